"""Every law of the folder keeps the contract of a friction law; a new file is tested without an edit here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.labels import label_faults
from helpers.messages import facts
from helpers.small_cases import case, friction_laws, two_boxes
from pydantic import TypeAdapter
from scipy.integrate import simpson

from ruptfx import RuptfxError
from ruptfx.app.check_law import figure
from ruptfx.app.check_law.checks import CHECKS, missing
from ruptfx.app.check_law.examples import friction, holds
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.interfaces.faults.projection import TracedLaw
from ruptfx.laws.friction import COMMON, RESERVED, AnyFriction
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.laws.friction.lengths import Breakdown, RateDependence

LAWS = friction_laws()
SEEDS = (0, 1)
every_law = pytest.mark.parametrize("kind, wrapped", LAWS, ids=["-".join(filter(None, law)) for law in LAWS])
every_example = pytest.mark.parametrize("seed", [SEEDS[0], pytest.param(SEEDS[1], marks=pytest.mark.slow)])


@pytest.mark.parametrize("kind", list(alternatives("ruptfx.laws.friction")))
def test_a_law_says_what_it_is(kind: str) -> None:
    assert missing(alternatives("ruptfx.laws.friction")[kind]) == []


@pytest.mark.parametrize("kind, wrapped", dict(LAWS).items(), ids=dict(LAWS))
def test_labels_of_its_figure_keep_apart(kind: str, wrapped: str | None) -> None:
    """The figure of a law that contains another one shows the sum of both: one of them is enough."""
    assert label_faults(figure.draw(friction(kind, wrapped))) == []


@pytest.mark.parametrize("name", sorted(RESERVED))
def test_a_law_that_would_overwrite_a_field_of_the_fault_is_refused(name: str) -> None:
    fields = {"state_fields": {name: "1"}, "__annotations__": {}, "__module__": "ruptfx.laws.friction.some_law"}
    with pytest.raises(
        RuptfxError, match=facts(f"some_law: the state variable '{name}' .* another name in state_fields")
    ):
        type(Coulomb)("SomeLaw", (Coulomb,), fields)


@pytest.mark.fem
def test_what_a_fault_and_its_file_call_their_own_is_reserved(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model
    from ruptfx.run.simulation import simulate

    flat = case({"duration": 1e-7})  # Coulomb friction has no state
    with simulate(flat, out=tmp_path / "run", progress=False) as record:
        assert set(record.interface.variables) <= RESERVED
    solid = case({"plane": "solid", "order": 1}).substituted({"mesh": two_boxes()})
    assert set(Model(solid).initial_state().faults["main"]) <= RESERVED


WRAPPERS = [kind for kind, cls in alternatives("ruptfx.laws.friction").items() if holds(cls)]


@pytest.mark.parametrize("outer", WRAPPERS)
@pytest.mark.parametrize("inner", WRAPPERS)
def test_laws_that_hold_each_other_share_no_state(outer: str, inner: str) -> None:
    plain = [kind for kind, wrapped in LAWS if wrapped is None]
    tables = [friction(kind, plain[0]).model_dump(mode="json") for kind in (outer, inner)]
    nested = {**tables[0], "law": tables[1]}
    laws = alternatives("ruptfx.laws.friction")
    shared = laws[outer].state_fields.keys() & laws[inner].state_fields.keys() - COMMON
    # Also where a third law is between them.
    between = next(
        kind
        for kind in WRAPPERS
        if laws[kind].state_fields.keys().isdisjoint(laws[outer].state_fields.keys() | laws[inner].state_fields.keys())
    )
    third = friction(between, plain[0]).model_dump(mode="json")
    for law in (nested, {**tables[0], "law": {**third, "law": tables[1]}}):
        if not shared:
            made = TypeAdapter(AnyFriction).validate_python(law)
            assert made.all_state_fields().keys() >= laws[outer].state_fields.keys() | laws[inner].state_fields.keys()
            continue
        with pytest.raises(CaseError) as caught:
            case({"faults.main.friction": law})
        said = f"faults.main.friction: {outer} holds {inner}, and both call a state variable '{min(shared)}'"
        assert str(caught.value).startswith(said)


@pytest.mark.parametrize("check", CHECKS)
def test_every_check_is_for_some_law(check: str) -> None:
    """For the others it gives a reason, with which the next test skips."""
    assert any(CHECKS[check](friction(kind, wrapped, 0), 0) is None for kind, wrapped in LAWS)


@every_law
@every_example
@pytest.mark.parametrize("check", CHECKS)
def test_a_law_keeps_its_contract(check: str, kind: str, wrapped: str | None, seed: int) -> None:
    reason = CHECKS[check](friction(kind, wrapped, seed), seed)
    if reason:
        pytest.skip(reason)
    assert reason is None


@every_law
def test_profiles_survive_toml(kind: str, wrapped: str | None) -> None:
    assert CHECKS["case file"](friction(kind, wrapped, profiles=True), 0) is None


@every_law
def test_profiles_are_evaluated_point_by_point(kind: str, wrapped: str | None) -> None:
    varying = friction(kind, wrapped, profiles=True)
    position = np.linspace(0, 1, 5)
    law = varying.at(position)
    sigma, rate = np.full(5, 2e6), np.full(5, 0.3)
    state = law.initial_state(sigma, 0.3 * sigma, rate)
    new = law.advance(state, rate, sigma, 1e-6)
    strength = law.strength(rate, sigma, new)
    traced = TracedLaw(law, at_end=True)
    np.testing.assert_allclose(traced(rate, sigma, state, 1e-6, speed_before=rate).strength, strength, rtol=1e-12)
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
def test_lengths_are_those_of_the_strength(kind: str, wrapped: str | None, seed: int) -> None:
    """A breakdown is what sliding at one rate loses; a rate dependence what a small change of the rate does."""
    law = friction(kind, wrapped, seed)
    sigma, v = np.array([1e6, 0.0, 3e6]), 3.0
    lengths = law.lengths(sigma, v)
    fields = law.all_state_fields()
    alone = "Pa" not in fields.values() and "clock" not in fields  # else more than the law's own changes its strength
    assert lengths is None or isinstance(lengths, Breakdown | RateDependence)
    if not alone and wrapped is not None:
        assert type(lengths) is type(law.law.lengths(sigma, v))
    if alone and isinstance(lengths, Breakdown):
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
    if alone and isinstance(lengths, RateDependence):
        slow, step, one = 1e-12, 1e-4, np.ones(1)
        steady = [law.steady_strength(rate * one, one) for rate in (slow, slow * np.exp(step))]
        weakening = law.lengths(one, slow).weakening
        if np.all(weakening > 0):
            np.testing.assert_allclose((steady[0] - steady[1]) / step, weakening, rtol=1e-3)
        else:  # the strength is almost zero at slip rates that low
            assert np.all(steady[1] >= steady[0])


def test_some_laws_say_their_lengths() -> None:
    found = {kind: type(friction(kind, wrapped).lengths(1e6, 1.0)) for kind, wrapped in LAWS if wrapped is None}
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


def test_the_breakdown_of_many_points_is_that_of_each() -> None:
    """On surfaces the integral over the slip is computed in parts, 500 of 2000 intervals at a time here."""
    law = friction("rate_and_state_power_law", None)
    alone, many = law.lengths(np.full(1, 1e6), 3.0), law.lengths(np.full(4000, 1e6), 3.0)
    np.testing.assert_allclose(many.energy, np.full(4000, alone.energy[0]), rtol=1e-12)
    np.testing.assert_array_equal(many.peak, np.full(4000, alone.peak[0]))
