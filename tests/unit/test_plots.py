"""Figures: guide lines where they belong, odd runs, and an image that is right in itself."""

import tomllib
from types import SimpleNamespace
from unittest.mock import patch

import h5py
import matplotlib
import numpy as np
import pytest
import tomli_w
import xarray
from helpers import synthetic
from helpers.messages import facts
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from PIL import Image

from ruptfx import RuptfxError
from ruptfx.results import plots
from ruptfx.results.analysis import summarise
from ruptfx.results.analysis.compression import emission_of
from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import edges, limit, new_figure, save, scale, style
from ruptfx.results.plots import surface_maps as _surface_maps
from ruptfx.results.plots._panels import _displaced
from ruptfx.results.plots._record import default_times
from ruptfx.results.plots.cycles import ruptures
from ruptfx.results.record import Record, RecordError

TIME, POSITION = synthetic.times(121), synthetic.points(40)


def record_of(tmp_path, field, **options):
    return Record(synthetic.write_run(tmp_path / "run", field, TIME, POSITION, **options))


@pytest.fixture
def train(tmp_path):
    with record_of(tmp_path, np.maximum(synthetic.train(TIME, POSITION), 0)) as record:
        yield record


@pytest.mark.parametrize("size", [1.0, 0.0])
def test_slow_and_fast_phases_have_a_figure_of_their_own(tmp_path, size):
    """Two ruptures of 60 us, loaded for 10 s each."""
    rest, crack = np.full((20, len(POSITION)), 1e-9), synthetic.crack(TIME, POSITION)
    field = size * np.concatenate([rest, crack, rest, crack, rest])
    slow, fast = np.full(len(rest), 0.5), np.full(len(crack), TIME[1] - TIME[0])
    time = np.cumsum(np.concatenate([slow, fast, slow, fast, slow]))
    path = synthetic.write_run(tmp_path / "run", field, time, POSITION)
    with Record(path) as record:
        figures = plots.all_figures(record)
        assert "cycles" in figures and "space_time" not in figures
        found = ruptures(record)
        assert len(found) == (2 if size else 0)
        for first, last in found:
            assert 30e-6 < float(record.interface.time[last] - record.interface.time[first]) < 61e-6
        if size:
            # Records are equally high on an axis of time; ticks where the ruptures begin.
            ax = figures["cycles"].axes[2]
            assert ax.get_ylabel().startswith("Time (s)")
            np.testing.assert_allclose(ax.get_yticks()[1:3], time[[first for first, _ in found]], rtol=0.02)
            heights = np.diff(ax.transAxes.inverted().transform(ax.transData.transform(
                np.column_stack([np.zeros(4), edges(time)[[0, 1, 100, 101]]])))[:, 1])  # fmt: skip
            np.testing.assert_allclose(heights[[0, 2]], 1 / len(time), rtol=1e-6)
        visible = [ax for ax in figures["cycles"].axes if ax.get_visible()]
        assert len(visible) == (6 if size else 1)  # with two colour bars; the force alone where nothing slides


@pytest.mark.slow
def test_saving_lays_out_once_and_draws_once(train, tmp_path):
    """What matplotlib would do in two drawings comes out the same, to the pixel."""
    figures = {name: plots.snapshots(train).figure for name in ("ours", "theirs")}
    # By figure, as the thread of a lumped model that an earlier test left may still draw its own.
    with patch.object(Figure, "draw", autospec=True, side_effect=Figure.draw) as draw:
        save(figures["ours"], tmp_path / "ours.png", "png")
        with style():
            figures["theirs"].savefig(tmp_path / "theirs.png")
    drawn = [call.args[0] for call in draw.call_args_list]
    assert [sum(figure is each for each in drawn) for figure in figures.values()] == [1, 2]
    ours, theirs = (np.asarray(Image.open(tmp_path / f"{name}.png")) for name in figures)
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("changes", [False, True])
def test_saving_lays_out_again_if_tick_labels_change(changes, tmp_path):
    """Axes that the layout has made wider or narrower may have longer labels, which would cover those beside them."""
    with style():
        figure, axes = new_figure(1, 2, 2.0)
        ax = axes[0, 1]
        begin = ax.get_position().x0
        ax.yaxis.set_major_formatter(lambda *_: "6" if not changes or ax.get_position().x0 == begin else "62.5")
    engine = type(figure.get_layout_engine())
    with patch.object(engine, "execute", autospec=True, side_effect=engine.execute) as execute:
        save(figure, tmp_path / "figure.png", "png")
    assert execute.call_count == 1 + changes


def test_guide_lines_run_at_the_wave_speeds(train):
    (ax, _) = plots.space_time(train).figure.axes
    rays = [line for line in ax.lines if line.get_gid() == "ray"]
    # Axes are in mm and µs: a line's slope dx/dt is its speed in 1000 m/s.
    slopes = [np.ptp(line.get_xdata()) / np.ptp(line.get_ydata()) for line in rays]
    np.testing.assert_allclose(slopes, [1.155, 1.255, np.sqrt(2) * 1.255, 2.2])
    assert [text.get_text() for text in ax.texts] == ["$c_R$", "$c_s$", r"$\sqrt{2}\,c_s$", "$c_l$"]
    # None leaves the picture: 100 mm, 60 µs.
    assert max(line.get_xdata().max() for line in rays) <= 100.001
    assert max(line.get_ydata().max() for line in rays) <= 60.001


