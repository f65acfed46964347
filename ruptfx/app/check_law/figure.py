"""Pictures of laws: friction against slip rate, strength and energy of cohesion, stress and strain of materials."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ruptfx.app.check_law.cohesive import ANGLES, jump_at, straight_path
from ruptfx.app.check_law.materials import elastic
from ruptfx.laws.cohesion import CohesiveLaw
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.materials import Material
from ruptfx.laws.materials.tensor import COMPONENTS
from ruptfx.laws.materials.traced import traced
from ruptfx.results.figure_style import MUTED, STEADY, STICK_SLIP, letter, new_figure, note, styled

STRESSES = (1e6, 3e6, 10e6)  # Pa
RATE = 0.1  # m/s
LONGEST = 10.0  # times the jump at failure; mixed modes have failed there as well
STEPS = {10.0: "#d55e00", 0.1: "#0072b2"}  # safe for colour-blind readers


@styled
def draw(law: FrictionLaw) -> Figure:
    """Draw strength against slip rate, initial and steady; strength and state after velocity steps.

    Parameters
    ----------
    law : FrictionLaw
        Law with numbers as parameters.
    """
    figure, (axes,) = new_figure(1, 3, 2.7)
    rates = np.logspace(-9, 2, 400)
    for sigma, colour in zip(STRESSES, ("#56b4e9", "#0072b2", "#1a1a1a"), strict=True):
        normal = np.full_like(rates, sigma)
        start = {name: np.broadcast_to(v[:1], rates.shape) for name, v in _rest(law, sigma).items()}
        axes[0].semilogx(rates, law.strength(rates, normal, start) / 1e6 + 0 * rates, "--", color=colour)
        try:
            final = law.steady_strength(rates, normal)
        except NotImplementedError:
            final = np.full_like(rates, np.nan)
        axes[0].semilogx(rates, final / 1e6 + 0 * rates, color=colour, label=rf"$\sigma$ = {sigma / 1e6:g} MPa")
    axes[0].set(xlabel="Slip rate (m/s)", ylabel="Strength (MPa)", ylim=(0, None))
    axes[0].legend(title="dashed: initial state\nfull: steady sliding", title_fontsize=7)
    times, pressure = np.logspace(-8, 2, 400), np.full(400, STRESSES[1])
    names = list(law.all_state_fields())
    for factor, colour in STEPS.items():
        before = law.advance(_rest(law, STRESSES[1]), np.full(400, RATE), pressure, 1e-3)
        after = law.advance(before, np.full(400, factor * RATE), pressure, times)
        label = f"{RATE:g} to {factor * RATE:g} m/s"
        carried = law.strength(factor * RATE, pressure, after) + 0 * times
        axes[1].semilogx(times, carried / pressure, color=colour, label=label)
        for name, style in zip(names, ("-", "--", ":", "-.") * len(names), strict=False):
            with np.errstate(invalid="ignore", divide="ignore"):
                relative = after[name] / np.where(before[name] != 0, before[name], 1.0) + 0 * times
            axes[2].loglog(times, np.where(relative > 0, relative, np.nan), style, color=colour,
                           label=name.replace("_", " ") if factor > 1 else None)  # fmt: skip
    pressed = rf"$\sigma$ = {STRESSES[1] / 1e6:g} MPa"
    axes[1].set(xlabel="Time since velocity step (s)", ylabel=rf"Strength / $\sigma$, {pressed}")
    axes[1].legend(frameon=True, edgecolor="none", borderpad=0.2)  # curves may lie behind it
    axes[2].set(xlabel="Time since velocity step (s)", ylabel="State / state before the step")
    if names:
        axes[2].legend()
    else:
        note(axes[2], "no state")
    letter(axes)
    return figure


@styled
def draw_cohesive(law: CohesiveLaw) -> Figure:
    """Draw strength against opening and slip alone; work of straight mixed-mode paths over the fracture energies.

    Parameters
    ----------
    law : CohesiveLaw
        Law with numbers as parameters.
    """
    figure, (axes,) = new_figure(1, 3, 2.7)
    size = np.linspace(0, 1.2, 601)
    pure = (("opening", "Tensile strength (MPa)", 0.0, law.f_t), ("slip", "Cohesion (MPa)", np.pi / 2, law.c))
    for ax, (name, label, angle, strength), colour in zip(axes, pure, (STICK_SLIP, STEADY), strict=False):
        jump = jump_at(law, angle, size)
        damage = law.damage(*jump) + 0 * size
        remaining = strength * np.where(damage < 1, law.remaining_fraction(damage), 0.0)
        ax.plot(1e6 * jump[name == "slip"], 1e-6 * remaining, color=colour)
        ax.set(xlabel=f"Inelastic {name} (µm)", ylabel=label, xlim=(0, None), ylim=(0, None))
    works = np.array([straight_path(law, angle, LONGEST)[1:] for angle in ANGLES])
    result = works @ [1 / law.G_Ic, 1 / law.G_IIc]
    axes[2].plot(np.degrees(ANGLES), result, color="#1a1a1a", label=f"at most {result.max():.2f}")
    axes[2].axhline(1, color=MUTED, lw=0.6, ls=":")
    axes[2].set(xlabel="Mix of modes (degree)", xlim=(0, 90), ylim=(0, None))
    axes[2].set_ylabel(r"$W_I / G_{Ic} + W_{II} / G_{IIc}$ at failure")
    axes[2].legend()
    letter(axes)
    return figure


def _rest(law: FrictionLaw, sigma: float) -> dict[str, np.ndarray]:
    """Return the initial state at a shear stress of 0.3 sigma, shape (400,)."""
    normal = np.full(400, sigma)
    state = law.initial_state(normal, 0.3 * normal, np.full(400, RATE))
    return {name: value + np.zeros(400) for name, value in state.items()}


@styled
def draw_material(material: Material) -> Figure:
    """Draw stress against strain in cycles of shear and of uniaxial strain, fast and slow."""
    figure, (axes,) = new_figure(1, 2, 2.8)
    cycle = 1e-3 * np.sin(np.linspace(0, 5 * np.pi, 1001))
    for axis, part, name in ((axes[0], "xy", "Shear"), (axes[1], "xx", "Uniaxial")):
        for period, colour in ((1e-6, "#56b4e9"), (1e-3, "#0072b2"), (1.0, "#1a1a1a")):
            law = traced(material, "solid") if material.has_memory() else None
            state = {} if law is None else {key: np.full(1, value) for key, value in law.state.items()}
            stress = []
            for strain in cycle:
                parts = {each: np.full(1, strain if each == part else 0.0) for each in COMPONENTS}
                if law is None:
                    stress.append(elastic(material, np.stack(list(parts.values())))[COMPONENTS.index(part), 0])
                else:
                    result, state = law.evaluate(parts, state, period / 400)
                    stress.append(result[part][0])
            axis.plot(cycle * 1e3, np.array(stress) / 1e6, color=colour, label=f"period {period:g} s")
        axis.set(xlabel=f"{name} strain (0.001)", ylabel="Stress (MPa)")
    axes[0].legend()
    return figure
