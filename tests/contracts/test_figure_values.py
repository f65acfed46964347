"""Contract of the figures: every curve, map and picture shows the numbers of the record, in the units on its axes.

`SHOWN` has, for every figure, what its panels must show in SI units; units on the axes are others than these.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest
from helpers import synthetic
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, QuadMesh
from matplotlib.colors import to_hex
from matplotlib.image import AxesImage

from ruptfx import RuptfxError
from ruptfx.results import plots
from ruptfx.results.figure_style import TIME_MAP
from ruptfx.results.record import Record

Array = np.ndarray
TIME, POSITION = synthetic.times(121), synthetic.points(40)
# Unit of a quantity: another one of its kind, and its size. No two kinds have the same size.
OTHER = {
    "s": ("ns", 1e-9), "m": ("cm", 1e-2), "m/s": ("km/s", 1e3), "Pa": ("GPa", 1e9), "N/m": ("kN/m", 1e3),
    "J/m": ("mJ/m", 1e-3), "N m": ("GN m", 1e9), "N m/s": ("MN m/s", 1e6), "1": ("%", 0.01),
}  # fmt: skip


class Shown(NamedTuple):
    """What an artist shows: a quantity of `units` and SI values along x and y and as colours; "" has no unit."""

    x: tuple[str, Array]
    y: tuple[str, Array]
    colours: tuple[str, Array] | None = None
    close: float = 1e-9


def edges(centres: Array) -> Array:
    return np.array([centres[0], *(0.5 * (a + b) for a, b in pairwise(centres)), centres[-1]])


# -- runs whose fields are all different, and uneven in space and time -----------------------------------------------


def uneven(path: Path) -> Path:
    """Make every field of a run uneven, each in its own way."""
    for number, file in enumerate(sorted(path.glob("*.h5"))):
        with h5py.File(file, "a") as data:

            def change(name: str, item: Any, number: int = number, file: Path = file, data: Any = data) -> None:
                if not isinstance(item, h5py.Dataset) or item.ndim < 2 or item.dtype.kind != "f" or name in SHAPES:
                    return
                random = np.random.default_rng([number, len(name), *map(ord, name[:4])])
                phase = np.linspace(0, 1, item.shape[1])
                if file.name == "bulk.h5":
                    phase = np.asarray(data["points"]) @ [10.0, 30.0]
                along = 1 + 0.1 * np.sin(random.uniform(3, 6) * phase)
                in_time = 1 + 0.1 * np.sin(np.linspace(0, random.uniform(3, 6), item.shape[0]))
                factor = np.multiply.outer(in_time, along)
                item[...] *= factor.reshape(factor.shape + (1,) * (item.ndim - 2))

            data.visititems(change)
            for name in ("slip", "slip_rate"):  # else the size is that of one component
                if f"{name}_2" in data:
                    data[f"{name}_2"][...] = 0.6 * data[f"{name}_1"][...]
            if file.name == "bulk.h5":  # as above
                velocity = data["velocity"][...]
                velocity[..., 0] = 0.7 * velocity[..., -1]
                data["velocity"][...] = velocity
    return path


SHAPES = ("points", "cells", "lines", "displacement")


def write(path: Path, kind: str) -> Path:
    if kind in ("surface", "line of receivers", "sliding surface"):
        return uneven(synthetic.write_surface_run(path, branch=kind == "surface", slides=kind == "sliding surface"))
    crack = synthetic.crack(TIME, POSITION)
    if kind == "cycles":
        resting = np.full((20, len(POSITION)), 1e-9)
        steps = [(resting, 0.5), (crack, TIME[1]), (resting, 0.5)]
        time = np.cumsum(np.concatenate([np.full(len(field), step) for field, step in steps]))
        return uneven(synthetic.write_run(path, np.concatenate([field for field, _ in steps]), time, POSITION))
    written = uneven(synthetic.write_run(path, crack, TIME, POSITION, slides=kind == "slides", wet=kind == "wet"))
    if kind == "broken":
        synthetic.write_cracks(path, failed=120)
    return written


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Record]]:
    folder, opened = tmp_path_factory.mktemp("runs"), dict[str, Record]()

    def record(kind: str) -> Record:
        if kind not in opened:
            opened[kind] = Record(write(folder / kind, kind))
        return opened[kind]

    yield record
    for each in opened.values():
        each.close()


# -- what the figures must show --------------------------------------------------------------------------------------


def at_row(record: Record, time: float) -> int:
    return int(np.argmin(np.abs(record.interface["time"].values - time)))


def space_time(record: Record) -> list[list[Shown]]:
    data = record.interface
    grid = ("x", edges(data["position"].values)), ("time", edges(data["time"].values))
    return [[Shown(*grid, ("slip", data["slip"].values))]]


def space_time_of_rates(record: Record) -> list[list[Shown]]:
    """Where points slide faster than 2 % of the speed of the driven edge, 2 m/s."""
    data = record.interface
    grid = ("x", edges(data["position"].values)), ("time", edges(data["time"].values))
    rate = np.abs(data["slip_rate"].values)
    return [[Shown(*grid, ("slip_rate", np.where(rate < 0.04, np.nan, rate)))]]


def contact(record: Record) -> list[list[Shown]]:
    data = record.interface
    grid = ("x", edges(data["position"].values)), ("time", edges(data["time"].values))
    return [[Shown(*grid, ("", data["contact"].values.astype(float)))]]


def energy_budget(record: Record) -> list[list[Shown]]:
    energy, time = record.energy, ("time", record.energy["time"].values)
    names = ("boundary_work", "kinetic", "strain", "interface_elastic", "frictional_dissipation", "damping")
    values = {name: energy[name].values for name in names}
    left_over = values["boundary_work"] - sum(values[name] for name in names[1:])
    closure = 100 * np.abs(left_over) / values["boundary_work"].max()
    return [
        [Shown(time, ("energy", values[name])) for name in names],
        [Shown(time, ("", np.maximum(closure, 1e-14)), close=1e-6)],
    ]


def forces(record: Record) -> list[list[Shown]]:
    table, time = record.forces, ("time", record.forces["time"].values)
    shear = ("force", table["shear_force"].values)  # and its mean over 1/200 of the run, less than a step
    return [[Shown(time, ("force", table["normal_force"].values)), Shown(time, shear, close=0.01)]]


def instruments(record: Record) -> list[list[Shown]]:
    """A panel for each unit."""
    panels = []
    for name, channel, quantity in (("point", "velocity_y", "velocity"), ("point", "strain_xy", "strain"),
                                    ("cell", "force_x", "force")):  # fmt: skip
        data = record.instruments[name]
        panels.append([Shown(("time", data["time"].values), (quantity, data[channel].values))])
    return panels


def slip_profiles(record: Record) -> list[list[Shown]]:
    data, rows = record.interface, [at_row(record, time) for time in AT]
    return [[Shown(("x", data["position"].values), (name, data[name].values[row])) for row in rows]
            for name in ("slip", "displacement_jump")]  # fmt: skip


def fluid_front(record: Record) -> list[list[Shown]]:
    """The farthest points from the well at 0.03 m that have had 2 % of the largest rise and of the largest slip."""
    data, fronts = record.interface, []
    away = np.abs(data["position"].values - data["position"].values[np.argmin(np.abs(data["position"].values - 0.03))])
    pressure = data["pore_pressure"].values
    for values in (np.maximum(pressure - pressure[0], 0.0), np.abs(data["slip"].values)):
        rows = [away[values[: row + 1].max(axis=0) >= 0.02 * values.max()] for row in range(len(values))]
        fronts.append(np.array([row.max() if len(row) else np.nan for row in rows]))
    return [[Shown(("time", data["time"].values), ("distance", front)) for front in fronts]]


def snapshots(record: Record) -> list[list[Shown]]:
    data = record.interface
    return [[Shown(("x", data["position"].values), (name, data[name].values[at_row(record, time)]))]
            for time in AT for name in ("slip_rate", "shear_traction", "normal_stress")]  # fmt: skip


def surfaces(record: Record) -> list[list[Shown]]:
    data, panels = record.interface, []
    for row in (at_row(record, time) for time in AT):
        across = ("x", data["deformed_x"].values[row])
        names = ("normal_stress", "shear_traction")
        panels.append([Shown(across, ("traction", data[name].values[row])) for name in names])
        points = across, ("y", data["deformed_y"].values[row])
        opposite = ("x", data["paired_x"].values[row]), ("y", data["paired_y"].values[row])
        panels.append([Shown(*opposite), Shown(*points), Shown(*points)])
    return panels


def front(record: Record) -> list[list[Shown]]:
    data = record.interface
    return [[Shown(("x", data["position"].values), ("time", data["rupture_time"].values))]]


def cycles(record: Record) -> list[list[Shown]]:
    data, time = record.interface, ("time", record.interface["time"].values)
    shear, rate = data["shear_traction"].values, np.abs(data["slip_rate"].values)
    widths = np.diff(data["position"].values)
    force = (0.5 * (shear[:, 1:] + shear[:, :-1]) * widths).sum(axis=1)
    grid = ("x", edges(data["position"].values)), ("time", edges(data["time"].values))
    fast = time[1][rate.max(axis=1) > 1e-3]  # of the only rupture, from half of the way of the front before it starts
    ahead = (rate > 0.02 * rate.max()) & (time[1] >= fast[0])[:, None]
    began, crossed = (find(time[1][ahead.argmax(axis=0)[ahead.any(axis=0)]]) for find in (np.min, np.max))
    shown = np.abs(time[1] - 0.5 * (began + crossed)) <= crossed - began
    shown &= (time[1] >= fast[0]) & (time[1] <= fast[-1])
    since = ("rupture_time", edges(time[1][shown] - time[1][shown][0]))
    return [
        [Shown(time, ("force", force))],
        [Shown(time, ("", np.where(rate.max(axis=1) > 0, rate.max(axis=1), np.nan)))],
        [Shown(*grid, ("", np.maximum(rate, max(1e-10, 1e-10 * rate.max()))))],
        [Shown(grid[0], since, ("", np.maximum(rate[shown], 1e-3)))],
    ]


def moment_rate(record: Record) -> list[list[Shown]]:
    """The moment rate of every step, and 32 GPa times the area times slip: of all surfaces, then of each."""
    steps, time = np.linspace(0.0, 10.0, 123), record.interface["time"].values
    rates = [1e18 * steps, 3e18 * steps**2]
    moments = [32e9 * np.hypot(data["slip_1"].values, data["slip_2"].values) @ data["area"].values
               for data in record.interfaces.values()]  # fmt: skip
    return [
        [Shown(("time", when), (quantity, values)) for values in (np.sum(each, axis=0), *each)]
        for quantity, when, each in (("moment_rate", steps, rates), ("moment", time, moments))
    ]


def on_surfaces(record: Record, field: str, row: int) -> list[list[Shown]]:
    panels = []
    for data in record.interfaces.values():
        strike, dip = (np.unique(data[name].values) for name in ("position", "dip"))
        size = np.hypot(data[f"{field}_1"].values[row], data[f"{field}_2"].values[row])
        table = np.empty((len(dip), len(strike)))
        table[np.searchsorted(dip, data["dip"].values), np.searchsorted(strike, data["position"].values)] = size
        panels.append([Shown(("x", strike), ("x", dip), (field, table))])
    return panels


def contact_maps(record: Record) -> list[list[Shown]]:
    """Pressure and states of the last record, and the size of slip where the contact is closed."""
    data = record.interface
    strike, dip = (np.unique(data[name].values) for name in ("position", "dip"))
    place = np.searchsorted(dip, data["dip"].values), np.searchsorted(strike, data["position"].values)

    def table(values: Array) -> Array:
        rows = np.empty((len(dip), len(strike)))
        rows[place] = values
        return rows

    states = data["contact"].values[-1].astype(int)
    slip = np.where(states % 3 != 0, np.hypot(data["slip_1"].values[-1], data["slip_2"].values[-1]), 0.0)
    return [
        [Shown(("x", strike), ("x", dip), ("traction", table(np.maximum(data["normal_stress"].values[-1], 0.0))))],
        [Shown(("x", edges(strike)), ("x", edges(dip)), ("", table(states)))],
        [Shown(("x", strike), ("x", dip), ("slip", table(slip)))],
    ]


def ground_motion(record: Record) -> list[list[Shown]]:
    data = record.instruments["ground"]
    peak = np.sqrt(sum(np.square(data[f"velocity_{axis}"].values) for axis in "xyz")).max(axis=0)
    x, y = (np.unique(data[axis].values) for axis in "xy")
    table = np.empty((len(y), len(x)))
    table[np.searchsorted(y, data["y"].values), np.searchsorted(x, data["x"].values)] = peak
    return [[Shown(("x", x), ("x", y), ("velocity", table))]]


def picture(values: Array, record: Record, quantity: str, close: float = 0.02) -> list[list[Shown]]:
    """An image of values at the points of the bodies."""
    points = record.bulk["points"].values
    return [[Shown(("x", points[:, 0]), ("x", points[:, 1]), (quantity, values), close)]]


def fringes(record: Record) -> list[list[Shown]]:
    """Dark field: sin^2(pi N) with N = fringe times thickness over 22.6 kN/m."""
    row = int(np.argmin(np.abs(record.bulk["time"].values - AT[0])))
    order = record.bulk["fringe"].values[row] * 9.5e-3 / 22.6e3
    return picture(np.sin(np.pi * order) ** 2, record, "", 0.1)


def wavefield(record: Record) -> list[list[Shown]]:
    row = int(np.argmin(np.abs(record.bulk["time"].values - AT[0])))
    return picture(np.hypot(*record.bulk["velocity"].values[row].T), record, "field")


def material_state(record: Record) -> list[list[Shown]]:
    """The label has a power of ten."""
    return picture(1e4 * record.bulk["plastic_strain"].values[-1], record, "")


def cracks(record: Record) -> list[list[Shown]]:
    events, edge = record.events, record.edges
    x, y, when = (events[name].values for name in ("x", "y", "time_of_failure"))
    first = int(np.argmin(when))
    order = np.random.default_rng(0).permutation(len(when))
    away, since = np.hypot(x - x[first], y - y[first])[order], (when - when[first])[order]
    points = record.cracks["points"].values
    lines, status = points[record.cracks["lines"].values], record.cracks["status"].values[-1]
    return [
        [Shown(("x", some[..., 0].ravel()), ("x", some[..., 1].ravel())) for some in (lines, lines[status == 2])],
        [Shown(("displacement", edge["rock.top.displacement_y"].values), ("force", edge["rock.top.force_y"].values))],
        [Shown(("time", since), ("distance", away))],
    ]


def emission(record: Record) -> list[list[Shown]]:
    """Numbers of failures in time; failed facets, and the events that radiate, by mode."""
    events, cracks = record.events, record.cracks
    when = np.sort(events["time_of_failure"].values)
    x, y, mode = (events[name].values[events["energy"].values > 0] for name in ("x", "y", "mode"))
    ends = cracks["points"].values[cracks["lines"].values[cracks["status"].values[-1] == 2]].reshape(-1, 2)
    return [
        [Shown(("time", when), ("", np.arange(1.0, len(when) + 1)))],
        [Shown(("x", ends[:, 0]), ("x", ends[:, 1])),
         *(Shown(("x", x[mode == name]), ("x", y[mode == name])) for name in np.unique(mode))],
    ]  # fmt: skip


AT = (30e-6, 50e-6)
# Figure: run, arguments, and what its panels must show.
SHOWN: list[tuple[str, str, dict[str, Any], Callable[[Record], list[list[Shown]]]]] = [
    ("space_time", "slides", {"field": "slip"}, space_time),
    ("space_time", "plain", {}, space_time_of_rates),
    ("contact", "slides", {}, contact),
    ("energy_budget", "plain", {}, energy_budget),
    ("forces", "slides", {"field": "forces"}, forces),
    ("instruments", "plain", {}, instruments),
    ("slip_profiles", "plain", {"at": AT}, slip_profiles),
    ("fluid_front", "wet", {}, fluid_front),
    ("snapshots", "plain", {"at": AT}, snapshots),
    ("surfaces", "slides", {"at": AT}, surfaces),
    ("front", "plain", {"field": "rupture_time"}, front),
    ("cycles", "cycles", {}, cycles),
    ("moment_rate", "surface", {}, moment_rate),
    ("slip_rate_maps", "surface", {"at": 6.0}, lambda record: on_surfaces(record, "slip_rate", at_row(record, 6.0))),
    ("slip_rate_maps", "surface", {"at": 6.0, "field": "slip"},
     lambda record: on_surfaces(record, "slip", at_row(record, 6.0))),
    ("rupture_map", "surface", {}, lambda record: on_surfaces(record, "slip", -1)),
    ("contact_maps", "sliding surface", {}, contact_maps),
    ("ground_motion", "line of receivers", {}, ground_motion),
    ("fringes", "plain", {"at": AT[0]}, fringes),
    ("wavefield", "plain", {"at": AT[0]}, wavefield),
    ("material_state", "plain", {}, material_state),
    ("cracks", "broken", {}, cracks),
    ("emission", "broken", {"field": ["load", "map"]}, emission),
]  # fmt: skip


def test_every_figure_is_here() -> None:
    assert {name for name, *_ in SHOWN} == set(plots.FIGURES)


def read(artist: Any) -> tuple[Array, Array, Array | None] | None:
    """Return x, y and colours of an artist, None for guides: lines of two points, and marks of few facets."""
    if isinstance(artist, QuadMesh):
        places = artist.get_coordinates()
        return places[0, :, 0], places[:, 0, 1], np.ma.filled(np.ma.asarray(artist.get_array(), float), np.nan)
    if isinstance(artist, AxesImage):
        ends = np.array(artist.get_extent())
        return ends[:2], ends[2:], np.ma.filled(artist.get_array(), np.nan)
    if isinstance(artist, LineCollection):
        points = np.concatenate([np.asarray(part) for part in artist.get_segments()] or [np.zeros((0, 2))])
        return (points[:, 0], points[:, 1], None) if len(points) else None
    if isinstance(artist, PathCollection):
        return (*np.ma.filled(artist.get_offsets(), np.nan).T, None)
    if hasattr(artist, "get_xdata") and len(artist.get_xdata()) > 2 and artist.get_gid() != "sliding":
        return np.asarray(artist.get_xdata(), float), np.asarray(artist.get_ydata(), float), None
    return None


def artists(ax: Axes) -> list[tuple[Array, Array, Array | None]]:
    kinds = (*ax.images, *ax.collections, *ax.lines)
    return [values for values in map(read, kinds) if values is not None]


def compare_image(values: tuple[Array, Array, Array | None], expected: Shown, size: dict[str, float]) -> None:
    """Compare the pixels of an image with the values at the nearest points."""
    assert values[2] is not None and expected.colours is not None
    (x, y), colours = (each[1] / size[each[0]] for each in expected[:2]), expected.colours
    np.testing.assert_allclose([*values[0], *values[1]], [x.min(), x.max(), y.min(), y.max()], rtol=1e-9)
    rows, columns = values[2].shape
    across = x.min() + (np.arange(columns) + 0.5) * np.ptp(x) / columns
    up = y.min() + (np.arange(rows) + 0.5) * np.ptp(y) / rows
    height = 0.4 * np.ptp(np.unique(y)[:2])
    checked = 0
    for point in np.flatnonzero(np.abs(y) > 1e-9)[::7]:  # both bodies have points on the interface
        row, column = int(np.argmin(np.abs(up - y[point]))), int(np.argmin(np.abs(across - x[point])))
        if abs(up[row] - y[point]) > height:
            continue
        wanted = colours[1][point] / size[colours[0]]
        largest = np.abs(colours[1]).max() / size[colours[0]]
        assert values[2][row, column] == pytest.approx(wanted, abs=expected.close * largest)
        checked += 1
    assert checked > 100


@pytest.mark.parametrize(
    "name, kind, options, expected", SHOWN, ids=[f"{name}-{number}" for number, (name, *_) in enumerate(SHOWN)]
)
def test_values(
    name: str, kind: str, options: dict[str, Any], expected: Callable[[Record], list[list[Shown]]],
    records: Callable[[str], Record],
) -> None:  # fmt: skip
    record, draw = records(kind), plots.FIGURES[name]
    with pytest.raises(RuptfxError) as raised:
        draw(record, units={"nothing": "m"}, **options)
    known = dict(re.findall(r"(\w+) \[([^\]]+)\]", str(raised.value)))
    units = {quantity: OTHER[unit][0] for quantity, unit in known.items()}
    size = {"": 1.0, **{quantity: OTHER[unit][1] for quantity, unit in known.items()}}
    axes = draw(record, units=units, **options)
    with Record(record.path) as untouched:
        for key in untouched.interface:
            np.testing.assert_array_equal(record.interface[key], untouched.interface[key], err_msg=str(key))
    panels = [ax for ax in np.atleast_1d(axes).flat if ax.get_visible()]
    wanted = expected(record)
    assert len(panels) == len(wanted)
    used = {pair[0] for panel in wanted for shown in panel for pair in shown[:3] if pair is not None}
    assert used - {""} == set(units) - NOT_DRAWN.get(name, set())
    texts = [text for ax in panels[0].figure.axes for text in (ax.get_xlabel(), ax.get_ylabel())]
    for quantity in used - {""}:
        assert any(f"({units[quantity]})" in text for text in texts), (quantity, texts)
    for number, (ax, panel) in enumerate(zip(panels, wanted, strict=True)):
        drawn = artists(ax)
        lines = [shown for shown in panel if shown.colours is None or not ax.images]
        assert len(drawn) >= len(panel), f"panel {number}"
        for shown in panel:
            if ax.images and shown.colours is not None:
                compare_image(drawn[0], shown, size)
        for places, limits, axis in zip(panel[0][:2], (ax.get_xlim(), ax.get_ylim()), "xy", strict=True):
            inside = places[1][np.isfinite(places[1])] / size[places[0]]
            slack = 1e-9 * np.ptp(limits) + 1e-12
            assert min(limits) - slack <= inside.min() and inside.max() <= max(limits) + slack, (number, axis)
        for shown in lines:
            assert any(agrees(values, shown, size) for values in drawn), f"panel {number}: {shown.y[0]}"
        if not ax.images:
            for values in drawn:
                assert any(agrees(values, shown, size) for shown in panel) or name in EXTRA, f"panel {number}"


NOT_DRAWN = {"contact_maps": {"time"},
             "snapshots": {"time"}, "slip_profiles": {"time"}, "surfaces": {"time"}, "slip_rate_maps": {"time"},
             "fringes": {"time"}, "wavefield": {"time"}, "material_state": {"time"}}  # fmt: skip
"""Quantities of titles and colour bars."""
EXTRA = {"ground_motion", "snapshots", "rupture_map", "slip_rate_maps", "cracks"}
"""Figures with strengths, traces of interfaces, contours and notches besides."""


def agrees(values: tuple[Array, Array, Array | None], shown: Shown, size: dict[str, float]) -> bool:
    for drawn, expected in zip(values, shown[:3], strict=True):
        if (drawn is None) != (expected is None):
            return False
        if drawn is None or expected is None:
            continue
        wanted = expected[1] / size[expected[0]]
        if drawn.shape != wanted.shape or not np.array_equal(np.isnan(drawn), np.isnan(wanted)):
            return False
        scale = np.nanmax(np.abs(wanted))
        if not np.nanmax(np.abs(drawn - wanted)) <= shown.close * scale:
            return False
    return True


def test_lines_have_the_colour_of_their_time(records: Callable[[str], Record]) -> None:
    """From the first colour at the start to the last one at the end, in any unit."""
    record = records("plain")
    ends = [float(time) for time in record.interface["time"].values[[0, -1]]]
    lines = plots.slip_profiles(record, at=ends, field="slip", units={"time": "ns"}).lines
    for line, place in zip(lines, (0.0, 1.0), strict=True):
        np.testing.assert_allclose(line.get_color(), TIME_MAP(place), atol=1e-6)


@pytest.mark.parametrize("name, kind, field, units, expected", [
    ("front", "plain", "rupture_speed", {"rupture_speed": "km/s"}, [1.155, 1.255, np.sqrt(2) * 1.255, 2.2]),
    ("energy_budget", "plain", "closure", {}, [0.1]),
    ("cracks", "broken", "growth", {"time": "ms", "distance": "cm"}, [117.4]),
    ("cycles", "cycles", "largest_rupture", {"x": "cm", "rupture_time": "ms"}, [1 / 220.0, 1 / 125.5]),
])  # fmt: skip
def test_guides(
    name: str, kind: str, field: str, units: dict[str, str], expected: list[float], records: Callable[[str], Record]
) -> None:
    """Lines of two points: wave speeds, the tolerance of the energy budget [%], and slopes of waves."""
    axes = plots.FIGURES[name](records(kind), field=field, units=units)
    drawn = []
    for x, y in (line.get_data() for line in axes.lines if len(line.get_xdata()) == 2):
        drawn.append(y[0] if y[0] == y[1] else (y[1] - y[0]) / (x[1] - x[0]))
    assert sorted(drawn) == pytest.approx(expected, rel=1e-4)


def test_the_rose_has_the_length_of_facets_by_their_direction(records: Callable[[str], Record]) -> None:
    """40 facets each of 10 mm along 0 and 90 degrees and of sqrt(2) times that along 45; at both ends."""
    record = records("broken")
    axes = plots.FIGURES["emission"](record, field="rose")
    unit = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}[axes.get_xlabel()[-3:-1].strip("(")]
    lengths = np.zeros(36)
    for bar in axes.patches:
        lengths[round(np.degrees(bar.get_x()) / 10)] += bar.get_height() * unit
        assert bar.get_width() == pytest.approx(np.radians(10))
    expected = np.zeros(18)
    expected[[0, 9, 4]] = np.array([1.0, 1.0, np.sqrt(2)]) * 40 * 10e-3
    np.testing.assert_allclose(lengths, [*expected, *expected], atol=1e-9)


def test_states_of_contact_have_the_colours_of_the_legend(records: Callable[[str], Record]) -> None:
    """Open 0, sticking 1, sliding 2 and uncovered 3, in the map and at the points of each time."""
    record = records("slides")
    axes: Any = plots.contact(record)
    (states,) = axes.collections
    legend = axes.get_legend()
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["open", "sticking", "sliding", "uncovered"]
    colours = [to_hex(handle.get_facecolor()) for handle in legend.legend_handles]
    assert [to_hex(states.to_rgba(state)) for state in range(4)] == colours
    panels: Any = plots.surfaces(record, at=AT, field="surfaces")
    shown = record.interface["contact"].values[[at_row(record, time) for time in AT]]
    found = [text.get_text() for text in panels.flat[0].get_legend().get_texts()]
    assert found == [name for state, name in enumerate(names) if state in shown]  # what is not drawn is not explained
    for ax, time in zip(panels, AT, strict=True):
        (points,) = ax.collections
        wanted = record.interface["contact"].values[at_row(record, time)]
        assert [to_hex(colour) for colour in points.get_facecolors()] == [colours[state] for state in wanted]
