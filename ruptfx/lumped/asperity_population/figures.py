"""Figures of the asperity population: its velocity steps and hold beside the laws fitted to the steps."""

from __future__ import annotations

import numpy as np
import xarray
from matplotlib.figure import Figure

from ruptfx.results.figure_style import ACCENT, STEADY, STICK_SLIP, letter, new_figure, remark, styled

LAWS = (("ageing", "-", STICK_SLIP), ("slip", "--", STEADY))


def figures(dataset: xarray.Dataset) -> dict[str, Figure]:
    """Draw all figures of a result."""
    return {"population": population(dataset)}


@styled
def population(dataset: xarray.Dataset) -> Figure:
    """Draw velocity steps against slip, steady friction, static friction after the hold, mean age and state."""
    figure, grid = new_figure(2, 2, 4.6, gridspec_kw={"width_ratios": (1.5, 1)})
    steps, steady, ages, holds = grid.ravel()
    slip = dataset.slip * 1e6
    steps.plot(slip, dataset.friction, color="0.6", lw=0.7, label="population")
    steps.plot(slip, dataset.ageing_law, color=STICK_SLIP, label="ageing law")
    steps.plot(slip, dataset.slip_law, "--", color=STEADY, label="slip law")
    top, low = float(dataset.friction.max()), float(dataset.friction.min())
    steps.set(xlabel="Slip (µm)", ylabel="Friction coefficient", ylim=(None, top + 0.2 * (top - low)))
    steps.legend(ncols=3, loc="upper center")
    ends = np.append(np.flatnonzero(np.diff(dataset.slip_rate)), dataset.sizes["sample"] - 1)
    for begin, end in zip(np.append(0, ends[:-1] + 1), ends, strict=True):
        late = dataset.isel(sample=slice(end - (end - begin) // 10, end + 1))
        steady.plot(late.slip_rate[0] * 1e6, late.friction.mean(), "o", color="0.4")
    steady.plot(dataset.speed * 1e6, dataset.steady_friction, color=ACCENT, label="infinite population")
    steady.set(xscale="log", xlabel="Slip rate (µm/s)", ylabel="Steady friction")
    steady.legend()
    ages.semilogy(slip, dataset.mean_age, color="0.6", lw=0.7, label="mean age of the contacts")
    for name, style, colour in LAWS:
        ages.semilogy(slip, dataset[f"{name}_theta"], style, color=colour, label=rf"$\theta$ of the {name} law")
    ages.set(xlabel="Slip (µm)", ylabel="Time (s)")
    ages.legend()
    holds.semilogx(dataset.hold, dataset.static_friction, color="0.6", label="population")
    for name, style, colour in LAWS:
        holds.semilogx(dataset.hold, dataset[f"{name}_hold"], style, color=colour, label=f"{name} law")
    holds.set(xlabel="Hold (s)", ylabel="Static friction")
    holds.legend()
    letter(grid.ravel())
    remark(figure, "Laws are fitted to the velocity steps alone; the hold comes later. Points: last tenths of steps.")
    return figure
