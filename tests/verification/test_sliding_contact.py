"""Contact between different meshes in explicit steps against closed forms and the laws of motion."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.sliding_cases import STIFF, rough, wave
from helpers.small_cases import advance

pytest.importorskip("dolfinx")

from ruptfx.case import Case, parse_case
from ruptfx.run import stages
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem


@pytest.mark.slow
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


def test_waves_that_fit_slip_before_a_flat_interface() -> None:
    """In phase, under uniform sigma_yy and sigma_xy, friction 1: flanks of slope a slip first, at the tau / sigma with
    (tau cos 2a + sin a cos a) / (cos^2 a - tau sin 2a) = 1, 0.747 for the steepest of 0.105; a flat interface at 1.

    The edges carry what belongs to the uniform stress; the shear grows slowly, damped.
    """
    steepest = np.arctan(2 * np.pi * 10e-6 / 0.6e-3)
    tau = np.linspace(0, 1, 100001)
    mean = (tau * np.cos(2 * steepest) + 0.5 * np.sin(2 * steepest)) / (
        np.cos(steepest) ** 2 - tau * np.sin(2 * steepest)
    )
    expected = float(tau[np.argmax(mean >= 1)])
    assert abs(expected - 0.747) < 1e-3
    press, shear, normal = 4e-6, 16e-6, 10e6
    shape = {"profile": {**wave(1), "mean": 0.0}, "length": 1.8e-3, "left": 0.0, "height": 0.4e-3}

    def edges(ratio: float, ramp: float) -> list[dict[str, object]]:
        across = {"upper.top": (1, -1), "upper.left": (0, -1), "lower.left": (0, -1), "upper.right": (0, 1),
                  "lower.right": (0, 1)}  # fmt: skip
        held = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
        return held + [
            {"kind": "traction", "edge": edge, "ramp": ramp,
             "traction": [shear * ratio * normal, (normal if edge == "upper.top" else ratio * normal) * along]}
            for edge, (shear, along) in across.items()
        ]  # fmt: skip

    case = parse_case(rough({
        "order": 4, "mesh.curve_order": 4, "materials": {"default": {**STIFF, "poisson_ratio": 0.0}},
        "mesh.upper": {**shape, "element_size": 0.1e-3}, "mesh.lower": {**shape, "element_size": 0.075e-3},
        "faults.main.friction.mu_d": 1.0, "duration": press + shear, "boundaries": None,
        "stages": [
            {"duration": press, "damping": {"mass": 3e6}, "boundaries": edges(0.0, 0.5 * press)},
            {"duration": shear, "damping": {"mass": 3e6}, "boundaries": edges(1.0, shear)},
        ],
    }))  # fmt: skip
    assert isinstance(case, Case)
    model = Model(case)
    motion, state, face = stages.bind(model), model.initial_state(), model.faults[0].interface
    middle = np.abs(face.points[:, 0] - 0.9e-3) < 0.45e-3
    advance(motion, state, press)
    before, ratio = state.faults["main"]["slip"].copy(), np.nan
    while state.time < case.duration and np.isnan(ratio):
        motion.step(state)
        fault = state.faults["main"]
        first = middle & (np.abs(fault["slip"] - before) > 1e-9)
        if first.any():
            local = np.column_stack([-fault["normal_stress"], fault["shear_traction"]])
            force = np.einsum("i,ik,ikc->c", face.weight * middle, local, face.frame)
            ratio = abs(force[0] / force[1])
    np.testing.assert_allclose(ratio, expected, rtol=0.03)
    slopes = -2 * np.pi * 10e-6 / 0.6e-3 * -np.sin(2 * np.pi * face.points[first, 0] / 0.6e-3)
    assert np.abs(slopes).min() > 0.9 * np.tan(steepest)


@pytest.mark.parametrize("part, follow, tolerance", [(1.0, 0.05, 1e-3), (0.01, 1e-6, 1e-5)])
def test_free_bodies_that_collide_obliquely(part: float, follow: float, tolerance: float) -> None:
    """Linear momentum is kept to round-off, angular momentum but for the strains and for how far points slide past
    what they are said to face.

    The theory of small strains takes moments about the places where nodes were; strains are 10 / 2260 or a hundredth.
    """
    given = parse_case(rough({
        "boundaries": [], "duration": 6e-6 if part == 1 else 12e-6, "mesh.closest": 3e-7,
        "faults.main.sliding.update_slip": follow,
    }))  # fmt: skip
    assert isinstance(given, Case)
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    velocity = state.velocity.reshape(-1, 2)
    upper = model.layout.body == model.bodies.names.index("upper")
    velocity[upper] = part * np.array([20.0, -10.0])
    mass = model.mass.reshape(-1, 2)

    def momenta() -> tuple[np.ndarray, float]:
        moving, place = mass * velocity, model.coordinates + state.displacement.reshape(-1, 2)
        return moving.sum(axis=0), float(np.sum(place[:, 0] * moving[:, 1] - place[:, 1] * moving[:, 0]))

    linear, angular = momenta()
    pressed: list[float] = []
    advance(motion, state, given.duration, lambda state: pressed.append(state.faults["main"]["normal_stress"].max()))
    after, turned = momenta()
    assert max(pressed) > part * 1e8 and state.faults["main"]["slip"].max() > part * 5e-5
    size = np.abs(mass * velocity).sum()
    np.testing.assert_allclose(after, linear, atol=1e-12 * size)
    np.testing.assert_allclose(turned, angular, atol=tolerance * size * 1e-3)  # arms of 1 mm
