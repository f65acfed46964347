"""Spring slider: equations, protocols, parameter fit, and the run directory all lumped models share."""

from __future__ import annotations

import itertools
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts, facts_of, says
from typer.testing import CliRunner

from ruptfx import RuptfxError
from ruptfx.app.cli import app
from ruptfx.case import parse_case, read_case
from ruptfx.input.schema import CaseError, find
from ruptfx.laws.friction.rate_and_state_ageing import RateAndStateAgeing
from ruptfx.lumped import extreme, read_result, redraw, rehearse, simulate
from ruptfx.lumped.spring_slider import _EXPERIMENTS, PMMA, SpringSlider
from ruptfx.lumped.spring_slider.fit import Fit, modelled, read_trace
from ruptfx.lumped.spring_slider.protocols import Temperatures, VelocitySteps
from ruptfx.lumped.spring_slider.slider import Slider, critical_stiffness, integrate
from ruptfx.lumped.spring_slider.stability import StabilityDiagram, _cycles
from ruptfx.results.record import Record

SLIDER = str(Path(__file__).parents[2] / "demos" / "spring_slider.toml")
W = 16.0
VARIANTS = [(0.0, 0.0), (0.0, 0.4e-6), (1.6, 0.0), (1.6, 0.4e-6)]
LAWS = ("rate_and_state_ageing", "rate_and_state_slip", "rate_and_state_saturating")


def law_of(kind: str) -> object:
    extra = {"theta_c": 1e-3} if kind.endswith("saturating") else {}
    return find("ruptfx.laws.friction", kind)(a=0.013, b=0.026, D_c=0.42e-6, f_0=0.36, V_0=1e-6, **extra)


@pytest.mark.parametrize("kind", LAWS)
@pytest.mark.parametrize("mass, interface_length", VARIANTS)
def test_steady_sliding_is_an_equilibrium(kind: str, mass: float, interface_length: float) -> None:
    slider = Slider(law_of(kind), W, 1e6, mass, interface_length)  # type: ignore[arg-type]
    y = slider.steady(3e-6)
    rates = slider.rates(y, 3e-6, W) / slider.scales(3e-6) * (slider.law.D_c / 3e-6)
    # The acceleration is a difference of forces of 6 N divided by a small mass: rounding is seen through it.
    assert np.abs(rates).max() < 1e-7
    assert slider.force(y, W) == pytest.approx(float(slider.law.steady_strength(3e-6, W)))


def test_a_run_knows_where_it_would_be_unstable() -> None:
    """Rigid interface without mass: K_c = W (b - a) / D_c and omega = (V / D_c) sqrt((b - a) / a) (Ruina 1983)."""
    law, experiment = law_of(LAWS[0]), {"kind": "velocity_steps", "distance": 1e-6, "samples": 20}
    found = SpringSlider(friction=law, normal_force=W, stiffness=1e6, experiment=experiment).run().attrs
    assert found["K_c"] == pytest.approx(W * 0.013 / 0.42e-6, rel=1e-6)
    assert found["K_over_K_c"] == pytest.approx(1e6 * 0.42e-6 / (W * 0.013), rel=1e-6)
    assert found["onset_frequency"] == pytest.approx(1e-6 / 0.42e-6 / (2 * np.pi), rel=1e-4)  # V_0, b = 2 a


@pytest.mark.parametrize("kind", LAWS)
def test_slip_rate_inverts_strength(kind: str) -> None:
    law = law_of(kind)
    for speed in (1e-12, 1e-6, 1.0):
        state = {"theta": np.float64(3.0)}
        force = law.strength(speed, W, state)  # type: ignore[attr-defined]
        assert law.slip_rate(force, W, state) == pytest.approx(speed, rel=1e-9)  # type: ignore[attr-defined]


