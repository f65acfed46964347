"""Rough faults in three dimensions: their surface, positions, tractions from a tensor, the flat limit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from helpers.small_cases import strike_slip

from ruptfx.bodies.meshes.box_with_fault import BoxWithFault
from ruptfx.bodies.state import State
from ruptfx.case import parse_case
from ruptfx.input.profiles.self_affine_surface import SelfAffineSurface
from ruptfx.input.schema import CaseError
from ruptfx.run.model import Model

ROUGH = {
    "kind": "self_affine_surface", "rms": 1e-4, "hurst": 0.7, "length": 16e-3, "longest": 8e-3, "shortest": 3e-3,
    "seed": 2,
}  # fmt: skip


def surface(**changes: Any) -> SelfAffineSurface:
    given = {key: value for key, value in ROUGH.items() if key != "kind"}
    return SelfAffineSurface.model_validate(given | changes)


def test_height_and_spectrum_of_the_surface() -> None:
    """On a grid over a period: the RMS, a plateau, amplitudes that fall as q^-(1 + H), nothing beyond both ends."""
    size = 64
    height = surface(length=1.0, longest=0.5, rolloff=0.2, shortest=0.05, rms=3.0, mean=7.0)
    x, d = np.meshgrid(np.arange(size) / size, np.arange(size) / size)
    found = height(np.stack([x.ravel(), d.ravel()], axis=1))
    assert found.mean() == pytest.approx(7.0, abs=1e-12)
    assert np.sqrt(np.mean((found - 7.0) ** 2)) == pytest.approx(3.0, rel=1e-12)
    amplitude = np.abs(np.fft.fft2((found - 7.0).reshape(size, size))) / size**2
    number = np.fft.fftfreq(size, 1 / size)
    q = np.hypot(number[:, None], number[None])
    inside = (q >= 2 - 1e-9) & (q <= 20 + 1e-9)
    assert amplitude[~inside].max() < 1e-14
    plateau, falling = inside & (q <= 5), inside & (q >= 5)
    assert amplitude[plateau] == pytest.approx(amplitude[plateau][0], rel=1e-9)
    assert amplitude[falling] == pytest.approx(amplitude[plateau][0] * (q[falling] / 5) ** -1.7, rel=1e-9)


def test_vertices_of_the_fault_are_on_the_surface() -> None:
    """The box keeps its sides and its top, and every element is the right way round."""
    mesh = strike_slip()["mesh"] | {"dip": 70.0, "height": ROUGH}
    flat, rough = (BoxWithFault.model_validate({key: value for key, value in given.items() if key != "kind"}).build()
                   for given in (mesh | {"height": 0.0}, mesh))  # fmt: skip
    shift = rough.points - flat.points
    assert np.array_equal(shift[:, [0, 2]], np.zeros((len(shift), 2)))
    fault = np.unique(np.concatenate(rough.interfaces["main"]))
    where = np.stack([flat.points[fault, 0], -flat.points[fault, 2] / np.sin(np.deg2rad(70))], axis=1)
    assert shift[fault, 1] == pytest.approx(surface()(where), abs=1e-12)
    for name in ("left", "right", "bottom", "far"):
        assert np.abs(shift[rough.edges[f"plus.{name}"], 1]).max() < 1e-16
    corners = rough.points[rough.cells]
    edges = corners[:, [1, 2, 4]] - corners[:, :1]
    assert np.linalg.det(edges).min() > 0


def steps(height: Any, number: int = 40) -> tuple[Model, State]:
    case = parse_case(strike_slip({"mesh.height": height}))
    model = Model(case)
    state, motion = model.initial_state(), case.stepper.bind(model)
    for _ in range(number):
        motion.step(state)
    return model, state


def test_without_amplitude_a_rough_fault_is_the_plane_one() -> None:
    (model_1, flat), (model_2, rough) = steps(0.0), steps(ROUGH | {"rms": 0.0})
    face_1, face_2 = model_1.faults[0].interface, model_2.faults[0].interface
    assert np.array_equal(face_1.locations, face_2.locations)
    slip = flat.faults["main"]["slip_1"]
    assert slip.max() > 1e-7
    assert rough.faults["main"]["slip_1"] == pytest.approx(slip, abs=1e-10 * slip.max())
    size = np.abs(flat.displacement).max()
    assert rough.displacement == pytest.approx(flat.displacement, abs=1e-10 * size)


def test_positions_of_a_rough_fault_are_those_in_its_plane() -> None:
    face = Model(parse_case(strike_slip({"mesh.height": ROUGH}))).faults[0].interface
    assert np.ptp(face.points[:, 1]) > 2e-4
    assert face.line.measure == "x"
    assert np.array_equal(face.position, face.points[:, 0])
    assert face.across == pytest.approx(-face.points[:, 2], abs=1e-15)


def test_tractions_of_a_tensor_on_an_oblique_fault() -> None:
    """A height that grows linearly along strike turns the fault: closed form of a plane with another strike."""
    slope = 0.1
    tilted = {"kind": "table", "positions": [-6e-3, 6e-3], "values": [-6e-3 * slope, 6e-3 * slope]}
    table = strike_slip({"mesh.height": tilted, "mesh.distance": 6e-3})
    del table["faults"]["main"]["initial_stress"]
    table["initial_stress"] = {"kind": "depth", "density": 2500.0, "along": 0.8, "across": 0.6, "shear": 0.3}
    fault = Model(parse_case(table)).faults[0]
    points = fault.interface.points
    inside = np.abs(points[:, 0]) < 4.9e-3
    P = 2500 * 9.81 * -points[inside, 2]
    angle = np.arctan(slope)
    sine, cosine = np.sin(angle), np.cos(angle)
    expected = P * (0.6 * cosine**2 + 0.8 * sine**2 + 0.6 * sine * cosine)
    assert fault.normal_stress_0[inside] == pytest.approx(expected, rel=1e-9)
    shear = P * (0.3 * (cosine**2 - sine**2) + (0.8 - 0.6) * sine * cosine)
    assert fault.shear_traction_0[inside, 0] == pytest.approx(shear, rel=1e-9)
    assert np.abs(fault.shear_traction_0[inside, 1]).max() < 1e-9 * P.max()


def test_energy_of_a_rupture_on_a_rough_fault_is_accounted_for() -> None:
    model, state = steps(ROUGH, 60)
    state.wants_energies = True
    motion = model.case.stepper.bind(model)
    motion.step(state)
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    scale = max(abs(value) for value in energy.values())
    assert abs(sum(energy.values()) - work) < 1e-9 * scale


def test_a_fault_too_rough_for_its_box_is_refused() -> None:
    with pytest.raises(CaseError, match=facts(r"mesh\.height: .* 0\.3 of distance = 0\.003 m")):
        Model(parse_case(strike_slip({"mesh.height": ROUGH | {"rms": 1e-3}})))
    short = {"kind": "surface_table", "strike": [-1e-3, 1e-3], "dip": [0.0, 8e-3], "values": [[0.0, 0.0], [0.0, 0.0]]}
    with pytest.raises(CaseError, match=facts(r"mesh\.height: the table has strike from -0\.001 to 0\.001 m")):
        Model(parse_case(strike_slip({"mesh.height": short})))
    with pytest.raises(CaseError, match="shortest"):
        parse_case(strike_slip({"mesh.height": ROUGH | {"shortest": 1e-6}}))
