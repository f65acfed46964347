"""Numbers of single laws: published initial values, exact evolution, wrappers at their limits."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.messages import facts

from ruptfx.input.profiles.cone import Cone
from ruptfx.input.schema import CaseError
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.cohesion import Cohesion
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.laws.friction.exponential_slip_weakening import ExponentialSlipWeakening
from ruptfx.laws.friction.forced_weakening import ForcedWeakening
from ruptfx.laws.friction.linear_slip_weakening import LinearSlipWeakening
from ruptfx.laws.friction.memory_constant_time import MemoryConstantTime
from ruptfx.laws.friction.prakash_clifton import PrakashClifton
from ruptfx.laws.friction.pressurised import Pressurised
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.laws.friction.rate_and_state_flash_heating import RateAndStateFlashHeating
from ruptfx.laws.friction.roughness_drag import RoughnessDrag
from ruptfx.laws.friction.time_weakening import TimeWeakening
from ruptfx.laws.friction.velocity_weakening import VelocityWeakening
from ruptfx.laws.nucleation.forced_rupture import ForcedRupture
from ruptfx.laws.nucleation.friction_drop import FrictionDrop

ONE = np.ones(1)
FLASH = RateAndStateFlashHeating(a=0.01, b=0.014, D_c=0.4, f_0=0.6, V_0=1e-6, f_w=0.2, V_w=0.1, V_initial=1e-16)
AGEING = RateAndStateAgeing(a=0.008, b=0.012, D_c=0.02, f_0=0.6, V_0=1e-6, V_initial=1e-12)


def test_initial_values_of_the_benchmarks() -> None:
    # TPV101: sigma 120 MPa, tau 75 MPa; TPV103: sigma 120 MPa, tau 40 MPa.
    theta = AGEING.initial_state(120e6 * ONE, 75e6 * ONE, 0 * ONE)["theta"][0]
    assert theta == pytest.approx(1.606238999213454e9, rel=1e-14)
    psi = FLASH.initial_state(120e6 * ONE, 40e6 * ONE, 0 * ONE)["psi"][0]
    assert psi == pytest.approx(0.563591842632738, rel=1e-14)


@pytest.mark.parametrize("law, V, tau", [(AGEING, 1e-12, 75e6), (FLASH, 1e-16, 40e6)])
def test_any_two_give_the_third(law: RateAndStateAgeing, V: float, tau: float) -> None:
    """Stress and slip rate give the state; stress and state the slip rate; slip rate and state the stress."""
    sigma = 120e6 * ONE
    state = law.initial_state(sigma, tau * ONE, 0 * ONE)
    # d ln V = d tau / (a sigma): 1e-14 of tau is 1e-12 of V.
    assert law.carried_slip_rate(tau * ONE, sigma, state)[0] == pytest.approx(V, rel=1e-11)
    assert law.strength(V * ONE, sigma, state)[0] == pytest.approx(tau, rel=1e-13)


def test_one_omega_for_several_static_coefficients() -> None:
    """At 0.5 m/s and omega 0.1: V_w = sqrt(0.1 / (mu_s - 0.7)) is infinite, 0.8165 and 0.57735 m/s.

    0.7 + 0.15 exp(-0.612372) = 0.781309 and 0.7 + 0.3 exp(-0.866025) = 0.826187.
    """
    law = VelocityWeakening(mu_s=0.85, mu_d=0.7, omega=0.1).substituted({"mu_s": np.array([0.7, 0.85, 1.0])})
    np.testing.assert_allclose(law.strength(0.5, np.ones(3), {}), [0.7, 0.781309, 0.826187], atol=1e-6)
    np.testing.assert_array_equal(law.strength(0.0, np.ones(3), {}), [0.7, 0.85, 1.0])


@pytest.mark.parametrize(("keys", "message"), [
    ({}, "neither V_w nor omega"), ({"V_w": 0.1, "omega": 0.1}, "both V_w and omega"),
    ({"mu_s": 0.65, "omega": 0.1}, "VelocityWeakening.omega: mu_s - mu_d is -0.05 .* 0 or more.* V_w"),
])  # fmt: skip
def test_omega_replaces_the_slip_rate(keys: dict[str, float], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        VelocityWeakening(**{"mu_s": 0.8, "mu_d": 0.7, **keys}).at(np.zeros(1))


def test_roughness_drag_grows_with_slip() -> None:
    """After 3 m of slip in steps: 0.2 of the wrapped law, and 3 m times 0.01 / m."""
    law = RoughnessDrag(law=LinearSlipWeakening(mu_s=0.6, mu_d=0.2, D_c=0.5), drag=0.01)
    state = law.initial_state(1e7 * ONE, 0 * ONE, 0 * ONE)
    for _ in range(30):
        state = law.advance(state, 2.0 * ONE, 1e7 * ONE, 0.05)
    assert law.strength(2.0 * ONE, 1e7 * ONE, state)[0] == pytest.approx(2.3e6, rel=1e-12)


def test_flash_heating_steady_coefficient() -> None:
    # V = 1 m/s: f_LV = 0.6 - 0.004 ln(1e6) = 0.544738; (1 + 10^8)^(1/8) = 10 (1 + 1e-8)^(1/8) = 10.0000000125,
    # f_ss = 0.2 + 0.344738 / 10.0000000125.
    f_lv = 0.6 - 0.004 * np.log(1e6)
    assert FLASH.steady_coefficient(1.0) == pytest.approx(0.2 + (f_lv - 0.2) / (1 + 1e8) ** 0.125, rel=1e-13)
    state = {"psi": FLASH.steady_psi(1.0 * ONE)}
    assert FLASH.strength(ONE, 1e6 * ONE, state)[0] == pytest.approx(1e6 * FLASH.steady_coefficient(1.0), rel=1e-13)


def test_velocity_step_is_exact() -> None:
    """After a step from V_1 to V_2 psi relaxes exponentially in slip, in one step or in many."""
    state = {"psi": FLASH.steady_psi(1e-3 * ONE)}
    many = state
    for _ in range(100):
        many = FLASH.advance(many, 1e-2 * ONE, 1e6 * ONE, 0.4)
    end = FLASH.steady_psi(1e-2)
    expected = end + (state["psi"] - end) * np.exp(-1.0)  # slip 0.4 m = D_c
    assert many["psi"] == pytest.approx(expected, rel=1e-13)
    assert FLASH.advance(state, 1e-2 * ONE, 1e6 * ONE, 40.0)["psi"] == pytest.approx(expected, rel=1e-13)


def test_exponential_slip_weakening() -> None:
    law = ExponentialSlipWeakening(mu_s=0.6, mu_d=0.2, D_c=1e-3)
    slipped = law.advance(law.initial_state(ONE, 0 * ONE, 0 * ONE), 2.0 * ONE, ONE, 0.5e-3)
    assert law.strength(ONE, ONE, slipped)[0] == pytest.approx(0.2 + 0.4 * np.exp(-1), rel=1e-14)


def test_prescribed_rupture_runs_at_its_speed() -> None:
    position = np.array([0.0, 1.0, 2.0, 3.0])
    law = TimeWeakening(mu_s=0.6, mu_d=0.2, t_w=0.5, arrival=Cone(slope=1.0, center=0.0)).at(position)
    state = law.advance(law.initial_state(np.ones(4), np.zeros(4), np.zeros(4)), np.zeros(4), np.ones(4), 2.25)
    # Behind the front by 2.25, 1.25, 0.25 and -0.75 s: full, full, half and no weakening.
    np.testing.assert_allclose(law.strength(0.0, np.ones(4), state), [0.2, 0.2, 0.4, 0.6], rtol=1e-14)


def test_forced_weakening_never_strengthens() -> None:
    inner = ExponentialSlipWeakening(mu_s=0.6, mu_d=0.1, D_c=1e-3)
    law = ForcedWeakening(law=inner, mu_d=0.3, arrival=1.0)
    fresh = law.initial_state(ONE, 0 * ONE, 0 * ONE)
    assert law.strength(ONE, ONE, law.advance(fresh, 0 * ONE, ONE, 0.5))[0] == 0.6
    assert law.strength(ONE, ONE, law.advance(fresh, 0 * ONE, ONE, 1.5))[0] == 0.3
    assert law.strength(ONE, ONE, law.advance(fresh, ONE, ONE, 1.5))[0] == pytest.approx(0.1, rel=1e-12)


def at(law: FrictionLaw, time: float, slip: float = 0.0) -> float:
    """Strength under 1 Pa after a slip, within a time."""
    state = law.advance(law.initial_state(ONE, 0 * ONE, 0 * ONE), slip / time * ONE, ONE, time)
    return float(law.strength(ONE, ONE, state)[0])


def test_the_weaker_of_slip_and_time_weakening_rules() -> None:
    inner = LinearSlipWeakening(mu_s=0.6, mu_d=0.2, D_c=1e-3)
    law = ForcedWeakening(law=inner, mu_d=0.2, arrival=1.0, t_w=0.5, end=2.0)
    # mu_s - (mu_s - mu_d) max(w, slip / D_c) = 0.6 - 0.4 max(0.5, 0.25) and 0.6 - 0.4 max(0.5, 0.75).
    assert at(law, 1.25, 0.25e-3) == pytest.approx(0.4, rel=1e-14)
    assert at(law, 1.25, 0.75e-3) == pytest.approx(0.3, rel=1e-14)
    # All forced; from the end on the held law alone: 0.6 - 0.4 / 4.
    assert at(law, 1.75, 0.25e-3) == pytest.approx(0.2, rel=1e-14)
    assert at(law, 2.0, 0.25e-3) == at(law, 0.9, 0.25e-3) == pytest.approx(0.5, rel=1e-14)


def test_forced_weakening_of_a_law_that_creeps_begins_at_its_initial_traction() -> None:
    law = RateAndStateAgeing(a=0.01, b=0.015, D_c=1e-2, f_0=0.6, V_0=1e-6)
    forced = ForcedWeakening(law=law, mu_d=0.1, arrival=1.0, t_w=0.5)
    state = forced.initial_state(ONE, 0.5 * ONE, 0 * ONE)
    assert state["coefficient_at_start"][0] == 0.5
    # Half-way from 0.5 to 0.1; where the interface is open nothing is carried.
    assert forced.strength(ONE, ONE, state | {"clock": 1.25 * ONE})[0] == pytest.approx(0.3, rel=1e-14)
    assert forced.strength(ONE, 0 * ONE, state | {"clock": 1.25 * ONE})[0] == 0


@pytest.mark.parametrize("pascal", [1.0, 1e-6, 1e6])
def test_an_open_point_falls_from_the_slope_of_its_strength(pascal: float) -> None:
    """0.18 beside a cohesion of 3 MPa or none, whatever the unit of stress; mu_d under a law that only creeps."""
    bonded = Cohesion(c=3e6 * pascal, law=LinearSlipWeakening(mu_s=0.18, mu_d=0.12, D_c=0.3))
    creeps = RateAndStateAgeing(a=0.01, b=0.015, D_c=1e-2, f_0=0.6, V_0=1e-6)
    for law, expected in ((bonded, 0.18), (bonded.law, 0.18), (creeps, 0.1)):
        state = ForcedWeakening(law=law, mu_d=0.1, arrival=1.0).initial_state(0 * ONE, 0 * ONE, 0 * ONE)
        assert state["coefficient_at_start"][0] == pytest.approx(expected, rel=1e-14)
    # 3 MPa / 30 MPa + 0.18 under pressure.
    closed = ForcedWeakening(law=bonded, mu_d=0.1, arrival=1.0).initial_state(30e6 * pascal * ONE, 0 * ONE, 0 * ONE)
    assert closed["coefficient_at_start"][0] == pytest.approx(0.28, rel=1e-14)


def test_fluid_takes_its_pressure_from_the_normal_stress() -> None:
    """0.5 (10 - 4 w): w rises to 1 from 1 to 1.5 s and falls from 3 to 3.5 s; never below zero."""
    law = Pressurised(law=Coulomb(mu_d=0.5), pressure=4.0, begin=1.0, end=3.0, rise=0.5)
    for clock, expected in ((0.0, 5.0), (1.25, 4.0), (2.0, 3.0), (3.25, 4.0), (4.0, 5.0)):
        state = {"clock": np.array(clock)}
        assert float(law.strength(np.array(1.0), np.array(10.0), state)) == pytest.approx(expected)
    assert float(law.strength(np.array(1.0), np.array(3.0), {"clock": np.array(2.0)})) == 0.0
    assert float(law.advance({"clock": np.array(2.0)}, np.array(1.0), np.array(3.0), np.array(0.5))["clock"]) == 2.5


def test_a_forced_rupture_may_be_under_way_at_the_start() -> None:
    position = np.array([0.0, 400.0, 600.0, 1200.0])
    law = LinearSlipWeakening(mu_s=0.6, mu_d=0.2, D_c=1e-3)
    nucleation = ForcedRupture(center=0.0, radius=1000.0, speed=1000.0, mu_d=0.2, t_w=0.2, start=-0.5, end=3.0)
    forced = nucleation.weaken(law, position)
    one = np.ones(4)
    state = forced.initial_state(one, 0 * one, 0 * one)
    # The front left 0.5 s ago and is at 500 m: w = 1 at the center, (0.5 - 0.4) / 0.2 = 0.5 at 400 m, none beyond.
    np.testing.assert_allclose(forced.strength(0 * one, one, state), [0.2, 0.4, 0.6, 0.6], rtol=1e-14)
    # 0.2 s later it is 100 m beyond 600 m; 1200 m is outside.
    later = forced.advance(state, 0 * one, one, 0.2)
    np.testing.assert_allclose(forced.strength(0 * one, one, later), [0.2, 0.2, 0.4, 0.6], rtol=1e-14)
    np.testing.assert_allclose(forced.strength(0 * one, one, forced.advance(state, 0 * one, one, 3.0)), 0.6)
    drop = FrictionDrop(center=0.0, half_width=500.0, mu_d=0.1, time=-0.1, t_w=0.2, end=3.0)
    both = drop.weaken(forced, position)
    # The drop is half-way from 0.6, the coefficient without the rupture, to 0.1.
    start = both.initial_state(one, 0 * one, 0 * one)
    np.testing.assert_allclose(both.strength(0 * one, one, start), [0.2, 0.35, 0.6, 0.6], rtol=1e-14)


def test_memories_of_the_normal_stress() -> None:
    by_slip = PrakashClifton(law=Coulomb(mu_d=0.5), L_p=1e-3, V_star=0.25)
    by_time = MemoryConstantTime(law=Coulomb(mu_d=0.5), t_c=1e-3)
    # Normal stress from 1 to 3, during one memory: (0.75 + 0.25) m/s for 1 ms, and 1 ms.
    expected = 0.5 * (3 - 2 * np.exp(-1))
    for law, rate in ((by_slip, 0.75), (by_time, 0.0)):
        state = law.initial_state(ONE, 0 * ONE, 0 * ONE)
        state = law.advance(state, rate * ONE, 3 * ONE, 1e-3)
        assert law.strength(rate * ONE, 3 * ONE, state)[0] == pytest.approx(expected, rel=1e-13)
        assert law.strength(rate * ONE, 0 * ONE, state)[0] == 0.0


def test_cohesion_holds_and_breaks() -> None:
    law = Cohesion(law=Coulomb(mu_d=0.5), c=2.0, D_cohesion=1e-2)
    state = law.initial_state(ONE, 0 * ONE, 0 * ONE)
    assert law.strength(0 * ONE, ONE, state)[0] == 2.5
    assert law.strength(0 * ONE, 0 * ONE, state)[0] == 0.0
    assert law.strength(ONE, ONE, law.advance(state, ONE, ONE, 0.5e-2))[0] == pytest.approx(1.5, rel=1e-14)
    assert law.strength(ONE, ONE, law.advance(state, ONE, ONE, 2e-2))[0] == 0.5
