"""Shared parts of the fracture benchmarks: a case run in memory, its events, edge forces and energies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.app.bench import Check
from ruptfx.case import Case, read_case
from ruptfx.interfaces.cracks.extrinsic import Extrinsic
from ruptfx.platform import fem
from ruptfx.run.model import Model
from ruptfx.run.recording.crack_files import events, facets_of
from ruptfx.run.recording.edge_sums import EdgeSums

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State

SAMPLES = 400  # of the forces


@dataclass(frozen=True)
class Broken:
    """Result of one fracture run.

    Attributes
    ----------
    events : dict of ndarray
        Columns of `events.h5`, with `mode` as text.
    ends : ndarray, shape (events, 2, 2)
        Of the facets that failed [m].
    time : ndarray, shape (samples,)
        Of the forces [s].
    edges : dict of ndarray
        Columns of `edges.csv` by name.
    closure : float
        Largest unaccounted energy over the largest work.
    """

    events: dict[str, np.ndarray]
    ends: np.ndarray
    time: np.ndarray
    edges: dict[str, np.ndarray]
    closure: float

    def budget(self) -> Check:
        """Return the check of the energy closure that every benchmark has."""
        return Check("energy closure", 0.0, self.closure, 1e-10, "1", "exact")


def demo(name: str, overrides: Iterable[str] = ()) -> Case:
    """Return a demo case with other values."""
    case = read_case(str(files("ruptfx").joinpath("demos", f"{name}.toml")), overrides)
    assert isinstance(case, Case)
    return case


def rigid(case: Case, check_every: int = 2) -> Case:
    """Return the same case with extrinsic facets."""
    given = case.fracture
    assert given is not None
    changed = Extrinsic(
        default=given.default, pairs=given.pairs, joints=given.joints, thickness=given.thickness,
        unresolved=given.unresolved, check_every=check_every,
    )  # fmt: skip
    return case.model_copy(update={"fracture": changed})


def openings(model: Model, state: State) -> dict[str, float]:
    """Return the mean opening of every joint beyond that of its springs [m]."""
    cracks = model.cracks
    assert cracks is not None
    joint, length = (values[cracks.order] for values in (cracks.network.joint, cracks.network.length))
    opened = state.cracks["inelastic_opening"].mean(axis=1)
    return {
        name: float(np.average(opened[joint == number], weights=length[joint == number]))
        for number, name in enumerate(model.bodies.joints)
    }


def broken(case: Case, comm: fem.MPI.Comm | None = None) -> Broken:
    """Run a case in memory on one rank."""
    model = Model(case, comm or fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    sums = EdgeSums(model)
    rows, lost, work = [], [0.0], 1e-300
    steps = int(np.ceil(case.duration / motion.dt))
    every = max(steps // SAMPLES, 1)
    for step in range(steps):
        motion.step(state)
        if step % every == 0:
            rows.append([state.fault_time, *sums.row(state)])
        if step % (10 * every) == 0 or step == steps - 1:
            energy = model.energies(state)
            lost.append(energy["boundary_work"] - sum(v for name, v in energy.items() if name != "boundary_work"))
            work = max(work, abs(energy["boundary_work"]))
    assert model.cracks is not None and case.fracture is not None
    cracks: FaultState = model.cracks.gather(state.cracks)
    facets = model.cracks.gather(facets_of(model.cracks))
    table, words = events(cracks, facets, model.bodies.names, list(model.bodies.joints), case.fracture.thickness)
    failed = np.flatnonzero(np.isfinite(cracks["time_of_failure"]))
    failed = failed[np.argsort(cracks["time_of_failure"][failed], kind="stable")]
    columns = np.array(rows).T
    return Broken(
        {**table, "mode": np.array(words["mode"])}, facets["ends"].reshape(-1, 2, 2)[failed], columns[0],
        dict(zip(sums.columns, columns[1:], strict=True)), float(np.max(np.abs(lost))) / work,
    )  # fmt: skip
