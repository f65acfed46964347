"""Terms of an objective, one kind per file; the file name is the `kind` of an entry of ``[[objective]]``.

A term is a function of readings of a run that are linear in its fields: traces of instruments at given times, or a
field of an interface at the end. It returns its value and the derivative by every reading; the adjoint sweep
(`ruptfx.adjoint`) does the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ruptfx.instruments import Channel
from ruptfx.schema import Alternative, Part, alternative

if TYPE_CHECKING:
    from ruptfx.instruments._readings import ModelReadings

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """One channel at given times.

    Attributes
    ----------
    channel : Channel
    times : ndarray, shape (m,), or None
        [s]; None for every step, where a channel has one source.
    bandwidth : float, optional
        Frequency of half power of a low-pass filter [Hz].
    """

    channel: Channel
    times: Floats | None
    bandwidth: float | None = None


@dataclass(frozen=True)
class Final:
    """A field of an interface at the end of the run, at all its points in their order.

    Attributes
    ----------
    fault, field : str
    """

    fault: str
    field: str


@dataclass(frozen=True)
class Sample:
    """Values of a reading, the same on all ranks.

    Attributes
    ----------
    at : ndarray, shape (m,)
        Times [s] of a trace, positions [m] of a final field.
    values : ndarray, shape (m,)
    weights : ndarray, shape (m,)
        Tributary lengths of the points [m] of a final field; 1 of a trace.
    """

    at: Floats
    values: Floats
    weights: Floats


Request = Trace | Final


class Misfit(Alternative):
    """Contract of a term of an objective."""

    example: ClassVar[str] = ""
    """Example table for a case of two plates in plane stress, 12 mm long and 4 mm high each, with a fault receiver
    named `fault` at 5.3 mm."""
    unit: ClassVar[str] = "1"
    """Unit of the value; terms of one objective have the same."""

    def requests(self, bodies: ModelReadings, key: str) -> list[Request]:
        """Return the readings that the term needs; collective.

        Raises
        ------
        CaseError
            On all ranks, if the case does not have them, or data are outside of its duration.
        """
        raise NotImplementedError

    def evaluate(self, samples: Sequence[Sample]) -> tuple[float, list[Floats]]:
        """Return the value and its derivative by the values of each reading."""
        raise NotImplementedError


class Unknown(Part):
    """A quantity of a case by which an objective is differentiated."""

    key: Annotated[str, Field(min_length=1)]
    """Dotted key: `faults.main.initial_stress.shear`, `faults.main.friction.mu_s`, `faults.main.nucleation.0.extra`."""
    shape: Literal["field", "number"] = "field"
    """Values at all points of the interface, or one number that is added everywhere."""


if TYPE_CHECKING:
    AnyMisfit = Misfit
else:
    AnyMisfit = alternative("ruptfx.misfits")
