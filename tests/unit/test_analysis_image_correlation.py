"""Image correlation finds displacements that are known, to what its noise and its subsets allow."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import synthetic
from helpers.messages import facts, says
from PIL import Image

from ruptfx import RuptfxError
from ruptfx.results.analysis import image_correlation as dic
from ruptfx.results.record import Record

pytest.importorskip("skimage")

SHAPE = (120, 160)


def stretched(xx: float, xy: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacements [pixels] of a uniform strain, both shears alike."""
    y, x = np.indices(SHAPE).astype(float)
    return xx * x + xy * y + 0.3, xy * x - 0.2


def test_uniform_strain_is_found() -> None:
    """1 % and 0.5 % without noise to a hundredth of them in the middle, displacements to some hundredths of a pixel."""
    before = np.round(dic.speckle(SHAPE, 4.0))
    moved = stretched(0.01, 0.005)
    found = dic.displacements(before, dic.photographed(before, *moved), 21)
    middle = np.s_[30:-30, 30:-30]
    for measured, true in zip(found, moved, strict=True):
        assert np.sqrt(np.mean((measured - true)[middle] ** 2)) < 0.02
    strain = dic.strains(*found, 31)
    for name, true in (("xx", 0.01), ("yy", 0.0), ("xy", 0.005)):
        assert np.nanmean(strain[name][middle]) == pytest.approx(true, abs=1e-4)
    assert np.isnan(strain["xx"][:15]).all() and np.isfinite(strain["xx"][15:-15, 15:-15]).all()


@pytest.mark.parametrize("noise", [2.0, 4.0])
def test_noise_of_a_picture_is_its_standard_deviation(noise: float) -> None:
    """Far from black and white; rounding to whole levels adds 1 / 12. Of 19200 pixels the estimate is good to 0.5 %."""
    grey, still = np.full(SHAPE, 128.0), np.zeros(SHAPE)
    seen = dic.photographed(grey, still, still, noise) - grey
    assert seen.std() == pytest.approx(np.sqrt(noise**2 + 1 / 12), rel=0.025)
    assert abs(seen.mean()) < 0.03 * noise


def test_noise_falls_with_the_subset() -> None:
    """Of still pictures with noise of 4 grey levels: nothing but noise, less of larger subsets and windows."""
    image, still, noise = dic.speckle(SHAPE, 4.0), np.zeros(SHAPE), []
    before, after = (dic.photographed(image, still, still, 4.0, seed) for seed in (1, 2))
    for subset in (11, 31):
        strain = dic.strains(*dic.displacements(before, after, subset), subset)["xx"][40:-40, 40:-40]
        assert abs(strain.mean()) < 5e-4
        noise.append(strain.std())
    assert noise[1] < noise[0] / 3 and noise[0] > 1e-4


def test_an_experiment_with_a_run(tmp_path) -> None:
    """Plates that are stretched along x by 0.2 %, the upper one has slipped by two pixels besides: the strain is found
    far from the interface; within half a subset of it the jump looks like shear."""
    import h5py

    time, position = synthetic.times(3), synthetic.points(4)
    run = synthetic.write_run(tmp_path / "run", synthetic.crack(time, position), time, position, snapshots=2)
    pixel = 0.5e-3
    with h5py.File(run / "bulk.h5", "a") as file:
        points, upper = file["points"][:], file["body"][:] == 1
        file["displacement"][:] = 0
        file["displacement"][1, :, 0] = 2e-3 * points[:, 0] + np.where(upper, 2 * pixel, 0.0)
    with Record(run) as record:
        data = dic.experiment(record, 1, pixel, subset=15, noise=1.0)
        assert data.sizes == {"y": 80, "x": 200} and data.attrs["subset"] == 15 * pixel
        np.testing.assert_allclose(data.true_xx.values[5:35, 5:-5], 2e-3, rtol=1e-6)
        assert abs(data.true_xy.values[5:35, 5:-5]).max() < 1e-9
        edges = np.array([0.0, 0.25, 0.5, 1.0, 1.2]) * data.attrs["subset"]
        bias, noise = dic.errors(data, "xx", edges)
        assert abs(bias[3]) < 3e-4 and 0 < noise[3] < 2e-3
        hidden, _ = dic.errors(data, "xy", edges)
        # A jump of two pixels over a window of 15: 2 / 15 / 2 = 0.07 of shear strain where there is none.
        assert hidden[0] > 0.03 and abs(hidden[3]) < 0.01
        with pytest.raises(RuptfxError, match=facts(r"200 pixels of 0\.0005 m, less than two subsets")):
            dic.experiment(record, 1, pixel, subset=101)


