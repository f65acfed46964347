"""Every law of the folder keeps the contract of a cohesive law; a new file is tested without an edit here."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
import tomli_w
from helpers.messages import facts
from pydantic import TypeAdapter
from scipy.integrate import quad

from ruptfx.app.check_law import check_law
from ruptfx.app.check_law.cohesive import straight_path
from ruptfx.app.check_law.examples import table
from ruptfx.input.schema import CaseError, alternatives, descriptions
from ruptfx.laws.cohesion import AnyCohesion, CohesiveLaw
from ruptfx.platform.codegen.tracing import derivative, record, symbol, to_numpy

LAWS = alternatives("ruptfx.laws.cohesion")
every_law = pytest.mark.parametrize("kind", list(LAWS))
every_example = pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])


def example(kind: str, seed: int = 0) -> CohesiveLaw:
    return TypeAdapter(AnyCohesion).validate_python({"kind": kind, **table(LAWS[kind], seed)})


@every_law
def test_a_law_says_what_it_is(kind: str) -> None:
    assert LAWS[kind].formula and LAWS[kind].source and LAWS[kind].summary()


@every_law
def test_all_strength_is_lost_from_the_beginning_to_the_end(kind: str) -> None:
    damage = np.linspace(0, 1, 2001)
    left = example(kind).remaining_fraction(damage)
    np.testing.assert_allclose(left[[0, -1]], [1, 0], atol=1e-15)
    assert np.all(np.diff(left) <= 1e-15)


@every_law
def test_the_area_is_that_of_the_curve(kind: str) -> None:
    """By an adaptive rule, which halves the pieces with a kink until they no longer count."""
    found, _ = quad(example(kind).remaining_fraction, 0.0, 1.0, epsabs=1e-14, epsrel=1e-14, limit=200)
    assert found == pytest.approx(LAWS[kind].area, rel=1e-12)


@every_law
@every_example
def test_one_mode_alone_takes_its_fracture_energy(kind: str, seed: int) -> None:
    law = example(kind, seed)
    for strength, energy, end, damage in (
        (law.f_t, law.G_Ic, law.opening_at_failure, lambda w: law.damage(w, 0 * w)),
        (law.c, law.G_IIc, law.slip_at_failure, lambda s: law.damage(0 * s, s)),
    ):
        inelastic = np.linspace(0, end, 9 * 2000 + 1)
        found = damage(inelastic)
        assert found[0] == 0 and found[-1] == pytest.approx(1, rel=1e-14) and np.all(np.diff(found) > 0)
        assert damage(np.array([2 * end])) == 1  # and no more
        # Trapezoids of a smooth curve between kinks: second order, 1/18000 squared.
        assert np.trapezoid(strength * law.remaining_fraction(found), inelastic) == pytest.approx(energy, rel=1e-7)


@every_law
@every_example
def test_damage_grows_with_the_size_of_a_jump_of_any_mode(kind: str, seed: int) -> None:
    law, size = example(kind, seed), np.linspace(0, 1.5, 300)
    for angle in np.linspace(0, np.pi / 2, 7):
        damage = law.damage(size * np.cos(angle) * law.opening_at_failure, size * np.sin(angle) * law.slip_at_failure)
        assert np.all(np.diff(damage) >= 0) and damage[0] == 0 and damage[-1] == 1


def test_a_mixed_mode_takes_the_energy_of_its_mix() -> None:
    """f_t w = c s all the way is B = 1/2, and with eta = 2 a quarter of the way from G_Ic to G_IIc."""
    law = LAWS["benzeggagh_kenane"](f_t=2e6, c=4e6, G_Ic=10.0, G_IIc=50.0, eta=2.0)
    opening = np.linspace(0, 4e-5, 100001)
    slip = 0.5 * opening
    left = law.remaining_fraction(law.damage(opening, slip))
    work = np.trapezoid(law.f_t * left, opening) + np.trapezoid(law.c * left, slip)
    assert work == pytest.approx(20.0, rel=1e-8)


@pytest.mark.parametrize("kind", [kind for kind in LAWS if kind != "benzeggagh_kenane"])
@pytest.mark.parametrize("angle", [30.0, 45.0, 80.0])
def test_a_mixed_mode_on_the_circle_takes_more_than_one_mode(kind: str, angle: float) -> None:
    """W_I = G_Ic cos a and W_II = G_IIc sin a: sqrt(2) times a common fracture energy at 45 degrees."""
    law = LAWS[kind](f_t=2e6, c=5e6, G_Ic=10.0, G_IIc=40.0)
    _, opening, slip = straight_path(law, np.radians(angle))
    assert opening == pytest.approx(10.0 * np.cos(np.radians(angle)), rel=1e-6)
    assert slip == pytest.approx(40.0 * np.sin(np.radians(angle)), rel=1e-6)


@every_law
def test_a_law_passes_check_law(kind: str) -> None:
    (report,) = check_law(kind)
    assert report.name == "cohesive law" and report.sound, report.rows


@every_law
def test_the_key_says_what_a_mixed_mode_costs(kind: str) -> None:
    said = descriptions(LAWS[kind])["G_Ic"]
    assert "1.41" in said and "benzeggagh_kenane" in said


def test_mixed_modes_of_the_other_laws_fail_on_a_circle() -> None:
    law = example("linear")
    assert law.damage(0.6 * law.opening_at_failure, 0.8 * law.slip_at_failure) == pytest.approx(1, rel=1e-14)


@every_law
def test_traced_slopes_are_those_of_the_curve(kind: str) -> None:
    law, damage = example(kind), symbol("damage")
    left = record(law.remaining_fraction, damage)
    traced = to_numpy({"left": left, "slope": derivative(left, damage)}, ["damage"])
    x = np.linspace(0.013, 0.987, 50)  # off the kink
    value, slope = traced(x)
    np.testing.assert_allclose(value, law.remaining_fraction(x), rtol=1e-14)
    difference = (law.remaining_fraction(x + 1e-6) - law.remaining_fraction(x - 1e-6)) / 2e-6
    np.testing.assert_allclose(slope + 0 * x, difference, rtol=1e-6, atol=1e-8)


@every_law
def test_a_law_survives_toml(kind: str) -> None:
    law = example(kind)
    again = tomllib.loads(tomli_w.dumps({"cohesion": law.model_dump(mode="json")}))["cohesion"]
    assert TypeAdapter(AnyCohesion).validate_python(again) == law


def test_a_strength_must_not_be_negative() -> None:
    """Zero is a crack from the start, along an interface; facets all over a body refuse it."""
    with pytest.raises(CaseError, match=facts(r"f_t = -1.0: input should be greater than or equal to 0")):
        LAWS["linear"](f_t=-1.0, c=1e6, G_Ic=1.0, G_IIc=1.0)
    LAWS["linear"](f_t=0.0, c=0.0, G_Ic=1.0, G_IIc=1.0)
