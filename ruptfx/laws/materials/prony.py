"""Viscoelasticity from a table of moduli and relaxation times."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from ruptfx.input.schema import Unit
from ruptfx.input.units import Duration, Modulus
from ruptfx.laws.materials._relaxing import Relaxing

if TYPE_CHECKING:
    Moduli = list[float]
    Times = list[float]
else:
    Moduli = Annotated[list[Modulus], Field(min_length=1, max_length=20), Unit("Pa")]
    Times = Annotated[list[Duration], Field(min_length=1, max_length=20), Unit("s")]


class Prony(Relaxing):
    """Isotropic viscoelasticity of polymers: a Prony series of the relaxation function.

    G(t) = G - sum_l G_l (1 - exp(-t / T_l)), and with bulk_moduli K(t) = K - sum_l K_l (1 - exp(-t / T_l)). G and K are
    the moduli of the case, those of sudden loading. Steps are exact where the strain is linear in time.
    Source: Ferry (1980), Viscoelastic Properties of Polymers, 3rd ed., generalised Maxwell model.
    """

    times: Times
    """Relaxation times T_l."""
    shear_moduli: Moduli
    """Parts G_l of the shear modulus that relax, one for each time."""
    bulk_moduli: Moduli | None = None
    """Parts K_l of the bulk modulus that relax, one for each time; default is none, elastic changes of volume."""

    def check_values(self) -> None:
        first, shear = self.lame("strain")
        for key, name, modulus in (("shear_moduli", "shear", shear), ("bulk_moduli", "bulk", first + 2 * shear / 3)):
            moduli = getattr(self, key)
            if moduli is None:
                continue
            if len(moduli) != len(self.times):
                raise ValueError(f"{key}: {len(moduli)} moduli for {len(self.times)} times; give one for each time")
            least = float(np.min(modulus))
            if sum(moduli) > least * (1 + 1e-12):
                raise ValueError(
                    f"{key}: their sum {sum(moduli):.4g} Pa exceeds the {name} modulus {least:.4g} Pa of sudden "
                    "loading; lower them, or give the constants of sudden loading"
                )

    @cached_property
    def rates(self) -> tuple[float, ...]:
        return tuple(1 / time for time in self.times)

    @cached_property
    def coefficients(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        first, shear = self.lame("strain")
        bulk = [0.0] * len(self.times) if self.bulk_moduli is None else self.bulk_moduli
        of_bulk, of_shear = first + 2 * shear / 3, shear
        return tuple(each / of_bulk for each in bulk), tuple(each / of_shear for each in self.shear_moduli)
