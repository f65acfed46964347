"""The scalar solve that every law and contact method share."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from helpers.small_cases import friction_laws

from ruptfx.app.check_law.examples import friction
from ruptfx.interfaces.faults import point_step
from ruptfx.interfaces.faults.projection import ProjectionError, Resistance, StrengthAtState, TracedLaw, project, solved
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.laws.friction.prakash_clifton_two import PrakashCliftonTwo
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.laws.friction.rate_and_state_power_law import RateAndStatePowerLaw
from ruptfx.laws.friction.velocity_weakening import VelocityWeakening

N = 2000
LAWS = friction_laws()
every_law = pytest.mark.parametrize("kind, wrapped", LAWS, ids=["-".join(filter(None, law)) for law in LAWS])


def one(law: FrictionLaw, trial_normal: float, trial_shear: Any, Z: float = 1e6, **options: Any) -> Any:
    """Project a single point."""
    shear = np.atleast_2d(np.asarray(trial_shear, float))
    traced = TracedLaw(law, at_end=True)
    return project(traced, {}, np.array([trial_normal], float), shear, np.array([Z]), 1e-8, **options)


@every_law
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("extreme", [False, True])
def test_the_root_is_a_root(kind: str, wrapped: str | None, seed: int, extreme: bool) -> None:
    """|T| = trial - Z V and |T| = strength(V) where it slips, |T| <= strength(0) where it does not."""
    law = friction(kind, wrapped, seed)
    random = np.random.default_rng([seed, 5])
    wide = 3.0 if extreme else 1.0
    sigma = 10 ** random.uniform(6 - wide, 6 + wide, N)
    trial = random.normal(size=(N, 1)) * 10 ** random.uniform(6 - wide, 6 + wide, (N, 1))
    Z = 10 ** random.uniform(6 - wide, 6 + 3 * wide, N)
    dt = 1e-8
    state = law.initial_state(sigma, 0.3 * sigma, np.full(N, 0.1))
    state = {name: value + np.zeros(N) for name, value in state.items()}
    traced = TracedLaw(law, at_end=True)
    # Without a root the slope Z + dstrength/dV cannot stay positive; that is an error, and another test's.
    done = project(traced, state, sigma, trial, Z, dt, guess=random.uniform(0, 10, N))
    rate, carried = np.abs(done.mean_slip_rate[:, 0]), np.abs(done.shear_traction[:, 0])
    found = traced(rate, sigma, state, dt)
    strength, slope = found.strength, found.slope
    size = np.abs(trial[:, 0])
    # The residual is below 1e-13 of the trial, or the bracket is as narrow as doubles go (1e-15 V).
    residual = np.abs(size - Z * rate - strength)
    slips = rate > 0
    assert np.all(residual[slips] <= 1e-12 * size[slips] + 1e-14 * (np.abs(slope) + Z)[slips] * rate[slips])
    assert np.all(size[~slips] <= strength[~slips] * (1 + 1e-12))
    np.testing.assert_allclose(carried, size - Z * rate, rtol=0, atol=1e-12 * size.max())
    assert np.all(done.slip_rate * trial >= 0)
    # Without extrapolation the law sees V itself, and the returned state is the one at the traction.
    np.testing.assert_array_equal(done.slip_rate, done.mean_slip_rate)
    for name in law.all_state_fields():
        np.testing.assert_allclose(done.state[name], found.state[name], rtol=1e-12)


def test_steps_do_not_go_round_in_circles() -> None:
    """Met in a run: steps in V led from 2.7 to 68 m/s and steps in log V back, for ever; the root is at 12.8 m/s."""
    wrapped = RateAndStatePowerLaw(
        mu_s=0.6, mu_d=0.367353, V_0=39.9676, V_1=27.682, p=1.2, m=3.42914, L_0=2.94185e-6, A_0=2.02208,
        theta_0_initial=5.596e-5,
    )  # fmt: skip
    law = PrakashCliftonTwo(law=wrapped, L_1=5.04426e-6, L_2=2.4753e-5, C=0.534763, D=0.358336)
    state = {"theta_0": np.array([3.14511e-8]), "theta_1": np.array([9.15887e6]), "theta_2": np.array([6.15029e6])}
    normal, trial, Z = np.array([1.71174e7]), np.array([[5648850.59148074]]), np.array([9752.66])
    done = project(TracedLaw(law, at_end=True), state, normal, trial, Z, 2.4e-8,
                   guess=np.array([69.4224]))  # fmt: skip
    assert 12 < done.slip_rate[0, 0] < 14


def test_a_guess_changes_nothing_but_the_number_of_steps() -> None:
    law = friction("rate_and_state_power_law")
    random = np.random.default_rng(3)
    sigma, trial, Z = 10 ** random.uniform(5, 7, N), 10 ** random.uniform(5, 7, (N, 1)), np.full(N, 1e6)
    state = law.initial_state(sigma, 0.3 * sigma, np.zeros(N))
    without = project(TracedLaw(law, at_end=True), state, sigma, trial, Z, 1e-8)
    for guess in (np.full(N, 1e-30), np.full(N, 1e30), np.full(N, np.nan), without.slip_rate[:, 0]):
        again = project(TracedLaw(law, at_end=True), state, sigma, trial, Z, 1e-8, guess=guess)
        np.testing.assert_allclose(again.slip_rate, without.slip_rate, rtol=1e-9, atol=1e-12)


def test_rests_at_slip_rates_next_to_nothing() -> None:
    """Where rates have hundreds of decades the bracket ends at rest, with the traction of the trial."""
    law = RateAndStateAgeing(a=0.001, b=0.015, D_c=1e-6, f_0=0.6, V_0=1e-4)
    traced, state = TracedLaw(law, at_end=True), {"theta": np.array([0.1])}
    done = project(traced, state, np.array([1e10]), np.array([[3.5e3]]), np.array([5e11]), 5e-5)
    assert not done.mean_slip_rate.any() and done.shear_traction[0, 0] == 3.5e3


def test_sticks_below_strength() -> None:
    # Strength 0.5 x 4 MPa = 2 MPa.
    done = one(Coulomb(mu_d=0.5), 4e6, 1.99e6)
    assert done.slip_rate[0, 0] == 0 and done.shear_traction[0, 0] == 1.99e6 and done.normal_stress[0] == 4e6


def test_slips_above_strength() -> None:
    # V = (|trial| - mu sigma) / Z = (3 - 2) MPa / 1e6 Pa s/m = 1 m/s, in the direction of the trial.
    for sign in (1, -1):
        done = one(Coulomb(mu_d=0.5), 4e6, sign * 3e6)
        assert done.slip_rate[0, 0] == pytest.approx(sign * 1.0, rel=1e-12)
        assert done.shear_traction[0, 0] == pytest.approx(sign * 2e6, rel=1e-12)


def test_two_tangents_share_one_magnitude() -> None:
    # |trial| = 5 MPa, strength 2 MPa: V = 3 m/s along (3, -4) / 5.
    done = one(Coulomb(mu_d=0.5), 4e6, [[3e6, -4e6]])
    np.testing.assert_allclose(done.slip_rate, [[1.8, -2.4]], rtol=1e-12)
    np.testing.assert_allclose(done.shear_traction, [[1.2e6, -1.6e6]], rtol=1e-12)


@pytest.mark.parametrize("trial_normal", [0.0, -1e-300, -5e6])
def test_open_carries_nothing(trial_normal: float) -> None:
    done = one(Coulomb(mu_d=0.5), trial_normal, 3e6)
    assert done.normal_stress[0] == 0 and done.shear_traction[0, 0] == 0
    assert done.slip_rate[0, 0] == pytest.approx(3.0, rel=1e-15)


def test_no_shear_no_slip() -> None:
    for normal in (4e6, -4e6):
        done = one(Coulomb(mu_d=0.0), normal, 0.0)
        assert done.slip_rate[0, 0] == 0 and done.shear_traction[0, 0] == 0


@pytest.mark.parametrize("Z", [1e-12, 1e-3, 1e18])
def test_extreme_impedance(Z: float) -> None:
    done = one(Coulomb(mu_d=0.5), 4e6, 3e6, Z)
    # Soft: V = 1 MPa / Z whatever its size; the traction is the strength in any case, to the rounding of 3 MPa.
    assert done.slip_rate[0, 0] == pytest.approx(1e6 / Z, rel=1e-12)
    assert done.shear_traction[0, 0] == pytest.approx(2e6, rel=1e-12)


def test_rate_strengthening_limit_of_small_impedance() -> None:
    """Z -> 0: the slip rate is the law's inverse at the trial traction."""
    law = friction("rate_and_state_ageing")
    state = {"theta": np.array([1e-3])}
    tiny = 1e-30
    done = project(TracedLaw(law, at_end=True), state, np.array([1e6]), np.array([[0.4e6]]), np.array([1e-9]), tiny)
    # tau = a sigma asinh(V / (2 V_0) exp((f_0 + b ln(V_0 theta / D_c)) / a)), solved for V.
    exponent = (law.f_0 + law.b * np.log(law.V_0 * 1e-3 / law.D_c)) / law.a
    expected = 2 * law.V_0 * np.sinh(0.4 / law.a) * np.exp(-exponent)
    assert done.slip_rate[0, 0] == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("trial_normal, trial_shear", [(np.nan, 1e6), (1e6, np.nan), (1e6, np.inf)])
