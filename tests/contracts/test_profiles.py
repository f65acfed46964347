"""Every profile of the folder: a function of the position alone, read, written and given with units like any number."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
import tomli_w

from ruptfx.initial_stress import InitialStress
from ruptfx.profiles import evaluate
from ruptfx.schema import alternatives

KINDS = alternatives("ruptfx.profiles")
X = np.linspace(-1.0, 1.0, 41)
every_kind = pytest.mark.parametrize("kind", KINDS)


def example(kind: str) -> dict[str, Any]:
    table = tomllib.loads(f"normal = 1e6\nshear = {KINDS[kind].example}")
    assert table["shear"]["kind"] == kind
    return table


@every_kind
def test_values_belong_to_places(kind: str) -> None:
    """The value at a point does not depend on the other points, hence not on ranks or their order."""
    shape = InitialStress.model_validate(example(kind)).shear
    whole = evaluate(shape, X)
    assert whole.shape == X.shape and np.isfinite(whole).all()
    some = np.array([30, 2, 17])
    np.testing.assert_allclose(shape(X[some]), whole[some], rtol=1e-12)
    assert shape(X[:0]).shape == (0,)  # a rank without a point


@every_kind
def test_written_and_read_it_is_the_same(kind: str) -> None:
    given = InitialStress.model_validate(example(kind))
    written = tomli_w.dumps(given.model_dump(mode="json", exclude_none=True))
    again = InitialStress.model_validate(tomllib.loads(written))
    assert again == given and type(again.shear) is KINDS[kind]
    np.testing.assert_array_equal(again.at(X).shear, given.at(X).shear)


@every_kind
def test_an_unknown_key_is_refused(kind: str) -> None:
    table = example(kind)
    with pytest.raises(ValueError, match="unknown key 'beyond_this'"):
        InitialStress.model_validate({**table, "shear": {**table["shear"], "beyond_this": 1.0}})
