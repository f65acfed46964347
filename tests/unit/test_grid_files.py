"""Grids of bodies in NetCDF files: units of attributes, sizes, and damaged files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray
from helpers.damaged import damaged
from helpers.messages import facts
from helpers.small_cases import plates

from ruptfx import RuptfxError
from ruptfx.case import parse_case
from ruptfx.input.netcdf_units import read_grid

X, Y = np.array([0.0, 6.0, 12.0]), np.array([-4.0, 4.0])
POINTS = np.array([[1e-3, -2e-3], [11e-3, 3e-3]])
GRID = {"kind": "grid", "file": "m.nc", "variable": "rho"}


def written(path: Path, unit: str | None = "g/cm3", axis: str = "mm") -> Path:
    """Density 2.67 g/cm3 and 0.1 more for each mm, in a file with units."""
    values = 2.67 + 0.1 * X[:, None] + 0 * Y
    data = xarray.Dataset({"rho": (("x", "y"), values, {"units": unit} if unit else {})},
                          {"x": ("x", X, {"units": axis}), "y": ("y", Y, {"units": axis})})  # fmt: skip
    data.to_netcdf(path, engine="h5netcdf")
    return path


def density(folder: Path, **changes: Any) -> np.ndarray:
    case = parse_case(plates({"materials.default.density": {**GRID, **changes}}), folder)
    return case.materials["default"].values_at(POINTS)["density"]


@pytest.mark.parametrize("unit, scale", [("g/cm3", 1e3), ("g cm-3", 1e3), ("kg m^-3", 1.0), ("t/m3", 1e3), (None, 1.0)])
def test_units_of_values_and_axes_count(unit: str | None, scale: float, tmp_path: Path) -> None:
    written(tmp_path / "m.nc", unit)
    np.testing.assert_allclose(density(tmp_path), scale * (2.67 + 1e2 * POINTS[:, 0]), rtol=1e-12)


@pytest.mark.parametrize("unit, axis, words", [
    ("GPa", "mm", r"'rho' has units = 'GPa': .*kg/m3"), ("g/cm3", "degrees_east", r"'x' has units = 'degrees_east'"),
    ("g/cm3", "s", r"'x' has units = 's': .*m is wanted"), ("blob", "mm", r"'rho' has units = 'blob': .*kg/m3"),
])  # fmt: skip
def test_other_units_are_refused_when_the_case_is_read(unit: str, axis: str, words: str, tmp_path: Path) -> None:
    written(tmp_path / "m.nc", unit, axis)
    with pytest.raises(RuptfxError, match=facts(rf"materials\.default\.density: .*m\.nc: {words}")):
        density(tmp_path)


def test_a_file_that_changed_is_read_again(tmp_path: Path) -> None:
    for unit, scale in (("g/cm3", 1e3), ("kg/m3", 1.0)):
        written(tmp_path / "m.nc", unit)
        np.testing.assert_allclose(density(tmp_path), scale * (2.67 + 1e2 * POINTS[:, 0]), rtol=1e-12)


def empty(path: Path, shape: tuple[int, int], **sizes: int) -> None:
    """A small file with a compressed variable of which no value was written."""
    with h5py.File(path, "w") as file:
        for name, count in zip("xy", shape, strict=True):
            file.create_dataset(name, shape=(count,), dtype="f8", chunks=(min(count, 1000),), compression="gzip")
            file[name].make_scale(name)
        file.create_dataset("rho", shape=shape, dtype="f8", chunks=tuple(min(n, 1000) for n in shape),
                            compression="gzip", fillvalue=2670.0)  # fmt: skip
        for axis, name in enumerate("xy"):
            file["rho"].dims[axis].attach_scale(file[name])


@pytest.mark.parametrize("shape", [(200_000, 200_000), (200_000_000, 2)])
def test_many_values_are_refused_before_they_are_read(shape: tuple[int, int], tmp_path: Path) -> None:
    empty(tmp_path / "m.nc", shape)
    assert (tmp_path / "m.nc").stat().st_size < 5e6
    with pytest.raises(RuptfxError, match=facts(r"m\.nc: 'rho' has 4e\+\d+ values, .* 1e\+08")):
        density(tmp_path)


def test_pipes_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "m.nc")
    with pytest.raises(RuptfxError, match=facts(r"m\.nc: cannot be read: it is no regular file")):
        density(tmp_path)


def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    """500 files with wrong bytes, or cut off: no other error than that of a file which cannot be read.

    Those without damage are read, after whatever was wrong with the file before at the same path.
    """
    path, count = tmp_path / "wrong.nc", 0
    whole = written(tmp_path / "m.nc").read_bytes()
    for content in damaged(whole, 500, 3, seed=3):
        path.write_bytes(content)
        try:
            grid = read_grid(path, "rho", "xyz", "kg/m3")
        except ValueError as error:
            assert str(error).startswith(str(path)), error
            assert content != whole
        else:
            assert grid.values.shape == (3, 2)
            count += content == whole
    assert count > 50