def test_rays_leave_an_inner_origin_to_both_sides(tmp_path):
    field = synthetic.crack(TIME, np.abs(POSITION - 0.03))
    with record_of(tmp_path, field, V_imp=0.0) as record:
        ax = plots.space_time(record).figure.axes[0]
        assert len([line for line in ax.lines if line.get_gid() == "ray"]) == 8


def test_slip_rate_shows_the_data(train):
    mesh = plots.space_time(train).figure.axes[0].collections[0]
    values = mesh.get_array()
    assert values.shape == (len(TIME), len(POSITION))
    # Everything slower than 2 % of 2 m/s is left white.
    np.testing.assert_array_equal(np.ma.getmaskarray(values), train.interface["slip_rate"].values < 0.04)


def test_antiplane_knows_only_the_shear_wave(tmp_path):
    with record_of(tmp_path, synthetic.crack(TIME, POSITION), plane="antiplane") as record:
        figures = plots.all_figures(record)
        assert "fringes" not in figures and "wavefield" in figures
        assert [text.get_text() for text in figures["space_time"].axes[0].texts] == ["$c_s$"]
        assert plots.fringes(record).figure.axes[0].texts[0].get_text().startswith("no fringes")


def test_a_run_without_sliding_says_so(tmp_path):
    with record_of(tmp_path, np.zeros((len(TIME), len(POSITION)))) as record:
        texts = [text.get_text() for ax in plots.space_time(record).figure.axes for text in ax.texts]
        assert "no sliding" in texts


def bodies(record, c_p, c_s):
    """Give the record bodies with these wave speeds."""
    with h5py.File(record.path / "interface.h5", "a") as file:
        file.attrs.update(bodies=["lower", "upper"], c_p_of_bodies=c_p, c_s_of_bodies=c_s)
    return Record(record.path)


def remarks(figure):
    """What is printed in small type below the panels."""
    return figure.get_supxlabel()


def test_bodies_that_differ_have_their_own_guide_lines(train):
    with bodies(train, [2200.0, 1800.0], [1255.0, 1000.0]) as record:
        figure = plots.space_time(record).figure
        rays = [line for line in figure.axes[0].lines if line.get_gid() == "ray"]
        slopes = [np.ptp(line.get_xdata()) / np.ptp(line.get_ydata()) for line in rays]
        np.testing.assert_allclose(slopes, [1.0, 1.255, 1.8, 2.2])
        assert [line.get_linestyle() for line in rays] == [":", "--", ":", "--"]
        for drawn in (figure, plots.front(record).figure, plots.snapshots(record).figure):
            assert "dashed lower; dotted upper" in remarks(drawn)
    with bodies(train, [2200.0, 2200.0], [1255.0, 1255.0]) as record:
        assert len([line for line in plots.space_time(record).figure.axes[0].lines if line.get_gid() == "ray"]) == 4
        assert "dashed" not in remarks(plots.space_time(record).figure)


def test_antiplane_bodies_that_differ_have_no_other_speed(tmp_path):
    plain = record_of(tmp_path, synthetic.crack(TIME, POSITION), plane="antiplane")
    with bodies(plain, [1255.0, 1000.0], [1255.0, 1000.0]) as record:
        assert [text.get_text() for text in plots.space_time(record).figure.axes[0].texts] == ["$c_s$", "$c_s$"]


def test_the_fast_wave_has_the_name_of_its_plane(tmp_path):
    with record_of(tmp_path, synthetic.crack(TIME, POSITION), plane="strain") as record:
        assert plots.space_time(record).figure.axes[0].texts[-1].get_text() == "$c_p$"


def test_turned_signs_are_said(tmp_path):
    for sign, text in ((1, ""), (-1, "signs of slip, slip rate and shear traction are turned")):
        with record_of(tmp_path / str(sign), sign * synthetic.crack(TIME, POSITION)) as record:
            for figure in (plots.snapshots(record).figure, plots.slip_profiles(record).figure):
                assert (text in remarks(figure)) if text else "turned" not in remarks(figure)


def test_a_speed_panel_without_a_speed_says_why(tmp_path):
    together = np.where(TIME[:, None] > 20e-6, 1.0, 0.0) * np.ones_like(POSITION)
    with record_of(tmp_path / "all", together) as record:
        assert "slide at once" in plots.front(record).figure.axes[1].texts[-1].get_text()
    with record_of(tmp_path / "few", together * (np.arange(len(POSITION)) < 3)) as record:
        assert "fewer than four points" in plots.front(record).figure.axes[1].texts[-1].get_text()


def test_speeds_leave_out_an_inner_origin(tmp_path):
    # To both sides of 50 mm at 2100 m/s: across the origin a line through all arrivals would be flat, faster than c_p.
    field = synthetic.crack(TIME, np.abs(POSITION - 0.05))
    with record_of(tmp_path, field, V_imp=0.0) as record:
        position, speed = plots.front(record).figure.axes[1].lines[0].get_data()
    # Within 2.25 mm, nine tenths of half the window, both directions are in it.
    assert np.isnan(speed[np.abs(position - 50) < 1.9]).all()
    drawn = np.isfinite(speed)
    assert drawn[(np.abs(position - 50) > 2.6) & (np.abs(position - 50) < 48)].all()
    assert speed[drawn] == pytest.approx(2.1, rel=0.2)  # 0.5 us between saved times


