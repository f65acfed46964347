"""Inference: exact priors, recovered numbers and fields, kills and ranks, and what is refused."""

from __future__ import annotations

import csv
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pytest
import tomli_w
import xarray
from helpers.messages import facts
from helpers.small_cases import merged, slip_weakening, strike_slip
from typer.testing import CliRunner

from ruptfx.app.cli import app
from ruptfx.app.commands.infer import _note, shown_interval
from ruptfx.case import Case, parse_case, read_case
from ruptfx.input.schema import CaseError

pytest.importorskip("dolfinx")

from ruptfx import RuptfxError, infer, simulate
from ruptfx.many_runs.adjoint.gradients import Objective
from ruptfx.many_runs.adjoint.unknowns import chosen
from ruptfx.many_runs.inference import inversion, posterior, searches
from ruptfx.many_runs.inference.evaluations import Evaluation, load_one
from ruptfx.many_runs.inference.evaluator import Evaluator
from ruptfx.many_runs.inference.figure import _draw_field, draw, draw_tradeoffs
from ruptfx.many_runs.inference.result import Fit, Recovered, Result
from ruptfx.many_runs.inference.variables import Variable
from ruptfx.platform import fem, launch
from ruptfx.platform.progress import Progress
from ruptfx.readings.misfits import Unknown
from ruptfx.results import figure_style
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem


@pytest.fixture
def pictures() -> None:
    """Wanted by tests that look for the pictures of an inference; the others save none."""


