"""Every profile of the folder: a function of the position alone, read, written and given with units like any number.

Kinds for lines are evaluated on a surface, too; kinds for surfaces refuse a line, those for bodies an interface. `grid`
reads a file that a test writes (tests/contracts/test_varying_materials.py)."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
import tomli_w
from helpers.messages import facts

from ruptfx.input.profiles import evaluate, in_body
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.interfaces.faults.initial_stress import InitialStress

KINDS = {kind: cls for kind, cls in alternatives("ruptfx.input.profiles").items() if kind != "grid"}
X = np.linspace(-1.0, 1.0, 41)
SURFACE = np.stack([X, np.linspace(0.0, 0.6, 41)], axis=1)
every_kind = pytest.mark.parametrize("kind", KINDS)


def example(kind: str) -> dict[str, Any]:
    table = tomllib.loads(f"normal = 1e6\nshear = {KINDS[kind].example}")
    assert table["shear"]["kind"] == kind
    return table


def places(kind: str) -> np.ndarray:
    return SURFACE if KINDS[kind].over_surface or KINDS[kind].over_body else X


def values(kind: str, shape: Any, where: np.ndarray) -> np.ndarray:
    """Values along an interface, or at points of bodies."""
    return in_body(shape, where) if KINDS[kind].over_body else evaluate(shape, where)


@every_kind
def test_values_belong_to_places(kind: str) -> None:
    """The value at a point does not depend on the other points, hence not on ranks or their order."""
    shape = InitialStress.model_validate(example(kind)).shear
    where = places(kind)
    whole = values(kind, shape, where)
    assert (whole.shape == X.shape and np.ptp(whole) > 0) or kind == "constant"
    assert whole.shape == X.shape and np.isfinite(whole).all()
    some = np.array([30, 2, 17])
    np.testing.assert_allclose(values(kind, shape, where[some]), whole[some], rtol=1e-12)
    assert values(kind, shape, where[:0]).shape == (0,)  # a rank without a point


@every_kind
def test_over_a_surface(kind: str) -> None:
    """Kinds of one position vary along the first one only; those of surfaces refuse a line."""
    shape = InitialStress.model_validate(example(kind)).shear
    if KINDS[kind].over_body:
        for where in (X, SURFACE):
            with pytest.raises(CaseError, match=rf"{kind} "):
                evaluate(shape, where)
    elif KINDS[kind].over_surface:
        with pytest.raises(CaseError, match=rf"{kind} .*boxcar"):
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
    found = (values(kind, each.shear, places(kind)) for each in (again, given))
    np.testing.assert_array_equal(*found)


ANYWHERE = ("constant", "random", "sum", "product")  # along interfaces and in bodies


@pytest.mark.parametrize("kind", [kind for kind, cls in KINDS.items() if kind not in ANYWHERE and not cls.over_body])
def test_kinds_of_interfaces_in_bodies(kind: str) -> None:
    """They say what to write in a body; wrapped in `along_axis`, those of one position vary there."""
    shape = InitialStress.model_validate(example(kind)).shear
    with pytest.raises(CaseError, match=facts(r"in bodies use \{ kind = 'along_axis'")):
        in_body(shape, SURFACE)
    if not KINDS[kind].over_surface:
        np.testing.assert_array_equal(in_body(along(shape), SURFACE[:, ::-1]), evaluate(shape, X))


@pytest.mark.parametrize("kind", ANYWHERE)
def test_kinds_that_are_for_bodies_too(kind: str) -> None:
    shape = InitialStress.model_validate(example(kind)).shear
    if kind in ("sum", "product"):  # of kinds for bodies
        inner = {"kind": "along_axis", "axis": "x", "profile": example("boxcar")["shear"]}
        given = {"terms": [1.0, inner]} if kind == "sum" else {"value": 2.0, "factor": inner}
        shape = KINDS[kind].model_validate(given)
        line = np.where(np.abs(X - 0.1) <= 0.2 + 1e-9, 2.0, 1.0)
        np.testing.assert_allclose(in_body(shape, SURFACE), 1 + line if kind == "sum" else 2 * line, rtol=1e-15)
    found = in_body(shape, SURFACE)
    np.testing.assert_allclose(in_body(shape, SURFACE[::-1]), found[::-1], rtol=1e-12)


def along(shape: Any) -> Any:
    return KINDS["along_axis"].model_construct(axis="y", profile=shape)


@every_kind
def test_an_unknown_key_is_refused(kind: str) -> None:
    table = example(kind)
    with pytest.raises(CaseError, match=facts("unknown key 'beyond_this'")):
        InitialStress(**{**table, "shear": {**table["shear"], "beyond_this": 1.0}})
