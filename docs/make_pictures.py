"""Draws the pictures of the site that no demo leaves: `python docs/make_pictures.py` (three minutes of processor time).

`tpv205.png`, `time_order.png`, `self_similar.png` and `bp1.png` are the figures of `ruptfx bench NAME --fine`;
`antiplane.png`, `bimaterial.png` and `rate_state.png` are `space_time.png` of these demos, `gmsh_mesh.png` is of
`ruptfx mesh`,
`rough_rupture.png` and `contact_fringes.png` are what these scripts save, `sliding_start.png` and `slow_sliding.png`
are `forces.png` of these demos, `measured_surface.png` is `surfaces.png`, `stress_barrier.png` `front.png` of that
one, `spring_block.png` is `onset_of_sliding.png`, `rough_sliding.png` is `surfaces.png`, `brazilian.png` `cracks.png`,
`ball.png` `wavefield.png`.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ruptfx import plots, read_case, simulate
from ruptfx.analysis.modes import classify
from ruptfx.figure_style import RATE_MAP, styled

PICTURES = Path(__file__).with_name("pictures")
DEMOS = Path(__file__).parents[1] / "demos"
V_IMP, TIP = 2.0, 2100.0  # m/s
BLUE, ORANGE = "#1769aa", "#c8501e"


# -- sliding modes: made slip rates, classified as those of a run are -------------------------------------------------


def pulses(time: np.ndarray, position: np.ndarray, count: int) -> np.ndarray:
    """Parabolic pulses that follow each other."""
    spacing, width = 12e-3, 6e-3
    field = np.zeros((len(time), len(position)))
    for number in range(count):
        centre = TIP * (time[:, None] - 5e-6) - number * spacing - width / 2
        field = np.maximum(field, 2 * (1 - ((position - centre) / (width / 2)) ** 2))
    return field


def crack(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """All that lies behind the tip slides."""
    return 2 * np.clip((TIP * (time[:, None] - 5e-6) - position) / 1e-3, 0, 1)


@styled
def modes() -> Figure:
    """One made field for each mode, with the word that the classification finds."""
    time, position = np.linspace(0, 60e-6, 301), np.linspace(0, 0.1, 401)
    later = (time > 5e-6 + 0.055 / TIP)[:, None]
    one = pulses(time, position, 1)
    fields = {
        "crack": crack(time, position),
        "pulse": one,
        "train": pulses(time, position, 6),
        "mixed": np.where(later, crack(time, position), pulses(time, position, 2)),
        "arrested": one * (position < 0.04),
    }
    figure = Figure(figsize=(7.0, 1.9), layout="constrained")
    for axes, (name, field) in zip(figure.subplots(1, len(fields), sharey=True), fields.items(), strict=True):
        found = classify(field, time, position, loaded_end=0.0, V_imp=V_IMP, c_R=1155.0, c_s=1255.0, c_p=2200.0).mode
        assert found == name, f"{name} is classified as {found}"
        axes.pcolormesh(position * 1e3, time * 1e6, field, cmap=RATE_MAP, rasterized=True)
        axes.set(title=name, xlabel="Position (mm)")
    figure.axes[0].set_ylabel("Time (µs)")
    return figure


# -- signs ------------------------------------------------------------------------------------------------------------


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.6})


@styled
def signs() -> Figure:
    """Bodies, normal, tangent, slip and the stresses that count as positive."""
    figure = Figure(figsize=(7.0, 3.3), layout="constrained")
    axes = figure.add_subplot()
    axes.add_patch(Rectangle((0, 0), 10, 2, facecolor="#dfe9f2", edgecolor="black"))
    axes.add_patch(Rectangle((0, -2), 10, 2, facecolor="#f3e6dd", edgecolor="black"))
    axes.plot([0, 10], [0, 0], color="black", linewidth=2.2)
    axes.text(0.3, 1.6, "upper: plus body")
    axes.text(0.3, -1.8, "lower: minus body")
    arrow(axes, (2, 0), (2, 1.2), BLUE)
    axes.text(2.1, 1.0, "normal n, from minus to plus", color=BLUE)
    arrow(axes, (2, 0), (3.4, 0), BLUE)
    axes.text(2.5, -0.45, "tangent t", color=BLUE)
    arrow(axes, (6.3, 0.35), (7.9, 0.35), ORANGE)
    arrow(axes, (7.9, -0.35), (6.3, -0.35), ORANGE)
    axes.text(5.3, 0.6, "positive slip: plus minus minus, along t", color=ORANGE)
    axes.text(5.3, -0.95, "a positive shear traction resists it", color=ORANGE)
    for x in (4.5, 5.1):
        arrow(axes, (x, 2.8), (x, 2.05), "black")
        arrow(axes, (x, -2.8), (x, -2.05), "black")
    axes.text(5.4, 2.4, "positive normal stress of an interface: compression")
    axes.text(5.4, -2.6, "(stresses of bodies: positive in tension)")
    axes.plot([0], [0], "o", color="black", markersize=4)
    arrow(axes, (0, -2.35), (3.0, -2.35), "black")
    axes.text(0.0, -2.75, "position along the interface: x")
    axes.set(xlim=(-0.3, 11.2), ylim=(-3.0, 3.0), aspect="equal")
    axes.axis("off")
    return figure


# -- damping ----------------------------------------------------------------------------------------------------------


@styled
def damping() -> Figure:
    """Slip rate behind the front of `demos/slip_weakening.toml` with less and less damping."""
    figure = Figure(figsize=(7.0, 2.4), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    chosen = (("damping={}", "no damping"), ("damping.kelvin_voigt.fraction=0.1", "fraction = 0.1"),
              ("damping.kelvin_voigt.fraction=0.2", "fraction = 0.2"))  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for number, (axes, (override, title)) in enumerate(zip(panels, chosen, strict=True)):
            given = ["output.figures=false", "duration=6.0", override]
            record = simulate(read_case(DEMOS / "slip_weakening.toml", overrides=given), out=Path(folder, str(number)))
            rates = record.interface.slip_rate.sel(time=5.5, method="nearest")
            axes.plot(rates.position / 1e3, rates, linewidth=0.7)
            axes.set(title=title, xlabel="Position (km)", xlim=(0, 20))
    panels[0].set_ylabel("Slip rate at 5.5 s (m/s)")
    return figure


def impact() -> None:
    """Figures of the impact demo that the site shows, on a mesh twice as coarse."""
    with tempfile.TemporaryDirectory() as folder:
        case = read_case(DEMOS / "impact.toml", overrides=["mesh.element_size=2e-3"])
        record = simulate(case, out=Path(folder, "run"))
        for name, figure in plots.all_figures(record).items():
            if name in ("energy_budget", "space_time"):
                figure.savefig(PICTURES / f"impact_{name}.png", dpi=130)


DRAWINGS = {"modes": modes, "signs": signs, "damping": damping}

if __name__ == "__main__":
    PICTURES.mkdir(exist_ok=True)
    for name in sys.argv[1:] or [*DRAWINGS, "impact"]:
        if name == "impact":
            impact()
        else:
            DRAWINGS[name]().savefig(PICTURES / f"{name}.png", dpi=160)
