"""Figure of the earthquakes of a surface over many cycles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from ruptfx.results.analysis.interface_events import InterfaceEvent, peak_rates
from ruptfx.results.analysis.surface import moment
from ruptfx.results.figure_style import GUIDE, RATE_MAP, Array, edges, letter, new_figure, remark, scale, styled
from ruptfx.results.plots.surface_maps import draw
from ruptfx.results.record import Data

MAPS = 4  # events with a map of their slip
SLOWEST = 1e-12  # m/s


@styled
def surface_catalogue(data: Data, events: Sequence[InterfaceEvent], threshold: float) -> Figure:
    """Draw largest slip rate and moment over time, slip rate along strike at every record, and slip of the last events.

    Parameters
    ----------
    data : Dataset
        `Record.interface` of a surface.
    threshold : float
        Slip rate of events [m/s].
    """
    shown = list(events)[-MAPS:]
    figure, axes = new_figure(2 + (len(shown) + 1) // 2, 2, 4.2 + 1.5 * ((len(shown) + 1) // 2))
    time = data["time"].values
    size, unit = scale(time, "s")
    ax = axes[0, 0]
    ax.semilogy(time / size, np.maximum(peak_rates(data), SLOWEST), color="#1a1a1a", lw=0.7)
    ax.axhline(threshold, color=GUIDE, lw=0.6, ls=":")
    ax.set(xlabel=f"Time ({unit})", ylabel="Largest slip rate (m/s)")
    ax = axes[0, 1]
    moments = np.array([moment(data, row) for row in range(len(time))])
    power = int(np.floor(np.log10(max(float(moments.max()), 1.0))))
    m_size, m_unit = 10.0**power, rf"$10^{{{power}}}$ N m"
    ax.plot(time / size, moments / m_size, color="#1a1a1a", lw=0.8)
    ax.set(xlabel=f"Time ({unit})", ylabel=f"Moment ({m_unit})")
    _along_strike(axes[1, 0], data)
    _magnitudes(axes[1, 1], events, size, unit, float(time[-1]))
    value = np.concatenate([_slip(data, event) for event in shown]) if shown else np.ones(1)
    norm = Normalize(0, float(value.max()))
    for ax, event in zip(axes[2:].flat, shown, strict=False):
        mesh = draw(ax, data, _slip(data, event), norm, RATE_MAP)
        figure.colorbar(mesh, ax=ax, label="Slip (m)", fraction=0.03, pad=0.02)
        length = scale(np.concatenate([data["position"].values, data["dip"].values]), "m")[1]
        ax.set(xlabel=f"Along strike ({length})", ylabel=f"Down dip ({length})")
        ax.set_title(f"{event.time / size:.4g} {unit}, magnitude {event.magnitude:.2f}")
    for ax in axes[2:].flat[len(shown) :]:
        ax.set_visible(False)
    letter([ax for ax in axes.flat if ax.get_visible()])
    text = f"{len(events)} events in which slip is faster than {threshold:g} m/s; (c): records have equal heights."
    remark(figure, text)
    return figure


def _slip(data: Data, event: InterfaceEvent) -> Array:
    change = [
        data[f"slip_{tangent}"].isel(time=event.last).values - data[f"slip_{tangent}"].isel(time=event.first).values
        for tangent in (1, 2)
    ]
    return np.asarray(np.hypot(*change))


def _along_strike(ax: Axes, data: Data) -> None:
    """Draw the largest slip rate down dip against strike, one line per record."""
    strike, place = np.unique(data["position"].values, return_inverse=True)
    largest = np.zeros((data.sizes["time"], len(strike)))
    for row, values in enumerate(largest):
        rate = np.hypot(*(data[f"slip_rate_{tangent}"].isel(time=row).values for tangent in (1, 2)))
        np.maximum.at(values, place, rate)
    size, unit = scale(strike, "m")
    records = np.arange(len(largest))
    mesh = ax.pcolormesh(
        edges(strike) / size, edges(records), np.maximum(largest, SLOWEST), norm=LogNorm(1e-10, 1.0), cmap=RATE_MAP,
        rasterized=True,
    )  # fmt: skip
    ax.figure.colorbar(mesh, ax=ax, label="Slip rate (m/s)", fraction=0.05, pad=0.02)
    ax.set(xlabel=f"Strike ({unit})", ylabel="Record")


def _magnitudes(ax: Axes, events: Sequence[InterfaceEvent], size: float, unit: str, end: float) -> None:
    """Draw the moment magnitude of the events against time."""
    if events:
        magnitudes = np.array([event.magnitude for event in events])
        ax.stem([event.time / size for event in events], magnitudes, linefmt=GUIDE, basefmt=" ")
        ax.set_ylim(bottom=np.floor(magnitudes.min()) - 1)
    ax.set(xlabel=f"Time ({unit})", ylabel="Moment magnitude", xlim=(0, end / size))