def test_points_that_slide_are_marked(train):
    """Those of the saved time nearest to the snapshot."""
    figure = plots.wavefield(train, at=[1e-5, 4e-5]).figure
    snapshots, data, counts = train.bulk["time"].values, train.interface, []
    for ax, wanted in zip(figure.axes, (1e-5, 4e-5), strict=False):
        row = np.abs(data.time.values - snapshots[np.abs(snapshots - wanted).argmin()]).argmin()
        (marks,) = [line for line in ax.lines if line.get_gid() == "sliding"]
        expected = data.position.values[np.abs(data.slip_rate.values[row]) > 1e-3]
        np.testing.assert_allclose(marks.get_xdata(), expected / 1e-3)
        counts.append(len(expected))
    assert 0 < counts[0] < counts[1]


def test_colour_bars_have_an_arrow_where_they_are_cut(train):
    def arrows(figure):
        return [image.colorbar.extend for ax in figure.axes for image in (*ax.collections, *ax.images)
                if image.colorbar is not None]  # fmt: skip

    assert arrows(plots.wavefield(train).figure) == ["max"]
    assert arrows(plots.fringes(train).figure) == ["neither"]
    assert arrows(plots.space_time(train).figure) == ["both"]


def with_materials(record, table):
    case = (record.path / "case.toml").read_text().split("[materials")[0]
    (record.path / "case.toml").write_text(case + tomli_w.dumps(table))
    return Record(record.path)


def test_without_a_fringe_constant_there_are_no_fringes(train):
    with with_materials(train, {"materials": {"default": {"density": 1.0}}}) as record:
        assert "fringes" not in plots.all_figures(record)
        assert "fringe_constant" in plots.fringes(record).figure.axes[0].texts[0].get_text()
        assert len(plots.fringes(record, at=0.0, fringe_constant=22.6e3, thickness=9.5e-3).figure.axes) == 2
    with with_materials(train, {"materials": {"default": {"fringe_constant": 22.6e3}}}) as record:
        assert "fringes" not in plots.all_figures(record)
        assert "plate_thickness" in plots.fringes(record).figure.axes[0].texts[0].get_text()


def test_every_body_has_its_own_fringes(train):
    # sigma_1 - sigma_2 = 6 MPa in plates of 10 mm: N = 2 at 30 kN/m is black; the other body has no constant.
    table = {"materials": {"lower": {}, "upper": {"fringe_constant": 30e3}}, "output": {"plate_thickness": 10e-3}}
    with with_materials(train, table) as record:
        figure = plots.fringes(record, at=0.0).figure
        image = np.ma.filled(figure.axes[0].images[0].get_array(), np.nan)
        half = len(image) // 2
        assert np.isnan(image[: half - 2]).all()
        np.testing.assert_allclose(image[half + 2 :], 0, atol=1e-12)
        assert figure.axes[1].get_xlabel().endswith("no fringe constant (lower), 3 MPa per fringe (upper)")


def test_fringes_say_what_initial_stress_is_assumed(train):
    for source, text in (("given", ""), ("assumed: uniaxial", "Initial stress assumed: uniaxial.")):
        with h5py.File(train.path / "bulk.h5", "a") as file:
            file.attrs["initial_stress"] = source
        with Record(train.path) as record:
            assert remarks(plots.fringes(record, at=0.0).figure) == text


def test_stresses_of_rock_make_no_fringes(train):
    with h5py.File(train.path / "bulk.h5", "a") as file:
        file["fringe"][:] = 200e6  # 84 fringes
    assert "fringes" not in plots.all_figures(train)


def test_bodies_without_an_interface(train):
    (train.path / "interface.h5").unlink()
    found = set(plots.all_figures(Record(train.path)))
    assert found >= {"fringes", "wavefield", "energy_budget"} and found.isdisjoint({"space_time", "front"})
    assert summarise(Record(train.path))["energy_closure"] == pytest.approx(2e-4)


def test_a_figure_of_a_file_that_is_not_there_is_not_drawn(train, monkeypatch):
    """Its `suits` need not ask for the file; one that is damaged is no reason to be silent."""
    monkeypatch.setitem(plots._FILES, "front", SimpleNamespace(suits=lambda record: "slip" in record.interface))
    assert plots.suits("front", Record(train.path))
    (train.path / "interface.h5").write_bytes(b"")
    with pytest.raises(RecordError, match=r"interface\.h5"):
        plots.suits("front", Record(train.path))
    (train.path / "interface.h5").unlink()
    assert not plots.suits("front", Record(train.path))


def test_missing_files_mean_fewer_figures(train):
    (train.path / "bulk.h5").unlink()
    found = set(plots.all_figures(train))
    assert found >= {"space_time", "front", "energy_budget"} and found.isdisjoint({"fringes", "wavefield"})


def test_slip_is_positive_in_its_direction(tmp_path):
    with record_of(tmp_path, -synthetic.crack(TIME, POSITION)) as record:
        lines = plots.slip_profiles(record).figure.axes[0].lines
        assert min(line.get_ydata().min() for line in lines) >= 0


