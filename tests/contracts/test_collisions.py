"""Pieces that meet: what contact holds and loses closes the budget, and check says what there is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from crack_cases import meeting_blocks

pytest.importorskip("dolfinx")

from benchmarks.collisions import NEVER, Flight, pair
from ruptfx.case import parse_case
from ruptfx.checks.preflight import preflight
from ruptfx.model import Model
from ruptfx.schema import CaseError

pytestmark = pytest.mark.fem


def test_what_contact_loses_closes_the_budget() -> None:
    """With what finite steps take where bodies turn, which is less in proportion where strains are smaller."""

    def flown(velocity: float) -> tuple[float, float, float]:
        gap = 2e-6 * velocity
        bodies = {
            name: {"kind": "rectangle", "center": [x, 0.0], "width": 2e-3, "height": 2e-3}
            for name, x in (("a", 0.0), ("b", 2e-3 + gap))
        }
        given = {"a": [velocity, 0.0], "b": [-velocity, 0.1 * velocity]}
        return Flight(pair(bodies, 0.3, 5e-6, {"initial_velocity": given})).fly()[1:]

    lost, turned, missing = flown(5.0)
    same, less, too = flown(0.5)
    assert all(1e-7 < part < 5e-3 for part in (lost, same))  # when in a step they meet decides
    assert less < 0.2 * turned < 1e-6 and turned < 0.1 * lost
    assert missing < 1e-12 and too < 1e-12


@pytest.mark.parametrize("speed", [5.0, 15.0])
def test_a_block_slides_with_the_steady_strength_of_rate_and_state(speed: float) -> None:
    """f_0 + (a - b) ln(V / V_0) times the load, while cells meet others; damped, as contact vibrates."""
    friction = {"kind": "rate_and_state_ageing", "a": 0.015, "b": 0.01, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-6,
                "theta_initial": 1.0}  # fmt: skip
    bodies = {
        "plate": {"kind": "rectangle", "center": [0.0, 0.0], "width": 12e-3, "height": 2e-3},
        "block": {"kind": "rectangle", "center": [-2e-3, 2e-3], "width": 4e-3, "height": 2e-3},
    }
    flight = Flight(pair(bodies, 0.0, 6e-5, {
        "fracture": {"kind": "intrinsic", "default": {"cohesion": NEVER, "friction": friction}},
        "damping": {"mass": 1e5},
        "boundaries": [
            {"kind": "traction", "edge": "block.top", "traction": [0.0, -10e6], "ramp": 5e-6},
            {"kind": "driven", "edge": "block.top", "component": "x", "velocity": speed, "ramp": 5e-6},
            *({"kind": "driven", "edge": "plate.bottom", "component": axis, "velocity": 0.0} for axis in "xy"),
        ],
    }))  # fmt: skip
    forces = flight.forces("block")
    along, across = forces[len(forces) // 2 :].mean(axis=0)
    assert across == pytest.approx(10e6 * 4e-3, rel=0.03)  # it still vibrates across the plate
    assert -along / across == pytest.approx(0.6 + 0.005 * np.log(speed / 1e-6), rel=1e-3)  # 4e-4 and 1e-5 off
    energy = flight.motion.energies(flight.state)
    given = energy.pop("boundary_work")
    assert abs(given - sum(energy.values())) < 1e-12 * given


COULOMB = {"kind": "coulomb", "mu_d": 0.5}


@pytest.mark.parametrize(("law", "reason"), [
    ({"kind": "cohesion", "c": 1e6, "law": COULOMB}, "one of facets"),
    ({"kind": "pressurised", "pressure": 1e6, "begin": 1e-6, "law": COULOMB}, "time since the start"),
    ({"kind": "coulomb", "mu_d": {"kind": "boxcar", "inside": 0.2, "outside": 0.5, "center": 0.0, "half_width": 1e-3}},
     "varies"),
])  # fmt: skip
def test_friction_that_colliding_cells_cannot_have_is_refused(law: dict[str, Any], reason: str) -> None:
    with pytest.raises(CaseError, match=reason):
        Model(parse_case(meeting_blocks({"fracture.default.friction": law})))


def test_check_tells_of_bodies_that_have_facets_and_of_cells_that_may_meet() -> None:
    rows = {row.quantity: row for row in preflight(parse_case(meeting_blocks()))}
    zones = {name.split()[1].rstrip(":") for name in rows if "process zone" in name}
    assert zones == {"plate-plate", "stone-stone"}
    found = rows["collisions: cells that may meet"]
    assert isinstance(found.value, (int, float)) and 20 < found.value < int(found.note.split()[1].rstrip(","))
