"""Numbers with units as text: in keys, lists and profiles; the same bits as the number in SI."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.messages import facts
from helpers.small_cases import merged, plates

from ruptfx.case import parse_case
from ruptfx.input.quantities import at_least, at_most, parse
from ruptfx.input.schema import CaseError


@pytest.mark.parametrize(
    "text, unit, number",
    [
        ("60 us", "s", 60e-6),  # 60 * 1e-6 in floating point is 5.9999999999999995e-05
        ("6 MPa", "Pa", 6e6),
        ("5 \u03bcs", "s", 5e-6),  # the Greek letter
        ("5 \u00b5s", "s", 5e-6),  # the micro sign
        ("0.3bar", "Pa", 0.3e5),
        ("-2.5e-1 km", "m", -250.0),
        ("300 MPa/mm", "Pa/m", 3e11),
        ("1.246 g/cm3", "kg/m3", 1246.0),
        ("2 km/s", "m/s", 2e3),
        ("300 kHz", "1/s", 3e5),
        ("5 1/ms", "1/s", 5e3),
        ("22.6 kN/m", "N/m", 22.6e3),
        ("3 N m", "N m", 3.0),
        ("1 min", "s", 60.0),
        ("30 s", "min", 0.5),
        ("2 %", "1", 0.02),
        ("180 deg", "rad", 3.141592653589793),
        *((f"250 {unit}", "1", 250e-6) for unit in ("ue", "ustrain", "microstrain", "\u00b5\u03b5", "\u03bc\u03b5")),
        ("0.25 m/s", None, 0.25),
    ],
)
def test_numbers_with_units(text: str, unit: str | None, number: float) -> None:
    assert parse(text, unit) == number


@pytest.mark.parametrize(
    "text, message",
    [
        ("60e-6", "input should be a valid number, or one with a unit, such as '2 s'"),
        ("soon", "input should be a valid number"),
        ("60 mm", "a value in s is wanted, and mm is of another kind"),
        ("6 parsec", "unknown unit 'parsec'; known: m, g"),
        ("6 kmin", "unknown unit 'kmin'"),
        ("6 mue", "unknown unit 'mue'"),
        ("6 ue", "a value in s is wanted, and ue is of another kind"),
        ("1e999 s", "1e999 s: is larger than any number"),
        # Powers of ten with so many digits took minutes.
        ("1e99999999 s", "input should be a valid number"),
        ("1e-99999999 s", "input should be a valid number"),
        ("1 km^99999999", "unknown unit"),
    ],
)
def test_what_is_no_time(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=facts(message)):
        parse(text, "s")


def unknown_shear(noise: object = 0.01, **unknown: object) -> dict[str, Any]:
    term = {"kind": "traces", "instrument": "end", "times": [1e-6, 2e-6], "sigma": noise,
            "data": {"slip_rate": [0.0, 0.0]}, "units": {"slip_rate": "mm/s"}}  # fmt: skip
    key = {"key": "faults.main.initial_stress.shear", "shape": "number", **unknown}
    receiver = {"kind": "fault_receiver", "name": "end", "interval": 1e-7, "position": 6e-3}
    return plates({"objective": [term], "unknowns": [key], "instruments": [receiver]})


def test_bounds_are_printed_so_that_they_hold() -> None:
    assert (at_most(1.23456789e-8), at_least(1.23456789e-8)) == ("1.23456e-08", "1.23457e-08")
    assert (at_most(-2.0000001), at_least(-2.0000001)) == ("-2.00001", "-2")
    assert at_most(20000.1) == at_least(20000.1) == "20000.1"  # the nearest float is below it
    assert (at_most(float("inf")), at_least(0.0)) == ("inf", "0")


def test_numbers_whose_unit_another_key_names() -> None:
    """Deviations of channels and bounds of keys are read in the unit of these; the resolved case has SI numbers."""
    case = parse_case(unknown_shear("10 mm/s", sigma="2 MPa", bounds=["1 bar", 3e6]))
    assert case.objective[0].sigma == 0.01
    assert (case.unknowns[0].sigma, case.unknowns[0].bounds) == (2e6, [1e5, 3e6])
    assert case == parse_case(unknown_shear(0.01, sigma=2e6, bounds=[1e5, 3e6]))


@pytest.mark.parametrize("table, message", [
    (unknown_shear("10 mm"), r"objective\.0: sigma in mm: .* slip_rate"),
    (unknown_shear("ten"), r"objective\.0\.sigma = 'ten': .* SI unit of the channels; write a number"),
    (unknown_shear(sigma="2 m"), r"unknowns\.0\.sigma: .* in Pa .* m "),
    (unknown_shear(bounds=["1 s", "3 MPa"]), r"unknowns\.0\.bounds: .* in Pa .* s "),
    (unknown_shear(scale="log", sigma="1 MPa"), r"unknowns\.0\.sigma = '1 MPa': .* logarithm; write 1e\+06"),
])  # fmt: skip
def test_units_of_another_kind_than_that_key(table: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        parse_case(table)


def test_wherever_a_number_with_a_unit_stands() -> None:
    profile: dict[str, Any] = {"kind": "boxcar", "center": "3 cm", "half_width": "5 mm"}
    wave = {"kind": "ricker", "frequency": "300 kHz", "delay": "4 us"}
    edge = {"kind": "traction", "edge": "upper.top"}

    def case(times: bool) -> dict[str, Any]:
        return merged(plates(), {
            "duration": "20 us" if times else 20e-6,
            "faults.main.initial_stress.normal": profile | {"inside": "6 MPa" if times else 6e6, "outside": 5e6},
            "boundaries": [edge | {"traction": ["1 kPa" if times else 1e3, 0.0], "history": wave}],
        })  # fmt: skip

    assert parse_case(case(True)) == parse_case(case(False))
    assert parse_case(case(True)).hash == parse_case(case(False)).hash
    assert parse_case(case(True)).faults["main"].initial_stress.normal.center == 0.03


def test_bounds_hold_for_text() -> None:
    for value, message in (("-6 us", "greater than 0"), ("6 MPa", "another kind")):
        with pytest.raises(CaseError, match=facts(f"duration = '?{value[:2]}.*{message}")):
            parse_case(plates({"duration": value}))


def test_elastic_constants_in_other_words() -> None:
    """E = 2 G (1 + nu); from G = rho c_s^2 and (c_p / c_s)^2 = 2 (1 - nu) / (1 - 2 nu)."""
    rock = {"kind": "isotropic_elastic", "density": 2670.0}
    by_shear = material(rock | {"shear_modulus": "32 GPa", "poisson_ratio": 0.25})
    assert (by_shear.young_modulus, by_shear.poisson_ratio) == (80e9, 0.25)
    by_speeds = material(rock | {"c_p": "6 km/s", "c_s": 6e3 / 3**0.5})  # nu = 1/4: c_p^2 = 3 c_s^2
    assert by_speeds.poisson_ratio == pytest.approx(0.25, rel=1e-14)
    assert by_speeds.young_modulus == pytest.approx(2.5 * 2670 * 12e6, rel=1e-14)
    assert by_speeds.wave_speeds("strain").c_p == pytest.approx(6e3, rel=1e-14)


@pytest.mark.parametrize(
    "keys, message",
    [
        ({"c_p": 6e3}, "c_s: this key is required and missing"),
        ({"c_p": 6e3, "c_s": 6e3}, "c_p = 6000: must be more than sqrt(4/3) c_s = 6928.2"),
        ({"c_p": 6e3, "c_s": -1.0}, "c_s = -1.0: input should be greater than 0"),
        ({"c_p": 6e3, "c_s": 3e3, "poisson_ratio": 0.2}, "give either c_p and c_s or poisson_ratio"),
        ({"shear_modulus": 1e9, "young_modulus": 1e9, "poisson_ratio": 0.2}, "give either shear_modulus and"),
        ({"shear_modulus": "1 m", "poisson_ratio": 0.2}, "a value in Pa is wanted"),
    ],
)
def test_elastic_constants_that_do_not_fit(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError) as caught:
        material({"kind": "isotropic_elastic", "density": 2670.0} | keys)
    assert "materials.default" in str(caught.value) and message in str(caught.value)


def material(table: dict[str, Any]) -> Any:
    return parse_case(plates() | {"materials": {"default": table}}).materials["default"]