def test_chosen_times_are_the_nearest_saved(train):
    figure = plots.snapshots(train, at=[20.1e-6, 40.2e-6]).figure
    assert [ax.get_title(loc="right") for ax in figure.axes[::2]] == ["20 µs", "40 µs"]
    assert len(plots.fringes(train, at=16e-6).figure.axes) == 2  # one panel and its colour bar


def test_fringes_count_the_stress(train):
    # Where nothing moves sigma_1 - sigma_2 = 6 MPa: N = 6 / 2.3789 = 2.5222, sin^2(pi N) = 0.9951.
    image = plots.fringes(train, at=0.0).figure.axes[0].images[0].get_array()
    assert float(image[-1, -1]) == pytest.approx(0.9951, abs=1e-4)
    light = plots.fringes(train, at=0.0, field="light").figure.axes[0].images[0].get_array()
    np.testing.assert_allclose(image + light, 1)


def test_energy_figure_shows_every_part(train):
    axes = plots.energy_budget(train).figure.axes
    labels = [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert labels == ["work", "kinetic", "strain", "interface elastic", "frictional dissipation", "damping"]
    # The table misses 2e-4 of the work, 0.02 %.
    assert np.nanmax(axes[1].lines[0].get_ydata()) == pytest.approx(0.02)


def test_energies_too_small_to_see_are_named_not_drawn(train):
    """Damping is 0.02 of the work in the file of 100 J/m; here a ten-thousandth of that is left."""
    path = train.path / "energy.csv"
    rows = [line.split(",") for line in path.read_text().splitlines()]
    rows[2:] = [[*row[:5], str(1e-4 * float(row[5])), *row[6:]] for row in rows[2:]]
    path.write_text("\n".join(",".join(row) for row in rows))
    with Record(train.path) as record:
        figure = plots.energy_budget(record).figure
        labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
        assert "damping" not in labels and "damping" in remarks(figure)


def crushed(tmp_path, failed):
    path = synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION)
    synthetic.write_cracks(path, failed)
    return Record(path)


@pytest.mark.parametrize("failed, drawn", [(100, False), (102, True)])
def test_statistics_of_emission_need_more_than_50_events(tmp_path, failed, drawn):
    """Half of the facets that failed radiate."""
    with crushed(tmp_path, failed) as record:
        assert plots.suits("emission", record) is drawn


def test_panels_of_emission_have_data(tmp_path):
    """Radii of the rose begin at zero; where no event counts there is no panel of events, and all sentences end."""
    with crushed(tmp_path, 120) as record:
        drawn = plots.emission(record).flat
        assert len(drawn) == 4 and not any(ax.name == "polar" for ax in drawn)  # load, map, magnitudes, rates
        assert plots.emission(record, field="rose").get_ylim()[0] == 0
        assert "Black" not in remarks(plots.emission(record, field=["load", "map"]).figure)
        none = plots.emission(record, found=emission_of(record, smallest=10.0, failure_time=0.0)).figure
        assert len([ax for ax in none.axes if ax.get_visible()]) == 2
        assert ": ." not in remarks(none) and "radiate." in remarks(none)


def test_panels_of_cracks_have_data(tmp_path):
    """No panel of forces where no edge bore one, none of distances with one event; no legend over a panel letter."""
    with crushed(tmp_path, 120) as record:
        assert len(plots.cracks(record).figure.axes) == 3
    with Record(tmp_path / "run") as record:
        table = "time,rock.top.displacement_y,rock.top.force_y\n0.0,0.0,0.0\n1e-6,1e-6,0\n"
        (record.path / "edges.csv").write_text(table)
        figure = plots.cracks(record).figure
        assert len(figure.axes) == 2
        figure.draw_without_rendering()
        (legend,) = figure.legends
        assert not any(legend.get_window_extent().overlaps(ax.get_tightbbox()) for ax in figure.axes)


def test_figures_say_what_the_summary_calls_not_resolved(tmp_path):
    summary = {"mode": "not resolved", "not_resolved": "chatter of 7 nodes", "peak_slip_rate_resolved": False}
    field = np.maximum(synthetic.train(TIME, POSITION), 0)
    for number, (known, said) in enumerate(((summary, True), ({"mode": "train", "not_resolved": None}, False))):
        path = synthetic.write_run(tmp_path / str(number), field, TIME, POSITION, summary=known)
        with Record(path) as record:
            for name in ("space_time", "snapshots", "front"):
                assert ("chatter of 7 nodes" in remarks(plots.FIGURES[name](record).figure)) is said, name


def test_open_faces_have_no_slip_rate(tmp_path):
    """From 30 to 40 mm the faces are open, and slide at 2 m/s: grey there, and no curve."""
    path = synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION)
    away = (POSITION > 0.03) & (POSITION < 0.04)
    with h5py.File(path / "interface.h5", "a") as file:
        file["opening"][...] = np.where(away, 1e-6, file["opening"][...])
        file["normal_stress"][...] = np.where(away, 0.0, file["normal_stress"][...])
    with Record(path) as record:
        figure = plots.snapshots(record, at=[50e-6]).figure
        (rate,) = [line for line in figure.axes[0].lines if len(line.get_xdata()) == len(POSITION)]
        np.testing.assert_array_equal(np.isnan(rate.get_ydata()), away)
        assert [each.get_gid() for each in figure.axes[0].collections].count("open") == 1
        mesh = plots.space_time(record).figure.axes[0].collections
        assert "Grey" in remarks(plots.space_time(record).figure) and "Grey" in remarks(figure)
        columns = np.ma.getmaskarray(mesh[-1].get_array()).reshape(len(TIME), -1)
        assert columns[-1][away].all() and not columns[-1][POSITION < 0.03].any()


