"""The contract of pore pressures and temperatures of an interface, as tables of a case."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.input.schema import Part

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fields import Contribution
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System


MOTION = "motion of the interface"
"""What fields need that depend on slip, the state of friction, stress or heat; gradients exclude it."""


class FieldTable(Part):
    """A contribution to a field of an interface; mixed into the contract of each field."""

    source: ClassVar[str] = ""
    """Publication of the equations."""

    @property
    def follows_motion(self) -> bool:
        """True if the field depends on the motion of the interface, by its kind or by its values."""
        return MOTION in self.needs

    def bind(self, model: System, face: Interface, key: str) -> Contribution:
        """Return its contribution to the fields of an interface; its profiles are evaluated at the points; collective.

        Raises
        ------
        CaseError
            On all ranks.
        """
        raise NotImplementedError
