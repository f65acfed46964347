"""Every initial stress of the bodies: shapes, equilibrium with the weight, the same values for one point or many."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from pydantic import TypeAdapter

from ruptfx.bodies.initial_stress import AnyBodyStress, BodyStress, matrices, tractions
from ruptfx.input.schema import alternatives

KINDS = alternatives("ruptfx.bodies.initial_stress")
every_kind = pytest.mark.parametrize("kind", KINDS)
POINTS = np.random.default_rng(5).uniform(-9e3, -1e2, (40, 3))


def example(kind: str) -> BodyStress:
    text = f"stress = {KINDS[kind].example}"
    return TypeAdapter(AnyBodyStress).validate_python(tomllib.loads(text)["stress"])


@every_kind
def test_a_stress_depends_on_its_point_only(kind: str) -> None:
    stress = example(kind)
    found = stress.effective(POINTS)
    assert found.shape == (40, 6) and np.isfinite(found).all()
    assert np.array_equal(stress.effective(POINTS[7:8])[0], found[7])
    assert stress.pore_pressure(POINTS).shape == (40,) and (stress.pore_pressure(POINTS) >= 0).all()
    if stress.everywhere is not None:
        assert np.array_equal(found, np.tile(stress.everywhere, (40, 1)))


@every_kind
@pytest.mark.parametrize("dim", [2, 3])
def test_a_stress_balances_the_weight(kind: str, dim: int) -> None:
    """Total stress and weight, with the density of the kind."""
    stress = example(kind)
    weight = getattr(stress, "density", 0.0) * stress.acceleration(dim)
    left = stress.divergence(POINTS[:, :dim], np.full(40, 50.0)) + weight
    scale = np.linalg.norm(weight) + np.abs(stress.effective(POINTS[:, :dim])).max() / 1e4
    assert np.abs(left).max() < 1e-9 * scale


@every_kind
def test_a_stress_is_the_same_after_it_was_written(kind: str) -> None:
    stress = example(kind)
    again = TypeAdapter(AnyBodyStress).validate_python(stress.model_dump(exclude_none=True))
    assert again == stress and hash(again.model_dump_json()) == hash(stress.model_dump_json())


def test_six_components_have_their_places() -> None:
    """xx, yy, zz, xy, yz, xz: on a plane z = 0 the shear traction is (xz, yz), on a plane y = 0 (xy, yz)."""
    stress = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]])
    assert matrices(stress)[0].tolist() == [[1, 4, 6], [4, 2, 5], [6, 5, 3]]
    for frame, expected in (
        ([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (-3.0, 6.0, 5.0)),
        ([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], (-2.0, 4.0, 5.0)),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], (-1.0, 4.0, 6.0)),
    ):
        normal, shear = tractions(stress, np.array([frame]))
        assert (normal.item(), *shear[0]) == pytest.approx(expected)
