"""Moduli and wave speeds of scalars are those beside the interface, at its points and in its directions."""

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, case

from ruptfx.app.checks.preflight import preflight
from ruptfx.interfaces.faults.sides import sides_of
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic, rayleigh_speed
from ruptfx.platform import fem
from ruptfx.run.model import Model

COMM = fem.MPI.COMM_SELF
SOFT = HOMALITE | {"young_modulus": 2e9, "poisson_ratio": 0.3, "density": 1100.0}
WOVEN = {"kind": "orthotropic_elastic", "density": 1600.0, "E_1": 130e9, "E_2": 9e9, "nu_12": 0.3, "nu_23": 0.4,
         "G_12": 5e9}  # fmt: skip
BOX = {
    "plane": "solid", "order": 2,
    "mesh": {"kind": "box_with_fault", "fault_length": 4.0, "fault_width": 2.0, "element_size": 1.0, "beyond": 1.0,
             "distance": 1.0},
    "faults.main.contact": {"kind": "split_node"},
}  # fmt: skip


def beside(changes):
    model = Model(case(changes), COMM)
    face = model.faults[0].interface
    return face, sides_of(model, face)


def layers(axis, boundaries, values):
    return {"kind": "along_axis", "axis": axis,
            "profile": {"kind": "layers", "boundaries": boundaries, "values": values}}  # fmt: skip


@pytest.mark.parametrize("plane", ["stress", "strain", "antiplane"])
def test_a_uniform_body_has_its_own(plane):
    changes = {"plane": plane} | ({"faults.main.contact": {"kind": "split_node"}} if plane == "antiplane" else {})
    _, sides = beside(changes)
    expected = IsotropicElastic(**{k: v for k, v in HOMALITE.items() if k != "kind"}).wave_speeds(plane)
    np.testing.assert_allclose(sides.speeds(), np.tile(expected, (len(sides.speeds()), 1)), rtol=1e-10)
    np.testing.assert_allclose(sides.modulus, 5.3e9 / 2.7, rtol=1e-12)
    assert sides.bodies == {name: pytest.approx(expected[:2], rel=1e-12) for name in ("lower", "upper")}


@pytest.mark.parametrize("soft", ["upper", "lower"])
def test_two_bodies_have_the_harmonic_mean_and_the_slower_waves(soft):
    _, sides = beside({f"materials.{soft}": SOFT})
    stiff, other = 5.3e9 / 2.7, 2e9 / 2.6
    np.testing.assert_allclose(sides.modulus, 2 * stiff * other / (stiff + other), rtol=1e-12)
    np.testing.assert_allclose(sides.speeds()[:, 1], np.sqrt(other / 1100.0), rtol=1e-12)
    np.testing.assert_allclose(sides.softer(), other, rtol=1e-12)
    columns = sides.columns()
    np.testing.assert_allclose(columns["fastest_wave"], np.sqrt(5.3e9 / (1 - 0.35**2) / 1246.0), rtol=1e-12)


def test_a_rigid_side_is_the_limit_of_a_stiff_one():
    changes = {"mesh.kind": "block_on_rigid", "materials": {"default": SOFT}}
    _, sides = beside(changes)
    np.testing.assert_allclose(sides.modulus, 2 * 2e9 / 2.6, rtol=1e-12)
    np.testing.assert_allclose(sides.speeds()[:, 1], np.sqrt(2e9 / 2.6 / 1100.0), rtol=1e-12)


def test_strips_away_from_the_interface_do_not_count():
    modulus = layers("y", [-2e-3, 2e-3], [1e9, 5.3e9, 50e9])
    _, sides = beside({"materials.default.young_modulus": modulus})
    _, plain = beside({})
    for name, column in sides.columns().items():
        np.testing.assert_allclose(column, plain.columns()[name], rtol=1e-12)


def test_moduli_along_the_interface_are_those_of_the_points():
    """E jumps from 1 to 5 GPa at x = 6 mm, where two elements meet: the point there has half of each."""
    face, sides = beside({"materials.default.young_modulus": layers("x", [6e-3], [1e9, 5e9])})
    E = np.where(face.position < 5.999e-3, 1e9, np.where(face.position > 6.001e-3, 5e9, 3e9))
    np.testing.assert_allclose(sides.modulus[:, 0, 0], E / 2.7, rtol=1e-9)
    speeds = sides.speeds()
    c_s = np.sqrt(np.array([1e9, 5e9]) / 2.7 / 1246.0)
    np.testing.assert_allclose(speeds[[0, -1], 1], c_s, rtol=1e-9)
    c_p = np.sqrt(np.array([1e9, 5e9]) / (1 - 0.35**2) / 1246.0)
    c_R = [rayleigh_speed(*pair) for pair in zip(c_p, c_s, strict=True)]
    np.testing.assert_allclose(speeds[[0, -1], 2], c_R, rtol=1e-9)


