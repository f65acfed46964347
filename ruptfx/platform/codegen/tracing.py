"""Pointwise NumPy formulas, recorded once, with exact derivatives and C code from the same source lines.

A friction law or a contact method is called with `Expression` objects instead of arrays; NumPy's own dispatch turns
``np.exp(x) * y`` into a graph. From the graph come the derivative with respect to any symbol, a NumPy function and C
statements. Equal subexpressions are one node, so that each is computed once.

Supported are arithmetic, also in place, comparisons, logic, ``np.where``, ``np.select``, ``np.clip`` and NumPy's
pointwise functions; operations that need a number, like a Python ``if``, raise an error. `record` adds the line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np
from pydantic import BaseModel

from ruptfx import RuptfxError, Table

Derivatives = tuple[Any, ...]
SMALLEST_NORMAL = float(np.finfo(float).tiny)
Recorded = TypeVar("Recorded")


def _refuse(what: str, instead: str) -> Callable[..., NoReturn]:
    """Return a special method that raises an error, for a value that is not yet known."""

    def method(self: Any, *args: Any, **options: Any) -> NoReturn:
        raise RuptfxError(f"{what}: {instead}")

    return method


_number = _refuse(
    "a number is needed here, but a law is recorded before there are any",
    "use numpy's functions instead of those of math, float, int or round",
)
_points = _refuse("a law acts point by point and cannot pick points", "use numpy.where(condition, value, other)")


class Expression(np.lib.mixins.NDArrayOperatorsMixin):
    """A node of the graph: an operation and its arguments; compares by identity of structure."""

    __slots__ = ("args", "is_condition", "op")
    op: str
    args: tuple[Any, ...]
    is_condition: bool

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        name = f"numpy.{ufunc.__name__}"
        if method != "__call__":
            raise RuptfxError(f"{name}.{method} cannot be traced: use pointwise functions")
        if "out" in options and "where" not in options:
            raise RuptfxError(f"{name} into an array or with out= cannot be traced: write x = x + y instead")
        if options:
            raise RuptfxError(f"{name} with {', '.join(options)}= cannot be traced: use numpy.where")
        return apply(ufunc.__name__, *inputs)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if function not in _FUNCTIONS:
            raise RuptfxError(f"numpy.{function.__name__} cannot be traced: use pointwise functions and numpy.where")
        return _FUNCTIONS[function](*args, **options)

    __bool__ = _refuse(
        "a law must not branch on a value", "use numpy.where instead of if, and, or, not, min, max or a chain a < x < b"
    )
    __float__ = __int__ = __index__ = __complex__ = __round__ = __trunc__ = __floor__ = __ceil__ = __format__ = _number
    __len__ = __iter__ = __getitem__ = __setitem__ = __contains__ = _points
    __array__ = _refuse("a traced value is no array", "leave out numpy.array, numpy.asarray and the like")

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"a traced value has no '{name}': use pointwise functions like numpy.{name}(x)")

    # `x += y` makes a new node, for nodes never change; NumPy's mixin would write into x.
    __iadd__ = np.lib.mixins.NDArrayOperatorsMixin.__add__
    __isub__ = np.lib.mixins.NDArrayOperatorsMixin.__sub__
    __imul__ = np.lib.mixins.NDArrayOperatorsMixin.__mul__
    __itruediv__ = np.lib.mixins.NDArrayOperatorsMixin.__truediv__
    __ifloordiv__ = np.lib.mixins.NDArrayOperatorsMixin.__floordiv__
    __imod__ = np.lib.mixins.NDArrayOperatorsMixin.__mod__
    __ipow__ = np.lib.mixins.NDArrayOperatorsMixin.__pow__
    __iand__ = np.lib.mixins.NDArrayOperatorsMixin.__and__
    __ior__ = np.lib.mixins.NDArrayOperatorsMixin.__or__
    __ixor__ = np.lib.mixins.NDArrayOperatorsMixin.__xor__

    def __repr__(self) -> str:
        return f"{self.op}({', '.join(map(repr, self.args))})"

    __hash__ = object.__hash__  # nodes are unique, see `_node`


@cache
def _node(op: str, *args: Any) -> Expression:
    node = Expression.__new__(Expression)
    node.op, node.args = op, args
    chosen = op in ("multiply", "where") and all(arg.is_condition for arg in args[-2:])
    node.is_condition = op in _CONDITIONS or chosen
    return node


def symbol(name: str) -> Expression:
    """Return an input of the formula."""
    return _node("symbol", name)


def constant(value: Any) -> Expression:
    """Return a number in the formula.

    Raises
    ------
    RuptfxError
        Not one real number.
    """
    try:
        return _node("constant", float(value))
    except (TypeError, ValueError):
        shown = f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else repr(value)
        raise RuptfxError(f"{shown} is no number; use numbers, parameters and what the method is given") from None


def _is(node: Any, value: float) -> bool:
    return bool(node.op == "constant" and node.args[0] == value)


def apply(op: str, *inputs: Any) -> Expression:  # noqa: C901
    """Return a new node, simplified if an argument is 0 or 1 (frequent in derivatives).

    Raises
    ------
    RuptfxError
        An operation that is not known, an argument that is no number, or conditions where numbers belong.
    """
    args = tuple(x if isinstance(x, Expression) else constant(x) for x in inputs)
    op = _ALIASES.get(op, op)
    if op in _SPELLED:
        spelled: Expression = _SPELLED[op](*args)
        return spelled
    if op not in _C:
        known = ", ".join(sorted(_C.keys() | _SPELLED.keys()))
        raise RuptfxError(f"numpy.{op} cannot be traced; known functions: {known}")
    if op not in _OF_CONDITIONS and all(x.is_condition for x in args):
        # NumPy itself would refuse, or return a condition or a number of half precision.
        raise RuptfxError(f"numpy.{op} of conditions: make numbers of them, numpy.where(condition, 1.0, 0.0)")
    match op, args:
        case ("add", (x, y)) if _is(x, 0):
            return y
        case ("add" | "subtract", (x, y)) if _is(y, 0):
            return x
        case ("subtract", (x, y)) if _is(x, 0):
            return apply("negative", y)
        case ("multiply", (x, y)) if _is(x, 0) or _is(y, 0):
            return constant(0)
        case ("multiply", (x, y)) if _is(x, 1):
            return y
        case ("multiply" | "divide" | "power", (x, y)) if _is(y, 1):
            return x
        case ("divide", (x, _)) if _is(x, 0):
            return x
        case ("where", (_, x, y)) if x is y:
            return x
        case ("power", (x, y)) if _is(y, 2):
            return apply("multiply", x, x)
    return _node(op, *args)


_ALIASES = {
    "absolute": "fabs", "float_power": "power", "fmax": "maximum", "fmin": "minimum", "true_divide": "divide",
    "bitwise_and": "logical_and", "bitwise_or": "logical_or", "bitwise_xor": "logical_xor", "invert": "logical_not",
    "bitwise_invert": "logical_not", "mod": "remainder", "rad2deg": "degrees", "deg2rad": "radians",
}  # fmt: skip

# Operations written in terms of others.
_SPELLED: dict[str, Callable[..., Any]] = {
    "positive": lambda x: x,
    "square": lambda x: x * x,
    "reciprocal": lambda x: 1 / x,
    "degrees": lambda x: x * (180 / np.pi),
    "radians": lambda x: x * (np.pi / 180),
    "floor_divide": lambda x, y: np.floor(x / y),
    "remainder": lambda x, y: x - np.floor(x / y) * y,
    # NaN must stay NaN.
    "heaviside": lambda x, middle: np.where(x < 0, 0.0, np.where(x > 0, 1.0, np.where(x == 0, middle, x))),
}

# C text of every operation; `{0}` is the first argument.
_C = {
    "add": "{0} + {1}", "subtract": "{0} - {1}", "multiply": "{0} * {1}", "divide": "{0} / {1}",
    "negative": "-{0}", "power": "pow({0}, {1})", "exp": "exp({0})", "log": "log({0})", "expm1": "expm1({0})",
    "log1p": "log1p({0})", "exp2": "exp2({0})", "log2": "log2({0})", "log10": "log10({0})",
    "sqrt": "sqrt({0})", "cbrt": "cbrt({0})", "hypot": "hypot({0}, {1})", "fabs": "fabs({0})",
    "sin": "sin({0})", "cos": "cos({0})", "tan": "tan({0})", "sinh": "sinh({0})", "cosh": "cosh({0})",
    "tanh": "tanh({0})", "arcsin": "asin({0})", "arccos": "acos({0})", "arctan": "atan({0})",
    "arctan2": "atan2({0}, {1})", "arcsinh": "asinh({0})", "arccosh": "acosh({0})", "arctanh": "atanh({0})",
    "logaddexp": "({0} == {1} ? {0} + M_LN2 : fmax({0}, {1}) + log1p(exp(-fabs({0} - {1}))))",
    "floor": "floor({0})", "ceil": "ceil({0})", "trunc": "trunc({0})", "rint": "rint({0})",
    "maximum": "({0} > {1} ? {0} : {1})", "minimum": "({0} < {1} ? {0} : {1})",
    "sign": "({0} > 0 ? 1.0 : {0} < 0 ? -1.0 : 0.0)", "where": "({0} != 0 ? {1} : {2})",
    "less": "(double)({0} < {1})", "less_equal": "(double)({0} <= {1})", "greater": "(double)({0} > {1})",
    "greater_equal": "(double)({0} >= {1})", "equal": "(double)({0} == {1})", "not_equal": "(double)({0} != {1})",
    "logical_and": "(double)({0} != 0) * ({1} != 0)", "logical_or": "(double)(({0} != 0) + ({1} != 0) > 0)",
    "logical_xor": "(double)(({0} != 0) != ({1} != 0))", "logical_not": "(double)({0} == 0)",
    "isfinite": "(double)(isfinite({0}) != 0)", "isinf": "(double)(isinf({0}) != 0)",
    "isnan": "(double)(isnan({0}) != 0)",
}  # fmt: skip

# The same, and faster in vectors, where all arguments are conditions, which are 0 or 1.
_C_OF_CONDITIONS = {
    "logical_and": "{0} * {1}", "logical_or": "({0} > {1} ? {0} : {1})", "logical_not": "1 - {0}",
}  # fmt: skip

_CONDITIONS = {
    "less", "less_equal", "greater", "greater_equal", "equal", "not_equal", "logical_and", "logical_or", "logical_xor",
    "logical_not", "isfinite", "isinf", "isnan",
}  # fmt: skip
_OF_CONDITIONS = {*_CONDITIONS, "where", "multiply"}


# Partial derivatives with respect to each argument; operations not listed are piecewise constant.
_RULES: dict[str, Callable[..., Derivatives]] = {
    "add": lambda x, y: (1.0, 1.0),
    "subtract": lambda x, y: (1.0, -1.0),
    "multiply": lambda x, y: (y, x),
    "divide": lambda x, y: (1 / y, -x / (y * y)),
    "negative": lambda x: (-1.0,),
    # d/dy only where the exponent depends on the variable; x = 0 is then the user's own singularity.
    "power": lambda x, y: (y * np.power(x, y - 1), np.log(x) * np.power(x, y)),
    "exp": lambda x: (np.exp(x),),
    "log": lambda x: (1 / x,),
    "expm1": lambda x: (np.exp(x),),
    "log1p": lambda x: (1 / (1 + x),),
    "exp2": lambda x: (np.log(2) * np.exp2(x),),
    "log2": lambda x: (1 / (np.log(2) * x),),
    "log10": lambda x: (1 / (np.log(10) * x),),
    "sqrt": lambda x: (0.5 / np.sqrt(x),),
    "cbrt": lambda x: (1 / (3 * np.cbrt(x) ** 2),),
    "hypot": lambda x, y: (x / np.hypot(x, y), y / np.hypot(x, y)),
    "fabs": lambda x: (np.sign(x),),
    "sin": lambda x: (np.cos(x),),
    "cos": lambda x: (-np.sin(x),),
    "tan": lambda x: (1 + np.tan(x) ** 2,),
    "sinh": lambda x: (np.cosh(x),),
    "cosh": lambda x: (np.sinh(x),),
    "tanh": lambda x: (1 - np.tanh(x) ** 2,),
    "arcsin": lambda x: (1 / np.sqrt(1 - x * x),),
    "arccos": lambda x: (-1 / np.sqrt(1 - x * x),),
    "arctan": lambda x: (1 / (1 + x * x),),
    "arctan2": lambda y, x: (x / (x * x + y * y), -y / (x * x + y * y)),
    "arcsinh": lambda x: (1 / np.sqrt(1 + x * x),),
    "arccosh": lambda x: (1 / np.sqrt(x * x - 1),),
    "arctanh": lambda x: (1 / (1 - x * x),),
    "logaddexp": lambda x, y: (1 / (1 + np.exp(y - x)), 1 / (1 + np.exp(x - y))),
    "maximum": lambda x, y: (np.where(x > y, 1.0, 0.0), np.where(x > y, 0.0, 1.0)),
    "minimum": lambda x, y: (np.where(x < y, 1.0, 0.0), np.where(x < y, 0.0, 1.0)),
    "where": lambda c, x, y: (0.0, np.where(c, 1.0, 0.0), np.where(c, 0.0, 1.0)),
}


def _where(condition: Any, *values: Any) -> Expression:
    if len(values) != 2:
        raise RuptfxError("numpy.where with a condition alone picks points: give both values, numpy.where(c, x, y)")
    return apply("where", condition, *values)


def _clip(x: Any, low: Any = None, high: Any = None, *, min: Any = None, max: Any = None, **given: Any) -> Expression:
    """Trace `numpy.clip`, whose bounds have two names each."""
    low, high = given.pop("a_min", low if min is None else min), given.pop("a_max", high if max is None else max)
    if given:
        raise RuptfxError(f"numpy.clip with {', '.join(given)}= cannot be traced")
    x = x if low is None else apply("maximum", x, low)
    return x if high is None else apply("minimum", x, high)


def _select(conditions: Iterable[Any], values: Iterable[Any], default: Any = 0.0) -> Expression:
    result = default if isinstance(default, Expression) else constant(default)
    for condition, value in reversed(list(zip(conditions, values, strict=True))):
        result = apply("where", condition, value, result)
    return result


_FUNCTIONS: dict[object, Callable[..., Expression]] = {
    np.where: _where,
    np.clip: _clip,
    np.select: _select,
    np.zeros_like: lambda x: constant(0.0),
    np.ones_like: lambda x: constant(1.0),
    np.full_like: lambda x, value: value if isinstance(value, Expression) else constant(value),
    np.copy: lambda x: x,
    np.round: lambda x: apply("rint", x),
}
"""NumPy's functions that are no ufuncs."""


