"""A rough surface that is self-affine between two wavelengths."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.profiles import PositiveMetre, Profile, Value
from ruptfx.schema import Unit

ROWS = 4096  # points at a time, which limits temporary memory
MOST_WAVES = 200_000


class SelfAffineSurface(Profile):
    """A self-affine field over a surface, the same for a seed on any mesh and any rank count.

    The sum of a(q) cos(q_x x + q_y d + phase) over the wave vectors of a periodic square of side `length`, with x along
    strike, d down dip and phases of the seed. Between the wavelengths `rolloff` and `shortest` the squares of the
    amplitudes fall as q^-(2 + 2 hurst), as a section along any line then falls as q^-(1 + 2 hurst); from `longest` to
    `rolloff` they are equal. The root mean square over the square is exactly `rms`.
    Source: Yastrebov, Anciaux, Molinari (2017); of faults: Candela et al. (2012), JGR 117, B08409.
    """

    over_surface: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "self_affine_surface", rms = 0.1, hurst = 0.8, length = 2.0, longest = 1.0, shortest = 0.2, '
        "seed = 3 }"
    )
    rms: Annotated[Value, Field(ge=0)]
    """Root mean square of the field."""
    hurst: Annotated[float, Field(gt=0, lt=1), Unit("1")]
    """Hurst exponent."""
    length: PositiveMetre
    """Period along strike and down dip."""
    longest: PositiveMetre
    """Longest wavelength."""
    shortest: PositiveMetre
    """Shortest wavelength; several elements long, so that the mesh follows it."""
    rolloff: PositiveMetre | None = None
    """Roll-off wavelength; default is `longest`."""
    seed: Annotated[int, Field(ge=0)]
    """Seed of the random numbers."""
    mean: Value = 0.0
    """Mean of the field."""

    @model_validator(mode="after")
    def _ordered(self) -> SelfAffineSurface:
        rolloff = self.longest if self.rolloff is None else self.rolloff
        if not self.shortest <= rolloff <= self.longest <= self.length:
            raise ValueError(
                f"wavelengths need shortest <= rolloff <= longest <= length, these are {self.shortest:g}, {rolloff:g}, "
                f"{self.longest:g} and {self.length:g} m"
            )
        if (self.length / self.shortest) ** 2 > MOST_WAVES:
            raise ValueError(
                f"shortest = {self.shortest:g} m: {2 * (self.length / self.shortest) ** 2:.3g} waves in a square of "
                f"length = {self.length:g} m; make it at least {self.length / np.sqrt(MOST_WAVES):.3g}"
            )
        if not len(self._waves()):
            raise ValueError(
                f"no wave of a square of length = {self.length:g} m is between shortest = {self.shortest:g} and "
                f"longest = {self.longest:g} m; lower shortest, or raise longest"
            )
        return self

    def _waves(self) -> np.ndarray:
        """Return the numbers of waves along both directions, one of two opposite ones, shape (waves, 2)."""
        most = int(np.floor(self.length / self.shortest + 1e-9))
        k, m = (each.ravel() for each in np.meshgrid(np.arange(most + 1), np.arange(-most, most + 1), indexing="ij"))
        size = np.hypot(k, m)
        low, high = self.length / self.longest * (1 - 1e-9), self.length / self.shortest * (1 + 1e-9)
        kept = (size >= low) & (size <= high) & ((k > 0) | (m > 0))
        return np.stack([k[kept], m[kept]], axis=1)

    def __call__(self, position: np.ndarray) -> np.ndarray:
        vectors = 2 * np.pi * self._waves() / self.length
        size = np.maximum(np.linalg.norm(vectors, axis=1), 2 * np.pi / (self.rolloff or self.longest))
        amplitude = size ** (-1 - self.hurst)
        amplitude *= self.rms / np.sqrt(0.5 * np.sum(amplitude**2))
        phase = np.random.default_rng(self.seed).uniform(0, 2 * np.pi, len(vectors))
        found = np.empty(len(position))
        for first in range(0, len(position), ROWS):
            part = slice(first, first + ROWS)
            found[part] = np.cos(position[part] @ vectors.T + phase) @ amplitude
        return self.mean + found
