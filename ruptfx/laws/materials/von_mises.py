"""Von Mises viscoplasticity with hardening."""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.input.units import Duration, VaryingPressure
from ruptfx.laws.materials import PointError, RecordedState, StateField, Tensor
from ruptfx.laws.materials._overstress import ROUNDING, SMALLEST, relaxed
from ruptfx.laws.materials._prestressed import Prestressed


class VonMises(Prestressed):
    """Isotropic elasticity up to yield, then viscoplastic flow with linear hardening: metals, and glassy polymers.

    Yield: q <= sigma_y + H kappa, q = sqrt(3 / 2 (s - X):(s - X)), with the deviator s of the stress, the equivalent
    plastic strain kappa and the back stress X = 2 / 3 H_k plastic strain. The part of q beyond yield decays with the
    relaxation time T at constant strain, during which the strength hardens. With T far below the time step flow is
    independent of the rate.
    Source: Simo and Hughes (1998), Computational Inelasticity, sections 1.7 and 3.3 (radial return).
    """

    yield_stress: VaryingPressure
    """Yield stress sigma_y in tension."""
    hardening: VaryingPressure = 0.0
    """Isotropic hardening modulus H: stress per equivalent plastic strain."""
    kinematic_hardening: VaryingPressure = 0.0
    """Kinematic hardening modulus H_k, of the back stress."""
    relaxation_time: Duration
    """Relaxation time T of the stress beyond yield."""

    def check_values(self) -> None:
        value, limit = np.broadcast_arrays(self._size(self._initial.deviator()), self.yield_stress)
        if np.any(value > limit * (1 + ROUNDING)):
            worst = int(np.argmax(value - limit))
            raise PointError(
                f"initial_stress: beyond yield, q = {value.flat[worst]:.4g} Pa above {limit.flat[worst]:.4g} Pa; raise "
                "yield_stress, or give a stress with smaller differences",
                worst,
            )

    def yielded(self) -> np.ndarray | None:
        if self.initial_stress is None:
            return None
        return np.asarray(np.divide(*np.broadcast_arrays(self._size(self._initial.deviator()), self.yield_stress)))

    def _size(self, deviator: Tensor) -> Any:
        """Return q of a deviator [Pa]."""
        return np.sqrt(1.5 * deviator.dot(deviator) + SMALLEST)

    def state_fields(self) -> dict[str, StateField]:
        return {
            "plastic_strain": StateField("1", tensor=True), "equivalent_plastic_strain": StateField("1"),
            "overstress": StateField("Pa"),
        }  # fmt: skip

    def stress(self, strain: Tensor, state: dict[str, Any], dt: Any) -> tuple[Tensor, dict[str, Any]]:
        _, shear = self.lame("strain")
        plastic, kappa = state["plastic_strain"], state["equivalent_plastic_strain"]
        trial = self._elastic(strain - plastic)
        shifted = (trial + self._initial).deviator() - (2 / 3) * self.kinematic_hardening * plastic
        q = self._size(shifted)
        beyond = q - (self.yield_stress + self.hardening * kappa)
        flown = relaxed(state["overstress"], beyond, dt / self.relaxation_time)
        # Flow lowers q by 3 G per equivalent plastic strain, and hardening raises the yield stress.
        added = flown / (3 * shear + self.hardening + self.kinematic_hardening)
        flow = (1.5 * added / q) * shifted
        return trial - 2 * shear * flow, {
            "plastic_strain": plastic + flow, "equivalent_plastic_strain": kappa + added,
            "overstress": np.maximum(beyond - flown, 0.0),
        }  # fmt: skip

    def recorded_states(self) -> dict[str, RecordedState]:
        return {"equivalent_plastic_strain": RecordedState("1", "equivalent plastic strain, accumulated")}

    def stored(self, strain: Tensor, state: dict[str, Any]) -> Any:
        """Return the elastic energy and that of the back stress; isotropic hardening dissipates.

        Less what the initial stress has given to the plastic strain.
        """
        first, shear = self.lame("strain")
        plastic = state["plastic_strain"]
        elastic = strain - plastic
        trace = elastic.trace()
        back = self.kinematic_hardening / 3 * plastic.dot(plastic)
        value = self._initial.dot(plastic)
        return 0.5 * first * trace * trace + shear * elastic.dot(elastic) + back - value
