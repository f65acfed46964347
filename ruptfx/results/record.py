"""Record: reader of the directory of a finished, running or killed run. Needs neither DOLFINx nor MPI.

A run directory contains ``case.toml`` (the resolved case), ``interface.h5`` (histories along the interface;
with several interfaces ``interface_NAME.h5``), ``bulk.h5`` (snapshots of the two bodies), ``energy.csv``,
``run.log``, with faults in 3D ``moment_rate.csv``, with fracture ``cracks.h5``, ``events.h5`` and ``edges.csv``,
``files.json`` with names and checksums of all files, and, written last, ``summary.json``: a run that has it is
complete. ``figures/`` follow.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self

import h5py
import numpy as np

from ruptfx import RuptfxError, Table
from ruptfx.input.fields import STRESSES, extensive_unit, stress_entries
from ruptfx.input.former_names import FORMER_COLUMNS, warn_of_former
from ruptfx.platform import run_files
from ruptfx.results.columns import Column, Columns, Stored

if TYPE_CHECKING:
    import xarray  # imported on first use: it takes longer than the end of a run to read

# Labels of the last axis of a bulk quantity, by its length: antiplane, in plane or 3D.
_LABELS = {
    "component": {1: ["z"], 2: ["x", "y"], 3: ["x", "y", "z"]},
    "stress_component": {len(n): list(n) for n in (*STRESSES.values(), stress_entries("axisymmetric", 2))},
}
_MESH = {"points": ("point", "axis"), "cells": ("cell", "corner"), "body": ("point",), "body_of_cell": ("cell",),
         "time": ("time",)}  # fmt: skip
_AGAIN = "if the run is still going, try again in a moment; if it was killed, run the case again"
_OPTIONAL = {
    **dict.fromkeys(("cracks.h5", "events.h5", "edges.csv"), "[fracture]"), "forces.csv": "sliding contact",
    "moment_rate.csv": "faults in 3D",
    "instruments.h5": "[[instruments]]", "attachments.h5": "[[attachments]]",
}  # fmt: skip
"""Files that only runs with a part of a case have."""


class RecordError(RuptfxError):
    """Error of an unreadable run directory or file; the message names it and the remedy."""


class MissingFileError(RecordError):
    """The run has no such file, or not yet."""


class OutsideError(RecordError):
    """Error of a chosen part of the run in which nothing was saved."""


class Data(Protocol):
    """Interface of the arrays of a file for analysis and figures: `Columns` or an `xarray.Dataset`."""

    @property
    def attrs(self) -> Mapping[Any, Any]: ...

    @property
    def sizes(self) -> Mapping[Any, int]: ...

    def __getitem__(self, name: str, /) -> Any: ...

    def __contains__(self, name: object, /) -> bool: ...

    def __iter__(self) -> Iterator[Any]: ...


class Files:
    """One run, read from its directory as NumPy arrays; every file is opened at its first use.

    Analysis and figures at the end of a run use this class. `Record` for users adds
    named axes, units and the methods of xarray.

    Parameters
    ----------
    path : path of the run directory
    trust : bool
        Run the plug-ins of the run where figures need the code of its laws. They can do what you can.
    checks : bool
        Compare every file of a complete run with its checksum at its first use; not needed by the process that has just
        written it.

    Attributes
    ----------
    omitted : list of str
        Parts of figures that were left out for want of the plug-ins.
    outside : dict of str to str
        Figures that were left out because their data have no time of this part of the run, with the reason.
    case, summary, interface, interfaces, bulk, energy, instruments, attachments, forces, cracks, events, edges,
    moment_rate
        As of `Record`.

    Raises
    ------
    RecordError
        The directory is no run; or, on first use, a file is missing or damaged.
    """

    def __init__(self, path: str | Path, trust: bool = False, checks: bool = True) -> None:
        self.path, self.trust = Path(path), trust
        self.omitted, self.outside = list[str](), dict[str, str]()
        self._checks, self._checked = checks, set[str]()
        self._open: list[h5py.File] = []
        self.since, self.until = 0.0, float(np.inf)
        self._chosen: str | None = None
        if not self.path.is_dir():
            raise RecordError(f"{self.path}: no such directory; give the directory that 'ruptfx run' wrote")
        if not (self.path / "case.toml").is_file():
            raise RecordError(f"{self.path}: holds no case.toml; give the directory that 'ruptfx run' wrote")

    def between(self, since: float | None = None, until: float | None = None) -> Self:
        """Return the record with the saved times of a part of the run, for its figures.

        Parameters
        ----------
        since, until : float, optional
            First and last time [s]; default are those of the run.

        Raises
        ------
        RecordError
            The last time is not later than the first.
        """
        part = self._copy()
        part.since = self.since if since is None else max(since, self.since)
        part.until = self.until if until is None else min(until, self.until)
        if not part.until > part.since >= 0:
            raise RecordError(f"from {part.since:g} to {part.until:g} s: give an earlier and a later time")
        return part

    def on(self, interface: str | None) -> Self:
        """Return the record whose `interface` and `forces` are of the one of this name; itself without a name.

        Raises
        ------
        RecordError
            There is none of this name.
        """
        if not interface:
            return self
        if interface not in self.interfaces:
            from ruptfx.input.schema import nearest  # loads pydantic

            known = nearest(interface, list(self.interfaces)) if self.interfaces else "the run has none"
            raise RecordError(f"{self.path}: interface '{interface}': {known}")
        part = self._copy()
        part._chosen = interface
        return part

    def _copy(self) -> Self:
        copy = type(self)(self.path, self.trust, self._checks)
        copy.since, copy.until, copy._chosen = self.since, self.until, self._chosen
        copy.omitted, copy.outside = self.omitted, self.outside
        return copy

    @property
    def is_part(self) -> bool:
        """Return whether the record has only a part of the saved times."""
        return self.since > 0 or self.until < np.inf

    def _within(self, data: Any) -> Any:
        """Return histories at the times of this record.

        Raises
        ------
        OutsideError
            Nothing was saved then.
        """
        if not self.is_part:
            return data
        times = data["time"].values
        near = 1e-9 * (abs(times[-1]) if len(times) else 0.0)
        rows = slice(int(np.searchsorted(times, self.since - near)), int(np.searchsorted(times, self.until + near)))
        if rows.stop <= rows.start and len(times):
            raise OutsideError(
                f"{self.path}: nothing was saved from {self.since:g} to {self.until:g} s; the saved times are "
                f"{times[0]:g} to {times[-1]:g} s; choose a window that contains one of them"
            )
        return data.isel(time=rows)

    def _existing(self, name: str) -> Path:
        path = self.path / name
        if not path.is_file():
            if self.complete and name in _OPTIONAL:
                raise MissingFileError(
                    f"{path}: missing; only runs with {_OPTIONAL[name]} have this file; add that to the case and "
                    "run it again"
                )
            raise MissingFileError(f"{path}: missing; {_AGAIN}")
        self._check(name)
        return path

    def _check(self, name: str) -> None:
        """Compare a file with its checksum, once.

        Raises
        ------
        RecordError
        """
        if self._checks and name not in self._checked:
            try:
                run_files.check(self.path, name)
            except run_files.ChangedFileError as error:
                raise RecordError(str(error)) from None
            self._checked.add(name)

    @cached_property
    def case(self) -> Table:
        from ruptfx.input.schema import CaseError, load_toml_file  # on first use: it loads pydantic

        path = self._existing("case.toml")
        try:
            return load_toml_file(path)
        except CaseError as error:
            reason = str(error).removeprefix(f"{path}: ")
            raise RecordError(f"{path}: damaged ({reason}); copy the case file of the run there") from None

    @property
    def complete(self) -> bool:
        """True if the run ended normally."""
        return (self.path / "summary.json").is_file()

    @property
    def summary(self) -> Table | None:
        if not self.complete:
            return None
        path = self._existing("summary.json")
        try:
            table = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise RecordError(f"{path}: damaged ({error}); run the case again") from None
        if not isinstance(table, dict):
            raise RecordError(f"{path}: damaged (no table but {table!r}); run the case again")
        return table

    @property
    def figures(self) -> list[Path]:
        """Pictures in ``figures/``, by name."""
        return sorted(path for path in (self.path / "figures").glob("*.*") if path.is_file())

    @property
    def interface(self) -> Data:
        if not self.interfaces:
            raise MissingFileError(f"{self.path / 'interface.h5'}: missing; {_AGAIN}")
        return self.interfaces[self.interface_name]

    @property
    def interface_name(self) -> str:
        """Name of `interface`: the chosen one, else that with the largest slip, of an incomplete run the first."""
        if self._chosen is not None:
            return self._chosen
        first = next(iter(self.interfaces), "")
        if len(self.interfaces) < 2:
            return first
        decisive = str((self.summary or {}).get("interface"))  # runs of earlier versions name none
        return decisive if decisive in self.interfaces else first

    @cached_property
    def interfaces(self) -> Mapping[str, Data]:
        paths = sorted(self.path.glob("interface*.h5"))
        opened = {path.stem: self._open_interface(path) for path in paths}
        entries = {str(data.attrs.get("fault", stem)): data for stem, data in opened.items()}
        if len(entries) < 2:
            return entries
        ordered = [name for name in self.case.get("faults", {}) if name in entries]
        return {name: entries[name] for name in [*ordered, *(name for name in entries if name not in ordered)]}

    def _opened(self, path: Path) -> h5py.File:
        """Open a file until the record is closed."""
        # No file locking, so that a file can be read while a run still writes it.
        self._open.append(h5py.File(path, "r", locking=False))
        return self._open[-1]

    def _open_interface(self, path: Path) -> Data:
        self._check(path.name)
        try:
            file = self._opened(path)
            for item in file.values():  # a damaged file shows itself here
                dict(item.attrs)
            data = _renamed(self._histories(file))
            written = _written(data["time"].values)
            data["position"], data["normal_stress"]
        except (OSError, KeyError, ValueError, RuntimeError) as error:
            raise RecordError(f"{path}: damaged or unfinished ({error}); {_AGAIN}") from None
        return self._within(data if written == data.sizes["time"] else data.isel(time=slice(written)))

    @cached_property
    def instruments(self) -> Mapping[str, Data]:
        if not self.case.get("instruments"):
            return {}
        return self._groups("instruments.h5", [str(table["name"]) for table in self.case["instruments"]])

    @cached_property
    def attachments(self) -> Mapping[str, Data]:
        if not self.case.get("attachments"):
            return {}
        return self._groups("attachments.h5", [str(table["name"]) for table in self.case["attachments"]])

    def _groups(self, file_name: str, names: list[str]) -> Mapping[str, Data]:
        """Return the histories of a file with a group for every name."""
        path, groups = self._existing(file_name), {}
        try:
            file = self._opened(path)
            for name in names:
                data = self._histories(file, name)
                groups[name] = self._within(data.isel(time=slice(_written(data["time"].values))))
        except (OSError, KeyError, ValueError, RuntimeError) as error:
            raise RecordError(f"{path}: damaged or unfinished ({error}); {_AGAIN}") from None
        return groups

    def _histories(self, file: h5py.File, group: str | None = None) -> Any:
        """Return the arrays of an interface, of an instrument, or of an attachment."""
        import h5netcdf

        file_of_all = h5netcdf.File(file)
        named = file_of_all if group is None else file_of_all[group]
        times = len(file[named.variables["time"].name])

        def stored(item: h5netcdf.Variable) -> Stored:
            """Return the HDF5 data set, which is faster than h5netcdf; not if a killed run has truncated it."""
            plain = file[item.name]
            return item if item.dimensions[0] == "time" and len(plain) < times else plain

        columns = {name: Column(stored(item), item.dimensions, item.attrs) for name, item in named.variables.items()}
        return Columns(columns, named.attrs)

    @cached_property
    def bulk(self) -> Data:
        path = self._existing("bulk.h5")
        try:
            data = self._snapshots(self._opened(path))
            return self._within(data.isel(time=slice(_written(data["time"].values))))
        except (OSError, KeyError, ValueError, RuntimeError) as error:
            raise RecordError(f"{path}: damaged or unfinished ({error}); {_AGAIN}") from None

    def _snapshots(self, file: h5py.File) -> Any:
        """Return the arrays of the bodies."""
        columns = {name: Column(item, _axes(name, item.ndim), item.attrs) for name, item in file.items()}
        return Columns(columns, dict(file.attrs))

    def sum_unit(self, unit: str) -> str:
        """Return the unit of forces (N) or energies (J) of this run: per metre of thickness in a plane."""
        return extensive_unit(unit, self.case.get("plane", ""))

    @cached_property
    def energy(self) -> Data:
        path, needed = self._existing("energy.csv"), ("boundary_work", "closure")
        return _renamed(self._read_table(path, lambda name: "1" if name == "closure" else self.sum_unit("J"), needed))

    @cached_property
    def forces(self) -> Data:
        several = [self.interface_name] if self._chosen else [self.interface_name, *self.interfaces]
        names = [f"forces_{name}.csv" for name in several if (self.path / f"forces_{name}.csv").is_file()]
        path = self._existing(names[0] if names else "forces.csv")
        units = {"force": self.sum_unit("N"), "work": self.sum_unit("J")}
        return self._read_table(path, lambda name: units.get(name.rpartition("_")[2], "1"))

    @cached_property
    def moment_rate(self) -> Data:
        return self._read_table(self._existing("moment_rate.csv"), lambda name: "N m/s")

    @cached_property
    def edges(self) -> Data:
        path, force = self._existing("edges.csv"), self.sum_unit("N")
        return self._read_table(path, lambda name: "m" if ".displacement_" in name else force)

    @cached_property
    def cracks(self) -> Data:
        axes = {"points": ("point", "axis"), "lines": ("facet", "end"), "normal": ("facet", "axis"),
                "bodies": ("facet", "side"), "length": ("facet",), "joint": ("facet",), "time": ("time",)}  # fmt: skip
        data = self._arrays(self._existing("cracks.h5"), lambda name: axes.get(name, ("time", "facet")))
        return self._within(data.isel(time=slice(_written(data["time"].values))))

    @cached_property
    def events(self) -> Data:
        data = self._arrays(self._existing("events.h5"), lambda name: ("event",))
        if not self.is_part:
            return data
        when = data["time_of_failure"].values
        rows = np.flatnonzero((when >= self.since) & (when <= self.until))
        columns = {name: Column(data[name].values[rows], ("event",), dict(data[name].attrs)) for name in data}
        return self._labelled(columns, dict(data.attrs))

    def _arrays(self, path: Path, axes: Callable[[str], tuple[str, ...]]) -> Any:
        """Return all arrays of a file, in memory; `axes` gives the names of the axes of an array."""
        try:
            with h5py.File(path, "r", locking=False) as file:
                columns = {}
                for name, item in file.items():
                    if item.attrs.get("CLASS") == b"DIMENSION_SCALE" and "units" not in item.attrs:
                        continue  # NetCDF stores the length of an axis in a separate array
                    values = item.asstr()[()] if h5py.check_string_dtype(item.dtype) else item[()]
                    named = {key: item.attrs[key] for key in ("units", "long_name") if key in item.attrs}
                    columns[name] = Column(values, axes(name), named)
                entries = {key: value for key, value in file.attrs.items() if not key.startswith("_")}
            return self._labelled(columns, entries)
        except (OSError, KeyError, ValueError, RuntimeError) as error:
            raise RecordError(f"{path}: damaged or unfinished ({error}); {_AGAIN}") from None

    def _labelled(self, columns: dict[str, Column], attributes: dict[str, Any]) -> Any:
        """Return arrays in memory with names of axes and units."""
        return Columns(columns, attributes)

    def _read_table(self, path: Path, unit: Callable[[str], str], needed: tuple[str, ...] = ()) -> Data:
        """Read a CSV file of a run against time; `unit` is that of a column, and the `needed` ones must be there."""
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except UnicodeDecodeError as error:
            raise RecordError(f"{path}: damaged ({error}); {_AGAIN}") from None
        notes = " ".join(line.lstrip("# ") for line in lines if line.startswith("#"))
        names, *rows = [line.split(",") for line in lines if line and not line.startswith("#")] or [[]]
        try:
            # The last row of a killed run may be cut.
            complete = rows if not rows or len(rows[-1]) == len(names) else rows[:-1]
            table = np.array(complete, dtype=float).reshape(-1, len(names))
            columns = dict(zip((name.strip() for name in names), table.T, strict=True))
            for name in ("time", *needed):
                columns[name]
        except (ValueError, KeyError) as error:
            raise RecordError(f"{path}: damaged ({error!r}); {_AGAIN}") from None
        entries = {name: ("s" if name == "time" else unit(name), name.replace("_", " ")) for name in columns}
        made = {
            name: Column(values, ("time",), dict(zip(("units", "long_name"), entries[name], strict=True)))
            for name, values in columns.items()
        }
        return self._within(self._labelled(made, {"units": notes}))

    def close(self) -> None:
        """Close the files; the record opens them again at the next use."""
        for name in ("interfaces", "bulk", "instruments", "attachments", "cracks", "events", "edges"):
            self.__dict__.pop(name, None)
        while self._open:
            self._open.pop().close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()


class Record(Files):
    """One run, read from its directory; every file is opened at its first use.

    Parameters
    ----------
    path : path of the run directory
    trust : bool
        Run the plug-ins of the run where figures need the code of its laws. They can do what you can.
    checks : bool
        Compare every file of a complete run with its checksum at its first use.

    Attributes
    ----------
    omitted : list of str
        Parts of figures that were left out for want of the plug-ins.
    outside : dict of str to str
        Figures that were left out because their data have no time of this part of the run, with the reason.
    case : dict
        The resolved case.
    summary : dict or None
        Scalars of the whole run; None until it is complete.
    interface : xarray.Dataset
        Histories against `time` [s] and `position` [m] along the interface with the largest slip, which summary and
        figures are about (of an incomplete run the first one), or the one of `record.on(name)`, read lazily.
    interfaces : dict of xarray.Dataset
        All interfaces by name, in the order of the case.
    bulk : xarray.Dataset
        Snapshots against `time` [s] and `point`, with `points` [m] and `cells`, read lazily.
    energy : xarray.Dataset
        Energies [J, in a plane J/m] and their closure against `time` [s].
    instruments : dict of xarray.Dataset
        Signals of each instrument against its `time` [s], by name; empty without instruments.
    attachments : dict of xarray.Dataset
        Fields of each attachment against `time` [s] and `node`, by its name; empty without attachments.
    forces : xarray.Dataset
        Of `interface`, or the first other one with finite sliding: forces [N/m], fractions of its length and works
        [J/m] against `time` [s].
    moment_rate : xarray.Dataset
        Moment rate of every surface by its name [N m/s] against the `time` of every step [s].
    cracks : xarray.Dataset
        Snapshots of all cohesive facets against `time` [s] and `facet`, with `points` [m] and `lines`.
    events : xarray.Dataset
        Facets that failed, in their order, against `event`.
    edges : xarray.Dataset
        Mean displacement [m] and force [N, in a plane N/m] of edges on which boundaries act, against `time` [s].

    Raises
    ------
    RecordError
        The directory is no run; or, on first use, a file is missing or damaged.

    Examples
    --------
    >>> with Record("out/impact") as record:                                              # doctest: +SKIP
    ...     record.interface.slip_rate.sel(position=0.03, method="nearest").plot()
    """

    interface: xarray.Dataset
    interfaces: dict[str, xarray.Dataset]
    bulk: xarray.Dataset
    energy: xarray.Dataset
    instruments: dict[str, xarray.Dataset]
    attachments: dict[str, xarray.Dataset]
    forces: xarray.Dataset
    moment_rate: xarray.Dataset
    cracks: xarray.Dataset
    events: xarray.Dataset
    edges: xarray.Dataset

    def _histories(self, file: h5py.File, group: str | None = None) -> xarray.Dataset:
        import h5netcdf
        import xarray
        from xarray.backends import H5NetCDFStore

        return xarray.open_dataset(H5NetCDFStore(h5netcdf.File(file), group=group), decode_timedelta=False)

    def _snapshots(self, file: h5py.File) -> xarray.Dataset:
        import h5netcdf
        import xarray
        from xarray.backends import H5NetCDFStore

        # Plain HDF5: its axes have no names yet.
        store = H5NetCDFStore(h5netcdf.File(file, phony_dims="access"))
        stored = xarray.open_dataset(store, decode_cf=False, cache=False)
        variables = {str(name): _bulk_variable(str(name), item.variable) for name, item in stored.items()}
        data = xarray.Dataset(variables, attrs=stored.attrs)
        labels = {dim: names.get(data.sizes.get(dim, 0)) for dim, names in _LABELS.items()}
        return data.assign_coords({dim: names for dim, names in labels.items() if names})

    def _labelled(self, columns: dict[str, Column], attributes: dict[str, Any]) -> xarray.Dataset:
        import xarray

        described = {name: (column.dims, column.values, dict(column.attrs)) for name, column in columns.items()}
        return xarray.Dataset(described, attrs=attributes)

    def close(self) -> None:
        for name in ("interfaces", "instruments", "attachments"):
            for data in self.__dict__.get(name, {}).values():
                data.close()
        super().close()

    def _repr_html_(self) -> str:
        from ruptfx.results.notebook import shown_record

        return shown_record(self)

    def __repr__(self) -> str:
        parts: dict[str, Callable[[], str]] = {
            "case": lambda: f"{self.case.get('title', '')}, {self.case.get('plane', '')}".strip(", "),
            "interface": lambda: _extent(self.interface, str(self.interface["position"].dims[0])),
            "bulk": lambda: _extent(self.bulk, "point"),
            "energy": lambda: f"{self.energy.sizes['time']} times",
            "summary": lambda: f"mode {self.summary.get('mode')}" if self.summary else "none yet",
            "figures": lambda: ", ".join(path.name for path in self.figures) or "none",
        }
        if (self.path / "result.nc").is_file():  # of a lumped model
            parts = {name: parts[name] for name in ("case", "summary", "figures")}
            parts["summary"] = lambda: "ruptfx.lumped.read_result(path) has the result as an xarray.Dataset"
        lines = [f"Record {self.path} ({'complete' if self.complete else 'not complete'})"]
        for name, describe in parts.items():
            try:
                text = describe()
            except MissingFileError:
                text = "missing"
            except RecordError:
                text = "damaged"
            lines.append(f"{'└──' if name == 'figures' else '├──'} {name:<10}{text}")
        return "\n".join(lines)


def _renamed(data: Any) -> Any:
    """Return the arrays of an earlier version by the names of this one."""
    former = {name: FORMER_COLUMNS[name] for name in data if FORMER_COLUMNS.get(name, name) not in data}
    for name in former:
        warn_of_former("the column", name, former[name])
    return data.rename(former) if former else data


def _written(time: np.ndarray) -> int:
    """Return the number of valid saved times: a killed run may leave fill values at the end."""
    good = np.isfinite(time) & np.append(True, np.diff(time) > 0)
    return int(good.argmin()) if not good.all() else len(time)


def _axes(name: str, dimensions: int) -> tuple[str, ...]:
    """Return the names of the axes of a bulk quantity."""
    if name in _MESH:
        return _MESH[name]
    last = "stress_component" if name == "stress" else "component"
    return ("time", "point", last)[:dimensions]


def _bulk_variable(name: str, stored: xarray.Variable) -> xarray.Variable:
    """Return the variable with names of its axes, still on disk."""
    stored.dims = _axes(name, stored.ndim)
    stored.attrs = {key: str(value) for key, value in stored.attrs.items()}
    return stored


def _extent(data: xarray.Dataset, along: str) -> str:
    times = data["time"].values
    until = f", until {float(times[-1]):.4g} s" if len(times) else ""
    fields = sum("time" in variable.dims for variable in data.data_vars.values())
    return f"{fields} fields, {data.sizes[along]} points x {len(times)} times{until}"
