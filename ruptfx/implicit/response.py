"""What a fault answers to a displacement at the end of an implicit step: traction, exact tangent, new state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.contact import Trial
from ruptfx.fault import Fault
from ruptfx.points import Clock, closed_and_stuck, frictional_power, point, settle
from ruptfx.projection import Projected, TracedLaw

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
        clock = Clock.implicit(dt, dt_before)
        found = trial, done = point(
            self.fault, self.law, state, jump, clock, time, self.radiation, guess, tangent=True,
            normal_multiplier=multiplier[0], shear_multiplier=list(multiplier[1].T), body_stiffness=body_stiffness,
        )  # fmt: skip
        settled = settle(self.fault, self.law, state, jump, found, clock, time, self.threshold)
        return Response(settled.change, self._tangent(trial, done, dt), settled.state)

    def _tangent(self, trial: Trial, done: Projected, dt: float) -> np.ndarray:
        """dT / d[u] from the derivatives of the projection: the trial has the stiffness relief / dt along the
        interface and 1 / compliance across."""
        assert done.tangent is not None
        slopes, tangents, relief = done.tangent, self.fault.tangents, trial.impedance[0]
        stiffness = relief / dt
        along: np.ndarray = stiffness[:, None, None] * (np.eye(tangents) - relief[:, None, None] * slopes.rate_by_shear)
        if not self.fault.interface.has_normal:
            return along
        result = np.zeros((len(relief), 1 + tangents, 1 + tangents))
        normal = 1 / trial.normal_compliance
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
            fault, jump, none, Clock.implicit(1.0, 1.0), 0.0, normal_multiplier=none[:, 0],
            shear_multiplier=list(none.T), body_stiffness=body_stiffness,
        )  # fmt: skip
        stiffness = list(trial.impedance)
        if fault.interface.has_normal:
            stiffness.insert(0, 1 / trial.normal_compliance)
        return np.stack(stiffness, axis=1)[:, :, None] * np.eye(len(stiffness))

    def commit(self, state: State, new: FaultState, dt: float) -> None:
        """Take over the fields at the end of a step, `state.time`, and count, of the points of this rank, what friction
        and closing gaps took and nucleation gave."""
        fault, face = self.fault, self.fault.interface
        old, time = state.faults[fault.name], state.time
        area = face.owned * face.weight
        dissipated = float(area @ frictional_power(fault, old, new, dt)) * dt
        # The mean pressure on what the gap grew.
        pressure = 0.5 * (old["normal_stress"] + new["normal_stress"])
        rigid = fault.contact.stiffness()[0] == 0  # normal
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
