"""Refusals of cases name the key, the value and the remedy; sentences may change.

Each key of the demo cases gets wrong values, so that a key in a new demo is tried without an edit here. The sentences
of all refusals in the package are read from its source.
"""

from __future__ import annotations

import ast
import copy
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import ruptfx
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError

PACKAGE = Path(ruptfx.__file__).parent
DEMOS = Path(__file__).parents[2] / "demos"
CASES = {path.stem: table for path in sorted(DEMOS.glob("*.toml"))
         if "axes" not in (table := tomllib.loads(path.read_text()))}  # fmt: skip
WRONG = {"-7.25e+33": -7.25e33, "7.25e+33": 7.25e33, "'seven'": "seven"}


def leaves(node: Any, path: tuple[str | int, ...] = (), kind: str = "") -> Iterator[tuple[str, tuple[str | int, ...]]]:
    """Yield the path of each value but kinds, with a name that is the same wherever its table is used."""
    kind = str(node.get("kind", kind)) if isinstance(node, dict) else kind
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        if key != "kind" and not isinstance(value, dict):
            name = next(str(each) for each in reversed((*path, key)) if isinstance(each, str))
            yield f"{kind}, {name}, {type(value).__name__}", (*path, key)
        yield from leaves(value, (*path, key), kind)


def once() -> dict[str, list[tuple[str | int, ...]]]:
    """Return the paths of the values of each demo that no demo before it has."""
    seen, found = set[str](), dict[str, list[tuple[str | int, ...]]]()
    for name, table in CASES.items():
        for what, path in leaves(table):
            if what not in seen:
                seen.add(what)
                found.setdefault(name, []).append(path)
    return found


PATHS = once()


def at(table: Any, path: tuple[str | int, ...]) -> Any:
    for key in path:
        table = table[key]
    return table


def named(line: str, table: dict[str, Any]) -> list[str]:
    """Return the keys at the start of a message that lead to a table or value of the case."""
    found, node = [], table
    for key in line.partition(": ")[0].partition(" = ")[0].split("."):
        try:
            node = node[int(key)] if isinstance(node, list) else node[key]
        except (KeyError, IndexError, ValueError, TypeError):
            break
        found.append(key)
    return found


def refused(table: dict[str, Any], path: tuple[str | int, ...], value: object) -> str | None:
    """Return the message about a case with another value; None if that is accepted."""
    table = copy.deepcopy(table)
    at(table, path[:-1])[path[-1]] = value
    try:
        parse_case(table, DEMOS)
    except CaseError as error:
        return str(error)
    return None


def names_it(line: str, table: dict[str, Any], path: tuple[str | int, ...], shown: str) -> bool:
    """Return whether a line leads to the table of a key, and has the key and a value: its own, or one it gives.

    Elastic constants are given as others, and several numbers may be wrong together only.
    """
    key = next(each for each in reversed(path) if isinstance(each, str))
    keys = named(line, table)
    leads = line.startswith("case: ") or (bool(keys) and keys == [str(each) for each in path][: len(keys)])
    valued = shown.strip("'") in line or re.search(r"= -?[0-9]|[0-9.e+-]+ (Pa|m)\b", line) is not None
    return leads and valued and (key in line or keys[:1] == ["materials"])


@pytest.mark.parametrize("demo", PATHS)
def test_key_and_value_are_named(demo: str) -> None:
    found = [
        message for path in PATHS[demo] for shown, value in WRONG.items()
        if (message := refused(CASES[demo], path, value)) is not None
        and not any(names_it(line, CASES[demo], path, shown) for line in message.splitlines())
    ]  # fmt: skip
    assert found == []


# -- the sentences of the package ------------------------------------------------------------------------------------

REMEDY = re.compile(
    r"\b(use|give|make|remove|leave|choose|add|refine|raise|lower|write|change|keep|move|lengthen|shorten|widen|coarsen|"
    r"install|enlarge|reduce|increase|rename|place|put|say|start|declare|derive|run|check|split|set|take|hold|extend|"
    r"fill|name them|must|needs?|needed|wanted|required|known|at least|at most|more than|less than|er than|"
    r"has the columns|did you mean|one of|input should)\b"
)
"""What to do, or what is allowed."""
PASSED_ON = re.compile(r"\{[^}]*(error|reason|remedy|hint|nearest|found|known)[^}]*\}")
"""The message of another refusal, a list of what is known."""


def text_of(node: ast.expr) -> str | None:
    """Return the text of a message, with its expressions in braces; None if it is made elsewhere."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(str(each.value) if isinstance(each, ast.Constant) else f"{{{ast.unparse(each.value)}}}"
                       for each in node.values if isinstance(each, ast.Constant | ast.FormattedValue))  # fmt: skip
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        parts = text_of(node.left), text_of(node.right)
        return None if None in parts else "".join(part or "" for part in parts)
    return None


def refusals() -> Iterator[tuple[str, str]]:
    """Yield the file and the message of every refusal of a case."""
    for path in sorted(PACKAGE.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(source)) if re.search(r"raise (Case|Value)Error\(", source) else ():
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                name, text = ast.unparse(node.exc.func), text_of(node.exc.args[0])
                if name in ("CaseError", "ValueError") and text is not None:
                    yield str(path.relative_to(PACKAGE)), text


REFUSALS = list(refusals())


def test_refusals_are_found() -> None:
    assert len(REFUSALS) > 250


@pytest.mark.parametrize("file, message", [
    pytest.param(file, text, id=f"{file}, {text[:50]}") for file, text in REFUSALS
])  # fmt: skip
def test_a_refusal_says_what_to_do_or_what_is_allowed(file: str, message: str) -> None:
    assert REMEDY.search(message) or PASSED_ON.search(message), message
