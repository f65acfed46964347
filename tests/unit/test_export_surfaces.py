"""Export and comparison of surfaces: other programs read what the record has, seen from the side that they want."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import tomli_w
import xarray
from helpers import synthetic
from helpers.labels import label_faults
from helpers.messages import facts, says
from helpers.small_cases import strike_slip
from matplotlib.image import imread
from typer.testing import CliRunner

from ruptfx import RuptfxError
from ruptfx.app.cli import app
from ruptfx.app.commands.compare import overlay_surfaces
from ruptfx.app.convert import scec_files, vtk_files
from ruptfx.interfaces.faults.interface import local_frame
from ruptfx.results.analysis.measured import compare_with_file
from ruptfx.results.analysis.surface import rupture_time_difference
from ruptfx.results.record import Record

RECEIVERS = [
    {"kind": "receiver", "name": "far", "interval": 3e-7, "point": [1e-3, 1.3e-3, -2e-3]},
    {"kind": "receiver", "name": "near", "interval": 3e-7, "point": [1e-3, -1.3e-3, -2e-3]},
    {"kind": "fault_receiver", "name": "fault", "interval": 3e-7, "point": [2.2e-3, 0.0, -3.1e-3]},
]


@pytest.mark.parametrize("structured", [True, False])
def test_vtkhdf_has_the_surface_and_fields_without_time(tmp_path: Path, structured: bool) -> None:
    with Record(synthetic.write_surface_run(tmp_path / "run", structured=structured)) as record:
        path, _ = vtk_files.whole(record, tmp_path)  # and its grid of receivers
        data = record.interface
        with h5py.File(path) as file:
            root = file["VTKHDF"]
            points, count = root["Points"][:], data.sizes["point"]
            np.testing.assert_array_equal(points, np.stack([data.x, data.y, data.z], axis=1))
            cells = root["Connectivity"][:].reshape(len(root["Types"]), -1)
            assert set(root["Types"]) == ({9} if structured else {1})
            if structured:  # quadrilaterals cover the surface, and run round their corners
                a, b, c, d = (points[cells[:, corner]] for corner in range(4))
                areas = 0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1)
                np.testing.assert_allclose(areas, 500.0**2)
                assert areas.sum() == pytest.approx(40e3 * 20e3)
            for row in (0, 17):
                begin = root["Steps/PointDataOffsets/rupture_time"][row]
                for name in ("rupture_time", "area", "peak_slip_rate", "dip"):
                    np.testing.assert_array_equal(root[f"PointData/{name}"][begin : begin + count], data[name])
                np.testing.assert_array_equal(root["PointData/slip_1"][begin : begin + count], data.slip_1[row])
            assert np.isfinite(data.rupture_time).any()


def surface(normal: np.ndarray, origin: np.ndarray) -> xarray.Dataset:
    """Points of a plane with a normal, with positions along both tangents."""
    _, first, second = local_frame(normal[None])[0]
    s, d = (each.ravel() for each in np.meshgrid(np.linspace(-3e3, 2e3, 6), np.linspace(0, 4e3, 5), indexing="ij"))
    points = origin + s[:, None] * first + d[:, None] * second
    return xarray.Dataset({key: ("point", values) for key, values in zip(
        ("position", "dip", "x", "y", "z"), (s, d, *points.T), strict=True)})  # fmt: skip


@pytest.mark.parametrize("dip", [90.0, 60.0, 30.0])
@pytest.mark.parametrize("toward", [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (-0.6, 0.8)])
@pytest.mark.parametrize("plus_is_above", [True, False])
def test_signs_do_not_depend_on_the_normal(dip: float, toward: tuple[float, float], plus_is_above: bool) -> None:
    """The block on the side towards which a fault dips moves 3 m down dip, and 2 m to the right of a viewer.

    Right-lateral slip is to the right of everybody who looks across the fault.
    """
    angle = np.deg2rad(dip)
    horizontal = np.array([*toward, 0.0])
    hanging = np.sin(angle) * horizontal + np.array([0, 0, np.cos(angle)])
    down = np.cos(angle) * horizontal - np.array([0, 0, np.sin(angle)])
    right = np.array([toward[1], -toward[0], 0.0])
    origin = 700.0 * horizontal  # of the trace at z = 0
    normal = hanging if plus_is_above else -hanging
    view = scec_files.View.of(surface(normal, origin), "main")
    slip_of_plus = (2.0 * right + 3.0 * down) * (1 if plus_is_above else -1)
    _, first, second = local_frame(normal[None])[0]
    found = view.turn @ [slip_of_plus @ first, slip_of_plus @ second]
    # Of a vertical fault the viewer may stand on the other side, from which the near block goes down.
    other_side = dip == 90 and view.away @ horizontal < 0
    np.testing.assert_allclose(found, [2.0, -3.0 if other_side else 3.0], atol=1e-9)
    side = -1 if other_side else 1
    np.testing.assert_allclose(view.away, side * horizontal, atol=1e-12)
    np.testing.assert_allclose(view.strike, side * right, atol=1e-12)
    off, along, depth = view.place(origin + 900.0 * right + 2e3 * down)
    assert (along, depth) == pytest.approx((side * 900.0, 2e3))
    assert off == pytest.approx(side * 2e3 * np.cos(angle), abs=1e-6)


def test_surfaces_without_strike_are_refused(tmp_path: Path) -> None:
    for data, message in (
        (surface(np.array([0.0, 0.0, 1.0]), np.zeros(3)), "is horizontal and has no strike; turn the mesh"),
        (xarray.Dataset({"position": ("position", np.zeros(3))}), "is a line"),
    ):
        with pytest.raises(RuptfxError, match=facts(message)):
            scec_files.View.of(data, "main")


def curved(normal: np.ndarray, origin: np.ndarray, height: float) -> xarray.Dataset:
    """The plane of `surface` with hills of a height, whose mean is zero, and with the areas and fields of a record."""
    data = surface(normal, origin)
    hills = height * np.cos(np.pi * (np.arange(30) // 5)) * np.cos(np.pi * np.arange(30) / 4)
    hills -= hills.mean()
    moved = {axis: ("point", data[axis].values + hills * part) for axis, part in zip("xyz", normal, strict=True)}
    times = {"area": ("point", np.full(30, 1e6)), "rupture_time": ("point", np.arange(30.0))}
    return data.assign(moved | times).assign_attrs(rupture_threshold=1e-3, apart=float(np.abs(hills).max()))


@pytest.mark.parametrize("normal", [(0.0, 1.0, 0.0), (-0.8, 0.6, 0.0), (0.0, np.sin(1.0), np.cos(1.0))])
@pytest.mark.parametrize("height", [5.0, 300.0])
def test_a_curved_fault_is_seen_along_the_axes_of_its_positions(normal: tuple[float, ...], height: float) -> None:
    direction = np.array(normal)
    across = np.array([*direction[:2], 0.0])
    origin = 1e3 * across / np.linalg.norm(across)
    data = curved(direction, origin, height)
    view, plane = (scec_files.View.of(each, "main") for each in (data, surface(direction, origin)))
    for name in ("strike", "down", "away", "turn"):
        np.testing.assert_allclose(getattr(view, name), getattr(plane, name), atol=1e-9, err_msg=name)
    assert (view.apart, plane.apart) == (pytest.approx(data.attrs["apart"], rel=1e-9), 0.0)
    assert view.trace == pytest.approx(plane.trace, rel=1e-9) and abs(plane.trace) == pytest.approx(1e3)
    # A plane through the origin within the hills is that of the positions.
    assert scec_files.View.of(curved(direction, 5e-4 * height * origin, height), "main").trace == 0.0


def station(count: int) -> xarray.Dataset:
    """A receiver in a body with different histories of all components."""
    values = {f"{field}_{axis}": ("time", np.arange(3.0) + 10 * n + m) for n, axis in enumerate("xyz")
              for m, field in enumerate(("displacement", "velocity")[:count])}  # fmt: skip
    return xarray.Dataset(values, {"time": [0.0, 0.5, 1.0]})


def written(record: SimpleNamespace, folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Return the files of an export by their names, and its notes."""
    notes: list[str] = []
    folder.mkdir()
    return {file.name: file for file in scec_files.files(record, folder, notes.append)}, notes


