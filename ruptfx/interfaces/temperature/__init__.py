"""Temperatures of an interface, one kind per file; the name is the `kind` of ``[faults.NAME.temperature]``.

Several entries add up. Friction laws with the state `temperature` read it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ruptfx.input.schema import Alternative, alternative
from ruptfx.interfaces.field_table import FieldTable


class Temperature(FieldTable, Alternative):
    """Contract of a temperature."""


if TYPE_CHECKING:
    AnyTemperature = Temperature
else:
    AnyTemperature = alternative("ruptfx.interfaces.temperature")
