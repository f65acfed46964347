"""Every search method, by its own example: read again, reproducible, inside of the ranges, finds a minimum."""

from __future__ import annotations

import tomllib
from itertools import islice
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from ruptfx.input.schema import alternatives
from ruptfx.many_runs.search_methods import AnySearchMethod, SearchMethod

METHODS = alternatives("ruptfx.many_runs.search_methods")
every_method = pytest.mark.parametrize("kind", METHODS)
BEGIN, MINIMUM = [0.9, 0.2], np.array([0.3, 0.6])


@pytest.fixture(autouse=True)
def libraries(request: pytest.FixtureRequest) -> None:
    if "cma_es" in request.node.name:
        pytest.importorskip("cma")


def example(kind: str) -> SearchMethod:
    table = tomllib.loads(f"method = {METHODS[kind].example}")["method"]
    assert table["kind"] == kind
    return TypeAdapter(AnySearchMethod).validate_python(table)


def search(kind: str, generations: int, population: int | None = None, seed: int = 3) -> tuple[Any, Any]:
    """Sets of generations and their losses, the squared distances from the minimum."""
    sets, losses = [], []
    method = example(kind).generations(BEGIN, 0.2, population, np.random.default_rng(seed))
    for asked, tell in islice(method, generations):
        sets.append(np.array(asked))
        losses.append([float(((np.array(each) - MINIMUM) ** 2).sum()) for each in asked])
        tell(losses[-1])
    return sets, losses


@every_method
def test_written_and_read_again(kind: str) -> None:
    method = example(kind)
    assert TypeAdapter(AnySearchMethod).validate_python(method.model_dump(mode="json")) == method


@every_method
def test_sets_are_in_the_ranges_and_the_first_is_the_given_one(kind: str) -> None:
    sets, _ = search(kind, 30, population=6)
    assert sets[0][0] == pytest.approx(BEGIN) and {each.shape[1] for each in sets} == {2}
    assert min(each.min() for each in sets) >= 0 and max(each.max() for each in sets) <= 1
    assert len(sets[0]) == 6


@every_method
def test_an_interrupted_search_asks_for_the_same_sets_again(kind: str) -> None:
    (short, _), (long, _), (other, _) = search(kind, 5), search(kind, 9), search(kind, 5, seed=4)
    for one, again in zip(short, long, strict=False):
        np.testing.assert_array_equal(one, again)
    assert np.any(short[1] != other[1])


@every_method
def test_it_finds_the_minimum_of_a_paraboloid_and_never_ends(kind: str) -> None:
    """Within a hundredth of the ranges after 300 sets, from a distance of 0.72."""
    sets, losses = search(kind, 200)
    assert len(sets) == 200
    tried = np.concatenate(losses)
    assert tried[:300].min() < 1e-4 and tried[0] == pytest.approx(0.6**2 + 0.4**2)
