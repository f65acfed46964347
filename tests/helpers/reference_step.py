"""The steps of an interface written with arrays: what the compiled ones are compared to.

`point` is trial and projection, `write_back` what is written back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.input.fields import MONITORS, Moment
from ruptfx.interfaces.faults.cohesive_interface import DAMAGED, CohesiveStrength
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fault_step import impedances
from ruptfx.interfaces.faults.points import Clock, closed_and_stuck, frictional_power
from ruptfx.interfaces.faults.projection import Projected, TracedLaw, project
from ruptfx.laws.contact import Array, Trial
from ruptfx.stepping.implicit.response import Response


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
    fractured : ndarray, shape (n,)
        Power of cohesion in shear [W/m2].
    """

    state: FaultState
    power: np.ndarray
    change: np.ndarray
    fractured: np.ndarray


def point(
    fault: Fault, law: TracedLaw, state: FaultState, jump: np.ndarray, clock: Clock, time: float,
    radiation: float | np.ndarray = 0.0, guess: FaultState | None = None, **known: Array,
) -> Found:  # fmt: skip
    """Trial, and what law and cohesion admit of it.

    Parameters
    ----------
    state : FaultState
        At the traction before.
    radiation
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
    before = fault.components(state, "mean_slip_rate")
    near = fault.components(guess or state, "mean_slip_rate")
    known_state = {name: state[name] for name in law.state_names}

    def projected(cohesive: CohesiveStrength | None) -> Projected:
        return project(
            law, known_state | {"normal_stress": np.maximum(state["normal_stress"], 0.0)}, trial.normal_stress,
            np.stack(trial.shear_traction, axis=1), np.stack(trial.impedance, axis=1), clock.since, before,
            clock.extrapolation, radiation, guess=np.linalg.norm(near, axis=1),
            where=f"of fault '{fault.name}' at time {time:.6g} s", cohesive=cohesive,
        )  # fmt: skip

    if fault.cohesion is None:
        return trial, projected(None), None
    if not law.at_end:
        bonded = known_beforehand(fault, state, jump, trial, clock)
        return trial, projected(bonded.cohesive), bonded

    def at(damage: np.ndarray) -> tuple[Projected, Bonded]:
        cohesive = fault.traced_cohesion().strength_at(damage, state["largest_opening"], trial.normal_compliance)
        found = projected(cohesive)
        opened = (found.normal_stress - trial.normal_stress) * trial.normal_compliance
        slid = state["damaging_slip"] + clock.since * np.linalg.norm(found.mean_slip_rate, axis=1)
        return found, Bonded(damage, np.maximum(state["largest_opening"], opened), slid, cohesive)

    def missing(damage: np.ndarray) -> np.ndarray:
        _, bonded = at(damage)
        return fault.traced_cohesion().damage_after(state["damage"], bonded.largest, bonded.slid) - damage

    # Bisection between the damage before and 1, where it grows.
    low, high = state["damage"].copy(), np.ones_like(state["damage"])
    grows, fails = missing(low) > DAMAGED, missing(high) >= 0
    for _ in range(60):
        middle = 0.5 * (low + high)
        more = missing(middle) > 0
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return trial, *at(np.where(grows, np.where(fails, 1.0, 0.5 * (low + high)), state["damage"]))


@dataclass
class Bonded:
    """Damage, largest opening and slip of cohesion at the time of the traction, shapes (n,), and what they leave."""

    damage: np.ndarray
    largest: np.ndarray
    slid: np.ndarray
    cohesive: CohesiveStrength


Found = tuple[Trial, Projected, Bonded | None]


def known_beforehand(fault: Fault, state: FaultState, jump: np.ndarray, trial: Trial, clock: Clock) -> Bonded:
    """Cohesion where opening and slip do not depend on the traction."""
    largest = np.maximum(state["largest_opening"], fault.opening(fault.interface.split(jump)[0]))
    slid = state["damaging_slip"] + clock.since * np.linalg.norm(fault.components(state, "mean_slip_rate"), axis=1)
    damage = fault.traced_cohesion().damage_after(state["damage"], largest, slid)
    return Bonded(damage, largest, slid, fault.traced_cohesion().strength_at(damage, largest, trial.normal_compliance))


def write_back(
    fault: Fault, law: TracedLaw, old: FaultState, jump: np.ndarray, found: Found, clock: Clock,
    time: float, threshold: float,
) -> Settled:  # fmt: skip
    """The fields after a step from what `point` found; `old` is left alone.

    Parameters
    ----------
    threshold : float
        Slip rate [m/s] whose first passing is a rupture.
    """
    trial, done, bonded = found
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
    fractured, closed = np.zeros_like(power), done.normal_stress > 0
    if bonded is not None:
        new |= {"damage": bonded.damage, "largest_opening": bonded.largest, "damaging_slip": bonded.slid}
        closed |= bonded.cohesive.intact
        if law.at_end:
            fractured = fault.cohesive_losses(old, new, 1.0).shear
        else:
            whole = np.linalg.norm(done.shear_traction, axis=1)
            shear = bonded.cohesive.shear
            fractured = np.where(whole > shear, shear / np.where(whole > 0, whole, 1.0), 1.0) * power
        power = power - fractured
    at = Moment(
        time,
        since,
        speed,
        then,
        done.normal_stress,
        old["normal_stress"],
        closed,
        fault.has_strength,
        power,
        duration,
        fault.threshold_at(time, threshold),
    )
    new |= {monitor.name: monitor.update(old[monitor.name], at) for monitor in MONITORS}
    change = [done.shear_traction - fault.driving_shear(time)]
    if fault.interface.has_normal:
        change.insert(0, (fault.normal_stress_0 - done.normal_stress)[:, None])
    return Settled(new | done.state, power, np.concatenate(change, axis=1), fractured)


def advance_reference(
    fault: Fault,
    law: TracedLaw,
    state: FaultState,
    displacement: np.ndarray,
    velocity: np.ndarray,
    force: np.ndarray,
    inverse_mass: np.ndarray,
    clock: Clock,
    time: float,
    threshold: float,
) -> float:
    """The explicit step in arrays; changes `state`, `velocity` and `force`, returns the energy dissipated on this
    rank [J]."""
    face = fault.interface
    settled = advance_settled(fault, law, state, displacement, velocity, inverse_mass, clock, time, threshold)
    for name, values in settled.state.items():
        state[name][:] = values
    face.add_force(velocity, clock.kick * settled.change, scale=inverse_mass)
    face.add_force(force, settled.change, scale=np.ones_like(force))
    duration = clock.since if law.at_end else clock.kick
    return float(np.sum(face.owned * face.weight * settled.power) * duration)


def advance_settled(
    fault: Fault, law: TracedLaw, state: FaultState, displacement: np.ndarray, velocity: np.ndarray,
    inverse_mass: np.ndarray, clock: Clock, time: float, threshold: float,
) -> Settled:  # fmt: skip
    """What the explicit step finds; changes nothing."""
    face, jump = fault.interface, fault.interface.jump(displacement)
    opening_velocity, slip_velocity = face.split(face.jump(velocity))
    z_n, z_s = impedances(face, inverse_mass, clock.kick)
    found = point(
        fault, law, state, jump, clock, time, opening_velocity=opening_velocity, slip_velocity=list(slip_velocity.T),
        normal_impedance=z_n, shear_impedance=list(z_s.T),
    )  # fmt: skip
    settled = write_back(fault, law, state, jump, found, clock, time, threshold)
    return settled


def respond_reference(
    fault: Fault, state: FaultState, jump: np.ndarray, dt: float, dt_before: float, time: float,
    multiplier: tuple[np.ndarray, np.ndarray], body_stiffness: np.ndarray, threshold: float,
    radiation: np.ndarray | float = 0.0, guess: FaultState | None = None,
) -> Response:  # fmt: skip
    """What `FaultResponse` answers at the end of an implicit step; with cohesion but for the tangent."""
    law = TracedLaw(fault.friction, at_end=True, bonded=fault.cohesion is not None)
    clock = Clock.implicit(dt, dt_before)
    found = point(
        fault, law, state, jump, clock, time, radiation, guess, normal_multiplier=multiplier[0],
        shear_multiplier=list(multiplier[1].T), body_stiffness=body_stiffness,
    )  # fmt: skip
    settled = write_back(fault, law, state, jump, found, clock, time, threshold)
    slopes = projection_slopes(fault, law, state, found, clock, radiation)
    return Response(settled.change, _tangent(fault, found[0], slopes, dt), settled.state)


@dataclass
class Slopes:
    """Exact derivatives of the admissible tractions with respect to the trial, including the state in the solve.

    Attributes
    ----------
    stress : ndarray, shape (n,)
        d normal_stress / d trial_normal: 1 where closed, 0 where open.
    rate_by_shear : ndarray, shape (n, tangents, tangents)
        d V / d trial_shear [m/s/Pa]; the shear traction changes by 1 - Z times this.
    rate_by_normal : ndarray, shape (n, tangents)
        d V / d trial_normal [m/s/Pa], negative or zero: pressure increases strength and reduces slip.
    """

    stress: np.ndarray
    rate_by_shear: np.ndarray
    rate_by_normal: np.ndarray


def projection_slopes(
    fault: Fault, law: TracedLaw, state: FaultState, found: Found, clock: Clock, radiation: np.ndarray | float,
) -> Slopes:  # fmt: skip
    """Derivatives of t - Z V = strength(V, sigma, b) and of the direction d of the traction.

    t and b are the parts of trial and V_before along the traction; V = (V + c) d - k V_before with c the part of
    k V_before along d. There is one impedance for all tangents.
    """
    trial, done, bonded = found
    before, shear = fault.components(state, "mean_slip_rate"), np.stack(trial.shear_traction, axis=1)
    z, k = np.asarray(trial.impedance[0])[:, None], law.carried(clock.extrapolation)
    kept = before * (np.sum(before * shear, axis=1) > 0)[:, None]
    large = 2 * np.linalg.norm(k * z * kept, axis=1) > np.linalg.norm(shear, axis=1)
    turning = k * np.where(large[:, None] & (k < 0), 0.0, kept)
    shifted = shear + z * turning
    size = np.linalg.norm(shifted, axis=1)
    direction = shifted / np.where(size > 0, size, 1.0)[:, None]
    carried, along = np.sum(turning * direction, axis=1), np.sum(kept * direction, axis=1)
    sliding, closed = done.mean_slip_rate.any(axis=1), done.normal_stress > 0
    rate = np.where(sliding, np.sum((done.mean_slip_rate + turning) * direction, axis=1) - carried, 0.0)
    known = {name: state[name] for name in law.state_names} | {"normal_stress": np.maximum(state["normal_stress"], 0.0)}
    law_there = law(
        rate, np.maximum(done.normal_stress, 0.0), known, clock.since, before=along,
        speed_before=np.linalg.norm(before, axis=1), extrapolation=clock.extrapolation, radiation=radiation,
        bond=0.0 if bonded is None else bonded.cohesive.shear,
    )  # fmt: skip
    with np.errstate(invalid="ignore", divide="ignore"):
        bend = np.where(sliding, 1 / size, 0.0)[:, None]
        # (Z + dstrength/dV) dV = dt - dstrength/db db - dstrength/dsigma dsigma; an open interface has no strength
        yielding = np.where(sliding, 1 / (z[:, 0] + np.where(closed, law_there.slope, 0.0)), 0.0)
        by_normal = np.where(sliding & closed, -yielding * law_there.stress_slope, 0.0)
    # d(b) / d(trial) and d(c) / d(trial): what is across the direction, over the size of trial'.
    db, dc = (bend * (v - np.sum(v * direction, axis=1)[:, None] * direction) for v in (kept, turning))
    before_slope = np.where(closed, law_there.before_slope, 0.0)[:, None]
    by_size = yielding[:, None] * (direction - z * dc - before_slope * db)
    plane = np.eye(direction.shape[1]) - direction[:, :, None] * direction[:, None, :]
    by_shear = direction[:, :, None] * (by_size + dc)[:, None, :]
    by_shear += ((rate + carried)[:, None] * bend)[:, :, None] * plane
    return Slopes(closed.astype(float), by_shear, by_normal[:, None] * direction)


def _tangent(fault: Fault, trial: Trial, slopes: Slopes, dt: float) -> np.ndarray:
    """dT / d[u] from the derivatives of the projection: the trial has the stiffness relief / dt along the interface
    and 1 / compliance across."""
    tangents, relief = fault.tangents, np.asarray(trial.impedance[0])
    along = (relief / dt)[:, None, None] * (np.eye(tangents) - relief[:, None, None] * slopes.rate_by_shear)
    has_normal = fault.interface.has_normal
    result = np.zeros((len(relief), has_normal + tangents, has_normal + tangents))
    result[:, has_normal:, has_normal:] = along
    if has_normal:
        normal = 1 / trial.normal_compliance
        result[:, 0, 0] = normal * slopes.stress
        # Opening lowers the trial pressure by 1 / compliance, and the slip rate grows for it.
        result[:, 1:, 0] = (relief * normal)[:, None] * slopes.rate_by_normal
    return result
