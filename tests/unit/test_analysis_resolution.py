"""What a mesh does not resolve: noise, chatter, tips that nothing carries; on fields made so, and on real runs."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers import synthetic
from helpers.small_cases import SPLIT, merged, plates

from ruptfx.results.analysis import modes, summarise
from ruptfx.results.analysis.resolution import NOISE, peak_is_resolved, roughness
from ruptfx.results.record import Record

TIME, POSITION = synthetic.times(), synthetic.points()
DEMO = Path(__file__).parents[2] / "demos" / "slip_weakening.toml"


def classify(field):
    known = {"c_R": synthetic.C_R, "c_s": synthetic.C_S, "c_p": synthetic.C_P}
    return modes.classify(field, TIME, POSITION, V_imp=synthetic.V_IMP, **known)


@pytest.mark.parametrize("wavelength", [2, 4, 6, 8, 20])
def test_noise_of_a_wave(wavelength):
    """The line through both neighbours is cos(2 pi / N) of the value: (1 - cos)^2 / 4 = sin^4(pi / N)."""
    wave = np.sin(2 * np.pi * np.arange(2001) / wavelength + 0.3)[None]
    short, whole = roughness(wave, np.arange(2001.0))
    assert short.sum() / whole.sum() == pytest.approx(np.sin(np.pi / wavelength) ** 4, rel=1e-9)


def test_a_straight_line_has_no_noise_on_uneven_points():
    short, whole = roughness((3 + POSITION)[None], POSITION)
    assert short.sum() < 1e-28 * whole.sum()


@pytest.mark.parametrize(("amplitude", "resolved"), [(0.4, True), (0.6, False)])
def test_noise_from_point_to_point(amplitude, resolved):
    found = classify(synthetic.grid_noise(TIME, POSITION, amplitude))
    # 2 m/s and a two-point wave of amplitude a: a^2 / (4 + a^2), 0.038 and 0.083; the limit is 1/16.
    assert found.doubts.noise == pytest.approx(amplitude**2 / (4 + amplitude**2), rel=0.02)
    assert found.pattern == "crack"
    if resolved:
        assert found.mode == "crack" and found.regime == "supershear" and found.confidence == 1
    else:
        assert found.mode == found.mode_at_half_threshold == found.regime == "not resolved"
        assert found.confidence == 0 and np.isnan(found.tip_speed.value)


def test_noise_far_behind_the_tip_leaves_its_speed():
    # From 10 mm on, 40 points behind the tip.
    found = classify(synthetic.grid_noise(TIME, POSITION, 1.0, behind=10e-3))
    assert found.mode == "not resolved"
    assert found.regime == "supershear" and found.tip_speed.value == pytest.approx(2100, rel=2e-3)


@pytest.mark.parametrize(("speed", "mode"), [(2100.0, "train"), (6000.0, "not resolved"), (-5000.0, "not resolved")])
def test_narrow_zones_are_a_train_if_waves_carry_them(speed, mode):
    """Zones of 1.75 mm are seven points wide and smooth; above c_p = 2200 m/s, either way, they are chatter."""
    found = classify(synthetic.ripples(TIME, POSITION, speed))
    assert found.pattern == "train" and found.mode == mode
    assert found.doubts.noise < NOISE and found.zone_points == pytest.approx(7, abs=1)
    assert found.regime == "supershear"


def test_wide_zones_may_be_faster_than_waves():
    # Of 5 mm, twenty points: pulses that trail a tip may be faster than c_p.
    assert classify(synthetic.ripples(TIME, POSITION, 6000.0, wavelength=10e-3)).mode == "train"


@pytest.mark.parametrize(("speed", "resolved"), [(2230.0, True), (6000.0, False)])
def test_nothing_carries_a_tip_above_c_p(speed, resolved):
    found = classify(synthetic.crack(TIME, POSITION, speed=speed))
    assert found.mode == "crack" and np.isfinite(found.tip_speed.value) == resolved
    assert found.regime == ("supershear" if resolved else "not resolved")
    assert len(found.doubts.speed) == (0 if resolved else 1)


@pytest.mark.parametrize(("jitter", "resolved"), [(0.1e-6, True), (5e-6, False)])
def test_many_places_at_once(jitter, resolved):
    """Points start at 5 us + x / 2100 m/s and up to 0.1 us, half a saved time, or up to 5 us, 10 mm of way, later."""
    late = jitter * np.random.default_rng(5).random(len(POSITION))
    found = classify(2.0 * (TIME[:, None] > 5e-6 + POSITION / 2100 + late))
    assert found.regime == ("supershear" if resolved else "not resolved")
    assert any("in no order" in text for text in found.doubts.speed) != resolved


def test_a_rupture_between_two_saved_times():
    # At rest at 0 and 60 us; at 55 us, the only other time, all points slide.
    field = synthetic.crack(np.array([0.0, 55e-6, 0.0]), POSITION)
    found = modes.classify(field, np.array([0.0, 55e-6, 60e-6]), POSITION, V_imp=synthetic.V_IMP)
    assert found.mode == "not resolved" and found.confidence == 0
    assert "save more" in found.doubts.mode[0]


def test_largest_slip_rate():
    # A parabola over 15 points has no noise to speak of; over three points it is mostly noise.
    wide, narrow = (synthetic.pulses(TIME, POSITION, width=width) for width in (6e-3, 0.75e-3))
    assert peak_is_resolved(np.maximum(wide, 0), POSITION) is True
    assert peak_is_resolved(np.maximum(narrow, 0), POSITION) is False
    assert peak_is_resolved(np.zeros_like(wide), POSITION) is None


def test_summary_says_so(tmp_path):
    field = synthetic.grid_noise(TIME, POSITION, 1.0)
    with Record(synthetic.write_run(tmp_path / "run", field, TIME, POSITION)) as record:
        found = summarise(record)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["mode"] == found["speed_regime"] == "not resolved" and found["mode_before_arrest"] == "crack"
    assert found["tip_speed"] is None and found["tip_speed_over_c_l"] is None
    assert found["peak_slip_rate_resolved"] is False and "20% of its energy" in found["not_resolved"]


# -- real runs, a second each --------------------------------------------------------------------------------------


def run(table, path):
    pytest.importorskip("dolfinx")
    from ruptfx.case import parse_case
    from ruptfx.run.simulation import simulate

    return simulate(parse_case({**table, "output": {"figures": False}}), path, progress=False).summary


def weakening(shear, damping):
    return merged(tomllib.loads(DEMO.read_text()), {
        "mesh.element_size": 800.0, "mesh.height": 8e3, "faults.main.initial_stress.shear": shear,
        "faults.main.friction.D_c": 0.9665, "damping": {"kelvin_voigt": {"fraction": damping}} if damping else None,
    })  # fmt: skip


@pytest.mark.fem
def test_a_rupture_that_dies_in_noise(tmp_path):
    """S = 3: the forced part of the rupture rings from node to node, a damped layer takes that away."""
    bare = run(weakening(67.56e6, 0.0), tmp_path / "bare")
    assert bare["mode"] == bare["speed_regime"] == "not resolved" and "from point to point" in bare["not_resolved"]
    damped = run(weakening(67.56e6, 0.3), tmp_path / "damped")
    assert (damped["mode"], damped["speed_regime"], damped["not_resolved"]) == ("arrested", "sub-Rayleigh", None)


@pytest.mark.fem
def test_a_rupture_that_runs(tmp_path):
    """S = 0.5."""
    found = run(weakening(75.16e6, 0.2), tmp_path / "run")
    assert (found["mode"], found["speed_regime"], found["not_resolved"]) == ("crack", "supershear", None)
    assert found["peak_slip_rate_resolved"] is True


@pytest.mark.fem
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_chatter_of_different_materials(damping, tmp_path):
    """Coulomb friction without memory is ill-posed between them: whatever happens is the mesh's."""
    pytest.importorskip("dolfinx")
    from benchmarks import bimaterial

    table = merged(bimaterial.case(8e-5, bimaterial.COULOMB), {"damping.kelvin_voigt.fraction": damping or None})
    found = run(table if damping else merged(table, {"damping": None}), tmp_path / "run")
    assert found["mode"] == "not resolved" and found["mode_before_arrest"] == "train"
    assert "places slip in turn" in found["not_resolved"]


