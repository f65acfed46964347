"""Evolution with covariance matrix adaptation (CMA-ES)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from ruptfx import RuptfxError
from ruptfx.many_runs.search_methods import Generation, SearchMethod


class CmaEs(SearchMethod):
    """Evolution with covariance matrix adaptation.

    A search that stops improving restarts elsewhere, with twice the population (Auger and Hansen, CEC 2005). The
    default population is 4 + 3 ln of the number of axes. From the library `cma`: Hansen, The CMA evolution strategy:
    a tutorial, arXiv:1604.00772.
    """

    example: ClassVar[str] = '{ kind = "cma_es" }'

    def generations(
        self, begin: Sequence[float], step: float, population: int | None, random: np.random.Generator
    ) -> Iterator[Generation]:
        try:
            import cma
        except ImportError as error:
            raise RuptfxError(f"a search needs cma ({error}): pip install 'ruptfx[search]'") from None
        size = population or 4 + int(3 * math.log(len(begin)))
        first = True
        while True:
            evolution = cma.CMAEvolutionStrategy(list(begin), step, {
                "bounds": [0, 1], "popsize": size, "verbose": -9, "seed": math.nan, "signals_filename": "",
                "randn": lambda *shape: random.standard_normal(shape),
            })  # fmt: skip
            while not evolution.stop():
                sets = evolution.ask()
                if first:  # what is known to be good is among the first
                    sets[0], first = np.array(begin), False
                yield sets, lambda losses, sets=sets, to=evolution: to.tell(sets, losses)  # type: ignore[misc]
            begin, size = list(random.random(len(begin))), 2 * size
