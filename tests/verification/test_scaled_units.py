"""A run in other units of length, time and mass is the same run; a law starts at its initial slip rate at any size."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import case

from ruptfx import gradient
from ruptfx.case import Case
from ruptfx.many_runs.adjoint.gradients import Objective
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

SHEAR = "faults.main.initial_stress.shear"


def creeping(rate: float, shear: float = 2.4e6, L: float = 1.0, T: float = 1.0, M: float = 1.0,
             **changes: Any) -> Case:  # fmt: skip
    """Plates with rate and state friction that begins at a slip rate [m/s], in units of L, T and M."""
    stress, speed = M / (L * T**2), L / T
    return case({
        "plane": "strain", "order": 2, "duration": 3e-6 * T,
        "mesh": {"kind": "two_plates", "length": 24e-3 * L, "height": 6e-3 * L, "element_size": 2e-3 * L},
        "materials.default": {"kind": "isotropic_elastic", "young_modulus": 5.3e9 * stress, "poisson_ratio": 0.35,
                              "density": 1246.0 * M / L**3},
        "faults.main": {
            "contact": {"kind": "split_node"}, "initial_stress": {"normal": 6e6 * stress, "shear": shear * stress},
            "friction": {"kind": "rate_and_state_ageing", "a": 0.02, "b": 0.03, "D_c": 2e-6 * L, "f_0": 0.5,
                         "V_0": 1e-2 * speed, "V_initial": rate * speed},
            "nucleation": [{"kind": "smooth_patch", "extra": 1.5e6 * stress, "center": 10e-3 * L, "radius": 5e-3 * L,
                            "rise": 1e-6 * T}],
        },
        "stepper": {"kind": "leapfrog", "time_step": 1e-7 * T},
        "output": {"figures": False, "rupture_threshold": 1e-3 * speed},
        "boundaries": [{"kind": "absorbing", "edge": "upper.right"}], **changes,
    })  # fmt: skip


def slip_at_end(given: Case, L: float = 1.0) -> np.ndarray:
    """Slip at the end of a run in units of `L`, shape (n,)."""
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    for _ in range(30):
        motion.step(state)
    slip: np.ndarray = state.faults["main"]["slip"] / L
    return slip


@pytest.mark.parametrize("rate", [3e-4, 1e-3, 2e-2])
def test_other_units_of_length_time_and_mass_change_nothing(rate: float) -> None:
    """Three random units between 1e-4 and 1e4 of the present ones; the slip agrees to rounding."""
    exact = slip_at_end(creeping(rate))
    assert exact.max() > 1e-8
    random = np.random.default_rng(int(1e6 * rate))
    for _ in range(3):
        L, T, M = 10.0 ** random.uniform(-4, 4, 3)
        np.testing.assert_allclose(slip_at_end(creeping(rate, L=L, T=T, M=M), L), exact, rtol=1e-9)


@pytest.mark.parametrize("rate", [1e-9, 1e-3, 0.5])
@pytest.mark.parametrize("shear", [2399300.0, 2399500.0, 2399700.0])
def test_a_law_begins_at_its_initial_slip_rate(rate: float, shear: float) -> None:
    state = Model(creeping(rate, shear)).initial_state()
    np.testing.assert_allclose(state.faults["main"]["slip_rate"], rate, rtol=1e-9)


def test_a_stress_beyond_the_state_begins_at_the_reference_rate() -> None:
    """An age that carries 0.43 sigma at 1e-3 m/s under 0.8 sigma: sinh ratio of 1e8 m/s is cut to V_0."""
    law = creeping(1e-3).faults["main"].friction
    rates = {}
    for shear in (1.0e6, 4.8e6):
        changed = {"faults.main.friction": {**law.model_dump(), "kind": "rate_and_state_ageing", "theta_initial": 2e-3}}
        changed["faults.main.friction"].pop("V_initial")
        rates[shear] = Model(creeping(1e-3, shear, **changed)).initial_state().faults["main"]["slip_rate"][0]
    psi = 0.5 + 0.03 * np.log(1e-2 * 2e-3 / 2e-6)
    assert rates[1.0e6] == pytest.approx(2e-2 * np.sinh(1.0 / 6.0 / 0.02) * np.exp(-psi / 0.02), rel=1e-9)
    assert rates[4.8e6] == 1e-2


@pytest.mark.parametrize("rate", [0.999e-3, 1e-3, 1.001e-3, 0.1])
def test_gradients_agree_with_differences_at_any_initial_slip_rate(rate: float) -> None:
    """Central differences over 100 Pa of 2.4 MPa, with an error of second order."""
    term = {"kind": "final_slip", "target": 1e-6, "sigma": 1e-6}
    unknown = {"key": SHEAR, "shape": "number"}
    given = creeping(rate, objective=[term], unknowns=[unknown])
    slope = float(gradient(given, progress=False)[SHEAR])
    values = [Objective(creeping(rate, 2.4e6 + step, objective=[term]), given.objective, record=False).value
              for step in (-100.0, 100.0)]  # fmt: skip
    assert slope == pytest.approx((values[1] - values[0]) / 200.0, rel=1e-5)
