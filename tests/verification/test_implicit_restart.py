"""Implicit runs that were stopped go on to the same bits; steps that find no equilibrium are halved, then it stops."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.small_cases import case, impact

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.case import parse_case
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.steppers.generalized_alpha import GeneralizedAlphaMotion

pytestmark = pytest.mark.fem


RIGID = {"kind": "augmented_lagrangian"}
TIED = {"boundaries": [
    {"kind": "periodic", "first": "upper.left", "second": "upper.right"},
    {"kind": "periodic", "first": "lower.left", "second": "lower.right"},
    {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 5.0},
    {"kind": "driven", "edge": "lower.bottom", "component": "x", "velocity": -5.0},
]}  # fmt: skip


@pytest.mark.parametrize("changes", [
    pytest.param({"faults.main.contact": {"kind": "compliant", "C_n": 300e9, "C_s": 100e9}}, id="compliant"),
    pytest.param({"faults.main.contact": RIGID}, id="rigid", marks=pytest.mark.slow), pytest.param(TIED, id="periodic"),
    pytest.param(TIED | {"faults.main.contact": RIGID}, id="periodic and rigid", marks=pytest.mark.slow),
])  # fmt: skip
def test_stopped_run_goes_on_to_the_same_bits(
    changes: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sliding = parse_case(impact(6e6, 2.0, changes={
        "order": 2, "duration": 10e-6, "mesh.length": 16e-3, "mesh.height": 6e-3,
        "stepper": {"kind": "generalized_alpha", "courant": 1.0}, "output.checkpoint_steps": 4, **changes,
    }))  # fmt: skip
    simulate(sliding, tmp_path / "whole", progress=False)
    step = GeneralizedAlphaMotion.step

    def stops(motion: Any, state: Any) -> None:
        if state.step == 10:
            raise ConvergenceError("stopped by the test")
        step(motion, state)

    monkeypatch.setattr(GeneralizedAlphaMotion, "step", stops)
    with pytest.raises(ConvergenceError):
        simulate(sliding, tmp_path / "stopped", progress=False)
    with Record(tmp_path / "stopped") as left:  # what there was is kept
        assert left.interface.sizes["time"] == 11
    monkeypatch.setattr(GeneralizedAlphaMotion, "step", step)
    with simulate(sliding, tmp_path / "stopped", progress=False, resume=True) as record:
        assert float(record.interface.slip.max()) > 1e-7
    assert max(largest_difference(tmp_path / "whole", tmp_path / "stopped").values()) == 0


def test_steps_are_halved_and_grow_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solver that fails for steps longer than a third of the given one, for a while."""
    driven = case({
        "order": 2, "boundaries": [{"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1.0}],
        "stepper": {"kind": "generalized_alpha", "time_step": 1e-6},
    })  # fmt: skip
    model = Model(driven)
    motion, state = driven.stepper.bind(model), model.initial_state()
    solve = Equilibrium.solve

    def fails(equilibrium: Any, state: Any, dt: float, *rest: Any, **given: Any) -> Any:
        if dt > 0.3e-6 and state.time < 0.6e-6:
            raise ConvergenceError("too long")
        return solve(equilibrium, state, dt, *rest, **given)

    monkeypatch.setattr(Equilibrium, "solve", fails)
    sizes = []
    for _ in range(6):
        before = state.time
        motion.step(state)
        sizes.append(state.time - before)
    # Quarters until 0.6 us have passed, then twice as long each time, up to what was asked for.
    np.testing.assert_allclose(sizes, [0.25e-6, 0.25e-6, 0.25e-6, 0.5e-6, 1e-6, 1e-6], rtol=1e-9)
    # Driven edges went as far as they should: 1 m/s.
    dofs = model.loads.motions[0].dofs
    np.testing.assert_allclose(state.displacement[dofs], state.time, rtol=1e-12)

    monkeypatch.setattr(Equilibrium, "solve", lambda *_, **__: (_ for _ in ()).throw(ConvergenceError("never")))
    with pytest.raises(RuptfxError, match=facts(r"never; the step was halved 10 times: reduce stepper\.time_step")):
        motion.step(state)
