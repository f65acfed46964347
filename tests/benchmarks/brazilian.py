"""A disc between two flats splits along the line of the load: its strength against that of the rock in tension.

The demo, slower, and with less fracture energy. The largest force P gives a strength, 2 P / (pi D t). Of a disc that
is brittle, E G / f_t^2 << D, and loaded slowly it is a little above f_t: 0.95 to 1.35 f_t at E G / f_t^2 = 0.03 D, as
the path along facets is longer than a straight one; it grows with the fracture energy. The disc breaks from the middle,
within D / 4, and along the load, within 10 degrees. That is the long axis of the cloud of facets in its inner half
which have failed when the force has fallen to 0.7 of its peak; later fragments fail separately. Everything twice: with
`intrinsic` facets and with `extrinsic` ones.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks._broken import Broken, broken, demo, rigid
from ruptfx.app.bench import Check, Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.case import Case
    from ruptfx.platform.fem import MPI

DIAMETER, STRENGTH, YOUNG = 54e-3, 4e6, 50e9  # m, Pa
PARTS = (0.03, 0.12)  # E G / f_t^2 over the diameter
SPEED = 0.02  # m/s of either flat
FIRST, FALLEN = 20, 0.7  # facets that failed; part of the largest force
SOURCE = "flattened disc"


def disc(part: float, size: float) -> Case:
    """Return the disc whose characteristic length is a fraction `part` of its diameter."""
    energy = part * DIAMETER * STRENGTH**2 / YOUNG
    return demo("brazilian", [
        f"mesh.element_size={size}", "fracture.unresolved=true",
        f"fracture.default.cohesion.G_Ic={energy}", f"fracture.default.cohesion.G_IIc={40 * energy}",
        f"boundaries.0.velocity={-SPEED}", f"boundaries.1.velocity={SPEED}", "boundaries.0.ramp=50e-6",
        "boundaries.1.ramp=50e-6", f"duration={600e-6 * (1 + part)}",
    ])  # fmt: skip


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    size = 0.6e-3 if fine else 1.5e-3
    cases = [disc(part, size) for part in PARTS]
    springs, tied = [broken(case) for case in cases], [broken(rigid(case)) for case in cases]
    checks = [*_checks(springs, ""), *_checks(tied, ", rigid")]
    return Outcome([*checks, max((each.budget() for each in springs + tied), key=lambda check: check.found)],
                   lambda: _draw(springs, tied))  # fmt: skip


def _checks(found: list[Broken], which: str) -> list[Check]:
    ratios = [_force(each).max() * 2 / (np.pi * DIAMETER * STRENGTH) for each in found]
    x, y = (found[0].events[name] for name in ("x", "y"))
    return [
        Check(f"2 P / (pi D f_t), E G / f_t^2 = {PARTS[0]:g} D{which}", 1.15, float(ratios[0]), 0.2, "1", SOURCE),
        Check(f"the same, {PARTS[1]:g} D, over that{which}", 1.0, float(ratios[1] / ratios[0]), 0.0, "1", SOURCE,
              "at least"),
        Check(f"the first {FIRST} failed facets, median distance from the middle{which}", DIAMETER / 4,
              float(np.median(np.hypot(x, y)[:FIRST])) if len(x) else np.nan, 0.0, "m", SOURCE, "at most"),
        Check(f"angle of the crack to the load{which}", 0.0, _angle(found[0]), 10.0, "degree", SOURCE),
    ]  # fmt: skip


def _force(found: Broken) -> np.ndarray:
    """Return the force between the flats [N/m]."""
    return np.asarray(0.5 * (found.edges["specimen.bottom.force_y"] - found.edges["specimen.top.force_y"]))


def _angle(found: Broken) -> float:
    """Return the angle between the cloud of failed facets and the load [degrees]."""
    force = _force(found)
    fallen = (np.arange(len(force)) > force.argmax()) & (force < FALLEN * force.max())
    x, y, when = (found.events[name] for name in ("x", "y", "time_of_failure"))
    inside = (np.hypot(x, y) < DIAMETER / 4) & (when <= found.time[np.argmax(fallen)])
    if inside.sum() < 5 or not fallen.any():
        return np.nan
    _, axes = np.linalg.eigh(np.cov(np.array([x, y])[:, inside], aweights=found.events["length"][inside]))
    return float(np.degrees(np.arctan2(abs(axes[0, 1]), abs(axes[1, 1]))))


def _draw(springs: list[Broken], tied: list[Broken]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((left, middle, right),) = new_figure(1, 3, 3.0)
    angle = np.linspace(0, 2 * np.pi, 200)
    for found, ax, line, name in ((springs, middle, "-", "springs"), (tied, right, "--", "rigid")):
        for number, (part, each) in enumerate(zip(PARTS, found, strict=True)):
            moved = each.edges["specimen.bottom.displacement_y"] - each.edges["specimen.top.displacement_y"]
            nominal = 2 * _force(each) / (np.pi * DIAMETER * STRENGTH)
            left.plot(1e6 * moved, nominal, f"C{number}{line}", lw=0.8, label=f"{name}, $EG/f_t^2$ = {part:g} D")
            for ends in each.ends:
                ax.plot(*(1e3 * ends.T), color=f"C{number}", lw=1 if number == 0 else 0.5)
        ax.plot(27 * np.cos(angle), 27 * np.sin(angle), "k", lw=0.5)
        ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", title=name)
    left.set(xlabel="Approach of the flats (µm)", ylabel=r"$2P/(\pi D f_t)$")
    left.legend(frameon=False, fontsize=5)
    return figure
