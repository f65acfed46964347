"""Lumped models: Maxwell-slip ensemble, spring-block chain and rate-and-state slider against exact numbers.

Expected numbers are closed forms, derived where they are used, or published; those marked as independent computation
come from separate programs written for this comparison, with the tolerance of their scatter. The chain is chaotic
after its first rupture, so that only what does not depend on the draw is asked of it, over several seeds. Run times
are of one core and are limits, not measurements.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray

from ruptfx.app.bench import Check, Outcome
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.lumped import silent
from ruptfx.lumped.asperity_population import AsperityPopulation
from ruptfx.lumped.maxwell_slip import MaxwellSlip, large_number_limit, late_amplitude_law
from ruptfx.lumped.maxwell_slip.roughness import ContactLayer, Surface
from ruptfx.lumped.spring_block import SpringBlock
from ruptfx.lumped.spring_block.chain import Chain, History, Integrator
from ruptfx.lumped.spring_slider.protocols import SlideHoldSlide
from ruptfx.lumped.spring_slider.slider import Slider, linear_rates
from ruptfx.lumped.spring_slider.stability import ModulatedLoad, StabilityDiagram, onset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

ROUGHNESS = "Baygeldi et al. (2026)"
CHAIN = "Rubinstein et al. (2011)"
SLOW = "Baumberger et al. (2001)"
INERTIA = "Rice and Ruina (1983)"
INDEPENDENT = "independent computation"
PILOT = {1.0: 0.070, 10.0: 0.069, 20.0: 0.113, 22.0: 0.133, 50.0: 0.314, 500.0: 0.711, 1e5: 0.973}
MODULATION = {0.02: -0.0028, 0.05: -0.0160, 0.1: -0.0519, 0.2: -0.142, 0.3: -0.239}
SURFACES = [
    Surface(name="polished P4000", R_a=0.023e-6, observed="stick-slip"),
    Surface(name="diamond saw-cut", R_a=0.296e-6, observed="stick-slip"),
    Surface(name="laser-cut", R_a=0.840e-6, observed="steady"),
    Surface(name="polished P40", R_a=4.108e-6, observed="steady"),
    Surface(name="Bouissou intermediate", R_q=24e-6, pressure=10e6, observed="steady"),
    Surface(name="Bouissou rough", R_q=49e-6, pressure=10e6, observed="steady"),
]
WEIGHT, A, B, D_C = 16.0, 0.013, 0.026, 0.42e-6
K_C = WEIGHT * (B - A) / D_C
CHAIN_SEEDS = (1, 2, 3)
PRINTED_DAMPING = 3.45e4  # 1/s
BLOCK_MASS = 0.0756  # kg, of 140 x 75 x 6 mm of PMMA; the source prints 11.5 kg


def timed(work: Callable[[], object]) -> tuple[Any, float]:
    """Return a result and the processor time of its computation [s]."""
    start = time.process_time()
    return work(), time.process_time() - start


def run_time(what: str, most: float, seconds: float) -> Check:
    """Return the check of a limit of processor time."""
    return Check(what, most, seconds, unit="s", relation="at most", timing=True)


@cache
def ensembles() -> tuple[xarray.Dataset, float]:
    """Return the results of the Maxwell-slip ensembles, and the processor time [s]."""
    return timed(MaxwellSlip(alphas=list(PILOT), surfaces=SURFACES).run)


@cache
def modulation() -> xarray.Dataset:
    """Return the response of the slider to a modulated normal load."""
    slider = pmma(2 * K_C, interface_length=0.4e-6)
    return ModulatedLoad(amplitudes=list(MODULATION), critical=False).run(slider, silent)


def pmma(stiffness: object, mass: float = 0.0, interface_length: float = 0.0) -> Slider:
    """Return a slider with the constants of PMMA near room temperature."""
    law = RateAndStateAgeing(a=A, b=B, D_c=D_C, f_0=0.36, V_0=1e-6)
    return Slider(law, WEIGHT, stiffness, mass, interface_length)


def run(fine: bool = False, comm: MPI.Comm | None = None) -> Outcome:
    """Return all checks of the lumped models; the same at any resolution and on any number of ranks."""
    return Outcome([*roughness_checks(), *chain_checks(), *slider_checks(), *asperity_checks()], figure)


def roughness_checks() -> list[Check]:
    """Return the checks of the Maxwell-slip ensemble."""
    data, seconds = ensembles()
    low, high = ContactLayer().critical(22, 0.3)
    right = int((data.verdict == data.observed).sum())
    mean = data.late_amplitude.mean("realisation")
    return [
        Check("critical roughness, contact fraction 1.5 %", 0.408e-6, low, 0.005, "m", ROUGHNESS, relative=True),
        Check("critical roughness, contact fraction 1.1 %", 0.557e-6, high, 0.005, "m", ROUGHNESS, relative=True),
        Check("surfaces with the observed kind of sliding", 6, right, 0, "1", ROUGHNESS),
        # The law is the first harmonic of Gaussian phases: at alpha = 50 higher harmonics and the tails of the Beta
        # distribution are below 1 %; at 22 the tails are worth 0.008.
        *(
            Check(
                f"late amplitude without scatter, alpha = {alpha}",
                float(late_amplitude_law(alpha, 0.3, 0.225)),
                large_number_limit(alpha, 0.3, 0.225)[1],
                tolerance,
                "1",
                "(2/pi) exp(-2 pi^2 s^2)",
            )
            for alpha, tolerance in ((22, 0.01), (50, 0.003))
        ),
        *(
            Check(
                f"late amplitude, 300 blocks, alpha = {alpha:g}",
                amplitude,
                float(mean.sel(alpha=alpha)),
                0.02,
                "1",
                INDEPENDENT,
            )
            for alpha, amplitude in PILOT.items()
        ),
        Check("alpha at the transition", 22, float(data.alpha_c), 2, "1", ROUGHNESS),
        run_time("run time, 7 alphas, 100 runs, 300 blocks, 20 periods", 20, seconds),
    ]


def wave_speed() -> float:
    """Return the speed [blocks/s] of a smooth pulse in an undamped chain without contacts."""
    model, blocks = SpringBlock(), 400
    chain = Chain(
        mass=model.mass / model.blocks,
        damping=0.0,
        spring=(model.blocks - 1) * model.stiffness,
        drive_stiffness=0.0,
        drive_speed=0.0,
        contacts=np.ones(blocks, int),
        contact_stiffness=1e-9,
        contact_strength=1.0,
        scatter=0.0,
        delay=1.0,
    )
    pulse = Integrator(chain, 0.5 * chain.stable_step(), seed=0)
    block = np.arange(blocks)
    # A Gaussian ten blocks wide, at rest, splits into two pulses; the right one passes blocks 200 and 300.
    pulse.x[:] = pulse.x_old[:] = 1e-6 * np.exp(-0.5 * ((block - 100) / 10) ** 2)
    times, centres = np.empty(2), np.empty(2)
    for number, crossings in enumerate((100, 200)):
        # Run for the crossing time at the expected speed; a wrong speed moves the pulse.
        pulse.advance(round(crossings / model.chain_speed / pulse.dt) - pulse.steps, History())
        half = np.where(block > 150, pulse.x, 0)
        times[number], centres[number] = pulse.time, (half * block).sum() / half.sum()
    return float(np.diff(centres)[0] / np.diff(times)[0])


def dropping_correlation(data: xarray.Dataset) -> float:
    """Return the correlation of length and force of precursors with a visible force drop."""
    first = int(data.event_large.values.argmax())
    seen = data.event_drop.values[:first] > 0
    return float(np.corrcoef(data.event_force.values[:first][seen], data.event_reach.values[:first][seen])[0, 1])


def chain_checks() -> list[Check]:
    """Return the checks of the spring-block chain."""
    smooth = SpringBlock(scatter=0.0, duration=0.33, large_events=1)
    data = smooth.run()
    first = float(data.first_break_time)
    early = data.position.sel(time=0.3, method="nearest").values.astype(float)
    soft, seconds = timed(SpringBlock().run)
    stiff = SpringBlock(interface_ratio=50.0, large_events=1)
    softs = [soft, *(SpringBlock(large_events=1, seed=seed).run() for seed in CHAIN_SEEDS[1:])]
    stiffs = [stiff.model_copy(update={"seed": seed}).run() for seed in CHAIN_SEEDS]
    drops = np.mean([float(s.largest_precursor_drop / s.mean_large_drop) for s in softs + stiffs])
    begins = sum(int(s.break_block[0]) for s in softs + stiffs)

    def over(runs: list[xarray.Dataset], name: str) -> list[float]:
        return [float(run[name]) for run in runs]

    # Static chain: K_b (x_(j+1) - 2 x_j + x_(j-1)) = K_s x_j, so q + 1/q = 2 + K_s / K_b = 2 + 1/69.
    # The slow approach adds the drag m eta sum(v_j), v_j = V_d K_d q^j / (K_d + K_b (1 - q) + K_s): at most 0.4 N.
    # First rupture: x_0 = F_s / (N K_s) and F = (K_b (1 - q) + K_s) x_0, at t = (F / K_d + x_0) / V_d.
    every = softs + stiffs
    kept, released = (float(np.mean(over(runs, "retained_stress"))) for runs in (softs, stiffs))
    correlation = float(np.nanmean([dropping_correlation(run) for run in stiffs]))
    return [
        Check("decay of the static displacement per block", 0.8866, early[6] / early[5], 2e-4, "1", CHAIN),
        Check("force at the first rupture, no scatter", 378.1, float(data.first_break_force), 0.3, "N", "static chain"),
        Check("time of the first rupture, no scatter", 0.324, first, 0.0005, "s", "static chain"),
        Check("wave speed of the chain", 80944, wave_speed(), 0.01, "1/s", "sqrt(K_b / m)", relative=True),
        Check("blocks from the trailing edge to the first rupture", 0, begins, 0, "1", CHAIN),
        Check("precursors, fewest of a run", 1, min(over(every, "precursors")), 0, "1", CHAIN, "at least"),
        Check("largest precursor drop over a large drop, mean", 0.1, drops, 0.1, "1", CHAIN),
        Check("slow fronts, soft, fewest of a run", 1, min(over(softs, "slow_fronts")), 0, "1", CHAIN, "at least"),
        Check("slow fronts' speed / chain's", 0.1, max(over(softs, "slow_front_speed")), 0, "1", CHAIN, "at most"),
        Check("slow fronts, stiff, most of a run", 0, max(over(stiffs, "slow_fronts")), 0, "1", CHAIN),
        Check("stress kept by sliding, soft, mean", 0.75, kept, 0, "1", CHAIN, "at least"),
        Check("stress kept by sliding, stiff, mean", 0.5, released, 0, "1", CHAIN, "at most"),
        Check("correlation of length and force, precursors that drop it", 0.5, correlation, 0, "1", CHAIN, "at least"),
        run_time("run time to the fifth large event", 60, seconds),
        *front_speed_checks(soft),
    ]


def front_speed_checks(printed: xarray.Dataset) -> list[Check]:
    """Return the checks of what decides the speed of fronts: damping over the frequency sqrt(K_s / m) of the contacts.

    The source says in words that fronts accelerate until they approach the wave speed of the chain. With the printed
    damping a block on its contacts is overdamped, eta > 2 sqrt(K_s / m).
    """
    model = SpringBlock(large_events=1, duration=3.0)
    bounds: tuple[tuple[str, dict[str, float], Literal["at least", "at most"], float], ...] = (
        ("damping / 3", {"damping": PRINTED_DAMPING / 3}, "at most", 0.2),
        ("damping / 10", {"damping": PRINTED_DAMPING / 10}, "at least", 0.2),
        ("damping / 100", {"damping": PRINTED_DAMPING / 100}, "at least", 0.5),
        ("mass of the block, printed damping", {"mass": BLOCK_MASS}, "at least", 0.2),
        ("scatter of 0.2, printed damping", {"scatter": 0.2}, "at most", 0.1),
        ("delay of 50 ms, printed damping", {"delay": 0.05}, "at most", 0.1),
    )
    name = "median speed of fronts over the chain's"
    frequency = np.sqrt(model.interface_ratio * model.stiffness * model.blocks / model.mass)
    return [
        Check("damping over the frequency of a block on its contacts", 2, PRINTED_DAMPING / frequency, 0, "1", CHAIN,
              "at least"),
        Check(f"{name}, printed damping", 0.1, float(printed.front_speed), 0, "1", CHAIN, "at most"),
        *(
            Check(f"{name}, {what}", bound, float(model.model_copy(update=changes).run().front_speed), 0, "1", CHAIN,
                  relation)
            for what, changes, relation, bound in bounds
        ),
    ]  # fmt: skip


def slider_checks() -> list[Check]:
    """Return the checks of the rate-and-state slider."""
    slow, slow_omega = onset(pmma(K_C), 1e-6)
    mass, fast = WEIGHT / 9.81, 1e-4
    heavy, heavy_omega = onset(pmma(K_C, mass), fast)
    # Ruina (1983): K_c = W (b - a) / D_c; with inertia times 1 + M V^2 / (W a D_c); frequency (V / D_c) sqrt(b/a - 1).
    inertia = 1 + mass * fast**2 / (WEIGHT * A * D_C)
    rate = np.sqrt((B - A) / A) / D_C
    holds = SlideHoldSlide(holds=[1e3, 1e4, 1e5]).run(pmma(2 * K_C), silent)
    load = modulation()
    law = pmma(K_C, WEIGHT / 9.81, 0.429e-6).with_stiffness(1e-3)
    resonance = float(np.abs(linear_rates(law, 1e-12).imag).max()) / (2 * np.pi)
    table = ModulatedLoad(amplitudes=[0.2])
    lowered = table.critical_stiffness(pmma(K_C, interface_length=0.4e-6), 0.2)
    diagram, seconds = timed(lambda: StabilityDiagram().run(pmma(K_C), silent))
    cells = float(np.abs((diagram.k_c_simulated - diagram.k_c_linear) / diagram.cell).max())
    return [
        Check("K_c by simulation, quasi-static", K_C, slow, 0.001, "N/m", SLOW, relative=True),
        Check("frequency at onset", rate * 1e-6, slow_omega, 0.001, "rad/s", SLOW, relative=True),
        Check("K_c by simulation, inertia, 100 um/s", K_C * inertia, heavy, 0.001, "N/m", INERTIA, relative=True),
        Check("frequency at onset, inertia", rate * fast, heavy_omega, 0.001, "rad/s", INERTIA, relative=True),
        Check("static friction per e-fold of hold", B, float(holds.healing_slope), 0.01, "1", SLOW, relative=True),
        *(
            Check(
                f"change of mean friction, load amplitude {eps:g}",
                change,
                float(load.mean_change.sel(eps=eps)),
                0.02,
                "1",
                INDEPENDENT,
                relative=True,
            )
            for eps, change in MODULATION.items()
        ),
        Check("K_c under load amplitude 0.2 over K_c", 1, lowered / K_C, 0, "1", SLOW, "at most"),
        Check("resonance of the pinned contact, lambda 0.429 um", 761, resonance, 0.001, "Hz", SLOW, relative=True),
        Check("error of the 40 x 40 diagram, cells", 0.5, cells, 0.02, "1", "linear analysis", "at most"),
        run_time("run time of the 40 x 40 diagram", 60, seconds),
    ]


def asperity_checks() -> list[Check]:
    """Compare the population with its infinite limit, and the fitted laws with its velocity steps."""
    model = AsperityPopulation()
    data, seconds = timed(model.run)
    steps = np.flatnonzero(np.diff(data.slip_rate)) + 1
    first, fastest = (data.isel(sample=part) for part in (slice(0, steps[0]), slice(*steps[2:4])))
    late = fastest.isel(sample=slice(-fastest.sizes["sample"] // 10, None))
    span = float(data.friction.max() - data.friction.min())
    quadrature, emerges = "quadrature", "Hulikal et al. (2015): rate and state emerge"
    # Lengths without memory: the mean age of contacts is mean length / slip rate. The direct effect is that of the real
    # area, strengthening times friction; weakening between two slip rates is (b - a) of any law that fits.
    weakening = (model.steady(1e-6) - model.steady(1e-4)) / np.log(100)
    fitted = float(data.ageing_b - data.ageing_a)
    direct = model.shear_strengthening * model.steady(1e-6)
    return [
        Check("asperities: steady friction at 1 um/s", model.steady(1e-6), float(first.friction.mean()), 0.002, "1",
              quadrature, relative=True),
        Check("asperities: steady friction at 100 um/s", model.steady(1e-4), float(late.friction.mean()), 0.005, "1",
              quadrature, relative=True),
        Check("asperities: mean age of contacts at 1 um/s", 0.4, float(first.mean_age.mean()), 0.03, "s",
              "mean length / slip rate", relative=True),
        Check("asperities: b - a of the ageing law", weakening, fitted, 0.15, "1", quadrature, relative=True),
        Check("asperities: a of the ageing law", direct, float(data.ageing_a), 0.25, "1", emerges, relative=True),
        Check("asperities: misfit of the ageing law over the range of friction", 0.03,
              float(data.ageing_misfit) / span, 0, "1", emerges, "at most"),
        Check("asperities: healing per e-fold over b of the ageing law", 1, float(data.healing / data.ageing_b), 0, "1",
              emerges, "at least"),
        run_time("asperities: run time", 20, seconds),
    ]  # fmt: skip


def figure() -> Figure:
    """Draw amplitude against alpha, and mean friction against load amplitude, with the expected numbers."""
    from ruptfx.results.figure_style import STEADY, STICK_SLIP, letter, new_figure, styled

    @styled
    def draw() -> Figure:
        picture, axes = new_figure(1, 2, 2.7)
        left, right = axes[0]
        data, load = ensembles()[0], modulation()
        left.plot(data.alpha_fine, data.limit_amplitude, color=STEADY, label=r"$N\to\infty$")
        mean, scatter = data.late_amplitude.mean("realisation"), data.late_amplitude.std("realisation")
        left.errorbar(data.alpha, mean, scatter, fmt="o", color=STEADY, capsize=2, label="300 blocks")
        left.plot(list(PILOT), list(PILOT.values()), "x", color=STICK_SLIP, markersize=6, label="expected")
        left.set(xscale="log", xlabel=r"Shape parameter $\alpha$", ylabel="Late amplitude")
        right.plot(load.eps, 100 * load.mean_change, "o-", color=STEADY, label="slider")
        right.plot(
            list(MODULATION),
            [100 * v for v in MODULATION.values()],
            "x",
            color=STICK_SLIP,
            markersize=6,
            label="expected",
        )
        right.plot(load.eps, 100 * load.law, "--", color="0.4", label="constant age")
        right.set(xlabel=r"Load amplitude $\epsilon$", ylabel="Change of mean friction (%)")
        left.legend()
        right.legend()
        letter(axes[0])
        return picture

    return draw()
