"""TPV101 along a line: rate and state friction with the ageing law, smooth nucleation; in-plane.

SCEC/USGS benchmark TPV101 in two dimensions: initial state to all digits, convergence of front speed and peak slip
rate under refinement, and the evolution of the law itself against exact solutions (velocity step, hold).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.bench import Check, Outcome
from ruptfx.bench._rupture import Rupture, elastic, rupture
from ruptfx.friction.rate_and_state_ageing import RateAndStateAgeing

LENGTH, HEIGHT = 19e3, 6e3  # m, of the quarter that is modelled: x > 0, y > 0
SOURCE = "SCEC/USGS TPV101"
LAW = {"kind": "rate_and_state_ageing", "b": 0.012, "D_c": 0.02, "f_0": 0.6, "V_0": 1e-6, "V_initial": 1e-12}
TAPER = {"kind": "taper", "center": 0.0, "half_width": 15e3, "width": 3e3}
STATE, VALUE = "theta", 1.606238999213454e9
DURATION = 6.0


def case(spacing: float) -> dict[str, Any]:
    return line(spacing, {**LAW, "a": {**TAPER, "inside": 0.008, "outside": 0.016}}, 75e6, 25e6, DURATION)


def line(spacing: float, law: dict[str, Any], shear: float, extra: float, duration: float) -> dict[str, Any]:
    """A rate-and-state benchmark of this family: a half model, symmetric about x = 0 too."""
    return {
        "plane": "strain", "order": 4, "duration": duration,
        "mesh": {
            "kind": "half_plate", "length": LENGTH, "height": HEIGHT, "element_size": 4 * spacing,
        },
        "materials": {"default": elastic(6000.0, 3464.0, 2670.0)}, "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": law, "initial_stress": {"normal": 120e6, "shear": shear},
            "nucleation": {"kind": "smooth_patch", "extra": extra, "center": 0.0, "radius": 3e3, "rise": 1.0},
        }},
        "boundaries": [
            {"kind": "driven", "edge": "upper.left", "component": "y", "velocity": 0.0},
            {"kind": "absorbing", "edge": "upper.right"}, {"kind": "absorbing", "edge": "upper.top"},
        ],
    }  # fmt: skip


def converge(make: Any, state: str, value: float, source: str, fine: bool) -> tuple[list[Check], list[Rupture]]:
    """Initial state, and front speed between 5 and 12 km and peak slip rate at 9 km on three meshes."""
    spacings = (50.0, 25.0, 12.5) if fine else (100.0, 50.0, 25.0)
    runs = [rupture(make(h), energies=4) for h in spacings]
    initial = runs[0].model.faults[0].initial_state()[state]
    checks = [Check(f"initial {state}", value, float(initial[0]), 1e-14, "", source, relative=True)]
    numbers = [facts(r) for r in runs]
    for name, limit in (("front speed, 5 to 12 km", 0.01), ("peak slip rate at 9 km", 0.05)):
        coarse, middle, best = (each[name] for each in numbers)
        if fine:
            text = f"{name}, {spacings[1]:g} against {spacings[2]:g} m"
            checks.append(Check(text, best, middle, limit, "m/s", "own finer mesh", relative=True))
        ratio = abs(best - middle) / abs(middle - coarse)
        checks.append(Check(f"{name}: change over that before", 0.6, ratio, 0, "1", "converges", "at most"))
    checks += [r.budget() for r in runs]
    return checks, runs


def facts(result: Rupture) -> dict[str, float]:
    arrival, x = result.rupture_time(1e-1), result.position
    part = (x > 5e3) & (x < 12e3) & np.isfinite(arrival)
    speed = np.polyfit(arrival[part], x[part], 1)[0] if part.sum() > 10 else np.nan
    peak = np.abs(result.slip_rate[:, result.at(9e3)]).max()
    return {"front speed, 5 to 12 km": float(speed), "peak slip rate at 9 km": float(peak)}


def run(fine: bool, comm: Any) -> Outcome:
    del comm
    checks, runs = converge(case, STATE, VALUE, SOURCE, fine)
    law = RateAndStateAgeing(a=0.008, **{key: v for key, v in LAW.items() if key != "kind"})  # type: ignore[arg-type]
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


def draw(runs: list[Rupture]) -> Any:
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
    for result, style in zip(runs, (":", "--", "-"), strict=True):
        x = result.position / 1e3
        spacing = 1e3 * np.median(np.diff(x))
        left.plot(x, result.rupture_time(1e-1), style, label=f"nodes about {spacing:.0f} m apart")
        for k, place in enumerate((0.0, 4.5e3, 9e3, 12e3)):
            right.plot(result.time, np.abs(result.slip_rate[:, result.at(place)]), style, color=f"C{k}", lw=1)
    left.set(xlabel="x [km]", ylabel="time of 0.1 m/s [s]", xlim=(0, 18))
    left.legend(frameon=False)
    right.set(xlabel="time [s]", ylabel="slip rate at 0, 4.5, 9, 12 km [m/s]")
    return figure
