"""One set of constants that a search has tried."""

from __future__ import annotations

from dataclasses import dataclass, field

from ruptfx.many_runs.study.definition import Point
from ruptfx.many_runs.study.store import Result

Runs = list[tuple[Point, Result]]


@dataclass(frozen=True)
class ScoredSet:
    """One set of constants with the results of its runs.

    Attributes
    ----------
    number, generation : int
        Indices from 0, in the order of the search.
    sample : dict of float
        Value of every axis that has a range.
    runs : list of (Point, Result)
        Its runs, one for every combination of the other axes.
    degrees : dict of float
        Degree of each run, by its name (`name_of`).
    score : float
    """

    number: int
    generation: int
    sample: dict[str, float]
    runs: Runs = field(repr=False)
    degrees: dict[str, float]
    score: float
