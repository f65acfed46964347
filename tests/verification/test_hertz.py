"""Two half-planes with a parabolic gap: Hertz line contact, then Cattaneo-Mindlin partial slip."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, OPERATOR

pytest.importorskip("dolfinx")

from ruptfx.bodies.state import State
from ruptfx.case import parse_case
from ruptfx.run.model import Model
from ruptfx.stepping.implicit.equilibrium import Equilibrium

pytestmark = [pytest.mark.fem, pytest.mark.slow]

RADIUS, HALF_WIDTH, MU = 1.0, 1e-3, 0.3
STIFFNESS = HOMALITE["young_modulus"] / (2 * (1 - HOMALITE["poisson_ratio"] ** 2))  # E* of equal bodies
HEIGHT = 8 * HALF_WIDTH


def moved(velocity: list[float], before: State | None = None, steps: int = 1) -> tuple[Model, State]:
    """Equilibrium after moving the upper end, which does not turn, for a second; from the state before."""
    edges = [("lower.bottom", [0.0, 0.0]), ("upper.top", velocity)]
    model = Model(parse_case({
        "plane": "strain", "order": 4, "duration": 1.0, "operator": OPERATOR, "stepper": {"kind": "quasi_static"},
        "mesh": {"kind": "two_plates", "length": 2 * HEIGHT, "height": HEIGHT, "element_size": HALF_WIDTH / 8,
                 "growth": 1.35},
        "materials": {"default": HOMALITE},
        "faults": {"main": {
            "contact": {"kind": "augmented_lagrangian"}, "friction": {"kind": "coulomb", "mu_d": MU},
            "initial_stress": {"normal": 0.0}, "gap": {"kind": "parabola", "radius": RADIUS, "center": HEIGHT},
        }},
        "boundaries": [
            {"kind": "driven", "edge": edge, "component": component, "velocity": value}
            for edge, values in edges for component, value in zip("xy", values, strict=True)
        ],
    }))  # fmt: skip
    # Solved as a whole: from one point of contact the iteration on the interface goes back and forth.
    equilibrium, state = Equilibrium(model, condensed=False), model.initial_state()
    if before is not None:
        state.displacement[:] = before.displacement
        for name, values in before.faults["main"].items():
            state.faults["main"][name][:] = values
    for _ in range(steps):
        equilibrium.solve(state, 1.0 / steps).commit(state)
    return model, state


def test_hertz_and_cattaneo_mindlin() -> None:
    """Pressure and shear traction within 2 % of closed form, in the mean over the contact, for the forces that act.

    p = p_0 sqrt(1 - x^2 / a^2), a^2 = 4 P R / (pi E*), p_0 = 2 P / (pi a); then q = mu p - mu p_0 (c / a)
    sqrt(1 - x^2 / c^2) with c = a sqrt(1 - Q / (mu P)) (Johnson 1985, sections 4.2 and 7.2; equal bodies, so that
    shear does not change pressure). The plates are 16 half-widths wide and high together, the spacing of nodes a / 32.
    """
    down = 0.25 * HALF_WIDTH**2 / RADIUS * (np.log(8 * HEIGHT / HALF_WIDTH) + 1)
    model, pressed = moved([0.0, -down])
    face = model.faults[0].interface
    x, weight = face.position - HEIGHT, face.weight

    def closed_form(fields: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, float]:
        P, Q = weight @ fields["normal_stress"], weight @ fields["shear_traction"]
        a = np.sqrt(4 * P * RADIUS / (np.pi * STIFFNESS))
        c, p_0 = a * np.sqrt(1 - Q / (MU * P)), 2 * P / (np.pi * a)
        pressure = p_0 * np.sqrt(np.maximum(1 - (x / a) ** 2, 0))
        inner = p_0 * c / a * np.sqrt(np.maximum(1 - (x / c) ** 2, 0))
        return pressure, MU * (pressure - inner), c

    def off(ours: np.ndarray, theirs: np.ndarray, size: np.ndarray) -> float:
        return float(np.sqrt(weight @ (ours - theirs) ** 2 / (weight @ size**2)))

    fields = pressed.faults["main"]
    pressure, _, _ = closed_form(fields)
    assert off(fields["normal_stress"], pressure, pressure) < 0.02
    assert fields["normal_stress"].max() == pytest.approx(pressure.max(), rel=0.02)
    # Nothing slips while it is pressed, and the edge of contact is right to a spacing of nodes.
    assert np.abs(fields["shear_traction"]).max() < 1e-3 * MU * pressure.max()
    touching = np.abs(x[fields["normal_stress"] > 0]).max()
    assert touching == pytest.approx(np.abs(x[pressure > 0]).max(), abs=HALF_WIDTH / 16)

    _, sheared = moved([0.3 * down, 0.0], pressed, steps=3)
    fields = sheared.faults["main"]
    pressure, shear, c = closed_form(fields)
    assert 0.3 * HALF_WIDTH < c < 0.8 * HALF_WIDTH
    assert off(fields["normal_stress"], pressure, pressure) < 0.02
    assert off(fields["shear_traction"], shear, MU * pressure) < 0.02
    stuck = np.abs(x[(fields["slip"] == 0) & (fields["normal_stress"] > 0)]).max()
    assert stuck == pytest.approx(c, abs=0.05 * HALF_WIDTH)
