"""Figure of the largest speed at the points of grids of receivers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from ruptfx.results.analysis.ground_motion import speeds_of
from ruptfx.results.figure_style import RATE_MAP, Array
from ruptfx.results.plots._sheet import Sheet, figure
from ruptfx.results.record import Data, Files

NEAR = 1e-6  # of the extent of a grid: distance of a point of an interface that is drawn on it


def suits(record: Files) -> bool:
    """Return whether the run has grids of receivers on a line or a plane that record the velocity."""
    return bool(_grids(record)) and (record.path / "instruments.h5").is_file()


@figure
def ground_motion(sheet: Sheet, record: Files, *, field: str | Sequence[str] | None = None) -> None:
    """Draw the peak ground velocity: the largest length of the velocity of every point, as a map or along a line.

    Parameters
    ----------
    field
        Names of grids of receivers. Default: all.
    """
    grids = {name: record.instruments[name] for name in sheet.choose(field, _grids(record))}
    if not any(data.sizes["time"] for data in grids.values()):
        sheet.empty("no sample was saved")
        return
    shapes = [_sides(data) for data in grids.values()]
    heights = [2.2 if len(sides) < 2 else float(np.clip(0.9 + 5.6 * sides[1][1] / sides[0][1], 1.8, 6.0))
               for sides in shapes]  # fmt: skip
    axes = sheet.panels(len(grids), 1, sum(heights), height_ratios=heights)
    for ax, (name, data), sides in zip(axes[:, 0], grids.items(), shapes, strict=True):
        peak = speeds_of(data).max(axis=0)
        size, unit = sheet.scale("velocity", peak, "m/s")
        label = f"Peak velocity ({unit})"
        lengths, metre = sheet.scale("x", max(extent for _, extent in sides), "m")
        first = data[sides[0][0]].values / lengths
        if len(sides) == 1:
            ax.plot(first, peak / size)
            ax.set_ylabel(label)
        else:
            second = data[sides[1][0]].values / lengths
            columns, rows = np.unique(first), np.unique(second)
            table = np.empty((len(rows), len(columns)))
            table[np.searchsorted(rows, second), np.searchsorted(columns, first)] = peak / size
            drawn = ax.pcolormesh(columns, rows, table, norm=Normalize(0, table.max() or 1.0), cmap=RATE_MAP,
                                  shading="gouraud", rasterized=True)  # fmt: skip
            sheet.figure.colorbar(drawn, ax=ax, label=label)
            _draw_interfaces(ax, record, data, [axis for axis, _ in sides], lengths)
            ax.set(aspect="equal", ylabel=f"{sides[1][0]} ({metre})")
        ax.set_xlabel(f"{sides[0][0]} ({metre})")
        ax.set_title(name, loc="right")
    sheet.letter(axes[:, 0])
    sheet.remark("Largest length of the velocity among the samples.")


def _grids(record: Files) -> list[str]:
    """Return the names of the grids that are drawn."""
    tables = [table for table in record.case.get("instruments", []) if table["kind"] == "receiver_grid"]
    grids = []
    for table in tables:
        apart = sum(first != last for first, last in zip(table["corner"], table["opposite"], strict=True))
        if apart in (1, 2) and "velocity" in table.get("fields", ["velocity"]):
            grids.append(str(table["name"]))
    return grids


def _sides(data: Data) -> list[tuple[str, float]]:
    """Return the axes along which a grid extends, and how far [m]."""
    extents = [(axis, float(np.ptp(data[axis].values))) for axis in ("x", "y", "z") if axis in data]
    return [(axis, extent) for axis, extent in extents if extent > 0]


def _draw_interfaces(ax: Axes, record: Files, data: Data, axes: list[str], size: float) -> None:
    """Draw the points of the interfaces that are in the plane of a grid."""
    extent = max(np.ptp(data[axis].values) for axis in axes)
    for interface in record.interfaces.values():
        points: dict[str, Array] = {axis: interface[axis].values for axis in ("x", "y", "z") if axis in interface}
        near = np.ones(len(points["x"]), dtype=bool)
        for axis, values in points.items():
            bounds = data[axis].values
            slack = NEAR * extent
            near &= (values >= bounds.min() - slack) & (values <= bounds.max() + slack)
        if near.any():
            line = [points[axis][near] / size for axis in axes]
            order = np.argsort(line[0] if np.ptp(line[0]) >= np.ptp(line[1]) else line[1])
            ax.plot(line[0][order], line[1][order], color="#1a1a1a", lw=0.8)
