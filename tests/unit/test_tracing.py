"""Formulas recorded once: values, exact derivatives and C from the same lines; what cannot be recorded says so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ruptfx import RuptfxError
from ruptfx.tracing import _RULES, apply, constant, derivative, symbol, to_c, to_numpy

X, Y = symbol("x"), symbol("y")
POINTS = np.linspace(0.15, 2.9, 23)
UNARY = ["negative", "exp", "log", "expm1", "log1p", "sqrt", "fabs", "arcsinh", "sinh", "cosh", "tanh", "sin", "cos"]
BINARY = ["add", "subtract", "multiply", "divide", "power", "maximum", "minimum"]


def value(expression: Any, **at: Any) -> np.ndarray:
    return np.broadcast_to(to_numpy({"f": expression}, list(at))(*at.values())[0], np.shape(next(iter(at.values()))))


def slope(function: Any, x: np.ndarray, h: float = 1e-6) -> np.ndarray:
    """Central difference; error h^2 and 1e-16 / h, about 1e-10."""
    return (function(x + h) - function(x - h)) / (2 * h)


def test_every_rule_is_tested() -> None:
    assert set(_RULES) == {*UNARY, *BINARY, "where"}


@pytest.mark.parametrize("name", UNARY)
def test_unary_derivatives(name: str) -> None:
    recorded, plain = getattr(np, name)(X), getattr(np, name)
    np.testing.assert_allclose(value(recorded, x=POINTS), plain(POINTS), rtol=1e-15)
    np.testing.assert_allclose(value(derivative(recorded, X), x=POINTS), slope(plain, POINTS), rtol=1e-7, atol=1e-8)


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
    with pytest.raises(RuptfxError, match=r"use numpy\.where instead of if"):
        max(X, Y)
    with pytest.raises(RuptfxError, match=r"must not branch"):
        bool(X > 1)


def test_refuses_what_is_not_pointwise() -> None:
    with pytest.raises(RuptfxError, match=r"numpy\.interp cannot be traced"):
        np.interp(X, [0, 1], [0, 1])
    with pytest.raises(RuptfxError, match=r"numpy\.arctan cannot be traced; known functions: .*exp"):
        np.arctan(X)
    with pytest.raises(RuptfxError, match="cannot be traced"):
        apply("spherical_bessel", X)


def test_compiled_c_is_numpy(tmp_path: Any) -> None:
    """All operations in one function, compiled and called."""
    import ctypes

    from ruptfx import native

    parts = {f"o[{i}]": getattr(np, name)(X) for i, name in enumerate(UNARY)}
    parts |= {f"o[{i + len(UNARY)}]": getattr(np, name)(X, Y) for i, name in enumerate(BINARY)}
    n = len(parts)
    parts |= {f"o[{n}]": np.where(X > Y, np.sign(X - Y), -1.5), f"o[{n + 1}]": np.where((X < 1) | (Y == 2), 1.0, 0.0)}
    source = f"#include <math.h>\nvoid all(double x, double y, double *o)\n{{\n{to_c(parts)}\n}}\n"
    function = native.load("all_operations", source).all
    out = np.zeros(len(parts))
    for x, y in ((0.3, 1.7), (2.5, 0.4), (1.0, 2.0)):
        function(ctypes.c_double(x), ctypes.c_double(y), ctypes.c_void_p(out.ctypes.data))
        expected = to_numpy(parts, ["x", "y"])(x, y)
        np.testing.assert_allclose(out, np.array(expected, float), rtol=1e-13)
