"""Random sets in a box that shrinks around the best one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from ruptfx.plugin import Fraction, Generation, SearchMethod


class ShrinkingBox(SearchMethod):
    """Random sets in a box around the best one, which shrinks from generation to generation."""

    example: ClassVar[str] = '{ kind = "shrinking_box", shrink = 0.8 }'
    shrink: Fraction = 0.9
    """Size of a box over that of the one before."""

    def generations(
        self, begin: Sequence[float], step: float, population: int | None, random: np.random.Generator
    ) -> Iterator[Generation]:
        best, least, half, is_first = np.array(begin), np.inf, 2 * step, True
        while True:
            sets = np.clip(best + half * random.uniform(-1, 1, (population or 8, len(best))), 0, 1)
            if is_first:
                sets[0], is_first = best, False

            def tell(losses: Sequence[float], sets: np.ndarray = sets) -> None:
                nonlocal best, least
                number = int(np.argmin(losses))
                if losses[number] < least:
                    best, least = sets[number], losses[number]

            yield sets.tolist(), tell
            half = max(self.shrink * half, 1e-6)
