"""The explicit step of an interface written with arrays: what the compiled one is compared to."""

from __future__ import annotations

import numpy as np

from ruptfx.contact import Point
from ruptfx.fault import Fault
from ruptfx.fault_step import Clock, impedances
from ruptfx.fields import MONITORS, Moment, component_names
from ruptfx.projection import TracedLaw, project
from ruptfx.state import FaultState


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
    face, since, at_end = fault.interface, clock.since, fault.contact.traction_ends_slip
    opening, slip_jump = face.split(face.jump(displacement))
    opening_velocity, slip_velocity = face.split(face.jump(velocity))
    z_n, z_s = impedances(face, inverse_mass, clock.kick)
    slip, shear_0 = fault.components(state, "slip"), fault.driving_shear(time)
    trial = fault.contact.trial(Point(
        normal_stress_0=fault.normal_stress_0, shear_traction_0=list(shear_0.T),
        opening_jump=fault.opening(opening), slip_jump=list(slip_jump.T), opening_velocity=opening_velocity,
        slip_velocity=list(slip_velocity.T), slip=list(slip.T), since=since, dt=clock.dt, normal_impedance=z_n,
        shear_impedance=list(z_s.T),
    ))  # fmt: skip
    mean_old, traction_old = fault.components(state, "mean_slip_rate"), fault.components(state, "shear_traction")
    before = {name: state[name] for name in (*law.state_names, "normal_stress")}
    done = project(
        law, before, np.broadcast_to(trial.normal_stress, z_n.shape), np.stack(trial.shear_traction, axis=1),
        np.stack([np.broadcast_to(z, z_n.shape) for z in trial.impedance], axis=1), since, mean_old,
        np.linalg.norm(fault.components(state, "slip_rate"), axis=1), clock.extrapolation,
        guess=np.linalg.norm(mean_old, axis=1),
        where=f"of fault '{fault.name}' at time {time:.6g} s",
    )  # fmt: skip
    mean, now = done.mean_slip_rate, done.slip_rate
    if at_end and since == 0:
        mean, now = mean_old, fault.components(state, "slip_rate")
    # Bodies start from rest, also where the interface creeps.
    power = fault.contact.dissipated(traction_old, done.shear_traction, mean_old * (since > 0), mean).sum(axis=1)
    speed = np.linalg.norm(now, axis=1)
    state["opening"][:] = (
        (done.normal_stress - trial.normal_stress) * trial.normal_compliance if at_end
        else np.where(state["normal_stress"] > 0, 0.0, np.maximum(fault.opening(opening), 0.0))
    )  # fmt: skip
    state["normal_stress"][:] = done.normal_stress
    was, duration = np.linalg.norm(fault.components(state, "slip_rate"), axis=1), since if at_end else clock.kick
    at = Moment(time, since, speed, was, done.normal_stress, power, duration, threshold)
    for monitor in MONITORS:
        state[monitor.name][:] = monitor.update(state[monitor.name], at)
    for k in range(fault.tangents):
        for name, value in (
            ("slip", slip + since * (mean if at_end else mean_old)),
            ("slip_rate", now),
            ("mean_slip_rate", mean),
            ("shear_traction", done.shear_traction),
        ):
            state[component_names(name, fault.tangents)[k]][:] = value[:, k]
    for name in law.state_names:
        state[name][:] = done.state[name]
    change = [done.shear_traction - shear_0]
    if face.has_normal:
        change.insert(0, (fault.normal_stress_0 - done.normal_stress)[:, None])
    face.add_force(velocity, clock.kick * np.concatenate(change, axis=1), scale=inverse_mass)
    face.add_force(force, np.concatenate(change, axis=1), scale=np.ones_like(force))
    return float(np.sum(face.owned * face.weight * power) * duration)
