"""The same value everywhere."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.profiles import Profile, Value


class Constant(Profile):
    """The same value everywhere."""

    example: ClassVar[str] = '{ kind = "constant", value = 0.3 }'
    value: Value
    """The value, everywhere."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return np.full_like(position, self.value)

    def in_body(self, points: np.ndarray) -> np.ndarray:
        return np.full(len(points), self.value)
