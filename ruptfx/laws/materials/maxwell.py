"""Maxwell viscoelasticity."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from ruptfx.input.units import Duration
from ruptfx.laws.materials._relaxing import Relaxing


class Maxwell(Relaxing):
    """Isotropic elasticity whose shear stress relaxes to zero: a spring and a dashpot in series.

    ds/dt = 2 G de/dt - s / T, with the deviators s and e of stress and strain and T = eta / G, eta the shear viscosity.
    Volume changes are elastic. Steps are exact where the strain is linear in time.
    """

    relaxation_time: Duration
    """Relaxation time T = eta / G of shear stress."""

    @cached_property
    def rates(self) -> tuple[float, ...]:
        return (1 / self.relaxation_time,)

    @cached_property
    def coefficients(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        return (0.0,), (1.0,)
