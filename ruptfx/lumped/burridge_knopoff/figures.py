"""Figures of the Burridge-Knopoff chain: events in space and time, and their size distribution."""

from __future__ import annotations

import numpy as np
import xarray
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from ruptfx.results.figure_style import RATE_MAP, STEADY, STICK_SLIP, letter, new_figure, remark, styled


def figures(dataset: xarray.Dataset) -> dict[str, Figure]:
    """Draw all figures of a result."""
    return {"events": events(dataset), "sizes": sizes(dataset)}


@styled
def events(dataset: xarray.Dataset) -> Figure:
    """Draw the mean force of the leaf springs, and the extent of events along the chain, against time."""
    figure, grid = new_figure(2, 1, 4.6, sharex=True)
    top, bottom = grid[:, 0]
    top.plot(np.repeat(dataset.time, 2), dataset.force.values.ravel(), color="#1a1a1a", lw=0.6)
    top.set(ylabel="Mean force (N)", xlim=(0, float(dataset.time[-1]) or 1.0))
    slid = dataset.slip.values > 0
    low, high = slid.argmax(axis=1), slid.shape[1] - slid[:, ::-1].argmax(axis=1)
    largest = float(dataset.moment.max()) * 1e3
    shades = ScalarMappable(LogNorm(1e-5 * largest, largest), RATE_MAP)
    bottom.vlines(dataset.time, low, high, colors=shades.to_rgba(dataset.moment * 1e3), lw=0.6, rasterized=True)
    bottom.set(xlabel="Time (s)", ylabel="Number of the block", ylim=(0, slid.shape[1]))
    figure.colorbar(shades, ax=bottom, label="Slip of all blocks (mm)", extend="min", pad=0.02)
    remark(figure, "The drive stands still during an event.")
    letter(grid[:, 0])
    return figure


@styled
def sizes(dataset: xarray.Dataset) -> Figure:
    """Draw number of events against magnitude with counting errors, and slip against the number of blocks."""
    figure, (axes,) = new_figure(1, 2, 2.7)
    count = dataset["count"].values
    seen = count > 0
    magnitude = dataset.magnitude.values[seen]
    axes[0].errorbar(magnitude, count[seen], np.minimum(np.sqrt(count[seen]), 0.999 * count[seen]), fmt="o",
                     color=STEADY, capsize=2)  # fmt: skip
    axes[0].set(xlabel="Magnitude ln(slip of all blocks / (strength / stiffness))", yscale="log",
                ylabel="Number of events per 0.5", ylim=(0.5, None))  # fmt: skip
    axes[1].loglog(dataset.blocks, dataset.moment * 1e3, ".", color=STICK_SLIP, ms=2)
    axes[1].set(xlabel="Number of blocks that slip", ylabel="Slip of all blocks (mm)")
    remark(figure, "Bars: square root of the number.")
    letter(axes)
    return figure
