"""Forces between two sliding bodies, and the stick, slip and open parts of the interface."""

from __future__ import annotations

from math import isqrt

import numpy as np

from ruptfx import Table
from ruptfx.bodies.state import State
from ruptfx.input.fields import component_names, extensive_unit
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.sliding.contact_states import OPEN, SLIDING, STICKING, UNCOVERED, contact_states
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.interfaces.sliding.surface import Floats
from ruptfx.platform import fem, parallel

PARTS = ("sticking", "sliding", "open", "uncovered")
WORKS = {  # sums of energies
    "friction_work": ("frictional_dissipation",), "impact_work": ("impact_loss", "pairing_update_loss"),
}  # fmt: skip
OTHERS = len(PARTS) + len(WORKS)
OF_RECORDS = "that of the record of the interface"
OF_MEANS = "the middle of the time over which all numbers of a row are means"


def columns(tangents: int) -> tuple[str, ...]:
    """Return the columns of the file besides time."""
    return "normal_force", *component_names("shear_force", tangents), *PARTS, *WORKS


def remark(means: bool, plane: str) -> str:
    """Return the first line of the file, which describes its columns."""
    force, energy = (extensive_unit(unit, plane) for unit in "NJ")
    size, along = ("area", ", shear along both mean tangents") if plane == "solid" else ("length", "")
    return (
        f"time in s, {OF_MEANS if means else OF_RECORDS}; forces between the bodies in {force}, the normal one "
        f"positive in compression{along}; then parts of the {size} of the plus side; then, in {energy}, what friction "
        "took so far, and what impacts and updates of the pairing did"
    )


def row(comm: fem.MPI.Comm, fault: Fault, state: State, threshold: float) -> list[float]:
    """Return normal (compression positive) and shear forces in the mean frame [N/m or N], parts and works; collective.

    After the forces are the parts of the length or area of the plus side that stick, slide, are open or have no
    partner, and the works. Sliding points are faster than `threshold` [m/s].
    """
    return _row(comm, _sums(fault, state, threshold))


def _sums(fault: Fault, whole: State, threshold: float) -> Floats:
    """Return force, size times tangents, works, and sizes by state of contact; of this rank."""
    face, state = fault.interface, whole.faults[fault.name]
    assert isinstance(face, SlidingInterface)
    area = face.owned * face.weight
    local = np.column_stack([-state["normal_stress"], fault.components(state, "shear_traction")])
    states = contact_states(fault, state, threshold)
    status = [area @ (states == each) for each in (STICKING, SLIDING, OPEN, UNCOVERED)]
    works = [sum(whole.energy[f"{fault.name}.{name}"] for name in names) for names in WORKS.values()]
    force, tangents = np.einsum("i,ik,ikc->c", area, local, face.frame), np.einsum("i,ikc->kc", area, face.frame[:, 1:])
    return np.concatenate([force, tangents.ravel(), works, status])


def _row(comm: fem.MPI.Comm, sums: Floats) -> list[float]:
    """Return the row from the sums of every rank; collective."""
    dim = isqrt(len(sums) - OTHERS)
    force, tangent, second, works, parts = np.split(
        parallel.total(comm, sums.tolist()), [dim, 2 * dim, dim * dim, dim * dim + len(WORKS)]
    )
    tangent /= np.linalg.norm(tangent)
    if dim == 2:
        rows = np.array([[-tangent[1], tangent[0]], tangent])
    else:
        normal = np.cross(tangent, second)
        normal /= np.linalg.norm(normal)
        rows = np.stack([normal, tangent, np.cross(normal, tangent)])
    normal_force, *shear = (rows @ force).tolist()
    return [-normal_force, *shear, *(parts / parts.sum()).tolist(), *works.tolist()]


class ForceMeans:
    """Mean forces and parts of sliding interfaces over time, which contain all events between two rows.

    Parameters
    ----------
    faults : list of Fault
        Faults with finite sliding.
    threshold : float
        Slip rate above which a point slides [m/s].
    """

    def __init__(self, comm: fem.MPI.Comm, faults: list[Fault], threshold: float) -> None:
        self._comm, self._faults, self._threshold = comm, faults, threshold
        self._sums = {fault.name: np.zeros(fault.interface.points.shape[1] ** 2 + OTHERS) for fault in faults}
        self._began = self._time = 0.0

    def observe(self, state: State) -> None:
        """Add the state after a step; its forces represent the time since the previous step."""
        now = state.fault_time
        for fault in self._faults if now > self._time else []:
            self._sums[fault.name] += (now - self._time) * _sums(fault, state, self._threshold)
        self._time = max(now, self._time)

    def take(self) -> tuple[float, dict[str, list[float]]]:
        """Return the middle of the time since the last call [s], and the row of the means; collective."""
        length, middle = self._time - self._began, 0.5 * (self._began + self._time)
        rows = {name: _row(self._comm, sums / length) for name, sums in self._sums.items()}
        for sums in self._sums.values():
            sums[:] = 0
        self._began = self._time
        return middle, rows

    def table(self) -> Table | None:
        """Return all data that change, of every rank on rank 0, for a checkpoint; collective."""
        ranks = self._comm.gather({name: sums.tolist() for name, sums in self._sums.items()}, root=0)
        return None if ranks is None else {"began": self._began, "time": self._time, "ranks": ranks}

    def restore(self, table: Table) -> None:
        """Continue from a checkpoint; on another number of ranks rank 0 takes the sum."""
        self._began, self._time, ranks = table["began"], table["time"], table["ranks"]
        mine = ranks if self._comm.rank == 0 else []
        if len(ranks) == self._comm.size:
            mine = [ranks[self._comm.rank]]
        for name, sums in self._sums.items():
            sums[:] = np.sum([rank[name] for rank in mine], axis=0) if mine else 0.0