def record(
    function: Callable[..., Any], *inputs: Any, as_: Callable[[Any], Recorded] = lambda result: result
) -> Recorded:
    """Call a method with symbols instead of numbers.

    Parameters
    ----------
    function : callable
        A bound method of a friction law or contact method.
    inputs
        Symbols, or containers of symbols.
    as_ : callable
        Converts the returned value to the expected type, or raises an error.

    Raises
    ------
    RuptfxError
        If an operation cannot be recorded, or after any other error in the method; with file, line and name.
    """
    try:
        return as_(function(*inputs))
    except Exception as error:
        raise RuptfxError(located(error, function)) from error


def located(error: Exception, function: Callable[..., Any]) -> str:
    """Return an error message with file, line and method of the innermost law or contact method in the traceback."""
    trace = error.__traceback__
    code = getattr(function, "__func__", function).__code__
    line = code.co_firstlineno
    while trace is not None:
        frame = trace.tb_frame
        # Laws and contact methods are the only models of pydantic that a traceback passes. Use the line in the law, not
        # that of __getattr__ after a missing attribute.
        if isinstance(frame.f_locals.get("self"), BaseModel) and not frame.f_code.co_name.startswith("__"):
            code, line = frame.f_code, trace.tb_lineno
        trace = trace.tb_next
    return f"{Path(code.co_filename).name}, line {line}, {code.co_name}: {_reason(error)}"


