"""A Gmsh session; run as a program with SCRIPT MESH FOLDER, it meshes a script in a folder."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import ModuleType
from typing import Protocol, TypeAlias

Entity: TypeAlias = tuple[int, int]
"""Dimension and tag of a point, a line or a surface."""


class Geometry(Protocol):
    """`gmsh.model.occ`, as far as the sources of meshes use it; Gmsh has no annotations."""

    def addPoint(self, x: float, y: float, z: float, /) -> int: ...

    def addLine(self, start: int, end: int, /) -> int: ...

    def addRectangle(self, x: float, y: float, z: float, width: float, height: float, /) -> int: ...

    def addDisk(self, x: float, y: float, z: float, half_width: float, half_height: float, /) -> int: ...

    def rotate(
        self, entities: list[Entity], x: float, y: float, z: float, ax: float, ay: float, az: float, angle: float, /
    ) -> None: ...

    def fragment(
        self, objects: list[Entity], tools: list[Entity], /
    ) -> tuple[list[Entity], list[list[Entity]]]: ...

    def intersect(
        self, objects: list[Entity], tools: list[Entity], /
    ) -> tuple[list[Entity], list[list[Entity]]]: ...

    def synchronize(self) -> None: ...


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
