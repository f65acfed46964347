"""Figure of the arrival of the rupture and its speed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ruptfx.analysis.front import local_speed
from ruptfx.figure_style import GUIDE, Array, letter, new_figure, note, remark, scale, styled
from ruptfx.plots._record import along, end_time, guides, has_slip_rates, is_uneven, whose_speeds
from ruptfx.record import Files


def suits(record: Files) -> bool:
    """Whether the run slides and one scale of time shows it."""
    return has_slip_rates(record) and not is_uneven(record)


@styled
def front(record: Files) -> Figure:
    """Arrival of the rupture and its local speed along the interface, with the wave speeds.

    The speed is the slope of a least-squares line through the arrivals in a window of 5 % of the interface; a window
    with fronts in both directions, as around an inner origin, has none. A panel without a speed says why.
    """
    data = record.interface
    position, arrival = data["position"].values, data["rupture_time"].values
    (x_size, x_unit), (t_size, t_unit) = scale(np.ptp(position), "m"), scale(end_time(record), "s")
    figure, (axes,) = new_figure(1, 2, 2.6, sharex=True)
    axes[0].plot(position / x_size, arrival / t_size, color="#1a1a1a")
    axes[0].set(xlabel=along(record, x_size, x_unit), ylabel=f"Rupture time ({t_unit})")
    axes[0].set_xlim(position[0] / x_size, position[-1] / x_size)
    speeds = guides(record)
    fastest = max((guide.speed for guide in speeds), default=1.0)
    size, unit = (1e3, "km/s") if fastest > 900 else scale(fastest, "m/s")
    local = np.abs(local_speed(position, arrival, 0.05 * np.ptp(position)))
    local[_both_ways(position, arrival, 0.05 * np.ptp(position))] = np.nan
    together = local > 3 * fastest
    local[together] = np.nan
    shown = np.append(local[np.isfinite(local)], 0.0)
    axes[1].plot(position / x_size, local / size, ".-", ms=2, color="#1a1a1a")  # a point may stand alone
    for name, speed, style in speeds:
        axes[1].axhline(speed / size, ls=style, color=GUIDE, lw=0.8)
        axes[1].annotate(
            name, (1, speed / size), (3, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
            color=GUIDE, va={"$c_s$": "bottom", "$c_R$": "top"}.get(name, "center"), annotation_clip=False,
        )
    axes[1].set(
        xlabel=along(record, x_size, x_unit), ylabel=f"Rupture speed ({unit})",
        ylim=(0, 1.35 * max(fastest, np.quantile(shown, 0.9)) / size),
    )
    if not np.isfinite(arrival).any():
        for ax in axes:
            note(ax, "no sliding")
    elif len(shown) == 1:
        note(axes[1], "no front: the points\nslide at once" if together.any() else "too few points slid\nfor a speed")
    remark(figure, whose_speeds(record))
    letter(axes)
    return figure


def _both_ways(position: Array, arrival: Array, width: float) -> Array:
    """Points about which, in a window, at least a tenth of the arrivals run against the others."""
    middle, step = (position[1:] + position[:-1]) / 2, np.diff(arrival)
    first, last = (np.searchsorted(middle, position + shift) for shift in (-width / 2, width / 2))
    later, earlier = (np.append(0, np.cumsum(way)) for way in (step > 0, step < 0))
    later, earlier = later[last] - later[first], earlier[last] - earlier[first]
    both: Array = (later + earlier > 0) & (np.minimum(later, earlier) >= 0.1 * (later + earlier))
    return both
