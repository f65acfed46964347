"""Maps of a surface: strike to the right, dip downwards, equal scales."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh, TriMesh
from matplotlib.colors import Colormap, Normalize
from matplotlib.contour import ContourSet
from matplotlib.tri import Triangulation

from ruptfx.analysis.surface import grid
from ruptfx.figure_style import Array, scale
from ruptfx.plots._sheet import Window, pair
from ruptfx.record import Data

Lengths = tuple[float, str]
"""Size and name of the unit of lengths."""


def draw(
    ax: Axes, data: Data, values: Array, norm: Normalize, colours: Colormap, lengths: Lengths | None = None
) -> QuadMesh | TriMesh:
    """Draw values at the points of a surface as colours."""
    size, _ = lengths or axis_scale(data)
    strike, dip = data["position"].values / size, data["dip"].values / size
    positions = grid(data)
    drawn: QuadMesh | TriMesh
    if positions is None:
        drawn = ax.tripcolor(Triangulation(strike, dip), values, norm=norm, cmap=colours, shading="gouraud")
    else:
        s, d = (each / size for each in positions)
        table = values.reshape(len(s), len(d)).T
        drawn = ax.pcolormesh(s, d, table, norm=norm, cmap=colours, shading="gouraud", rasterized=True)
    ax.set(aspect="equal", xlim=(strike.min(), strike.max()), ylim=(dip.max(), dip.min()))
    return drawn


def contours(
    ax: Axes, data: Data, times: Array, levels: Array, colour: str = "#1a1a1a", style: str = "solid",
    labels: bool = True, lengths: Lengths | None = None,
) -> None:  # fmt: skip
    """Draw contours of times at the points of a surface, every other one with a label; none where they are NaN."""
    size, _ = lengths or axis_scale(data)
    positions = grid(data)
    lines: ContourSet
    look: dict[str, Any] = {"colors": colour, "linewidths": 0.6, "linestyles": style}
    if positions is None:
        triangles = Triangulation(data["position"].values / size, data["dip"].values / size)
        triangles.set_mask(~np.isfinite(times)[triangles.triangles].all(axis=1))
        lines = ax.tricontour(triangles, np.nan_to_num(times), levels, **look)
    else:
        s, d = (each / size for each in positions)
        lines = ax.contour(s, d, np.ma.masked_invalid(times.reshape(len(s), len(d)).T), levels=levels, **look)
    if labels:
        ax.clabel(lines, levels[1::2], fmt="%g", fontsize=6)


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
    return f"{name} ({unit})", f"Down dip ({unit})"


def label(ax: Axes, data: Data, left: bool = True, below: bool = True, lengths: Lengths | None = None) -> None:
    """Label the axes of a map."""
    along, down = axis_names(data, lengths)
    ax.set(xlabel=along if below else "", ylabel=down if left else "")
