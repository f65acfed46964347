"""Friction laws as source code for other programs, one language per file, from the one traced formula.

A language has a function `write(law)` that returns the texts of its files by their names.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
from pydantic import ValidationError

from ruptfx import RuptfxError, __version__
from ruptfx.app.check_law.examples import tables
from ruptfx.case import Case, override, read_case
from ruptfx.input.plugins import active, load
from ruptfx.input.schema import CaseError, Part, descriptions, find, kinds, nearest, own_kinds, own_module, unit_of
from ruptfx.interfaces.faults.projection import parameters_as_symbols
from ruptfx.laws.friction import FrictionLaw
from ruptfx.platform.codegen.tracing import (
    Expression,
    constant,
    derivative,
    record,
    symbol,
    symbols_of,
)

POINTS = 8  # of the self-test
STATE = "s_"
PARAMETER = "p_"
UNITS = {"slip_rate": "m/s", "normal_stress": "Pa", "shear_stress": "Pa", "dt": "s"}
TOLERANCE = 1e-12  # relative, of the self-test


class Parameter(NamedTuple):
    """Parameter of an exported law."""

    name: str
    value: float
    unit: str
    description: str


class Function(NamedTuple):
    """Function of an exported law.

    Attributes
    ----------
    name, description : str
    inputs : tuple of str
        Numbers after parameters and state.
    reads_state : bool
    outputs : dict of str to Expression
        The value, or the state variables by name.
    """

    name: str
    description: str
    inputs: tuple[str, ...]
    reads_state: bool
    outputs: Mapping[str, Expression]

    @property
    def returns_state(self) -> bool:
        """Return whether the function returns a state, not one value."""
        return "value" not in self.outputs


class Sample(NamedTuple):
    """Arguments of the functions of the self-test and the numbers of this package."""

    inputs: Mapping[str, float]
    state: Mapping[str, float]
    expected: Mapping[str, Mapping[str, float]]
    """Outputs by the name of the function."""


@dataclass(frozen=True)
class ExportedLaw:
    """Everything that a language writes.

    Attributes
    ----------
    kind : str
    about : list of str
        Paragraphs of the comment at the head of a file.
    parameters : list of Parameter
    states : dict of str to str
        Units of the state variables by name.
    functions : list of Function
    samples : list of Sample
    """

    kind: str
    about: list[str]
    parameters: list[Parameter]
    states: Mapping[str, str]
    functions: list[Function]
    samples: list[Sample]

    def names(self, parameter: str, state: str) -> dict[str, str]:
        """Return the texts of parameters and state variables by their symbols, from a text with a place for a name."""
        texts = {PARAMETER + each.name: parameter.format(each.name) for each in self.parameters}
        return texts | {STATE + name: state.format(name) for name in self.states}

    def head(self, comment: str, width: int = 100) -> str:
        """Return the comment at the head of a file, from the begin of its lines."""
        lines = [line for text in self.about for line in (textwrap.wrap(text, width) or [""])]
        return "\n".join(f"{comment} {line}".rstrip() for line in lines) + "\n"


def languages() -> list[str]:
    """Return the languages, the names of the files of this folder."""
    return own_kinds(__name__)


def files_of(law: ExportedLaw, language: str) -> dict[str, str]:
    """Return the texts of the files in a language, by name.

    Raises
    ------
    RuptfxError
        No such language.
    """
    if language not in languages():
        raise RuptfxError(f"--to {language}: unknown language, {nearest(language, languages())}")
    write: Callable[[ExportedLaw], dict[str, str]] = own_module(__name__, language).write
    return write(law)


def law_of(what: str, changes: Iterable[str] = (), fault: str | None = None) -> FrictionLaw:
    """Return the law of a kind, of a Python file with one law, or of a fault of a case.

    Parameters
    ----------
    what : str
        A kind, a file that ends with .py, or a case that ends with .toml.
    changes : iterable of str
        ``"mu_s=0.6"``: parameters; for a case its keys.
    fault : str, optional
        Of several faults of a case, the one whose law it is.

    Raises
    ------
    RuptfxError
        No such kind, file or fault, or invalid parameters.
    """
    if what.endswith(".toml"):
        return _law_of_case(what, list(changes), fault)
    package = "ruptfx.laws.friction"
    plugins = [load(what)] if what.endswith(".py") else []
    with active(plugins):
        own = list(plugins[0].classes.get(package, {})) if plugins else kinds(package)
        if plugins and len(own) != 1:
            raise RuptfxError(f"export-law {what}: defines {len(own)} friction laws, and 1 is wanted; split the file")
        kind = own[0] if plugins else what
        if kind not in own:
            raise RuptfxError(f"export-law {what}: no file (.py, .toml) and no kind of friction: {nearest(what, own)}")

        def change(table: dict[str, Any]) -> None:
            for item in changes:
                override(table, item)

        cls = find(package, kind)
        try:
            return cast("FrictionLaw", cls.model_validate(tables(cls, 1, change)[0]))
        except ValidationError as error:
            raise CaseError.from_validation(error, kind) from None


def _law_of_case(path: str, changes: list[str], fault: str | None) -> FrictionLaw:
    case = read_case(path, overrides=changes)
    if isinstance(case, Case):
        laws = {name: each.friction for name, each in case.faults.items() if each.friction is not None}
    else:  # a lumped model
        law = getattr(case, "friction", None)
        laws = {"friction": law} if isinstance(law, FrictionLaw) else {}
    if fault is None and len(laws) == 1:
        return next(iter(laws.values()))
    if fault not in laws:
        shown = "which of them? use --fault NAME" if fault is None else f"there is no '{fault}'; use another --fault"
        raise RuptfxError(f"export-law {path}: faults with friction: {', '.join(laws) or 'none'}; {shown}")
    return laws[fault]


def exported(law: FrictionLaw) -> ExportedLaw:
    """Trace a law and describe it for the languages.

    Raises
    ------
    RuptfxError
        A parameter that is not one number, or a formula that cannot be traced.
    """
    values, traced = parameters_as_symbols(law, PARAMETER)
    for part, prefix in _parts(law):
        for name in type(part).model_fields:
            if isinstance(value := getattr(part, name), Part) and not isinstance(value, FrictionLaw):
                raise RuptfxError(
                    f"export-law: {prefix}{name} of {law.kind()} is a profile; give one number, for example with --set "
                    f"{prefix.replace('_', '.')}{name}=..."
                )
    functions = list(_functions(traced, law))
    used = {name for each in functions for name in symbols_of(each.outputs.values())}
    described = {name: (unit, text) for name, unit, text in _described(law)}
    parameters = [
        Parameter(name.removeprefix(PARAMETER), float(value), *described[name.removeprefix(PARAMETER)])
        for name, value in values.items() if name in used
    ]  # fmt: skip
    states = law.all_state_fields()
    return ExportedLaw(law.kind(), _about(law, parameters, states), parameters, states, functions,
                       _samples(law, functions))  # fmt: skip


def _parts(law: FrictionLaw) -> Iterator[tuple[FrictionLaw, str]]:
    """Yield a law and those that it wraps, each with the prefix of its parameters."""
    prefix = ""
    part: FrictionLaw | None = law
    while part is not None:
        yield part, prefix
        part, prefix = getattr(part, "law", None), f"{prefix}law_"


def _described(law: FrictionLaw) -> Iterator[tuple[str, str, str]]:
    """Yield name, unit and description of every parameter."""
    for part, prefix in _parts(law):
        texts = descriptions(type(part))
        for name in type(part).model_fields:
            yield f"{prefix}{name}", unit_of(type(part), name), " ".join(texts.get(name, "").split())


def _functions(traced: FrictionLaw, law: FrictionLaw) -> Iterator[Function]:
    names = list(law.all_state_fields())
    state = {name: symbol(STATE + name) for name in names}
    rate, stress, shear, dt = map(symbol, ("slip_rate", "normal_stress", "shear_stress", "dt"))

    def value(result: Any) -> Expression:
        return result if isinstance(result, Expression) else constant(result)

    def fields(result: Mapping[str, Any]) -> dict[str, Expression]:
        return {name: value(result[name]) for name in names}

    strength = record(traced.strength, rate, stress, dict(state), as_=value)
    at = ("slip_rate", "normal_stress")
    yield Function("strength", "shear strength [Pa] while the interface slides at slip_rate >= 0; at 0 the largest "
                   "shear stress without sliding", at, True, {"value": strength})  # fmt: skip
    yield Function("strength_slope", "derivative of the strength by the slip rate [Pa s/m]", at, True,
                   {"value": derivative(strength, rate)})  # fmt: skip
    if names:
        inputs = ("normal_stress", "shear_stress", "slip_rate")
        advanced = record(traced.advance, dict(state), rate, stress, dt, as_=fields)
        initial = record(traced.initial_state, stress, shear, rate, as_=fields)
        about = "state after a step dt at a constant slip rate and normal stress, exact at any dt"
        yield Function("advance", about, (*at, "dt"), True, advanced)
        about = "state before the first slip, of laws that creep that which carries a shear stress at a slip rate"
        yield Function("initial_state", about, inputs, False, initial)


def _about(law: FrictionLaw, parameters: list[Parameter], states: Mapping[str, str]) -> list[str]:
    wraps = [f"{prefix.replace('_', '.')}{name}" for part, prefix in _parts(law) for name in ("law",)
             if getattr(part, "law", None) is not None]  # fmt: skip
    lines = [f"{part.kind()}: {type(part).summary()}\nFormula: {part.formula}\nSource: {part.source}"
             for part, _ in _parts(law)]  # fmt: skip
    return [
        f"Friction law {law.kind()}, written by ruptfx {__version__} from its one traced formula.",
        "",
        *(line for text in lines for line in text.split("\n")),
        *([f"A law that another one wraps has the prefix of its key: {', '.join(wraps)}."] if wraps else []),
        "",
        "SI units. Normal stress positive in compression; slip rate and shear stress are magnitudes.",
        *([f"State: {', '.join(f'{name} [{unit}]' for name, unit in states.items())}."] if states else ["No state."]),
        "Parameters: " + "; ".join(f"{each.name} [{each.unit}] = {each.value:g}" for each in parameters) + ".",
    ]


def _samples(law: FrictionLaw, functions: list[Function]) -> list[Sample]:
    """Return random arguments and the numbers that the law of this package has there."""
    random = np.random.default_rng(1)
    rate, stress = 10 ** random.uniform(-9, 1, POINTS), 10 ** random.uniform(5, 8, POINTS)
    shear, dt = stress * random.uniform(0.2, 0.6, POINTS), 10 ** random.uniform(-7, 2, POINTS)
    with np.errstate(all="ignore"):
        first = law.initial_state(stress, shear, rate)
        state = law.advance(first, 10 ** random.uniform(-9, 1, POINTS), stress, dt)
        state = {name: np.broadcast_to(value, POINTS).astype(float) for name, value in state.items()}
        expected: dict[str, Mapping[str, Any]] = {
            "strength": {"value": law.strength(rate, stress, state)},
            "advance": law.advance(state, rate, stress, dt), "initial_state": first,
        }  # fmt: skip
    known = {each.name for each in functions}
    inputs = {"slip_rate": rate, "normal_stress": stress, "shear_stress": shear, "dt": dt}
    return [
        Sample(
            {name: float(value[i]) for name, value in inputs.items()},
            {name: float(value[i]) for name, value in state.items()},
            {
                function: {name: float(np.broadcast_to(value, POINTS)[i]) for name, value in outputs.items()}
                for function, outputs in expected.items() if function in known
            },
        )
        for i in range(POINTS)
    ]  # fmt: skip


def wrapped(text: str, width: int, indent: str, end: str = "") -> str:
    """Return a statement in lines of at most a width, continued after `end`."""
    lines = textwrap.wrap(text, width - len(indent) - len(end) - 2, break_long_words=False, break_on_hyphens=False)
    return f"{end}\n{indent}    ".join([f"{indent}{lines[0]}", *lines[1:]])
