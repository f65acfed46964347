"""TPV102: rate and state rupture (ageing law) on a vertical fault, in three dimensions.

SCEC/USGS benchmark on a half space (`_rate_and_state_3d`): ageing law, shear stress 75 MPa, 25 MPa more at the center
of the nucleation. The fault is symmetric about x = 0. Nodes are 250 m apart, with `--fine` 375 and 188 m, too, where
the benchmark asks for 100 m. Times of 0.2 m of slip are compared with those of the finest mesh, which are saved here,
with the bar of TPV5 on these nodes, 0.19 s. With `--fine` times, peak slip rates and slips converge. No published curve
was compared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks._rate_and_state_3d import COARSE, case, study, weakening
from benchmarks.tpv5 import bar
from benchmarks.tpv101 import LAW
from ruptfx import Table

if TYPE_CHECKING:
    from ruptfx.bench import Outcome
    from ruptfx.fem import MPI

DURATION = 9.0  # s
KNOWN = {
    (0.0, 12e3): 3.316, (4.5e3, 7.5e3): 2.885, (9e3, 7.5e3): 4.882,
    (12e3, 7.5e3): 6.045, (12e3, 3e3): 6.433, (12e3, 12e3): 6.436,
}  # fmt: skip
"""Time of 0.2 m of slip [s], nodes 188 m apart, by position along strike and down dip [m]."""


def make(element_size: float, duration: float) -> Table:
    """Return the case on elements of a size [m], until a time [s]."""
    return case(element_size, {**LAW, "a": weakening(0.008, 0.016)}, 75e6, 25e6, duration)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    return study(make, DURATION, KNOWN, bar(COARSE), fine, comm)
