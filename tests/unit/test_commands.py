"""Commands around a run: new, mesh, list, compare, export, resume, cite."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import tomli_w
import xarray
from helpers import synthetic
from helpers.labels import label_faults
from helpers.messages import says
from helpers.sliding_cases import solids
from helpers.small_cases import merged, plates, strike_slip
from matplotlib.image import imread
from typer.testing import CliRunner, Result

from ruptfx.app.cli import app
from ruptfx.app.commands._shared import keys, runs_and_files
from ruptfx.app.commands._shared import runs as run_directories
from ruptfx.app.commands.compare import _place, is_noise, overlay
from ruptfx.app.commands.new import cases
from ruptfx.results.analysis.emission import read_catalogue
from ruptfx.results.record import Record

ROOT = Path(__file__).parents[2]
fem = pytest.mark.fem


def ruptfx(*arguments: str | Path) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, [str(argument) for argument in arguments])


def said(result: Result) -> str:
    return " ".join(result.output.split())


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two finished runs, the second pressed together twice as much, with checkpoints."""
    pytest.importorskip("dolfinx")
    folder = tmp_path_factory.mktemp("runs")
    for name, changes in (("one", {}), ("two", {"faults.main.initial_stress.normal": 12e6})):
        keys = {"duration": 4e-6, "output.checkpoint_steps": 10, "output.figures": False, **changes}
        (folder / f"{name}.toml").write_text(tomli_w.dumps(merged(plates(), keys)))
        result = ruptfx("run", folder / f"{name}.toml", "--out", folder / name, "--quiet")
        assert result.exit_code == 0, said(result)
    return folder


# -- new and mesh ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("demo", cases())
def test_new_writes_a_case_that_is_commented(demo: str, tmp_path: Path) -> None:
    """Every demo: what it is in the first line, and comments at every other key or so."""
    from ruptfx.case import Case, read_case

    result = ruptfx("new", tmp_path / "mine.own", "--from", demo)
    path = tmp_path / "mine.own.toml"
    assert result.exit_code == 0 and f"ruptfx check {path}" in said(result)
    lines = path.read_text().splitlines()
    assert lines[0].startswith("# ") and f"demos/{demo}.toml" not in path.read_text()
    assert "exists already" in said(ruptfx("new", tmp_path / "mine.own", "--from", demo))
    if isinstance(read_case(path), Case):
        assert sum("#" in line for line in lines) >= 0.15 * sum("=" in line for line in lines)


RUN = ("impact", "gmsh", "stick_slip")
"""Demos whose copies `make test` runs; `-m slow` runs all."""


@pytest.mark.parametrize(
    "demo", [demo if demo in RUN else pytest.param(demo, marks=pytest.mark.slow) for demo in cases()]
)
def test_a_new_case_runs(demo: str, tmp_path: Path) -> None:
    """A few steps of every demo."""
    from ruptfx.case import Case, read_case

    path = tmp_path / "mine.toml"
    assert ruptfx("new", path, "--from", demo).exit_code == 0
    case = read_case(path)
    if not isinstance(case, Case):
        pytest.skip("tests/contracts/test_lumped.py runs lumped cases")
    pytest.importorskip("dolfinx")
    if demo == "gmsh":
        pytest.importorskip("gmsh")
    part = 2e-3 if case.stages else 1e-3  # a stage takes at least one step
    short = [f"duration={part * case.duration!r}", "output.figures=false"]
    short += [f"stages.{number}.duration={part * stage.duration!r}" for number, stage in enumerate(case.stages)]
    if hasattr(case.mesh, "element_size"):
        short.append(f"mesh.element_size={2 * case.mesh.element_size!r}")
        short += [
            f"instruments.{number}.interval={2 * each.interval!r}" for number, each in enumerate(case.instruments)
        ]
    options = [item for value in short for item in ("--set", value)]
    result = ruptfx("run", path, "--out", tmp_path / "run", "--quiet", *options)
    assert result.exit_code == 0, said(result)
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["steps"] > 0