def _reason(error: Exception) -> str:
    match error:
        case RuptfxError() | AttributeError():
            return str(error)
        case KeyError():
            return f"there is no state variable {error}"
    return f"{type(error).__name__}: {error}"


def derivative(expression: Expression, variable: Expression) -> Expression:
    """Return the exact derivative of a traced expression with respect to a symbol (forward mode on the graph)."""
    return directional([expression], {variable: constant(1)})[0]


def directional(
    expressions: Iterable[Expression], directions: Mapping[Expression, Expression], guarded: bool = False
) -> list[Expression]:
    """Return the exact derivatives of traced expressions along directions, the changes of some nodes of the graph.

    Parameters
    ----------
    expressions : iterable of Expression
    directions : mapping of Expression to Expression
    guarded : bool
        Whether no change times an infinite derivative is zero.
    """
    expressions = list(expressions)
    slopes: dict[Expression, Expression] = {}
    for node in _ordered(expressions):
        if node in directions:
            slopes[node] = directions[node]
            continue
        total = constant(0)
        inner = [slopes.get(arg) if isinstance(arg, Expression) else None for arg in node.args]
        if node.op in _RULES and any(slope is not None and not _is(slope, 0) for slope in inner):
            if node.op == "where":  # 0 * inf in the unused branch must not affect the other
                condition, x, y = node.args
                total = apply("where", condition, slopes[x], slopes[y])
            else:
                for partial, slope in zip(_RULES[node.op](*node.args), inner, strict=True):
                    if slope is not None and not _is(slope, 0):
                        part = _times(slope, partial) if guarded else apply("multiply", partial, slope)
                        total = apply("add", total, part)
        slopes[node] = total
    return [slopes[expression] for expression in expressions]


