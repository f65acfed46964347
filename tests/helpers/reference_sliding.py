"""The explicit step of an interface that slides written with arrays: what the compiled one is compared to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from helpers.reference_step import point, write_back
from ruptfx.bodies.state import FaultState
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fault_step import impedances
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.faults.points import Clock
from ruptfx.interfaces.sliding.interface import SlidingInterface

Floats = NDArray[np.float64]


def operator(face: SlidingInterface) -> Floats:
    """J as a matrix over the degrees of freedom of both surfaces, shape (n, 2, nodes of both, 2)."""
    geometry = face.geometry
    between = np.hstack([np.eye(len(face.plus)), -(geometry.coupling @ np.eye(len(geometry.minus.nodes)))])
    return np.einsum("ikc,ij->ikjc", face.frame * face.covered[:, None, None], between)


def slide_reference(
    fault: Fault, state: FaultState, displacement: Floats, velocity: Floats, force: Floats, inverse_mass: Floats,
    clock: Clock, time: float, threshold: float,
) -> None:  # fmt: skip
    """Changes `state`, `velocity` and `force`."""
    face = fault.interface
    assert isinstance(face, SlidingInterface)
    n = len(face.plus)
    rows = operator(face).reshape(2 * n, -1)
    inverse, weight = inverse_mass[face.dofs], np.repeat(face.weight, 2)
    mobility = (rows**2 @ inverse).reshape(n, 2)
    mobility[~face.covered] = inverse[: 2 * n].reshape(n, 2)[~face.covered]
    each = np.arange(n)
    points = Interface(
        face.points, face.position, face.number, each, each, np.tile(np.eye(2), (n, 1, 1)), face.weight, face.owned,
        face.total, face.line, other_side="rigid",
    )  # fmt: skip
    load = fault.load(time)[:, 0]
    z_n, z_s = impedances(points, mobility.ravel(), clock.kick)
    jump = face.geometry.offset + (rows @ displacement[face.dofs]).reshape(n, 2)
    initial = face.initial
    own = operator(initial).reshape(2 * n, -1)
    traction_0 = np.column_stack([-fault.normal_stress_0, fault.shear_traction_0])
    start = own.T @ (np.repeat(initial.weight, 2) * traction_0.ravel())

    def pull(normal: Floats, shear: Floats) -> Floats:
        return start - rows.T @ (weight * np.column_stack([-normal, shear - load]).ravel())

    tolerance, most = fault.contact.sweeps_to() or (0.0, 0)
    normal, shear = state["normal_stress"], state["shear_traction"]
    law = fault.traced_law()
    for _ in range(max(1, most)):
        given = (normal, shear) if most else (fault.normal_stress_0, fault.shear_traction_0[:, 0] + load)
        begun = replace(
            fault, interface=points, nucleation=(), normal_stress_0=given[0], shear_traction_0=given[1][:, None]
        )
        rate = (rows @ (velocity[face.dofs] + clock.kick * inverse * pull(normal, shear))).reshape(n, 2)
        found = point(
            begun, law, state, jump, clock, time, opening_velocity=rate[:, 0], slip_velocity=[rate[:, 1]],
            normal_impedance=z_n, shear_impedance=list(z_s.T),
        )  # fmt: skip
        settled = write_back(begun, law, state, jump, found, clock, time, threshold)
        new = settled.state["normal_stress"], settled.state["shear_traction"]
        change = max(np.abs(new[0] - normal).max(), np.abs(new[1] - shear).max())
        normal, shear = new
        if change <= tolerance * max(np.abs(normal).max(), np.abs(shear).max()):
            break
    force[face.dofs] += pull(normal, shear)
    velocity[face.dofs] += clock.kick * inverse * pull(normal, shear)
    for name, values in settled.state.items():
        state[name][:] = values
