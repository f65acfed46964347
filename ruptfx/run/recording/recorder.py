"""Recording of a run: interface histories, bulk snapshots, the energy table, the log, the final marker.

Rows of all files are in an order that does not depend on the partition. Rank 0 writes interface data, every
rank its part of the bodies, on threads of their own. A run directory is complete when `summary.json` is there: it is
written last, to a temporary name, and renamed. Only figures follow.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

import h5py
import numpy as np

from ruptfx import RuptfxError, Table, __version__
from ruptfx.input.fields import extensive_unit
from ruptfx.platform import fem, parallel, run_files
from ruptfx.platform.stopwatch import phase, phases
from ruptfx.run.recording.bulk_fields import BulkFields, Topology
from ruptfx.run.recording.instruments_file import InstrumentsFile
from ruptfx.run.recording.mechanisms import Opening, records_of
from ruptfx.run.recording.sampling import Samples
from ruptfx.run.recording.schedule import Schedule, end_of
from ruptfx.run.recording.table_file import TableFile
from ruptfx.run.recording.writer import Writer
from ruptfx.stepping.steppers import sync_bodies

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model
    from ruptfx.run.recording.checkpoint import Checkpoint, Keeper
    from ruptfx.run.recording.mechanisms import Records
    from ruptfx.stepping.steppers import Motion


class DiskError(RuptfxError):
    """The disk is full or missing; HDF5 cannot write its remaining data and would fail at exit."""

    at_once = True


class Recorder:
    """Writes the files of one run; a context manager that leaves readable files however the run ends.

    Records are made at multiples of an interval, each after the first step that reaches its time. The first state
    and that at the end of the duration are recorded, too. All fields of a record belong to its time:
    for interfaces that of the traction, in explicit runs one step before the present displacement;
    for bodies and energies that of the velocity, half a step before it. Data of mechanisms are in files of their own
    (`ruptfx.run.recording.mechanisms`).

    Parameters
    ----------
    motion : Motion
        The stepper, which computes the energies.
    out : Path
        An existing empty directory.
    resume : Checkpoint, optional
        Continue the files of this checkpoint.
    """

    def __init__(self, model: Model, motion: Motion, out: Path, resume: Checkpoint | None = None) -> None:
        self.model, self.out, self._motion, self._resume = model, out, motion, resume
        case = model.case
        self._schedules = {what: Schedule(interval) for what, interval in case.intervals.items()}
        # Index of the next time: bulk snapshots and means start after time zero.
        self.next = {"interface": 0, "bulk": 1, "forces": 1}
        self.counts = {"interface": 0, "bulk": 0, "forces": 0}  # numbers of records in the files
        self.last = {"interface": -1.0, "bulk": 0.0, "forces": 0.0}  # times of the last records [s]
        self._fastest = self._fastest_recorded = 0.0  # m/s, for `output.interface_growth`
        self._ending = False
        self.largest_work = 0.0
        self.peak_slip_rate = 0.0  # largest slip rate of the last record, on rank 0
        self.log = logging.getLogger("ruptfx.run")
        self._bulk = BulkFields(model)
        self.samples = Samples(model, motion.dt, self._bulk.initial_stress.at)
        self.parts = records_of(model)
        self._instruments: InstrumentsFile | None = None
        self._writer = Writer()

    @property
    def keepers(self) -> dict[str, Keeper]:
        """Return the objects of the recorder with data for checkpoints, itself among them."""
        entries: dict[str, Keeper] = {"recorder": self, "samples": self.samples}
        for each in self.parts:
            entries |= each.keepers()
        return entries

    def table(self) -> Table:
        """Return all data that change, for a checkpoint."""
        return {
            "next": self.next, "counts": self.counts, "last": self.last, "largest_work": self.largest_work,
            "peak_slip_rate": self.peak_slip_rate, "fastest_recorded": self._fastest_recorded,
        }  # fmt: skip

    def restore(self, table: Table) -> None:
        """Continue from a checkpoint."""
        self.next, self.counts, self.last = dict(table["next"]), dict(table["counts"]), dict(table["last"])
        self.largest_work, self.peak_slip_rate = table["largest_work"], table["peak_slip_rate"]
        self._fastest_recorded = table.get("fastest_recorded", 0.0)

    @property
    def records(self) -> int:
        """Number of the records of the interfaces."""
        return self.counts["interface"]

    def finished(self, state: State) -> bool:
        """Return whether the state has reached the duration of the case."""
        return state.fault_time >= end_of(self.model.case.duration)

    def __enter__(self) -> Recorder:
        with phase("gathering"):
            topology = self._bulk.topology()
            for each in self.parts:
                each.gather()
        try:
            self.meet(lambda: self._open() if self.model.comm.rank == 0 else None)
            self.meet(lambda: self._open_bulk(topology))
        except BaseException:
            self._writer.close()
            raise
        return self

    def _open_bulk(self, topology: Topology) -> None:
        self._bulk.create(self.out, topology)
        if self._resume:
            self._bulk.restore(self._resume.path / "bulk.h5", self._kept("bulk"))

    def _kept(self, what: str) -> int | None:
        """Return the number of records to keep in the files of the checkpoint, None without one.

        Later records are those of an end.
        """
        return None if self._resume is None else int(self._resume.manifest["memory"]["recorder"]["counts"][what])

    def _open(self) -> None:
        if self._resume:
            for part in self.out.glob("bulk.*.h5"):  # parts of ranks that may no longer exist
                part.unlink()
            self._resume.restore_files(self.out)
        else:
            for name in self._names():  # files of the same case, stopped before its first checkpoint
                (self.out / name).unlink(missing_ok=True)
            self.model.case.save(self.out)
        run_files.begin(self.out, self._names())
        handler = logging.FileHandler(self.out / "run.log")
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        self._log_before = self.log.handlers, self.log.level, self.log.propagate
        self.log.handlers = [handler]
        self.log.setLevel(logging.INFO)
        self.log.propagate = False
        self._energies = TableFile(self.out / "energy.csv", [*self.model.energy_columns, "closure"], (
            "time in s, that of the velocities in explicit runs, half a step after the record of the interface; "
            f"energies in {extensive_unit('J', self.model.case.plane)}, closure relative to the largest work"
        ), self._kept("interface"))  # fmt: skip
        if self.samples.instruments:
            self._instruments = InstrumentsFile(self.out / "instruments.h5", self.samples.instruments, {
                "case_hash": self.model.case.hash, "initial_stress": self._bulk.initial_stress.origin,
                "record": "all numbers of a sample are of its time, linear between the steps", **versions(),
            })  # fmt: skip
        opening = Opening(self.out, self._kept, {"case_hash": self.model.case.hash, **versions()})
        for each in self.parts:
            each.open(opening)

    def _names(self) -> list[str]:
        """Return the names of the files that this run writes, except for the case."""
        size = self.model.comm.size
        names = ["run.log", "energy.csv", run_files.SUMMARY, "bulk.h5", "bulk.xdmf"]
        names += [f"bulk.{rank}.h5" for rank in range(size)] if size > 1 else []
        names += ["instruments.h5"] if self.samples.instruments else []
        return names + [name for each in self.parts for name in each.names()]

    def reopen(self) -> list[Path]:
        """Write all data in memory; return the history files of this rank, which may then be copied."""
        files = self._bulk.reopen()
        if self.model.comm.rank == 0:
            files.append(self._energies.path)
            if self._instruments is not None:
                self._instruments.reopen()
                files.append(self._instruments.path)
            for each in self.parts:
                files += each.reopen()
        return files

    @phase("writing")
    def _write(self, action: Callable[[], None]) -> None:
        """Queue an action for the writing thread of this rank."""
        self._writer.submit(action)

    def failure(self) -> Exception | None:
        """Return the error of writing on this rank, which all ranks raise together."""
        error = self._writer.error
        if not isinstance(error, OSError | RuntimeError):  # HDF5 reports either
            return error
        return DiskError(
            f"{self.out}: cannot be written ({getattr(error, 'strerror', None) or error}); free some space and go on "
            f"with --resume, or run again; {self.records} records were made"
        )

    @phase("writing")
    def meet(self, write: Callable[[], None] = lambda: None) -> None:
        """Write this, too, and wait until all ranks have written everything; collective.

        A full or missing disk stops all ranks with a message.
        """
        self._writer.submit(write)
        self._writer.drain()
        parallel.raise_on_all(self.model.comm, self.failure())

    def due(self, state: State) -> bool:
        """Return whether a record is due at this step."""
        return any(self._reached(what, state) for what in self._schedules)

    def expects(self, state: State) -> bool:
        """Return whether an explicit step that begins now ends with a record of the interfaces.

        The tractions of the step belong to the present time.
        """
        ends = state.time >= end_of(self.model.case.duration)
        return ends or self._reached_at("interface", state.time, state.step + 1)

    def _reached(self, what: str, state: State) -> bool:
        return self._reached_at(what, state.fault_time, state.step)

    def _reached_at(self, what: str, now: float, step: int) -> bool:
        every = self.model.case.output.interface_steps
        if what == "interface":
            if now <= self.last[what]:  # the first explicit step only completes the state at the start
                return False
            if every is not None and step % every == 0:
                return True
            if self._has_grown():
                return True
        if self._ending:
            return now > self.last[what]
        return self._schedules[what].due(self.next[what], now)

    def _has_grown(self) -> bool:
        """Return whether the largest slip rate differs enough from that of the last record."""
        growth, now, then = self.model.case.output.interface_growth, self._fastest, self._fastest_recorded
        return growth is not None and max(now, then) > 0 and not (then < growth * now and now < growth * then)

    def _passed(self, what: str, state: State) -> None:
        """Count a record that was made; a long step may pass several times of the schedule."""
        self.next[what], self.last[what] = self._schedules[what].after(state.fault_time), state.fault_time
        self.counts[what] += 1

    def observe(self, state: State) -> None:
        """Read instruments and what mechanisms record at the start and at every step."""
        if self.model.case.output.interface_growth is not None:  # such steps are collective
            self._fastest = self._largest_slip_rate(state)
        if self.samples.reads_bodies:
            self.sync_bodies(state)
        self.samples.observe(state)
        for each in self.parts:
            each.observe(state)

    def _largest_slip_rate(self, state: State) -> float:
        """Return the largest slip rate of points whose slip is not prescribed [m/s]; collective."""
        rates = [0.0]
        for fault in self.model.faults:
            free = fault.components(state.faults[fault.name], "slip_rate")[~fault.is_held]
            rates.append(float(np.linalg.norm(free, axis=1).max(initial=0.0)))
        return parallel.largest(self.model.comm, max(rates))

    def sync_bodies(self, state: State) -> None:
        """Compute displacement and velocity at the time of the state if steps have deferred them; collective."""
        sync_bodies(self._motion, state)

    def collect(self) -> None:
        """Append complete samples to their file; collective."""
        samples = self.samples.gather()
        file = self._instruments
        if file is not None and samples:
            self._write(lambda: file.append(samples))

    def finish(self, state: State) -> None:
        """Save the state at the duration if its time is no multiple of an interval; collective."""
        self._ending = self.finished(state)
        if self._ending and self.due(state):
            self.record(state)

    def record(self, state: State) -> None:
        """Save the records that are due at this step; collective."""
        with phase("steps"):
            self.sync_bodies(state)
        if self.samples.instruments:
            with phase("gathering"):
                self.collect()
        if self._reached("interface", state):
            self._passed("interface", state)
            self._fastest_recorded = self._fastest
            rows = self._read("interface", state)
            with phase("energies"):
                energy = self._motion.energies(state)
            if self.model.comm.rank == 0:
                self.peak_slip_rate = max((each.largest_slip_rate(data) for each, _, data in rows), default=0.0)
                row = self._balance(state, energy)
                self._write(lambda: self._append(rows, row))
        if "forces" in self._schedules and self._reached("forces", state):
            self._passed("forces", state)
            means = self._read("forces", state)
            if self.model.comm.rank == 0:
                self._write(lambda: self._append(means))
        if "bulk" in self._schedules and self._reached("bulk", state):
            self._passed("bulk", state)
            with phase("gathering"):
                snapshot = self._bulk.gather(state)
            data = self._read("bulk", state)
            time = state.time - 0.5 * state.lag
            self._writer.drain()  # one snapshot in memory is enough
            self._write(lambda: self._bulk.append(time, snapshot))
            if self.model.comm.rank == 0:
                self._write(lambda: self._append(data))

    @phase("gathering")
    def _read(self, schedule: str, state: State) -> list[tuple[Records, float, Any]]:
        """Return the records of the mechanisms that are due, each with its time and data; collective."""
        return [(each, *each.read(state)) for each in self.parts if each.schedule == schedule]

    def _balance(self, state: State, energy: dict[str, float]) -> list[float]:
        """Return a row of the energy table: its time [s], the energies [J] and the energy error."""
        lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
        self.largest_work = max(self.largest_work, abs(energy["boundary_work"]))
        closure = lost / self.largest_work if self.largest_work > 0 else 0.0
        return [state.time - 0.5 * state.lag, *energy.values(), closure]

    def _append(self, rows: list[tuple[Records, float, Any]], energies: list[float] | None = None) -> None:
        """Append records of mechanisms, and a row of the energy table."""
        for each, time, data in rows:
            each.append(time, data)
        if energies is not None:
            self._energies.append(energies[0], energies[1:])

    @phase("writing")
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                self.meet(self._complete)
        except BaseException as failed:
            error = failed
            raise
        finally:
            self._writer.close()
            self._close(error)

    def _complete(self) -> None:
        for each in self.parts if self.model.comm.rank == 0 else []:
            each.complete()

    def _close(self, error: BaseException | None) -> None:
        """Close all files; files with failed writes remain open, since HDF5 would fail on closing them."""
        files: list[Closing] = [*self.parts, self._bulk]
        if self._instruments is not None:
            files.append(self._instruments)
        if self.model.comm.rank == 0:
            files.append(self._energies)
            if error is not None:
                self.log.error("stopped: %s", error)
        for file in files if not isinstance(error, DiskError) else []:
            with suppress(OSError, RuntimeError) if error is not None else nullcontext():
                file.close()
        self.log.info("%d records", self.records)
        self.log.info("time by phase [s]: %s", json.dumps({name: round(s, 4) for name, s in phases().items()}))
        if self.model.comm.rank == 0:
            for handler in self.log.handlers:
                handler.close()
            self.log.handlers, level, self.log.propagate = self._log_before
            self.log.setLevel(level)


class Closing(Protocol):
    """An object that can be closed."""

    def close(self) -> None: ...


def versions() -> dict[str, str]:
    """Return the versions of ruptfx, DOLFINx and HDF5 for attributes of files."""
    return {
        "ruptfx_version": __version__,
        "dolfinx_version": fem.dolfinx.__version__,
        "hdf5_version": h5py.version.hdf5_version,
    }
