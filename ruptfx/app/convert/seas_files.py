"""Cycles of a fault as text files of the SEAS code comparison, and the check of such files.

A line gives the files of the benchmarks BP1 and BP3, time series down dip and profiles; a surface those of BP5: time
series, `global.dat`, profiles along a line of strike and of dip, and the rupture times of the first event. On request
both have the motion of stations off the fault (`ruptfx.app.convert.seas_ground`). Components 2
and 3 are those of the record, along the positions and down dip, of the plus relative to the minus side. On a dipping
line in plane motion slip is positive for a thrust.

Source: descriptions of the benchmarks BP1-QD to BP8-QD, https://strike.scec.org/cvws/seas
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import date
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ruptfx import RuptfxError, __version__
from ruptfx.app.convert.seas_ground import SMALL, ground_motion
from ruptfx.input import quantities
from ruptfx.results.analysis.surface import SurfaceInterpolation, is_surface, moment_rate

if TYPE_CHECKING:
    from ruptfx.results.record import Data, Record

Array = np.ndarray
Station = tuple[float, ...]
"""Distance down dip [m]; of a surface position along strike and distance down dip."""

DOWN_DIP: tuple[Station, ...] = tuple((1e3 * d,) for d in (0, 2.5, 5, 7.5, 10, 12.5, 15, 17.5, 20, 25, 30, 35))
ON_SURFACE: tuple[Station, ...] = tuple((1e3 * strike, 1e3 * dip) for strike, dip in (
    (-36, 0), (-16, 0), (0, 0), (16, 0), (36, 0), (-24, 10), (-16, 10), (0, 10), (16, 10), (0, 22)
))  # fmt: skip
"""Stations of BP1 and BP3, and of BP5 [m]."""
LINES = {"strike": 10e3, "depth": 0.0}
"""Profiles of a surface: along strike at this distance down dip, and down dip at this position [m]."""
STEPS = {1: 500.0, 2: 1000.0}  # m, spacing of profiles of lines and surfaces
NO_RATE = 1e-20  # m/s, whose logarithm is written where nothing slips: V_zero of BP5
NEVER = 1e9
"""Rupture time of points that did not rupture [s]."""
MOST_ROWS = 100_000
"""Largest number of times in a file."""
ENTRIES = ("problem", "code", "modeler", "date", "element_size")
SERIES = "# Here is the time-series data."
PROFILE = "# Here are the data"

TIME, STATE = ("t", "Time (s)"), ("state", "State (log10 s)")
ON_LINE = {"slip": "Slip (m)", "slip_rate": "Slip rate (log10 m/s)", "shear_stress": "Shear stress (MPa)",
           "normal_stress": "Normal stress (MPa)"}  # fmt: skip
OF_SURFACE = {f"{name}_{axis}": f"{text.split(' (')[0]}_{axis} ({text.split(' (')[1]}"
              for name, text in list(ON_LINE.items())[:3] for axis in (2, 3)}  # fmt: skip
GLOBAL = (TIME, ("max_slip_rate", "Max slip rate (log10 m/s)"), ("moment_rate", "Moment rate (N-m/s)"))
MOTION = {"disp": "Displacement {} (m)", "vel": "Velocity {} (m/s)"}
CONTOURS = (("x2", "x2 (m)"), ("x3", "x3 (m)"), ("t", f"Time (s), {NEVER:.1E} where it does not rupture"))
LAYOUTS = (
    (r"(\w+_)?fltst_dp\d{3}\.dat", {("t", "slip", "slip_rate", "shear_stress", "state"),
                                    ("t", *ON_LINE, "state")}),
    (r"(\w+_)?fltst_strk[+-]\d\d+dp[+-]\d\d+\.dat", {("t", *OF_SURFACE, "state")}),
    (r"(\w+_)?srfst_fn[+-]\d\d+\.dat", {("t", *(f"{name}_{axis}" for name in MOTION for axis in (1, 2)))}),
    (r"(\w+_)?blkst_strk[+-]\d\d+fn[+-]\d\d+dp[+-]\d\d+\.dat",
     {("t", *(f"{name}_{axis}" for name in MOTION for axis in (1, 2, 3)))}),
    (r"(\w+_)?global\.dat", {tuple(name for name, _ in GLOBAL)}),
    (r"(\w+_)?rupture\.dat", {tuple(name for name, _ in CONTOURS)}),
    (r"(\w+_)?(slip|shear_stress|normal_stress)\.dat", {("t", "max_slip_rate", name) for name in ON_LINE}),
    (r"(\w+_)?(slip|stress)_[23]_(strike|depth)\.dat",
     {("t", "max_slip_rate", f"{name}_{axis}") for name in ("slip", "shear_stress") for axis in (2, 3)}),
)  # fmt: skip
"""Names of files, and the lines of fields that they may have."""
BOUNDS = {"rate": (-35.0, 3.0), "stress": (-1e4, 1e4), "state": (-20.0, 20.0), "disp": (-1e4, 1e4), "vel": (-1e2, 1e2)}
"""Least and largest plausible log10 of a slip rate in m/s, stress in MPa, log10 of an age in s, displacement in m and
velocity in m/s."""


class Interpolation(Protocol):
    """Values at wanted places from those of all points."""

    def __call__(self, values: Array) -> Array: ...


@dataclass(frozen=True)
class Fault:
    """Fields of an interface at stations and along profiles, in the directions and units of the files.

    Attributes
    ----------
    data : Data
    places : tuple of ndarray
        Positions of all points by which stations are named [m].
    axes : tuple of int
        Components of slip in the files; empty for a line.
    sign : float
        Factor of slip and shear traction.
    normal : bool
        Whether the files have the normal stress.
    frictional : ndarray of bool, shape (points,)
        Points that count for the largest slip rate and the moment rate.
    """

    data: Data
    places: tuple[Array, ...]
    axes: tuple[int, ...]
    sign: float
    normal: bool
    frictional: Array

    @classmethod
    def of(cls, record: Record, name: str) -> Fault:
        """Return the fault of an interface.

        Raises
        ------
        RuptfxError
            Its friction has no age.
        """
        data = record.interfaces[name]
        if "theta" not in data:
            raise RuptfxError(
                f"export --format seas: interface {name} has no age theta, the state of the files; use --format netcdf"
            )
        if not is_surface(data):
            down, sign = _down_dip(data)
            plane = data.attrs["plane"] != "antiplane"
            return cls(data, (down,), (), sign if plane else 1.0, plane, np.ones(len(down), dtype=bool))
        strike, dip = data["position"].values, data["dip"].values
        along = record.case.get("mesh", {}).get("along_strike")
        inside = np.abs(strike) <= 0.5 * along["length"] if along else np.ones(len(strike), dtype=bool)
        return cls(data, (strike, dip), (2, 3), 1.0, False, inside)

    @property
    def ends(self) -> list[tuple[float, float]]:
        """Least and largest positions of the frictional part [m]."""
        inside = (each[self.frictional] for each in self.places)
        return [(float(each.min()), float(each.max())) for each in inside]

    def covers(self, station: Station) -> bool:
        """Return whether a station is on the frictional part of the fault."""
        slack = 1e-6 * max(np.ptp(each) for each in self.places)
        return all(low - slack <= x <= high + slack for (low, high), x in zip(self.ends, station, strict=True))

    def at(self, stations: Sequence[Station]) -> Interpolation:
        """Return the linear interpolation to places."""
        where = np.array(stations, dtype=float).reshape(len(stations), -1).T
        if len(self.places) == 2:
            return SurfaceInterpolation(self.data, *where)
        order = np.argsort(self.places[0])
        return lambda values: np.interp(where[0], self.places[0][order], values[order])

    def columns(self, stations: Sequence[Station]) -> dict[str, Array]:
        """Return all fields at places by their names in the files, shape (times, places)."""
        at = self.at(stations)
        sources = {"slip": "slip", "slip_rate": "slip_rate", "shear_stress": "shear_traction"}
        result: dict[str, Array] = {}
        for name, source in sources.items():
            for axis in self.axes or (None,):
                tail, column = ("", source) if axis is None else (f"_{axis}", f"{source}_{axis - 1}")
                values = self._each(column, at)
                result[name + tail] = _log(values) if name == "slip_rate" else self.sign * values
                if name == "shear_stress":
                    result[name + tail] /= 1e6
        if self.normal:
            result["normal_stress"] = self._each("normal_stress", at) / 1e6
        result["state"] = np.log10(self._each("theta", at))
        return result

    def _each(self, name: str, at: Interpolation) -> Array:
        return np.stack([at(values) for values in self.data[name].values])

    def fastest(self) -> Array:
        """Return log10 of the largest slip rate of every record."""
        names = [f"slip_rate_{axis - 1}" for axis in self.axes] or ["slip_rate"]
        square = np.sum([self.data[name].values[:, self.frictional] ** 2 for name in names], axis=0)
        return _log(np.sqrt(square.max(axis=1)))

    def moment_rate(self) -> Array:
        """Return the moment rate of the frictional part at every record [N m/s]."""
        return moment_rate(self.data, self.frictional)


def _log(rate: Array) -> Array:
    return np.log10(np.maximum(np.abs(rate), NO_RATE))


def _down_dip(data: Data) -> tuple[Array, float]:
    """Return the distance of the points of a line from its upper end [m], and the sign of slip for a thrust.

    The tangent of a line points to the right of a viewer who looks along its normal, and the normal to the plus side;
    that of a fault which is neither horizontal nor vertical has its hanging wall above.
    """
    position, x, y = (data[name].values for name in ("position", "x", "y"))
    order = np.argsort(position)
    across, up = (float(np.diff(each[order[[0, -1]]])[0]) for each in (x, y))
    flat = 1e-6 * np.hypot(across, up)
    down = position.max() - position if up > flat else position - position.min()
    dips = abs(across) > flat and abs(up) > flat
    return down, float(np.sign(across) * np.sign(up)) if dips else 1.0


def parse_stations(texts: Sequence[str], option: str = "station", example: str = "-24 km, 10 km") -> list[Station]:
    """Return stations from text such as `7.5 km`, or `-24 km, 10 km` on a surface.

    Parameters
    ----------
    option, example : str
        Of the command and of a surface, for messages.

    Raises
    ------
    RuptfxError
    """
    try:
        return [tuple(quantities.parse(part.strip(), "m") for part in text.split(",")) for text in texts]
    except ValueError as error:
        count = ("one", "two", "three")[example.count(",")]
        raise RuptfxError(f"export --{option}: {error}; on a surface {count} of them: '{example}'") from None


def parse_off_fault(texts: Sequence[str] | None) -> list[Station] | None:
    """Return stations off the fault; none of the user's for `benchmark`, and None without text.

    Raises
    ------
    RuptfxError
    """
    if not texts:
        return None
    return [] if list(texts) == ["benchmark"] else parse_stations(texts, "off-fault", "-16 km, 8 km, 0 km")


def files(
    record: Record, folder: Path, note: Callable[[str], object] = print, stations: Sequence[Station] = (),
    off_fault: Sequence[Station] | None = None,
) -> Iterator[Path]:  # fmt: skip
    """Write the files of every interface, check them, and yield their paths.

    `note` prints what is not written. Stations are by default those of the benchmarks that are on the fault. Stations
    off the fault are written unless `off_fault` is None; without one they are those of the benchmarks in the bodies.

    Raises
    ------
    RuptfxError
        No interface has an age, a station is not on the fault, or a file would be refused.
    """
    names = list(record.interfaces)
    for name in names:
        try:
            fault = Fault.of(record, name)
        except RuptfxError as error:
            if len(names) == 1:
                raise
            note(f"not written: {error}")
            continue
        prefix = "" if name == "main" or len(names) == 1 else f"{name}_"
        writer = Writer(record, fault, folder, prefix)
        ground = iter(()) if off_fault is None else writer.ground(name, off_fault)
        for path in chain(writer.write(stations), ground):
            check(path)
            yield path


@dataclass
class Writer:
    """Writes the files of a fault into a folder."""

    record: Record
    fault: Fault
    folder: Path
    prefix: str
    times: Array = field(init=False)
    fastest: Array = field(init=False)

    def __post_init__(self) -> None:
        self.times, self.fastest = self.fault.data["time"].values, self.fault.fastest()

    def write(self, stations: Sequence[Station]) -> Iterator[Path]:
        """Write all files; yield the paths."""
        surface = bool(self.fault.axes)
        wanted = [each for each in (ON_SURFACE if surface else DOWN_DIP) if self.fault.covers(each)]
        yield from self._stations(self._checked(stations) or wanted)
        if not surface:
            yield from self._profiles("", "xd", *self._line(0, None))
            return
        yield self._table("global.dat", GLOBAL, [self.times, self.fastest, self.fault.moment_rate()])
        for axis, (along, across) in enumerate(LINES.items()):
            where, places = self._line(axis, across)
            if self.fault.covers(places[0]):
                yield from self._profiles(f"_{along}", f"x{axis + 2}", where, places)
        times = self.fault.data["rupture_time"].values[self.fault.frictional]
        strike, dip = (each[self.fault.frictional] for each in self.fault.places)
        threshold = float(self.fault.data.attrs["rupture_threshold"])
        yield self._table("rupture.dat", CONTOURS, [strike, dip, np.where(np.isfinite(times), times, NEVER)],
                          {"rupture": f"first slip rate above {threshold:g} m/s"}, "# Here is the data.")  # fmt: skip

    def _checked(self, stations: Sequence[Station]) -> list[Station]:
        places = self.fault.ends
        for station in stations:
            if len(station) != len(places) or not self.fault.covers(station):
                where = ", ".join(f"{x / 1e3:g} km" for x in station)
                ends = " and ".join(f"{low / 1e3:.6g} to {high / 1e3:.6g} km" for low, high in places)
                raise RuptfxError(
                    f"export --station '{where}' is not on the fault: {len(places)} positions, {ends}; "
                    f"use --station '{', '.join(f'{low / 1e3:.6g} km' for low, _ in places)}' for its first corner"
                )
        return list(stations)

    def _line(self, axis: int, across: float | None) -> tuple[Array, list[Station]]:
        """Return the positions of a profile and its places [m]."""
        own = self.fault.places[axis][self.fault.frictional]
        step = STEPS[len(self.fault.places)]
        first, last = np.ceil(own.min() / step - 1e-6), np.floor(own.max() / step + 1e-6)
        where = step * np.arange(first, last + 1)
        if len(where) < 2:  # a fault of a laboratory
            where = np.unique(own)
        if across is None:
            return where, [(x,) for x in where]
        return where, [(x, across) if axis == 0 else (across, x) for x in where]

    def _stations(self, stations: Sequence[Station]) -> Iterator[Path]:
        if not stations:
            return
        columns = self.fault.columns(stations)
        texts = OF_SURFACE if self.fault.axes else ON_LINE
        head = [TIME, *((name, texts[name]) for name in columns if name != "state"), STATE]
        for number, station in enumerate(stations):
            kilometres = [x / 1e3 for x in station]
            if len(station) == 2:
                name = "fltst_strk{:+03.0f}dp{:+03.0f}.dat".format(*kilometres)
                place = "on fault, {:g} km along strike, {:g} km depth".format(*kilometres)
            else:
                name = f"fltst_dp{10 * kilometres[0]:03.0f}.dat"
                place = f"on fault, {kilometres[0]:g} km down-dip distance"
            values = [self.times, *(each[:, number] for each in columns.values())]
            yield self._table(name, head, values, self._of_times(place))

    def _of_times(self, place: str) -> dict[str, str]:
        """Return the entries of the header of a time series."""
        steps = np.diff(self.times) if len(self.times) > 1 else np.zeros(1)
        return {"location": place, "minimum_time_step": f"{steps.min():.6g} s",
                "maximum_time_step": f"{steps.max():.6g} s", "num_time_steps": str(len(self.times))}  # fmt: skip

    def ground(self, name: str, stations: Sequence[Station]) -> Iterator[Path]:
        """Write the motion of stations off an interface, by default of the benchmarks; yield the paths.

        Raises
        ------
        RuptfxError
            Two stations have the same file, or one is not in the bodies.
        """
        _names_off_fault(stations)  # before the bodies are built
        ground = ground_motion(self.record, name, stations)
        names = _names_off_fault(ground.stations)
        for (file, place), displacement, velocity in zip(names, ground.displacement, ground.velocity, strict=True):
            axes = range(1, displacement.shape[1] + 1)
            head = [TIME, *((f"{kind}_{axis}", text.format(axis)) for kind, text in MOTION.items() for axis in axes)]
            yield self._table(file, head, [self.times, *displacement.T, *velocity.T], self._of_times(place))

    def _profiles(self, tail: str, axis: str, where: Array, places: list[Station]) -> Iterator[Path]:
        columns = self.fault.columns(places)
        for name, values in columns.items():
            if name.startswith("slip_rate") or name == "state":
                continue
            stem = name.replace("shear_", "") if tail else name
            text = (OF_SURFACE if tail else ON_LINE)[name]
            entries = [
                f"# Row #1 = {'Distance' if tail else 'Distance down dip'} {axis} (m) with two zeros first",
                f"# Column #1 = {TIME[1]}", f"# Column #2 = {GLOBAL[1][1]}",
                f"# Columns #3-{len(where) + 2} = {text}", "# The line below lists the names of the data fields",
                axis, f"t max_slip_rate {name}", PROFILE,
            ]  # fmt: skip
            rows = np.vstack([[0.0, 0.0, *where], np.column_stack([self.times, self.fastest, values])])
            yield self._save(f"{stem}{tail}.dat", self._header({}) + entries, rows)

    def _table(
        self, name: str, columns: Sequence[tuple[str, str]], values: Sequence[Array],
        entries: dict[str, str] | None = None, last: str = SERIES,
    ) -> Path:  # fmt: skip
        lines = self._header(entries or {})
        lines += [f"# Column #{number} = {text}" for number, (_, text) in enumerate(columns, 1)]
        lines += ["# The line below lists the names of the data fields", " ".join(name for name, _ in columns), last]
        return self._save(name, lines, np.column_stack(list(values)))

    def _header(self, entries: dict[str, str]) -> list[str]:
        case = self.record.case
        size, order = case.get("mesh", {}).get("element_size"), case.get("order", 1)
        head = {
            "problem": case.get("title") or self.record.path.name, "code": "ruptfx", "version": __version__,
            "modeler": "to be filled in", "date": f"{date.today():%Y/%m/%d}",
            "element_size": "unknown" if size is None else f"{size:g} m, order {order}", **entries,
        }  # fmt: skip
        return ["# This is the file header:", *(f"# {key}={value}" for key, value in head.items())]

    def _save(self, name: str, lines: list[str], rows: Array) -> Path:
        path = self.folder / f"{self.prefix}{name}"
        formats = ["%21.13E", *["%14.6E"] * (rows.shape[1] - 1)]
        np.savetxt(path, rows + 0.0, fmt=formats, header="\n".join(lines), comments="")  # + 0.0: no -0.0
        return path


def _names_off_fault(stations: Sequence[Station]) -> list[tuple[str, str]]:
    """Return the file and the location of stations off the fault, in km, or in m as in BP7 where all are within 1 km.

    Raises
    ------
    RuptfxError
        Two stations have the same file.
    """
    in_metres = all(abs(x) < SMALL for station in stations for x in station)
    unit, width, scale = ("m", 4, 1.0) if in_metres else ("km", 3, 1e3)
    names: dict[str, tuple[Station, str]] = {}
    for station in stations:
        short = [x / scale for x in station]
        words = [f"{x:+0{width}.0f}" for x in short]
        file = ("srfst_fn{}.dat" if len(station) == 1 else "blkst_strk{}fn{}dp{}.dat").format(*words, *["+00"] * 3)
        if file in names:
            raise RuptfxError(
                f"export --off-fault: {station} and {names[file][0]} m are both {file}; move one of them by 1 {unit}"
            )
        texts = [f"{x:g} {unit}" for x in short]
        names[file] = station, (
            f"on surface, {texts[0]} distance off-fault" if len(station) == 1
            else ", ".join(f"{x} {y}" for x, y in zip(texts, ("along strike", "off fault", "depth"), strict=False))
        )  # fmt: skip
    return [(file, place) for file, (_, place) in names.items()]


def check(path: Path) -> None:
    """Read a file of the code comparison back and refuse what its upload would.

    Raises
    ------
    RuptfxError
        With the line, the value, the bound and what to do.
    """
    allowed = next((fields for pattern, fields in LAYOUTS if re.fullmatch(pattern, path.name)), None)
    if allowed is None:
        raise RuptfxError(f"{path}: no name of a file of the comparison, as fltst_dp075.dat; rename it")
    lines = path.read_text(encoding="utf-8").splitlines()
    matches = (re.fullmatch(r"#\s*([\w ]+?)\s*=\s*(.*)", line) for line in lines)
    entries = {match[1]: match[2] for match in matches if match}
    for key in ENTRIES:
        if not entries.get(key):
            raise RuptfxError(f"{path}: the header has no '# {key}='; add this line")
    body = [(number, line.split()) for number, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    names = [words for _, words in body if not _is_number(words[0])]
    rows = body[len(names) :]
    profile = len(names) == 2
    if not names or tuple(names[-1]) not in allowed or len(names) > 2:
        shown = " or ".join(sorted(" ".join(each) for each in allowed))
        got = " / ".join(" ".join(each) for each in names)
        raise RuptfxError(f"{path}: its line of fields is '{got}' and not '{shown}'; use these names and columns")
    table = _numbers(path, rows, len(rows[0][1]) if profile and rows else len(names[-1]))
    numbers = [number for number, _ in rows]
    if profile:
        _check_places(path, numbers[0], table[0])
        table, numbers = table[1:], numbers[1:]
    if "rupture" in path.stem:
        return
    if not 2 <= len(table) <= MOST_ROWS:
        raise RuptfxError(
            f"{path}: {len(table)} times, and the comparison reads 2 to {MOST_ROWS}; run again with fewer or more "
            "records: change output.interface_growth or output.interface_interval"
        )
    late = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if len(late) or table[0, 0] < 0:
        row = int(late[0]) + 1 if len(late) else 0
        raise RuptfxError(
            f"{path}, line {numbers[row]}: time {table[row, 0]:.9g} s does not follow "
            f"{table[row - 1, 0] if row else 0.0:.9g} s; sort the rows by time from 0 s on, and remove repeated ones"
        )
    fields = [*names[-1][:2], *[names[-1][-1]] * (table.shape[1] - 2)] if profile else names[-1]
    _check_units(path, numbers, fields, table)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(path: Path, rows: list[tuple[int, list[str]]], count: int) -> Array:
    """Return the numbers of the rows; all are finite, and all rows have the same number of columns."""
    if not rows:
        raise RuptfxError(f"{path}: has no rows of numbers; run longer, or use another record")
    for number, words in rows:
        if len(words) != count:
            raise RuptfxError(f"{path}, line {number}: {len(words)} columns instead of {count}; add or remove some")
        bad = next((word for word in words if not (_is_number(word) and np.isfinite(float(word)))), None)
        if bad is not None:
            raise RuptfxError(f"{path}, line {number}: '{bad}' is no finite number; remove the row or the cause of it")
    return np.array([words for _, words in rows], dtype=float)


def _check_places(path: Path, number: int, row: Array) -> None:
    """Refuse a first row of a profile without two zeros, or whose positions do not increase."""
    if np.any(row[:2] != 0) or len(row) < 4 or np.any(np.diff(row[2:]) <= 0):
        raise RuptfxError(
            f"{path}, line {number}: the first row must be 0 0 and at least two increasing positions in m; its "
            f"beginning is {' '.join(f'{value:g}' for value in row[:4])}; sort the columns"
        )


def _check_units(path: Path, numbers: list[int], fields: Sequence[str], table: Array) -> None:
    """Refuse numbers that have another unit: slip rates that are no logarithms, stresses in Pa."""
    for column, name in enumerate(fields):
        bounds = next((BOUNDS[key] for key in BOUNDS if key in name and name != "moment_rate"), None)
        if bounds is None:
            continue
        outside = np.flatnonzero((table[:, column] < bounds[0]) | (table[:, column] > bounds[1]))
        if len(outside):
            row = int(outside[0])
            raise RuptfxError(
                f"{path}, line {numbers[row]}: {name} = {table[row, column]:g} is not within {bounds[0]:g} to "
                f"{bounds[1]:g}; use m, m/s and MPa, and log10 of slip rates in m/s and of ages in s"
            )
