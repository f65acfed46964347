"""Bodies of revolution: Lamé's cylinders, waves along a bar, what lies on the axis, friction round a fibre."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv

pytest.importorskip("dolfinx")

from helpers.small_cases import march
from scipy.sparse import diags
from scipy.sparse.linalg import eigsh, spsolve

from ruptfx import RuptfxError
from ruptfx.app.convert import vtk_files
from ruptfx.bodies.operators.assembled import stiffness_form
from ruptfx.bodies.space.axisymmetry import on_axis
from ruptfx.bodies.spectrum import highest_frequency
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.platform import fem
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.results.analysis.polariscope import Camera
from ruptfx.run.model import Model
from ruptfx.run.recording.bulk_fields import BulkFields
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

E, NU, RHO = 70e9, 0.25, 2500.0
LAME, SHEAR = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
ELASTIC = {"kind": "isotropic_elastic", "young_modulus": E, "poisson_ratio": NU, "density": RHO}
HELD = [
    {"kind": "driven", "edge": f"{body}.{side}", "component": "x", "velocity": 0.0}
    for body in ("fibre", "matrix") for side in ("left", "right")
]  # fmt: skip


def case(mesh: dict[str, Any], boundaries: list[Any], order: int = 4, **changes: Any) -> Any:
    table = {
        "plane": "axisymmetric", "order": order, "duration": 1e-6,
        "mesh": {"kind": "fibre_in_matrix", "radius": 2e-3, "outer_radius": 5e-3, "length": 4e-3,
                 "element_size": 1e-3, **mesh},
        "materials": {"default": ELASTIC}, "boundaries": boundaries,
        "faults": {"main": {"contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 0.3},
                            "initial_stress": {"normal": 10e6}}},
        "output": {"figures": False}, **changes,
    }  # fmt: skip
    return parse_case(table)


def fibre(mesh: dict[str, Any], boundaries: list[Any], order: int = 4) -> Model:
    return Model(case(mesh, boundaries, order))


def stiffness(model: Model) -> Any:
    return fem.local_matrix(stiffness_form(model.bulk)).tocsc()


def cylinders() -> tuple[Model, np.ndarray, dict[str, tuple[float, float]]]:
    """Lamé: u_r = A r + B / r of two bodies that are not in contact, whose ends do not move along the axis.

    The model, its displacement, and A and B of every body.
    """
    inside, outside = 30e6, 20e6
    model = fibre({"hole": 0.8e-3, "element_size": 0.4e-3}, [
        *HELD, {"kind": "traction", "edge": "fibre.bottom", "traction": [0.0, inside]},
        {"kind": "traction", "edge": "matrix.top", "traction": [0.0, -outside]},
    ])  # fmt: skip
    free = ~model.loads.prescribed
    u = np.zeros(len(free))
    u[free] = spsolve(stiffness(model)[free][:, free], model.loads.force(1.0)[free])
    constants = {}
    for body, (a, b, p_a, p_b) in {"fibre": (0.8e-3, 2e-3, inside, 0.0), "matrix": (2e-3, 5e-3, 0.0, outside)}.items():
        A = (p_a * a**2 - p_b * b**2) / (2 * (LAME + SHEAR) * (b**2 - a**2))
        constants[body] = A, (p_a - p_b) * a**2 * b**2 / (2 * SHEAR * (b**2 - a**2))
    return model, u, constants


def test_cylinders_under_pressure() -> None:
    model, u, constants = cylinders()
    r, found = model.coordinates[:, 1], u.reshape(-1, 2)
    for body, (A, B) in constants.items():
        here = model.layout.body == model.bodies.names.index(body)
        exact = A * r[here] + B / r[here]
        np.testing.assert_allclose(found[here, 1], exact, rtol=0, atol=2e-5 * np.abs(exact).max())
        assert np.abs(found[here, 0]).max() < 2e-5 * np.abs(exact).max()


def test_stresses_of_cylinders_under_pressure() -> None:
    """Lamé: radial and hoop stress 2 (lambda + G) A -+ 2 G B / r^2, in snapshots and at receivers; the hoop strain."""
    model, u, constants = cylinders()
    state, bulk = model.initial_state(), BulkFields(model)
    state.displacement[:] = u
    stress, topology = bulk.gather(state)["stress"], bulk.topology()
    points, body = topology.points, topology.body
    plates = ModelReadings(model, bulk.initial_stress.at)
    assert list(plates.entries) == ["xx", "yy", "xy", "zz"] and stress.shape == (len(points), 4)
    for (name, (A, B)), at in zip(constants.items(), (1.3e-3, 3.1e-3), strict=True):
        here = body == model.bodies.names.index(name)
        mean, swing = 2 * (LAME + SHEAR) * A, 2 * SHEAR * B / points[here, 1] ** 2
        largest = np.abs(mean + swing).max()
        exact = np.stack([2 * LAME * A + 0 * swing, mean - swing, 0 * swing, mean + swing], axis=1)
        # At the inner edge, in elements half of whose radius wide.
        np.testing.assert_allclose(stress[here], exact, rtol=0, atol=3e-3 * largest)
        place = plates.point([1.7e-3, at], name, "receiver")
        for share, value in (
            (place.stress((2, 2)), mean + 2 * SHEAR * B / at**2), (place.stress((1, 1)), mean - 2 * SHEAR * B / at**2),
            (place.strain((2, 2)), A + B / at**2),
        ):  # fmt: skip
            assert u[share.places] @ share.weights == pytest.approx(value, rel=1e-3)


def test_files_have_the_hoop_stress(tmp_path: Any) -> None:
    """A pressure on the matrix: by name in xarray and in ParaView's files; what looks through plates refuses."""
    push = {"kind": "traction", "edge": "matrix.top", "traction": [0.0, -20e6], "ramp": 1e-7}
    gauge = {"kind": "receiver", "name": "ring", "interval": 1e-7, "point": [2e-3, 4e-3]}
    run = simulate(case({}, [push], 2, instruments=[gauge]), tmp_path / "run", progress=False)
    with run as record:
        stress = record.bulk.stress
        assert list(stress.stress_component.values) == ["xx", "yy", "xy", "zz"]
        assert stress.attrs["long_name"].endswith("zz goes round the axis")
        here = np.argmin(np.hypot(*(record.bulk.points.values - [2e-3, 4e-3]).T))
        hoop = float(stress.sel(stress_component="zz")[-1, here])
        assert hoop < -1e5
        assert {"stress_zz", "strain_zz"} <= set(record.instruments["ring"].data_vars)
        with pytest.raises(RuptfxError, match=f"^{record.path}: "):
            Camera(1e6, 1e-7, 1e-3).film(record)
        vtk = {path.name: path for path in vtk_files.whole(record, tmp_path)}
        with h5py.File(vtk["bulk.vtkhdf"]) as file:
            tensors = file["VTKHDF/PointData/stress"][:]
            assert tensors.shape[1] == 6 and tensors[-len(record.bulk.points) + here, 2] == hoop
    assert 'Name="stress_zz"' in (tmp_path / "run" / "bulk.xdmf").read_text()


