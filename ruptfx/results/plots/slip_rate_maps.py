"""Figure of the slip rate on surfaces at several times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import LogNorm, Normalize

from ruptfx import RuptfxError
from ruptfx.input.schema import nearest as nearest_name
from ruptfx.results.analysis.interface_events import peak_rates
from ruptfx.results.analysis.surface import magnitude_of
from ruptfx.results.figure_style import RATE_MAP, Array, scale
from ruptfx.results.plots import surface_maps as _surface
from ruptfx.results.plots._record import chosen, has_surface
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.record import Data, Files

UNITS = {"slip_rate": "m/s", "slip": "m", "shear_traction": "Pa"}
COLUMNS = 2
SLOW = 1e3  # longest over shortest time between records, from which a run has slow times, as cycles have
DECADES, SLOWEST = 1e2, 1e-10  # largest slip rate over the median, and least over the largest, of logarithmic colours
MAPS, NEARLY_ALL = 6, 0.98


def suits(record: Files) -> bool:
    """Return whether the run has a surface and a record."""
    return has_surface(record) and record.interface.sizes["time"] > 0


@figure
def slip_rate_maps(
    sheet: Sheet,
    record: Files,
    *,
    at: float | Sequence[float] | None = None,
    fault: str | Sequence[str] | None = None,
    x: Window | None = None,
    field: str = "slip_rate",
) -> None:
    """Draw the slip rate, or another field, on every surface at several times, with one scale of colours.

    It is logarithmic for the slip rate of runs with slow times, as cycles have, where it spans decades.

    Parameters
    ----------
    at
        Times [s]; the nearest saved ones are drawn. Default: six, the first saved ones after equal parts of the
        ruptured area have ruptured; of cycles those of the fastest rupture.
    fault : str or sequence of str, optional
        Names of surfaces. Default: all.
    field : str
        Tangential field, of which the magnitude is drawn: "slip_rate", "slip", "shear_traction"; or "pore_pressure" and
        "temperature" of a surface that has them.
    """
    surfaces = _surface.selected(sheet, record, fault)
    first = next(iter(surfaces.values()))
    known = [name.removesuffix("_1") for name in map(str, first) if name.endswith("_1")]
    known += [name for name in ("pore_pressure", "temperature") if name in first]
    if field not in known:
        raise RuptfxError(f"plots.slip_rate_maps: field = '{field}': {nearest_name(str(field), known)}")
    saved = first["time"].values
    slow = _is_slow(saved)
    runs = _in_fastest(surfaces) if slow else _after(saved, _while_it_runs(surfaces))
    rows = np.unique(chosen(saved, at, runs[-1:] if sheet.is_given else runs))
    values = {name: [_at(data, field, int(row)) for row in rows] for name, data in surfaces.items()}
    all_values = np.concatenate([each for of_times in values.values() for each in of_times])
    size, unit = sheet.scale(field, all_values, _unit(first, field))
    high = float(np.quantile(all_values, 0.999)) or 1.0
    low = max(float(np.quantile(all_values, 0.01)), SLOWEST * high)
    logarithmic = slow and field == "slip_rate" and high > DECADES * float(np.median(all_values)) > 0
    high = float(all_values.max()) if logarithmic else high
    norm = LogNorm(low / size, high / size) if logarithmic else Normalize(0, high / size)
    # Maps of one time are next to each other, and those of two times where they stay high enough.
    height = _surface.height_in_line(surfaces.values())
    across = min(COLUMNS if height / COLUMNS >= _surface.LOWEST else 1, len(rows))
    stretch, lines = _surface.stretch_of(height / across), -(-len(rows) // across)
    ratios = [_surface.size_of(data)[0] for data in surfaces.values()] * across
    tall = float(np.clip(0.6 + lines * (0.35 + stretch * height / across), 2.0, 8.5))
    several = "" if len(surfaces) == 1 else f" and a fault with fault = {', '.join(map(repr, surfaces))}"
    sheet.one_of(f"choose one time with at = 3.0{several}")
    shared = {"sharex": len(surfaces) == 1, "sharey": len(surfaces) == 1}
    axes = sheet.panels(lines, len(ratios), tall, width_ratios=ratios, **shared)
    t_size, t_unit = sheet.scale("time", float(saved.max()), "s")
    x_scale = sheet.scale("x", max(map(_surface.extent, surfaces.values())), "m")
    panels = [(row, name, number) for number, row in enumerate(rows) for name in surfaces]
    for index, (row, name, number) in enumerate(panels):
        ax, data = axes.flat[index], surfaces[name]
        each = np.maximum(values[name][number] / size, low / size if logarithmic else 0.0)
        drawn = _surface.draw(ax, data, each, norm, RATE_MAP, x_scale, stretch)
        time = f"{saved[row] / t_size:.3g} {t_unit}"
        if slow and row > rows[0]:  # within seconds of each other, decades after the start
            later, later_unit = scale(float(saved[row] - saved[rows[0]]), "s")
            time = f"(a) + {(saved[row] - saved[rows[0]]) / later:.3g} {later_unit}"
        ax.set_title(f"{name}\n{time}" if len(record.interfaces) > 1 else time, loc="right")
        below = index >= len(panels) - len(ratios)
        _surface.label(ax, data, index % len(ratios) == 0, below, x_scale)
        _surface.window(ax, x, x_scale, sheet.name)
    for ax in axes.flat[len(panels) :]:
        ax.set_visible(False)
    label = field.replace("_", " ").capitalize()
    sheet.figure.colorbar(drawn, ax=axes.ravel().tolist(), label=f"{label} ({unit})", shrink=0.7)
    sheet.letter(axes.ravel()[: len(panels)])
    end, largest = f"{high / size:.3g}", f"{all_values.max() / size:.3g}"
    said = f"Colours end at {end} {unit}; the largest value is {largest}." if largest != end else ""
    sheet.remark(said, _surface.stretched(stretch))


def _after(saved: Array, wanted: Array) -> Array:
    """Return the index of the first saved time after each wanted time: points that have just ruptured slip then."""
    return np.asarray(np.minimum(np.searchsorted(saved, wanted, side="right"), len(saved) - 1))


def _is_slow(saved: Array) -> bool:
    """Return whether the times between records differ as those of cycles do."""
    steps = np.diff(saved)
    return len(steps) > 1 and bool(steps.max() > SLOW * steps[steps > 0].min(initial=np.inf))


def _in_fastest(surfaces: Mapping[str, Data]) -> Array:
    """Return the rows of records of the fastest rupture, equidistant in number, with one before it."""
    peaks = np.max([peak_rates(data) for data in surfaces.values()], axis=0)
    fastest = int(np.argmax(peaks))
    threshold = min(float(next(iter(surfaces.values())).attrs["rupture_threshold"]), 0.5 * float(peaks[fastest]))
    still = np.flatnonzero(peaks < threshold)
    first = still[still < fastest].max(initial=0)
    last = still[still > fastest].min(initial=len(peaks) - 1)
    return np.unique(np.linspace(first, last, MAPS).astype(int))


def _while_it_runs(surfaces: Mapping[str, Data]) -> Array:
    """Return six times at which equal parts of the ruptured area have ruptured [s].

    They are those of a sixth to nearly all of it: a few points that rupture late do not count. Without a rupture they
    are equidistant in the whole run.
    """
    arrival = np.concatenate([data["rupture_time"].values for data in surfaces.values()])
    area = np.concatenate([data["area"].values for data in surfaces.values()])
    saved = next(iter(surfaces.values()))["time"].values
    ruptured = np.flatnonzero(np.isfinite(arrival))
    if not len(ruptured):
        return np.linspace(saved.min(), saved.max(), MAPS + 1)[1:]
    order = ruptured[np.argsort(arrival[ruptured], kind="stable")]
    part = np.cumsum(area[order])
    shares = np.append(np.arange(1, MAPS) / MAPS, NEARLY_ALL)
    return np.asarray(np.interp(shares * part[-1], part, arrival[order]))


def _at(data: Data, field: str, row: int) -> Array:
    """Return a field, or the magnitude of a tangential one, at the time of a record."""
    return np.asarray(data[field].values[row]) if field in data else magnitude_of(data, field, row)


def _unit(data: Data, field: str) -> str:
    name = field if field in data else f"{field}_1"
    return str(data[name].attrs.get("units", UNITS.get(field, "1")))
