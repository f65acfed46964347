"""A rectangular block on a rigid base, flat or rough."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.bodies.meshes import Base, MeshSource, RawMesh
from ruptfx.bodies.meshes._lattice import Lattice, affordable
from ruptfx.bodies.meshes.half_plate import plate
from ruptfx.bodies.meshes.rough_plates import SAMPLES
from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import CaseError, Part, Unit
from ruptfx.input.units import Coordinate, Length, VaryingHeight


class RoughBase(Part):
    """A rigid base with a profile, on which the block can slide any distance."""

    length: Length
    """Along x."""
    left: Coordinate = 0.0
    """x of the left end."""
    profile: VaryingHeight = 0.0
    """Height by x; the base is shifted so that its highest point under the block touches it."""


class BlockOnRigid(MeshSource):
    """A deformable block on a rigid base at rest, at y = 0; slip and opening are the block's own displacement.

    A base with a profile needs the table `[faults.main.sliding]`.
    The interface is called `main`; the edges are `upper.left`, `upper.right` and `upper.top`.
    """

    example: ClassVar[str] = '{ kind = "block_on_rigid", length = 12e-3, height = 4e-3, element_size = 1e-3 }'

    length: Length
    """Along x."""
    height: Length
    """Along y."""
    element_size: Length
    """Along the interface, and across it next to the interface; the spacing of nodes is this over the order."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the heights of neighbouring elements away from the interface."""
    left: Coordinate = 0.0
    """x of the left end."""
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

    def build(self) -> RawMesh:
        raw = self._block().build()
        if self.base is not None:
            left, right = self.base.left, self.base.left + self.base.length
            raw.bases["main"] = Base(self.base.profile, self._level(self.base), (left, right))
        return raw

    def lattice(self) -> Lattice | None:
        return self._block() if self.base is None else None

    def _level(self, base: RoughBase) -> float:
        """Return the level at which the base touches the block from below [m]."""
        ends = self.left + self.chamfer, self.left + self.length - self.chamfer
        first, last = max(base.left, ends[0]), min(base.left + base.length, ends[1])
        if first >= last:
            raise CaseError(
                f"mesh.base.left = {base.left:g}: the block, from {ends[0]:g} to {ends[1]:g} m, is beside its base, "
                f"from {base.left:g} to {base.left + base.length:g} m; put it on that"
            )
        x = np.linspace(first, last, affordable(SAMPLES * (last - first) / self.element_size) + 1)
        try:
            evaluate(base.profile, np.array([base.left, base.left + base.length]))
            return -float(np.max(evaluate(base.profile, x)))
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