def test_what_can_be_written_is_written_and_the_others_are_named(tmp_path: Path) -> None:
    """Beside a curved fault a horizontal interface and a receiver that records its velocity only."""
    points = {"whole": [0.0, 3e3, 0.0], "half": [0.0, 6e3, 0.0]}
    record = SimpleNamespace(
        path=tmp_path, case={"instruments": [{"kind": "receiver", "name": name, "point": point}
                                             for name, point in points.items()]},
        interfaces={"sill": surface(np.array([0.0, 0.0, 1.0]), np.zeros(3)),
                    "main": curved(np.array([0.0, 1.0, 0.0]), np.zeros(3), 200.0)},
        instruments={"whole": station(2), "half": station(1)},
    )  # fmt: skip
    files, notes = written(record, tmp_path / "out")
    assert sorted(files) == ["body030st000dp000.txt", "main_rupture_time.txt"]
    assert len(notes) == 2 and "interface sill" in notes[0] and "instrument half" in notes[1]
    head, columns = read(files["main_rupture_time.txt"])
    assert f"{record.interfaces['main'].attrs['apart']:.4g} m" in head["fault_surface"]
    np.testing.assert_allclose(columns["j"], record.interfaces["main"].position)
    np.testing.assert_allclose(read(files["body030st000dp000.txt"])[1]["n-disp"], [10.0, 11.0, 12.0])


