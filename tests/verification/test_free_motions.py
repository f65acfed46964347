"""Bodies that can move freely have no equilibrium: their rigid motions are named before any step."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.small_cases import plates, strike_slip

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.run import stages
from ruptfx.run.model import Model
from ruptfx.stepping.implicit.free_motions import RigidMotions

pytestmark = pytest.mark.fem

SLOW = {"kind": "quasi_static"}


def drive(edge: str, component: str, velocity: float = 0.0) -> dict[str, Any]:
    return {"kind": "driven", "edge": edge, "component": component, "velocity": velocity}


def flat(*boundaries: dict[str, Any]) -> dict[str, Any]:
    return plates({"stepper": SLOW, "order": 2, "boundaries": list(boundaries)})


def solid(*boundaries: dict[str, Any]) -> dict[str, Any]:
    return strike_slip({"stepper": SLOW, "faults.main.contact": {"kind": "compliant", "C_n": 1e12, "C_s": 1e12},
                        "boundaries": list(boundaries), "mesh.element_size": 4e-3})  # fmt: skip


PRESSED = {"kind": "traction", "edge": "upper.top", "traction": [0.0, -1e5]}
FAR = [drive("plus.far", "x", 1e-3), drive("minus.far", "x", -1e-3)]
CASES = {
    "nothing": (flat(), ["translation along x", "translation along y", "rotation in the plane"], 3),
    # On x = const. both a translation along y and a turn move the edge along y: one turn about it remains.
    "one side": (flat(drive("upper.left", "y")), ["translation along x", "rotation in the plane"], 2),
    "top": (flat(drive("upper.top", "x", 1.0)), ["translation along y", "rotation in the plane"], 2),
    "two sides": (flat(drive("upper.top", "x", 1.0), drive("lower.bottom", "x")), ["translation along y"], 1),
    "spring": (flat({"kind": "spring", "edge": "lower.bottom", "normal": 1e9}, PRESSED), ["translation along x"], 1),
    "far edges": (solid(*FAR), ["translation along y", "translation along z", "rotation about x"], 3),
    "all of the solid": (solid(), ["translation along x", "translation along y", "translation along z",
                                   "rotation about x", "rotation about y", "rotation about z"], 6),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_free_motions_are_named_and_the_remedy_holds_them(name: str) -> None:
    table, words, count = CASES[name]
    model = Model(parse_case(table))
    motions = RigidMotions(model)
    free = motions.free()
    assert free.shape[1] == count
    said = motions.in_words(free)
    assert len(said) == 1 and said[0].split(": ")[1].split(", ") == words
    edges = motions.remedy(free)
    if table["boundaries"]:
        with pytest.raises(CaseError) as refused:
            stages.bind(model)
        for edge, component in edges:
            assert f"edge = '{edge}', component = '{component}'" in str(refused.value)
    else:  # no force moves the bodies as a whole
        stages.bind(model)
    held = Model(parse_case(table | {"boundaries": [*table["boundaries"], *(drive(*each) for each in edges)]}))
    assert RigidMotions(held).free().shape[1] == 0
    stages.bind(held)


def test_bodies_apart_have_motions_of_their_own() -> None:
    """A frictionless support of one body holds the other one through the interface, in all directions."""
    model = Model(parse_case(flat(drive("lower.bottom", "y"), drive("lower.left", "x"))))
    assert RigidMotions(model).free().shape[1] == 0
    model.faults = []  # without the interface the upper body is free, and only that
    motions = RigidMotions(model)
    assert motions.free().shape[1] == 3
    assert [words.split(":")[0] for words in motions.in_words(motions.free())] == ["body 'upper'"]
