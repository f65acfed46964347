"""Every profile of the folder: a function of the position alone, read, written and given with units like any number.

Kinds for lines are evaluated on a surface, too; kinds for surfaces refuse a line."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
import tomli_w

from ruptfx.faults.initial_stress import InitialStress
from ruptfx.profiles import evaluate
from ruptfx.schema import CaseError, alternatives

KINDS = alternatives("ruptfx.profiles")
X = np.linspace(-1.0, 1.0, 41)
SURFACE = np.stack([X, np.linspace(0.0, 0.6, 41)], axis=1)
every_kind = pytest.mark.parametrize("kind", KINDS)


def example(kind: str) -> dict[str, Any]:
    table = tomllib.loads(f"normal = 1e6\nshear = {KINDS[kind].example}")
    assert table["shear"]["kind"] == kind
    return table


def places(kind: str) -> np.ndarray:
    return SURFACE if KINDS[kind].over_surface else X


@every_kind
def test_values_belong_to_places(kind: str) -> None:
    """The value at a point does not depend on the other points, hence not on ranks or their order."""
    shape = InitialStress.model_validate(example(kind)).shear
    where = places(kind)
    whole = evaluate(shape, where)
    assert (whole.shape == X.shape and np.ptp(whole) > 0) or kind == "constant"
    assert whole.shape == X.shape and np.isfinite(whole).all()
    some = np.array([30, 2, 17])
    np.testing.assert_allclose(evaluate(shape, where[some]), whole[some], rtol=1e-12)
    assert evaluate(shape, where[:0]).shape == (0,)  # a rank without a point


@every_kind
def test_over_a_surface(kind: str) -> None:
    """Kinds of one position vary along the first one only; those of surfaces refuse a line."""
    shape = InitialStress.model_validate(example(kind)).shear
    if KINDS[kind].over_surface:
        with pytest.raises(CaseError, match="varies over a surface"):
            evaluate(shape, X)
    else:
        np.testing.assert_array_equal(evaluate(shape, SURFACE), evaluate(shape, X))
        turned = KINDS["along_dip"].model_construct(profile=shape)
        np.testing.assert_array_equal(evaluate(turned, SURFACE[:, ::-1]), evaluate(shape, X))


@every_kind
def test_written_and_read_it_is_the_same(kind: str) -> None:
    given = InitialStress.model_validate(example(kind))
    written = tomli_w.dumps(given.model_dump(mode="json", exclude_none=True))
    again = InitialStress.model_validate(tomllib.loads(written))
    assert again == given and type(again.shear) is KINDS[kind]
    np.testing.assert_array_equal(again.at(places(kind)).shear, given.at(places(kind)).shear)


@every_kind
def test_an_unknown_key_is_refused(kind: str) -> None:
    table = example(kind)
    with pytest.raises(ValueError, match="unknown key 'beyond_this'"):
        InitialStress.model_validate({**table, "shear": {**table["shear"], "beyond_this": 1.0}})
