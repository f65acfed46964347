"""Forces between two bodies that slide, what of the interface sticks, slides, is open, and where it is."""

from __future__ import annotations

import numpy as np

from ruptfx import fem, parallel
from ruptfx.fault import Fault
from ruptfx.fields import OF_SLIDING
from ruptfx.sliding.interface import SlidingInterface
from ruptfx.state import FaultState

OPEN, STICKING, SLIDING, UNCOVERED = range(len(OF_SLIDING[0].meanings))
COLUMNS = ("normal_force", "shear_force", "sticking", "sliding", "open", "uncovered")
REMARK = (
    "time in s, that of the record of the interface; forces between the bodies in N per metre, the normal one positive "
    "in compression; then parts of the length of the plus side"
)


def row(comm: fem.MPI.Comm, fault: Fault, state: FaultState, threshold: float) -> list[float]:
    """Normal (positive in compression) and shear force along the mean normal and tangent [N/m]; collective.

    Then the parts of the length of the plus side that stick, slide, are open, and face nothing. What slides is faster
    than `threshold` [m/s].
    """
    face = fault.interface
    assert isinstance(face, SlidingInterface)
    area = face.owned * face.weight
    local = np.stack([-state["normal_stress"], state["shear_traction"]], axis=1)
    force = np.einsum("i,ik,ikc->c", area, local, face.frame)
    tangent = area @ face.frame[:, 1]
    states = contact_states(fault, state, threshold)
    status = [area @ (states == each) for each in (STICKING, SLIDING, OPEN, UNCOVERED)]
    force, tangent, parts = np.split(parallel.total(comm, [*force, *tangent, *status]), [2, 4])
    tangent /= np.linalg.norm(tangent)
    normal = np.array([-tangent[1], tangent[0]])
    return [float(-force @ normal), float(force @ tangent), *(parts / parts.sum()).tolist()]


def contact_states(fault: Fault, state: FaultState, threshold: float) -> np.ndarray:
    """What every point does, by its place among the meanings of `contact`; what slides is faster than a threshold."""
    face = fault.interface
    assert isinstance(face, SlidingInterface)
    closed, moves = state["normal_stress"] > 0, np.abs(state["mean_slip_rate"]) > threshold
    return np.select([~face.covered, ~closed, ~moves], [UNCOVERED, OPEN, STICKING], SLIDING)


def sliding_fields(
    fault: Fault, state: FaultState, displacement: np.ndarray, threshold: float
) -> dict[str, np.ndarray]:
    """What the file has of an interface that slides besides the state of its points, at their time."""
    face = fault.interface
    assert isinstance(face, SlidingInterface)
    faced, here, there = face.places(displacement)
    values = [contact_states(fault, state, threshold).astype(float), faced, *here.T, *there.T]
    return {field.name: value for field, value in zip(OF_SLIDING, values, strict=True)}
