"""Explicit central differences with a diagonal mass."""

from __future__ import annotations

import ctypes
from importlib.resources import files
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx import native, parallel
from ruptfx.collisions._step import FORCE
from ruptfx.contact import require
from ruptfx.cracks._rigid import RigidCracks
from ruptfx.fault_step import FaultStep
from ruptfx.fields import OF_BODIES
from ruptfx.operators import Damped, FusedOperator
from ruptfx.points import Clock
from ruptfx.schema import CaseError
from ruptfx.sliding.follower import Follower
from ruptfx.sliding.interface import SlidingInterface
from ruptfx.sliding.step import SlidingStep
from ruptfx.spectrum import stable_time_step
from ruptfx.steppers import Stepper
from ruptfx.steppers._pieces import Pieces
from ruptfx.units import Duration, Fraction

if TYPE_CHECKING:
    from ruptfx.model import Model
    from ruptfx.state import State


class Leapfrog(Stepper):
    """Central differences in leapfrog form: v(n+1/2) = v(n-1/2) + dt a(n), u(n+1) = u(n) + dt v(n+1/2).

    Second order, conserves the discrete energy exactly, stable for dt <= 2 / omega_max. Dashpots and mass damping are
    implicit, so they do not shorten the step.
    """

    conserving: ClassVar[dict[str, object] | None] = {}

    keeps_ties: ClassVar[bool] = True
    staged: ClassVar[bool] = True

    safety: Fraction = 0.9
    """Time step over the stable one."""
    time_step: Duration | None = None
    """Given instead of chosen; refused if it is not stable."""

    def bind(self, model: Model) -> LeapfrogMotion:
        require(model.faults, "explicit")
        return LeapfrogMotion(model, self._step_of(model))

    def fixed(self, model: Model) -> Leapfrog:
        return self.model_copy(update={"time_step": self._step_of(model)})

    def _step_of(self, model: Model) -> float:
        stable = stable_time_step(model)
        if self.time_step is None:
            return parallel.three_digits(self.safety * stable)
        if self.time_step > stable:
            raise CaseError(
                f"stepper.time_step = {self.time_step:.4g} s: unstable, the limit is {stable:.4g} s, "
                f"{what_limits(model, stable)}; reduce it, or leave it out"
            )
        return self.time_step


def what_limits(model: Model, stable: float) -> str:
    """Whether elements or the stiffness of an interface set the stable step, as found without it; collective."""
    compliant = [fault for fault in model.faults if any(fault.contact.stiffness())]
    without = stable_time_step(model, [], springs=False) if compliant or model.cracks is not None else stable
    if without < 1.05 * stable:  # within the error of the computed highest frequencies
        return "set by the elements" + " and the elastic supports of boundaries" * bool(model.loads.supports)
    if model.cracks is not None:
        without = stable_time_step(model, springs=False)
        return f"set by the springs of fracture ({without:.4g} s without them)"
    first = min(compliant, key=lambda fault: stable_time_step(model, [fault])) if len(compliant) > 1 else compliant[0]
    return f"set by the contact stiffness of faults.{first.name} ({without:.4g} s without it)"


