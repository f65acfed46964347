"""Mode I growth under uniform tension against the equation of motion of a bilateral crack.

The counterpart of `growth` on a cohesive interface. The energy release of the self-similar crack balances the
fracture energy: a / a_c = (G F / G*)^2 A_I (`ruptfx.laws.fracture.half_length_at`), a_c = Gamma E' / (pi sigma^2).
A crack that opens at once would send out waves of its own. Here Gamma grows linearly from the middle to the half-length
at which a crack of that Gamma runs at 0.4 c_R, so that it runs that fast from nearly nothing; from there on Gamma is
uniform and the crack accelerates. A strength of seven times the tension keeps the process zone small; within, it grows
with the root of Gamma, which keeps the zone as long.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import elastic, rupture
from ruptfx.app.bench.burridge_andrews import C_P, C_R, C_S, DENSITY, MODULUS
from ruptfx.laws import fracture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

TENSION, STRENGTH, OPENING = 1e6, 7e6, 3e-4  # Pa, Pa, m at failure
ENERGY = 0.5 * STRENGTH * OPENING
CRITICAL = fracture.critical_half_length(ENERGY, 2 * MODULUS, TENSION)
ZONE = fracture.static_process_zone(MODULUS, OPENING, STRENGTH)
BEGIN = 0.4 * C_R
UNIFORM = fracture.half_length_at(BEGIN, C_P, C_S, "I")  # a_c, from which on Gamma is
CUT = 0.2  # a_c, open from the start


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    reach, size = (5.0, 0.75 * ZONE) if not fine else (7.0, 0.4 * ZONE)
    place = np.array([0.0, CUT, *np.geomspace(1.001 * CUT, UNIFORM, 100)])
    part = place / UNIFORM
    strength = np.where(place <= CUT, 0.0, STRENGTH * np.sqrt(part))

    def along(values: np.ndarray) -> Table:
        positions = (place * CRITICAL).tolist()
        return {"kind": "table", "positions": positions, "values": values.tolist(), "extend": True}

    energy = along(ENERGY * np.maximum(part, CUT / UNIFORM))
    result = rupture({
        "plane": "strain", "order": 4, "duration": (1.9 * reach) * CRITICAL / C_S,
        "mesh": {
            "kind": "two_plates", "length": reach * CRITICAL, "height": 0.6 * reach * CRITICAL, "element_size": size,
            "growth": 1.05,
        },
        "materials": {"default": elastic(C_P, C_S, DENSITY)}, "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 0.5},
            "initial_stress": {"tensor": [0.0, TENSION, 0.0]},
            "cohesion": {
                "kind": "linear", "f_t": along(strength), "c": along(strength), "G_Ic": energy, "G_IIc": energy,
            },
        }},
        "boundaries": [
            {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 0.0},
            {"kind": "driven", "edge": "lower.left", "component": "x", "velocity": 0.0},
            *({"kind": "absorbing", "edge": edge} for edge in (
                "upper.top", "upper.right", "lower.bottom", "lower.right")),
        ],
    })  # fmt: skip
    length, speed = front(result.position, result.time, result.opening)
    inside = (length > 1.7) & (length < 0.75 * reach) & np.isfinite(speed)
    theory = np.array([fracture.speed_at(a, C_P, C_S, C_R, "I") for a in length[inside]])
    worst = float(np.max(np.abs(speed[inside] - theory))) / C_R if inside.any() else np.nan
    checks = [
        Check("reach", 0.75 * reach, float(length[-1]), 0.0, "a_c", "model", "at least"),
        Check(
            f"largest |v - theory|, 1.7 < a/a_c < {0.75 * reach:.3g}",
            0.0,
            worst,
            0.03,
            "c_R",
            "Broberg (1960); Freund (1990)",
        ),
        Check("fastest", 1.0, float(np.nanmax(speed)) / C_R, 0.0, "c_R", "Freund (1990)", "at most"),
        result.budget(),
    ]
    return Outcome(checks, lambda: _draw(length, speed, inside))


def front(position: np.ndarray, time: np.ndarray, opening: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return half-length [a_c] and speed of the front [m/s], where a part of the opening at failure is reached."""
    level = 0.1 * OPENING
    reached = opening > level
    first = np.argmax(reached, axis=0)
    arrived = reached.any(axis=0) & (first > 0) & (position > CUT * CRITICAL)
    point = np.flatnonzero(arrived)
    before, after = opening[first[point] - 1, point], opening[first[point], point]
    part = (level - before) / (after - before)
    when = time[first[point] - 1] + part * (time[first[point]] - time[first[point] - 1])
    grid = np.arange(CUT + 0.1, position[point].max(initial=0.0) / CRITICAL, 0.1)
    arrival = np.interp(grid * CRITICAL, position[point], when)
    speed, width = np.full(len(grid), np.nan), 4
    for i in range(width, len(grid) - width):
        near = slice(i - width, i + width + 1)
        speed[i] = CRITICAL / np.polyfit(grid[near] - grid[i], arrival[near], 2)[1]
    return grid, speed


def _draw(length: np.ndarray, speed: np.ndarray, inside: np.ndarray) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((ax,),) = new_figure(1, 1, 3.2, 5)
    v = np.linspace(0.01, 0.98, 100) * C_R
    known = np.maximum(v, BEGIN) / C_R
    ax.plot([fracture.half_length_at(x, C_P, C_S, "I") for x in v], known, "k:", label="equation of motion")
    ax.plot(length, speed / C_R, lw=0.8, color="0.6")
    ax.plot(length[inside], speed[inside] / C_R, label="cohesive interface")
    ax.set(xlabel="half-length / $a_c$", ylabel="front speed / $c_R$", xlim=(0, 1.2 * length[-1]), ylim=(0, 1.1))
    ax.legend(frameon=False)
    return figure
