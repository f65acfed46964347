"""Figures of the Maxwell-slip ensemble: histories with slip raster, static coefficient, amplitude, roughness map."""

from __future__ import annotations

import numpy as np
import xarray
from matplotlib.figure import Figure

from ruptfx.results.figure_style import (
    ACCENT,
    ONE_COLUMN,
    STEADY,
    STICK_SLIP,
    UNDECIDED,
    WIDTH,
    blank_figure,
    letter,
    styled,
)

_COLOURS = {"stick-slip": STICK_SLIP, "steady": STEADY, "undecided": UNDECIDED}


def figures(dataset: xarray.Dataset) -> dict[str, Figure]:
    """Draw all figures of a result."""
    drawn = {
        "friction_histories": histories(dataset),
        "static_coefficient": static(dataset),
        "late_amplitude": amplitude(dataset),
    }
    if dataset.sizes["surface"]:
        drawn["roughness_map"] = roughness_map(dataset)
    return drawn


def _colour(dataset: xarray.Dataset) -> list[str]:
    return [STICK_SLIP if unstable else STEADY for unstable in dataset.stick_slip.values]


@styled
def histories(dataset: xarray.Dataset) -> Figure:
    """Draw the friction coefficient against time, over the raster of slipped blocks."""
    count = dataset.sizes["alpha"]
    columns = min(3, count)
    rows = -(-count // columns)
    figure = blank_figure(WIDTH, 2.3 * rows)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    period, colours = float(dataset.slip_period), _colour(dataset)
    for index, ax in enumerate(axes):
        if index >= count:
            ax.set_visible(False)
            continue
        row = dataset.isel(alpha=index)
        raster = ax.twinx()
        raster.plot(
            row.slip_time / period,
            np.where(row.slipped_block < 0, np.nan, row.slipped_block),
            ".",
            markersize=0.9,
            markeredgewidth=0,
            color=ACCENT,
            rasterized=True,
        )
        raster.set_ylim(0, dataset.attrs["blocks"])
        last = index % columns == columns - 1 or index == count - 1
        raster.spines["right"].set_visible(last)
        raster.tick_params(labelright=last, right=last)
        if last:
            raster.set_ylabel("Slipping block")
        ax.set_zorder(raster.get_zorder() + 1)
        ax.patch.set_visible(False)
        ax.plot(row.trace_time / period, row.trace_friction, color=colours[index])
        for level, style in ((dataset.attrs["mu_s"], "--"), (dataset.attrs["mu_d"], ":")):
            ax.axhline(level, color="0.3", linestyle=style, linewidth=0.6)
        mode = "stick-slip" if row.stick_slip else "steady sliding"
        ax.set_title(f"$\\alpha$ = {float(row.alpha):g}: {mode}", loc="right")
        if index % columns == 0:
            ax.set_ylabel("Friction coefficient")
        if index >= count - columns:
            ax.set_xlabel("Time / slip period")
    letter(axes[:count])
    return figure


@styled
def static(dataset: xarray.Dataset) -> Figure:
    """Draw the macroscopic static coefficient against alpha, with its scatter."""
    figure = blank_figure(ONE_COLUMN, 2.6)
    ax = figure.subplots()
    values = dataset.mu_static
    for alpha, runs in zip(dataset.alpha.values, values.values, strict=True):
        ax.plot(np.full(len(runs), alpha), runs, "s", color="0.7", markersize=1.5, zorder=1)
    ax.errorbar(
        dataset.alpha,
        values.mean("realisation"),
        values.std("realisation"),
        fmt="s",
        color="k",
        capsize=2,
        label=f"mean of {dataset.sizes['realisation']} runs, std",
        zorder=3,
    )
    ax.plot(dataset.alpha_fine, dataset.limit_mu_static, color=STEADY, label=r"$N\to\infty$", zorder=2)
    for name, below in (("mu_s", True), ("mu_d", False)):
        ax.axhline(dataset.attrs[name], color="0.3", linewidth=0.6, linestyle="--" if below else ":")
        ax.annotate(
            rf"$\mu_{name[-1]}$",
            (1, dataset.attrs[name]),
            xycoords=("axes fraction", "data"),
            xytext=(2, 0),
            textcoords="offset points",
            va="center",
        )
    _transition(ax, dataset)
    ax.set(xscale="log", xlabel=r"Shape parameter $\alpha$  (rough $\rightarrow$ smooth)")
    ax.set_ylabel("Static coefficient")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 0.16))  # below the curve, right of the transition
    return figure


