"""From a case to a finished run directory: the only time loop."""

from __future__ import annotations

import os
import platform
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, overload

import numpy as np

from ruptfx import RuptfxError, lumped
from ruptfx.bodies.state import State
from ruptfx.case import Case
from ruptfx.input.quantities import with_prefix
from ruptfx.lumped import LumpedModel
from ruptfx.platform import fem, launch, parallel, run_files
from ruptfx.platform.progress import Progress, note, working
from ruptfx.platform.stopwatch import phase, restart
from ruptfx.results import directories, figure_process
from ruptfx.results.record import Files, Record
from ruptfx.run import stages
from ruptfx.run.cost import need_memory
from ruptfx.run.model import Model
from ruptfx.run.recording import run_directory
from ruptfx.run.recording.checkpoint import Checkpoint, Checkpoints
from ruptfx.run.recording.early_log import EarlyLog
from ruptfx.run.recording.recorder import Recorder, versions
from ruptfx.stepping.steppers import Motion
from ruptfx.stepping.stopping import StopRules

if TYPE_CHECKING:
    import xarray

CHECK_EVERY = 25  # steps between checks for errors on any rank


class Interrupted(RuptfxError):  # noqa: N818
    """Stopped by a signal; the written files are readable."""

    exit_code = 130


@overload
def simulate(
    case: Case,
    out: str | Path = "run",
    comm: fem.MPI.Comm | None = None,
    progress: bool = True,
    resume: bool = False,
    complete: Callable[[], None] = lambda: None,
    overwrite: bool = False,
) -> Record: ...


@overload
def simulate(
    case: LumpedModel, out: str | Path = "run", comm: fem.MPI.Comm | None = None, progress: bool = True,
    resume: bool = False, complete: Callable[[], None] = lambda: None, overwrite: bool = False,
) -> xarray.Dataset: ...  # fmt: skip


def simulate(
    case: Case | LumpedModel, out: str | Path = "run", comm: fem.MPI.Comm | None = None, progress: bool = True,
    resume: bool = False, complete: Callable[[], None] = lambda: None, overwrite: bool = False,
) -> Record | xarray.Dataset:  # fmt: skip
    """Run a case and write a complete run directory.

    Parameters
    ----------
    case : Case or LumpedModel
        A lumped model needs one rank; it has no checkpoints, and `resume` starts an interrupted run again.
    out : str or Path
        Run directory; must not exist or be empty.
    comm : MPI communicator, optional
        Default is all ranks of the job; every rank calls this function.
    progress : bool
        Show a progress bar on rank 0.
    resume : bool
        Continue from the newest checkpoint in `out`, on any number of ranks; from the beginning if it was stopped
        before the first; not at all if it is complete. It must be a run of the same case.
    complete : callable
        Called on rank 0 when the run is complete, before its figures are drawn.
    overwrite : bool
        Replace the run in `out`, of any case, once this one is complete; other files stay.

    Returns
    -------
    Record or xarray.Dataset
        The finished run, on every rank; for a lumped model its result.

    Raises
    ------
    RuptfxError
        On all ranks. Files written so far are kept and readable.
    """
    out = Path(out)
    if resume and overwrite:
        raise RuptfxError("resume goes on with a run that overwrite would remove; give one of them")
    if isinstance(case, LumpedModel):  # before DOLFINx and MPI are loaded: it needs neither
        with Progress(progress) as bar:
            return lumped.simulate(case, out, bar.update, resume, overwrite)
    comm = fem.world(comm)
    if resume:
        parallel.on_root(comm, lambda: directories.refuse_links(out))
    case.set_sums(parallel.on_root(comm, case.read_sums))
    same = parallel.on_root(comm, lambda: case.hash) == case.hash
    parallel.raise_on_all(comm, None if same else RuptfxError(
        f"rank {comm.rank} read another case than rank 0: are the case file and its plug-ins the same on all machines?"
    ))  # fmt: skip
    if resume and run_directory.is_finished(comm, out, case):
        if comm.rank == 0:
            note(f"{out}: complete, nothing is computed; extend it: ruptfx resume {out} --duration TIME", progress)
            complete()
        return Record(out, trust=True)
    draws = case.output.figures and figure_process.LATER not in os.environ
    if draws and comm.rank == 0:
        figure_process.prepare()
    restart()
    with run_directory.reserved(comm, out):
        place = run_directory.begun(comm, out, case) if resume else out
        checkpoint = Checkpoint.latest(comm, place, case) if resume else None
        if checkpoint and comm.rank == 0 and case.sums and not (place / run_files.INPUTS).is_file():
            files = ", ".join(case.sums)
            note(f"{out}: of an earlier version, without checksums of {files}: assumed to be unchanged", progress)
        if not (resume or overwrite):
            run_directory.prepare(comm, out)
        began = time.perf_counter()
        early = EarlyLog(comm.rank == 0)
        with phase("model"), working("building the model", progress and comm.rank == 0), early:
            need_memory(case, comm)
            model = Model(case, comm)
            motion = stages.bind(model)
        early.show(progress)
        if checkpoint is None and (resume or overwrite):  # remove older files only after the model was built
            place = run_directory.prepare(comm, out, again=case, overwrite=overwrite)
        _run(model, motion, place, progress, checkpoint, began, early)
        run_directory.replace(comm, out)
        if comm.rank == 0:
            complete()
        if draws:
            with working("drawing the figures", progress and comm.rank == 0):
                _draw(comm, out)
    return Record(out, trust=True)


