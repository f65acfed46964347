"""Formulas recorded once: values, exact derivatives and C from the same lines; what cannot be recorded says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.platform.codegen.tracing import (
    _C,
    _RULES,
    _SPELLED,
    apply,
    by_reciprocals,
    constant,
    derivative,
    symbol,
    to_c,
    to_numpy,
    uniform_parts,
)

X, Y = symbol("x"), symbol("y")
POINTS = np.linspace(0.15, 2.9, 23)
COMPARISONS = ["less", "less_equal", "greater", "greater_equal", "equal", "not_equal"]
UNARY = [
    "negative", "exp", "log", "expm1", "log1p", "sqrt", "fabs", "arcsinh", "sinh", "cosh", "tanh", "sin", "cos",
    "exp2", "log2", "log10", "cbrt", "tan", "arcsin", "arccos", "arctan", "arccosh", "arctanh",
    "square", "reciprocal", "positive", "degrees", "radians",
]  # fmt: skip
BINARY = ["add", "subtract", "multiply", "divide", "power", "maximum", "minimum", "hypot", "arctan2", "logaddexp",
          "remainder"]  # fmt: skip
STEPS = ["floor", "ceil", "trunc", "rint", "sign", "isfinite", "isinf", "isnan", "logical_not"]
DOMAINS = {"arcsin": (-0.9, 0.9), "arccos": (-0.9, 0.9), "arctanh": (-0.9, 0.9), "arccosh": (1.15, 2.9)}


def value(expression: Any, **at: Any) -> np.ndarray:
    return np.broadcast_to(to_numpy({"f": expression}, list(at))(*at.values())[0], np.shape(next(iter(at.values()))))


def slope(function: Any, x: np.ndarray, h: float = 1e-6) -> np.ndarray:
    """Central difference; error h^2 and 1e-16 / h, about 1e-10."""
    return (function(x + h) - function(x - h)) / (2 * h)


def test_every_rule_is_tested() -> None:
    assert set(_RULES) <= {*UNARY, *BINARY, "where"}
    # What has no rule is piecewise constant.
    assert set(_C) - set(_RULES) == {*STEPS, *COMPARISONS, "logical_and", "logical_or", "logical_xor"}
    assert set(_SPELLED) <= {*UNARY, *BINARY, "floor_divide", "heaviside"}


@pytest.mark.parametrize("name", UNARY)
def test_unary_derivatives(name: str) -> None:
    recorded, plain = getattr(np, name)(X), getattr(np, name)
    at = np.linspace(*DOMAINS[name], 23) if name in DOMAINS else POINTS
    np.testing.assert_allclose(value(recorded, x=at), plain(at), rtol=1e-15)
    np.testing.assert_allclose(value(derivative(recorded, X), x=at), slope(plain, at), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("name", STEPS)
def test_steps_have_no_slope(name: str) -> None:
    recorded, at = getattr(np, name)(X), np.array([-2.7, -0.3, 0.4, 1.6, np.inf, np.nan])
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(value(recorded, x=at), getattr(np, name)(at))
    assert derivative(recorded, X) is constant(0)


def test_functions_spelled_with_others() -> None:
    at = np.array([-3.7, -1.0, 0.0, 0.3, 5.0, np.nan])
    np.testing.assert_array_equal(value(np.heaviside(X, 0.25), x=at), np.heaviside(at, 0.25))
    np.testing.assert_array_equal(value(X // 0.8, x=at), at // 0.8)
    np.testing.assert_allclose(value(X % 0.8, x=at), at % 0.8, rtol=1e-14)
    np.testing.assert_array_equal(value(np.clip(X, -1.5, 1.0), x=at), np.clip(at, -1.5, 1.0))
    np.testing.assert_array_equal(value(np.clip(X, None, 1.0), x=at), np.clip(at, None, 1.0))
    np.testing.assert_array_equal(value(np.clip(X, min=0.1), x=at), np.clip(at, min=0.1))
    np.testing.assert_array_equal(value(np.clip(X, a_min=0.1, a_max=2), x=at), np.clip(at, a_min=0.1, a_max=2))
    chosen = [np.select([x < 0, x < 1], [2 * x, x * x], -1.0) for x in (X, at)]
    np.testing.assert_array_equal(value(chosen[0], x=at), chosen[1])
    np.testing.assert_array_equal(value(derivative(chosen[0], X), x=at), [2, 2, 0, 0.6, 0, 0])


def test_in_place_operators_give_a_new_value() -> None:
    def formula(x: Any) -> Any:
        y = 1 * x
        y += 2.0
        y *= x
        y -= 0.25
        y /= 3.0
        y **= 3
        y %= 7.0
        y //= 0.5
        return y

    np.testing.assert_array_equal(value(formula(X), x=POINTS), formula(POINTS))
    flag = X > 1
    flag &= X < 2
    flag |= X > 2.5
    flag ^= X > 2.7
    expected = ((POINTS > 1) & (POINTS < 2)) | (POINTS > 2.5)
    np.testing.assert_array_equal(value(flag, x=POINTS), expected ^ (POINTS > 2.7))


def test_numbers_that_are_none() -> None:
    """Infinity and not-a-number may stand in a formula, in NumPy and in C."""
    parts = {"a": np.where(X > 1, np.inf, -np.inf), "b": np.where(X > 1, np.nan, X)}
    found = to_numpy(parts, ["x"])(np.array([0.5, 2.0]))
    np.testing.assert_array_equal(found, [[-np.inf, np.inf], [0.5, np.nan]])
    assert "(-INFINITY)" in to_c(parts) and "NAN" in to_c(parts)


@pytest.mark.parametrize("value, shown", [(np.ones(3), r"shape.*\(3,\)"), ("seven", "'seven'")])
def test_what_is_no_number_is_shown(value: Any, shown: str) -> None:
    with pytest.raises(RuptfxError, match=rf"{shown}.*; use numbers, parameters"):
        constant(value)


def test_long_loops() -> None:
    x = X
    for _ in range(3000):
        x = 0.5 * (x + Y / x)
    at = {"x": np.array([1.0]), "y": np.array([2.0])}
    np.testing.assert_allclose(value(x, **at), np.sqrt(2.0), rtol=1e-15)
    np.testing.assert_allclose(value(derivative(x, Y), **at), 0.5 / np.sqrt(2.0), rtol=1e-13)


@pytest.mark.parametrize("name", ["add", "subtract", "negative", "exp", "sqrt", "maximum", "power"])
def test_conditions_are_no_numbers(name: str) -> None:
    """NumPy refuses them, makes a condition of their sum, and has half precision for their roots."""
    function = getattr(np, name)
    with pytest.raises(RuptfxError, match=facts(r"of conditions: make numbers of them, numpy\.where")):
        function(*[X > 1, (X < 2) * (Y > 0)][: function.nin])
    np.testing.assert_array_equal(value((X > 1) * 2.0 + 1, x=np.array([0.0, 2.0])), [1, 3])


@pytest.mark.parametrize("name", BINARY)
def test_binary_derivatives(name: str) -> None:
    recorded, plain, other = getattr(np, name)(X, Y), getattr(np, name), 1.234
    at = {"x": POINTS, "y": np.full_like(POINTS, other)}
    np.testing.assert_allclose(value(recorded, **at), plain(POINTS, other), rtol=1e-15)
    by_x, by_y = (value(derivative(recorded, variable), **at) for variable in (X, Y))
    np.testing.assert_allclose(by_x, slope(lambda x: plain(x, other), POINTS), rtol=1e-7, atol=1e-8)
    expected = slope(lambda y: plain(POINTS, y), np.full_like(POINTS, other))
    np.testing.assert_allclose(by_y, expected, rtol=1e-7, atol=1e-8)


def test_chain_product_and_shared_parts() -> None:
    def formula(x: Any) -> Any:
        common = np.exp(-x) * x
        return np.tanh(common**3 + 2 * common) / (1 + common) - common

    first = derivative(formula(X), X)
    np.testing.assert_allclose(value(first, x=POINTS), slope(formula, POINTS), rtol=1e-7)
    expected = slope(lambda x: value(first, x=x), POINTS)
    np.testing.assert_allclose(value(derivative(first, X), x=POINTS), expected, rtol=1e-6)


def test_where_keeps_the_branch_not_taken_out() -> None:
    """The derivative of log(x) at x = 0 is infinite, but it is not the branch that counts."""
    safe = np.where(X > 0, X * np.log(X), 3 * X)
    with np.errstate(all="ignore"):
        found = value(derivative(safe, X), x=np.array([0.0, 1.0]))
    np.testing.assert_allclose(found, [3.0, 1.0])


def test_comparisons_and_logic() -> None:
    both = np.where(np.logical_and(X > 1, X < 2), 1.0, 0.0)
    np.testing.assert_array_equal(value(both, x=np.array([0.5, 1.5, 2.5])), [0, 1, 0])
    either = np.where((X <= 1) | (X >= 2), 1.0, 0.0)
    np.testing.assert_array_equal(value(either, x=np.array([0.5, 1.5, 2.5])), [1, 0, 1])
    # Piecewise constant: no derivative.
    np.testing.assert_array_equal(value(derivative(both, X), x=np.array([0.5, 1.5])), [0, 0])


def test_equal_parts_are_one_node() -> None:
    assert np.exp(X + 1) is np.exp(X + 1)
    code = to_c({"a": np.exp(X + 1) * 2, "b": np.exp(X + 1) * 3})
    assert code.count("exp(") == 1


def test_simplifications() -> None:
    assert X + 0 is X and 0 + X is X and X * 1 is X and X / 1 is X and X**1 is X and X - 0 is X
    assert (X * 0).op == "constant" and (0 - X).op == "negative" and (X**2).op == "multiply"
    assert np.where(X > 0, Y, Y) is Y


def test_a_constant_has_no_slope() -> None:
    assert derivative(constant(3), X).args == (0.0,) and derivative(Y, X).args == (0.0,)


def test_refuses_to_branch() -> None:
    with pytest.raises(RuptfxError, match=facts(r"use numpy\.where instead of if")):
        max(X, Y)
    with pytest.raises(RuptfxError, match=r"numpy\.where"):
        bool(X > 1)


def test_refuses_what_is_not_pointwise() -> None:
    with pytest.raises(RuptfxError, match=facts(r"numpy\.interp cannot be traced")):
        np.interp(X, [0, 1], [0, 1])
    with pytest.raises(RuptfxError, match=facts(r"numpy\.spacing cannot be traced; known functions: .*exp")):
        np.spacing(X)
    with pytest.raises(RuptfxError, match=r"numpy\.spherical_bessel"):
        apply("spherical_bessel", X)


def test_compiled_c_is_numpy(tmp_path: Any) -> None:
    """All operations in one function, compiled and called."""
    import ctypes

    from ruptfx.platform.codegen import native

    unary = [name for name in (*UNARY, *STEPS) if name not in DOMAINS]
    pairs = [*BINARY, *COMPARISONS, "heaviside", "floor_divide"]
    formulas = [getattr(np, name)(X) for name in unary] + [getattr(np, name)(X, Y) for name in pairs]
    formulas += [np.arcsin(X / 9), np.arccos(X / 9), np.arctanh(X / 9), np.arccosh(1 + X * X)]
    formulas += [function(X > 1, Y < 1) for function in (np.logical_and, np.logical_or, np.logical_xor)]
    formulas += [np.where(X > Y, np.sign(X - Y), -1.5), np.where(~(X < 1) | (Y == 2), np.inf, -np.inf)]
    formulas += [np.clip(X, 0.5, 2.0), X - Y == 0, np.logaddexp(X, X), np.isnan(0 / (X - 1) * np.nan)]
    formulas += [derivative(formula, X) for formula in formulas]
    parts = {f"o[{i}]": formula for i, formula in enumerate(formulas)}
    source = f"#include <math.h>\nvoid all(double x, double y, double *o)\n{{\n{to_c(parts)}\n}}\n"
    function = native.load("all_operations", source).all
    out = np.zeros(len(parts))
    for x, y in ((0.3, 1.7), (2.5, 0.4), (1.25, 2.0), (2.0, 2.0)):
        function(ctypes.c_double(x), ctypes.c_double(y), ctypes.c_void_p(out.ctypes.data))
        expected = to_numpy(parts, ["x", "y"])(x, y)
        np.testing.assert_allclose(out, np.array(expected, float), rtol=1e-13)


def test_parts_of_one_symbol_are_computed_once() -> None:
    """exp(-y) and its sum with 1 are parts, y itself and x y are not; the values are bitwise the same."""
    kept = np.exp(-Y)
    outputs = {"f": X * (kept + 1) + X * Y, "g": kept * 2, "h": X + 1, "i": Y}
    found, parts = uniform_parts(outputs, Y, "o_")
    assert set(parts.values()) == {kept + 1, kept * 2}
    at = {name: to_numpy({"p": part}, ["y"])(0.3)[0] for name, part in parts.items()}
    whole = to_numpy(outputs, ["x", "y"])(POINTS, 0.3)
    split = to_numpy(found, ["x", "y", *parts])(POINTS, 0.3, *at.values())
    for one, other in zip(whole, split, strict=True):
        np.testing.assert_array_equal(one, other)


def test_quotients_by_numbers_become_products() -> None:
    outputs = {"a": (X / 3.0 + Y / X) / 1e-320, "b": np.exp(X / 3.0), "c": X / 0.0}
    found = by_reciprocals(outputs)
    assert "divide(symbol('x'), constant(3.0))" not in repr(found)
    assert f"multiply(symbol('x'), constant({1 / 3.0!r}))" in repr(found["b"])
    assert found["a"].op == found["c"].op == "divide"  # the reciprocal is infinite
    with np.errstate(all="ignore"):
        for x, y in ((0.7, -2.0), (-1.3, 5.0)):
            expected, got = (to_numpy(each, ["x", "y"])(x, y) for each in (outputs, found))
            np.testing.assert_allclose(got, expected, rtol=1e-15)
