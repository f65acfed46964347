"""Velocity steps, holds and stability of the evolution laws against closed forms and differential equations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.laws.friction.rate_and_state_base import Creeping
from ruptfx.laws.friction.rate_and_state_nagata import RateAndStateNagata
from ruptfx.laws.friction.rate_and_state_prz import RateAndStatePrz
from ruptfx.laws.friction.rate_and_state_slip import RateAndStateSlip
from ruptfx.laws.friction.rate_and_state_two_states import RateAndStateTwoStates
from ruptfx.lumped.spring_slider.slider import Slider, critical_stiffness

ONE = np.ones(1)
COMMON = {"D_c": 1e-5, "f_0": 0.6, "V_0": 1e-6}
PRZ = RateAndStatePrz(a=0.01, b=0.015, **COMMON)
TWO = RateAndStateTwoStates(a=0.01, b=0.02, b_2=-0.006, D_c_2=8e-5, **COMMON)
NAGATA = RateAndStateNagata(a=0.051, b=0.0565, c=2.0, **COMMON)


def after_a_step(law: Creeping, before: float, after: float, slip: np.ndarray) -> np.ndarray:
    """Friction coefficient at slips after steady sliding at one slip rate and a step to another."""
    ratio = law.steady_strength(before * ONE, ONE)
    state = law.initial_state(ONE, ratio, before * ONE)
    if isinstance(law, RateAndStateTwoStates):
        assert state["psi_1"][0] == pytest.approx(-law.b * np.log(before / law.V_0), rel=1e-9, abs=1e-12)
    return np.array([law.strength(after * ONE, ONE, law.advance(state, after * ONE, ONE, s / after))[0] for s in slip])


SLIP = np.array([0.0, 0.3e-5, 1e-5, 4e-5, 1e-3])


def test_step_of_prz() -> None:
    """From 1 to 10 um/s u = V theta / (2 D_c) is 10, then tanh(artanh 10 + s / (2 D_c)) with the inverse coth."""
    first = 0.6 + 0.01 * np.log(10)
    u = 1 / np.tanh(np.arctanh(0.1) + SLIP / (2 * PRZ.D_c))
    expected = first + PRZ.b * np.log(u / 10)
    np.testing.assert_allclose(after_a_step(PRZ, 1e-6, 1e-5, SLIP), expected, rtol=1e-12)
    assert expected[-1] == pytest.approx(0.6 - 0.005 * np.log(10), rel=1e-12)
    # A step down, from 10 to 1 um/s: u begins at 0.1.
    u = np.tanh(np.arctanh(0.1) + SLIP / (2 * PRZ.D_c))
    expected = 0.6 - 0.005 * np.log(10) - 0.01 * np.log(10) + PRZ.b * np.log(10 * u)
    np.testing.assert_allclose(after_a_step(PRZ, 1e-5, 1e-6, SLIP), expected, rtol=1e-12)


def test_prz_ages_at_rest_and_slips_as_the_ageing_law_near_steady_sliding() -> None:
    """A hold of 1000 s adds 1000 s; a step by 1 % is that of ageing and slip law to second order."""
    at_rest = PRZ.advance({"theta": 20.0 * ONE}, 0 * ONE, ONE, 1000.0)
    assert at_rest["theta"][0] == pytest.approx(1020.0, rel=1e-13)
    laws = [PRZ, *(kind(a=0.01, b=0.015, **COMMON) for kind in (RateAndStateAgeing, RateAndStateSlip))]
    steps = [after_a_step(law, 1e-6, 1.01e-6, SLIP) for law in laws]
    for each in steps[1:]:
        np.testing.assert_allclose(each, steps[0], atol=0.015 * 0.01**2 / 4)
    # The same critical stiffness, from the spring slider: (b - a) / D_c.
    sliders = [Slider(law, 1.0, 1.0) for law in laws]
    np.testing.assert_allclose([critical_stiffness(slider, 1e-6)[0] for slider in sliders], 0.005 / 1e-5, rtol=1e-6)


def test_step_of_two_states() -> None:
    """a ln 10 at once; psi_1 decays by b ln 10 over D_c, psi_2 by b_2 ln 10 over D_c_2."""
    decade = np.log(10)
    first, second = -np.expm1(-SLIP / TWO.D_c), -np.expm1(-SLIP / TWO.D_c_2)
    expected = 0.6 + decade * (0.01 - 0.02 * first + 0.006 * second)
    np.testing.assert_allclose(after_a_step(TWO, 1e-6, 1e-5, SLIP), expected, rtol=1e-12)
    alone = RateAndStateTwoStates(a=0.01, b=0.015, b_2=0.0, D_c_2=1.0, **COMMON)
    slip_law = RateAndStateSlip(a=0.01, b=0.015, **COMMON)
    np.testing.assert_allclose(
        after_a_step(alone, 3e-6, 2e-5, SLIP), after_a_step(slip_law, 3e-6, 2e-5, SLIP), rtol=1e-12
    )


@pytest.mark.parametrize(("b_2", "D_c_2"), [(-0.006, 8e-5), (0.004, 1e-4), (0.004, 1e-6)])
def test_critical_stiffness_of_two_states(b_2: float, D_c_2: float) -> None:
    """The linearised quasi-static slider, per slip, has a pair of imaginary eigenvalues at the critical stiffness."""
    law = TWO.substituted({"b_2": b_2, "D_c_2": D_c_2})
    k = float(law.lengths(1.0, 1e-6).critical_stiffness)
    b, lengths = np.array([law.b, b_2]), np.array([law.D_c, D_c_2])
    for factor, sign in ((1.0, 0), (1.01, -1), (0.99, 1)):
        # ln V = (tau - psi_1 - psi_2) / a; dtau/ds = -k ln V, dpsi_i/ds = -(psi_i + b_i ln V) / D_i.
        log_rate = np.array([1.0, -1.0, -1.0]) / law.a
        rows = [-factor * k * log_rate]
        for i in range(2):
            rows.append(-(np.eye(3)[i + 1] + b[i] * log_rate) / lengths[i])
        rate = np.linalg.eigvals(np.array(rows)).real.max() * law.D_c
        assert abs(rate) < 1e-9 if sign == 0 else np.sign(rate) == sign


def test_step_of_nagata() -> None:
    """A step by 10 changes friction by a / (1 + c) of its logarithm at once, and the age by exp(-c a / ((1 + c) b)).

    Then the age grows as with the ageing law of (1 + c) D_c: 0.017 ln 10, and in the end (a - b) ln 10.
    """
    decade = np.log(10)
    jump = np.exp(-2 / 3 * 0.051 / 0.0565 * decade)
    x = SLIP / (3 * 1e-5)
    age = 0.1 + (jump - 0.1) * np.exp(-x)  # over the steady age at 1 um/s
    expected = 0.6 + 0.051 * decade + 0.0565 * np.log(age)
    assert expected[0] == pytest.approx(0.6 + 0.017 * decade, rel=1e-12)
    np.testing.assert_allclose(after_a_step(NAGATA, 1e-6, 1e-5, SLIP), expected, rtol=1e-10)
    assert expected[-1] == pytest.approx(0.6 - 0.0055 * decade, rel=1e-12)
    lengths = NAGATA.lengths(1.0, 1e-6)
    assert lengths.critical_stiffness == pytest.approx(0.0055 / 3e-5, rel=1e-12)


def test_nagata_without_weakening_is_the_ageing_law() -> None:
    ageing = RateAndStateAgeing(a=0.051, b=0.0565, **COMMON)
    for before, after in ((1e-6, 1e-4), (1e-3, 1e-8)):
        without = after_a_step(NAGATA.substituted({"c": 0.0}), before, after, SLIP)
        np.testing.assert_allclose(without, after_a_step(ageing, before, after, SLIP), rtol=1e-11)


def test_nagata_under_a_stress_that_changes() -> None:
    """theta from 1 - V theta/D_c - c (theta/b) dmu/dt under a known stress, V from mu = f_0 + a ln V/V_0 + b ln theta.

    The law itself knows no stress rate. Its steps of 1/4000 of a period are of second order.
    """
    law, period, amplitude = NAGATA, 8.0, 0.02

    def coefficient(t: float) -> float:
        return float(0.6 + amplitude * np.sin(2 * np.pi * t / period))

    def rate(t: float) -> float:
        return float(amplitude * 2 * np.pi / period * np.cos(2 * np.pi * t / period))

    def slip_rate(t: float, log_age: float) -> float:
        return float(law.V_0 * np.exp((coefficient(t) - law.f_0 - law.b * log_age) / law.a))

    def age_rate(t: float, y: np.ndarray) -> list[float]:
        theta = law.D_c / law.V_0 * np.exp(y[0])
        return [(1 - slip_rate(t, y[0]) * theta / law.D_c) / theta - law.c / law.b * rate(t)]

    solution = solve_ivp(age_rate, (0, period), [0.0], rtol=1e-11, atol=1e-12, dense_output=True)
    count = 4000
    state, dt = {"psi": 0.6 * ONE}, period / count
    for i in range(count):
        now, middle = coefficient(i * dt), coefficient((i + 0.5) * dt)
        half = law.advance(state, law.slip_rate(now * ONE, ONE, state), ONE, dt / 2)
        state = law.advance(state, law.slip_rate(middle * ONE, ONE, half), ONE, dt)
        if (i + 1) % 500 == 0:
            t = (i + 1) * dt
            v = law.slip_rate(coefficient(t) * ONE, ONE, state)[0]
            assert v == pytest.approx(slip_rate(t, solution.sol(t)[0]), rel=1e-5)
            assert law.log_age(state["psi"], v)[0] == pytest.approx(solution.sol(t)[0], abs=1e-6)


@pytest.mark.parametrize("law", [PRZ, TWO, NAGATA], ids=lambda law: law.kind())
def test_stress_slip_rate_and_state_agree(law: FrictionLaw) -> None:
    state = law.initial_state(2e6 * ONE, 1.3e6 * ONE, 3e-8 * ONE)
    assert law.strength(3e-8 * ONE, 2e6 * ONE, state)[0] == pytest.approx(1.3e6, rel=1e-12)
    assert law.carried_slip_rate(1.3e6 * ONE, 2e6 * ONE, state)[0] == pytest.approx(3e-8, rel=1e-9)
    assert law.steady_strength(1e-6 * ONE, 1e6 * ONE)[0] == pytest.approx(0.6e6, rel=1e-12)
