"""Pores that open where slip accelerates, with drainage through a membrane."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.units import Compressibility, Duration, Fraction, VaryingCoefficient
from ruptfx.interfaces.faults.fields import Contribution, Heating
from ruptfx.interfaces.field_table import MOTION
from ruptfx.interfaces.pore_pressure import PorePressure
from ruptfx.interfaces.pore_pressure._state import require_state

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System

BRIEF = 1e-3
"""Step over the drainage time below which the error of a step is a series."""


class Dilatancy(PorePressure):
    """Dilatancy: pores open where the state theta falls, and drain in a constant time.

    dp/dt = -p / t_d + epsilon / (beta phi) d(ln theta)/dt, at every point by itself. Where slip accelerates, theta and
    the pressure fall, which stabilises slip.
    """

    needs = frozenset({MOTION})
    source = "Segall and Rice (1995)"
    example: ClassVar[str] = (
        '{ kind = "dilatancy", coefficient = 1e-4, compressibility = 1e-8, porosity = 0.1, drainage_time = 0.1 }'
    )

    coefficient: VaryingCoefficient
    """epsilon: change of the porosity when theta changes by a factor of e."""
    compressibility: Compressibility
    """beta of fluid and pores."""
    porosity: Fraction
    """phi of the layer."""
    drainage_time: Duration | None = None
    """t_d, in which a pressure falls by a factor of e; without it nothing drains."""

    def bind(self, model: System, face: Interface, key: str) -> Drained:
        require_state(model, key)
        return Drained(self, len(face.plus))


class Drained(Contribution):
    """Pressure of points without flow along the interface, exact for a constant rate of ln theta in a step."""

    adds = ("pore_pressure",)
    is_aged = True

    def __init__(self, table: Dilatancy, points: int) -> None:
        self._points, self._drainage = points, table.drainage_time
        self._per_age = table.coefficient / (table.compressibility * table.porosity)  # Pa

    def memory(self) -> dict[str, np.ndarray]:
        return {"change": np.zeros((self._points, 1))}

    def values(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> dict[str, np.ndarray]:
        change, added = memory["change"][:, 0], self._per_age * heating.aged
        if self._drainage is not None and heating.elapsed > 0:
            x = heating.elapsed / self._drainage
            change, added = np.exp(-x) * change, -np.expm1(-x) / x * added
        return {"pore_pressure": change + added}

    def advance(self, memory: Mapping[str, np.ndarray], time: float, heating: Heating) -> None:
        memory["change"][:, 0] = self.values(memory, time, heating)["pore_pressure"]

    def uncertainty(self, heating: Heating) -> np.ndarray | float:
        """Return the difference from a rate of ln theta that grows linearly from that of the step before."""
        if self._drainage is None or heating.elapsed == 0:
            return 0.0
        x = heating.elapsed / self._drainage
        part = x**3 / 12 if x < BRIEF else 0.5 * x * (1 + np.exp(-x)) + np.expm1(-x)
        growth = (heating.aged / heating.elapsed - heating.ageing) / heating.elapsed
        return np.asarray(np.abs(self._per_age * growth) * self._drainage**2 * part)
