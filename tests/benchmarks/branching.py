"""A crack in a plate under tension runs and branches (after Borden et al. 2012).

The demo with springs between all cells, on coarser cells, and with facets that are rigid until their strength, on those
of the demo; on the coarser ones, 1 mm, whether that crack branches is chance: not with looks at the strength every
other step, the default, after 35 mm with one in each step, after 21 mm with one in four (0.62, 0.48 and 0.45 c_R). It
branches somewhere between 10 and 30 mm from the
notch, and no front, in steps of 10 mm, is faster than 0.65 c_R; it has run 45 mm after 70 to 90 us. There are branches
where failed facets are more than 4 mm apart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks._broken import Broken, broken, demo, rigid
from ruptfx.app.bench import Check, Outcome
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

END = 45e-3  # m from the notch
STEP = 10e-3
APART = 4e-3  # m between branches
SOURCE = "Borden et al. (2012) and others"


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    case = demo("branching", [f"mesh.element_size={0.6e-3 if fine else 1e-3}", "duration=95e-6"])
    finer = demo("branching", [f"mesh.element_size={0.6e-3 if fine else 0.8e-3}", "duration=95e-6"])
    found = {"intrinsic": broken(case), "extrinsic": broken(rigid(finer))}
    material = case.materials["specimen"]
    assert isinstance(material, IsotropicElastic)
    c_R = material.wave_speeds("strain").c_R
    checks = [check for kind, each in found.items() for check in _checks(kind, each, c_R)]
    return Outcome(checks, lambda: _draw(found))


def _checks(kind: str, found: Broken, c_R: float) -> list[Check]:
    x, y, when = (found.events[name] for name in ("x", "y", "time_of_failure"))
    ahead = x > 0
    places = np.arange(0, END + 1e-9, STEP / 2)
    arrival = np.array([when[ahead & (x >= place)].min(initial=np.inf) for place in places])
    speed = STEP / (arrival[2:] - arrival[:-2])
    apart = [place for place in np.arange(5e-3, END, 1e-3) if _height(x, y, place) > APART]
    return [
        Check(f"{kind}: place of the branching", 20e-3, apart[0] if apart else np.nan, 10e-3, "m", SOURCE),
        Check(f"{kind}: fastest front over 10 mm", 0.65, float(np.max(speed)) / c_R, 0.0, "c_R", SOURCE, "at most"),
        Check(f"{kind}: time at 45 mm", 80e-6, float(arrival[-1]), 10e-6, "s", SOURCE),
        found.budget(),
    ]


def _height(x: np.ndarray, y: np.ndarray, place: float) -> float:
    """Return the height of the cracked zone around an x [m]."""
    near = np.abs(x - place) < 1.5e-3
    return float(np.ptp(y[near])) if near.any() else 0.0


def _draw(found: dict[str, Broken]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((ax,),) = new_figure(1, 1, 2.6, 6)
    for number, (kind, each) in enumerate(found.items()):
        for ends in each.ends:
            ax.plot(*(1e3 * ends.T), color=f"C{number}", lw=1)
        ax.plot([], [], f"C{number}", lw=1, label=kind)
    ax.plot([-50, 0], [0, 0], "k", lw=1.5)
    ax.set(xlim=(-50, 50), ylim=(-20, 20), aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
    ax.legend(frameon=False, fontsize=7, loc="upper left")
    return figure
