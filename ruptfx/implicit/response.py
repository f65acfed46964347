"""What a fault answers to a displacement at the end of an implicit step: traction, exact tangent, new state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx.contact import Point, Trial
from ruptfx.fault import Fault
from ruptfx.fields import MONITORS, Moment
from ruptfx.projection import Projected, TracedLaw, project

if TYPE_CHECKING:
    from ruptfx.state import FaultState, State


@dataclass
class Response:
    """The fault at the end of a step, were the displacement the given one; nothing is committed.

    Attributes
    ----------
    traction : ndarray, shape (n, local)
        T - T_0 in the local frame [Pa], tension positive: what `Interface.assemble` takes.
    tangent : ndarray, shape (n, local, local)
        dT / d[u] [Pa/m], with the state advanced inside the solve; unsymmetric where friction follows pressure.
    state : dict of ndarray
        All fields at the end of the step.
    """

    traction: np.ndarray
    tangent: np.ndarray
    state: FaultState


class FaultResponse:
    """Answers for one fault: `FaultResponse(fault, threshold)(state, jump, dt, time, ...)`.

    Parameters
    ----------
    fault : Fault
    threshold : float
        Slip rate [m/s] whose first passing is the rupture time.
    radiation : float or ndarray, shape (n,)
        Impedance [Pa s/m] of waves that are not computed, mu / (2 c_s) for quasi-dynamic steps: the traction is the
        strength plus this times the slip rate.
    """

    def __init__(self, fault: Fault, threshold: float, radiation: float | np.ndarray = 0.0) -> None:
        self.fault, self.threshold, self.radiation = fault, threshold, radiation
        self.law = TracedLaw(fault.friction, at_end=True)

    def __call__(
        self,
        state: FaultState,
        jump: np.ndarray,
        dt: float,
        dt_before: float,
        time: float,
        multiplier: tuple[np.ndarray, np.ndarray],
        body_stiffness: np.ndarray,
        guess: FaultState | None = None,
    ) -> Response:
        """The response at the end of a step.

        Parameters
        ----------
        state : FaultState
            At the beginning of the step; left alone.
        jump : ndarray, shape (n, local)
            Displacement jump at the end of the step [m].
        dt, dt_before, time : float
            Lengths of the step and of the one before, zero at the start, and the time of its end [s].
        multiplier : (ndarray, ndarray), shapes (n,) and (n, tangents)
            Normal stress and shear traction of the last outer iteration [Pa].
        body_stiffness : ndarray, shape (n,)
            As in `contact.Point`.
        guess : FaultState, optional
            Near which the answer is looked for first; the beginning of the step where it is left out.

        Raises
        ------
        ProjectionError
            On the rank of a point without an admissible traction.
        """
        fault = self.fault
        slip, initial = fault.components(state, "slip"), fault.driving_shear(time)
        trial = closed_and_stuck(
            fault, jump, slip, dt, time, normal_multiplier=multiplier[0], shear_multiplier=list(multiplier[1].T),
            body_stiffness=body_stiffness,
        )  # fmt: skip
        normal, shear = trial.normal_stress, np.stack(trial.shear_traction, axis=1)
        relief = np.broadcast_to(trial.impedance[0], normal.shape)  # shear traction per slip rate
        before, near = (fault.components(fields, "mean_slip_rate") for fields in (state, guess or state))
        done = project(
            self.law, {name: state[name] for name in (*self.law.state_names, "normal_stress")}, normal, shear, relief,
            dt, before, None, dt / (dt + dt_before), self.radiation, np.linalg.norm(near, axis=1),
            f"of fault '{fault.name}' at time {time:.6g} s", tangent=True,
        )  # fmt: skip
        change = [done.shear_traction - initial]
        if fault.interface.has_normal:
            change.insert(0, (fault.normal_stress_0 - done.normal_stress)[:, None])
        gap = (done.normal_stress - normal) * trial.normal_compliance
        return Response(
            np.concatenate(change, axis=1), self._tangent(done, relief, trial.normal_compliance, dt),
            self._new_state(state, done, gap, dt, time),
        )  # fmt: skip

    def _tangent(self, done: Projected, relief: np.ndarray, compliance: np.ndarray | float, dt: float) -> np.ndarray:
        """dT / d[u] from the derivatives of the projection: the trial has the stiffness relief / dt along the
        interface and 1 / compliance across."""
        assert done.tangent is not None
        slopes, tangents = done.tangent, self.fault.tangents
        stiffness = relief / dt
        along = stiffness[:, None, None] * (np.eye(tangents) - relief[:, None, None] * slopes.rate_by_shear)
        if not self.fault.interface.has_normal:
            return along
        result = np.zeros((len(relief), 1 + tangents, 1 + tangents))
        normal = np.broadcast_to(1 / compliance, relief.shape)
        result[:, 0, 0] = normal * slopes.stress
        # Opening lowers the trial pressure by 1 / compliance, and the slip rate grows for it.
        result[:, 1:, 0] = (relief * normal)[:, None] * slopes.rate_by_normal
        result[:, 1:, 1:] = along
        return result

    def stuck(self, body_stiffness: np.ndarray) -> np.ndarray:
        """dT / d[u] [Pa/m] where it is closed and does not slide, shape (n, local, local)."""
        fault = self.fault
        none = np.zeros((len(body_stiffness), fault.tangents))
        jump = np.zeros((len(none), fault.interface.frame.shape[1]))
        trial = closed_and_stuck(  # in a step of one second, so that it is the same to the last bit in any other
            fault, jump, none, 1.0, 0.0, normal_multiplier=none[:, 0], shear_multiplier=list(none.T),
            body_stiffness=body_stiffness,
        )  # fmt: skip
        stiffness = list(trial.impedance)
        if fault.interface.has_normal:
            stiffness.insert(0, 1 / trial.normal_compliance)
        columns = [np.broadcast_to(each, body_stiffness.shape) for each in stiffness]
        return np.stack(columns, axis=1)[:, :, None] * np.eye(len(columns))

    def _new_state(self, old: FaultState, done: Projected, gap: np.ndarray, dt: float, time: float) -> FaultState:
        fault = self.fault
        state = fault.state_of({
            "normal_stress": done.normal_stress, "opening": gap, "slip_rate": done.slip_rate,
            "slip": fault.components(old, "slip") + dt * done.mean_slip_rate, "mean_slip_rate": done.mean_slip_rate,
            "shear_traction": done.shear_traction,
        })  # fmt: skip
        then, speed = (
            np.linalg.norm(rate, axis=1) for rate in (fault.components(old, "slip_rate"), done.slip_rate)
        )
        power = self._power(old, state)
        at = Moment(time, dt, speed, then, done.normal_stress, power, dt, self.threshold)
        monitors = {monitor.name: monitor.update(old[monitor.name], at) for monitor in MONITORS}
        return state | monitors | done.state

    def _power(self, old: FaultState, new: FaultState) -> np.ndarray:
        """Of friction over a step [W/m2], shape (n,)."""
        rates, tractions = (
            [self.fault.components(fields, name) for fields in (old, new)]
            for name in ("mean_slip_rate", "shear_traction")
        )
        return np.asarray(self.fault.contact.dissipated(*tractions, *rates)).sum(axis=1)

    def commit(self, state: State, new: FaultState, dt: float) -> None:
        """Take over the fields at the end of a step, `state.time`, and count, of the points of this rank, what friction
        and closing gaps took and nucleation gave."""
        fault, face = self.fault, self.fault.interface
        old, time = state.faults[fault.name], state.time
        area = face.owned * face.weight
        dissipated = float(area @ self._power(old, new)) * dt
        # The mean pressure on what the gap grew.
        pressure = 0.5 * (old["normal_stress"] + new["normal_stress"])
        rigid = not any(fault.contact.stiffness())
        impact = -float(area @ (pressure * (new["opening"] - old["opening"]))) if rigid else 0.0
        worked = 0.0
        if fault.is_loaded:
            load_old, load = fault.load(time - dt), fault.load(time)
            rate_old, rate = (fault.components(fields, "mean_slip_rate")[:, 0] for fields in (old, new))
            worked = float(area @ fault.contact.dissipated(load_old, load, rate_old, rate)) * dt
        state.energy["frictional_dissipation"] += dissipated
        state.energy["impact"] += impact
        state.energy["boundary_work"] += worked
        for name, values in new.items():
            old[name][:] = values


def closed_and_stuck(
    fault: Fault, jump: np.ndarray, slip: np.ndarray, dt: float, time: float, **of_iteration: Any
) -> Trial:
    """The trial of a fault from its displacement jump alone, as implicit steps see it.

    Parameters
    ----------
    jump : ndarray, shape (n, local)
        [m]
    slip : ndarray, shape (n, tangents)
        Before [m].
    dt, time : float
        Length of the step and the time of the traction [s].
    **of_iteration
        Multipliers and body stiffness of `contact.Point`.
    """
    normal_jump, slip_jump = fault.interface.split(jump)
    unknown = np.full(len(jump), np.nan)
    trial = fault.contact.trial(Point(
        normal_stress_0=fault.normal_stress_0, shear_traction_0=list(fault.driving_shear(time).T),
        opening_jump=fault.opening(normal_jump), slip_jump=list(slip_jump.T), opening_velocity=unknown,
        slip_velocity=[unknown] * fault.tangents, slip=list(slip.T), since=dt, dt=dt, normal_impedance=unknown,
        shear_impedance=[unknown] * fault.tangents, **of_iteration,
    ))  # fmt: skip
    return replace(trial, normal_stress=np.broadcast_to(trial.normal_stress, unknown.shape))
