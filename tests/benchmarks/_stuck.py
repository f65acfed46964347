"""Bodies in equilibrium on an interface that sticks: what a motion adds to the shear forces of its points."""

from __future__ import annotations

import numpy as np

from ruptfx import Table
from ruptfx.case import Case, parse_case
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model


def added_shear_forces(table: Table, down: float, sheared: tuple[str, float], steps: tuple[float, float],
                       comm: fem.MPI.Comm) -> tuple[np.ndarray, Case]:  # fmt: skip
    """Press one body on another, then shear them, with friction that is never overcome; collective.

    Parameters
    ----------
    table : Table
        Bodies `lower` and `upper`, and their fault `main`; boundaries, stages and stepper are replaced.
    down : float
        Vertical displacement of `upper.top` that presses [m].
    sheared : tuple
        Edge that then moves along x, and how far [m]; `lower.bottom` and `upper.top` move in no other way.
    steps : tuple
        The first and the longest one, as parts of each of the two motions.

    Returns
    -------
    ndarray, shape (points,)
        Shear forces that the second motion adds, per thickness [N/m], of all points of the fault in their order.
    Case
        The case as it ran.
    """
    edge, far = sheared
    moves = {(each, axis): [0.0, 0.0, 0.0] for each in ("lower.bottom", "upper.top") for axis in "xy"}
    moves |= {("upper.top", "y"): [0.0, down, down], (edge, "x"): [0.0, 0.0, far]}
    given = {key: value for key, value in table.items() if key != "stages"} | {
        "duration": 2.0, "output": {"figures": False},
        "boundaries": [
            {"kind": "moved", "edge": where, "component": axis, "quantity": "displacement",
             "times": [0.0, 1.0, 2.0], "values": values} for (where, axis), values in moves.items()
        ],
        "stepper": {"kind": "quasi_static", "first_step": steps[0], "largest_step": steps[1]},
    }  # fmt: skip
    given["faults"]["main"] |= {
        "contact": {"kind": "augmented_lagrangian"}, "friction": {"kind": "coulomb", "mu_d": 50.0},
    }  # fmt: skip
    case = parse_case(given)
    assert isinstance(case, Case)
    model = Model(case, comm)
    motion, state, face = case.stepper.bind(model), model.initial_state(), model.faults[0].interface
    shear = state.faults["main"]["shear_traction"]
    pressed = shear.copy()
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
        if state.time < 0.5 * case.duration * (1 + 1e-9):
            pressed = shear.copy()
    added = np.zeros(face.total)
    added[face.number] = face.owned * face.weight * (shear - pressed)
    return parallel.total(comm, added), case
