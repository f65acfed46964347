"""Every law of the folder keeps the contract of a friction law; a new file is tested without an edit here."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from examples import friction, friction_laws, holds
from pydantic import TypeAdapter
from scipy.integrate import simpson
from small_cases import case, two_boxes

from ruptfx import RuptfxError
from ruptfx.friction import COMMON, RESERVED, AnyFriction, FrictionLaw
from ruptfx.friction._lengths import Breakdown, RateDependence
from ruptfx.friction.coulomb import Coulomb
from ruptfx.projection import TracedLaw, project
from ruptfx.schema import CaseError, alternatives

LAWS = friction_laws()
SEEDS = (0, 1, 2)
every_law = pytest.mark.parametrize("kind, held", LAWS, ids=["-".join(filter(None, law)) for law in LAWS])
every_example = pytest.mark.parametrize("seed", SEEDS)

N = 400


def histories(law: FrictionLaw, seed: int, steps: int = 6) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Slip rates, normal stresses and states the law can be in: what a few arbitrary steps lead to."""
    random = np.random.default_rng(seed)
    rate = 10 ** random.uniform(-9, 3, N)
    sigma = 10 ** random.uniform(4, 8.5, N)
    state = law.initial_state(sigma, 0.3 * sigma, rate)
    for _ in range(steps):
        v, s = 10 ** random.uniform(-12, 3, N), 10 ** random.uniform(4, 8.5, N)
        state = law.advance(state, v, s, 10 ** random.uniform(-9, -4, N))
    return rate, sigma, {name: np.broadcast_to(value, N).astype(float) for name, value in state.items()}


@pytest.mark.parametrize("kind", list(alternatives("ruptfx.friction")))
def test_a_law_says_what_it_is(kind: str) -> None:
    cls = alternatives("ruptfx.friction")[kind]
    assert cls.formula and cls.source and cls.summary()
    assert all(unit for unit in cls.state_fields.values())
    assert set(cls.state_fields).isdisjoint(cls.model_fields)


@pytest.mark.parametrize("name", sorted(RESERVED))
def test_a_law_that_would_overwrite_a_field_of_the_fault_is_refused(name: str) -> None:
    fields = {"state_fields": {name: "1"}, "__annotations__": {}, "__module__": "ruptfx.friction.some_law"}
    with pytest.raises(RuptfxError, match=f"some_law: the state variable '{name}' .* another name in state_fields"):
        type(Coulomb)("SomeLaw", (Coulomb,), fields)