@pytest.mark.parametrize("names", [("main", "branch"), ("west", "east")])
def test_axes_of_stations_off_faults_do_not_depend_on_the_order(tmp_path: Path, names: tuple[str, str]) -> None:
    """A fault along x and a smaller one along y: stations have the axes of `main`, or of the larger one."""
    first, second = curved(np.array([0.0, 1.0, 0.0]), np.zeros(3), 0.0), curved(np.array([1.0, 0, 0]), np.zeros(3), 0.0)
    faults = {names[0]: first, names[1]: second.assign(area=0.9 * second.area)}
    instruments = [{"kind": "receiver", "name": "s", "point": [1e3, 3e3, 0.0]}]
    for number, order in enumerate((names, names[::-1])):
        record = SimpleNamespace(path=tmp_path, case={"instruments": instruments}, instruments={"s": station(2)},
                                 interfaces={name: faults[name] for name in order})  # fmt: skip
        files, _ = written(record, tmp_path / str(number))
        columns = read(files["body030st010dp000.txt"])[1]
        np.testing.assert_allclose(columns["h-disp"], [0.0, 1.0, 2.0])
        values, unit = scec_files.channels(record, "s")["h-disp"]
        np.testing.assert_allclose(values, columns["h-disp"])
        assert unit == "m"


