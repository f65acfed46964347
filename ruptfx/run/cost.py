"""Cost of a whole run in processor time, memory and disk, measured in a rehearsal; check of the available memory.

The rehearsal is the beginning of the run: real steps for half a second, records and snapshots, so that it includes this
machine, this mesh and this friction law. A figure process is started as in a run; the cost of figures is estimated from
its start-up time. Work outside of the run, such as other rows of `ruptfx check`, is excluded.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.case import Case
from ruptfx.input.fields import stress_entries
from ruptfx.platform import fem, parallel
from ruptfx.platform.memory import largest_memory, refuse_shortage
from ruptfx.results import figure_process
from ruptfx.results.analysis.raster import PIXELS
from ruptfx.run.recording.bulk_fields import BulkFields, recorded_states
from ruptfx.run.recording.mechanisms import Records, records_of
from ruptfx.run.recording.recorder import Recorder
from ruptfx.run.recording.sampling import Samples
from ruptfx.run.recording.schedule import count

if TYPE_CHECKING:
    from ruptfx.readings.instruments import Channel, Instrument
    from ruptfx.run.model import Model
    from ruptfx.stepping.steppers import Motion

NEVER = {"interface": 10**9, "bulk": 10**9, "forces": 10**9}  # index of the next records, to suppress them
SECONDS, FEWEST = 0.5, 6  # steps of the rehearsal: sufficient processor time [s], and smallest number
LIBRARIES = 160e6  # bytes of a rank before it has a mesh (`ruptfx bench memory`)
# Bytes per node of a model in its first step, by components of the motion: lower bound of a run. Two components
# as measured by `ruptfx bench memory` with 8 million nodes, less a tenth.
PER_NODE = {1: 130.0, 2: 245.0, 3: 245.0}
INVERSE_MASSES = 3  # of every node: those of the first, the second and all later steps
# Largest processor time of the start of the program, and of the analysis at its end, over that of a fixed piece of
# Python; of a plain panel of a figure over that of the start of the figure process (`ruptfx bench command_cost`).
START, ANALYSIS, PANEL = 40.0, 1.0, 0.085
PACES = 5  # parts of that piece, of which the median is used
# Memory of the figure process [bytes]: imports, additional for each pixel of the bodies.
DRAWS, PIXEL = 125e6, 180.0
PICTURE = 0.2e6  # bytes of a figure file
BYTES = {"double": 8, "single": 4}


@dataclass(frozen=True)
class Cost:
    """Cost of a run on one rank with all outputs.

    Attributes
    ----------
    step, time : float
        Processor time of a step, and of the command [s].
    memory, disk : float
        Largest resident memory, and files without checkpoints [bytes].
    """

    step: float
    time: float
    memory: float
    disk: float


def rehearse(model: Model, motion: Motion, steps: int | None, started: float, built: float) -> Cost:
    """Return the cost of a run.

    Parameters
    ----------
    steps : int or None
        None if their number is unknown; only the first steps are counted then.
    started, built : float
        Processor time of this program at the start and end of building the model [s]. The time before is that of
        start-up, in a program without other work.
    """
    case, pace, parts = model.case, _pace(), records_of(model)
    figures = _work_of_figures(case, parts) if case.output.figures else {}
    draws = figure_process.start_up() if figures else None
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        with Recorder(model, motion, Path(folder)) as recorder:
            run = _Beginning(model, motion, recorder)
            opening = time.process_time() - began
            most_steps = max(steps - 1, 1) if steps else np.inf
            step = _each(run.step, SECONDS, FEWEST, most_steps)
            of_record = _each(run.step_and_record, 0.2 * SECONDS, 2) - step
            of_snapshot = _each(run.snapshot, 0.1 * SECONDS, 1)
    records, snapshots = counts(case, steps)
    total = min(started, START * pace) + built - started + opening + max((steps or 0) - 1, 0) * step
    total += max(records - 2, 0) * max(of_record, 0.0) + max(snapshots - 1, 0) * of_snapshot + ANALYSIS * pace
    memory = largest_memory()
    if draws is not None:
        total += (1 + PANEL * sum(figures.values())) * draws()
        memory += DRAWS + sum(each.memory for each in parts)
        if "wavefield" in figures or "fringes" in figures:
            size = np.ptp(model.coordinates, axis=0)[:2]
            memory += PIXEL * PIXELS**2 * size.min() / size.max()
    disk = _bytes_of_files(model, parts, steps) + len(figures) * PICTURE
    disk += bool(figures) * sum(each.pictures for each in parts)
    return Cost(step, total, memory, disk)


class _Beginning:
    """First steps of a run, with the work of the loop around them, and records on request.

    Made, it has the first state, a step, a record of the end of that, and a snapshot, in which what needs it is
    compiled.
    """

    def __init__(self, model: Model, motion: Motion, recorder: Recorder) -> None:
        self.motion, self.recorder, self.state = motion, recorder, model.initial_state()
        self.state.lazy_bodies = True
        recorder.observe(self.state)
        self._record("interface")
        self.step_and_record()
        self.snapshot()

    def step(self) -> None:
        self._step(watched=False)

    def step_and_record(self) -> None:
        """Make a step and a record; energies of a record come from its step."""
        self._step(watched=True)
        self._record("interface")

    def snapshot(self) -> None:
        self._record("bulk")

    def _step(self, watched: bool) -> None:
        self.recorder.next = dict(NEVER)
        self.recorder.expects(self.state)
        self.state.wants_energies = watched
        self.motion.step(self.state)
        self.recorder.observe(self.state)
        self.recorder.due(self.state)

    def _record(self, what: str) -> None:
        """Make one kind of record due and write it."""
        self.recorder.next = NEVER | {what: 0}
        self.recorder.last[what] = -1.0
        self.recorder.record(self.state)
        self.recorder.meet()


def _pace() -> float:
    """Return the processor time of a fixed piece of Python [s], about 0.04."""
    return PACES * median(_once(lambda: sum(len(f"{number:.3g}") for number in range(20_000))) for _ in range(PACES))


def _each(action: Callable[[], object], seconds: float, fewest: int, most: float = np.inf) -> float:
    """Return the mean processor time of an action [s], repeated for so many seconds."""
    begin, times = time.process_time(), 0
    while times < most and (times < fewest or time.process_time() - begin < seconds):
        action()
        times += 1
    return (time.process_time() - begin) / times


def _once(action: Callable[[], object]) -> float:
    return _each(action, 0.0, 1)


def _bytes_of_files(model: Model, parts: list[Records], steps: int | None) -> float:
    """Return the bytes of the files of mechanisms, bulk.h5 (uncompressed), instruments.h5 and, as text, energy.csv."""
    case = model.case
    records, snapshots = counts(case, steps)
    numbers = float(sum(each.numbers(records, snapshots) for each in parts))
    for instrument, channels in measured(model, 0.0) if case.instruments else []:
        numbers += case.duration / instrument.interval * (1 + len(channels))
    dim, c = model.coordinates.shape[1], model.components
    columns = {"velocity": c, "displacement": c, "stress": len(stress_entries(case.plane, c)), "fringe": 1}
    columns["state"] = len(recorded_states(model))
    of_snapshot = sum(columns[name] for name in case.output.bulk_fields) * BYTES[case.output.bulk_precision]
    mesh = 8 * (dim + 2**dim)  # points, and about as many cells between them
    of_energies = 20 * (len(model.energy_columns) + 2) * records
    return 8 * numbers + model.total_nodes * (snapshots * of_snapshot + mesh) + of_energies


def measured(model: Model, dt: float) -> list[tuple[Instrument, list[Channel]]]:
    """Return the instruments of a case and the channels of each."""
    return Samples(model, dt, BulkFields(model).initial_stress.at).instruments


def counts(case: Case, steps: int | None) -> tuple[int, int]:
    """Return the numbers of records of the interfaces and of snapshots of the bodies, at most one per step."""
    intervals = case.intervals
    records, snapshots = (
        count(intervals[what], case.duration) if what in intervals else 0 for what in ("interface", "bulk")
    )
    if steps is None:
        return 1 + records, snapshots
    every = case.output.interface_steps
    records += 0 if every is None else steps // every
    return 1 + min(records, steps), min(snapshots, steps)


def _work_of_figures(case: Case, parts: list[Records]) -> dict[str, int]:
    """Return the figures of such a run (at most), each with its cost in plain panels."""
    work = {"energy_budget": 4}
    for each in parts:
        work |= each.figures
    if case.plane != "solid" and "velocity" in case.output.bulk_fields:
        work["wavefield"] = 7
    if case.plane != "solid" and "fringe" in case.output.bulk_fields and case.output.plate_thickness is not None:
        work["fringes"] = 5
    if case.instruments:
        work["instruments"] = 1 + len(case.instruments)
    return work


# -- memory --------------------------------------------------------------------------------------------------------


def need_memory(case: Case, comm: fem.MPI.Comm) -> None:
    """Refuse a mesh that does not fit into the memory of this machine, before it is built; collective.

    Only for meshes whose size is known beforehand; the estimate is a lower bound of a run.

    Raises
    ------
    RuptfxError
        On all ranks; the message gives the memory and the remedy.
    """
    lattice, ranks = case.mesh.lattice(), parallel.ranks_here(comm)
    if lattice is None:
        return
    components, nodes = {"antiplane": 1, "solid": 3}.get(case.plane, 2), lattice.nodes(case.order)
    shorter = BYTES["double"] - case.real.itemsize
    per_node = PER_NODE[components] - shorter * (2 * components + INVERSE_MASSES)  # velocity, force and these
    least = ranks * LIBRARIES + nodes * per_node * ranks / comm.size
    part = "an eighth" if case.plane == "solid" else "a quarter"
    refuse_shortage(
        comm, "mesh", f"{nodes:.3g} nodes", least,
        f"twice the mesh.element_size takes {part}. Else make the bodies smaller, let elements grow away from the "
        "interface (mesh.growth), or spread the ranks over several machines", " of memory at least",
    )  # fmt: skip
