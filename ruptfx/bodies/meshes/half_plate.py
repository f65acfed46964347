"""One rectangular plate and its mirror image."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from ruptfx.bodies.meshes import MeshSource
from ruptfx.bodies.meshes._lattice import Lattice, columns_of, row_levels
from ruptfx.input.schema import Unit
from ruptfx.input.units import Coordinate, Length


class HalfPlate(MeshSource):
    """The upper of two equal plates that meet at y = 0; the lower one is its mirror image and is not meshed.

    `antisymmetric` motion (shear rupture, modes II and III) keeps the normal stress of the interface, `symmetric`
    motion (opening, mode I) has no slip. The interface is called `main`, the edges are `upper.left`, `upper.right`
    and `upper.top`.
    """

    example: ClassVar[str] = '{ kind = "half_plate", length = 12e-3, height = 4e-3, element_size = 1e-3 }'

    length: Length
    """Along x."""
    height: Length
    """Height of one plate."""
    element_size: Length
    """Along the interface, and across it next to the interface; the spacing of nodes is this over the order."""
    symmetry: Literal["antisymmetric", "symmetric"] = "antisymmetric"
    """`antisymmetric`: the plates shear each other; `symmetric`: they are pulled apart."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the heights of neighbouring elements away from the interface."""
    left: Coordinate = 0.0
    """x of the left end."""

    def lattice(self) -> Lattice:
        return plate(self.length, self.height, self.element_size, self.growth, self.left, self.symmetry)


def plate(length: float, height: float, size: float, growth: float, left: float, other_side: str) -> Lattice:
    """Return a plate above the interface `main`, whose minus side is not meshed."""
    levels = row_levels(height, size, growth)
    return Lattice(columns_of(left, length, size), {"upper": levels}, one_sided={"main": other_side})
