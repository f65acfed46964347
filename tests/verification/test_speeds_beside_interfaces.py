"""Moduli and wave speeds of scalars are those beside the interface, at its points and in its directions."""

import json
import re

import numpy as np
import pytest
from helpers.crack_cases import GRANITE, block
from helpers.sliding_cases import STIFF, rough, wave
from helpers.small_cases import HOMALITE, branched, case, plates

pytest.importorskip("dolfinx")

from ruptfx import Record
from ruptfx.app.checks.preflight import preflight
from ruptfx.case import parse_case
from ruptfx.interfaces.faults.sides import sides_of
from ruptfx.interfaces.mechanisms.checks.plausibility import doubts
from ruptfx.interfaces.mechanisms.checks.sliding import _driven_slip
from ruptfx.interfaces.sliding.roughness import roughness
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic, rayleigh_speed
from ruptfx.many_runs.study.harvest import harvest, scalars
from ruptfx.platform import fem
from ruptfx.results.analysis.compression import slowest
from ruptfx.results.analysis.verdict import verdict
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate
from ruptfx.stepping.steppers.quasi_static import slip_to_resolve

pytestmark = pytest.mark.fem

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


@pytest.mark.parametrize("angle", [0.0, np.pi / 2])
def test_antiplane_waves_along_the_interface_and_shear_across_it(angle):
    """G_13 = 5 GPa along the fibres, G_23 = 9 / 2.8 GPa across them."""
    along, across = (5e9, 9e9 / 2.8) if angle == 0 else (9e9 / 2.8, 5e9)
    changes = {"plane": "antiplane", "faults.main.contact": {"kind": "split_node"}}
    _, sides = beside(changes | {"materials.default": WOVEN | {"angle": angle}})
    np.testing.assert_allclose(sides.speeds(), np.sqrt(along / 1600.0), rtol=1e-9)
    np.testing.assert_allclose(sides.modulus, across, rtol=1e-9)


@pytest.mark.slow
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
    for name, (value, judged) in plain.items():
        assert away[name] == ((pytest.approx(value, rel=1e-9) if isinstance(value, float) else value), judged), name
    name = "faults.main: critical half-length"
    assert beside_it[name][0] == pytest.approx(0.1 * plain[name][0], rel=1e-9)
    speed = "faults.main: generalized Rayleigh speed"
    assert plain[speed][0] == pytest.approx(rayleigh_speed(2202.0, 1255.0), rel=1e-3)


def front(speed, changes):
    """Plates on which friction falls behind a front that runs from x = 0 at a prescribed speed."""
    table = plates({
        "plane": "strain", "duration": 26e-6, "mesh.length": 60e-3, "mesh.height": 16e-3, "mesh.left": 0.0, "order": 3,
        "stepper": {"kind": "leapfrog", "time_step": 1e-7},
        "faults.main.contact": {"kind": "split_node"},
        "faults.main.friction": {
            "kind": "time_weakening", "mu_s": 2.0, "mu_d": 0.1, "t_w": 4e-6,
            "arrival": {"kind": "cone", "center": 0.0, "slope": 1 / speed},
        },
        "faults.main.initial_stress": {"normal": 6e6, "shear": 2.4e6},
    })  # fmt: skip
    for key, value in changes.items():
        table["materials"]["default"] = table["materials"]["default"] | {key: value}
    return table


@pytest.mark.slow
def test_the_regime_is_that_of_the_bodies_at_the_interface(tmp_path):
    """A front at 1000 m/s between plates with c_s = 1255 m/s; soft strips 12 mm away, with c_s = 545 m/s."""
    strips = {"young_modulus": layers("y", [-12e-3, 12e-3], [1e9, 5.3e9, 1e9])}
    found = []
    for name, changes in (("plain", {}), ("strips", strips)):
        with simulate(parse_case(front(1000.0, changes)), tmp_path / name, progress=False) as record:
            found.append(record.summary)
    c_s = np.sqrt(5.3e9 / 2.7 / 1246.0)
    for summary in found:
        assert summary["speed_regime"] == "sub-Rayleigh" and summary["not_resolved"] is None
        assert summary["tip_speed_over_c_s"] == pytest.approx(summary["tip_speed"] / c_s, rel=1e-9)
    assert found[1]["tip_speed_over_c_s"] == pytest.approx(found[0]["tip_speed_over_c_s"], rel=1e-4)


