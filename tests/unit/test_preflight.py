"""What `ruptfx check` says before a run."""

from __future__ import annotations

import math
import re
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.sliding_cases import rough, solids, wave
from helpers.small_cases import COMPLIANT, HOMALITE, SPLIT, case, memory_friction, plates, slip_weakening, two_boxes
from scipy.optimize import brentq

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.app.checks.preflight import preflight
from ruptfx.case import parse_case, read_case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.interfaces.sliding.roughness import _slope

pytestmark = pytest.mark.fem


@pytest.fixture(autouse=True)
def only_costs_are_rehearsed(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory, files and time are measured in steps of the run, of which no other row has anything."""
    if request.node.get_closest_marker("rehearsed") is None:
        monkeypatch.setattr("ruptfx.app.checks.preflight._cost", lambda *_: iter(()))


def rows(table: dict[str, Any]) -> dict[str, Row]:
    return {row.quantity.removeprefix("faults.main"): row for row in preflight(parse_case(table))}


def weakening(**changes: Any) -> dict[str, Row]:
    return rows(slip_weakening({f"faults.main.{key.replace('__', '.')}": value for key, value in changes.items()}))


# Poisson's ratio 0.35 in plane stress acts as 0.35 / 1.35 = 0.259, where the limit of S is 1.81: more than at 0.25.
@pytest.mark.parametrize("ratio, says", [(1.79, "may go supershear"), (1.83, "stays sub-Rayleigh")])
def test_supershear_limit_is_that_of_the_material(ratio: float, says: str) -> None:
    # Strength 3.6 MPa, residual 1.8 MPa.
    found = weakening(initial_stress__shear=1.8e6 + 1.8e6 / (1 + ratio))[": S"]
    assert found.value == pytest.approx(ratio, rel=1e-6)
    assert found.note.startswith(f"{says} (limit 1.81")


def test_springs_on_which_bodies_chatter() -> None:
    """Springs of 1e15 Pa/m make the step of elements of 0.05 mm several times shorter."""

    def warned(stiffness: float, **changes: Any) -> tuple[float, str]:
        springs = {"kind": "compliant", "C_n": stiffness, "C_s": stiffness}
        row = rows(rough({"faults.main.contact": springs, **changes}))[": stable step without springs / with them"]
        return float(row.value), row.verdict

    assert warned(1e13)[1] == "ok" and warned(1e15, damping={"kelvin_voigt": {"fraction": 0.1}})[1] == "ok"
    ratio, verdict = warned(1e15)
    assert verdict == "warning" and ratio > 2
    # The frequency grows with the root of the stiffness.
    assert warned(4e15)[0] == pytest.approx(2 * ratio, rel=0.05)


def test_surfaces_that_slide() -> None:
    """Waves of 10 um and 0.6 mm have slopes up to 2 pi A / wavelength = 0.1047, a little less between nodes."""
    found = rows(rough())
    assert found[": largest slope"].value == pytest.approx(0.1047, rel=0.1)
    # The lower body goes from -0.3 to 2.1 mm, the upper one from 0 to 1.2 mm.
    assert found[": slip until an end leaves"].value == pytest.approx(0.3e-3)
    assert found[": spacing of nodes, plus / minus"].value == pytest.approx(0.1 / (2.4 / 18), rel=1e-2)
    assert {found[key].verdict for key in (": largest slope", ": spacing of nodes, plus / minus")} == {"ok"}
    means = {"output.forces_interval": 0.2e-6}  # its rehearsal takes none
    coarse = {"mesh.lower.element_size": 0.06e-3, "mesh.lower.profile": wave(-1, 25e-6), **means}
    found = rows(rough(coarse))
    assert found[": largest slope"].verdict == found[": spacing of nodes, plus / minus"].verdict == "warning"
    assert "swap plus and minus" in found[": spacing of nodes, plus / minus"].note
    # 2.4 mm of the lower body in five elements of 0.48 mm, below those of 0.1 mm.
    row = rows(rough({"mesh.lower.element_size": 0.48e-3, "mesh.lower.profile": 0.0, **means}))[
        ": spacing of nodes, plus / minus"
    ]
    assert row.verdict == "warning" and "4.8 times coarser" in row.note


def test_an_end_that_edges_drive_off() -> None:
    """0.9 mm of the lower body are in front of the upper one, 0.3 mm behind it; driven by 10 m/s."""
    key = ": slip until an end leaves"
    for duration, way, leaves in ((80e-6, 0.8e-3, False), (100e-6, 1e-3, True)):
        found = rows(rough({"duration": duration}))[key]
        assert found.verdict == ("warning" if leaves else "ok")
        assert (f"but edges drive it by {way:.4g} m" in found.note) == leaves
    table = rough({"duration": 40e-6})
    table["boundaries"][3]["velocity"] = -10.0
    assert rows(table)[key].verdict == "warning"
    # In stages, ways add up.
    table = rough({"duration": 120e-6})
    stages = [{"duration": 60e-6}] * 2
    assert rows({**table, "stages": stages})[key].verdict == "warning"


def test_solids_that_slide() -> None:
    """The upper body is 1.5 x 1 mm from (0, 0), the lower one 2.7 x 2.7 mm from (-0.3, -0.3) mm; the upper one is
    driven by 8 m/s along x and by 6 m/s along y: 0.9 mm of the lower one are before it along x, 1.4 mm along y."""
    means = {"output.forces_interval": 0.2e-6}
    keys = [f": slip until an end leaves along t{k}" for k in (1, 2)]
    for duration, slips, leaves in ((100e-6, (0.8e-3, 0.6e-3), (False, False)),
                                    (150e-6, (1.2e-3, 0.9e-3), (True, False)),
                                    (250e-6, (2.0e-3, 1.5e-3), (True, True))):  # fmt: skip
        found = rows(solids({"duration": duration, **means}))
        for key, slip, away in zip(keys, slips, leaves, strict=True):
            assert found[key].value == pytest.approx(0.3e-3) and found[key].verdict == ("warning" if away else "ok")
            assert (f"edges drive it by {slip:.4g} m" in found[key].note) == away
    assert "to -t1 0.0003 m, to +t1 0.0009 m" in found[keys[0]].note
    assert "to -t2 0.0003 m, to +t2 0.0014 m" in found[keys[1]].note
    assert found[": spacing of nodes, plus / minus"].value == pytest.approx(0.25 / (2.7 / 14))
    assert found[": part of the surface above the opposite one"].value == pytest.approx(1)
    assert found[": largest slope"].value == pytest.approx(0, abs=1e-9)
    back = solids({"duration": 60e-6, **means})  # 0.36 mm to -y, where there is 0.3 mm
    back["boundaries"][5]["velocity"] = -6.0
    assert [rows(back)[key].verdict for key in keys] == ["ok", "warning"]
    # A ball pressed on a plate as wide as itself and driven along x: along y it moves by round-off, and does not leave.
    ball = {"kind": "parabola", "radius": 10e-3, "center": {"x": 0.75e-3, "y": 0.5e-3}}
    along = solids({"mesh.upper.profile": ball, "mesh.curve_order": 2, "mesh.lower.width": 1e-3,
                    "mesh.lower.front": 0.0, **means})  # fmt: skip
    along["boundaries"][5]["velocity"] = 0.0
    along["boundaries"][3] = {"kind": "driven", "edge": "upper.top", "component": "z", "velocity": -2.0}
    assert [rows(along)[key].value for key in keys] == [pytest.approx(0.3e-3), 0.0]
    assert rows(along)[keys[1]].verdict == "ok"
    # Of elements of 0.5 mm along y, with the weights 1/6, 4/6, 1/6, the nodes at -0.7 and -0.45 mm overhang.
    bent = {"kind": "sinusoid", "amplitude": 50e-6, "wavelength": 2e-3}  # 2 pi 50 um / 2 mm = 0.157
    found = rows(solids({"mesh.upper.front": -0.7e-3, "mesh.curve_order": 2, "mesh.lower.profile": bent, **means}))
    assert found[": part of the surface above the opposite one"].value == pytest.approx(7 / 12, rel=0.01)
    assert found[": largest slope"].value == pytest.approx(0.157, rel=0.1)


def test_theory_of_random_roughness_is_for_random_surfaces() -> None:
    """Persson's contact fraction under 20 MPa: not of a ball, nor of crossed waves; E* is that of both bodies."""
    crossed = {"kind": "along_dip", "profile": {"kind": "sinusoid", "amplitude": 1.0, "wavelength": 1e-3}}
    waves = {"kind": "product", "value": {"kind": "sinusoid", "amplitude": 2e-6, "wavelength": 1e-3}, "factor": crossed}
    ball = {"kind": "parabola", "radius": 20e-3, "center": {"x": 0.5e-3, "y": 0.5e-3}}
    random = {"kind": "self_affine_surface", "rms": 2e-6, "hurst": 0.8, "length": 2e-3, "longest": 2e-3,
              "shortest": 1e-3, "seed": 1}  # fmt: skip
    for profile, says in ((ball, False), (waves, False), (random, True),
                          ({"kind": "sum", "terms": [ball, random]}, True)):  # fmt: skip
        found = rows(solids({"mesh.curve_order": 2, "mesh.upper.profile": profile}))
        assert found[": E*"].value == pytest.approx(1 / (0.9375 / 5.3e9 + 0.9375 / 3.392e9), rel=1e-6)
        assert (": contact fraction" in found) == (": mean pressure of contacts" in found) == says
    slope = float(found[": root mean square slope"].value)
    expected = math.erf(20e6 / (math.sqrt(2) * 0.5 * 2.2063e9 * slope))
    assert found[": contact fraction"].value == pytest.approx(expected, rel=1e-3)


def test_theory_of_two_waves() -> None:
    """Opposed waves, together 20 um over 0.6 mm, E* 2.206 GPa: p* 231 MPa, of which the edge brings 20 MPa. In contact
    are (2 / pi) asin(sqrt(20 / 231.0)) = 0.1903 of 0.6 mm, with nodes every 50 um; the peak is 2 sqrt(20 * 231)."""
    found = rows(rough())
    assert found[": p*"].value == pytest.approx(231.0e6, rel=1e-3)
    assert found[": contact fraction"].value == pytest.approx(0.1903, rel=1e-3)
    assert found[": peak pressure"].value == pytest.approx(2e6 * math.sqrt(20 * 231.0), rel=1e-3)
    across = found[": nodes across one contact"]
    assert across.value == pytest.approx(0.1903 * 12, rel=1e-2) and across.verdict == "warning"
    # 12 nodes of the upper, 9 of the lower body.
    assert found[": nodes along the shortest wave"].value == pytest.approx(9, rel=1e-2)
    assert found[": generalized Rayleigh speed"].verdict == "warning"
    # 10 m/s for 2 us, found again every 2.5 um.
    assert found[": updates of the pairing"].value == pytest.approx(8, rel=1e-2)
    slow = rows(rough({"stepper": {"kind": "quasi_static"}, "faults.main.contact": {"kind": "augmented_lagrangian"}}))
    assert ": updates of the pairing" not in slow
    assert slow[": largest slip of an implicit step"].value == pytest.approx(25e-6, rel=1e-2)  # half of 50 um
    # Half of the force where waves are in phase by a quarter: amplitudes 10 and 10 i make 14.1 um.
    shifted = rough({"mesh.upper.profile": {**wave(1), "phase": math.pi / 2}})
    assert rows(shifted)[": p*"].value == pytest.approx(231.0e6 / math.sqrt(2), rel=1e-3)


def test_pressure_of_stages_and_of_driven_edges() -> None:
    table = rough()
    fixed, pressed, driven = table["boundaries"][:2], table["boundaries"][2], table["boundaries"][3]
    less = {**pressed, "traction": [0.0, -5e6]}
    stages = [{"duration": 1e-6, "boundaries": [*fixed, each, driven]} for each in (pressed, less)]
    # 20 MPa at the end of the first stage, 1 us and as long as the ramp.
    found = rows({**table, "stages": stages, "boundaries": []})
    assert "under 2e+07 Pa" in found[": contact fraction"].note
    down = {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": -1.0}
    found = rows({**table, "boundaries": [*fixed, down]})[": contact fraction"]
    assert (found.value, found.note) == ("not known", "the motion of edges presses")
    # A load on the lower body where the upper one is held.
    up = [{**each, "edge": "upper.top"} for each in fixed]
    push = {"kind": "traction", "edge": "lower.bottom", "traction": [0.0, 3e6]}
    # 3 MPa on 2.4 mm press 1.2 mm.
    assert "under 6e+06 Pa" in rows({**table, "boundaries": [*up, push]})[": contact fraction"].note


def test_a_slope_is_the_mean_over_the_length_and_not_over_the_nodes() -> None:
    """A distance that falls by 0.5 over the first of four metres and by nothing over the others: sqrt(0.5^2 / 4)."""
    plus = SimpleNamespace(points=np.array([[0.0, 1.0], [4.0, 1.0]]))
    minus = SimpleNamespace(points=np.array([[0.0, 0.0], [1.0, 0.5], [4.0, 0.5]]))
    assert _slope(plus, minus) == pytest.approx(0.25, rel=1e-12)  # type: ignore[arg-type]


def test_theory_of_a_self_affine_surface() -> None:
    """A root mean square slope s: erf(sqrt(2) p / (E* s)) of it touch."""
    profile = {"kind": "self_affine", "rms": 2e-6, "hurst": 0.8, "length": 1.2e-3, "longest": 1.2e-3,
               "shortest": 0.3e-3, "seed": 2}  # fmt: skip
    found = rows(rough({"mesh.upper.profile": profile, "mesh.lower.profile": 0.0}))
    slope, fraction = found[": root mean square slope"].value, found[": contact fraction"].value
    # Between that of waves of the longest and of the shortest wavelength, 2 pi rms / wavelength.
    assert 0.0105 < slope < 0.0419
    assert fraction == pytest.approx(math.erf(math.sqrt(2) * 20e6 / (2.206e9 * slope)), rel=1e-3)
    assert found[": mean pressure of contacts"].value == pytest.approx(20e6 / fraction, rel=1e-3)
    assert found[": nodes along the shortest wave"].verdict == "warning"  # 6 of the upper, 4.4 of the lower body
    flat = rows(rough({"mesh.upper.profile": 0.0, "mesh.lower.profile": 0.0}))
    assert ": contact fraction" not in flat and ": E*" not in flat


def test_isotropic_formulas_are_estimates_for_other_bodies() -> None:
    fibres = {"kind": "orthotropic_elastic", "E_1": 30e9, "E_2": 5e9, "nu_12": 0.3, "nu_23": 0.3, "G_12": 2e9}
    table = slip_weakening({"materials": {"default": fibres | {"density": 1200.0}}})
    found = rows(table)[": lengths and limits"]
    assert (found.value, found.verdict) == ("estimates", "warning")
    assert ": lengths and limits" not in weakening()


@pytest.mark.parametrize("ratio, says", [(1.1, "may go supershear"), (1.3, "stays sub-Rayleigh")])
def test_supershear_limit_in_3d(ratio: float, says: str) -> None:
    friction = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 5e-6}
    stress = {"normal": 6e6, "shear": 1.8e6 + 1.8e6 / (1 + ratio)}
    changes = {"plane": "solid", "order": 1, "faults.main.friction": friction, "faults.main.initial_stress": stress}
    boxes = case(changes).substituted({"mesh": two_boxes()})
    # A mesh that is no part of a case cannot be written, so there is no run whose cost the last rows could tell.
    found = next(row for row in preflight(boxes) if row.quantity == "faults.main: S")
    assert found.note.startswith(f"{says} (limit 1.19, about")


NUCLEATION = {
    "friction_drop": {"half_width": 1e-3},
    "forced_rupture": {"radius": 1e-3, "speed": 1000.0, "mu_d": 0.1},
    "smooth_patch": {"extra": 1e6, "radius": 1e-3, "rise": 1e-6},
}


@pytest.mark.parametrize("kind", NUCLEATION)
def test_nucleation_off_the_fault_is_an_error(kind: str) -> None:
    def row(center: float) -> Row | None:
        patch = {"kind": kind, "center": center, **NUCLEATION[kind]}
        return weakening(nucleation=[patch]).get(".nucleation.0")

    assert row(16e-3) is None
    found = row(34e-3)  # 2 mm beyond the end
    assert found is not None and found.verdict == "error"
    assert f"{kind} with" in found.note and "center = 0.034" in found.note and "positions 0 to 0.032 m" in found.note


def test_profile_that_varies_nowhere_on_the_fault_is_named() -> None:
    away = {"kind": "boxcar", "inside": 3.7e6, "outside": 2.8e6, "center": 1.0, "half_width": 3e-3}
    found = weakening(initial_stress__shear=away)[".initial_stress.shear"]
    assert (found.value, found.verdict) == (2.8e6, "warning")
    assert "center = 1" in found.note and "positions 0 to 0.032 m" in found.note
    assert ".initial_stress.shear" not in weakening()


def test_what_a_run_refuses_is_refused() -> None:
    with pytest.raises(CaseError, match=facts(r"stop_when\.tip_beyond = 1: no interface reaches")):
        rows(slip_weakening({"stop_when": {"tip_beyond": 1.0}}))


@pytest.mark.parametrize("length, verdict", [(5e-6, "ok"), (5e-8, "warning")])
def test_weakening_slip_over_the_expected_slip_rate(length: float, verdict: str) -> None:
    """Stress drop 3.7 - 1.8 MPa over rho c_s / 2 = 0.782 MPa s/m: 2.43 m/s, so that 5 um take 2.058 us of steps of
    some 0.09 us."""
    found = weakening(friction__D_c=length)[": shortest time"]
    assert found.value == pytest.approx(length / 2.430, rel=1e-3)
    assert "D_c / V at V = 2.43 m/s" in found.note
    assert found.verdict == verdict
    half = {"kind": "boxcar", "inside": 0.5 * length, "outside": length, "center": 16e-3, "half_width": 4e-3}
    assert weakening(friction__D_c=half)[": shortest time"].value == pytest.approx(0.5 * length / 2.430, rel=1e-3)


@pytest.mark.parametrize("time, verdict", [(1e-6, "ok"), (1e-8, "warning")])
def test_memory_shorter_than_the_step(time: float, verdict: str) -> None:
    memory = {"kind": "memory_constant_time", "t_c": time, "law": {"kind": "coulomb", "mu_d": 0.3}}
    found = rows(plates({"faults.main.friction": memory}))[": shortest time"]
    assert found.value == pytest.approx(time, rel=1e-3)
    assert "relaxation of theta_p" in found.note and found.verdict == verdict


def test_driven_edges_set_the_expected_slip_rate() -> None:
    """L_0 = 10 um over the impact speed of 5 m/s; the stress drop is nothing, and L_p is longer."""
    driven = [{"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 5.0}]
    found = rows(plates({"faults.main.friction": memory_friction("P1"), "boundaries": driven}))[": shortest time"]
    assert found.value == pytest.approx(2e-6, rel=1e-12) and found.note == "L_0 / V at V = 5 m/s"


@pytest.mark.parametrize(
    "contact, damped, proposed", [(SPLIT, False, True), (SPLIT, True, False), (COMPLIANT, False, False)]
)
def test_damping_is_proposed_for_split_nodes(contact: dict[str, Any], damped: bool, proposed: bool) -> None:
    table = slip_weakening({"faults.main.contact": contact})
    if damped:
        table["damping"] = {"kelvin_voigt": {"fraction": 0.2}}
    assert (": damping" in rows(table)) == proposed


def test_lengths_of_a_law_that_depends_on_the_slip_rate() -> None:
    """A power law that jumps from r = L_0 / theta_0 = 0.05 m/s to V = 5 m/s, behind a memory that has caught up."""
    driven = [{"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 5.0}]
    found = rows(plates({"faults.main.friction": memory_friction("P1"), "boundaries": driven}))
    # [mu_d + 0.2 exp(-(0.05 / 29)^1.2)] (105 / 100.05)^(1/5) less mu_d + 0.2 exp(-(5 / 29)^1.2), under 6 MPa.
    peak = (0.4 + 0.2 * math.exp(-((0.05 / 29) ** 1.2))) * (105 / 100.05) ** 0.2
    drop = 6e6 * (peak - 0.4 - 0.2 * math.exp(-((5 / 29) ** 1.2)))
    assert f"over a drop of {drop:.4g} Pa, at a slip rate of 5 m/s" in found[": fracture energy"].note
    # 9 pi / 32 G* 2 Gamma / drop^2 with G* = G (1 + nu) = E / 2 in plane stress.
    energy = float(found[": fracture energy"].value)
    zone = 9 * math.pi / 32 * 2.65e9 * 2 * energy / drop**2
    assert found[": static process zone"].value == pytest.approx(zone, rel=1e-9)


def test_a_law_without_a_length_says_so() -> None:
    law = {"kind": "velocity_weakening", "mu_s": 0.6, "mu_d": 0.2, "V_w": 1.0}
    found = rows(plates({"faults.main.friction": law}))[": process zone"]
    assert (found.value, found.note) == ("none", "velocity_weakening has no length of its own")


def test_softening_against_the_stiffness_of_the_contact() -> None:
    """1.8 MPa are lost over D_c, and the springs have 100 GPa/m: 3.6 at 5 um, 0.9 at 20 um."""
    for slip, told in ((5e-6, 3.6), (20e-6, None)):
        law = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": slip}
        found = rows(plates({"faults.main.friction": law})).get(": softening / stiffness")
        assert (found and found.value) == (told and pytest.approx(told))
        assert found is None or found.verdict == "warning"


def test_the_demo_needs_no_warning() -> None:
    demo = read_case(Path(__file__).parents[2] / "demos" / "slip_weakening.toml")
    assert {row.quantity for row in preflight(demo) if row.verdict != "ok"} == set()


def test_cases_without_a_word_pass() -> None:
    assert all(row.verdict == "ok" for row in preflight(case()))


# -- what is hardly meant --------------------------------------------------------------------------------------------


def doubted(changes: dict[str, Any]) -> dict[str, Row]:
    return {row.quantity: row for row in preflight(parse_case(plates(changes))) if row.verdict == "warning"}


@pytest.mark.parametrize(
    "key, value, quantity, note",
    [
        ("materials.default.young_modulus", 5.3, "upper: young_modulus", "less than 1000, that of any solid"),
        ("materials.default.young_modulus", 5.3e13, "upper: young_modulus", "is its exponent lost?"),
        ("materials.default.density", 1.2, "lower: density", "less than 10, that of any solid"),
        # sqrt(5.3 / 2 / 1.35 / 1246) = 0.04 m/s
        ("materials.default.young_modulus", 5.3, "upper: c_s", "less than 1, that of any solid"),
        ("faults.main.initial_stress.normal", 6.0, "faults.main.initial_stress", "hardly pressed together"),
        ("faults.main.initial_stress.normal", 6e8, "faults.main.initial_stress", "strains are not small"),
    ],
)
def test_lost_exponents(key: str, value: float, quantity: str, note: str) -> None:
    found = doubted({key: value})
    assert note in found[quantity].note
    assert quantity not in doubted({})


def test_no_cohesion_is_no_lost_exponent() -> None:
    sand = {
        "kind": "drucker_prager", "young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0, "cohesion": 0.0,
        "friction_angle": 0.6, "relaxation_time": 1e-6, "initial_stress": [-6e6, -6e6, -6e6, 0.0, 0.0, 0.0],
    }  # fmt: skip
    table = {"plane": "strain", "materials.default": sand}
    assert "upper: cohesion" not in doubted(table)
    assert "upper: cohesion" in doubted({**table, "materials.default": {**sand, "cohesion": 5.0}})


PUSHED = {"kind": "traction", "edge": "upper.top", "traction": [0.0, -1e5]}
AROUND = [{"kind": "absorbing", "edge": f"lower.{side}"} for side in ("bottom", "left", "right")]


def test_bodies_that_only_dashpots_hold_drift() -> None:
    """1200 N/m over rho c_p = sqrt(1246 * 8.5062e9) along 12 mm and rho c_s = sqrt(1246 * 1.96296e9) along 2 x 4 mm."""
    pressed = {"plane": "strain", "boundaries": [PUSHED, *AROUND]}
    found = doubted(pressed)["upper, lower: drift along y"]
    assert found.value == pytest.approx(1200 / (12e-3 * 3.25558e6 + 8e-3 * 1.56392e6), rel=1e-4)
    assert [name for name in doubted(pressed) if "drift" in name] == ["upper, lower: drift along y"]


@pytest.mark.parametrize("boundaries", [
    [PUSHED, *AROUND[1:], {"kind": "driven", "edge": "lower.bottom", "component": "y", "velocity": 0.0}],
    [PUSHED, *AROUND[1:], {"kind": "spring", "edge": "lower.bottom", "normal": 1e12}],
    [PUSHED, *AROUND[1:], {"kind": "traction", "edge": "lower.bottom", "traction": [0.0, 1e5]}],
    [{**PUSHED, "history": {"kind": "ricker", "frequency": 1e7, "delay": 2e-7}}, *AROUND],  # a pulse passes
    [{"kind": "incident_wave", "edge": "lower.bottom", "wave": "P", "direction": [0.0, 1.0], "velocity": 1.0,
      "history": {"kind": "ricker", "frequency": 1e5, "delay": 2e-6}}],
], ids=["driven", "spring", "both sides", "pulse", "wave"])  # fmt: skip
def test_bodies_that_are_held_do_not_drift(boundaries: list[dict[str, Any]]) -> None:
    """The first three are the remedies of the message."""
    assert not [name for name in doubted({"plane": "strain", "boundaries": boundaries}) if "drift" in name]


def test_echoes_of_edges_that_reflect() -> None:
    """From the interface to the edge and back with c_p of plane stress, sqrt(E / rho / (1 - nu^2)) = 2201.7 m/s."""
    height = plates()["mesh"]["height"]
    back = 2 * height / 2201.7
    found = rows(plates({"duration": 1.01 * back}))["upper.top: echo"]
    assert found.value == pytest.approx(back, rel=1e-4) and "make the body larger" in found.note
    assert "upper.top: echo" not in rows(plates({"duration": 0.99 * back}))
    absorbing = [{"kind": "absorbing", "edge": "upper.top"}]
    quiet = rows(plates({"duration": 1.01 * back, "boundaries": absorbing}))
    assert "upper.top: echo" not in quiet and "lower.bottom: echo" in quiet


def test_periodic_edges_do_not_reflect() -> None:
    ends = [{"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"} for body in ("upper", "lower")]
    table = plates({"mesh.length": 4e-3, "duration": 4e-5, "boundaries": ends})
    assert {key for key in rows(table) if "echo" in key} == {"upper.top: echo", "lower.bottom: echo"}


@pytest.mark.parametrize("initial", [
    {"faults.main.initial_stress": {"tensor": [6e6, 5e6, 1e6]}},
    {"faults.main.initial_stress": {}, "initial_stress": {"kind": "uniform", "tensor": [6e6, 5e6, 1e6]}},
])  # fmt: skip
def test_a_tensor_with_positive_compression_is_refused(initial: dict[str, Any]) -> None:
    with pytest.raises(CaseError, match=facts(r"initial_stress\.tensor: .*'main'.*5e\+06 Pa")):
        rows(plates({"faults.main.contact": SPLIT, "faults.main.initial_stress": None, **initial}))


def test_echoes_return_with_the_speed_of_their_own_body() -> None:
    """4 mm to and fro: in Homalite with 2201.7 m/s, in aluminium with sqrt(70e9 / 2700 / (1 - 0.33^2)) = 5393.9 m/s."""
    aluminium = {"kind": "isotropic_elastic", "young_modulus": 70e9, "poisson_ratio": 0.33, "density": 2700.0}
    table = plates({"duration": 10e-6, "materials.lower": aluminium})
    found = {key: row for key, row in rows(table).items() if "echo" in key}
    assert found["upper.top: echo"].value == pytest.approx(8e-3 / 2201.7, rel=1e-4)
    assert found["lower.bottom: echo"].value == pytest.approx(8e-3 / 5393.9, rel=1e-4)
    assert sum("make the body larger" in row.note for row in found.values()) == 1


# -- where a fault is judged ------------------------------------------------------------------------------------------

# Below 6 MPa with mu_s 0.677, mu_d 0.525 and a shear of 3.5 MPa, as in TPV3: S = (4.062 - 3.5) / (3.5 - 3.15).
BARRIER = {"kind": "boxcar", "inside": 0.677, "outside": 1e4, "center": 8e-3, "half_width": 6e-3}
S_TPV = 0.562 / 0.35


def where(row: Row) -> float:
    """Position in the note of a row [m]."""
    found = re.search(r"x = ([-+.\de]+) m", row.note)
    assert found is not None, row
    return float(found[1])


@pytest.mark.parametrize("shear", [
    3.5e6, {"kind": "boxcar", "inside": 4.2e6, "outside": 3.5e6, "center": 6e-3, "half_width": 1e-3},
])  # fmt: skip
def test_a_strength_barrier_is_not_where_a_fault_is_judged(shear: Any) -> None:
    """The fault ends at 14 mm of 32 mm: its middle lies in the barrier. Process zone 9 pi / 32 G* D_c / drop."""
    law = {"kind": "linear_slip_weakening", "mu_s": BARRIER, "mu_d": 0.525, "D_c": 5e-6}
    found = rows(slip_weakening({"faults.main.friction": law, "faults.main.initial_stress.shear": shear}))
    assert found[": S"].value == pytest.approx(S_TPV, rel=1e-9)
    assert found[": strength at rest"].value == pytest.approx(4.062e6, rel=1e-9)
    zone = 9 * math.pi / 32 * 2.65e9 * 5e-6 / 0.912e6
    assert found[": static process zone"].value == pytest.approx(zone, rel=1e-3)
    for name in (": S", ": strength at rest", ": static process zone", ": critical half-length"):
        assert 2e-3 - 1e-9 <= where(found[name]) <= 14e-3 + 1e-9
    assert not any("weakest place" in key for key in found)  # it is the same there


def test_the_nucleation_and_the_weakest_place_are_judged() -> None:
    """A rupture starts at 4 mm; between 22 and 26 mm the shear is 3.9 MPa, S = (4.062 - 3.9) / (3.9 - 3.15)."""
    law = {"kind": "linear_slip_weakening", "mu_s": 0.677, "mu_d": 0.525, "D_c": 5e-6}
    shear = {"kind": "boxcar", "inside": 3.9e6, "outside": 3.5e6, "center": 24e-3, "half_width": 2e-3}
    drop = {"kind": "friction_drop", "center": 4e-3, "half_width": 1e-3}
    found = rows(slip_weakening({
        "faults.main.friction": law, "faults.main.initial_stress.shear": shear, "faults.main.nucleation": [drop],
    }))  # fmt: skip
    assert found[": S"].value == pytest.approx(S_TPV, rel=1e-9) and where(found[": S"]) == pytest.approx(4e-3, abs=1e-3)
    weakest = found[", weakest place: S"]
    assert weakest.value == pytest.approx(0.162 / 0.75, rel=1e-9) and 22e-3 <= where(weakest) <= 26e-3
    assert ", weakest place: static process zone" not in found  # the same at both


def test_a_default_material_that_no_body_has() -> None:
    assert "materials.default" not in rows(plates())
    assert "materials.default" not in rows(plates({"materials.upper": HOMALITE}))
    found = rows(plates({"materials.upper": HOMALITE, "materials.lower": HOMALITE}))["materials.default"]
    assert found.verdict == "warning" and "every body has its own: upper, lower; remove it" in found.note


# -- what loads the bodies --------------------------------------------------------------------------------------------


def sampled(times: list[float], values: list[float], **changes: Any) -> Row:
    moved = {"kind": "moved", "edge": "upper.left", "component": "x", "quantity": "velocity", **changes}
    return rows(plates({"boundaries": [{**moved, "times": times, "values": values}]}))["boundaries.0: samples"]


def test_what_the_run_sees_of_samples() -> None:
    """5 us of samples whose largest value comes at 4 us, or just before the end, or after it."""
    row = sampled([0.0, 4e-6, 9e-6], [0.0, 3.0, 1.0])
    assert (row.value, row.verdict) == (3, "ok") and "0 to 3 m/s" in row.note and "upper.left" in row.note
    assert "0 to 3 m/s" in sampled([-2e-6, 0.0, 4e-6, 9e-6], [7.0, 0.0, 3.0, 1.0]).note  # not what is before the run
    # From 0 at 0 s to 6 at 10 us by straight lines (three samples in a row): 3 at 5 us.
    assert "0 to 3 m/s" in sampled([0.0, 10e-6, 20e-6], [0.0, 6.0, 12.0]).note
    assert "0 to 3 m in" in sampled([0.0, 10e-6, 20e-6], [0.0, 6.0, 12.0], quantity="displacement").note


@pytest.mark.parametrize(
    "times, values, verdict",
    [
        ([0.0, 10.0, 60.0], [0.0, 5.0, 9.0], "warning"),  # microseconds read as seconds
        ([0.0, 10e-6, 490e-6], [0.0, 5.0, 9.0], "ok"),  # 98 times the run
        ([0.0, 10e-6, 510e-6], [0.0, 5.0, 9.0], "warning"),  # 102 times
        ([0.0, 1e-6, 4e-6], [0.0, 5.0, 9.0], "warning"),  # ends before the run, moving
        ([0.0, 1e-6, 4e-6], [0.0, 5.0, 0.0], "ok"),  # at rest
        ([6e-6, 7e-6], [5.0, 9.0], "warning"),  # begins after the run
    ],
)
def test_samples_that_are_hardly_meant(times: list[float], values: list[float], verdict: str) -> None:
    assert sampled(times, values).verdict == verdict


def test_samples_of_a_file_are_shown_with_its_name(tmp_path: Path) -> None:
    (tmp_path / "vibrometer.csv").write_text("time (us), velocity (mm/s)\n0, 0\n4, 3\n9, 0\n")
    moved = {"kind": "moved", "edge": "upper.left", "component": "x", "quantity": "velocity", "file": "vibrometer.csv"}
    given = parse_case(plates({"boundaries": [moved]}), tmp_path)
    row = next(row for row in preflight(given) if row.quantity == "boundaries.0: samples")
    assert "upper.left, vibrometer.csv: 0 to 9e-06 s" in row.note and "0 to 0.003 m/s" in row.note
    assert parse_case(given.table()).hash == given.hash  # the file is no part of the resolved case


def test_samples_of_a_history_and_of_stages() -> None:
    history = {"kind": "sampled", "times": [0.0, 1e-6, 2.0], "values": [0.0, 0.5, 1.0]}
    pull = {"kind": "traction", "edge": "upper.top", "traction": [1e3, 0.0], "history": history}
    found = rows(plates({"boundaries": [pull]}))["boundaries.0: samples"]
    assert found.verdict == "warning" and found.value == 3
    short = {**pull, "history": {**history, "times": [0.0, 1e-6, 2e-6]}}
    stages = [{"duration": 2.5e-6}, {"duration": 2.5e-6, "boundaries": [short]}]
    staged = rows(plates({"stages": stages}))
    assert staged["stages.1.boundaries.0: samples"].verdict == "ok"  # a history keeps its last value


def test_rows_of_rate_and_state() -> None:
    """G* = E / 2 in plane stress, sigma = 6 MPa; nodes of order 4 are up to sqrt(3 / 7) mm apart."""
    law = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-6}
    stress = {"faults.main.initial_stress.shear": 3.6e6}
    found = rows(plates({"faults.main.friction": law, **stress}))
    drop = 5.3e9 / 2 * 1e-6 / 6e6  # G* D_c / sigma [m]
    for name, value in {
        ": b - a": 0.005, ": L_b": drop / 0.015, ": points in L_b": drop / 0.015 / (1e-3 * math.sqrt(3 / 7)),
        ": k_c": 0.005 * 6e6 / 1e-6, ": h*": math.pi * drop / 0.005,
        ": nucleation half-length": 0.015 / (math.pi * 0.005**2) * drop,
    }.items():  # fmt: skip
        assert found[name].value == pytest.approx(value, rel=1e-9), name
    assert found[": points in L_b"].verdict == "ok" and "velocity weakening" in found[": b - a"].note
    stable = rows(plates({"faults.main.friction": {**law, "a": 0.02}, **stress}))
    assert stable[": b - a"].value == pytest.approx(-0.005) and "strengthening" in stable[": b - a"].note
    assert not {": k_c", ": h*", ": nucleation half-length"} & set(stable)


def test_points_that_slip_at_once() -> None:
    """0.3 x 6 MPa carry two thirds of 2.7 MPa, at 9 points within 2 mm of the middle, of two elements of order 4."""
    shear = {"kind": "boxcar", "inside": 2.7e6, "outside": 0.0, "center": 6e-3, "half_width": 2e-3}
    friction = {"kind": "coulomb", "mu_d": 0.3}
    found = rows(plates({"faults.main.friction": friction, "faults.main.initial_stress.shear": shear}))
    row = found[": shear / strength"]
    assert row.value == pytest.approx(1.5) and row.verdict == "warning" and "at 9 points" in row.note
    everywhere = rows(plates({"faults.main.friction": friction, "faults.main.initial_stress.shear": 3.6e6}))
    assert everywhere[": shear / strength"].value == pytest.approx(2.0)
    assert "everywhere" in everywhere[": shear / strength"].note
    assert ": shear / strength" not in rows(plates())


def test_the_first_of_steps_that_vary() -> None:
    rigid = {"kind": "augmented_lagrangian"}
    steps = {"stepper": {"kind": "quasi_static", "first_step": 2e-8}, "faults.main.contact": rigid}
    found = rows(plates(steps))
    assert found["first time step"].value == pytest.approx(2e-8) and "time step" not in found
    assert "vary over 5e-06 s" in found["first time step"].note


def test_records_coarser_than_the_process() -> None:
    # Process zone 6.504 mm (above), c_R of plane stress 1155.9 m/s: it passes in 5.63 us.
    for interval, doubt in ((5.5e-6, False), (5.8e-6, True)):
        found = rows(slip_weakening({"output.interface_interval": interval}))
        assert (": interval of records" in found) == doubt


# -- what it costs ---------------------------------------------------------------------------------------------------


@pytest.mark.rehearsed
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"output.bulk_fields": ["velocity"], "output.bulk_precision": "single", "mesh.element_size": 0.5e-3},
        {"output.interface_interval": 0.1e-6},
    ],
)
def test_size_of_files(changes: dict[str, Any], tmp_path: Path) -> None:
    """Within 30 % of what a run leaves."""
    from ruptfx.run.simulation import simulate

    table = plates({"duration": 4e-6, **changes})
    simulate(parse_case(table), tmp_path / "run", progress=False)
    there = sum((tmp_path / "run" / name).stat().st_size for name in ("interface.h5", "bulk.h5", "energy.csv"))
    assert rows(table)["files"].value == pytest.approx(there / 1e6, rel=0.3)


@pytest.mark.slow
def test_time_memory_and_files_of_the_whole_command(tmp_path: Path) -> None:
    """Within 30 % of what `ruptfx run` takes, with pictures; its time, as others use the machine, within a factor."""
    import tomli_w

    from benchmarks.command_cost import ALIKE, compared

    table = plates({"duration": 20e-6, "output.figures": True, "boundaries": [
        {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0}
    ]})  # fmt: skip
    (tmp_path / "case.toml").write_text(tomli_w.dumps(table))
    _, told, taken = compared(tmp_path / "case.toml")
    for what, value in taken.items():
        least, most = (0.4, 2.5) if what == "expected run time" else (1 - ALIKE, 1 + ALIKE)
        assert least * value < told[what] < most * value, what


def test_expected_time_counts_steps_records_and_snapshots(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step of 1 s, 10 s more for a record, 100 s for a snapshot; 20 steps, 11 records, 4 snapshots.

    Of these the first step, the first two records and the first snapshot are part of the beginning, which takes
    nothing here: 19 x 1 + 9 x 10 + 3 x 100 = 409 s.
    """
    from types import SimpleNamespace

    from ruptfx.platform import fem
    from ruptfx.run import cost
    from ruptfx.run.model import Model

    given = parse_case(plates({"output.interface_interval": 2e-7, "output.bulk_interval": 5e-7, "duration": 2e-6}))
    model = Model(given, fem.MPI.COMM_WORLD)
    motion = given.stepper.bind(model)
    takes = {"step": 1.0, "step_and_record": 11.0, "snapshot": 100.0}
    monkeypatch.setattr(cost, "_each", lambda action, *_: takes[action.__name__])
    monkeypatch.setattr(cost, "_pace", lambda: 0.0)
    monkeypatch.setattr(cost, "time", SimpleNamespace(process_time=lambda: 0.0))
    found = cost.rehearse(model, motion, steps=20, started=0.0, built=0.0)
    assert (found.step, found.time) == (1.0, pytest.approx(409.0, rel=1e-12))


def test_shares_of_a_rehearsal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a second of steps, but no more than the run has; a fifth of that for records, a tenth for snapshots."""
    from ruptfx.run.model import Model

    spec = find_spec("ruptfx.run.cost")
    assert spec is not None and spec.loader is not None
    cost: Any = module_from_spec(spec)  # with its own numbers, which conftest.py makes smaller
    spec.loader.exec_module(cost)
    model = Model(parse_case(plates({"output.figures": False})))
    motion, shares = model.case.stepper.bind(model), {}

    def each(action: Any, seconds: float, fewest: int, most: float = math.inf) -> float:
        shares[action.__name__] = seconds, fewest, most
        return 1.0

    monkeypatch.setattr(cost, "_each", each)
    monkeypatch.setattr(cost, "_pace", lambda: 0.01)
    monkeypatch.setattr(cost, "time", SimpleNamespace(process_time=lambda: 0.0))
    costs = [cost.rehearse(model, motion, steps=20, started=begun, built=begun) for begun in (0.1, 7.0)]
    assert shares == {"step": (0.5, 6, 19), "step_and_record": (0.1, 2, math.inf), "snapshot": (0.05, 1, math.inf)}
    # Start-up counts as what it takes in a program without other work: 40 times the pace of 0.01 s at most.
    assert costs[1].time - costs[0].time == pytest.approx(0.4 - 0.1, rel=1e-9)


def test_the_integral_of_a_smooth_patch_is_that_of_its_middle_points() -> None:
    """Values that grow from one edge to the other, as of no profile here: their mean is a ninth."""
    from ruptfx.interfaces.mechanisms.checks.patch import _row

    x, y = (each.ravel() for each in np.meshgrid(np.arange(-0.5, 2.0, 1e-2), np.arange(-0.5, 1.5, 1e-2)))
    points = np.stack([x, 0 * x, -y], axis=1)
    frame = np.tile(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), (len(x), 1, 1))
    face: Any = SimpleNamespace(points=points, locations=np.stack([x, y], axis=1), frame=frame, area=1e-4 + 0 * x)

    def grows(places: np.ndarray) -> np.ndarray:
        s, d = places.T
        weight = [np.select([np.isclose(each, edges).any(axis=0)], [0.5], 1.0) for each, edges in
                  ((s, np.array([[0.0], [1.5]])), (d, np.array([[0.0], [1.0]])))]  # fmt: skip
        inside = (s > -1e-9) & (s < 1.5 + 1e-9) & (d > -1e-9) & (d < 1 + 1e-9)
        return np.where(inside, weight[0] * weight[1] * (s / 1.5) ** 8, 0.0)

    row = _row("patch", face, grows, np.array([[0.0, 1.5], [0.0, 1.0]]), 0.0)
    percent = re.search(r"([\d.]+) %", row.note)
    assert percent is not None and float(percent[1]) == 100


def test_what_does_not_fit_is_refused_before_it_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """3 x 2 elements of order 4 twice over: 2 x 25 x 9 = 450 nodes of 245 bytes and 160 MB of libraries."""
    from ruptfx import RuptfxError
    from ruptfx.app.checks import preflight
    from ruptfx.platform import memory
    from ruptfx.run import simulation

    made: list[object] = []
    for module in (preflight, simulation):
        monkeypatch.setattr(module, "Model", lambda *_: made.append("model"))
    monkeypatch.setattr(memory, "available", lambda: 160e6)
    with pytest.raises(
        RuptfxError, match=facts(r"450 nodes take 0.16 GB of memory at least, and 0.16 GB are free here")
    ):
        list(preflight.preflight(case()))
    with pytest.raises(RuptfxError, match=facts(r"twice the mesh\.element_size takes a quarter")):
        simulation.simulate(case(), tmp_path / "run", progress=False)
    assert not made


@pytest.mark.rehearsed
def test_what_fits_only_in_part_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    from ruptfx.app.checks import preflight

    monkeypatch.setattr(preflight, "available", lambda: 20e6)
    found = rows(plates())["memory"]
    assert found.verdict == "error" and "20 MB are free here: take a larger mesh.element_size" in found.note


def test_free_memory_is_that_of_the_machine_or_of_the_control_group(tmp_path: Path) -> None:
    from ruptfx.platform.memory import available

    assert available(tmp_path) is None
    (tmp_path / "proc").mkdir()
    (tmp_path / "proc" / "meminfo").write_text("MemTotal: 9000 kB\nMemAvailable:    4000 kB\n")
    assert available(tmp_path) == 4000 * 1024
    group = tmp_path / "sys" / "fs" / "cgroup"
    group.mkdir(parents=True)
    (group / "memory.max").write_text("max\n")
    (group / "memory.current").write_text("1000\n")
    assert available(tmp_path) == 4000 * 1024
    (group / "memory.max").write_text("5000\n")
    assert available(tmp_path) == 4000


def test_what_instruments_see() -> None:
    """Half of one sample every 2 us is 250 kHz; nodes are 0.5 mm apart, 5 of them carry S waves of c_s / 2.5 mm."""
    gauge = {"kind": "strain_gauge", "name": "gauge", "interval": 2e-6, "point": [5e-3, 2e-3], "length": 1e-4}
    fast = {"kind": "load_cell", "name": "cell", "interval": 2e-6, "edge": "upper.top", "bandwidth": 1e6}
    slow = {**fast, "name": "slow", "bandwidth": 1e5}
    found = rows(plates({"instruments": [gauge, fast, slow]}))
    seen = found["instruments.gauge: highest frequency"]
    speed = math.sqrt(5.3e9 / 2 / 1.35 / 1246)
    assert seen.value == pytest.approx(250e3) and seen.verdict == "ok"
    assert f"carries S waves to {speed / 2.5e-3:.3g} Hz" in seen.note and "measures as at a point" in seen.note
    both = {"kind": "velocimeter", "name": "both", "interval": 2e-6, "point": [5e-3, 2e-3], "direction": [1.0, 0.0],
            "relative_to": [5e-3, -2e-3]}  # fmt: skip
    soft = {"instruments": [both], "materials.lower": {**HOMALITE, "young_modulus": 5.3e9 / 4}}
    note = rows(plates(soft))["instruments.both: highest frequency"].note
    assert f"carries S waves to {0.5 * speed / 2.5e-3:.3g} Hz" in note  # in the slower body
    alias = found["instruments.cell: highest frequency"]
    assert alias.verdict == "warning" and "passes more: reduce the interval" in alias.note
    smooth = found["instruments.slow: highest frequency"]
    assert (alias.value, smooth.value, smooth.verdict) == (pytest.approx(250e3), 1e5, "ok")


# -- every row of one case by hand -----------------------------------------------------------------------------------

OF_THE_MACHINE = {"memory", "files", "expected run time"}  # compared with runs above


@pytest.mark.rehearsed
def test_every_row_of_a_case() -> None:
    """Two plates of 32 mm x 8 mm in elements of 2 mm of order 2; 2.8 MPa of shear on 6 MPa, coefficients 0.6 and 0.3.

    Rayleigh speed: the root of (2 - c^2 / c_s^2)^2 = 4 sqrt(1 - c^2 / c_p^2) sqrt(1 - c^2 / c_s^2).
    """
    E, nu, rho = (HOMALITE[name] for name in ("young_modulus", "poisson_ratio", "density"))
    c_p, c_s = np.sqrt(E / (1 - nu**2) / rho), np.sqrt(E / 2 / (1 + nu) / rho)
    c_R = brentq(lambda c: (2 - (c / c_s) ** 2) ** 2 - 4 * np.sqrt((1 - (c / c_p) ** 2) * (1 - (c / c_s) ** 2)),
                 0.8 * c_s, 0.999 * c_s)  # fmt: skip
    table = rows(slip_weakening({"order": 2, "faults.main.initial_stress.shear": 2.8e6}))
    drop, energy = 0.3 * 6e6, 0.5 * 0.3 * 6e6 * 5e-6
    stress_drop, half = 2.8e6 - 0.3 * 6e6, E / 2  # G / (1 - nu) of plane stress
    zone = 9 * math.pi / 32 * half * 2 * energy / drop**2
    rate = stress_drop * 2 / (rho * c_s)  # both bodies radiate
    dt = table["time step"].value
    expected = {
        "nodes": 2 * 33 * 9, ": generalized Rayleigh speed": c_R, "time step": dt, "stable time step": 1.11 * dt,
        **{f"{body}: {name}": speed for body in ("upper", "lower")
           for name, speed in (("c_p", c_p), ("c_s", c_s), ("c_R", c_R))},
        ": points": 33, ": position": "0 to 0.032", ": initial stress": 6e6, ": strength at rest": 3.6e6,
        ": fracture energy": energy, ": S": 0.8 / 1.0,
        ": critical half-length": energy * E / (math.pi * stress_drop**2),  # Griffith: Gamma E' / (pi drop^2)
        ": nucleation half-length": 0.579 * half / (drop / 5e-6),  # Uenishi and Rice
        ": static process zone": zone, ": points in process zone": zone / 1e-3, ": damping": "none",
        ": shortest time": 5e-6 / rate, "upper.top: echo": 2 * 8e-3 / c_p, "lower.bottom: echo": 2 * 8e-3 / c_p,
        "records: interface": 1 + math.ceil(10e-6 / dt), "records: bulk": 6,  # one per step at most, and the start
    }  # fmt: skip
    assert set(table) == set(expected) | OF_THE_MACHINE
    for name, value in expected.items():
        close = 2e-3 if name == ": nucleation half-length" else 0.02 if name == "stable time step" else 1e-9
        wanted = value if isinstance(value, str) else pytest.approx(value, rel=close)
        assert table[name].value == wanted, name
    # Numbers of the notes.
    for name, value in {
        "upper: c_s": np.sqrt(2) * c_s, "lower: c_s": np.sqrt(2) * c_s, ": points": 1e-3, "time step": 10e-6,
        ": initial stress": 2.8e6, ": shortest time": rate, "records: interface": 10e-6 / 300,
        "records: bulk": 10e-6 / 6,
    }.items():  # fmt: skip
        numbers = [float(number) for number in re.findall(r"(?<![\w(])\d[\d.]*(?:e[+-]?\d+)?", table[name].note)]
        assert any(number == pytest.approx(value, rel=1e-2) for number in numbers), (name, numbers)


def test_a_mirror_image_radiates_as_a_body() -> None:
    """Half of a symmetric model has the expected slip rate of the whole, and a rigid base radiates nothing."""
    times = {
        mesh: rows(slip_weakening({"order": 2, "faults.main.initial_stress.shear": 2.8e6, "mesh": {
            "length": 32e-3, "height": 8e-3, "element_size": 2e-3, **mesh_table}}))[": shortest time"].value
        for mesh, mesh_table in {
            "whole": {"kind": "two_plates"}, "half": {"kind": "half_plate", "symmetry": "antisymmetric"},
            "rigid": {"kind": "block_on_rigid"},
        }.items()
    }  # fmt: skip
    assert times["half"] == pytest.approx(times["whole"], rel=1e-9)
    assert times["rigid"] == pytest.approx(2 * times["whole"], rel=1e-9)


def test_a_shortage_of_memory_is_the_same_sentence_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Key, use, needed and free memory, remedy; nothing where it fits, or where the free memory is not known."""
    from ruptfx import RuptfxError
    from ruptfx.platform import memory

    monkeypatch.setattr(memory, "available", lambda: 2.5e9)
    asked = "mesh.points = 9", "matrices", 3e9, "use fewer"
    said = "mesh.points = 9: matrices take 3 GB each, and 2.5 GB are free here; use fewer"
    assert memory.shortage(*asked, note=" each") == said
    comm: Any = SimpleNamespace(allgather=lambda each: [each])
    with pytest.raises(RuptfxError, match=re.escape(said)):
        memory.refuse_shortage(comm, *asked, note=" each")
    for free in (3e9, None):
        monkeypatch.setattr(memory, "available", lambda free=free: free)
        assert memory.shortage(*asked) == ""
        memory.refuse_shortage(comm, *asked)


@pytest.mark.parametrize("precision, per_node", [("double", 245.0), ("single", 245.0 - 4 * (2 + 2 + 3))])
def test_memory_of_several_ranks_on_one_machine(
    precision: str, per_node: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two of four ranks are on this machine: twice the libraries, and half of the nodes.

    In single precision velocity, force and three inverse masses have 4 bytes less.
    """
    from ruptfx import RuptfxError
    from ruptfx.platform import memory
    from ruptfx.run import cost

    comm = SimpleNamespace(size=4, Split_type=lambda kind: SimpleNamespace(size=2), allgather=lambda each: [each] * 4)
    least = 2 * 160e6 + 2 * 13 * 5 * per_node / 2
    of_order_2 = case({"order": 2, "precision": precision})
    monkeypatch.setattr(memory, "available", lambda: least + 1)
    cost.need_memory(of_order_2, comm)
    monkeypatch.setattr(memory, "available", lambda: least - 1)
    with pytest.raises(RuptfxError):
        cost.need_memory(of_order_2, comm)


@pytest.mark.parametrize("dim, components, stresses", [(2, 2, 3), (3, 3, 6)])
def test_bytes_of_snapshots_and_energies(
    dim: int, components: int, stresses: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """10 nodes, 4 snapshots of velocity and stress in single precision, 21 records of 7 energies as text.

    The mesh has as many cells as nodes, of 2^dim corners, and dim coordinates of each node.
    """
    from ruptfx.run import cost

    output = SimpleNamespace(bulk_fields=["velocity", "stress"], bulk_precision="single", interface_steps=None)
    given = SimpleNamespace(
        instruments=[],
        plane="solid" if dim == 3 else "stress",
        output=output,
        duration=20.0,
        intervals={"interface": 1.0, "bulk": 5.0},
    )
    model = SimpleNamespace(
        case=given,
        coordinates=np.zeros((10, dim)),
        components=components,
        total_nodes=10,
        energy_columns=["energy"] * 7,
        given=[],
    )
    expected = 10 * (4 * 4 * (components + stresses) + 8 * (dim + 2**dim)) + 20 * 9 * 21
    assert cost._bytes_of_files(model, [], 100) == expected
    # 40 samples of the time and three channels.
    given.instruments = ["one"]
    monkeypatch.setattr(cost, "measured", lambda *_: [(SimpleNamespace(interval=0.5), [1, 2, 3])])
    assert cost._bytes_of_files(model, [], 100) == expected + 8 * 40 * 4


GAUGE = {"kind": "fault_receiver", "name": "fault", "position": 16e-3, "interval": 1e-7}
DATA = {
    "kind": "traces", "instrument": "fault", "times": [0.5e-6, 1e-6, 1.5e-6, 2e-6], "begin": 0.9e-6, "sigma": 0.5e-6,
    "data": {"slip": [9.0, 1.0, -4.0, 2.0], "opening": [0.0, 0.0, 0.0, 0.0]}, "units": {"slip": "um", "opening": "m"},
}  # fmt: skip


def inferred(unknowns: list[dict[str, Any]], **of_data: Any) -> dict[str, Row]:
    """Rows about data of a run of 3 us, and its unknowns."""
    table = slip_weakening({"duration": 3e-6, "instruments": [GAUGE], "objective": [DATA | of_data],
                            "unknowns": unknowns})  # fmt: skip
    return rows(table)


def test_check_lists_data_and_unknowns() -> None:
    """Two traces of the three times from 0.9 us on, of up to 4 um at 0.5 um of noise; a number, and a field."""
    field = {"key": "faults.main.initial_stress.shear", "sigma": 1e6, "correlation_length": 5e-3}
    result = inferred([{"key": "faults.main.friction.mu_d", "shape": "number"}, field])
    samples, variables = result["objective.0: samples"], result["unknowns: variables"]
    assert (samples.value, samples.verdict) == (6, "ok")
    numbers = [float(each) for each in re.findall(r"-?\d[\d.]*(?:e[-+]\d+)?", samples.note)]
    assert numbers == [2, 3, 1e-6, 2e-6, 0.5e-6, 8]
    points = parse_case(slip_weakening({})).mesh.length / 1e-3  # type: ignore[attr-defined]
    assert variables.verdict == "ok" and int(variables.value) > points
    assert re.findall(r"\d+ of them|\d+ samples", variables.note) == ["1 of them", "6 samples"]
    # More numbers without a prior than data: 2 and 1.
    keys = ("friction.mu_d", "friction.mu_s")
    few = inferred([{"key": f"faults.main.{key}", "shape": "number"} for key in keys], end=1.2e-6, channels=["slip"])
    assert (few["unknowns: variables"].value, few["unknowns: variables"].verdict) == (2, "warning")


@pytest.mark.parametrize("changes, key", [
    ({"begin": None, "times": [-1e-6, 0.0, 1e-6, 2e-6]}, r"objective\.0\.times"),
    ({"data": {"slide": [0.0] * 4}, "units": {"slide": "m"}}, r"objective\.0\.data\.slide"),
])  # fmt: skip
@pytest.mark.parametrize("command, unknowns", [
    ("infer", [{"key": "faults.main.friction.mu_d", "shape": "number"}]), ("gradient", []),
])  # fmt: skip
def test_check_warns_of_data_that_are_refused(
    changes: dict[str, Any], key: str, command: str, unknowns: list[dict[str, Any]]
) -> None:
    row = inferred(unknowns, **changes)[command]
    assert row.verdict == "warning" and re.match(key, row.note)


def test_check_lists_unknowns_of_infer_that_are_no_unknowns() -> None:
    row = inferred([{"key": "faults.main.friction.mu", "shape": "number"}])["infer"]
    assert row.verdict == "warning" and re.match(r"unknowns\.0\.key", row.note)
