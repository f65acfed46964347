"""The tests themselves: none ends without having asked for something."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import Skips

TESTS = Path(__file__).parents[1]
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def bare_returns(source: str) -> list[str]:
    """Return the functions called `test_...` that have a `return` without a value, each with its line."""
    tests = [node for node in ast.walk(ast.parse(source)) if isinstance(node, FUNCTIONS) and node.name[:5] == "test_"]
    return [f"{test.name}, line {node.lineno}" for test in tests for node in own_nodes(test)
            if isinstance(node, ast.Return) and node.value is None]  # fmt: skip


def own_nodes(parent: ast.AST) -> Iterator[ast.AST]:
    """Iterate over the nodes of a function but those of the functions inside of it."""
    for node in ast.iter_child_nodes(parent):
        if not isinstance(node, (*FUNCTIONS, ast.Lambda, ast.ClassDef)):
            yield node
            yield from own_nodes(node)


@pytest.mark.parametrize("path", sorted(TESTS.rglob("test_*.py")), ids=lambda path: path.name)
def test_no_test_returns_early(path: Path) -> None:
    """It would pass: use `pytest.skip` with a reason, or parametrize with what fits."""
    assert bare_returns(path.read_text(encoding="utf-8")) == []


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
