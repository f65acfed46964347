"""A camera behind a polariscope: light averaged over exposures and pixels of a stress field that is known."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from helpers import synthetic
from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.results.analysis.polariscope import Camera, fringe_orders, max_shear
from ruptfx.results.record import Record

TIME = np.linspace(0, 60e-6, 61)


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """Bodies whose stress xx grows with time and x alike: fringe order 0.3 per microsecond and 0.05 per millimetre; the
    principal directions are x and y."""
    path = Path(tmp_path_factory.mktemp("runs") / "ramp")
    position = synthetic.points(4)
    synthetic.write_run(path, synthetic.crack(TIME, position), TIME, position, snapshots=61)
    with h5py.File(path / "bulk.h5", "a") as file:
        x, constant = file["points"][:, 0], 22.6e3 / 9.5e-3  # Pa per fringe
        order = 0.3e6 * file["time"][:][:, None] + 50.0 * x
        file["stress"][:] = 0
        file["stress"][:, :, 0] = constant * order
        file["stress"][:, :, 2] = 0
    with Record(path) as record:
        yield record


@pytest.mark.slow
def test_frames_at_the_rate_of_the_camera(record):
    film = Camera(frame_rate=1e5, exposure=1e-7, pixel=1e-3).film(record)
    np.testing.assert_allclose(film.time, 1e-5 * np.arange(6))  # the next would end behind the last snapshot
    assert film.shape == (6, 40, 100) and film.x[0] == pytest.approx(0.5e-3) and film.attrs["units"] == "1"
    # At 10 us order 3 at the left end: dark; white 10 mm to the right of it, half a fringe.
    order = 0.3e6 * (film.time + 0.5e-7) + 50.0 * film.x
    np.testing.assert_allclose(film.mean("y"), np.sin(np.pi * order) ** 2, atol=0.01)


@pytest.mark.parametrize("exposure", [1e-6, 3e-6])
def test_exposure_fades_what_moves(record, exposure):
    """The mean of sin^2(pi N) over a time T in which N grows by r T is 1/2 - cos(2 pi N_m) sinc(r T) / 2 with the order
    in its middle; over 10/3 us, a whole fringe, all would be grey."""
    film = Camera(frame_rate=1e5, exposure=exposure, pixel=1e-3).film(record)
    order = 0.3e6 * (film.time + 0.5 * exposure) + 50.0 * film.x
    expected = 0.5 - 0.5 * np.cos(2 * np.pi * order) * np.sinc(0.3e6 * exposure)
    np.testing.assert_allclose(film.mean("y"), expected, atol=0.03)


def test_pixels_fade_what_is_fine(record):
    """Pixels of 10 mm hold half a fringe: sinc(1/2) = 0.64 of the contrast is left."""
    film = Camera(frame_rate=1e5, exposure=1e-8, pixel=10e-3).film(record)
    assert film.shape == (6, 4, 10)
    # Mean of sin^2(pi N) over a pixel in which N grows by half, as over an exposure.
    order = 50.0 * film.x.values + 0.3e6 * film.time.values[:, None]
    expected = 0.5 - 0.5 * np.cos(2 * np.pi * order) * np.sinc(0.5)
    np.testing.assert_allclose(film.mean("y"), expected, atol=0.05)


def test_light_field_and_isoclinics(record):
    dark, light = (Camera(1e5, 1e-8, 1e-3, field).film(record) for field in ("dark", "light"))
    np.testing.assert_allclose(dark + light, 1, atol=1e-9)
    along = Camera(1e5, 1e-8, 1e-3, "plane", polariser=0.0).film(record)
    between = Camera(1e5, 1e-8, 1e-3, "plane", polariser=np.pi / 4).film(record)
    assert float(along.max()) < 1e-9
    np.testing.assert_allclose(between, dark, atol=1e-9)


def test_fringe_orders_and_the_largest_shear_stress(record):
    """As the stress was made: (sigma_1 - sigma_2) / 2 is half a fringe constant over the thickness for every order."""
    orders, shear = fringe_orders(record, 1e-3), max_shear(record, 1e-3)
    np.testing.assert_allclose(orders.mean("y"), 0.3e6 * orders.time + 50.0 * orders.x, atol=1e-9)
    np.testing.assert_allclose(shear, 0.5 * 22.6e3 / 9.5e-3 * orders, rtol=1e-9)
    assert (orders.attrs["units"], shear.attrs["units"]) == ("1", "Pa") and shear.dims == ("time", "y", "x")
    np.testing.assert_allclose(fringe_orders(record, 1e-3, thickness=19e-3), 2 * orders, rtol=1e-9)


@pytest.mark.parametrize("wrong,message", [
    ({"exposure": 0.0}, "exposure = 0.0: must be above zero"), ({"exposure": 2e-5}, "longer than the 1e-05 s from"),
])  # fmt: skip
def test_impossible_cameras(wrong, message):
    with pytest.raises(RuptfxError, match=facts(message)):
        Camera(**{"frame_rate": 1e5, "exposure": 1e-6, "pixel": 1e-3, **wrong})


def test_runs_it_cannot_show(record, tmp_path):
    position = synthetic.points(4)
    for name, options, message in (
        ("plane", {"plane": "antiplane", "snapshots": 9}, "two snapshots or more of stresses in a plate"),
        ("few", {"snapshots": 3}, "fringes change by .* reduce output.bulk_interval"),
    ):
        run = synthetic.write_run(tmp_path / name, synthetic.crack(TIME, position), TIME, position, **options)
        if name == "few":
            with h5py.File(run / "bulk.h5", "a") as file:
                file["stress"][:, :, 0] += 1e7 * np.arange(3)[:, None]
        with Record(run) as other, pytest.raises(RuptfxError, match=facts(message)):
            Camera(1e5, 1e-6, 1e-3).film(other)
    with pytest.raises(RuptfxError, match=facts(r"less than an exposure of 0\.001 s")):
        Camera(100.0, 1e-3, 1e-3).film(record)
