"""A known pressure."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import model_validator

from ruptfx.bodies.boundaries.histories import History
from ruptfx.input.schema import CasePath
from ruptfx.input.units import VaryingDelay, VaryingInstant, VaryingPressure
from ruptfx.interfaces.faults.known_field import KnownField, require_one_source
from ruptfx.interfaces.pore_pressure import PorePressure

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System


class Given(PorePressure):
    """Known pressure: a profile times a history, or values over time and position from a file."""

    example: ClassVar[str] = '{ kind = "given", pressure = 300.0 }'

    pressure: VaryingPressure | None = None
    """Profile of the pressure."""
    history: History | None = None
    """Factor in time; without it the pressure is constant."""
    file: CasePath | None = None
    """CSV file with time, position and pressure at the points of a grid, instead of both; linear in between.
    Its header may give the units, as in `time (d), position (km), pressure (Pa)`."""
    begin: VaryingInstant | None = None
    """Time at which the pressure rises from zero; without it, it acts from the start."""
    end: VaryingInstant | None = None
    """Time at which it falls to zero."""
    rise: VaryingDelay = 0.0
    """Duration of its rise and of its fall; 0: instantaneous."""

    @model_validator(mode="after")
    def _one_source(self) -> Given:
        require_one_source("pressure", self.pressure, self)
        return self

    def bind(self, model: System, face: Interface, key: str) -> KnownField:
        known = KnownField.of("pore_pressure", "Pa", self.pressure, self, face, key)
        return known.between(self.begin, self.end, self.rise)
