"""Maxwell-slip ensemble and the roughness map: small cases followed by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.lumped.maxwell_slip import MaxwellSlip, large_number_limit, late_amplitude_law, slide, transition
from ruptfx.lumped.maxwell_slip.roughness import ContactLayer, Surface, read_profile, roughness_of


def test_two_blocks_by_hand() -> None:
    # mu_s 0.3, drop 0.15, forces 0 and 0.15: slips at drive displacements 0.15 (second), 0.3 (both), 0.45 (both), ...
    ensemble = slide(np.array([[0.0, 0.15]]), 0.3, 0.15, 3.0)
    assert ensemble.displacement[0, : ensemble.count[0]] == pytest.approx([0.15, 0.3, 0.3, 0.45, 0.45])
    assert ensemble.block[0, 0] == 1
    # The mean force starts at 0.075 and is 0.225 at the first slip, which takes 0.15 / 2 off it.
    displacement, friction = ensemble.corners(0)
    assert displacement[:3] == pytest.approx([0, 0.15, 0.15])
    assert friction[:3] == pytest.approx([0.075, 0.225, 0.15])
    # From then on both slip together: from 0.3 down to 0.15, over and over.
    assert ensemble.static[0] == pytest.approx(0.3)
    assert ensemble.late_amplitude[0] == pytest.approx(0.15)


def test_history_equals_a_time_stepped_ensemble() -> None:
    random = np.random.default_rng(3)
    force = random.uniform(-0.3, 0.3, 40)
    displacement, friction = slide(force[None, :].copy(), 0.3, 0.15, 6.0).corners(0)
    step = 1e-4
    for number in range(1, 6000):
        force += step
        force[force > 0.3] -= 0.15
        if number % 500 == 0:
            # Right after a corner the two differ by at most one slip, 0.15 / 40.
            exact = np.interp(number * step, displacement + 1e-12 * np.arange(len(displacement)), friction)
            assert force.mean() == pytest.approx(exact, abs=0.15 / 40 + step)


def test_same_seed_same_result_and_other_seed_not() -> None:
    small = {"alphas": [10.0], "blocks": 20, "realisations": 3}
    first, again, other = (MaxwellSlip(**small, seed=s).run() for s in (1, 1, 2))
    assert first.identical(again) and not first.equals(other)


def test_late_amplitude_of_scattered_phases() -> None:
    """mu_s = 0.6, drop = 0.4: s = 0.3 periods at alpha = 12, so 2 / pi exp(-0.18 pi^2) = 0.1077. Blocks followed one by
    one agree the better the more the Beta distribution is a Gaussian one, before higher harmonics are left."""
    assert late_amplitude_law(12.0, 0.6, 0.4) == pytest.approx(0.10773, rel=1e-4)
    for alpha, tolerance in ((20.0, 0.03), (40.0, 0.015)):
        followed = large_number_limit(alpha, 0.6, 0.4)[1]
        assert late_amplitude_law(alpha, 0.6, 0.4) == pytest.approx(followed, rel=tolerance)


def test_transition_is_interpolated_in_the_logarithm() -> None:
    # Half way between 10 and 1000 in the logarithm is 100.
    assert transition(np.array([1000.0, 10.0]), np.array([0.2, 0.1]), 0.15) == pytest.approx(100)
    assert np.isnan(transition(np.array([10.0, 1000.0]), np.array([0.2, 0.3]), 0.1))
    # Of two crossings that of the smoother surfaces.
    assert transition(np.array([1.0, 2.0, 4.0, 100.0]), np.array([0.1, 0.2, 0.1, 0.2]), 0.15) == pytest.approx(20)


def test_roughness_and_alpha_invert_each_other() -> None:
    layer = ContactLayer(contact_fraction_min=0.012, contact_fraction_max=0.012)
    assert layer.alpha(float(layer.roughness(37.0, 0.3, 0.012)), 0.3) == pytest.approx((37.0, 37.0))
    # Twice the pressure, twice the roughness at the same alpha.
    assert layer.critical(22, 0.3, 2 * layer.pressure)[0] == pytest.approx(2 * layer.critical(22, 0.3)[0])
    assert [layer.verdict(r, 22, 0.3) for r in (0.1e-6, 5e-6)] == ["stick-slip", "steady"]
    # Smaller contacts carry larger stresses, so that the bounds are in order; between them nothing is decided.
    scattered = ContactLayer(contact_fraction_min=0.01, contact_fraction_max=0.02)
    low, high = scattered.critical(22, 0.3)
    assert high == pytest.approx(2 * low)
    judged = [scattered.verdict(r, 22, 0.3) for r in (0.99 * low, 1.01 * low, 0.99 * high, 1.01 * high)]
    assert judged == ["stick-slip", "undecided", "undecided", "steady"]


def test_verdicts_use_the_transition_that_the_run_finds() -> None:
    # Without scatter of the fraction R_a is critical at alpha_c alone, so 1 % below and above it the verdicts differ.
    sure = {"contact_fraction_min": 0.012, "contact_fraction_max": 0.012}
    small = {"alphas": [1.0, 1e3], "blocks": 100, "realisations": 5}
    found = float(MaxwellSlip(**small).run().alpha_c)
    critical = ContactLayer(**sure).critical(found, 0.3)[0]
    surfaces = [{"name": name, "R_a": factor * critical} for name, factor in (("smooth", 0.99), ("rough", 1.01))]
    judged = MaxwellSlip(**small, layer=sure, surfaces=surfaces).run()
    assert judged.verdict.values.tolist() == ["stick-slip", "steady"]
    assert float(judged.verdict_alpha_c) == found != 22
    # R_a sqrt(2 alpha + 1) is constant: at half the alpha_c all these surfaces are smooth.
    given = MaxwellSlip(**small, layer={**sure, "alpha_c": 0.5 * found}, surfaces=surfaces).run()
    assert given.verdict.values.tolist() == ["stick-slip", "stick-slip"]


def test_no_verdict_without_a_transition() -> None:
    one = MaxwellSlip(alphas=[10.0], blocks=20, realisations=2, surfaces=[{"name": "s", "R_a": 1e-9}]).run()
    assert one.verdict.values.tolist() == ["undecided"]
    figure = MaxwellSlip.figures(one)["roughness_map"]
    assert "no verdicts" in figure.axes[0].get_title(loc="left")


def test_roughness_of_known_profiles() -> None:
    x = np.linspace(0, 1e-3, 20_001)
    # Mean of |A cos| over whole waves is 2 A / pi; tilt and offset are not roughness.
    wave = 1e-6 * np.cos(2 * np.pi * 20 * x / 1e-3)
    assert roughness_of(wave + 3e-3 * x + 1.0, x) == pytest.approx(2e-6 / np.pi, rel=1e-3)
    # The filter halves a wave as long as its cutoff: half stays, half is waviness (ISO 16610-21).
    inner = slice(5_000, 15_001)
    whole = 1e-6 * np.sin(2 * np.pi * x / 5e-5)
    assert roughness_of(whole, x, 5e-5) == pytest.approx(1e-6 / np.pi, rel=0.02)
    assert roughness_of(whole[inner], x[inner], 4e-4) == pytest.approx(2e-6 / np.pi, rel=0.02)


def test_profiles_are_read_with_headers_units_and_semicolons(tmp_path: Path) -> None:
    height = np.sin(np.arange(50.0))
    table = "\n".join(f"{i};{z:.6f}" for i, z in enumerate(height))
    (tmp_path / "p.csv").write_text(f"# stylus\nx [um];z [um]\n{table}\n")
    position, read = read_profile(tmp_path / "p.csv", 1e-6)
    assert position == pytest.approx(1e-6 * np.arange(50)) and read == pytest.approx(1e-6 * height, abs=1e-11)
    (tmp_path / "z.txt").write_text("\n".join(f"{z:.6f}" for z in height))
    assert read_profile(tmp_path / "z.txt")[0] is None
    case = {
        "kind": "maxwell_slip",
        "alphas": [10.0],
        "blocks": 5,
        "realisations": 2,
        "surfaces": [{"name": "mine", "profile": "p.csv", "profile_unit": 1e-6}],
    }
    result = parse_case(case, tmp_path).run()
    assert result.R_a.values[0] == pytest.approx(roughness_of(1e-6 * height, 1e-6 * np.arange(50)), rel=1e-5)


@pytest.mark.parametrize(
    "text, message",
    [
        ("a,b\n" + "1,x\n" * 9, r"line 2 of .*p\.txt: 'x' is not a finite number"),
        ("1\n2 3\n", r"line 2 of .*p\.txt: 2 columns; every row must have the same one or two"),
        ("1\n2\n", r"p\.txt: 2 rows; a profile must have at least 8"),
        ("\n".join(["2 1"] * 9), r"line 2 of .* must increase"),
    ],
)
def test_bad_profiles_say_what_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "p.txt").write_text(text)
    with pytest.raises(RuptfxError, match=facts(message)):
        read_profile(tmp_path / "p.txt")


@pytest.mark.parametrize(
    "change, message",
    [
        ({"mu_d": 0.3}, "must be less than mu_s"),
        ({"periods": 2.0}, "repeated after 5"),
        ({"blokcs": 3}, "did you mean 'blocks'"),
        ({"alphas": [0.0]}, "greater than 0"),
        ({"surfaces": [{"name": "s"}]}, "exactly one of R_a, R_q, profile, not none"),
        ({"surfaces": [{"name": "s", "R_a": 1e-6, "R_q": 1e-6}]}, "R_a, R_q, profile, not R_a and R_q"),
        ({"surfaces": [{"name": "s", "R_a": 1e-6, "cutoff": 1e-3}]}, "cutoff = 0.001 m filters a profile; give"),
        ({"alphas": [3.0, 5.0, 3.0]}, "alphas: must differ from each other; give 3 once"),
        ({"layer": {"contact_fraction_min": 0.02}}, "contact_fraction_min = 0.02 must not exceed .* = 0.015"),
        ({"surfaces": [{"name": "s", "profile": "missing.csv"}]}, "no such file"),
    ],
)
def test_bad_cases_name_the_key(change: dict[str, object], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        parse_case({"kind": "maxwell_slip", **change})


def test_a_surface_is_given_once() -> None:
    with pytest.raises(CaseError, match=facts(r"R_a, R_q, profile, .*R_a and R_q")):
        Surface(name="s", R_a=1e-6, R_q=1e-6)


def test_times_are_drive_displacements_over_the_speed() -> None:
    """The slip period is 2 (mu_s - mu_d) N_b / k over the speed of the drive."""
    table = {"kind": "maxwell_slip", "normal_force": 30.0, "blocks": 10, "stiffness": 5.0,
             "drive_speed": 0.2, "mu_s": 0.5, "mu_d": 0.3}  # fmt: skip
    model = parse_case(table)
    assert isinstance(model, MaxwellSlip)
    data = model.run()
    period = 2 * (0.5 - 0.3) * 3.0 / 5.0 / 0.2
    assert float(data["slip_period"]) == pytest.approx(period, rel=1e-12)
    last = float(np.nanmax(data["trace_time"]))
    assert last == pytest.approx(model.periods * period, rel=1e-12)
    assert 0.9 * last < float(np.nanmax(data["slip_time"])) <= last
