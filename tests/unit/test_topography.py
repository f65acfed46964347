"""Topography of boxes, and height maps from files on the coordinates of a map."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.damaged import damaged
from helpers.messages import facts
from helpers.small_cases import strike_slip
from PIL import Image, TiffImagePlugin
from pydantic import ValidationError

from ruptfx.bodies.meshes.box_with_fault import BoxWithFault
from ruptfx.input.map_frame import MapFrame
from ruptfx.input.profiles.surface_table import SurfaceTable
from ruptfx.input.schema import CaseError

BOX = {key: value for key, value in strike_slip()["mesh"].items() if key != "kind"}
WAVES = {
    "kind": "sum", "terms": [
        {"kind": "sinusoid", "amplitude": 4e-4, "wavelength": 9e-3},
        {"kind": "along_dip", "profile": {"kind": "sinusoid", "amplitude": 3e-4, "wavelength": 8e-3}},
    ]
}  # fmt: skip


def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 4e-4 * np.cos(2 * np.pi * x / 9e-3) + 3e-4 * np.cos(2 * np.pi * y / 8e-3)


def box(**changes: Any) -> BoxWithFault:
    return BoxWithFault.model_validate(BOX | changes)


@pytest.mark.parametrize("dip", [90.0, 60.0, 35.0])
def test_the_surface_is_the_topography(dip: float) -> None:
    """Fault and sides stay in their planes, the bottom at its depth, and elements the right way round."""
    flat, raw = (box(dip=dip, topography=each).build() for each in (0.0, WAVES))
    assert np.array_equal(raw.cells, flat.cells)
    top = np.unique(np.concatenate([raw.edges["plus.top"], raw.edges["minus.top"]]))
    assert np.ptp(raw.points[top, 2]) > 1e-3
    assert raw.points[top, 2] == pytest.approx(height(*raw.points[top, :2].T), abs=1e-13)
    fault = np.unique(np.concatenate(raw.interfaces["main"]))
    cotangent = 1 / np.tan(np.deg2rad(dip)) if dip < 90 else 0.0
    across = raw.points[:, 1] + cotangent * raw.points[:, 2]
    assert across[fault] == pytest.approx(0.0, abs=1e-15)
    assert across == pytest.approx(flat.points[:, 1] + cotangent * flat.points[:, 2], abs=1e-15)
    assert np.array_equal(raw.points[:, 0], flat.points[:, 0])
    bottom = raw.edges["plus.bottom"]
    assert np.array_equal(raw.points[bottom], flat.points[bottom])
    corners = raw.points[raw.cells]
    assert np.linalg.det(corners[:, [1, 2, 4]] - corners[:, :1]).min() > 0
    column = np.flatnonzero((flat.points[:, 0] == flat.points[top[0], 0]) & (across == across[top[0]]))
    rise = (raw.points - flat.points)[column, 2]  # less and less in proportion to the height over the bottom
    share = 1 - flat.points[column, 2] / flat.points[:, 2].min()
    assert rise == pytest.approx(share * raw.points[top[0], 2], abs=1e-15)


def rows(**changes: Any) -> dict[str, Any]:
    """A height of 1 mm over a square around the box, or other values."""
    return {"kind": "surface_table", "strike": [-1.0, 1.0], "dip": [-1.0, 1.0], "values": [[1e-3] * 2] * 2} | changes


def plane(rise: float, axis: int) -> dict[str, Any]:
    return rows(values=[[-rise, rise]] * 2 if axis == 0 else [[-rise] * 2, [rise] * 2])


STEP = rows(strike=[-1.0, -1e-3, 1e-3, 1.0], values=[[-1.1e-3, -1.1e-3, 1.1e-3, 1.1e-3]] * 2)
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"half": True, "topography": WAVES}, "half = true: .* topography"),
    ({"height": WAVES, "topography": WAVES}, "height: .* topography"),
    ({"topography": plane(1.1, 0)}, r"mesh\.topography: .* 0\.3 .*beyond .*"),
    ({"topography": rows(strike=[-1e-4, 1e-4])}, r"mesh\.topography: .*strike from -0\.0001 to 0\.0001 m"),
    ({"topography": STEP}, r"mesh\.topography: .* 1\.1 .*x = .*, more than 1"),
    ({"dip": 45.0, "topography": plane(0.55, 1)}, r"mesh\.topography: .* 0\.55 .*y = .*, more than 0\.5, .* 45 deg"),
]  # fmt: skip


@pytest.mark.parametrize("changes, message", REFUSED)
def test_topography_that_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises((CaseError, ValueError), match=facts(message)):
        box(**changes).build()


def test_a_plane_just_below_the_limits_is_meshed() -> None:
    for dip, axis, rise in ((90.0, 0, 0.3), (45.0, 1, 0.3)):
        assert np.ptp(box(dip=dip, topography=plane(rise, axis)).build().points[:, 2]) > 0


def map_file(path: Path, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Write heights of 10 + x + 2 y over a grid in the format of the suffix; return them, shape (y, x)."""
    values = 10 + x[None] + 2 * y[:, None]
    if path.suffix == ".csv":
        lines = [f"{a},{b},{10 + a + 2 * b}" for a in x for b in y]
        path.write_text("\n".join(["x (m),y (m),height (m)", *lines]))
    elif path.suffix == ".nc":
        xarray = pytest.importorskip("xarray")
        data = xarray.Dataset({"height": (("y", "x"), values, {"units": "m"})}, {"x": x, "y": y})
        data.to_netcdf(path, engine="h5netcdf")
    else:
        geotiff(path, values, (x[0], y[-1]), x[1] - x[0], point=True)
    return values


