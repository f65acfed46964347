"""Mode II growth under uniform stress drop against the equation of motion of a bilateral crack.

The energy release of the self-similar crack balances the fracture energy: a / a_c = (G F / G*)^2 A_II (see
`ruptfx.laws.fracture.half_length_at`). Strength far above the initial stress (S = 6) keeps the process zone small;
it shrinks as 1 / A_II (Freund 1990; Rice 1980). The zone is what lies between the tip and where the slip reaches D_c,
at one instant: the speed times the time in which a point weakens is less while the front accelerates.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench.burridge_andrews import C_P, C_R, C_S, crack, front
from ruptfx.laws import fracture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

RATIO = 6.0


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    result, critical = crack(RATIO, 6.0, 12.0 if fine else 8.0, 9.5, start=1.25)
    length, when, speed = front(result, critical)
    inside = (length > 1.5) & (length < 5) & np.isfinite(speed)
    theory = np.array([fracture.speed_at(a, C_P, C_S, C_R) for a in length[inside]])
    worst = float(np.max(np.abs(speed[inside] - theory)) / C_R)
    weak = result.slip_time(1e-3 * (2.2 / (1 + RATIO)))
    done = np.isfinite(weak)
    zone = length * critical - np.interp(when, weak[done], result.position[done])
    scaled = np.array([z * fracture.A_II(min(v, 0.999 * C_R), C_P, C_S) for z, v in zip(zone, speed, strict=True)])
    static = float(np.median(scaled[inside]))
    spread = float(np.max(np.abs(scaled[inside] / static - 1)))
    checks = [
        Check("largest |v - theory|, 1.5 < a/a_c < 5", 0.0, worst, 0.05, "c_R", "Burridge and Willis; Freund (1990)"),
        Check("largest departure of zone x A_II from its median", 0.0, spread, 0.10, "1", "Rice (1980)"),
        result.budget(),
    ]
    return Outcome(checks, lambda: _draw(length, speed, zone, static, inside))


def _draw(length: np.ndarray, speed: np.ndarray, zone: np.ndarray, static: float, inside: np.ndarray) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((left, right),) = new_figure(1, 2, 3.2, 8)
    v = np.linspace(0.01, 0.98, 100) * C_R
    left.plot([fracture.half_length_at(x, C_P, C_S) for x in v], v / C_R, "k:", label="equation of motion")
    left.plot(length, speed / C_R, label=f"S = {RATIO:g}")
    left.set(xlabel="half-length / $a_c$", ylabel="front speed / $c_R$", xlim=(0, 6), ylim=(0, 1.1))
    left.legend(frameon=False)
    right.plot(speed[inside] / C_R, zone[inside], ".", label="tip to slip of $D_c$")
    right.plot(v / C_R, [static / fracture.A_II(x, C_P, C_S) for x in v], "k:", label="~ 1 / $A_{II}$")
    right.set(xlabel="front speed / $c_R$", ylabel="process zone (m)")
    right.legend(frameon=False)
    return figure
