"""Drucker-Prager viscoplasticity."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ruptfx.input.units import Duration, VaryingAngle, VaryingPressure
from ruptfx.laws.materials import PointError, RecordedState, StateField, Tensor
from ruptfx.laws.materials._overstress import ROUNDING, SMALLEST, relaxed
from ruptfx.laws.materials._prestressed import Prestressed


class DruckerPrager(Prestressed):
    """Isotropic elasticity up to yield, then viscoplastic flow without change of volume.

    Yield: sqrt(J2) <= Y = max(c cos phi - sigma_m sin phi, 0), with the mean stress sigma_m (tension positive). The
    overstress f = sqrt(J2) - Y decays with the relaxation time T along the deviator: f' = g - f / T, where g is its
    elastic rate. A step solves this exactly for constant g: f = f_0 exp(-dt / T) + g T (1 - exp(-dt / T)).
    Source: Andrews (2005), JGR 110, B01307; SCEC/USGS benchmarks TPV12 and TPV13 (Harris et al. 2011, SRL 82).
    """

    linear: ClassVar[bool] = False
    needs_initial_stress: ClassVar[bool] = True

    cohesion: VaryingPressure
    """Cohesion c."""
    friction_angle: VaryingAngle
    """Angle of internal friction phi."""
    relaxation_time: Duration
    """Relaxation time T of the stress beyond yield."""

    def check_values(self) -> None:
        tau, strength = np.broadcast_arrays(*self.shear_and_strength(self._initial))
        # The rounding of a stress far below is that of its own size.
        if np.any(tau > strength + ROUNDING * np.abs(tau).max()):
            worst = int(np.argmax(tau - strength))
            raise PointError(
                f"initial_stress: beyond yield, sqrt(J2) = {tau.flat[worst]:.4g} Pa above {strength.flat[worst]:.4g} "
                "Pa; raise cohesion or compression",
                worst,
            )

    def yielded(self) -> np.ndarray:
        tau, strength = np.broadcast_arrays(*self.shear_and_strength(self._initial))
        return np.asarray(tau / np.maximum(strength, np.maximum(ROUNDING * np.abs(tau).max(), SMALLEST)))

    def shear_and_strength(self, total: Tensor) -> tuple[Any, Any]:
        """Return sqrt(J2) and its limit Y [Pa] of a stress."""
        deviator = total.deviator()
        limit = self.cohesion * np.cos(self.friction_angle) - total.trace() / 3 * np.sin(self.friction_angle)
        return np.sqrt(0.5 * deviator.dot(deviator) + SMALLEST), np.maximum(limit, 0.0)

    def flow(self, total: Tensor) -> Tensor:
        """Return the part of a stress that relaxes beyond yield [Pa]."""
        return total.deviator()

    def state_fields(self) -> dict[str, StateField]:
        return {"plastic_strain": StateField("1", tensor=True), "overstress": StateField("Pa")}

    def stress(self, strain: Tensor, state: dict[str, Any], dt: Any) -> tuple[Tensor, dict[str, Any]]:
        _, shear = self.lame("strain")
        trial = self._elastic(strain - state["plastic_strain"])
        total = trial + self._initial
        tau, limit = self.shear_and_strength(total)
        beyond = tau - limit
        flown = relaxed(state["overstress"], beyond, dt / self.relaxation_time)
        part, flow = np.minimum(flown / tau, 1.0), self.flow(total)
        return trial - part * flow, {
            "plastic_strain": state["plastic_strain"] + (part / (2 * shear)) * flow,
            "overstress": np.maximum(beyond - np.minimum(flown, tau), 0.0),
        }

    def recorded_states(self) -> dict[str, RecordedState]:
        return {"plastic_strain": RecordedState("1", "magnitude sqrt(2/3 e:e) of the plastic strain e")}

    def recorded(self, state: dict[str, Any]) -> dict[str, Any]:
        plastic = state["plastic_strain"]
        return {"plastic_strain": np.sqrt(2 / 3 * plastic.dot(plastic))}

    def stored(self, strain: Tensor, state: dict[str, Any]) -> Any:
        """Return the elastic energy less what the initial stress has given to the plastic strain."""
        first, shear = self.lame("strain")
        elastic = strain - state["plastic_strain"]
        trace, value = elastic.trace(), self._initial.dot(state["plastic_strain"])
        return 0.5 * first * trace * trace + shear * elastic.dot(elastic) - value
