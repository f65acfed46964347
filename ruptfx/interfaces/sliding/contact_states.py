"""Stick, slip and open points of sliding interfaces, and the fields of their records."""

from __future__ import annotations

import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.input.fields import OF_SLIDING, fields_of_sliding
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.sliding.interface import SlidingInterface

OPEN, STICKING, SLIDING, UNCOVERED = range(len(OF_SLIDING[0].meanings))


def contact_states(fault: Fault, state: FaultState, threshold: float) -> np.ndarray:
    """Return the contact state of every point, as its index among the meanings of `contact`."""
    face = fault.interface
    assert isinstance(face, SlidingInterface)
    speed = np.linalg.norm(fault.components(state, "mean_slip_rate"), axis=1)
    closed, moves = state["normal_stress"] != 0, speed > threshold
    return np.select([~face.covered, ~closed, ~moves], [UNCOVERED, OPEN, STICKING], SLIDING)


def sliding_fields(
    fault: Fault, state: FaultState, displacement: np.ndarray, threshold: float
) -> dict[str, np.ndarray]:
    """Return fields of a sliding interface for the file in addition to the state of its points, at the same time."""
    face = fault.interface
    assert isinstance(face, SlidingInterface)
    opposite, here, there = face.places(displacement)
    values = [contact_states(fault, state, threshold).astype(float), opposite, *here.T, *there.T]
    return {field.name: value for field, value in zip(fields_of_sliding(len(here.T)), values, strict=True)}
