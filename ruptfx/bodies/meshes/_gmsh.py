"""A Gmsh session; run as a program with FILE MESH FOLDER, it meshes a script or reads a mesh, and writes MSH 4.1."""

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

    def rotate(  # noqa: PLR0913
        self, entities: list[Entity], x: float, y: float, z: float, ax: float, ay: float, az: float, angle: float, /
    ) -> None: ...

    def fragment(self, objects: list[Entity], tools: list[Entity], /) -> tuple[list[Entity], list[list[Entity]]]: ...

    def intersect(self, objects: list[Entity], tools: list[Entity], /) -> tuple[list[Entity], list[list[Entity]]]: ...

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


def main(source: str, mesh: str) -> None:
    """Mesh a script, or read a mesh, and write the elements of all groups in binary MSH 4.1."""
    try:
        with session() as gmsh:
            if source.endswith(".geo"):
                gmsh.open(source)
                gmsh.model.mesh.generate(3 if gmsh.model.getEntities(3) else 2)
            else:
                gmsh.logger.start()
                gmsh.merge(source)
                if wrong := [line for line in gmsh.logger.get() if line.startswith(("Error", "Warning"))]:
                    sys.exit(wrong[0])
            gmsh.model.mesh.unpartition()
            name_groups(gmsh, not source.endswith(".geo"))
            for option, value in (("MshFileVersion", 4.1), ("Binary", 1), ("SaveAll", 0), ("SaveParametric", 0)):
                gmsh.option.setNumber(f"Mesh.{option}", value)
            gmsh.write(mesh)
    except UnicodeDecodeError:
        sys.exit("a name of a group is not in UTF-8; save the file as UTF-8")
    except Exception as error:
        sys.exit(str(error))


def name_groups(gmsh: ModuleType, keep: bool) -> None:
    """Name every physical group '#DIMENSION NUMBER NAME', as meshio drops groups without a name of their own.

    Parameters
    ----------
    keep : bool
        Keep cells of no group, in one that has the number 0 in its name; Gmsh does not write elements without a group.
    """
    groups = gmsh.model.getPhysicalGroups()
    names = {(dim, tag): gmsh.model.getPhysicalName(dim, tag).strip() for dim, tag in groups}  # padded in MED files
    for dim, tag in groups:
        gmsh.model.removePhysicalName(gmsh.model.getPhysicalName(dim, tag))
    for (dim, tag), name in names.items():
        gmsh.model.setPhysicalName(dim, tag, f"#{dim} {tag} {name}")
    meshed = [entity for entity in gmsh.model.getEntities() if gmsh.model.mesh.getElements(*entity)[0].size]
    top = max((dim for dim, _ in meshed), default=0)
    lonely = [tag for dim, tag in meshed if dim == top and not len(gmsh.model.getPhysicalGroupsForEntity(dim, tag))]
    if keep and groups and lonely:
        gmsh.model.setPhysicalName(top, gmsh.model.addPhysicalGroup(top, lonely), f"#{top} 0 ")


if __name__ == "__main__":
    os.chdir(sys.argv[3])  # after the imports: files that Gmsh writes of its own accord go there
    main(*sys.argv[1:3])