def test_a_trial_that_is_no_number(trial_normal: float, trial_shear: float) -> None:
    message = r"coulomb: the trial traction is not a number .*interface point 0 at 3 us"
    with np.errstate(invalid="ignore"), pytest.raises(ProjectionError, match=facts(message)):
        one(Coulomb(mu_d=0.5), trial_normal, trial_shear, where="at 3 us")


def test_failure_names_law_point_and_state() -> None:
    law = friction("rate_and_state_ageing")
    state = {"theta": np.array([1.0, np.nan])}
    message = r"rate_and_state_ageing: no slip rate balances .*interface point 1 .*traction = 1e\+06.*theta = nan"
    with pytest.raises(ProjectionError, match=facts(message)):
        project(TracedLaw(law, at_end=True), state, np.full(2, 1e6), np.full((2, 1), 1e6), np.full(2, 1e6), 1e-8)


def test_ill_posed_steps_still_end() -> None:
    """Strength that falls faster than Z V: the largest root or the smallest, but a root, and never a hang."""
    law = VelocityWeakening(mu_s=0.8, mu_d=0.1, V_w=1e-3)
    for trial in np.linspace(0.05, 2, 40) * 1e6:
        done = one(law, 1e6, trial, Z=1e4)
        rate = done.slip_rate[0, 0]
        if rate > 0:
            strength = (0.1 + 0.7 * np.exp(-rate / 1e-3)) * 1e6
            assert trial - 1e4 * rate == pytest.approx(strength, rel=1e-10)
        else:
            assert trial <= 0.8e6


