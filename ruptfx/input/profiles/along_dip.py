"""A profile of one position that varies down the dip of a surface."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import ValidationInfo

from ruptfx.input.profiles import AnyProfile, Profile, with_units


class AlongDip(Profile):
    """Another profile, evaluated at the second position of a surface: the distance down dip from its upper edge.

    Without it, profiles of one position vary along strike.
    """

    over_surface: ClassVar[bool] = True
    down_dip: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "along_dip", profile = { kind = "table", positions = [-1.0, 1.0], values = [1.0, 3.0] } }'
    )
    profile: AnyProfile
    """Profile of one position."""

    @classmethod
    def with_files(cls, values: object, info: ValidationInfo, unit: str) -> object:
        return with_units(values, info, {"profile": unit})

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.profile.over(position[:, 1])
