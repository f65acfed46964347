"""Figures of the spring slider, one per experiment."""

from __future__ import annotations

import numpy as np
import xarray
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from ruptfx.results.figure_style import (
    ACCENT,
    ONE_COLUMN,
    RATE_MAP,
    STEADY,
    STICK_SLIP,
    WIDTH,
    blank_figure,
    letter,
    styled,
)


def figures(dataset: xarray.Dataset) -> dict[str, Figure]:
    """Draw the figure of the experiment."""
    name = dataset.attrs["experiment"]
    return {name: _DRAW[name](dataset)}


@styled
def velocity_steps(dataset: xarray.Dataset) -> Figure:
    """Draw friction and speeds against the displacement of the drive."""
    figure = blank_figure(ONE_COLUMN, 3.2)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    x = dataset.drive_displacement * 1e6
    top.plot(x, dataset.friction, color=STICK_SLIP)
    top.set_ylabel("Friction coefficient")
    bottom.plot(x, dataset.slip_rate * 1e6, color=STEADY, label="slip rate")
    bottom.plot(x, dataset.drive_speed * 1e6, color="0.4", linestyle="--", linewidth=0.7, label="drive")
    bottom.set(yscale="log", xlabel="Drive displacement (µm)", ylabel="Speed (µm/s)")
    bottom.legend(loc="upper right")
    return figure


@styled
def slide_hold_slide(dataset: xarray.Dataset) -> Figure:
    """Draw friction during the holds, and static friction against their duration."""
    figure = blank_figure(WIDTH, 2.7)
    left, right = figure.subplots(1, 2)
    shades = np.linspace(0.2, 1, dataset.sizes["hold"])
    for shade, run in zip(shades, (dataset.isel(hold=i) for i in range(dataset.sizes["hold"])), strict=True):
        restart = float(run.drive_displacement[np.argmax(run.drive_speed.values == 0)])
        left.plot(
            (run.drive_displacement - restart) * 1e6,
            run.friction,
            color=STICK_SLIP,
            alpha=float(shade),
            label=f"{float(run.hold):g} s",
        )
    left.set(xlabel="Drive displacement from the hold (µm)", ylabel="Friction coefficient")
    left.legend(title="hold", title_fontsize=7)
    right.plot(dataset.hold, dataset.static_friction, "o", color=STICK_SLIP, label="simulation")
    slope, last = dataset.attrs["b"], dataset.isel(hold=-1)
    line = float(last.static_friction) + slope * np.log(dataset.hold / float(last.hold))
    right.plot(dataset.hold, line, "--", color="0.4", label=f"slope b = {slope:g} per e-fold")
    right.axhline(float(dataset.steady_friction), color=STEADY, linestyle=":", label="steady sliding")
    right.set(xscale="log", xlabel="Duration of the hold (s)", ylabel="Static friction coefficient")
    right.legend()
    letter((left, right))
    return figure


@styled
def modulated_speed(dataset: xarray.Dataset) -> Figure:
    """Draw friction against the modulated speed: loops about the steady line."""
    figure = blank_figure(ONE_COLUMN, 2.8)
    ax = figure.subplots()
    order = np.argsort(dataset.drive_speed.values)
    speed = dataset.drive_speed.values * 1e6
    for colour, loop in zip((STICK_SLIP, ACCENT, STEADY, "0.3", "0.6"), dataset.friction, strict=False):
        ax.plot(speed, loop, color=colour, label=f"{float(loop.period):g} s")
        for at in (0.02, 0.52):
            i = int(at * len(speed))
            ax.annotate(
                "",
                (speed[i + 6], loop[i + 6]),
                (speed[i], loop[i]),
                arrowprops={"arrowstyle": "->", "color": colour, "lw": 1},
            )
    ax.plot(speed[order], dataset.steady_friction.values[order], "k:", label="steady")
    ax.set(xscale="log", xlabel="Drive speed (µm/s)", ylabel="Friction coefficient")
    ax.legend(title="period", title_fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))  # loops fill the axes
    return figure


@styled
def modulated_load(dataset: xarray.Dataset) -> Figure:
    """Draw mean friction, its harmonics and the critical stiffness against the load amplitude."""
    critical = bool(np.isfinite(dataset.K_c_loaded.values).any())
    figure = blank_figure(WIDTH, 2.4)
    axes = figure.subplots(1, 2 + critical)
    fine = np.linspace(0, float(dataset.eps.max()), 100)
    axes[0].plot(dataset.eps, 100 * dataset.mean_change, "o-", color=STICK_SLIP, label="simulation")
    axes[0].plot(fine, 100 * np.interp(fine, dataset.eps, dataset.law), "--", color="0.4", label="constant age")
    axes[0].set_ylabel("Change of mean friction (%)")
    axes[0].legend()
    axes[1].plot(dataset.eps, dataset.first_harmonic, "o-", color=STEADY, label="f")
    axes[1].plot(dataset.eps, dataset.second_harmonic, "s-", color=ACCENT, label="2 f")
    axes[1].set(ylabel="Harmonic of F / W", ylim=(0, None))
    axes[1].legend()
    if critical:
        axes[2].plot(dataset.eps, dataset.K_c_loaded / float(dataset.attrs["K_c"]), "o-", color="k")
        axes[2].set(ylabel=r"$K_c(\epsilon)\,/\,K_c(0)$", ylim=(0, 1.05))
    letter(axes)
    for ax in axes:
        ax.set_xlabel(r"Load amplitude $\epsilon$")
    return figure