def test_other_light_changes_nothing() -> None:
    """A second picture of 16 bits, brighter and with less contrast."""
    before, moved = np.round(dic.speckle(SHAPE, 4.0)), stretched(0.01, 0.005)
    after = dic.photographed(before, *moved)
    same, other = (dic.displacements(before, picture, 21) for picture in (after, 257 * (40 + 0.7 * after)))
    np.testing.assert_allclose(other, same, atol=1e-6)
    for window in (4, 1, 121):
        with pytest.raises(
            RuptfxError, match=facts(f"window = {window}: must be odd, 3 or more, and fit into the image")
        ):
            dic.strains(*same, window)


@pytest.mark.parametrize("before,after,subset,message", [
    (np.ones((40, 50)), np.ones((40, 60)), 11, "images of 50 x 40 and 60 x 40: .* same size"),
    (np.eye(40), np.eye(40), 10, "subset = 10: must be odd"),
    (np.eye(40), np.eye(40), 41, "fit into the image of 40 x 40"),
    (np.ones((40, 40)), np.eye(40), 11, "no contrast"),
])  # fmt: skip
def test_what_is_refused(before, after, subset, message) -> None:
    with pytest.raises(RuptfxError, match=facts(message)):
        dic.displacements(before, after, subset)


def test_subsets_without_their_speckles_are_lost() -> None:
    """A patch of other speckles in the second picture: all squares around it correlate, those inside of it do not."""
    before, moved = np.round(dic.speckle(SHAPE, 4.0)), stretched(0.01, 0.005)
    after = dic.photographed(before, *moved)
    good = dic.correlation(before, 40 + 0.7 * after, *moved, 21)  # light and contrast do not matter
    assert np.nanmin(good) > 0.99
    whole = np.isfinite(good)
    assert not whole[:10].any() and not whole[:, -10:].any() and whole[12:-12, 14:-14].all()
    after[40:80, 60:110] = dic.speckle(SHAPE, 4.0, seed=9)[40:80, 60:110]
    found = dic.correlation(before, after, *moved, 21)
    away = np.ones(SHAPE, dtype=bool)
    away[25:95, 45:125] = False
    np.testing.assert_allclose(found[away & whole], good[away & whole], atol=1e-5)
    assert np.nanmax(found[53:67, 74:96]) < 0.6
    lost = found < 0.7
    assert dic.spread(lost, 21)[lost].all() and dic.spread(lost, 21).sum() > lost.sum()


def test_command(tmp_path, monkeypatch) -> None:
    from typer.testing import CliRunner

    from ruptfx.app.cli import app

    monkeypatch.chdir(tmp_path)
    image = np.round(dic.speckle(SHAPE, 4.0))
    pictures = {"a": image, "b": dic.photographed(image, *stretched(0.01, 0.0)), "small": image[:100]}
    for name, picture in pictures.items():
        Image.fromarray(picture[::-1].astype(np.uint8)).save(f"{name}.png")
    done = CliRunner().invoke(app, ["dic", "a.png", "b.png", "--pixel", "1e-5", "--subset", "25"])
    assert done.exit_code == 0, done.output
    import xarray

    with xarray.open_dataset("dic.nc", engine="h5netcdf") as data:
        assert float(data.strain_xx.mean()) == pytest.approx(0.01, abs=3e-4)
        assert data.displacement_x.attrs["units"] == "m" and float(data.x[-1]) == pytest.approx(159e-5)
        assert np.isnan(data.strain_xx[:12]).all() and float(data.correlation.min()) > 0.9
    assert says("lost subsets: 1.5 %", done.output)  # 2 of 136 columns of squares leave the picture at its right edge
    with Image.open("dic.png") as figure:
        assert figure.size[0] > 1000
    Image.fromarray(dic.speckle(SHAPE, 4.0, seed=5).astype(np.uint8)).save("other.png")
    done = CliRunner().invoke(app, ["dic", "a.png", "other.png", "--least", "0.95"])
    assert done.exit_code == 1 and says("no subset of 21 pixels correlates by 0.95", " ".join(done.stderr.split()))
    for wrong, message in (("small.png", "same size"), ("missing.png", "missing.png: no picture")):
        done = CliRunner().invoke(app, ["dic", "a.png", wrong])
        assert done.exit_code == 1 and message in " ".join((done.output + done.stderr).split())
