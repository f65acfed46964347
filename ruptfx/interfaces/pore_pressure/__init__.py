"""Pore pressures of an interface, one kind per file; the name is the `kind` of ``[faults.NAME.pore_pressure]``.

Several entries add up. The friction law reads the normal stress less the pore pressure; the traction on the bodies
remains the total one. A pressure above the normal stress, which would open the interface, ends the run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.input.schema import Alternative, alternative

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fields import Contribution
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System


class PorePressure(Alternative):
    """Contract of a pore pressure."""

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
    AnyPorePressure = PorePressure
else:
    AnyPorePressure = alternative("ruptfx.interfaces.pore_pressure")