@styled
def stability(dataset: xarray.Dataset) -> Figure:
    """Draw stick-slip and steady sliding over speed and stiffness, with the linear boundary."""
    figure = blank_figure(ONE_COLUMN, 2.8)
    ax = figure.subplots()
    speed = dataset.speed * 1e6
    ax.pcolormesh(
        speed,
        dataset.stiffness * 1e-4,
        dataset.oscillates.astype(float),
        shading="nearest",
        rasterized=True,
        cmap=ListedColormap(["#dfe8f0", "#f0d8d4"]),
        vmin=0,
        vmax=1,
    )
    ax.plot(speed, dataset.k_c_linear * 1e-4, color="k", label="linear analysis")
    ax.plot(speed, dataset.k_c_simulated * 1e-4, ".", color=STICK_SLIP, markersize=4, label="simulation")
    ax.annotate("stick-slip", (0.06, 0.08), xycoords="axes fraction", color=STICK_SLIP)
    ax.annotate("steady sliding", (0.06, 0.88), xycoords="axes fraction", color=STEADY)
    ax.set(xscale="log", xlabel="Drive speed (µm/s)", ylabel=r"$K / W$ ($10^4$/m)")
    ax.legend(loc="upper right")
    return figure


@styled
def bifurcation(dataset: xarray.Dataset) -> Figure:
    """Draw amplitude and harmonic content against stiffness, and the waveforms."""
    figure = blank_figure(WIDTH, 3.0)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.3))
    left.plot(dataset.ratio, dataset.amplitude, "-", color=STICK_SLIP)
    settled = np.abs(dataset.drift.values) < 0.01
    for chosen, face, label in ((settled, STICK_SLIP, "settled"), (~settled, "w", "still changing")):
        left.plot(
            dataset.ratio[chosen], dataset.amplitude[chosen], "o", color=STICK_SLIP, markerfacecolor=face, label=label
        )
    left.legend(loc="lower left")
    left.axvline(1, color="0.4", linestyle=":", linewidth=0.8)
    left.set(xlabel=r"$K / K_c$", ylabel="Peak-to-peak friction", ylim=(0, None))
    left.set_title("(a)", loc="left")
    second = left.twinx()
    second.spines["right"].set_visible(True)
    second.plot(dataset.ratio, dataset.harmonic, "s--", color=STEADY, markersize=3)
    second.set(ylim=(0, 1))
    second.set_ylabel("Second / first harmonic", color=STEADY)
    chosen = np.unique(np.linspace(0, dataset.sizes["ratio"] - 1, min(5, dataset.sizes["ratio"])).astype(int))
    step = 1.1 * float(dataset.amplitude.max())
    for row, index in enumerate(chosen):
        wave = dataset.wave.isel(ratio=index)
        right.plot(dataset.wave_time, wave - wave.mean() - row * step, color=STICK_SLIP, linewidth=0.8)
        right.annotate(
            f"{float(wave.ratio):g}", (1.01, -row * step), xycoords=("axes fraction", "data"), va="center", fontsize=7
        )
    right.set(xlabel="Time (s)", ylabel="Friction coefficient, shifted")
    right.set_title(r"(b)  waves at $K / K_c$ (right)", loc="left")
    return figure


@styled
def fit(dataset: xarray.Dataset) -> Figure:
    """Draw the measured trace, the fit and its parameters with their intervals."""
    figure = blank_figure(ONE_COLUMN * 1.5, 3.2)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    top.plot(dataset.time, dataset.measured, ".", color="0.6", markersize=2, label="measured")
    top.plot(dataset.time, dataset.fitted, color=STICK_SLIP, label="fit")
    top.set_ylabel("Friction coefficient")
    top.legend(loc="lower right")
    level = 100 * dataset.attrs["confidence"]
    text = [f"{level:.0f} % intervals"]
    for name, factor, unit in (("a", 1, ""), ("b", 1, ""), ("D_c", 1e6, " µm")):
        value, low, high = (float(dataset[name + end]) * factor for end in ("", "_low", "_high"))
        text.append(rf"${name}$ = {value:.4g}{unit}  [{low:.4g}, {high:.4g}]")
    top.set_title("\n".join(text), fontsize=7, loc="left")
    bottom.plot(dataset.time, dataset.fitted - dataset.measured, color=STEADY, linewidth=0.6)
    bottom.set(xlabel="Time (s)", ylabel="Residual")
    return figure


