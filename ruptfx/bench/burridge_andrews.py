"""Burridge-Andrews bracket: in plane strain a rupture with S = 1.2 goes supershear, one with S = 2.0 never does.

S = (tau_s - tau_0) / (tau_0 - tau_d); the limit is 1.77 for nu = 0.25 (Burridge 1973; Andrews 1976). Both ruptures run
over more than 30 critical half-lengths a_c = Gamma E' / (pi dtau^2).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.analysis import fracture
from ruptfx.bench import Check, Outcome
from ruptfx.bench._rupture import Rupture, elastic, rupture
from ruptfx.materials.isotropic_elastic import rayleigh_speed

C_S, C_P, DENSITY = 1000.0, np.sqrt(3) * 1000.0, 2000.0
C_R = rayleigh_speed(C_P, C_S)
DROP = 1e6  # Pa, tau_0 - tau_d
SIGMA = 10e6
MODULUS = fracture.effective_modulus(DENSITY * C_S**2, C_P, C_S)


def crack(ratio: float, reach: float, per_zone: float, duration: float, start: float = 1.1) -> tuple[Rupture, float]:
    """Spontaneous rupture from a forced one of `start` critical half-lengths; the run and a_c [m].

    Parameters
    ----------
    ratio : S
    reach, duration : length [a_c] and time [a_c / c_s] of the model
    per_zone : nodes in the static process zone
    """
    slip = 1e-3 * (2.2 / (1 + ratio))
    zone = fracture.static_process_zone(MODULUS, slip, (1 + ratio) * DROP)
    critical = fracture.critical_half_length(0.5 * (1 + ratio) * DROP * slip, 2 * MODULUS, DROP)
    table = {
        "plane": "strain", "order": 4, "duration": duration * critical / C_S,
        "mesh": {
            "kind": "half_plate", "length": reach * critical, "height": 0.5 * reach * critical,
            "element_size": 4 * zone / per_zone,
        },
        "materials": {"default": elastic(C_P, C_S, DENSITY)},
        "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "initial_stress": {"normal": SIGMA, "shear": 0.2 * SIGMA + DROP},
            "friction": {
                "kind": "linear_slip_weakening", "mu_s": 0.2 + (1 + ratio) * DROP / SIGMA, "mu_d": 0.2, "D_c": slip,
            },
            "nucleation": {
                "kind": "forced_rupture", "center": 0.0, "radius": start * critical, "speed": 0.4 * C_S, "mu_d": 0.2,
                "t_w": 4 * zone / per_zone / (0.4 * C_S),
            },
        }},
        "boundaries": [
            {"kind": "driven", "edge": "upper.left", "component": "y", "velocity": 0.0},
            {"kind": "absorbing", "edge": "upper.top"}, {"kind": "absorbing", "edge": "upper.right"},
        ],
    }  # fmt: skip
    return rupture(table, stride=2), critical


def front(result: Rupture, critical: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half-length [a_c], arrival [s] and smoothed front speed [m/s]."""
    arrival = result.rupture_time(1e-3 * DROP / (DENSITY * C_S))
    x = result.position
    slid = np.isfinite(arrival)
    grid = np.arange(0.2, x[slid].max() / critical, 0.1)
    when = np.interp(grid * critical, x[slid], arrival[slid])
    # Slope of a line through five points, 0.4 a_c.
    width = 2
    speed = np.array([
        np.polyfit(when[i - width : i + width + 1], grid[i - width : i + width + 1] * critical, 1)[0]
        if width <= i < len(grid) - width else np.nan for i in range(len(grid))
    ])  # fmt: skip
    return grid, when, speed


def run(fine: bool, comm: Any) -> Outcome:
    del comm
    checks, curves = [], []
    for ratio, reach, supershear in ((1.2, 50.0, True), (2.0, 34.0, False)):
        result, critical = crack(ratio, reach, 8.0 if fine else 5.0, 1.3 * reach)
        length, _, speed = front(result, critical)
        inside = (length > 2) & (length < reach - 2)
        fastest = float(np.nanmax(speed[inside])) / C_S
        checks.append(Check(f"S = {ratio}: reach", 30.0, float(length[-1]), 0, "a_c", "model", "at least"))
        if supershear:
            late = float(np.median(speed[(length > reach - 12) & (length < reach - 2)])) / C_S
            checks.append(Check("S = 1.2: late speed / c_s", 1.0, late, 0, "1", "Andrews (1976)", "at least"))
            # The last place below c_s: single points of a sub-Rayleigh front scatter up to it.
            jump = float(length[inside & (speed < C_S)].max())
            checks.append(Check("S = 1.2: faster than c_s from", 30.0, jump, 0, "a_c", "Andrews (1976)", "at most"))
        else:
            checks.append(Check("S = 2.0: fastest / c_s", 1.0, fastest, 0, "1", "Andrews (1976)", "at most"))
        checks.append(result.budget())
        curves.append((ratio, length, speed))
    return Outcome(checks, lambda: _draw(curves))


def _draw(curves: list) -> Any:
    from matplotlib import pyplot as plt

    figure, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
    for ratio, length, speed in curves:
        ax.plot(length, speed / C_S, label=f"S = {ratio}")
    for level, name in ((C_R / C_S, "$c_R$"), (np.sqrt(2), "$\\sqrt{2} c_s$"), (C_P / C_S, "$c_p$")):
        ax.axhline(level, color="0.6", lw=0.8, ls=":")
        ax.text(50.5, level, name, va="center")
    ax.set(xlabel="half-length / $a_c$", ylabel="front speed / $c_s$", xlim=(0, 50), ylim=(0, 2))
    ax.legend(frameon=False)
    return figure
