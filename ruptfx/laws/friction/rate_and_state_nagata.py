"""Rate and state friction whose state weakens with the shear stress."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.units import VaryingCoefficient, VaryingRatio
from ruptfx.laws.friction import AT_REST, Array, LawState
from ruptfx.laws.friction.lengths import RateDependence
from ruptfx.laws.friction.rate_and_state_base import Creeping, decay_mean

LARGEST = 600.0  # logarithm of an age over D_c / V_0


class RateAndStateNagata(Creeping):
    """Rate and state of Nagata: contacts age as in the ageing law, and weaken while the shear stress grows.

    The traction is the strength at every slip rate, so the law needs no stress rate: b ln theta + c mu changes at
    a rate without it. The state variable psi is f_0 + b ln(V_0 theta/D_c) + a c/(1 + c) ln(V/V_0), with which the
    strength at a sudden change of the slip rate changes by a/(1 + c) times its logarithm. The stress is that over the
    normal stress, the coefficient mu. The weakening by stress ends at the slip rate V_0 exp(-f_0 (1 + c)/a), below
    which the direct effect of an interface with psi = f_0 is no logarithm.
    """

    state_fields = {"psi": "1"}
    formula = (
        "strength = a' sigma asinh(V/(2 V_0) exp(psi/a')), a' = a/(1 + c), "
        "psi = f_0 + b ln(V_0 theta/D_c) + c a' ln(V/V_0); dtheta/dt = 1 - V theta/D_c - c (theta/b) dmu/dt"
    )
    source = "Nagata, Nakatani, Yoshida (2012), J. Geophys. Res. 117, B02314; regularised as in Rice, Lapusta, Ranjith"
    example: ClassVar[str] = (
        '{ kind = "rate_and_state_nagata", a = 0.051, b = 0.0565, D_c = 3.3e-7, f_0 = 0.6, V_0 = 1e-6, c = 2.0 }'
    )

    c: VaryingRatio = 2.0
    """Weakening of the state by shear stress; 0 is the ageing law."""
    psi_initial: VaryingCoefficient | None = None
    """Initial state; without it, the state that carries the initial shear stress at the initial slip rate."""

    def direct(self) -> Array:
        return self.a / (1 + self.c)

    def _weakened(self, slip_rate: Array) -> Array:
        """Return a c/(1 + c) ln(V/V_0), the difference between psi and the psi of the ageing law."""
        slowest = np.maximum(np.exp(np.maximum(-self.f_0 / self.direct(), -LARGEST)), AT_REST)
        return self.c * self.direct() * np.log(np.hypot(slip_rate / self.V_0, slowest))

    def log_age(self, psi: Array, slip_rate: Array) -> Array:
        """Return ln(V_0 theta/D_c) of a state at a slip rate [m/s]."""
        return (psi - self.f_0 - self._weakened(slip_rate)) / self.b

    def psi(self, state: LawState) -> Array:
        return state["psi"]

    def state_of(self, psi: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"psi": psi}

    def given_state(self, normal_stress: np.ndarray) -> LawState | None:
        return None if self.psi_initial is None else {"psi": 0 * normal_stress + self.psi_initial}

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate, where dmu is b dtheta/theta: the ageing law in a time 1 + c times slower.
        slow_time = dt / (1 + self.c)
        x = slip_rate * slow_time / self.D_c
        age = np.minimum(np.maximum(self.log_age(state["psi"], slip_rate), -LARGEST), LARGEST)
        grown = slow_time * self.V_0 / self.D_c * np.exp(-age) * decay_mean(x)
        # theta over its value before is 1 + change; the two forms are exact near 1 and near 0.
        change = np.expm1(-x) + grown
        log_ratio = np.where(
            change > -0.5, np.log1p(np.maximum(change, -0.5)), np.log(np.maximum(np.exp(-x) + grown, AT_REST))
        )
        return {"psi": state["psi"] + self.b * log_ratio}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        speed = np.maximum(slip_rate, AT_REST)
        psi = self.f_0 - self.b * np.log(speed / self.V_0) + self._weakened(speed)
        return self.strength(speed, normal_stress, {"psi": psi})

    def lengths(self, normal_stress: Array, slip_rate: Array) -> RateDependence:
        """Return the lengths of small perturbations, which decay over (1 + c) D_c."""
        direct = self.direct()
        evolution = self.b - self.a + direct
        return RateDependence(direct * normal_stress, evolution * normal_stress, (1 + self.c) * self.D_c)
