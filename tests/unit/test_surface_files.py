"""Grids of a surface in CSV and NetCDF files: units, any order of lines, refusals with file, place and remedy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from helpers.small_cases import strike_slip

from ruptfx import RuptfxError
from ruptfx.case import parse_case
from ruptfx.input.profiles.surface_table import SurfaceTable
from ruptfx.input.schema import CaseError

xarray = pytest.importorskip("xarray")

# Strike -2 and 3 km, dip 0, 1 and 4 km; values in MPa.
LINES = ["3, 0, 2", "-2, 0, 1", "-2, 4, 5", "3, 4, 6", "-2, 1, 3", "3, 1, 4"]
HEADER = "strike (km), dip (km), shear (MPa)"
POINTS = np.array([[-2e3, 0.0], [3e3, 4e3], [0.5e3, 1e3], [0.5e3, 2.5e3]])
VALUES = np.array([1.0, 6.0, 3.5, 4.5]) * 1e6
"""Corners, the mean of 3 and 4, and the mean of 3, 4, 5 and 6."""


def shear_of(table: dict[str, Any], directory: Path) -> SurfaceTable:
    case = parse_case(strike_slip({"faults.main.initial_stress.shear": {"kind": "surface_table", **table}}), directory)
    shear = case.faults["main"].initial_stress.shear
    assert isinstance(shear, SurfaceTable)
    return shear


def dataset(**changes: Any) -> Any:
    """The grid of `LINES` in other units and another order of the axes."""
    given = {
        "dims": ("strike", "dip"), "strike": [3.0, -2.0], "dip": [0.0, 1e3, 4e3], "units": "kPa",
        "values": [[2e3, 4e3, 6e3], [1e3, 3e3, 5e3]], **changes,
    }  # fmt: skip
    coords = {"strike": ("strike", given["strike"], {"units": "km"}), "dip": ("dip", given["dip"], {"units": "m"})}
    attributes = {"units": given["units"]} if given["units"] else {}
    return xarray.Dataset({"shear": (given["dims"], given["values"], attributes)}, coords)


def test_columns_of_a_text_file_have_the_units_of_the_header(tmp_path: Path) -> None:
    """Lines in any order; the resolved case holds numbers in SI units, and no file."""
    (tmp_path / "s.csv").write_text("\n".join(["# drawn by hand", HEADER, *LINES]), encoding="utf-8")
    shear = shear_of({"file": "s.csv"}, tmp_path)
    assert (shear.strike, shear.dip, shear.file) == ([-2e3, 3e3], [0.0, 1e3, 4e3], None)
    np.testing.assert_array_equal(shear.over(POINTS), VALUES)
    # Without a header: m and the unit of the key.
    (tmp_path / "plain.csv").write_text("\n".join(LINES).replace(",", ";"), encoding="utf-8")
    plain = shear_of({"file": "plain.csv"}, tmp_path)
    np.testing.assert_array_equal(plain.over(POINTS / 1e3), VALUES / 1e6)


def test_variables_of_a_netcdf_file_have_the_units_of_their_attributes(tmp_path: Path) -> None:
    dataset().to_netcdf(tmp_path / "s.nc", engine="h5netcdf")
    shear = shear_of({"file": "s.nc"}, tmp_path)
    assert (shear.strike, shear.file, shear.variable) == ([-2e3, 3e3], None, None)
    np.testing.assert_allclose(shear.over(POINTS), VALUES, rtol=1e-15)
    two = dataset()
    two["twice"] = 2 * two["shear"]
    two["twice"].attrs = {}  # values are in the unit of the key
    two.to_netcdf(tmp_path / "two.nc", engine="h5netcdf")
    np.testing.assert_allclose(shear_of({"file": "two.nc", "variable": "shear"}, tmp_path).over(POINTS), VALUES)
    np.testing.assert_allclose(
        shear_of({"file": "two.nc", "variable": "twice"}, tmp_path).over(POINTS), 2 * VALUES / 1e3
    )
    with pytest.raises(CaseError, match=facts(r"two\.nc: give variable, one of shear, twice")):
        shear_of({"file": "two.nc"}, tmp_path)
    with pytest.raises(CaseError, match=facts(r"two\.nc: no variable 'normal'; .* one of shear, twice")):
        shear_of({"file": "two.nc", "variable": "normal"}, tmp_path)


def test_a_table_in_python_reads_the_file(tmp_path: Path) -> None:
    """Without a key the unit of the header gives SI numbers."""
    file = tmp_path / "s.csv"
    file.write_text("\n".join([HEADER, *LINES]), encoding="utf-8")
    np.testing.assert_array_equal(SurfaceTable(file=str(file)).over(POINTS), VALUES)


@pytest.mark.parametrize("lines, message", [
    ([HEADER, *LINES, LINES[2]], r"line 8 of .*s\.csv: .*strike = -2000 m, dip = 4000 m .*twice; remove"),
    ([HEADER, *LINES[:-1]], r"s\.csv: no value at strike = 3000 m, dip = 1000 m; .*2 x 3"),
    (["x (km), y (km), h (MPa)", *LINES, LINES[2]], r"line 8 of .*s\.csv: .*x = -2000 m, y = 4000 m .*twice; remove"),
    (["Easting (m), Northing (m), h (MPa)", *LINES[:-1]], r"no value at Easting = 3 m, Northing = 1 m; .*2 x 3"),
    ([HEADER, "0, 0, 1", "1, 0, 1"], r"s\.csv: at least two positions .*found 2 and 1"),
    ([HEADER], r"line 1 of .*s\.csv: 'strike \(km\)' is no number"),
    ([HEADER, "0, 0"], r"line 2 of .*s\.csv: 2 cells under 3 names in line 1"),
    ([HEADER, "0, 0, nan"], r"line 2 of .*s\.csv: 'nan' must be a finite number"),
    (["dip (km), strike (km), shear (MPa)", *LINES], r"line 1 of .*s\.csv: column 1 is dip; order them"),
    (["strike (km), dip (km), shear (m)", *LINES], r"line 1 of .*s\.csv, column 3.*in Pa is wanted"),
])  # fmt: skip
def test_text_files_that_are_no_grid_are_refused(lines: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(CaseError, match=facts(rf"initial_stress\.shear: .*{message}")):
        shear_of({"file": "s.csv"}, tmp_path)


@pytest.mark.parametrize("changes, message", [
    ({"units": "m"}, r"'shear' has units = 'm': .*Pa is wanted"),
    ({"strike": [3.0, 3.0]}, r"strike needs two positions or more, each given once"),
    ({"values": [[2e3, np.nan, 6e3], [1e3, 3e3, 5e3]]}, r"'shear' has values that are missing .*fill them"),
    ({"dims": ("strike", "depth")}, r"'shear' has the axes strike, depth; give it strike and dip"),
])  # fmt: skip
def test_netcdf_files_that_are_no_grid_are_refused(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    dataset(**changes).to_netcdf(tmp_path / "s.nc", engine="h5netcdf")
    with pytest.raises(CaseError, match=facts(rf"initial_stress\.shear: .*s\.nc: {message}")):
        shear_of({"file": "s.nc"}, tmp_path)


@pytest.mark.parametrize("table, message", [
    ({"file": "absent.csv"}, r"absent\.csv: cannot be read"),
    ({"file": "absent.nc"}, r"absent\.nc: cannot be read as NetCDF"),
    ({"file": "s.csv", "variable": "shear"}, r"variable = 'shear': only NetCDF files"),
    ({"file": "s.csv", "strike": [0.0, 1.0]}, r"give either a file, or strike, dip and values"),
    ({"variable": "shear", "strike": [0.0, 1.0], "dip": [0.0, 1.0], "values": [[0, 1], [2, 3]]},
     r"variable = 'shear': belongs to a file"),
    ({}, r"shear\.strike = \[\]: positions must increase and be at least two"),
])  # fmt: skip
def test_keys_that_do_not_go_together_are_refused(table: dict[str, Any], message: str, tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("\n".join([HEADER, *LINES]), encoding="utf-8")
    with pytest.raises(RuptfxError, match=facts(rf"initial_stress\.{message}" if table == {} else message)):
        shear_of(table, tmp_path)


def test_a_file_that_does_not_cover_the_fault_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    (tmp_path / "s.csv").write_text("\n".join([HEADER.replace("km", "mm"), *LINES]), encoding="utf-8")
    table = {"kind": "surface_table", "file": "s.csv"}
    case = parse_case(strike_slip({"faults.main.initial_stress.shear": table}), tmp_path)
    with pytest.raises(CaseError, match=facts(r"initial_stress\.shear: .*strike from -0\.002 to 0\.003 m.*add to")):
        Model(case)
