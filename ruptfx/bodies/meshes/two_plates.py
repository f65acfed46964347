"""Two rectangular plates, one on the other."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.meshes import MeshSource
from ruptfx.bodies.meshes._lattice import Lattice, columns_of, row_levels
from ruptfx.input.schema import Unit
from ruptfx.input.units import Coordinate, Length


class TwoPlates(MeshSource):
    """Two rectangular plates of structured quadrilaterals that meet at y = 0, `upper` above `lower`.

    The interface is called `main`; the edges are `upper.left`, `upper.right`, `upper.top`, `lower.left`,
    `lower.right` and `lower.bottom`.
    """

    example: ClassVar[str] = '{ kind = "two_plates", length = 12e-3, height = 4e-3, element_size = 1e-3, growth = 1.3 }'

    length: Length
    """Along x."""
    height: Length
    """Height of each plate."""
    element_size: Length
    """Along the interface, and across it next to the interface; the spacing of nodes is this over the order."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the heights of neighbouring elements away from the interface."""
    left: Coordinate = 0.0
    """x of the left end."""

    def levels(self) -> np.ndarray:
        """Return heights of the element rows above the interface, shape (rows + 1,) [m]."""
        return row_levels(self.height, self.element_size, self.growth)

    def lattice(self) -> Lattice:
        levels = self.levels()
        return Lattice(
            columns_of(self.left, self.length, self.element_size), {"upper": levels, "lower": -levels[::-1]}, ("main",)
        )
