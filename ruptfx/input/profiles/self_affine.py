"""A rough profile that is self-affine between two wavelengths."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles._self_affine import SelfAffineField

MOST_WAVES = 100_000


class SelfAffine(SelfAffineField):
    """A self-affine rough profile, the same for a seed on any mesh and any rank count.

    The sum of a_k cos(q_k x + phi_k), q_k = 2 pi k / length, with phases of the seed. Between the wavelengths `rolloff`
    and `shortest` the heights a_k^2 fall as q^-(1 + 2 hurst), from `longest` to `rolloff` they are equal. The root mean
    square of the heights over `length`, after which the profile repeats itself, is exactly `rms`, or that of the
    slopes `rms_slope`.
    Source: Hu and Tonder (1992); Yastrebov, Anciaux, Molinari (2017).
    """

    example: ClassVar[str] = (
        '{ kind = "self_affine", rms = 0.1, hurst = 0.8, length = 2.0, longest = 1.0, shortest = 0.05, seed = 3 }'
    )

    def _check_count(self) -> None:
        if self.length > MOST_WAVES * self.shortest:
            raise ValueError(
                f"length = {self.length:g} m: at most {MOST_WAVES} times shortest = {self.shortest:g} m; make it "
                "shorter"
            )

    def _waves(self) -> np.ndarray:
        """Return the numbers k of the waves, shape (waves, 1)."""
        first, last = np.ceil(self.length / self.longest - 1e-9), np.floor(self.length / self.shortest + 1e-9)
        return np.arange(first, last + 1)[:, None]
