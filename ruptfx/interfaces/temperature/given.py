"""A known temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import model_validator

from ruptfx.bodies.boundaries.histories import History
from ruptfx.input.schema import CasePath
from ruptfx.input.units import VaryingTemperature
from ruptfx.interfaces.faults.known_field import KnownField, require_one_source
from ruptfx.interfaces.temperature import Temperature

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System


class Given(Temperature):
    """Known temperature: a profile times a history, or values over time and position from a file."""

    example: ClassVar[str] = '{ kind = "given", temperature = 300.0 }'

    temperature: VaryingTemperature | None = None
    """Profile of the temperature."""
    history: History | None = None
    """Factor in time; without it the temperature is constant."""
    file: CasePath | None = None
    """CSV file with time, position and temperature at the points of a grid, instead of both; linear in between.
    Its header may give the units, as in `time (d), position (km), temperature (K)`."""

    @model_validator(mode="after")
    def _one_source(self) -> Given:
        require_one_source("temperature", self.temperature, self)
        return self

    def bind(self, model: System, face: Interface, key: str) -> KnownField:
        return KnownField.of("temperature", "K", self.temperature, self, face, key)
