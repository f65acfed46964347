"""Flat blocks that slide over non-matching nodes, and a block that slides off the end of the other.

The blocks of the benchmark `rubbing` without their waves, both of 5.3 GPa, in a damped state: what is noise of the
method must not be lost in the vibration that friction excites between elastic bodies. While all slides the ratio of
the forces is that of friction, the pressure of a point in the middle half ought not to change, and the normal stress
does no work. Then the lower block ends where the upper one does: it slides off by a quarter of its length.
"""

from __future__ import annotations

import numpy as np

from benchmarks._rubbing_blocks import SPEED, Blocks, rub
from ruptfx.app.bench import Check, Outcome
from ruptfx.bodies.state import State
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.platform import fem, parallel

DAMPED = {"mass": 3e5, "kelvin_voigt": {"fraction": 0.1}}


def blocks(order: int, friction: float, way: float, right: float) -> Blocks:
    """Return blocks of any order, with nodes about 50 um apart."""
    return Blocks(
        0.05e-3 * order, order, way, amplitude=0.0, moduli=(5.3e9, 5.3e9), friction=friction, press=25e-6, ramp=20e-6,
        damping=(DAMPED, DAMPED), ends=(-0.3e-3, right),
    )  # fmt: skip


class _Watch:
    """Forces, and pressures in the middle half, of every step after a time.

    Parameters
    ----------
    comm : MPI.Comm
    since : float
        [s]
    """

    def __init__(self, comm: fem.MPI.Comm, since: float) -> None:
        self._comm, self._since = comm, since
        self.normal, self.shear = 0.0, 0.0
        self.pressures: list[np.ndarray] = []

    def __call__(self, state: State, face: SlidingInterface) -> None:
        if state.time < self._since:
            return
        fault, area = state.faults["main"], face.owned * face.weight
        self.normal += float(area @ fault["normal_stress"])
        self.shear += float(area @ fault["shear_traction"])
        low, high = (face.line.first + part * face.line.length for part in (0.25, 0.75))
        middle = face.owned & (face.position > low) & (face.position < high)
        self.pressures.append(fault["normal_stress"][middle])

    def ratio(self) -> float:
        """Return shear over normal force, both averaged."""
        normal, shear = parallel.total(self._comm, [self.normal, self.shear])
        return float(abs(shear) / normal)

    def noise(self) -> float:
        """Return the RMS over time and points of the pressure about its time average, relative to that average."""
        pressure = np.array(self.pressures)
        away = pressure.var(axis=0) if len(pressure) else np.zeros(0)
        square, mean, points = parallel.total(
            self._comm, [float(away.sum()), float(pressure.mean(axis=0).sum()), float(len(away))]
        )
        return float(np.sqrt(square / points) / (mean / points))


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    checks = []
    way = 0.5e-3 if fine else 0.25e-3
    for order in (1, 2, 4) if fine else (2,):
        given = blocks(order, 0.3, way, 3.3e-3)
        # Evaluate the last three quarters of the sliding at full speed.
        watch = _Watch(comm, given.case().duration - 0.75 * way / SPEED)
        found, name = rub(given, comm, watch), f"order {order}"
        checks += [
            Check(f"{name}: ratio of the forces", 0.3, watch.ratio(), 1e-3, "1", "friction", relative=True),
            Check(f"{name}: noise of the pressure", 0.0, watch.noise(), 0.025, "1", "aim"),
            Check(f"{name}: normal / friction work", 0.0, found.impact, 1e-4, "1", "no work without gap"),
        ]
    given = blocks(2, 0.1, 0.3e-3, 1.2e-3)
    watch = _Watch(comm, given.press + given.ramp)
    found = rub(given, comm, watch)
    checks += [
        Check("sliding off: ratio of the forces", 0.1, watch.ratio(), 0.03, "1", "friction", relative=True),
        Check("sliding off: energy not accounted for", 0.0, found.missing, 1e-4, "1", "discrete budget"),
    ]
    return Outcome(checks)
