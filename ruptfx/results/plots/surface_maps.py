"""Maps of surfaces: strike to the right, dip downwards, equal scales."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh, TriMesh
from matplotlib.colors import Colormap, Normalize
from matplotlib.contour import ContourSet
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from ruptfx import RuptfxError
from ruptfx.input.schema import nearest
from ruptfx.results.analysis import slides_far
from ruptfx.results.analysis.surface import grid
from ruptfx.results.figure_style import Array, scale
from ruptfx.results.plots._sheet import Sheet, Window, pair
from ruptfx.results.record import Data, Files

Lengths = tuple[float, str]
"""Size and name of the unit of lengths."""

DRAWN, AROUND = 5.6, 0.9  # inch: width of the maps of a line, height of title and labels
LOWEST = 0.95  # inch, height of a map: that of the label of its axis
SLOW = 3.0  # times the median difference of the rupture times of neighbours
TICKS = 6  # intervals down dip, at most
LONG = 3.0  # side of a triangle over the median of the sides at an end, beyond which it is no neighbour
SHORT = 6.0  # mean distances of points


def selected(sheet: Sheet, record: Files, fault: str | Sequence[str] | None) -> dict[str, Data]:
    """Return the surfaces that a figure draws by name, all of them by default.

    Raises
    ------
    RuptfxError
        There is no such fault.
    """
    known = record.interfaces
    wanted = list(known) if fault is None else [fault] if isinstance(fault, str) else list(fault)
    for name in wanted:
        if name not in known:
            raise RuptfxError(f"plots.{sheet.name}: fault = '{name}': {nearest(name, list(known))}")
    return {name: data for name, data in known.items() if name in wanted}


def size_of(data: Data) -> tuple[float, float]:
    """Return the extents of a surface along strike and down dip [m]."""
    return max(float(np.ptp(data["position"].values)), 1e-300), float(np.ptp(data["dip"].values))


def ends_of(data: Data) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ends of a surface along strike and down dip [m]."""
    strike, dip = data["position"].values, data["dip"].values
    return (float(strike.min()), float(strike.max())), (float(dip.min()), float(dip.max()))


def height_in_line(surfaces: Iterable[Data]) -> float:
    """Return the height of maps that fill a line side by side, at one scale [inch]."""
    sizes = [size_of(data) for data in surfaces]
    return DRAWN * max(high for _, high in sizes) / sum(wide for wide, _ in sizes)


def stretch_of(height: float) -> float:
    """Return by how much a map of a height [inch] is stretched down dip, so that its axis has room for a label."""
    return max(1.0, LOWEST / max(height, 1e-3 * LOWEST))


def stretched(stretch: float) -> str:
    """Return the remark on a stretched map; empty for equal scales."""
    return f"Vertical axis stretched {stretch:.2g} times." if stretch > 1 else ""


def panels(sheet: Sheet, surfaces: Mapping[str, Data]) -> tuple[Array, float]:
    """Return a panel for each surface, shape (rows, columns), and by how much maps are stretched down dip.

    Panels are side by side, at one scale of lengths, or below each other if such maps would be low.
    """
    sizes = [size_of(data) for data in surfaces.values()]
    height = height_in_line(surfaces.values())
    if height >= LOWEST or len(sizes) == 1:
        stretch, ratios = stretch_of(height), [wide for wide, _ in sizes]
        return sheet.panels(1, len(sizes), min(AROUND + stretch * height, 6.5), width_ratios=ratios), stretch
    heights = [DRAWN * high / max(wide for wide, _ in sizes) for _, high in sizes]
    stretch = stretch_of(min(heights))
    room = [AROUND + stretch * each for each in heights]
    return sheet.panels(len(sizes), 1, min(sum(room), 8.5), height_ratios=room), stretch


