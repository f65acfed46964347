"""Springs between an edge and the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.plugin import (
    Attached,
    EdgeAttachment,
    EdgeNodes,
    Energy,
    PointField,
    Springs,
    Stiffness,
)

if TYPE_CHECKING:
    from ruptfx.plugin import Kick, State, System


class Mat(EdgeAttachment):
    """Springs between an edge and the ground, the same in all directions."""

    example: ClassVar[str] = '{ kind = "mat", name = "mat", edge = "lower.bottom", stiffness = 1e12 }'
    stiffness: Stiffness
    """Traction per displacement."""

    def bind(self, model: System, key: str) -> MatSprings:
        return MatSprings(model, self, self.nodes_on(model, key))


class MatSprings(Attached):
    """The springs of the nodes."""

    energies = (Energy("mat", "energy of mats", "stored"),)
    fields = (PointField("force", "N", "force on the edge", vector=True),)

    def __init__(self, model: System, part: Mat, edge: EdgeNodes) -> None:
        super().__init__(model, part.name, edge.nodes)
        self.stiffness = part.stiffness * edge.area[:, None]

    def springs(self) -> list[Springs]:
        bound = np.zeros(self.model.nodes)
        bound[self.at] = self.stiffness[:, 0]
        return [Springs(f"the springs of attachments '{self.name}'", bound=bound)]

    def add_external(self, state: State, kick: Kick) -> None:
        self.of(state)["force"][:] = -self.stiffness * self.at_nodes(state.displacement)
        self.at_nodes(state.force, add=self.of(state)["force"])

    def add_energies(self, state: State, energies: dict[str, float]) -> None:
        held = -0.5 * self.of(state)["force"] * self.at_nodes(state.displacement)  # u_n k u_(n+1) / 2
        energies["mat"] += float(held[self.owned].sum())
