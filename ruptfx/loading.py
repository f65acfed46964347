"""What acts on the bodies: initial stress, driven, loaded and absorbing edges.

The initial stress is in equilibrium with what presses the bodies together; the displacement is measured from that
state, so a driven edge or a traction here is what comes on top of it. Edges that are not named are free to move under
their initial load.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from ruptfx.schema import Part, Unit
from ruptfx.units import Time, VaryingPressure, VaryingStress, Velocity

Component = Literal["x", "y", "z"]
Range = Annotated[list[float], Field(min_length=2, max_length=2), Unit("m")]


class InitialStress(Part):
    """Stress an interface carries before anything happens."""

    normal: VaryingPressure
    """Normal stress, positive in compression."""
    shear: VaryingStress = 0.0
    """Shear traction along the (first) tangent."""


class _Edge(Part):
    edge: str
    """``body.side``, for example ``upper.left``."""


class Driven(_Edge):
    """The edge moves with a given velocity in one direction and is free in the others."""

    kind: Literal["driven"]
    component: Component
    velocity: Velocity
    ramp: Time = 0.0
    """Time over which the velocity grows linearly from zero."""
    x_range: Range | None = None
    y_range: Range | None = None
    """Only the part of the edge within these coordinates moves."""


class Traction(_Edge):
    """A traction on the edge on top of the initial load."""

    kind: Literal["traction"]
    traction: Annotated[list[float], Field(min_length=1, max_length=3), Unit("Pa")]
    ramp: Time = 0.0


class Absorbing(_Edge):
    """Lysmer dashpots rho c_p (normal) and rho c_s (tangential); exact for plane waves at normal incidence.

    Source: Lysmer and Kuhlemeyer (1969).
    """

    kind: Literal["absorbing"]


class Free(_Edge):
    """No traction beyond the initial load: what an edge is when it is not named."""

    kind: Literal["free"]


BOUNDARIES: dict[str, type[_Edge]] = {
    "driven": Driven, "traction": Traction, "absorbing": Absorbing, "free": Free,
}  # fmt: skip


def _tag(value: Any) -> str:
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return f"<{kind}>"


AnyBoundary = Annotated[
    Annotated[Driven, Tag("<driven>")] | Annotated[Traction, Tag("<traction>")]
    | Annotated[Absorbing, Tag("<absorbing>")] | Annotated[Free, Tag("<free>")],
    Discriminator(
        _tag, custom_error_type="unknown_kind",
        custom_error_message=f"a boundary needs a 'kind', one of: {', '.join(BOUNDARIES)}",
    ),
]  # fmt: skip


def ramp(time: float, duration: float) -> float:
    """Linear growth from 0 to 1."""
    return 1.0 if duration <= 0 else min(max(time / duration, 0.0), 1.0)


class Loads:
    """The boundaries of a case as arrays over the local degrees of freedom.

    Attributes
    ----------
    driven : list of (dofs, Driven)
    dashpot : ndarray, shape (nodes * components,)
        Damping force per velocity [N s/m].
    force : list of (ndarray, Traction)
        Nodal force of the full traction [N].
    """

    def __init__(self, model: Any, boundaries: Sequence[_Edge]) -> None:
        self._model = model
        self.driven: list[tuple[np.ndarray, Driven]] = []
        self.force: list[tuple[np.ndarray, Traction]] = []
        self.dashpot = np.zeros(model.nodes * model.components)
        for number, boundary in enumerate(boundaries):
            tag = model.bodies.tag(boundary.edge, f"boundaries.{number}.edge")
            if isinstance(boundary, Driven):
                self.driven.append((self._driven_dofs(boundary, tag), boundary))
            elif isinstance(boundary, Traction):
                self.force.append((model.edge_force(tag, boundary.traction), boundary))
            elif isinstance(boundary, Absorbing):
                self.dashpot += model.edge_dashpot(tag)

    def _driven_dofs(self, boundary: Driven, tag: int) -> np.ndarray:
        nodes = self._model.edge_nodes(tag)
        x = self._model.coordinates[nodes]
        slack = 1e-9 * np.ptp(self._model.coordinates, axis=0).max(initial=0)
        for axis, limits in enumerate((boundary.x_range, boundary.y_range)):
            if limits is not None:
                keep = (x[:, axis] >= limits[0] - slack) & (x[:, axis] <= limits[1] + slack)
                nodes, x = nodes[keep], x[keep]
        return nodes * self._model.components + self._model.component(boundary.component)

    @property
    def acting(self) -> np.ndarray:
        """True for every degree of freedom a boundary acts on."""
        acting = self.dashpot != 0
        for dofs, _ in self.driven:
            acting[dofs] = True
        for force, _ in self.force:
            acting |= force != 0
        return acting
