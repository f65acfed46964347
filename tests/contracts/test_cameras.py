"""Every camera of the folder, by its own example: read again, frames of a motion that is known, files, refusals."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray
from helpers import synthetic
from helpers.messages import facts, says
from helpers.small_cases import plates
from PIL import Image
from typer.testing import CliRunner

from ruptfx import RuptfxError
from ruptfx.app.cli import app
from ruptfx.app.commands.film import _write
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.results.analysis import image_correlation
from ruptfx.results.analysis.polariscope import Camera as Optics
from ruptfx.results.cameras import camera_from
from ruptfx.results.cameras.speckles import _mean
from ruptfx.results.record import Record

CAMERAS = alternatives("ruptfx.results.cameras")
every_camera = pytest.mark.parametrize("kind", CAMERAS)
TIME = np.linspace(0, 60e-6, 7)
RATE, PIXEL, STRAIN = 1e5, 0.5e-3, 500.0  # 1/s, m, and strain along x per second


def example(kind: str) -> dict[str, Any]:
    return tomllib.loads(f"camera = {CAMERAS[kind].example}")["camera"]


def with_camera(kind: str, changes: dict[str, Any] | None = None, **others: Any) -> Case:
    return parse_case(plates({"cameras": [{**example(kind), **(changes or {})}], **others}))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Plates of 100 by 40 mm: stress xx and displacement along x grow linearly with time; the case has two cameras."""
    path, position = Path(tmp_path_factory.mktemp("runs") / "stretch"), synthetic.points(4)
    synthetic.write_run(path, synthetic.crack(TIME, position), TIME, position, snapshots=len(TIME))
    with h5py.File(path / "bulk.h5", "a") as file:
        x, time = file["points"][:, 0], file["time"][:]
        file["stress"][:] = 0
        file["stress"][:, :, 0] = 22.6e3 / 9.5e-3 * 0.03e6 * time[:, None] + 0 * x  # 0.3 orders from one to the next
        file["displacement"][:] = 0
        file["displacement"][:, :, 0] = STRAIN * time[:, None] * x
    entries = [
        {"kind": kind, "name": f"{kind}_{number}", "frame_rate": RATE, "exposure": 1e-7, "pixel": PIXEL}
        for number, kind in enumerate(CAMERAS)
    ]
    text = "".join(
        "\n[[cameras]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in entry.items())
        for entry in entries
    )
    with (path / "case.toml").open("a") as file:
        file.write(text)
    return path


@every_camera
def test_written_and_read_again(kind: str) -> None:
    given = with_camera(kind)
    again = parse_case(tomllib.loads(given.to_toml()))
    assert example(kind)["kind"] == kind and again == given and again.hash == given.hash


@every_camera
def test_frames(kind: str, run: Path) -> None:
    with Record(run) as record:
        table = next(each for each in record.case["cameras"] if each["kind"] == kind)
        film = camera_from(table).film(record)
    assert film.dims == ("time", "y", "x") and film.shape == (6, 80, 200)
    np.testing.assert_allclose(film.time, np.arange(6) / RATE, atol=1e-12)  # the next would end too late
    np.testing.assert_allclose(film.x, PIXEL * (np.arange(200) + 0.5), rtol=1e-9)
    values = film.values[np.isfinite(film.values)]
    assert values.min() >= 0 and values.max() <= 1
    assert all(np.abs(one - other).max() > 0.02 for one, other in zip(film[:-1].values, film[1:].values, strict=True))


def test_a_polariscope_sees_what_the_formula_says(run: Path) -> None:
    with Record(run) as record:
        table = {"kind": "polariscope", "name": "light", "frame_rate": RATE, "exposure": 1e-7, "pixel": PIXEL,
                 "field": "light"}  # fmt: skip
        film, optics = camera_from(table).film(record), Optics(RATE, 1e-7, PIXEL, "light").film(record)
    xarray.testing.assert_identical(film, optics)
    order = 0.03e6 * (film.time + 0.5e-7)
    np.testing.assert_allclose(film.mean(["y", "x"]), np.cos(np.pi * order) ** 2, atol=1e-3)


def test_speckles_move_as_the_bodies_do(run: Path) -> None:
    """Image correlation of two frames finds the stretch from one to the other, at the middles of the exposures."""
    pytest.importorskip("skimage")
    with Record(run) as record:
        table = {"kind": "speckles", "name": "surface", "frame_rate": RATE, "exposure": 5e-6, "pixel": PIXEL}
        film = camera_from({**table, "noise": 0.0}).film(record)
    first, last = (255 * np.nan_to_num(film[number].values) for number in (0, 2))
    moved = image_correlation.displacements(first, last, 21)
    # Upper and lower plate alike; the strain is that of 20 us, over the length that the first exposure has.
    expected = STRAIN * 20e-6 / (1 + STRAIN * 2.5e-6)
    found = image_correlation.strains(*moved, 31)["xx"][20:-20, 40:-40]
    assert np.nanmean(found) == pytest.approx(expected, rel=0.05)


