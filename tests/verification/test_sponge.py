"""Absorbing layers: reflection of packets, the same in three dimensions, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import SPLIT, march, merged, plates, strike_slip

pytest.importorskip("dolfinx")

from helpers.messages import facts

from benchmarks import sponge as bench
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

LAYER = {"kind": "sponge", "width": 2.0}
SOLID = {"duration": 4e-6, "order": 2, "faults.main.contact": SPLIT, "stepper": {"kind": "leapfrog", "time_step": 5e-8}}


def test_a_layer_of_two_wavelengths_reflects_one_percent() -> None:
    """S waves at 30 degrees: a solution of the differential equations of the layer has 0.97 %, dashpots 19 %."""
    found, closure = bench.reflection(LAYER, "S", 30, elements=2)
    assert 0.008 < found < 0.0115
    assert closure < 1e-10


def push(sides: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A load that comes to layers of two adjacent edges."""
    load = {"kind": "traction", "edge": "upper.left", "traction": [1e6, 5e5, 0.0][: 3 if sides else 2], "ramp": 1e-6}
    return [load, *({"kind": "sponge", "edge": f"upper.{side}", "width": 2e-3} for side in ("right", "top")), *sides]


def test_extruded_layers_are_those_of_plane_strain() -> None:
    flat = plates({**SOLID, "plane": "strain", "boundaries": push([])})
    across = [{"kind": "driven", "edge": f"{body}.{face}", "component": "z", "velocity": 0.0}
              for body in ("upper", "lower") for face in ("back", "front")]  # fmt: skip
    solid = merged(flat, {"plane": "solid", "boundaries": push(across)})
    solid["mesh"] = {"kind": "extruded", "section": flat["mesh"], "thickness": 1e-3}
    ends = []
    for table in (flat, solid):
        model, _, state = march(parse_case(table))
        x = model.coordinates
        on = np.flatnonzero(x[:, 2] < 1e-12) if x.shape[1] == 3 else np.arange(len(x))
        order = on[np.lexsort((*np.round(x[on, :2].T, 9), model.layout.body[on]))]
        ends.append(state.displacement.reshape(model.nodes, -1)[order, :2])
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-10 * np.abs(ends[0]).max())


def test_a_layer_along_the_far_edge_of_a_dipping_fault() -> None:
    """The edge is at 30 degrees to z; dashpots alone are refused there, and the layer takes as much from any plane."""
    table = strike_slip({"mesh.dip": 60.0, "order": 1, "boundaries": [{**LAYER, "edge": "plus.far", "width": 2e-3}]})
    model = Model(parse_case(table))
    lost, mass = (each.reshape(-1, 3) for each in (model.loads.dashpot, model.mass))
    distance = model.coordinates @ [0.0, np.sin(np.pi / 3), np.cos(np.pi / 3)]
    deep = (distance.max() - distance < 2e-3 * (1 - 1e-9)) & (model.layout.body == 0)
    np.testing.assert_array_equal(lost.any(axis=1), deep)
    depth = 1 - (distance.max() - distance) / 2e-3
    inside = deep & (depth < 1 - 1e-9)  # not on the edge, which has dashpots
    shape = 2.1 * depth - 0.7 * depth**2 + 6.1 * depth**3 + 5.7 * depth**4
    speeds = model.wave_speeds()
    for component, share in ((0, 0.0), (1, 0.75), (2, 0.25)):  # of c_p: square of the normal
        rate = shape / 2e-3 * (share * speeds.c_p + (1 - share) * speeds.c_s)
        np.testing.assert_allclose(lost[inside, component], (rate * mass[:, component])[inside], rtol=1e-9)
    assert inside.any()


CHAMFERED = {"kind": "block_on_rigid", "length": 12e-3, "height": 4e-3, "element_size": 1e-3, "chamfer": 1e-3}


@pytest.mark.parametrize("mesh, edge, message", [
    ({}, "upper.right", r"boundaries\.0\.width = 2 m: .*narrower"),
    ({"mesh": CHAMFERED}, "upper.left", r"boundaries\.0\.edge = 'upper.left': .*plane"),
])  # fmt: skip
def test_refusals(mesh: dict[str, Any], edge: str, message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        Model(parse_case(plates({**mesh, "boundaries": [{**LAYER, "edge": edge}]})))
