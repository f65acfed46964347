"""Bodies beyond the limit of a factorisation: the numbers of the factors, and iterations that do not grow."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers.sliding_cases import solids
from helpers.small_cases import strike_slip

pytest.importorskip("dolfinx")

from ruptfx.app.checks.preflight import preflight
from ruptfx.case import parse_case
from ruptfx.run import stages
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import preconditioners
from ruptfx.stepping.implicit.compliance import Decomposed, Factors, Jumps, norm
from ruptfx.stepping.implicit.iterated import Iterated
from ruptfx.stepping.implicit.preconditioners import lu

pytestmark = pytest.mark.fem

LAW = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 2e-7, "f_0": 0.6, "V_0": 1e-6}
FAR = [{"kind": "driven", "edge": f"{side}.far", "component": axis,
        "velocity": 1e-6 if (side, axis) == ("plus", "z") else 0.0}
       for side in ("plus", "minus") for axis in "xyz"]  # fmt: skip
FAULT: dict[str, Any] = {
    "mesh.element_size": 4e-3, "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14},
    "faults.main.friction": LAW, "boundaries": FAR, "stepper": {"kind": "quasi_dynamic"}, "duration": 50.0,
}  # fmt: skip
DRAGGED = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xyz"] + [
    {"kind": "driven", "edge": "upper.top", "component": axis, "velocity": value}
    for axis, value in zip("xyz", (8.0, 6.0, -2.0), strict=True)
]
COARSE = {"mesh.upper.element_size": 0.75e-3, "mesh.lower.element_size": 0.9e-3, "boundaries": DRAGGED,
          "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}}  # fmt: skip
CASES: dict[str, dict[str, Any]] = {
    "quasi_dynamic": strike_slip(FAULT),
    "quasi_dynamic, order 1": strike_slip(FAULT | {"order": 1}),
    "sliding, quasi_static": solids(COARSE | {"stepper": {"kind": "quasi_static"}}),
    "sliding, generalized_alpha": solids(COARSE | {"stepper": {"kind": "generalized_alpha", "time_step": 1e-7}}),
}
STEPS = 3


def march(name: str) -> dict[str, np.ndarray]:
    """Return the displacement and the fields of the fault after a few steps."""
    case = parse_case(CASES[name])
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    for _ in range(STEPS):
        motion.step(state)
    return {"displacement": state.displacement, **state.faults["main"]}


@pytest.mark.parametrize("name", CASES)
def test_numbers_are_those_of_the_factors(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = []
    for kind in (Decomposed, Iterated):
        init = kind.__init__

        def count(self: Any, *parts: Any, kind: type = kind, init: Any = init) -> None:
            kinds.append(kind)
            init(self, *parts)

        monkeypatch.setattr(kind, "__init__", count)
    theirs = march(name)
    assert set(kinds) == {Decomposed}
    kinds.clear()
    monkeypatch.setitem(lu.DIRECT, 3, 0)
    ours = march(name)
    assert Iterated in kinds
    assert sum(np.abs(value).max(initial=0.0) > 0 for value in ours.values()) > 6
    for field, value in theirs.items():
        scale = np.nanmax(np.abs(value), initial=0.0)
        np.testing.assert_allclose(ours[field], value, rtol=0, atol=1e-8 * scale, err_msg=field)


def test_a_body_beyond_the_limit_takes_as_many_iterations() -> None:
    """Loads on the interface of 12 000 and of 63 000 unknowns: the residual by the operator, and the iterations."""
    counts, unknowns = [], []
    for size in (1.5e-3, 0.65e-3):
        model = Model(
            parse_case(CASES["quasi_dynamic"] | {"mesh": {**CASES["quasi_dynamic"]["mesh"], "element_size": size}})
        )
        model = model.in_steps("implicit")
        kind = preconditioners.choose(model, {"pc_type": "mg"})
        tangent = kind.make_tangent(model, np.zeros(len(model.mass)))
        jumps = Jumps(model)
        spring = {"main": np.tile(1e12 * np.eye(3), (len(model.faults[0].interface.plus), 1, 1))}
        fill = partial(tangent.update, 0.0, 0.0, spring, driven=tangent.unit)
        bodies = Factors(model, tangent, fill, kind)
        load = np.zeros((jumps.points, 3))
        load[jumps.points // 2] = 1e6, 2e6, 3e6
        force = jumps.force(load, len(model.mass))
        u = bodies.solve(force)
        wrong = force + model.internal_force(u) - jumps.force(1e12 * jumps.of(u), len(u))
        wrong[model.loads.prescribed] = 0.0
        assert norm(model, wrong) < 1e-10 * norm(model, force)
        assert isinstance(bodies.inverse, Iterated)
        counts += bodies.inverse.iterations
        unknowns.append(model.total_nodes * model.components)
    assert 12e3 < unknowns[0] < 13e3 and unknowns[1] > lu.DIRECT[3]
    assert max(counts) <= 15 and abs(counts[1] - counts[0]) <= 3


@pytest.mark.parametrize(
    ("name", "components"), [("quasi_dynamic", 3 * 7 * 5), ("sliding, quasi_static", 3 * (5 * 3 + 7 * 7))]
)
def test_check_says_the_time_before_it_is_spent(name: str, components: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Twenty microseconds for every component and unknown, in rows that come before the matrix is computed."""
    monkeypatch.setitem(lu.DIRECT, 3, 0)
    rows, case = {}, parse_case(CASES[name])
    unknowns = Model(case).total_nodes * 3
    with monkeypatch.context() as patch, pytest.raises(NotImplementedError):
        patch.setattr(stages, "bind", lambda model: _refuse())
        for row in preflight(case):
            rows[row.quantity] = row.value
    assert components in rows.values()
    assert rows["time of the solutions"] == pytest.approx(2e-5 * components * unknowns)


def _refuse() -> None:
    raise NotImplementedError
