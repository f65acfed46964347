"""Interfaces whose nodes match give what they gave before there were others.

The saved fields are of the last version without interfaces that slide; only energies, which have other columns since,
and arrivals where a gap closes, which have another meaning, are newer. Bits depend on compiler and processor; what is
saved is held to far less than any change of a formula and far more than rounding does: with the weak form instead of
the fast kernel (RUPTFX_TEST_OPERATOR=ufl_form), whose sums have another order, the same numbers come out within
TOLERANCE, too. Where a change is meant, write them again and say why:

    python tests/verification/test_matching_path.py
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.small_cases import SPLIT, impact, march, merged, plates, slip_weakening

pytest.importorskip("ruptfx.platform.fem")

from ruptfx.case import parse_case
from ruptfx.interfaces.sliding.interface import SlidingInterface

pytestmark = pytest.mark.fem

SAVED = Path(__file__).parents[1] / "data" / "matching_path.json"
TOLERANCE = 1e-9  # of the largest value of a field
FIELDS = ("slip", "slip_rate", "normal_stress", "shear_traction", "opening", "friction_work", "rupture_time")


def _fixed(table: dict, step: float, steps: int) -> dict:
    """With a step that no spectrum chooses, so that rounding of one cannot change it."""
    return merged(table, {"stepper": {"kind": "leapfrog", "time_step": step}, "duration": step * steps})


CASES = {
    "rupture between rigid sides": _fixed(slip_weakening(), 1e-7, 60),
    "impact on springs with rate, state and memory": _fixed(
        impact(6e6, 20.0, changes={"mesh.length": 20e-3}), 2e-8, 250
    ),
    "gap that closes and slides": _fixed(plates({
        "faults.main.contact": SPLIT, "faults.main.friction": {"kind": "coulomb", "mu_d": 0.3},
        "faults.main.initial_stress.normal": 0.0, "faults.main.gap": 2e-8,
        "boundaries": [
            {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": -0.5},
            {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0},
        ],
    }), 5e-8, 100),
}  # fmt: skip


def numbers(name: str) -> dict[str, list[float]]:
    """Fields at all points, and energies, at the end."""
    model, motion, state = march(parse_case(CASES[name]))
    assert not isinstance(model.faults[0].interface, SlidingInterface)
    found = {field: state.faults["main"][field].tolist() for field in FIELDS}
    return found | {"energy": list(motion.energies(state).values())}


@pytest.mark.parametrize("name", CASES)
def test_matching_interfaces_give_what_they_gave(name: str) -> None:
    saved, found = json.loads(SAVED.read_text())[name], numbers(name)
    assert max(map(abs, saved["slip"])) > 1e-7 and set(saved) == set(found)
    for field, expected in saved.items():
        scale = np.nanmax(np.abs(np.array(expected, dtype=float)), initial=0.0)
        np.testing.assert_allclose(found[field], np.array(expected, dtype=float), rtol=0, atol=TOLERANCE * scale,
                                   err_msg=field)  # fmt: skip


if __name__ == "__main__":
    SAVED.write_text(json.dumps({name: numbers(name) for name in CASES}, indent=None) + "\n")
