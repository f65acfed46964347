"""Self-similar mode II and mode III cracks at a forced speed: slip = 2 T / (G F) sqrt(v^2 t^2 - x^2).

Sources: Kostrov (1964) for mode III, F = E(k); Burridge and Willis (1969) for mode II. The strength drops within the
time in which the front passes one node spacing, so that the error is of first order in the spacing. It has two parts of
opposite sign: the front is late by that time, and ahead by a part of a spacing. Where they cancel (mode III at
0.5 c_s, 3e-3 on 4 and on 2 mm) the errors of neighbouring meshes say nothing of the order; the fine run looks over two
halvings.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import Rupture, elastic, rupture
from ruptfx.laws import fracture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

C_S, C_P, DENSITY = 1000.0, np.sqrt(3) * 1000.0, 2000.0
DROP, SIGMA = 1e6, 10e6
REACH = 0.6  # m, half-length of the crack at the end


def crack(plane: str, fraction: float, spacing: float) -> Rupture:
    """Run a quarter of the problem: symmetric about x = 0 too, where the normal motion is zero (mode II)."""
    speed = fraction * C_S
    duration = REACH / speed
    # Far enough for no reflection to come back.
    size = 0.55 * C_P * duration if plane == "strain" else 0.55 * C_S * duration
    length = max(2 * size, 1.3 * REACH)
    arrival = {"kind": "cone", "slope": 1 / speed, "center": 0.0}
    table = {
        "plane": plane, "order": 4, "duration": duration,
        "mesh": {"kind": "half_plate", "length": length, "height": size, "element_size": 4 * spacing},
        "materials": {"default": elastic(C_P, C_S, DENSITY)},
        "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "initial_stress": {"normal": SIGMA, "shear": 0.5 * SIGMA + DROP},
            "friction": {
                "kind": "time_weakening", "mu_s": 50.0, "mu_d": 0.5, "arrival": arrival, "t_w": spacing / speed,
            },
        }},
    }  # fmt: skip
    if plane == "strain":
        table["boundaries"] = [{"kind": "driven", "edge": "upper.left", "component": "y", "velocity": 0.0}]
    return rupture(table)


def misfit(result: Rupture, plane: str, fraction: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Return largest relative slip error over the inner 80 % of the crack, slip and exact slip [m]."""
    speed = fraction * C_S
    factor = (
        fracture.self_similar_factor_III(speed, C_S) if plane == "antiplane"
        else fracture.self_similar_factor_II(speed, C_P, C_S)
    )  # fmt: skip
    x, time = result.position, result.state.time
    exact = 2 * DROP / (DENSITY * C_S**2 * factor) * np.sqrt(np.maximum((speed * time) ** 2 - x**2, 0))
    slip = np.abs(result.fields["slip"])
    inner = x < 0.8 * speed * time
    return float(np.max(np.abs(slip[inner] / exact[inner] - 1))), slip, exact


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    checks, curves = [], []
    spacings = (8e-3, 2e-3) if fine else (8e-3, 4e-3)
    for plane, name in (("antiplane", "III"), ("strain", "II")):
        for fraction in (0.3, 0.5, 0.7, 0.9) if fine else (0.5, 0.7):
            errors = []
            for spacing in spacings:
                result = crack(plane, fraction, spacing)
                error, slip, exact = misfit(result, plane, fraction)
                errors.append(error)
            label = f"mode {name} at {fraction} c_s"
            source = "Kostrov (1964)" if name == "III" else "Burridge and Willis (1969)"
            checks.append(Check(f"{label}: largest slip error", 0.0, errors[-1], 1.5e-2, "1", source))
            coarser = f"{spacings[0] / spacings[1]:g} times the spacing"
            checks.append(Check(f"{label}: error over that of {coarser}", 0.7, errors[1] / errors[0], 0, "1",
                                "falls with the mesh", "at most"))  # fmt: skip
            checks.append(result.budget())
            curves.append((label, result.position, slip, exact))
    return Outcome(checks, lambda: _draw(curves))


def _draw(curves: list) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, (axes,) = new_figure(1, 2, 3.2, 8)
    for label, x, slip, exact in curves:
        ax = axes[0] if "III" in label else axes[1]
        (line,) = ax.plot(x, slip * 1e3, label=label.replace("c_s", "$c_s$"))
        ax.plot(x, exact * 1e3, ":", color="k", lw=1)
        del line
    for ax in axes:
        ax.set(xlabel="x (m)", ylabel="slip (mm)", xlim=(0, 0.75))
        ax.legend(frameon=False)
    return figure