def _run(
    model: Model, motion: Motion, out: Path, progress: bool, checkpoint: Checkpoint | None, began: float,
    early: EarlyLog,
) -> None:  # fmt: skip
    """Run the time loop in a directory that is ready."""
    case, comm = model.case, model.comm
    with phase("model"):
        state = model.initial_state()
        state.lazy_bodies = True
        if checkpoint:
            checkpoint.restore(model, state)
    with (
        phase("steps"),
        Recorder(model, motion, out, checkpoint) as recorder,
        Signals() as signals,
        Progress(progress and comm.rank == 0) as bar,
    ):
        recorder.log.info("case %s: %d nodes, %d ranks, dt %.4g s", case.hash, model.total_nodes, comm.size, motion.dt)
        early.write_to(recorder.log)
        if comm.rank == 0:
            figure_process.announce(out)
        stopping = StopRules(model, case.stop_when)
        keepers = {**recorder.keepers, "stopping": stopping}
        checkpoints = Checkpoints(model, recorder, keepers)
        if checkpoint:
            checkpoint.recall(keepers)
        else:
            recorder.observe(state)
            recorder.record(state)
        stepping, first = time.perf_counter(), state.step
        bar.begin(state.time / case.duration)
        error = None
        while not recorder.finished(state) and not stopping.ended:
            # A rank with an error steps on, as the others wait for its messages; it is raised where all ranks meet.
            state.wants_energies = recorder.expects(state)
            failed = _step(motion, state)
            error = error or failed
            recorder.observe(state)
            regular, due = motion.collective or state.step % CHECK_EVERY == 0, recorder.due(state)
            if not (regular or due or comm.size == 1 or checkpoints.scheduled(state)):
                continue
            broken = error or recorder.failure()
            _raise_together(comm, broken or (_not_a_number(model, state) if regular or due else None))
            if due:
                recorder.record(state)
                bar.update(
                    state.time / case.duration,
                    f"{with_prefix(state.time, 's')} of {with_prefix(case.duration, 's')}  step {state.step}  "
                    f"peak slip rate {with_prefix(recorder.peak_slip_rate, 'm/s')}"
                )  # fmt: skip
                stopping.check(state)
            stop = signals.anywhere(comm)
            if stop or checkpoints.due(state):
                checkpoints.write(state)
            if stop:
                home = directories.home(out)
                raise Interrupted(
                    f"stopped by {stop} at {with_prefix(state.time, 's')} of {with_prefix(case.duration, 's')}, step "
                    f"{state.step}; "
                    f"{recorder.records} records are kept in {out}"
                    + f", and the run in {home} is as it was" * (home != out)
                    + f"; go on with: ruptfx resume {home}"
                )
        stepping = time.perf_counter() - stepping
        checkpoints.write(state, final=True)
        recorder.finish(state)  # behind the last checkpoint: a longer run has no record here
    _finish(model, out, {
        "wall_time": time.perf_counter() - began, "steps": state.step, "time_step": motion.dt,
        "nodes": model.total_nodes, "ended_by": stopping.ended or "duration",
        "node_updates_per_second": model.total_nodes * (state.step - first) / stepping, "ranks": comm.size,
    })  # fmt: skip


