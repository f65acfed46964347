"""Files of stations, of which each becomes an instrument, and points that are moved to the surface."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.damaged import damaged
from helpers.messages import facts
from helpers.small_cases import plates, strike_slip

from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError
from ruptfx.readings.instruments._stations import read_stations

STATIONS = {"kind": "receiver", "name": "sta", "interval": 1e-6, "stations": "sta.csv", "fields": ["velocity"]}


def parsed(folder: Path, lines: str, solid: bool = True, **keys: Any) -> Case:
    (folder / "sta.csv").write_text(lines)
    make = strike_slip if solid else plates
    table = {key: value for key, value in {**STATIONS, **keys}.items() if value is not None}
    return parse_case(make({"instruments": [table]}), folder)


def test_every_station_is_an_instrument(tmp_path: Path) -> None:
    """Units of the header count; a name becomes one of a case; the resolved case needs no file."""
    lines = "# network CI\nname, x (mm), y (mm), z (mm)\nCI.PAS, 1, 2, 0\n7-b, -1, 0.5, -2\n"
    case = parsed(tmp_path, lines)
    entries = [each.model_dump(exclude_defaults=True) for each in case.instruments]
    assert [each["name"] for each in entries] == ["sta_CI_PAS", "sta_7_b"]
    assert [each["point"] for each in entries] == [pytest.approx([1e-3, 2e-3, 0]), pytest.approx([-1e-3, 5e-4, -2e-3])]
    assert all(each["fields"] == ["velocity"] and "stations" not in each for each in entries)
    on_fault = parsed(tmp_path, "name,x,y,z\na,1e-3,0,-1e-3\n", kind="fault_receiver", fields=None)
    assert on_fault.instruments[0].kind() == "fault_receiver"


def test_stations_without_a_height_are_on_the_surface(tmp_path: Path) -> None:
    case = parsed(tmp_path, "station x y\nA 1e-3 2e-3\n")
    assert case.instruments[0].model_dump()["on_surface"] is True
    flat = parsed(tmp_path, "id;x [mm]\nA;5\n", solid=False)
    assert flat.instruments[0].model_dump()["point"] == [5e-3, 0.0]


def test_stations_on_a_map(tmp_path: Path) -> None:
    """10 km to the south of the origin; x points to the south, so that y is to the east."""
    (tmp_path / "a.csv").write_text("name,easting (km),northing (km)\nA,402,3790\n")
    from ruptfx.input.map_frame import MapFrame

    (station,) = read_stations(tmp_path / "a.csv", MapFrame(origin=[4e5, 3.8e6], azimuth=180.0), 3)
    assert station.point == pytest.approx([1e4, 2e3, 0.0]) and not station.has_height
    pytest.importorskip("pyproj")
    (tmp_path / "b.csv").write_text("code,lon (deg),lat (deg),elevation (m)\nB,-117,35,20\n")
    (station,) = read_stations(tmp_path / "b.csv", MapFrame(origin=[-117.0, 34.9], projection="EPSG:32611"), 3)
    assert station.point == pytest.approx([0.0, 0.9996 * 11092.5, 20.0], abs=2.0)


WRONG: list[tuple[str, dict[str, Any], str]] = [
    ("name,x,y\nA,1,2\nA,2,2\n", {}, r"instruments\.0\.stations: line 3 of .*sta\.csv: .*A"),
    ("x,y,z\n1,2,3\n", {}, r"sta\.csv: .*no column name; .*it has: x, y, z"),
    ("name,x,y,z\n", {}, r"sta\.csv: has no stations"),
    ("name\tx\ty\t\n", {}, r"sta\.csv"),
    ("name,x\nA,1\n", {}, r"sta\.csv: .*no column y"),
    ("name,x,y\nA,1,b\n", {}, r"line 2 of .*sta\.csv.*'b'"),
    ("name,x (s),y\nA,1,2\n", {}, r"line 1 of .*sta\.csv, column 'x \(s\)': "),
    ("name,x,y\nA,1,2\n", {"point": [0.0, 0.0, 0.0]}, r"point = \[0\.0, 0\.0, 0\.0\]: .*stations"),
    ("name,x,y\nA,1,2\n", {"kind": "fault_receiver", "fields": None}, r"sta\.csv: .*fault_receiver .*xyz"),
    ("name,x,y\nA,1,2\n", {"map": {"origin": [0.0]}}, r"instruments\.0\.stations: .*origin"),
]  # fmt: skip


@pytest.mark.parametrize("lines, keys, message", WRONG)
def test_files_that_are_refused(lines: str, keys: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        parsed(tmp_path, lines, **keys)


@pytest.mark.parametrize("header, row", [
    ("name, x (mm), y (mm), z (mm)", "S{0}, {0}.5, -{0}e-1, -2"), ("station\teasting\tnorthing", "S{0}\t40{0}\t3790"),
    ("id;lon;lat;elevation (m)", '"CI.{0}";-117,{0};35,0{0};20,5'),
])  # fmt: skip
def test_damaged_files_are_read_or_refused(header: str, row: str, tmp_path: Path) -> None:
    """500 files with wrong bytes, or cut off: read, or refused with the name of the file, and no other error."""
    whole = "\n".join([header, *(row.format(number) for number in range(6)), ""]).encode()
    path, count = tmp_path / "wrong.csv", 0
    for content in damaged(whole, 500, 4, seed=9):
        path.write_bytes(content)
        try:
            stations = read_stations(path, None, 3)
            assert all(re.fullmatch(r"\w*", each.name, re.A) and np.isfinite(each.point).all() for each in stations)
            count += content == whole
        except (CaseError, ValueError) as error:
            assert content != whole and "wrong.csv" in str(error), error
    assert count > 30


def test_a_kind_without_a_point_has_no_stations(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=facts(r"unknown key 'stations'")):
        parsed(tmp_path, "name,x\nA,1\n", solid=False, kind="strain_gauge", fields=None)


HILL = {"kind": "gaussian", "background": 0.0, "amplitude": 1e-3, "center": {"x": 1e-3, "y": 1e-3}, "width": 3e-3}


@pytest.mark.fem
@pytest.mark.parametrize("topography", [0.0, HILL], ids=["flat", "hill"])
def test_points_above_the_surface_are_moved_to_it(topography: Any) -> None:
    """By half an element at most, with a note in every channel; from any height with `on_surface`."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.cost import measured
    from ruptfx.run.model import Model

    size = strike_slip()["mesh"]["element_size"]

    def channels(point: list[float], **keys: Any) -> list[Any]:
        table = {"kind": "receiver", "name": "a", "interval": 1e-6, "point": point, "fields": ["displacement"], **keys}
        model = Model(parse_case(strike_slip({"mesh.topography": topography, "instruments": [table]})))
        ((_, result),) = measured(model, 1e-7)
        shares = [share for channel in result for share in channel.shares]
        for share in shares:  # the shape functions give back a linear field at the point
            field = model.coordinates[share.places // 3] @ [0.3, -0.7, 1.1]
            values.append(float(field @ share.weights))
        return result

    values: list[float] = []
    x, y, surface = 0.7e-3, 1.3e-3, 0.0
    top = 0.0 if topography == 0.0 else None
    for keys, z in (({"on_surface": True}, -5e-3), ({"on_surface": True}, 4e-3), ({}, None)):
        if z is None:
            z = surface + 0.4 * size
        values.clear()
        result = channels([x, y, z], **keys)
        heights = (np.array(values) - 0.3 * x + 0.7 * y) / 1.1
        surface = heights[0]
        assert heights == pytest.approx(surface if top is None else top, abs=1e-8 * size)
        assert all("surface" in channel.long_name for channel in result)
    if top is None:  # bilinear facets between vertices on the hill
        exact = 1e-3 * np.exp(-0.5 * ((x - 1e-3) ** 2 + (y - 1e-3) ** 2) / 9e-6)
        assert surface == pytest.approx(exact, rel=0.05)
    with pytest.raises(CaseError, match=facts(r"instruments\.0\.point = .*is not inside")):
        channels([x, y, surface + 0.6 * size])
    assert all("surface" not in channel.long_name for channel in channels([x, y, surface - 1e-4]))
