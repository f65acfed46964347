"""One value within a rectangle of a surface, another beyond it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles.rim import Patch, sharp, smooth


class Rectangle(Patch):
    """`inside` in a rectangle of a surface, `outside` beyond it; nodes on a sharp edge carry the mean of both sides."""

    example: ClassVar[str] = (
        '{ kind = "rectangle", inside = 2.0, outside = 1.0, strike = [-0.4, 0.3], dip = [0.0, 0.5], rim = 0.1 }'
    )

    def share(self, position: np.ndarray) -> np.ndarray:
        share = np.ones(len(position))
        for values, (first, last) in zip(position.T, (self.strike, self.dip), strict=True):
            distance, half = np.abs(values - 0.5 * (first + last)), 0.5 * (last - first)
            share = share * (smooth(distance, half, self.rim) if self.rim else sharp(distance, half))
        return share