def _transition(ax, dataset: xarray.Dataset) -> None:  # type: ignore[no-untyped-def]
    alpha_c = float(dataset.alpha_c)
    if np.isfinite(alpha_c):
        ax.axvline(alpha_c, color=STICK_SLIP, linestyle="--", linewidth=0.8)
        ax.annotate(
            rf"$\alpha_c$ = {alpha_c:.3g}",
            (alpha_c, 0.065),  # above mu_d
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            color=STICK_SLIP,
        )


@styled
def amplitude(dataset: xarray.Dataset) -> Figure:
    """Draw late peak-to-peak friction against alpha, the threshold and the laws for infinitely many blocks."""
    figure = blank_figure(ONE_COLUMN, 2.6)
    ax = figure.subplots()
    values = dataset.late_amplitude
    ax.errorbar(
        dataset.alpha,
        values.mean("realisation"),
        values.std("realisation"),
        fmt="o",
        color="k",
        capsize=2,
        label=f"{dataset.attrs['blocks']} blocks, {dataset.sizes['realisation']} runs",
    )
    ax.plot(dataset.alpha_fine, dataset.limit_amplitude, color=STEADY, label=r"$N\to\infty$")
    ax.plot(
        dataset.alpha_fine,
        dataset.law_amplitude,
        color=ACCENT,
        linestyle="--",
        label=r"$(2/\pi)\,\exp(-2\pi^2 s^2)$",
    )
    ax.axhline(dataset.attrs["threshold"], color=STICK_SLIP, linewidth=0.7, linestyle=":")
    ax.annotate(
        f"threshold {dataset.attrs['threshold']:g}",
        (1, dataset.attrs["threshold"]),
        ha="right",
        xycoords=("axes fraction", "data"),
        xytext=(-3, 2),
        textcoords="offset points",
        color=STICK_SLIP,
    )
    _transition(ax, dataset)
    ax.set(xscale="log", xlabel=r"Shape parameter $\alpha$", ylim=(0, 1.05))
    ax.set_ylabel(r"Late peak-to-peak / $2(\mu_s-\mu_d)$")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 0.18))  # below the curves, right of the transition
    return figure


@styled
def roughness_map(dataset: xarray.Dataset) -> Figure:
    """Draw R_a against alpha over the range of the real-contact fraction, and the surfaces with their verdicts."""
    figure = blank_figure(WIDTH * 0.75, 2.9)
    ax = figure.subplots()
    alpha = np.geomspace(0.03, 1e5, 200)
    low, high = (float(dataset[name]) / np.sqrt(2 * alpha + 1) for name in ("R_a_scale_min", "R_a_scale_max"))
    ax.fill_between(alpha, low * 1e6, high * 1e6, color="0.8", label=r"$R_a(\alpha)$, range of contact fraction")
    limits = [float(dataset[name]) * 1e6 for name in ("R_a_crit_min", "R_a_crit_max")]
    alpha_c = rf"$\alpha_c$ = {float(dataset.verdict_alpha_c):.3g}"
    if np.isfinite(limits).all():
        critical = rf"$R_{{a,crit}}$ = {limits[0]:.3f}–{limits[1]:.3f} µm at {alpha_c}"
        ax.axhspan(*limits, color=ACCENT, alpha=0.3, linewidth=0, label=critical)
    else:
        ax.set_title(r"no transition among these $\alpha$: no verdicts", loc="left")
    for row in (dataset.isel(surface=i) for i in range(dataset.sizes["surface"])):
        colour, R_a = _COLOURS[str(row.verdict.values)], float(row.R_a) * 1e6
        ends = np.maximum([float(row.alpha_low), float(row.alpha_high)], alpha[0])
        ax.plot(ends, [R_a, R_a], color=colour, linewidth=4, solid_capstyle="butt")
        beyond = float(row.alpha_high) == 0  # rougher than every ensemble
        ax.plot(np.sqrt(ends[0] * ends[1]), R_a, "<" if beyond else "o", color=colour)
        right = ends[1] < 300
        ax.annotate(
            f"{row.surface.values}: {row.verdict.values}",
            (ends[1] if right else ends[0], R_a),
            xytext=(6 if right else -6, 0),
            textcoords="offset points",
            va="center",
            color=colour,
            ha="left" if right else "right",
        )
    ax.set(xscale="log", yscale="log", xlabel=r"Shape parameter $\alpha$", ylabel=r"Roughness $R_a$ (µm)")
    ax.legend(loc="lower left")
    return figure
