"""A disc between two flats splits along the line of the load: its strength against that of the rock in tension.

The demo, slower, and with less fracture energy. The largest force P gives a strength, 2 P / (pi D t). Of a disc that
is brittle, E G / f_t^2 << D, and loaded slowly it is a little above f_t: 0.95 to 1.35 f_t at E G / f_t^2 = 0.03 D, as
the path along facets is longer than a straight one; it grows with the fracture energy. The disc breaks from the middle,
within D / 4, and along the load, within 10 degrees. That is the long axis of the cloud of facets in its inner half
which have failed when the force has fallen to 0.7 of its peak; later pieces break on their own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bench import Check, Outcome
from ruptfx.bench._broken import Broken, broken, demo

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.fem import MPI

DIAMETER, STRENGTH, YOUNG = 54e-3, 4e6, 50e9  # m, Pa
PARTS = (0.03, 0.12)  # E G / f_t^2 over the diameter
SPEED = 0.02  # m/s of either flat
FIRST, FALLEN = 20, 0.7  # facets that failed; part of the largest force
SOURCE = "flattened disc"


def split(part: float, size: float) -> Broken:
    """The disc with a characteristic length of a part of its diameter."""
    energy = part * DIAMETER * STRENGTH**2 / YOUNG
    return broken(demo("brazilian", [
        f"mesh.element_size={size}", "fracture.unresolved=true",
        f"fracture.default.cohesion.G_Ic={energy}", f"fracture.default.cohesion.G_IIc={40 * energy}",
        f"boundaries.0.velocity={-SPEED}", f"boundaries.1.velocity={SPEED}", "boundaries.0.ramp=50e-6",
        "boundaries.1.ramp=50e-6", f"duration={600e-6 * (1 + part)}",
    ]))  # fmt: skip


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    size = 0.6e-3 if fine else 1.5e-3
    found = [split(part, size) for part in PARTS]
    ratios = [_force(each).max() * 2 / (np.pi * DIAMETER * STRENGTH) for each in found]
    x, y = (found[0].events[name] for name in ("x", "y"))
    checks = [
        Check(f"2 P / (pi D f_t), E G / f_t^2 = {PARTS[0]:g} D", 1.15, float(ratios[0]), 0.2, "1", SOURCE),
        Check(f"the same, {PARTS[1]:g} D, over that", 1.0, float(ratios[1] / ratios[0]), 0.0, "1", SOURCE, "at least"),
        Check(f"the first {FIRST} failed facets, median distance from the middle", DIAMETER / 4,
              float(np.median(np.hypot(x, y)[:FIRST])) if len(x) else np.nan, 0.0, "m", SOURCE, "at most"),
        Check("angle of the crack to the load", 0.0, _angle(found[0]), 10.0, "degree", SOURCE),
        max((each.budget() for each in found), key=lambda check: check.found),
    ]  # fmt: skip
    return Outcome(checks, lambda: _draw(found))


def _force(found: Broken) -> np.ndarray:
    """Between the flats [N/m]."""
    return np.asarray(0.5 * (found.edges["specimen.bottom.force_y"] - found.edges["specimen.top.force_y"]))


def _angle(found: Broken) -> float:
    """Of the cloud of failed facets to the load [degrees]."""
    force = _force(found)
    fallen = (np.arange(len(force)) > force.argmax()) & (force < FALLEN * force.max())
    x, y, when = (found.events[name] for name in ("x", "y", "time_of_failure"))
    inside = (np.hypot(x, y) < DIAMETER / 4) & (when <= found.time[np.argmax(fallen)])
    if inside.sum() < 5 or not fallen.any():
        return np.nan
    _, axes = np.linalg.eigh(np.cov(np.array([x, y])[:, inside], aweights=found.events["length"][inside]))
    return float(np.degrees(np.arctan2(abs(axes[0, 1]), abs(axes[1, 1]))))


def _draw(found: list[Broken]) -> Figure:
    from ruptfx.figure_style import new_figure

    figure, ((left, right),) = new_figure(1, 2, 3.0)
    for number, (part, each) in enumerate(zip(PARTS, found, strict=True)):
        moved = each.edges["specimen.bottom.displacement_y"] - each.edges["specimen.top.displacement_y"]
        nominal = 2 * _force(each) / (np.pi * DIAMETER * STRENGTH)
        left.plot(1e6 * moved, nominal, f"C{number}", lw=0.8, label=f"$EG/f_t^2$ = {part:g} D")
        for ends in each.ends:
            right.plot(*(1e3 * ends.T), color=f"C{number}", lw=1 if number == 0 else 0.5)
    left.set(xlabel="Approach of the flats (µm)", ylabel=r"$2P/(\pi D f_t)$")
    left.legend(frameon=False, fontsize=7)
    angle = np.linspace(0, 2 * np.pi, 200)
    right.plot(27 * np.cos(angle), 27 * np.sin(angle), "k", lw=0.5)
    right.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    return figure
