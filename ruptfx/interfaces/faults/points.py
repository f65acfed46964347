"""Points of a fault in arrays: times of a step, trial, and power of friction; steps are in C (`points.c`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.laws.contact import Array, Point, Trial


@dataclass(frozen=True)
class Clock:
    """Times of a step [s].

    Attributes
    ----------
    dt : float
        Time between displacements.
    kick : float
        Duration for which the traction acts on the velocity: `dt`, at the start of explicit steps half of it.
    since : float
        Time since the previous traction: `dt`, at the start of explicit steps zero.
    extrapolation : float
        Extrapolation of `TracedLaw`: 1/2, in the step after the start 1.
    """

    dt: float
    kick: float
    since: float
    extrapolation: float

    @classmethod
    def of_step(cls, dt: float, number: int = 2) -> Clock:
        """Return the times of the explicit step with this number after a start: 0, 1, and all others."""
        return cls(dt, 0.5 * dt if number == 0 else dt, 0.0 if number == 0 else dt, 1.0 if number == 1 else 0.5)

    @classmethod
    def implicit(cls, dt: float, dt_before: float) -> Clock:
        """Return the times of an implicit step after a step of `dt_before`, zero at the start."""
        return cls(dt, dt, dt, dt / (dt + dt_before))


def closed_and_stuck(
    fault: Fault, jump: np.ndarray, slip: np.ndarray, clock: Clock, time: float, **known: Array | Sequence[Array]
) -> Trial:
    """Return the trial as arrays of shape (n,).

    Parameters
    ----------
    jump : ndarray, shape (n, local)
        Jump of the displacement at the time of the traction [m].
    slip : ndarray, shape (n, tangents)
        Slip before the step [m].
    time : float
        Time of the traction [s].
    **known
        Further fields of `contact.Point`: velocities and impedances in explicit steps, multipliers and body
        stiffness in implicit ones.
    """
    opening, slip_jump = fault.interface.split(jump)
    unknown = np.full(len(jump), np.nan)
    each_unknown = [unknown] * fault.tangents
    explicit: dict[str, Any] = {
        "opening_velocity": unknown, "slip_velocity": each_unknown, "normal_impedance": unknown,
        "shear_impedance": each_unknown,
    }  # fmt: skip
    trial = fault.contact.trial(Point(
        normal_stress_0=fault.normal_stress_0, shear_traction_0=list(fault.driving_shear(time).T),
        opening_jump=fault.opening(opening), slip_jump=list(slip_jump.T), slip=list(slip.T), since=clock.since,
        dt=clock.dt, **(explicit | known),
    ))  # fmt: skip

    def each(values: Sequence[Array]) -> list[np.ndarray]:
        return [np.broadcast_to(value, unknown.shape) for value in values]

    normal, compliance = each([trial.normal_stress, trial.normal_compliance])
    return Trial(normal, each(trial.shear_traction), compliance, each(trial.impedance))


def frictional_power(fault: Fault, old: FaultState, new: FaultState, since: float) -> np.ndarray:
    """Return the power of friction over a step [W/m2], shape (n,)."""
    rates, tractions = (
        [fault.components(fields, name) for fields in (old, new)] for name in ("mean_slip_rate", "shear_traction")
    )
    rates[0] *= since > 0  # bodies start from rest, also where the interface creeps
    return np.asarray(fault.contact.dissipated(*tractions, *rates)).sum(axis=1)