@pytest.mark.parametrize("kind", LAWS)
def test_age_rate_is_the_derivative_of_advance(kind: str) -> None:
    law = law_of(kind)
    for speed in (1e-9, 1e-6, 1e-3):
        theta, dt = 0.7, 1e-7 * 0.42e-6 / speed
        moved = law.advance({"theta": theta}, speed, W, dt)["theta"]  # type: ignore[attr-defined]
        assert (moved - theta) / dt == pytest.approx(law.age_rate(theta, speed), rel=1e-3)  # type: ignore[attr-defined]


def test_velocity_step_ends_at_the_steady_friction() -> None:
    data = VelocitySteps(speeds=[1e-6, 1e-5], distance=20e-6).run(Slider(PMMA, W, 1e7), lambda *_: None)
    # mu changes by (a - b) per e-fold in steady sliding, and by nearly a at once on a stiff spring.
    assert data.step_steady.values == pytest.approx([-0.013], rel=1e-4)
    assert 0.8 * 0.013 < data.step_direct.values[0] < 0.013


def test_a_slider_without_inertia_that_runs_away_says_so() -> None:
    slider = Slider(PMMA, W, 0.5 * W * 0.013 / 0.42e-6)
    start = slider.steady(1e-6)
    start[1] += 0.1
    with pytest.raises(RuptfxError, match=facts(r" m/s at t = \d")):
        integrate(slider, start, np.linspace(0, 100, 50), 1e-6)


def test_elastic_interface_is_a_spring_in_series() -> None:
    # k / (1 + k lambda) = k_c0 at onset, k = K / W: k_c = k_c0 / (1 - k_c0 lambda).
    rigid = 0.013 / 0.42e-6
    found, _ = critical_stiffness(Slider(PMMA, W, 1.0, 0.0, 0.4e-6), 1e-6)
    assert found / W == pytest.approx(rigid / (1 - rigid * 0.4e-6), rel=1e-6)


