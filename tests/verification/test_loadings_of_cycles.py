"""Cycles are the same whether prescribed creep below a fault loads it, or far edges move with the plates."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

YEAR, V_P, G, DEPTH, WEAK, FAR = 365.25 * 86400, 1e-9, 32.04e9, 20e3, 10e3, 400e3
A, A_MAX, B, D_C, F_0, V_0, SIGMA = 0.010, 0.025, 0.015, 0.04, 0.6, 1e-6, 50e6


def onsets(edges_move: bool) -> np.ndarray:
    """Return the times at which two events begin [s], on nodes 500 m apart; the first one begins from steady creep."""
    speeds = {"plus.far": V_P / 2, "plus.bottom": V_P / 2, "minus.far": -V_P / 2, "minus.bottom": -V_P / 2}
    moved = speeds if edges_move else {"minus.far": 0.0}  # which only keeps the bodies from moving as a whole
    carried = SIGMA * A_MAX * np.arcsinh(V_P / (2 * V_0) * np.exp((F_0 + B * np.log(V_0 / V_P)) / A_MAX))
    steps = {"kind": "table", "positions": [DEPTH, DEPTH + 1.0], "values": [0.0, 1.0], "extend": True}
    case = Case.model_validate({
        "plane": "antiplane", "order": 2, "duration": 1e3 * YEAR, "output": {"figures": False},
        "boundaries": [{"kind": "driven", "edge": edge, "component": "z", "velocity": speed}
                       for edge, speed in moved.items()],
        "mesh": {"kind": "dipping_section", "fault_width": DEPTH, "beyond": FAR, "distance": FAR, "dip": 90.0,
                 "element_size": 1e3, "growth": 1.5},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 2.5 * G, "poisson_ratio": 0.25,
                                  "density": 2670.0}},
        "faults": {"main": {
            "contact": {"kind": "compliant", "C_n": 1e13, "C_s": 1e13},
            "initial_stress": {"normal": SIGMA, "shear": carried},
            "prescribed_slip": [{"kind": "constant_rate", "rate": V_P, "where": steps}],
            "friction": {
                "kind": "rate_and_state_ageing", "b": B, "D_c": D_C, "f_0": F_0, "V_0": V_0, "V_initial": V_P,
                "a": {"kind": "table", "positions": [0.0, WEAK, WEAK + 3e3], "values": [A, A, A_MAX], "extend": True},
            },
        }},
        "stepper": {"kind": "quasi_dynamic"},
    })  # fmt: skip
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    state.lazy_bodies = True
    begun: list[float] = []
    slides = False
    while len(begun) < 2:
        motion.step(state)
        fastest = state.faults["main"]["slip_rate"].max()
        if fastest > 1e-3 and not slides:
            begun.append(state.time)
        slides = fastest > (1e-4 if slides else 1e-3)
    return np.array(begun)


@pytest.mark.slow
def test_the_interval_does_not_depend_on_the_loading() -> None:
    by_creep, by_edges = onsets(False), onsets(True)
    assert by_creep[0] == pytest.approx(by_edges[0], rel=0.01)
    assert np.diff(by_creep) == pytest.approx(np.diff(by_edges), rel=0.01)
    # A cycle of slip at 1e-9 m/s: metres, as the ruptures of such a fault.
    assert 50 * YEAR < np.diff(by_edges)[0] < 300 * YEAR
