"""Every rule that stops a run, by its own example: read again, ends a run, on any ranks, also after a resume."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from helpers.messages import facts
from helpers.small_cases import plates

pytest.importorskip("dolfinx")

from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.platform import fem
from ruptfx.run.model import Model
from ruptfx.stepping.stopping import StopRules

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

RULES = alternatives("ruptfx.stepping.stop_rules")
every_rule = pytest.mark.parametrize("kind", RULES)
PATCH = {"kind": "boxcar", "inside": 0.2e6, "outside": 0.0, "center": 6e-3, "half_width": 1e-3}
LAW = {"kind": "coulomb", "mu_d": 0.03}


def example(kind: str) -> dict[str, Any]:
    """What the rule gives as an example."""
    return tomllib.loads(f"rule = {RULES[kind].example}")["rule"]


def slipping(kind: str, changes: dict[str, Any] | None = None) -> Case:
    """Two plates whose interface slips at once between 5 and 7 mm, and stops."""
    return parse_case(plates({
        "boundaries": [], "duration": 60e-6, "output.interface_interval": 0.5e-6, "faults.main.friction": LAW,
        "faults.main.initial_stress.shear": PATCH, "stop_when": {"rules": [example(kind)]},
        **(changes or {}),
    }))  # fmt: skip


def march(given: Case, comm: Any, saved: dict[str, Any] | None = None, steps: int = 0) -> tuple[int, str, Any]:
    """Step until the rule ends it; return the step, the reason and the variables after some steps."""
    model = Model(given, comm)
    motion, state, rules = given.stepper.bind(model), model.initial_state(), StopRules(model, given.stop_when)
    kept: Any = None
    while state.time < given.duration and not rules.ended:
        motion.step(state)
        if state.step % 10 == 0:
            if saved is not None and state.step == steps:  # what a checkpoint before this record contains
                rules = StopRules(model, given.stop_when)
                rules.restore(saved)
            rules.check(state)
            if state.step == steps - 10:
                kept = rules.table()
    return state.step, rules.ended, kept


@every_rule
def test_written_and_read_again(kind: str) -> None:
    given = slipping(kind)
    again = parse_case(tomllib.loads(given.to_toml()))
    assert example(kind)["kind"] == kind and again == given and again.hash == given.hash


@every_rule
def test_it_ends_its_example_with_its_reason_on_any_ranks(kind: str) -> None:
    given = slipping(kind)
    assert RULES[kind].reason
    together, alone = (march(given, comm)[:2] for comm in (fem.MPI.COMM_WORLD, fem.MPI.COMM_SELF))
    assert together == alone and alone[1] == RULES[kind].reason


@every_rule
def test_it_ends_at_the_same_step_after_a_resume(kind: str) -> None:
    """Its variables of a checkpoint ten steps before, set in a new watch."""
    given, comm = slipping(kind), fem.MPI.COMM_SELF
    end, reason, _ = march(given, comm)
    _, _, kept = march(given, comm, steps=end)
    assert march(given, comm, saved=kept, steps=end)[:2] == (end, reason)


@every_rule
def test_a_rule_on_interfaces_is_refused_without_one(kind: str) -> None:
    plate = {"kind": "rectangle", "center": [0.0, 0.0], "width": 4e-3, "height": 2e-3}
    table = plates({"faults": {}, "stop_when": {"rules": [example(kind)]}})
    table |= {"mesh": {"kind": "pieces", "element_size": 1e-3, "bodies": {"plate": plate}}, "faults": {}}
    if RULES[kind].of_interfaces:
        with pytest.raises(CaseError, match=facts(r"stop_when\.rules\.0")):
            parse_case(table)
    else:
        parse_case(table)


def test_a_position_that_no_interface_reaches_is_refused() -> None:
    given = slipping("tip_beyond", {"stop_when": {"rules": [{"kind": "tip_beyond", "position": 1.0}]}})
    with pytest.raises(CaseError, match=facts(r"stop_when\.rules\.0: .* 1; there are: faults.main from 0 to 0.012 m")):
        StopRules(Model(given), given.stop_when)