def transposed(seeds: Mapping[Expression, Expression], variables: Iterable[Expression]) -> list[Expression]:
    """Return the sum of seed times derivative over traced expressions, for each variable (reverse mode on the graph).

    Parameters
    ----------
    seeds : mapping of Expression to Expression
        Factor of each expression.
    variables : iterable of Expression
        Symbols.
    """
    total: dict[Expression, Expression] = dict(seeds)
    for node in reversed(_ordered(seeds)):
        factor = total.get(node, constant(0))
        if node.op not in _RULES or _is(factor, 0):
            continue
        if node.op == "where":
            condition, x, y = node.args
            parts = [(x, apply("where", condition, factor, 0.0)), (y, apply("where", condition, 0.0, factor))]
        else:
            parts = list(zip(node.args, (_times(factor, each) for each in _RULES[node.op](*node.args)), strict=True))
        for arg, part in parts:
            total[arg] = apply("add", total.get(arg, constant(0)), part)
    return [total.get(variable, constant(0)) for variable in variables]


def _times(factor: Expression, partial: Any) -> Expression:
    """Return a factor times a partial derivative, zero where the factor is, also where the derivative is infinite."""
    if not isinstance(partial, Expression) or partial.op == "constant":
        return apply("multiply", factor, partial)
    return apply("where", apply("equal", factor, 0.0), 0.0, apply("multiply", factor, partial))


