"""Loading in stages in implicit steps: they end where a stage does, and what goes on is not disturbed."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.small_cases import COMPLIANT, merged, plates

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.platform import fem
from ruptfx.run import stages
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
STEP = 1e-6
STEPPERS: dict[str, dict[str, Any]] = {
    "quasi_static": {"kind": "quasi_static", "first_step": STEP, "largest_step": STEP, "smallest_step": STEP},
    "generalized_alpha": {"kind": "generalized_alpha", "time_step": STEP},
    "average_acceleration": {"kind": "generalized_alpha", "scheme": "average_acceleration", "time_step": STEP},
    "hybrid": {
        "kind": "hybrid", "fast_above": 1e-2, "slow_below": 1e-3, "calm_for": 1e-6,
        "slow": {"kind": "quasi_static", "first_step": STEP, "largest_step": STEP},
        "fast": {"kind": "leapfrog", "time_step": 5e-8},
    },
}  # fmt: skip
HELD = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
PRESSES = {"kind": "traction", "edge": "upper.top", "traction": [0.0, -2e6], "ramp": 2e-6}
TOP = {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 0.0}
SHEARS = {**TOP, "velocity": 4.0}


def table(stepper: str, changes: dict[str, Any]) -> dict[str, Any]:
    """Two plates, the lower one held, that stick or slide with friction of 0.3 under 6 MPa."""
    return plates({
        "order": 2, "duration": 12e-6, "faults.main.contact": COMPLIANT, "stepper": STEPPERS[stepper],
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.3}, **changes,
    })  # fmt: skip


def staged(*given: tuple[float, list[dict[str, Any]]], **more: Any) -> dict[str, Any]:
    return {"stages": [{"duration": duration, "boundaries": [*HELD, *each], **more} for duration, each in given]}


def march(given: dict[str, Any]) -> tuple[Any, Any, list[float]]:
    """To the end of a case; the motion, the state and the times of all steps."""
    case = parse_case(given)
    motion = stages.bind(model := Model(case))
    state, times = model.initial_state(), [0.0]
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
        times.append(state.time)
    return motion, state, times


def assert_same(one: Any, other: Any) -> None:
    fields = [(one.displacement, other.displacement), (STEP * one.velocity, STEP * other.velocity)]
    fields += [(one.faults["main"][name], other.faults["main"][name]) for name in ("slip", "shear_traction")]
    for a, b in fields:
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * np.abs(b).max(initial=1e-6))


@pytest.mark.parametrize("stepper", [name for name in STEPPERS if name != "hybrid"])
def test_stages_that_change_nothing(stepper: str) -> None:
    """Ramped loads of the first stage, held in the second."""
    after = {**PRESSES, "ramp": 0.0}
    (_, alone, _), (motion, cut, times) = (march(table(stepper, changes)) for changes in (
        {"boundaries": [*HELD, SHEARS, PRESSES]},
        staged((5e-6, [SHEARS, PRESSES]), (7e-6, [SHEARS, after])),
    ))  # fmt: skip
    np.testing.assert_allclose(times, STEP * np.arange(13), rtol=1e-12)
    assert cut.faults["main"]["slip"].max(initial=1e-6) > 1e-7
    assert_same(cut, alone)
    energy = motion.energies(cut)
    work = energy.pop("boundary_work")
    if stepper != "generalized_alpha":  # which damps what it does not resolve
        assert abs(work - sum(energy.values())) < 1e-9 * work


@pytest.mark.parametrize("stepper", ["quasi_static", "generalized_alpha"])
def test_press_hold_shear(stepper: str) -> None:
    """The same as loads of one case that begin when they should."""
    held = {**PRESSES, "ramp": 0.0}
    pushes = {"kind": "traction", "edge": "upper.left",
              "traction": [7e6 if stepper == "quasi_static" else 60e6, 0.0]}  # fmt: skip
    history = {"kind": "sampled", "times": [0.0, 5e-6, 9e-6], "values": [0.0, 0.0, 1.0]}
    (_, alone, _), (_, cut, _) = (march(table(stepper, changes)) for changes in (
        {"boundaries": [*HELD, PRESSES, {**pushes, "history": history}]},
        staged((3e-6, [PRESSES]), (2e-6, [held]), (7e-6, [held, {**pushes, "ramp": 4e-6}])),
    ))  # fmt: skip
    assert cut.faults["main"]["slip"].max(initial=0.0) > 1e-7
    assert_same(cut, alone)


@pytest.mark.parametrize("stepper", ["quasi_static", "generalized_alpha"])
def test_steps_end_where_a_stage_does(stepper: str) -> None:
    """One step is cut at the end of a stage; then they are as long as before."""
    held = {**PRESSES, "ramp": 0.0}
    _, _, times = march(table(stepper, staged((2.3e-6, [SHEARS, PRESSES]), (9.7e-6, [SHEARS, held]))))
    np.testing.assert_allclose(times[:6], [0, 1e-6, 2e-6, 2.3e-6, 3.3e-6, 4.3e-6], rtol=1e-12, atol=1e-18)


def test_other_loads_act_at_once() -> None:
    """A block in antiplane shear that is let go: held, its acceleration is zero, free, it is that of the forces."""
    sheared = {"kind": "driven", "edge": "upper.top", "component": "z", "velocity": 1.0}
    bottom = {**sheared, "edge": "lower.bottom", "velocity": 0.0}
    given = table("average_acceleration", {
        "plane": "antiplane", "faults.main.friction": {"kind": "coulomb", "mu_d": 1e6}, "duration": 4e-6,
        "stages": [{"duration": 2e-6, "boundaries": [sheared, bottom]}, {"duration": 2e-6, "boundaries": [bottom]}],
    })  # fmt: skip
    case = parse_case(given)
    motion = stages.bind(model := Model(case))
    state, driven = model.initial_state(), model.coordinates[:, 1] > 4e-3 - 1e-9
    motion.step(state)
    assert driven.any() and not state.fields["acceleration"][driven].any()
    motion.step(state)
    force = model.internal_force(state.displacement)
    np.testing.assert_allclose(state.fields["acceleration"][driven], (force / model.mass)[driven], rtol=1e-9)
    energy = motion.energies(state)
    given_before = energy["boundary_work"]
    motion.step(state)
    motion.step(state)
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    assert work == pytest.approx(given_before, rel=1e-9)  # nobody drives it any more
    assert abs(work - sum(energy.values())) < 1e-9 * work


@pytest.mark.skipif(COMM.size > 1, reason="compares two runs of one rank")
@pytest.mark.parametrize("stepper", ["quasi_static", "generalized_alpha", "hybrid"])
@pytest.mark.parametrize("every", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_goes_on_with_the_same_bits(stepper: str, every: int, tmp_path: Path) -> None:
    """From within a stage, and from the step that ends one."""
    held = {**PRESSES, "ramp": 1e-6, "traction": [0.0, -1e6]}
    given = parse_case(merged(table(stepper, staged(
        (3.5e-6, [PRESSES, TOP]), (8.5e-6, [held, SHEARS]), damping={} if stepper == "quasi_static" else {"mass": 1e5},
    )), {"output.checkpoint_steps": every, "output.interface_interval": 1e-6}))  # fmt: skip
    simulate(given, tmp_path / "whole", progress=False)
    shutil.copytree(tmp_path / "whole", tmp_path / "resumed")
    (tmp_path / "resumed" / "summary.json").unlink()
    simulate(given, tmp_path / "resumed", progress=False, resume=True)
    found = largest_difference(tmp_path / "whole", tmp_path / "resumed")
    assert max(found.values()) == 0
