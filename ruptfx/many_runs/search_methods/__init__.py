"""Methods of a search over the axes of a study, one per file; the file name is the `kind` of `search.method`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.schema import Alternative, alternative

Sets = Sequence[Sequence[float]]
Generation = tuple[Sets, Callable[[Sequence[float]], None]]
"""Sets of constants, as fractions of their ranges, and the function that accepts their losses in the same order."""


class SearchMethod(Alternative):
    """Contract of a search method."""

    example: ClassVar[str] = ""
    """Table with which the contract tests find the minimum of a paraboloid in two dimensions."""

    def generations(
        self, begin: Sequence[float], step: float, population: int | None, random: np.random.Generator
    ) -> Iterator[Generation]:
        """Yield generations without end; the first set of the first one is `begin`.

        The same arguments and losses give the same sets, so that an interrupted search replays its finished points.

        Parameters
        ----------
        begin : sequence of float
            First set: a fraction of its range for every axis.
        step : float
            Distance of the other sets of the first generation from it, as a fraction of the ranges.
        population : int, optional
            Sets of one generation.
        random : numpy Generator
            The only source of random numbers.

        Raises
        ------
        RuptfxError
            A library is missing.
        """
        raise NotImplementedError


if TYPE_CHECKING:
    AnySearchMethod = SearchMethod
else:
    AnySearchMethod = alternative("ruptfx.many_runs.search_methods")