def substituted(expressions: Iterable[Expression], values: Mapping[Expression, Expression]) -> list[Expression]:
    """Return traced expressions with other expressions in the place of some symbols."""
    expressions = list(expressions)
    new: dict[Expression, Expression] = {}
    for node in _ordered(expressions):
        if node in values:
            new[node] = values[node]
        else:
            new[node] = _node(node.op, *(new[arg] if isinstance(arg, Expression) else arg for arg in node.args))
    return [new[expression] for expression in expressions]


def by_reciprocals(outputs: Mapping[str, Expression]) -> dict[str, Expression]:
    """Return outputs in which products with reciprocals replace quotients by numbers: equal up to rounding, and faster.

    A reciprocal that is not a normal number is not used.
    """
    new: dict[Expression, Expression] = {}
    for node in _ordered(outputs.values()):
        args = [new[arg] if isinstance(arg, Expression) else arg for arg in node.args]
        over = node.args[1].args[0] if node.op == "divide" and node.args[1].op == "constant" else 0.0
        if SMALLEST_NORMAL < abs(over) < 1 / SMALLEST_NORMAL:
            new[node] = _node("multiply", args[0], constant(1 / over))
        else:
            new[node] = _node(node.op, *args)
    return {name: new[node] for name, node in outputs.items()}


def symbols_of(expressions: Iterable[Expression]) -> list[str]:
    """Return the names of the symbols that occur in traced expressions, in the order of their first use."""
    return [node.args[0] for node in _ordered(expressions) if node.op == "symbol"]


def depends(expression: Any, variables: Iterable[Expression]) -> bool:
    """Return whether any of the symbols occurs in a traced expression (or number)."""
    return isinstance(expression, Expression) and not set(_ordered([expression])).isdisjoint(variables)


def _ordered(roots: Iterable[Expression]) -> list[Expression]:
    """Return every node once, arguments before their users."""
    order: dict[Expression, None] = {}
    todo = [(root, False) for root in reversed(list(roots))]
    while todo:  # iterative, because a loop in a law makes deep graphs
        node, visited = todo.pop()
        if visited:
            order[node] = None
        elif node not in order:
            todo.append((node, True))
            todo += [(arg, False) for arg in reversed(node.args) if isinstance(arg, Expression)]
    return list(order)


