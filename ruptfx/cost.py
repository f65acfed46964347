"""What a whole run takes in processor time, memory and disk, measured in a rehearsal; and whether there is the memory.

The rehearsal makes a few real steps and records, so that it knows this machine, this mesh and this friction law. It
counts what a run has besides: start, model, compiling, analysis and figures.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError, fem
from ruptfx.case import Case
from ruptfx.fields import DERIVED, ENERGIES, FIELDS, OF_SLIDING
from ruptfx.recording.bulk_fields import BulkFields
from ruptfx.recording.crack_files import SNAPSHOTS
from ruptfx.recording.recorder import Recorder
from ruptfx.recording.sampling import Samples

if TYPE_CHECKING:
    from ruptfx.instruments import Channel, Instrument
    from ruptfx.model import Model
    from ruptfx.steppers import Motion

STEPS = 6  # of the rehearsal, after the first
LIBRARIES = 160e6  # bytes of a rank before it has a mesh (`ruptfx bench memory`)
# Bytes per node of a model in its first step, by components of the motion: the least that a run takes. Two components
# as measured by `ruptfx bench memory` with 8 million nodes, less a tenth.
PER_NODE = {1: 130.0, 2: 245.0}
# Processor time of the start of the program at most, of the analysis at its end, of the start of what draws and of a
# figure, all of them Python at work, over that of a fixed piece of Python; bytes of a figure's file
# (`ruptfx bench command_cost`).
START, ANALYSIS, PAINTER, DRAWING, PICTURE = 40.0, 2.5, 50.0, 12.5, 0.2e6
PACES = 5  # parts of that piece, the middle one of which counts
FIGURES, CRACKS = 190e6, 200e6  # bytes of memory of what draws, and more where it draws bodies that break
BYTES = {"double": 8, "single": 4}


@dataclass(frozen=True)
class Cost:
    """Of a run on one rank with all it leaves.

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


def rehearse(model: Model, motion: Motion, steps: int | None, started: float) -> Cost:
    """The cost of a run.

    Parameters
    ----------
    model : Model
    motion : Motion
    steps : int or None
        None where their number is not known; only the first are counted then.
    started : float
        Processor time of this program when it began with the model [s]: what starting takes, in a program that did
        nothing else.
    """
    case, pace = model.case, _pace()
    spared = max(started - START * pace, 0.0)  # a program that did something else before
    with tempfile.TemporaryDirectory() as folder, Recorder(model, motion, Path(folder)) as recorder:
        state = model.initial_state()
        state.unseen = True

        def record(what: str) -> None:
            """Make the recorder believe that this is due."""
            recorder.next = {"interface": 10**9, "bulk": 10**9, what: 0}
            recorder.last = -1.0
            recorder.record(state)
            recorder.meet()

        record("interface")
        motion.step(state)
        record("bulk")  # compiles
        step = _each(lambda: motion.step(state), STEPS)
        of_record = _each(lambda: record("interface"), 2)
        of_snapshot = _each(lambda: record("bulk"), 1)
    figures = number_of_figures(case) if case.output.figures else 0
    records, snapshots = _counts(case, steps)
    total = time.process_time() - spared - pace + max((steps or 0) - STEPS, 0) * step
    total += max(records - 3, 0) * of_record + max(snapshots - 2, 0) * of_snapshot
    total += (ANALYSIS + PAINTER * bool(figures) + figures * DRAWING) * pace
    memory = largest_memory() + bool(figures) * (FIGURES + CRACKS * (case.fracture is not None))
    return Cost(step, total, memory, _bytes_of_files(model, steps) + figures * PICTURE)


def _pace() -> float:
    """Processor time of a fixed piece of Python [s], about 0.04."""
    return PACES * median(_each(lambda: sum(len(f"{number:.3g}") for number in range(20_000)), 1) for _ in range(PACES))


def _each(action: Callable[[], object], times: int) -> float:
    """Processor time of an action [s]."""
    begin = time.process_time()
    for _ in range(times):
        action()
    return (time.process_time() - begin) / times


