"""Burridge-Andrews bracket: in plane strain a rupture with S = 1.2 goes supershear, one with S = 2.0 never does.

S = (tau_s - tau_0) / (tau_0 - tau_d); the limit is 1.77 for nu = 0.25 (Burridge 1973; Andrews 1976). Both ruptures run
over 50 critical half-lengths a_c = Gamma E' / (pi dtau^2). At S = 1.2 a daughter crack starts ahead of the front some
35 a_c from the centre, on every mesh: a model of only 30 a_c does not show the transition. The place is checked by a
second mesh; it depends on the damping (39 a_c with a Kelvin-Voigt viscosity of 0.1 stable steps, 35.5 with 0.03, 34
with 0.01), hardly on the nucleation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import Rupture, elastic, rupture
from ruptfx.laws import fracture
from ruptfx.laws.materials.isotropic_elastic import rayleigh_speed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

C_S, C_P, DENSITY = 1000.0, np.sqrt(3) * 1000.0, 2000.0
C_R = rayleigh_speed(C_P, C_S)
DROP = 1e6  # Pa, tau_0 - tau_d
SIGMA = 10e6
MODULUS = fracture.effective_modulus(DENSITY * C_S**2, C_P, C_S)


REACH = 50.0  # a_c


def crack(ratio: float, reach: float, per_zone: float, duration: float, start: float = 1.1) -> tuple[Rupture, float]:
    """Run a spontaneous rupture from a forced one of `start` critical half-lengths; return the run and a_c [m].

    Parameters
    ----------
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
        "damping": {"kelvin_voigt": {"fraction": 0.03}},
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
    return rupture(table), critical


def front(result: Rupture, critical: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return half-length [a_c], arrival [s] and smoothed front speed [m/s], NaN where a crack ahead was earlier."""
    arrival = result.rupture_time(1e-3 * DROP / (DENSITY * C_S))
    slid = np.isfinite(arrival)
    x, arrival = result.position[slid], arrival[slid]
    ahead = np.minimum.accumulate(arrival[::-1])[::-1]
    arrival = np.where(arrival > ahead + 3 * (result.time[2] - result.time[1]), np.nan, arrival)
    grid = np.arange(0.2, x.max() / critical, 0.1)
    when = np.interp(grid * critical, x, arrival)
    speed = np.full(len(grid), np.nan)
    width = 4
    for i in range(width, len(grid) - width):
        part = slice(i - width, i + width + 1)
        if np.isfinite(when[part]).all():  # slope at the middle of a parabola through 0.8 a_c
            speed[i] = critical / np.polyfit(grid[part] - grid[i], when[part], 2)[1]
    return grid, when, speed


def transition(length: np.ndarray, when: np.ndarray) -> float:
    """Return the half-length [a_c] at which a crack ahead of the front begins; NaN if there is none."""
    overtaken = length[np.isnan(when)]
    return float(overtaken.max()) if len(overtaken) else np.nan


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    checks, curves, places = [], [], []
    for ratio, per_zone in ((1.2, 6.0), (1.2, 8.0), (2.0, 5.0)):
        result, critical = crack(ratio, REACH, per_zone * (1.5 if fine else 1.0), 1.3 * REACH)
        length, when, speed = front(result, critical)
        checks.append(Check(f"S = {ratio}: reach", 30.0, float(length[-1]), 0, "a_c", "model", "at least"))
        if ratio < 1.77:
            places.append(transition(length, when))
            late = float(np.median(speed[(length > REACH - 10) & (length < REACH - 2)])) / C_S
            checks.append(Check(f"S = {ratio}: late speed / c_s", 1.0, late, 0, "1", "Andrews (1976)", "at least"))
        else:
            fastest = float(np.nanmax(speed[(length > 2) & (length < REACH - 2)])) / C_S
            checks.append(Check(f"S = {ratio}: fastest / c_s", 1.0, fastest, 0, "1", "Andrews (1976)", "at most"))
        checks.append(result.budget())
        curves.append((f"S = {ratio}, {result.position[4] / critical:.2g} $a_c$ per element", length, speed))
    text = "S = 1.2: supershear from"
    checks.append(Check(text, places[0], places[1], 0.05, "a_c", "coarser mesh", relative=True))
    return Outcome(checks, lambda: _draw(curves))


def _draw(curves: list) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((ax,),) = new_figure(1, 1, 3.4, 6)
    for (label, length, speed), style in zip(curves, ("C0:", "C0-", "C1-"), strict=True):
        ax.plot(length, speed / C_S, style, lw=1, label=label)
    for level, name in ((C_R / C_S, "$c_R$"), (np.sqrt(2), "$\\sqrt{2} c_s$"), (C_P / C_S, "$c_p$")):
        ax.axhline(level, color="0.6", lw=0.8, ls=":")
        ax.text(REACH + 0.5, level, name, va="center")
    ax.set(xlabel="half-length / $a_c$", ylabel="front speed / $c_s$", xlim=(0, REACH), ylim=(0, 2))
    ax.legend(frameon=False, loc="lower right", fontsize=8)
    return figure
