"""A profile of one position that varies along an axis of the bodies."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import ValidationInfo

from ruptfx.input.profiles import AnyProfile, Profile, with_units
from ruptfx.input.schema import CaseError


class AlongAxis(Profile):
    """Another profile, evaluated at one coordinate of the points of the bodies: properties over depth.

    For parameters of materials; profiles of one position need it there.
    """

    over_body: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "along_axis", axis = "y", profile = { kind = "table", positions = [-1.0, 1.0], values = [1, 3] } }'
    )
    axis: Literal["x", "y", "z"]
    """Coordinate along which it varies; bodies of revolution have x and the radius y."""
    profile: AnyProfile
    """Profile of one position, the coordinate."""

    @classmethod
    def with_files(cls, values: object, info: ValidationInfo, unit: str) -> object:
        return with_units(values, info, {"profile": unit})

    def __call__(self, position: np.ndarray) -> np.ndarray:
        number = "xyz".index(self.axis)
        if number >= position.shape[1]:
            raise CaseError(f"axis = '{self.axis}': must be x or y, as the bodies have {position.shape[1]} dimensions")
        return self.profile.over(position[:, number])