def test_strengthening_friction_is_always_stable() -> None:
    strengthening = PMMA.model_copy(update={"b": 0.005})
    assert critical_stiffness(Slider(strengthening, W, 1.0), 1e-6)[0] == 0


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic record: a jump up and a jump down, noise of 0.001."""
    path = tmp_path_factory.mktemp("trace") / "trace.csv"
    time = np.linspace(0, 10, 400)
    drive = np.where(time < 4, 1e-6, np.where(time < 4.5, 1e-5, 1e-6))
    friction = modelled(Slider(PMMA, W, 2e6), np.array([*np.log([0.013, 0.026, 0.42e-6]), 0.36]), time, drive)
    friction += 1e-3 * np.random.default_rng(0).standard_normal(len(time))
    lines = [f"{t:.9g},{v:.9g},{m:.9g}" for t, v, m in zip(time, drive, friction, strict=True)]
    path.write_text("time,drive_speed,friction\n" + "\n".join(lines))
    return path


def test_fit_finds_the_parameters_of_a_noisy_trace(trace: Path) -> None:
    guess = PMMA.model_copy(update={"a": 0.01, "b": 0.02, "D_c": 0.7e-6, "f_0": 0.4})
    found = Fit(trace=str(trace), confidence=0.99).run(Slider(guess, W, 2e6), lambda *_: None)
    for name, truth in (("a", 0.013), ("b", 0.026), ("D_c", 0.42e-6)):
        assert float(found[f"{name}_low"]) < truth < float(found[f"{name}_high"])
        assert float(found[name]) == pytest.approx(truth, rel=0.1)
    assert float(found.misfit) == pytest.approx(1e-3, rel=0.15)


def test_the_summary_of_a_fit_has_the_fitted_parameters(trace: Path, tmp_path: Path) -> None:
    """The trace has a = 0.013, b = 0.026, D_c = 0.42 um: K_c = W (b - a) / D_c = 495 kN/m, K / K_c = 4.04."""
    start = PMMA.model_copy(update={"a": 0.01, "b": 0.02, "D_c": 0.7e-6})
    model = SpringSlider(friction=start, normal_force=W, stiffness=2e6, experiment=Fit(trace=str(trace)))
    simulate(model, tmp_path / "run")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    for name, truth in (("a", 0.013), ("b", 0.026), ("D_c", 0.42e-6), ("f_0", 0.36)):
        assert summary[f"{name}_low"] < summary[name] < summary[f"{name}_high"]
        assert summary[name] == pytest.approx(truth, rel=0.1)
    critical = W * (summary["b"] - summary["a"]) / summary["D_c"]
    assert summary["K_c"] == pytest.approx(critical, rel=1e-6)
    assert summary["K_over_K_c"] == pytest.approx(2e6 / critical, rel=1e-6)


SHORT = {
    "velocity_steps": {"samples": 20}, "slide_hold_slide": {"holds": [1.0, 10.0], "samples": 100},
    "modulated_speed": {"periods": [3.0], "cycles": 2, "samples": 100},
    "modulated_load": {"amplitudes": [0.0], "samples": 20, "critical": False},
    "stability": {"speeds": 2, "stiffnesses": 2}, "bifurcation": {"ratios": [0.9], "periods": 10, "samples": 500},
    "stick_slip": {"speeds": [1e-5], "cycles": 2, "samples": 500}, "loading_unloading": {"samples": 50},
    "frequency_response": {"samples": 1000},
    "temperatures": {"temperatures": [293.0, 313.0], "holds": [1.0, 10.0], "samples": 100},
}  # fmt: skip
WITH_MASS = ("bifurcation", "stick_slip", "frequency_response")


@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize("experiment", _EXPERIMENTS, ids=lambda cls: cls.name)
def test_results_of_an_experiment_have_names_of_their_own(experiment: Any, trace: Path, tmp_path: Path) -> None:
    """`simulate` refuses a result and a constant of one name; K_c = W (b - a) / D_c of a rigid, slow slider."""
    keys = {"trace": str(trace)} if experiment is Fit else SHORT[experiment.name]
    mass = 1.6 if experiment.name in WITH_MASS else 0.0
    elastic = 0.4e-6 if experiment.name in ("loading_unloading", "frequency_response") else 0.0
    stiffness = 1e5 if experiment.name == "stick_slip" else 2e6
    law = (
        PMMA
        if experiment is not Temperatures
        else find("ruptfx.laws.friction", THERMAL["kind"])(
            **{key: value for key, value in THERMAL.items() if key != "kind"}
        )
    )
    model = SpringSlider(
        friction=law, normal_force=W, stiffness=stiffness, mass=mass, interface_length=elastic,
        experiment=experiment(**keys),
    )  # fmt: skip
    data = simulate(model, tmp_path / "run")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    compliance = (summary["D_c"] if experiment is Fit else 0.42e-6) / W / (summary["b"] - summary["a"])
    assert summary["K_c"] == pytest.approx(1 / (compliance - elastic / W), rel=1e-3)
    assert {*data.attrs}.isdisjoint(data.variables)


@pytest.mark.parametrize(
    "text, message",
    [
        ("t,v,mu\n1,2,3\n", "column time, drive_speed, friction is missing"),
        ("# a\ntime,drive_speed,friction\n0,1e-6,0.3\n\n1,1e-6,x\n", r"line 5 of .*t\.csv: 'x' is not a finite number"),
        ("time,drive_speed,friction\n1,1e-6,0.3\n0,1e-6,0.3\n", r"line 3 of .*t\.csv: 0 after 1"),
        ("time,drive_speed,friction\n0,1e-6,0.3\n", "at least 20 rows"),
    ],
)
def test_bad_traces_say_what_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(RuptfxError, match=facts(message)):
        read_trace(tmp_path / "t.csv")


@pytest.mark.parametrize(
    "change, message",
    [
        ({"friction": {"kind": "coulomb", "mu_d": 0.5}}, "use rate_and_state_ageing"),
        ({"experiment": {"kind": "velocity_step"}}, "an experiment needs a 'kind'"),
        ({"experiment": {"kind": "velocity_steps", "sped": 1.0}}, "experiment.*unknown key 'sped'"),
        ({"experiment": {"kind": "fit", "trace": "none.csv"}}, "no such file"),
        ({"stiffness": -1.0}, "stiffness = -1.0"),
    ],
)
def test_bad_cases_name_the_key(change: dict[str, object], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        parse_case({"kind": "spring_slider", **change})


def test_a_run_leaves_a_complete_directory(tmp_path: Path) -> None:
    model = SpringSlider(experiment=VelocitySteps(distance=5e-6, samples=100))
    data = simulate(model, tmp_path / "run")
    names = sorted(str(p.relative_to(tmp_path / "run")) for p in (tmp_path / "run").rglob("*") if p.is_file())
    assert names == ["case.toml", "figures/velocity_steps.png", "files.json", "result.nc", "summary.json"]
    assert read_result(tmp_path / "run").equals(data)
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["case_hash"] == model.hash
    assert [p.name for p in redraw(tmp_path / "run", ("svg",))] == ["velocity_steps.svg"]
    with pytest.raises(RuptfxError, match="run:"):
        simulate(model, tmp_path / "run")
    with pytest.raises(RuptfxError, match=r"result\.nc"):
        redraw(tmp_path)


def test_check_prints_the_critical_stiffness_and_a_record_names_the_result(tmp_path: Path) -> None:
    """K_c of the demo: (b - a) W / D_c in series with the interface W / lambda; K is twice that."""
    shown = CliRunner().invoke(app, ["check", SLIDER, "--set", "experiment.distance=2e-6"]).output
    printed = dict(re.findall(r"^(\w+) = (\S+)", shown, re.MULTILINE))
    contact = (0.026 - 0.013) * 16 / 0.42e-6  # of the block at its contact [N/m]
    series = contact * (16 / 0.4e-6) / (16 / 0.4e-6 - contact)
    assert float(printed["K_c"]) == pytest.approx(series, rel=1e-3) and "N/m" in shown
    assert float(printed["K_over_K_c"]) == pytest.approx(1e6 / series, rel=1e-3)
    model = read_case(SLIDER, ["experiment.distance=2e-6"])
    shown = CliRunner().invoke(app, ["run", SLIDER, "--out", str(tmp_path / "run"), "--quiet",
                                     "--set", "experiment.distance=2e-6"])  # fmt: skip
    assert shown.exit_code == 0 and model.constants()["K_c"] == pytest.approx(float(printed["K_c"]), rel=1e-5)
    with Record(tmp_path / "run") as record:
        assert "read_result" in repr(record) and "missing" not in repr(record)
    assert read_result(tmp_path / "run").attrs["K_c"] == model.constants()["K_c"]


def test_a_run_prints_its_numbers_with_units(tmp_path: Path) -> None:
    experiment = '{ kind = "velocity_steps", distance = 5e-6, samples = 100 }'
    text = f'kind = "spring_slider"\nnormal_force = 16.0\nexperiment = {experiment}'
    (tmp_path / "case.toml").write_text(text)
    command = ["run", str(tmp_path / "case.toml"), "--out", str(tmp_path / "run")]
    done = CliRunner(env={"COLUMNS": "200"}).invoke(app, command)
    rows = [line.split() for line in done.output.splitlines()]
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    for name, unit in (("K_c", "N/m"), ("normal_force", "N"), ("onset_frequency", "Hz")):
        row = next(each for each in rows if each[:1] == [name])
        assert float(row[1]) == pytest.approx(summary[name], rel=1e-5) and row[2] == unit
    assert "case_hash" not in done.output


def test_resume_keeps_what_is_finished_and_begins_the_rest_again(tmp_path: Path) -> None:
    model, out = SpringSlider(experiment=VelocitySteps(distance=5e-6, samples=100)), tmp_path / "run"
    data = simulate(model, out, resume=True)
    when = (out / "result.nc").stat().st_mtime_ns
    assert simulate(model, out, resume=True).equals(data) and (out / "result.nc").stat().st_mtime_ns == when
    (out / "summary.json").unlink()  # stopped before its end
    (out / "result.nc").write_text("half")
    assert simulate(model, out, resume=True).equals(data) and read_result(out).equals(data)
    with pytest.raises(RuptfxError, match=facts(f"holds a run of case {model.hash}, this is case")):
        simulate(model.model_copy(update={"stiffness": 2 * model.stiffness}), out, resume=True)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("mine")
    with pytest.raises(RuptfxError, match="other:"):
        simulate(model, tmp_path / "other", resume=True)
    assert (tmp_path / "other" / "thesis.tex").read_text() == "mine"


@pytest.mark.parametrize(
    "changes, key",
    [
        ({"mass": 5e-324}, "mass = 4.94066e-324"),
        pytest.param({"friction": {"kind": LAWS[0], "a": 0.013, "b": 1e18, "D_c": 4.2e-7, "f_0": 0.36, "V_0": 1e-6}},
                     "friction.b = 1e+18 (usual 0.026)", marks=pytest.mark.slow),
        ({"experiment": {"kind": "velocity_steps", "speeds": [1e-6, 1e7, 1e-6]}}, "experiment.speeds.1 = 1e+07"),
        ({"experiment": {"kind": "velocity_steps", "speeds": [1e-6, 1e300]}}, "experiment.speeds.1 = 1e+300"),
    ],
)  # fmt: skip
def test_numbers_that_cannot_be_computed_are_named(changes: dict[str, Any], key: str, tmp_path: Path) -> None:
    """Integrators and eigenvalues refuse what overflows with a ValueError; the run names the number that is far off."""
    model = parse_case({"kind": "spring_slider", "interface_length": 4e-7, **changes})
    assert isinstance(model, SpringSlider)
    with pytest.raises(RuptfxError, match=facts_of(key)) as caught:
        simulate(model, tmp_path / "run")
    assert not (tmp_path / "run" / "summary.json").exists() and "far from the usual" in str(caught.value)
    with pytest.raises(RuptfxError) as checked:
        rehearse(model, limit=300.0)  # not what a slow machine reaches
    assert str(checked.value) == str(caught.value)
    if "mass" in changes:  # which fails at once
        (tmp_path / "case.toml").write_text(model.to_toml())
        shown = CliRunner().invoke(app, ["check", str(tmp_path / "case.toml")])
        assert shown.exit_code == 1 and "valid" not in shown.output


def test_check_computes_a_model_for_a_limited_time(tmp_path: Path) -> None:
    """Numbers that are far off and can be computed are named; a model that takes long is left."""
    model = SpringSlider(normal_force=2e6, stiffness=2e11, experiment=VelocitySteps(distance=5e-6, samples=100))
    (tmp_path / "case.toml").write_text(model.to_toml())
    shown = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["check", str(tmp_path / "case.toml")])
    assert shown.exit_code == 0 and says("warning: far from the usual: stiffness = 2e+11 (usual 1e+06)", shown.output)
    assert rehearse(model)
    start = time.perf_counter()
    assert not rehearse(SpringSlider(experiment=StabilityDiagram()), limit=0.05)
    assert time.perf_counter() - start < 2


def test_usual_numbers_are_not_called_extreme() -> None:
    assert list(extreme(SpringSlider())) == []
    named = list(extreme(SpringSlider(stiffness=1e20, experiment=VelocitySteps(speeds=[1e-6, 1e3]))))
    assert named == ["stiffness = 1e+20 (usual 1e+06)", "experiment.speeds.1 = 1000 (usual 1e-05)"]


def test_rates_with_a_mass_and_an_elastic_interface() -> None:
    """e' = V_d - v, M v' = K e - F and stretch' = v - V, with the force F = W / lambda times the stretch."""
    law = RateAndStateAgeing(a=0.01, b=0.015, D_c=1e-6, f_0=0.6, V_0=1e-6)
    slider = Slider(law, 100.0, 2e6, 10.0, 4e-7)
    y = slider.steady(1e-6)
    y[2], y[3] = 3e-6, 1.05 * y[3]
    force = 100.0 / 4e-7 * y[3]
    slip_rate = float(law.slip_rate(force, 100.0, {"theta": np.exp(y[1])}))
    assert abs(slip_rate - 3e-6) > 1e-7  # not in equilibrium
    e, _, v, stretch = slider.rates(y, 1e-6, 100.0)
    assert (e, v, stretch) == pytest.approx((1e-6 - 3e-6, (2e6 * y[0] - force) / 10.0, 3e-6 - slip_rate))


