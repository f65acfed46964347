"""A rough surface that is self-affine between two wavelengths."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles._self_affine import SelfAffineField
from ruptfx.input.quantities import at_least

MOST_WAVES = 200_000


class SelfAffineSurface(SelfAffineField):
    """A self-affine field over a surface, the same for a seed on any mesh and any rank count.

    The sum of a(q) cos(q_x x + q_y d + phase) over the wave vectors of a periodic square of side `length`, with x along
    strike, d down dip and phases of the seed. Between the wavelengths `rolloff` and `shortest` the squares of the
    amplitudes fall as q^-(2 + 2 hurst), as a section along any line then falls as q^-(1 + 2 hurst); from `longest` to
    `rolloff` they are equal. The root mean square over the square is exactly `rms`, or that of the
    slopes `rms_slope`.
    Source: Yastrebov, Anciaux, Molinari (2017); of faults: Candela et al. (2012), JGR 117, B08409.
    """

    over_surface: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "self_affine_surface", rms = 0.1, hurst = 0.8, length = 2.0, longest = 1.0, shortest = 0.2, '
        "seed = 3 }"
    )

    def _check_count(self) -> None:
        ratio = self.length / self.shortest
        if ratio * ratio > MOST_WAVES:  # a product is infinite where a power of numbers raises an error
            raise ValueError(
                f"shortest = {self.shortest:g} m: {2 * ratio * ratio:.3g} waves in a square of "
                f"length = {self.length:g} m; make it at least {at_least(self.length / np.sqrt(MOST_WAVES))}"
            )

    def _waves(self) -> np.ndarray:
        """Return the numbers of waves along both directions, one of two opposite ones, shape (waves, 2)."""
        top = int(np.floor(self.length / self.shortest + 1e-9))
        k, m = (each.ravel() for each in np.meshgrid(np.arange(top + 1), np.arange(-top, top + 1), indexing="ij"))
        size = np.hypot(k, m)
        low, high = self.length / self.longest * (1 - 1e-9), self.length / self.shortest * (1 + 1e-9)
        kept = (size >= low) & (size <= high) & ((k > 0) | (m > 0))
        return np.stack([k[kept], m[kept]], axis=1)
