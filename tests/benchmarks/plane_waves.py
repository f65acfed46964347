"""Plane S wave on a Coulomb interface, and a P wave that opens and closes a gap: exact, one-dimensional.

S wave of stress tau_i: a stuck interface would carry tau_0 + 2 Z2 / (Z1 + Z2) tau_i, it carries tau_c = f sigma, and
slides at V = (tau_stuck - tau_c) (Z1 + Z2) / (Z1 Z2), with Z = rho c_s; the wave comes through body 1 (lower).

P wave of tensile stress s(t) between equal bodies under the compression sigma_0: the gap opens when s exceeds sigma_0,
grows at 2 (s - sigma_0) / Z and closes when the integral of that returns to zero; then the interface carries
sigma_0 - s again. The momentum of the upper body is the integral of the pressure beyond sigma_0, here negative: it is
pulled down.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import Rupture, elastic, rupture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

SIGMA, FRICTION, TAU_I = 6e6, 0.2, 1e6
FAST, SLOW = elastic(2200.0, 1255.0, 1246.0), elastic(1600.0, 900.0, 1100.0)
HEIGHT = 40e-3


def column(upper: dict, lower: dict, size: float, height: float) -> Table:
    """Return mesh, materials and fault of a column of two bodies."""
    return {
        "mesh": {"kind": "two_plates", "length": 4 * size, "height": height, "element_size": size},
        "materials": {"upper": upper, "lower": lower}, "faults": {"main": {"contact": {"kind": "split_node"}}},
    }  # fmt: skip


def shear(upper: dict, lower: dict, size: float, stress_0: float) -> tuple[Rupture, float]:
    """Return the run of an S wave from below and the exact slip rate."""
    z = [np.sqrt(m["density"] * m["young_modulus"] / (2 * (1 + m["poisson_ratio"]))) for m in (lower, upper)]
    table = column(upper, lower, size, HEIGHT) | {"plane": "antiplane", "duration": 1.7 * HEIGHT / 1255.0}
    if lower is SLOW:
        table["duration"] = 1.7 * HEIGHT / 900.0
    table["faults"]["main"] |= {
        "friction": {"kind": "coulomb", "mu_d": FRICTION}, "initial_stress": {"normal": SIGMA, "shear": stress_0},
    }  # fmt: skip
    # Drag the lower end against the slip that the initial stress drives: slip = u(plus) - u(minus).
    table["boundaries"] = [
        {"kind": "driven", "edge": "lower.bottom", "component": "z", "velocity": -TAU_I / z[0], "ramp": 2e-6},
        {"kind": "absorbing", "edge": "upper.top"},
    ]
    stuck = stress_0 + 2 * z[1] / (z[0] + z[1]) * TAU_I
    return rupture(table), (stuck - FRICTION * SIGMA) * (z[0] + z[1]) / (z[0] * z[1])


def gap(size: float) -> tuple[Rupture, dict[str, float], tuple[np.ndarray, np.ndarray]]:
    """Run a triangular tensile pulse from below: rise to A in T_1, back to zero at T_2."""
    rise, end, load = 8e-6, 16e-6, 18e6
    height, c_p = 60e-3, 2200.0
    z = FAST["density"] * c_p
    table = column(FAST, FAST, size, height) | {"plane": "strain", "duration": height / c_p + 26e-6}
    table["faults"]["main"] |= {"friction": {"kind": "coulomb", "mu_d": FRICTION}, "initial_stress": {"normal": SIGMA}}
    roller = [
        {"kind": "driven", "edge": f"{body}.{side}", "component": "x", "velocity": 0.0}
        for body in ("upper", "lower") for side in ("left", "right")
    ]  # fmt: skip
    # Two ramps of opposite sign: the sum grows to `load` at `rise` and is zero again at `end`, twice as late.
    table["boundaries"] = [
        *roller,
        {"kind": "traction", "edge": "lower.bottom", "traction": [0.0, -2 * load], "ramp": rise},
        {"kind": "traction", "edge": "lower.bottom", "traction": [0.0, 2 * load], "ramp": end},
        {"kind": "absorbing", "edge": "upper.top"},
    ]
    t = np.linspace(0, 26e-6, 260001)
    stress = 2 * load * (np.minimum(t / rise, 1) - np.minimum(t / end, 1))
    opened = int(np.argmax(stress > SIGMA))
    width = np.cumsum(np.where(np.arange(len(t)) >= opened, 2 * (stress - SIGMA) / z, 0)) * (t[1] - t[0])
    closed = opened + int(np.argmax((width[opened:] <= 0) & (np.arange(len(t) - opened) > 10)))
    width[closed:] = 0
    carried = np.where((np.arange(len(t)) > opened) & (np.arange(len(t)) < closed), 0.0, SIGMA - stress)
    exact = {
        "largest gap": float(width.max()), "time it is open": float(t[closed] - t[opened]),
        "momentum": float(np.sum(carried - SIGMA) * (t[1] - t[0])),
    }  # fmt: skip
    return rupture(table, energies=50), exact, (t + height / c_p, width)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    size = 0.25e-3 if fine else 0.5e-3
    checks, curves = [], []
    for name, upper, lower, stress_0 in (
        ("equal bodies", FAST, FAST, 0.5e6), ("from the slower body", FAST, SLOW, 0.5e6),
        ("from the faster body", SLOW, FAST, 0.8e6),
    ):  # fmt: skip
        result, rate = shear(upper, lower, size, stress_0)
        middle = np.abs(result.slip_rate[:, len(result.position) // 2])
        late = result.time > 0.9 * result.time[-1]
        mean = float(middle[late].mean())
        checks.append(Check(f"slip rate, {name}", rate, mean, 2e-3, "m/s", "exact", relative=True))
        checks.append(result.budget())
        curves.append((name, result.time, middle, rate))
    result, exact, reference = gap(size)
    opening = result.opening
    middle = opening[:, opening.shape[1] // 2]
    step = result.time[2] - result.time[1]
    # Momentum of the upper body per area, while nothing has left it.
    upper = result.model.layout.body == result.model.bodies.names.index("upper")
    mass = result.model.mass.reshape(-1, 2)[:, 1]
    momentum = float(mass[upper] @ result.state.velocity.reshape(-1, 2)[upper, 1]) / float(np.ptp(result.position))
    found = {"largest gap": middle.max(), "time it is open": step * np.count_nonzero(middle > 0), "momentum": momentum}
    units = {"largest gap": "m", "time it is open": "s", "momentum": "Pa s"}
    for name, value in exact.items():
        checks.append(Check(f"P wave, {name}", value, float(found[name]), 0.01, units[name], "exact", relative=True))
    checks.append(result.budget())
    return Outcome(checks, lambda: _draw(curves, result.time, middle, reference))


def _draw(curves: list, time: np.ndarray, middle: np.ndarray, reference: tuple[np.ndarray, np.ndarray]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((left, right),) = new_figure(1, 2, 3.2, 8)
    for name, when, rate, exact in curves:
        (line,) = left.plot(when * 1e6, rate, label=name)
        left.axhline(exact, color=line.get_color(), ls=":", lw=1)
    left.set(xlabel="time (µs)", ylabel="slip rate (m/s)")
    left.legend(frameon=False, loc="center left")
    right.plot(time * 1e6, middle * 1e6)
    right.plot(reference[0] * 1e6, reference[1] * 1e6, "k:", lw=1)
    right.set(xlabel="time (µs)", ylabel="opening (µm)")
    return figure