def test_the_second_harmonic_of_a_cycle_is_its_share() -> None:
    """16 cycles sin + 0.3 sin 2: the ratio is 0.3, whatever number of cycles is counted."""
    t = np.linspace(0.0, 16.0, 16001)
    wave = np.sin(2 * np.pi * t + 0.1) + 0.3 * np.sin(4 * np.pi * t)
    omega, ratio = _cycles(SimpleNamespace(time=t, friction=0.5 + 1e-3 * wave), 1.0)
    assert (omega, ratio) == (pytest.approx(2 * np.pi, rel=1e-3), pytest.approx(0.3, rel=1e-2))


def test_the_healing_slope_is_per_e_fold_of_the_hold() -> None:
    """Of the last two holds, 10 s and 100 s."""
    table = {"holds": [1.0, 10.0, 100.0], "samples": 100}
    model = parse_case({"kind": "spring_slider", "experiment": {"kind": "slide_hold_slide", **table}})
    assert isinstance(model, SpringSlider)
    data = model.run()
    peaks = data["static_friction"].values
    assert float(data["healing_slope"]) == pytest.approx((peaks[2] - peaks[1]) / np.log(10.0), rel=1e-12)


def test_the_area_of_a_loop_is_that_of_the_integral_over_ln_v() -> None:
    """By the shoelace formula, positive where friction is higher while the drive gets faster."""
    table = {"periods": [3.0], "samples": 100, "cycles": 2}
    model = parse_case({"kind": "spring_slider", "experiment": {"kind": "modulated_speed", **table}})
    assert isinstance(model, SpringSlider)
    data = model.run()
    x, y = np.log(data["drive_speed"].values), data["friction"].values[0]
    area = -0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
    assert float(data["loop_area"][0]) == pytest.approx(area, rel=0.01) and abs(area) > 1e-3
    faster, middle = np.gradient(x) > 0, np.abs(x - x.mean()) < 0.5
    assert (y[middle & faster].mean() > y[middle & ~faster].mean()) == (area > 0)


