"""The explicit step of an interface written with arrays: what the compiled one is compared to."""

from __future__ import annotations

import numpy as np

from ruptfx.fault import Fault
from ruptfx.fault_step import impedances
from ruptfx.points import Clock, point, settle
from ruptfx.projection import TracedLaw
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
    face, jump = fault.interface, fault.interface.jump(displacement)
    opening_velocity, slip_velocity = face.split(face.jump(velocity))
    z_n, z_s = impedances(face, inverse_mass, clock.kick)
    found = point(
        fault, law, state, jump, clock, time, opening_velocity=opening_velocity, slip_velocity=list(slip_velocity.T),
        normal_impedance=z_n, shear_impedance=list(z_s.T),
    )  # fmt: skip
    settled = settle(fault, law, state, jump, found, clock, time, threshold)
    for name, values in settled.state.items():
        state[name][:] = values
    face.add_force(velocity, clock.kick * settled.change, scale=inverse_mass)
    face.add_force(force, settled.change, scale=np.ones_like(force))
    duration = clock.since if law.at_end else clock.kick
    return float(np.sum(face.owned * face.weight * settled.power) * duration)
