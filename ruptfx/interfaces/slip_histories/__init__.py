"""Histories of prescribed slip, one kind per file; its name is the `kind` of an entry of `faults.NAME.prescribed_slip`.

A history says where on an interface slip is prescribed, and the slip there at any time. `_growth.py` is shared by
those that are a profile times a function of time, `_samples.py` by those that are samples, `_subfaults.py` by files
of finite faults.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import Alternative, alternative
from ruptfx.input.units import VaryingRatio
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.faults.prescribed_slip import History as History


class SlipHistory(Alternative):
    """The contract of a history of slip."""

    files_of_example: ClassVar[Mapping[str, str]] = {}
    """Content of the files that `example` names, which contract tests write beside the case."""

    where: VaryingRatio = 1.0
    """Slip is prescribed where this is above zero; elsewhere the friction law acts, or without one no slip."""

    def bind(self, face: Interface, width: float) -> History:
        """Return the history at the points of an interface.

        Parameters
        ----------
        face : Interface
        width : float
            Largest distance down dip of all points of a surface, of all ranks [m]; zero of a line.

        Raises
        ------
        CaseError
            On the rank that meets the error: values or places that do not fit the interface.
        """
        raise NotImplementedError

    def reaches(self, face: Interface) -> np.ndarray:
        """Return the points at which `where` is above zero, shape (n,)."""
        return evaluate(self.at(face.locations).where, face.locations) > 0


if TYPE_CHECKING:
    AnySlipHistory = SlipHistory
else:
    AnySlipHistory = alternative("ruptfx.interfaces.slip_histories")
