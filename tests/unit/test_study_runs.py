"""Running studies with a stand-in for the solver: what is run, kept, refused, refined and written."""

from __future__ import annotations

import json
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

pytest.importorskip("distributed")

from helpers.messages import facts, says
from typer.testing import CliRunner

from ruptfx import RuptfxError
from ruptfx.app.cli import app
from ruptfx.many_runs.study import execute, read_csv, read_study, refine, run_study
from ruptfx.many_runs.study.mode_map import Map
from ruptfx.many_runs.study.store import Store
from ruptfx.many_runs.study.table import unit_of
from ruptfx.platform import launch
from ruptfx.results.summary_fields import DESCRIPTIONS

IMPACT = Path(__file__).parents[2] / "demos" / "impact.toml"
# Pulses above a diagonal of the map, no mesh dependence but at 20 m/s; some loadings fail in their own way.
STAND_IN = """
import json, os, signal, sys, time
for line in sys.stdin:
    case = json.loads(line)["case"]
    sigma, speed = case["faults"]["main"]["initial_stress"]["normal"], case["boundaries"][0]["velocity"]
    if speed == 13.0:
        print("about to die", file=sys.stderr, flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    if speed == 23.0:
        print("PID 1234 RUNNING AT host\\nEXIT STRING: Aborted (signal 6)", flush=True)
        print("out of luck", file=sys.stderr, flush=True)
        sys.exit(6)
    if speed == 29.0:
        print("a line of a library", flush=True)
        sys.exit(134)
    if speed == 17.0:
        time.sleep(60)
    if speed == 19.0:
        answer = {"status": "failed", "error": "unstable\\nstep"}
    else:
        fine = case["mesh"]["element_size"] < 1e-3
        mode = "pulse" if sigma * speed > 50e6 and not (fine and speed == 20.0) else "crack"
        answer = {"status": "done", "values": {"mode": mode, "product": sigma * speed, "nothing": None}}
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def maps():
    """Wanted by tests that look for a map; the studies of the others draw none."""


@pytest.fixture(autouse=True)
def _stand_in(request, monkeypatch):
    if "maps" not in request.fixturenames:
        monkeypatch.setattr(execute, "_has_map", lambda directory: False)
    monkeypatch.setattr(launch, "mpi_command", lambda ranks, module: [sys.executable, "-c", STAND_IN])
    monkeypatch.setitem(DESCRIPTIONS, "product", "Of the stand-in alone.")


def study(tmp_path, speeds, sigmas=(1e6, 10e6), extra="", top=""):
    path = tmp_path / "study.toml"
    path.write_text(
        f'case = "{IMPACT}"\n{top}\n'
        f'[[axes]]\nname = "Sigma_0"\nkey = "faults.main.initial_stress.normal"\nunit = "Pa"\n'
        f'spacing = "log"\nvalues = {list(sigmas)}\n'
        f'[[axes]]\nname = "V_imp"\nkey = "boundaries.0.velocity"\nunit = "m/s"\nvalues = {list(speeds)}\n{extra}'
    )
    return read_study(path)


def run(tmp_path, *arguments, out="out", **options):
    extra = {key: options.pop(key) for key in ("extra", "top") if key in options}
    return run_study(study(tmp_path, *arguments, **extra), tmp_path / out, show=False, **options)


def finished(out):
    return [line.split()[1] for line in (out / "points.log").read_text().splitlines()]


def test_products_hold_every_point(tmp_path, maps):
    run(tmp_path, [2.0, 8.0])
    table = read_csv(tmp_path / "out" / "table.csv")
    assert [(r["Sigma_0"], r["V_imp"], r["mode"], r["product"]) for r in table] == [
        (1e6, 2.0, "crack", 2e6), (1e6, 8.0, "crack", 8e6), (10e6, 2.0, "crack", 2e7), (10e6, 8.0, "pulse", 8e7),
    ]  # fmt: skip
    with xarray.open_dataset(tmp_path / "out" / "table.nc", engine="h5netcdf") as data:
        assert data["product"].dims == ("Sigma_0", "V_imp") and data["Sigma_0"].attrs["units"] == "Pa"
        np.testing.assert_array_equal(data["product"], [[2e6, 8e6], [2e7, 8e7]])
        assert data["mode"].sel(Sigma_0=10e6, V_imp=8.0) == "pulse"
    for name in ("mode_map.png", "mode_map.pdf", "mode_map.html"):
        assert (tmp_path / "out" / name).stat().st_size > 1000


def test_a_study_without_numbers_has_a_table_and_no_map(tmp_path, maps):
    path = tmp_path / "study.toml"
    axis = 'key = "boundaries.0.velocity"\nvalues = [1.0, 2.0]\nlabels = ["a", "b"]'
    path.write_text(f'case = "{IMPACT}"\n[[axes]]\n{axis}')
    run_study(read_study(path), tmp_path / "out", show=False)
    assert [row["velocity"] for row in read_csv(tmp_path / "out" / "table.csv")] == ["a", "b"]
    assert not (tmp_path / "out" / "mode_map.html").exists()


def test_the_command_lists_the_files_that_it_wrote(tmp_path, monkeypatch, maps):
    """Of an axis of words there is no map: two tables; of an axis of numbers a map, its page and curves as well."""
    monkeypatch.setenv("COLUMNS", "500")
    words = '[[axes]]\nname = "order"\nkey = "order"\nvalues = [3, 4]\nlabels = ["low", "high"]\n'
    numbers = '[[axes]]\nname = "V"\nkey = "boundaries.0.velocity"\nvalues = [1.0, 2.0]\n'
    for name, axis, more in (("words", words, False), ("numbers", numbers, True)):
        file, out = tmp_path / f"{name}.toml", tmp_path / name
        file.write_text(f'case = "{IMPACT}"\n{axis}')
        done = CliRunner().invoke(app, ["study", str(file), "--out", str(out), "--quiet"])
        assert done.exit_code == 0, done.output
        listed = done.output.split("(")[-1].split(")")[0].split(", ")
        assert listed[:2] == ["table.csv", "table.nc"] and ("mode_map.html" in listed) == more
        assert [name for name in listed if not (out / name).is_file()] == []


def test_a_study_of_text_alone_has_a_table_and_no_map(tmp_path, maps):
    run(tmp_path, [2.0], top='quantities = ["ended_by"]')
    assert [row["V_imp"] for row in read_csv(tmp_path / "out" / "table.csv")] == [2.0, 2.0]
    assert not (tmp_path / "out" / "mode_map.html").exists()


def test_a_scalar_with_the_name_of_an_axis_does_not_replace_it(tmp_path, monkeypatch):
    monkeypatch.setattr(
        launch, "mpi_command", lambda *_: [sys.executable, "-c", STAND_IN.replace('"nothing": None', '"V_imp": 99.0')]
    )
    run(tmp_path, [2.0, 8.0], [1e6])
    assert [row["V_imp"] for row in read_csv(tmp_path / "out" / "table.csv")] == [2.0, 8.0]


def test_a_goal_of_text_is_refused(tmp_path):
    pytest.importorskip("cma")
    search = 'sampling = "cma_es"\nsamples = 9\n[[search.goals]]\nquantity = "mode"\nat_least = 1.0\n'
    path = tmp_path / "study.toml"
    path.write_text(f'case = "{IMPACT}"\n{search}[[axes]]\nkey = "boundaries.0.velocity"\nrange = [1.0, 2.0]')
    with pytest.raises(RuptfxError, match=facts("'mode' is the text 'crack'")):
        run_study(read_study(path), tmp_path / "out", show=False)


def test_a_misspelt_quantity_of_a_lumped_model_is_named_after_its_first_points(tmp_path, monkeypatch):
    script = STAND_IN.split("for line")[0] + (
        'for line in sys.stdin:\n    print(json.dumps({"status": "done", "values": {"K_c": 1.0}}), flush=True)\n'
    )
    monkeypatch.setattr(launch, "mpi_command", lambda *_: [sys.executable, "-c", script])
    path = tmp_path / "study.toml"
    slider = IMPACT.with_name("spring_slider.toml")
    path.write_text(f'case = "{slider}"\nquantities = ["K_k"]\n[[axes]]\nkey = "stiffness"\nvalues = [1e6, 2e6]')
    with pytest.raises(RuptfxError, match=facts(r"quantities\.0 = 'K_k'.*did you mean 'K_c'")):
        run_study(read_study(path), tmp_path / "out", show=False)
    assert len(finished(tmp_path / "out")) == 2  # kept for the same command with the right name
    path.write_text(path.read_text().replace("K_k", "K_c"))
    assert run_study(read_study(path), tmp_path / "out", show=False).known_before == 2


def test_only_new_points_run(tmp_path):
    assert run(tmp_path, [2.0, 8.0]).known_before == 0
    again = run(tmp_path, [2.0, 4.0, 8.0])
    assert again.known_before == 4 and len(again.points) == 6
    log = finished(tmp_path / "out")
    assert len(log) == 6 == len(set(log))


def test_a_crash_costs_one_point_and_is_recorded(tmp_path):
    found = run(tmp_path, [2.0, 13.0, 19.0])
    assert found.failed == 4
    errors = {r["V_imp"]: r["error"] for r in read_csv(tmp_path / "out" / "table.csv")}
    assert "crashed (SIGKILL): about to die" in errors[13.0] and errors[19.0] == "unstable step"
    assert errors[2.0] is None
    # Failed points are known, too, unless asked to run again.
    assert run(tmp_path, [2.0, 13.0, 19.0]).known_before == 6
    assert run(tmp_path, [2.0, 13.0, 19.0], retry=True).known_before == 2


def test_a_crash_is_reported_with_signal_last_line_and_point(tmp_path: Path) -> None:
    """A launcher that prints its own lines to standard output, as MPICH and Open MPI do: they are no answer."""
    study(tmp_path, [2.0, 23.0, 29.0], [1e6])
    done = CliRunner(env={"COLUMNS": "500"}).invoke(app, [
        "study", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--quiet",
    ])  # fmt: skip
    assert done.exit_code == 0, done.output
    errors = {r["V_imp"]: r["error"] for r in read_csv(tmp_path / "out" / "table.csv")}
    assert errors[23.0] == "the run crashed (SIGABRT): out of luck" and errors[2.0] is None
    assert errors[29.0] == "the run crashed (SIGABRT): a line of a library"
    assert "V_imp = 23.0: the run crashed (SIGABRT): out of luck" in done.output
    assert not (tmp_path / "out" / ".lock").exists()


def test_a_study_is_listed_as_one_row(tmp_path: Path) -> None:
    run(tmp_path, [2.0, 13.0], out="studies/map")
    listed = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["list", str(tmp_path / "studies")])
    (row,) = listed.output.splitlines()[1:]
    assert str(tmp_path / "studies" / "map") in row and "study, 4 points, 2 failed" in row
    points = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["list", str(tmp_path / "studies" / "map" / "points")])
    assert len(points.output.splitlines()) == 5  # with a head


def test_time_limit(tmp_path):
    found = run(tmp_path, [17.0], [1e6], top="time_limit = 0.5")
    assert found.points[0][1]["error"].startswith("took longer than time_limit = 0.5 s")


def test_two_processes_and_another_study_are_refused(tmp_path):
    run(tmp_path, [2.0])
    with Store(tmp_path / "out", study(tmp_path, [2.0])), pytest.raises(RuptfxError, match=facts(r"process \d+ on")):
        run(tmp_path, [2.0])
    with pytest.raises(RuptfxError, match=r"out: (?!.*axes boundaries).*--out"):
        run(tmp_path, [2.0], extra="[set]\nduration = 1e-6")
    with pytest.raises(RuptfxError, match=facts(r"out: .*axes boundaries\.0\.velocity.* duration.*--out")):
        run(tmp_path, [2.0], extra='[[axes]]\nkey = "duration"\nvalues = [1e-6]')
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    with pytest.raises(RuptfxError, match=facts(r"holds something else \(thesis.tex\)")):
        run(tmp_path, [2.0], out="mine")
    assert run(tmp_path, [2.0]).known_before == 2  # nothing was lost


def test_a_study_that_was_killed_in_its_first_file_is_started_again(tmp_path: Path) -> None:
    """The rest of its file is neither something else nor left; a file of the user with such a name is."""
    out, plan = tmp_path / "out", study(tmp_path, [2.0])
    out.mkdir()
    left = out / ".study.json.12009"
    left.write_text("{")
    with Store(out, plan):
        assert not left.exists() and (out / "study.json").is_file()
    other = tmp_path / "other"
    other.mkdir()
    (other / ".study.json.bak").write_text("{")
    with pytest.raises(RuptfxError, match=facts(r"holds something else \(.study.json.bak\)")), Store(other, plan):
        pass


def test_what_a_killed_study_leaves_is_removed(tmp_path):
    run(tmp_path, [2.0])
    (tmp_path / "out" / "points" / ".half").mkdir()
    run(tmp_path, [2.0])
    assert not list((tmp_path / "out" / "points").glob(".*"))


def test_refinement_locates_the_boundary_and_asks_a_finer_mesh(tmp_path):
    extra = '[refine]\nwidth = 0.05\nfine = { "mesh.element_size" = 0.5e-3 }'
    run(tmp_path, [2.0, 20.0], extra=extra, refined=True)
    table = read_csv(tmp_path / "out" / "table.csv")
    # The boundary sigma V = 50e6 crosses the lines sigma = 10e6 at V = 5, and V = 20 at sigma = 2.5e6.
    line = sorted((r["V_imp"], r["mode"]) for r in table if r["Sigma_0"] == 10e6)
    low, high = max(v for v, mode in line if mode == "crack"), min(v for v, mode in line if mode == "pulse")
    assert low <= 5.0 < high and high - low <= 0.05 * 18
    other = sorted((r["Sigma_0"], r["mode"]) for r in table if r["V_imp"] == 20.0)
    low, high = max(s for s, mode in other if mode == "crack"), min(s for s, mode in other if mode == "pulse")
    assert low <= 2.5e6 < high and np.log(high / low) <= 0.05 * np.log(10)
    fine = [(r["V_imp"], r["mode"], r["fine_mesh"]) for r in table if r["fine_mesh"] is not None]
    assert len(fine) == 4 and (20.0, "pulse", "crack") in fine
    text = json.loads((tmp_path / "out" / "refinement.json").read_text())["summary"]
    assert says("3 of 4 points beside them keep their mode", text)
    # Nothing runs again.
    assert run(tmp_path, [2.0, 20.0], extra=extra, refined=True).known_before == len(table) + 4


def test_hypercube_table_and_data_set(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(
        f'case = "{IMPACT}"\nsampling = "latin_hypercube"\nsamples = 5\nseed = 3\n'
        '[[axes]]\nname = "V_imp"\nkey = "boundaries.0.velocity"\nrange = [1.0, 9.0]\n'
        '[[axes]]\nkey = "faults.main.friction.L_p"\nrange = [1e-6, 1e-4]'
    )
    run_study(read_study(path), tmp_path / "out", show=False)
    with xarray.open_dataset(tmp_path / "out" / "table.nc", engine="h5netcdf") as data:
        assert data["product"].dims == ("point",)
        np.testing.assert_allclose(data["product"], 6e6 * data["V_imp"])


def search(tmp_path, samples):
    """For speed x 6 MPa = 30 MPa m/s, where L_p does not matter; where the stress is 10 MPa nothing is asked for."""
    path = tmp_path / "search.toml"
    path.write_text(
        f'case = "{IMPACT}"\nsampling = "cma_es"\nsamples = {samples}\nseed = 3\n'
        '[[axes]]\nname = "Sigma_0"\nkey = "faults.main.initial_stress.normal"\nvalues = [6e6, 10e6]\n'
        '[[axes]]\nname = "V_imp"\nkey = "boundaries.0.velocity"\nrange = [1.0, 12.0]\n'
        '[[axes]]\nkey = "faults.main.friction.L_p"\nrange = [1e-6, 1e-4]\nspacing = "log"\n'
        "[search]\nstart = { V_imp = 11.0 }\n"
        '[[search.goals]]\nquantity = "product"\ntarget = 30e6\nscale = 3e6\nwhere = { Sigma_0 = 6e6 }\n'
    )
    return read_study(path)


@pytest.mark.slow
def test_a_search_finds_the_best_and_goes_on_where_it_was(tmp_path):
    pytest.importorskip("cma")
    short = run_study(search(tmp_path, 8), tmp_path / "out", show=False)
    assert len(finished(tmp_path / "out")) == 16 and short.sets[0].sample["V_imp"] == 11.0
    outcome = run_study(search(tmp_path, 60), tmp_path / "out", show=False)
    assert outcome.known_before == 16 and len(finished(tmp_path / "out")) == 120
    scores = read_csv(tmp_path / "out" / "scores.csv")
    assert [row["score"] for row in scores[:8]] == [one.score for one in short.sets]
    assert [row["degree_10000000.0"] for row in scores] == [1.0] * 60
    first, best = scores[0], max(scores, key=lambda row: row["score"])
    # 66 is 12 scales away from 30: 1 / 145; the best is found within a tenth of a scale, 0.05 m/s.
    assert first["degree_6000000.0"] == pytest.approx(1 / 145) and first["score"] == pytest.approx((1 + 1 / 145) / 2)
    assert best["V_imp"] == pytest.approx(5.0, abs=0.05)
    assert (tmp_path / "out" / "search.png").stat().st_size > 1000
    # The best sets are a study of their own, with the same numbers.
    again = run_study(read_study(tmp_path / "out" / "best.toml"), tmp_path / "again", show=False)
    point, result = again.points[0]
    assert point.coordinates["set"] == "B1" and result["values"]["product"] == pytest.approx(6e6 * best["V_imp"])


def test_a_search_is_not_refined_and_says_what_it_lacks(tmp_path, monkeypatch):
    with pytest.raises(RuptfxError, match="--refine"):
        run_study(search(tmp_path, 8), tmp_path / "out", show=False, refined=True)
    monkeypatch.setitem(sys.modules, "cma", None)
    with pytest.raises(RuptfxError, match=facts(r"pip install 'ruptfx\[search\]'")):
        run_study(search(tmp_path, 8), tmp_path / "out", show=False)


@pytest.mark.slow
def test_a_scheduler_elsewhere(tmp_path):
    from distributed import LocalCluster

    threads = {"n_workers": 1, "threads_per_worker": 2, "processes": False, "dashboard_address": None}
    with LocalCluster(**threads, protocol="tcp") as cluster:
        assert run(tmp_path, [2.0, 13.0], scheduler=cluster.scheduler_address).failed == 2
    with pytest.raises(RuptfxError, match=r"--scheduler tcp://127\.0\.0\.1:9"):
        run(tmp_path, [4.0], scheduler="tcp://127.0.0.1:9")


def test_missing_dask_is_said(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RuptfxError, match=facts(r"pip install 'ruptfx\[study\]'")):
        run(tmp_path, [2.0])


def test_lock_is_free_after_an_error_and_blocks_other_threads(tmp_path):
    plan = study(tmp_path, [2.0])
    seen = []

    def second():
        try:
            with Store(tmp_path / "out", plan):
                seen.append("in")
        except RuptfxError:
            seen.append("refused")

    with pytest.raises(ZeroDivisionError), Store(tmp_path / "out", plan):
        thread = threading.Thread(target=second)
        thread.start()
        thread.join()
        raise ZeroDivisionError
    second()
    assert seen == ["refused", "in"]


def test_children_end_with_their_study(tmp_path):
    import psutil

    run(tmp_path, [2.0])
    deadline = time.monotonic() + 5
    while psutil.Process().children() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [child for child in psutil.Process().children() if "-c" in child.cmdline()]


@pytest.mark.parametrize("width, count", [(0.25, 0), (0.25 * (1 + 1e-12), 0), (0.26, 1)])
def test_a_boundary_of_the_wanted_width_is_not_bisected_again(width, count, monkeypatch):
    point = SimpleNamespace(coordinates={"a": 0.0}, values={"a": 0.0}, hash="x")
    monkeypatch.setattr(refine, "boundaries", lambda study, known: iter([refine.Step("a", point, point, width)]))
    study = SimpleNamespace(
        base=dict,
        refine=SimpleNamespace(width=0.25),
        axis=lambda name: SimpleNamespace(middle=lambda low, high: 0.5),
        point=lambda values, origin, table: SimpleNamespace(hash="y"),
    )
    assert len(refine.bisections(study, [])) == count


@pytest.mark.parametrize("half, fine, doubtful", [
    ("crack", "crack", False), ("pulse", "crack", True), ("crack", "pulse", True), (None, None, False),
])  # fmt: skip
def test_points_are_doubtful_by_the_threshold_or_by_the_finer_mesh(half, fine, doubtful):
    shown = Map(SimpleNamespace(refine=SimpleNamespace(by="mode")), [], Path())
    assert shown.doubtful({"mode": "crack", "mode_at_half_threshold": half, "fine_mesh": fine}) is doubtful


def test_columns_have_their_units():
    """By hand; energies of plane models are per metre of thickness."""
    assert [unit_of("energy_kinetic", plane) for plane in ("stress", "antiplane", "solid", "axisymmetric", "")] == [
        "J/m", "J/m", "J", "J", "1"]  # fmt: skip
    units = {"energy_kinetic": "J/m", "energy_closure": "1", "time_step": "s", "wall_time": "s", "seconds": "s",
             "node_updates_per_second": "1/s", "tip_speed": "m/s", "max_slip": "m", "mode": "1"}  # fmt: skip
    assert {name: unit_of(name, "strain") for name in units} == units