class LeapfrogMotion:
    """Leapfrog bound to a model and a time step.

    Plain nodes are updated inside the bulk kernel where the operator can do that (`step`), all others here. Where all
    is known at the same time, at the start, velocities first take half a step: `State.lag` is zero then.
    """

    collective = False

    def __init__(self, model: Model, dt: float) -> None:
        self.model, self.dt = model, dt
        c = model.components
        held = np.repeat(model.layout.shared, c) | model.loads.acting
        for fault in model.faults:
            held.reshape(-1, c)[fault.interface.nodes] = True
        self._fused = model.operator if isinstance(model.operator, FusedOperator) else None
        # Bodies that break are damped everywhere, so that elements can be in one sweep with what else they do.
        viscous_sweep = model.cracks is not None and self._fused is not None and self._fused.damps
        if model.viscosity is not None and not viscous_sweep:
            held.reshape(-1, c)[model.viscosity.nodes] = True
        for tied in (model.layout.kept, model.layout.copies):
            held.reshape(-1, c)[tied] = True
        if isinstance(model.cracks, RigidCracks) or model.bulk.large_rotations:
            held[:] = True  # they move with others, or energies need their forces
        held_nodes = held.reshape(-1, c).any(axis=1)
        if self._fused:
            self._fused.prepare_step(held_nodes)
        else:
            held_nodes[:] = True
        self._dofs = dofs = np.flatnonzero(np.repeat(held_nodes, c)).astype(np.int64)
        # As a slice where they are all: no numbers to look up.
        self._held = _places(dofs, len(held))
        mass, dashpot = masses_and_dashpots(model)
        self._mass, self._dashpot, self._driven = mass[dofs], dashpot[dofs], model.loads.prescribed[dofs].astype(float)
        self._special = self._damped_or_driven()
        # In sums of ranks `_owned` counts what each node has of its own (forces), `_once` what tied ones share (mass).
        self._owned = (dofs < model.owned_nodes * c).astype(float)
        self._once = np.repeat(model.layout.once, c)[dofs].astype(float)
        # Of every load: where its degrees of freedom are among the held ones, and its forces at those this rank counts.
        self._shares = []
        for load in model.loads.forces:
            places = np.searchsorted(dofs, load.dofs)
            self._shares.append((places, load.values * self._owned[places]))
        self._damped: Damped | None = None
        if model.viscosity is not None:
            viscous = dofs if viscous_sweep else np.flatnonzero(np.repeat(model.viscosity.nodes, c))
            self._viscous = _places(viscous, len(held))
            self._viscous_among_held = _places(np.searchsorted(dofs, viscous), len(dofs))
            self._viscous_force = np.zeros(len(model.mass))
            if viscous_sweep:
                self._damped = Damped(model.viscosity.eta, self._viscous_force, np.zeros(1))
        self._velocity_old, self._work = np.zeros(len(dofs)), np.zeros(2)
        self._sums = (-1, 0.0, 0.0)  # the last watched step, and the kinetic and strain energy of this rank after it
        self._followers = [Follower(fault) for fault in model.faults if fault.slides]
        self._kicks = [_Kick(model, dofs, dt, number, mass, dashpot, self._velocity_old) for number in range(3)]
        # Where ranks have borders the kernel leaves nodes to us that it moves elsewhere: both round them alike then.
        self._alike = int(model.cracks is not None and all(kick.plain_keep == 1 for kick in self._kicks))
        self._pieces: Pieces | None = None
        if isinstance(model.cracks, RigidCracks):
            self._pieces = Pieces(model, model.cracks, mass, dashpot, self._renew, self._once)
        source = "".join(files("ruptfx").joinpath(part).read_text() for part in ("lanes.c", "steppers/leapfrog.c"))
        self._library = native.load("leapfrog", source)

    def _damped_or_driven(self) -> np.ndarray:
        """Places among the held degrees of freedom at which work is done."""
        return np.flatnonzero((self._dashpot != 0) | (self._driven != 0)).astype(np.int64)

    def _renew(self, dofs: np.ndarray, mass: np.ndarray, dashpot: np.ndarray, driven: np.ndarray) -> None:
        """Take over what has changed at some degrees of freedom, where all are held."""
        self._mass[dofs], self._dashpot[dofs], self._driven[dofs] = mass, dashpot, driven
        if driven.any() or dashpot.any():
            self._special = self._damped_or_driven()
        for kick in self._kicks:
            kick.renew(dofs, mass, dashpot, driven)

    def step(self, state: State) -> None:
        """One step; `state.time` becomes the time of the new displacement.

        Raises
        ------
        ProjectionError
            On the rank that owns the failing interface point; the clock goes on, as on the other ranks.
        """
        number = 0 if state.lag == 0 else 1 if state.numbers.pop("started", 0.0) else 2
        try:
            self._advance(state, self._kicks[number])
        finally:
            state.step += 1
            state.time += self.dt
            state.numbers["lag"] = self.dt
        if number == 0:
            state.numbers["started"] = 1.0
            # From rest to v in half a step the way is v dt / 4; the sum of the steps has counted v dt / 2.
            beyond = 0.25 * self.dt * state.velocity
            state.energy["boundary_work"] -= sum(
                fault.preload_work(beyond) for fault in self.model.faults if not fault.contact.traction_ends_slip
            )

    def _advance(self, state: State, kick: _Kick) -> None:
        for follower in self._followers:
            follower(state)
        plain = np.zeros(2) if state.watched else None
        stored = self._strain_energy(state) if state.watched else None
        between = self._cracks(state, kick)
        self._bulk(state, kick, plain)
        loads = self.model.loads
        loads.add_support_force(state.displacement, state.force)
        if self.model.bulk.large_rotations:
            self._turn(state, kick.since)
        internal = self._forces_of_bodies(state) if state.watched else None
        # Work of the loads by the mean velocity is added once the new one is known.
        factors = [load.factor(state.time) for load in loads.forces]
        for load, factor in zip(loads.forces, factors, strict=True):
            state.force[load.dofs] += factor * load.values
        self.model.layout.sum_tied(state.force)
        if self._pieces:
            self._pieces.join(state.force)
        moving = [fault.opening_rate(state.faults[name], state.velocity) for name, fault in kick.faults]
        pointer = _pointer
        held = None if isinstance(self._held, slice) else pointer(self._dofs)
        which = None if self._pieces is None else self._pieces.held
        count = ctypes.c_long(len(self._dofs if which is None else which))
        now = count, None if which is None else pointer(which), held
        self._library.kick(
            *now, ctypes.c_long(self._alike), pointer(kick.keep), pointer(kick.push), pointer(state.force),
            pointer(state.velocity), pointer(self._velocity_old),
        )  # fmt: skip
        loads.drive(state.velocity, state.time + 0.5 * self.dt)
        for (name, fault), rate_old in zip(kick.faults, moving, strict=True):
            dissipated = fault(state.faults[name], state.displacement, state.velocity, state.force, state.time)
            state.take(name, "frictional_dissipation", dissipated)
            state.energy["boundary_work"] += fault.work
            state.take(name, "impact", fault.impact_loss(state.faults[name], state.velocity, rate_old))
            if isinstance(fault, FaultStep) and fault.fault.cohesion is not None:
                state.energy["fracture"] += fault.fractured(state.faults[name], state.velocity, rate_old)
        # Tied nodes move together; an interface that ends there has changed the velocity of one of them only.
        self.model.layout.equalise(state.velocity)
        if self._pieces:
            self._pieces.advance(state, self.dt, kick.keep, kick.push, self._damped)
            self._pieces.hold(state, self.dt, kick.length, kick.since, kick.push, self._velocity_old)
        self._load_work(state, kick, factors)
        self._library.drift(
            *now, ctypes.c_long(len(self._special)), pointer(self._special), ctypes.c_double(self.dt),
            ctypes.c_double(kick.length), pointer(self._mass), pointer(self._dashpot), pointer(self._driven),
            pointer(self._once), pointer(self._velocity_old), pointer(state.velocity), pointer(state.displacement),
            pointer(state.force), pointer(self._work),
        )  # fmt: skip
        state.energy["damping"] += self._work[0] + self._viscous_work(state, kick, which)
        state.energy["boundary_work"] += self._work[1]
        self._work[:] = 0
        if plain is not None and internal is not None:
            self._sum_energies(state, kick, plain, internal, between, stored)

    def leave(self, state: State) -> None:
        """Nothing waits."""

    def enter(self, state: State) -> None:
        """Forces are found anew in every step."""

    def energies(self, state: State) -> dict[str, float]:
        """In the middle of the last step."""
        step, *bulk = self._sums
        return self.model.energies(state, (bulk[0], bulk[1]) if state.lag and step == state.step else None)

    def _sum_energies(
        self, state: State, kick: _Kick, plain: np.ndarray, internal: np.ndarray, between: np.ndarray | None,
        stored: float | None,
    ) -> None:  # fmt: skip
        """v' M v / 2 and u_(n+1)' K u_n / 2 from the forces of this very step.

        Parameters
        ----------
        plain : ndarray, shape (2,)
            What the kernel summed over plain nodes.
        internal : ndarray, shape (held degrees of freedom,)
            Of `_forces_of_bodies`, before anything else acts [N].
        between : ndarray, shape (nodes * components,), optional
            That of cracks and collisions alone, at the nodes this rank owns [N].
        stored : float, optional
            Strain energy at the displacement before, where it is no quadratic form [J]: half a step later it is
            W(u_n) - f . v dt / 2, which is u_(n+1)' K u_n / 2 where it is one.
        """
        velocity = state.velocity[self._held]
        # What forces do over half a step, or K over all of the displacement.
        over = self.dt * velocity if stored is not None else state.displacement[self._held]
        kinetic = kick.plain_mass * plain[0] + (self._once * self._mass * velocity) @ velocity
        work = plain[1] + (self._owned * internal) @ over
        if self.model.viscosity is not None and self._damped is None:  # of this rank's elements, as forces were summed
            work -= float(self._viscous_force[self._viscous] @ state.displacement[self._viscous])
        if between is not None:  # they act where the kernel sums, too
            work -= float(between @ (state.displacement if stored is None else over))
        self._sums = (state.step + 1, 0.5 * float(kinetic), (stored or 0.0) - 0.5 * float(work))

    def _forces_of_bodies(self, state: State) -> np.ndarray:
        """What acts at the held degrees of freedom, without viscous forces of a sweep, shape (those,) [N]."""
        forces = state.force[self._dofs]
        if self._damped is not None:
            forces[self._viscous_among_held] -= self._viscous_force[self._viscous]
        return forces

    def _strain_energy(self, state: State) -> float | None:
        """Of this rank, where it is no quadratic form [J]."""
        return self.model.strain_energy(state.displacement) if self.model.bulk.large_rotations else None

    def _bulk(self, state: State, kick: _Kick, energy: np.ndarray | None) -> None:
        """Internal force at held nodes, complete over ranks; plain nodes advanced on the way.

        The elements at nodes of other ranks come first; their contributions travel while the others are computed.
        """
        arrays = (state.displacement, state.velocity, state.force)
        plain = 0.0
        viscous = self.model.viscosity is not None and self._damped is None
        first = self.model.cracks is not None
        if viscous and first:  # at all nodes before the elements, in the order of sums that no partition changes
            self._add_viscous_force(state)
        if self._fused:
            plain += self._fused.step_boundary(*arrays, kick.plain_push, self.dt, kick.plain_keep, energy, self._damped)
        else:
            self.model.operator.add_internal_force(state.displacement, state.force)
        if viscous and not first:
            self._add_viscous_force(state)
        self.model.force.begin()
        if self._fused:
            plain += self._fused.step_interior(*arrays, kick.plain_push, self.dt, kick.plain_keep, energy, self._damped)
            state.energy["damping"] += kick.plain_loss * plain
        self.model.force.end()

    def _add_viscous_force(self, state: State) -> None:
        viscosity = self.model.viscosity
        assert viscosity is not None
        force, dofs = self._viscous_force, self._viscous
        force[dofs] = 0
        viscosity.operator.add_internal_force(state.velocity, force)
        force[dofs] *= viscosity.eta
        state.force[dofs] += force[dofs]

    def _cracks(self, state: State, kick: _Kick) -> np.ndarray | None:
        """Add the forces of cracks and collisions at the nodes this rank owns; a copy where energies are watched.

        They come before those of the cells: sums have the same order on any number of ranks.
        """
        cracks = self.model.cracks
        if cracks is None:
            return None
        if self._pieces:  # their tractions come with those of other rigid contact
            self._pieces.part(state)
            return None
        collisions, booked = self.model.collisions, self._booked(state)
        if collisions is not None:
            collisions.find(state)
        cracks(state, self.model.mass, kick.since)
        state.energy["turning"] -= self._booked(state) - booked
        if collisions is not None:
            collisions(state, kick.since)
        return state.force.copy() if state.watched else None

    @staticmethod
    def _booked(state: State) -> float:
        """What facets have taken, and springs of those that were handed over [J]."""
        return sum(state.energy[name] for name in ("frictional_dissipation", "fracture", "impact", "collision_loss"))

    def _turn(self, state: State, since: float) -> None:
        """Add the work of the forces of cells, facets and supports since those before, which their mean does.

        Leapfrog balances that to rounding. Energies that are no quadratic form change by something else in a finite
        step, of second order in it: `Model.energies` has the difference as `turning`.
        """
        force, model = state.force.copy(), self.model
        if FORCE in state.fields:  # they account for themselves
            force -= state.fields[FORCE]
        if OF_BODIES in state.fields:
            mean = 0.5 * (state.fields[OF_BODIES] + force)
            state.energy["turning"] -= since * model.layout.owned_dot(mean, state.velocity)
        else:
            state.energy["turning"] += model.strain_energy(state.displacement)
            if model.cracks is not None:
                state.energy["turning"] += model.cracks.stored(state.cracks, 0 * force, state.displacement)
        state.fields[OF_BODIES] = force

    def _viscous_work(self, state: State, kick: _Kick, which: np.ndarray | None) -> float:
        """Energy that Kelvin-Voigt damping took in this step [J], from the elements of this rank."""
        if self.model.viscosity is None:
            return 0.0
        here, among_held = (self._viscous, self._viscous_among_held) if which is None else (which, which)
        mean = 0.5 * (self._velocity_old[among_held] + state.velocity[here])
        lost = -float(self._viscous_force[here] @ mean)
        if self._damped is not None:
            lost += float(self._damped.lost[0])
            self._damped.lost[:] = 0
            self._viscous_force[here] = 0
        return lost * kick.length

    def _load_work(self, state: State, kick: _Kick, factors: list[float | np.ndarray]) -> None:
        for (places, share), factor in zip(self._shares, factors, strict=True):
            mean = 0.5 * (self._velocity_old[places] + state.velocity[self._dofs[places]])
            state.energy["boundary_work"] += float((share * factor) @ mean) * kick.length