def statements(
    outputs: Mapping[str, Expression | float], spell: Callable[[Expression, list[str]], str],
    literal: Callable[[float], str], names: Mapping[str, str] | None = None,
) -> tuple[list[tuple[str, str]], dict[str, str]]:  # fmt: skip
    """Return the formulas of outputs as assignments, each operation once.

    Parameters
    ----------
    spell : callable
        Returns the text of a node from the texts of its arguments.
    literal : callable
        Returns the text of a number.
    names : mapping of str to str, optional
        Text of symbols that are not written by their name.

    Returns
    -------
    list of (str, str)
        Variable and text of every operation, in order.
    dict of str to str
        Text of every output.
    """
    targets = {name: x if isinstance(x, Expression) else constant(x) for name, x in outputs.items()}
    texts: dict[Expression, str] = {}
    lines: list[tuple[str, str]] = []
    for node in _ordered(targets.values()):
        if node.op == "symbol":
            texts[node] = (names or {}).get(node.args[0], node.args[0])
        elif node.op == "constant":
            texts[node] = literal(node.args[0])
        else:
            texts[node] = f"e{len(lines)}"
            lines.append((texts[node], spell(node, [texts[arg] for arg in node.args])))
    return lines, {target: texts[node] for target, node in targets.items()}


def c_text(node: Expression, args: list[str]) -> str:
    """Return the C text of an operation."""
    texts = _C | _C_OF_CONDITIONS if all(arg.is_condition for arg in node.args) else _C
    return texts[node.op].format(*args)


def c_literal(value: float) -> str:
    """Return the C text of a number."""
    return _literal(value, "INFINITY", "NAN")


def numpy_text(node: Expression, args: list[str]) -> str:
    """Return the NumPy text of an operation."""
    return f"np.{node.op}({', '.join(args)})"


def numpy_literal(value: float) -> str:
    """Return the NumPy text of a number."""
    return _literal(value, "np.inf", "np.nan")


def to_c(outputs: Mapping[str, Expression | float], end: str = "\n", names: Mapping[str, str] | None = None) -> str:
    """Return C statements that assign every output from variables with the names of the symbols, or with `names`."""
    lines, results = statements(outputs, c_text, c_literal, names)
    written = [f"const double {name} = {text};" for name, text in lines]
    return end.join([*written, *(f"{target} = {text};" for target, text in results.items())])


def _literal(value: float, infinity: str, nan: str) -> str:
    if np.isnan(value):
        return nan
    return f"({value!r})" if np.isfinite(value) else f"({'-' * (value < 0)}{infinity})"


def uniform_parts(
    outputs: Mapping[str, Expression], of: Expression, prefix: str
) -> tuple[dict[str, Expression], dict[str, Expression]]:
    """Return outputs with new symbols for all parts that depend on one symbol only, and these parts.

    Parameters
    ----------
    of : Expression
        The symbol, the same at all points.
    prefix : str
        Of the names of the new symbols; numbers follow.

    Returns
    -------
    dict of str to Expression
        The outputs.
    dict of str to Expression
        The parts by symbol name, to be computed once for all points.
    """
    depends: dict[Expression, bool | None] = {}  # None: of constants only
    parts: dict[Expression, Expression] = {}
    for node in _ordered(outputs.values()):
        inner = [depends[arg] for arg in node.args if isinstance(arg, Expression)]
        of_symbol = node is of if node.op == "symbol" else None
        if inner:
            of_symbol = False if False in inner else True if True in inner else None
        depends[node] = of_symbol
        if of_symbol is False:
            for arg in node.args:
                if isinstance(arg, Expression) and depends[arg] and arg is not of and arg not in parts:
                    parts[arg] = symbol(f"{prefix}{len(parts)}")
    for output in outputs.values():
        if depends[output] and output is not of and output not in parts:
            parts[output] = symbol(f"{prefix}{len(parts)}")
    kept = dict(zip(outputs, substituted(outputs.values(), parts), strict=True))
    return kept, {made.args[0]: part for part, made in parts.items()}


def to_numpy(outputs: Mapping[str, Expression], inputs: list[str]) -> Callable[..., tuple[np.ndarray, ...]]:
    """Return a function of arrays, in the order of `inputs`, that returns the outputs in their order."""
    lines, results = statements(outputs, numpy_text, numpy_literal)
    returned = "".join(f"{text}, " for text in results.values())
    body = [f"    {name} = {text}" for name, text in lines]
    source = "\n".join([f"def function({', '.join(inputs)}):", *body, f"    return ({returned})"])
    scope: Table = {"np": np}
    exec(source, scope)
    function: Callable[..., tuple[np.ndarray, ...]] = scope["function"]
    return function