def test_single_values_do_not_flatten_a_curve():
    """A hundred values from 0 to 1 and one of 50: limits are 98 % of them and half of that range on both sides."""
    axes = new_figure(1, 1, 2.0)[1][0, 0]
    values = np.append(np.linspace(0, 1, 1000), 50.0)
    assert limit(axes, values) and axes.get_ylim() == pytest.approx((0, 1.48), abs=0.01)
    assert not limit(axes, values[:-1])


def test_save_all(train, tmp_path, blank_pictures):
    paths = plots.save_all(train, tmp_path / "pictures", formats=("png", "pdf"))
    assert len(paths) == 2 * len(plots.all_figures(train)) and all(path.stat().st_size > 500 for path in paths)


@pytest.mark.parametrize(("directory", "kind"), [("file", "png"), ("fine", "xyz")])
def test_save_all_refuses(train, tmp_path, directory, kind):
    (tmp_path / "file").write_text("")
    with pytest.raises(RuptfxError, match=facts(f"{directory}: figures cannot be saved")):
        plots.save_all(train, tmp_path / directory, formats=(kind,))


def test_the_users_style_is_left_alone(train):
    with matplotlib.rc_context({"font.size": 20}):
        figure = plots.space_time(train).figure
        assert matplotlib.rcParams["font.size"] == 20
        assert figure.axes[0].xaxis.label.get_size() == 8


def test_raster_of_a_mesh_with_triangles_and_a_hole():
    # Two unit squares side by side with a gap of one; the field x + 10 y is linear, hence exact inside cells.
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [3, 0], [3, 1], [2, 1]], dtype=float)
    quads = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
    for cells in (quads, np.vstack([quads[:, :3], quads[:, [0, 2, 3]]])):
        image = Raster(points, cells, pixels=30)(points[:, 0] + 10 * points[:, 1])
        assert image.shape == (10, 30)
        assert np.isnan(image[:, 10:20]).all() and np.isfinite(image[:, :10]).all()
        # Pixel (row 2, column 25) has its centre at (2.55, 0.25).
        assert image[2, 25] == pytest.approx(2.55 + 2.5)


def test_pieces_that_move_far_are_drawn_where_they_are():
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    moved = np.stack([np.zeros((4, 2)), np.broadcast_to([2.0, 0.0], (4, 2))])
    bulk = xarray.Dataset({
        "points": (("node", "axis"), points), "cells": (("cell", "corner"), np.array([[0, 1, 2, 3]])),
        "displacement": (("time", "node", "axis"), moved),
    })  # fmt: skip
    first, last = _displaced(SimpleNamespace(case={"large_rotations": True}, bulk=bulk, interfaces={}), [0, 1])
    for raster, filled in ((first, slice(0, 333)), (last, slice(667, 1000))):
        shown = np.isfinite(raster(points[:, 0]))
        assert raster.extent == (0, 3, 0, 1) and shown[:, filled].all()
        assert shown.mean() == pytest.approx(1 / 3, abs=2e-3)
    assert _displaced(SimpleNamespace(case={}, bulk=bulk, interfaces={"main": {}}), [0, 1]) is None
    slides = SimpleNamespace(case={}, bulk=bulk, interfaces={"main": {"contact": None}})
    assert [raster.extent for raster in _displaced(slides, [0, 1])] == [first.extent, last.extent]


@pytest.mark.parametrize(
    ("value", "unit", "name"),
    [
        (0.06, "m", "mm"),
        (3e-5, "m", "µm"),
        (15e3, "m", "km"),
        (60e-6, "s", "µs"),
        (6e6, "Pa", "MPa"),
        (0.2, "m/s", "m/s"),
        (9.9e7, "s", "s"),
        (1e8, "s", "yr"),
        (1e-6, "m/s", "µm/s"),
        (0.0, "m", "m"),
        (np.nan, "s", "s"),
    ],
)
def test_units_that_read_well(value, unit, name):
    assert scale(value, unit)[1] == name


def test_default_times_end_with_the_rupture(train):
    # The tip arrives at 100 mm at 52.6 µs, which these files round up to the next saved time, 53 µs.
    chosen = default_times(train, TIME, 4)
    assert len(chosen) == 4 and TIME[chosen[-1]] == pytest.approx(53e-6)


