"""The mesh of a specimen: areas, edges, notches, platens, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("gmsh")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import RawMesh
from ruptfx.bodies.meshes.specimen import Specimen
from ruptfx.input.schema import CaseError

RECTANGLE = {"kind": "rectangle", "width": 4e-3, "height": 6e-3}


def build(**keys: Any) -> RawMesh:
    return Specimen.model_validate({"shape": RECTANGLE, "element_size": 0.5e-3, **keys}).build()


def areas(raw: RawMesh) -> np.ndarray:
    first, second = (
        raw.points[raw.cells[:, 1]] - raw.points[raw.cells[:, 0]],
        raw.points[raw.cells[:, 2]] - raw.points[raw.cells[:, 0]],
    )
    return 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def length(raw: RawMesh, edge: str) -> float:
    ends = raw.points[raw.edges[edge]]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())


def test_rectangle_with_platens_and_phases() -> None:
    raw = build(
        platens={"thickness": 1e-3, "body": "steel"},
        phases={"kind": "random_cells", "fractions": {"quartz": 0.5, "mica": 0.5}},
    )
    assert raw.bodies == ["quartz", "mica", "steel"]
    area = np.bincount(raw.cell_body, areas(raw))
    assert area[2] == pytest.approx(2 * 4e-3 * 1e-3) and area[:2].sum() == pytest.approx(4e-3 * 6e-3)
    assert {edge: pytest.approx(length(raw, edge)) for edge in raw.edges} == {
        "steel.bottom": 4e-3,
        "steel.top": 4e-3,
        "specimen.left": 6e-3,
        "specimen.right": 6e-3,
    }
    assert raw.points[raw.edges["steel.top"]][:, :, 1] == pytest.approx(4e-3)
    assert np.sqrt(areas(raw).mean() * 4 / np.sqrt(3)) == pytest.approx(0.5e-3, rel=0.15)  # edges of equal triangles


def test_disc_with_flats() -> None:
    # Half the flat is seen under 10 degrees: two segments are missing from the circle, R^2 (a - sin a cos a) each.
    raw = build(shape={"kind": "disc", "diameter": 8e-3, "flat": 20.0}, element_size=0.3e-3)
    a = np.deg2rad(10)
    assert areas(raw).sum() == pytest.approx(16e-6 * (np.pi - 2 * (a - np.sin(a) * np.cos(a))), rel=2e-3)
    assert [length(raw, "specimen.top"), length(raw, "specimen.bottom")] == pytest.approx([8e-3 * np.sin(a)] * 2)
    assert length(raw, "specimen.side") == pytest.approx(8e-3 * (np.pi - 2 * a), rel=1e-3)
    assert set(build(shape={"kind": "disc", "diameter": 8e-3, "flat": 0}).edges) == {"specimen.side"}


def test_notch_and_part_of_an_edge() -> None:
    raw = build(center=[2e-3, 3e-3], notches=[[0, 2e-3, 1.5e-3, 2e-3]], parts={"struck": [0, 0, 0, 2e-3]})
    ends = raw.points[raw.open_facets]
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(1.5e-3)
    assert ends[:, :, 1] == pytest.approx(2e-3)
    assert length(raw, "specimen.struck") == pytest.approx(2e-3) and length(raw, "specimen.left") == pytest.approx(4e-3)
    assert len(build().open_facets) == 0


def test_joints_are_lines_of_facets_with_a_name() -> None:
    """Straight, whatever the mesh; what is outside of the specimen does not count."""
    raw = build(center=[2e-3, 3e-3], joints={"old": [-1e-3, 0.0, 5e-3, 6e-3]})
    ends = raw.points[raw.joints["old"]]
    assert ends[:, :, 1] - ends[:, :, 0] == pytest.approx(1e-3, abs=1e-12)
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(4e-3 * np.sqrt(2))
    assert len(raw.open_facets) == 0


@pytest.mark.parametrize(
    "keys, message",
    [
        ({"element_size": 1e-6}, "would make"),
        ({"joints": {"old": [9e-3, 0, 9e-3, 1e-3]}}, r"mesh\.joints\.old: no part of it is inside"),
        ({"parts": {"struck": [1e-3, 0, 1e-3, 1e-3]}}, r"mesh\.parts\.struck: no part of the boundary"),
        (
            {
                "platens": {"thickness": 1e-3, "body": "quartz"},
                "phases": {"kind": "random_cells", "fractions": {"quartz": 1.0}},
            },
            "name of a phase",
        ),
        (
            {"phases": {"kind": "voronoi_grains", "fractions": {"quartz": 1.0}, "grain_size": 0.6e-3}},
            "less than two cells",
        ),
    ],
)
def test_what_is_refused(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        build(**keys)


def test_a_notch_of_no_length_is_refused() -> None:
    with pytest.raises(RuptfxError, match=r"mesh\.notches"):
        build(notches=[[0.0, 0.0, 0.0, 0.0]])
