"""Goals of a search for quantities of runs, and the score of a set of constants."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated

from pydantic import Field, model_validator

from ruptfx import Table
from ruptfx.input.quantities import parse
from ruptfx.input.schema import CaseError, Part
from ruptfx.input.units import Fraction
from ruptfx.many_runs.search_methods import AnySearchMethod
from ruptfx.many_runs.search_methods.cma_es import CmaEs
from ruptfx.results import summary_fields

Positive = Annotated[float, Field(gt=0)]
NUMBERS = ("target", "scale", "at_least", "at_most")


class Goal(Part):
    """Target or bound of a quantity of the summary, in its unit; a run reaches it to a degree from 0 to 1.

    With `target` the degree is 1 / (1 + ((q - target) / scale)^2), with `at_least` q over it and with `at_most` it
    over q, at most 1. Runs that failed or lack the quantity have the degree 0.
    """

    quantity: str
    """A number of the summary of a run."""
    where: Table = {}
    """Axes without a range and the values (or labels) to which the goal applies; all runs by default."""
    target: float | None = None
    """Target value."""
    scale: Positive | None = None
    """Distance from the target at which the degree is one half."""
    at_least: Positive | None = None
    """Smallest value of degree 1."""
    at_most: Positive | None = None
    """Largest value of degree 1."""

    @model_validator(mode="before")
    @classmethod
    def _without_units(cls, values: object) -> object:
        """Convert text such as "2 km/s" to the unit of the quantity; to SI if that is unknown (lumped models).

        Energies are in J or, of cases in a plane, in J/m.
        """
        if not isinstance(values, Mapping):
            return values
        quantity = str(values.get("quantity"))
        texts = {name: text for name in NUMBERS if isinstance(text := values.get(name), str)}
        plane = "strain" if any(text.endswith("/m") for text in texts.values()) else "solid"
        unit = summary_fields.unit(quantity, plane) or ("1" if quantity in summary_fields.DESCRIPTIONS else None)
        try:
            return {**values, **{name: parse(text, unit) for name, text in texts.items()}}
        except ValueError as error:
            raise ValueError(f"{', '.join(f'{name} = {text!r}' for name, text in texts.items())}: {error}") from None

    @model_validator(mode="after")
    def _one_of_them(self) -> Goal:
        if sum(item is not None for item in (self.target, self.at_least, self.at_most)) != 1:
            raise ValueError("give one of target, at_least and at_most")
        if (self.target is None) != (self.scale is None):
            raise ValueError("target and scale belong together; give both or none")
        return self

    def concerns(self, coordinates: Mapping[str, object]) -> bool:
        """Return whether the goal applies to the run at these coordinates."""
        return all(coordinates.get(name) == value for name, value in self.where.items())

    def degree(self, values: Mapping[str, object]) -> float:
        """Return the degree to which a run with these quantities reaches the goal.

        Raises
        ------
        CaseError
            The quantity is text.
        """
        value = values.get(self.quantity)
        if isinstance(value, str):
            raise CaseError(f"search.goals: quantity = '{self.quantity}' is the text '{value}'; give one with numbers")
        if not isinstance(value, int | float):
            return 0.0
        if self.target is not None and self.scale is not None:
            return 1 / (1 + ((value - self.target) / self.scale) ** 2)
        if self.at_least is not None:
            return min(1.0, max(value, 0.0) / self.at_least)
        assert self.at_most is not None
        return min(1.0, self.at_most / value) if value > 0 else 1.0


class Search(Part):
    """Search over the axes with a range.

    The degree of a run is the geometric mean of the degrees of the goals that apply to it, and the score
    of a set of constants the mean over its runs.
    """

    goals: Annotated[list[Goal], Field(min_length=1)]
    """Goals, one table each."""
    start: dict[str, float] = {}
    """Initial values by axis; default is the middle of the range."""
    step: Fraction = 0.2
    """Standard deviation of the first population, as a part of the ranges."""
    population: Annotated[int, Field(ge=4)] | None = None
    """Sets of one generation; the default is that of the method."""
    method: AnySearchMethod = CmaEs()
    """Method that chooses the sets."""

    def degree(self, coordinates: Mapping[str, object], values: Mapping[str, object]) -> float:
        """Return the geometric mean of the goals that apply to a run; 1 without any."""
        degrees = [goal.degree(values) for goal in self.goals if goal.concerns(coordinates)]
        return math.prod(degrees) ** (1 / max(len(degrees), 1))

    def score(self, degrees: Iterable[float]) -> float:
        """Return the score of a set from the degrees of its runs."""
        items = list(degrees)
        return sum(items) / len(items)