def test_new_knows_its_demos(tmp_path: Path) -> None:
    assert says("did you mean 'bimaterial'?", said(ruptfx("new", tmp_path / "mine", "--from", "bimateral")))
    assert "known:" in said(ruptfx("new", tmp_path / "mine", "--from", "mode_map"))  # a study
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("demo", cases())
def test_new_replaces_materials(demo: str, tmp_path: Path) -> None:
    """All else stays; one material for all bodies, which is what the case then has."""
    from ruptfx.case import Case, read_case

    result = ruptfx("new", tmp_path / "mine", "--from", demo, "--materials", "steel")
    before = read_case(ROOT / "demos" / f"{demo}.toml")
    if not isinstance(before, Case):
        assert "no bodies with materials" in said(result) and not list(tmp_path.iterdir())
    else:
        case = read_case(tmp_path / "mine.toml")
        assert isinstance(case, Case) and list(case.materials) == ["default"]
        steel = case.materials["default"]
        assert steel.density == 7850.0 and steel.wave_speeds("strain").c_s == pytest.approx(3235.0)
        # Files of the demo are copied with the case.
        tables = [
            json.loads(json.dumps(each.table()).replace(str(folder), "."))
            for each, folder in ((before, ROOT / "demos"), (case, tmp_path))
        ]
        for table in tables:
            del table["materials"]
        assert tables[0] == tables[1]


def test_new_with_a_material_for_each_body(tmp_path: Path) -> None:
    from ruptfx.case import Case, read_case

    for demo in ("impact", "bimaterial"):  # with a default, and with a table for each
        assert ruptfx("new", tmp_path / demo, "--from", demo, "--materials", "pmma,aluminium").exit_code == 0
        case = read_case(tmp_path / f"{demo}.toml")
        assert isinstance(case, Case) and list(case.materials) == ["upper", "lower"]
        assert [each.density for each in case.materials.values()] == [1170.0, 2700.0]
    assert says("did you mean 'pmma'?", said(ruptfx("new", tmp_path / "x", "--materials", "pmna")))
    three = said(ruptfx("new", tmp_path / "x", "--materials", "pmma,steel,granite"))
    assert "one for each of upper, lower" in three and not (tmp_path / "x.toml").exists()


@fem
@pytest.mark.parametrize("demo", ["gmsh", "antiplane", "rate_state"])
def test_mesh_draws_names_normals_and_patches(demo: str, tmp_path: Path) -> None:
    from ruptfx.app.drawing.mesh_drawing import draw
    from ruptfx.case import read_case

    pytest.importorskip("gmsh")
    coarse = [] if demo == "gmsh" else ["mesh.element_size=2000.0"]
    figure = draw(read_case(ROOT / "demos" / f"{demo}.toml", coarse))
    assert label_faults(figure) == []
    (axes,) = figure.axes
    words = " ".join(text.get_text() for text in axes.texts)
    # As in other figures: 80 mm by 40 mm, and faults of kilometres.
    unit = "mm" if demo == "gmsh" else "km"
    assert (axes.get_xlabel(), axes.get_ylabel()) == (f"x ({unit})", f"y ({unit})")
    figure.draw_without_rendering()
    shown, size = [label.get_text() for label in axes.get_xticklabels()], 1e-3 if demo == "gmsh" else 1e3
    np.testing.assert_allclose([float(text.replace("−", "-")) * size for text in shown], axes.get_xticks(), rtol=1e-9)
    wanted = {
        "gmsh": ["above", "below", "above.left", "interface fault: position = arc length from (0, 15) mm", "n", "t"],
        "rate_state": ["upper.left", "friction.a", "nucleation.0"],
        "antiplane": ["upper", "upper.top", "interface main: position = x", "nucleation.0"],
    }[demo]
    assert [word for word in wanted if word not in words] == []
    # From the foot of the arrow to its head: the normal of a line from (0, 0.015) to (0.08, 0.025), to the plus side.
    arrow = next(text for text in axes.texts if getattr(text, "arrow_patch", None) is not None)
    direction = np.array(arrow.xy) - np.array(arrow.xyann)
    normal = np.array([-10.0, 80.0] if demo == "gmsh" else [0.0, 1.0])
    np.testing.assert_allclose(direction / np.linalg.norm(direction), normal / np.linalg.norm(normal), atol=1e-9)


