"""Pieces that meet: what contact holds and loses closes the budget, and check says what there is."""

from __future__ import annotations

import pytest
from crack_cases import meeting_blocks

pytest.importorskip("dolfinx")

from ruptfx.bench.collisions import Flight, pair
from ruptfx.case import parse_case
from ruptfx.checks.preflight import preflight

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


def test_check_tells_of_bodies_that_have_facets_and_of_cells_that_may_meet() -> None:
    rows = {row.quantity: row for row in preflight(parse_case(meeting_blocks()))}
    zones = {name.split()[1].rstrip(":") for name in rows if "process zone" in name}
    assert zones == {"plate-plate", "stone-stone"}
    found = rows["collisions: cells that may meet"]
    assert isinstance(found.value, (int, float)) and 20 < found.value < int(found.note.split()[1].rstrip(","))
