"""What a step does at the points of a fault, in arrays: `point` is trial and projection, `settle` what is written back.

Implicit steps call these. Explicit steps have the same in C (`fault_step.c`), which the tests compare with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx.contact import Array, Point, Trial
from ruptfx.fault import Fault
from ruptfx.fields import MONITORS, Moment
from ruptfx.projection import Projected, TracedLaw, project
from ruptfx.state import FaultState


@dataclass(frozen=True)
class Clock:
    """Times of a step [s].

    Attributes
    ----------
    dt : float
        Between displacements.
    kick : float
        How long the traction acts on the velocity: `dt`, at the start of explicit steps half of it.
    since : float
        Time since the traction before: `dt`, at the start of explicit steps zero.
    extrapolation : float
        Of `TracedLaw`: 1/2, in the step after the start 1.
    """

    dt: float
    kick: float
    since: float
    extrapolation: float

    @classmethod
    def of_step(cls, dt: float, number: int = 2) -> Clock:
        """The explicit step with this number after a start from one time for all: 0, 1, and all others."""
        return cls(dt, 0.5 * dt if number == 0 else dt, 0.0 if number == 0 else dt, 1.0 if number == 1 else 0.5)

    @classmethod
    def implicit(cls, dt: float, dt_before: float) -> Clock:
        """An implicit step and the length of the one before it, zero at the start."""
        return cls(dt, dt, dt, dt / (dt + dt_before))


@dataclass
class Settled:
    """A fault after a step; nothing of it has changed yet.

    Attributes
    ----------
    state : FaultState
        All fields.
    power : ndarray, shape (n,)
        Of friction [W/m2].
    change : ndarray, shape (n, local)
        Traction beyond the initial one in the local frame [Pa], tension positive: what `Interface.assemble` takes.
    """

    state: FaultState
    power: np.ndarray
    change: np.ndarray


def closed_and_stuck(
    fault: Fault, jump: np.ndarray, slip: np.ndarray, clock: Clock, time: float, **known: Array
) -> Trial:
    """The trial, all of it as arrays of shape (n,).

    Parameters
    ----------
    jump : ndarray, shape (n, local)
        Of the displacement, at the time of the traction [m].
    slip : ndarray, shape (n, tangents)
        Before [m].
    time : float
        Of the traction [s].
    **known
        What else of `contact.Point` is known: velocities and impedances in explicit steps, multipliers and body
        stiffness in implicit ones.
    """
    opening, slip_jump = fault.interface.split(jump)
    unknown = np.full(len(jump), np.nan)
    each_unknown = [unknown] * fault.tangents
    explicit: dict[str, Array] = {
        "opening_velocity": unknown, "slip_velocity": each_unknown, "normal_impedance": unknown,
        "shear_impedance": each_unknown,
    }  # fmt: skip
    found = fault.contact.trial(Point(
        normal_stress_0=fault.normal_stress_0, shear_traction_0=list(fault.driving_shear(time).T),
        opening_jump=fault.opening(opening), slip_jump=list(slip_jump.T), slip=list(slip.T), since=clock.since,
        dt=clock.dt, **(explicit | known),
    ))  # fmt: skip

    def each(values: list[Array]) -> list[Array]:
        return [np.broadcast_to(value, unknown.shape) for value in values]

    normal, compliance = each([found.normal_stress, found.normal_compliance])
    return Trial(normal, each(found.shear_traction), compliance, each(found.impedance))


def point(
    fault: Fault, law: TracedLaw, state: FaultState, jump: np.ndarray, clock: Clock, time: float,
    radiation: float | np.ndarray = 0.0, guess: FaultState | None = None, tangent: bool = False, **known: Array,
) -> tuple[Trial, Projected]:  # fmt: skip
    """Trial, and what the law admits of it.

    Parameters
    ----------
    state : FaultState
        At the traction before.
    radiation, tangent
        As for `project`.
    guess : FaultState, optional
        Whose mean slip rate is near; that of the step before if not given.
    jump, time, **known
        As for `closed_and_stuck`.

    Raises
    ------
    ProjectionError
        On the rank of a point without an admissible traction.
    """
    trial = closed_and_stuck(fault, jump, fault.components(state, "slip"), clock, time, **known)
    before, then = (fault.components(state, name) for name in ("mean_slip_rate", "slip_rate"))
    near = fault.components(guess or state, "mean_slip_rate")
    return trial, project(
        law, {name: state[name] for name in (*law.state_names, "normal_stress")}, trial.normal_stress,
        np.stack(trial.shear_traction, axis=1), np.stack(trial.impedance, axis=1), clock.since, before,
        np.linalg.norm(then, axis=1), clock.extrapolation, radiation, guess=np.linalg.norm(near, axis=1),
        where=f"of fault '{fault.name}' at time {time:.6g} s", tangent=tangent,
    )  # fmt: skip


def settle(
    fault: Fault, law: TracedLaw, old: FaultState, jump: np.ndarray, found: tuple[Trial, Projected], clock: Clock,
    time: float, threshold: float,
) -> Settled:  # fmt: skip
    """The fields after a step from what `point` found; `old` is left alone.

    Parameters
    ----------
    threshold : float
        Slip rate [m/s] whose first passing is the rupture time.
    """
    trial, done = found
    since, mean_before = clock.since, fault.components(old, "mean_slip_rate")
    mean, now = done.mean_slip_rate, done.slip_rate
    if law.at_end:
        if since == 0:
            mean, now = mean_before, fault.components(old, "slip_rate")
        opening, slipping = (done.normal_stress - trial.normal_stress) * trial.normal_compliance, mean
    else:
        apart = np.maximum(fault.opening(fault.interface.split(jump)[0]), 0.0)
        opening, slipping = np.where(old["normal_stress"] > 0, 0.0, apart), mean_before
    new = fault.state_of({
        "normal_stress": done.normal_stress, "opening": opening, "slip_rate": now, "mean_slip_rate": mean,
        "slip": fault.components(old, "slip") + since * slipping, "shear_traction": done.shear_traction,
    })  # fmt: skip
    speed, then = (np.linalg.norm(fault.components(fields, "slip_rate"), axis=1) for fields in (new, old))
    power, duration = frictional_power(fault, old, new, since), since if law.at_end else clock.kick
    at = Moment(time, since, speed, then, done.normal_stress, power, duration, threshold)
    new |= {monitor.name: monitor.update(old[monitor.name], at) for monitor in MONITORS}
    change = [done.shear_traction - fault.driving_shear(time)]
    if fault.interface.has_normal:
        change.insert(0, (fault.normal_stress_0 - done.normal_stress)[:, None])
    return Settled(new | done.state, power, np.concatenate(change, axis=1))


def frictional_power(fault: Fault, old: FaultState, new: FaultState, since: float) -> np.ndarray:
    """Of friction over a step [W/m2], shape (n,)."""
    rates, tractions = (
        [fault.components(fields, name) for fields in (old, new)] for name in ("mean_slip_rate", "shear_traction")
    )
    rates[0] *= since > 0  # bodies start from rest, also where the interface creeps
    return np.asarray(fault.contact.dissipated(*tractions, *rates)).sum(axis=1)
