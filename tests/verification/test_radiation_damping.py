"""Quasi-dynamic steps: what waves that are not computed carry off, of both bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, case

pytest.importorskip("dolfinx")

from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

SOFT = {"kind": "isotropic_elastic", "young_modulus": 1e9, "poisson_ratio": 0.2, "density": 2000.0}
RIGID_BASE = {"kind": "block_on_rigid", "length": 12e-3, "height": 4e-3, "element_size": 2e-3}


def impedance(material: dict[str, Any]) -> float:
    """mu / c_s = sqrt(mu rho) [Pa s/m]."""
    shear_modulus = material["young_modulus"] / 2 / (1 + material["poisson_ratio"])
    return float(np.sqrt(shear_modulus * material["density"]))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        # Equal bodies: mu / (2 c_s). Shear waves of either side share the slip rate as V+ Z+ = V- Z-.
        ({}, impedance(HOMALITE) / 2),
        ({"materials": {"upper": HOMALITE, "lower": SOFT}}, 1 / (1 / impedance(HOMALITE) + 1 / impedance(SOFT))),
        ({"mesh": RIGID_BASE}, impedance(HOMALITE)),
    ],
    ids=["equal", "unequal", "rigid"],
)
def test_slip_rate_of_a_sudden_stress_drop(changes: dict[str, Any], expected: float) -> None:
    # 3 MPa on an interface that holds 0.4 times 6 MPa: before the bodies unload, V = 0.6 MPa / impedance.
    dropped = case({
        "order": 1, "duration": 1e-9, "faults.main.contact": {"kind": "augmented_lagrangian"},
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.4},
        "faults.main.initial_stress": {"normal": 6e6, "shear": 3e6},
        "stepper": {"kind": "quasi_static", "radiation_damping": True, "first_step": 1e-12, "smallest_step": 1e-12,
                    "slip_tolerance": 1.0}, **changes,
    })  # fmt: skip
    model = Model(dropped)
    motion, state = dropped.stepper.bind(model), model.initial_state()
    motion.step(state)
    # The slip of some 1e-12 m lets G / h of 1e12 Pa/m unload some Pa.
    np.testing.assert_allclose(state.faults["main"]["slip_rate"], 0.6e6 / expected, rtol=1e-4)
