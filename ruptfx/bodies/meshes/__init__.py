"""Mesh sources, one per file; the file name is the `kind` in a case.

A mesh source fills a `RawMesh` on rank 0, which `ruptfx.bodies.space.bodies` splits over the ranks; or it returns a
`Lattice`, of which every rank makes its own part.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, ClassVar, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import Alternative, Part, alternative
from ruptfx.input.units import Length, Velocity

if TYPE_CHECKING:
    from ruptfx.bodies.meshes._bricks import Bricks
    from ruptfx.bodies.meshes._lattice import Lattice

    AnyLattice: TypeAlias = Lattice | Bricks

# Vertices of the facets of a cell in DOLFINx order.
FACETS: dict[str, list[tuple[int, ...]]] = {
    "triangle": [(1, 2), (0, 2), (0, 1)],
    "quadrilateral": [(0, 1), (0, 2), (1, 3), (2, 3)],
    "tetrahedron": [(1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)],
    "hexahedron": [(0, 1, 2, 3), (0, 1, 4, 5), (0, 2, 4, 6), (1, 3, 5, 7), (2, 3, 6, 7), (4, 5, 6, 7)],
}

COINCIDENT = 1e-4
"""Largest distance of nodes that coincide, over the length of the shortest side of an element or facet beside them."""


@dataclass(frozen=True)
class Base:
    """A rigid surface at rest that a body slides over.

    Attributes
    ----------
    profile : float or Profile
        Height by x, or x and y [m].
    level : float
        Offset of the profile [m].
    ends : (float, float)
        x of both ends [m].
    sides : (float, float), or None
        y of the front and the back of a surface [m]; None of a line.
    """

    profile: object
    level: float
    ends: tuple[float, float]
    sides: tuple[float, float] | None = None

    def points(self, places: np.ndarray) -> np.ndarray:
        """Return points at x, shape (n,), as (n, 2); or at x and y, shape (n, 2), as (n, 3) [m]."""
        return np.column_stack([places, self.level + evaluate(self.profile, places)])


@dataclass
class RawMesh:
    """Bodies with their own nodes on either side of every interface, before partitioning.

    Attributes
    ----------
    cell : str
        quadrilateral, triangle, hexahedron or tetrahedron.
    points : ndarray, shape (vertices, dim)
        Coordinates [m].
    cells : ndarray of int, shape (cells, vertices per cell)
        In DOLFINx order (tensor order for quadrilaterals and hexahedra); with `order` above 1 all nodes of a cell, the
        vertices first.
    bodies : list of str
    cell_body : ndarray of int, shape (cells,)
        Index into `bodies`.
    edges : dict of str to ndarray of int, shape (facets, vertices per facet)
        Named boundary facets, ``"upper.left"``.
    interfaces : dict of str to (ndarray, ndarray)
        Facets of the plus and of the minus side in the same order, vertex by vertex at the same place.
    one_sided : dict of str to str
        Interfaces whose minus side is not meshed (both facets are then those of the plus side), and its kind:
        ``rigid``, or the mirror image of the plus side, ``antisymmetric`` (modes II and III) or ``symmetric``.
    non_matching : set of str
        Interfaces with non-matching sides: their facets are lists of different length, each in any order.
    bases : dict of str to Base
        Rigid surface of one-sided interfaces with finite sliding.
    reference_normals : dict of str to ndarray, shape (3,)
        Normal of the reference plane of rough interfaces, in which positions are; of either sign.
    mirror_planes : dict of str to str
        Edge in which the plane of a mirrored interface continues, by interface: the whole is welded there.
    open_facets : ndarray of int, shape (facets, 2)
        Inner facets that are initial cracks, in bodies with `[fracture]`.
    joints : dict of str to ndarray of int, shape (facets, 2)
        Named inner facets, which may have their own laws, in bodies with `[fracture]`.
    order : int
        Order of the polynomials that map the reference cell: above 1, cells are curved.
    strike : int or None
        Axis of the first tangent of all interfaces where it does not follow from their normals.
    """

    cell: str
    points: np.ndarray
    cells: np.ndarray
    bodies: list[str]
    cell_body: np.ndarray
    edges: dict[str, np.ndarray] = field(default_factory=dict)
    interfaces: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    one_sided: dict[str, str] = field(default_factory=dict)
    non_matching: set[str] = field(default_factory=set)
    bases: dict[str, Base] = field(default_factory=dict)
    reference_normals: dict[str, np.ndarray] = field(default_factory=dict)
    mirror_planes: dict[str, str] = field(default_factory=dict)
    open_facets: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    joints: dict[str, np.ndarray] = field(default_factory=dict)
    order: int = 1
    strike: int | None = None


class AlongStrike(Part):
    """A section that repeats along z with a period; slip and friction vary along z, bodies do not.

    The interfaces are surfaces whose points are equidistant along z, around z = 0. Beyond the fault, which reaches
    from z = -length / 2 to length / 2, they are locked, or creep.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"along strike"})

    length: Length
    """Length of the fault along z, in which its friction acts."""
    period: Length
    """Period along z, at least the length: images of the fault are this far apart."""
    points: Annotated[int, Field(ge=4)]
    """Number of points along z in a period."""
    creep: Velocity = 0.0
    """Slip rate along z beyond the ends of the fault; without it they are locked."""

    @model_validator(mode="after")
    def _reaches_over_the_fault(self) -> AlongStrike:
        if self.period < self.length:
            raise ValueError(f"period = {self.period:g}: must be at least length = {self.length:g}")
        if self.creep and not self.beyond.any():
            raise ValueError(
                f"creep = {self.creep:g}: no point is beyond the fault; increase period, or leave creep out"
            )
        return self

    @property
    def spacing(self) -> float:
        """Distance of neighbouring points [m]."""
        return self.period / self.points

    @property
    def positions(self) -> np.ndarray:
        """z of the points [m], shape (points,)."""
        return np.asarray((np.arange(self.points) - 0.5 * (self.points - 1)) * self.spacing)

    @property
    def beyond(self) -> np.ndarray:
        """True for points beyond the fault, shape (points,)."""
        return np.asarray(np.abs(self.positions) > self.half_length)

    @property
    def half_length(self) -> float:
        """Half of the length, beyond rounding of coordinates [m]."""
        return 0.5 * self.length * (1 + 1e-9)


class MeshSource(Alternative):
    """Contract of a mesh source."""

    example: ClassVar[str] = ""
    """Example table of a few elements, which the contract tests build; its files are in `tests/data`."""

    along_strike: AlongStrike | None = None
    """Of a 2D mesh: it is a section that repeats along z, and interfaces are surfaces. Needs `plane = "solid"` and
    `stepper.kind = "quasi_dynamic"`."""

    def build(self) -> RawMesh:
        """Return the mesh; called on rank 0 only.

        Raises
        ------
        RuptfxError
            If the mesh is invalid, with the reason.
        """
        lattice = self.lattice()
        if lattice is None:
            raise NotImplementedError
        return lattice.build()

    def remarks(self) -> dict[str, str]:
        """Return facts about the source that `ruptfx check` shows, by what they are about."""
        return {}

    def lattice(self) -> AnyLattice | None:
        """Return the lattice that `build` would make, or None; called on every rank, instead of `build`."""
        return None


if TYPE_CHECKING:
    AnyMesh = MeshSource
else:
    AnyMesh = alternative("ruptfx.bodies.meshes")

SHARED = ("lobatto", "strip")
"""Files of this folder that are no kinds."""
