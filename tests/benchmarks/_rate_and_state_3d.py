"""Rate and state ruptures on a vertical fault that reaches the surface: the common part of TPV102 and TPV104.

Half space, velocity weakening over 30 km x 15 km with a rim of 3 km to velocity strengthening, nucleation by a smooth
patch of radius 3 km, 7.5 km deep. One half is computed, the other one is its mirror image. Elements of order 4 have
1000 m, with `--fine` also 1500 and 750 m: nodes are 250, 375 and 188 m apart, where the benchmarks ask for 100 m. 375 m
are too coarse: fronts of TPV102 arrive up to 0.63 s later than on 188 m, those of TPV104 up to 4.8 s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from benchmarks._surfaces import (
    Places,
    Surface,
    against_published,
    budget,
    draw,
    half_model,
    rupture,
    spacing,
    symmetry,
)
from benchmarks.tpv5 import bar
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import elastic

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

SIZES = (1500.0, 1000.0, 750.0)  # m, elements of order 4
COARSE = SIZES[1]  # without `--fine`
STATIONS = dict.fromkeys([(4.5e3, 7.5e3), (9e3, 7.5e3), (12e3, 3e3), (12e3, 12e3)], 0.0)  # m, where both sides agree
SLIP = 0.2  # m
ARRIVALS = 7.5  # s, when the front has passed all stations


def weakening(inside: float, outside: float, middle: float = 7.5e3, half_width: float = 7.5e3) -> Table:
    """Return the profile of a parameter: `inside` where friction weakens, `outside` beyond the rim.

    Parameters
    ----------
    inside, outside : float
    middle, half_width : float
        Of the part that weakens, down dip [m].
    """
    along = {"kind": "taper", "inside": 1.0, "outside": 0.0, "center": 0.0, "half_width": 15e3, "width": 3e3}
    down = {**along, "inside": inside - outside, "center": middle, "half_width": half_width}
    return {"kind": "sum", "terms": [
        outside, {"kind": "product", "value": {"kind": "along_dip", "profile": down}, "factor": along},
    ]}  # fmt: skip


def case(element_size: float, law: Table, shear: float, extra: float, duration: float) -> Table:
    """Return one half of the problem.

    Parameters
    ----------
    element_size : float
        [m]
    law : dict
        Friction.
    shear, extra : float
        Initial shear stress, and what the nucleation adds at its center [Pa].
    duration : float
        [s]
    """
    center = {"x": 0.0, "y": 0.0, "z": -7.5e3}
    return half_model({
        "plane": "solid", "order": 4, "duration": duration, "positions": "x",
        "mesh": {
            "kind": "box_with_fault", "fault_length": 36e3, "fault_width": 18e3, "element_size": element_size,
            "beyond": 9e3, "distance": 15e3, "growth": 1.2,
        },
        "materials": {"default": elastic(6000.0, 3464.0, 2670.0)},
        "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": law, "initial_stress": {"normal": 120e6, "shear": shear},
            "nucleation": {"kind": "smooth_patch", "extra": extra, "center": center, "radius": 3e3, "rise": 1.0},
        }},
        "output": {"figures": False},
        "boundaries": [
            {"kind": "absorbing", "edge": f"plus.{edge}"} for edge in ("left", "right", "bottom", "far")
        ],
    })  # fmt: skip


def study(
    make: Callable[[float, float], Table],
    duration: float,
    fine: bool,
    comm: MPI.Comm,
    published: Places | None = None,
    bars: Callable[[float], float] = bar,
    source: str = "",
) -> Outcome:
    """Check symmetry, energy, published times of slip, and with `fine` the convergence of times, peak rates and slips.

    Parameters
    ----------
    make : callable
        Case of an element size [m] and a duration [s].
    duration : float
        Of the runs with `fine` [s].
    fine : bool
    comm : MPI communicator
    published : dict, optional
        Times of 0.2 m of slip at stations, of another code [s].
    bars : callable
        Tolerance of these times [s] on elements of a size [m].
    source : str
        Where they come from.
    """
    sizes, duration = (SIZES, duration) if fine else ((COARSE,), ARRIVALS)
    runs = {size: rupture(make(size, duration), comm, SLIP) for size in sizes}
    checks = []
    for size, surface in runs.items():
        checks += [symmetry(surface, spacing(size), STATIONS), budget(surface, spacing(size))]
        if published and size <= COARSE:  # the front is not resolved on the coarsest mesh
            checks += against_published(surface, spacing(size), published, bars(size), source)
    if fine:
        checks += _converge(*runs.values())
    drawn = {spacing(size): surface for size, surface in runs.items()}
    return Outcome(checks, lambda: draw(drawn, "time of 0.2 m of slip (s)", (15e3, 15e3)))


def _converge(coarse: Surface, middle: Surface, finest: Surface) -> list[Check]:
    """Check that differences to the finest mesh fall; by (250 - 188) / (375 - 188) = 1/3 if they are of first order."""
    found = []
    for name, what in (("slip_time", "time of 0.2 m of slip"), ("peak_slip_rate", "peak slip rate"),
                       ("slip_1", "slip at the end")):  # fmt: skip
        # Behind the nucleation and inside of the rim, where all points slide.
        apart = [
            each.rms(finest, name, (np.abs(each.strike) < 13e3) & (each.dip < 13e3)
                     & (np.hypot(each.strike, each.dip - 7.5e3) > 4e3))
            for each in (coarse, middle)
        ]  # fmt: skip
        quantity = f"{what}, RMS difference to the finest mesh, 250 over 375 m"
        found.append(Check(quantity, 0.6, apart[1] / apart[0], 0, "1", "converges", "at most"))
    return found
