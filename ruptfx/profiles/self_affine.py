"""A rough profile that is self-affine between two wavelengths."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from ruptfx.profiles import PositiveMetre, Profile, Value
from ruptfx.schema import Unit

MOST_WAVES = 100_000


class SelfAffine(Profile):
    """A self-affine rough profile, the same for a seed on any mesh and any rank count.

    The sum of a_k cos(q_k x + phi_k), q_k = 2 pi k / length, with phases of the seed. Between the wavelengths `rolloff`
    and `shortest` the heights a_k^2 fall as q^-(1 + 2 hurst), from `longest` to `rolloff` they are equal. The root mean
    square of the heights over `length`, after which the profile repeats itself, is exactly `rms`.
    Source: Hu and Tonder (1992); Yastrebov, Anciaux, Molinari (2017).
    """

    example: ClassVar[str] = (
        '{ kind = "self_affine", rms = 0.1, hurst = 0.8, length = 2.0, longest = 1.0, shortest = 0.05, seed = 3 }'
    )
    rms: Annotated[Value, Field(ge=0)]
    """Root mean square of the heights."""
    hurst: Annotated[float, Field(gt=0, lt=1), Unit("1")]
    """Hurst exponent."""
    length: PositiveMetre
    """Period of the profile."""
    longest: PositiveMetre
    """Longest wavelength."""
    shortest: PositiveMetre
    """Shortest wavelength."""
    rolloff: PositiveMetre | None = None
    """Roll-off wavelength; default is `longest`."""
    seed: Annotated[int, Field(ge=0)]
    """Seed of the random numbers."""
    mean: Value = 0.0
    """Mean height."""

    @model_validator(mode="after")
    def _ordered(self) -> SelfAffine:
        rolloff = self.longest if self.rolloff is None else self.rolloff
        if not self.shortest <= rolloff <= self.longest <= self.length:
            raise ValueError(
                f"wavelengths need shortest <= rolloff <= longest <= length, these are {self.shortest:g}, {rolloff:g}, "
                f"{self.longest:g} and {self.length:g} m"
            )
        if self.length > MOST_WAVES * self.shortest:
            raise ValueError(
                f"length = {self.length:g} m: at most {MOST_WAVES} times shortest = {self.shortest:g} m; make it "
                "shorter"
            )
        if not len(self._waves()):
            raise ValueError(
                f"no wavelength length / k is between shortest = {self.shortest:g} and longest = {self.longest:g} m; "
                "change one of them"
            )
        return self

    def _waves(self) -> np.ndarray:
        """Numbers k of the waves."""
        return np.arange(np.ceil(self.length / self.longest - 1e-9), np.floor(self.length / self.shortest + 1e-9) + 1)

    def __call__(self, position: np.ndarray) -> np.ndarray:
        wavenumber = 2 * np.pi * self._waves() / self.length
        amplitude = np.maximum(wavenumber, 2 * np.pi / (self.rolloff or self.longest)) ** (-0.5 - self.hurst)
        amplitude *= self.rms / np.sqrt(0.5 * np.sum(amplitude**2))
        phase = np.random.default_rng(self.seed).uniform(0, 2 * np.pi, len(wavenumber))
        return self.mean + np.cos(np.outer(position, wavenumber) + phase) @ amplitude
