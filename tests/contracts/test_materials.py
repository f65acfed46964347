"""Every material of the folder keeps the contract of a material; a new file is tested without an edit here."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from helpers.messages import facts
from helpers.small_cases import SPLIT, merged, plates
from pydantic import TypeAdapter

from ruptfx.app.check_law.examples import material

pytest.importorskip("dolfinx")

import ufl

from ruptfx import RuptfxError
from ruptfx.bodies import operators
from ruptfx.bodies.operators import Bulk
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError, alternatives, kinds, unit_of
from ruptfx.laws.materials import AnyMaterial, Material, Plane
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.laws.materials.orthotropic_elastic import OrthotropicElastic
from ruptfx.laws.materials.stiffness import surface_wave_speed, tangent_stiffness
from ruptfx.platform import fem
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

PLANES: tuple[Plane, ...] = ("stress", "strain", "antiplane", "solid")
every_plane = pytest.mark.parametrize("plane", PLANES)
every_material = pytest.mark.parametrize("kind", list(alternatives("ruptfx.laws.materials")))


def normals(plane: Plane) -> np.ndarray:
    n = np.random.default_rng(1).normal(size=(5, 3 if plane == "solid" else 2))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def energy(given: Material, strain: np.ndarray, plane: Plane) -> float:
    return float(given.energy_density(ufl.as_tensor(strain.tolist()), plane)((0.0,) * len(strain)))


@every_material
def test_toml_round_trip(kind: str) -> None:
    for given in (material(kind), material(kind, plain=True)):
        written = tomli_w.dumps({"material": given.model_dump(mode="json", exclude_none=True)})
        assert TypeAdapter(AnyMaterial).validate_python(tomllib.loads(written)["material"]) == given


@every_material
@every_plane
def test_energy_is_positive_and_starts_at_rest(kind: str, plane: Plane) -> None:
    """Of every strain but none, and without a force where there is none: the energy of small strains is quadratic."""
    given, random = material(kind), np.random.default_rng(0)
    dim = 3 if plane == "solid" else 2
    for _ in range(20):
        strain = 1e-6 * random.normal(size=dim if plane == "antiplane" else (dim, dim))
        strain = strain if plane == "antiplane" else 0.5 * (strain + strain.T)
        stored = energy(given, strain, plane)
        assert stored > 0
        assert energy(given, 1e-2 * strain, plane) == pytest.approx(1e-4 * stored, rel=1e-4)
    assert energy(given, 0 * strain, plane) == 0


@every_material
@every_plane
def test_lame_parameters_are_those_of_the_energy(kind: str, plane: Plane) -> None:
    """Whoever names them is linear and isotropic: lambda tr(e)^2 / 2 + G e:e at any strain."""
    given, random = material(kind), np.random.default_rng(3)
    moduli = given.lame(plane)
    if moduli is None:
        pytest.skip("not isotropic")
    dim = 3 if plane == "solid" else 2
    for size in (1e-6, 1.0):
        strain = size * random.normal(size=dim if plane == "antiplane" else (dim, dim))
        if plane == "antiplane":
            expected = 0.5 * moduli[1] * strain @ strain
        else:
            strain = 0.5 * (strain + strain.T)
            expected = 0.5 * moduli[0] * np.trace(strain) ** 2 + moduli[1] * np.sum(strain**2)
        assert energy(given, strain, plane) == pytest.approx(expected, rel=1e-12)


@every_material
@every_plane
def test_impedance_belongs_to_the_energy(kind: str, plane: Plane) -> None:
    """Z Z = rho times the Christoffel tensor: p' Z Z p / rho is twice the energy of the small strain sym(p n')."""
    given = material(kind)
    n = normals(plane)
    impedance = given.impedance(n, plane)
    np.testing.assert_allclose(impedance, impedance.swapaxes(1, 2), rtol=1e-12, atol=1e-12 * np.abs(impedance).max())
    assert np.linalg.eigvalsh(impedance).min() > 0
    for normal, z in zip(n, impedance, strict=True):
        p = 1e-6 * np.random.default_rng(2).normal(size=len(z))
        strain = p[0] * normal if plane == "antiplane" else 0.5 * (np.outer(p, normal) + np.outer(normal, p))
        assert p @ z @ z @ p / given.density == pytest.approx(2 * energy(given, strain, plane), rel=1e-5)


@every_material
@every_plane
def test_wave_speeds_are_those_of_the_energy(kind: str, plane: Plane) -> None:
    """Along x; a material that says them itself says the same."""
    given = material(kind)
    said, default = given.wave_speeds(plane), Material.wave_speeds(given, plane)
    np.testing.assert_allclose(said, default, rtol=1e-9)
    assert said.c_R <= said.c_s <= said.c_p


@pytest.mark.parametrize("plane", ["stress", "solid"])
@every_material
def test_operators_agree(kind: str, plane: Plane) -> None:
    """With the UFL form to round-off; all are symmetric."""
    given, meshes = material(kind), fem.dolfinx.mesh
    if plane == "solid":
        mesh = meshes.create_unit_cube(fem.MPI.COMM_WORLD, 2, 2, 2, meshes.CellType.hexahedron)
    else:
        mesh = meshes.create_unit_square(fem.MPI.COMM_WORLD, 3, 2, meshes.CellType.quadrilateral)
    mesh.geometry.x[:, 0] += 0.1 * np.sin(4 * mesh.geometry.x[:, 1])
    space = fem.lagrange(mesh, 2, mesh.geometry.dim)
    cells = mesh.topology.index_map(mesh.topology.dim)
    bulk = Bulk(space, plane, [given], np.zeros(cells.size_local + cells.num_ghosts, dtype=np.int32))
    size = (space.dofmap.index_map.size_local + space.dofmap.index_map.num_ghosts) * space.dofmap.index_map_bs
    u, w = np.random.default_rng(4).normal(size=(2, size))
    found = {}
    for name in kinds("ruptfx.bodies.operators"):
        operator: Any = operators.create(name, bulk)
        found[name], other = np.zeros(size), np.zeros(size)
        operator.add_internal_force(u, found[name])
        operator.add_internal_force(w, other)
        assert w @ found[name] == pytest.approx(u @ other, rel=1e-11, abs=1e-11 * np.abs(other).sum())
    expected = found.pop("ufl_form")
    for name, force in found.items():
        assert np.abs(force - expected).max() <= 1e-12 * np.abs(expected).max(), name


def column(given: Material, plane: Plane, along: int) -> Model:
    """Two plates 1 mm wide and 12 mm high whose edges are guided, so that a plane wave runs up; they end absorbing."""
    held = "xy"[1 - along] if plane != "antiplane" else None
    guided = [
        {"kind": "driven", "edge": f"{body}.{side}", "component": held, "velocity": 0.0}
        for body in ("upper", "lower") for side in ("left", "right") if held
    ]  # fmt: skip
    table = merged(plates({"plane": plane, "operator": "assembled", "faults.main.contact": SPLIT}), {
        "mesh": {"kind": "two_plates", "length": 1e-3, "height": 12e-3, "element_size": 1e-3},
        "boundaries": [*guided, {"kind": "absorbing", "edge": "upper.top"}],
        "faults.main.initial_stress.normal": 1e9,
    })  # fmt: skip
    if "initial_stress" in type(given).model_fields:
        given = given.model_copy(update={"initial_stress": [0.0] * 6})
    table["materials"] = {"default": given}
    return Model(parse_case(table))


def refusal(given: Material, plane: Plane, along: int) -> str:
    """Return the message with which absorbing edges refuse a material, empty where they take it."""
    try:
        column(given, plane, along)
    except CaseError as refused:
        if plane in given.planes():
            assert "boundaries" in str(refused) and "send back" in str(refused)
        return str(refused)
    return ""


PLANE_WAVES: list[tuple[Plane, int]] = [("stress", 0), ("stress", 1), ("strain", 1), ("antiplane", 0)]


@every_material
def test_absorbing_edges_take_every_material_in_some_plane(kind: str) -> None:
    """With axes along x and y; else no test below would have seen its waves."""
    assert any(not refusal(material(kind, plain=True), *setting) for setting in PLANE_WAVES)


def hardly_relaxing(given: Material) -> Material:
    """Return a material with durations 1e6 times as long: a wave does not decay while it passes."""
    cls, slow = type(given), {}
    for name in cls.model_fields:
        value = getattr(given, name)
        if value is not None and unit_of(cls, name) == "s":
            slow[name] = [1e6 * each for each in value] if isinstance(value, list) else 1e6 * value
    return given.model_copy(update=slow)


@pytest.mark.parametrize("plane, along", PLANE_WAVES)
@every_material
def test_plane_waves_travel_and_leave(kind: str, plane: Plane, along: int) -> None:
    """A packet that moves along x (0) or y and runs up: 4 mm at the speed of the impedance, then out by the top."""
    given, begin, width = hardly_relaxing(material(kind, plain=True)), 4e-3, 1.5e-3
    if refusal(given, plane, along):
        pytest.skip("absorbing edges refuse oblique axes")
    model = column(given, plane, along)
    motion, state, y = model.case.stepper.bind(model), model.initial_state(), model.coordinates[:, 1]
    c = model.components
    place = slice(along if c > 1 else 0, None, c)
    speed = np.diag(given.impedance(np.array([0.0, 1.0]), plane))[along if c > 1 else 0] / given.density

    def packet(travelled: float) -> np.ndarray:
        return 1e-9 * np.exp(-(((y - begin - travelled) / width) ** 2))

    state.displacement[place] = packet(0)
    state.velocity[place] = (packet(speed * motion.dt) - packet(-speed * motion.dt)) / (2 * motion.dt)
    largest = np.abs(state.velocity).max()
    while state.time < 4e-3 / speed:
        motion.step(state)
    upper = y > 0.5 * begin
    error = np.abs(state.displacement[place] - packet(speed * state.time))[upper]
    assert error.max() < 0.01 * 1e-9
    # At 20 mm / c the packet has left by the top at 12 mm and its echo would be back at 4 mm.
    while state.time < 20e-3 / speed:
        motion.step(state)
    assert np.abs(state.velocity[place]).max() < 0.01 * largest


# -- single materials ----------------------------------------------------------------------------------------------


@every_plane
def test_isotropic_impedance(plane: Plane) -> None:
    """rho c_p along the normal and rho c_s across."""
    given = IsotropicElastic(young_modulus=5.3e9, poisson_ratio=0.35, density=1246.0)
    speeds, n = given.wave_speeds(plane), normals(plane)
    along = n[:, :, None] * n[:, None, :] if plane != "antiplane" else np.zeros((len(n), 1, 1))
    expected = given.density * (speeds.c_p * along + speeds.c_s * (np.eye(along.shape[1]) - along))
    np.testing.assert_allclose(given.impedance(n, plane), expected, rtol=1e-13, atol=1e-13 * expected.max())


@every_plane
@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_equal_constants_make_an_orthotropic_body_isotropic(plane: Plane, angle: float) -> None:
    E, nu = 5.3e9, 0.35
    given = OrthotropicElastic(density=1246.0, E_1=E, E_2=E, nu_12=nu, nu_23=nu, G_12=E / (2 * (1 + nu)), angle=angle)
    same = IsotropicElastic(young_modulus=E, poisson_ratio=nu, density=1246.0)
    expected = tangent_stiffness(same, plane)
    np.testing.assert_allclose(tangent_stiffness(given, plane), expected, rtol=1e-12, atol=1e-12 * expected.max())


LAYERED = {"density": 1600.0, "E_1": 140e9, "E_2": 10e9, "nu_12": 0.3, "nu_23": 0.45, "G_12": 5e9}


@pytest.mark.parametrize("plane", ["stress", "strain", pytest.param("solid", marks=pytest.mark.slow)])
def test_speed_without_shear_mach_front(plane: Plane) -> None:
    """sqrt(2) c_s of isotropic bodies; else that of a plane wave (1, -m) f(x + m y - v t) without shear."""
    same = IsotropicElastic(young_modulus=5.3e9, poisson_ratio=0.35, density=1246.0)
    assert same.mach_free_speed(plane) == pytest.approx(np.sqrt(2) * same.wave_speeds(plane).c_s, rel=1e-12)
    given = OrthotropicElastic(**LAYERED)
    C, moment = tangent_stiffness(given, plane), given.density * given.mach_free_speed(plane) ** 2
    m = np.sqrt((C[0, 0, 1, 1] + moment) / C[1, 1, 1, 1])
    along = np.eye(len(C))[0] + m * np.eye(len(C))[1]
    wave = np.eye(len(C))[0] - m * np.eye(len(C))[1]
    np.testing.assert_allclose(np.einsum("ijkl,j,k,l", C, along, wave, along), moment * wave, atol=1e-9 * moment)
    assert abs(np.einsum("kl,k,l", C[0, 1], wave, along)) < 1e-9 * moment
    assert np.isnan(OrthotropicElastic(**LAYERED, angle=0.3).mach_free_speed(plane))
    assert np.isnan(given.mach_free_speed("antiplane"))


def test_engineering_constants_of_an_orthotropic_body() -> None:
    """A stretch along an axis under stress along it alone takes E and contracts by nu; plane strain holds e_33."""
    solid = tangent_stiffness(OrthotropicElastic(**LAYERED, E_3=8e9, nu_13=0.25, G_13=4e9, G_23=3e9), "solid")
    voigt = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    compliance = np.linalg.inv([[solid[i, j, m, n] for m, n in voigt] for i, j in voigt])
    assert 1 / np.diag(compliance) == pytest.approx([140e9, 10e9, 8e9, 3e9, 4e9, 5e9], rel=1e-12)
    assert -compliance[1, 0] * 140e9 == pytest.approx(0.3, rel=1e-12)
    assert -compliance[2, 0] * 140e9 == pytest.approx(0.25, rel=1e-12)
    assert -compliance[2, 1] * 10e9 == pytest.approx(0.45, rel=1e-12)
    strain = tangent_stiffness(OrthotropicElastic(**LAYERED, E_3=8e9, nu_13=0.25), "strain")
    np.testing.assert_allclose(strain, solid[:2, :2, :2, :2], rtol=1e-12, atol=1.0)
    antiplane = tangent_stiffness(OrthotropicElastic(**LAYERED), "antiplane")
    np.testing.assert_allclose(antiplane, np.diag([5e9, 10e9 / 2.9]), rtol=1e-12)


def test_turned_axes() -> None:
    """By a right angle axis 1 is y; by 30 degrees a rotation of the tensor."""
    straight, upright, turned = (
        tangent_stiffness(OrthotropicElastic(**LAYERED, angle=angle), "stress") for angle in (0, np.pi / 2, np.pi / 6)
    )
    assert upright[1, 1, 1, 1] == pytest.approx(straight[0, 0, 0, 0], rel=1e-12)
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    axes = np.array([[c, -s], [s, c]])  # columns: axes 1 and 2
    expected = np.einsum("ia,jb,kc,ld,abcd->ijkl", axes, axes, axes, axes, straight)
    np.testing.assert_allclose(turned, expected, rtol=1e-12, atol=1e-3)


def test_constants_of_no_body_are_refused() -> None:
    """nu_21 = nu_12 E_2 / E_1 too: 0.9 > sqrt(1 / 2)."""
    with pytest.raises(CaseError, match=facts(r"let some strain release energy; .*sqrt\(E_i / E_j\)")):
        OrthotropicElastic(density=1e3, E_1=1e9, E_2=2e9, nu_12=0.9, nu_23=0.1, G_12=1e9)


def test_surface_wave_of_an_orthotropic_body() -> None:
    """Along an axis the speed of a free surface solves, with X = rho c^2,
    (C_66 - X) [C_11 C_22 - C_12^2 - C_22 X]^2 = C_22 C_66 X^2 (C_11 - X) (Source: Stoneley 1963)."""
    C = tangent_stiffness(OrthotropicElastic(**LAYERED), "strain")
    c11, c22, c12, c66 = C[0, 0, 0, 0], C[1, 1, 1, 1], C[0, 0, 1, 1], C[0, 1, 0, 1]
    x = 1600.0 * surface_wave_speed(C, 1600.0) ** 2
    assert (c66 - x) * (c11 * c22 - c12**2 - c22 * x) ** 2 == pytest.approx(c22 * c66 * x**2 * (c11 - x), rel=1e-9)
    assert 0.8 * c66 < x < c66


class Graded(Material):
    """Stiffness that varies from place to place."""

    def energy_density(self, strain: Any, plane: Plane) -> Any:
        x = ufl.SpatialCoordinate(ufl.Mesh(fem.basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))))
        return (1e9 + 1e6 * x[0]) * ufl.inner(strain, strain)


class Unstable(Material):
    def energy_density(self, strain: Any, plane: Plane) -> Any:
        return 1e9 * (ufl.inner(strain, strain) - 2 * ufl.tr(strain) ** 2)


@pytest.mark.parametrize(
    "given, message",
    [
        (Graded(density=1e3), r"does not follow from its energy alone \(it varies from place to place\).*`impedance`"),
        (Unstable(density=1e3), r"some plane waves have a modulus of -2e\+09 Pa"),
    ],
)  # fmt: skip
def test_impedances_that_are_not_known(given: Material, message: str) -> None:
    with pytest.raises(RuptfxError, match=facts(message)):
        given.impedance(np.eye(2), "strain")
    with pytest.raises(RuptfxError, match=facts(message)):
        given.wave_speeds("strain")


def test_springs_of_an_orthotropic_body_with_equal_axes_are_isotropic() -> None:
    """The mean of n n / E(n) over all directions is 1 / (2 E) along both axes; with E_1 = 2 E_2, by quadrature."""
    body = OrthotropicElastic(
        E_1=4.0, E_2=2.0, E_3=1.5, nu_12=0.3, nu_23=0.4, nu_13=0.25, G_12=0.8, G_13=0.7, G_23=0.5, density=1.0
    )
    c, s = np.cos(angle := np.linspace(0, 2 * np.pi, 4001)[:-1]), np.sin(angle)
    inverse = c**4 / 4 + (1 / 0.8 - 2 * 0.3 / 4) * (c * s) ** 2 + s**4 / 2
    means = np.mean(c**2 * inverse), np.mean(s**2 * inverse)
    first, second, both = body._of_springs(lambda modulus: 1 / modulus)
    assert (first, second, both) == pytest.approx((2 * means[0], 2 * means[1], 2 * sum(means)), rel=1e-9)


PLUG_IN = Path(__file__).parents[2] / "demos" / "plugins" / "materials" / "transversely_isotropic.py"


def layered_rock(folder: Path, text: str, changes: dict[str, Any]) -> Any:
    (folder / "rock.py").write_text(text)
    rock = {"kind": "transversely_isotropic", "density": 2000.0, "A": 1e9, "C": 1e9, "F": 0.5e9, "L": 1e9, "N": 0.25e9}
    table = {"plane": "strain", "operator": "ufl_form", "materials.default": {**rock, **changes}}
    return parse_case(plates(table) | {"plugins": ["rock.py"]}, folder)


def test_an_energy_that_is_not_positive_is_refused_before_the_first_step(tmp_path: Path) -> None:
    """A = C = 1 GPa, F = 3 GPa: the strains xx = yy and xx = -yy have the stiffness A + F and A - F, -2 GPa."""
    Model(layered_rock(tmp_path, PLUG_IN.read_text(), {}))
    with pytest.raises(CaseError, match=facts(r"materials\.\w+: some strain .* -2e\+09 Pa .* 4e\+09 Pa")):
        Model(layered_rock(tmp_path, PLUG_IN.read_text(), {"F": 3e9}))


def test_an_energy_that_is_positive_at_some_points_only_is_refused(tmp_path: Path) -> None:
    """F rises from 0.5 GPa at the left to 1.5 GPa at the right end: A - F is -0.5 GPa there."""
    text = PLUG_IN.read_text().replace("Modulus, Plane", "Modulus, Plane, VaryingStress")
    text = text.replace("F: Modulus", "F: VaryingStress")
    ramp = {"kind": "table", "positions": [0.0, 12e-3], "values": [0.5e9, 1.5e9]}

    def along_x(values: list[float]) -> dict[str, Any]:
        return {"F": {"kind": "along_axis", "axis": "x", "profile": {**ramp, "values": values}}}

    with pytest.raises(CaseError, match=facts(r"materials\.\w+: some strain .* -5e\+08 Pa .* 2.5e\+09 Pa")):
        Model(layered_rock(tmp_path, text, along_x([0.5e9, 1.5e9])))
    Model(layered_rock(tmp_path, text, along_x([0.2e9, 0.8e9])))


def test_stiffer_orthotropic_bodies_keep_the_strain_across_a_stress() -> None:
    """The compliances of springs are taken from 1 / E_1, 1 / E_2 and 1 / G_12 alone."""
    body = OrthotropicElastic(
        E_1=4.0, E_2=2.0, E_3=1.5, nu_12=0.3, nu_23=0.4, nu_13=0.25, G_12=0.8, G_13=0.7, G_23=0.5, density=1.0
    )

    def springs(modulus: float) -> float:
        return 0.01 / modulus

    less = np.zeros((6, 6))
    less[[0, 1, 5], [0, 1, 5]] = body._of_springs(springs)
    assert less[0, 0] > 0
    stiffer = body.stiffened("strain", springs)
    np.testing.assert_allclose(stiffer._compliance(), body._compliance() - less, rtol=1e-12, atol=1e-15)
    for plane in ("stress", "strain"):
        exact = IsotropicElastic(young_modulus=4.0, poisson_ratio=0.3, density=1.0)
        lame, shear = exact.lame(plane)
        lame_2, shear_2 = exact.stiffened(plane, springs).lame(plane)
        assert 0.5 / shear - 0.5 / shear_2 == pytest.approx(0.0025)
        assert 0.5 / (lame + shear) - 0.5 / (lame_2 + shear_2) == pytest.approx(0.0025)