@pytest.mark.parametrize("kind", LAWS)
def test_the_slope_of_ageing_is_that_of_its_contribution(kind: str) -> None:
    law: Any = law_of(kind)
    theta, step = np.geomspace(1e-6, 1e6, 9), 1e-4
    slope = (law.contact(theta * np.exp(step)) - law.contact(theta * np.exp(-step))) / (2 * step)
    assert law.contact_slope(theta) == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("kind", LAWS)
@pytest.mark.parametrize("forward", [True, False])
def test_rates_with_a_mass_on_a_rigid_interface(kind: str, forward: bool) -> None:
    """Mass times the change of the slip rate is the spring's force less friction, also while the block moves back."""
    law: Any = law_of(kind)
    slider = Slider(law, W, 1e5, 1.6)
    y = slider.steady(3e-6)
    y[0], y[1] = 1.1 * y[0], y[1] - 0.3
    y[2] = (1.01 if forward else -0.9) * y[2]
    rates = slider.rates(y, 1e-6, W)
    step = 1e-5 / np.abs(rates / slider.scales(1e-6)).max()
    change = slider.slip_rate(y + step * rates, W) - slider.slip_rate(y - step * rates, W)
    assert (slider.slip_rate(y, W) > 0) == forward
    assert 1.6 * change / (2 * step) == pytest.approx(1e5 * y[0] - slider.force(y, W), rel=1e-6)


