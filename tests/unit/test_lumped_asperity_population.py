"""Population of asperities: relaxation, load, ages, steady friction by quadrature, a hold against an integrator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.messages import facts
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ruptfx import RuptfxError
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.lumped.asperity_population import AsperityPopulation
from ruptfx.lumped.asperity_population.law_fit import Trace
from ruptfx.lumped.asperity_population.population import Asperity, Population

ASPERITY = Asperity(5e4, 0.5e-3, 1e-18, 1e-6, 0.4e-6, 1.0)


@pytest.mark.parametrize("force", [1e-5, 2e-3, 20e-3])
def test_relaxation_at_constant_separation(force: float) -> None:
    """df/dt = -k r sinh(f / f_0), by an integrator; u = exp(-f / f_0) keeps its digits where tanh is 1."""
    k, f_0, r = ASPERITY.stiffness, ASPERITY.activation_force, ASPERITY.creep_rate
    time = 1e3
    exact = solve_ivp(
        lambda t, f: -k * r * np.sinh(f / f_0), (0, time), [force], method="LSODA", rtol=1e-9, atol=1e-16
    ).y[0, -1]
    assert ASPERITY.relaxed(np.array(force), time) == pytest.approx(exact, rel=1e-6)


def test_the_shear_strength_is_that_at_the_first_speed() -> None:
    """Friction is strength times real area over load there, 120 MPa pi R h / W; an e-fold of the slip rate adds 2 %."""
    model = AsperityPopulation(speeds=[3e-6, 1e-5], normal_force=15.0)
    expected = 120e6 * np.pi * 10e-6 * 2e-3 / 15.0
    found = model.coefficient(2e-3, 3e-6 * np.exp([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(found, expected * np.array([1.0, 1.02, 1.04]), rtol=1e-12)


def test_forces_carry_the_load_and_no_asperity_pulls() -> None:
    population = Population(ASPERITY, 500, 1.2, seed=3)
    for _ in range(50):
        population.advance(1e-6, 0.02)
        assert ASPERITY.stiffness * population.pressed().sum() == pytest.approx(1.2, rel=1e-12)
        assert population.pressed().min() >= 0


@pytest.mark.parametrize("shape", [1.0, 4.0])
def test_lengths_have_their_mean_and_shape(shape: float) -> None:
    """A gamma distribution: its variance is the square of the mean over the shape."""
    lengths = Population(replace(ASPERITY, length_shape=shape), 20_000, 1.2, seed=3).left
    assert lengths.mean() == pytest.approx(ASPERITY.mean_length, rel=0.03)
    assert lengths.var() == pytest.approx(ASPERITY.mean_length**2 / shape, rel=0.1)


def test_hold_against_an_integrator() -> None:
    """dp_i/dt = r sinh(k (z_i - p_i - d) / f_0), d from the load at every instant, for thirty asperities."""
    population = Population(ASPERITY, 30, 0.1, seed=1)
    z, k = population.height.copy(), ASPERITY.stiffness

    def separation(p: np.ndarray) -> float:
        return brentq(lambda d: k * np.maximum(z - p - d, 0).sum() - 0.1, -1e-5, z.max(), xtol=1e-18)

    def rates(_: float, scaled: np.ndarray) -> np.ndarray:
        p = scaled * 1e-6
        force = k * np.maximum(z - p - separation(p), 0)
        return ASPERITY.creep_rate * np.sinh(force / ASPERITY.activation_force) / 1e-6

    exact = solve_ivp(rates, (0, 1.0), np.zeros(30), method="LSODA", rtol=1e-7, atol=1e-10)
    errors = []
    for growth in (0.02, 0.01):
        hold, time, dt = Population(ASPERITY, 30, 0.1, seed=1), 0.0, 1e-12
        while time < 1.0:
            dt = min(dt, 1.0 - time)
            hold.advance(0.0, dt)
            time += dt
            dt = growth * time + 1e-12
        errors.append(abs(hold.separation / separation(exact.y[:, -1] * 1e-6) - 1))
    assert errors[0] < 0.01 and errors[1] < 0.6 * errors[0]


def test_contacts_are_as_old_as_their_slip() -> None:
    """Exponential lengths have no memory: the mean age in steady sliding is mean length / slip rate."""
    population = Population(ASPERITY, 3000, 7.5, seed=2)
    ages = []
    for step in range(400):
        population.advance(1e-6, 0.02)
        ages += [population.mean_age()] if step > 200 else []
    assert np.mean(ages) == pytest.approx(0.4, rel=0.05)


@pytest.mark.parametrize("shape", [1.0, 10.0])
def test_steady_friction_is_that_of_the_infinite_population(shape: float) -> None:
    model = AsperityPopulation(asperities=2000, normal_force=5.0, length_shape=shape)
    population, found = Population(model.asperity, 2000, 5.0, seed=1), []
    for step in range(600):
        population.advance(1e-5, 0.04 * 0.4e-6 / 1e-5)
        found += [float(model.coefficient(population.area_height(), 1e-5))] if step > 400 else []
    assert np.mean(found) == pytest.approx(model.steady(1e-5), rel=3e-3)
    # No asperity weakens, the population does: a = strengthening times friction, and b is more.
    assert model.steady(1e-5) < model.steady(1e-6)


def test_fit_finds_the_law_that_made_the_trace() -> None:
    law = RateAndStateAgeing(a=0.006, b=0.011, D_c=0.5e-6, f_0=0.33, V_0=1e-6)
    rate = np.repeat([1e-6, 1e-5, 1e-6], 200)
    trace = Trace(0.02e-6 / rate, rate, np.zeros(600))
    trace = Trace(trace.duration, rate, trace.predicted(law)[0])
    found, misfit = trace.fit(law.model_copy(update={"a": 0.01, "b": 0.007, "D_c": 1e-6, "f_0": 0.3}))
    assert misfit < 1e-6
    for name in ("a", "b", "D_c", "f_0"):
        assert float(getattr(found, name)) == pytest.approx(float(getattr(law, name)), rel=1e-3)


def test_too_few_asperities_are_refused() -> None:
    with pytest.raises(RuptfxError, match=facts(r"10 asperities .*load of 10 N")):
        Population(ASPERITY, 10, 10.0, seed=0)
