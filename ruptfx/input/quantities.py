"""Numbers with a unit as text: "6 MPa" is 6e6 for a stress.

A unit is a product of symbols, `/` divides by all that follows it, a number behind a symbol is its exponent: "kg/m3",
"MPa/mm", "N m", "1/s". Factors are exact fractions, so that "60 us" equals 60e-6 bitwise.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from fractions import Fraction

YEAR = 31557600.0  # s, Julian
_PREFIXES = {
    "n": Fraction(1, 10**9), "u": Fraction(1, 10**6), "µ": Fraction(1, 10**6), "μ": Fraction(1, 10**6),
    "m": Fraction(1, 1000), "c": Fraction(1, 100), "k": Fraction(1000), "M": Fraction(10**6), "G": Fraction(10**9),
}  # fmt: skip
_SYMBOLS: dict[str, tuple[Fraction, dict[str, int]]] = {
    "m": (Fraction(1), {"m": 1}),
    "L": (Fraction(1, 1000), {"m": 3}),
    "g": (Fraction(1, 1000), {"kg": 1}),
    "t": (Fraction(1000), {"kg": 1}),
    "s": (Fraction(1), {"s": 1}),
    "min": (Fraction(60), {"s": 1}),
    "h": (Fraction(3600), {"s": 1}),
    "d": (Fraction(86400), {"s": 1}),
    "yr": (Fraction(YEAR), {"s": 1}),  # Julian
    "Hz": (Fraction(1), {"s": -1}),
    "N": (Fraction(1), {"kg": 1, "m": 1, "s": -2}),
    "Pa": (Fraction(1), {"kg": 1, "m": -1, "s": -2}),
    "bar": (Fraction(10**5), {"kg": 1, "m": -1, "s": -2}),
    "J": (Fraction(1), {"kg": 1, "m": 2, "s": -2}),
    "K": (Fraction(1), {"K": 1}),
    "W": (Fraction(1), {"kg": 1, "m": 2, "s": -3}),
    "rad": (Fraction(1), {"rad": 1}),
    "deg": (Fraction(3.141592653589793) / 180, {"rad": 1}),
    "%": (Fraction(1, 100), {}),
    "1": (Fraction(1), {}),
}
_MICROSTRAIN = ("microstrain", "ustrain", "µstrain", "μstrain", "ue", "µε", "με")
# Exponents are short: a power of ten with a million digits takes minutes, and floats end at 1e308.
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)(?![eE]?[+-]?\d)\s*([^\d\s.].*?|1/.*?)\s*")
_FACTOR = re.compile(r"([A-Za-zµμε%]+|1)\^?(-?\d{1,2})?")


def parse(text: str, unit: str | None) -> float:
    """Return the number in the unit of a key, from text such as "6 MPa".

    Parameters
    ----------
    text : str
        A number and a unit.
    unit : str or None
        Unit of the key, for example ``Pa``; None for the SI unit of the text.

    Raises
    ------
    ValueError
        If the text is no number with a unit, or the unit is unknown or of another kind.
    """
    example = "'2 %'" if unit == "1" else f"'2 {unit or 'm'}'"
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise ValueError(f"input should be a valid number, or one with a unit, such as {example}")
    try:
        return float(Fraction(match[1]) * factor(match[2], unit))
    except OtherKind as error:
        raise ValueError(f"{error}; write for example {example}") from None
    except OverflowError:
        raise ValueError(f"{text}: is larger than any number; write for example {example}") from None


def in_si(text: str) -> float | None:
    """Return the number in SI units from text such as "6 MPa"; None if it is no number with a known unit."""
    match = _QUANTITY.fullmatch(text)
    try:
        return None if match is None else float(Fraction(match[1]) * factor(match[2], None))
    except (ValueError, OverflowError):
        return None


def si_and_units(value: object) -> tuple[object, list[str]]:
    """Return a value with texts such as "6 MPa", also in lists, as numbers in SI units, and the units of these."""
    if isinstance(value, list):
        pairs = [si_and_units(item) for item in value]
        return [item for item, _ in pairs], [unit for _, units in pairs for unit in units]
    number = in_si(value) if isinstance(value, str) else None
    if number is None or not isinstance(value, str):
        return value, []
    match = _QUANTITY.fullmatch(value)
    assert match is not None
    return number, [match[2]]


def require_units(key: str, units: list[str], wanted: str) -> None:
    """Refuse units of another kind than that of a key, whose numbers were read in SI units.

    Raises
    ------
    ValueError
    """
    for unit in units:
        try:
            known = factor(unit, wanted) and factor(wanted, None)
        except ValueError as error:
            raise ValueError(f"{key}: {error}") from None
        if known != 1:
            raise ValueError(f"{key}: {unit}: give a number in {wanted}")


class OtherKind(ValueError):  # noqa: N818
    """Error of a unit with another dimension than that of the key."""


def factor(text: str, unit: str | None) -> Fraction:
    """Return the exact factor from a unit to that of a key: 1/1000 from "mm" to "m"; without a key to the SI unit.

    Raises
    ------
    ValueError
        An unknown unit, or one of another kind.
    """
    value, dimension = _unit(text)
    if unit is None:
        return value
    wanted, wanted_dimension = _unit(unit)
    if dimension != wanted_dimension:
        raise OtherKind(f"a value in {unit} is wanted, and {text} is of another kind")
    return value / wanted


def _unit(text: str) -> tuple[Fraction, Counter[str]]:
    """Return the factor to SI and the exponents of the base units."""
    factor, dimension = Fraction(1), Counter[str]()
    for number, part in enumerate(text.split("/")):
        sign = -1 if number else 1
        for symbol in part.replace("*", " ").replace("·", " ").split():
            match = _FACTOR.fullmatch(symbol)
            if match is None:
                raise ValueError(f"unknown unit '{text}'; write for example 'N/m' or 'm s^-2'")
            scale, base = _symbol(match[1])
            exponent = sign * int(match[2] or 1)
            factor *= scale**exponent
            dimension.update({name: exponent * power for name, power in base.items()})
    return factor, Counter({name: power for name, power in dimension.items() if power})


def _symbol(name: str) -> tuple[Fraction, dict[str, int]]:
    if name in _SYMBOLS:
        return _SYMBOLS[name]
    if name in _MICROSTRAIN:  # without "strain": columns are called so
        return Fraction(1, 10**6), {}
    if name[0] in _PREFIXES and name[1:] in _SYMBOLS and name[1:] not in ("%", "1", "min", "d", "yr", "deg", "t"):
        scale, base = _SYMBOLS[name[1:]]
        return _PREFIXES[name[0]] * scale, base
    raise ValueError(
        f"unknown unit '{name}'; known: {', '.join(_SYMBOLS)}, n, u, m, c, k, M, G before "
        "them, and microstrain (ustrain, ue)"
    )


def with_prefix(value: float, unit: str, digits: int = 3) -> str:
    """Return a number with its unit and the prefix that leaves one to three digits before the point: "31.7 us".

    Times of more than ten years are in years: "163 yr".

    Parameters
    ----------
    unit : str
        One that takes prefixes: ``m``, ``s``, ``Pa``, ``m/s``.
    digits : int
        Significant digits.
    """
    if value == 0 or not math.isfinite(value):
        return f"{value:g} {unit}"
    if unit == "s" and abs(value) > 10 * YEAR:
        years = value / YEAR
        return f"{years:.{max(digits, len(str(int(abs(years)))))}g} yr"
    rounded = float(f"{value:.{digits - 1}e}")
    power = min(max(math.floor(math.log10(abs(rounded)) / 3), -3), 3 if unit != "s" else 0)
    scaled = rounded / 1000.0**power
    digits = max(digits, 1 + math.floor(math.log10(abs(scaled)) + 1e-9)) if abs(scaled) < 1000 else digits
    return f"{scaled:.{digits}g} {'num kMG'[power + 3].strip()}{unit}"


def at_most(bound: float, digits: int = 6) -> str:
    """Return an upper bound as text of a few digits that is not above it, so that a case may give what is printed."""
    return _rounded(bound, digits, ROUND_FLOOR)


def at_least(bound: float, digits: int = 6) -> str:
    """Return a lower bound as text of a few digits that is not below it, so that a case may give what is printed."""
    return _rounded(bound, digits, ROUND_CEILING)


def _rounded(bound: float, digits: int, rounding: str) -> str:
    if not math.isfinite(bound):
        return f"{bound:g}"
    return f"{float(Context(digits, rounding).create_decimal(repr(float(bound)))):.{digits}g}"