def _step(motion: Motion, state: State) -> RuptfxError | None:
    """Make one step; return the error of this rank, to be raised by all together."""
    try:
        motion.step(state)
    except RuptfxError as error:
        return error
    return None


def _not_a_number(model: Model, state: State) -> RuptfxError | None:
    """Return the error of the first node whose velocity is not finite, or None."""
    if np.isfinite(state.velocity @ state.velocity):
        return None
    bad = ~np.isfinite(state.velocity.reshape(model.nodes, -1)).all(axis=1)
    node = int(np.argmax(bad)) if bad.any() else int(np.argmax(np.abs(state.velocity)) // model.components)
    x = ", ".join(f"{value:.6g}" for value in model.coordinates[node])
    return RuptfxError(
        f"the motion is not a number or overflows at ({x}) m, time {state.time:.6g} s, step {state.step}; "
        "reduce stepper.safety or stepper.time_step"
    )


def _raise_together(comm: fem.MPI.Comm, error: Exception | None) -> None:
    """Raise on all ranks if any of them failed."""
    if comm.size > 1:
        parallel.raise_on_all(comm, error)
    elif error is not None:
        raise error


class Signals:
    """Conversion of stop signals to a flag that the time loop checks; a second SIGINT or SIGTERM acts immediately.

    SIGUSR1 and SIGXCPU are the warnings of batch systems and of a limit of the processor time (again every second).
    """

    def __init__(self) -> None:
        self.received = ""
        self._before: dict[int, signal.Handlers | Callable[[int, FrameType | None], object] | int | None] = {}

    def __enter__(self) -> Signals:
        try:
            for number in launch.STOPPING:
                self._before[number] = signal.signal(number, self._receive)
        except ValueError:  # not the main thread: leave signals alone
            pass
        return self

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
        if number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._before[number] or signal.SIG_DFL)

    def anywhere(self, comm: fem.MPI.Comm) -> str:
        """Return the signal that any rank received; collective, the same on all."""
        received = self.received or launch.asked_to_stop()
        if comm.size == 1:
            return received
        return next(filter(None, comm.allgather(received)), "")

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)


@contextmanager
def interruptible_progress(
    comm: fem.MPI.Comm, show: bool, kept: Callable[[], str] = lambda: "nothing is kept"
) -> Iterator[Callable[[float, str], None]]:
    """Yield a report of progress that ends the work on all ranks once any of them received a stop signal; collective.

    Parameters
    ----------
    show : bool
        Whether this rank shows the progress.
    kept : callable
        Returns what is kept, for the message.

    Raises
    ------
    Interrupted
        On all ranks, when the progress is reported.
    """
    with Signals() as signals, Progress(show) as bar:

        def report(done: float, text: str) -> None:
            if received := signals.anywhere(comm):
                raise Interrupted(f"stopped by {received}; {kept()}")
            bar.update(done, text)

        yield report


def _finish(model: Model, out: Path, facts: dict[str, object]) -> None:
    """Analyse the run and write the summary on rank 0; all ranks raise its error."""

    def finish() -> None:
        from ruptfx.results.analysis import summarise

        with Files(out, trust=True) as record:  # its plug-ins have just been executed by the run
            findings = summarise(record)
        entries = {**versions(), "python_version": platform.python_version(), "numpy_version": np.__version__}
        run_files.complete(out, {
            **findings, **facts, "title": model.case.title, "case_hash": model.case.hash, "versions": entries,
            "host_cores": os.cpu_count(),
        })  # fmt: skip

    parallel.on_root(model.comm, finish)


def _draw(comm: fem.MPI.Comm, out: Path) -> None:
    """Draw the figures of a complete run; all ranks raise its error."""
    error = None
    if comm.rank == 0:
        try:
            figure_process.draw(out)
        except Exception as caught:
            error = caught
    parallel.rest(comm)
    parallel.raise_on_all(comm, error)