def draw(
    ax: Axes, data: Data, values: Array, norm: Normalize, colours: Colormap, lengths: Lengths | None = None,
    stretch: float = 1.0,
) -> QuadMesh | TriMesh:  # fmt: skip
    """Draw values at the points of a surface as colours; its scale down dip may be stretched."""
    size, _ = lengths or axis_scale(data)
    strike, dip = data["position"].values / size, data["dip"].values / size
    positions = grid(data)
    drawn: QuadMesh | TriMesh
    if positions is None:
        drawn = ax.tripcolor(triangulated(strike, dip), values, norm=norm, cmap=colours, shading="gouraud")
    else:
        s, d = (each / size for each in positions)
        table = values.reshape(len(s), len(d)).T
        drawn = ax.pcolormesh(s, d, table, norm=norm, cmap=colours, shading="gouraud", rasterized=True)
    # Ticks that do not depend on the height of the map: it changes after the layout has made room for their labels.
    ax.yaxis.set_major_locator(MaxNLocator(TICKS, steps=[1, 2, 5, 10]))
    ax.set(aspect=stretch, xlim=(strike.min(), strike.max()), ylim=(dip.max(), dip.min()))
    return drawn


def contours(  # noqa: PLR0913
    ax: Axes, data: Data, times: Array, levels: Array, colour: str = "#1a1a1a", style: str = "solid",
    labels: bool = True, lengths: Lengths | None = None, largest: float = np.inf,
) -> bool:  # fmt: skip
    """Draw contours of times at the points of a surface, every other one with a label; return whether there is one.

    There is none where times are NaN.

    Nor are there contours around neighbours whose times differ by more than `largest`, and pieces of contours that are
    as short as a few points are left out.
    """
    size, _ = lengths or axis_scale(data)
    triangles, values = _triangles(data, times, size)
    apart = _differences(data, triangles, values)
    jumps = np.zeros(len(values), dtype=bool)
    jumps[triangles.triangles[apart > largest]] = True
    left_out = ~np.isfinite(apart) | jumps[triangles.triangles].any(axis=1)
    if triangles.mask is not None:
        left_out |= triangles.mask
    if left_out.all():
        return False
    triangles.set_mask(left_out)
    look: dict[str, Any] = {"colors": colour, "linewidths": 0.6, "linestyles": style}
    lines: ContourSet = ax.tricontour(triangles, np.nan_to_num(values), levels, **look)
    wide, high = size_of(data)
    shortest = SHORT * np.sqrt(wide * high / len(times)) / size
    lines.set_paths([_long_pieces(path, shortest) for path in lines.get_paths()])
    rim = withStroke(linewidth=1.4, foreground="white", alpha=0.5)  # dark lines are on dark colours, too
    lines.set_path_effects([rim])
    if labels:
        for text in ax.clabel(lines, levels[1::2], fmt="%g", fontsize=6):
            text.set_path_effects([rim])
    return any(np.size(path.vertices) for path in lines.get_paths())


def triangulated(x: Array, y: Array) -> Triangulation:
    """Return the triangles between points, without those that bridge a concave part of the outline.

    These have a side much longer than sides usually are at one of its ends. A complete lattice, in any order and graded
    in any way, has no such part.
    """
    triangles = Triangulation(x, y)
    lines = [len(np.unique(np.round((each - each.min()) / (np.ptp(each) or 1.0), 6))) for each in (x, y)]
    if lines[0] * lines[1] == len(x):
        triangles.set_mask(np.zeros(len(triangles.triangles), dtype=bool))
        return triangles
    ends = triangles.edges
    length = np.hypot(np.diff(triangles.x[ends], axis=1), np.diff(triangles.y[ends], axis=1))[:, 0]
    at, of = np.concatenate(ends.T), np.concatenate([length, length])
    order = np.lexsort([of, at])
    count = np.bincount(at, minlength=len(triangles.x))
    middle = np.cumsum(count) - count + np.maximum(count - 1, 0) // 2
    usual = of[order][np.minimum(middle, len(of) - 1)]
    sides = triangles.triangles[:, [[0, 1], [1, 2], [2, 0]]]
    longest = np.hypot(*(np.diff(each[sides], axis=2)[..., 0] for each in (triangles.x, triangles.y)))
    triangles.set_mask((longest > LONG * usual[sides].min(axis=2)).any(axis=1))
    return triangles


