"""Order of the interface step in time, on a fixed mesh, and its stability where the memory is shorter than a step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from small_cases import COMPLIANT, SPLIT, march, memory_friction, plates

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case

pytestmark = pytest.mark.fem

DURATION = 8e-6
COULOMB = {"kind": "coulomb", "mu_d": 0.3}
AGEING = {
    "kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 20e-6, "f_0": 0.3, "V_0": 1e-3, "V_initial": 1e-3,
}  # fmt: skip
# The strength of these does not depend on the slip rate itself: second order.
SECOND = {
    "coulomb": COULOMB,
    "slip weakening": {"kind": "exponential_slip_weakening", "mu_s": 0.35, "mu_d": 0.25, "D_c": 20e-6},
    "memory over slip": {"kind": "prakash_clifton", "L_p": 40e-6, "law": COULOMB},
    "two memories": {"kind": "prakash_clifton_two", "L_1": 40e-6, "L_2": 10e-6, "law": COULOMB},
    "memory in time": {"kind": "memory_constant_time", "t_c": 2e-6, "law": COULOMB},
}
# The slip rate in the strength is that of the middle of a step, and not of the time of the traction: first order.
FIRST = {"ageing": AGEING, "power law": memory_friction("P1")}
METHODS = pytest.mark.parametrize("contact", [COMPLIANT, SPLIT], ids=["compliant", "split_node"])


def jumps(friction: dict[str, Any], contact: dict[str, Any], steps: int) -> np.ndarray:
    """Slip jump along the interface after `steps` steps; plates driven so that shear and normal stress change."""
    table = plates({
        "order": 2, "duration": DURATION, "stepper": {"kind": "leapfrog", "time_step": DURATION / steps},
        "faults.main.friction": friction, "faults.main.contact": contact,
        "faults.main.initial_stress": {"normal": 6e6, "shear": 1.5e6},
    })  # fmt: skip
    table["boundaries"] = [
        {"kind": "driven", "edge": edge, "component": component, "velocity": velocity, "ramp": DURATION / 2}
        for edge, component, velocity in (
            ("upper.left", "x", 4.0), ("upper.top", "y", -1.0), ("lower.bottom", "y", 0.0), ("lower.left", "x", 0.0),
        )
    ]  # fmt: skip
    model, _, state = march(parse_case(table))
    face = model.faults[0].interface
    assert float(np.abs(state.faults["main"]["slip"]).max()) > 1e-6
    return face.split(face.jump(state.displacement))[1][:, 0]


def order(friction: dict[str, Any], contact: dict[str, Any]) -> float:
    coarse, middle, fine = (jumps(friction, contact, steps) for steps in (160, 320, 1280))
    # The error of the finest run, 1/16 of that of the middle one for order 2, makes this 2.1; for order 1, 1/4 and 1.2.
    return float(np.log2(np.abs(coarse - fine).max() / np.abs(middle - fine).max()))


@METHODS
@pytest.mark.parametrize("name", SECOND)
def test_second_order(name: str, contact: dict[str, Any]) -> None:
    assert order(SECOND[name], contact) > 1.7


@METHODS
@pytest.mark.parametrize("name", FIRST)
def test_first_order_with_a_direct_effect(name: str, contact: dict[str, Any]) -> None:
    assert order(FIRST[name], contact) > 0.9


@METHODS
def test_a_memory_much_shorter_than_a_step_is_no_memory(contact: dict[str, Any]) -> None:
    """Relaxation within 1e-3 of a step, or within a slip of a nanometre: plain Coulomb friction, and stable."""
    plain = jumps(COULOMB, contact, 160)
    for short in (
        {"kind": "memory_constant_time", "t_c": 5e-11}, {"kind": "prakash_clifton", "L_p": 1e-9, "V_star": 10.0},
    ):  # fmt: skip
        difference = np.abs(jumps({**short, "law": COULOMB}, contact, 160) - plain).max()
        assert difference < 5e-3 * np.abs(plain).max()
