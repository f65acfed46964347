"""Blocks of points that sweeps of sliding contact skip because they cannot close: bitwise the result without."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.sliding_cases import rough, solids, wave
from helpers.small_cases import advance, march

pytest.importorskip("dolfinx")

from ruptfx.bodies.state import FaultState, State
from ruptfx.case import Case, parse_case
from ruptfx.interfaces.mechanisms.sliding import SlidingFaults
from ruptfx.interfaces.sliding.step import SlidingStep
from ruptfx.laws.contact import Point
from ruptfx.laws.contact.forward_lagrange import ForwardLagrange
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

BALL = {"kind": "parabola", "radius": 8e-3, "center": {"x": 0.7e-3, "y": 0.5e-3}}
FINE = {"mesh.upper.element_size": 0.2e-3}
TURNS = np.array([1e4, 6e3, 3e4])  # of the body that turns [1/s]


def dragged(table: dict[str, Any], component: str, value: float) -> dict[str, Any]:
    """Change the velocity or the pressure of the upper body of a case."""
    for edge in table["boundaries"]:
        if edge["edge"] == "upper.top" and component == edge.get("component"):
            edge["velocity"] = value
        if component == "pressure" and edge["kind"] == "traction":
            edge["traction"] = [*[0.0] * (len(edge["traction"]) - 1), -value]
    return table


CASES: dict[str, dict[str, Any]] = {
    # At 40 m/s over an element of the other side; the nucleation acts on open points, too.
    "fast over waves": dragged(rough({
        "mesh.upper.profile": wave(1, 2e-6), "mesh.lower.profile": wave(-1, 2e-6),
        "faults.main.nucleation": {"kind": "overstress", "extra": 1e5},
    }), "x", 40.0),
    "a ball over a plate": dragged(solids({
        **FINE, "mesh.upper.profile": BALL, "mesh.curve_order": 2, "duration": 1.5e-6,
    }), "pressure", 4e6),
    "a body that turns and tilts": solids({"boundaries": [], **FINE}),
}  # fmt: skip


def end_of(name: str, monkeypatch: pytest.MonkeyPatch, factor: float = 1.0) -> tuple[State, int, int, int]:
    """Return the state at the end, updates of the pairing, steps with blocks that were skipped, and in partial contact.

    `factor` multiplies the bound of the sums of the rows of B, from which limits follow; infinite, nothing is skipped.
    """
    find = SlidingStep._find_reach

    def changed(step: SlidingStep) -> None:
        find(step)
        step._marks[4][:] = (step._marks[4] + 1e-300) * factor

    monkeypatch.setattr(SlidingStep, "_find_reach", changed)
    case = parse_case(CASES[name])
    assert isinstance(case, Case)
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    if "turns" in name:
        upper = model.layout.body == model.bodies.names.index("upper")
        places = model.coordinates[upper] - np.array([0.75e-3, 0.5e-3, 0.0])
        state.velocity.reshape(-1, 3)[upper] = np.array([8.0, 5.0, -4.0]) + np.cross(TURNS, places)
    (sliding,) = (each for each in motion.mechanisms if isinstance(each, SlidingFaults))
    skipped = partial = 0

    def count(state: State) -> None:
        nonlocal skipped, partial
        step = sliding.steps[-1][0]
        assert isinstance(step, SlidingStep)
        skipped += bool(np.any(step._marks[5] > 0))
        partial += 0.02 < np.mean(state.faults["main"]["normal_stress"] > 0) < 0.98

    advance(motion, state, case.duration, count)
    monkeypatch.undo()
    return state, sliding.followers[0].face.geometry.revision, skipped, partial


@pytest.mark.parametrize("name", CASES)
def test_nothing_depends_on_blocks_that_are_skipped(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All fields and energies bit by bit, while points close, open and find other partners."""
    skipping, updates, skipped, partial = end_of(name, monkeypatch)
    every, _, none, _ = end_of(name, monkeypatch, np.inf)
    assert updates > 2 and skipped > 20 and partial > 20 and none == 0
    fields = skipping.faults["main"]
    for key, values in every.faults["main"].items():
        np.testing.assert_array_equal(fields[key], values, err_msg=key)
    np.testing.assert_array_equal(skipping.displacement, every.displacement)
    np.testing.assert_array_equal(skipping.velocity, every.velocity)
    assert skipping.energy == every.energy


@pytest.mark.parametrize("name", ["fast over waves", "a ball over a plate"])
def test_limits_hold_at_any_velocities(name: str) -> None:
    """Single steps from random velocities, of which many close points in the middle of the sweeps: a bound that is a
    millionth of the right one is seen."""
    model, motion, state = march(parse_case(CASES[name]))
    (sliding,) = (each for each in motion.mechanisms if isinstance(each, SlidingFaults))
    step, dofs = sliding.steps[-1][0], model.faults[0].interface.nodes
    assert isinstance(step, SlidingStep)
    fields, spread, rng = state.faults["main"], step._marks[4], np.random.default_rng(1)
    right, differ = spread.copy(), 0
    for size in np.repeat([1.0, 10.0, 100.0], 30):
        velocity = state.velocity.copy()
        velocity.reshape(model.nodes, -1)[dofs] += size * rng.standard_normal((len(dofs), model.components))
        results = []
        for factor in (1.0, np.inf, 1e-6):
            spread[:] = (right + 1e-300) * factor
            new, force = velocity.copy(), np.zeros_like(state.force)
            changed = FaultState({key: values.copy() for key, values in fields.items()})
            step(changed, state.displacement, new, force, state.time)
            results.append([new, force, *changed.values()])
        for skipping, every in zip(*results[:2], strict=True):
            np.testing.assert_array_equal(skipping, every)
        differ += any(np.any(wrong != every) for wrong, every in zip(*results[2:0:-1], strict=True))
    assert differ


def test_the_trial_of_sweeps_follows_the_opening_velocity_by_the_impedance() -> None:
    """The contract from which margins of open points follow (`ContactMethod.sweeps_to`)."""
    speeds, impedance = np.array([-3.0, 0.0, 5.0]), 2e6
    none = np.zeros(3)
    trial = ForwardLagrange().trial(Point(
        normal_stress_0=none, shear_traction_0=[none], opening_jump=none + 1e-7, slip_jump=[none],
        opening_velocity=speeds, slip_velocity=[none], slip=[none], since=none + 1e-8, dt=none + 1e-8,
        normal_impedance=none + impedance, shear_impedance=[none + impedance],
    ))  # fmt: skip
    np.testing.assert_allclose(np.diff(trial.normal_stress) / np.diff(speeds), -impedance, rtol=1e-12)
