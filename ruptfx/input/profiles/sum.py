"""Sum of numbers and profiles."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, ValidationInfo

from ruptfx.input.profiles import Profile, ValueOrProfile, evaluate, in_body, with_unit


class Sum(Profile):
    """Sum of terms, each a number or a profile in the unit of the key."""

    example: ClassVar[str] = (
        '{ kind = "sum", terms = [1.0, { kind = "boxcar", inside = 2, outside = 0, center = 0.1, half_width = 0.2 }] }'
    )
    terms: Annotated[list[ValueOrProfile], Field(min_length=1)]
    """Numbers and profiles that are added, each in the unit of the key."""

    @classmethod
    def with_files(cls, values: object, info: ValidationInfo, unit: str) -> object:
        assert isinstance(values, dict)
        terms = values.get("terms")
        if not isinstance(terms, list):
            return values
        return {**values, "terms": [with_unit(each, info, unit, "terms", i) for i, each in enumerate(terms)]}

    def over(self, places: np.ndarray) -> np.ndarray:
        return np.sum([evaluate(term, places) for term in self.terms], axis=0)

    def in_body(self, points: np.ndarray) -> np.ndarray:
        return np.sum([in_body(term, points) for term in self.terms], axis=0)

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.over(position)