def _places(numbers: np.ndarray, count: int) -> np.ndarray | slice:
    """A slice in the place of all numbers from 0 to `count`."""
    return slice(None) if len(numbers) == count else numbers


def masses_and_dashpots(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Mass [kg] and damping force per velocity [N s/m] of every degree of freedom, of tied ones together."""
    both = model.mass.copy(), model.loads.dashpot + model.case.damping.mass * model.mass
    for values in both:
        model.layout.sum_tied(values)
    return both


class _Kick:
    """What forces do to velocities in step 0, 1 or any later one.

    Attributes
    ----------
    length, since : float
        Time the forces act for [s]: half a step in step 0; and since those before, zero then.
    keep, push : ndarray, shape (held degrees of freedom,)
        v = keep v_before + push force.
    plain_keep, plain_push, plain_loss, plain_mass : float, ndarray of shape (nodes,), float, float
        The same for plain nodes, whose only damping is that of the mass, with the push over the time step; what that
        damping takes of the sum of squares that the kernel returns; and the mass times `plain_push`.
    faults : list of (str, FaultStep or SlidingStep)
    """

    def __init__(
        self, model: Model, dofs: np.ndarray, dt: float, number: int, mass: np.ndarray, dashpot: np.ndarray,
        velocity_old: np.ndarray,
    ) -> None:  # fmt: skip
        clock = Clock.of_step(dt, number)
        self.length, self.since = clock.kick, clock.since
        rate = model.case.damping.mass
        effective, prescribed = 1 / (mass + 0.5 * self.length * dashpot), model.loads.prescribed
        self.keep, self.push = np.empty(len(dofs)), np.empty(len(dofs))
        self.renew(slice(None), mass[dofs], dashpot[dofs], prescribed[dofs])
        lost = 0.5 * self.length * rate
        self.plain_keep, self.plain_loss = (1 - lost) / (1 + lost), 2 * lost / (1 + lost) * self.length / dt
        nodal = np.ascontiguousarray(1 / mass.reshape(-1, model.components)[:, 0])
        self.plain_mass = self.length / dt / (1 + lost)
        self.plain_push = self.plain_mass * nodal
        if model.cracks is not None and not model.cracks.fracture.rigid:
            plain = ~model.loads.acting[dofs]
            self.keep[plain], self.push[plain] = self.plain_keep, dt * self.plain_push[dofs[plain] // model.components]
        # For contact, mass includes the dashpots, and nodes whose motion is prescribed cannot be moved.
        inverse_mass = np.where(prescribed, 0.0, effective)
        threshold = model.case.output.rupture_threshold
        self.faults: list[tuple[str, FaultStep | SlidingStep]] = []
        for fault in model.faults:
            if isinstance(fault.interface, SlidingInterface):
                before = velocity_old, np.searchsorted(dofs, fault.interface.dofs)
                self.faults.append((fault.name, SlidingStep(fault, inverse_mass, clock, threshold, before)))
            else:
                self.faults.append((fault.name, FaultStep(fault, inverse_mass, clock, threshold)))

    def renew(self, places: np.ndarray | slice, mass: np.ndarray, dashpot: np.ndarray, prescribed: np.ndarray) -> None:
        """Set `keep` and `push` at some of the held degrees of freedom."""
        decay = 0.5 * self.length * dashpot
        effective = 1 / (mass + decay)
        self.keep[places] = np.where(prescribed, 0.0, (mass - decay) * effective)
        self.push[places] = np.where(prescribed, 0.0, self.length * effective)


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
