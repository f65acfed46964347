"""Temperatures of an interface, one kind per file; the name is the `kind` of ``[faults.NAME.temperature]``.

Several entries add up. Friction laws with the state `temperature` read it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.input.schema import Alternative, alternative

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fields import Contribution
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System


class Temperature(Alternative):
    """Contract of a temperature."""

    source: ClassVar[str] = ""
    """Publication of the equations."""

    def bind(self, model: System, face: Interface, key: str) -> Contribution:
        """Return its contribution to the fields of an interface; its profiles are evaluated at the points; collective.

        Raises
        ------
        CaseError
            On all ranks.
        """
        raise NotImplementedError


if TYPE_CHECKING:
    AnyTemperature = Temperature
else:
    AnyTemperature = alternative("ruptfx.interfaces.temperature")
