"""Isotropic bodies with memory that start from an initial stress."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field

from ruptfx.input.schema import Unit
from ruptfx.input.units import VaryingStress
from ruptfx.laws.materials import IDENTITY, Tensor
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic

if TYPE_CHECKING:
    StressTensor = list[Any]
else:
    StressTensor = Annotated[list[VaryingStress], Field(min_length=6, max_length=6), Unit("Pa")]


class Prestressed(IsotropicElastic):
    """Isotropic elasticity in which the initial stress counts for yield or damage."""

    linear: ClassVar[bool] = False

    initial_stress: StressTensor | None = None
    """Initial stress: xx, yy, zz, xy, yz, xz, tension positive; in equilibrium with the tractions of interfaces.
    Without it that of the table `[initial_stress]`, and without both, where that is allowed, none."""

    @property
    def _initial(self) -> Tensor:
        return Tensor(*(self.initial_stress or [0.0] * 6))

    def _elastic(self, strain: Tensor) -> Tensor:
        """Return the stress of an elastic strain [Pa]."""
        first, shear = self.lame("strain")
        return first * strain.trace() * IDENTITY + 2 * shear * strain
