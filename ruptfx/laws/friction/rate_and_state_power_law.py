"""Rate and state friction with a power-law direct effect."""

from __future__ import annotations

import numpy as np

from ruptfx.input.units import (
    VaryingCoefficient,
    VaryingExponent,
    VaryingLength,
    VaryingRatio,
    VaryingSpeed,
    VaryingTime,
)
from ruptfx.laws.friction import Array, FrictionLaw, LawState
from ruptfx.laws.friction.lengths import Breakdown
from ruptfx.laws.friction.rate_and_state_base import decay_mean

LARGEST = 2e6  # numbers in an array of `lengths`


class RateAndStatePowerLaw(FrictionLaw):
    """Rate and state with a power-law direct effect; at constant speed the strength falls from mu_s to mu_d.

    With r = L_0 / theta_0, the coefficient is mu = g(theta_0) (V / V_0 + 1)^(1/m),
    g = [mu_d + (mu_s - mu_d) exp(-(r / V_1)^p)] / (r / V_0 + 1)^(1/m), and the state evolves as
    dtheta_0/dt = A_0 (1 - theta_0 V / L_0). In steady sliding theta_0 = L_0 / V and
    mu_ss = mu_d + (mu_s - mu_d) exp(-(V / V_1)^p).
    """

    state_fields = {"theta_0": "s"}
    formula = (
        "strength = g(theta_0) (V/V_0 + 1)^(1/m) sigma, g = [mu_d + (mu_s - mu_d) exp(-(r/V_1)^p)] / "
        "(r/V_0 + 1)^(1/m), r = L_0/theta_0; dtheta_0/dt = A_0 (1 - theta_0 V/L_0)"
    )
    source = "Povirk and Needleman (1993); Coker, Lykotrafitis, Needleman, Rosakis (2005)"

    mu_s: VaryingCoefficient
    """Steady coefficient at rest."""
    mu_d: VaryingCoefficient
    """Steady coefficient at high slip rates."""
    V_0: VaryingSpeed
    """Slip rate of the direct effect."""
    V_1: VaryingSpeed
    """Slip rate around which the steady coefficient falls."""
    p: VaryingExponent
    """Exponent of that fall."""
    m: VaryingExponent
    """The direct effect is the power 1/m of the slip rate."""
    L_0: VaryingLength
    """Slip over which the state follows a change of the slip rate."""
    A_0: VaryingRatio = 1.0
    """Rate at which the state grows at rest."""
    theta_0_initial: VaryingTime
    """State before the first slip [s]; L_0 / theta_0_initial is the corresponding steady slip rate."""

    def initial_state(self, normal_stress: np.ndarray, shear_stress: np.ndarray, slip_rate: np.ndarray) -> LawState:
        return {"theta_0": np.zeros_like(normal_stress) + self.theta_0_initial}

    def strength(self, slip_rate: Array, normal_stress: Array, state: LawState) -> Array:
        remembered = self.L_0 / state["theta_0"]
        weakened = self.mu_d + (self.mu_s - self.mu_d) * np.exp(-((remembered / self.V_1) ** self.p))
        # (V/V_0 + 1)^(1/m) / (r/V_0 + 1)^(1/m), with one power instead of two.
        direct = ((slip_rate + self.V_0) / (remembered + self.V_0)) ** (1 / self.m)
        return weakened * direct * normal_stress

    def advance(self, state: LawState, slip_rate: Array, normal_stress: Array, dt: Array) -> LawState:
        # Exact at constant slip rate: theta_0 exp(-x) + A_0 dt (1 - exp(-x)) / x, x = A_0 V dt / L_0.
        x = self.A_0 * slip_rate * dt / self.L_0
        return {"theta_0": state["theta_0"] * np.exp(-x) + self.A_0 * dt * decay_mean(x)}

    def steady_strength(self, slip_rate: Array, normal_stress: Array) -> Array:
        """Return mu_d + (mu_s - mu_d) exp(-(V / V_1)^p), times the normal stress [Pa], point by point."""
        return (self.mu_d + (self.mu_s - self.mu_d) * np.exp(-((slip_rate / self.V_1) ** self.p))) * normal_stress

    def lengths(self, normal_stress: Array, slip_rate: Array) -> Breakdown:
        """Return the breakdown for sudden slip at a constant rate.

        theta_0 evolves from theta_0_initial to L_0 / V over some lengths L_0 / A_0; the energy is the integral over
        them.
        """
        start = np.asarray(self.theta_0_initial + 0.0 * normal_stress)
        residual = self.steady_strength(slip_rate, normal_stress)
        # theta_0 approaches its limit as exp(-A_0 slip / L_0).
        most_steps = 40 + np.log1p(slip_rate * np.max(start / self.L_0))
        times = np.linspace(0, most_steps, 2001).reshape(-1, *[1] * start.ndim)
        peak = self.strength(0.0 * start + slip_rate, normal_stress, {"theta_0": start})
        # Simpson's rule, over pairs of intervals in parts: surfaces have so many points that all times of all points
        # fill the memory.
        energy, pairs = 0.0 * start, max(1, int(LARGEST / max(start.size, 1) / 2))
        for first in range(0, len(times) - 1, 2 * pairs):
            slip = times[first : first + 2 * pairs + 1] * (self.L_0 / self.A_0)
            state = self.advance({"theta_0": start}, slip_rate, normal_stress, slip / slip_rate)
            strength = self.strength(slip_rate, normal_stress, state)
            excess = np.asarray(strength - residual)
            energy = energy + (slip[1] - slip[0]) / 3 * (excess[:-1:2] + 4 * excess[1::2] + excess[2::2]).sum(axis=0)
        return Breakdown(peak, residual, energy)
