"""A rupture jumps from contact to contact, as fast as the P wave of the stiff body, symmetrically.

The demo of that name: two bodies of 5.3 and 3.392 GPa touch at the crests of opposed waves; friction fails on one
contact, and the outermost points of the next ones slip when the P wave of the stiff body comes (Di Bartolomeo et al.,
ESDA2010-25247, Fig. 6a and 7: 2300 m/s), to the left as to the right: asperities decouple the bodies. On a smooth
interface the two sides differ. The paper does not print its loads; those of the demo are chosen, and with them the
symmetry ends at the third contact to the right, where only the P wave of the soft body makes points slip.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

import ruptfx
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case, read_case
from ruptfx.laws.nucleation.friction_drop import FrictionDrop
from ruptfx.platform import fem, parallel
from ruptfx.results.analysis.asperities import Asperity, asperities
from ruptfx.run import stages
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FAST = 0.3  # m/s, above the slip rates of the slow loading
SWITCH = 0.05e-6  # s; damping ends when friction fails, and edges of contacts slip for 10 ns then, by themselves
NEAR = {-1: 3, 1: 2}  # contacts to the left and to the right that the P wave of the stiff body makes slip
SOURCE = "c_p of the stiff body"

Floats = NDArray[np.float64]


def arrivals(case: Case, patch: FrictionDrop, comm: fem.MPI.Comm) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Return positions [m], closed flags when friction fails, first fast slip since then [s]; sorted, on all ranks."""
    model = Model(case, comm)
    motion, state, face = stages.bind(model), model.initial_state(), model.faults[0].interface
    fault = state.faults["main"]
    first, closed = np.full(len(face.plus), np.nan), np.zeros(len(face.plus))
    while state.time < case.duration:
        motion.step(state)
        since = state.fault_time - patch.time
        if since < 0:
            closed[:] = fault["normal_stress"] > 0
        elif since > SWITCH:
            first[np.isnan(first) & (np.abs(fault["slip_rate"]) > FAST)] = since
    rows = parallel.share_rows(comm, np.column_stack([face.position, closed, first])[face.owned])
    position, closed, first = rows[np.argsort(rows[:, 0])].T
    return position, closed > 0, first


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    del fine  # nodes 25 um apart do not resolve these contacts
    case = read_case(Path(ruptfx.__file__).with_name("demos") / "rough_rupture.toml")
    assert isinstance(case, Case)
    patch = case.faults["main"].nucleation[0]
    assert isinstance(patch, FrictionDrop)
    position, closed, first = arrivals(case, patch, comm)
    contacts = asperities(position, closed, first)
    stiff = case.materials["upper"].wave_speeds(case.plane).c_p
    checks, times = [], {}
    for side, count in NEAR.items():
        there = sorted((c for c in contacts if side * c.center > patch.half_width), key=lambda c: abs(c.center))[:count]
        place = [_first_point(position, first, contact) for contact in there]
        times[side] = np.array([contact.arrival for contact in there])
        speed = side * float(np.polyfit(times[side], place, 1)[0])
        name = f"first slip of contacts to the {'right' if side > 0 else 'left'}"
        checks.append(Check(f"{name}: speed", stiff, speed, 0.04, "m/s", SOURCE, relative=True))
    for number in range(min(NEAR.values())):
        ratio = float(times[1][number] / times[-1][number])
        checks.append(Check(f"contact {number + 1}: right over left", 1.0, ratio, 0.04, "1", "symmetry, as published"))
    return Outcome(checks, lambda: _draw(case, patch, position, closed, first))


def _first_point(position: Floats, first: Floats, contact: Asperity) -> float:
    """Return the position at which a contact slips first [m]."""
    return float(position[contact.points][np.nanargmin(first[contact.points])])


def _draw(case: Case, patch: FrictionDrop, position: Floats, closed: NDArray[np.bool_], first: Floats) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((axes,),) = new_figure(1, 1, 3, 5)
    for name, color in (("upper", "#1769aa"), ("lower", "#c1440e")):
        speed = case.materials[name].wave_speeds(case.plane).c_p
        reach = np.linspace(patch.half_width, 3e-3, 2)
        for side in (-1, 1):
            label, time = f"P wave of the {name} body" if side > 0 else None, (reach - patch.half_width) / speed
            axes.plot(side * 1e3 * reach, 1e6 * time, "--", color=color, lw=0.8, label=label)
    axes.plot(1e3 * position[closed], 1e6 * first[closed], "ko", ms=3, label="first slip of contacts")
    axes.set(xlabel="x (mm)", ylabel="Time after friction failed (µs)", ylim=(0, 2))
    axes.legend(frameon=False, loc="lower right")
    return figure