def test_slip_rates_of_any_strength() -> None:
    """Zero, logarithmic with a root 65 decades below its guess, zero with a guess far below, too large, undefined."""
    size = np.array([5.0, 1.0, 3.6e6, 1.0, 1.0])
    trial = point_step.shifted_trial([size], [np.array([1.0, 1e-3, 5e5, 1.0, 1.0])], [np.zeros(5)], 1.0)

    def resistance(v: np.ndarray) -> Resistance:
        with np.errstate(divide="ignore"):
            strength = np.array([0 * v[0], 1 + 1e-3 * np.log(v[1] * np.exp(150.0)), 0 * v[2], 2 + v[3], np.nan * v[4]])
            slope = np.array([0.0, 1e-3 / v[1], 0.0, 1.0, np.nan])
        return np.maximum(strength, 0.0), slope, v

    closed = np.ones(5, dtype=bool)
    root = solved(trial, size, size, closed, resistance, np.array([3.0, 1.0, 1e-100, 1.0, 1.0]))
    np.testing.assert_allclose(root.rate, [5, np.exp(-150), 7.2, 0, np.nan], rtol=1e-9)


@every_law
def test_strength_at_a_known_state(kind: str, wrapped: str | None) -> None:
    """That of the law itself, and its derivative by central differences of step 1e-5."""
    law, v, sigma = friction(kind, wrapped, 0), 10 ** np.linspace(-9, 1, 20), np.full(20, 2e6)
    state = {name: value + np.zeros(20) for name, value in law.initial_state(sigma, 0.3 * sigma, v).items()}
    strength, slope = StrengthAtState(law)(v, sigma, state)
    np.testing.assert_allclose(strength, law.strength(v, sigma, state) + 0 * v, rtol=1e-13)
    after, earlier = (law.strength(v * (1 + h), sigma, state) for h in (1e-5, -1e-5))
    np.testing.assert_allclose(slope * v, (after - earlier) / 2e-5, rtol=1e-6, atol=1e-8 * sigma[0])
