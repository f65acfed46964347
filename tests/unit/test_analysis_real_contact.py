"""Real contact of surfaces: area of the points that touch, against discs and overlaps, and the part that is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from helpers import synthetic
from helpers.messages import facts
from helpers.sliding_cases import solids

from ruptfx import RuptfxError
from ruptfx.results import movies, plots
from ruptfx.results.analysis.real_contact import contact_area, contact_box, touching
from ruptfx.results.record import Record

RADII, MIDDLE = np.array([0.0, 3e3, 4e3]), np.array(synthetic.MIDDLE)  # m


def test_area_of_a_disc(tmp_path: Path) -> None:
    """Pi a^2 within the error of a grid of 500 m; nothing touches at first."""
    with Record(synthetic.write_pressed_run(tmp_path / "run", RADII)) as record:
        data = record.interface
        area = contact_area(data)
        assert area[0] == 0.0
        np.testing.assert_allclose(area[1:], np.pi * RADII[1:] ** 2, rtol=0.02)
        load = np.sum(data["normal_stress"].values[2] * data["area"].values)
        np.testing.assert_allclose(load / area[2], 2 / 3 * 9e6, rtol=0.02)  # the mean pressure of Hertz
        assert touching(data, 2).sum() == touching(data)[2].sum() > 100


def first_panel(record: Record, **options: Any) -> Any:
    axes: Any = plots.contact_maps(record, **options)
    return axes[0]


def test_part_that_is_drawn(tmp_path: Path) -> None:
    """The box of the disc with 15 % of its diameter around it, at any record; the whole surface if asked for."""
    with Record(synthetic.write_pressed_run(tmp_path / "run", RADII)) as record:
        ends = contact_box(record.interface)
        exact = MIDDLE[:, None] + np.array([-1, 1]) * 1.3 * RADII[-1]
        np.testing.assert_allclose(ends, exact, atol=600.0)
        for options in ({}, {"at": 0.0}):
            ax = first_panel(record, **options)
            np.testing.assert_allclose([ax.get_xlim(), ax.get_ylim()[::-1]], np.array(ends) / 1e3)
        ax = first_panel(record, whole=True)
        np.testing.assert_allclose([ax.get_xlim(), ax.get_ylim()[::-1]], [[-20, 20], [0, 20]])
        assert "50.25 km²" in plots.remarks(plots.contact_maps(record))


def test_film_of_a_growing_contact(tmp_path: Path) -> None:
    """Pixels without contact are NaN, the others have the pressure of Hertz; arrows are as long as the slip, 5 mm."""
    with Record(synthetic.write_pressed_run(tmp_path / "run", RADII)) as record:
        film = movies.film(record, "contact")
        left, right, bottom, top = np.array(film.extent) * 1e3
        for row, radius in enumerate(RADII):
            image = film.image(row)
            x, y = np.linspace(left, right, image.shape[1]), np.linspace(bottom, top, image.shape[0])
            away = np.hypot(x[None] - MIDDLE[0], y[:, None] - MIDDLE[1])
            assert np.isnan(image[away > radius + 500]).all()
            inner = away < max(radius - 1e3, 0.0)
            assert inner.any() == (row > 0)
            exact = 9 * np.sqrt(1 - (away[inner] / max(radius, 1.0)) ** 2)
            np.testing.assert_allclose(image[inner], exact, atol=0.3)
        assert film.look["vmax"] == pytest.approx(9.0, rel=1e-3) and "5 mm" in film.remark
        assert film.below is not None
        axes: Any = plots.contact_maps(record, field="slip")
        film.move(axes, 2)
        (arrows,) = axes.collections
        np.testing.assert_allclose(np.hypot(arrows.U, arrows.V), 5e-3)
        assert np.all(arrows.V < 0)
        update = film.below(axes)
        update(float(film.times[2]))
        (line, mark) = axes.lines
        np.testing.assert_allclose(line.get_ydata()[1:] * 1e6, np.pi * RADII[1:] ** 2, rtol=0.02)
        assert mark.get_ydata() == line.get_ydata()[2:]


def test_runs_without_a_contact_to_film(tmp_path: Path) -> None:
    path = synthetic.write_surface_run(tmp_path / "plain", count=3)
    with Record(path) as record, pytest.raises(RuptfxError, match=facts("--what slip_rate")):
        movies.film(record, "contact")
    path = synthetic.write_pressed_run(tmp_path / "apart", RADII)
    with h5py.File(path / "interface.h5", "a") as file:
        file["contact"][...] = 0
    with Record(path) as record, pytest.raises(RuptfxError, match=facts("3 .* --what slip_rate")):
        movies.film(record, "contact")


@pytest.mark.fem
@pytest.mark.parametrize("end, covered", [(3.0, 1.5), (1.0, 1.0), (0.5, 0.5)])
def test_area_of_a_block_that_overhangs(end: float, covered: float, tmp_path: Path) -> None:
    """A block of 1.5 mm x 1 mm under 10 MPa beside the end of the other one: the overlap, within half a node."""
    pytest.importorskip("dolfinx")
    from ruptfx.case import parse_case
    from ruptfx.run.simulation import simulate

    table = solids({
        "mesh.lower.length": 0.3e-3 + end * 1e-3, "duration": 4e-8, "boundaries": [],
        "faults.main.initial_stress.normal": 10e6, "output.interface_interval": 2e-8,
    })  # fmt: skip
    record = simulate(parse_case(table), tmp_path / "run", progress=False)
    data = record.interface
    exact, node = covered * 1e-6, 0.5e-6 / 6  # half of the outer node of a facet
    area = contact_area(data)
    np.testing.assert_allclose(area, exact, atol=1e-12 if end > 1.5 else node)
    forces = record.forces
    parts = forces["sticking"].values + forces["sliding"].values
    np.testing.assert_allclose(parts * data["area"].values.sum(), area, rtol=1e-9)
