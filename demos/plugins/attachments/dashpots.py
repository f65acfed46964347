"""Dashpots between an edge and the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

from ruptfx.plugin import Attached, EdgeAttachment, EdgeNodes, Floats, PointField, Positive, Reaction, StepEnd, Unit

if TYPE_CHECKING:
    from ruptfx.plugin import Kick, State, System


class Dashpots(EdgeAttachment):
    """Dashpots between an edge and the ground, with the traction -c v in each direction."""

    example: ClassVar[str] = '{ kind = "dashpots", name = "bed", edge = "lower.bottom", viscosity = 2e6 }'
    implicit: ClassVar[bool] = True
    inertia: ClassVar[bool] = True
    viscosity: Annotated[Positive, Unit("Pa s/m")]
    """Traction per velocity."""

    def bind(self, model: System, key: str) -> Bed:
        return Bed(model, self, self.nodes_on(model, key))


class Bed(Attached):
    """The dashpots of the nodes; steps apply their forces, and the loss is in the column `damping`."""

    fields = (PointField("force", "N", "force on the edge", vector=True),)

    def __init__(self, model: System, part: Dashpots, edge: EdgeNodes) -> None:
        super().__init__(model, part.name, edge.nodes)
        self.viscosity = part.viscosity * edge.area[:, None]

    def dashpot(self) -> Floats:
        total = super().dashpot()
        self.at_nodes(total, add=self.viscosity)
        return total

    def account(self, state: State, kick: Kick) -> None:
        self.of(state)["force"][:] = -self.viscosity * self.mean_velocity(state)

    def respond(self, state: State, end: StepEnd) -> Reaction:
        return self.no_reaction()

    def force_of(self, state: State) -> Reaction:
        return self.no_reaction()

    def advance(self, state: State, end: StepEnd, reaction: Reaction) -> None:
        self.of(state)["force"][:] = -self.viscosity * self.at_nodes(state.velocity)
