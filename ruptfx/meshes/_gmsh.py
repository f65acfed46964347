"""A Gmsh session; run as a program with SCRIPT MESH FOLDER, it meshes a script in a folder."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import ModuleType


@contextmanager
def session() -> Iterator[ModuleType]:
    """Open a silent Gmsh session, closed in any case."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield gmsh
    finally:
        gmsh.finalize()
        with suppress(ValueError):  # not the main thread
            # Gmsh resets SIGPIPE to the system default, with which a broken pipe would end this process.
            signal.signal(signal.SIGPIPE, signal.SIG_IGN)


def main(script: str, mesh: str) -> None:
    """Mesh a script and write the mesh."""
    try:
        with session() as gmsh:
            gmsh.open(script)
            gmsh.model.mesh.generate(3 if gmsh.model.getEntities(3) else 2)
            gmsh.write(mesh)
    except Exception as error:
        sys.exit(str(error))


if __name__ == "__main__":
    os.chdir(sys.argv[3])  # after the imports: files that Gmsh writes of its own accord go there
    main(*sys.argv[1:3])
