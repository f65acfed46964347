"""What records cost and hold on any number of ranks."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("dolfinx")

from small_cases import impact, slip_weakening

from ruptfx import parallel
from ruptfx.case import parse_case
from ruptfx.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

DAMPED = {"damping": {"mass": 1e4, "kelvin_voigt": {"fraction": 0.1}}}
SUPPORTED = {"boundaries": [{"kind": "spring", "edge": "lower.bottom", "normal": 1e13, "tangential": 1e12}]}


@pytest.mark.parametrize("operator", ["matrix_free", "ufl_form"])
@pytest.mark.parametrize("table", [
    slip_weakening(DAMPED), slip_weakening(SUPPORTED), impact(6e6, 2.0),
], ids=["damped", "supported", "driven"])  # fmt: skip
def test_watched_steps_sum_their_energies(table: dict[str, Any], operator: str, monkeypatch: Any) -> None:
    """They are those of a force evaluation of the whole model, which they do without."""
    given = parse_case({**table, "operator": operator})
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    found = []
    for number in range(40):
        state.watched = number % 3 != 1
        motion.step(state)
        if state.watched:
            expected = model.energies(state)
            with monkeypatch.context() as without:
                without.setattr(model, "internal_force", None)
                energies = motion.energies(state)
            # Sums of some thousand numbers in another order.
            assert energies == pytest.approx(expected, rel=1e-12, abs=1e-13 * max(map(abs, expected.values())))
            found.append(energies["kinetic"])
    assert parallel.total(model.comm, min(found)) > 0
    state.watched = False
    motion.step(state)
    assert motion.energies(state) == model.energies(state)  # of this step, not of the last one watched
