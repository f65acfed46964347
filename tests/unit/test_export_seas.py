"""Files of the SEAS code comparison: what they say of a run, and what their check refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from helpers import synthetic
from helpers.messages import facts
from typer.testing import CliRunner

from ruptfx import RuptfxError
from ruptfx.app.cli import app
from ruptfx.app.convert import seas_files

TIMES = [0.0, 3e7, 6e7]
NAMES = ("t", "slip", "slip_rate", "shear_stress", "state")


def line(plane: str, dip: float = 90.0, plus_is_above: bool = True) -> xarray.Dataset:
    """Points 1 km apart to 40 km down dip, whose position begins where their tangent does.

    At the distance d and the time t slip is t/30 m + 1e-4 d, its rate 1e-9 m/s, shear traction 25 MPa + 1 kPa d.
    """
    d = np.linspace(0.0, 40e3, 41)
    angle = np.deg2rad(dip)
    position = d if plus_is_above else 40e3 - d
    order = np.argsort(position)
    d = d[order]
    fields = {
        "slip": np.array(TIMES)[:, None] / 3e7 + 1e-4 * d, "slip_rate": np.full((3, 41), 1e-9),
        "shear_traction": np.broadcast_to(25e6 + 1e3 * d, (3, 41)), "normal_stress": np.full((3, 41), 50e6),
        "theta": np.full((3, 41), 8e6),
    }  # fmt: skip
    places = {"position": position[order], "x": d * np.cos(angle), "y": -d * np.sin(angle)}
    return xarray.Dataset(
        {name: (("time", "position"), values) for name, values in fields.items()}
        | {name: ("position", values) for name, values in places.items()}, {"time": TIMES}, {"plane": plane},
    )  # fmt: skip


def surface() -> xarray.Dataset:
    """Points 2 km apart along strike, -40 to 40 km, and down dip, 0 to 40 km; slip rates 1e-9 and 0 m/s.

    One point outside of the fault of 60 km slides at 1 m/s.
    """
    strike, dip = (each.ravel() for each in np.meshgrid(2e3 * np.arange(-20, 21), 2e3 * np.arange(21), indexing="ij"))
    count = len(strike)
    rate = np.full((3, count), 1e-9)
    rate[:, 0] = 1.0
    fields = {
        "slip_1": rate * np.array(TIMES)[:, None] + 1e-5 * strike, "slip_2": np.zeros((3, count)),
        "slip_rate_1": rate, "slip_rate_2": np.zeros((3, count)),
        "shear_traction_1": np.full((3, count), 20e6), "shear_traction_2": np.full((3, count), -1e6),
        "theta": np.full((3, count), 1e8),
    }  # fmt: skip
    of_points = {
        "position": strike, "dip": dip, "area": np.full(count, 4e6), "shear_modulus_11": np.full(count, 30e9),
        "shear_modulus_22": np.full(count, 30e9), "shear_modulus_12": np.zeros(count),
        "rupture_time": np.where(dip < 10e3, 12.5, np.nan),
    }  # fmt: skip
    return xarray.Dataset(
        {name: (("time", "point"), values) for name, values in fields.items()}
        | {name: ("point", values) for name, values in of_points.items()}, {"time": TIMES},
        {"plane": "solid", "rupture_threshold": 1e-3},
    )  # fmt: skip


def written(tmp_path: Path, data: xarray.Dataset, stations: list[tuple[float, ...]] | None = None) -> dict[str, Path]:
    mesh = {"element_size": 2e3, "along_strike": {"length": 60e3}}
    record = SimpleNamespace(path=tmp_path, case={"title": "BP", "mesh": mesh, "order": 2}, interfaces={"main": data})
    return {path.name: path for path in seas_files.files(record, tmp_path, stations=stations or [])}  # type: ignore[arg-type]


def rows(path: Path) -> np.ndarray:
    return np.array([each.split() for each in path.read_text().splitlines() if each[0] not in "#txz"], dtype=float)


def test_the_files_of_a_vertical_fault_have_its_numbers(tmp_path: Path) -> None:
    files = written(tmp_path, line("antiplane"))
    stations = ("000", "025", "050", "075", "100", "125", "150", "175", "200", "250", "300", "350")
    assert list(files) == [*(f"fltst_dp{each}.dat" for each in stations), "slip.dat", "shear_stress.dat"]
    lines = files["fltst_dp075.dat"].read_text().splitlines()
    assert tuple(lines[-5].split()) == NAMES and lines[1] == "# problem=BP"
    # At 7.5 km: 0.75 m at first, log10 of 1e-9 m/s, 25 MPa + 7.5 MPa, log10 of 8e6 s.
    np.testing.assert_allclose(rows(files["fltst_dp075.dat"]), [
        [time, time / 3e7 + 0.75, -9.0, 32.5, 6.90309] for time in TIMES
    ], rtol=1e-6)  # fmt: skip
    profile = rows(files["slip.dat"])
    assert profile.shape == (4, 83)  # 0 to 40 km every 500 m, and two columns
    np.testing.assert_allclose(profile[0, [0, 1, 2, 3, -1]], [0.0, 0.0, 0.0, 500.0, 40e3])
    np.testing.assert_allclose(profile[2, [0, 1, 2, 3, -1]], [3e7, -9.0, 1.0, 1.05, 5.0])


@pytest.mark.parametrize(("dip", "plus_is_above", "sign"), [
    (60.0, True, -1.0), (60.0, False, -1.0), (120.0, True, 1.0), (120.0, False, 1.0), (90.0, True, 1.0),
])  # fmt: skip
def test_thrusts_are_positive(tmp_path: Path, dip: float, plus_is_above: bool, sign: float) -> None:
    """The plus side of a fault that dips to +x moves down dip if it is above, the hanging wall, and up below it."""
    files = written(tmp_path, line("strain", dip, plus_is_above))
    assert {"slip.dat", "shear_stress.dat", "normal_stress.dat"} <= set(files)
    np.testing.assert_allclose(
        rows(files["fltst_dp100.dat"])[1], [3e7, sign * 2.0, -9.0, sign * 35.0, 50.0, 6.90309], rtol=1e-6
    )


def test_the_files_of_a_surface_have_its_numbers(tmp_path: Path) -> None:
    files = written(tmp_path, surface())
    assert [name for name in files if name.startswith("fltst")] == [  # the fault ends at 30 km
        f"fltst_strk{each}.dat" for each in ("-16dp+00", "+00dp+00", "+16dp+00", "-24dp+10", "-16dp+10", "+00dp+10",
                                             "+16dp+10", "+00dp+22")
    ]  # fmt: skip
    np.testing.assert_allclose(
        rows(files["fltst_strk-24dp+10.dat"])[2], [6e7, 0.06 - 0.24, 0.0, -9.0, -20.0, 20.0, -1.0, 8.0], atol=1e-9
    )
    # 31 x 21 points of 4 km2: the one that slides at 1 m/s is beyond the end of the fault.
    np.testing.assert_allclose(rows(files["global.dat"])[0], [0.0, -9.0, 31 * 21 * 4e6 * 30e9 * 1e-9], rtol=1e-6)
    along = rows(files["slip_2_strike.dat"])
    np.testing.assert_allclose(along[0, 2:], 1e3 * np.arange(-30, 31))
    np.testing.assert_allclose(along[3, 2:], 0.06 + 1e-2 * np.arange(-30, 31), atol=1e-7)
    np.testing.assert_allclose(rows(files["stress_3_depth.dat"])[1:, 2:], -1.0)
    contours = rows(files["rupture.dat"])
    assert contours.shape == (31 * 21, 3)
    np.testing.assert_array_equal(contours[:, 2], np.where(contours[:, 1] < 10e3, 12.5, 1e9))


def test_stations_of_the_user(tmp_path: Path) -> None:
    stations = seas_files.parse_stations(["-3.5 km, 2000 m", "4 km, 2 km"])
    files = written(tmp_path, surface(), stations)
    assert [name for name in files if name.startswith("fltst")] == ["fltst_strk-04dp+02.dat", "fltst_strk+04dp+02.dat"]
    others: list[tuple[list[tuple[float, ...]], str]] = [([(35e3, 2e3)], "35 km, 2 km"), ([(2e3,)], "2 km")]
    for wrong, where in others:
        with pytest.raises(RuptfxError, match=facts(f"'{where}' is not on the fault: 2 positions, -30 to 30 km")):
            written(tmp_path, surface(), wrong)
    with pytest.raises(RuptfxError, match=facts("export --station: .* '-24 km, 10 km'")):
        seas_files.parse_stations(["7 kg"])


def without_age(data: xarray.Dataset) -> xarray.Dataset:
    return data.drop_vars("theta")


def test_other_laws_and_formats_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RuptfxError, match=facts("interface main has no age theta .* --format netcdf")):
        written(tmp_path, without_age(line("antiplane")))
    time, position = synthetic.times(5), synthetic.points(10)
    run = synthetic.write_run(tmp_path / "run", np.full((5, len(position)), 1.0), time, position)
    done = CliRunner().invoke(app, ["export", str(run), "--station", "2 km"])
    assert done.exit_code != 0 and "--format seas" in done.output
    done = CliRunner().invoke(app, ["export", str(run), "--format", "seas", "--station", "50 mm"])
    assert done.exit_code == 0, done.output
    # Slip at 1 m/s for 60 us; the tangent of this line is +x.
    np.testing.assert_allclose(
        rows(run / "export" / "fltst_dp000.dat")[-1, :4], [60e-6, 60e-6, 0.0, -0.761594], rtol=1e-5
    )


def changed(row: int, column: int, value: str) -> Callable[[list[str]], list[str]]:
    """Replace a number of a row, counted from the end."""

    def change(lines: list[str]) -> list[str]:
        words = lines[-row].split()
        words[column] = value
        return [*lines[:-row], " ".join(words), *lines[len(lines) - row + 1 :]]

    return change


REFUSED: list[tuple[str, Callable[[list[str]], list[str]], str]] = [
    ("fltst_dp075.dat", changed(1, 0, "3e7"), "line 22: time 30000000 s does not follow 30000000 s"),
    ("fltst_dp075.dat", changed(3, 0, "-1"), "line 20: time -1 s does not follow 0 s"),
    ("fltst_dp075.dat", changed(2, 3, "nan"), "line 21: 'nan'"),
    ("fltst_dp075.dat", changed(2, 2, "1e-9 7"), "line 21: 6 columns instead of 5"),
    ("fltst_dp075.dat", changed(2, 2, "7e3"), "line 21: slip_rate = 7000 is not within -35 to 3"),
    ("fltst_dp075.dat", changed(2, 3, "3.25e7"), "line 21: shear_stress = 3.25e\\+07 is not within -10000 to 10000"),
    ("fltst_dp075.dat", changed(1, 4, "8e6"), "line 22: state = 8e\\+06 is not within -20 to 20"),
    ("fltst_dp075.dat", lambda lines: lines[:-2], "1 times, and .* 2 to 100000"),
    ("fltst_dp075.dat", lambda lines: lines[:-3], "has no rows"),
    ("fltst_dp075.dat", lambda lines: [*lines, *(f"{7e7 + n:.12g} 1 -9 32.5 6.9" for n in range(100_000))],
     "100003 times, and .* 2 to 100000"),
    ("fltst_dp075.dat", lambda lines: [each.replace("t slip ", "t Slip ") for each in lines],
     "'t Slip slip_rate shear_stress state' and not 't slip slip_rate shear_stress normal_stress state or t slip"),
    ("fltst_dp075.dat", lambda lines: [each for each in lines if "modeler" not in each], "'# modeler='"),
    ("slip.dat", lambda lines: [each for each in lines if each != "xd"], "line 15: 83 columns instead of 3"),
    ("slip.dat", changed(4, 1, "1"), "line 16: the first row must be 0 0 .* 0 1 0 500"),
    ("slip.dat", changed(4, 3, "0"), "line 16: the first row must be 0 0"),
    ("slip.dat", changed(1, 0, "2"), "line 19: time 2 s does not follow 30000000 s"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "change", "message"), REFUSED, ids=[str(n) for n in range(len(REFUSED))])
def test_what_the_upload_would_refuse_is_refused(
    tmp_path: Path, name: str, change: Callable[[list[str]], list[str]], message: str
) -> None:
    path = written(tmp_path, line("antiplane"))[name]
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
    with pytest.raises(RuptfxError, match=facts(message)):
        seas_files.check(path)


@pytest.mark.parametrize(("column", "value", "words"), [
    (1, "2e4", "line 11: disp_1 = 20000 is not within -10000 to 10000; use m, m/s"), (4, "300", "line 11: vel_2 = 300"),
    (0, "5", "line 11: time 5 s does not follow 5 s"),
])  # fmt: skip
def test_stations_off_the_fault_are_checked(tmp_path: Path, column: int, value: str, words: str) -> None:
    head = [*(f"# {key}=1" for key in seas_files.ENTRIES), "t disp_1 disp_2 vel_1 vel_2", "# data"]
    path = tmp_path / "srfst_fn-08.dat"
    body = [f"{time} 0.1 0.2 1e-9 2e-9" for time in (0, 2, 5, 7)]
    path.write_text("\n".join([*head, *body]) + "\n")
    seas_files.check(path)
    path.write_text("\n".join(changed(1, column, value)([*head, *body])) + "\n")
    with pytest.raises(RuptfxError, match=facts(words)):
        seas_files.check(path)


def test_only_names_of_the_comparison_are_read(tmp_path: Path) -> None:
    path = written(tmp_path, line("antiplane"))["slip.dat"].rename(tmp_path / "fltst_dp75.dat")
    with pytest.raises(RuptfxError, match=facts("fltst_dp75.dat: .* fltst_dp075.dat")):
        seas_files.check(path)
