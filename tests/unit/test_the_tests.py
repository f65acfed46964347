"""The tests themselves: none ends without having asked for something."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import Skips
from helpers.messages import facts, says

TESTS = Path(__file__).parents[1]
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def bare_returns(source: str) -> list[str]:
    """Return the functions called `test_...` that have a `return` without a value, each with its line."""
    tests = [node for node in ast.walk(ast.parse(source)) if isinstance(node, FUNCTIONS) and node.name[:5] == "test_"]
    return [f"{test.name}, line {node.lineno}" for test in tests for node in own_nodes(test)
            if isinstance(node, ast.Return) and node.value is None]  # fmt: skip


def called(node: ast.AST) -> set[str]:
    """Return the names of the functions that a function calls; an `assert` is one of them."""
    return {
        "assert" if isinstance(each, ast.Assert) else getattr(each.func, "attr", getattr(each.func, "id", ""))
        for each in ast.walk(node) if isinstance(each, (ast.Assert, ast.Call))
    }  # fmt: skip


def asserts(name: str) -> bool:
    """Return whether a function of this name asserts: `assert`, `raises`, `assert_allclose` and others."""
    return name in ("raises", "warns", "fail") or name.startswith("assert")


def without_assertions(sources: dict[str, str]) -> list[str]:
    """Return the tests in which nothing is asserted, neither by themselves nor by functions of these files."""
    functions = [(path, node.name, called(node)) for path, source in sources.items()
                 for node in ast.walk(ast.parse(source)) if isinstance(node, FUNCTIONS)]  # fmt: skip
    helpers, before = {name for _, name, calls in functions if any(map(asserts, calls))}, -1
    while len(helpers) > before:
        before = len(helpers)
        helpers |= {name for _, name, calls in functions if calls & helpers}
    return [f"{path}: {name}" for path, name, _ in functions if name.startswith("test_") and name not in helpers]


def own_nodes(parent: ast.AST) -> Iterator[ast.AST]:
    """Iterate over the nodes of a function but those of the functions inside of it."""
    for node in ast.iter_child_nodes(parent):
        if not isinstance(node, (*FUNCTIONS, ast.Lambda, ast.ClassDef)):
            yield node
            yield from own_nodes(node)


@pytest.mark.parametrize(("pattern", "expected"), [
    (r"boundaries\.0\.normal = 1e\+09: plane = 'antiplane' moves in z only",
     r"boundaries\.0\.normal = 1e\+09: plane = 'antiplane'"),
    (r"dt = .*below the time step of 0\.5 s; use 'leapfrog'", r"dt =(?s:.*)0\.5 s(?s:.*)'leapfrog'"),
    ("materials: one of both is needed", "materials"),
    ("times must increase", "times must increase"),
    (r"no (root|sign) of it at 5 s|other 5", r"no (root|sign) of it at 5 s|other 5"),
])  # fmt: skip
def test_facts_of_a_message_are_its_keys_and_values(pattern: str, expected: str) -> None:
    assert facts(pattern) == expected


def test_other_facts_are_no_match() -> None:
    said = "run.toml: stepper.safety = 1.5: it should be less than or equal to 1"
    assert says("stepper.safety = 1.5: must be at most 1", said)
    assert not says("stepper.safety = 1.5: must be at most 2", said)
    assert not says("stepper.safty = 1.5: must be at most 1", said)
    assert not says("at most 1, stepper.safety = 1.5", said)


OF_TESTS = ("no good here", "no mesh today", "disk full", "no such mesh", "division by zero", "inserted sweeps",
            "shows otherwise", "no run is needed")  # fmt: skip
"""Messages that tests or their helpers raise themselves, or Python."""


@pytest.mark.parametrize("path", sorted(TESTS.rglob("test_*.py")), ids=lambda path: path.name)
def test_messages_are_matched_by_their_facts(path: Path) -> None:
    """A sentence that is reworded breaks the test of its message at most: see `messages`."""
    sentences = [node.value for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
                 if isinstance(node, ast.keyword) and node.arg == "match"]  # fmt: skip
    texts = [node.value for node in sentences if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    assert [text for text in texts if " " in text and facts(text) != text] == []
    calls = [node for node in sentences if isinstance(node, ast.Call) and ast.unparse(node.func) == "facts"]
    texts += [node.args[0].value for node in calls if isinstance(node.args[0], ast.Constant)]
    assert [text for text in texts if re.fullmatch(r"(?:[A-Za-z]+ )+[A-Za-z]+", text) and text not in OF_TESTS] == []


def test_what_tests_share_is_in_no_test() -> None:
    """A test that imports another one is tied to it: cases and functions of several are in `helpers`."""
    found = {
        (path.name, node.module) for path in TESTS.rglob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.ImportFrom)
    }  # fmt: skip
    assert [(path, module) for path, module in found if (module or "").rpartition(".")[2].startswith("test_")] == []


@pytest.mark.parametrize("path", sorted(TESTS.rglob("test_*.py")), ids=lambda path: path.name)
def test_no_test_returns_early(path: Path) -> None:
    """It would pass: use `pytest.skip` with a reason, or parametrize with what fits."""
    assert bare_returns(path.read_text(encoding="utf-8")) == []


def test_every_test_asserts_something() -> None:
    sources = {str(path.relative_to(TESTS)): path.read_text(encoding="utf-8") for path in TESTS.rglob("*.py")}
    assert without_assertions(sources) == []


def test_tests_without_assertions_are_found() -> None:
    source = """
def compare(a, b):
    assert a == b
def twice(a, b):
    compare(a, b)
def test_one():
    twice(1, 1)
def test_two():
    print(1)
def test_three():
    with pytest.raises(ValueError):
        int("")
"""
    assert without_assertions({"test_x.py": source}) == ["test_x.py: test_two"]


def test_bare_returns_are_found() -> None:
    source = """
def test_one():
    if unlike:
        return
    def inside():
        return
    assert inside() is None
def helper():
    return
class Group:
    async def test_two(self):
        for each in more:
            return
"""
    assert bare_returns(source) == ["test_one, line 4", "test_two, line 13"]


def test_skips_are_counted_and_unknown_reasons_make_a_run_fail() -> None:
    def report(outcome: str, text: object) -> pytest.TestReport:
        return pytest.TestReport("test_x", ("test_x.py", 1, "test_x"), {}, outcome, text, "call")

    skips, where = Skips(allowed=("no state", "rank 0 .*")), ("test_x.py", 1)
    for each in (report("skipped", (*where, "Skipped: no state")), report("passed", None), report("failed", "no")):
        skips.pytest_runtest_logreport(each)
    skips.pytest_runtest_logreport(report("skipped", (*where, "Skipped: no state")))
    assert skips.count == {"no state": 2} and skips.refused() == []
    skips.pytest_collectreport(report("skipped", (*where, "Skipped: could not import 'x'")))
    assert skips.count.total() == 3 and skips.refused() == ["could not import 'x'"]
