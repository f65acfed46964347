"""A rectangular block on a rigid base."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

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

    def lattice(self) -> Lattice:
        return plate(self.length, self.height, self.element_size, self.growth, self.left, "rigid")
