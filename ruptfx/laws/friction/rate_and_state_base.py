"""Shared part of the rate-and-state laws: regularised direct effect, its inverse, consistent initial states."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ruptfx.input.units import (
    VaryingCoefficient,
    VaryingEvolution,
    VaryingExponent,
    VaryingLength,
    VaryingSpeed,
    VaryingTime,
)
from ruptfx.laws.friction import AT_REST, Array, FrictionLaw, LawState
from ruptfx.laws.friction.lengths import RateDependence

LOWEST = 1e-6  # friction coefficient
_LARGEST_EXPONENT = 700.0  # exp of more overflows; reached only if f_0 / a exceeds some 600


def log_sinh(x: np.ndarray) -> np.ndarray:
    """Return ln(2 sinh x) for x > 0, without overflow."""
    return x + np.log(-np.expm1(-2 * x))


def decay_mean(x: Array) -> Array:
    """Return (1 - exp(-x)) / x, with its limit 1 at x = 0 and exact derivatives there."""
    large = np.maximum(x, 1e-4)
    return np.where(x < 1e-4, 1 - x / 2 + x * x / 6, -np.expm1(-large) / large)


class Creeping(FrictionLaw):
    """Regularised direct effect: tau = a sigma asinh(V / (2 V_0) exp(psi / a)).

    The form is that of thermally activated creep (Rice, Lapusta and Ranjith 2001). For V >> V_0 exp(-psi / a)
    it is tau = sigma (psi + a ln(V / V_0)); at V = 0 it is zero, not infinite. Laws differ in what psi is.
    """

    a: VaryingExponent
    """Direct effect: instantaneous change of the coefficient with the logarithm of the slip rate."""
    b: VaryingEvolution
    """Evolution effect: change of the coefficient with the logarithm of the slip rate, over D_c."""
    D_c: VaryingLength
    """Slip over which the state follows a change of the slip rate."""
    f_0: VaryingCoefficient
    """Steady coefficient at the slip rate V_0."""
    V_0: VaryingSpeed
    """Reference slip rate."""
    V_initial: VaryingSpeed = 1e-9
    """Slip rate [m/s] at which the initial shear stress is carried, if the interface has no initial velocity. With an
    initial state and a stress the law gives it; it begins at the larger of this and V_0 at most."""

    def direct(self) -> Array:
        """Return the change of the coefficient at once with the logarithm of the slip rate [1], point by point."""
        return self.a

    def psi(self, state: LawState) -> Array:
        """Return the friction coefficient [1] at the slip rate V_0, without the regularisation, point by point."""
        raise NotImplementedError

    def state_of(self, psi: np.ndarray, slip_rate: np.ndarray) -> LawState:
        """Return the state of a `psi` and a slip rate [m/s], the inverse of `psi`."""
        raise NotImplementedError

    def given_state(self, normal_stress: np.ndarray) -> LawState | None:
        """Return the initial state if it is a parameter, else None."""
        raise NotImplementedError

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        value = self.given_state(normal_stress)
        if value is not None:
            return value
        speed = np.where(np.abs(slip_rate) > 0, np.abs(slip_rate), self.V_initial)
        # An unloaded or open point has no consistent state: use a stress of 1e-6 of the normal stress.
        pressure = np.where(normal_stress > 0, normal_stress, np.inf)
        ratio = np.maximum(np.abs(shear_stress) / pressure, LOWEST)
        direct = self.direct()
        return self.state_of(direct * (log_sinh(ratio / direct) - np.log(speed / self.V_0)), speed)

    def _exponent(self, state: LawState) -> Array:
        return np.minimum(self.psi(state) / self.direct(), _LARGEST_EXPONENT)

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        return self.direct() * normal_stress * np.arcsinh(slip_rate / (2 * self.V_0) * np.exp(self._exponent(state)))

    def slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        """Return the slip rate [m/s] at a given stress: V = 2 V_0 sinh(tau / (a sigma)) exp(-psi / a)."""
        exponent, drive = self._exponent(state), shear_stress / (self.direct() * normal_stress)
        return self.V_0 * (np.exp(drive - exponent) - np.exp(-drive - exponent))

    def given_slip_rate(self) -> Array | None:
        return self.V_initial if self.given_state(np.zeros(1)) and "V_initial" in self.model_fields_set else None

    def carried_slip_rate(self, shear_stress: Array, normal_stress: Array, state: LawState) -> Array:
        return self.slip_rate(np.abs(shear_stress), np.maximum(normal_stress, 1e-300), state)

    def largest_initial_slip_rate(self) -> Array:
        return np.maximum(self.V_0, self.V_initial)

    def lengths(self, normal_stress: Array, slip_rate: Array) -> RateDependence:
        """Return the lengths of small perturbations at low slip rates."""
        return RateDependence(self.a * normal_stress, self.b * normal_stress, self.D_c)


class RateAndState(Creeping):
    """Rate and state with psi = f_0 + contact(theta).

    Laws differ in `contact`, the strengthening of the contacts with their age theta, and in how the age
    evolves; theta is D_c / V in steady sliding where a law has no other `steady_age`.
    """

    state_fields = {"theta": "s"}

    offers_with: ClassVar[dict[str, str]] = {"age_rate": "age"}
    theta_initial: VaryingTime | None = None
    """Initial age [s]; without it, the age that carries the initial shear stress at the initial slip rate."""

    def contact(self, theta: Array) -> Array:
        """Return the contribution of the contact age [s] to the friction coefficient [1], point by point."""
        return self.b * np.log(self.V_0 * theta / self.D_c)

    def contact_slope(self, theta: Array) -> Array:
        """Return the derivative of `contact` by ln theta [1], point by point."""
        return self.b + 0 * theta

    def age(self, contact: Array) -> Array:
        """Return the age [s] of a contribution, the inverse of `contact`."""
        return self.D_c / self.V_0 * np.exp(contact / self.b)

    def age_rate(self, theta: Array, slip_rate: Array) -> Array:
        """Return dtheta/dt [1] at an age [s] and a slip rate [m/s], point by point."""
        raise NotImplementedError

    def steady_age(self, slip_rate: Array) -> Array:
        """Return the age [s] in steady sliding at a slip rate [m/s]."""
        return self.D_c / slip_rate

    def psi(self, state: LawState) -> Array:
        return self.f_0 + self.contact(state["theta"])

    def state_of(self, psi: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"theta": self.age(psi - self.f_0)}

    def given_state(self, normal_stress: np.ndarray) -> LawState | None:
        return None if self.theta_initial is None else {"theta": 0 * normal_stress + self.theta_initial}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        speed = np.maximum(slip_rate, AT_REST)
        return self.strength(speed, normal_stress, {"theta": self.steady_age(speed)})

    def isothermal(self) -> RateAndState:
        """Return the law of the same strength at a constant temperature, whose age is the contact time."""
        return self

    def is_uniform(self) -> bool:
        """Return whether every parameter is one number, as required by a lumped model."""
        values: list[object] = [getattr(self, name) for name in type(self).model_fields]
        return all(value is None or isinstance(value, float | int) for value in values)
