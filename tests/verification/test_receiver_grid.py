"""Grids of receivers: every point is a receiver, and ParaView reads them as lines, surfaces and blocks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from helpers.small_cases import SPLIT, plates, strike_slip

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import simulate
from ruptfx.app.convert import vtk_files
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.results.analysis.ground_motion import speeds_of
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.recording.sampling import Samples

pytestmark = pytest.mark.fem

GRID = {"kind": "receiver_grid", "interval": 5e-7, "spacing": 2e-3}
GRIDS = [
    {**GRID, "name": "ground", "corner": [-4e-3, -2e-3, 0.0], "opposite": [4e-3, 2e-3, 0.0]},
    {**GRID, "name": "slice", "corner": [-3e-3, 1.3e-3, -6e-3], "opposite": [3e-3, 1.3e-3, 0.0],
     "fields": ["velocity", "stress"]},
    {**GRID, "name": "line", "corner": [-4e-3, 1e-3, -2e-3], "opposite": [4e-3, 1e-3, -2e-3]},
    {**GRID, "name": "block", "corner": [0.0, -2e-3, -4e-3], "opposite": [2e-3, 0.0, 0.0], "fields": ["displacement"]},
]  # fmt: skip
SINGLE = [
    {"kind": "receiver", "name": "middle", "interval": 5e-7, "point": [1e-3, 1.3e-3, -2e-3]},
    {"kind": "receiver", "name": "fault", "interval": 5e-7, "point": [2e-3, 0.0, -2e-3], "body": "plus"},
]


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("grids") / "run"
    case = parse_case(strike_slip({"order": 1, "instruments": [*GRIDS, *SINGLE], "output.figures": False}))
    with simulate(case, path, progress=False) as found:
        yield found


def at(data: Any, point: list[float]) -> int:
    """Return the number of a point of a grid."""
    (found,) = np.flatnonzero(np.all([np.isclose(data[axis], value, atol=1e-9)
                                      for axis, value in zip("xyz", point, strict=True)], axis=0))  # fmt: skip
    return int(found)


def test_every_point_is_a_receiver(record: Record) -> None:
    """Also on the fault, where the grid has the first body."""
    for name, single in (("slice", SINGLE[0]), ("block", SINGLE[1])):
        data, alone = record.instruments[name], record.instruments[single["name"]]
        column = at(data, single["point"])
        shared = [key for key in alone.data_vars if key in data]
        assert len(shared) == {"slice": 9, "block": 3}[name]
        for key in shared:
            largest = float(np.abs(data[key]).max())
            np.testing.assert_allclose(data[key][:, column], alone[key], rtol=0, atol=1e-14 * largest)
        assert float(np.abs(alone["velocity_x"]).max()) > 1e-3


def test_paraview_reads_lines_surfaces_and_blocks(record: Record, tmp_path: Path) -> None:
    written = {path.name: path for path in vtk_files.whole(record, tmp_path)}
    sizes = {"ground": (9, 32e-6), "slice": (9, 36e-6), "line": (3, 8e-3), "block": (12, 16e-9)}
    for name, (kind, whole) in sizes.items():
        data = record.instruments[name]
        with h5py.File(written[f"{name}_grid.vtkhdf"]) as file:
            root = file["VTKHDF"]
            points = root["Points"][:]
            np.testing.assert_array_equal(points, np.stack([data.x, data.y, data.z], axis=1))
            assert set(root["Types"]) == {kind}
            corners = points[root["Connectivity"][:].reshape(len(root["Types"]), -1)]
            first = corners[:, 0]
            if kind == 3:
                parts = np.linalg.norm(corners[:, 1] - first, axis=1)
            elif kind == 9:
                parts = 0.5 * np.linalg.norm(np.cross(corners[:, 2] - first, corners[:, 3] - corners[:, 1]), axis=1)
            else:  # VTK's order: corners 1, 3 and 4 are next to corner 0
                edges = np.stack([corners[:, each] - first for each in (1, 3, 4)], axis=1)
                parts = np.abs(np.linalg.det(edges))
                np.testing.assert_allclose(corners[:, 6], first + edges.sum(axis=1))
            assert parts.sum() == pytest.approx(whole)
            np.testing.assert_array_equal(root["Steps/Values"], data.time)
            row = len(data.time) - 1
            begin = root["Steps/PointDataOffsets/" + ("displacement" if name == "block" else "velocity")][row]
            here = slice(begin, begin + len(points))
            if name == "block":
                np.testing.assert_array_equal(root["PointData/displacement"][here, 2], data.displacement_z[row])
            else:
                np.testing.assert_array_equal(root["PointData/velocity"][here, 1], data.velocity_y[row])
                np.testing.assert_array_equal(root["PointData/peak_speed"][here], speeds_of(data).max(axis=0))
            if name == "slice":
                np.testing.assert_array_equal(root["PointData/stress"][here, 5], data.stress_xz[row])


@pytest.mark.parametrize("changes, message", [
    ({"corner": [1e-3, 1e-3], "opposite": [20e-3, 1e-3]}, r"instruments\.0\.corner = .*\(0\.0124, 0\.001\) m"),
    ({"corner": [1e-3, 1e-3], "opposite": [9e-3, 3e-3], "spacing": 1e-6}, r"spacing = 1e-06 m: .* at most 100000"),
    ({"corner": [1e-3, 1e-3, 0.0], "opposite": [9e-3, 3e-3, 0.0]}, r"instruments\.0\.corner: 2 components"),
])  # fmt: skip
def test_refusals(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        table = plates({"faults.main.contact": SPLIT, "instruments": [{**GRID, "name": "grid", **changes}]})
        Samples(Model(parse_case(table)), 1e-8, lambda points: np.zeros((len(points), 3)))
