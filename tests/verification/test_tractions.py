"""Tractions on parts of edges and their course in time."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.small_cases import plates

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

LOAD = {"kind": "traction", "edge": "upper.top", "traction": [1e6, -2e6]}


def force(**changes: object) -> np.ndarray:
    """Sum of the nodal forces of the load [N/m]."""
    model = Model(parse_case(plates({"boundaries": [LOAD | changes]})))
    return model.loads.force(0.0).reshape(-1, 2).sum(axis=0)


def test_a_part_of_an_edge_is_loaded() -> None:
    # The edge is 12 mm long, its elements 2 mm: those with their middle in 3.5 .. 8 mm reach from 4 to 8 mm.
    np.testing.assert_allclose(force(), [12e3, -24e3], rtol=1e-12)
    np.testing.assert_allclose(force(x_range=[3.5e-3, 8e-3]), [4e3, -8e3], rtol=1e-12)
    with pytest.raises(CaseError, match=facts(r"boundaries\.0: upper\.top has no side .* x_range = \[0\.02, 0\.03\]")):
        force(x_range=[20e-3, 30e-3])


def test_a_part_of_an_edge_has_springs() -> None:
    """1e12 Pa/m along the normal and 4e11 Pa/m across, on the 4 mm of the same sides: 4e9 and 1.6e9 N/m per depth."""
    spring = {"kind": "spring", "edge": "upper.top", "normal": 1e12, "tangential": 4e11, "x_range": [3.5e-3, 8e-3]}
    model = Model(parse_case(plates({"boundaries": [spring]})))
    (support,) = model.loads.supports
    nodes, stiffness = support.nodes, support.stiffness
    loaded = np.abs(stiffness).sum(axis=(1, 2)) > 0
    np.testing.assert_allclose(stiffness.sum(axis=0), [[1.6e9, 0.0], [0.0, 4e9]], atol=1.0)
    assert np.ptp(model.coordinates[nodes[loaded], 0]) == pytest.approx(4e-3)
    with pytest.raises(CaseError, match=facts(r"boundaries\.0: upper\.top has no side .* x_range = \[0\.02, 0\.03\]")):
        Model(parse_case(plates({"boundaries": [{**spring, "x_range": [20e-3, 30e-3]}]})))


def test_no_traction_is_a_free_edge() -> None:
    np.testing.assert_array_equal(force(traction=[0.0, 0.0]), 0)
    np.testing.assert_allclose(force(traction=[0.0, 1e6]), [0, 12e3], atol=1e-9)


def test_course_in_time() -> None:
    def factor(history: dict[str, object], time: float, ramp: float = 0.0) -> float:
        case = parse_case(plates({"boundaries": [LOAD | {"history": history, "ramp": ramp}]}))
        return case.boundaries[0].factor(time)

    ricker = {"kind": "ricker", "frequency": 1e5, "delay": 15e-6}
    assert factor(ricker, 15e-6) == 1.0
    # a = 1/2 is where the wavelet passes zero: t - delay = sqrt(1/2) / (pi f).
    assert abs(factor(ricker, 15e-6 + np.sqrt(0.5) / (np.pi * 1e5))) < 1e-12
    sampled = {"kind": "sampled", "times": [0.0, 2e-6, 3e-6], "values": [0.0, 1.0, -1.0]}
    assert factor(sampled, 1e-6) == pytest.approx(0.5) and factor(sampled, 9e-6) == -1.0
    assert factor(sampled, 1e-6, ramp=4e-6) == pytest.approx(0.125)
    with pytest.raises(CaseError, match=facts(r"times = \[0\.0, 2e-06, 2e-06\]: must increase")):
        factor(sampled | {"times": [0.0, 2e-6, 2e-6]}, 0.0)
