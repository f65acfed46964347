"""Slip weakening with a long tail."""

import numpy as np

from ruptfx.plugin import Array, FrictionLaw, LawState, VaryingCoefficient, VaryingLength


class HyperbolicWeakening(FrictionLaw):
    """Slip weakening with a long tail."""

    formula = "strength = sigma (mu_d + (mu_s - mu_d) / (1 + slipped / D_c))"
    source = "an example"
    state_fields = {"slipped": "m"}
    mu_s: VaryingCoefficient
    """Static friction coefficient."""
    mu_d: VaryingCoefficient
    """Friction coefficient after a long slip."""
    D_c: VaryingLength
    """Slip that halves the drop."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"slipped": np.zeros_like(normal_stress)}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        return normal_stress * (self.mu_d + (self.mu_s - self.mu_d) / (1 + state["slipped"] / self.D_c))

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        return {"slipped": state["slipped"] + slip_rate * dt}
