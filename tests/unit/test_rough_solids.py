"""Solids with rough surfaces: curved hexahedra, gap, refinement of their middle, refusals."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.sliding_cases import solids
from helpers.small_cases import strike_slip

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import FACETS, RawMesh
from ruptfx.bodies.meshes.block_on_rigid import BlockOnRigid
from ruptfx.bodies.meshes.lobatto import nodes_between
from ruptfx.bodies.meshes.rough_plates import RoughPlates, _places
from ruptfx.bodies.space.bodies import check_facets, check_orientation
from ruptfx.case import parse_case
from ruptfx.input.profiles.self_affine import SelfAffine
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.sliding.roughness import _slope, largest_slope, mean_frame
from ruptfx.interfaces.sliding.surface import Surface, lattice_numbers
from ruptfx.platform import fem
from ruptfx.run import stages
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

WAVES = {
    "kind": "product", "value": {"kind": "sinusoid", "amplitude": 5e-5, "wavelength": 2e-3},
    "factor": {"kind": "along_dip", "profile": {"kind": "sinusoid", "amplitude": 1.0, "wavelength": 3e-3}},
}  # fmt: skip
BALL = {"kind": "parabola", "radius": 20e-3, "center": {"x": 0.13e-3, "y": -0.21e-3}}


def plates(upper: dict[str, Any] | None = None, lower: dict[str, Any] | None = None, **options: Any) -> RoughPlates:
    """Return an upper plate of 4 x 3 mm, 1 mm high, on a lower one of 6 x 6 mm."""
    above = {"length": 4e-3, "width": 3e-3, "height": 1e-3, "element_size": 0.5e-3, "left": -2e-3, "front": -1.5e-3}
    below = {"length": 6e-3, "width": 6e-3, "height": 1e-3, "element_size": 0.75e-3, "left": -3e-3, "front": -3e-3}
    table = {"upper": above | (upper or {}), "lower": below | (lower or {}), "curve_order": 2, **options}
    return RoughPlates.model_validate(table)


def volume(raw: RawMesh, body: int) -> float:
    """Return the volume of a body by a quadrature that is exact for its cells [m3]."""
    order, cell = raw.order, fem.basix.CellType[raw.cell]
    element = fem.basix.create_element(
        fem.basix.ElementFamily.P, cell, order, lagrange_variant=fem.basix.LagrangeVariant.gll_warped
    )
    points, weights = fem.basix.make_quadrature(cell, 3 * order)
    slopes = np.asarray(element.tabulate(1, points))[1:, :, :, 0]
    cells = raw.points[raw.cells[raw.cell_body == body]]
    return float(np.sum(np.linalg.det(np.einsum("dqk,cka->cqda", slopes, cells)) * weights))


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_nodes_of_cells_are_in_the_order_of_dolfinx(cell: str, order: int) -> None:
    basix = fem.basix
    element = basix.create_element(
        basix.ElementFamily.P, basix.CellType[cell], order, lagrange_variant=basix.LagrangeVariant.gll_warped
    )
    lines = np.unique(np.round(element.points[:, 0], 9))
    expected = np.abs(np.asarray(element.points)[..., None] - lines).argmin(axis=-1)
    assert [list(place) for place in _places(expected.shape[1], order)] == expected.tolist()


@pytest.mark.parametrize("order", [1, 2, 4])
def test_curved_solids_follow_the_profile(order: int) -> None:
    """The mean of cos(2 pi x / 2 mm) over 6 mm is zero: the volume of the lower plate is that of its box."""
    raw = plates(lower={"profile": WAVES}, closest=1e-4, curve_order=order).build()
    check_orientation(raw)
    check_facets(raw)
    np.testing.assert_allclose([volume(raw, 0), volume(raw, 1)], [12e-9, 36e-9], rtol=1e-12 if order > 1 else 1e-3)
    plus, minus = raw.interfaces["main"]
    assert (len(plus), len(minus)) == (8 * 6, 8 * 8) and plus.shape[1] == 4
    x, y, z = raw.points[np.unique(minus)].T
    height = 5e-5 * np.cos(2 * np.pi * x / 2e-3) * np.cos(2 * np.pi * y / 3e-3)
    np.testing.assert_allclose(z, height, atol=1e-18)
    np.testing.assert_allclose(raw.points[np.unique(plus), 2], 1.5e-4, rtol=1e-6)  # the crest, and the gap
    count = Counter(frozenset(row) for facet in FACETS[raw.cell] for row in raw.cells[:, list(facet)].tolist())
    named = [*raw.edges.values(), plus, minus]
    assert all(count[frozenset(facet)] == 1 for facets in named for facet in facets.tolist())
    assert sum(map(len, named)) == sum(number == 1 for number in count.values())  # the whole outside has names


def test_the_gap_of_a_ball_is_that_of_its_tip() -> None:
    """The tip is between samples of the gap, (0.13, -0.21) mm."""
    raw = plates(upper={"profile": BALL}, closest=2e-6).build()
    x, y, z = raw.points[np.unique(raw.interfaces["main"][0])].T
    np.testing.assert_allclose(z - 2e-6, ((x - 0.13e-3) ** 2 + (y + 0.21e-3) ** 2) / 40e-3, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 4])
def test_nodes_of_a_ball_are_on_the_sphere(order: int) -> None:
    """Every node of the curved facets is on the sphere to rounding, also where it is steep."""
    ball = {"kind": "sphere", "radius": 6e-3, "center": {"x": 0.1e-3, "y": -0.2e-3}}
    size = {"left": -1.5e-3, "length": 3e-3, "height": 2e-3}
    raw = plates(upper={"profile": ball, **size}, closest=1e-6, curve_order=order).build()
    check_orientation(raw)
    points = raw.points[np.unique(raw.cells[raw.cell_body == 0])]
    points = points[np.argsort(points[:, 2])]
    _, lowest = np.unique(np.round(points[:, :2] / 1e-8), axis=0, return_index=True)
    assert len(lowest) == (6 * order + 1) ** 2
    away = np.linalg.norm(points[lowest] - np.array([0.1e-3, -0.2e-3, 6e-3 + 1e-6]), axis=1)
    np.testing.assert_allclose(away, 6e-3, rtol=1e-9)


def test_surfaces_of_a_slope() -> None:
    """The gap of a rough surface with an RMS slope of 0.05 over a plane has that slope, heights scale with it."""
    rough = {"kind": "self_affine_surface", "rms_slope": 0.05, "hurst": 0.8, "length": 6e-3, "longest": 6e-3,
             "shortest": 3e-3, "seed": 4}  # fmt: skip
    line = np.arange(48) * 6e-3 / 48
    places = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)
    heights = plates(lower={"profile": rough}).lower.heights(places.reshape(-1, 2), "lower").reshape(48, 48)
    k = 2j * np.pi * np.fft.fftfreq(48, 6e-3 / 48)
    wave = np.fft.fft2(heights)
    slopes = [np.fft.ifft2(wave * each).real for each in (k[:, None], k)]
    np.testing.assert_allclose(np.sqrt(np.mean(slopes[0] ** 2 + slopes[1] ** 2)), 0.05, rtol=1e-9)
    flat = {"kind": "self_affine", "rms_slope": "5 %", "hurst": 0.8, "length": 6e-3, "longest": 6e-3, "shortest": 3e-4,
            "seed": 4}  # fmt: skip
    profile = plates(lower={"profile": flat}).lower.profile
    assert isinstance(profile, SelfAffine)
    line = np.arange(480) * 6e-3 / 480
    slope = np.fft.ifft(np.fft.fft(profile(line)) * 2j * np.pi * np.fft.fftfreq(480, 6e-3 / 480)).real
    np.testing.assert_allclose(np.sqrt(np.mean(slope**2)), 0.05, rtol=1e-9)
    with pytest.raises(CaseError, match=facts(r"rms_slope = 0.05: give rms \[Pa\]")):
        parse_case(strike_slip({"faults.main.initial_stress.normal": rough}))


MAP = "\n".join(["x (mm), y (mm), height (um)", *(
    f"{x}, {y}, {20 + 10 * np.cos(np.pi * x / 3) * np.cos(np.pi * y / 3):.6f}"
    for x in np.linspace(-3, 3, 25) for y in np.linspace(-3, 3, 25)
)])  # fmt: skip


@pytest.mark.parametrize("interpolation, close", [("linear", 0.2), ("cubic", 2e-3)])
def test_a_measured_map_of_heights(interpolation: str, close: float, tmp_path: Path) -> None:
    """A wave of 10 um every 0.25 mm in a CSV file: the nodes of the lower surface are on it."""
    (tmp_path / "map.csv").write_text(MAP, encoding="utf-8")
    measured = {"kind": "surface_table", "file": "map.csv", "interpolation": interpolation}
    case = parse_case(solids({"mesh.lower": {
        "length": 6e-3, "left": -3e-3, "width": 6e-3, "front": -3e-3, "height": 1e-3, "element_size": 0.39e-3,
        "profile": measured,
    }, "mesh.curve_order": 2}), tmp_path)  # fmt: skip
    raw = case.mesh.build()
    x, y, z = raw.points[np.unique(raw.interfaces["main"][1])].T
    exact = 20e-6 + 10e-6 * np.cos(np.pi * x / 3e-3) * np.cos(np.pi * y / 3e-3)
    np.testing.assert_allclose(z, exact, atol=close * 1e-6)
    assert np.abs(z - exact).max() > 0.02 * close * 1e-6
    assert raw.points[np.unique(raw.interfaces["main"][0]), 2].min() == pytest.approx(30e-6, abs=0.1e-6)


@pytest.mark.parametrize("text, message", [
    (None, r"mesh\.lower\.profile: .*map\.csv"),
    (MAP.replace("0.25, 0.5, ", "0.25, 0.6, ", 1), r"map\.csv: no value at x = -0\.00025 m, y = 0\.0005 m;"),
    (MAP.replace("height (um)", "height (MPa)"), r"line 1 of .*map\.csv, column 3"),
    (MAP.replace("x (mm), y (mm)", "y (mm), x (mm)"), r"line 1 of .*map\.csv: column 1 is y"),
    (MAP.replace("0.25, 0.5, ", "0.25, 0.5, nan #", 1), r"line \d+ of .*map\.csv"),
    ("\n".join(MAP.splitlines()[:26]), r"map\.csv: .* 1 .* 25"),
    (MAP.replace("x (mm), y (mm)", "x (um), y (um)"),
     r"mesh\.lower\.profile: .* strike from -3e-06 to 3e-06 m, .* from -0\.0003 to 0\.0024 m"),
])  # fmt: skip
def test_maps_of_heights_that_are_refused(text: str | None, message: str, tmp_path: Path) -> None:
    """A file that is missing, has a hole, another unit, exchanged columns or no number, is a line, or is too small."""
    if text is not None:
        (tmp_path / "map.csv").write_text(text, encoding="utf-8")
    with pytest.raises(RuptfxError, match=facts(message)):
        parse_case(solids({"mesh.lower.profile": {"kind": "surface_table", "file": "map.csv"}}), tmp_path).mesh.build()


def test_a_sphere_that_ends_within_a_plate() -> None:
    small = {"kind": "sphere", "radius": 1.6e-3, "center": {"x": 0.0, "y": 0.0}}
    with pytest.raises(CaseError, match=facts(r"mesh\.upper\.profile: radius = 0\.0016 m: .* 0\.0025")):
        plates(upper={"profile": small}).build()


def test_elements_grow_beyond_the_middle() -> None:
    """In the middle 1 mm there are two elements of 0.5 mm; those beyond grow, and the last ends at 3 mm."""
    raw = plates(lower={"fine": 1e-3, "growth": 1.5, "element_size": 0.5e-3}).build()
    minus = raw.points[np.unique(raw.interfaces["main"][1])]
    for axis in (0, 1):
        lines = np.unique(np.round(minus[:, axis], 12))
        assert lines[0] == -3e-3 and lines[-1] == 3e-3
        np.testing.assert_allclose(lines, -lines[::-1], atol=1e-15)
        size = np.diff(lines)
        middle = size[len(size) // 2 :]
        np.testing.assert_allclose(middle[0], 0.5e-3, rtol=1e-9)
        np.testing.assert_allclose(middle[2:] / middle[1:-1], 1.5, rtol=1e-6)


def test_a_solid_on_a_rigid_ball() -> None:
    """The base touches z = 0 at its tip; x and y of its surface end where the table says."""
    base = {"length": 5e-3, "width": 4e-3, "left": -2e-3, "front": -2e-3,
            "profile": {"kind": "product", "value": BALL, "factor": -1.0}}  # fmt: skip
    block = {"length": 2e-3, "width": 3e-3, "height": 1e-3, "element_size": 0.5e-3, "left": -1e-3, "front": -1.5e-3}
    raw = BlockOnRigid.model_validate({**block, "base": base}).build()
    assert raw.cell == "hexahedron" and len(raw.cells) == 4 * 6 * 2 and raw.one_sided == {"main": "rigid"}
    np.testing.assert_allclose(volume(raw, 0), 6e-9, rtol=1e-12)
    surface = raw.bases["main"]
    assert (surface.ends, surface.sides) == ((-2e-3, 3e-3), (-2e-3, 2e-3))
    points = surface.points(np.array([[0.13e-3, -0.21e-3], [1.13e-3, -0.21e-3]]))
    np.testing.assert_allclose(points[:, 2], [0.0, -1e-6 / 40e-3], atol=1e-12)
    np.testing.assert_allclose(points[:, 0], [0.13e-3, 1.13e-3])


def test_refusals_of_solids() -> None:
    with pytest.raises(ValueError, match=facts(r"lower.width is missing and upper.width = 0.003 m")):
        plates(lower={"width": None})
    with pytest.raises(CaseError, match=facts(r"mesh.upper.front = 0.0031: upper from 0.0031 to 0.0061 m")):
        plates(upper={"front": 3.1e-3}).build()
    steep = {"kind": "sinusoid", "amplitude": 2e-3, "wavelength": 1e-3}
    with pytest.raises(RuptfxError, match=facts(r"cells are folded, the first near")):
        check_orientation(plates(lower={"profile": steep}).build())
    block = {"length": 2e-3, "height": 1e-3, "element_size": 0.5e-3}
    with pytest.raises(ValueError, match=facts(r"chamfer = 0.0001 m")):
        BlockOnRigid.model_validate({**block, "width": 1e-3, "chamfer": 1e-4})
    with pytest.raises(ValueError, match=facts(r"base.width is missing and width = 0.001 m")):
        BlockOnRigid.model_validate({**block, "width": 1e-3, "base": {"length": 1e-3}})
    with pytest.raises(ValueError, match=facts(r"fine = 0.001 m")):
        BlockOnRigid.model_validate({**block, "fine": 1e-3})


def lattice(order: int, height: Any, elements: int = 24) -> Surface:
    """Return a surface over a square of 2 mm whose facets are a lattice."""
    line = nodes_between(np.linspace(0, 2e-3, elements + 1), order)
    x, y = (each.ravel() for each in np.meshgrid(line, line, indexing="ij"))
    points = np.column_stack([x, y, height(x, y)])
    return Surface(np.arange(len(points)), points, order, lattice_numbers((elements, elements), order))


@pytest.mark.parametrize("order", [2, 4])
def test_slopes_of_surfaces(order: int) -> None:
    """z = h cos(k x) cos(k y): root mean square slope h k / sqrt(2), largest slope h k; the plane part has none."""
    h, k = 10e-6, 2 * np.pi / 1e-3
    waves = lattice(order, lambda x, y: h * np.cos(k * x) * np.cos(k * y) + 0.1 * x)
    plane = lattice(order, lambda x, y: 0.1 * x, elements=19)
    frame = mean_frame(waves)
    np.testing.assert_allclose(frame[0], np.array([-0.1, 0.0, 1.0]) / np.sqrt(1.01), atol=2e-4)
    assert abs(largest_slope(plane)) < 1e-7
    np.testing.assert_allclose(largest_slope(waves), h * k, rtol=0.05)
    np.testing.assert_allclose(_slope(waves, plane), h * k / np.sqrt(2), rtol=0.03)
    np.testing.assert_allclose(_slope(plane, waves), h * k / np.sqrt(2), rtol=0.08)  # of its nearest nodes


def test_explicit_steps_of_a_solid_on_a_rigid_base() -> None:
    """A force of 1 MPa on a block of 1 mm2 on a flat base, damped: the base carries 1 N."""
    square = {"length": 1e-3, "width": 1e-3}
    case = parse_case({
        "plane": "solid", "order": 1, "duration": 10e-6, "positions": "x",
        "mesh": {"kind": "block_on_rigid", **square, "height": 0.5e-3, "element_size": 0.25e-3, "base": square},
        "materials": {"default": {
            "kind": "isotropic_elastic", "young_modulus": 5e9, "poisson_ratio": 0.25, "density": 1200.0,
        }},
        "damping": {"mass": 5e6},
        "faults": {"main": {
            "sliding": {}, "initial_stress": {"normal": 0.0}, "contact": {"kind": "forward_lagrange"},
            "friction": {"kind": "coulomb", "mu_d": 0.3},
        }},
        "boundaries": [{"kind": "traction", "edge": "upper.top", "traction": [0.0, 0.0, -1e6], "ramp": 1e-6}],
    })  # fmt: skip
    model = Model(case, fem.MPI.COMM_WORLD)
    motion, state, face = stages.bind(model), model.initial_state(), model.faults[0].interface
    while state.time < case.duration:
        motion.step(state)
    load = float(face.weight @ state.faults["main"]["normal_stress"])
    assert load == pytest.approx(1.0, rel=0.02)
