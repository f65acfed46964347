"""What a run leaves behind: interface histories, bulk snapshots, the energy table, the log, the final marker.

All files are written by rank 0 in an order that does not depend on the partition. A run directory is complete when
`summary.json` is there: it is written last, to a temporary name, and renamed.
"""

from __future__ import annotations

import csv
import json
import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5netcdf
import h5py
import numpy as np

from ruptfx import RuptfxError, __version__, fem, parallel
from ruptfx.bulk_fields import BulkFields
from ruptfx.fault import Fault, component_names

if TYPE_CHECKING:
    from ruptfx.model import Model, State

ENERGIES = ("kinetic", "strain", "interface_elastic", "frictional_dissipation", "damping", "boundary_work")
_FIELDS = {
    "slip": ("m", "slip"),
    "slip_rate": ("m/s", "slip rate"),
    "displacement_jump": ("m", "tangential displacement jump"),
    "shear_traction": ("Pa", "shear traction"),
    "normal_stress": ("Pa", "normal stress, positive in compression"),
    "opening": ("m", "opening"),
}
_TANGENTIAL = ("slip", "slip_rate", "displacement_jump", "shear_traction")


def prepare_directory(comm: fem.MPI.Comm, out: Path) -> None:
    """Make the run directory, on all ranks or none.

    Raises
    ------
    RuptfxError
        The directory holds something already, or cannot be written.
    """

    def make() -> None:
        try:
            if out.exists() and (not out.is_dir() or any(out.iterdir())):
                raise RuptfxError(f"{out}: exists already; choose another --out, or remove it")
            out.mkdir(parents=True, exist_ok=True)
            probe = out / ".writable"
            probe.write_text("")
            probe.unlink()
        except OSError as error:
            raise RuptfxError(f"{out}: cannot be written ({error.strerror}); choose another --out") from None

    parallel.on_root(comm, make)


