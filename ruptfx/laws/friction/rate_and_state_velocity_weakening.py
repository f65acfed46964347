"""Rate and state friction that weakens with 1 / V at high slip rates."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import VaryingCoefficient, VaryingExponent, VaryingLength, VaryingSpeed
from ruptfx.laws.friction import Array, FrictionLaw, LawState
from ruptfx.laws.friction._memory import approach


class RateAndStateVelocityWeakening(FrictionLaw):
    """Rate and state with saturating effects: slip weakening at high slip rates, velocity weakening at low ones.

    The state is a length, zero after a long rest, that grows with slip and decays within D_c / V_w. In steady sliding
    it is V D_c / V_w, and the coefficient is mu_s + (a - b) V / (V + V_w). Much faster than V_w, friction weakens with
    slip over D_c.
    """

    state_fields = {"theta_slip": "m"}
    formula = (
        "strength = [mu_s + a V/(V + V_w) - b theta_slip/(theta_slip + D_c)] sigma; "
        "dtheta_slip/dt = V - theta_slip V_w/D_c"
    )
    source = "Ampuero and Ben-Zion (2008), Geophys. J. Int. 173, 674-692"

    mu_s: VaryingCoefficient
    """Coefficient at rest."""
    a: VaryingExponent
    """Direct effect: largest growth of the coefficient with the slip rate, at once."""
    b: VaryingExponent
    """Evolution effect: largest loss of the coefficient with the state."""
    D_c: VaryingLength
    """Slip over which the state weakens friction."""
    V_w: VaryingSpeed
    """Slip rate of both effects."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"theta_slip": np.zeros_like(normal_stress)}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        theta = state["theta_slip"]
        direct = self.a * slip_rate / (slip_rate + self.V_w)
        return np.maximum(self.mu_s + direct - self.b * theta / (theta + self.D_c), 0.0) * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate.
        return {"theta_slip": approach(state["theta_slip"], slip_rate * self.D_c / self.V_w, dt * self.V_w / self.D_c)}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        steady = {"theta_slip": slip_rate * self.D_c / self.V_w}
        return self.strength(slip_rate, normal_stress, steady)
