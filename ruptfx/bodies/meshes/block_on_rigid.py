"""A rectangular block on a rigid base, flat or rough."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.bodies.meshes import Base, MeshSource, RawMesh
from ruptfx.bodies.meshes._lattice import Lattice
from ruptfx.bodies.meshes.half_plate import plate
from ruptfx.bodies.meshes.rough_plates import RoughPlate, in_plan, least, overlap
from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import CaseError, Part, Unit
from ruptfx.input.units import Coordinate, Length, VaryingHeight


class RoughBase(Part):
    """A rigid base with a profile, on which the block can slide any distance."""

    length: Length
    """Along x."""
    left: Coordinate = 0.0
    """x of the left end."""
    width: Length | None = None
    """Along y, under a solid."""
    front: Coordinate = 0.0
    """y of the front, under a solid."""
    profile: VaryingHeight = 0.0
    """Height by x, or x and y; the base is shifted so that its highest point under the block touches it."""


class BlockOnRigid(MeshSource):
    """A deformable block on a rigid base at rest, at y = 0; slip and opening are the block's own displacement.

    A base with a profile needs the table `[faults.main.sliding]`.
    The interface is called `main`; the edges are `upper.left`, `upper.right` and `upper.top`. A block with a `width`
    is a solid on a base at z = 0, z is up, and it has the edges `upper.front` (lowest y) and `upper.back`, too.
    """

    example: ClassVar[str] = '{ kind = "block_on_rigid", length = 12e-3, height = 4e-3, element_size = 1e-3 }'

    length: Length
    """Along x."""
    height: Length
    """Across the interface."""
    element_size: Length
    """Along the interface, and across it next to the interface; the spacing of nodes is this over the order."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the sizes of neighbouring elements away from the interface, and beyond `fine`."""
    left: Coordinate = 0.0
    """x of the left end."""
    width: Length | None = None
    """Along y, of a solid."""
    front: Coordinate = 0.0
    """y of the front of a solid."""
    fine: Length | None = None
    """Length and width in the middle of a solid in which elements have their size; left out, it is the block."""
    chamfer: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Length and height cut off the two corners at the interface: sharp corners carry most of the load."""
    base: RoughBase | None = None
    """Base for finite sliding, rough or smooth; without it the base is flat and infinite."""

    @model_validator(mode="after")
    def _leaves_something(self) -> BlockOnRigid:
        if self.chamfer >= min(0.5 * self.length, self.height):
            raise ValueError(
                f"chamfer = {self.chamfer:g} m: it must be less than half of the length, {0.5 * self.length:g} m, and "
                f"than the height, {self.height:g} m"
            )
        return self

    @model_validator(mode="after")
    def _of_one_dimension(self) -> BlockOnRigid:
        if self.width is None:
            if self.fine is not None:
                raise ValueError(
                    f"fine = {self.fine:g} m: only solids are refined in their middle; add width, or remove it"
                )
            if self.base is not None and self.base.width is not None:
                raise ValueError(f"base.width = {self.base.width:g} m: the block has none; add width, or remove it")
            return self
        if self.chamfer:
            raise ValueError(f"chamfer = {self.chamfer:g} m: only plane blocks have chamfers; remove it, or width")
        if self.base is not None and self.base.width is None:
            raise ValueError(f"base.width is missing and width = {self.width:g} m; add it, or remove width")
        return self

    def build(self) -> RawMesh:
        raw = self._block().build() if self.width is None else self._solid()
        if self.base is not None:
            ends, *sides = _base_intervals(self.base)
            raw.bases["main"] = Base(in_plan(self.base.profile, 1 + len(sides)), self._level(self.base), ends, *sides)
        return raw

    def lattice(self) -> Lattice | None:
        return self._block() if self.base is None and self.width is None else None

    def _plate(self) -> RoughPlate:
        """Return the block as a plate with a plane surface."""
        names = ("length", "height", "element_size", "growth", "left", "width", "front", "fine")
        return RoughPlate(**{name: getattr(self, name) for name in names})

    def _solid(self) -> RawMesh:
        points, cells, sides = self._plate().build(1, 1, "mesh")
        return RawMesh(
            cell="hexahedron", points=points, cells=cells, bodies=["upper"], cell_body=np.zeros(len(cells), dtype=int),
            edges={f"upper.{side}": facets for side, facets in sides.items() if side != "bottom"},
            interfaces={"main": (sides["bottom"], sides["bottom"])}, one_sided={"main": "rigid"},
        )  # fmt: skip

    def _level(self, base: RoughBase) -> float:
        """Return the level at which the base touches the block from below [m]."""
        (first, last), *across = self._plate().intervals
        block = [(first + self.chamfer, last - self.chamfer), *across]
        extent = _base_intervals(base)
        common = overlap(block, extent, ("block", "base"), ("mesh.base.left", "mesh.base.front"))
        corners = np.stack(np.meshgrid(*extent), axis=-1).reshape(-1, len(extent))
        try:
            profile = in_plan(base.profile, len(extent))
            evaluate(profile, corners if len(extent) > 1 else corners[:, 0])
            return least(lambda places: -evaluate(profile, places), common, self.element_size)
        except CaseError as error:
            raise CaseError(f"mesh.base.profile: {error}") from None

    def _block(self) -> Lattice:
        lattice = plate(self.length, self.height, self.element_size, self.growth, self.left, "rigid")
        if not self.chamfer:
            return lattice
        (levels,) = lattice.levels.values()
        if len(levels) == 2:
            levels = np.insert(levels, 1, self.chamfer)
        levels[1 + np.argmin(np.abs(levels[1:-1] - self.chamfer))] = self.chamfer  # a row of elements must end there
        return replace(lattice, levels={"upper": levels}, chamfer=self.chamfer)


def _base_intervals(base: RoughBase) -> list[tuple[float, float]]:
    """Return first and last x, and y under a solid [m]."""
    along = (base.left, base.left + base.length)
    return [along] if base.width is None else [along, (base.front, base.front + base.width)]
