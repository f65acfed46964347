"""Fields that are self-affine between two wavelengths."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import Field, ValidationInfo, model_validator

from ruptfx.input.profiles import PositiveMetre, Profile, Value
from ruptfx.input.schema import Unit

ENTRIES = 2**24
"""Points times waves at a time, which limits temporary memory."""


class SelfAffineField(Profile):
    """A sum of waves with phases of a seed, the same for a seed on any mesh and any rank count."""

    rms: Annotated[Value, Field(ge=0)] | None = None
    """Root mean square of the field; give it or `rms_slope`."""
    rms_slope: Annotated[float, Field(ge=0), Unit("1")] | None = None
    """Root mean square of the gradient of heights."""
    hurst: Annotated[float, Field(gt=0, lt=1), Unit("1")]
    """Hurst exponent."""
    length: PositiveMetre
    """Period in each direction."""
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

    @classmethod
    def with_files(cls, values: object, info: ValidationInfo, unit: str) -> object:
        if isinstance(values, dict) and values.get("rms_slope") is not None and unit != "m":
            raise ValueError(f"rms_slope = {values['rms_slope']}: only heights [m] have slopes; give rms [{unit}]")
        return values

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if (self.rms is None) == (self.rms_slope is None):
            keys = "neither" if self.rms is None else f"rms = {self.rms:g} and rms_slope = {self.rms_slope:g}"
            raise ValueError(f"{keys}: give one of rms and rms_slope")
        rolloff = self.longest if self.rolloff is None else self.rolloff
        if not self.shortest <= rolloff <= self.longest <= self.length:
            raise ValueError(
                f"wavelengths need shortest <= rolloff <= longest <= length, these are {self.shortest:g}, {rolloff:g}, "
                f"{self.longest:g} and {self.length:g} m"
            )
        self._check_count()
        if not len(self._waves()):
            raise ValueError(
                f"no wavelength of a period of length = {self.length:g} m is between shortest = {self.shortest:g} and "
                f"longest = {self.longest:g} m; lower shortest, or raise longest"
            )
        return self

    def _check_count(self) -> None:
        """Raise `ValueError` where there would be too many waves."""
        raise NotImplementedError

    def _waves(self) -> np.ndarray:
        """Return the numbers of waves in a period, shape (waves, directions)."""
        raise NotImplementedError

    def __call__(self, position: np.ndarray) -> np.ndarray:
        """Return the field at positions of shape (n,) or (n, 2) [m]."""
        vectors = 2 * np.pi * self._waves() / self.length
        count, directions = vectors.shape
        size = np.maximum(np.linalg.norm(vectors, axis=1), 2 * np.pi / (self.rolloff or self.longest))
        amplitude = size ** (-directions / 2 - self.hurst)
        if self.rms is not None:
            amplitude *= self.rms / np.sqrt(0.5 * np.sum(amplitude**2))
        else:
            assert self.rms_slope is not None
            amplitude *= self.rms_slope / np.sqrt(0.5 * np.sum((amplitude[:, None] * vectors) ** 2))
        phase = np.random.default_rng(self.seed).uniform(0, 2 * np.pi, count)
        places = np.reshape(position, (-1, directions))
        values = np.empty(len(places))
        rows = max(ENTRIES // count, 1)
        for first in range(0, len(places), rows):
            part = slice(first, first + rows)
            values[part] = np.cos(places[part] @ vectors.T + phase) @ amplitude
        return self.mean + values
