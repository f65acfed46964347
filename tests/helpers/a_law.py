"""A friction law as the text of a plug-in."""

from __future__ import annotations

LAW = '''
from __future__ import annotations

import numpy as np

from ruptfx.laws.friction import FrictionLaw
from ruptfx.input.units import VaryingCoefficient, VaryingLength


class MyLaw(FrictionLaw):
    """Slip weakening that never ends."""

    state_fields = {"own_slip": "m"}
    mu_s: VaryingCoefficient
    L: VaryingLength = 1e-5

    def initial_state(self, normal_stress, shear_stress, slip_rate):
        return {"own_slip": np.zeros_like(normal_stress)}

    def strength(self, slip_rate, normal_stress, state):
        return self.mu_s * normal_stress / (1 + state["own_slip"] / self.L)

    def advance(self, state, slip_rate, normal_stress, dt):
        return {"own_slip": state["own_slip"] + slip_rate * dt}
'''