def test_strength_is_beside_the_traction_of_a_real_run(tmp_path):
    """Where it slides the traction is the strength; a point ahead of the front carries less."""
    pytest.importorskip("dolfinx")
    from helpers.small_cases import case, slip_weakening

    from ruptfx import simulate
    from ruptfx.results.strength import strength

    table = slip_weakening({"duration": 3e-6, "faults.main.nucleation": [
        {"kind": "friction_drop", "center": 6e-3, "half_width": 2e-3, "mu_d": 0.1}
    ]})  # fmt: skip
    with simulate(case().__class__(**table), tmp_path / "run", progress=False) as record:
        last = record.interface.isel(time=-1)
        found = strength(record, -1)
        assert found is not None
        traction, rate = np.abs(last.shear_traction.values), np.abs(last.slip_rate.values)
        slides = rate > 1e-3 * rate.max()
        assert slides.any() and not slides.all()
        np.testing.assert_allclose(traction[slides], found[slides], rtol=1e-6)
        assert (traction[~slides] < found[~slides] * (1 + 1e-9)).all()
        axes = plots.snapshots(record, field="shear_traction", at=float(last.time), units={"shear_traction": "kPa"})
        (line,) = (line for line in axes.lines if line.get_gid() == "strength")
        np.testing.assert_allclose(line.get_ydata(), found / 1e3)
        assert "Dotted" in plots.remarks(axes)


def test_white_is_said(tmp_path):
    time, position = synthetic.times(31), synthetic.points(20)
    with Record(synthetic.write_run(tmp_path / "run", synthetic.crack(time, position), time, position)) as record:
        # 2 % of the driven 2 m/s.
        assert "White: slower than 0.04 m/s" in remarks(plots.space_time(record).figure)
        drawn = plots.snapshots(record).figure
        assert not [line for ax in drawn.axes for line in ax.lines if line.get_gid() == "strength"]
        assert len(plots.snapshots(record, at=0.0).figure.axes) == 2  # one time is no reason to leave the rate out
        # 6 MPa everywhere: a sentence instead of a column.
        assert "normal stress is 6 MPa everywhere" in remarks(drawn) and len(drawn.axes) % 2 == 0


@pytest.fixture
def branched(tmp_path):
    with Record(synthetic.write_surface_run(tmp_path / "run", branch=True)) as record:
        yield record


def test_every_surface_has_a_panel_with_the_same_colours(branched):
    """The slip of the fault is at most 10 s at 1 m/s, that of the branch 9 s at 2 m/s."""
    axes = plots.rupture_map(branched)
    assert [ax.get_title(loc="right") for ax in axes.flat] == ["main", "branch"]
    meshes = [next(item for item in ax.collections if item.get_array() is not None) for ax in axes.flat]
    assert [mesh.get_array().max() for mesh in meshes] == pytest.approx([10.0, 18.0])
    assert [mesh.get_clim() for mesh in meshes] == [pytest.approx((0.0, 18.0))] * 2
    axes = plots.slip_rate_maps(branched, at=[2.0, 9.0])
    assert [ax.get_title(loc="right") for ax in axes.flat] == ["main\n2 s", "branch\n2 s", "main\n9 s", "branch\n9 s"]
    meshes = [ax.collections[0] for ax in axes.flat]
    assert [mesh.get_array().max() for mesh in meshes] == [1.0, 2.0, 1.0, 2.0]
    assert len({mesh.get_clim() for mesh in meshes}) == 1


def test_times_of_maps_are_those_of_equal_areas(tmp_path):
    """A front that leaves the middle at 2.5 km/s and a point that ruptures at 10 s: sixths of the area."""
    path = synthetic.write_surface_run(tmp_path / "run", count=401)
    with h5py.File(path / "interface.h5", "a") as file:
        file["rupture_time"][0] = 10.0
    with Record(path) as record:
        titles = [ax.get_title(loc="right") for ax in plots.slip_rate_maps(record).flat]
        data = record.interface
        distance = np.hypot(data.position, data.dip - 10e3).values
        area = [float(data.area.values[distance <= 2500.0 * float(title.split()[0])].sum()) for title in titles]
    np.testing.assert_allclose(np.array(area) / area[-1] * 0.98, [1 / 6, 2 / 6, 3 / 6, 4 / 6, 5 / 6, 0.98], atol=0.03)


def test_the_first_map_shows_the_slip_of_a_patch_that_slips_at_once(tmp_path):
    """Half of a surface ruptures at the start, where no point slips yet: its map is that of the second record."""
    path = synthetic.write_surface_run(tmp_path / "run", count=11)
    with h5py.File(path / "interface.h5", "a") as file:
        time = file["time"][:]
        half = np.arange(file["rupture_time"].shape[0]) % 2 == 0
        file["rupture_time"][:] = np.where(half, time[0], 4.5 * time[1])
        file["slip_rate_1"][0] = 0.0
        file["slip_rate_1"][1:] = 1.0
    with Record(path) as record:
        axes = plots.slip_rate_maps(record)
        titles = [ax.get_title(loc="right") for ax in axes.flat if ax.get_visible()]
        assert [float(title.split()[0]) for title in titles] == pytest.approx([time[1], time[5]])
        assert all(ax.xaxis.get_tick_params()["labelbottom"] for ax in axes.flat if ax.get_xlabel())
        assert "Colours" not in remarks(axes.flat[0].figure)  # the largest value is the end of the colours


def test_a_surface_without_slip_has_the_colour_of_zero(tmp_path):
    path = synthetic.write_surface_run(tmp_path / "run", count=6)
    with h5py.File(path / "interface.h5", "a") as file:
        file["slip_1"][:] = 0.0
        file["slip_2"][:] = 0.0
        file["rupture_time"][:] = np.nan
    with Record(path) as record:
        (ax,) = np.ravel(plots.rupture_map(record))
        mesh = next(item for item in ax.collections if item.get_array() is not None)
        assert mesh.get_clim() == (0.0, 1.0) and mesh.get_array().max() == 0.0
        assert remarks(ax.figure) == "No point has ruptured."


