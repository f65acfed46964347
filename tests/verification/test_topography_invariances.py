"""A fault below a hill: translated, turned, in other units, and with the hill from a map whose axes are elsewhere."""

from __future__ import annotations

import copy
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.moved_cases import moved, placed
from helpers.run_data import Data, Run, differences, read
from helpers.scaled_cases import mapped, unit_factor
from helpers.small_cases import strike_slip

from ruptfx.bodies.meshes.box_with_fault import BoxWithFault
from ruptfx.input.quantities import factor

pytest.importorskip("dolfinx")

from ruptfx.case import Case, parse_case
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

HILL = {"kind": "gaussian", "background": 0.0, "amplitude": 1e-3, "center": {"x": 1e-3, "y": 1e-3}, "width": 3e-3}
CASE = strike_slip({
    "order": 1, "duration": 1.5e-6, "mesh.topography": HILL, "mesh.fault_left": -6e-3,
    "faults.main.initial_stress.shear": 3.7e6, "stepper": {"kind": "leapfrog", "time_step": 1e-7},
})  # fmt: skip
CASE.pop("positions")


def run(table: dict[str, Any], out: Path) -> Run:
    case = parse_case(copy.deepcopy(table))
    assert isinstance(case, Case)
    simulate(case, out, progress=False)
    return read(out, "solid")


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run(CASE, tmp_path_factory.mktemp("hill") / "run")


def test_the_hill_changes_the_run(original: Run, tmp_path: Path) -> None:
    """Else the other tests would say nothing of it."""
    flat = run({**CASE, "mesh": {**CASE["mesh"], "topography": 0.0}}, tmp_path / "run")
    assert len(list(differences(original, flat, 1e-4))) > 10


@pytest.mark.parametrize("turn, offset", [
    ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [3e-3, -2e-3, 0]), ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0, 0, 0]),
])  # fmt: skip
def test_a_hill_and_its_fault_elsewhere(turn: Any, offset: Any, original: Run, tmp_path: Path) -> None:
    matrix, shift, still = np.array(turn, dtype=float), np.array(offset, dtype=float), np.zeros(3)
    actual = placed(run(moved(CASE, matrix, shift), tmp_path / "run"), np.eye(3), -shift)
    lines = list(differences(placed(original, matrix, still), actual, 1e-8))
    assert not lines, "\n".join(lines)


def test_a_hill_and_its_fault_further_along_x(original: Run, tmp_path: Path) -> None:
    """By their keys."""
    mesh = CASE["mesh"] | {"fault_left": -4e-3, "topography": HILL | {"center": {"x": 3e-3, "y": 1e-3}}}
    shift = np.array([2e-3, 0.0, 0.0])
    actual = placed(run({**CASE, "mesh": mesh}, tmp_path / "run"), np.eye(3), -shift)
    lines = list(differences(placed(original, np.eye(3), np.zeros(3)), actual, 1e-8))
    assert not lines, "\n".join(lines)


def as_text(number: float, unit: str, allowed: bool) -> object:
    """Return a number in another unit."""
    other = {"m": "mm", "s": "ms", "Pa": "kPa", "kg/m3": "g/m3"}.get(unit)
    if not allowed or other is None:
        return number
    ratio = factor(other, unit)
    return f"{Decimal(repr(number)) * ratio.denominator / ratio.numerator} {other}"


SIZES = {"m": 8.0, "s": 2.0, "kg": 3.0}
UNITS: dict[str, tuple[Callable[[float, str, bool], object], dict[str, float], float]] = {
    "text": (as_text, {}, 0.0),
    "scaled": (lambda number, unit, _: number * unit_factor(unit, SIZES), SIZES, 1e-8),
}


@pytest.mark.parametrize("name", UNITS)
def test_a_hill_in_other_units(name: str, original: Run, tmp_path: Path) -> None:
    change, sizes, tolerance = UNITS[name]
    changed = mapped(CASE, change)
    assert changed["mesh"]["topography"]["amplitude"] in ("1.000 mm", "1.0 mm", "1 mm", 8e-3)
    expected = {
        key: Data(np.asarray(data.values, float) * unit_factor(data.unit, sizes), data.unit)
        if data.unit is not None and not isinstance(data.values, str | None | bool) else data
        for key, data in original.items()
    }  # fmt: skip
    ignored = ("magnitude", "aseismic_share", "b_value", "not_resolved")
    lines = list(differences(expected, run(changed, tmp_path / "run"), tolerance, lambda each: each.endswith(ignored)))
    assert not lines, "\n".join(lines)


@pytest.mark.parametrize("azimuth", [90.0, 0.0, 270.0])
def test_a_map_elsewhere_with_other_axes(azimuth: float, tmp_path: Path) -> None:
    """Heights at eastings and northings; x of the model is to the east, to the north or to the west."""
    grid = np.linspace(-20e-3, 20e-3, 21)
    x, y = np.meshgrid(grid, grid, indexing="ij")
    height = 1e-3 * np.cos(300 * x) * np.cos(200 * y + 1) + 0.02 * x
    angle = np.deg2rad(azimuth)
    east, north = np.round([np.sin(angle), np.cos(angle)])
    lines = [f"{4e5 + a * east - b * north},{3.8e6 + a * north + b * east},{h}"
             for a, b, h in zip(x.ravel(), y.ravel(), height.ravel(), strict=True)]  # fmt: skip
    (tmp_path / "map.csv").write_text("\n".join(["easting (m),northing (m),height (m)", *lines]))
    plain = {"kind": "surface_table", "strike": grid.tolist(), "dip": grid.tolist(), "values": height.T.tolist()}
    map_frame = {"origin": [4e5, 3.8e6], "azimuth": azimuth}
    box = {key: value for key, value in CASE["mesh"].items() if key not in ("kind", "topography")}
    meshes = [
        BoxWithFault.model_validate({**box, "topography": each}, context={"directory": tmp_path}).build()
        for each in (plain, {"kind": "surface_table", "file": "map.csv", "map": map_frame})
    ]
    assert np.ptp(meshes[0].points[np.unique(meshes[0].edges["plus.top"]), 2]) > 1e-3
    np.testing.assert_allclose(meshes[1].points, meshes[0].points, rtol=0, atol=1e-9)
