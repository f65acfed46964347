"""Parameters of materials that vary in the bodies: closed forms of layers, equality with numbers, refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.crack_cases import block as torn
from helpers.messages import facts
from helpers.small_cases import HOMALITE, merged, plates, slip_weakening, strike_slip, unstressed

from ruptfx.input.profiles import in_body
from ruptfx.input.profiles.random import Random
from ruptfx.input.schema import CaseError

pytest.importorskip("dolfinx")

from benchmarks.materials import Block, anisotropic_speeds, column_of_layers, trapped_period
from ruptfx.bodies import operators
from ruptfx.bodies.boundaries.loading import Loads
from ruptfx.case import Case, parse_case
from ruptfx.laws.materials.drucker_prager import DruckerPrager
from ruptfx.laws.materials.standard_linear_solids import StandardLinearSolids
from ruptfx.laws.materials.traced import traced
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model
from ruptfx.stepping.steppers._radiation import radiation_impedance

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD


def over(axis: str, **profile: Any) -> dict[str, Any]:
    return {"kind": "along_axis", "axis": axis, "profile": profile}


def constant(value: float) -> dict[str, Any]:
    return {"kind": "constant", "value": value}


def line(axis: str, *values: float) -> dict[str, Any]:
    """A straight line from -1 m to 1 m."""
    return over(axis, kind="table", positions=[-1.0, 1.0], values=list(values))


def block(material: dict[str, Any], boundaries: list[dict[str, Any]], order: int = 3, plane: str = "strain") -> Model:
    mesh = Block(columns=3, rows=4, size=0.1)
    given = {"plane": plane, "order": order, "duration": 1.0, "mesh": mesh, "boundaries": boundaries,
             "materials": {"default": {**HOMALITE, **material}}, "output": {"figures": False}}  # fmt: skip
    return Model(Case.model_validate(given), COMM)


def march(given: dict[str, Any], steps: int, comm: Any = COMM) -> tuple[Model, Any, Any]:
    case = parse_case(given)
    model = Model(case, comm)
    motion, state = case.stepper.bind(model), model.initial_state()
    for number in range(steps):
        state.wants_energies = number == steps - 1
        motion.step(state)
    return model, motion, state


MODULI = {"young_modulus": constant(5.3e9), "poisson_ratio": constant(0.35), "density": constant(1246.0)}
EDGE = [{"kind": "absorbing", "edge": f"upper.{side}"} for side in ("top", "right")]
CASES: dict[str, Any] = {
    "elastic": plates({"boundaries": [
        *EDGE, {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0},
    ]}),
    "rupture": slip_weakening({"boundaries": EDGE}),
    "solid": strike_slip({"mesh.element_size": 2e-3}),
    "quasi static": plates({
        "stepper.kind": "quasi_static", "duration": 5.0, "boundaries": [
            *({"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"),
            {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 1e-6},
            {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": 0.0},
        ]}),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_constant_profiles_are_numbers(name: str) -> None:
    """Mass, stiffness, dashpots and the stable step are the same to rounding."""
    found = []
    for changes in ({}, {f"materials.default.{key}": value for key, value in MODULI.items()}):
        _, motion, state = march(merged(CASES[name], changes), 6)
        found.append((motion.dt, state.displacement, state.velocity))
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-9)
    for ours, theirs in zip(*(each[1:] for each in found), strict=True):
        assert np.abs(theirs).max() > 0
        np.testing.assert_allclose(ours, theirs, atol=1e-8 * np.abs(theirs).max())


@pytest.mark.parametrize("operator", ["matrix_free", "ufl_form", "assembled"])
def test_patch(operator: str) -> None:
    """Stretched in y without motion in x: sigma_yy is uniform where u' = sigma / M(y), M = lambda + 2 G.

    M = M_0 / (1 + y / L) makes u = sigma / M_0 (y + y^2 / (2 L)), which elements of order 2 have exactly.
    """
    nu, L = 0.25, 0.5
    y = np.linspace(0.0, 0.4, 2001)
    M = 1e9 / (1 + y / L)
    E = M * (1 + nu) * (1 - 2 * nu) / (1 - nu)
    profile = over("y", kind="table", interpolation="cubic", positions=y.tolist(), values=E.tolist())
    model = block({"poisson_ratio": nu, "young_modulus": profile}, [], order=2)
    at = model.coordinates[:, 1]
    u = np.zeros((model.nodes, 2))
    u[:, 1] = 1e6 / 1e9 * (at + at**2 / (2 * L))
    force = np.zeros(model.nodes * 2)
    operators.create(operator, model.bulk).add_internal_force(u.ravel(), force)
    model.layout.sum_shared(force)
    inside = (at > 1e-9) & (at < 0.4 - 1e-9)
    vertical = force.reshape(-1, 2)[:, 1]
    assert np.abs(vertical[inside]).max(initial=0.0) < 1e-9 * 1e6 * 0.1  # of the force on an element
    top = np.outer(at > 0.4 - 1e-9, [0.0, 1.0]).ravel()
    assert parallel.total(COMM, model.layout.owned_dot(top, force)) == pytest.approx(-1e6 * 0.3, rel=1e-9)


def test_layers() -> None:
    """S and P waves at normal incidence: travel time and transmitted velocity 2 Z_1 / (Z_1 + Z_2)."""
    for plane in ("antiplane", "strain"):
        found = column_of_layers(plane, COMM)
        for name, (exact, value) in found.items():
            assert value == pytest.approx(exact, rel=2e-3), (plane, name)


def test_waves_trapped_in_a_zone() -> None:
    """The period of a Love wave, over a boundary between elements."""
    exact, found = trapped_period(COMM)
    assert found == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("angle", [0.3, 1.2])
def test_waves_at_an_angle_to_fibres(angle: float) -> None:
    """Speeds of the quasi-P and quasi-S wave of the Christoffel equation."""
    for exact, found in anisotropic_speeds(angle, COMM):
        assert found == pytest.approx(exact, rel=1e-4)


def test_dashpots_have_the_local_impedance() -> None:
    """The sum over an edge is the integral of rho c_p and of rho c_s along it."""
    material = {"density": line("y", 1000.0, 3000.0), "c_p": line("y", 2000.0, 4000.0), "c_s": 1000.0}
    without = {"young_modulus": None, "poisson_ratio": None}
    given = {key: value for key, value in {**HOMALITE, **without, **material}.items() if value is not None}
    mesh = Block(columns=3, rows=4, size=0.1)
    case = Case.model_validate({
        "plane": "strain", "order": 4, "duration": 1.0, "mesh": mesh, "materials": {"default": given},
        "boundaries": [{"kind": "absorbing", "edge": "rock.right"}],
    })  # fmt: skip
    model = Model(case, COMM)
    dashpot = Loads(model, case.boundaries).dashpot
    found = [model.layout.owned_dot(np.tile(axis, model.nodes), dashpot) for axis in np.eye(2)]
    found = parallel.total(COMM, np.array(found))
    y = np.polynomial.legendre.leggauss(8)
    at, weight = 0.2 * (y[0] + 1), 0.2 * y[1]
    density, c_p = 2000.0 + 1000 * at, 3000.0 + 1000 * at
    np.testing.assert_allclose(found, [weight @ (density * c_p), weight @ (density * 1000.0)], rtol=1e-9)


def test_radiation_damping_has_the_local_impedance() -> None:
    """mu / (2 c_s) = rho c_s / 2 at every point between equal bodies, in the middle of elements to their accuracy."""
    x = {"density": over("x", kind="table", positions=[0.0, 0.04], values=[1000.0, 1500.0]),
         "c_p": 2200.0, "c_s": over("x", kind="table", positions=[0.0, 0.04], values=[1200.0, 1000.0])}  # fmt: skip
    given = slip_weakening({"plane": "strain"})
    given["materials"] = {"default": {"kind": "isotropic_elastic", **x}}
    model = Model(parse_case(given), COMM)
    fault = model.faults[0]
    at = fault.interface.points[:, 0]
    exact = (1000.0 + 500.0 * at / 0.04) * (1200.0 - 200.0 * at / 0.04) / 2
    np.testing.assert_allclose(radiation_impedance(model, fault), exact, rtol=1e-10)


DP: dict[str, Any] = {
    "kind": "drucker_prager", "cohesion": over("x", kind="table", positions=[0.0, 0.012], values=[1e6, 2e6]),
    "friction_angle": 0.5, "relaxation_time": 1e-7, "density": 1246.0, "poisson_ratio": 0.35,
    "young_modulus": over("y", kind="table", positions=[-4e-3, 4e-3], values=[4e9, 6e9]),
    "initial_stress": [over("y", kind="table", positions=[-4e-3, 4e-3], values=[-7e6, -5e6]), -6e6, -6e6, 0, 0, 0],
}  # fmt: skip
SLS: dict[str, Any] = {
    "kind": "standard_linear_solids", "Q_p": 25.0, "Q_s": 15.0, "lowest_frequency": 5e4, "frequency_ratio": 10.0,
    "density": 1246.0, "poisson_ratio": over("x", kind="table", positions=[0.0, 0.012], values=[0.2, 0.35]),
    "young_modulus": DP["young_modulus"],
}  # fmt: skip
PUSH = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 20.0, "ramp": 1e-6}


@pytest.mark.parametrize("material", [DP, SLS], ids=["drucker_prager", "standard_linear_solids"])
def test_formulas_with_parameters_of_points(material: dict[str, Any]) -> None:
    """The traced formula with parameters is that of a material with the numbers of the point; its tangent too."""
    cls = DruckerPrager if material is DP else StandardLinearSolids
    given = {key: value for key, value in material.items() if key != "kind"}
    whole = cls.model_validate(given)
    random = np.random.default_rng(3)
    points = random.uniform([0.0, -4e-3], [0.012, 4e-3], (5, 2))
    parameters = whole.values_at(points)
    law = traced(whole, "strain")
    strain = {name: 1e-3 * random.normal(size=5) for name in law.components}
    state = {name: 1e-3 * random.normal(size=5) for name in law.state}
    stress, after = law.evaluate(strain, state, 5e-8, parameters)
    tangent = law.tangent(strain, state, 5e-8, parameters)
    for number in range(5):
        numbers = whole.with_values({key: float(value[number]) for key, value in parameters.items()})
        plain = traced(cls.model_validate({k: v for k, v in numbers.model_dump().items() if k != "kind"}), "strain")
        one = [{name: each[number : number + 1] for name, each in rows.items()} for rows in (strain, state)]
        expected, then = plain.evaluate(*one, 5e-8)
        for name, value in expected.items():
            assert stress[name][number] == pytest.approx(value[0], rel=1e-9, abs=1.0)
        for name, value in then.items():
            assert after[name][number] == pytest.approx(value[0], rel=1e-9, abs=1e-15)
        np.testing.assert_allclose(tangent[..., number], plain.tangent(*one, 5e-8)[..., 0], rtol=1e-8, atol=1e2)


@pytest.mark.parametrize("material", [DP, SLS], ids=["drucker_prager", "standard_linear_solids"])
def test_budget_and_ranks_with_memory(material: dict[str, Any]) -> None:
    given = plates({"plane": "strain", "boundaries": [PUSH]})
    given["materials"] = {"default": material}
    found = []
    for comm in (COMM, fem.MPI.COMM_SELF):
        _, motion, state = march(given, 120, comm)
        energy = motion.energies(state)
        work = energy.pop("boundary_work")
        assert sum(energy.values()) == pytest.approx(work, rel=1e-10)
        assert energy["material_dissipation"] > 0.01 * work
        found.append([work, *energy.values()])
    np.testing.assert_allclose(*found, rtol=1e-9, atol=1e-9 * found[0][0])


def test_one_step_on_any_ranks_is_the_same() -> None:
    """Random moduli: the same at a place on any number of ranks, and so is the motion."""
    field = {"kind": "random", "mean": 5.3e9, "standard_deviation": 0.5e9, "correlation_length": 2e-3, "seed": 4}
    given = slip_weakening({"materials.default.young_modulus": field})
    slips = []
    for comm in (COMM, fem.MPI.COMM_SELF):
        model, _, state = march(given, 60, comm)
        face = model.faults[0].interface
        rows = parallel.share_rows(comm, np.column_stack([face.number, state.faults["main"]["slip"]])[face.owned])
        slips.append(rows[np.argsort(rows[:, 0]), 1])
    assert np.abs(slips[0]).max() > 1e-9
    np.testing.assert_allclose(*slips, atol=1e-11 * np.abs(slips[0]).max())


def test_random_fields_in_bodies() -> None:
    """Mean, deviation and exponential correlation over 400 seeds, in two and three dimensions."""
    points = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.18, 0.24], [1.0, 2.0, 2.0]])
    draws = np.array([
        in_body(Random(mean=0.0, standard_deviation=1.0, correlation_length=0.3, seed=seed, modes=64), points)
        for seed in range(400)
    ])  # fmt: skip
    found = draws.T @ draws / 400
    expected = np.exp(-np.linalg.norm(points[:, None] - points, axis=2) / 0.3)  # both neighbours are 0.3 m away
    # Products of 400 pairs have a standard error of about 0.05 to 0.07; clipping lowers variances by 0.3 %.
    np.testing.assert_allclose(found, expected, atol=0.2)
    section = Random(mean=1.0, standard_deviation=0.1, correlation_length=0.3, seed=1)
    flat = np.random.default_rng(0).uniform(size=(9, 2))
    np.testing.assert_allclose(in_body(section, flat), in_body(section, np.column_stack([flat, np.zeros(9)])))


def test_grid_from_a_netcdf_file(tmp_path: Path) -> None:
    """Linear in x and y, with axes in another order and decreasing; nothing outside of the grid."""
    import xarray

    x, y = np.linspace(0.0, 0.012, 4), np.linspace(4e-3, -4e-3, 5)
    values = 5e9 + 1e11 * x[None, :] + 2e11 * y[:, None]
    data = xarray.Dataset({"E": (("y", "x"), values)}, coords={"x": x, "y": y})
    data.to_netcdf(tmp_path / "moduli.nc", engine="h5netcdf")
    grid = {"kind": "grid", "file": "moduli.nc", "variable": "E"}
    given = parse_case(plates({"materials.default.young_modulus": grid}), tmp_path)
    material = given.materials["default"]
    points = np.random.default_rng(0).uniform([0, -4e-3], [0.012, 4e-3], (7, 2))
    np.testing.assert_allclose(material.values_at(points)["young_modulus"], 5e9 + points @ [1e11, 2e11], rtol=1e-12)
    assert Model(given, COMM).variation is not None
    for changes, said in (
        ({"mesh.length": 20e-3}, "x from 0 to 0.012 m does not cover the body, which has points from .* to 0.02 m"),
        ({"materials.default.young_modulus.variable": "G"}, "no variable 'G'; .* E"),
    ):
        with pytest.raises(CaseError, match=said):
            Model(parse_case(merged(plates({"materials.default.young_modulus": grid}), changes), tmp_path), COMM)


def test_a_stress_gauge_has_the_local_stiffness() -> None:
    """A receiver in the stiffer layer: sigma_yy = (lambda + 2 G) e_yy of its place."""
    layers = over("y", kind="layers", boundaries=[0.2], values=[1e9, 4e9])
    model = block({"young_modulus": layers, "poisson_ratio": 0.0}, [], order=2)
    from ruptfx.bodies.space.inside import Inside
    from ruptfx.readings.instruments.model_readings import ModelReadings, SensedPoint

    u = np.zeros((model.nodes, 2))
    u[:, 1] = 1e-3 * model.coordinates[:, 1]
    for y, modulus in ((0.1, 1e9), (0.33, 4e9)):
        point = [0.12, y]
        share = SensedPoint(ModelReadings(model, unstressed), Inside(model, point, None, "here"), point).stress((1, 1))
        total = parallel.total(COMM, share.weights @ u.ravel()[share.places]) if len(share.places) else (
            parallel.total(COMM, 0.0))  # fmt: skip
        assert float(total) == pytest.approx(1e-3 * modulus, rel=1e-9)


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"young_modulus": over("y", kind="table", positions=[0.0, 1.0], values=[1e9, 2e9])},
         "materials.default.young_modulus: the table from 0 to 1 m does not cover .* extend = true"),
        ({"young_modulus": over("y", kind="table", positions=[-1.0, 1.0], values=[-1e12, 1e12])},
         r"young_modulus = -4\S* at position .*: input should be greater than 0; change the profile"),
        ({"young_modulus": {"kind": "boxcar", "inside": 1e9, "outside": 2e9, "center": 0.0, "half_width": 1e-3}},
         "boxcar varies along an interface; in bodies use { kind = 'along_axis'"),
        ({"young_modulus": over("z", kind="layers", boundaries=[0.0], values=[1e9, 2e9])}, "the bodies have 2 dim"),
    ],
)  # fmt: skip
def test_refused_profiles(changes: dict[str, Any], said: str) -> None:
    """Every rank raises; the message names the key."""
    given = plates({f"materials.default.{key}": value for key, value in changes.items()})
    given["materials"] = {"upper": given["materials"]["default"], "default": given["materials"]["default"]}
    with pytest.raises(CaseError, match=said.replace("materials.default", "materials.(lower|upper)")):
        Model(parse_case(given), COMM)


def test_values_that_contradict_each_other_are_refused() -> None:
    """Drucker-Prager bodies beyond yield at one end only."""
    given = plates({"plane": "strain"})
    weak = {"cohesion": over("x", kind="table", positions=[0.0, 0.012], values=[1e6, 0.0]), "friction_angle": 0.0,
            "initial_stress": [-6e6, -6e6, -6e6, 0.5e6, 0, 0]}  # fmt: skip
    given["materials"] = {"default": {**DP, **weak}}
    with pytest.raises(CaseError, match=facts(r"initial_stress: beyond yield, sqrt\(J2\) = 5e\+05 Pa")):
        Model(parse_case(given), COMM)


def test_fracture_needs_uniform_bodies() -> None:
    said = r"materials.default.young_modulus.*: materials are uniform in bodies that break; give a number"
    with pytest.raises(CaseError, match=said):
        parse_case(torn({"materials.default.young_modulus": constant(5e9)}))


def test_incident_waves_need_a_uniform_edge() -> None:
    wave = {"kind": "incident_wave", "edge": "lower.bottom", "wave": "S", "direction": [0.0, 1.0], "velocity": 1.0,
            "history": {"kind": "ricker", "frequency": 3e5, "delay": 4e-6}}  # fmt: skip
    given = plates({"boundaries": [wave], "materials.default.young_modulus": constant(5e9)})
    with pytest.raises(CaseError, match=facts(r"boundaries\.0\.edge = 'lower\.bottom'.* vary")):
        Model(parse_case(given), COMM)


def test_a_fluid_is_refused_with_its_points(tmp_path: Path) -> None:
    """c_s falls from 1200 m/s at y = -4 mm to 0 at y = 2 mm and above, where 2 x 7 nodes are."""
    speeds = over("y", kind="table", positions=[-4e-3, 2e-3, 4e-3], values=[1200.0, 0.0, 0.0])
    table = plates({"plane": "strain", "order": 1, "materials.default": {
        "kind": "isotropic_elastic", "density": 1246.0, "c_p": 2100.0, "c_s": speeds}})  # fmt: skip
    message = r"materials\.upper: c_s = \S+ m/s, .* at 14 points, the first at \(0, 0\.002\) m; give"
    with pytest.raises(CaseError, match=message) as refused:
        Model(parse_case(table), COMM)
    assert "young_modulus" not in str(refused.value) and "poisson_ratio" not in str(refused.value)
    lifted = {**speeds, "profile": {**speeds["profile"], "values": [1200.0, 100.0, 100.0]}}
    Model(parse_case(merged(table, {"materials.default.c_s": lifted})), COMM)  # the remedy
    slow = {**speeds, "profile": {**speeds["profile"], "values": [1200.0, 2000.0, 2000.0]}}
    with pytest.raises(CaseError, match=facts(r"materials\.upper: c_p = 2100 m/s .* = 2\d+\.?\d* m/s")):
        Model(parse_case(merged(table, {"materials.default.c_s": slow})), COMM)