@fem
@pytest.mark.parametrize("dip", [90.0, 60.0])
def test_mesh_of_a_solid_has_a_map_of_its_surface(dip: float) -> None:
    """Elements of 1 mm on a fault of 12 mm x 8 mm, with 3.7 MPa in a square and 2.8 MPa elsewhere."""
    from ruptfx.app.drawing.mesh_drawing import draw
    from ruptfx.case import parse_case

    figure = draw(parse_case(strike_slip({"mesh.dip": dip})))
    solid, surface = figure.axes[:2]
    words = [text.get_text() for text in solid.texts]
    assert {"plus.top", "plus.far", "minus.left", "n", "1", "2"} <= set(words)
    assert surface.get_title() == "interface main: position = x"
    triangles, elements = surface.collections
    areas = [
        0.5 * abs(np.cross([*(c - a), 0], [*(d - b), 0])[2])
        for a, b, c, d in (path.vertices[:4] for path in elements.get_paths())
    ]
    np.testing.assert_allclose(areas, 1.0, rtol=1e-9)
    assert len(areas) == 12 * 8 and surface.get_xlim() == pytest.approx((-6, 6)) and surface.yaxis_inverted()
    assert surface.get_ylim() == pytest.approx((8, 0), abs=1e-9)
    shear, mesh = triangles.get_array(), triangles._triangulation
    x, y = mesh.x, mesh.y
    inside, outside = (abs(x) < 2.9) & (abs(y - 3) < 1.9), (abs(x) > 3.1) | (abs(y - 3) > 2.1)
    np.testing.assert_allclose(shear[inside], 3.7, rtol=1e-9)
    np.testing.assert_allclose(shear[outside], 2.8, rtol=1e-9)
    assert label_faults(figure) == []


@fem
def test_names_of_edges_of_a_thin_solid_do_not_overlap() -> None:
    """A bar of 30 x 2 x 3 mm: ten names beside each other, with lines that end at the middles of their edges."""
    from ruptfx.app.drawing.mesh_drawing import draw
    from ruptfx.case import parse_case

    bar = {"fault_length": 30e-3, "fault_width": 2e-3, "beyond": 1e-3, "distance": 1e-3, "element_size": 1e-3}
    shear = {"faults.main.initial_stress.shear": 2.8e6, "order": 1}
    figure = draw(parse_case(strike_slip({**{f"mesh.{key}": size for key, size in bar.items()}, **shear})))
    figure.draw_without_rendering()
    names = [text for text in figure.axes[0].texts if "." in text.get_text()]
    boxes = [text.get_window_extent() for text in names]
    assert len(names) == 10
    assert not any(one.overlaps(other) for number, one in enumerate(boxes) for other in boxes[:number])
    ticks = [label.get_window_extent() for axis in (figure.axes[0].yaxis, figure.axes[0].zaxis)
             for label in axis.get_ticklabels() if label.get_text()]  # fmt: skip
    assert not any(one.overlaps(other) for number, one in enumerate(ticks) for other in ticks[:number])


@fem
@pytest.mark.parametrize("base", [False, True])
def test_mesh_of_solids_that_slide_has_both_surfaces(base: bool) -> None:
    """3 x 2 elements of 0.5 mm: 20 um above 7 x 7 others, or on a rigid wave of 10 um, drawn as 24 x 24 rectangles."""
    from ruptfx.app.drawing.mesh_drawing import draw
    from ruptfx.case import parse_case

    wave = {"kind": "sinusoid", "amplitude": 10e-6, "wavelength": 0.5e-3}
    table = solids({"mesh.closest": 20e-6, "mesh.upper.height": 1.5e-3, "mesh.lower.height": 1e-3})
    if base:
        plan = {"length": 1.5e-3, "width": 1e-3}
        block = {"kind": "block_on_rigid", **plan, "height": 0.5e-3, "element_size": 0.5e-3}
        table |= {"mesh": {**block, "base": {**plan, "profile": wave}},
                  "materials": {"upper": table["materials"]["upper"]}, "boundaries": []}  # fmt: skip
    figure = draw(parse_case(table))
    surface = figure.axes[1]
    gap, own, other = surface.collections
    assert len(own.get_paths()) == 6 and len(other.get_paths()) == (24 * 24 if base else 49)
    # That of the wave is twice its amplitude at the troughs, and zero at the crests, where it touches.
    assert gap.get_array().min() == pytest.approx(0.0 if base else 20.0, abs=0.1)
    assert gap.get_array().max() == pytest.approx(20.0, rel=1e-3)
    assert label_faults(figure) == []


