"""A Gaussian random field."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx.profiles import PositiveMetre, Profile, Value


class Random(Profile):
    """Gaussian random field with an exponential correlation, the same for a seed on any mesh and any rank count.

    Built from `modes` random cosines whose wavenumbers follow the Cauchy law, the spectrum of the correlation
    exp(-|d| / correlation_length); clipped at three standard deviations.
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
