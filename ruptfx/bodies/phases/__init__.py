"""Distributions of minerals in a specimen, one per file; the file name is the `kind` of `mesh.phases`.

A phase is a body of the mesh: its material is the table `[materials.NAME]`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ruptfx.input.schema import Alternative, Name, Unit, alternative

Share = Annotated[float, Field(gt=0, le=1), Unit("1")]


class Phases(Alternative):
    """Contract of a distribution of minerals."""

    example: ClassVar[str] = ""
    """Example table."""

    fractions: Annotated[dict[Name, Share], Field(min_length=1)]
    """Fraction of every phase, by name; they add up to 1."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of the random numbers."""

    @model_validator(mode="after")
    def _whole(self) -> Phases:
        total = sum(self.fractions.values())
        if abs(total - 1) > 1e-6:
            raise ValueError(f"fractions add up to {total:g}; they must add up to 1")
        return self

    def phase_of(self, centres: NDArray[np.float64], element_size: float) -> NDArray[np.int64]:
        """Return the phase of every cell, as the index of its name in `fractions`.

        Parameters
        ----------
        centres : ndarray, shape (cells, 2)
            [m].
        element_size : float
            [m].

        Raises
        ------
        CaseError
            If the cells are too large for the distribution.
        """
        raise NotImplementedError

    def draws(self, size: NDArray[np.float64], element_size: float) -> float:
        """Return how many independent draws the phases of a rectangle are worth; default: one for every cell.

        The fractions scatter as those of so many draws.

        Parameters
        ----------
        size : ndarray, shape (2,)
            Lengths of its sides [m].
        element_size : float
            [m].
        """
        return float(np.prod(size)) / element_size**2

    def drawn(self, count: int, random: np.random.Generator) -> NDArray[np.int64]:
        """Return independent random phases as indices among `fractions`, shape (count,)."""
        share = np.array(list(self.fractions.values()))
        return random.choice(len(share), count, p=share / share.sum())


if TYPE_CHECKING:
    AnyPhases = Phases
else:
    AnyPhases = alternative("ruptfx.bodies.phases")
