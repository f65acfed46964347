"""Steps whose iteration at the interfaces fails are solved with the whole bodies."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, HOMALITE, case

pytest.importorskip("dolfinx")

from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.condensed import Condensed
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.implicit.solvers import NewtonSolver

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
RADIUS, HALF_WIDTH = 1.0, 1e-3
HEIGHT = 8 * HALF_WIDTH
FAILS = "no equilibrium at the interfaces alone at 1 s"


def pressed(elements: int) -> Model:
    """A cylinder on a half-plane that touch in one point, pressed together in one step of a second."""
    down = 0.25 * HALF_WIDTH**2 / RADIUS * (np.log(8 * HEIGHT / HALF_WIDTH) + 1)
    motions = {"lower.bottom": (0.0, 0.0), "upper.top": (0.0, -down)}
    return Model(case({
        "plane": "strain", "order": 2, "duration": 1.0, "stepper": {"kind": "quasi_static"},
        "mesh": {"kind": "two_plates", "length": 2 * HEIGHT, "height": HEIGHT, "element_size": HALF_WIDTH / elements,
                 "growth": 1.35},
        "faults.main": {
            "contact": {"kind": "augmented_lagrangian"}, "friction": {"kind": "coulomb", "mu_d": 0.3},
            "initial_stress": {"normal": 0.0}, "gap": {"kind": "parabola", "radius": RADIUS, "center": HEIGHT},
        },
        "boundaries": [{"kind": "driven", "edge": edge, "component": component, "velocity": velocity}
                       for edge, velocities in motions.items()
                       for component, velocity in zip("xy", velocities, strict=True)],
    }))  # fmt: skip


def test_hertz_contact_from_one_point(caplog: pytest.LogCaptureFixture) -> None:
    """Largest pressure of the load that acts, p_0 = sqrt(P E* / (pi R)), within 1 %; the same with the whole bodies."""
    found = []
    for condensed in (True, False):
        model = pressed(4)
        caplog.clear()
        with caplog.at_level(logging.INFO, logger="ruptfx.run"):
            state = model.initial_state()
            Equilibrium(model, condensed=condensed).solve(state, 1.0).commit(state)
        assert (FAILS in caplog.text) == condensed
        face, stress = model.faults[0].interface, state.faults["main"]["normal_stress"]
        load = parallel.total(COMM, float(np.sum(face.owned * face.weight * stress)))
        found.append((float(load), parallel.largest(COMM, stress.max(initial=0.0))))
    stiffness = HOMALITE["young_modulus"] / (2 * (1 - HOMALITE["poisson_ratio"] ** 2))
    (load, highest), whole = found
    assert highest == pytest.approx(np.sqrt(load * stiffness / (np.pi * RADIUS)), rel=1e-2)
    assert (load, highest) == pytest.approx(whole, rel=1e-8)


@pytest.mark.parametrize("gap", [True, False], ids=["open", "closed"])
def test_only_interfaces_that_open_fall_back(gap: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A closed interface without equilibrium has none with the whole bodies: no time is spent on looking for it."""
    asked: list[Any] = []
    monkeypatch.setattr(Condensed, "solve", lambda *_: False)
    solve = NewtonSolver.solve
    monkeypatch.setattr(NewtonSolver, "solve", lambda *given: asked.append(given) or solve(*given))
    contact = {"faults.main.gap": 1e-6, "faults.main.initial_stress": {"normal": 0.0}} if gap else {}
    model = Model(case({
        "order": 1, "faults.main.contact": COMPLIANT, **contact, "stepper": {"kind": "quasi_static"}, "boundaries": [
            {"kind": "driven", "edge": edge, "component": component, "velocity": 0.0}
            for edge in ("lower.bottom", "upper.top") for component in "xy"],
    }))  # fmt: skip
    equilibrium, state = Equilibrium(model), model.initial_state()
    if gap:
        equilibrium.solve(state, 1e-6).commit(state)
    else:
        with pytest.raises(ConvergenceError):
            equilibrium.solve(state, 1e-6)
    assert bool(asked) == gap
