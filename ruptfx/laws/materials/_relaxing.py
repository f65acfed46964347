"""Isotropic viscoelasticity with springs and dashpots in parallel: the stress for any relaxation spectrum."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ruptfx.laws.materials import IDENTITY, StateField, Tensor
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic


class Relaxing(IsotropicElastic):
    """Bulk and shear modulus relax with M(t) = M_U (1 - sum_l Y_l (1 - exp(-omega_l t))), M_U those of the case.

    Source: anelastic functions, Kristek and Moczo (2003), BSSA 93, 2273-2280.
    """

    linear: ClassVar[bool] = True

    @cached_property
    def rates(self) -> tuple[float, ...]:
        """Relaxation rates omega_l [rad/s]."""
        raise NotImplementedError

    @cached_property
    def coefficients(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Coefficients Y_l of bulk and shear modulus."""
        raise NotImplementedError

    def state_fields(self) -> dict[str, StateField]:
        delayed = {f"delayed_{number}": StateField("1", tensor=True) for number in range(len(self.rates))}
        return {"strain": StateField("1", tensor=True), **delayed}

    def stress(self, strain: Tensor, state: dict[str, Any], dt: Any) -> tuple[Tensor, dict[str, Any]]:
        """Return C (strain - sum_l Y_l z_l), dz_l/dt = omega_l (strain - z_l): exact where strain is linear in time."""
        bulk, shear = strain, strain
        new = {"strain": strain}
        for number, (rate, of_bulk, of_shear) in enumerate(zip(self.rates, *self.coefficients, strict=True)):
            part = rate * dt
            kept = np.exp(-part)
            mean = np.where(part > 0, -np.expm1(-part) / np.where(part > 0, part, 1.0), 1.0)
            delayed = kept * state[f"delayed_{number}"] + (mean - kept) * state["strain"] + (1 - mean) * strain
            new[f"delayed_{number}"] = delayed
            bulk, shear = bulk - of_bulk * delayed, shear - of_shear * delayed
        first, modulus = self.lame("strain")
        return (first + 2 * modulus / 3) * bulk.trace() * IDENTITY + 2 * modulus * shear.deviator(), new

    def stored(self, strain: Tensor, state: dict[str, Any]) -> Any:
        """Return the energy of all springs: those without dashpot, and those in series with one."""
        first, modulus = self.lame("strain")
        bulk = first + 2 * modulus / 3

        def energy(of_bulk: Any, of_shear: Any, at: Tensor) -> Any:
            deviator = at.deviator()
            return 0.5 * of_bulk * bulk * at.trace() * at.trace() + of_shear * modulus * deviator.dot(deviator)

        total = energy(1 - sum(self.coefficients[0]), 1 - sum(self.coefficients[1]), strain)
        for number, (of_bulk, of_shear) in enumerate(zip(*self.coefficients, strict=True)):
            total = total + energy(of_bulk, of_shear, strain - state[f"delayed_{number}"])
        return total
