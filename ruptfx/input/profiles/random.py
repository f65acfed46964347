"""A Gaussian random field."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.input.profiles import PositiveMetre, Profile, Value


class Random(Profile):
    """Gaussian random field with an exponential correlation, the same for a seed on any mesh and any rank count.

    Built from `modes` random cosines whose wavenumbers follow the Cauchy law, the spectrum of the correlation
    exp(-|d| / correlation_length); clipped at three standard deviations. In bodies the field varies alike in all
    directions, with the same correlation: its wave vectors follow the Cauchy law of three dimensions, and a section of
    a field is the field in the section.
    """

    example: ClassVar[str] = (
        '{ kind = "random", mean = 1.0, standard_deviation = 0.1, correlation_length = 0.1, seed = 3 }'
    )
    mean: Value
    """Mean of the field."""
    standard_deviation: Annotated[Value, Field(ge=0)]
    """Standard deviation of the field; values beyond three of them are clipped."""
    correlation_length: PositiveMetre
    """Distance over which the correlation falls by 1/e."""
    seed: Annotated[int, Field(ge=0)]
    """Seed of the random numbers."""
    modes: Annotated[int, Field(ge=16)] = 512
    """Number of cosines."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        random = np.random.default_rng(self.seed)
        wavenumber = random.standard_cauchy(self.modes) / self.correlation_length
        phase = random.uniform(0, 2 * np.pi, self.modes)
        field = np.sqrt(2 / self.modes) * np.cos(np.outer(position, wavenumber) + phase).sum(axis=1)
        return self.mean + self.standard_deviation * np.clip(field, -3, 3)

    def in_body(self, points: np.ndarray) -> np.ndarray:
        random, dim = np.random.default_rng(self.seed), points.shape[1]
        vectors = random.standard_normal((self.modes, 3)) / np.abs(random.standard_normal((self.modes, 1)))
        phase = random.uniform(0, 2 * np.pi, self.modes)
        vectors = vectors[:, :dim].T / self.correlation_length
        field = np.empty(len(points))
        for first in range(0, len(points), 4096):  # limits temporary memory
            part = slice(first, first + 4096)
            field[part] = np.cos(points[part] @ vectors + phase).sum(axis=1)
        return self.mean + self.standard_deviation * np.clip(np.sqrt(2 / self.modes) * field, -3, 3)
