"""A known temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import model_validator

from ruptfx.bodies.boundaries.histories import History
from ruptfx.input.schema import CasePath
from ruptfx.input.units import VaryingTemperature
from ruptfx.interfaces.faults.known_field import KnownField
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
        if (self.temperature is None) == (self.file is None):
            raise ValueError("temperature, file: give one of them")
        if self.file is not None and self.history is not None:
            raise ValueError("history: the file has values over time; remove it, or give temperature instead of file")
        return self

    def bind(self, model: System, face: Interface, key: str) -> KnownField:
        if self.file is not None:
            return KnownField.of_file("temperature", self.file, "K", face, key)
        assert self.temperature is not None  # `_one_source`
        return KnownField.of_profile("temperature", self.temperature, self.history, len(face.plus))
