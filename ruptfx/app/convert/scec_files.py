"""A rupture on surfaces as text files of the SCEC/USGS code comparison.

One file of time series for every receiver on a fault and in the bodies, and for every fault the rupture times of all
points, for contours. A viewer stands on the near side of the fault and looks at it: strike is to the right, so that a
positive horizontal slip is right-lateral. The far side is the hanging wall of a dipping fault, and of a vertical one
the side for which strike has its largest component along +x or +y. Directions of a curved fault are those of the plane
in which its positions are; its slip and shear traction keep the tangents of the point, projections of these directions.

Source: descriptions of the benchmarks TPV5 to TPV104, https://strike.scec.org/cvws
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Self, SupportsFloat

import numpy as np

from ruptfx import RuptfxError, Table, __version__
from ruptfx.results.analysis.surface import is_surface

if TYPE_CHECKING:
    from ruptfx.results.record import Data, Files, Record

Array = np.ndarray

FLAT = 1e-6  # distance from the plane over its extent, and height of a horizontal normal
THIN = 1e-4  # thickness of a surface over its extent below which its points do not define a direction across it
STEEP = 1e-3  # horizontal length of the normal below which a surface has no strike
NEVER = 1e9
"""Rupture time of points that did not rupture [s]."""
DECIMALS = 9  # of positions [m]: the rest is rounding of a turned plane
GRID = 100.0  # m, unit of the positions in names of files


@dataclass(frozen=True)
class Column:
    """One column of a file: name in the line of fields, and its description."""

    field: str
    text: str


TIME = Column("t", "time (s)")
OF_BODY = (
    Column("h-disp", "horizontal displacement (m), positive along strike"),
    Column("h-vel", "horizontal velocity (m/s)"),
    Column("v-disp", "vertical displacement (m), positive downwards"),
    Column("v-vel", "vertical velocity (m/s)"),
    Column("n-disp", "normal displacement (m), positive from the near to the far side"),
    Column("n-vel", "normal velocity (m/s)"),
)
OF_FAULT = (
    Column("h-slip", "horizontal slip (m), positive if right-lateral"),
    Column("h-slip-rate", "horizontal slip rate (m/s)"),
    Column("h-shear-stress", "horizontal shear stress (MPa), positive if it drives right-lateral slip"),
    Column("v-slip", "slip down dip (m), positive if the far side moves downwards"),
    Column("v-slip-rate", "slip rate down dip (m/s)"),
    Column("v-shear-stress", "shear stress down dip (MPa), positive if it drives the far side downwards"),
)
TENSION = Column("n-stress", "normal stress (MPa), positive in tension")
PRESSURE = Column("n-stress", "normal stress (MPa), positive in compression")
STATES = {
    "theta": Column("log-theta", "log10 of the state variable theta (s)"),
    "psi": Column("psi", "state variable psi (1)"),
}
"""Column of a state variable of a rate and state law. Its benchmarks count pressure as positive, all others tension."""
CONTOURS = (
    Column("j", "distance along strike (m)"), Column("k", "distance down dip (m)"),
    Column("t", f"rupture time (s), {NEVER:.1E} where the fault did not rupture"),
)  # fmt: skip


@dataclass(frozen=True)
class View:
    """Directions of a surface as its viewer sees them; of a curved one those of the plane of its positions.

    Attributes
    ----------
    strike, down, away : ndarray, shape (3,)
        Unit vectors: to the right, down dip, and horizontal from the near to the far side.
    turn : ndarray, shape (2, 2)
        Matrix that turns slip and shear traction, of the plus body relative to the minus body along both tangents of
        the surface, into those of the far side relative to the near side along strike and down dip.
    trace : float
        Position of the line where the plane of the surface is at z = 0, along `away` [m]; 0 where the plane through the
        origin passes through a curved surface, else that through the mean of its points.
    apart : float
        Largest distance of the surface from the plane of its positions through the mean of its points [m], 0 if plane.
    """

    strike: Array
    down: Array
    away: Array
    turn: Array
    trace: float
    apart: float = 0.0

    @classmethod
    def of(cls, data: Data, name: str) -> Self:
        """Return the directions of an interface, from the positions of its points.

        Raises
        ------
        RuptfxError
            It is no surface, or it is horizontal.
        """
        key = f"export --format scec: interface {name}"
        if not is_surface(data):
            raise RuptfxError(f"{key} is a line, and the format is for surfaces in 3D; use --format csv")
        points = np.stack([data[axis].values for axis in "xyz"], axis=1)
        middle = points.mean(axis=0)
        # Positions are distances along two directions; of a plane, whose normal they do not define, those within it.
        places = np.stack([data[position].values for position in ("position", "dip")], axis=1)
        directions, *_ = np.linalg.lstsq(points - middle, places - places.mean(axis=0), rcond=THIN)
        first, second = (directions / np.linalg.norm(directions, axis=0)).T
        normal = np.cross(first, second)  # from the minus to the plus body
        if np.hypot(*normal[:2]) < STEEP:
            raise RuptfxError(
                f"{key} is horizontal and has no strike; turn the mesh so that z is up, or use --format netcdf"
            )
        up = np.array([0.0, 0.0, 1.0])
        strike = np.cross(normal, up)
        far = np.sign(strike[np.argmax(np.abs(strike))] if abs(normal[2]) < FLAT else normal[2])
        normal, strike = far * normal, far * strike / np.linalg.norm(strike)
        down, away = np.cross(normal, strike), np.cross(up, strike)
        off = float(np.abs((points - middle) @ normal).max())
        apart = off if off > FLAT * np.ptp(points, axis=0).max() else 0.0
        trace = 0.0 if abs(normal @ middle) < apart else float(normal @ middle / (normal @ away))
        turn = far * np.stack([strike, down]) @ np.stack([first, second], axis=1)
        turn = np.round(turn, 12)  # positions are rounded: no share of one component in the other on aligned surfaces
        return cls(strike, down, away, turn, trace, apart)

    def place(self, points: Array) -> tuple[Array, Array, Array]:
        """Return distances of points [m]: off the fault at z = 0, along strike, and down dip from z = 0."""
        places = points @ self.away - self.trace, points @ self.strike, points[..., 2] / self.down[2]
        off, along, down = (np.round(place, DECIMALS) + 0.0 for place in places)  # without -0.0
        return off, along, down


def files(record: Record, folder: Path, note: Callable[[str], object] = print) -> Iterator[Path]:
    """Write the rupture times of every fault and the time series of every receiver; yield the paths.

    `note` prints what is not written.

    Raises
    ------
    RuptfxError
        No interface is a surface with a strike.
    """
    views: dict[str, View] = {}
    for name, surface in record.interfaces.items():
        try:
            views[name] = View.of(surface, name)
        except RuptfxError as error:
            if len(record.interfaces) == 1:
                raise
            note(f"not written: {error}")
    if not views:
        raise RuptfxError(f"export --format scec: {record.path} has no interface with a strike; use --format vtkhdf")
    for name, view in views.items():
        yield _contours(record, name, view, folder)
    written: set[str] = set()
    reference = _reference(record.interfaces, views)
    for table in record.case.get("instruments", []):
        data = record.instruments[table["name"]] if table["kind"] in ("receiver", "fault_receiver") else None
        fault = table.get("fault", "main")
        if data is None or (table["kind"] == "fault_receiver" and fault not in views):
            continue
        try:
            if table["kind"] == "fault_receiver":
                path = _on_fault(record, table, data, views[fault], folder, written)
            else:
                path = _in_body(record, table, data, views[reference], folder, written)
        except RuptfxError as error:
            note(f"not written: {error}")
            continue
        written.add(path.name)
        yield path


def _reference(interfaces: Mapping[str, Data], names: Collection[str]) -> str:
    """Return the fault whose axes stations off the faults have: `main`, else the largest; the order does not matter."""
    return "main" if "main" in names else max(sorted(names), key=lambda name: float(interfaces[name]["area"].sum()))


def _contours(record: Record, name: str, view: View, folder: Path) -> Path:
    """Write the rupture time of every point of a fault."""
    data = record.interfaces[name]
    _, along, down = view.place(np.stack([data[axis].values for axis in "xyz"], axis=1))
    times = data["rupture_time"].values
    rows = np.column_stack([along, down, np.where(np.isfinite(times), times, NEVER)])
    threshold = float(data.attrs["rupture_threshold"])
    entries = {"rupture": f"slip rate above {threshold:g} m/s", **_shape(view)}
    return _write(record, folder / f"{name}_rupture_time.txt", entries, CONTOURS, rows)


def _on_fault(
    record: Record, table: Table, data: Data, view: View, folder: Path, written: Collection[str] = ()
) -> Path:
    """Write what a receiver on a fault recorded."""
    _, along, down = view.place(np.array(table["point"], dtype=float))
    columns = _fault_columns(data, view)
    fault = table.get("fault", "main")
    name = _file_name(table, {f"{'fault' if fault == 'main' else fault}st": along, "dp": down}, written)
    place = f"on fault, {along / 1e3:.7g} km along strike, {down / 1e3:.7g} km down-dip"
    return _series(record, folder / name, place, columns, data, _shape(view))


def _shape(view: View) -> dict[str, str]:
    """Return the entry of the header about a curved fault."""
    tangents = "slip and shear stress along the tangents of the surface at the station"
    return {"fault_surface": f"up to {view.apart:.4g} m off its plane; {tangents}"} if view.apart else {}


def _fault_columns(data: Data, view: View) -> dict[Column, Array]:
    """Return what a receiver on a fault recorded, as its viewer sees it."""
    slip, rate, shear = (
        view.turn @ np.stack([data[f"{field}_{tangent}"].values for tangent in (1, 2)])
        for field in ("slip", "slip_rate", "shear_traction")
    )
    state = next((name for name in STATES if name in data), None)
    pressure = data["normal_stress"].values / 1e6
    values = [slip[0], rate[0], shear[0] / 1e6, slip[1], rate[1], shear[1] / 1e6, pressure if state else -pressure]
    columns = dict(zip((*OF_FAULT, PRESSURE if state else TENSION), values, strict=True))
    if state:
        columns[STATES[state]] = np.log10(data[state].values) if state == "theta" else data[state].values
    return columns


def _in_body(record: Record, table: Table, data: Data, view: View, folder: Path, written: Collection[str] = ()) -> Path:
    """Write what a receiver in the bodies recorded."""
    columns = _body_columns(table, data, view)
    point = np.array(table["point"], dtype=float)
    off, along, _ = view.place(point)
    depth = 0.0 - point[2]
    name = _file_name(table, {"body": off, "st": along, "dp": depth}, written)
    place = f"{off / 1e3:.7g} km off fault, {along / 1e3:.7g} km along strike, {depth / 1e3:.7g} km depth"
    return _series(record, folder / name, place, columns, data)


def _body_columns(table: Table, data: Data, view: View) -> dict[Column, Array]:
    """Return what a receiver in the bodies recorded, as the viewer of a fault sees it.

    Raises
    ------
    RuptfxError
        It does not record velocity and displacement.
    """
    for field in ("velocity", "displacement"):
        if f"{field}_x" not in data:
            raise RuptfxError(
                f"export --format scec: instrument {table['name']} does not record its {field}; run again with "
                "fields = ['velocity', 'displacement'] in its table"
            )
    directions = (view.strike, np.array([0.0, 0.0, -1.0]), view.away)
    motions = [np.stack([data[f"{field}_{axis}"].values for axis in "xyz"]) for field in ("displacement", "velocity")]
    values = [direction @ motion for direction in directions for motion in motions]
    return dict(zip(OF_BODY, values, strict=True))


def channels(record: Files, instrument: str) -> dict[str, tuple[Array, str]]:
    """Return what a receiver recorded by the names of the fields in these files, with units.

    Empty for other instruments, and where there is no surface.

    Raises
    ------
    RuptfxError
        The surface is horizontal.
    """
    table: Table = next((each for each in record.case.get("instruments", []) if each["name"] == instrument), {})
    surfaces = {name: data for name, data in record.interfaces.items() if is_surface(data)}
    if table.get("kind") not in ("receiver", "fault_receiver") or not surfaces:
        return {}
    fault = table.get("fault", "main") if table["kind"] == "fault_receiver" else _reference(surfaces, surfaces)
    if fault not in surfaces:
        return {}
    surface, data = surfaces[fault], record.instruments[instrument]
    view = View.of(surface, fault)
    of_fault = table["kind"] == "fault_receiver"
    columns = _fault_columns(data, view) if of_fault else _body_columns(table, data, view)
    return {column.field: (values, _unit(column.text)) for column, values in columns.items()}


def _unit(text: str) -> str:
    """Return the unit in the description of a column."""
    return text.partition("(")[2].partition(")")[0]


def _file_name(table: Table, positions: Mapping[str, SupportsFloat], written: Collection[str] = ()) -> str:
    """Return the name that the comparison uses, with positions in 100 m.

    It is the name of the instrument if the positions are no multiples of 100 m, or if another receiver has this place.
    """
    shares = {key: float(value) / GRID for key, value in positions.items()}
    numbers = {key: round(share) for key, share in shares.items()}
    name = "".join(f"{key}{number:0{4 if number < 0 else 3}d}" for key, number in numbers.items()) + ".txt"
    off_grid = any(abs(share - numbers[key]) > FLAT for key, share in shares.items())
    return f"{table['name']}.txt" if off_grid or name in written else name


def _series(
    record: Record, path: Path, place: str, columns: Mapping[Column, Array], data: Data,
    more: Mapping[str, str] | None = None,
) -> Path:  # fmt: skip
    """Write time series of one place."""
    times = data["time"].values
    step = f"{times[1] - times[0]:.9g} s" if len(times) > 1 else "unknown"
    entries = {"time_step": step, "num_time_steps": str(len(times)), "location": place, **(more or {})}
    return _write(record, path, entries, (TIME, *columns), np.column_stack([times, *columns.values()]))


def _write(record: Record, path: Path, entries: dict[str, str], columns: tuple[Column, ...], rows: Array) -> Path:
    """Write the header, the names of the fields, and the numbers."""
    case = record.case
    size = case.get("mesh", {}).get("element_size")
    order = case.get("order", 1)
    spacing = "unknown" if size is None else f"{size:g} m, order {order} (nodes {size / order:g} m apart)"
    head = {
        "problem": case.get("title") or record.path.name, "author": "to be filled in",
        "date": f"{date.today():%Y/%m/%d}", "code": "ruptfx", "code_version": __version__, "element_size": spacing,
        **entries,
    }  # fmt: skip
    lines = [f"# {key} = {value}" for key, value in head.items()]
    lines += [f"# Column #{number} = {column.text}" for number, column in enumerate(columns, 1)]
    lines += ["# The line below lists the names of the data fields:", " ".join(column.field for column in columns)]
    formats = ["%21.13E", *["%15.7E"] * (len(columns) - 1)]
    # Adding zero removes the sign of -0.0.
    np.savetxt(path, rows + 0.0, fmt=formats, header="\n".join(lines), comments="")
    return path
