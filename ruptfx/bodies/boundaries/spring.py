"""Edges on an elastic foundation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.boundaries import Action, Support
from ruptfx.bodies.boundaries._edge_sides import EdgeSides
from ruptfx.input.schema import Unit
from ruptfx.laws.materials import Plane

if TYPE_CHECKING:
    from ruptfx.bodies.space.edges import Edge
    from ruptfx.platform.fem import Expr

Foundation = Annotated[float, Field(ge=0), Unit("Pa/m")]


class Spring(EdgeSides):
    """Elastic foundation: traction against the displacement from the initial state, k_n normal, k_t tangential.

    Its energy counts as strain energy, and the stable time step takes its stiffness into account.
    Source: Winkler (1867).
    """

    example: ClassVar[str] = '{ kind = "spring", edge = "lower.bottom", normal = 2e12, tangential = 1e12 }'
    source: ClassVar[str] = "Winkler (1867)"

    normal: Foundation = 0.0
    """Traction per displacement along the normal."""
    tangential: Foundation = 0.0
    """Traction per displacement along the edge."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        if components == "z" and self.normal:
            raise ValueError(f"{key}.normal = {self.normal:g}: plane = 'antiplane' moves in z only; use tangential")

    def act_on(self, edge: Edge, key: str) -> Action:
        # Bodies that repeat along strike have a normal in the plane of their section, and move along strike, too.
        c, plane = edge.model.components, edge.model.mesh.geometry.dim
        if not self.normal + self.tangential:  # of which UFL makes no form
            return Action()

        def column(j: int) -> np.ndarray:
            """Force of a unit displacement in one direction."""

            def density(tests: list[Expr], n: Expr) -> Expr:
                if c == 1:
                    return self.tangential * tests[0]
                across = self.normal - self.tangential
                out = n[j] * sum(n[i] * tests[i] for i in range(plane)) if j < plane else 0.0
                return self.tangential * tests[j] + across * out

            if c > 1 and j >= plane and not self.tangential:  # UFL makes no form of it
                return np.zeros((len(edge.nodes), c))

            return edge.integral(density, self.limits).reshape(-1, c)[edge.nodes]

        stiffness = np.stack([column(j) for j in range(c)], axis=2)
        self.refuse_empty(key, edge, stiffness)
        return Action(support=Support(edge.nodes, 0.5 * (stiffness + stiffness.swapaxes(1, 2))))
