"""Image correlation of pictures that its own code did not make: dots that a formula puts where they have moved to.

A picture is a function of the place, evaluated at X(x), where what is seen at x was before: exact, without
interpolation of grey levels; then noise of two grey levels, and rounding to whole ones.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from ruptfx.app.cli import app
from ruptfx.results.analysis import image_correlation as dic

pytest.importorskip("skimage")

Array = np.ndarray
SHAPE, SUBSET = (200, 260), 21
MIDDLE = np.s_[40:-40, 40:-40]
Y, X = np.indices(SHAPE).astype(float)


def picture(x: Array, y: Array, seed: int) -> Array:
    """Bright dots of 1.6 pixels at random places, seen at places that were x and y before [pixels]."""
    random = np.random.default_rng(3)
    light = np.zeros(SHAPE)
    for column, row in random.uniform(-10, [SHAPE[1] + 10, SHAPE[0] + 10], (2600, 2)):
        near = tuple(slice(max(int(at) - 14, 0), max(int(at) + 14, 0)) for at in (row, column))
        light[near] += np.exp(-((x[near] - column) ** 2 + (y[near] - row) ** 2) / (2 * 1.6**2))
    noise = 2.0 * np.random.default_rng(seed).normal(size=SHAPE)
    return np.clip(np.round(20 + 210 * (1 - np.exp(-1.5 * light)) + noise), 0, 255)


def mapped(gradient: Array) -> tuple[Array, Array]:
    """Where points were that the deformation gradient, of the middle, has brought to X and Y."""
    back = np.linalg.inv(gradient)
    return 130 + back[0, 0] * (X - 130) + back[0, 1] * (Y - 100), 100 + back[1, 0] * (X - 130) + back[1, 1] * (Y - 100)


BEFORE = picture(X, Y, 1)


@pytest.mark.parametrize("shift", [0.1, 0.25, 0.5])
def test_shifts(shift: float) -> None:
    """Found: a bias of 0.009 pixel at most, none at half a pixel, as of interpolation in general."""
    along_x, along_y = dic.displacements(BEFORE, picture(X - shift, Y + 0.3, 2), SUBSET)
    assert along_x[MIDDLE].mean() == pytest.approx(shift, abs=0.015)
    assert along_y[MIDDLE].mean() == pytest.approx(-0.3, abs=0.015)
    assert along_x[MIDDLE].std() < 0.015


@pytest.mark.parametrize("period", [60, 84, 120])
def test_a_sine_is_averaged_over_the_subset(period: float) -> None:
    """A subset that is moved as a whole sees the mean over its side: sin(pi s) / (pi s) of a sine of 1 / s sides.

    What is lost is right within a quarter (found: 11 to 20 % less), as subsets have more dots on one side than another.

    Source: Schreier and Sutton (2002), Exp. Mech. 42, 303.
    """
    sine = np.sin(2 * np.pi * Y / period)
    along_x, along_y = dic.displacements(BEFORE, picture(X - 1.5 * sine, Y, 2), SUBSET)
    found = np.polyfit(sine[MIDDLE].ravel(), along_x[MIDDLE].ravel(), 1)[0] / 1.5
    mean = np.sinc(SUBSET / period)
    assert found == pytest.approx(mean, abs=0.25 * (1 - mean))
    assert abs(along_y[MIDDLE].mean()) < 0.02


def test_a_turn_is_no_strain() -> None:
    """By 2 degrees: cos - 1 = -6.1e-4 along x and y as a small strain, no shear.

    Subsets do not turn, so that the noise is 0.003, six times that without a turn, and its mean over 50 subsets 4e-4.
    """
    c, s = np.cos(np.radians(2)), np.sin(np.radians(2))
    moved = dic.displacements(BEFORE, picture(*mapped(np.array([[c, -s], [s, c]])), 2), SUBSET)
    strain = dic.strains(*moved, SUBSET)
    for name, true in (("xx", c - 1), ("yy", c - 1), ("xy", 0.0)):
        assert np.nanmean(strain[name][MIDDLE]) == pytest.approx(true, abs=8e-4)
    turn = np.polyfit(Y[MIDDLE].ravel(), moved[0][MIDDLE].ravel(), 1)[0]
    assert turn == pytest.approx(-s, rel=0.01)


@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize("given, pixel, unit", [([], 1.0, "pixel"), (["--pixel", "20 um"], 2e-5, "m")])
def test_command_on_two_files(given: list[str], pixel: float, unit: str, tmp_path: Path) -> None:
    """Strains of files whose first row is the top one: xx 0.4 %, yy -0.2 %, xy (0.3 % - 0.1 %) / 2, to 2e-4.

    Displacements and places have the same unit, so that the slopes of the displacement are F - 1 of X, to first order.
    """
    x, y = mapped(np.array([[1.004, 0.003], [-0.001, 0.998]]))
    after = picture(x - 0.4, y + 0.3, 2)  # besides moved by 0.4 and -0.3 pixels, which no turned picture has
    for name, image in (("before", BEFORE), ("after", after)):
        Image.fromarray(image[::-1].astype(np.uint8)).save(tmp_path / f"{name}.png")
    done = CliRunner().invoke(
        app,
        ["dic", str(tmp_path / "before.png"), str(tmp_path / "after.png"), "--out", str(tmp_path / "strains"), *given],
    )
    assert done.exit_code == 0, done.output
    import xarray

    with xarray.open_dataset(tmp_path / "strains.nc", engine="h5netcdf") as data:
        for name, true in (("xx", 0.004), ("yy", -0.002), ("xy", 0.001)):
            found = float(np.nanmean(data[f"strain_{name}"].values[MIDDLE]))
            assert found == pytest.approx(true, abs=2e-4), name
        assert float(data.x[-1]) == pytest.approx(259 * pixel) and float(data.y[-1]) == pytest.approx(199 * pixel)
        place = [axis[MIDDLE].ravel() for axis in np.broadcast_arrays(data.x.values, data.y.values[:, None])]
        for name, slopes in (("x", (0.004, 0.003)), ("y", (-0.001, -0.002))):
            field = data[f"displacement_{name}"]
            assert field.attrs["units"] == data.x.attrs["units"] == unit
            fit = np.linalg.lstsq(np.stack([*place, np.ones_like(place[0])], axis=1), field.values[MIDDLE].ravel())[0]
            assert fit[:2] == pytest.approx(slopes, abs=2e-4)
        rows, columns = np.arange(50, 150), np.arange(50, 200)  # (130, 100) moves by 0.4 and -0.3
        at_left = float(np.nanmean(data["displacement_x"].values[np.ix_(rows, columns[:10])])) / pixel
        below = float(np.nanmean(data["displacement_y"].values[np.ix_(rows[:10], columns)])) / pixel
        assert at_left == pytest.approx(0.4 + 0.004 * (54.5 - 130) + 0.003 * (99.5 - 100), abs=0.05)
        assert below == pytest.approx(-0.3 - 0.001 * (124.5 - 130) - 0.002 * (54.5 - 100), abs=0.05)


@pytest.mark.parametrize("pixel", ["0", "-1e-5", "inf", "nan", "20 us", "wide"])
def test_sizes_of_a_pixel_that_are_refused(pixel: str, tmp_path: Path) -> None:
    Image.fromarray(BEFORE.astype(np.uint8)).save(tmp_path / "a.png")
    name = str(tmp_path / "a.png")
    done = CliRunner().invoke(app, ["dic", name, name, f"--pixel={pixel}", "--out", str(tmp_path / "none")])
    assert done.exit_code == 1 and "--pixel" in done.output + done.stderr
    assert list(tmp_path.iterdir()) == [tmp_path / "a.png"]