def test_the_order_of_the_interfaces_changes_nothing(tmp_path):
    """The branch slips less than the main fault: the summary, the figures and the verdict are of the main fault."""
    table, found = branched({"duration": 4e-6}), []
    for names in (("main", "branch"), ("branch", "main")):
        parsed = parse_case(table | {"faults": {name: table["faults"][name] for name in names}})
        with simulate(parsed, tmp_path / names[0], progress=False) as record:
            assert record.interface.attrs["fault"] == "main" and list(record.interfaces) == list(names)
            largest = {name: float(np.abs(data["slip"].values).max()) for name, data in record.interfaces.items()}
        found.append(json.loads((tmp_path / names[0] / "summary.json").read_text()))
    numbers = [{key: value for key, value in each.items() if key not in ("wall_time", "node_updates_per_second")}
               for each in found]  # fmt: skip
    assert numbers[0] == numbers[1]
    summary = found[0]
    assert summary["interface"] == "main" and largest["main"] > largest["branch"] > 0
    assert {name: each["max_slip"] for name, each in summary["interfaces"].items()} == pytest.approx(largest)
    for name in ("mode", "tip_speed", "reach", "max_slip"):
        assert summary[name] == summary["interfaces"]["main"][name]
    assert verdict(summary).startswith("main: ")
    values = harvest(tmp_path / "main", ["run"])
    assert values["interfaces.branch.max_slip"] == pytest.approx(largest["branch"])
    assert "interfaces.branch.max_slip" in scalars(table["faults"])


def test_the_speed_of_an_interface_is_that_of_its_mean_slowness(tmp_path):
    """Half of it between plates of 5.3 and half of 2 GPa."""
    changes = {"duration": 1e-7, "materials.default.young_modulus": layers("x", [6e-3], [5.3e9, 2e9])}
    with simulate(case(changes), tmp_path / "run", progress=False) as record:
        data = record.interface
        for name in ("c_p", "c_s", "c_R"):
            assert np.ptp(data[name].values) > 0.3 * data[name].values.max()
            assert data.attrs[name] == pytest.approx(1 / np.mean(1 / data[name].values), rel=1e-12)


def test_a_run_of_an_earlier_version_opens(tmp_path):
    """Without columns of speeds and without `interface` in the summary it has the numbers of its attributes."""
    import h5py

    with simulate(parse_case(front(1000.0, {})), tmp_path / "run", progress=False) as record:
        expected = dict(record.summary)
    path = tmp_path / "run" / "interface.h5"
    with h5py.File(path, "a") as file:
        for name in ("shear_modulus", "c_p", "c_s", "c_R", "fastest_wave"):
            del file[name]
    with Record(tmp_path / "run", checks=False) as old:
        from ruptfx.results.analysis import summarise

        found = summarise(old)
    for name in ("tip_speed_over_c_R", "tip_speed_over_c_s", "tip_speed_over_c_l"):
        assert found[name] == pytest.approx(expected[name], rel=1e-9)


def test_cracks_have_the_waves_of_the_bodies_beside_facets(tmp_path):
    """c_s = sqrt(E / (2 (1 + nu) rho)); the upper body has 4 times the density, and S waves half as fast."""
    mesh = {"kind": "triangles", "width": 4e-3, "height": 8e-3, "element_size": 2e-3, "divide": 4e-3, "turn": 0.2}
    upper = {**GRANITE, "density": 4 * 2600.0}
    table = block({"mesh": mesh, "materials.upper": upper, "duration": 1e-7, "boundaries": []})
    simulate(parse_case(table), tmp_path / "run", progress=False)
    c_s = np.sqrt(50e9 / 2.5 / 2600)
    with Record(tmp_path / "run") as record:
        speeds = dict(zip(record.cracks.attrs["bodies"], record.cracks.attrs["c_s_of_bodies"], strict=True))
        assert speeds == {"lower": pytest.approx(c_s, rel=1e-12), "upper": pytest.approx(c_s / 2, rel=1e-12)}
        assert slowest(record.cracks, "c_s") == pytest.approx(c_s / 2, rel=1e-12)
        # nu = 1/4: (c_R / c_s)^2 = 2 - 2 / sqrt(3)
        assert slowest(record.cracks, "c_R") == pytest.approx(c_s / 2 * np.sqrt(2 - 2 / np.sqrt(3)), rel=1e-9)


