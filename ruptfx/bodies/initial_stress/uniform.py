"""One initial stress everywhere."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, field_validator

from ruptfx.bodies.initial_stress import BodyStress
from ruptfx.input.schema import Unit
from ruptfx.laws.materials import Plane


class Uniform(BodyStress):
    """The same stress everywhere, without weight."""

    example: ClassVar[str] = '{ kind = "uniform", tensor = [-50e6, -120e6, -60e6, 70e6, 0.0, 0.0] }'

    tensor: Annotated[list[float], Field(min_length=3, max_length=6), Unit("Pa")]
    """Components xx, yy, zz, xy, yz, xz, tension positive; in the plane three may be given, xx, yy, xy, if no material
    yields."""

    @field_validator("tensor")
    @classmethod
    def _three_or_six(cls, tensor: list[float]) -> list[float]:
        if len(tensor) not in (3, 6):
            raise ValueError("give 6 components, xx, yy, zz, xy, yz, xz, or in the plane 3, xx, yy, xy")
        return tensor

    def check(self, plane: Plane) -> None:
        if plane == "solid" and not self.has_six:
            xx, yy, xy = self.tensor
            raise ValueError(
                f"initial_stress.tensor = {self.tensor}: plane = 'solid' needs 6 components, xx, yy, zz, xy, yz, xz; "
                f"write [{xx:g}, {yy:g}, ZZ, {xy:g}, YZ, XZ] with the three that are missing"
            )

    @property
    def has_six(self) -> bool:
        return len(self.tensor) == 6

    @property
    def everywhere(self) -> np.ndarray:
        if self.has_six:
            return np.array(self.tensor)
        xx, yy, xy = self.tensor
        return np.array([xx, yy, 0.0, xy, 0.0, 0.0])

    def effective(self, points: np.ndarray) -> np.ndarray:
        return np.tile(self.everywhere, (len(points), 1))
