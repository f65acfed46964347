"""A vertical section across a fault that dips from the surface."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes._lattice import Lattice, affordable, row_levels
from ruptfx.input.schema import Unit
from ruptfx.input.units import Length


class DippingSection(MeshSource):
    """Ground on both sides of a fault that begins at the surface, y = 0, and dips towards +x.

    Body `plus` is its hanging wall, `minus` its foot wall, of parallelograms. The interface `main` cuts the section
    from the surface to its bottom: `fault_width` and, with elements that grow, `beyond`, where `prescribed_slip` lets
    it creep. Positions are distances down dip, and slip is that of `plus` down dip. The edges are `plus.top`, the
    surface of the Earth, `plus.bottom`, `plus.far`, and those of `minus`.
    """

    example: ClassVar[str] = (
        '{ kind = "dipping_section", fault_width = 6e-3, beyond = 3e-3, distance = 4e-3, element_size = 1e-3, '
        "dip = 60.0 }"
    )

    fault_width: Length
    """Down dip, with elements of one size."""
    beyond: Length
    """Distance of the bottom from this part, down dip."""
    distance: Length
    """Distance of the far edges from the fault, along x."""
    element_size: Length
    """Along the fault and next to it; the spacing of nodes is this over the order."""
    dip: Annotated[float, Field(ge=20, le=90), Unit("degree")]
    """Angle between the fault and the horizontal in degrees."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the sizes of neighbouring elements away from the fault, below it too."""

    def build(self) -> RawMesh:
        fault = np.linspace(0, self.fault_width, affordable(self.fault_width / self.element_size) + 1)
        below = self.fault_width + row_levels(self.beyond, self.element_size, self.growth)
        away = row_levels(self.distance, self.element_size, self.growth)
        down = np.concatenate([fault, below[1:]])
        raw = Lattice(down, {"plus": away, "minus": -away[::-1]}, ("main",)).build()
        angle = np.deg2rad(self.dip)
        distance, off = raw.points.T
        raw.points[:] = np.column_stack([distance * np.cos(angle) + off, -distance * np.sin(angle)])
        names = {"left": "top", "right": "bottom", "top": "far", "bottom": "far"}
        raw.edges = {f"{body}.{names[side]}": facets for (body, side), facets in (
            (edge.split("."), facets) for edge, facets in raw.edges.items()
        )}  # fmt: skip
        return raw