def pochhammer(k: float, a: float) -> float:
    """Frequency [rad/s] of the first longitudinal mode of a free cylinder: Pochhammer (1876), Chree (1889)."""
    c_p, c_s = np.sqrt((LAME + 2 * SHEAR) / RHO), np.sqrt(SHEAR / RHO)

    def equation(omega: float) -> float:
        p, q = (np.sqrt(complex((omega / c) ** 2 - k**2)) for c in (c_p, c_s))
        value = (
            2 * p / a * (q**2 + k**2) * jv(1, p * a) * jv(1, q * a) - (q**2 - k**2) ** 2 * jv(0, p * a) * jv(1, q * a)
            - 4 * k**2 * p * q * jv(1, p * a) * jv(0, q * a)
        )  # fmt: skip
        return float(value.real)

    bar = k * np.sqrt(E / RHO)
    return brentq(equation, 0.9 * bar, 0.9999 * bar, rtol=1e-13)


def bar_mode(order: int, size: float) -> float:
    """The same from K v = omega^2 M v of a cylinder of half a wavelength whose ends stay plane."""
    length, a = 8e-3, 2e-3
    model = fibre({"length": length, "element_size": size}, HELD, order)
    here = np.repeat(model.layout.body == model.bodies.names.index("fibre"), 2)
    keep = np.flatnonzero(here & ~model.loads.prescribed)
    assert model.mass.min() > 0
    omega = pochhammer(np.pi / length, a)
    K, M = stiffness(model)[keep][:, keep], diags(model.mass[keep]).tocsc()
    return float(np.sqrt(eigsh(K, 1, M, sigma=0.97 * omega**2)[0][0]) / omega)