def test_single_contacts_have_no_front(tmp_path):
    """Every third point slides: dots without lines, and no speed; groups of five have both."""
    path = synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION)
    for group, lines in ((1, False), (5, True)):
        with h5py.File(path / "interface.h5", "a") as file:
            arrival = np.linspace(1e-6, 30e-6, len(POSITION))
            file["rupture_time"][:] = np.where(np.arange(len(POSITION)) % (group + 2) < group, arrival, np.nan)
        with Record(path) as record:
            times, speeds = plots.front(record).flat
            assert (times.lines[0].get_linestyle() == "-") is lines
            assert np.isfinite(speeds.lines[0].get_ydata()).any() == lines


def test_instruments_of_one_quantity_have_one_scale(tmp_path):
    """Velocities of 2 and 1 m/s share unit and limits; one of 1 mm/s has the unit, and limits of its own."""
    path = synthetic.write_run(tmp_path / "run", synthetic.crack(TIME, POSITION), TIME, POSITION)
    sizes = {"a": 2.0, "b": 1.0, "c": 1e-3}
    case = tomllib.loads((path / "case.toml").read_text())
    case["instruments"] = [{"kind": "receiver", "name": name, "point": [0.0, 0.0], "interval": 1e-6} for name in sizes]
    (path / "case.toml").write_text(tomli_w.dumps(case))
    time = np.linspace(0.0, 30e-6, 31)
    for number, (name, size) in enumerate(sizes.items()):
        columns = {f"velocity_{axis}": ("time", part * size * np.sin(time * 1e5), {"units": "m/s"})
                   for axis, part in (("x", 1.0), ("y", 0.5))}  # fmt: skip
        xarray.Dataset(columns, {"time": time}).to_netcdf(
            path / "instruments.h5", "a" if number else "w", group=name, engine="h5netcdf"
        )
    with Record(path) as record:
        axes = plots.instruments(record).flat[:3]
        assert len({ax.get_ylabel() for ax in axes}) == 1
        assert axes[0].lines[0].get_ydata().max() / axes[2].lines[0].get_ydata().max() == pytest.approx(2e3)
        assert axes[0].get_ylim()[0] == axes[1].get_ylim()[0] < 100 * axes[2].get_ylim()[0] < 0
        assert len({line.get_linestyle() for line in axes[0].lines}) == 2  # components differ in print


def test_a_map_without_contours_does_not_speak_of_them(branched):
    """Rupture times of neighbours that differ at random have no contours."""
    with_contours = remarks(plots.rupture_map(branched).figure)
    assert with_contours.startswith("Contours")
    ax = Figure().add_subplot()
    data = branched.interface
    assert _surface_maps.contours(ax, data, data["rupture_time"].values, np.array([1.0, 2.0]))
    assert not _surface_maps.contours(ax, data, data["rupture_time"].values, np.array([100.0, 200.0]))
    assert not _surface_maps.contours(ax, data, data["rupture_time"].values, np.array([1.0]), largest=1e-9)


def test_slip_rates_of_cycles_have_logarithmic_colours(tmp_path):
    """Half of a surface slides at 1 m/s for seconds, after 30 years at 1e-9 m/s and before as many at 1e-12 m/s."""
    path = synthetic.write_surface_run(tmp_path / "run", count=6)
    with xarray.open_dataset(path / "interface.h5", engine="h5netcdf") as opened:
        data = opened.load()
    peak = np.array([1e-9, 1e-9, 1.0, 0.5, 1e-12, 1e-12])
    half = data.position.values < 0
    data["slip_rate_1"] = (("time", "point"), np.where(half, peak[:, None], 1e-9))
    data = data.assign_coords(time=[0.0, 1e9, 1e9 + 4, 1e9 + 5, 1e9 + 90, 2e9])
    data.to_netcdf(path / "interface.h5", engine="h5netcdf")
    with Record(path) as record:
        axes = list(plots.slip_rate_maps(record).flat)
        titles = [ax.get_title(loc="right") for ax in axes if ax.get_visible()]
        assert titles == ["31.7 yr", "(a) + 4 s", "(a) + 5 s", "(a) + 90 s"]
        meshes = [ax.collections[0] for ax in axes if ax.get_visible()]
        assert all(isinstance(mesh.norm, LogNorm) and mesh.get_clim() == (1e-10, 1.0) for mesh in meshes)
        assert [mesh.get_array().min() for mesh in meshes] == pytest.approx([1e-9, 1e-9, 1e-9, 1e-10])
        assert not isinstance(plots.slip_rate_maps(record, field="slip").flat[0].collections[0].norm, LogNorm)


@pytest.mark.parametrize("name", ["rupture_map", "slip_rate_maps"])
def test_a_surface_is_chosen_by_its_name(branched, name):
    ax = plots.FIGURES[name](branched, Figure().add_subplot(), fault="branch")
    assert ax.get_xlim() == (-10.0, 10.0) and ax.get_title(loc="right").startswith("branch")
    with pytest.raises(RuptfxError, match=rf"plots\.{name}: 2 panels .*fault = 'main', 'branch'"):
        plots.FIGURES[name](branched, Figure().add_subplot())
    with pytest.raises(RuptfxError, match=rf"plots\.{name}: fault = 'brunch': .*branch"):
        plots.FIGURES[name](branched, fault="brunch")


