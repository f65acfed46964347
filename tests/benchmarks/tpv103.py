"""TPV103 along a line: rate and state friction with strong rate weakening, smooth nucleation; in-plane.

SCEC/USGS benchmark TPV103 in two dimensions: initial state to all digits, convergence of front speed and peak slip
rate under refinement, and a velocity step of the law against its exact evolution. The nucleation sends a supershear
front ahead that dies at 4.8, 5.8, 6.3 and 6.3 km on meshes of 100, 50, 25 and 12.5 m: closely behind, at 9 km, the
peak slip rate converges from 50 m on only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.tpv101 import TAPER, converge, draw, line
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.laws.friction.rate_and_state_flash_heating import RateAndStateFlashHeating

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

LAW = {
    "kind": "rate_and_state_flash_heating", "b": 0.014, "D_c": 0.4, "f_0": 0.6, "V_0": 1e-6, "f_w": 0.2,
    "V_initial": 1e-16,
}  # fmt: skip
STATE, VALUE = "psi", 0.563591842632738
DURATION = 6.0


def case(spacing: float) -> Table:
    """Return the case with nodes `spacing` [m] apart."""
    law = {**LAW, "a": {**TAPER, "inside": 0.01, "outside": 0.02}, "V_w": {**TAPER, "inside": 0.1, "outside": 1.0}}
    return line(spacing, law, 40e6, 45e6, DURATION)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    checks, runs = converge(case, STATE, VALUE, "SCEC/USGS TPV103", fine)
    law = RateAndStateFlashHeating(a=0.01, V_w=0.1, **{k: v for k, v in LAW.items() if k != "kind"})
    one = np.ones(1)
    first, last = (float(np.asarray(law.steady_psi(rate))[0]) for rate in (1e-3 * one, one))
    state = {"psi": first * one}
    for _ in range(40):
        state = law.advance(state, one, 1e6 * one, 0.01)  # slip 0.4 m = D_c
    exact = last + (first - last) * np.exp(-1.0)
    checks.append(Check("velocity step: psi", exact, float(state["psi"][0]), 1e-12, "1", "exact", relative=True))
    return Outcome(checks, lambda: draw(runs))
