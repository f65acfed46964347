"""One value within an ellipse of a surface, another beyond it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles.rim import Patch, sharp, smooth


class Ellipse(Patch):
    """`inside` in an ellipse between both pairs of ends, `outside` beyond it; the rim is along the mean half-axis."""

    example: ClassVar[str] = (
        '{ kind = "ellipse", inside = 2.0, outside = 1.0, strike = [-0.4, 0.6], dip = [0.1, 0.5], rim = 0.05 }'
    )

    def share(self, position: np.ndarray) -> np.ndarray:
        ends = np.array([self.strike, self.dip])
        half = 0.5 * (ends[:, 1] - ends[:, 0])
        radius = np.linalg.norm((position - ends.mean(axis=1)) / half, axis=1)
        mean = float(np.mean(half))
        return smooth(mean * radius, mean, self.rim) if self.rim else sharp(radius, 1.0)
