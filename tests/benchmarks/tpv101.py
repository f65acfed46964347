"""TPV101 along a line: rate and state friction with the ageing law, smooth nucleation; in-plane.

SCEC/USGS benchmark TPV101 in two dimensions: initial state to all digits, convergence of front speed and peak slip
rate under refinement, and the evolution of the law itself against exact solutions (velocity step, hold). Peaks are
those of running means over 0.03 s, what an S wave needs for 100 m, on every mesh; Kelvin-Voigt viscosity in units of
the stable step falls with the spacing, so that it does not set the order of the front. Rupture times and peaks
converge if the last halving of the spacing changes them by less than 0.6 of what the halving before did; front speeds
are compared with those of the finest mesh (a slope of arrivals that all shift alike changes by 0.3 % or less).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import Rupture, elastic, rupture
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

LENGTH, HEIGHT = 19e3, 6e3  # m, of the quarter that is modelled: x > 0, y > 0
C_S = 3464.0
SOURCE = "SCEC/USGS TPV101"
LAW = {"kind": "rate_and_state_ageing", "b": 0.012, "D_c": 0.02, "f_0": 0.6, "V_0": 1e-6, "V_initial": 1e-12}
TAPER = {"kind": "taper", "center": 0.0, "half_width": 15e3, "width": 3e3}
STATE, VALUE = "theta", 1.606238999213454e9
DURATION = 6.0


def case(spacing: float) -> Table:
    """Return the case with nodes `spacing` [m] apart."""
    return line(spacing, {**LAW, "a": {**TAPER, "inside": 0.008, "outside": 0.016}}, 75e6, 25e6, DURATION)


def line(spacing: float, law: Table, shear: float, extra: float, duration: float) -> Table:
    """Return a rate-and-state benchmark of this family: a half model, symmetric about x = 0 too."""
    return {
        "plane": "strain", "order": 4, "duration": duration,
        "mesh": {
            "kind": "half_plate", "length": LENGTH, "height": HEIGHT, "element_size": 4 * spacing,
        },
        "materials": {"default": elastic(6000.0, C_S, 2670.0)},
        "damping": {"kelvin_voigt": {"fraction": 0.1 * min(1.0, spacing / 100.0)}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": law, "initial_stress": {"normal": 120e6, "shear": shear},
            "nucleation": {"kind": "smooth_patch", "extra": extra, "center": 0.0, "radius": 3e3, "rise": 1.0},
        }},
        "boundaries": [
            {"kind": "driven", "edge": "upper.left", "component": "y", "velocity": 0.0},
            {"kind": "absorbing", "edge": "upper.right"}, {"kind": "absorbing", "edge": "upper.top"},
        ],
    }  # fmt: skip


def converge(
    make: Callable[[float], Table], state: str, value: float, source: str, fine: bool
) -> tuple[list[Check], list[Rupture]]:
    """Check the initial state, and the convergence of rupture time, front speed and peaks on three meshes."""
    spacings = (50.0, 25.0, 12.5) if fine else (100.0, 50.0, 25.0)
    runs = [rupture(make(h), energies=4) for h in spacings]
    initial = runs[0].model.faults[0].initial_state()[state]
    checks = [Check(f"initial {state}", value, float(initial[0]), 1e-14, "", source, relative=True)]
    numbers = [facts(r) for r in runs]
    # Near the nucleation a spacing of 100 m is too coarse for a ratio.
    near = "peak slip rate at 9 km"
    for name, (limit, unit) in {
        "rupture time at 12 km": (5e-3, "s"), "front speed, 5 to 12 km": (0.01 if fine else 0.03, "m/s"),
        "peak slip rate at 12 km": (0.05, "m/s"), near: (0.05, "m/s"),
    }.items():  # fmt: skip
        coarse, middle, best = (each[name] for each in numbers)
        if fine or "speed" in name:
            text = f"{name}, {spacings[1]:g} against {spacings[2]:g} m"
            checks.append(Check(text, best, middle, limit, unit, "own finer mesh", relative=True))
        if "speed" not in name and (fine or name != near):
            ratio = abs(best - middle) / abs(middle - coarse)
            checks.append(Check(f"{name}: change over that before", 0.6, ratio, 0, "1", "converges", "at most"))
    checks += [r.budget() for r in runs]
    return checks, runs


def facts(result: Rupture) -> dict[str, float]:
    """Return rupture time, front speed and peak slip rates of a run, by name."""
    arrival, x = result.rupture_time(1e-1), result.position
    part = (x > 5e3) & (x < 12e3) & np.isfinite(arrival)
    speed = np.polyfit(arrival[part], x[part], 1)[0] if part.sum() > 10 else np.nan
    peak = result.mean_peak(100.0 / C_S)
    peaks = {f"peak slip rate at {place / 1e3:g} km": float(np.interp(place, x, peak)) for place in (12e3, 9e3)}
    time = float(np.interp(12e3, x, arrival))
    return {"rupture time at 12 km": time, "front speed, 5 to 12 km": float(speed), **peaks}


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    checks, runs = converge(case, STATE, VALUE, SOURCE, fine)
    law = RateAndStateAgeing(a=0.008, **{key: v for key, v in LAW.items() if key != "kind"})
    one, sigma = np.ones(1), 1e6 * np.ones(1)
    # Velocity step from 1e-6 to 1e-3 m/s: theta = L/V2 + (L/V1 - L/V2) exp(-slip/L); hold: theta grows by its time.
    state = {"theta": 0.02 / 1e-6 * one}
    for _ in range(50):
        state = law.advance(state, 1e-3 * one, sigma, 0.2)  # slip 0.01 m in all
    exact = 20.0 + (2e4 - 20.0) * np.exp(-0.5)
    checks.append(Check("velocity step: theta", exact, float(state["theta"][0]), 1e-12, "s", "exact", relative=True))
    held = law.advance({"theta": 20.0 * one}, 0 * one, sigma, 1e4)["theta"][0]
    checks.append(Check("hold of 1e4 s: theta", 10020.0, float(held), 1e-12, "s", "exact", relative=True))
    return Outcome(checks, lambda: draw(runs))


def draw(runs: list[Rupture]) -> Figure:
    """Draw rupture times and slip-rate histories of the three meshes."""
    from ruptfx.results.figure_style import new_figure

    figure, ((left, right),) = new_figure(1, 2, 3.2, 8)
    for result, style in zip(runs, (":", "--", "-"), strict=True):
        x = result.position / 1e3
        spacing = 1e3 * np.median(np.diff(x))
        left.plot(x, result.rupture_time(1e-1), style, color="C0", label=f"nodes about {spacing:.3g} m apart")
        for k, place in enumerate((0.0, 4.5e3, 9e3, 12e3)):
            label = f"{place / 1e3:g} km" if style == "-" else None
            rate = np.abs(result.slip_rate[:, result.at(place)])
            right.plot(result.time, rate, style, color=f"C{k}", lw=1, label=label)
    left.set(xlabel="x (km)", ylabel="time of 0.1 m/s (s)", xlim=(0, 18))
    left.legend(frameon=False)
    right.legend(frameon=False)
    right.set(xlabel="time (s)", ylabel="slip rate (m/s)")
    return figure
