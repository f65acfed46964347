"""Facets along which bodies break: springs from the start (intrinsic), or inserted at their strength (extrinsic)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.interfaces.cracks._response import FacetResponse
from ruptfx.interfaces.cracks.extrinsic import Extrinsic
from ruptfx.interfaces.cracks.rigid import RigidCracks
from ruptfx.interfaces.mechanisms import Floats, ImplicitForce, Mechanism, Reaction, Rows, Springs, StepEnd
from ruptfx.interfaces.mechanisms._rotation_error import deducting_dissipation

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms.checks.table import Plan, Row
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System

MOST_DAMAGE = 0.1  # growth of the damage of a facet in an implicit step


class Facets(Mechanism):
    """State and energies of facets, which `model.cracks` computes.

    Attributes
    ----------
    cracks : CrackStep
    """

    order = 0
    rounds_as_kernel = True

    @classmethod
    def present(cls, model: System) -> bool:
        return False

    def __init__(self, model: System) -> None:
        super().__init__(model)
        assert model.cracks is not None
        self.cracks = model.cracks

    def begin(self, state: State) -> None:
        state.cracks |= self.cracks.initial_state()

    def add_energies(self, state: State, energies: dict[str, float]) -> None:
        before = 0.5 * state.lag * state.velocity
        energies["interface_elastic"] += self.cracks.stored(state.cracks, before, state.at_faults()[1])
        energies["boundary_work"] += self.cracks.preload_work(state.displacement - before)

    def springs(self) -> list[Springs]:
        return [Springs("the springs of fracture", plural=True, add_with_elements=self.cracks.add_spring_force)]

    def check(self, plan: Plan) -> Iterator[Row]:
        from ruptfx.interfaces.mechanisms.checks import facet as rows

        return rows.facet_rows(self.model, self.cracks)

    def saved(self, state: State) -> Mapping[str, Rows]:
        return {"cracks": self.cracks.gather(state.cracks)}

    def restore(self, state: State, read: Callable[[str], np.ndarray]) -> None:
        for name, values in state.cracks.items():
            values[:] = read(f"cracks/{name}")[self.cracks.number]

    def add_resistance(self, state: State, force: Floats) -> None:
        self.cracks.add_force(state.cracks, force)

    def counted(self, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
        return self.cracks.counted(nodes)


class IntrinsicFacets(Facets, ImplicitForce):
    """Springs of all facets that have not failed."""

    @classmethod
    def present(cls, model: System) -> bool:
        return model.cracks is not None and not isinstance(model.cracks, RigidCracks)

    def check(self, plan: Plan) -> Iterator[Row]:
        from ruptfx.interfaces.mechanisms.checks import facet as rows

        yield from super().check(plan)
        yield from rows.spring_rows(self.model, self.cracks)

    def add_first(self, state: State, kick: Kick) -> None:
        with deducting_dissipation(state):
            self.cracks(state, self.model.mass, kick.clock.since)

    def account(self, state: State, kick: Kick) -> None:
        self.cracks.require_balance(state.time)

    # -- implicit steps ----------------------------------------------------------------------------

    @cached_property
    def _response(self) -> FacetResponse:
        return FacetResponse(self.cracks)

    def coupled(self) -> NDArray[np.int64]:
        pairs: NDArray[np.int64] = self._response.pairs
        return pairs

    def respond(self, state: State, end: StepEnd) -> Reaction:
        items = state, self.model.mass, end.displacement, end.dt
        fields, _ = self._response.fields(*items)
        return self._reaction(fields, lambda: self._response.stiffness(*items, fields))

    def force_of(self, state: State) -> Reaction:
        return self._reaction(state.cracks, lambda: np.zeros((len(self._response.pairs), 2, 2)))

    def _reaction(self, fields: FaultState, between: Callable[[], Floats]) -> Reaction:
        """Return the forces of tractions; collective."""
        force = np.zeros(2 * self.model.nodes)
        self.cracks.add_force(fields, force)
        self.model.layout.take_from_owners(force)
        nodes, to_ground = np.arange(self.model.nodes), np.zeros((0, 2, 2))
        return Reaction(nodes, force.reshape(-1, 2), to_ground, fields, self._response.pairs, between)

    def advance(self, state: State, end: StepEnd, reaction: Reaction) -> None:
        self._response.advance(state, self.model.mass, end.displacement, end.dt)

    def step_error(self, state: State, reaction: Reaction) -> float:
        grown = reaction.fields["damage"] - state.cracks["damage"]
        return float(grown.max(initial=0.0)) / MOST_DAMAGE

    def fastest(self, state: State) -> float:
        cracks, fields = self.cracks, state.cracks
        rows = state.velocity.reshape(-1, 2)
        rate = rows[cracks.corners[:, 1]] - rows[cracks.corners[:, 0]]
        slip_rate = np.einsum("fec,fc->fe", rate, cracks.tangent)
        failed = fields["time_of_failure"] < state.time
        yields = (fields["damage"] > 0) & ~failed[:, None]
        slides = failed[:, None] & (fields["normal_traction"] < 0)
        speed = np.where(yields, np.linalg.norm(rate, axis=2), np.where(slides, np.abs(slip_rate), 0.0))
        return float(speed.max(initial=0.0))


class ExtrinsicFacets(Facets):
    """Facets that are rigid until their strength: the corners of a connected component move as one.

    Mass, damping and force of a component are those of its corners together, so that all of them get the same velocity
    to the last bit. As facets are inserted components separate, and the sums of the new ones are computed.
    """

    order = 90

    def __init__(self, model: System) -> None:
        super().__init__(model)
        assert isinstance(model.cracks, RigidCracks)
        self._rigid = model.cracks
        self._adopted: State | None = None
        self._followers = self._leaders = np.zeros(0, np.int64)  # degrees of freedom that move as driven ones do

    @classmethod
    def present(cls, model: System) -> bool:
        return isinstance(model.cracks, RigidCracks)

    def check(self, plan: Plan) -> Iterator[Row]:
        from ruptfx.interfaces.mechanisms.checks import facet as rows

        fracture = self._rigid.fracture
        assert isinstance(fracture, Extrinsic)
        yield from super().check(plan)
        yield from rows.insertion_rows(self.model, self._rigid, fracture.check_every, plan.dt)

    def nodes(self) -> NDArray[np.bool_]:
        return ~super().nodes()  # they move with others

    def bind(self, stepped: SteppedNodes) -> None:
        self._stepped = stepped
        # Of every corner alone, and of components.
        self._own = stepped.mass.copy(), stepped.dashpot.copy(), stepped.driven.copy()
        self._together = tuple(np.empty_like(values) for values in self._own)
        acting = self.model.loads.acting.reshape(-1, 2).any(axis=1)
        acting |= self.model.case.damping.mass > 0  # its work is summed with that of dashpots
        self._acting = acting

    def prepare(self, state: State, kick: Kick) -> None:
        if state is not self._adopted:
            self._rigid.adopt(state.cracks)
            self._sum(None)
            self._adopted = state
        result = self._rigid.grow(state, self.model.mass)
        if len(result):
            self._sum(result)

    def combine(self, state: State, kick: Kick) -> None:
        self._rigid.total(state.force, state.force, self._rigid.summed_vertices)

    def after_kick(self, state: State, kick: Kick) -> None:
        stepped, clock = self._stepped, kick.clock
        self._rigid.advance(state, clock.dt, kick.keep, kick.push, stepped.damped)
        state.velocity[self._followers] = state.velocity[self._leaders]
        self._rigid.hold(state, clock.dt, clock.kick, clock.since, kick.push, stepped.velocity_before)

    def exchange(self, state: State, kick: Kick) -> None:
        self.model.layout.take_from_owners(state.velocity)

    def account(self, state: State, kick: Kick) -> None:
        self._rigid.count_losses(state)
        self._rigid.require_balance(state.time)

    def started(self, state: State, dt: float) -> None:
        # The way of the first half step is (v_0 + v) dt / 4, and v dt / 2 was counted (`Faults.started`).
        beyond = 0.25 * dt * (state.velocity - self.model.initial_velocity())
        state.energy["boundary_work"] -= self._rigid.preload_work(beyond)

    def _sum(self, vertices: np.ndarray | None) -> None:
        """Sum mass, damping and prescribed motion over components, at all vertices or at some of them."""
        rigid = self._rigid
        if vertices is None:
            nodes = np.arange(self.model.nodes)
            for own, together in zip(self._own, self._together, strict=True):
                together[:] = own  # also of corners whose star is not here
        else:
            nodes = rigid.corners_at(vertices)
        for own, together in zip(self._own, self._together, strict=True):
            rigid.total(own, together, vertices)
        dofs = (2 * nodes[:, None] + np.arange(2)).ravel()
        mass, dashpot, driven = (together[dofs] for together in self._together)
        self._stepped.renew(dofs, mass, dashpot, driven > 0)
        first = (rigid.leader[nodes] == nodes) & (nodes < self.model.owned_nodes)
        self._stepped.once[dofs] = np.repeat(first.astype(float), 2)
        if vertices is None or driven.any():
            self._follow()
        self._stepped.only = (2 * rigid.hold_vertices(self._acting)[:, None] + np.arange(2)).ravel()

    def _follow(self) -> None:
        """Find the corners that move with driven ones; the last of several motions counts, as it does at nodes."""
        leader = (2 * self._rigid.leader.astype(np.int64)[:, None] + np.arange(2)).ravel()
        source = np.full(len(leader), -1)
        for motion in self.model.loads.motions:
            source[leader[motion.dofs]] = motion.dofs
        source = source[leader]
        self._followers = np.flatnonzero((source >= 0) & (source != np.arange(len(source))))
        self._leaders = source[self._followers]