class Recorder:
    """Writes the files of one run; a context manager that leaves readable files however the run ends.

    Parameters
    ----------
    model : Model
    out : Path
        An existing empty directory.
    dt : float
        Time step [s], to turn intervals into steps.
    """

    def __init__(self, model: Model, out: Path, dt: float) -> None:
        self.model, self.out, self.dt = model, out, dt
        case = model.case
        self.steps = max(1, int(np.ceil(case.duration / dt * (1 - 1e-9))))
        self._every = _steps(case.output.interface_interval or case.duration / 300, dt)
        self._bulk_every = _steps(case.output.bulk_interval or case.duration / 6, dt)
        self.records = 0
        self.peak_slip_rate = 0.0  # of the last record, known to rank 0
        self.log = logging.getLogger("ruptfx.run")
        self._bulk = BulkFields(model)
        self._files: dict[str, Any] = {}

    def __enter__(self) -> Recorder:
        parallel.on_root(self.model.comm, self._open)
        places = [
            _gather_fault(self.model.comm, f, [f.interface.position, *f.interface.points.T]) for f in self.model.faults
        ]
        points, cells, body = self._bulk.topology()
        if self.model.comm.rank == 0:
            for fault, place in zip(self.model.faults, places, strict=True):
                self._files[fault.name] = self._open_interface(fault, place)
            self._bulk.create(self.out, points, cells, body)
        return self

    def _open(self) -> None:
        (self.out / "case.toml").write_text(self.model.case.to_toml())
        handler = logging.FileHandler(self.out / "run.log")
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        self.log.handlers = [handler]
        self.log.setLevel(logging.INFO)
        self.log.propagate = False
        self._energy = (self.out / "energy.csv").open("w", newline="")
        self._energy.write(
            "# time in s, energies in J (per metre of thickness in 2D), closure relative to the largest work\n"
        )
        self._table = csv.writer(self._energy)
        self._table.writerow(["time", *ENERGIES, "closure"])
        self._largest_work = 0.0

    def _open_interface(self, fault: Fault, place: np.ndarray) -> h5netcdf.File:
        name = "interface.h5" if len(self.model.faults) == 1 else f"interface_{fault.name}.h5"
        file = h5netcdf.File(self.out / name, "w")
        file.dimensions = {"time": None, "position": fault.interface.total}
        coordinates = dict(zip(("position", "x", "y", "z"), place.T, strict=False))
        for key, values in coordinates.items():
            _variable(
                file, key, ("position",), "m", "position along the interface" if key == "position" else key, values
            )
        _variable(file, "time", ("time",), "s", "time")
        fields = {
            entry: (unit, text) for name, (unit, text) in _FIELDS.items()
            for entry in (component_names(name, fault.tangents) if name in _TANGENTIAL else [name])
        }  # fmt: skip
        fields |= {key: (unit, f"state variable {key}") for key, unit in fault.friction.all_state_fields().items()}
        for key, (unit, text) in fields.items():
            _variable(file, key, ("time", "position"), unit, text)
        _variable(file, "peak_slip_rate", ("position",), "m/s", "largest slip rate of all steps")
        _variable(file, "rupture_time", ("position",), "s", "first time the slip rate passed rupture_threshold")
        file.attrs.update(self._attributes(fault, coordinates))
        file.flush()
        return file

    def _attributes(self, fault: Fault, place: dict[str, np.ndarray]) -> dict[str, Any]:
        case, speeds = self.model.case, self.model.wave_speeds()
        attributes: dict[str, Any] = {
            "fault": fault.name, "plane": case.plane, "c_p": speeds.c_p, "c_s": speeds.c_s, "c_R": speeds.c_R,
            "V_imp": case.impact_speed, "rupture_threshold": case.output.rupture_threshold,
            "case_hash": case.hash, "complete": 0, **versions(),
        }  # fmt: skip
        # The end of the interface where a driven edge is; the left one when there is none or it is not an end.
        driven = [boundary.edge for boundary in case.boundaries if boundary.kind == "driven"]
        right = any(edge.endswith(".right") for edge in driven)
        attributes["loaded_end"] = float(place["position"][-1 if right else 0])
        return attributes

    def record(self, state: State) -> None:
        """Save what is due at this step; collective."""
        if state.step % self._every == 0 or state.step >= self.steps:
            self._record_interface(state)
            self._record_energy(state)
            self.records += 1
        if state.step > 0 and (state.step % self._bulk_every == 0 or state.step >= self.steps):
            self._bulk.record(state)

    def due(self, state: State) -> bool:
        return any(state.step % every == 0 for every in (self._every, self._bulk_every)) or state.step >= self.steps

    def _record_interface(self, state: State) -> None:
        self.peak_slip_rate = 0.0
        for fault in self.model.faults:
            fields = dict(state.faults[fault.name])
            _, jump = fault.interface.split(fault.interface.jump(state.displacement))
            fields |= dict(zip(component_names("displacement_jump", fault.tangents), jump.T, strict=True))
            rows = _gather_fault(self.model.comm, fault, list(fields.values()))
            if self.model.comm.rank == 0:
                file = self._files[fault.name]
                count = file.dimensions["time"].size
                file.resize_dimension("time", count + 1)
                file["time"][count] = state.time
                for name, values in zip(fields, rows.T, strict=True):
                    if name.startswith("slip_rate"):
                        self.peak_slip_rate = max(self.peak_slip_rate, float(np.abs(values).max()))
                    variable = file[name]
                    variable[(count, slice(None)) if "time" in variable.dimensions else slice(None)] = values
                file.flush()

    def _record_energy(self, state: State) -> None:
        energy = self.model.energies(state, self.dt)
        if self.model.comm.rank == 0:
            lost = energy["boundary_work"] - sum(energy[name] for name in ENERGIES if name != "boundary_work")
            self._largest_work = max(self._largest_work, abs(energy["boundary_work"]))
            closure = lost / self._largest_work if self._largest_work > 0 else 0.0
            self._table.writerow([repr(v) for v in (state.time, *(energy[name] for name in ENERGIES), closure)])
            self._energy.flush()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> None:
        if self.model.comm.rank != 0:
            return
        if error is not None:
            self.log.error("stopped: %s", error)
        for name, file in self._files.items():
            file.attrs["complete"] = int(error is None)
            file.close()
            self.log.info("fault %s: %d records", name, self.records)
        self._bulk.close()
        self._energy.close()
        for handler in self.log.handlers:
            handler.close()
        self.log.handlers = []


def write_summary(out: Path, summary: dict[str, Any]) -> None:
    """The marker of a complete run: written to a temporary name, synced, renamed."""
    temporary = out / ".summary.json"
    with temporary.open("w") as file:
        json.dump(summary, file, indent=2)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(out / "summary.json")


def versions() -> dict[str, str]:
    return {
        "ruptfx_version": __version__,
        "dolfinx_version": fem.dolfinx.__version__,
        "hdf5_version": h5py.version.hdf5_version,
    }


def _steps(interval: float, dt: float) -> int:
    return max(1, round(interval / dt))


def _gather_fault(comm: fem.MPI.Comm, fault: Fault, columns: list[np.ndarray]) -> np.ndarray:
    """Columns of all owned points in order along the interface on rank 0, shape (points, columns)."""
    face = fault.interface
    rows = np.stack([face.number.astype(float), *columns], axis=1)[face.owned]
    gathered = parallel.gather_rows(comm, rows)
    if gathered is None:
        return np.zeros((0, len(columns)))
    return gathered[np.argsort(gathered[:, 0]), 1:]


def _variable(
    file: h5netcdf.File, name: str, dimensions: tuple[str, ...], unit: str, text: str, values: np.ndarray | None = None
) -> None:
    variable = file.create_variable(name, dimensions, np.float64, fillvalue=np.nan if values is None else None)
    variable.attrs["units"] = unit
    variable.attrs["long_name"] = text
    if values is not None:
        variable[:] = values