def geotiff(
    path: Path, values: np.ndarray, corner: tuple[float, float], size: float, point: bool = False, model: int = 1,
    nodata: str = "",
) -> None:  # fmt: skip
    """Write an image whose first row is the northernmost, as tools for maps do."""
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[33550], tags[33922] = (size, size, 0.0), (0.0, 0.0, 0.0, *corner, 0.0)
    tags[34735] = (1, 1, 0, 2, 1024, 0, 1, model, 1025, 0, 1, 2 if point else 1)
    tags.tagtype |= {33550: 12, 33922: 12, 34735: 3}
    if nodata:
        tags[42113] = nodata
    Image.fromarray(np.ascontiguousarray(values[::-1]).astype(np.float32)).save(path, tiffinfo=tags)


@pytest.mark.parametrize("suffix", ["csv", "nc", "tif"])
def test_height_maps_of_every_format(suffix: str, tmp_path: Path) -> None:
    x, y = np.array([-4.0, -1.0, 2.0, 5.0]), np.array([-3.0, 0.0, 3.0])
    values = map_file(tmp_path / f"a.{suffix}", x, y)
    table = SurfaceTable.model_validate({"file": f"a.{suffix}"}, context={"directory": tmp_path})
    assert (table.strike, table.dip) == (x.tolist(), y.tolist())
    assert np.array_equal(table.values, values)


def test_pixels_of_images_are_areas_or_points(tmp_path: Path) -> None:
    """The corner of an area is half a pixel from its middle; integers are read as well."""
    values = np.arange(6.0).reshape(2, 3)
    geotiff(tmp_path / "a.tif", values, (100.0, 60.0), 20.0)
    table = SurfaceTable(file=str(tmp_path / "a.tif"))
    assert (table.strike, table.dip, table.values) == ([110, 130, 150], [30, 50], values.tolist())


WRONG: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({"nodata": "3"}, {}, r"a\.tif: 1 "),
    ({"model": 2}, {}, r"a\.tif: .*map = \{ origin = .*projection"),
    ({}, {"map": {"origin": [0.0, 0.0], "projection": "EPSG:32611"}}, r"a\.tif: .*projection"),
]  # fmt: skip


@pytest.mark.parametrize("keys, table, message", WRONG)
def test_images_that_are_refused(keys: dict[str, Any], table: dict[str, Any], message: str, tmp_path: Path) -> None:
    geotiff(tmp_path / "a.tif", np.arange(6.0).reshape(2, 3), (0.0, 0.0), 1.0, **keys)
    with pytest.raises((CaseError, ValueError), match=facts(message)):
        SurfaceTable.model_validate({"file": "a.tif", **table}, context={"directory": tmp_path})


def test_points_on_a_map_are_named_in_degrees(tmp_path: Path) -> None:
    lines = ["lon,lat,height (m)", "-117,35,1", "-117,36,1", "-116,35,1"]
    frame = {"origin": [-117.0, 35.0], "projection": "EPSG:32611"}
    for header, names in ((lines[0], ("lon", "lat")), ("# no header", ("longitude", "latitude"))):
        (tmp_path / "a.csv").write_text("\n".join([header, *lines[1:]]))
        with pytest.raises(
            ValidationError, match=facts(rf"no value at {names[0]} = -116 degrees, {names[1]} = 36 degrees")
        ):
            SurfaceTable.model_validate({"file": "a.csv", "map": frame}, context={"directory": tmp_path})


def test_damaged_height_maps_are_read_or_refused(tmp_path: Path) -> None:
    """500 images with wrong bytes, or cut off: read, or refused with the name of the file, and no other error."""
    geotiff(tmp_path / "whole.tif", np.arange(42.0).reshape(6, 7), (0.0, 0.0), 1.0)
    whole, path, count = (tmp_path / "whole.tif").read_bytes(), tmp_path / "wrong.tif", 0
    for content in damaged(whole, 500, 4, seed=8):
        path.write_bytes(content)
        try:
            table = SurfaceTable.model_validate({"file": path.name}, context={"directory": tmp_path})
            assert np.isfinite(table.values).all() and len(table.strike) > 1
            count += content == whole
        except (CaseError, ValidationError) as error:
            assert content != whole
            assert "wrong.tif" in str(error) or "positions must increase" in str(error), error
    assert count > 30