@pytest.fixture(autouse=True)
def _unsaved(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "pictures" not in request.fixturenames:
        monkeypatch.setattr(figure_style, "save", lambda *of_figure: None)


SHEAR = "faults.main.initial_stress.shear"
NORMAL = "faults.main.initial_stress.normal"
FIELD = {"key": SHEAR, "sigma": 2e6, "correlation_length": 5e3}
TIMES = np.arange(0.1, 1.55, 0.05)


def fault(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """A rupture in antiplane with the ageing law, and ten receivers."""
    receivers = [
        {"kind": "velocimeter", "name": f"r{n}", "interval": 0.02, "point": [x, 600.0], "direction": [1.0]}
        for n, x in enumerate(np.linspace(-4.5e3, 4.5e3, 10).tolist())
    ]
    table = {
        "plane": "antiplane", "order": 4, "duration": 1.6, "positions": "x",
        "mesh": {"kind": "half_plate", "left": -5e3, "length": 10e3, "height": 2e3, "element_size": 500.0},
        "materials": {"default": {"kind": "isotropic_elastic", "density": 2670.0, "c_p": 6000.0, "c_s": 3464.0}},
        "damping": {"kelvin_voigt": {"eta": 7e-4}},
        "faults": {"main": {
            "contact": {"kind": "split_node"},
            "friction": {"kind": "rate_and_state_ageing", "a": 0.008, "b": 0.012, "D_c": 0.04, "f_0": 0.6, "V_0": 1e-6,
                         "V_initial": 1e-6},
            "initial_stress": {"normal": 120e6, "shear": 75e6},
            "nucleation": {"kind": "smooth_patch", "extra": 25e6, "center": 0.0, "radius": 3e3, "rise": 0.3},
        }},
        "boundaries": [{"kind": "absorbing", "edge": f"upper.{edge}"} for edge in ("left", "right", "top")],
        "instruments": receivers,
    }  # fmt: skip
    return merged(table, changes or {})


def hill(x: np.ndarray) -> np.ndarray:
    return 75e6 + 3e6 * np.exp(-(((x - 2e3) / 1.5e3) ** 2))


@cache
def measured(key: str, value: float | None) -> dict[str, Any]:
    """The case with data of a run in which one key has another value, None for the hill; noise of 5 %."""
    x = np.linspace(-5e3, 5e3, 81)
    hilly = {"kind": "table", "positions": x.tolist(), "values": hill(x).tolist()}
    table = fault()
    table["objective"] = [
        {"kind": "traces", "instrument": each["name"], "times": TIMES.tolist(), "sigma": 1.0,
         "data": {"velocity": [0.0] * len(TIMES)}, "units": {"velocity": "m/s"}} for each in table["instruments"]
    ]  # fmt: skip
    true = parse_case(table).changed(key, hilly if value is None else value)
    clean = [each.values for _, each in Objective(true, true.objective, record=False).samples]
    sigma, random = 0.05 * float(np.sqrt(np.mean(np.square(clean)))), np.random.default_rng(3)
    for term, values in zip(table["objective"], clean, strict=True):
        term["sigma"] = sigma
        term["data"]["velocity"] = (values + sigma * random.normal(size=len(values))).tolist()
    return table


def with_unknowns(table: dict[str, Any], *unknowns: dict[str, Any], **settings: Any) -> Case:
    return parse_case({**table, "unknowns": list(unknowns), "inference": settings})


def variable(unknown: dict[str, Any], table: dict[str, Any] | None = None) -> Variable:
    model = Model(parse_case(table or fault())).in_steps("explicit")
    ((_, place),) = chosen(model, [Unknown(**unknown)])
    return Variable(model, Unknown(**unknown), place, "unknowns.0")


def test_the_prior_of_a_field_has_an_exponential_covariance() -> None:
    made = variable(FIELD)
    columns = np.array([made.values(row) - made.start for row in np.eye(made.size)])
    distance = np.abs(made.position[:, None] - made.position)
    np.testing.assert_allclose(columns.T @ columns, 4e12 * np.exp(-distance / 5e3), rtol=1e-6)


@pytest.mark.parametrize("unknown", [
    FIELD, {**FIELD, "bounds": [70e6, 78e6]}, {**FIELD, "scale": "log", "sigma": 0.05},
    {**FIELD, "scale": "log", "sigma": 0.05, "bounds": [70e6, 78e6]},
    {"key": SHEAR, "shape": "number", "sigma": 1e6}, {"key": SHEAR, "shape": "number", "scale": "log"},
    {"key": SHEAR, "shape": "knots", "knots": [-5e3, -1e3, 3e3], "scale": "log"},
], ids=["linear", "bounds", "log", "log with bounds", "number", "factor", "knots"])  # fmt: skip
def test_values_and_their_derivatives(unknown: dict[str, Any]) -> None:
    made, random = variable(unknown), np.random.default_rng(0)
    z, change = random.normal(size=(2, made.size))
    factors = random.normal(size=len(made.start))
    np.testing.assert_allclose(made.values(np.zeros(made.size)), made.start, rtol=1e-14)
    difference = (made.values(z + 1e-5 * change) - made.values(z - 1e-5 * change)) / 2e-5
    assert made.pull(z, factors) @ change == pytest.approx(factors @ difference, rel=1e-5)
    np.testing.assert_allclose(made.push(z, change) @ factors, made.pull(z, factors) @ change, rtol=1e-10)
    if bounds := unknown.get("bounds"):
        values = made.values(30 * z)
        assert bounds[0] <= values.min() and values.max() <= bounds[1]
        assert made.at_bound(30 * z) and not made.at_bound(np.zeros(made.size))


def test_a_number_is_recovered(tmp_path: Path) -> None:
    """D_c is 30 mm in the data, and 40 mm in the case."""
    table = measured("faults.main.friction.D_c", 0.03)
    number = {"key": "faults.main.friction.D_c", "shape": "number", "scale": "log", "bounds": [1e-3, 1.0]}
    made = infer(with_unknowns(table, number, tolerance=1e-6), tmp_path / "out", progress=False)
    assert made.case.faults["main"].friction.D_c == pytest.approx(0.03, rel=0.01)
    assert 2 * made.best.misfit / made.data == pytest.approx(1.0, abs=4 * np.sqrt(2 / made.data))
    assert len(made.runs) < 20


def test_laplace_of_a_linear_model_is_exact() -> None:
    """Residuals J z - d with d ~ N(0, 1) and z ~ N(0, 1) for fields: covariance (J'J + I)^-1."""
    random = np.random.default_rng(0)
    jacobian = random.normal(size=(7, 5)) * np.array([10.0, 3.0, 1.0, 0.1, 1e-9])
    some = np.array([True, False, True, False, True])
    made = posterior.of_jacobian(np.zeros(5), jacobian, some)
    exact = np.linalg.inv(jacobian.T @ jacobian + np.diag(some))
    np.testing.assert_allclose(made.spread @ made.spread.T, exact, rtol=1e-9, atol=1e-12)
    product = jacobian.T @ jacobian
    whole = posterior.of_products(np.zeros(5), lambda z: product @ z, 4)
    np.testing.assert_allclose(whole.spread @ whole.spread.T, np.linalg.inv(product + np.eye(5)), atol=1e-9)
    draws = made.draws(100_000, np.full(5, -np.inf), np.full(5, np.inf))
    np.testing.assert_allclose(np.cov(draws.T), exact, atol=0.02 * exact.max())
    assert made.draws(1000, np.zeros(5), np.full(5, np.inf)).min() >= 0


NUMBERS = ({"key": "faults.main.friction.D_c", "shape": "number", "scale": "log", "bounds": [1e-2, 0.2]},
           {"key": SHEAR, "shape": "number", "sigma": 2e6})  # fmt: skip


@cache
def by_gauss_newton() -> Result:
    """D_c is 30 mm in the data, and 40 mm in the case; the stress is that of the case."""
    case = with_unknowns(measured("faults.main.friction.D_c", 0.03), *NUMBERS, method="gauss_newton")
    with TemporaryDirectory() as folder:
        made = infer(case, Path(folder, "out"), progress=False)
        again = infer(case, Path(folder, "out"), progress=False)  # from the files
        assert (Path(folder, "out/tradeoffs.png")).stat().st_size > 10000
        rows = list(csv.DictReader(Path(folder, "out/unknowns.csv").read_text().splitlines()))
        with xarray.open_dataset(Path(folder, "out/result.nc"), engine="h5netcdf") as data:
            for row, each in zip(rows, made.unknowns, strict=True):
                assert each.interval is not None
                assert float(row["68 % from, mean"]) == each.interval[0].mean() == data[f"{each.key}.from"].mean()
    assert len(again.runs) == len(made.runs) and again.best.total == made.best.total
    return made


def test_gauss_newton_recovers_two_numbers_in_a_few_runs(pictures: None) -> None:
    made = by_gauss_newton()
    assert made.reason == "converged" and len(made.runs) < 10 and not made.exceeds_noise
    assert replace(made, iterates=[0]).exceeds_noise  # the start
    assert 2 * made.best.misfit / made.data == pytest.approx(1.0, abs=4 * np.sqrt(2 / made.data))
    for each, true in zip(made.unknowns, (0.03, 75e6), strict=True):
        low, high = each.interval[:, 0]
        assert low < each.best[0] < high
        assert abs(each.best[0] - true) < 2 * (high - low)  # four standard deviations


def test_sensitivities_are_those_of_the_adjoint(pictures: None) -> None:
    """J' r of the first run is the gradient of its misfit; its prior has none."""
    made = by_gauss_newton()
    first, case = made.runs[0], made.case.changed("faults.main.friction.D_c", 0.04).changed(SHEAR, 75e6)
    with TemporaryDirectory() as folder:
        found = inversion.Inversion(case, Path(folder, "out"), fem.MPI.COMM_WORLD, False, 1e9)
        exact = found._evaluate(np.zeros(2)).gradient
    np.testing.assert_allclose(first.jacobian.T @ first.residuals, exact, rtol=1e-8)


@pytest.mark.parametrize("method, settings", [
    ("cma_es", {"iterations": 25, "tolerance": 1e-9}), ("ensemble", {"iterations": 500, "population": 8}),
])  # fmt: skip
def test_methods_without_derivatives_on_a_linear_model(
    method: str, settings: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Runs are replaced by residuals J z - d: the minimum and the covariance (J'J + P)^-1 are known."""
    pytest.importorskip({"cma_es": "cma", "ensemble": "emcee"}[method])
    jacobian, data = np.array([[8.0, 0.0], [6.0, 3.0], [0.0, 1.0]]), np.array([1.0, 2.0, 0.5])

    def evaluate(self: inversion.Inversion, z: np.ndarray, derivatives: str) -> Evaluation:
        r = jacobian @ z - data
        prior = 0.5 * float(z[1] ** 2)
        return Evaluation(z, 0.5 * float(r @ r), prior, jacobian.T @ r, np.zeros(290), r, np.zeros((0, 0)))

    monkeypatch.setattr(inversion.Inversion, "_evaluate", evaluate)
    monkeypatch.setattr(inversion.evaluations, "save", lambda *args: None)
    monkeypatch.setattr(inversion.Inversion, "_jacobian", lambda self, number: jacobian)
    case = with_unknowns(measured("faults.main.friction.D_c", 0.03), *NUMBERS, method=method, seed=3, **settings)
    made = infer(case, tmp_path / "out", progress=False)
    curvature = jacobian.T @ jacobian + np.diag([0.0, 1.0])
    least = np.linalg.solve(curvature, jacobian.T @ data)
    deviation = np.sqrt(np.diag(np.linalg.inv(curvature)))
    close = 1e-2 if method == "cma_es" else 0.3
    np.testing.assert_allclose(made.best.variables, least, atol=close * deviation.min())
    widths = [0.25 * np.log(20.0), 2e6]  # of one in each variable
    halves = [0.5 * np.log(made.unknowns[0].interval[1, 0] / made.unknowns[0].interval[0, 0]),
              0.5 * np.ptp(made.unknowns[1].interval[:, 0])]  # fmt: skip
    np.testing.assert_allclose(halves, deviation * widths, rtol=1e-6 if method == "cma_es" else 0.15)
    if method == "ensemble":
        correlation = np.corrcoef(*made.samples.values())[0, 1]
        assert correlation == pytest.approx(-18 / np.sqrt(1100), abs=0.12)
        assert len(made.samples[SHEAR]) == 8 * 350


@pytest.mark.slow
def test_intervals_of_a_rupture_agree_with_an_ensemble(tmp_path: Path, pictures: None) -> None:
    """Two ways to the posterior: Laplace's approximation, and a sample without derivatives."""
    pytest.importorskip("emcee")
    laplace = by_gauss_newton()
    case = laplace.case.changed("inference", {"method": "ensemble", "iterations": 60, "population": 6, "seed": 1})
    made = infer(case, tmp_path / "out", progress=False)
    for one, other in zip(made.unknowns, laplace.unknowns, strict=True):
        width = np.ptp(one.interval[:, 0]) / np.ptp(other.interval[:, 0])
        assert 0.6 < width < 1.6  # about 20 independent samples
        assert abs(one.interval.mean() - other.interval.mean()) < np.ptp(other.interval[:, 0])
    assert "samples" in made.reason and made.best.total < laplace.best.total * 1.01


def test_an_ensemble_needs_a_range_and_walkers(tmp_path: Path) -> None:
    pytest.importorskip("emcee")
    number = {"key": SHEAR, "shape": "number"}
    case = with_unknowns(measured("faults.main.friction.D_c", 0.03), number, method="ensemble")
    with pytest.raises(CaseError, match=facts(r"unknowns\.0\.sigma, bounds: .*ensemble")):
        infer(case, tmp_path / "out", progress=False)
    few = with_unknowns(measured("faults.main.friction.D_c", 0.03), *NUMBERS, {**number, "key": NORMAL, "sigma": 1e6},
                        method="ensemble", population=4)  # fmt: skip
    with pytest.raises(CaseError, match=facts(r"inference\.population = 4: .* 6 walkers")):
        infer(few, tmp_path / "few", progress=False)


@pytest.mark.parametrize("method", ["l_bfgs", "gauss_newton"])
def test_the_progress_of_a_search_has_its_steps_and_never_decreases(
    method: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[list[tuple[float, str]]] = []

    class Recorded(Progress):
        def __init__(self, show: bool = True) -> None:
            super().__init__(False)
            self.seen: list[tuple[float, str]] = []
            shown.append(self.seen)

        def update(self, fraction: float, text: str) -> None:
            self.seen.append((fraction, text))

    monkeypatch.setattr(inversion, "Progress", Recorded)
    case = with_unknowns(measured("faults.main.friction.D_c", 0.03), *NUMBERS, method=method, iterations=3)
    infer(case, tmp_path / "out", progress=False)
    (search,) = [seen for seen in shown if any("iteration" in text for _, text in seen)]
    fractions = np.array([fraction for fraction, _ in search])
    assert np.all(np.diff(fractions) > -1e-12) and 0 < fractions[0] < 0.01 and 0.5 < fractions[-1] <= 1
    wanted = "backward  step" if method == "l_bfgs" else "variable 2 of 2, sensitivity  step"
    assert any(wanted in text for _, text in search) and any("forward  step" in text for _, text in search)


@pytest.mark.slow
def test_a_field_is_recovered_and_its_case_runs(tmp_path: Path, pictures: None) -> None:
    out = tmp_path / "out"
    case = with_unknowns(measured(SHEAR, None), FIELD, iterations=15)
    made = infer(case, out, progress=False)
    (stress,) = made.unknowns
    seen = np.abs(stress.position) < 3e3  # the rupture passes the rest too late
    true = hill(stress.position)
    assert np.linalg.norm((stress.best - true)[seen]) < 0.2 * np.linalg.norm((stress.start - true)[seen])
    assert 0.8 < 2 * made.best.misfit / made.data < 1.1
    assert len(made.runs) < 60
    best = read_case(out / "best.toml")
    assert isinstance(best, Case)
    again = Objective(best, best.objective, record=False)
    assert again.value == pytest.approx(made.best.misfit, rel=1e-9)
    with simulate(best, out=tmp_path / "run", progress=False) as record:
        np.testing.assert_allclose(record.interface["slip"].values[-1].max(), record.interface["slip"].values.max())
    rows = list(csv.DictReader((out / "misfit.csv").open()))
    assert [float(row["misfit"]) for row in rows] == [run.misfit for run in made.runs]
    assert rows[0]["iteration"] == "0" and rows[-1]["iteration"] in ("", str(len(made.iterates) - 1))
    assert tomllib.loads((out / "case.toml").read_text())["inference"]["iterations"] == 15
    assert (out / "inference.png").stat().st_size > 20000 and (out / "unknowns.csv").exists()


def test_the_band_of_a_field_is_narrow_where_the_data_see_it(tmp_path: Path) -> None:
    """Below the receivers, where the rupture passes, the data know more than the prior; at the ends they do not."""
    case = with_unknowns(measured(SHEAR, None), FIELD, iterations=1, directions=3)
    (stress,) = infer(case, tmp_path / "out", progress=False).unknowns
    half = 0.5 * np.ptp(stress.interval, axis=0)
    ratio = half[np.argsort(stress.position)] / 2e6  # prior 2 MPa
    assert ratio.max() <= 1 + 1e-9 and ratio.min() < 0.5
    assert ratio[len(ratio) // 2] < ratio[0] and ratio[len(ratio) // 2] < ratio[-1]
    again = infer(case, tmp_path / "out", progress=False).unknowns[0]  # from the file
    np.testing.assert_array_equal(again.interval, stress.interval)


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (4.05341e-6, 4.19739e-6, "4.053e-06 to 4.197e-06"), (0.233478, 0.245822, "0.2335 to 0.2458"),
        (-1.0, 3.0, "-1 to 3"), (0.5123456, 0.5123467, "0.512346 to 0.512347"), (0.25, 0.25, "0.25 to 0.25"),
    ],
)  # fmt: skip
def test_intervals_have_the_digits_in_which_their_ends_differ(low: float, high: float, text: str) -> None:
    assert shown_interval(low, high) == text


def test_an_interrupted_inference_goes_on_as_if_it_were_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = with_unknowns(measured(SHEAR, None), FIELD, iterations=5)
    whole = infer(case, tmp_path / "whole", progress=False)
    computed, evaluate = [], inversion.Inversion._evaluate

    def counted(self: inversion.Inversion, z: np.ndarray, derivatives: str) -> Any:
        if len(computed) == 3:
            os.kill(os.getpid(), signal.SIGTERM)
        made = evaluate(self, z, derivatives)
        computed.append(made)
        return made

    monkeypatch.setattr(inversion.Inversion, "_evaluate", counted)
    with pytest.raises(RuptfxError, match=facts("3 runs are kept")) as error:
        infer(case, tmp_path / "part", progress=False)
    assert error.value.exit_code == 130
    monkeypatch.setattr(inversion.Inversion, "_evaluate", evaluate)
    (tmp_path / "part/evaluations/0003.part").write_bytes(b"half")
    made = infer(case, tmp_path / "part", progress=False)
    assert len(made.runs) == len(whole.runs) > 4
    for one, other in zip(made.runs, whole.runs, strict=True):
        np.testing.assert_array_equal(one.variables, other.variables)
    monkeypatch.setattr(inversion.Inversion, "_evaluate", counted)  # 3 were made: no further run is
    assert infer(case, tmp_path / "part", progress=False).best.misfit == whole.best.misfit
    with pytest.raises(RuptfxError, match=rf"{re.escape(str(tmp_path / 'part'))}: .*--out"):
        infer(case.changed("duration", 1.59), tmp_path / "part", progress=False)


GENERATIONS = {"cma_es": {"iterations": 3, "population": 6}, "ensemble": {"iterations": 2, "population": 6}}
"""Settings of short searches, whose runs are made at once."""


def at_once(method: str) -> Case:
    """D_c is 30 mm in the data, and 40 mm in the case."""
    pytest.importorskip({"cma_es": "cma", "ensemble": "emcee"}[method])
    pytest.importorskip("distributed")
    return with_unknowns(measured("faults.main.friction.D_c", 0.03), *NUMBERS, method=method, seed=3,
                         **GENERATIONS[method])  # fmt: skip


def same_runs(one: Result, other: Result) -> None:
    """All runs are bitwise the same, and so is the posterior."""
    assert len(one.runs) == len(other.runs) and one.iterates == other.iterates and one.reason == other.reason
    for a, b in zip(one.runs, other.runs, strict=True):
        for name, values in vars(a).items():
            np.testing.assert_array_equal(values, vars(b)[name], err_msg=name)
    for key, values in one.samples.items():
        np.testing.assert_array_equal(values, other.samples[key])


@pytest.mark.slow
@pytest.mark.parametrize("method", GENERATIONS)
def test_runs_at_once_are_those_one_after_the_other(method: str, tmp_path: Path) -> None:
    """In this process, and by the workers of a study: one, and two."""
    case = at_once(method)
    alone = infer(case, tmp_path / "alone", progress=False)
    assert len(alone.runs) > 10
    two = infer(case, tmp_path / "two", progress=False, cores=2)
    same_runs(alone, two)
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        one = infer(case, tmp_path / "one", progress=False, scheduler=address)
    same_runs(alone, one)


def begun(folder: Path) -> subprocess.Popen[str]:
    """Start the inference of a folder on two cores."""
    command = [sys.executable, "-m", "ruptfx", "infer", "case.toml", "--out", "out", "--cores", "2", "--quiet"]
    environment = {**os.environ, "RUPTFX_TEST": str(folder)}
    return subprocess.Popen(command, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True)


def wait_for_runs(folder: Path, count: int) -> None:
    """Wait until so many runs of the inference of a folder are on disk."""
    deadline = time.monotonic() + 120
    while len(list((folder / "out/evaluations").glob("*.npz"))) < count:
        assert time.monotonic() < deadline
        time.sleep(0.02)


def kill(process: subprocess.Popen[str], folder: Path) -> None:
    """Kill an inference, and wait until all of its processes have ended."""
    process.kill()
    process.communicate()
    deadline = time.monotonic() + 10
    while any(
        (each.info["environ"] or {}).get("RUPTFX_TEST") == str(folder) and each.info["status"] != psutil.STATUS_ZOMBIE
        for each in psutil.process_iter(["environ", "status"])
    ):
        assert time.monotonic() < deadline, "runs outlive their inference"
        time.sleep(0.05)


def stop(process: subprocess.Popen[str]) -> None:
    """Stop an inference as a scheduler of a cluster does."""
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130 and re.search(r"stopped; \d+ runs are kept, the same command continues", errors)


@pytest.mark.slow
@pytest.mark.faults
def test_an_inference_on_two_ranks_that_is_stopped_says_what_is_kept(tmp_path: Path) -> None:
    """SIGTERM to the launcher: all ranks end at the next step, with one message and the exit code of a stopped run."""
    with_unknowns(measured(SHEAR, None), FIELD, iterations=50).save(tmp_path)
    command = [sys.executable, "-m", "ruptfx", "infer", "case.toml", "--out", "out", "--ranks", "2", "--quiet"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    wait_for_runs(tmp_path, 1)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    kept = len(list((tmp_path / "out/evaluations").glob("*.npz")))
    text = " ".join(errors.split())
    assert re.findall(r"stopped by (?:Ctrl-C|SIGTERM); (\d+) runs are kept, the same command continues", text) == [
        str(kept)
    ]


@pytest.mark.slow
@pytest.mark.faults
def test_an_inference_on_two_cores_that_is_killed_goes_on(tmp_path: Path) -> None:
    """Killed while two runs are made: finished ones are kept, and the result is that without a kill."""
    case = at_once("cma_es")
    case.save(tmp_path)
    out, files = tmp_path / "out", tmp_path / "out" / "evaluations"
    process = begun(tmp_path)
    wait_for_runs(tmp_path, 3)
    kill(process, tmp_path)
    kept = {path: path.stat().st_mtime_ns for path in files.glob("*.npz")}
    assert 3 <= len(kept) < 19

    process = begun(tmp_path)
    wait_for_runs(tmp_path, len(kept) + 2)
    stop(process)

    process = begun(tmp_path)
    assert process.wait(300) == 0
    assert all(
        path.stat().st_mtime_ns == time_of for path, time_of in kept.items() if path.stem != best_of(out)
    )  # that one has its Jacobian now
    same_runs(infer(case, tmp_path / "alone", progress=False), infer(case, out, progress=False))


@pytest.mark.slow
@pytest.mark.faults
def test_gauss_newton_on_two_cores_that_is_killed_goes_on(tmp_path: Path) -> None:
    """Killed and stopped while columns of a Jacobian are computed: the result is that without a kill."""
    pytest.importorskip("distributed")
    case = with_unknowns(measured("faults.main.friction.D_c", 0.03), *NUMBERS, method="gauss_newton", iterations=3)
    case.save(tmp_path)
    out, files = tmp_path / "out", tmp_path / "out" / "evaluations"

    def jacobians() -> list[int]:
        """Columns of the Jacobian of every run on disk, 0 while they are computed."""
        return [load_one(path).jacobian.shape[-1] for path in sorted(files.glob("*.npz"))]

    process = begun(tmp_path)
    wait_for_runs(tmp_path, 1)
    kill(process, tmp_path)
    assert jacobians() == [0]
    process = begun(tmp_path)
    wait_for_runs(tmp_path, 2)
    stop(process)
    assert jacobians() == [2, 0]
    first = (files / "0000.npz").stat().st_mtime_ns

    process = begun(tmp_path)
    assert process.wait(300) == 0
    assert (files / "0000.npz").stat().st_mtime_ns == first
    alone = infer(case, tmp_path / "alone", progress=False)
    assert len(alone.runs) > 2 and alone.runs[1].jacobian.size
    same_runs(alone, infer(case, out, progress=False))


def best_of(out: Path) -> str:
    """Name of the run with the least misfit and prior."""
    rows = list(csv.DictReader((out / "misfit.csv").open()))
    totals = [float(row["misfit"]) + float(row["prior"]) for row in rows]
    return f"{int(np.argmin(totals)):04d}"


@pytest.mark.slow
def test_columns_at_once_are_those_one_after_the_other(tmp_path: Path) -> None:
    """The Jacobians of Gauss-Newton in this process, and by one and two workers; continued, too."""
    pytest.importorskip("distributed")
    case = with_unknowns(measured("faults.main.friction.D_c", 0.03), *NUMBERS, method="gauss_newton", iterations=3)
    alone = infer(case, tmp_path / "alone", progress=False)
    assert alone.runs[0].jacobian.shape[1] == 2 and len(alone.runs) > 1
    two = infer(case, tmp_path / "two", progress=False, cores=2)
    same_runs(alone, two)
    same_runs(alone, infer(case, tmp_path / "two", progress=False))  # from the files
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        one = infer(case, tmp_path / "one", progress=False, scheduler=cluster.scheduler_address)
    same_runs(alone, one)


def test_several_cores_for_runs_that_depend_on_each_other_are_refused(tmp_path: Path) -> None:
    case = with_unknowns(measured("faults.main.friction.D_c", 0.03), *NUMBERS, method="l_bfgs")
    with pytest.raises(CaseError, match=facts(r"inference\.method = 'l_bfgs': makes one run after the other")):
        infer(case, tmp_path / "out", progress=False, cores=2)
    assert not (tmp_path / "out").exists()


def test_a_run_that_fails_in_a_worker_ends_the_inference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Variables that are no numbers: its error is that of the call."""
    monkeypatch.setattr(searches, "METHODS", {"cma_es": lambda runs, settings: runs.values_alone([np.full(2, np.nan)])})
    with pytest.raises(RuptfxError, match="trial_shear_traction"):
        infer(at_once("cma_es"), tmp_path / "out", progress=False, cores=2)


@pytest.mark.slow
def test_an_inference_is_the_same_on_two_ranks(tmp_path: Path) -> None:
    case = with_unknowns(measured(SHEAR, None), FIELD, iterations=3)
    (tmp_path / "case.toml").write_text(case.to_toml())
    found = []
    for ranks in (1, 2):
        out = tmp_path / str(ranks)
        assert launch.run_on(ranks, ["infer", str(tmp_path / "case.toml"), "--out", str(out), "--quiet"]) == 0
        found.append(read_case(out / "best.toml").table()["faults"]["main"]["initial_stress"]["shear"]["values"])
    np.testing.assert_allclose(*found, rtol=1e-9)
    assert np.ptp(found[0]) > 1e5


TRACE = {"kind": "traces", "instrument": "fault", "times": [1e-6], "data": {"slip": [0.0]}, "units": {"slip": "m"},
         "sigma": 1e-6}  # fmt: skip
NUMBER = {"key": SHEAR, "shape": "number"}


@pytest.mark.parametrize("changes, message", [
    ({"objective": []}, "objective: there are no data"),
    ({"unknowns": []}, "unknowns: there are none"),
    ({"objective": [{"kind": "slip_time", "position": 16e-3}]}, r"objective\.0\.kind = 'slip_time': .* in s"),
    ({"unknowns": [{**NUMBER, "bounds": [5e6, 6e6]}]}, r"unknowns\.0\.bounds = .*do not contain the value of the case"),
    ({"unknowns": [{"key": "faults.main.friction.mu_d", "shape": "number", "bounds": [-0.1, 0.5]}]},
     r"unknowns\.0\.bounds = \[-0\.1, 0\.5\]: -0\.1 is refused, faults\.main\.friction\.mu_d = -0\.1: .* 0; give"),
    ({"unknowns": [NUMBER, {"key": "faults.main.friction.D_c", "shape": "number", "bounds": [0.0, 1e-4]}]},
     r"unknowns\.1\.bounds = \[0\.0, 0\.0001\]: 0 is refused, faults\.main\.friction\.D_c = 0\.0: .* 0; give"),
    ({"unknowns": [{"key": "faults.main.friction.mu_d", "bounds": [-0.1, 0.5], "sigma": 0.1,
                    "correlation_length": 1e-3}]}, r"unknowns\.0\.bounds = \[-0\.1, 0\.5\]: -0\.1 is refused"),
    ({"objective": [{**TRACE, "units": {"slip": "furlong"}}]}, r"objective\.0: units\.slip = 'furlong': unknown unit"),
    ({"objective": [{**TRACE, "units": {"slip": "Pa"}}]}, r"objective\.0\.units\.slip = 'Pa': a value in m is wanted"),
    ({"objective": [{**TRACE, "times": [1.0]}]}, r"objective\.0\.times: data from 1 s.*make the run longer"),
    ({"objective": [{**TRACE, "instrument": "gauge"}]}, r"objective\.0\.instrument = 'gauge': no such instrument"),
    ({"unknowns": [{"key": SHEAR}]}, r"unknowns\.0\.sigma, correlation_length: .*prior"),
    ({"unknowns": [{**NUMBER, "scale": "log"}], "faults.main.initial_stress.shear": -1e6},
     r"unknowns\.0\.scale = 'log'.* -1e\+06"),
    ({"unknowns": [{"key": "faults.main.friction.mu"}]}, r"unknowns\.0\.key .*did you mean"),
    ({"unknowns": [{"key": "materials.default.density"}]}, r"unknowns\.0\.key .*this is a constant of bodies"),
    ({"unknowns": [{"key": "faults.main.contact.C_n", "shape": "number"}],
      "faults.main.contact": {"kind": "compliant", "C_n": 300e9, "C_s": 100e9}},
     r"unknowns\.0\.key .*the stable time step depends on it"),
])  # fmt: skip
def test_what_cannot_be_inferred_is_refused_before_the_first_step(
    changes: dict[str, Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object) -> None:
        raise AssertionError("a step was made")

    monkeypatch.setattr("ruptfx.stepping.steppers.leapfrog.LeapfrogMotion.step", refuse)
    receiver = {"kind": "fault_receiver", "name": "fault", "interval": 1e-7, "position": 16e-3}
    table = slip_weakening({"instruments": [receiver], "objective": [TRACE], "unknowns": [NUMBER], **changes})
    with pytest.raises(RuptfxError, match=facts(message)):
        infer(parse_case(table), tmp_path / "out", progress=False)
    assert not (tmp_path / "out").exists()  # else the corrected case would be another one there


@pytest.mark.parametrize("unknown, message", [
    ({"bounds": [2.0, 1.0]}, "the first must be below the second"),
    ({"bounds": [-1.0, 1.0], "scale": "log"}, r"bounds = \[-1\.0, 1\.0\]: must be positive with scale = 'log'"),
    ({"shape": "number", "correlation_length": 1.0}, "a number has none"),
    ({"shape": "knots"}, "knots belong together"),
    ({"shape": "knots", "knots": [2.0, 1.0]}, "must increase"),
])  # fmt: skip
def test_entries_that_contradict_themselves_are_refused(unknown: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        parse_case(slip_weakening({"unknowns": [{"key": SHEAR, **unknown}]}))


def test_a_knot_that_no_point_depends_on_is_named() -> None:
    """Three knots between two neighbouring points: the middle one has no effect."""
    with pytest.raises(CaseError, match=r"^unknowns\.0\.knots:.*-999.m;.remove"):
        variable({"key": SHEAR, "shape": "knots", "knots": [-5e3, -1e3, -999.0, -998.0, 3e3]})


def test_an_unknown_that_the_data_do_not_feel_is_named(tmp_path: Path) -> None:
    """Cohesion that is lost has no effect."""
    law = {"kind": "cohesion", "c": 1e5, "D_cohesion": 1e-6, "law": {"kind": "coulomb", "mu_d": 1e3}}
    table = slip_weakening({"faults.main.friction": law, "objective": [{"kind": "final_slip", "sigma": 1e-6}]})
    case = with_unknowns(table, {"key": "faults.main.friction.c", "shape": "number"})
    with pytest.raises(RuptfxError, match=facts(r"does not depend on 'faults\.main\.friction\.c'")):
        infer(case, tmp_path / "out", progress=False)


@pytest.mark.parametrize("sigma", [0.0, 1e5])
def test_the_figure_names_a_prior_only_where_there_is_one(sigma: float) -> None:
    from matplotlib.figure import Figure

    x, start = np.linspace(0.0, 1.0, 3), np.full(3, 3e6)
    band = np.array([start - sigma, start + sigma])
    ax = Figure().subplots()
    _draw_field(ax, Recovered(SHEAR, "Pa", "knots", x, start, start, band, False, None))
    names = [each.get_text() for each in ax.get_legend().get_texts()]
    assert names == [*(["prior"] if sigma else []), "case", "recovered"]


def by_hand() -> Result:
    """A field at three positions, two numbers and two traces; twice the misfit is four and three times the data."""
    x = np.array([2e3, 0.0, 1e3])
    start, best = np.array([70e6, 71e6, 72e6]), np.array([75e6, 74e6, 79e6])
    field = Recovered(SHEAR, "Pa", "points", x, start, best, np.array([start - 1e6, start + 2e6]), False,
                      np.array([best - 3e6, best + 5e6]))  # fmt: skip
    D_c, other = (Recovered(f"faults.main.friction.{name}", "m", "number", x, np.full(3, 0.04), np.full(3, value),
                            np.full((2, 3), 0.04), False, np.array([[0.02] * 3, [0.05] * 3]))
                  for name, value in (("D_c", 0.03), ("D", 0.06)))  # fmt: skip
    times = np.array([0.0, 1e-3, 2e-3])
    fits = [Fit(name, times, times * size, times * 2, times * 3) for name, size in (("one", 4e3), ("two", 1e3))]
    runs: Any = [SimpleNamespace(misfit=misfit) for misfit in (8.0, 99.0, 6.0)]
    samples = {each.key: np.linspace(0.01, 0.05, 41) ** power for each, power in ((D_c, 1), (other, 2))}
    case: Any = SimpleNamespace(unknowns=[Unknown(key=each.key) for each in (field, D_c, other)])
    return Result(case, [field, D_c, other], runs, [0, 2], 4, "converged", fits, samples)


def test_the_command_prints_the_numbers_of_the_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Means of fields, their range and half the mean width of their intervals; numbers with both ends."""
    monkeypatch.setattr(inversion, "infer", lambda *_, **__: by_hand())
    (tmp_path / "case.toml").write_text(tomli_w.dumps(slip_weakening()))
    done = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["infer", str(tmp_path / "case.toml")])
    lines = [" ".join(line.split()) for line in done.output.splitlines()]
    assert "misfit 8 -> 6 (3 times that of noise); 1 iterations, 3 runs, converged" in lines
    assert f"{SHEAR} 7.1e+07 7.4e+07 to 7.9e+07 ± 4e+06 on average Pa" in lines
    assert "faults.main.friction.D_c 0.04 0.03 0.02 to 0.05 m" in lines


def test_figures_show_the_numbers_of_the_result() -> None:
    """A field in MPa at positions in any order, a number over that of the case, traces by the largest amplitude."""
    made = by_hand()
    fits, samples = made.fits, {each.key: made.samples[each.key] for each in made.unknowns[1:]}
    D_c, other = made.unknowns[1:]
    traces, of_field, numbers, misfit = draw(made).axes
    for row, fit in enumerate(fits):
        for line, values in zip(traces.lines[3 * row :], (fit.start, fit.data, fit.best), strict=False):
            np.testing.assert_allclose(line.get_xdata(), [0, 1, 2])
            np.testing.assert_allclose(line.get_ydata(), values / 8.0 - row)
    assert traces.get_xlabel() == "Time (ms)"
    for line, expected in zip(of_field.lines, ([71, 72, 70], [74, 79, 75]), strict=True):
        np.testing.assert_allclose([line.get_xdata(), line.get_ydata()], [[0, 1, 2], expected])
    for band, expected in zip(of_field.collections, ([69, 74], [71, 84]), strict=True):  # lowest and highest
        np.testing.assert_allclose(band.get_paths()[0].get_extents().intervaly, expected)
    assert (of_field.get_xlabel(), of_field.get_ylabel()) == ("Position (km)", "shear (MPa)")
    texts = [text.get_text() for text in numbers.texts]
    assert texts[5:] == ["friction.D_c", "30", "20 to 50", "40", "mm", "friction.D", "60", "20 to 50", "40", "mm"]
    (bar,) = (line for line in traces.lines if line.get_label() == "_height")
    assert np.ptp(bar.get_ydata()) == pytest.approx(5.0 / 8.0) and traces.texts[-1].get_text() == "5"
    np.testing.assert_allclose(misfit.lines[-1].get_ydata(), [4.0, 3.0])  # twice the misfit over the number of data
    first, pair, second = draw_tradeoffs(made).axes
    np.testing.assert_allclose(pair.lines[0].get_data(), [10 * samples[D_c.key] * 100, samples[other.key] * 1e3])
    for ax, value in ((first, 30.0), (second, 60.0)):
        np.testing.assert_allclose(ax.lines[0].get_xdata(), value)
        interval = ax.patches[-1].get_extents().transformed(ax.transData.inverted())
        assert [interval.x0, interval.x1] == pytest.approx([20.0, 50.0])
    labels = [(ax.get_xlabel(), ax.get_ylabel()) for ax in (first, pair, second)]
    assert labels == [("", ""), ("D_c (mm)", "D (mm)"), ("D (mm)", "")]


@pytest.mark.parametrize("ends, at_bound, note", [
    ((2.0, 4.0), False, ""), ((2.0, 4.0), True, "at bound"), ((1.5, 5.5), False, "not determined"),
])  # fmt: skip
def test_an_interval_as_wide_as_the_bounds_determines_nothing(ends: Any, at_bound: bool, note: str) -> None:
    """Bounds of 2 and 6."""
    value, interval = np.array([3.0]), np.array(ends)[:, None]
    made = Recovered("key", "m", "number", value, value, value, interval, at_bound, interval)
    assert _note(made, [2.0, 6.0]) == note and _note(made, None) == ("at bound" if at_bound else "")


def test_the_best_case_of_a_number_on_a_surface() -> None:
    """A stress that varies over the surface, to which a number is added, or by which it is multiplied."""
    final = [{"kind": "final_slip", "sigma": 1e-6}]
    for scale, sigma in (("linear", 1e4), ("log", 0.01)):
        number = {"key": SHEAR, "shape": "number", "scale": scale, "sigma": sigma}
        case = parse_case(strike_slip({"duration": 1e-6, "objective": final, "unknowns": [number]}))
        made = Evaluator(case, fem.MPI.COMM_SELF, 1e9)
        changed = made.evaluate(z := np.array([1.5]), "none")
        best = parse_case(made.case_with(z).table())
        assert Objective(best, best.objective, record=False).value == pytest.approx(changed.misfit, rel=1e-12)
        assert changed.misfit != pytest.approx(made.evaluate(np.zeros(1), "none").misfit, rel=1e-4)


def test_data_that_the_case_fits_exactly_end_the_search(tmp_path: Path) -> None:
    """The gradient is zero there, and the unknown is felt."""
    number = {"key": "faults.main.friction.D_c", "shape": "number", "scale": "log", "bounds": [1e-7, 1e-4]}
    receiver = {"kind": "fault_receiver", "name": "fault", "interval": 1e-7, "position": 16e-3}
    table = slip_weakening({"duration": 2e-6, "instruments": [receiver], "objective": [TRACE], "unknowns": [number]})
    case = parse_case(table)
    ((_, sample),) = Objective(case, case.objective, record=False).samples
    case = parse_case(merged(table, {"objective": [{**TRACE, "data": {"slip": sample.values.tolist()}}]}))
    made = infer(case, tmp_path / "out", progress=False)
    assert made.best.misfit == 0 and made.unknowns[0].best[0] == pytest.approx(5e-6, rel=1e-12)


def test_a_run_that_fails_names_the_values_that_the_search_has_reached() -> None:
    number = {"key": "faults.main.friction.mu_d", "shape": "number"}
    case = parse_case(slip_weakening({"objective": [{"kind": "final_slip", "sigma": 1e-6}], "unknowns": [number]}))
    made = Evaluator(case, fem.MPI.COMM_SELF, 1e9)
    with pytest.raises(RuptfxError, match=facts(r"reached faults\.main\.friction\.mu_d = -2\.9: give bounds")):
        made.evaluate(np.array([(-2.9 - 0.3) / (0.1 * 0.3)]), "none")  # z = 1 is a tenth of the value of the case


def test_a_field_of_a_key_that_takes_one_number_is_refused() -> None:
    nucleation = [{"kind": "friction_drop", "mu_d": 0.1, "center": 16e-3, "half_width": 3e-3}]
    unknown = {"key": "faults.main.nucleation.0.mu_d", "sigma": 0.1, "correlation_length": 1e-3}
    final = [{"kind": "final_slip", "sigma": 1e-6}]
    case = parse_case(slip_weakening({"objective": final, "unknowns": [unknown], "faults.main.nucleation": nucleation}))
    with pytest.raises(CaseError, match=facts(r"unknowns\.0\.shape = 'field': .*use shape = 'number'")):
        Evaluator(case, fem.MPI.COMM_SELF, 1e9)


def test_the_command_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    number = {"key": "faults.main.friction.D_c", "shape": "number", "scale": "log", "bounds": [1e-7, 1e-4]}
    objective = [{"kind": "final_slip", "sigma": 1e-6, "target": 1e-5}]
    path.write_text(tomli_w.dumps(slip_weakening({"objective": objective, "unknowns": [number]})))
    out = tmp_path / "out"
    runs = []
    for iterations in (1, 2):
        setting = ["--set", f"inference.iterations={iterations}"]
        done = CliRunner().invoke(app, ["infer", str(path), "--out", str(out), "--quiet", *setting])
        assert done.exit_code == 0, done.output
        runs.append(len(list((out / "evaluations").glob("*.npz"))))
    assert 1 < runs[0] < runs[1]
    best = read_case(out / "best.toml")
    assert isinstance(best, Case) and best.faults["main"].friction.D_c != 5e-6
    assert fem.MPI.COMM_WORLD.size == 1


def test_samples_have_their_covariance() -> None:
    samples = np.random.default_rng(1).normal(size=(500, 2)) @ np.array([[2.0, 0.3], [0.0, 0.5]])
    made = posterior.of_samples(samples)
    np.testing.assert_allclose(made.spread @ made.spread.T, np.cov(samples.T, bias=True), rtol=1e-10)


@pytest.mark.parametrize("misfit, beyond", [(100.0, False), (139.0, False), (141.0, True)])
def test_a_misfit_exceeds_noise_from_four_standard_deviations_on(misfit: float, beyond: bool) -> None:
    """2 misfit / data has the mean 1 and the standard deviation sqrt(2 / data), 0.1 with 200 data: 1.4 is the limit."""
    run = SimpleNamespace(misfit=misfit)
    assert Result(None, [], [run], [0], 200, "", [], {}).exceeds_noise is beyond  # type: ignore[arg-type]


def test_doubts_name_the_opposite_sign_and_the_time() -> None:
    """Of five traces with noise of 1 %: as they are, turned, 4 us late, 4 us early, and another signal."""
    times = np.linspace(0, 60e-6, 301)
    noise = 0.01 * np.random.default_rng(3).normal(size=(5, len(times)))

    def pulse(t: np.ndarray) -> np.ndarray:
        return np.exp(-(((t - 25e-6) / 5e-6) ** 2)) - 0.6 * np.exp(-(((t - 38e-6) / 3e-6) ** 2))

    best = pulse(times)
    signals = [best, -best, pulse(times - 4e-6), pulse(times + 4e-6), np.cos(4e5 * times)]
    fits = [
        Fit(name, times, signal + each, best, best) for name, signal, each in zip("abcde", signals, noise, strict=True)
    ]
    doubts = list(Result(None, [], [], [], 0, "", fits, {}).doubts())  # type: ignore[arg-type]
    assert [doubt.split()[0] for doubt in doubts] == ["b", "c", "d"]
    assert "sign" in doubts[0] and "late" in doubts[1] and "early" in doubts[2]
    shifts = [float(doubt.split("as if ")[1].split()[0]) for doubt in doubts[1:]]
    np.testing.assert_allclose(shifts, 4e-6, rtol=0.03)


@pytest.mark.parametrize("scale, ends", [("linear", [8.0, 12.0]), ("log", [10 * np.exp(-2), 10 * np.exp(2)])])
def test_the_band_of_the_prior_is_a_standard_deviation_to_both_sides(scale: str, ends: list[float]) -> None:
    each = SimpleNamespace(
        unknown=SimpleNamespace(key="k", sigma=2.0, scale=scale, shape="number"),
        place=SimpleNamespace(unit="Pa", of_points=True),
        position=np.zeros(1), start=np.array([10.0]), values=lambda part: np.array([11.0]), at_bound=lambda part: False,
    )  # fmt: skip
    search: Any = SimpleNamespace(_posterior=None, evaluator=SimpleNamespace(split=lambda z: [(each, z)]))
    (recovered,) = inversion.Inversion._recovered(search, np.zeros(1))
    assert recovered.band[:, 0] == pytest.approx(ends)


@pytest.mark.parametrize("value, at", [(0.005, True), (0.02, False), (5.0, False), (9.98, False), (9.995, True)])
def test_an_unknown_is_at_its_bound_within_a_thousandth(value: float, at: bool) -> None:
    each: Any = SimpleNamespace(
        unknown=SimpleNamespace(bounds=[0.0, 10.0]), _low=0.0, _high=10.0, _t=lambda values: values,
        values=lambda z: np.array([value]),
    )  # fmt: skip
    assert Variable.at_bound(each, np.zeros(1)) is at
