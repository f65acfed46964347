"""Springs between an edge and the ground that harden."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.plugin import (
    Attached,
    EdgeAttachment,
    EdgeNodes,
    Energy,
    Floats,
    PointField,
    Reaction,
    Springs,
    StepEnd,
    Stiffness,
    Unit,
)

if TYPE_CHECKING:
    from ruptfx.plugin import Kick, State, System


class HardeningSprings(EdgeAttachment):
    """Springs with the traction k u + h u^3 in each direction (Duffing)."""

    example: ClassVar[str] = (
        '{ kind = "hardening_springs", name = "pads", edge = "lower.bottom", stiffness = 1e12, hardening = 1e20 }'
    )
    implicit: ClassVar[bool] = True
    closure: ClassVar[float] = 1e-10
    why_open: ClassVar[str] = "leapfrog conserves a quadratic energy only"
    stiffness: Stiffness
    """Traction per displacement."""
    hardening: Annotated[float, Field(ge=0), Unit("Pa/m3")]
    """Traction per cube of the displacement."""

    def bind(self, model: System, key: str) -> Pads:
        return Pads(model, self, self.nodes_on(model, key))


class Pads(Attached):
    """The springs of the nodes."""

    energies = (Energy("pads", "energy of pads", "stored"),)
    fields = (PointField("force", "N", "force on the edge", vector=True),)

    def __init__(self, model: System, part: HardeningSprings, edge: EdgeNodes) -> None:
        super().__init__(model, part.name, edge.nodes)
        self.linear, self.cubic = part.stiffness * edge.area[:, None], part.hardening * edge.area[:, None]

    def _force(self, u: Floats) -> Floats:
        return -self.linear * u - self.cubic * u**3

    def springs(self) -> list[Springs]:
        bound = np.zeros(self.model.nodes)
        bound[self.at] = self.linear[:, 0]
        return [Springs(f"the springs of attachments '{self.name}'", bound=bound)]

    def add_external(self, state: State, kick: Kick) -> None:
        self.of(state)["force"][:] = self._force(self.at_nodes(state.displacement))
        self.at_nodes(state.force, add=self.of(state)["force"])

    def respond(self, state: State, end: StepEnd) -> Reaction:
        u = self.at_nodes(end.displacement)
        slope = (self.linear + 3 * self.cubic * u**2)[:, :, None] * np.eye(u.shape[1])
        return Reaction(self.at, self._force(u), slope, {"force": self._force(u)})

    def force_of(self, state: State) -> Reaction:
        c = self.model.components
        return Reaction(self.at, self.of(state)["force"], np.zeros((len(self.at), c, c)), self.of(state))

    def advance(self, state: State, end: StepEnd, reaction: Reaction) -> None:
        self.of(state)["force"][:] = reaction.fields["force"]

    def add_energies(self, state: State, energies: dict[str, float]) -> None:
        before, u = self.at_nodes(state.at_faults()[1]), self.at_nodes(state.displacement)  # u_n and u_(n+1)
        stored = 0.5 * self.linear * before * u + 0.25 * self.cubic * (before * u) ** 2
        energies["pads"] += float(stored[self.owned].sum())