@styled
def stick_slip(dataset: xarray.Dataset) -> Figure:
    """Draw period and drop of stick-slip against the drive speed, a line for each normal force and stiffness."""
    figure = blank_figure(WIDTH, 2.8)
    left, right = figure.subplots(1, 2)
    styles = ("-", "--", ":", "-.")
    shades = np.linspace(1, 0.25, dataset.sizes["normal_force"])
    for i, j in np.ndindex(dataset.sizes["normal_force"], dataset.sizes["stiffness"]):
        one = dataset.isel(normal_force=i, stiffness=j)
        look = {"marker": "o", "linestyle": styles[j % len(styles)], "color": STICK_SLIP, "alpha": float(shades[i])}
        named = f"{float(one.normal_force):g} N, {float(one.stiffness) / 1e3:g} kN/m"
        left.plot(one.speed * 1e6, one.period, label=f"{named}: slope {float(one.period_exponent):.3f}", **look)
        right.plot(one.speed * 1e6, one.force_drop, **look)
    scale = "log" if dataset.period.notnull().any() else "linear"  # steady sliding has no period
    left.set(xscale="log", yscale=scale, xlabel="Drive speed (µm/s)", ylabel="Time from slip to slip (s)")
    left.legend(loc="lower left")
    right.set(xscale="log", xlabel="Drive speed (µm/s)", ylabel="Drop of the friction force (N)", ylim=(0, None))
    letter((left, right))
    return figure


@styled
def loading_unloading(dataset: xarray.Dataset) -> Figure:
    """Draw force against displacement, loaded and unloaded, and what displacement stays."""
    figure = blank_figure(WIDTH, 2.8)
    left, right = figure.subplots(1, 2)
    farthest = 1.5 * float(dataset.displacement.max())
    shown = dataset.whole_displacement.values <= farthest
    left.plot(dataset.whole_displacement[shown] * 1e6, dataset.whole_friction[shown], "k:", label="to the slip")
    for shade, run in zip(np.linspace(0.25, 1, dataset.sizes["fraction"]), dataset.fraction, strict=True):
        one = dataset.sel(fraction=run)
        left.plot(one.displacement * 1e6, one.friction, color=STICK_SLIP, alpha=float(shade), label=f"{float(run):g}")
    left.set(xlabel="Displacement of the slider (µm)", ylabel="Force over normal force")
    left.legend(title="largest / static force", title_fontsize=7)
    right.plot(dataset.fraction, dataset.irreversible * 1e6, "o-", color=STICK_SLIP)
    right.set(xlabel="Largest force over static force", ylabel="Irreversible slip (µm)", xlim=(0, 1))
    letter((left, right))
    return figure


@styled
def frequency_response(dataset: xarray.Dataset) -> Figure:
    """Draw amplitude and phase against frequency, with resonance and quality factor."""
    figure = blank_figure(ONE_COLUMN, 3.2)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    top.plot(dataset.frequency, dataset.compliance * 1e6, color=STICK_SLIP)
    top.axvline(float(dataset.resonance), color="0.4", linestyle=":", linewidth=0.8)
    top.set_title(f"{float(dataset.resonance):.4g} Hz, Q = {float(dataset.quality):.3g}", fontsize=7, loc="left")
    top.set(yscale="log", ylabel="Displacement over force (µm/N)")
    bottom.plot(dataset.frequency, np.degrees(dataset.phase), color=STEADY)
    bottom.set(xscale="log", xlabel="Frequency (Hz)", ylabel="Phase (degrees)")
    return figure


@styled
def temperatures(dataset: xarray.Dataset) -> Figure:
    """Draw static friction against contact time, its slope against temperature, and the master curve."""
    figure = blank_figure(WIDTH, 2.6)
    axes = figure.subplots(1, 3)
    colours = RATE_MAP(np.linspace(0.1, 0.9, dataset.sizes["temperature"]))
    for colour, temperature in zip(colours, dataset.temperature.values, strict=True):
        one = dataset.sel(temperature=temperature)
        axes[0].plot(one.hold, one.static_friction, "o-", color=colour, label=f"{temperature:g} K")
        axes[2].plot(one.reduced_time, one.static_friction, "o", color=colour)
    axes[0].set(xscale="log", xlabel="Contact time (s)", ylabel="Static friction coefficient")
    axes[0].legend()
    axes[1].plot(dataset.temperature, dataset.ageing_slope, "o-", color=STEADY)
    axes[1].set(xlabel="Temperature (K)", ylabel="Slope of static friction per e-fold")
    axes[1].set_ylim(0, 1.2 * float(dataset.ageing_slope.max()))
    axes[2].set(xscale="log", xlabel="Contact time over shift factor (s)", ylabel="Static friction coefficient")
    letter(axes)
    return figure


_DRAW = {
    "temperatures": temperatures,
    "velocity_steps": velocity_steps,
    "slide_hold_slide": slide_hold_slide,
    "modulated_speed": modulated_speed,
    "modulated_load": modulated_load,
    "stability": stability,
    "bifurcation": bifurcation,
    "stick_slip": stick_slip,
    "loading_unloading": loading_unloading,
    "frequency_response": frequency_response,
    "fit": fit,
}