@pytest.mark.parametrize("stiffness", [pytest.param(1e5, marks=pytest.mark.slow), 2e5])
def test_stick_slip_on_a_soft_spring(stiffness: float) -> None:
    """K / K_c = 0.2 and 0.4. In a cycle the drive stretches the spring by what a slip takes away, but for creep."""
    experiment = {"kind": "stick_slip", "speeds": [1e-6, 1e-5], "cycles": 3}
    model = parse_case(
        {"kind": "spring_slider", "normal_force": W, "stiffness": stiffness, "mass": 1.6, "experiment": experiment}
    )
    assert isinstance(model, SpringSlider)
    data = model.run()
    period, drop = data["period"].values.ravel(), data["force_drop"].values.ravel()
    assert data["K_over_critical"].values.ravel() == pytest.approx(stiffness * 0.42e-6 / (W * 0.013), rel=2e-3)
    stretched = stiffness * period * np.array([1e-6, 1e-5])
    assert np.all(drop < stretched) and drop == pytest.approx(stretched, rel=0.04)
    assert data["period_scatter"].values.max() < 2e-3
    slope = np.log(period[1] / period[0]) / np.log(10)
    assert slope < -1 and data["period_exponent"].values == pytest.approx(slope, rel=1e-12)


def test_a_stiff_spring_slides_steadily_and_has_no_period(tmp_path: Path) -> None:
    experiment = {"kind": "stick_slip", "speeds": [1e-5], "cycles": 2, "samples": 200}
    model: Any = parse_case(
        {"kind": "spring_slider", "normal_force": W, "stiffness": 1e6, "mass": 1.6, "experiment": experiment}
    )
    data = simulate(model, tmp_path / "run")
    assert np.isnan(data["period"].values).all() and np.isnan(data["force_drop"].values).all()


