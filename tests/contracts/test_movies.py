"""Every film of `movies/`, found by its name: it moves, says when, and is a file that others open."""

from __future__ import annotations

import re
from itertools import pairwise

import h5py
import numpy as np
import pytest
from helpers import synthetic
from helpers.labels import label_faults
from helpers.messages import facts
from matplotlib import colormaps
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial import cKDTree

from ruptfx import RuptfxError
from ruptfx.input.schema import own_kinds
from ruptfx.results import movies
from ruptfx.results.figure_style import WAVE_MAP
from ruptfx.results.movies._solids import facing
from ruptfx.results.record import Record

TIME, POSITION = synthetic.times(61), synthetic.points(10)
OF_SURFACES = ("contact",)
"""Films of surfaces only."""
OF_LINES = [kind for kind in own_kinds("ruptfx.results.movies") if kind not in OF_SURFACES]


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "crack"
    with Record(synthetic.write_run(path, synthetic.crack(TIME, POSITION), TIME, POSITION)) as record:
        yield record


@pytest.fixture(scope="module")
def sliding(tmp_path_factory):
    path = tmp_path_factory.mktemp("runs") / "surface"
    with Record(synthetic.write_pressed_run(path, np.linspace(0.0, 8e3, 41))) as record:
        yield record


@pytest.mark.parametrize("what", own_kinds("ruptfx.results.movies"))
def test_every_film(what, record, sliding, tmp_path):
    record = sliding if what in OF_SURFACES else record
    told = []
    count = movies.save(record, what, tmp_path / "film.gif", most=4, told=lambda part, text: told.append(part))
    assert count == len(told) == 4 and told == sorted(told) and told[-1] == pytest.approx(1)
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 4 and film.info["duration"] == pytest.approx(1000 / 12, abs=10)
        pictures = []
        for number in range(4):
            film.seek(number)
            pictures.append(np.asarray(film.convert("RGB")).astype(float))
    # The wave and the tip move: pictures differ by more than the digits of the time.
    changed = [np.mean(np.abs(a - b).max(axis=2) > 20) for a, b in pairwise(pictures)]
    assert min(changed) > 0.01


@pytest.mark.parametrize("slides", [False, True])
@pytest.mark.parametrize("what", OF_LINES)
def test_labels_of_a_frame_keep_apart(what, slides, record, tmp_path, monkeypatch):
    made, new = [], movies.new_figure
    monkeypatch.setattr(movies, "new_figure", lambda *shape, **options: made.append(new(*shape, **options)) or made[0])
    if slides:
        record = Record(synthetic.write_run(
            tmp_path / "slides", synthetic.crack(TIME, POSITION), TIME, POSITION, snapshots=3, slides=True
        ))  # fmt: skip
    frames = movies.frames(record, what, most=2)
    for _ in frames:
        assert label_faults(made[0][0]) == []
    assert len(made) == 1
    # Positions of an interface that slides are those at the start, whatever the picture above shows.
    assert made[0][1][-1, 0].get_xlabel().endswith("before it slid") == slides


def test_pictures_show_the_values_of_the_run(record):
    """Snapshots of the plane wave: speed |sin|, and shear stress half of sqrt(6^2 + (4 sin)^2) MPa at the nodes."""
    row, bulk = 4, record.bulk
    for what, expected in (
        ("velocity", np.linalg.norm(bulk["velocity"].values[row], axis=-1)),
        ("max_shear", np.hypot(6.0, 2 * bulk["stress"].values[row][:, 2] / 1e6) / 2),
    ):
        image = movies.film(record, what).image(row)
        assert np.nanmax(image) == pytest.approx(expected.max(), rel=0.02)
        assert np.nanmin(image) == pytest.approx(expected.min(), rel=0.02, abs=1e-3)
        film, axes = movies.film(record, what), Figure().subplots()
        film.draw(axes)
        (trace,) = axes.lines
        x = 1e3 * record.interface["x"].values
        np.testing.assert_allclose(trace.get_data(), [x, 0 * x])
        largest = max(np.nanmax(film.image(number)) for number in range(len(film.times)))
        assert 0.95 * largest < film.look["vmax"] <= largest  # a few bright pixels do not darken the others
    # Dark field, sin^2(pi N), with N = fringe times 9.5 mm over 22.6 kN/m, at every seventh point.
    film = movies.film(record, "fringes")
    light = np.sin(np.pi * bulk["fringe"].values[row] * 9.5e-3 / 22.6e3) ** 2
    image, (left, right, bottom, top) = film.image(row), film.extent
    x, y = 1e3 * bulk["points"].values[::7].T
    rows = np.clip((y - bottom) / (top - bottom) * image.shape[0], 0, image.shape[0] - 1).astype(int)
    columns = np.clip((x - left) / (right - left) * image.shape[1], 0, image.shape[1] - 1).astype(int)
    assert np.abs(image[rows, columns] - light[::7]).max() < 0.2 and np.ptp(light) > 0.9