@pytest.mark.parametrize("angle, fast, slow", [(0.0, "E_1", "E_2"), (np.pi / 2, "E_2", "E_1")])
def test_an_anisotropic_body_has_the_waves_along_the_interface(angle, fast, slow):
    """Plane stress: c_l = sqrt(E / (1 - nu_12^2 E_2 / E_1) / rho) with E along the interface, c_s = sqrt(G / rho)."""
    _, sides = beside({"materials.default": WOVEN | {"angle": angle}})
    speeds = sides.speeds()
    shrunk = 1 - 0.3**2 * 9 / 130
    np.testing.assert_allclose(speeds[:, 0], np.sqrt(WOVEN[fast] / shrunk / 1600.0), rtol=1e-9)
    np.testing.assert_allclose(speeds[:, 1], np.sqrt(5e9 / 1600.0), rtol=1e-9)
    np.testing.assert_allclose(sides.modulus, 5e9, rtol=1e-9)
    assert np.all(speeds[:, 2] < speeds[:, 1])


def test_a_surface_has_moduli_and_waves_in_two_directions():
    """Fibres along x, the strike: slip along it shears 1 and 2, slip down dip 2 and 3; SH waves travel down dip with
    G_23, and along strike the slower ones with G_12 = G_13."""
    G_23 = 9e9 / 2.8
    _, sides = beside(BOX | {"materials.default": WOVEN})
    np.testing.assert_allclose(sides.modulus, np.tile(np.diag([5e9, G_23]), (len(sides.modulus), 1, 1)), atol=1.0)
    columns = sides.columns()
    np.testing.assert_allclose(columns["c_s"], np.sqrt(5e9 / 1600.0), rtol=1e-9)
    np.testing.assert_allclose(columns["c_s_dip"], np.sqrt(G_23 / 1600.0), rtol=1e-9)


@pytest.mark.parametrize("changes", [{}, {"mesh.half": True}])
def test_moduli_of_a_surface_follow_the_depth(changes):
    modulus = {"kind": "along_axis", "axis": "z",
               "profile": {"kind": "table", "positions": [-10.0, 0.0], "values": [110e9, 10e9]}}  # fmt: skip
    face, sides = beside(BOX | {"materials.default.young_modulus": modulus} | changes)
    expected = (10e9 - 10e9 * face.points[:, 2]) / 2.7
    np.testing.assert_allclose(sides.modulus[:, 0, 0], expected, rtol=1e-8)
    np.testing.assert_allclose(sides.modulus[:, 0, 1], 0.0, atol=1e-3)


def test_check_takes_the_bodies_beside_each_interface():
    """A soft strip away from the interface changes no row on it; one at the interface does.

    The critical half-length is proportional to G* = 2 G (1 - (c_s / c_p)^2), hence to E.
    """
    weakening = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 5e-6}
    loaded = {"faults.main.friction": weakening, "faults.main.initial_stress.shear": 2.8e6}

    def rows(changes):
        found = preflight(case(loaded | changes))
        return {row.quantity: (row.value, row.verdict) for row in found if row.quantity.startswith("faults.main")}

    plain = rows({})
    away = rows({"materials.default.young_modulus": layers("y", [-2e-3, 2e-3], [1e9, 5.3e9, 1e9])})
    beside_it = rows({"materials.upper": HOMALITE | {"young_modulus": 5.3e8}})
    assert away.keys() == plain.keys() and len(plain) > 8
    for name, (value, verdict) in plain.items():
        assert away[name] == ((pytest.approx(value, rel=1e-9) if isinstance(value, float) else value), verdict), name
    name = "faults.main: critical half-length"
    assert beside_it[name][0] == pytest.approx(0.1 * plain[name][0], rel=1e-9)
    speed = "faults.main: generalized Rayleigh speed"
    assert plain[speed][0] == pytest.approx(rayleigh_speed(2202.0, 1255.0), rel=1e-3)