def _long_pieces(path: Path, shortest: float) -> Path:
    """Return the connected pieces of a path that are at least so long."""
    if path.codes is None or not np.size(path.vertices):
        return path
    begins = np.flatnonzero(path.codes == Path.MOVETO)
    pieces = zip(np.split(path.vertices, begins[1:]), np.split(path.codes, begins[1:]), strict=True)
    kept = [Path(points, codes) for points, codes in pieces
            if np.hypot(*np.diff(points, axis=0).T).sum() >= shortest]  # fmt: skip
    return Path.make_compound_path(*kept) if kept else Path(np.empty((0, 2)))


def largest_difference(surfaces: Iterable[Data], step: float) -> float:
    """Return the largest difference of the rupture times of neighbours that a front makes [s].

    It is the step of contours, or a multiple of the median difference where the mesh is too coarse for the step.
    """
    apart = np.concatenate([_differences(data, *_triangles(data, data["rupture_time"].values)) for data in surfaces])
    apart = apart[np.isfinite(apart)]
    return max(step, SLOW * float(np.median(apart))) if len(apart) else step


def _differences(data: Data, triangles: Triangulation, values: Array) -> Array:
    """Return the difference of the values within each triangle, or within its rectangle of a grid."""
    apart = np.ptp(values[triangles.triangles], axis=1)
    return apart if grid(data) is None else np.tile(apart.reshape(4, -1).max(axis=0), 4)


def _triangles(data: Data, values: Array, size: float = 1.0) -> tuple[Triangulation, Array]:
    """Return the triangles between the points of a surface, and the values at their vertices.

    A rectangle of a grid has four triangles around its middle, so that contours are as symmetric as the values.
    """
    strike, dip, positions = data["position"].values / size, data["dip"].values / size, grid(data)
    if positions is None:
        return triangulated(strike, dip), values
    number = np.arange(len(strike)).reshape(len(positions[0]), len(positions[1]))
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]).reshape(4, -1)
    middle = len(strike) + np.arange(corners.shape[1])
    x, y, at_vertices = (np.concatenate([each, each[corners].mean(axis=0)]) for each in (strike, dip, values))
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    cells = np.concatenate([np.stack([one, other, middle], axis=1) for one, other in sides])
    return Triangulation(x, y, cells), at_vertices


def axis_scale(data: Data) -> tuple[float, str]:
    """Return size and unit of lengths on a surface."""
    return scale(extent(data), "m")


def extent(data: Data) -> float:
    """Return the larger extent of a surface [m]."""
    return float(max(np.ptp(data["position"].values), np.ptp(data["dip"].values)))


def window(ax: Axes, x: Window | None, lengths: Lengths, title: str) -> None:
    """Limit a map to positions along strike."""
    if x is not None:
        ax.set_xlim(*(None if end is None else end / lengths[0] for end in pair(title, "x", x)))


def axis_names(data: Data, lengths: Lengths | None = None) -> tuple[str, str]:
    """Return the labels of both axes of a map."""
    _, unit = lengths or axis_scale(data)
    name = "x" if data.attrs.get("position_measure") == "x" else "Along strike"
    # The surfaces of sliding contact are horizontal in most cases, and have no dip.
    other = "Across" if slides_far(data) else "Down dip"
    return f"{name} ({unit})", f"{other} ({unit})"


def label(ax: Axes, data: Data, left: bool = True, below: bool = True, lengths: Lengths | None = None) -> None:
    """Label the axes of a map."""
    along, down = axis_names(data, lengths)
    ax.set(xlabel=along if below else "", ylabel=down if left else "")
    if below:  # shared axes leave the numbers out above an empty place of the last row
        ax.tick_params(labelbottom=True)