def far_strips(changes):
    """A tenth of the stiffness at |y| > 2 mm of plates 12 mm long and 4 mm high."""
    return {"materials.default.young_modulus": layers("y", [-2e-3, 2e-3], [0.53e9, 5.3e9, 0.53e9]), **changes}


@pytest.mark.parametrize("far", [False, True])
def test_slip_that_relaxes_the_normal_stress_of_the_bodies_beside_the_interface(far):
    """A fiftieth of 0.01 L sigma / G with L = 12 mm, sigma = 6 MPa, G = 5.3 / 2.7 GPa, whatever is 2 mm away."""
    changes = {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.5}}
    model = Model(case(far_strips(changes) if far else changes), COMM)
    assert slip_to_resolve(model, model.faults[0]) == pytest.approx(0.02 * 0.01 * 12e-3 * 6e6 / (5.3e9 / 2.7), rel=1e-9)


def test_strains_are_those_of_the_bodies_beside_the_interface():
    """rho c_p^2 = E / (1 - nu^2) = 6.04 GPa carries 200 MPa by 3.3 %; strips of 0.604 GPa, 2 mm away, do not count."""

    def doubted(changes):
        loaded = changes | {"faults.main.initial_stress.normal": 200e6}
        return [each.quantity for each in doubts(Model(case(loaded), COMM)) if "initial_stress" in each.quantity]

    assert doubted(far_strips({})) == []
    assert doubted({"materials.default.young_modulus": 2.65e9}) == ["faults.main.initial_stress"]  # 6.6 %


def test_rough_surfaces_have_the_modulus_beside_them():
    """1 / E* = (1 - nu^2) / E of 5.3 and 3.392 GPa with nu = 1/4, without the soft upper half of the upper body."""
    strip = {"kind": "along_axis", "axis": "y",
             "profile": {"kind": "layers", "boundaries": [0.3e-3], "values": [5.3e9, 1e9]}}  # fmt: skip
    parsed = parse_case(rough({"materials.upper": STIFF | {"young_modulus": strip}}))
    model = Model(parsed, COMM)
    found = roughness(model, parsed.mesh, model.faults[0], [(0.0, model.loads)])
    assert found is not None and found.modulus == pytest.approx(1 / (0.9375 * (1 / 5.3e9 + 1 / 3.392e9)), rel=1e-9)


def test_a_rough_base_is_rigid():
    """Only the block counts: E* = 5.3 / 0.9375 GPa in plane strain, and E in plane stress."""
    for plane, modulus in (("strain", 5.3e9 / 0.9375), ("stress", 5.3e9)):
        changes = {"plane": plane, "mesh": {
            "kind": "block_on_rigid", "length": 1.2e-3, "height": 0.5e-3, "element_size": 0.1e-3,
            "base": {"profile": wave(-1), "length": 2.4e-3, "left": -0.6e-3},
        }, "materials": {"default": STIFF}, "boundaries": []}  # fmt: skip
        parsed = parse_case(rough(changes))
        model = Model(parsed, COMM)
        found = roughness(model, parsed.mesh, model.faults[0], [(0.0, model.loads)])
        assert found is not None and found.modulus == pytest.approx(modulus, rel=1e-9)


def number_in(note, pattern):
    (found,) = re.findall(pattern, note)
    return float(found)


