"""Explicit central differences with a diagonal mass."""

from __future__ import annotations

import ctypes
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx import native
from ruptfx.contact import require
from ruptfx.schema import CaseError
from ruptfx.steppers import Stepper
from ruptfx.units import Duration, Fraction

if TYPE_CHECKING:
    from ruptfx.model import Model, State


class Leapfrog(Stepper):
    """Central differences in leapfrog form: v(n+1/2) = v(n-1/2) + dt a(n), u(n+1) = u(n) + dt v(n+1/2).

    Second order, conserves the discrete energy exactly, stable for dt <= 2 / omega_max. Dashpots and mass damping are
    implicit, so they do not shorten the step.
    """

    safety: Fraction = 0.9
    """Time step over the stable one."""
    time_step: Duration | None = None
    """Given instead of chosen; refused if it is not stable."""

    def bind(self, model: Model) -> LeapfrogMotion:
        from ruptfx.model import three_digits

        require(model.faults, "explicit")
        stable = model.stable_time_step()
        if self.time_step is None:
            return LeapfrogMotion(model, three_digits(self.safety * stable))
        if self.time_step > stable:
            raise CaseError(
                f"stepper.time_step = {self.time_step:.4g} s: unstable, the limit is {stable:.4g} s, "
                f"{what_limits(model, stable)}; reduce it, or leave it out"
            )
        return LeapfrogMotion(model, self.time_step)


def what_limits(model: Model, stable: float) -> str:
    """Whether elements or the stiffness of an interface set the stable step: measured without that stiffness;
    collective."""
    compliant = [fault for fault in model.faults if any(fault.contact.stiffness())]
    without = model.stable_time_step([]) if compliant else stable
    if without < 1.05 * stable:  # no more than the highest frequencies are uncertain
        return "set by the elements"
    first = min(compliant, key=lambda fault: model.stable_time_step([fault])) if len(compliant) > 1 else compliant[0]
    return f"set by the contact stiffness of faults.{first.name} ({without:.4g} s without it)"


