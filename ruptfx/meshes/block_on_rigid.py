"""A rectangular block on a rigid base."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.meshes import MeshSource
from ruptfx.meshes._lattice import Lattice
from ruptfx.meshes.half_plate import plate
from ruptfx.schema import Unit
from ruptfx.units import Coordinate, Length


class BlockOnRigid(MeshSource):
    """A deformable block on a rigid base at rest, at y = 0; slip and opening are the block's own displacement.

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
    """What is cut off the two corners at the interface, along and across it: sharp corners carry most of the load."""

    @model_validator(mode="after")
    def _leaves_something(self) -> BlockOnRigid:
        if self.chamfer >= min(0.5 * self.length, self.height):
            raise ValueError(
                f"chamfer = {self.chamfer:g} m: it must be less than half of the length, {0.5 * self.length:g} m, and "
                f"than the height, {self.height:g} m"
            )
        return self

    def lattice(self) -> Lattice:
        lattice = plate(self.length, self.height, self.element_size, self.growth, self.left, "rigid")
        if not self.chamfer:
            return lattice
        (levels,) = lattice.levels.values()
        if len(levels) == 2:
            levels = np.insert(levels, 1, self.chamfer)
        levels[1 + np.argmin(np.abs(levels[1:-1] - self.chamfer))] = self.chamfer  # where a row of elements ends
        return replace(lattice, levels={"upper": levels}, chamfer=self.chamfer)
