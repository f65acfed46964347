"""Point masses on springs along an edge."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.bodies.boundaries import Component, check_component
from ruptfx.input.fields import Energy, PointField
from ruptfx.input.schema import Unit
from ruptfx.input.units import Frequency
from ruptfx.interfaces.attachments import Attached, EdgeAttachment, EdgeNodes
from ruptfx.interfaces.mechanisms import Floats, Reaction, Springs, StepEnd
from ruptfx.laws.materials import Plane

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick
    from ruptfx.interfaces.mechanisms.system import System

MassPerArea = Annotated[float, Field(gt=0), Unit("kg/m2")]


class Resonators(EdgeAttachment):
    """Masses on springs, evenly distributed along an edge: m a = k (u - x), and the force k (x - u) on the edge.

    They reflect waves near their own frequency, and make a band without surface waves above it. They begin at rest
    relative to the edge. Their kinetic and elastic energy is the column `resonators`.
    """

    example: ClassVar[str] = (
        '{ kind = "resonators", name = "row", edge = "upper.top", mass = 2.0, frequency = "200 kHz" }'
    )
    source: ClassVar[str] = "Colquitt et al. (2017)"
    implicit: ClassVar[bool] = True
    inertia: ClassVar[bool] = True

    mass: MassPerArea
    """Mass of the resonators per area of the edge."""
    frequency: Frequency
    """Frequency of a mass on a fixed edge, sqrt(k / m) / (2 pi)."""
    direction: Component | None = None
    """Direction in which springs act and masses move; default: all directions."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        if self.direction is not None:
            check_component(f"{key}.direction", self.direction, plane, components)

    def bind(self, model: System, key: str) -> Masses:
        return Masses(model, self, self.nodes_on(model, key))


class Masses(Attached):
    """The masses of an edge; leapfrog advances them as it does the bodies."""

    energies = (Energy("resonators", "kinetic and elastic energy of resonators", "stored"),)
    fields = (
        PointField("displacement", "m", "displacement of the mass", vector=True),
        PointField("velocity", "m/s", "velocity of the mass", vector=True),
        PointField("acceleration", "m/s2", "acceleration of the mass", vector=True, recorded=False),
    )

    def __init__(self, model: System, part: Resonators, edge: EdgeNodes) -> None:
        super().__init__(model, part.name, edge.nodes)
        self._square = (2 * np.pi * part.frequency) ** 2  # rad2/s2
        c = model.components
        moves = np.ones(c) if part.direction is None or c == 1 else (np.arange(c) == "xyz".index(part.direction))
        self._mass = part.mass * edge.area[:, None] * moves
        self._counted = self.owned[:, None] * self._mass

    def start(self, field: PointField) -> Floats | float:
        if field.name != "velocity":
            return field.start
        return self.at_nodes(self.model.initial_velocity())

    def begin(self, state: State) -> None:
        super().begin(state)
        state.energy["boundary_work"] += 0.5 * float(np.sum(self._counted * self.of(state)["velocity"] ** 2))

    def springs(self) -> list[Springs]:
        # k |u - x|^2 is at most 2 k |u|^2 + 2 k |x|^2: springs to the ground, of the edge and of the masses.
        bound = np.zeros(self.model.nodes)
        bound[self.at] = 2 * self._square * self._mass.max(axis=1)
        return [Springs(f"the springs of attachments '{self.name}'", True, bound=bound,
                        own_frequency=float(np.sqrt(2 * self._square)))]  # fmt: skip

    def _stretch(self, state: State) -> Floats:
        """Return the displacement of the masses relative to the edge [m], shape (n, components)."""
        return self.of(state)["displacement"] - self.at_nodes(state.displacement)

    def add_external(self, state: State, kick: Kick) -> None:
        fields, pull = self.of(state), self._square * self._stretch(state)
        self.at_nodes(state.force, add=self._mass * pull)
        fields["acceleration"][:] = -pull
        fields["velocity"] -= kick.clock.kick * pull
        fields["displacement"] += kick.clock.dt * fields["velocity"]

    def respond(self, state: State, end: StepEnd) -> Reaction:
        fields, u = self.of(state), self.at_nodes(end.displacement)
        x, v, a = (fields[name] for name in ("displacement", "velocity", "acceleration"))
        if end.weights is None:  # in equilibrium with the edge
            still = {"displacement": u, "velocity": (u - self.at_nodes(state.displacement)) / end.dt}
            return self._reaction(0 * u, 0.0, {**still, "acceleration": 0 * u})
        # The unknowns of the masses, eliminated from the equations of the scheme, which are linear.
        alpha_m, alpha_f, gamma, beta = end.weights
        predictor = x + end.dt * v + (0.5 - beta) * end.dt**2 * a
        c_M, square = 1 / (beta * end.dt**2), self._square
        inertia = c_M * (1 - alpha_m) / (1 - alpha_f)
        added = -(alpha_m * a + alpha_f * square * self._stretch(state)) / (1 - alpha_f)
        new = (inertia * predictor + added + square * u) / (inertia + square)
        rate = c_M * (new - predictor)
        return self._reaction(square * (new - u), square * inertia / (inertia + square), {
            "displacement": new, "velocity": v + end.dt * ((1 - gamma) * a + gamma * rate), "acceleration": rate,
        })  # fmt: skip

    def force_of(self, state: State) -> Reaction:
        return self._reaction(self._square * self._stretch(state), 0.0, self.of(state))

    def _reaction(self, pull: Floats, stiffness: float, fields: FaultState) -> Reaction:
        """Return the forces on the edge, from the pull of the springs and their stiffness over the mass."""
        blocks = stiffness * self._mass[:, :, None] * np.eye(self.model.components)
        return Reaction(self.at, self._mass * pull, blocks, fields)

    def advance(self, state: State, end: StepEnd, reaction: Reaction) -> None:
        fields = self.of(state)
        if end.weights is None:  # kinetic energy and that of the springs are lost, as those of the bodies
            moved = self.at_nodes(end.displacement - state.displacement)
            worked = -0.5 * float(np.sum(self._counted * self._square * self._stretch(state) * moved))
            speed = reaction.fields["velocity"]
            before = fields["velocity"] ** 2 + self._square * self._stretch(state) ** 2
            state.energy["damping"] += worked + 0.5 * float(np.sum(self._counted * (before - speed**2)))
        for name, values in reaction.fields.items():
            fields[name][:] = values

    def add_energies(self, state: State, energies: dict[str, float]) -> None:
        velocity, stretch = self.of(state)["velocity"], self._stretch(state)
        before = stretch - state.lag * (velocity - self.at_nodes(state.velocity))
        energies["resonators"] += 0.5 * float(np.sum(self._counted * (velocity**2 + self._square * stretch * before)))

    def recorded(self, state: State) -> FaultState:
        # Displacements are ahead of a record by one step, velocities by half of it.
        velocity, stretch = self.of(state)["velocity"], self._stretch(state)
        then = stretch - state.lag * (velocity - self.at_nodes(state.velocity))
        return {
            "displacement": self.of(state)["displacement"] - state.lag * velocity,
            "velocity": velocity + 0.5 * state.lag * self._square * then,
        }