def test_speed_has_both_components(tmp_path):
    """Of a shear wave that moves 0.75 times as fast along x as along y: 1.25 times as fast, for 3, 4 and 5."""
    time, position = synthetic.times(31), synthetic.points(20)
    path = synthetic.write_run(tmp_path / "run", synthetic.crack(time, position), time, position)
    with h5py.File(path / "bulk.h5", "r+") as file:
        across = file["velocity"][:, :, 1]
        file["velocity"][:, :, 0] = 0.75 * across
    with Record(path) as record:
        image = movies.film(record, "velocity").image(4)
    assert np.nanmax(image) == pytest.approx(1.25 * np.abs(across[4]).max(), rel=0.02)


def test_contours_of_the_largest_shear_stress(record, monkeypatch):
    """The stress at the nodes next to a contour is its level; the label says how far apart they are."""
    made, new = [], movies.new_figure
    monkeypatch.setattr(movies, "new_figure", lambda *shape, **options: made.append(new(*shape, **options)) or made[0])
    assert "a contour every 0.5 MPa" in movies.film(record, "max_shear").label
    seen = 0
    for number, _ in enumerate(movies.frames(record, "max_shear", most=6)):
        lines = [item for item in made[0][1][0, 0].collections if isinstance(item, QuadContourSet)]
        assert len(lines) <= 1  # those of the frame before are gone
        row = np.unique(np.linspace(0, record.bulk.sizes["time"] - 1, 6).astype(int))[number]
        points = 1e3 * record.bulk["points"].values
        there = record.bulk["fringe"].isel(time=row).values / 2e6
        for level, path in zip(lines[0].levels, lines[0].get_paths(), strict=True) if lines else ():
            near = cKDTree(points).query(path.vertices)[1]
            assert np.abs(there[near] - level).max() < 0.1
            seen += 1
    assert seen > 0


def test_bodies_that_slide_are_shown_where_they_are(tmp_path):
    """The upper body, 100 mm long, goes 20 mm to the right: nothing is left behind, and its line goes along."""
    run = synthetic.write_run(
        tmp_path / "slides", synthetic.crack(TIME, POSITION), TIME, POSITION, snapshots=3, slides=True
    )
    with h5py.File(run / "bulk.h5", "a") as file:
        moved = np.zeros(file["displacement"].shape)
        moved[:, file["body"][()] == 1, 0] = np.array([0.0, 0.01, 0.02])[:, None]
        del file["displacement"]
        file["displacement"] = moved
    with Record(run) as record:
        film = movies.film(record, "velocity")
        assert film.extent == pytest.approx((0, 120, -20, 20))
        for row, gone in ((0, 0), (1, 10), (2, 20)):
            there = np.isfinite(film.image(row))
            pixels = there.shape[1] / 120  # per mm
            upper, lower = there[-1], there[0]
            # Empty before it, and behind its end; the lower body stays.
            behind = round((gone - 0.5) * pixels) if gone else 0
            assert not upper[:behind].any() and upper[round((gone + 0.5) * pixels)]
            assert upper[round((gone + 99) * pixels)] and not upper[round((gone + 101) * pixels) :].any()
            assert lower[0] and not lower[round(101 * pixels) :].any()
        assert movies.save(record, "velocity", tmp_path / "film.gif", most=3) == 3


def test_mp4(record, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    assert movies.save(record, "slip_rate", tmp_path / "film.mp4", rate=10, most=5) == 5
    count, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "film.mp4"))
    assert count == 5 and seconds == pytest.approx(0.5, abs=0.11)


@pytest.mark.parametrize("what,name,message", [
    ("velocty", "film.gif", "did you mean 'velocity'"), ("velocity", "film.avi", "'.avi' is no format"),
])  # fmt: skip
def test_what_is_refused(what, name, message, record, tmp_path):
    with pytest.raises(RuptfxError, match=facts(message)):
        movies.save(record, what, tmp_path / name)


def test_runs_with_nothing_to_show(tmp_path):
    run = synthetic.write_run(
        tmp_path / "rest", 0 * synthetic.crack(TIME, POSITION), TIME, POSITION, plane="antiplane", snapshots=1
    )
    with Record(run) as record:
        for what, message in (
            ("velocity", "1 snapshots .* reduce output.bulk_interval"),
            ("fringes", "of stresses in a plate"),
            ("slip_rate", "nothing slid"),
        ):
            with pytest.raises(RuptfxError, match=facts(message)):
                movies.save(record, what, tmp_path / "film.gif")


