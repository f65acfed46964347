"""Verification pages: made from the saved results, whole, and true to them."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
import tomllib
from types import ModuleType

import pytest
from helpers.messages import says
from helpers.page_blocks import ROOT

from ruptfx.app.bench import Check
from ruptfx.app.bench import benchmarks as all_benchmarks

pytest.importorskip("sphinx")
PAGES = ROOT / "docs" / "verification"
PROBLEMS = tomllib.loads((PAGES / "problems.toml").read_text())["problems"]


@pytest.fixture(scope="module")
def pages() -> ModuleType:
    source = importlib.util.spec_from_file_location("reference", ROOT / "docs" / "_extensions" / "ruptfx_reference.py")
    assert source is not None and source.loader is not None
    module = importlib.util.module_from_spec(source)
    sys.modules["reference"] = module
    source.loader.exec_module(module)
    return module


def test_a_problem_shows_its_worst_check_and_what_is_missed(pages: ModuleType) -> None:
    near = Check("a", 2.0, 2.01, 0.01, relative=True)  # half of its tolerance
    far = Check("b", 0.0, 0.03, 0.02)
    bound = Check("c", 1.0, 0.5, relation="at least")
    assert pages.use(near) == pytest.approx(0.5) and pages.use(far) == pytest.approx(1.5)
    assert pages.use(bound) == float("inf") and pages.use(Check("d", 0.0, 1.0, relation="at least")) == -1
    assert pages.use(Check("e", 0.0, float("nan"), 1.0)) == float("inf")
    assert pages.passed([near, far]) == "1 of 2, missed" and pages.passed([near]) == "1 of 1"
    assert pages.error_of(near) == "0.5 % (allowed 1 %)"
    assert pages.error_of(far) == "3 % (allowed 2 %)"
    assert pages.error_of(Check("f", 0.04, 0.0404, 1.5e-3, unit="m")) == "400 um (allowed 1.5 mm)"


def test_repeated_checks_are_one_row_with_the_worst(pages: ModuleType) -> None:
    closure = {"quantity": "energy closure", "expected": 0.0, "tolerance": 1e-3, "source": "exact"}
    saved = {"checks": [{**closure, "found": found, "passed": True} for found in (1e-6, 5e-4, 1e-9)]}
    text = pages.checks(saved).astext()
    assert text.count("energy closure") == 1 and says("worst of 3 runs", text) and "0.0005" in text


def test_a_time_that_was_not_measured_is_not_shown(pages: ModuleType) -> None:
    assert pages.duration({"seconds": 12.4}) == "12 s"
    assert pages.duration({"seconds": None}) == "time not measured"


def test_the_summary_has_every_benchmark_with_results(pages: ModuleType) -> None:
    saved = {path.stem: json.loads(path.read_text()) for path in (PAGES / "results").glob("*.json")}
    text = pages.summary(saved).astext()
    assert all(re.search(rf"^{name}$", text, re.MULTILINE) for name in saved)
    missed = sum(any(not check["passed"] for check in each["checks"]) for each in saved.values())
    assert text.count("missed") == missed


@pytest.mark.parametrize("problem", PROBLEMS, ids=[problem["benchmark"] for problem in PROBLEMS])
def test_a_problem_has_results_and_a_picture(problem: dict[str, str]) -> None:
    assert (PAGES / problem["picture"]).is_file()
    assert (PAGES / "results" / f"{problem['benchmark']}.json").is_file()


def test_rows_name_tests_and_benchmarks_that_exist() -> None:
    text = (PAGES / "verified.md").read_text()
    named = set(re.findall(r"`(tests/[\w/.]+)`", text))
    assert len(named) > 20 and all((ROOT / name).exists() for name in named)
    alone = set(re.findall(r"`(test_\w+\.py)`", text))
    assert all(any(ROOT.glob(f"tests/*/{name}")) for name in alone)
    benchmarks = set(re.findall(r"`ruptfx bench (\w+)", text))
    assert len(benchmarks) > 20 and benchmarks <= {*all_benchmarks(ROOT / "tests" / "benchmarks")}


@pytest.mark.parametrize(
    "seconds, told",
    [(0.4, "1 s"), (1.6, "2 s"), (9.4, "9 s"), (12.6, "15 s"), (57.0, "55 s"), (100, "1.5 min"), (290, "5 min")],
)
def test_times_of_the_gallery_are_rounded(pages: ModuleType, seconds: float, told: str) -> None:
    assert pages.rounded(seconds) == told
