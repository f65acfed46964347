"""Patches of a surface with a sharp or a smooth rim."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import AfterValidator, Field

from ruptfx.input.profiles import Profile, Value
from ruptfx.input.schema import Unit


def _increasing(ends: list[float]) -> list[float]:
    if ends[0] >= ends[1]:
        raise ValueError("the second end must be larger than the first")
    return ends


Range = Annotated[list[Annotated[float, Unit("m")]], Field(min_length=2, max_length=2), AfterValidator(_increasing)]
"""Both ends of a patch along one position of a surface."""

SLACK = 1e-9  # of a half-width: rounding of coordinates


def sharp(distance: np.ndarray, half: float) -> np.ndarray:
    """Return 1 within `half` of the middle, 0 beyond it, and 1/2 on the edge.

    A node on the edge stands for the area on both sides of it: with the mean, the integral over the patch does not
    depend on where nodes are.
    """
    beyond = distance - half
    return np.where(np.abs(beyond) <= SLACK * half, 0.5, (beyond < 0).astype(float))


def smooth(distance: np.ndarray, half: float, rim: float) -> np.ndarray:
    """Return 1 within `half`, 0 from `half + rim` on, between them a transition with all derivatives continuous.

    B = (1 + tanh(w / (x - W - w) + w / (x - W))) / 2 (Source: SCEC/USGS benchmark TPV101 description).
    """
    inner = np.clip((distance - half) / rim, 1e-6, 1 - 1e-6)
    return np.where(
        distance <= half, 1.0,
        np.where(distance >= half + rim, 0.0, 0.5 * (1 + np.tanh(1 / (inner - 1) + 1 / inner))),
    )  # fmt: skip


class Patch(Profile):
    """`inside` in a patch of a surface, `outside` beyond it."""

    over_surface: ClassVar[bool] = True
    inside: Value
    """Value in the patch."""
    outside: Value
    """Value beyond it."""
    strike: Range
    """Both ends along the first position (strike)."""
    dip: Range
    """Both ends along the second position: down dip, from the upper edge of the surface."""
    rim: Annotated[float, Field(ge=0), Unit("m")] = 0.0
    """Width of a smooth transition outside of the patch; 0: a sharp edge."""

    def share(self, position: np.ndarray) -> np.ndarray:
        """Return 1 in the patch and 0 beyond its rim, shape (n,), at positions of shape (n, 2) [m]."""
        raise NotImplementedError

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.outside + (self.inside - self.outside) * self.share(position)
