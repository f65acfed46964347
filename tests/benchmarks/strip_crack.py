"""A crack runs along a weak plane of a strip between fixed grips, and stays below the Rayleigh wave.

Far ahead of the tip the strip of the height 2 H stores W = sigma^2 H / M per length, M the modulus without lateral
contraction, and far behind it nothing. A crack of the fracture energy G < W cannot be steady below c_R: it would take
up all of W. It has W - G to speed up with, and comes the closer to c_R the larger W / G is (Marder 1991; Goldman, Livne
and Fineberg 2010). Bounds of the mean speed in the last third of the way: never c_R, 0.75 c_R at W = 2 G, 0.88 at 4
and, fine, 0.92 at 8, which cracks between triangles reached. Plane stress, order 4; the first 1.5 H are open from the
start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import rupture
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

PMMA = IsotropicElastic(young_modulus=3.24e9, poisson_ratio=0.35, density=1190.0)
MODULUS = 3.24e9 / (1 - 0.35**2)  # Pa, without contraction along the strip
HALF, LENGTH, CUT = 10e-3, 65e-3, 15e-3  # m: H, of the strip, of the first crack
TENSION = 3e6  # Pa
ZONE = 0.06  # M G / f_t^2 over H at W = 4 G, half of it at 8 and as much at 2
BOUNDS = {2.0: 0.75, 4.0: 0.88, 8.0: 0.92}
SOURCE = "energy balance, Marder (1991)"


def front(ratio: float, fine: bool) -> tuple[np.ndarray, np.ndarray, Check]:
    """Return position [m] and time [s] of the front, and the energy check."""
    energy = TENSION**2 * HALF / MODULUS / ratio
    zone = ZONE * min(1.0, 4 / ratio) * HALF
    strength = float(np.sqrt(MODULUS * energy / zone))
    size = zone / (2.0 if fine else 1.2)
    case = {
        "plane": "stress", "order": 4, "duration": 1.6 * (LENGTH - CUT) / PMMA.wave_speeds("stress").c_R,
        "mesh": {"kind": "two_plates", "length": LENGTH, "height": HALF, "element_size": size, "growth": 1.1},
        "materials": {"default": PMMA.model_dump()},
        "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 0.5},
            "initial_stress": {"tensor": [0.0, TENSION, 0.0]},
            "cohesion": {
                "kind": "linear", "G_Ic": energy, "G_IIc": energy,
                **{name: {
                    "kind": "boxcar", "inside": 0.0, "outside": strength, "center": 0.0, "half_width": CUT,
                } for name in ("f_t", "c")},
            },
        }},
        "boundaries": [
            {"kind": "driven", "edge": edge, "component": component, "velocity": 0.0}
            for edge in ("upper.top", "lower.bottom") for component in "xy"
        ],
    }  # fmt: skip
    result = rupture(case)
    failed = result.opening > 2 * energy / strength
    first = np.argmax(failed, axis=0)
    arrived = failed.any(axis=0) & (first > 0) & (result.position > CUT * (1 + 1e-6))
    order = np.argsort(result.position[arrived])
    return result.position[arrived][order], result.time[first[arrived]][order], result.budget(tolerance=1e-10)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    c_R = PMMA.wave_speeds("stress").c_R
    checks, curves = [], []
    for ratio, least in list(BOUNDS.items())[: None if fine else 2]:
        place, time, budget = front(ratio, fine)
        grid = np.arange(CUT + 2e-3, LENGTH - HALF, 1e-3)
        arrival = np.interp(grid, place, time)
        speed = 4e-3 / (arrival[4:] - arrival[:-4]) / c_R
        last = grid[2:-2] > CUT + 2 / 3 * (LENGTH - HALF - CUT)
        name = f"W = {ratio:g} G"
        checks += [
            Check(f"{name}: mean speed in the last third", least, float(1 / np.mean(1 / speed[last])), 0.0, "c_R",
                  SOURCE, "at least"),
            Check(f"{name}: fastest over 4 mm", 1.0, float(speed.max()), 0.0, "c_R", SOURCE, "at most"),
            budget,
        ]  # fmt: skip
        curves.append((name, grid[2:-2], speed))
    return Outcome(checks, lambda: _draw(curves))


def _draw(curves: list[tuple[str, np.ndarray, np.ndarray]]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((ax,),) = new_figure(1, 1, 3.0, 5)
    for name, place, speed in curves:
        ax.plot((place - CUT) / HALF, speed, lw=1, label=name)
    ax.axhline(1.0, color="k", ls=":", lw=0.8)
    ax.set(xlabel="way of the front / H", ylabel="front speed / $c_R$", ylim=(0, 1.1))
    ax.legend(frameon=False)
    return figure