def test_movie_of_a_surface_is_a_map_with_the_front_where_it_is(tmp_path):
    """A circle whose radius grows by 2.5 km/s around a point 10 km down dip; the upper edge is on top."""
    with Record(synthetic.write_surface_run(tmp_path / "run", 2500.0)) as record:
        film = movies.film(record, "slip_rate")
        assert film.extent == pytest.approx((-20, 20, 20, 0)) and film.y_label == "Down dip (km)"
        for row in (8, 16):
            image = film.image(row)
            assert image.shape == (450, 900) and np.isfinite(image).all()
            x, y = np.linspace(-20, 20, 900), np.linspace(20, 0, 450)
            radius = np.hypot(x[None], y[:, None] - 10)
            front = 2.5 * film.times[row]
            np.testing.assert_allclose(image[radius < front - 1], 1.0, atol=1e-9)
            np.testing.assert_allclose(image[radius > front + 1], 0.0, atol=1e-9)
        assert movies.save(record, "slip_rate", tmp_path / "film.gif", most=4) == 4
        for what in ("max_shear", "fringes"):
            refused = rf"{re.escape(str(record.path))}: .*--what velocity .*--what slip_rate .*--format vtkhdf"
            with pytest.raises(RuptfxError, match=refused):
                movies.save(record, what, tmp_path / "film.gif")


def test_movie_of_a_surface_without_a_grid(tmp_path):
    with Record(synthetic.write_surface_run(tmp_path / "run", structured=False)) as record:
        film = movies.film(record, "slip_rate")
        data = record.interface
        row, image = 20, film.image(20)
        x, y = np.linspace(-20e3, 20e3, 900), np.linspace(20e3, 0, 450)
        pairs = (y, data.dip.values), (x, data.position.values)
        at = tuple(np.abs(pixels[:, None] - values).argmin(axis=0) for pixels, values in pairs)
        away = np.abs(np.hypot(data.position, data.dip - 10e3) - 2500.0 * film.times[row]).values > 1.5e3
        inside = np.isfinite(image[at])
        assert inside.mean() > 0.99  # a corner has no point
        away &= inside
        np.testing.assert_allclose(image[at][away], data.slip_rate_1.values[row][away], atol=1e-6)


@pytest.mark.parametrize("what, panels", [("slip_rate", 1), ("contact", 2)])
def test_labels_of_a_frame_of_a_surface_keep_apart(what, panels, sliding, monkeypatch):
    made, new = [], movies.new_figure
    monkeypatch.setattr(movies, "new_figure", lambda *shape, **options: made.append(new(*shape, **options)) or made[0])
    for _ in movies.frames(sliding, what, most=3):
        assert label_faults(made[0][0]) == []
    assert len(made) == 1 and made[0][1].shape == (panels, 1)


@pytest.mark.parametrize("corners", [8, 4])
def test_facets_that_face_a_direction(corners):
    """Of a cube of 2 x 2 x 2 cells, or of each of these cut into tetrahedra: 4 or 8 on each of three sides."""
    grid = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = synthetic.hexahedra(np.arange(27).reshape(3, 3, 3))
    if corners == 4:  # around one diagonal, so that facets of neighbours fit
        around = [1, 2, 3, 7, 4, 5]
        pairs = zip(around, around[1:] + around[:1], strict=True)
        cells = np.concatenate([cells[:, [0, 6, a, b]] for a, b in pairs])
    facets = facing(grid, cells, np.array([1.0, -2.0, 0.5]))
    assert len(facets) == (12 if corners == 8 else 24)
    places = grid[facets]
    for axis, place in ((0, 2.0), (1, 0.0), (2, 2.0)):
        assert np.sum((places[..., axis] == place).all(axis=1)) == len(facets) / 3


def test_velocity_of_solids_shows_the_side_behind_the_interface(tmp_path):
    """The minus body at 0, 1 and 2 m/s; the plus body, at 5 m/s, is left out."""
    with Record(synthetic.write_surface_run(tmp_path / "run")) as record:
        synthetic.write_solids(record.path, np.full(3, 5.0), np.array([0.0, 1.0, 2.0]))
        film = movies.film(record, "velocity")
        assert film.label == "Particle speed (m/s)" and "the body plus" in film.remark
        assert film.look["norm"].vmax == 2.0
        for row, part in ((0, 0.0), (1, 0.5), (2, 1.0)):
            colour = np.round(255 * np.array(colormaps[WAVE_MAP](part)[:3]))
            image = film.image(row)
            like = (np.abs(image - colour) <= 1).all(axis=2)
            assert like.mean() > 0.15
            rows, columns = np.nonzero(like)
            assert like[rows.min() : rows.max(), columns.min() : columns.max()].mean() > 0.5
        assert movies.save(record, "velocity", tmp_path / "film.gif", most=3) == 3
    short = synthetic.write_surface_run(tmp_path / "short")
    synthetic.write_solids(short, np.ones(1), np.ones(1))
    with Record(short) as record, pytest.raises(RuptfxError, match=facts("1 snapshots .* output.bulk_interval")):
        movies.film(record, "velocity")
