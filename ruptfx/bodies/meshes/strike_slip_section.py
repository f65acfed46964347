"""A vertical section across a strike-slip fault, one side of it."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes._lattice import Lattice, affordable, row_levels
from ruptfx.input.schema import Unit
from ruptfx.input.units import Length


class StrikeSlipSection(MeshSource):
    """Ground on one side of a vertical fault; the other is its mirror image that moves the opposite way.

    x is depth, y the distance from the fault. The interface `main` reaches from the surface, `upper.left`, to
    `fault_depth`; below, the fault plane is the edge `upper.below`, which a driven boundary moves at half the rate of
    the plates. The other edges are `upper.right` at the greatest depth and `upper.top` far from the fault.
    """

    example: ClassVar[str] = (
        '{ kind = "strike_slip_section", fault_depth = 8e-3, depth = 12e-3, distance = 4e-3, element_size = 1e-3 }'
    )

    fault_depth: Length
    """Depth at which the interface ends."""
    depth: Length
    """Depth of the section."""
    distance: Length
    """Distance of the far edge from the fault."""
    element_size: Length
    """Along the interface, and next to it; the spacing of nodes is this over the order."""
    growth: Annotated[float, Field(ge=1, le=2), Unit("1")] = 1.0
    """Ratio of the sizes of neighbouring elements away from the interface, below it too."""

    @model_validator(mode="after")
    def _deep_enough(self) -> StrikeSlipSection:
        if self.depth <= self.fault_depth:
            raise ValueError(f"depth = {self.depth:g}: must be more than fault_depth = {self.fault_depth:g}")
        return self

    def build(self) -> RawMesh:
        fault = np.linspace(0, self.fault_depth, affordable(self.fault_depth / self.element_size) + 1)
        below = self.fault_depth + row_levels(self.depth - self.fault_depth, self.element_size, self.growth)
        x, y = np.concatenate([fault, below[1:]]), row_levels(self.distance, self.element_size, self.growth)
        raw = Lattice(x, {"upper": y}, one_sided={"main": "antisymmetric"}).build()
        interface, raw.edges["upper.below"] = np.split(raw.interfaces["main"][0], [len(fault) - 1])
        raw.interfaces["main"] = interface, interface
        return raw
