"""A fibre in a matrix, as bodies of revolution."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.bodies.meshes import MeshSource
from ruptfx.bodies.meshes._lattice import Lattice, columns_of, row_levels
from ruptfx.input.schema import Unit
from ruptfx.input.units import Coordinate, Length


class FibreInMatrix(MeshSource):
    """A fibre along the x axis and the matrix around it, for `plane = "axisymmetric"`: y is the radius.

    The interface is called `main`, its plus side is the `matrix`; the edges are `matrix.left`, `matrix.right`,
    `matrix.top`, `fibre.left`, `fibre.right` and `fibre.bottom`, which is the axis or the surface of the hole.
    """

    example: ClassVar[str] = (
        '{ kind = "fibre_in_matrix", radius = 2e-3, outer_radius = 5e-3, length = 8e-3, element_size = 1e-3 }'
    )

    radius: Length
    """Radius of the fibre."""
    outer_radius: Length
    """Outer radius of the matrix."""
    length: Length
    """Length of both bodies along x."""
    element_size: Length
    """Along the interface, and across it next to the interface; the spacing of nodes is this over the order."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the heights of neighbouring elements away from the interface."""
    hole: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Radius of a hole along the fibre."""
    left: Coordinate = 0.0
    """x of the left end."""

    @model_validator(mode="after")
    def _in_order(self) -> FibreInMatrix:
        if not self.hole < self.radius < self.outer_radius:
            raise ValueError(
                f"radius = {self.radius:g} m: must lie between hole = {self.hole:g} m and outer_radius = "
                f"{self.outer_radius:g} m"
            )
        return self

    def lattice(self) -> Lattice:
        matrix, fibre = (
            row_levels(height, self.element_size, self.growth)
            for height in (self.outer_radius - self.radius, self.radius - self.hole)
        )
        inward = self.radius - fibre[::-1]
        inward[0] = self.hole
        return Lattice(
            columns_of(self.left, self.length, self.element_size),
            {"matrix": self.radius + matrix, "fibre": np.asarray(inward)},
            ("main",),
        )
