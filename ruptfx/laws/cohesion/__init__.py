"""Cohesive laws, one per file; the file name is the `kind` in a case.

The strength of an interface in addition to friction: tension up to `f_t remaining(D)` and a cohesion of `c
remaining(D)` in shear, where the damage D grows from 0 to 1 with inelastic opening and slip and never falls. A law is
its formulas, NumPy operations point by point without branches on values; they are traced
(`ruptfx.platform.codegen.tracing`) into C.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.input.fields import Array
from ruptfx.input.schema import Alternative, alternative
from ruptfx.input.units import VaryingEnergy, VaryingPressure


class CohesiveLaw(Alternative):
    """Contract of a cohesive law; parameters are the fields of the subclass."""

    formula: ClassVar[str] = ""
    """The law in one line, for `ruptfx describe cohesion`."""
    source: ClassVar[str] = ""
    """Source of the formula."""
    area: ClassVar[float]
    """Integral of `remaining_fraction` from 0 to 1; with strength and fracture energy it determines the jump at
    failure."""
    former_attributes: ClassVar[dict[str, str]] = {"left": "remaining_fraction"}

    f_t: VaryingPressure
    """Tensile strength; where it and `c` are zero, there is an initial crack."""
    c: VaryingPressure
    """Cohesion: shear strength without friction."""
    G_Ic: VaryingEnergy
    """Fracture energy of opening alone. In mixed mode the work of opening over `G_Ic` and that of slip over
    `G_IIc` add up to 1.41 at most, 1.11 to 1.2 on average in runs; `benzeggagh_kenane` uses a measured energy instead.
    """
    G_IIc: VaryingEnergy
    """Fracture energy of slip alone, without friction; see `G_Ic` for mixed modes."""

    @property
    def opening_at_failure(self) -> Array:
        """Inelastic opening at failure, G_Ic / (f_t area) [m]."""
        return self.G_Ic / (self.f_t * self.area)

    @property
    def slip_at_failure(self) -> Array:
        """Inelastic slip at failure, G_IIc / (c area) [m]."""
        return self.G_IIc / (self.c * self.area)

    def remaining_cohesion(self, damage: np.ndarray) -> np.ndarray:
        """Return the cohesion (shear strength without friction) at a damage [Pa], shape (n,)."""
        return np.asarray(self.c * np.where(damage < 1, self.remaining_fraction(damage), 0.0))

    def remaining_fraction(self, damage: Array) -> Array:
        """Return the remaining fraction of the strength, 1 at damage 0 and 0 at damage 1, decreasing."""
        raise NotImplementedError

    def damage(self, opening: Array, slip: Array) -> Array:
        """Return the damage, 0 to 1, from largest inelastic opening and accumulated inelastic slip [m].

        Here the circle of mixed modes, sqrt((opening / delta_n)^2 + (slip / delta_s)^2) (Source: Munjiza et al. 1999).
        On a straight path at an angle a from opening the works of opening and slip are G_Ic cos(a) and G_IIc sin(a).
        """
        return np.minimum(np.sqrt((opening / self.opening_at_failure) ** 2 + (slip / self.slip_at_failure) ** 2), 1.0)


if TYPE_CHECKING:
    AnyCohesion = CohesiveLaw
else:
    AnyCohesion = alternative("ruptfx.laws.cohesion")
