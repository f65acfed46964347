"""Pore pressures of an interface, one kind per file; the name is the `kind` of ``[faults.NAME.pore_pressure]``.

Several entries add up. The friction law reads the normal stress less the pore pressure; the traction on the bodies
remains the total one. A pressure above the normal stress, which would open the interface, ends the run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ruptfx.input.schema import Alternative, alternative
from ruptfx.interfaces.field_table import FieldTable


class PorePressure(FieldTable, Alternative):
    """Contract of a pore pressure."""


if TYPE_CHECKING:
    AnyPorePressure = PorePressure
else:
    AnyPorePressure = alternative("ruptfx.interfaces.pore_pressure")
