"""The nearest of some points, with SciPy's tree as the reference."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from ruptfx.bodies.space import closest as module
from ruptfx.bodies.space.closest import closest


def grid(dim: int) -> np.ndarray:
    line = np.linspace(-3e4, 1e4, 12)
    return np.stack(np.meshgrid(*[line] * dim, indexing="ij"), axis=-1).reshape(-1, dim)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_points_that_coincide_but_for_rounding_need_no_tree(dim: int, monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(1)
    others = grid(dim)
    order = random.permutation(len(others))[: len(others) // 2 + 1]
    points = others[order] * (1 + 2e-15)
    monkeypatch.setattr("scipy.spatial.cKDTree", None)
    distance, number = closest(points, others)
    np.testing.assert_array_equal(number, order)
    np.testing.assert_allclose(distance, np.linalg.norm(points - others[order], axis=1), rtol=1e-12)


@pytest.mark.parametrize("away", [1e-3, 10.0])
@pytest.mark.parametrize("dim", [2, 3])
def test_other_points_are_what_the_tree_finds(dim: int, away: float) -> None:
    random = np.random.default_rng(2)
    others = np.concatenate([grid(dim), grid(dim)[:5]])  # some twice
    points = grid(dim) + away * random.standard_normal(grid(dim).shape)
    assert module._coinciding(points, others) is None
    distance, number = closest(points, others)
    true = cKDTree(others).query(points)[0]
    np.testing.assert_allclose(distance, true)
    np.testing.assert_allclose(np.linalg.norm(points - others[number], axis=1), true)


def test_points_that_are_there_twice_and_no_points() -> None:
    others = np.concatenate([grid(2), grid(2) * (1 + 1e-15)])
    distance, number = closest(grid(2), others)
    np.testing.assert_allclose(others[number], grid(2), rtol=1e-12)
    assert distance.max() < 1e-9
    assert [len(found) for found in closest(np.zeros((0, 2)), others)] == [0, 0]