@pytest.mark.fem
def test_what_a_fault_and_its_file_call_their_own_is_reserved(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx.model import Model
    from ruptfx.simulation import simulate

    flat = case({"duration": 1e-7})  # Coulomb friction has no state
    with simulate(flat, out=tmp_path / "run", progress=False) as record:
        assert set(record.interface.variables) <= RESERVED
    solid = case({"plane": "solid", "order": 1}).substituted({"mesh": two_boxes()})
    assert set(Model(solid).initial_state().faults["main"]) <= RESERVED


WRAPPERS = [kind for kind, cls in alternatives("ruptfx.friction").items() if holds(cls)]


@pytest.mark.parametrize("outer", WRAPPERS)
@pytest.mark.parametrize("inner", WRAPPERS)
def test_laws_that_hold_each_other_share_no_state(outer: str, inner: str) -> None:
    plain = [kind for kind, held in LAWS if held is None]
    tables = [friction(kind, plain[0]).model_dump(mode="json") for kind in (outer, inner)]
    nested = {**tables[0], "law": tables[1]}
    laws = alternatives("ruptfx.friction")
    shared = laws[outer].state_fields.keys() & laws[inner].state_fields.keys() - COMMON
    # Also where a third law is between them.
    between = next(kind for kind in WRAPPERS if laws[kind].state_fields.keys().isdisjoint(
        laws[outer].state_fields.keys() | laws[inner].state_fields.keys()))
    third = friction(between, plain[0]).model_dump(mode="json")
    for law in (nested, {**tables[0], "law": {**third, "law": tables[1]}}):
        if not shared:
            TypeAdapter(AnyFriction).validate_python(law)
            continue
        with pytest.raises(CaseError) as caught:
            case({"faults.main.friction": law})
        said = f"faults.main.friction: {outer} holds {inner}, and both call a state variable '{min(shared)}'"
        assert str(caught.value).startswith(said)


@every_law
@every_example
def test_common_state_means_the_same_in_every_law(kind: str, held: str | None, seed: int) -> None:
    law = friction(kind, held, seed)
    sigma, rate = np.array([1e6, 0.0, 3e6]), np.ones(3)
    state = law.initial_state(sigma, 0.4 * sigma, 0 * rate)
    later, other = (law.advance(state, v, s, 0.25) for v, s in ((rate, sigma), (2 * rate, 3 * sigma)))
    for name in COMMON & state.keys():
        np.testing.assert_array_equal(later[name], other[name])  # whatever the law sees
    if "clock" in state:
        np.testing.assert_array_equal(state["clock"], 0)
        np.testing.assert_array_equal(later["clock"], 0.25)
    if "coefficient_at_start" in state:
        np.testing.assert_array_equal(later["coefficient_at_start"], state["coefficient_at_start"])


@every_law
def test_toml_round_trip(kind: str, held: str | None) -> None:
    for profiles in (False, True):
        law = friction(kind, held, profiles=profiles)
        written = tomli_w.dumps({"friction": law.model_dump(mode="json", exclude_none=True)})
        assert TypeAdapter(AnyFriction).validate_python(tomllib.loads(written)["friction"]) == law


@every_law
def test_initial_state_and_advance_have_the_declared_fields(kind: str, held: str | None) -> None:
    law = friction(kind, held)
    sigma = np.array([1e6, 0.0, 3e6])
    state = law.initial_state(sigma, 0.4 * sigma, np.zeros(3))
    assert set(state) == set(law.all_state_fields())
    assert set(law.advance(state, np.ones(3), sigma, 1e-6)) == set(state)
    assert all(np.shape(value) == (3,) and np.isfinite(value).all() for value in state.values())


@every_law
@every_example
def test_strength_is_finite_and_not_negative(kind: str, held: str | None, seed: int) -> None:
    law = friction(kind, held, seed)
    rate, sigma, state = histories(law, seed)
    # Arbitrary points, at rest, open, at rest and open; each after steps of any size.
    for v in (rate, 0 * rate):
        for s in (sigma, 0 * sigma):
            for dt in (0.0, 1e-12, 1e-7, 1.0, 1e12):
                new = law.advance(state, v, s, dt)
                assert all(np.isfinite(value).all() for value in new.values())
                strength = law.strength(v, s, new)
                assert np.isfinite(strength).all()
                assert (np.asarray(strength) >= 0).all()


@every_law
@every_example
def test_traced_values_and_derivatives(kind: str, held: str | None, seed: int) -> None:
    law = friction(kind, held, seed)
    rate, sigma, state = histories(law, seed)
    dt = 1e-7

    def direct(v: np.ndarray, s: np.ndarray) -> np.ndarray:
        return law.strength(v, s, law.advance(state, v, s, dt)) + 0 * v

    found = TracedLaw(law, at_end=True)(rate, sigma, state, dt, speed_then=rate)
    np.testing.assert_allclose(found.strength, direct(rate, sigma), rtol=1e-12)
    for name, value in law.advance(state, rate, sigma, dt).items():
        np.testing.assert_allclose(found.state[name], value, rtol=1e-12)
    # Central differences of step h: error h^2 from the third derivative, 1e-16 / h from rounding; h = 1e-5.
    h, at = 1e-5, state | {"normal_stress": 0.9 * sigma}
    last = rate * np.random.default_rng(seed).uniform(0.3, 1.6, len(rate))  # no kink of the extrapolation within h
    known = {"speed_before": last, "speed_then": last, "extrapolation": 0.5, "radiation": 1e3}
    for at_end in (True, False):
        traced = TracedLaw(law, at_end)

        def strength(v: float = 1, s: float = 1, b: float = 1, traced: TracedLaw = traced) -> np.ndarray:
            return traced(v * rate, s * sigma, at, dt, before=b * last, **known).strength

        here = traced(rate, sigma, at, dt, before=last, **known)
        for slope, value, name in (
            (here.slope, rate, "v"), (here.stress_slope, sigma, "s"), (here.before_slope, last, "b"),
        ):  # fmt: skip
            expected = (strength(**{name: 1 + h}) - strength(**{name: 1 - h})) / (2 * h)
            assert np.max(np.abs(slope * value - expected) / here.strength) < 1e-8


@every_law
@every_example
def test_state_at_the_traction(kind: str, held: str | None, seed: int) -> None:
    """At constant slip rate and stress it is exact; in steps much longer than the law's own times it is what the slip
    rate at the traction makes of it, whatever that was before, if the law forgets."""
    law = friction(kind, held, seed)
    if not law.all_state_fields():
        pytest.skip("no state")
    random = np.random.default_rng(seed)
    v, sigma = 10 ** random.uniform(-1, 1, N), 10 ** random.uniform(5, 7, N)
    state = law.advance(law.initial_state(sigma, 0.3 * sigma, v), 0.1 * v, 2 * sigma, 1e-5)
    state = {name: value + np.zeros(N) for name, value in state.items()}
    constant = {"before": v, "speed_before": v, "speed_then": v, "extrapolation": 0.5}
    for at_end in (True, False):
        for dt in (1e-9, 1e-6, 1e-3):
            for name, value in TracedLaw(law, at_end)(v, sigma, state, dt, **constant).state.items():
                np.testing.assert_allclose(value, law.advance(state, v, sigma, dt)[name], rtol=1e-9)
    # Clocks and slip do not forget the half that was added.
    end, other = (law.advance({n: f * x for n, x in state.items()}, v, sigma, 1e3) for f in (1.0, 1.5))
    if all(np.all(np.abs(other[name] - end[name]) < 1e-3 * np.abs(state[name])) for name in end):
        for at_end in (True, False):
            # (V_before + V) / 2 or V + (V - V_before) / 2 with V_before = V / 2
            now = (1.25 if at_end else 0.75) * v
            half = {"before": 0.5 * v, "speed_before": 0.5 * v, "speed_then": 2 * v, "extrapolation": 0.5}
            found = TracedLaw(law, at_end)(v, sigma, state | {"normal_stress": 2 * sigma}, 2e3, **half)
            np.testing.assert_allclose(found.rate_now, now, rtol=1e-12)
            expected = law.strength(now, sigma, law.advance(state, now, sigma, 1e3))  # half of the step
            np.testing.assert_allclose(found.strength, expected, rtol=1e-9)


@every_law
@every_example
def test_one_step_is_many(kind: str, held: str | None, seed: int) -> None:
    """One step is many, however long: nothing is gained by dividing it. The change over a short one is O(dt)."""
    law = friction(kind, held, seed)
    if not law.all_state_fields():
        pytest.skip("no state")
    # Rates at which something happens within the step, so that differences are well above round-off.
    random = np.random.default_rng(seed)
    v, sigma = 10 ** random.uniform(-1, 1, N), 10 ** random.uniform(5, 7, N)
    state = law.initial_state(sigma, 0.3 * sigma, v)
    state = law.advance(state, 0.1 * v, 2 * sigma, 1e-5)

    for dt in 10.0 ** np.arange(-9, 3):
        one, many = law.advance(state, v, sigma, dt), state
        for _ in range(5):
            many = law.advance(many, v, sigma, dt / 5)
        for name in law.all_state_fields():
            np.testing.assert_allclose(many[name], one[name], rtol=1e-9, err_msg=name)
    for name in law.all_state_fields():
        rounding = 1e-11 * np.abs(state[name])
        change = [law.advance(state, v, sigma, dt)[name] - state[name] for dt in (2e-9, 1e-9)]
        assert np.all(np.abs(change[0] - 2 * change[1]) <= rounding + 0.01 * np.abs(change[0])), name


@every_law
@every_example
def test_long_sliding_ends_at_the_steady_strength(kind: str, held: str | None, seed: int) -> None:
    law = friction(kind, held, seed)
    rate, sigma, state = histories(law, seed)
    try:
        steady = law.steady_strength(rate, sigma)
    except NotImplementedError:
        pytest.skip("the law has no steady state")
    for _ in range(3):  # a slip of 1e9 m in each step, against lengths below 1 mm
        state = law.advance(state, rate, sigma, 1e9 / rate)
    np.testing.assert_allclose(law.strength(rate, sigma, state), steady + 0 * rate, rtol=1e-6)


@every_law
@every_example
def test_friction_dissipates(kind: str, held: str | None, seed: int) -> None:
    law = friction(kind, held, seed)
    _, sigma, state = histories(law, seed)
    random = np.random.default_rng(seed)
    trial = random.normal(size=(N, 2)) * sigma[:, None]
    sigma = sigma * np.where(random.random(N) < 0.2, -1, 1)
    z, before = 10 ** random.uniform(5, 8, N), random.normal(size=(N, 2))
    size = np.linalg.norm(trial, axis=1)
    for at_end in (True, False):
        done = project(TracedLaw(law, at_end), state, sigma, trial, z, 1e-8, before, 0.5)
        power = np.sum(done.shear_traction * done.slip_rate, axis=1)
        carried = np.linalg.norm(done.shear_traction, axis=1)
        # Stuck points have slipped until half a step before the traction; which may be the other way.
        slides = np.any(done.mean_slip_rate != 0, axis=1)
        assert slides.mean() > 0.1 and np.all(power[slides] >= -1e-12 * size[slides])
        # Where the interface is open it carries nothing.
        assert np.all(carried[sigma < 0] == 0)


@every_law
def test_profiles_are_evaluated_point_by_point(kind: str, held: str | None) -> None:
    varying = friction(kind, held, profiles=True)
    position = np.linspace(0, 1, 5)
    law = varying.at(position)
    sigma, rate = np.full(5, 2e6), np.full(5, 0.3)
    state = law.initial_state(sigma, 0.3 * sigma, rate)
    new = law.advance(state, rate, sigma, 1e-6)
    strength = law.strength(rate, sigma, new)
    traced = TracedLaw(law, at_end=True)
    np.testing.assert_allclose(traced(rate, sigma, state, 1e-6, speed_then=rate).strength, strength, rtol=1e-12)
    some = np.array([3, 1])
    found = traced(rate[some], sigma[some], state, 1e-6, some, speed_then=rate)
    np.testing.assert_allclose(found.strength, strength[some], rtol=1e-12)
    for i, x in enumerate(position):
        one = varying.at(np.array([x]))
        here = one.initial_state(sigma[:1], 0.3 * sigma[:1], rate[:1])
        after = one.advance(here, rate[:1], sigma[:1], 1e-6)
        alone = one.strength(rate[:1], sigma[:1], after)
        np.testing.assert_allclose(strength[i], alone[0], rtol=1e-12)
    # The amplitude of the examples' profiles is 30 %, so that the points do differ.
    assert np.ptp(strength) > 1e-3 * strength.max()


@every_law
@every_example
def test_lengths_are_those_of_the_strength(kind: str, held: str | None, seed: int) -> None:
    """A breakdown is what sliding at one rate loses; a rate dependence what a small change of the rate does."""
    law = friction(kind, held, seed)
    sigma, v = np.array([1e6, 0.0, 3e6]), 3.0
    lengths = law.lengths(sigma, v)
    fields = law.all_state_fields()
    if "Pa" in fields.values() or "clock" in fields:  # what else changes with slip or time is not the law's own
        if held is not None:
            assert type(lengths) is type(law.law.lengths(sigma, v))
        return
    if isinstance(lengths, Breakdown):
        # Strength over slip by Simpson's rule, from 1e-9 of the shortest length to 1e6 of the longest, below 1 mm.
        slip = np.concatenate([[0.0], np.geomspace(1e-16, 1e3, 40001)])[:, None]
        state = law.initial_state(sigma, 0.3 * sigma, 0 * sigma + v)
        strength = law.strength(v, sigma, law.advance(state, v, sigma, slip / v)) + 0 * slip * sigma
        np.testing.assert_allclose(strength[0], lengths.peak + 0 * sigma, rtol=1e-9)
        np.testing.assert_allclose(strength[-1], lengths.residual + 0 * sigma, rtol=1e-6)
        # The tail of a state that decays to rounding is not part of it.
        lost = np.where(np.abs(strength - strength[-1]) > 1e-12 * strength[-1], strength - strength[-1], 0.0)
        energy = simpson(lost, x=slip[:, 0], axis=0)
        np.testing.assert_allclose(energy, lengths.energy + 0 * sigma, rtol=1e-4, atol=1e-9 * np.max(np.abs(energy)))
    if isinstance(lengths, RateDependence):
        slow, step, one = 1e-12, 1e-4, np.ones(1)
        steady = [law.steady_strength(rate * one, one) for rate in (slow, slow * np.exp(step))]
        weakening = law.lengths(one, slow).weakening
        if np.all(weakening > 0):  # else steady strength is zero at slip rates that low
            np.testing.assert_allclose((steady[0] - steady[1]) / step, weakening, rtol=1e-3)


def test_some_laws_say_their_lengths() -> None:
    found = {kind: type(friction(kind, held).lengths(1e6, 1.0)) for kind, held in LAWS if held is None}
    assert found["linear_slip_weakening"] is Breakdown and found["rate_and_state_ageing"] is RateDependence
    assert found["velocity_weakening"] is type(None)


def test_what_a_bond_adds_to_the_breakdown() -> None:
    """c to the peak and c D / 2 to the energy where it breaks; else c to both strengths."""
    weakening = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 1e-5}
    for length, residual, energy in ((4e-5, 0.2e6, 2.0 + 6.0), (None, 0.5e6, 2.0)):
        law = TypeAdapter(AnyFriction).validate_python(
            {"kind": "cohesion", "c": 0.3e6, "law": weakening} | ({"D_cohesion": length} if length else {})
        )
        found = law.lengths(1e6, 1.0)
        np.testing.assert_allclose([found.peak, found.residual, found.energy], [0.9e6, residual, energy], rtol=1e-12)


def test_a_memory_that_has_caught_up_sees_its_share() -> None:
    law = friction("prakash_clifton", "coulomb")
    np.testing.assert_allclose(law.lengths(1e6, 1.0).peak, law.law.mu_d * law.D * 1e6, rtol=1e-12)
