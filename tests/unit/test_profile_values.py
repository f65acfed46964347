"""Scalars that vary along an interface."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from pydantic import ValidationError

from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import CaseError, alternatives, unit_of
from ruptfx.interfaces.faults.initial_stress import InitialStress
from ruptfx.laws.friction.coulomb import Coulomb

X = np.linspace(-1.0, 1.0, 41)
KINDS = alternatives("ruptfx.input.profiles")


def example(kind: str) -> dict[str, Any]:
    return tomllib.loads(f"profile = {KINDS[kind].example}")["profile"]


def profile(kind: str, **changes: Any) -> Any:
    table = {**example(kind), **changes}
    return KINDS[table.pop("kind")](**table)


@pytest.mark.parametrize("kind", KINDS)
def test_the_name_of_a_profile_alone_is_refused_with_its_form(kind: str) -> None:
    with pytest.raises(CaseError, match=facts(rf"mu_d = '{kind}': a profile is a table; give {{ kind = '{kind}'")):
        Coulomb(mu_d=kind)


def test_closed_forms() -> None:
    assert np.all(profile("constant")(X) == 0.3)
    np.testing.assert_array_equal(profile("boxcar")(np.array([-0.11, -0.1, 0.1, 0.3, 0.31])), [1, 2, 2, 2, 1])
    # 1 + 2 exp(-1/2) one width away.
    np.testing.assert_allclose(profile("gaussian")(np.array([0.1, 0.3])), [3.0, 1 + 2 * np.exp(-0.5)])
    # Half-way down the ramp B = (1 + tanh(0)) / 2.
    np.testing.assert_allclose(profile("taper")(np.array([0.0, 0.3, 0.4, 0.5, 0.9])), [2, 2, 1.5, 1, 1])
    np.testing.assert_allclose(profile("cone")(np.array([-0.2, 0.0, 0.4, 0.9])), [0.2, 0.1, 0.3, 0.4])
    # 0.2^2 / (2 * 2) away from the tip.
    np.testing.assert_allclose(profile("parabola")(np.array([-0.1, 0.1, 0.3])), [0.02, 0.01, 0.02])
    np.testing.assert_allclose(profile("table")(np.array([-1.0, -0.5, 1.0, 2.0])), [0, 0.5, 2, 3])


def test_the_rim_of_a_patch() -> None:
    """Half-axes of 0.5 and 0.2 m, mean 0.35 m: a tenth beyond the ellipse is 0.7 of a rim of 0.05 m; likewise there."""
    part = 0.5 * (1 + np.tanh(1 / (0.7 - 1) + 1 / 0.7))
    ends = {"inside": 3.0, "outside": 1.0, "strike": [-0.4, 0.6], "dip": [0.1, 0.5], "rim": 0.05}
    expected = [3, 1 + 2 * part, 1 + 2 * part, 1]
    for kind, along, down in (("ellipse", 1.1 * 0.5, 1.1 * 0.2), ("rectangle", 0.535, 0.235)):
        places = np.add([0.1, 0.3], [[0.0, 0.0], [along, 0.0], [0.0, -down], [0.65, 0.0]])
        np.testing.assert_allclose(profile(kind, **ends)(places), expected, err_msg=kind)


def test_a_sinusoid_and_a_spline() -> None:
    # 1 + 0.5 cos(0.3) at zero, the mean a quarter of a wavelength after the phase is made up for.
    shape = profile("sinusoid")
    zero = 0.8 * (0.25 - 0.3 / (2 * np.pi))
    np.testing.assert_allclose(shape(np.array([0.0, zero])), [1 + 0.5 * np.cos(0.3), 1.0], rtol=1e-15)
    # A not-a-knot spline is exact for cubics, and clamped beyond its ends where it may be extended.
    places = np.array([-1.0, -0.3, 0.2, 0.9, 1.0])
    numbers = {"positions": places.tolist(), "values": (places**3 - places).tolist()}
    spline = profile("table", interpolation="cubic", extend=True, **numbers)
    np.testing.assert_allclose(spline(X), X**3 - X, atol=1e-15)
    np.testing.assert_allclose(spline(np.array([1.5])), 0.0, atol=1e-15)


@pytest.mark.parametrize("hurst", [0.5, 0.8])
def test_heights_of_a_self_affine_profile(hurst: float) -> None:
    """Their root mean square is exact, their mean spectrum falls as q^-(1 + 2 H), and is flat up to the roll-off."""
    numbers = {"rms": 3e-6, "hurst": hurst, "length": 1e-3, "longest": 5e-4, "rolloff": 1e-4, "shortest": 5e-6}
    x = np.arange(512) * 1e-3 / 512  # the highest wave has number 200
    power = np.zeros(257)
    for seed in range(64):
        heights = profile("self_affine", seed=seed, **numbers)(x)
        np.testing.assert_allclose([np.sqrt(np.mean(heights**2)), np.mean(heights)], [3e-6, 0], atol=1e-18, rtol=1e-12)
        power += np.abs(np.fft.rfft(heights)) ** 2
    inside = np.arange(11, 200)
    slope = np.polyfit(np.log(inside), np.log(power[inside]), 1)[0]
    assert abs(-0.5 * (slope + 1) - hurst) < 1e-6  # heights of all seeds are the same, only phases differ
    np.testing.assert_allclose(power[2:11], power[10], rtol=1e-9)
    assert power[1] + power[201:].sum() < 1e-20 * power[10]


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"shortest": 2.0}, "shortest <= rolloff <= longest <= length, these are 2, 1, 1 and 2 m"),
        ({"rms_slope": 0.1}, "rms = 0.1 and rms_slope = 0.1: give one"),
        ({"rms": None}, "rms and rms_slope"),
        ({"length": 1.2, "longest": 0.9, "shortest": 0.7}, "of length = 1.2 m is between shortest = 0.7"),
    ],
)  # fmt: skip
def test_wavelengths_that_do_not_fit(changes: dict[str, float], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        profile("self_affine", **changes)


def test_a_table_must_cover_the_interface_or_say_how_it_goes_on() -> None:
    beyond = np.array([-2.0, -0.5, 1.0, 5.0])
    law = Coulomb(mu_d=example("table"))
    with pytest.raises(
        CaseError, match=facts(r"Coulomb.mu_d: the table from -1 to 2 m .* from -2 to 5 m; .* extend = true")
    ):
        law.at(beyond)
    extended = law.model_copy(update={"mu_d": {**example("table"), "extend": True}})
    np.testing.assert_allclose(extended.at(beyond).mu_d, [0, 0.5, 2, 3])
    assert law.at(np.zeros(0)).mu_d.shape == (0,)  # a rank without a point


def test_tables_may_have_decimal_commas(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("0;1,5\n1;2\n")
    law = Coulomb(mu_d={"kind": "table", "file": str(tmp_path / "t.csv")})
    assert law.at(np.array([0.0, 0.5, 1.0])).mu_d == pytest.approx([1.5, 1.75, 2.0])


@pytest.mark.parametrize(
    "text, message",
    [
        ("x,v\n0,1\n1,abc\n", "line 3 of .*t.csv: 'abc' is not a finite number"),
        ("0,1\n\nO.5,1\n1,2\n", "line 3 of .*t.csv: 'O.5' is not a finite number"),
        ("0,1\n1,nan\n", "line 2 of .*t.csv: 'nan' is not a finite number"),
        ("0,1\n1\n2,3\n", "line 2 of .*t.csv: two columns are needed"),
        ("0,1\n2,1\n# end\n1,3\n", "line 4 of .*t.csv: 1 after 2; .* must increase"),
        ("x,v\n0,1\n", "t.csv: at least two lines .* found 1"),
    ],
)
def test_files_of_tables_are_refused_by_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(CaseError, match=facts(message)):
        Coulomb(mu_d={"kind": "table", "file": str(tmp_path / "t.csv")})


def test_files_of_tables_may_have_a_header_comments_and_a_signature(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(b"\xef\xbb\xbfposition;mu_d\r\n0;1\r\n# half-way\r\n1;2\r\n")
    law = Coulomb(mu_d={"kind": "table", "file": str(tmp_path / "t.csv")})
    assert law.mu_d.positions == [0.0, 1.0] and law.mu_d.values == [1.0, 2.0]


def test_random_has_the_moments_it_is_given() -> None:
    numbers = {"mean": 5.0, "standard_deviation": 0.5, "correlation_length": 0.01, "seed": 1, "modes": 1024}
    field = profile("random", **numbers)(np.linspace(0, 20, 4001))
    # 20 / 0.02 = 1000 independent stretches: the mean is good to 0.5 / sqrt(1000) = 0.016.
    assert field.mean() == pytest.approx(5.0, abs=0.06) and field.std() == pytest.approx(0.5, rel=0.1)
    assert np.abs(field - 5).max() <= 1.5 + 1e-12


def test_rounding_of_a_position_changes_no_random_class() -> None:
    """A node between two cells is in the later one, also where 3 x 0.07 is rounded down."""
    classes, ends = profile("random_classes", seed=4), np.arange(1, 400) * 0.07
    np.testing.assert_array_equal(classes(ends * (1 - 1e-12)), classes(ends + 0.01))
    assert (classes(ends - 0.01) != classes(ends + 0.01)).any()


def test_random_classes_have_the_weights() -> None:
    draws = profile("random_classes")(np.arange(4000) * 0.07 + 0.01)
    # Binomial with p = 0.75: standard deviation sqrt(p (1 - p) / 4000) = 0.007.
    assert set(draws) == {1.0, 2.0} and np.mean(draws == 2.0) == pytest.approx(0.75, abs=0.03)


def test_numbers_are_profiles_too() -> None:
    np.testing.assert_array_equal(evaluate(2.5, X), np.full_like(X, 2.5))


def test_laws_take_them() -> None:
    law = Coulomb.model_validate({"mu_d": example("boxcar")}).at(X)
    np.testing.assert_array_equal(law.mu_d, profile("boxcar")(X))
    assert Coulomb(mu_d=0.3).at(X).mu_d == 0.3


@pytest.mark.parametrize(
    "table, message",
    [
        ({"kind": "boxcar", "inside": 1.0}, "outside: this key is required and missing"),
        ({**example("gaussian"), "width": 0.0}, "width = 0.0: input should be greater than 0"),
        ({"kind": "table", "positions": [0.0, 1.0], "values": [1.0]}, "values: there are 1, each of 2 positions"),
        ({"kind": "table", "positions": [1.0, 0.0], "values": [1.0, 2.0]}, "positions"),
        ({**example("random_classes"), "weights": [0.0, 0.0]}, "weights: all are zero"),
        ({"kind": "wave"}, "unknown kind 'wave', known: along_axis, along_dip, boxcar, cone"),
        ("0.3", "input should be a valid number"),
    ],
)
def test_refusals(table: Any, message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        Coulomb(mu_d=table)


def test_units() -> None:
    assert unit_of(KINDS["boxcar"], "half_width") == "m" and unit_of(KINDS["boxcar"], "inside") == "1"


def test_a_profile_must_keep_the_bound_of_its_number():
    law = Coulomb(mu_d={"kind": "gaussian", "background": 0.5, "amplitude": -1.0, "center": 0.5, "width": 0.1})
    # 0.5 - exp(0) = -0.5 in the middle.
    with pytest.raises(CaseError, match=facts(r"Coulomb.mu_d = -0.5 at position 0.5 m: input should be greater")):
        law.at(np.linspace(0, 1, 11))
    stress = InitialStress(normal={"kind": "constant", "value": -1e6})
    with pytest.raises(CaseError, match=r"InitialStress.normal = -1e\+06"):
        stress.at(np.linspace(0, 1, 11))


def test_a_kind_that_is_no_text_is_a_message() -> None:
    with pytest.raises(ValidationError, match=facts("'kind' is required, one of: along_axis, along_dip")):
        Coulomb.model_validate({"mu_d": {"kind": {"kind": "table"}}})
