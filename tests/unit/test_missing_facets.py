"""Facets that are missing in an interface, in lines and surfaces whose holes are known by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from ruptfx.interfaces.mechanisms.checks.holes import holes

X = np.array([0.0, 1.0, 2.1, 3.0, 4.2, 5.0])
LINE = np.stack([np.column_stack([x, 0.3 * x]) for x in (X[:-1], X[1:])], axis=1)


def quadrilaterals(rows: int = 5, columns: int = 4) -> np.ndarray:
    """A bent sheet; the corners of every facet row by row."""
    i, j = (part.ravel() for part in np.mgrid[:rows, :columns])
    return np.stack(
        [np.column_stack([i + a, j + b, 0.1 * (i + a) ** 2]) for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))], axis=1
    ).astype(float)


def triangles() -> np.ndarray:
    sheet = quadrilaterals()
    return np.concatenate([sheet[:, [0, 1, 2]], sheet[:, [1, 2, 3]]])


SHEET, TRIANGLES = quadrilaterals(), triangles()
CASES: dict[str, tuple[np.ndarray, list[int], Any]] = {
    "whole line": (LINE, [], []),
    "one of a line": (LINE, [2], [LINE[2].mean(axis=0)]),
    "two of a line are a bridge": (LINE, [2, 3], []),
    "an end of a line": (LINE, [4], []),
    "a line of one facet": (LINE[:1], [], []),
    "whole sheet": (SHEET, [], []),
    "one of a sheet": (SHEET, [9], [SHEET[9].mean(axis=0)]),
    "one at the rim of a sheet": (SHEET, [0], []),
    "two neighbours are a barrier": (SHEET, [9, 10], []),
    "two apart": (SHEET, [5, 14], [SHEET[5].mean(axis=0), SHEET[14].mean(axis=0)]),
    "a sheet of one facet": (SHEET[:1], [], []),
    "one of triangles": (TRIANGLES, [9], [TRIANGLES[9].mean(axis=0)]),
}


@pytest.mark.parametrize("name", CASES)
def test_holes(name: str) -> None:
    facets, missing, expected = CASES[name]
    order = np.random.default_rng(5).permutation(len(facets) - len(missing))
    middles = holes(np.delete(facets, missing, axis=0)[order])
    middles = middles[np.argsort(middles[:, 0])]
    np.testing.assert_allclose(middles, np.reshape(expected, (-1, facets.shape[2])), atol=1e-12)
