"""Absorbing edges and radiation damping of anisotropic bodies, which only their energy knows to be so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, SPLIT, blocks, guided, merged, plates, tilted

pytest.importorskip("dolfinx")

import ufl
from helpers.messages import facts

from ruptfx import simulate
from ruptfx.bodies.space.edges import Edge
from ruptfx.case import parse_case, read_case
from ruptfx.input.schema import CaseError
from ruptfx.laws.materials import Material, Plane, WaveSpeeds
from ruptfx.results import plots
from ruptfx.run.model import Model
from ruptfx.stepping.steppers._radiation import radiation_impedance

pytestmark = pytest.mark.fem

DENSITY = 1200.0
# C_xxxx, C_yyyy, C_xxyy, C_xyxy: P waves along y are twice as fast as along x.
STIFFNESS = np.array([4e9, 16e9, 2e9, 1e9])


class Orthotropic(Material):
    """Orthotropic in the plane, its axes turned by `angle`."""

    angle: float = 0.0

    def energy_density(self, strain: Any, plane: Plane) -> Any:
        c, s = np.cos(self.angle), np.sin(self.angle)
        turn = ufl.as_matrix([[c, s], [-s, c]])
        e = turn * strain * turn.T
        c11, c22, c12, c66 = STIFFNESS
        return 0.5 * (c11 * e[0, 0] ** 2 + c22 * e[1, 1] ** 2) + c12 * e[0, 0] * e[1, 1] + 2 * c66 * e[0, 1] ** 2

    def wave_speeds(self, plane: Plane) -> WaveSpeeds:
        """Along the first axis, as if it were isotropic."""
        c_p, c_s = np.sqrt(STIFFNESS[[0, 3]] / DENSITY)
        return WaveSpeeds(c_p, c_s, 0.9 * c_s)


def model(changes: dict[str, Any], angle: float = 0.0) -> Model:
    table = plates({"plane": "strain", "faults.main.contact": SPLIT})
    table = merged(table, changes)
    table["materials"] = {"default": Orthotropic(density=DENSITY, angle=angle)}
    return Model(parse_case(table))


@pytest.mark.parametrize("wave, modulus", [("P", 16e9), ("S", 1e9)])
def test_plane_waves_leave(wave: str, modulus: float) -> None:
    """A packet that runs up a column; the isotropic rho c_p of the x axis would send a third of its velocity back."""
    height, width, begin = 12e-3, 1.5e-3, 4e-3
    strip = model({
        "mesh": {"kind": "two_plates", "length": 1e-3, "height": height, "element_size": 1e-3},
        "boundaries": [*guided("x" if wave == "P" else "y"), {"kind": "absorbing", "edge": "upper.top"}],
        "faults.main.initial_stress.normal": 1e9,
    })  # fmt: skip
    motion, state = strip.case.stepper.bind(strip), strip.initial_state()
    speed, along, y = np.sqrt(modulus / DENSITY), wave == "P", strip.coordinates[:, 1]

    def packet(y: np.ndarray) -> np.ndarray:
        return 1e-9 * np.exp(-(((y - begin) / width) ** 2))

    state.displacement[along::2] = packet(y)
    state.velocity[along::2] = (packet(y - speed * motion.dt) - packet(y + speed * motion.dt)) / (2 * motion.dt)
    largest = np.abs(state.velocity).max()
    # At 20 mm / c the packet has left by the top at 12 mm and its echo would be back at 4 mm.
    while state.time < 20e-3 / speed:
        motion.step(state)
    assert np.abs(state.velocity[along::2]).max() < 0.01 * largest


def test_a_material_whose_axes_are_turned() -> None:
    """The impedance of an edge along x is then a full matrix, which dashpots along x and y are not."""
    with pytest.raises(
        CaseError, match=facts(r"boundaries.0.edge = 'upper.top': .* send back \d+.\d% .*at most 1% is")
    ):
        model({"boundaries": [{"kind": "absorbing", "edge": "upper.top"}]}, angle=0.6)


def test_an_edge_that_is_turned(tmp_path: Path) -> None:
    """By 45 degrees Z of an isotropic body has (z_p + z_s) / 2 on the diagonal and (z_p - z_s) / 2 beside it."""
    pytest.importorskip("gmsh")
    table = plates({"mesh": tilted(tmp_path, np.pi / 4), "order": 1})
    turned = Model(parse_case(table))
    z_p, z_s = np.diag(turned.materials[0].impedance(np.eye(2), "stress")[0])
    coupling = Edge(turned, "lower.left", "edge").coupling()
    assert coupling == pytest.approx(0.5 * (z_p - z_s) / (z_p + z_s), rel=1e-9)
    with pytest.raises(CaseError, match=r"boundaries\.0\.edge = 'lower\.left'"):
        Model(parse_case({**table, "boundaries": [{"kind": "absorbing", "edge": "lower.left"}]}))


def test_radiation_damping_along_the_axes() -> None:
    """sqrt(rho C_xyxy) / 2 between equal bodies, twice as much on a rigid base."""
    impedance = np.sqrt(DENSITY * 1e9)
    for mesh, expected in (("two_plates", 0.5 * impedance), ("block_on_rigid", impedance)):
        aligned = model({"mesh.kind": mesh})
        np.testing.assert_allclose(radiation_impedance(aligned, aligned.faults[0]), expected, rtol=1e-12)


def test_radiation_damping_of_turned_axes() -> None:
    """Slip would change the normal stress, and a half model of equal plates is none: the image has other axes."""
    turned = model({}, angle=0.6)
    with pytest.raises(CaseError, match=facts(r"radiation_damping: .*faults.main.* use kind = 'hybrid'")):
        radiation_impedance(turned, turned.faults[0])
    with pytest.raises(CaseError, match=facts(r"materials\.upper\.kind = 'orthotropic'")):
        model({"mesh.kind": "half_plate"}, angle=0.6)
    half = model({"mesh.kind": "half_plate"})
    z = half.materials[0].impedance(np.array([0.0, 1.0]), "strain")
    np.testing.assert_allclose(radiation_impedance(half, half.faults[0]), 0.5 * z[0, 0], rtol=1e-12)


def test_radiation_of_welded_bodies_is_their_mean(tmp_path: Path) -> None:
    """At the node that two elements of different bodies share: the mean of both by area."""
    pytest.importorskip("gmsh")
    sides = {"main": {"plus": ["c", "d"], "minus": ["a", "b"]}}
    mesh = blocks(tmp_path, {"a": "1", "b": "2", "c": "3", "d": "4"}, {"main": "11, 21"}, sides)
    soft = {**HOMALITE, "young_modulus": HOMALITE["young_modulus"] / 4}
    layered = Model(parse_case(plates({
        "mesh": mesh, "order": 2, "materials": {"a": HOMALITE, "c": HOMALITE, "b": soft, "d": soft},
    })))  # fmt: skip
    fault = layered.faults[0]
    found, x = radiation_impedance(layered, fault), fault.interface.points[:, 0]
    stiff = 0.5 * np.sqrt(HOMALITE["density"] * HOMALITE["young_modulus"] / 2.7)
    np.testing.assert_allclose(found[x < -1e-9], stiff, rtol=1e-12)
    np.testing.assert_allclose(found[x > 1e-9], 0.5 * stiff, rtol=1e-12)
    np.testing.assert_allclose(found[np.abs(x) < 1e-9], 0.75 * stiff, rtol=1e-12)


def test_impact_along_fibres(tmp_path: Path) -> None:
    """The demo on a coarse mesh: the impact travels at sqrt(C_11 / rho), the rupture between c_s and v_c.

    C_11 and v_c are those of plane strain, from the compliance of a body that is isotropic across its fibres.
    """
    E_1, E_2, nu_12, nu_23, G_12, density = 80e9, 8.9e9, 0.25, 0.4, 3.6e9, 1478.0
    compliance = np.diag([1 / E_1, 1 / E_2, 1 / E_2])
    compliance[0, 1:] = compliance[1:, 0] = -nu_12 / E_1
    compliance[1, 2] = compliance[2, 1] = -nu_23 / E_2
    C = np.linalg.inv(compliance)
    c_p, c_s = np.sqrt(C[0, 0] / density), np.sqrt(G_12 / density)
    v_c = np.sqrt((C[0, 0] * C[1, 1] - C[0, 1] ** 2) / (C[0, 1] + C[1, 1]) / density)
    demo = Path(__file__).parents[2] / "demos" / "composite_impact.toml"
    case = read_case(demo, overrides=[
        "mesh.element_size=4e-3", "mesh.length=0.12", "mesh.height=0.032", "duration=14e-6", "output.figures=false",
        "output.bulk_interval=4e-6", "output.bulk_fields=['velocity']",
    ])  # fmt: skip
    with simulate(case, tmp_path / "run", progress=False) as record:
        points, places = record.bulk["points"].values, []
        row = np.flatnonzero(np.abs(points[:, 1] - 16e-3) < 1e-9)
        row = row[np.argsort(points[row, 0])]
        for velocity in record.bulk["velocity"].values[:, row, 0]:  # falls from 5 m/s to 0 at the wave
            last = np.flatnonzero(velocity > 2.5)[-1]
            there = slice(last, last + 2)
            places.append(np.interp(2.5, velocity[there][::-1], points[row[there], 0][::-1]))
        speed = np.diff(places) / np.diff(record.bulk["time"].values)
        np.testing.assert_allclose(speed, c_p, rtol=0.01)
        position, when = record.interface["position"].values, record.interface["rupture_time"].values
        first, second = (np.abs(position - at).argmin() for at in (20e-3, 50e-3))
        tip = (position[second] - position[first]) / (when[second] - when[first])
        assert 3 * c_s < tip < v_c
        assert record.interface.attrs["mach_free_speed"] == pytest.approx(v_c, rel=1e-12)
        figure = plots.space_time(record).figure
        texts = [text.get_text() for ax in figure.axes for text in ax.texts]
        assert "$v_c$" in texts and not any("sqrt" in text for text in texts)