def test_receivers_say_what_the_mesh_carries_in_their_own_body():
    """order c_s / (5 h) with order 4 and h = 2 mm: 400 c_s. A pair in both bodies has the smaller one.

    c_s = sqrt(5.3e9 / 2.7 / 1246) = 1255.2 m/s above and sqrt(2e9 / 2.6 / 1100) = 836.2 m/s below."""
    points = {"above": [5.3e-3, 2.2e-3], "below": [5.3e-3, -2.2e-3]}
    instruments = [{"kind": "receiver", "name": name, "interval": 1e-6, "point": point}
                   for name, point in points.items()]  # fmt: skip
    instruments.append({"kind": "velocimeter", "name": "pair", "interval": 1e-6, "point": points["above"],
                        "relative_to": points["below"], "direction": [1.0, 0.0]})  # fmt: skip
    rows = preflight(case({"materials.lower": SOFT, "instruments": instruments, "duration": 1e-5}))
    found = {row.quantity: number_in(row.note, r"S waves to (\S+) Hz") for row in rows if "highest" in row.quantity}
    expected = {"above": 400 * 1255.2, "below": 400 * 836.2, "pair": 400 * 836.2}
    assert found == {f"instruments.{name}: highest frequency": pytest.approx(value, rel=5e-3)
                     for name, value in expected.items()}  # fmt: skip


WEAKENING = {"faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 5e-6},
             "faults.main.initial_stress.shear": 3e6}  # fmt: skip
STIFF_IMPEDANCE, SOFT_IMPEDANCE = np.sqrt(1246.0 * 5.3e9 / 2.7), np.sqrt(1100.0 * 2e9 / 2.6)  # rho c_s = sqrt(rho G)


@pytest.mark.parametrize("changes, mobility", [
    ({}, 2 / STIFF_IMPEDANCE), (far_strips({}), 2 / STIFF_IMPEDANCE),
    ({"materials.lower": SOFT}, 1 / STIFF_IMPEDANCE + 1 / SOFT_IMPEDANCE),
    ({"mesh.kind": "block_on_rigid"}, 1 / STIFF_IMPEDANCE),
])  # fmt: skip
def test_the_slip_rate_behind_a_front_radiates_into_the_bodies_beside_it(changes, mobility):
    """V = (3 - 0.2 x 6) MPa (1 / (rho c_s)+ + 1 / (rho c_s)-), a rigid side takes nothing; the shortest time of the law
    is D_c / V."""
    rows = {row.quantity: row for row in preflight(case(WEAKENING | changes))}
    assert rows["faults.main: shortest time"].value == pytest.approx(5e-6 / (1.8e6 * mobility), rel=1e-6)


@pytest.mark.parametrize("changes", [{}, far_strips({})])
def test_records_are_compared_with_the_front_beside_the_interface(changes):
    """A front at c_R of Homalite, whatever is 2 mm away, passes a point in the process zone over c_R."""
    often = {"output.interface_interval": 1e-3, "duration": 1e-2}
    rows = {row.quantity: row for row in preflight(case(WEAKENING | changes | often))}
    passing = number_in(rows["faults.main: interval of records"].note, r"passes a point in (\S+) s")
    c_s = np.sqrt(5.3e9 / 2.7 / 1246.0)
    c_R = rayleigh_speed(np.sqrt(5.3e9 / (1 - 0.35**2) / 1246.0), c_s)
    assert passing == pytest.approx(rows["faults.main: static process zone"].value / c_R, rel=5e-3)


def test_driven_edges_of_both_bodies_slide_them_apart():
    """The upper body goes 10 m/s and the lower one -3 m/s for 2 us: 26 um."""
    parsed = parse_case(rough())
    table = parsed.table()
    next(b for b in table["boundaries"] if b["edge"] == "lower.bottom" and b["component"] == "x")["velocity"] = -3.0
    model = Model(parse_case(table), COMM)
    slip = _driven_slip(model, model.faults[0].interface, 2e-6, model.loads)
    assert slip[0] == pytest.approx(26e-6, rel=1e-12)


def test_echoes_come_with_the_fastest_waves_of_a_body():
    """From the interface to the top and back, 8 mm, at c_p = sqrt(E / (1 - nu^2) / rho), with 53 GPa in a strip."""

    def first_echo(changes):
        found = doubts(Model(case({"duration": 1e-4, **changes}), COMM))
        return next(each.value for each in found if "echo" in each.quantity)

    slow = 8e-3 / np.sqrt(5.3e9 / (1 - 0.35**2) / 1246.0)
    assert first_echo({}) == pytest.approx(slow, rel=1e-6)
    strip = {"materials.default.young_modulus": layers("x", [6e-3], [5.3e9, 53e9])}
    assert first_echo(strip) == pytest.approx(slow / np.sqrt(10), rel=1e-6)
