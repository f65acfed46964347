"""Statistics of a catalogue of events in one figure."""

from __future__ import annotations

from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ruptfx import RuptfxError
from ruptfx.results.analysis.emission import BValue, Catalogue, FractalDimension, Omori, b_against_completeness
from ruptfx.results.figure_style import GUIDE, MUTED, STICK_SLIP, letter, new_figure, note, remark, scale, styled

LARGEST_MARK = 60.0  # points^2


@styled
def catalogue_statistics(
    catalogue: Catalogue,
    b: BValue | RuptfxError,
    D: FractalDimension | RuptfxError | None,
    p: Omori | RuptfxError | None = None,
    failure_time: float | None = None,
) -> Figure:
    """Draw positions, magnitudes, spatial correlation and rate of events.

    A failed estimate is passed as its exception, whose message replaces the fit.

    Parameters
    ----------
    catalogue : Catalogue
        Seismic events.
    b, D, p : estimates, or the exceptions of failed ones
    failure_time : float, optional
        Reference time of the rate [s]; without it the rate is that over the whole record.
    """
    figure, axes = new_figure(2, 2, 5.6)
    places(axes[0, 0], catalogue)
    sizes(axes[0, 1], catalogue, b)
    pairs(axes[1, 0], D)
    rates(axes[1, 1], catalogue, p, failure_time)
    letter(axes.flat)
    M = catalogue.magnitude
    remark(
        figure,
        f"{len(catalogue)} events of magnitude {M.min():.3g} to {M.max():.3g}; circles grow with magnitude, "
        "bars are standard errors.",
    )
    return figure


def places(ax: Axes, catalogue: Catalogue) -> None:
    """Draw the positions of events; circles grow with magnitude."""
    size, unit = scale(np.concatenate([catalogue.x, catalogue.y]), "m")
    M = catalogue.magnitude
    span = max(float(np.ptp(M)), 1.0)
    area = 1 + (LARGEST_MARK - 1) * np.clip(1 + (M - M.max()) / span, 0, 1) ** 2
    ax.scatter(catalogue.x / size, catalogue.y / size, area, facecolors="none", edgecolors=STICK_SLIP, linewidths=0.5)
    ax.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")


def sizes(ax: Axes, catalogue: Catalogue, b: BValue | RuptfxError) -> None:
    """Draw the number of events above each magnitude, b, and its range over magnitudes of completeness."""
    M = np.sort(catalogue.magnitude)
    ax.semilogy(M, np.arange(len(M), 0, -1), ".", color="#1a1a1a", ms=2.5)
    ax.set(xlabel="Magnitude M", ylabel="Number of events ≥ M")
    if isinstance(b, RuptfxError):
        ax.set_title(f"no b: {_folded(b)}", fontsize=6, color=MUTED, loc="right")  # points fill the panel
        return
    line = np.array([b.completeness - b.bin / 2, M[-1]])
    ax.semilogy(line, b.count * 10 ** (-b.b * (line - line[0])), color=GUIDE, label=f"b = {b.b:.2f} ± {b.error:.2f}")
    ax.axvline(b.completeness, color=MUTED, lw=0.6, ls=":", label=f"M_c = {b.completeness:.2f}")
    against = b_against_completeness(catalogue.magnitude)
    if len(against) > 1:
        least, most = (extreme(each.b for each in against) for extreme in (min, max))
        ax.plot([], [], " ", label=f"{least:.2f} to {most:.2f} for other M_c")
    ax.legend(loc="lower left")


def pairs(ax: Axes, D: FractalDimension | RuptfxError | None) -> None:
    """Draw the correlation integral and its slope."""
    ax.set(xlabel="Distance r (m)", ylabel="Fraction of pairs < r")
    if D is None or isinstance(D, RuptfxError):
        _why(ax, D or "not asked for")
        return
    size, unit = scale(D.radius, "m")
    ax.loglog(D.radius / size, D.correlation, "o", color="#1a1a1a", ms=3)
    middle = np.exp(np.mean(np.log(D.correlation)))
    centre = np.exp(np.mean(np.log(D.radius)))
    ax.loglog(D.radius / size, middle * (D.radius / centre) ** D.D, color=GUIDE, label=f"D = {D.D:.2f} ± {D.error:.2f}")
    ax.set_xlabel(f"Distance r ({unit})")
    for axis in (ax.xaxis, ax.yaxis):  # less than two decades: powers of ten alone are too few labels
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    ax.legend(loc="upper left")


def rates(ax: Axes, catalogue: Catalogue, p: Omori | RuptfxError | None, failure_time: float | None) -> None:
    """Draw events per second before the failure, or over the whole record."""
    if failure_time is None:
        size, unit = scale(catalogue.time, "s")
        counts, limits = np.histogram(catalogue.time, 40)
        ax.stairs(counts / np.diff(limits) * size, limits / size, color="#1a1a1a")
        ax.set(xlabel=f"Time ({unit})", ylabel=f"Number of events per {unit}")
        return
    before = failure_time - catalogue.time
    before = before[before > 0]
    if not len(before):
        note(ax, "no event before the failure")
        return
    limits = np.geomspace(max(before.min(), 1e-3 * before.max()), before.max(), 16)
    counts, _ = np.histogram(before, limits)
    size, unit = scale(before, "s")
    middle = np.sqrt(limits[1:] * limits[:-1])
    seen = counts > 0
    ax.loglog(middle[seen] / size, (counts / np.diff(limits))[seen], "o", color="#1a1a1a", ms=3)
    ax.set(xlabel=f"Time to failure ({unit})", ylabel="Number of events per second")
    if isinstance(p, Omori):
        ax.loglog(limits / size, p.rate(limits), color=GUIDE, label=f"p = {p.p:.2f} ± {p.error:.2f}")
        ax.legend(loc="lower left")
    elif p is not None:
        _why(ax, p)


def _why(ax: Axes, error: RuptfxError | str) -> None:
    """Write the reason of a missing estimate into a panel."""
    note(ax, _folded(error))


def _folded(error: RuptfxError | str) -> str:
    """Return the message of an error, wrapped to the width of a panel."""
    return fill(str(error), 38)
