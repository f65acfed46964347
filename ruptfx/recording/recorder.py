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
from typing import TYPE_CHECKING, Protocol

import h5py
import numpy as np

from ruptfx import RuptfxError, Table, __version__, fem, parallel, run_files
from ruptfx.fault import Fault
from ruptfx.fields import DERIVED
from ruptfx.interface import Interface
from ruptfx.nucleation import first_begun
from ruptfx.recording import edge_sums, forces
from ruptfx.recording.attachments_file import AttachmentsFile
from ruptfx.recording.bulk_fields import BulkFields, Topology
from ruptfx.recording.crack_files import CrackFiles, facets_of
from ruptfx.recording.instruments_file import InstrumentsFile
from ruptfx.recording.interface_file import InterfaceFile
from ruptfx.recording.sampling import Samples
from ruptfx.recording.schedule import Schedule, end_of
from ruptfx.recording.table_file import TableFile
from ruptfx.recording.writer import Writer
from ruptfx.stopwatch import phase, phases

if TYPE_CHECKING:
    from ruptfx.mechanisms import Rows
    from ruptfx.model import Model
    from ruptfx.recording.checkpoint import Checkpoint, Keeper
    from ruptfx.state import State
    from ruptfx.steppers import Motion


class DiskError(RuptfxError):
    """The disk is full or missing; HDF5 cannot write its remaining data and would fail at exit."""

    at_once = True