def test_the_moment_is_that_of_all_surfaces(branched):
    """Each line is the shear modulus times the integral of the slip; the first is their sum."""
    lines = plots.moment_rate(branched, field="moment", units={"moment": "N m"}).lines
    assert [line.get_label() for line in lines] == ["all", "main", "branch"]
    found = {line.get_label(): line.get_ydata()[-1] for line in lines}
    for name, data in branched.interfaces.items():
        assert found[name] == pytest.approx(32e9 * float(data["area"].values @ data["slip_1"].values[-1]))
    assert found["all"] == pytest.approx(found["main"] + found["branch"])


def test_slip_everywhere_has_the_colours_of_its_differences(branched):
    """Slip of 0 to 18 m begins at zero; with 30 m more everywhere, at 30 m."""
    assert plots.rupture_map(branched).flat[0].collections[0].norm.vmin == 0.0
    for data in branched.interfaces.values():
        data["slip_1"].values[:] += 30.0
    norm = plots.rupture_map(branched).flat[0].collections[0].norm
    assert (norm.vmin, norm.vmax) == pytest.approx((30.0, 48.0), rel=0.05)


def test_long_surfaces_are_below_each_other(branched):
    """Side by side, two surfaces 6 and 3 times as long as deep would be less than an inch high."""
    assert plots.rupture_map(branched).shape == (1, 2)
    for data in branched.interfaces.values():
        data["position"].values[:] *= 3
    axes = plots.rupture_map(branched)
    axes[0, 0].figure.draw_without_rendering()
    assert axes.shape == (2, 1)
    assert axes[0, 0].get_window_extent().y0 > axes[1, 0].get_window_extent().y1


@pytest.mark.parametrize("structured", [True, False])
def test_contours_of_rupture_time_end_where_the_front_dies(tmp_path, structured):
    """Beyond x = 8 km every point ruptures at a time of its own, and beyond 14 km none does."""
    with Record(synthetic.write_surface_run(tmp_path / "run", structured=structured)) as record:
        x, times = record.interface["position"].values, record.interface["rupture_time"].values
        times[x > 8e3] = 5.0 + 4.0 * np.random.default_rng(1).random((x > 8e3).sum())
        times[x > 14e3] = np.nan
        lines = plots.rupture_map(record).collections[1]
        drawn = np.concatenate([path.vertices for path in lines.get_paths() if len(path.vertices)])
    assert drawn[:, 0].min() < -15 and drawn[:, 1].min() < 1  # km: where the front is a circle
    inside = drawn[drawn[:, 0] > 9.0]
    assert len(inside) == 0


@pytest.mark.parametrize("name", ["rupture_map", "slip_rate_maps"])
def test_maps_of_a_plate_are_stretched_until_their_labels_fit(tmp_path, name):
    """40 km by 1 km: at one scale a map of 5.6 inch would be 0.14 inch high."""
    with Record(synthetic.write_surface_run(tmp_path / "run")) as record:
        record.interface["dip"].values[:] /= 20
        axes = plots.FIGURES[name](record)
        figure = plots.figure_of(axes)
        figure.draw_without_rendering()
        for ax in np.atleast_1d(axes).flat:
            assert ax.yaxis.label.get_window_extent().height <= 1.02 * ax.get_window_extent().height
        assert "Vertical axis stretched 6.8 times." in remarks(figure)
    with Record(synthetic.write_surface_run(tmp_path / "equal")) as record:
        assert "stretched" not in remarks(plots.figure_of(plots.FIGURES[name](record)))


def test_completion_offers_figures_and_no_imports() -> None:
    assert set(dir(plots)) == {*plots.__all__, *plots.FIGURES}


def test_numbered_colours_are_those_of_the_style_when_saved_as_usual(tmp_path):
    """A panel filled by a line of "C0", saved after the style was left: #0072b2 in its middle, at 100 dots per inch."""
    with matplotlib.rc_context({"savefig.dpi": 100}):
        with style():
            figure, axes = new_figure(1, 1, 1.0, 2.0)
            axes[0, 0].plot([0, 1], [0.5, 0.5], color="C0", lw=200)
        figure.savefig(tmp_path / "picture.png")
    pixels = np.asarray(Image.open(tmp_path / "picture.png").convert("RGB"))
    assert pixels.shape == (100, 200, 3) and tuple(pixels[45, 110]) == (0x00, 0x72, 0xB2)


def test_a_graded_lattice_in_any_order_has_no_holes() -> None:
    """Elements that grow towards the rim: long sides there are no bridges; without one corner they may be."""
    line = np.concatenate([-np.array([4.0, 2.0]), np.linspace(-1, 1, 21), [2.0, 4.0]])
    x, y = (each.ravel() for each in np.meshgrid(line, line))
    order = np.random.default_rng(1).permutation(len(x))
    assert not np.any(_surface_maps.triangulated(x[order], y[order]).mask)
    some = (x < 2) | (y < 2)
    assert np.any(_surface_maps.triangulated(x[some], y[some]).mask)
