"""Discrete values at random."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.input.profiles import PositiveMetre, Profile, Value

SLACK = 1e-9  # of a cell: rounding of positions between two cells, which are in the later one


class RandomClasses(Profile):
    """Discrete values drawn with given weights, one draw per cell of length `cell` along the interface."""

    example: ClassVar[str] = (
        '{ kind = "random_classes", values = [1.0, 2.0], weights = [1.0, 3.0], cell = 0.07, seed = 3 }'
    )
    values: list[Value]
    """Values, of which one is drawn for each cell."""
    weights: list[Annotated[float, Field(ge=0)]]
    """Relative frequencies, one for each value."""
    cell: PositiveMetre
    """Length of a cell."""
    seed: Annotated[int, Field(ge=0)]
    """Seed of the random numbers."""

    @model_validator(mode="after")
    def _matching(self) -> RandomClasses:
        if len(self.values) != len(self.weights):
            raise ValueError(f"weights: there are {len(self.weights)}, each of {len(self.values)} values needs one")
        if sum(self.weights) <= 0:
            raise ValueError("weights: all are zero; give at least one that is positive")
        return self

    def __call__(self, position: np.ndarray) -> np.ndarray:
        edges = np.cumsum(self.weights) / np.sum(self.weights)
        cells = np.floor(position / self.cell + SLACK).astype(np.int64)
        # One generator per cell, so that its draw does not depend on the other cells of a rank.
        unique, inverse = np.unique(cells, return_inverse=True)
        draws = np.array([np.random.default_rng([self.seed, cell % 2**32]).random() for cell in unique])
        chosen = np.minimum(np.searchsorted(edges, draws[inverse]), len(self.values) - 1)
        return np.asarray(self.values)[chosen]