def test_loading_below_the_threshold_is_elastic_and_leaves_little() -> None:
    """Displacement lambda F / W; the creep of the law, which grows by e for every a of friction, stays."""
    experiment = {"kind": "loading_unloading", "fractions": [0.3, 0.7, 0.95], "samples": 100}
    slider = {"kind": "spring_slider", "normal_force": W, "stiffness": 3e4, "interface_length": 4e-7}
    model: Any = parse_case({**slider, "experiment": experiment})
    data = model.run()
    slips, static = data["irreversible"].values, float(data["static_friction"])
    assert float(PMMA.steady_strength(1e-5, W)) / W < static < float(PMMA.strength(1e-5, W, {"theta": 100.0})) / W
    low = data.isel(fraction=0)
    assert float(low.friction.max()) == pytest.approx(0.3 * static, rel=1e-3)
    assert low.displacement.values == pytest.approx(4e-7 * low.friction.values, abs=1e-13)
    assert abs(slips[0]) < 1e-14 and 1e-9 < slips[2] < 1e-6
    assert np.log(slips[2] / slips[1]) == pytest.approx(0.25 * static / 0.013, rel=0.1)


def test_resonance_of_the_pinned_slider() -> None:
    """f_0 = sqrt((W / lambda + K) / M) / 2 pi; the width at half power is the loss of the interface alone."""
    experiment = {"kind": "frequency_response", "loss_tangent": 0.04}
    model: Any = parse_case({
        "kind": "spring_slider", "normal_force": W, "mass": 1.63, "stiffness": 2e6, "interface_length": 4e-7,
        "experiment": experiment,
    })  # fmt: skip
    data = model.run()
    interface = W / 4e-7
    assert float(data["resonance"]) == pytest.approx(np.sqrt((interface + 2e6) / 1.63) / (2 * np.pi), rel=1e-3)
    assert float(data["quality"]) == pytest.approx((interface + 2e6) / (0.04 * interface), rel=5e-3)
    static = 1 / np.abs(interface * (1 + 0.04j) + 2e6 - 1.63 * (2 * np.pi * 300) ** 2)
    assert float(data["compliance"][0]) == pytest.approx(static, rel=1e-12)
    with pytest.raises(RuptfxError, match=facts(r"300.*400.*807\.888")):
        model.model_copy(update={"experiment": type(model.experiment)(lowest=300, highest=400)}).run()