@pytest.mark.fem
def test_an_interface_that_slips_in_four_places_at_once(tmp_path):
    """A plane wave from the top reaches all points together; those with the largest shear stress slip first."""
    x = np.linspace(0, 32e-3, 401)
    shear = 3e6 * (0.94 + 0.05 * np.sin(2 * np.pi * x / 8e-3))
    file = tmp_path / "shear.csv"
    file.write_text("position,shear\n" + "".join(f"{a},{b}\n" for a, b in zip(x, shear, strict=True)))
    found = run(plates({
        "duration": 12e-6, "mesh.length": 32e-3, "mesh.height": 8e-3, "faults.main.contact": SPLIT,
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.5},
        "faults.main.initial_stress": {"normal": 6e6, "shear": {"kind": "table", "file": str(file)}},
        "boundaries": [{"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 2.0, "ramp": 4e-6}],
    }), tmp_path / "run")  # fmt: skip
    assert found["reach"] > 25e-3 and found["mode"] == "crack"
    assert found["speed_regime"] == "not resolved" and found["tip_speed"] is None
    assert "places slip" in found["not_resolved"]


@pytest.mark.parametrize("points, resolved", [(9, True), (7, False)])
def test_waves_of_more_than_eight_points_are_resolved(points, resolved):
    """The noise of a wave of N points is sin^4(pi / N), and the limit that of eight."""
    x = np.arange(64.0 * points)
    assert peak_is_resolved(np.sin(2 * np.pi * x / points)[None], x) is resolved