def test_the_command_writes_pictures_and_both_files(run: Path, tmp_path: Path) -> None:
    def film(*options: str) -> Any:
        return CliRunner().invoke(app, ["film", str(run), *options])

    done = film("--camera", "polariscope_0", "--out", str(tmp_path / "film"))
    assert done.exit_code == 0 and "6 frames" in done.output, done.output
    with xarray.open_dataarray(tmp_path / "film" / "film.nc", engine="h5netcdf") as data:
        assert data.shape == (6, 80, 200) and json.loads(data.attrs["camera"])["name"] == "polariscope_0"
        last = data[5].values
    with Image.open(tmp_path / "film" / "film.gif") as moving, Image.open(tmp_path / "film" / "frame_0005.png") as one:
        assert moving.n_frames == 6 and one.size == (200, 80)
        np.testing.assert_array_equal(np.asarray(one)[::-1], np.round(255 * np.nan_to_num(last)))
    inline = '{ kind = "polariscope", frame_rate = "50 kHz", exposure = "1 us", pixel = "1 mm" }'
    done = film("--camera", inline, "--out", str(tmp_path / "film"))
    assert done.exit_code == 0 and "3 frames" in done.output, done.output
    assert len(list((tmp_path / "film").glob("*.png"))) == 3
    for options, said in (
        ((), "it has several cameras; give --camera polariscope_0 or speckles_1"),
        (("--camera", "polariscope"), "did you mean 'polariscope_0'"),
        (("--camera", "{ kind = 1"), "--camera { kind = 1: not valid TOML"),
        (("--camera", inline.replace("pixel", "pixl")), "unknown key 'pixl'"),
    ):
        done = film(*options)
        assert done.exit_code == 1 and said in " ".join(done.output.split()), done.output


@pytest.mark.parametrize(("kind", "changes", "others", "said"), [
    ("polariscope", {"exposure": 2e-6}, {}, "cameras.0.exposure = 2e-06 s: longer than the 1e-06 s from"),
    ("polariscope", {}, {"plane": "antiplane"}, "cameras.0.kind = 'polariscope': fringes are of plates"),
    ("speckles", {}, {"plane": "antiplane"}, "cameras.0.kind = 'speckles': it shows motion in a plane"),
    ("polariscope", {"polariser": 0.3}, {}, "cameras.0.polariser = 0.3: without effect with field = 'dark'"),
])  # fmt: skip
def test_cameras_that_cannot_be(kind: str, changes: dict[str, Any], others: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError) as caught:
        with_camera(kind, changes, **others)
    assert says(said, str(caught.value))


def test_runs_without_displacements_in_a_plane_have_no_speckles(tmp_path: Path) -> None:
    position = synthetic.points(4)
    path = synthetic.write_run(
        tmp_path / "run", synthetic.crack(TIME, position), TIME, position, snapshots=len(TIME), plane="antiplane"
    )
    speckles = camera_from(example("speckles"))
    with Record(path) as record, pytest.raises(RuptfxError) as raised:
        speckles.film(record)
    assert str(raised.value).startswith(f"{path}: ") and "two snapshots" in str(raised.value)


def test_each_has_its_own_name() -> None:
    with pytest.raises(CaseError, match=facts(r"cameras\.1\.name = 'fringes': another camera has that name")):
        parse_case(plates({"cameras": [example("polariscope")] * 2}))


@pytest.mark.fem
def test_check_warns_of_snapshots_that_are_too_far_apart() -> None:
    pytest.importorskip("dolfinx")
    from ruptfx.app.checks.preflight import _camera_rows

    cases = [with_camera("speckles", duration=1e-5, output={"bulk_interval": interval}) for interval in (1e-6, 5e-6)]
    rows = [next(_camera_rows(case)) for case in cases]
    assert [row.verdict for row in rows] == ["ok", "warning"] and "reduce output.bulk_interval" in rows[1].note
    assert rows[0].value == 10


def test_the_mean_of_an_exposure_is_that_over_its_time() -> None:
    """Displacement 0 until 1 s, then 1 m/s: from 0.9 s to 1.3 s the integral is 0.3^2 / 2."""
    values = np.array([0.0, 0.0, 1.0])[:, None, None]
    bulk = xarray.Dataset({"displacement": (("time", "point", "component"), values)})
    mean = _mean(np.array([0.0, 1.0, 2.0]), bulk, 0.9, 0.4)
    assert mean.item() == pytest.approx(0.3**2 / 2 / 0.4, rel=1e-12)


def test_pictures_are_upright_and_films_have_their_rate(tmp_path: Path) -> None:
    """The highest row of pixels is the top of the picture; four frames a second last 250 ms each."""
    camera = camera_from({"kind": "speckles", "name": "a", "frame_rate": 1e6, "exposure": 1e-7, "pixel": 1e-3})
    dark_below = np.array([[0.0, 0.0], [0.5, 0.5], [1.0, 1.0]])
    frames = xarray.DataArray(
        np.stack([dark_below, dark_below[::-1]]), {"time": [0.0, 1.0], "y": [0.0, 1.0, 2.0], "x": [0.0, 1.0]},
        name="light",
    )  # fmt: skip
    _write(frames, camera, tmp_path, 4.0)
    for number, column in enumerate(([255, 128, 0], [0, 128, 255])):
        picture = np.asarray(Image.open(tmp_path / f"frame_000{number}.png"), dtype=int)
        assert picture[:, 0].tolist() == column
    with Image.open(tmp_path / "film.gif") as film:
        assert film.info["duration"] == 250
        assert np.asarray(film.convert("L"), dtype=int)[0, 0] > 250
