"""Bodies with a fault that move when the run begins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, SPLIT, plates

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.run import stages
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

DT = 5e-8
AGEING = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 20e-6, "f_0": 0.3, "V_0": 1e-3}
PUSH = {"kind": "overstress", "extra": 2e5}


def moving(contact: dict[str, Any], changes: dict[str, Any]) -> tuple[Model, Any, Any]:
    table = plates({
        "order": 2, "faults.main.contact": contact, "stepper": {"kind": "leapfrog", "time_step": DT},
        "initial_velocity": {"upper": [1.5, 0.0], "lower": [-0.5, 0.0]}, **changes,
    })  # fmt: skip
    model = Model(parse_case(table))
    return model, stages.bind(model), model.initial_state()


@pytest.mark.parametrize("contact", [SPLIT, COMPLIANT], ids=lambda contact: contact["kind"])
@pytest.mark.parametrize("changes", [
    {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.3}},
    {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.3}, "faults.main.initial_stress.shear": 1e6},
    {"faults.main.friction": AGEING, "faults.main.initial_stress.shear": 1.8e6},
    {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.3}, "faults.main.nucleation": PUSH},
    {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.3}, "initial_velocity": {"upper": [1.0, -0.2]}},
], ids=["no shear", "shear", "ageing", "nucleation", "impact"])  # fmt: skip
def test_the_energy_budget_closes(contact: dict[str, Any], changes: dict[str, Any]) -> None:
    """Of plates that slide from the start, or whose motion stretches the springs between them."""
    _, motion, state = moving(contact, changes)
    for step in range(250):
        motion.step(state)
        if step % 25 > 1:
            continue
        energy = motion.energies(state)
        work = energy.pop("boundary_work")
        assert abs(work - sum(energy.values())) < 1e-11 * work
    taken = energy["frictional_dissipation" if contact == SPLIT else "interface_elastic"]
    assert abs(taken) > 1e-4 * work


def test_slip_rate_and_momentum_of_sliding_plates() -> None:
    """2 m/s at the start; friction of 0.3 x 6 MPa on 12 mm takes momentum from the upper plate, for half a step."""
    model, motion, state = moving(SPLIT, {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.3}})
    np.testing.assert_allclose(state.faults["main"]["slip_rate"], 2.0, rtol=1e-12)
    above = np.repeat(model.coordinates[:, 1] > 0, 2)
    above.reshape(-1, 2)[model.faults[0].interface.plus] = True
    above.reshape(-1, 2)[model.faults[0].interface.minus] = False

    def momentum() -> float:
        return float((model.mass * state.velocity)[above][::2].sum())

    # 1246 kg/m3 on 12 mm x 4 mm at 1.5 m/s.
    assert momentum() == pytest.approx(1246.0 * 12e-3 * 4e-3 * 1.5, rel=1e-12)
    motion.step(state)
    np.testing.assert_allclose(state.faults["main"]["shear_traction"], 0.3 * 6e6, rtol=1e-12)
    assert momentum() == pytest.approx(1246.0 * 12e-3 * 4e-3 * 1.5 - 0.3 * 6e6 * 12e-3 * 0.5 * DT, rel=1e-12)


def test_state_belongs_to_the_slip_rate() -> None:
    """Of rate and state at 0.3 sigma and f_0 = 0.3: f_0 = f_0 + a ln(V/V_0) + b ln(V_0 theta/D_c), V = 2 m/s."""
    _, _, state = moving(SPLIT, {"faults.main.friction": AGEING, "faults.main.initial_stress.shear": 1.8e6})
    expected = 20e-6 / 1e-3 * (2.0 / 1e-3) ** (-0.01 / 0.015)
    np.testing.assert_allclose(state.faults["main"]["theta"], expected, rtol=1e-9)


@pytest.mark.parametrize("changes", [{}, {"faults.main.nucleation": PUSH}], ids=["no shear", "nucleation"])
def test_the_budget_closes_on_an_interface_that_slides(changes: dict[str, Any]) -> None:
    law = {"kind": "coulomb", "mu_d": 0.3}
    _, motion, state = moving({"kind": "forward_lagrange"}, {
        "order": 1, "faults.main.friction": law, "faults.main.sliding": {}, **changes,
    })  # fmt: skip
    for _ in range(60):
        motion.step(state)
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    assert abs(work - sum(energy.values())) < 1e-11 * work and energy["frictional_dissipation"] > 0.1 * work
