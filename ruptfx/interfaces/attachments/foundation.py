"""A ground under an edge, with cohesive springs that can fail."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.fields import PointField
from ruptfx.input.schema import CaseError
from ruptfx.input.units import Stiffness
from ruptfx.interfaces.attachments import Attached, EdgeAttachment, EdgeNodes
from ruptfx.interfaces.faults.cohesive_interface import TracedCohesion
from ruptfx.interfaces.mechanisms import Floats, Reaction, Springs, StepEnd
from ruptfx.laws.cohesion import AnyCohesion, CohesiveLaw
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick
    from ruptfx.interfaces.mechanisms.system import System

TOLERANCE, MOST_HALVINGS, FAILED = 1e-13, 60, 1e-12  # of the damage
MOST_DAMAGE = 0.1  # growth of damage that steps of variable length allow
DIFFERENCE, SMALLEST = 1e-6, 1e-15  # of displacements in derivatives: relative, and added [m]


class Foundation(EdgeAttachment):
    """Springs between an edge and the ground that fail by a cohesive law, in tension and in shear.

    The separation d of edge and ground is the elastic one of the springs and an inelastic one w,

        T = k (d - w) = strength remaining(D),   D = damage(w_n, w_s),

    solved for the damage at the end of every step. A node that closes again unloads along the secant to the origin; the
    ground always carries pressure by its springs, and no shear where it has failed. Pulling an area off dissipates
    `G_Ic` per area; the energy is in the column `fracture`, that of the springs in `interface_elastic`.
    """

    example: ClassVar[str] = (
        '{ kind = "foundation", name = "base", edge = "lower.bottom", normal = 2e13, tangential = 1e13, '
        'cohesion = { kind = "linear", f_t = 1e5, c = 2e5, G_Ic = 0.05, G_IIc = 0.1 } }'
    )

    implicit: ClassVar[bool] = True

    normal: Stiffness
    """Stiffness of the springs along the normal."""
    tangential: Stiffness
    """Stiffness of the springs along the edge."""
    cohesion: AnyCohesion
    """Cohesive law; positions of profiles are x along edges that are longer than high, else y."""

    def bind(self, model: System, key: str) -> Ground:
        ground, error = None, None
        edge, along = self.nodes_on(model, key), model.loads.edge(self.edge, key).along()
        try:
            ground = Ground(model, self, edge, self.cohesion.at(along[edge.nodes]), key)
        except CaseError as caught:  # of a profile, at the nodes of this rank
            error = caught
        parallel.raise_on_all(model.comm, error)
        assert ground is not None
        return ground


class Ground(Attached):
    """The ground under the nodes of an edge."""

    fields = (
        PointField("traction", "Pa", "traction of the ground on the edge", vector=True),
        PointField("damage", "1", "damage, 1 where the ground has failed"),
        PointField("largest_opening", "m", "largest inelastic opening"),
        PointField("largest_slip", "m", "largest inelastic slip"),
    )

    def __init__(self, model: System, part: Foundation, edge: EdgeNodes, law: CohesiveLaw, key: str) -> None:
        super().__init__(model, part.name, edge.nodes)
        self._stiffness, self._cohesion = (part.normal, part.tangential), TracedCohesion(law)
        self._area, self._normal = edge.area[:, None], edge.normal
        self._counted = np.where(self.owned, edge.area, 0.0)
        steepest = self._steepest()
        for name, value, least in zip(("normal", "tangential"), self._stiffness, steepest, strict=True):
            if value < least:
                raise CaseError(
                    f"{key}.{name} = {value:.4g} Pa/m: the law loses {least:.4g} Pa per metre, more than the springs "
                    f"let go, so that the ground fails at once; give at least {1.01 * least:.3g} Pa/m, or a larger "
                    "fracture energy"
                )

    def _steepest(self) -> tuple[float, float]:
        """Return how fast strength falls with opening and with slip at most [Pa/m]."""
        law, n = self._cohesion.law, len(self.at)
        items = []
        for mode, (strength, length) in enumerate(((law.f_t, law.opening_at_failure), (law.c, law.slip_at_failure))):
            ways = np.linspace(0, 1, 201)[:, None] * np.broadcast_to(length, n)
            ways = np.where(np.isfinite(ways), ways, 0.0)
            strengths = np.array([self._strengths(self._damage(*((way, 0 * way), (0 * way, way))[mode]))[mode]
                             for way in ways])  # fmt: skip
            with np.errstate(all="ignore"):
                slope = -np.diff(strengths, axis=0) / np.diff(ways, axis=0)
            items.append(float(np.where(np.isfinite(slope) & (strength > 0), slope, 0.0).max(initial=0.0)))
        return items[0], items[1]

    def _damage(self, opening: Floats, slip: Floats) -> Floats:
        return self._cohesion.damage_after(np.zeros(len(self.at)), opening, slip)

    def _strengths(self, damage: Floats) -> tuple[Floats, Floats]:
        """Return the strengths in tension and shear that a damage leaves [Pa]."""
        remaining = self._cohesion.strength_at(damage, damage, damage)
        return remaining.tension, remaining.shear

    def springs(self) -> list[Springs]:
        def add(u: Floats, force: Floats) -> None:
            normal, across, _ = self._separation(u)
            resisting = self._stiffness[1] * across - self._stiffness[0] * normal[:, None] * self._directions()
            self.at_nodes(force, add=-self._area * resisting)

        return [Springs(f"the springs of attachments '{self.name}'", True, add=add)]

    def _directions(self) -> Floats:
        """Return the normal in the components of the displacement; zero where these are across the plane."""
        return self._normal if self.model.components > 1 else np.zeros((len(self.at), 1))

    def _separation(self, displacement: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the opening [m], the displacement across the normal, and how long that is."""
        return self._apart(self.at_nodes(displacement))

    def _apart(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        n = self._directions()
        outward = np.sum(u * n, axis=1)
        across = u - outward[:, None] * n
        return -outward, across, np.linalg.norm(across, axis=1)

    def add_external(self, state: State, kick: Kick) -> None:
        u = self.at_nodes(state.displacement)
        fields, _ = self._answer(self.of(state), u)
        self._take(state, fields, u - kick.clock.since * self.at_nodes(state.velocity), u)
        self.at_nodes(state.force, add=self._area * fields["traction"])

    def respond(self, state: State, end: StepEnd) -> Reaction:
        u = self.at_nodes(end.displacement)
        fields, (normal, along) = self._answer(self.of(state), u)
        n = self._directions()
        both, one = n[:, :, None] * n[:, None, :], np.eye(u.shape[1])
        stiffness = normal[:, None, None] * both + along[:, None, None] * (one - both)
        grows = fields["damage"] > self.of(state)["damage"]
        if grows.any():
            # The damage depends on all components; its derivative is taken by central differences.
            for k in range(u.shape[1]):
                step = np.zeros_like(u)
                step[:, k] = DIFFERENCE * np.linalg.norm(u, axis=1) + SMALLEST
                ahead, behind = (self._answer(self.of(state), u + sign * step)[0]["traction"] for sign in (1, -1))
                slope = -(ahead - behind) / (2 * step[:, k, None])
                stiffness[grows, :, k] = slope[grows]
        return Reaction(self.at, self._area * fields["traction"], self._area[:, :, None] * stiffness, fields)

    def force_of(self, state: State) -> Reaction:
        traction, c = self.of(state)["traction"], self.model.components
        return Reaction(self.at, self._area * traction, np.zeros((len(self.at), c, c)), self.of(state))

    def advance(self, state: State, end: StepEnd, reaction: Reaction) -> None:
        self._take(state, dict(reaction.fields), self.at_nodes(state.displacement), self.at_nodes(end.displacement))

    def step_error(self, state: State, reaction: Reaction) -> float:
        grown = reaction.fields["damage"] - self.of(state)["damage"]
        return float(grown.max(initial=0.0)) / MOST_DAMAGE

    def _answer(self, fields: FaultState, u: Floats) -> tuple[FaultState, tuple[Floats, Floats]]:
        """Return the fields at a displacement of the edge, and both secants of their damage [Pa/m].

        Parameters
        ----------
        fields : dict of str to ndarray
            At the start of the step.
        u : ndarray, shape (n, components)
            [m]
        """
        opening, across, slip = self._apart(u)
        damage = self._solve(fields, opening, slip)
        tension, shear = self._strengths(damage)
        w = np.maximum(fields["largest_opening"], opening - tension / self._stiffness[0])
        s = np.maximum(fields["largest_slip"], slip - shear / self._stiffness[1])
        with np.errstate(all="ignore"):
            secant = np.where(tension > 0, 1 / (1 / self._stiffness[0] + w / tension), 0.0)
            along = np.where(shear > 0, 1 / (1 / self._stiffness[1] + s / shear), 0.0)
        secant = np.where(opening > 0, secant, self._stiffness[0])
        traction = (secant * opening)[:, None] * self._directions() - along[:, None] * across
        return {"traction": traction, "damage": damage, "largest_opening": w, "largest_slip": s}, (secant, along)

    def _take(self, state: State, new: FaultState, u_before: Floats, u: Floats) -> None:
        """Copy fields to the state and count the losses: areas between two secants of traction against displacement."""
        fields = self.of(state)
        result = 0.5 * np.sum(new["traction"] * u_before - fields["traction"] * u, axis=1) * self._counted
        grown = new["damage"] > fields["damage"]
        state.energy["fracture"] += float(result[grown].sum())
        state.energy["impact_loss"] += float(result[~grown].sum())  # of nodes that open or close within a step
        for name, values in new.items():
            fields[name][:] = values

    def _solve(self, fields: FaultState, opening: Floats, slip: Floats) -> Floats:
        """Return the damage at which the springs carry what the law leaves, by false position (Illinois)."""

        def excess(damage: Floats) -> Floats:
            tension, shear = self._strengths(damage)
            w = np.maximum(fields["largest_opening"], opening - tension / self._stiffness[0])
            s = np.maximum(fields["largest_slip"], slip - shear / self._stiffness[1])
            return np.asarray(self._damage(w, s) - damage)

        low = fields["damage"].copy()
        at_low = excess(low)
        active = at_low > TOLERANCE
        if not active.any():
            return low
        high = np.ones(len(low))
        at_high, side, values = excess(high), np.zeros(len(low)), high.copy()
        # A node that has converged keeps its damage while others iterate: an excess of zero has no other bracket, and
        # the damage must not depend on which nodes share a rank.
        sought = active & (at_high < 0)
        for _ in range(MOST_HALVINGS):
            if not sought.any():
                break
            with np.errstate(all="ignore"):
                middle = np.where(sought, (low * at_high - high * at_low) / (at_high - at_low), values)
            value = excess(middle)
            up = value > 0
            at_high = np.where(up & (side > 0), 0.5 * at_high, at_high)
            at_low = np.where(~up & (side < 0), 0.5 * at_low, at_low)
            low, at_low = np.where(up, middle, low), np.where(up, value, at_low)
            high, at_high = np.where(up, high, middle), np.where(up, at_high, value)
            side, values = np.where(up, 1.0, -1.0), middle
            sought &= np.abs(value) > TOLERANCE
        values = np.where(values > 1 - FAILED, 1.0, np.maximum(values, fields["damage"]))
        return np.where(active, values, fields["damage"])

    def add_energies(self, state: State, energies: dict[str, float]) -> None:
        # What leapfrog balances half a step after the traction: of linear springs u_n k u_(n+1) / 2.
        stored = -0.5 * np.sum(self.of(state)["traction"] * self.at_nodes(state.displacement), axis=1)
        energies["interface_elastic"] += float(stored @ self._counted)