class Recorder:
    """Writes the files of one run; a context manager that leaves readable files however the run ends.

    Records are made at multiples of an interval, each after the first step that reaches its time. The first state
    and that at the end of the duration are recorded, too. All fields of a record belong to its time:
    for interfaces that of the traction, in explicit runs one step before the present displacement;
    for bodies and energies that of the velocity, half a step before it.

    Parameters
    ----------
    model : Model
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
        self.means: forces.ForceMeans | None = None
        if case.output.forces_interval is not None:
            sliding = [fault for fault in model.faults if fault.slides]
            self.means = forces.ForceMeans(model.comm, sliding, case.output.rupture_threshold)
        self.last = {"interface": -1.0, "bulk": 0.0, "forces": 0.0}  # times of the last records [s]
        self._ending = False
        self.largest_work = 0.0
        self.peak_slip_rate = 0.0  # largest slip rate of the last record, on rank 0
        self.log = logging.getLogger("ruptfx.run")
        self._bulk = BulkFields(model)
        self.samples = Samples(model, motion.dt, self._bulk.initial_stress_at)
        self._files: dict[str, InterfaceFile] = {}
        self._forces: dict[str, TableFile] = {}
        self._instruments: InstrumentsFile | None = None
        self._cracks: CrackFiles | None = None
        self._attachments: AttachmentsFile | None = None
        self._edges: TableFile | None = None
        self._edge_sums = None if model.cracks is None else edge_sums.EdgeSums(model)
        self._writer = Writer()

    @property
    def keepers(self) -> dict[str, Keeper]:
        """Return the objects of the recorder with data for checkpoints, itself among them."""
        return {"recorder": self, "samples": self.samples, **({} if self.means is None else {"means": self.means})}

    def table(self) -> Table:
        """Return all data that change, for a checkpoint."""
        return {
            "next": self.next, "counts": self.counts, "last": self.last, "largest_work": self.largest_work,
            "peak_slip_rate": self.peak_slip_rate,
        }  # fmt: skip

    def restore(self, table: Table) -> None:
        """Continue from a checkpoint."""
        self.next, self.counts, self.last = dict(table["next"]), dict(table["counts"]), dict(table["last"])
        self.largest_work, self.peak_slip_rate = table["largest_work"], table["peak_slip_rate"]

    @property
    def records(self) -> int:
        """Number of the records of the interfaces."""
        return self.counts["interface"]

    def finished(self, state: State) -> bool:
        """Return whether the state has reached the duration of the case."""
        return state.fault_time >= end_of(self.model.case.duration)

    def __enter__(self) -> Recorder:
        with phase("gathering"):
            places = [_positions(self.model.comm, fault.interface) for fault in self.model.faults]
            topology = self._bulk.topology()
            nodes = [each.positions() for each in self.model.attachments]
            facets = None if self.model.cracks is None else self.model.cracks.gather(facets_of(self.model.cracks))
        try:
            self.meet(lambda: self._open(places, facets, nodes) if self.model.comm.rank == 0 else None)
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

    def _open(self, places: list[np.ndarray], facets: dict[str, np.ndarray] | None, nodes: list[Rows]) -> None:
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
            "energies in J (in 2D per metre of thickness, but around an axis), closure relative to the largest work"
        ), self._kept("interface"))  # fmt: skip
        case = self.model.case
        for fault, place in zip(self.model.faults, places, strict=True):
            name = "interface.h5" if len(places) == 1 else f"interface_{fault.name}.h5"
            attributes, kept = self._attributes(fault, place), self._kept("interface")
            self._files[fault.name] = InterfaceFile(self.out / name, fault, place, attributes, kept)
            if fault.slides:
                name = "forces.csv" if len(places) == 1 else f"forces_{fault.name}.csv"
                means = self.means is not None
                remark, kept = forces.remark(means), self._kept("forces" if means else "interface")
                self._forces[fault.name] = TableFile(self.out / name, forces.COLUMNS, remark, kept)
        if self.samples.instruments:
            self._instruments = InstrumentsFile(self.out / "instruments.h5", self.samples.instruments, {
                "case_hash": self.model.case.hash, "initial_stress": self._bulk.initial_stress_from,
                "record": "all numbers of a sample are of its time, linear between the steps", **versions(),
            })  # fmt: skip
        if nodes:
            attached = list(zip(case.attachments, self.model.attachments, nodes, strict=True))
            about = {"case_hash": case.hash, "record": "all fields of a record are those of its time", **versions()}
            self._attachments = AttachmentsFile(self.out / "attachments.h5", attached, about, self._kept("interface"))
        if facets is not None and self._edge_sums is not None and case.fracture is not None:
            bodies, thickness = self.model.bodies, case.fracture.thickness
            joints, kept = list(bodies.joints), self._kept("bulk")
            self._cracks = CrackFiles(self.out, facets, bodies.names, joints, thickness, kept)
            columns, kept = self._edge_sums.columns, self._kept("interface")
            self._edges = TableFile(self.out / "edges.csv", columns, edge_sums.REMARK, kept)

    def _names(self) -> list[str]:
        """Return the names of the files that this run writes, except for the case."""
        model, several = self.model, len(self.model.faults) > 1
        suffixes = [f"_{fault.name}" if several else "" for fault in model.faults]
        names = ["run.log", "energy.csv", run_files.SUMMARY, "bulk.h5", "bulk.xdmf"]
        names += [f"bulk.{rank}.h5" for rank in range(model.comm.size)] if model.comm.size > 1 else []
        names += [f"interface{suffix}.h5" for suffix in suffixes]
        names += [f"forces{suffix}.csv" for fault, suffix in zip(model.faults, suffixes, strict=True) if fault.slides]
        names += ["instruments.h5"] if self.samples.instruments else []
        names += ["attachments.h5"] if model.attachments else []
        return names + ([] if model.cracks is None else ["cracks.h5", "cracks.xdmf", "events.h5", "edges.csv"])

    def settle(self) -> list[Path]:
        """Write all data in memory; return the history files of this rank, which may then be copied."""
        files = self._bulk.settle()
        if self.model.comm.rank == 0:
            for file in self._files.values():
                file.settle()
            files += [file.path for file in self._files.values()]
            files += [table.path for table in (self._energies, *self._forces.values())]
            if self._instruments is not None:
                self._instruments.settle()
                files.append(self._instruments.path)
            if self._attachments is not None:
                self._attachments.settle()
                files.append(self._attachments.path)
            if self._cracks is not None and self._edges is not None:
                files += [*self._cracks.settle(), self._edges.path]
        return files

    def _attributes(self, fault: Fault, place: np.ndarray) -> Table:
        case, speeds, line = self.model.case, self.model.wave_speeds(), fault.interface.line
        # The end of the interface next to a driven edge, or the left end.
        right = any(edge.endswith(".right") for edge in case.driven_edges)
        of_bodies = np.array([material.wave_speeds(case.plane) for material in self.model.materials])
        onset, center = first_begun(fault.nucleation)
        return {
            "fault": fault.name, "position_measure": line.measure, "origin": line.origin,
            "plane": case.plane, "c_p": speeds.c_p, "c_s": speeds.c_s, "c_R": speeds.c_R,
            "bodies": self.model.bodies.names, "c_p_of_bodies": of_bodies[:, 0], "c_s_of_bodies": of_bodies[:, 1],
            "V_imp": case.impact_speed, "rupture_threshold": case.output.rupture_threshold,
            "loaded_end": float(place[-1 if right else 0, 0]), "case_hash": case.hash, "complete": 0,
            "nucleation_time": onset, "nucleation_position": center,
            "record": "all fields of a record are those of its time; tractions, slip rate, slip and state satisfy the "
            "laws of contact and friction there",
            **versions(),
        }  # fmt: skip

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
        if self._ending:
            return now > self.last[what]
        return self._schedules[what].due(self.next[what], now)

    def _passed(self, what: str, state: State) -> None:
        """Count a record that was made; a long step may pass several times of the schedule."""
        self.next[what], self.last[what] = self._schedules[what].after(state.fault_time), state.fault_time
        self.counts[what] += 1

    def observe(self, state: State) -> None:
        """Read instruments and means at the start and at every step."""
        self.samples.observe(state)
        if self.means is not None:
            self.means.observe(state)

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
            state.catch_up()
        if self.samples.instruments:
            with phase("gathering"):
                self.collect()
        if self._reached("interface", state):
            self._passed("interface", state)
            with phase("gathering"):
                fields = {fault.name: self.gather_fault(fault, state) for fault in self.model.faults}
                comm, least = self.model.comm, self.model.case.output.rupture_threshold
                slide = [] if self.means is not None else [fault for fault in self.model.faults if fault.slides]
                sums = {fault.name: forces.row(comm, fault, state, least) for fault in slide}
                attached = [each.record(state) for each in self.model.attachments]
            with phase("energies"):
                energy = self._motion.energies(state)
            edges = None if self._edge_sums is None else self._edge_sums.row(state)
            now = state.fault_time
            if self.model.comm.rank == 0:
                rates = [v for each in fields.values() for name, v in each.items() if name.startswith("slip_rate")]
                self.peak_slip_rate = float(max((np.abs(rate).max() for rate in rates), default=0.0))
                row = self._balance(state, energy)
                self._write(lambda: self._append(now, fields, row, sums, edges, attached))
        if self.means is not None and self._reached("forces", state):
            self._passed("forces", state)
            with phase("gathering"):
                middle, means = self.means.take()
            if self.model.comm.rank == 0:
                self._write(lambda: self._append_forces(middle, means))
        if self._reached("bulk", state):
            self._passed("bulk", state)
            with phase("gathering"):
                snapshot = self._bulk.gather(state)
                cracks = None if self.model.cracks is None else self.model.cracks.gather(state.cracks)
            time = state.time - 0.5 * state.lag
            self._writer.drain()  # one snapshot in memory is enough
            self._write(lambda: self._bulk.append(time, snapshot))
            if self._cracks is not None and cracks is not None:
                files, at_facets, tractions = self._cracks, cracks, state.fault_time
                self._write(lambda: files.append(tractions, at_facets))

    def gather_fault(self, fault: Fault, state: State) -> dict[str, np.ndarray]:
        """Return every field of a fault in order along the interface, on rank 0; needs an up-to-date displacement."""
        fields = state.faults[fault.name] | state.points.get(fault.name, {})
        face = fault.interface
        _, jump = face.split(face.jump(state.displacement) - state.lag * face.rate(state.velocity))
        fields |= dict(zip(DERIVED[0].names(fault.tangents), jump.T, strict=True))
        if fault.slides:
            least = self.model.case.output.rupture_threshold
            fields |= forces.sliding_fields(fault, state.faults[fault.name], state.at_faults()[1], least)
        return parallel.gather_fields(self.model.comm, face.number, face.owned, fields)

    def _balance(self, state: State, energy: dict[str, float]) -> list[float]:
        """Return a row of the energy table: its time [s], the energies [J] and the energy error."""
        lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
        self.largest_work = max(self.largest_work, abs(energy["boundary_work"]))
        closure = lost / self.largest_work if self.largest_work > 0 else 0.0
        return [state.time - 0.5 * state.lag, *energy.values(), closure]

    def _append(
        self, time: float, faults: dict[str, dict[str, np.ndarray]], energies: list[float],
        sums: dict[str, list[float]], edges: list[float] | None, attached: list[Rows],
    ) -> None:  # fmt: skip
        """Append fields and forces of the interfaces at one time [s], and a row of the energy table at another."""
        self._append_forces(time, sums)
        if self._edges is not None and edges is not None:
            self._edges.append(time, edges)
        if self._attachments is not None:
            self._attachments.append(time, attached)
        for name, fields in faults.items():
            self._files[name].append(time, fields)
        self._energies.append(energies[0], energies[1:])

    def _append_forces(self, time: float, rows: dict[str, list[float]]) -> None:
        for name, values in rows.items():
            self._forces[name].append(time, values)

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
        for file in self._files.values():
            file.complete()

    def _close(self, error: BaseException | None) -> None:
        """Close all files; files with failed writes remain open, since HDF5 would fail on closing them."""
        files: list[Closing] = [*self._files.values(), *self._forces.values(), self._bulk]
        if self._instruments is not None:
            files.append(self._instruments)
        files += [file for file in (self._cracks, self._edges, self._attachments) if file is not None]
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


def _positions(comm: fem.MPI.Comm, face: Interface) -> np.ndarray:
    """Position along an interface and coordinates of its points [m] on rank 0, shape (points, 1 + dim)."""
    columns = {"position": face.position, **dict(zip("xyz", face.points.T, strict=False))}
    return np.column_stack([*parallel.gather_fields(comm, face.number, face.owned, columns).values()])
