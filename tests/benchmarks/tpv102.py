"""TPV102: rate and state rupture (ageing law) on a vertical fault, in three dimensions.

SCEC/USGS benchmark on a half space (`_rate_and_state_3d`): ageing law, shear stress 75 MPa, 25 MPa more at the center
of the nucleation. The fault is symmetric about x = 0. Nodes are 250 m apart, with `--fine` 375 and 188 m, too, where
the benchmark asks for 100 m. Checked are symmetry and energy, and with `--fine` that times of 0.2 m of slip, peak slip
rates and slips converge. No time of another code is a check: the curves of TPV102 are not in a public file that could
be cited here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks._rate_and_state_3d import case, study, weakening
from benchmarks.tpv101 import LAW
from ruptfx import Table

if TYPE_CHECKING:
    from ruptfx.app.bench import Outcome
    from ruptfx.platform.fem import MPI

DURATION = 9.0  # s


def make(element_size: float, duration: float) -> Table:
    """Return the case on elements of a size [m], until a time [s]."""
    return case(element_size, {**LAW, "a": weakening(0.008, 0.016)}, 75e6, 25e6, duration)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    return study(make, DURATION, fine, comm)