THERMAL = {"kind": "rate_and_state_thermal", "a": 0.013, "b": 0.026, "D_c": 0.42e-6, "f_0": 0.36, "V_0": 1e-6,
           "T_0": 293.0, "temperature_initial": 293.0}  # fmt: skip


def test_static_friction_over_temperature_has_one_curve_over_reduced_time() -> None:
    """Eq. 4 of Baumberger et al. (2001): mu_s(t, T) = mu_s(t / a_T), here b ln(1 / a_T) above that at T_0."""
    experiment = {"kind": "temperatures", "temperatures": [293.0, 313.0], "holds": [10.0, 1000.0], "samples": 500}
    law = {**THERMAL, "C_1": 8.0, "C_2": 100.0}
    found = parse_case({"kind": "spring_slider", "stiffness": 1e7, "friction": law, "experiment": experiment}).run()
    shift = 10 ** (-8.0 * 20 / 120)
    assert found["shift_factor"].values == pytest.approx([1.0, shift])
    rise = found.static_friction.values[1] - found.static_friction.values[0]
    assert rise == pytest.approx(0.026 * np.log(1 / shift), rel=1e-4)


def test_slopes_of_static_friction_follow_b_of_the_temperature() -> None:
    experiment = {"kind": "temperatures", "temperatures": [293.0, 351.6], "holds": [1e2, 1e4], "samples": 500}
    law = {**THERMAL, "b_slope": 2.0}  # 1 + 2 * 0.2
    found = parse_case({"kind": "spring_slider", "stiffness": 1e7, "friction": law, "experiment": experiment}).run()
    slopes = found.ageing_slope.values
    assert slopes[1] / slopes[0] == pytest.approx(1.4, rel=1e-2)


def test_other_laws_do_not_depend_on_temperature() -> None:
    model = parse_case({"kind": "spring_slider", "experiment": {"kind": "temperatures"}})
    with pytest.raises(CaseError, match=facts(r"friction\.kind = 'rate_and_state_ageing'.*'rate_and_state_thermal'")):
        model.run()


@pytest.mark.slow
def test_a_solver_that_keeps_short_steps_begins_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """At K/K_c = 0.9 LSODA starts within a slip and keeps steps of 4e-7 s: 3e8 for 106 s; begun again it ends."""
    from ruptfx.lumped.spring_slider import slider as module

    steps, count = module._steps, itertools.count()

    def counted(*arguments: object) -> Iterator[object]:
        for each in steps(*arguments):  # type: ignore[arg-type]
            assert next(count) < 100_000
            yield each

    monkeypatch.setattr(module, "_steps", counted)
    table = {"kind": "spring_slider", "normal_force": 16.0, "stiffness": 1e6, "mass": 1.63, "friction": {
        "kind": "rate_and_state_ageing", "a": 0.013, "b": 0.026, "D_c": 0.42e-6, "f_0": 0.36, "V_0": 1e-6,
    }, "experiment": {"kind": "bifurcation", "ratios": [0.8, 0.9]}}  # fmt: skip
    amplitude = parse_case(table).run().amplitude.values
    assert amplitude == pytest.approx([0.2293, 0.1958], rel=0.01)  # each begun near steady sliding: 0.2293, 0.1958
