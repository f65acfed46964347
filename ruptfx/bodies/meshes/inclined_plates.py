"""A square plate that is cut in two along an inclined line."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes._lattice import Lattice, columns_of
from ruptfx.input.schema import Unit
from ruptfx.input.units import Length


class InclinedPlates(MeshSource):
    """A square plate, 0 <= x, y <= side, cut in two along a line through its middle; `upper` above `lower`.

    The interface is called `main`; the edges are `upper.left`, `upper.right`, `upper.top`, `lower.left`,
    `lower.right` and `lower.bottom`. Pressed from above by P, it carries P cos^2 and P sin cos of the inclination.
    """

    example: ClassVar[str] = '{ kind = "inclined_plates", side = 12e-3, inclination = "25 deg", element_size = 2e-3 }'

    side: Length
    """Side of the square."""
    inclination: Annotated[float, Field(gt=-0.77, lt=0.77), Unit("rad")]
    """Inclination of the interface, anticlockwise from x; a number is in radians."""
    element_size: Length
    """Element size along x; each plate has half as many elements from bottom to top as along x."""

    def build(self) -> RawMesh:
        columns = columns_of(0.0, self.side, self.element_size)
        rows = np.linspace(0.0, 1.0, max(1, round(len(columns) / 2)) + 1)
        raw = Lattice(columns, {"upper": rows, "lower": rows - 1}, ("main",)).build()
        x, part = raw.points.T
        cut = 0.5 * self.side + (x - 0.5 * self.side) * np.tan(self.inclination)
        raw.points[:, 1] = np.where(part > 0, cut + part * (self.side - cut), (1 + part) * cut)
        return raw
