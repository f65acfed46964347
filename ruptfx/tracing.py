"""Pointwise NumPy formulas, recorded once: exact derivatives and C code from the same lines.

A friction law or a contact method is called with `Expression` objects instead of arrays; NumPy's own dispatch turns
``np.exp(x) * y`` into a graph. From the graph come the derivative with respect to any symbol, a NumPy function and C
statements. Equal subexpressions are one node, so that nothing is computed twice.

Supported are arithmetic, comparisons, ``np.where`` and the functions of `_RULES`; a Python ``if`` on a value cannot
be recorded and says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np

from ruptfx import RuptfxError

Derivatives = tuple[Any, ...]


class Expression(np.lib.mixins.NDArrayOperatorsMixin):
    """A node of the graph: an operation and its arguments; compares by identity of structure."""

    __slots__ = ("args", "op")
    op: str
    args: tuple[Any, ...]

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            return NotImplemented
        return apply(ufunc.__name__, *inputs)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if function is np.where and len(args) == 3:
            return apply("where", *args)
        if function in (np.zeros_like, np.ones_like):
            return constant(0.0 if function is np.zeros_like else 1.0)
        raise RuptfxError(f"numpy.{function.__name__} cannot be traced: use pointwise functions and numpy.where")

    def __bool__(self) -> bool:
        raise RuptfxError("a law must not branch on a value: use numpy.where instead of if, and, or, min, max")

    def __repr__(self) -> str:
        return f"{self.op}({', '.join(map(repr, self.args))})"

    __hash__ = object.__hash__  # nodes are unique, see `_node`


@cache
def _node(op: str, *args: Any) -> Expression:
    node = Expression.__new__(Expression)
    node.op, node.args = op, args
    return node


def symbol(name: str) -> Expression:
    """An input of the formula."""
    return _node("symbol", name)


def constant(value: float) -> Expression:
    return _node("constant", float(value))


def _is(node: Any, value: float) -> bool:
    return node.op == "constant" and node.args[0] == value


def apply(op: str, *inputs: Any) -> Expression:
    """A new node, simplified where an argument is 0 or 1 (derivatives are full of them)."""
    args = tuple(x if isinstance(x, Expression) else constant(x) for x in inputs)
    op = _ALIASES.get(op, op)
    if op not in _C:
        raise RuptfxError(f"numpy.{op} cannot be traced; known functions: {', '.join(sorted(_C))}")
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


_ALIASES = {"absolute": "fabs", "float_power": "power", "fmax": "maximum", "fmin": "minimum", "true_divide": "divide"}

# C text of every operation; `{0}` is the first argument.
_C = {
    "add": "{0} + {1}", "subtract": "{0} - {1}", "multiply": "{0} * {1}", "divide": "{0} / {1}",
    "negative": "-{0}", "power": "pow({0}, {1})", "exp": "exp({0})", "log": "log({0})", "expm1": "expm1({0})",
    "log1p": "log1p({0})", "sqrt": "sqrt({0})", "fabs": "fabs({0})", "arcsinh": "asinh({0})", "sinh": "sinh({0})",
    "cosh": "cosh({0})", "tanh": "tanh({0})", "sin": "sin({0})", "cos": "cos({0})",
    "maximum": "({0} > {1} ? {0} : {1})", "minimum": "({0} < {1} ? {0} : {1})",
    "sign": "(double)(({0} > 0) - ({0} < 0))", "where": "({0} != 0 ? {1} : {2})",
    "less": "(double)({0} < {1})", "less_equal": "(double)({0} <= {1})", "greater": "(double)({0} > {1})",
    "greater_equal": "(double)({0} >= {1})", "equal": "(double)({0} == {1})", "not_equal": "(double)({0} != {1})",
    "logical_and": "(double)({0} != 0 && {1} != 0)", "logical_or": "(double)({0} != 0 || {1} != 0)",
    "logical_not": "(double)({0} == 0)",
    "bitwise_and": "(double)({0} != 0 && {1} != 0)", "bitwise_or": "(double)({0} != 0 || {1} != 0)",
}  # fmt: skip

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
    "sqrt": lambda x: (0.5 / np.sqrt(x),),
    "fabs": lambda x: (np.sign(x),),
    "arcsinh": lambda x: (1 / np.sqrt(1 + x * x),),
    "sinh": lambda x: (np.cosh(x),),
    "cosh": lambda x: (np.sinh(x),),
    "tanh": lambda x: (1 - np.tanh(x) ** 2,),
    "sin": lambda x: (np.cos(x),),
    "cos": lambda x: (-np.sin(x),),
    "maximum": lambda x, y: (np.where(x > y, 1.0, 0.0), np.where(x > y, 0.0, 1.0)),
    "minimum": lambda x, y: (np.where(x < y, 1.0, 0.0), np.where(x < y, 0.0, 1.0)),
    "where": lambda c, x, y: (0.0, np.where(c, 1.0, 0.0), np.where(c, 0.0, 1.0)),
}


def derivative(expression: Expression, variable: Expression) -> Expression:
    """Exact derivative of a traced expression with respect to a symbol (forward mode on the graph)."""
    slopes: dict[Expression, Expression] = {}
    for node in _ordered([expression]):
        if node is variable:
            slopes[node] = constant(1)
            continue
        total = constant(0)
        inner = [slopes.get(arg) if isinstance(arg, Expression) else None for arg in node.args]
        if node.op in _RULES and any(slope is not None and not _is(slope, 0) for slope in inner):
            if node.op == "where":  # 0 * inf in the branch not taken must not spoil the other
                condition, x, y = node.args
                total = apply("where", condition, slopes[x], slopes[y])
            else:
                for partial, slope in zip(_RULES[node.op](*node.args), inner, strict=True):
                    if slope is not None and not _is(slope, 0):
                        total = apply("add", total, apply("multiply", partial, slope))
        slopes[node] = total
    return slopes[expression]


def depends(expression: Any, variables: Iterable[Expression]) -> bool:
    """Whether any of the symbols occurs in a traced expression (or number)."""
    return isinstance(expression, Expression) and not set(_ordered([expression])).isdisjoint(variables)


def _ordered(roots: Iterable[Expression]) -> list[Expression]:
    """Every node once, arguments before their users."""
    order: dict[Expression, None] = {}

    def visit(node: Expression) -> None:
        if node not in order:
            for arg in node.args:
                if isinstance(arg, Expression):
                    visit(arg)
            order[node] = None

    for root in roots:
        visit(root)
    return list(order)


def to_c(outputs: Mapping[str, Expression], indent: str = "    ") -> str:
    """C statements that assign every output from variables named like the symbols."""
    names: dict[Expression, str] = {}
    lines: list[str] = []
    for node in _ordered(outputs.values()):
        if node.op == "symbol":
            names[node] = node.args[0]
        elif node.op == "constant":
            names[node] = f"({node.args[0]!r})"
        else:
            names[node] = f"e{len(lines)}"
            text = _C[node.op].format(*(names[arg] for arg in node.args))
            lines.append(f"{indent}const double {names[node]} = {text};")
    lines += [f"{indent}{target} = {names[node]};" for target, node in outputs.items()]
    return "\n".join(lines)


def to_numpy(outputs: Mapping[str, Expression], inputs: list[str]) -> Callable[..., tuple[np.ndarray, ...]]:
    """A function of arrays, in the order of `inputs`, that returns the outputs in their order."""
    names: dict[Expression, str] = {}
    lines: list[str] = []
    for node in _ordered(outputs.values()):
        if node.op == "symbol":
            names[node] = node.args[0]
        elif node.op == "constant":
            names[node] = repr(node.args[0])
        else:
            names[node] = f"e{len(lines)}"
            lines.append(f"    {names[node]} = np.{node.op}({', '.join(names[arg] for arg in node.args)})")
    returned = "".join(f"{names[node]}, " for node in outputs.values())
    source = "\n".join([f"def function({', '.join(inputs)}):", *lines, f"    return ({returned})"])
    scope: dict[str, Any] = {"np": np}
    exec(source, scope)
    return scope["function"]