def read(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Return the entries of the header and the columns of a file, as a reader of the community does."""
    lines = path.read_text().splitlines()
    head = dict(line[2:].split(" = ", 1) for line in lines if line.startswith("# ") and " = " in line)
    body = [line for line in lines if not line.startswith("#")]
    rows = np.array([line.split() for line in body[1:]], dtype=float)
    return head, dict(zip(body[0].split(), rows.T, strict=True))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small rupture with receivers."""
    pytest.importorskip("dolfinx")
    folder = tmp_path_factory.mktemp("surface")
    table = strike_slip({"duration": 3e-6, "instruments": RECEIVERS, "output.figures": False})
    (folder / "case.toml").write_text(tomli_w.dumps(table))
    result = CliRunner().invoke(app, ["run", str(folder / "case.toml"), "--out", str(folder / "run"), "--quiet"])
    assert result.exit_code == 0, result.output
    return folder / "run"


@pytest.mark.slow
@pytest.mark.fem
@pytest.mark.usefixtures("blank_pictures")
def test_scec_files_are_compared_with_the_run_that_wrote_them(run: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["export", str(run), "--format", "scec", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    with Record(run) as record:
        for name, fields in (("fault", scec_files.OF_FAULT), ("far", scec_files.OF_BODY)):
            pairs = compare_with_file(record, tmp_path / f"{name}.txt", name, more=partial(scec_files.channels, record))
            assert {column.field for column in fields} <= set(pairs)
            assert {pair.unit for pair in pairs.values()} == ({"m", "m/s", "MPa"} if name == "fault" else {"m", "m/s"})
            moving = {key: pair for key, pair in pairs.items() if pair.measured.any()}
            assert len(moving) >= 4 and all(pair.result.misfit < 1e-6 for pair in moving.values())
    picture = tmp_path / "a.png"
    command = ["compare", str(run), str(tmp_path / "fault.txt"), "--instrument", "fault", "--out", str(picture)]
    result = CliRunner(env={"COLUMNS": "200"}).invoke(app, command)
    assert result.exit_code == 0 and "h-slip-rate" in result.output and picture.is_file(), result.output


@pytest.mark.fem
def test_scec_files_are_the_record(run: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["export", str(run), "--format", "scec", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert not any(" -0.0000000E+00" in file.read_text() for file in tmp_path.iterdir())
    with Record(run) as record:
        fault, far, near = (record.instruments[name] for name in ("fault", "far", "near"))
        data = record.interface
        head, columns = read(tmp_path / "fault.txt")
        assert list(columns) == [
            "t", "h-slip", "h-slip-rate", "h-shear-stress", "v-slip", "v-slip-rate", "v-shear-stress", "n-stress",
        ]  # fmt: skip
        assert {"problem", "author", "date", "code", "code_version", "element_size", "location"} < head.keys()
        assert head["time_step"] == "3e-07 s" and int(head["num_time_steps"]) == len(fault.time) == len(columns["t"])
        assert head["location"] == "on fault, 2.2e-06 km along strike, 3.1e-06 km down-dip"
        for name, expected in {
            "t": fault.time, "h-slip": fault.slip_1, "v-slip-rate": fault.slip_rate_2,
            "h-shear-stress": fault.shear_traction_1 / 1e6, "n-stress": -fault.normal_stress / 1e6,
        }.items():  # fmt: skip
            np.testing.assert_allclose(columns[name], expected, rtol=1e-7, atol=1e-30, err_msg=name)
        assert columns["h-slip"][-1] > 0 and columns["n-stress"][0] == pytest.approx(-6.0, rel=0.1)
        head, columns = read(tmp_path / "far.txt")
        assert head["location"] == "1.3e-06 km off fault, 1e-06 km along strike, 2e-06 km depth"
        np.testing.assert_allclose(columns["v-vel"], -far.velocity_z, rtol=1e-7, atol=1e-30)
        np.testing.assert_allclose(columns["n-disp"], far.displacement_y, rtol=1e-7, atol=1e-30)
        _, other = read(tmp_path / "near.txt")
        np.testing.assert_allclose(other["h-disp"], near.displacement_x, rtol=1e-7, atol=1e-30)
        # The far side goes to the right, the near side to the left.
        assert columns["h-disp"][-1] > 0 > other["h-disp"][-1]
        head, columns = read(tmp_path / "main_rupture_time.txt")
        assert list(columns) == ["j", "k", "t"] and head["rupture"] == "slip rate above 0.001 m/s"
        np.testing.assert_allclose(columns["j"], data.x, atol=1e-12)
        np.testing.assert_allclose(columns["k"], -data.z, atol=1e-12)
        broken = np.isfinite(data.rupture_time.values)
        assert 0 < broken.sum() < len(broken) and set(columns["t"][~broken]) == {1e9}
        np.testing.assert_allclose(columns["t"][broken], data.rupture_time[broken], rtol=1e-7)


def test_every_column_of_a_series(tmp_path: Path) -> None:
    """Seen along +y on a plane y = 0 with z up: strike is x, down dip is -z, away is y; all histories differ."""
    t = np.arange(3.0)
    fault = {
        "slip_1": 1 + t,
        "slip_2": 2 + t,
        "slip_rate_1": 3 + t,
        "slip_rate_2": 4 + t,
        "shear_traction_1": 5e6 + 1e5 * t,
        "shear_traction_2": 6e6 + 1e5 * t,
        "normal_stress": 7e6 + 1e5 * t,
    }
    body = {f"{field}_{axis}": 10 * n + m + t for n, field in enumerate(("velocity", "displacement"), 1)
            for m, axis in enumerate("xyz")}  # fmt: skip
    with Record(synthetic.write_surface_run(tmp_path / "run")) as record:
        view = scec_files.View.of(record.interface, "main")
        table = {"name": "s", "point": [12e3, 0.0, -3e3]}
        files = [
            write(record, table, xarray.Dataset({name: ("time", each) for name, each in values.items()}, {"time": t}),
                  view, tmp_path)
            for write, values in ((scec_files._on_fault, fault), (scec_files._in_body, body))
        ]  # fmt: skip
    (_, on), (_, inside) = map(read, files)
    expected = {"t": t, "n-stress": -fault["normal_stress"] / 1e6}
    for number, name in enumerate("hv"):
        weights = [(view.turn @ unit)[number] for unit in ([1.0, 0.0], [0.0, 1.0])]
        for column, field, size in (("slip", "slip", 1.0), ("slip-rate", "slip_rate", 1.0),
                                    ("shear-stress", "shear_traction", 1e-6)):  # fmt: skip
            expected[f"{name}-{column}"] = size * sum(
                weight * fault[f"{field}_{k}"] for k, weight in enumerate(weights, 1)
            )  # fmt: skip
    assert set(on) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(on[name], values, rtol=1e-6, err_msg=name)
    moved = {"t": t}
    for name, direction in {"h": view.strike, "v": np.array([0.0, 0.0, -1.0]), "n": view.away}.items():
        for column, field in (("disp", "displacement"), ("vel", "velocity")):
            moved[f"{name}-{column}"] = sum(
                share * body[f"{field}_{axis}"] for share, axis in zip(direction, "xyz", strict=True)
            )  # fmt: skip
    assert set(inside) == set(moved)
    for name, values in moved.items():
        np.testing.assert_allclose(inside[name], values, rtol=1e-6, err_msg=name)


def test_names_of_files_are_positions_in_100_m() -> None:
    table = {"name": "station"}
    assert scec_files._file_name(table, {"faultst": -12e3, "dp": 3e3}) == "faultst-120dp030.txt"
    assert scec_files._file_name(table, {"body": 9e3, "st": 0.0, "dp": 0.0}) == "body090st000dp000.txt"
    assert scec_files._file_name(table, {"faultst": 40.0, "dp": 3e3}) == "station.txt"
    # Rounding of positions in a turned plane is no direction.
    assert scec_files._file_name(table, {"faultst": -1e-12, "dp": 3e3}) == "faultst000dp030.txt"
    assert scec_files._file_name(table, {"faultst": 0.0, "dp": 3e3}, {"faultst000dp030.txt"}) == "station.txt"


def test_receivers_of_two_faults_and_of_both_sides_have_files_of_their_own(tmp_path: Path) -> None:
    """Two faults that pass through the same point, and the two sides of one of them there."""
    path = synthetic.write_surface_run(tmp_path / "run")
    fields = [f"{field}_{number}" for field in ("slip", "slip_rate", "shear_traction") for number in (1, 2)]
    on_fault = [*fields, "normal_stress"]
    in_body = [f"{field}_{axis}" for field in ("velocity", "displacement") for axis in "xyz"]
    point = [0.0, 0.0, -3e3]
    tables = [
        {"kind": "fault_receiver", "name": "first", "point": point},
        {"kind": "fault_receiver", "name": "second", "point": point, "fault": "branch"},
        {"kind": "receiver", "name": "above", "point": point, "body": "plus"},
        {"kind": "receiver", "name": "below", "point": point, "body": "minus"},
    ]
    names = (on_fault, on_fault, in_body, in_body)
    with Record(path) as record:
        given = SimpleNamespace(
            path=path, case={"instruments": tables},
            interfaces={"main": record.interface, "branch": record.interface},
            instruments={
                table["name"]: xarray.Dataset(
                    {name: ("time", np.full(3, float(number))) for name in fields}, {"time": [0.0, 0.5, 1.0]}
                ) for number, (table, fields) in enumerate(zip(tables, names, strict=True))
            },
        )  # fmt: skip
        found = [file for file in scec_files.files(given, tmp_path) if "rupture_time" not in file.name]
    assert [file.name for file in found] == [
        "faultst000dp030.txt", "branchst000dp030.txt", "body000st000dp030.txt", "below.txt",
    ]  # fmt: skip
    for number, (file, column) in enumerate(zip(found, ("h-slip", "h-slip", "h-disp", "h-disp"), strict=True)):
        np.testing.assert_allclose(read(file)[1][column], number)


def test_series_of_rate_and_state_have_the_state_and_count_pressure(tmp_path: Path) -> None:
    path = synthetic.write_surface_run(tmp_path / "run")
    names = [f"{field}_{number}" for field in ("slip", "slip_rate", "shear_traction") for number in (1, 2)]
    values = {name: ("time", np.zeros(3)) for name in names}
    station = xarray.Dataset(
        {**values, "normal_stress": ("time", [120e6] * 3), "theta": ("time", [1e9, 1e3, 1.0])},
        {"time": [0.0, 0.5, 1.0]},
    )
    with Record(path) as record:
        view = scec_files.View.of(record.interface, "main")
        table = {"name": "s", "point": [12e3, 0.0, -3e3]}
        _, columns = read(scec_files._on_fault(record, table, station, view, tmp_path))
    assert len(columns) == 9 and (tmp_path / "faultst120dp030.txt").is_file()
    np.testing.assert_allclose(columns["log-theta"], [9.0, 3.0, 0.0])
    np.testing.assert_allclose(columns["n-stress"], 120.0)


def test_rupture_times_of_two_surfaces(tmp_path: Path) -> None:
    """Circles at 2.5 and 2 km/s: times differ by r / 10 km/s, at most at the far corners that both reach in 10 s."""
    one = synthetic.write_surface_run(tmp_path / "one", 2500.0)
    two = synthetic.write_surface_run(tmp_path / "two", 2000.0, structured=False)
    out = tmp_path / "both.png"
    result = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["compare", str(one), str(two), "--out", str(out)])
    assert result.exit_code == 0, result.output
    rms, largest = map(float, re.findall(r"([\d.e-]+) s \((?:RMS)\), ([\d.e-]+) s at most", result.output)[0])
    radius = np.hypot(*np.meshgrid(np.linspace(-20, 20, 401), np.linspace(-10, 10, 201)))
    inside = radius < 20.0
    assert rms == pytest.approx(np.sqrt(np.mean((radius[inside] / 10) ** 2)), rel=0.02)
    assert largest == pytest.approx(2.0, rel=0.03)
    assert imread(out).std() > 0.02
    with Record(one) as first, Record(two) as second:
        np.testing.assert_allclose(rupture_time_difference(first.interface, first.interface), 0.0, atol=1e-12)
        figure = overlay_surfaces(first, second)
        assert label_faults(figure) == []
        slip, rate = figure.axes[1:]
        assert "down dip" in slip.get_title() and len(rate.lines) == 2
        # 10 km down dip, through the middle: 10 s - |x| / speed.
        for line, speed in zip(slip.lines, (2.5, 2.0), strict=True):
            x, y = line.get_data()
            np.testing.assert_allclose(y, np.maximum(10 - np.abs(x) / speed, 0), atol=0.15)


def test_a_surface_and_a_line_are_not_compared(tmp_path: Path) -> None:
    time, position = synthetic.times(11), synthetic.points(10)
    flat = synthetic.write_run(tmp_path / "flat", synthetic.crack(time, position), time, position)
    solid = synthetic.write_surface_run(tmp_path / "solid")
    for pair in ((flat, solid), (solid, flat)):
        command = ["compare", *map(str, pair), "--out", str(tmp_path / "both.png")]
        result = CliRunner(env={"COLUMNS": "200"}).invoke(app, command)
        assert result.exit_code == 1 and says("compare runs of the same dimension", " ".join(result.output.split()))
