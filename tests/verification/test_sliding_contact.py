"""Contact between different meshes in explicit steps against closed forms and the laws of motion."""

from __future__ import annotations

import numpy as np
import pytest
from sliding_cases import STIFF, rough
from small_cases import advance

pytest.importorskip("dolfinx")

from ruptfx import stages
from ruptfx.case import Case, parse_case
from ruptfx.model import Model

pytestmark = pytest.mark.fem


def test_hertz_between_different_meshes() -> None:
    """A cylinder on a plane, 4 elements on 3, pressed and damped to rest: within 2 % of the closed form for its force.

    p = p_0 sqrt(1 - x^2 / a^2) with a^2 = 4 P R / (pi E*) and p_0 = 2 P / (pi a) (Johnson 1985, section 4.2). The
    plates are 16 half-widths wide and high together.
    """
    radius, half_width = 10e-3, 0.1e-3
    height = 8 * half_width
    down = 0.25 * half_width**2 / radius * (np.log(8 * height / half_width) + 1)
    plate = {"length": 2 * height, "height": height, "growth": 1.35}
    bump = {"kind": "parabola", "radius": radius, "center": height}

    def edges(speed: float) -> list[dict[str, object]]:
        moves = {"lower.bottom": (0.0, 0.0), "upper.top": (0.0, -speed)}
        return [
            {"kind": "driven", "edge": edge, "component": axis, "velocity": value}
            for edge, values in moves.items() for axis, value in zip("xy", values, strict=True)
        ]  # fmt: skip

    case = parse_case({
        "plane": "strain", "order": 4, "duration": 12e-6, "damping": {"mass": 1.5e6},
        "mesh": {
            "kind": "rough_plates", "curve_order": 2,
            "upper": {**plate, "element_size": half_width / 4, "profile": bump},
            "lower": {**plate, "element_size": half_width / 3},
        },
        "materials": {"default": STIFF},
        "faults": {"main": {
            "sliding": {}, "contact": {"kind": "forward_lagrange"}, "friction": {"kind": "coulomb", "mu_d": 0.0},
            "initial_stress": {"normal": 0.0},
        }},
        "stages": [
            {"duration": 2e-6, "boundaries": edges(down / 2e-6)}, {"duration": 10e-6, "boundaries": edges(0.0)},
        ],
    })  # fmt: skip
    assert isinstance(case, Case)
    model = Model(case)
    state = advance(stages.bind(model), model.initial_state(), case.duration)
    face, pressure = model.faults[0].interface, state.faults["main"]["normal_stress"]
    force = face.weight @ pressure
    stiffness = STIFF["young_modulus"] / (2 * (1 - STIFF["poisson_ratio"] ** 2))
    a = np.sqrt(4 * force * radius / (np.pi * stiffness))
    exact = 2 * force / (np.pi * a) * np.sqrt(np.maximum(1 - ((face.position - height) / a) ** 2, 0))
    assert 0.8 * half_width < a < 1.2 * half_width
    assert np.sqrt(face.weight @ (pressure - exact) ** 2 / (face.weight @ exact**2)) < 0.02
    np.testing.assert_allclose(pressure.max(), exact.max(), rtol=0.02)
    touching = np.abs(face.position - height)[pressure > 0].max()
    np.testing.assert_allclose(touching, a, atol=half_width / 8)  # the widest spacing of nodes


def test_free_bodies_that_collide_obliquely() -> None:
    """Linear momentum is kept to round-off, angular momentum but for the strains, 10 / 2260.

    The theory of small strains takes moments about the places where nodes were.
    """
    given = parse_case(rough({"boundaries": [], "duration": 6e-6}))
    assert isinstance(given, Case)
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    velocity = state.velocity.reshape(-1, 2)
    upper = model.layout.body == model.bodies.names.index("upper")
    velocity[upper] = [20.0, -10.0]
    mass = model.mass.reshape(-1, 2)

    def momenta() -> tuple[np.ndarray, float]:
        moving, place = mass * velocity, model.coordinates + state.displacement.reshape(-1, 2)
        return moving.sum(axis=0), float(np.sum(place[:, 0] * moving[:, 1] - place[:, 1] * moving[:, 0]))

    linear, angular = momenta()
    pressed: list[float] = []
    advance(motion, state, given.duration, lambda state: pressed.append(state.faults["main"]["normal_stress"].max()))
    after, turned = momenta()
    assert max(pressed) > 1e7 and state.faults["main"]["slip"].max() > 5e-5
    size = np.abs(mass * velocity).sum()
    np.testing.assert_allclose(after, linear, atol=1e-12 * size)
    np.testing.assert_allclose(turned, angular, atol=1e-3 * size * 1e-3)  # arms of 1 mm
