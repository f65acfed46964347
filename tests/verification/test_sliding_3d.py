"""Solids that slide on each other: momenta, energies, direction and moment of friction, and the plane extruded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from helpers.sliding_cases import solids
from helpers.small_cases import Given, advance, march

pytest.importorskip("dolfinx")

from ruptfx import RuptfxError
from ruptfx.case import parse_case
from ruptfx.interfaces.sliding.interface import turned_frame
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

EXACT = {"kind": "forward_lagrange", "tolerance": 1e-13, "sweeps": 300}
COMPLIANT = {"kind": "compliant", "C_n": 3e12, "C_s": 1e12}


@pytest.mark.parametrize("contact", [EXACT, COMPLIANT], ids=["forward_lagrange", "compliant"])
def test_bodies_that_collide_keep_momenta_and_energy(contact: dict[str, Any]) -> None:
    """Without updates of the pairing, to round-off; moments are about the places where nodes were."""
    case = parse_case(solids({
        "boundaries": [], "duration": 1.5e-6, "faults.main.sliding.update_slip": 1e3, "faults.main.contact": contact,
    }))  # fmt: skip
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    upper = model.layout.body == model.bodies.names.index("upper")
    velocity, mass = state.velocity.reshape(-1, 3), model.mass.reshape(-1, 3)
    velocity[upper] = np.array([8.0, 5.0, -4.0]) + np.cross([0.0, 0.0, 3e3], model.coordinates[upper])
    begun = 0.5 * float(np.sum(mass * velocity**2))

    def momenta() -> np.ndarray:
        moving = mass * velocity
        return np.concatenate([moving.sum(axis=0), np.cross(model.coordinates, moving).sum(axis=0)])

    before = momenta()
    advance(motion, state, case.duration)
    size = np.abs(mass * velocity).sum()
    np.testing.assert_allclose(momenta(), before, atol=1e-11 * size * np.repeat([1.0, 1e-3], 3).max())
    np.testing.assert_allclose(momenta()[3:], before[3:], atol=1e-11 * size * 1e-3)
    fault, energies = state.faults["main"], motion.energies(state)
    assert fault["normal_stress"].max() > 1e6
    assert np.abs(fault["slip_1"]).max() > 1e-6 and np.abs(fault["slip_2"]).max() > 1e-6
    assert energies["frictional_dissipation"] > 1e-3 * begun
    work = energies.pop("boundary_work")
    gone = sum(energies.values()) - work
    assert abs(gone - (begun if work < 0.5 * begun else 0.0)) < 1e-10 * begun


@pytest.mark.parametrize("angle", np.arange(8) * np.pi / 4)
def test_friction_opposes_slip_in_any_direction(angle: float) -> None:
    """A block that moves over a plane under 10 kPa: mu N against its motion, within 0.5 %."""
    way = np.array([np.cos(angle), np.sin(angle), 0.0])
    state, face = _moved(way * 2.0)
    fault = state.faults["main"]
    local = np.stack([-fault["normal_stress"], fault["shear_traction_1"], fault["shear_traction_2"]], axis=1)
    force = np.einsum("i,ik,ikc->c", face.weight, local, face.frame)  # of the upper body on the lower one
    np.testing.assert_allclose(force[:2] / -force[2], 0.3 * way[:2], atol=0.005 * 0.3)
    slip = np.stack([fault["slip_1"], fault["slip_2"]], axis=1) @ face.frame[0, 1:, :2]
    assert np.all(slip @ way[:2] > 0.99 * np.linalg.norm(slip, axis=1)) and (slip @ way[:2]).min() > 0


def test_moment_of_friction_of_a_spinning_block() -> None:
    """A square of side a under the pressure p: mu p a^3 (sqrt 2 + asinh 1) / 6 about its middle, within 1 %."""
    state, face = _moved(np.array([0.0, 0.0, 4e3]), spins=True)
    fault = state.faults["main"]
    shear = np.stack([fault["shear_traction_1"], fault["shear_traction_2"]], axis=1)
    force = face.weight[:, None] * np.einsum("ik,ikc->ic", shear, face.frame[:, 1:])
    moment = np.cross(face.points - np.array([1e-3, 1e-3, 0.0]), force).sum(axis=0)
    exact = 0.3 * 1e4 * 2e-3**3 * (np.sqrt(2) + np.arcsinh(1)) / 6
    np.testing.assert_allclose(moment, [0.0, 0.0, exact], atol=0.01 * exact)


def _moved(motion: np.ndarray, spins: bool = False) -> tuple[Any, Any]:
    """Return the state after some steps of a block of 2 x 2 mm that moves or spins about its middle, and its face."""
    case = parse_case(solids({
        "boundaries": [], "order": 3, "faults.main.initial_stress.normal": 1e4,
        "mesh.upper": {"length": 2e-3, "width": 2e-3, "height": 0.5e-3, "element_size": 0.5e-3},
    }))  # fmt: skip
    model = Model(case)
    bound, state = case.stepper.bind(model), model.initial_state()
    upper = model.layout.body == model.bodies.names.index("upper")
    velocity = state.velocity.reshape(-1, 3)
    arms = model.coordinates[upper] - np.array([1e-3, 1e-3, 0.0])
    velocity[upper] = np.cross(motion, arms) if spins else motion
    for _ in range(4):
        bound.step(state)
    return state, model.faults[0].interface


@pytest.mark.parametrize(
    "along, law, order, update",
    [
        ("x", "slip weakening", 2, 1e3), ("y", "rate and state", 2, 1e3), ("x", "slip weakening", 1, 0.01),
        ("turned", "slip weakening", 1, 0.01), ("x", "slip weakening", 2, 0.01), ("y", "rate and state", 3, 0.01),
    ],
)  # fmt: skip
def test_extruded_plane_is_the_plane(along: str, law: str, order: int, update: float) -> None:
    """Flat bodies of different elements, pressed and dragged along either tangent: plane strain, to 1e-9; also with the
    bodies turned about x, so that y is up and z is the direction of extrusion.

    Updates of the pairing see bent surfaces of order 1 to 3.
    """
    friction = {
        "slip weakening": {"kind": "linear_slip_weakening", "mu_s": 0.5, "mu_d": 0.2, "D_c": 2e-6},
        "rate and state": {"kind": "rate_and_state_ageing", "a": 0.02, "b": 0.03, "D_c": 1e-6, "f_0": 0.4,
                           "V_0": 1e-2, "V_initial": 1e-3},
    }[law]  # fmt: skip
    common = {
        "duration": 1.5e-6,
        "stepper": {"kind": "leapfrog", "time_step": 2e-8},
        "faults.main.sliding.update_slip": update,
        "order": order,
        "faults.main.friction": friction,
        "faults.main.contact": EXACT,
    }
    upper = {"length": 1.5e-3, "left": 0.2e-3, "height": 0.5e-3, "element_size": 0.5e-3}
    lower = {"length": 2.1e-3, "height": 0.4e-3, "element_size": 0.3e-3}

    def edges(way: str, up: str, fixed: str) -> list[dict[str, object]]:
        press = {"x": 0.0, "y": 0.0, "z": 0.0, up: -20e6}
        drives = [("lower.bottom", way, 0.0), ("lower.bottom", up, 0.0), ("upper.top", way, 25.0)]
        sides = {"y": ("front", "back"), "z": ("front", "back"), "x": ("left", "right")}.get(fixed, ())
        drives += [(f"{body}.{side}", fixed, 0.0) for body in ("upper", "lower") for side in sides]
        return [
            {"kind": "traction", "edge": "upper.top", "traction": list(press.values())[: 3 if fixed else 2],
             "ramp": 0.5e-6},
            *({"kind": "driven", "edge": edge, "component": c, "velocity": v} for edge, c, v in drives),
        ]  # fmt: skip

    plane = parse_case(solids({
        **common, "plane": "strain", "mesh.upper": upper, "mesh.lower": lower, "boundaries": edges("x", "y", ""),
    }))  # fmt: skip
    names = ("width", "front", "length", "left") if along == "y" else ("length", "left", "width", "front")

    def extruded(plate: dict[str, float]) -> dict[str, float]:
        length, left, width, front = names
        other = {"height": plate["height"], "element_size": plate["element_size"], width: 1.5e-3, front: 0.0}
        return {**other, length: plate["length"], left: plate.get("left", 0.0)}

    solid = parse_case(solids({
        **common, "mesh.upper": extruded(upper), "mesh.lower": extruded(lower), "boundaries": edges(
            "y" if along == "y" else "x", "y" if along == "turned" else "z", {"x": "y", "y": "x", "turned": "z"}[along]
        ),
    }))  # fmt: skip
    if along == "turned":
        raw, turn = solid.mesh.build(), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        raw.points[:] = raw.points @ turn
        raw.reference_normals = {name: normal @ turn for name, normal in raw.reference_normals.items()}
        solid = solid.substituted({"mesh": Given(raw)})
    flat, _, expected = march(plane)
    full, _, state = march(solid)
    face, axis = full.faults[0].interface, int(along == "y")
    line = np.searchsorted(flat.faults[0].interface.points[:, 0], face.points[:, axis] - 1e-9)
    fields, exact = state.faults["main"], expected.faults["main"]
    slips = face.frame[0, 1:, axis]  # one of the tangents is along the slip
    number = int(np.argmax(np.abs(slips)))
    for name in ("normal_stress", "slip", "shear_traction", "slip_rate"):
        scale = np.abs(exact[name]).max()
        value = fields[name] if name == "normal_stress" else fields[f"{name}_{1 + number}"] * np.sign(slips[number])
        np.testing.assert_allclose(value, exact[name][line], rtol=0.0, atol=1e-9 * scale)
    assert np.abs(exact["slip"]).max() > 1e-6
    assert (face.geometry.revision > 2) == (update < 1)


def test_a_surface_that_folds_in_a_run_is_an_error() -> None:
    """A node in the middle of a facet moves beyond its neighbours: key, place and remedy."""
    case = parse_case(solids({"boundaries": []}))
    model = Model(case)
    bound, state, face = case.stepper.bind(model), model.initial_state(), model.faults[0].interface
    node = int(np.argmin(np.linalg.norm(face.points - [0.75e-3, 0.25e-3, 0.0], axis=1)))  # with 0.25 mm to the others
    state.displacement.reshape(-1, 3)[face.plus[node], 0] += 0.3e-3
    with pytest.raises(RuptfxError, match=facts(r"faults\.main: the surface at \(0\.00078\d*, 0\.00025, .* smaller")):
        bound.step(state)


def test_frames_follow_from_the_displacement_alone() -> None:
    """Tangents are rotated with the normal of the minus side, orthonormal; along a wave the other one stays."""
    wavy = {"kind": "sinusoid", "amplitude": 5e-5, "wavelength": 2e-3}
    model = Model(parse_case(solids({"boundaries": [], "mesh.curve_order": 2, "mesh.lower.profile": wavy})))
    face = model.faults[0].interface
    np.testing.assert_allclose(
        np.einsum("ikc,ilc->ikl", face.frame, face.frame), np.tile(np.eye(3), (face.total, 1, 1)), atol=1e-12
    )
    assert np.abs(face.frame[:, 0, 0]).max() > 0.1 and np.abs(face.frame[:, 1, 1]).max() < 1e-9
    np.testing.assert_allclose(face.frame, turned_frame(face.frame[:, 0], np.array([0.0, 0.0, 1.0])), atol=1e-12)


@pytest.mark.parametrize("contact", [COMPLIANT, {"kind": "augmented_lagrangian"}], ids=["compliant", "rigid"])
@pytest.mark.parametrize("kind", ["quasi_static", "generalized_alpha"])
def test_implicit_steps_slide_along_both_tangents(kind: str, contact: dict[str, Any]) -> None:
    """Dragged at 8 and 6 m/s: sliding points have mu times the pressure along their slip rate, the mean near 4 : 3."""
    moves = [("lower.bottom", axis, 0.0) for axis in "xyz"]
    moves += [("upper.top", axis, value) for axis, value in zip("xyz", (8.0, 6.0, -2.0), strict=True)]
    case = parse_case(solids({
        "order": 1, "duration": 2e-6, "faults.main.contact": contact,
        "stepper": {"kind": kind} | ({"time_step": 1e-7} if kind == "generalized_alpha" else {}),
        "boundaries": [{"kind": "driven", "edge": edge, "component": c, "velocity": v} for edge, c, v in moves],
    }))  # fmt: skip
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    while state.time < case.duration * (1 - 1e-9):
        motion.step(state)
    face, fault = model.faults[0].interface, state.faults["main"]
    shear, rate = (np.stack([fault[f"{name}_{k}"] for k in (1, 2)], axis=1) for name in ("shear_traction", "slip_rate"))
    speed, pressure = np.linalg.norm(rate, axis=1), fault["normal_stress"]
    slides = (pressure > 0) & (speed > 1e-2)
    assert slides.sum() >= 4
    expected = 0.3 * (pressure / np.maximum(speed, 1e-300))[:, None] * rate
    np.testing.assert_allclose(shear[slides], expected[slides], atol=1e-6 * pressure.max())
    force = face.weight @ shear / (face.weight @ pressure)
    assert 0.25 < np.linalg.norm(force) < 0.3 + 1e-9 and 1.1 < force[0] / force[1] < 1.6
    assert face.geometry.revision > 5
    gap = face.jump(state.displacement)[:, 0] + pressure / contact.get("C_n", np.inf)
    assert np.abs(gap[pressure > 0]).max() < 1e-12 and gap.min() > -1e-12
