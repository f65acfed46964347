"""A job of `test_failing_ranks.py`: steps in which one rank fails, in every phase; writes what all raise."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from helpers.crack_cases import case as broken
from helpers.small_cases import case

import ruptfx.stepping.steppers.leapfrog as leapfrog
from ruptfx import RuptfxError
from ruptfx.interfaces.mechanisms import Mechanism, mechanisms_of
from ruptfx.platform import parallel
from ruptfx.platform.fem import MPI
from ruptfx.run.model import Model

RANK, STEP, STEPS = 1, 3, 12
PHASES = ("add_first", "add_with_elements", "add_internal", "add_external", "combine", "before_kick", "after_kick",
          "account")  # fmt: skip
CASES = {
    "faults": case, "intrinsic": broken,
    "extrinsic": lambda: broken({"fracture.kind": "extrinsic", "damping": {"kelvin_voigt": {"fraction": 0.1}}}),
}  # fmt: skip


def failing(phase: str, model: Model) -> Mechanism:
    """A mechanism that fails on one rank in one phase of one step, before all others."""

    def act(self: Mechanism, state: object, kick: object) -> None:
        if model.comm.rank == RANK and state.step == STEP:
            raise RuptfxError(f"failed in {phase}")

    return type("Failing", (Mechanism,), {"order": -1, phase: act})(model)


lines = []
for name, made in CASES.items():
    for phase in PHASES:
        leapfrog.mechanisms_of = lambda model, phase=phase: [failing(phase, model), *mechanisms_of(model)]
        given = made()
        model = Model(given)
        motion, state = given.stepper.bind(model), model.initial_state()
        errors = []
        for _ in range(STEPS):
            try:
                motion.step(state)
            except RuptfxError as error:
                errors.append(error)
        said = ""
        try:
            parallel.raise_on_all(MPI.COMM_WORLD, errors[0] if errors else None)
        except RuptfxError as error:
            said = str(error)
        lines.append(f"{name}: {said}: {len(errors)} here")
Path(sys.argv[1], f"rank_{MPI.COMM_WORLD.rank}.txt").write_text("\n".join(lines), encoding="utf-8")