def _bytes_of_files(model: Model, steps: int | None) -> float:
    """Numbers in interface.h5, bulk.h5 (before compression) and instruments.h5 and, as text of 20, in energy.csv."""
    case = model.case
    records, snapshots = _counts(case, steps)
    numbers = 0.0
    for fault in model.faults:
        recorded = [field for field in (*FIELDS, *DERIVED, *(OF_SLIDING if fault.slides else ())) if field.recorded]
        names = [name for field in recorded for name in field.names(fault.tangents)]
        numbers += records * fault.interface.total * (len(names) + len(fault.state_fields()))
    for instrument, channels in measured(model, 0.0) if case.instruments else []:
        numbers += case.duration / instrument.interval * (1 + len(channels))
    dim, c = model.coordinates.shape[1], model.components
    columns = {"velocity": c, "displacement": c, "stress": {1: 2, 2: 3, 3: 6}[c], "fringe": 1}
    of_snapshot = sum(columns[name] for name in case.output.bulk_fields) * BYTES[case.output.bulk_precision]
    mesh = 8 * (dim + 2**dim)  # points, and about as many cells between them
    if model.cracks is not None:
        # Ends, lines, normal, length and bodies of every facet once; what snapshots show of it, one byte the status.
        numbers += int(model.cracks.owned.sum()) * (10 + snapshots * (len(SNAPSHOTS) - 1 + 1 / 8))
    return 8 * numbers + model.total_nodes * (snapshots * of_snapshot + mesh) + 20 * (len(ENERGIES) + 2) * records


def measured(model: Model, dt: float) -> list[tuple[Instrument, list[Channel]]]:
    """The instruments of a case and the numbers that each of them makes."""
    return Samples(model, dt, BulkFields(model).initial_stress_at).instruments


def _counts(case: Case, steps: int | None) -> tuple[float, float]:
    """How many records of the interfaces and snapshots of the bodies a run makes."""
    output, most = case.output, np.inf if steps is None else steps + 1
    records = case.duration / (output.interface_interval or case.duration / 300) + 1
    if steps is not None and output.interface_steps is not None:
        records += steps / output.interface_steps
    return min(records, most), min(case.duration / (output.bulk_interval or case.duration / 6), most)


def number_of_figures(case: Case) -> int:
    """How many pictures such a run ends with, at most."""
    flat = case.plane != "solid"
    fringes = case.output.plate_thickness is not None and "fringe" in case.output.bulk_fields
    bodies = flat * (("velocity" in case.output.bulk_fields) + fringes)
    sliding = 3 * any(fault.sliding is not None for fault in case.faults.values())
    return 1 + 4 * bool(case.faults) + sliding + (case.fracture is not None) + bodies + bool(case.instruments)


# -- memory --------------------------------------------------------------------------------------------------------


def need_memory(case: Case, comm: fem.MPI.Comm) -> None:
    """Refuse a mesh that does not fit into the memory of this machine, before any of it is made; collective.

    Only for meshes whose size is known beforehand; what is counted is the least that a run takes.

    Raises
    ------
    RuptfxError
        On all ranks: how much it would take, and what to do.
    """
    lattice, there = case.mesh.lattice(), available()
    here = comm.Split_type(fem.MPI.COMM_TYPE_SHARED).size if comm.size > 1 else 1
    if lattice is None or there is None:
        return
    p, components = case.order, 1 if case.plane == "antiplane" else 2
    nodes = sum((lattice.columns * p + 1) * (rows * p + 1) for rows in lattice.rows)
    least = here * LIBRARIES + nodes * PER_NODE[components] * here / comm.size
    if least > there:
        raise RuptfxError(
            f"mesh: {nodes:.3g} nodes take {least / 1e9:.3g} GB of memory at least, and {there / 1e9:.3g} GB are free "
            f"here; twice the mesh.element_size takes a quarter. Else make the bodies smaller, let elements grow away "
            "from the interface (mesh.growth), or spread the ranks over several machines"
        )


def largest_memory() -> float:
    """The most that this program ever held [bytes]; getrusage would count the program that started it, too."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0
    return next(float(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:"))


def available(root: Path = Path("/")) -> float | None:
    """Memory that is free for this process [bytes]: of the machine, and of its control group; None where not known."""
    try:
        lines = (root / "proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    free = [float(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
    groups = root / "sys/fs/cgroup"
    for limit, used in (("memory.max", "memory.current"),
                        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes")):  # fmt: skip
        try:
            free.append(float((groups / limit).read_text()) - float((groups / used).read_text()))
        except (OSError, ValueError):  # no such group, or its limit is "max"
            continue
    return max(min(free), 0.0) if free else None
