"""Product of a profile and a factor that varies."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import ValidationInfo

from ruptfx.input.profiles import NumberOrProfile, Profile, ValueOrProfile, evaluate, in_body, with_units


class Product(Profile):
    """`value`, in the unit of the key, times `factor`, a pure number; both may vary."""

    example: ClassVar[str] = (
        '{ kind = "product", value = 3.0, factor = { kind = "sinusoid", mean = 1, amplitude = 0.1, wavelength = 0.7 } }'
    )
    value: ValueOrProfile
    """Number or profile with the unit of the key."""
    factor: NumberOrProfile
    """Number or profile of pure numbers."""

    @classmethod
    def with_files(cls, values: object, info: ValidationInfo, unit: str) -> object:
        return with_units(values, info, {"value": unit, "factor": "1"})

    def over(self, places: np.ndarray) -> np.ndarray:
        return evaluate(self.value, places) * evaluate(self.factor, places)

    def in_body(self, points: np.ndarray) -> np.ndarray:
        return in_body(self.value, points) * in_body(self.factor, points)

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.over(position)
