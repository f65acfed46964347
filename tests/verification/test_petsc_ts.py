"""PETSc's TS and the native leapfrog solve the same equation: both go to the same limit, each at its order."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import case, impact, march

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import ConvergenceError

pytestmark = pytest.mark.fem

DRIVEN = [
    {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0, "ramp": 4e-6},
    {"kind": "traction", "edge": "upper.top", "traction": [1e6, 2e6], "ramp": 3e-6},
]
DURATION = 2e-6


def displacement(stepper: dict[str, Any], steps: int) -> np.ndarray:
    """At the end of a smooth motion of stuck plates."""
    smooth = case({
        "order": 2, "duration": DURATION, "boundaries": DRIVEN, "stepper": {**stepper, "time_step": DURATION / steps},
    })  # fmt: skip
    return march(smooth)[2].displacement


@pytest.fixture(scope="module")
def limit() -> np.ndarray:
    return displacement({"kind": "leapfrog"}, 2000)


@pytest.mark.parametrize("scheme, lowest, highest", [
    ("alpha2", 3.5, 4.5), ("basicsymplectic", 3.5, 4.5),
    ("rk", 6.5, 9.0),  # third order
])  # fmt: skip
def test_goes_to_the_limit_of_leapfrog_at_its_order(scheme: str, lowest: float, highest: float, limit: Any) -> None:
    errors = [
        np.linalg.norm(displacement({"kind": "petsc_ts", "scheme": scheme}, steps) - limit) / np.linalg.norm(limit)
        for steps in (30, 60, 120)[scheme == "rk" :]  # with 30 steps explicit Runge-Kutta is not stable
    ]
    assert all(lowest < coarse / fine < highest for coarse, fine in pairwise(errors)), errors
    assert errors[-1] < 1e-3


def test_verlet_is_leapfrog() -> None:
    """The same positions to rounding."""
    ours, theirs = (
        displacement({"kind": "petsc_ts", "scheme": "basicsymplectic"}, 80),
        displacement({"kind": "leapfrog"}, 80),
    )
    np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(theirs).max())


@pytest.mark.parametrize("scheme", ["alpha2", "rk"])
def test_slides_like_leapfrog(scheme: str) -> None:
    """Slip of the shear impact within 2 % at steps of leapfrog's size."""
    changes = {"order": 2, "duration": 10e-6, "mesh.length": 16e-3, "mesh.height": 6e-3}
    stable = stable_time_step(Model(parse_case(impact(6e6, 2.0, changes=changes))))

    def slip(stepper: dict[str, Any]) -> np.ndarray:
        sliding = impact(6e6, 2.0, changes={**changes, "stepper": {**stepper, "time_step": 10e-6 / steps}})
        state = march(parse_case(sliding))[2]
        fault = state.faults["main"]
        return fault["slip"] + state.lag * fault["slip_rate"]

    steps = int(np.ceil(10e-6 / (0.3 * stable)))
    theirs, ours = slip({"kind": "leapfrog"}), slip({"kind": "petsc_ts", "scheme": scheme})
    assert theirs.max() > 1e-6
    assert np.linalg.norm(ours - theirs) < 0.02 * np.linalg.norm(theirs)


def test_options_choose_the_scheme_and_unknown_ones_are_refused() -> None:
    def first_step(options: dict[str, Any]) -> Any:
        chosen = case({"order": 2, "stepper": {"kind": "petsc_ts", "scheme": "rk", "petsc_options": options}})
        model = Model(chosen)
        motion = chosen.stepper.bind(model)
        motion.step(model.initial_state())
        return motion

    assert first_step({"ts_rk_type": "5dp"})._ts.getRKType() == "5dp"
    with pytest.raises(CaseError, match=facts(r"petsc_options\.ts_rk_typo = '5dp': TS of type rk has no such option")):
        first_step({"ts_rk_typo": "5dp"})


@pytest.mark.parametrize("changes, message", [
    ({"damping": {"mass": 1e4}, "stepper.scheme": "basicsymplectic"},
     r"stepper\.scheme = 'basicsymplectic': .*use 'rk' or 'alpha2'"),
    ({"stepper.scheme": "basicsymplectic", "stepper.petsc_options": {"ts_basicsymplectic_type": "3"}}, "back in time"),
])  # fmt: skip
def test_what_ts_cannot_do_is_refused(changes: dict[str, Any], message: str) -> None:
    refused = case({"order": 2, "stepper": {"kind": "petsc_ts"}, **changes})
    with pytest.raises(CaseError, match=facts(message)):
        refused.stepper.bind(Model(refused))


@pytest.mark.parametrize("contact", ["split_node", "augmented_lagrangian"])
def test_contact_that_ts_has_no_use_for_is_refused(contact: str) -> None:
    with pytest.raises(CaseError, match=facts(f"faults.main.contact.kind = '{contact}': .*; use .*'compliant'")):
        case({"stepper": {"kind": "petsc_ts"}, "faults.main.contact": {"kind": contact}})


SLIDING = {"order": 2, "duration": 10e-6, "mesh.length": 16e-3, "mesh.height": 6e-3}
LINE_SEARCH = {"snes_linesearch_type": "bt"}  # finds no step where the residual grows first, as at the onset of sliding


def sliding(options: dict[str, Any]) -> Any:
    stepper = {"kind": "petsc_ts", "courant": 10.0, "petsc_options": options}
    return parse_case(impact(6e6, 2.0, changes={**SLIDING, "stepper": stepper}))


def test_steps_have_the_length_that_was_asked_for() -> None:
    """The first solve converges: as many steps as the duration has, and none is rejected."""
    times = []
    _, motion, _ = march(sliding({}), watch=lambda state: times.append(state.time))
    np.testing.assert_allclose(np.diff([0.0, *times]), motion.dt, rtol=1e-9)
    assert len(times) == int(np.ceil(10e-6 / motion.dt)) and motion._ts.getSNESFailures() == 0
    assert motion._kept.made < 0.1 * motion._ts.getSNESIterations()  # factors of earlier matrices precondition


def test_a_rejected_step_is_an_error_or_said(caplog: pytest.LogCaptureFixture) -> None:
    """Without an adaptor the run ends; with one the step is shorter, and the log has the rejected attempts."""
    given = sliding(LINE_SEARCH)
    motion, state = given.stepper.bind(Model(given)), Model(given).initial_state()
    with pytest.raises(ConvergenceError, match=facts(r"TS (alpha2) .* 3.16e-06 s .* 0 s: .*stepper.time_step")):
        motion.step(state)
    assert state.time == 0 and not state.displacement.any()
    given = sliding(LINE_SEARCH | {"ts_adapt_type": "basic"})
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    motion.step(state)
    assert 0 < state.time < 0.5 * motion.dt
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert f"{motion.dt:.4g} s" in caplog.text and f"{state.time:.4g} s" in caplog.text