@pytest.mark.parametrize("order", [2, 4])
def test_waves_along_a_bar(order: int) -> None:
    """Fourth order: what nodes on the axis gain of the mass moves those next to it by h^2, in a volume of h^2."""
    coarse, fine = (abs(bar_mode(order, size) - 1) for size in (2e-3, 1e-3))
    assert fine < (5e-6 if order == 4 else 3e-4) and np.log2(coarse / fine) > 3.8


def test_nodes_on_the_axis_do_not_shorten_the_step() -> None:
    solid, hollow = (2 / highest_frequency(fibre({"hole": hole}, HELD)) for hole in (0.0, 1e-3))
    assert solid > 0.98 * hollow


def test_springs_go_round_the_axis() -> None:
    """A foundation of k per area around the matrix: 1 m outwards takes k 2 pi R L of force; R = 5 mm, L = 4 mm."""
    springs = {"kind": "spring", "edge": "matrix.top", "normal": 3e9, "tangential": 1e9}
    model = fibre({}, [springs])
    for axis, stiffness_per_area in enumerate((1e9, 3e9)):
        moved = np.tile(np.eye(2)[axis], model.nodes)
        force = np.zeros_like(moved)
        model.loads.add_support_force(moved, force)
        sums = force.reshape(-1, 2).sum(axis=0)
        assert sums[axis] == pytest.approx(-stiffness_per_area * 2 * np.pi * 5e-3 * 4e-3, rel=1e-12)
        assert abs(sums[1 - axis]) < 1e-12 * abs(sums[axis])


def test_mass_is_that_of_the_cylinders() -> None:
    model = fibre({}, [], 3)
    total = np.pi * 5e-3**2 * 4e-3 * RHO
    assert model.mass[1::2].sum() == pytest.approx(total, rel=1e-13)


@pytest.mark.parametrize("operator", ["matrix_free", "ufl_form"])
def test_energy_and_force_of_a_fibre_that_is_pulled(operator: str) -> None:
    """Explicit steps with slip: the budget closes, and friction on all of the interface is 2 pi R L mu p."""
    pull = {"kind": "driven", "edge": "fibre.left", "component": "x", "velocity": -1.0, "ramp": 0.5e-6}
    model, motion, state = march(case({}, [pull, HELD[2]], 3, operator=operator, duration=8e-6))
    energy = motion.energies(state)
    found = sum(value for name, value in energy.items() if name != "boundary_work")
    assert energy["frictional_dissipation"] > 0.05 * energy["boundary_work"]
    assert found == pytest.approx(energy["boundary_work"], rel=1e-10)
    axis = on_axis(model.coordinates)
    assert axis.any() and not state.displacement.reshape(-1, 2)[axis, 1].any()
    fault = model.faults[0]
    assert fault.interface.weight[fault.interface.owned].sum() == pytest.approx(2 * np.pi * 2e-3 * 4e-3, rel=1e-13)


def test_stresses_have_the_strain_around_the_axis() -> None:
    """u_r = A r: xx = 2 lambda A, yy = zz = 2 (lambda + G) A everywhere, on the axis, in snapshots and at points."""
    model, A = fibre({}, [], 3), 1e-4
    displacement, state = np.zeros((model.nodes, 2)), model.initial_state()
    displacement[:, 1] = A * model.coordinates[:, 1]
    bulk = BulkFields(model)
    expected = np.array([2 * LAME * A, 2 * (LAME + SHEAR) * A, 0.0, 2 * (LAME + SHEAR) * A])
    found = bulk.nodal.stress(displacement.ravel(), state)
    np.testing.assert_allclose(found, np.tile(expected, (model.nodes, 1)), rtol=0, atol=1e-9 * expected[1])
    plates = ModelReadings(model, bulk.initial_stress.at)
    for radius, body in ((0.0, "fibre"), (1.3e-3, "fibre"), (4e-3, "matrix")):
        point = plates.point([1.7e-3, radius], body, "test")
        for entry, stress in (((0, 0), expected[0]), ((1, 1), expected[1]), ((2, 2), expected[3])):
            share = point.stress(entry)
            assert displacement.ravel()[share.places] @ share.weights == pytest.approx(stress, rel=1e-9)


def test_what_cannot_be() -> None:
    plates = {"kind": "two_plates", "length": 4e-3, "height": 1e-3, "element_size": 1e-3}
    with pytest.raises(CaseError, match=r"plane = 'axisymmetric'"):
        Model(case({}, []).changed("mesh", plates))
    with pytest.raises(CaseError, match=r"^faults\.\w+:"):
        Model(case({}, []).changed("mesh", {**plates, "kind": "block_on_rigid"}))
