"""What the rate-and-state laws share: regularised direct effect, its inverse, consistent initial states."""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx.friction import Array, FrictionLaw, LawState
from ruptfx.units import VaryingCoefficient, VaryingExponent, VaryingLength, VaryingSpeed, VaryingTime

_LARGEST_EXPONENT = 700.0  # exp of more overflows; met only if f_0 / a exceeds some 600


def log_sinh(x: np.ndarray) -> np.ndarray:
    """ln(2 sinh x) for x > 0, without overflow."""
    return x + np.log(-np.expm1(-2 * x))


def decay_mean(x: Array) -> Array:
    """(1 - exp(-x)) / x, with its limit 1 at x = 0 and exact derivatives there."""
    large = np.maximum(x, 1e-4)
    return np.where(x < 1e-4, 1 - x / 2 + x * x / 6, -np.expm1(-large) / large)


class RateAndState(FrictionLaw):
    """Regularised rate and state: tau = a sigma asinh(V / (2 V_0) exp((f_0 + contact(theta)) / a)).

    The form is that of thermally activated creep (Rice, Lapusta and Ranjith 2001). For V >> V_0 exp(-f_0 / a)
    it is tau = sigma (f_0 + a ln(V / V_0) + contact(theta)); at V = 0 it is zero, not infinite.
    Laws differ in `contact`, the strengthening of the contacts with their age theta, and in how the age
    evolves; all have theta = D_c / V in steady sliding.
    """

    state_fields = {"theta": "s"}

    a: VaryingExponent
    b: VaryingExponent
    D_c: VaryingLength
    f_0: VaryingCoefficient
    V_0: VaryingSpeed
    V_initial: VaryingSpeed = 1e-9
    """Slip rate [m/s] at which the initial shear stress is carried, where the interface is given at rest."""
    theta_initial: VaryingTime | None = None
    """Initial age [s]; without it, the age that carries the initial shear stress at the initial slip rate."""

    def contact(self, theta: Array) -> Array:
        """Contribution of the age of the contacts to the friction coefficient."""
        return self.b * np.log(self.V_0 * theta / self.D_c)

    def age(self, contact: Array) -> Array:
        """Inverse of `contact`: age [s]."""
        return self.D_c / self.V_0 * np.exp(contact / self.b)

    def age_rate(self, theta: Array, slip_rate: Array) -> Array:
        """dtheta/dt."""
        raise NotImplementedError

    def initial_state(
        self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray
    ) -> LawState:
        if self.theta_initial is not None:
            return {"theta": np.zeros_like(normal_stress) + self.theta_initial}
        speed = np.where(np.abs(slip_rate) > 0, np.abs(slip_rate), self.V_initial)
        # An unloaded or open point has no age that fits: its stress counts as 1e-6 of the normal stress.
        pressure = np.where(normal_stress > 0, normal_stress, 1.0)
        ratio = np.maximum(np.abs(shear_stress) / pressure, 1e-6)
        return {"theta": self.age(self.a * (log_sinh(ratio / self.a) - np.log(speed / self.V_0)) - self.f_0)}

    def _exponent(self, theta: Array) -> Array:
        return np.minimum((self.f_0 + self.contact(theta)) / self.a, _LARGEST_EXPONENT)

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        argument = slip_rate / (2 * self.V_0) * np.exp(self._exponent(state["theta"]))
        return self.a * normal_stress * np.arcsinh(argument)

    def slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        """Slip rate [m/s] at a given stress: V = 2 V_0 sinh(tau / (a sigma)) exp(-exponent)."""
        exponent, drive = self._exponent(state["theta"]), shear_stress / (self.a * normal_stress)
        return self.V_0 * (np.exp(drive - exponent) - np.exp(-drive - exponent))

    def given_slip_rate(self) -> Array | None:
        return self.V_initial if self.theta_initial is not None and "V_initial" in self.model_fields_set else None

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.slip_rate(np.abs(shear_stress), np.maximum(normal_stress, 1e-300), state)

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        speed = np.maximum(slip_rate, 1e-100)
        return self.strength(speed, normal_stress, {"theta": self.D_c / speed})

    def is_uniform(self) -> bool:
        """Whether every parameter is one number, as a lumped model needs."""
        values: list[Any] = [getattr(self, name) for name in type(self).model_fields]
        return all(value is None or isinstance(value, float | int) for value in values)