@pytest.mark.parametrize("content", [b"", b"II*\0", bytes(range(256))])
def test_damaged_images(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(CaseError, match=facts(r"a\.tif: .*TIFF")):
        SurfaceTable(file=str(tmp_path / "a.tif"))
    Image.fromarray(np.zeros((3, 3), np.float32)).save(tmp_path / "a.tif")
    with pytest.raises(CaseError, match=facts(r"a\.tif: .*ModelPixelScale .*ModelTiepoint")):
        SurfaceTable(file=str(tmp_path / "a.tif"))


@pytest.mark.parametrize("azimuth, x, y", [(90.0, [1, 0], [0, 1]), (0.0, [0, 1], [-1, 0]), (180.0, [0, -1], [1, 0])])
def test_axes_on_a_map(azimuth: float, x: list[float], y: list[float]) -> None:
    """x to the east, to the north and to the south; y is to the left of it."""
    frame = MapFrame(origin=[4e5, 3.8e6], azimuth=azimuth)
    there = frame.to_map(np.array([[1e3, 0.0], [0.0, 1e3]]))
    assert there - [4e5, 3.8e6] == pytest.approx(1e3 * np.array([x, y]))
    assert frame.to_model(there) == pytest.approx(np.array([[1e3, 0.0], [0.0, 1e3]]), abs=1e-8)


def test_longitude_and_latitude() -> None:
    """On the central meridian of zone 11, 117 degrees west, north is north and lengths are 0.9996 of those on the
    ground: a minute of latitude is 1849 m at 35 degrees."""
    pytest.importorskip("pyproj")
    frame = MapFrame(origin=[-117.0, 35.0], projection="EPSG:32611")
    (x, y), (east, north) = frame.to_model(np.array([[-117.0, 35 + 1 / 60], [-117 + 1 / 60, 35.0]]))
    assert (x, y) == pytest.approx((0.0, 0.9996 * 1849.0), abs=1.0)
    assert (east, north) == pytest.approx((0.9996 * 1521.8, 0.0), abs=1.0)
    assert frame.to_map(np.array([[x, y]])) == pytest.approx(np.array([[-117.0, 35 + 1 / 60]]), abs=1e-9)
    table = SurfaceTable.model_validate({
        "strike": [-117.1, -116.9], "dip": [34.9, 35.1], "values": [[0.0, 0.0], [200.0, 200.0]],
        "map": {"origin": [-117.0, 35.0], "projection": "EPSG:32611"},
    })  # fmt: skip
    assert table.over(np.array([[x, y], [0.0, 0.0]])) == pytest.approx([100 + 1e3 / 60, 100.0])
    for projection in ("EPSG:4326", "nowhere", "EPSG:2229"):  # degrees, no name, feet
        with pytest.raises(CaseError, match=facts(rf"projection = '{projection}': .*EPSG:32611")):
            MapFrame(origin=[-117.0, 35.0], projection=projection).to_model(np.zeros((1, 2)))
    with pytest.raises(CaseError, match=facts(r"origin = \[35\.0, -117\.0\]: .*-180 .*360.*-90 .*90")):
        MapFrame(origin=[35.0, -117.0], projection="EPSG:32611")


def test_without_pyproj_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyproj", None)
    frame = MapFrame(origin=[-117.0, 35.0], projection="EPSG:32611")
    with pytest.raises(CaseError, match=facts(r"projection = 'EPSG:32611' .*pip install 'ruptfx\[geo\]'")):
        frame.to_model(np.zeros((1, 2)))


@pytest.mark.parametrize("order", [1, 4])
def test_maps_end_at_a_concave_outline(order: int) -> None:
    """Rows of points below a valley, also of uneven nodes: the triangles cover the area under it, and none above."""
    from ruptfx.results.plots.surface_maps import triangulated

    ends = {1: [0.0, 1.0], 4: [0.0, 0.1727, 0.5, 0.8273, 1.0]}[order]
    x = np.unique(np.concatenate([i + np.array(ends) for i in range(16)]).round(6))
    rows = np.unique(np.concatenate([i + np.array(ends) for i in range(8)]).round(6)) / 8
    outline = 1.2 * np.cos(2 * np.pi * x / 16)
    points = np.stack([np.tile(x, len(rows)), np.concatenate([outline + (-8 - outline) * row for row in rows])])
    triangles = triangulated(*points)
    corners = points[:, triangles.get_masked_triangles()]
    a, b = corners[..., 1] - corners[..., 0], corners[..., 2] - corners[..., 0]
    area = 0.5 * np.abs(a[0] * b[1] - a[1] * b[0])
    middle = corners.mean(axis=2)
    above = middle[1] - np.interp(middle[0], x, outline)
    assert area.sum() == pytest.approx(8 * 16, rel=0.01)
    assert area[above > 0].sum() < 0.003 * 8 * 16
    assert triangles.mask.sum() > 10