class LeapfrogMotion:
    """Leapfrog bound to a model and a time step.

    Plain nodes are updated inside the bulk kernel where the operator can do that (`step`), all others here.
    """

    collective = False

    def __init__(self, model: Model, dt: float) -> None:
        self.model, self.dt = model, dt
        c, mass = model.components, model.mass
        loads = model.loads
        decay = 0.5 * dt * (loads.dashpot + model.case.damping.mass * mass)
        effective = 1 / (mass + decay)
        prescribed = loads.prescribed
        held = np.repeat(model.shared_nodes, c) | loads.acting
        for fault in model.faults:
            for side in (fault.interface.plus, fault.interface.minus):
                held.reshape(-1, c)[side] = True
        if model.viscosity is not None:
            held.reshape(-1, c)[model.viscosity.nodes] = True
        held_nodes = held.reshape(-1, c).any(axis=1)
        operator: Any = model.operator
        self._fused = hasattr(operator, "prepare_step")
        if self._fused:
            operator.prepare_step(held_nodes)
            # Plain nodes have no dashpot: half a step of mass damping is the same part of the mass everywhere.
            rate = model.case.damping.mass
            self._plain_decay = (1 - 0.5 * dt * rate) / (1 + 0.5 * dt * rate)
            self._plain_loss = rate * dt / (1 + 0.5 * dt * rate)
            self._plain_inverse_mass = np.ascontiguousarray(1 / mass.reshape(-1, c)[:, 0]) / (1 + 0.5 * dt * rate)
        else:
            held_nodes[:] = True
        dofs = np.flatnonzero(np.repeat(held_nodes, c)).astype(np.int64)
        self._dofs = dofs
        self._keep = np.where(prescribed, 0.0, (mass - decay) * effective)[dofs]
        self._push = np.where(prescribed, 0.0, dt * effective)[dofs]
        self._mass, self._dashpot = mass[dofs], (2 * decay / dt)[dofs]
        self._driven = prescribed[dofs].astype(float)
        self._owned = (dofs < model.owned_nodes * c).astype(float)
        if model.viscosity is not None:
            self._viscous = np.flatnonzero(np.repeat(model.viscosity.nodes, c))
            self._viscous_among_held = np.searchsorted(dofs, self._viscous)
            self._viscous_force = np.zeros(len(mass))
        self._velocity_old, self._work = np.zeros(len(dofs)), np.zeros(2)
        # Contact feels the mass with the dashpots in it, and cannot move what is driven.
        self._inverse_mass = np.where(prescribed, 0.0, effective)
        from ruptfx.fault import FaultStep  # not at the top: cases are read also where there is no DOLFINx

        threshold = model.case.output.rupture_threshold
        self._faults = [(f.name, FaultStep(f, self._inverse_mass, dt, threshold)) for f in model.faults]
        self._library = native.load("leapfrog", files("ruptfx.steppers").joinpath("leapfrog.c").read_text())

    def step(self, state: State) -> None:
        """One step; `state.time` becomes the time of the new displacement.

        Raises
        ------
        ProjectionError
            On the rank that owns the failing interface point; the clock goes on, as on the other ranks.
        """
        try:
            self._advance(state)
        finally:
            state.step += 1
            state.time += self.dt

    def _advance(self, state: State) -> None:
        self._bulk(state)
        for force, load in self.model.loads.force:
            # Work of the load by the mean velocity is added once the new one is known.
            state.force += load.factor(state.time) * force
        moving = [fault_step.opening_rate(state.faults[name], state.velocity) for name, fault_step in self._faults]
        pointer = _pointer
        n = ctypes.c_long(len(self._dofs))
        self._library.kick(
            n, pointer(self._dofs), pointer(self._keep), pointer(self._push), pointer(state.force),
            pointer(state.velocity), pointer(self._velocity_old),
        )  # fmt: skip
        self.model.loads.drive(state.velocity, state.time + 0.5 * self.dt)
        for (name, fault_step), rate_old in zip(self._faults, moving, strict=True):
            state.energy["frictional_dissipation"] += fault_step(
                state.faults[name], state.displacement, state.velocity, state.force, state.time
            )
            state.energy["boundary_work"] += fault_step.work
            state.energy["damping"] += fault_step.impact_loss(state.faults[name], state.velocity, rate_old)
        self._load_work(state)
        self._library.drift(
            n, pointer(self._dofs), ctypes.c_double(self.dt), pointer(self._mass), pointer(self._dashpot),
            pointer(self._driven), pointer(self._owned), pointer(self._velocity_old), pointer(state.velocity),
            pointer(state.displacement), pointer(state.force), pointer(self._work),
        )  # fmt: skip
        state.energy["damping"] += self._work[0] + self._viscous_work(state)
        state.energy["boundary_work"] += self._work[1]
        self._work[:] = 0

    def energies(self, state: State) -> dict[str, float]:
        """In the middle of the last step."""
        return self.model.energies(state, self.dt)

    def _bulk(self, state: State) -> None:
        """Internal force at held nodes, complete over ranks; plain nodes advanced on the way.

        The elements at nodes of other ranks come first; their contributions travel while the others are computed.
        """
        operator: Any = self.model.operator
        arrays = (state.displacement, state.velocity, state.force)
        plain = 0.0
        if self._fused:
            plain += operator.step_boundary(*arrays, self._plain_inverse_mass, self.dt, self._plain_decay)
        else:
            operator.add_internal_force(*arrays)
        viscosity = self.model.viscosity
        if viscosity is not None:
            force, dofs = self._viscous_force, self._viscous
            force[dofs] = 0
            viscosity.operator.add_internal_force(state.velocity, state.velocity, force)
            force[dofs] *= viscosity.eta
            state.force[dofs] += force[dofs]
        self.model.force.begin()
        if self._fused:
            plain += operator.step_interior(*arrays, self._plain_inverse_mass, self.dt, self._plain_decay)
            state.energy["damping"] += self._plain_loss * plain
        self.model.force.end()

    def _viscous_work(self, state: State) -> float:
        """Energy the Kelvin-Voigt layer took in this step [J], from the elements of this rank."""
        if self.model.viscosity is None:
            return 0.0
        mean = 0.5 * (self._velocity_old[self._viscous_among_held] + state.velocity[self._viscous])
        return -float(self._viscous_force[self._viscous] @ mean) * self.dt

    def _load_work(self, state: State) -> None:
        for force, load in self.model.loads.force:
            mean = 0.5 * (self._velocity_old + state.velocity[self._dofs])
            share = force[self._dofs] * self._owned
            state.energy["boundary_work"] += float(share @ mean) * load.factor(state.time) * self.dt


def _pointer(array: np.ndarray) -> Any:
    return ctypes.c_void_p(array.ctypes.data)