@fem
def test_mesh_saves_a_picture(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(tomli_w.dumps(plates()))
    result = ruptfx("mesh", tmp_path / "case.toml", "--out", tmp_path / "mesh.png")
    assert result.exit_code == 0 and imread(tmp_path / "mesh.png").std() > 0.02
    assert "lumped model" in said(ruptfx("mesh", ROOT / "demos" / "spring_slider.toml"))


# -- runs ------------------------------------------------------------------------------------------------------------


def test_list(runs: Path, tmp_path: Path) -> None:
    (tmp_path / "stopped").mkdir()
    (tmp_path / "stopped" / "case.toml").write_text((runs / "one" / "case.toml").read_text())
    rows = ruptfx("list", runs).output
    assert re.search(r"one\s+complete\s+\w+.*step \d+0\s+\d+\.\d MB", rows) and "two" in rows
    assert "stopped" in said(ruptfx("list", tmp_path))
    assert "no runs below it" in said(ruptfx("list", tmp_path / "nothing"))


def test_compare(runs: Path, tmp_path: Path) -> None:
    result = ruptfx("compare", runs / "one", runs / "two", "--out", tmp_path / "both.png")
    text = said(result)
    # 6 MPa and 12 MPa: twice as much.
    assert result.exit_code == 0 and "faults.main.initial_stress.normal 6e+06 1.2e+07 +100 %" in text
    assert text.index("The cases differ in") < text.index("initial_stress.normal") < text.index("results")
    # Nothing slips in either: results that agree are counted, and shown on request.
    assert "peak_slip_rate" not in text and says("results agree to 0.1 %", text) and "wall_time" not in text
    everything = said(ruptfx("compare", runs / "one", runs / "two", "--verbose", "--out", tmp_path / "both.png"))
    assert "peak_slip_rate" in everything and "wall_time" not in everything
    assert imread(tmp_path / "both.png").std() > 0.02
    with Record(runs / "one") as one, Record(runs / "two") as two:
        axes = overlay(one, two).axes
    # Nothing slips, and no wave reaches the interface: its normal stresses [MPa] instead of zeros.
    assert [[line.get_ydata().max() for line in ax.lines] for ax in axes] == [pytest.approx([6.0, 12.0])]
    same = said(ruptfx("compare", runs / "one", runs / "one", "--out", tmp_path / "same.png"))
    assert "The cases are the same." in same and "differ" not in same
    assert is_noise("tip_speed", 1000.0, 1000.9) and not is_noise("tip_speed", 1000.0, 1002.0)
    assert is_noise("energy_closure", 1e-15, 5e-13) and not is_noise("energy_closure", 1e-15, 1e-6)
    assert not is_noise("mode", "crack", "pulse") and not is_noise("tip_speed", None, 3.0)
    stray = said(ruptfx("compare", runs / "one", runs / "two", "--instrument", "G1"))
    assert "a directory; --instrument" in stray
    signals = tmp_path / "signals.csv"
    signals.write_text("time (us), velocity\n0, 0\n1, 1\n")
    swapped = said(ruptfx("compare", signals, runs / "one"))
    assert f"ruptfx compare {runs / 'one'} {signals}" in swapped
    assert f"{tmp_path / 'no.csv'}: no such file or directory" in said(
        ruptfx("compare", runs / "one", tmp_path / "no.csv")
    )


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 5 us that slips behind its hit edge."""
    pytest.importorskip("dolfinx")
    folder = tmp_path_factory.mktemp("pushed")
    edge = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0, "ramp": 1e-6}
    weak = {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.01}, "boundaries": [edge]}
    (folder / "case.toml").write_text(tomli_w.dumps(merged(plates(), weak)))
    assert ruptfx("run", folder / "case.toml", "--out", folder / "run", "--quiet").exit_code == 0
    return folder / "run"


def test_plot_of_one_figure_and_a_part_of_the_run(pushed: Path) -> None:
    result = ruptfx("plot", pushed, "--figure", "space_time", "--from", "2 us", "--to", "3e-6", "--format", "svg")
    assert result.exit_code == 0, said(result)
    assert result.output.splitlines()[-1] == str(pushed / "figures" / "space_time_from_2us_to_3us.svg")
    assert len(list((pushed / "figures").glob("*_from_2us_to_3us.svg"))) == 1
    for options, words in (
        (("--figure", "spacetime"), "did you mean 'space_time'?"),
        (("--format", "jpg"), "known: png, pdf, svg"),
        (("--figure", "emission"), "no data for it; it has "),
        (("--from", "9 us"), "the saved times are 0 to 5"),
        (("--from", "3 us", "--to", "2 us"), "give an earlier and a later time"),
        (("--to", "3 m"), "--to 3 m: "),
    ):
        refused = ruptfx("plot", pushed, *options)
        assert refused.exit_code == 1 and words in said(refused), said(refused)


@pytest.mark.usefixtures("blank_pictures")
def test_figures_without_data_in_a_part_of_the_run_are_skipped(pushed: Path) -> None:
    """Between two snapshots of the bodies: the figures of the interface are drawn, and the others are listed."""
    with Record(pushed) as record:
        first, second = (f"{time:.9g}" for time in record.bulk.time.values[1:3])
    window = "--from", str(float(first) + 1e-8), "--to", str(float(second) - 1e-8)
    result = ruptfx("plot", pushed, *window)
    drawn = {path.stem.partition("_from_")[0] for path in (pushed / "figures").glob("*_from_*.png")}
    assert result.exit_code == 0 and {"space_time", "energy_budget"} <= drawn and "wavefield" not in drawn
    assert "left out: wavefield: " in said(result) and "nothing was saved from" in said(result)
    refused = ruptfx("plot", pushed, *window, "--figure", "wavefield")
    assert refused.exit_code == 1 and "nothing was saved from" in said(refused)


def test_a_part_of_a_record_has_its_times_and_values(pushed: Path) -> None:
    """All histories, and the axis of the figure; the whole record stays as it is."""
    from ruptfx.results import plots

    with Record(pushed) as whole, whole.between(2e-6, 3e-6) as part:
        times = whole.interface.time.values
        inside = (times >= 2e-6 * (1 - 1e-9)) & (times <= 3e-6 * (1 + 1e-9))
        assert 0 < inside.sum() < len(times)
        np.testing.assert_array_equal(part.interface.slip_rate, whole.interface.slip_rate.values[inside])
        assert set(part.energy.time.values) == {t for t in whole.energy.time.values if 2e-6 <= t <= 3e-6}
        assert set(part.bulk.time.values) == {t for t in whole.bulk.time.values if 2e-6 <= t <= 3e-6}
        axes = plots.space_time(part).figure.axes[0]
        assert axes.get_ylim() == pytest.approx((2.0, part.interface.time.values[-1] * 1e6))  # us
        arrival = plots.front(part).figure.axes[0].lines[0].get_ydata()
        assert np.isfinite(arrival).any() and np.nanmin(arrival) >= 2.0 and np.nanmax(arrival) <= 3.0
        assert plots.space_time(whole).figure.axes[0].get_ylim()[0] == 0 and len(whole.interface.time) == len(times)


def test_completion_of_runs_and_keys(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(runs.parent)
    (runs / "measured.csv").write_text("t,v\n")
    assert run_directories(f"{runs.name}/") == [f"{runs.name}/one", f"{runs.name}/two"]
    assert run_directories(f"{runs.name}/o") == [f"{runs.name}/one"] and run_directories("nothing") == []
    assert runs_and_files(f"{runs.name}/") == [f"{runs.name}/{name}" for name in ("one", "two", "measured.csv")]
    context = SimpleNamespace(params={"case": runs / "one.toml"}, args=[])
    assert keys(context, "faults.main.initial_stress.n") == ["faults.main.initial_stress.normal="]
    # Also keys that the case does not give.
    assert keys(context, "output.bulk_i") == ["output.bulk_interval="] and keys(context, "duration=") == []
    assert keys(SimpleNamespace(params={}, args=[]), "d") == []


def test_the_shell_completes_a_key_behind_the_option(runs: Path) -> None:
    """By the protocol of the shell, where the parser has an option without a value."""
    words = f"ruptfx run {runs / 'one.toml'} --set output.bulk_i"
    done = subprocess.run(
        [sys.executable, "-m", "ruptfx"], capture_output=True, text=True, timeout=120, check=False,
        env={**os.environ, "_RUPTFX_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": "4"},
    )  # fmt: skip
    assert done.stdout.split() == ["output.bulk_interval="], done.stderr


def test_export_tables(runs: Path, tmp_path: Path) -> None:
    assert ruptfx("export", runs / "one", "--out", tmp_path).exit_code == 0
    with Record(runs / "one") as record:
        data = record.interface
        table = np.genfromtxt(tmp_path / "main_slip_rate.csv", delimiter=",", comments="#", skip_header=2)
        np.testing.assert_allclose(table[:, 0], data.time, rtol=1e-8)
        np.testing.assert_allclose(table[:, 1:], data.slip_rate, rtol=1e-8)
        for name, unit in (("slip_rate", "m/s"), ("slip", "m"), ("normal_stress", "Pa")):
            head = (tmp_path / f"main_{name}.csv").read_text().splitlines()[0]
            assert head == f"# {name} [{unit}]: time [s] below, position [m] to the right"
        still = np.genfromtxt(tmp_path / "main.csv", delimiter=",", names=True, deletechars="")
        np.testing.assert_allclose(still["rupture_time_[s]"], data.rupture_time, rtol=1e-8)


def test_export_netcdf(runs: Path, tmp_path: Path) -> None:
    assert ruptfx("export", runs / "one", "--format", "netcdf", "--out", tmp_path).exit_code == 0
    with Record(runs / "one") as record, xarray.open_dataset(tmp_path / "main.nc", engine="h5netcdf") as written:
        np.testing.assert_array_equal(written.slip, record.interface.slip)
        assert written.slip.attrs["units"] == "m"
    with xarray.open_dataset(tmp_path / "bulk.nc", engine="h5netcdf") as bulk:
        assert list(bulk.component.values) == ["x", "y"]


def test_export_vtk(runs: Path, tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    assert ruptfx("export", runs / "one", "--format", "vtk", "--out", tmp_path).exit_code == 0
    files = sorted(tmp_path.glob("*.vtu"))
    with Record(runs / "one") as record:
        first, last, snapshot = meshio.read(files[0]), meshio.read(files[-1]), record.bulk.isel(time=-1)
        assert len(files) == record.bulk.sizes["time"] + 1  # the initial state, too
        np.testing.assert_array_equal(last.point_data["velocity"][:, :2], snapshot.velocity)
        assert last.point_data["velocity"].shape[1] == 3 and not last.point_data["velocity"][:, 2].any()
        assert f'timestep="{float(snapshot.time)!r}" file="{files[-1].name}"' in (tmp_path / "bulk.pvd").read_text()
        # xx, yy, zz, xy, yz, xz; the plates are pressed with 6 MPa, and zz is none of the fields of a run.
        np.testing.assert_array_equal(last.point_data["stress"][:, [0, 1, 3]], snapshot.stress)
        np.testing.assert_allclose(first.point_data["stress"][0], [0, -6e6, np.nan, 0, np.nan, np.nan], atol=1e-3)
        np.testing.assert_allclose(first.point_data["fringe"], 6e6)
        assert not first.point_data["displacement"].any() and not first.point_data["velocity"].any()
        # The upper plate is body 0, above y = 0.
        middle = first.points[first.cells[0].data].mean(axis=1)
        np.testing.assert_array_equal(first.cell_data["body"][0] == 0, middle[:, 1] > 0)


def test_export_vtkhdf(runs: Path, tmp_path: Path) -> None:
    """Read as VTK does: rows of a field from its offset at every step."""
    assert ruptfx("export", runs / "one", "--format", "vtkhdf", "--out", tmp_path).exit_code == 0
    with h5py.File(tmp_path / "bulk.vtkhdf") as file, Record(runs / "one") as record:
        root, bulk = file["VTKHDF"], record.bulk
        assert root.attrs["Type"] == b"UnstructuredGrid" and list(root.attrs["Version"]) == [2, 0]
        np.testing.assert_array_equal(root["Steps/Values"], [0, *bulk.time.values])
        points, cells = int(root["NumberOfPoints"][0]), int(root["NumberOfCells"][0])
        assert len(root["Offsets"]) == cells + 1 and root["Offsets"][-1] == len(root["Connectivity"]) == 4 * cells
        for number in range(bulk.sizes["time"]):
            begin = root["Steps/PointDataOffsets/displacement"][number + 1]
            rows = root["PointData/displacement"][begin : begin + points]
            np.testing.assert_array_equal(rows[:, :2], bulk.displacement.isel(time=number))
    with h5py.File(tmp_path / "main.vtkhdf") as file, Record(runs / "one") as record:
        root, data = file["VTKHDF"], record.interface
        assert set(root["Types"]) == {3} and len(root["Types"]) == data.sizes["position"] - 1  # lines
        np.testing.assert_array_equal(root["Points"][:, 0], data.x)
        np.testing.assert_array_equal(root["PointData/slip_rate"][:].reshape(data.slip_rate.shape), data.slip_rate)


def test_export_vtkhdf_of_antiplane_motion(tmp_path: Path) -> None:
    """Along z, and shear stresses xz and yz; what was not saved is not zero."""
    time, position = synthetic.times(31), synthetic.points(20)
    run = synthetic.write_run(
        tmp_path / "run", synthetic.crack(time, position), time, position, plane="antiplane", snapshots=2
    )
    assert ruptfx("export", run, "--format", "vtkhdf", "--out", tmp_path / "out").exit_code == 0
    with h5py.File(tmp_path / "out/bulk.vtkhdf") as file, Record(run) as record:
        data, count = file["VTKHDF/PointData"], record.bulk.sizes["point"]
        np.testing.assert_array_equal(data["velocity"][-count:, 2], record.bulk["velocity"].values[-1, :, 0])
        assert data["velocity"][-count:, 2].any() and not data["velocity"][:, :2].any()
        stress = data["stress"][-count:]  # xx, yy, zz, xy, yz, xz
        np.testing.assert_array_equal(stress[:, [5, 4]], record.bulk["stress"].values[-1])
        assert np.isnan(stress[:, :4]).all() and stress[:, 5].any()


def test_vtk_reads_it(runs: Path, tmp_path: Path) -> None:
    reading = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    assert ruptfx("export", runs / "one", "--format", "vtkhdf", "--out", tmp_path).exit_code == 0
    with Record(runs / "one") as record:
        for name, data, field in (("bulk", record.bulk, "velocity"), ("main", record.interface, "slip_rate")):
            reader = reading.vtkHDFReader()
            reader.SetFileName(str(tmp_path / f"{name}.vtkhdf"))
            reader.UpdateInformation()
            steps = reader.GetNumberOfSteps()
            assert steps == data.sizes["time"] + (name == "bulk")
            reader.SetStep(steps - 1)
            reader.Update()
            grid = reader.GetOutput()
            read = vtk_to_numpy(grid.GetPointData().GetArray(field))
            expected = data[field].isel(time=-1).values
            np.testing.assert_array_equal(read[:, : expected.shape[1]] if expected.ndim == 2 else read, expected)
            assert grid.GetNumberOfCells() > 0
        assert read.ndim == 1


def test_a_finished_run_is_extended(runs: Path, tmp_path: Path) -> None:
    """Bit by bit what one run over the whole time with the same intervals gives."""
    import shutil

    extended, whole = tmp_path / "extended", tmp_path / "whole"
    shutil.copytree(runs / "one", extended)
    assert says("has 4e-06 s already", said(ruptfx("resume", extended, "--duration", "4 us")))
    result = ruptfx("resume", extended, "--duration", "8 us", "--quiet")
    assert result.exit_code == 0, said(result)
    table = merged(plates(), {
        "duration": 8e-6, "output.checkpoint_steps": 10, "output.figures": False,
        "output.interface_interval": 4e-6 / 300, "output.bulk_interval": 4e-6 / 6,
    })  # fmt: skip
    (tmp_path / "whole.toml").write_text(tomli_w.dumps(table))
    assert ruptfx("run", tmp_path / "whole.toml", "--out", whole, "--quiet").exit_code == 0
    with Record(extended) as one, Record(whole) as other:
        assert one.complete and one.summary["case_hash"] == other.summary["case_hash"]
        for name in ("time", "slip", "slip_rate", "shear_traction"):
            np.testing.assert_array_equal(one.interface[name], other.interface[name])
    # It did go on: both beginnings are in the log.
    assert len(re.findall("nodes", (extended / "run.log").read_text())) == 2


def test_resume_of_a_complete_run_says_that_nothing_is_computed(runs: Path) -> None:
    when = (runs / "one" / "summary.json").stat().st_mtime_ns
    result = ruptfx("resume", runs / "one")
    assert result.exit_code == 0
    assert f"complete, nothing is computed; extend it: ruptfx resume {runs / 'one'} --duration" in said(result)
    assert (runs / "one" / "summary.json").stat().st_mtime_ns == when
    assert "nothing is computed" not in said(ruptfx("resume", runs / "one", "--quiet"))


def test_resume_of_a_lumped_model_says_what_it_does(tmp_path: Path) -> None:
    out, case = tmp_path / "run", ROOT / "demos" / "spring_slider.toml"
    resume = ("run", case, "--out", out, "--set", "experiment.samples=100", "--resume")
    assert "(spring_slider) has no checkpoints; it is computed from the start" in said(ruptfx(*resume))
    when = (out / "result.nc").stat().st_mtime_ns
    again = said(ruptfx(*resume))
    assert "complete, nothing is computed" in again and "with --overwrite" in again
    assert (out / "result.nc").stat().st_mtime_ns == when
    assert ruptfx(*resume[:-1], "--overwrite").exit_code == 0 and (out / "result.nc").stat().st_mtime_ns != when
    (out / "summary.json").unlink()  # stopped before its end
    assert "computed from the start" in said(ruptfx("resume", out))


def test_new_with_a_schema(tmp_path: Path) -> None:
    assert ruptfx("new", tmp_path / "mine", "--schema").exit_code == 0
    first, rest = (tmp_path / "mine.toml").read_text().split("\n", 1)
    assert first == "#:schema ./ruptfx.input.schema.json" and rest.startswith("# Shear impact")
    printed = json.loads(ruptfx("describe", "--schema").output)
    assert json.loads((tmp_path / "ruptfx.input.schema.json").read_text()) == printed
    assert ruptfx("new", tmp_path / "other").exit_code == 0
    assert (tmp_path / "other.toml").read_text().replace("other", "mine") == rest


def test_resume_of_what_is_no_run(tmp_path: Path) -> None:
    assert "no run directory" in said(ruptfx("resume", tmp_path))


def test_cite_says_what_the_citation_file_says() -> None:
    text, citation = said(ruptfx("cite")), (ROOT / "CITATION.cff").read_text()
    for key in ("title", "version", "doi", "volume", "year"):
        for value in re.findall(rf"^ *{key}: (.+)$", citation, re.MULTILINE):
            assert value.strip('"') in text
    for family in re.findall(r"family-names: (\w+)", citation):
        assert family in text
    assert json.dumps(text).count("@") == 3


# -- events ----------------------------------------------------------------------------------------------------------


def test_events_of_a_measured_catalogue(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    table = np.column_stack(
        [
            1e-3 * random.random(200),
            0.05 * random.random(200),
            0.1 * random.random(200),
            -8 + random.exponential(np.log10(np.e), 200),
        ]
    )
    np.savetxt(tmp_path / "measured.csv", table, delimiter=",", header="time,x,y,magnitude", comments="")
    result = ruptfx("events", tmp_path / "measured.csv", "--out", tmp_path / "events.png", "--completeness", "-7.95")
    assert result.exit_code == 0 and says("200 events that radiate energy", said(result))
    b, error = map(float, re.search(r"b-value ([0-9.]+) ± ([0-9.]+)", said(result)).groups())
    assert b == pytest.approx(1.0, abs=3 * error) and "Omori" not in said(result)
    assert imread(tmp_path / "events.png").std() > 0.05
    few = ruptfx("events", tmp_path / "measured.csv", "--smallest", "-6", "--out", tmp_path / "few.png")
    assert few.exit_code == 0 and "b-value none" in said(few)
    (tmp_path / "none.csv").write_text("time,x,y,magnitude\n")
    none = ruptfx("events", tmp_path / "none.csv", "--out", tmp_path / "none.png")
    assert none.exit_code == 0 and "0 events" in said(none) and not (tmp_path / "none.png").exists()


def test_events_of_a_run(tmp_path: Path) -> None:
    """Their table can be read as a catalogue again."""
    time, position = synthetic.times(61), synthetic.points(20)
    run = synthetic.write_run(tmp_path / "run", synthetic.crack(time, position), time, position)
    synthetic.write_cracks(run, failed=2)
    result = ruptfx("events", run, "--csv")
    assert result.exit_code == 0 and says("Failed facets: 2", said(result)) and says("or more: 1", said(result))
    assert "tensile 100.0%" in said(result)
    assert imread(run / "figures" / "emission.png").std() > 0.02
    again = read_catalogue(run / "events.csv")
    assert again.energy.tolist() == [1e-6, 0.0] and again.x.tolist() == [5e-3, 10e-3]
    refused = ruptfx("events", run / "events.csv", "--csv")
    assert refused.exit_code != 0 and "is a table already" in said(refused)
    missing = ruptfx("events", tmp_path / "nowhere", "--csv")
    assert missing.exit_code != 0 and says("nowhere: no such file or directory", said(missing))


def test_runs_are_compared_in_the_middle_of_what_slid_in_both():
    """One slid from 1 to 5 m, the other from 2 to 8 m: 3.5 m; without slip the middle of the interface, 5 m."""
    position = np.arange(11.0)

    def run(low, high):
        arrival = np.where((position >= low) & (position <= high), 1.0, np.nan)
        return SimpleNamespace(position=SimpleNamespace(values=position), rupture_time=SimpleNamespace(values=arrival))

    assert _place([run(1, 5), run(2, 8)]) == 3.5
    assert _place([run(1, 5), run(20, 30)]) == 5.0
