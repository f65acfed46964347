"""Isotropic damage of elastic bodies."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ruptfx.input.schema import Unit
from ruptfx.input.units import Duration, VaryingModulus
from ruptfx.laws.materials import PointError, RecordedState, StateField, Tensor
from ruptfx.laws.materials._overstress import ROUNDING, SMALLEST, relaxed
from ruptfx.laws.materials._prestressed import Prestressed

Strain = Annotated[float, Field(gt=0), Unit("1")]


class ContinuumDamage(Prestressed):
    """Isotropic elasticity whose stiffness falls by a damage d that grows with the strain: sigma = (1 - d) C : strain.

    The size of the strain is tau = sqrt(E strain : C : strain), the stress in uniaxial tension without damage. Its
    largest effective value r begins at the strength f_t and follows tau with the relaxation time T where it is larger,
    r' = (tau - r) / T: without it softening would concentrate in one row of elements of any mesh. d = 1 - f_t / r
    exp(-(r - f_t) / (E e_s)), so that slow uniaxial stress falls as f_t exp(-(e - f_t / E) / e_s). Steps are exact
    where tau grows linearly. Tension, compression and shear damage alike; damage never heals, since stiffness that
    returns under strain needs a source of energy. The elastic strain of the initial stress counts for damage, which
    lowers that stress.
    Source: Simo and Ju (1987), Int. J. Solids Struct. 23, 821-840 (strain-based, with viscosity); exponential softening
    of Oliver, Cervera, Oller and Lubliner (1990), Proc. SCI-C, 945-957.
    """

    strength: VaryingModulus
    """Stress f_t at which damage begins in slow uniaxial tension."""
    softening_strain: Strain
    """Strain e_s over which stress falls to 1 / e; f_t^2 / (2 E) + f_t e_s is dissipated per volume."""
    relaxation_time: Duration
    """Time T in which the damage follows the strain."""

    def check_values(self) -> None:
        if (part := self.yielded()) is not None and np.any(part > 1 + ROUNDING):
            worst = int(np.argmax(part))
            raise PointError(
                f"initial_stress: damages from the start, its size is {part.flat[worst]:.4g} times the strength; raise "
                "strength, or give less stress",
                worst,
            )

    def yielded(self) -> np.ndarray | None:
        if self.initial_stress is None:
            return None
        return np.asarray(np.sqrt(self._young() * self._twice_energy(self._initial)) / self.strength)

    def state_fields(self) -> dict[str, StateField]:
        return {"growth": StateField("1"), "excess": StateField("1")}

    def stress(self, strain: Tensor, state: dict[str, Any], dt: Any) -> tuple[Tensor, dict[str, Any]]:
        elastic, growth = self._elastic(strain) + self._initial, state["growth"]
        size = np.sqrt(self._young() * self._twice_energy(elastic) + SMALLEST) / self.strength
        beyond = size - 1 - growth
        grown = relaxed(state["excess"], beyond, dt / self.relaxation_time)
        new = growth + grown
        excess = np.maximum(beyond - grown, 0.0)
        return self._remaining(new) * elastic - self._initial, {"growth": new, "excess": excess}

    def recorded_states(self) -> dict[str, RecordedState]:
        return {"damage": RecordedState("1", "damage, the lost part of the stiffness")}

    def recorded(self, state: dict[str, Any]) -> dict[str, Any]:
        return {"damage": 1 - self._remaining(state["growth"])}

    def stored(self, strain: Tensor, state: dict[str, Any]) -> Any:
        """Return the energy of the remaining stiffness less that at the start and the work of initial stress."""
        twice_energy = self._twice_energy(self._elastic(strain) + self._initial)
        begun, value = self._twice_energy(self._initial), self._initial.dot(strain)
        return 0.5 * (self._remaining(state["growth"]) * twice_energy - begun) - value

    def _twice_energy(self, stress: Tensor) -> Any:
        """Return S : C^-1 : S of a stress S without damage [J/m3]."""
        first, shear = self.lame("strain")
        trace = stress.trace()
        return (stress.dot(stress) - first / (3 * first + 2 * shear) * trace * trace) / (2 * shear)

    def _remaining(self, growth: Any) -> Any:
        """Return 1 - d, the remaining part of the stiffness, at r / f_t - 1."""
        return np.exp(-growth * (self.strength / (self._young() * self.softening_strain))) / (1 + growth)

    def _young(self) -> Any:
        first, shear = self.lame("strain")
        return shear * (3 * first + 2 * shear) / (first + shear)
