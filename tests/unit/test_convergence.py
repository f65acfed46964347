"""Error bars from several spacings: manufactured sequences by hand, signals, and a small run."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from helpers.drawn import shows
from helpers.messages import facts
from helpers.small_cases import INSTRUMENTS, merged, plates
from rich.console import Console

from ruptfx import RuptfxError
from ruptfx.app.commands.converge import table_of
from ruptfx.many_runs.convergence import converge, estimate, figure
from ruptfx.many_runs.convergence.estimates import OSCILLATE, Row, unresolved
from ruptfx.many_runs.convergence.readings import of_signal
from ruptfx.many_runs.study.harvest import harvest
from ruptfx.results.analysis.verdict import rows, verdict, with_bar
from ruptfx.results.record import Record


@pytest.mark.parametrize(
    ("order", "spacings"), [(1.0, (1, 2, 4)), (2.0, (1, 2, 4)), (1.5, (1, 1.4, 2.1)), (0.7, (2, 4, 8))]
)
def test_a_manufactured_sequence(order: float, spacings: tuple[float, ...]) -> None:
    """f = 3 + 0.2 h^p: the order and the limit are exact; the bar at order 1 is twice the error."""
    result = estimate([3 + 0.2 * h**order for h in spacings], spacings)
    assert result.order == pytest.approx(order, rel=1e-9) and result.outside == ""
    assert result.extrapolated == pytest.approx(3.0, abs=1e-9)
    assert result.bar >= 2 * 0.2 * spacings[0] ** order * (1 - 1e-9)
    if order <= 1:
        assert result.bar == pytest.approx(2 * 0.2 * spacings[0] ** order, rel=1e-9)


def test_the_example_of_celik() -> None:
    """Celik et al. (2008), table 1: f = 6.063, 5.972, 5.863 at r_21 = 1.5, r_32 = 1.333: p 1.53, limit 6.1685."""
    result = estimate([6.063, 5.972, 5.863], [1.0, 1.5, 2.0])
    assert result.order == pytest.approx(1.53, abs=0.01)
    assert result.extrapolated == pytest.approx(6.1685, abs=5e-4)


@pytest.mark.parametrize(("values", "bar"), [
    ((1.0, 1.1, 0.9), 0.4),  # oscillates: twice the largest difference
    ((1.0, 1.2, 1.3), 0.6),  # the differences grow
    ((1.0, 1.1, 1.21), 0.42),  # order 0.14
    ((1.0, 1.0, 1.4), 0.4),  # two agree: twice half of the coarse difference, as at order 1
    ((1.0, 1.01, 1.41), 0.4),  # order 5.3
])  # fmt: skip
def test_values_that_are_not_in_the_asymptotic_range(values: tuple[float, ...], bar: float) -> None:
    result = estimate(values, (1, 2, 4))
    assert result.outside and result.bar == pytest.approx(bar, rel=1e-12)
    assert result.extrapolated == result.value


def test_a_case_is_not_resolved_where_most_numbers_approach_no_limit() -> None:
    """Of the numbers that change: 2 of 4 may oscillate or move apart, 3 of 5 may not, unless their bars are small."""
    several = {"a": (1.0, 1.1, 1.3), "b": (2.0, 2.2, 2.1), "c": (1.0, 1.2, 1.3), "d": (1.0, 1.0, 1.4),
               "same": (3.0, 3.0, 3.0), "e": (5.0, 4.0, 5.0)}  # fmt: skip
    made = {name: estimate(values, (1, 2, 4)) for name, values in several.items()}
    rows = [Row(name, "1", each.value, each.bar, {"mesh": each}) for name, each in made.items()]
    assert [row.name for row in rows if not row.by["mesh"].approaches] == ["b", "c", "e"]
    assert unresolved(rows[:-1]) == "" and unresolved([]) == ""
    assert re.match(facts("3 of 5.*mesh.element_size"), unresolved(rows))
    # Bars over values of 0.2, 0.2, 0.4, 0.4 and 0.6, and an eighth of the median 0.4.
    assert unresolved([dataclasses.replace(row, value=8 * row.value) for row in rows]) == ""


def test_the_table_refers_to_reasons_below_it() -> None:
    """Numbers that oscillate, one of too high an order and one in the asymptotic range, within 80 columns."""
    series = {"energy_frictional_dissipation": (1.0, 1.1, 0.9), "reach": (1.0, 1.001, 1.1), "share": (1.0, 1.1, 1.3),
              "zones": (2.0, 2.1, 1.9)}  # fmt: skip
    made = [estimate(values, (1.0, 2.0, 4.0)) for values in series.values()]
    table, remarks = table_of([Row(name, "J/m", each.value, each.bar, {"mesh": each})
                               for name, each in zip(series, made, strict=True)])  # fmt: skip
    assert list(table.columns[-1].cells) == ["(1)", "(2)", "", "(1)"]
    assert remarks == [f"(1) not in the asymptotic range: {OSCILLATE}",
                       "(2) not in the asymptotic range: observed order below 0.5 or above 4"]  # fmt: skip
    text = io.StringIO()
    Console(file=text, width=80).print(table)
    assert len(text.getvalue().splitlines()) == 1 + len(series)


def test_equal_values_and_two_levels() -> None:
    assert estimate([2.5, 2.5, 2.5], (1, 2, 4)).bar == 0 == estimate([0.0, 0.0], (1, 2)).bar
    two = estimate([1.0, 1.1], (1, 2))
    assert (two.bar, two.extrapolated) == (pytest.approx(0.3), pytest.approx(0.9)) and two.outside


def test_numbers_of_a_signal() -> None:
    """A parabola with its peak of 4 between samples, from t = 0; a fifth of it, 0.8, is passed at 0.2111."""
    time = np.linspace(0, 4, 41)
    signal = 7.0 - (4 - (time - 2.03) ** 2) + (4 - 2.03**2)
    found = dict(of_signal(time, signal))
    assert found["peak"] == pytest.approx(2.03**2, rel=1e-12)
    exact = 2.03 - np.sqrt(0.8 * 2.03**2)
    assert found["arrival"] == pytest.approx(exact, abs=0.003)
    assert found["rms"] == pytest.approx(np.sqrt(np.mean((signal - signal[0]) ** 2)), rel=1e-12)
    assert dict(of_signal(time, 0 * time)) == {}


@pytest.mark.parametrize(("value", "bar", "shown"), [
    (3.5912, 0.041, "3.59 ± 0.04"), (3.5912, 0.024, "3.591 ± 0.024"), (1234.5, 30.0, "1.23e+03 ± 3.0e+01"),
    (2e-6, 4e-9, "2.000e-06 ± 4.0e-09"),
])  # fmt: skip
def test_digits_of_a_value_are_those_of_its_bar(value: float, bar: float, shown: str) -> None:
    assert with_bar(value, bar) == shown


def test_the_figure_shows_the_distances_from_the_limit() -> None:
    values = [2 + 0.1 * h for h in (1, 2, 4)]
    result = estimate(values, (1, 2, 4))
    shape = figure.draw([Row("max_slip", "m", values[0], result.bar, {"mesh": result})], {"mesh": [1, 2, 4]})
    errors, bars = shape.axes
    np.testing.assert_allclose(errors.lines[0].get_data(), [[1, 2, 4], np.array([0.05, 0.1, 0.2])], rtol=1e-9)
    shows(bars, ([result.bar / values[0]], [0]))
    assert [label.get_text() for label in bars.get_yticklabels()] == ["max slip"]


@pytest.mark.slow
@pytest.mark.fem
def test_a_small_case(tmp_path: Path) -> None:
    """Bars are in the summary of the run of the case only; a second call computes nothing."""
    pytest.importorskip("dolfinx")
    pytest.importorskip("distributed")
    pushed = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 10.0, "ramp": 1e-6}
    receiver = INSTRUMENTS[0] | {"interval": 4e-7}
    grid = {"kind": "receiver_grid", "name": "grid", "interval": 1e-6, "corner": [1e-3, 1e-3],
            "opposite": [9e-3, 3e-3], "spacing": 1e-3}  # fmt: skip
    weak = {"kind": "linear_slip_weakening", "mu_s": 0.3, "mu_d": 0.1, "D_c": 1e-5}
    changes = {"duration": 5e-6, "mesh.element_size": 1e-3, "instruments": [receiver, grid], "boundaries": [pushed],
               "faults.main.friction": weak}  # fmt: skip
    path = tmp_path / "case.toml"
    path.write_text(tomli_w.dumps(merged(plates(), changes)))
    made = converge(path, tmp_path / "out", cores=1, show=False)
    names = {row.name: row for row in made.rows}
    assert {"max_slip", "energy_kinetic"} <= names.keys() and any(" peak" in name for name in names)
    assert not any(name.startswith("grid.") for name in names)  # places of more receivers than times are no signals
    assert made.notes == [] and made.spacings == {"mesh": [1.0, 2.0, 4.0]}
    assert made.warning == unresolved(made.rows)
    table = json.loads((tmp_path / "out" / "converge.json").read_text())
    assert [each["name"] for each in table["numbers"]] == list(names)
    with Record(made.run) as record:
        summary = record.summary
    assert summary["error_bars"]["max_slip"]["bar"] == names["max_slip"].bar
    assert names["max_slip"].value == summary["max_slip"]
    shown = dict(rows(summary))
    assert "±" in shown["max_slip"] and verdict(summary)
    others = [each for each in (tmp_path / "out" / "points").glob("*/run/summary.json") if each.parent != made.run]
    assert len(others) == 2 and all("error_bars" not in json.loads(each.read_text()) for each in others)
    before = sorted((tmp_path / "out" / "points.log").read_text().splitlines())
    again = converge(path, tmp_path / "out", cores=1, show=False)
    assert sorted((tmp_path / "out" / "points.log").read_text().splitlines()) == before
    assert [row.bar for row in again.rows] == [row.bar for row in made.rows]


@pytest.mark.fem
def test_bars_of_mesh_and_step_are_added(tmp_path: Path) -> None:
    """Two levels of each: a bar is three times the change, from the numbers of the three runs."""
    pytest.importorskip("dolfinx")
    pytest.importorskip("distributed")
    pushed = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 10.0, "ramp": 1e-6}
    path = tmp_path / "case.toml"
    path.write_text(tomli_w.dumps(plates({"boundaries": [pushed], "stepper.time_step": 2e-8, "duration": 2e-6})))
    made = converge(path, tmp_path / "out", of=["mesh", "step"], levels=2, cores=1, show=False)
    assert made.spacings == {"mesh": [1.0, 2.0], "step": [1.0, 2.0]} and made.notes == []
    runs = {}
    for each in (tmp_path / "out" / "points").glob("*/run/summary.json"):
        case = tomllib.loads((each.parent / "case.toml").read_text())
        runs[case["mesh"]["element_size"], case["stepper"]["time_step"]] = harvest(each.parent, ["run"])[
            "energy_kinetic"
        ]
    value, coarse, long = (runs[at] for at in ((2e-3, 2e-8), (4e-3, 2e-8), (2e-3, 4e-8)))
    (row,) = (each for each in made.rows if each.name == "energy_kinetic")
    assert row.by["mesh"].bar == pytest.approx(3 * abs(coarse - value), rel=1e-9) and row.value == value
    assert row.by["step"].bar == pytest.approx(3 * abs(long - value), rel=1e-9)
    assert row.bar == pytest.approx(row.by["mesh"].bar + row.by["step"].bar, rel=1e-12)


def test_verdicts_of_faults_in_3d_and_of_fracture_have_bars() -> None:
    bars = {"moment_magnitude": 0.041, "rupture_speed": 120.0, "supershear_share": 0.06, "first_peak_stress": 2.5e5}
    summary = {
        "rupture_area": 1.0, "moment_magnitude": 6.512, "rupture_speed": 2710.0, "supershear_share": 0.3, "events": 0,
        "first_peak_stress": 12.3e6, "error_bars": {name: {"bar": bar} for name, bar in bars.items()},
    }  # fmt: skip
    text = verdict(summary)
    for each in ("6.51 ± 0.04", "2.71 km/s ± 120 m/s", "30 ± 6 %", "12.3 MPa ± 250 kPa"):
        assert each in text
    assert "±" not in verdict({**summary, "error_bars": {}})


@pytest.mark.parametrize(("of", "levels", "message"), [
    (["mesh"], 1, "--levels 1"), (["space"], 3, "--of space.* mesh,step"), (["step"], 3, "stepper.time_step"),
])  # fmt: skip
def test_what_cannot_be_made_coarser_is_refused(tmp_path: Path, of: list[str], levels: int, message: str) -> None:
    path = tmp_path / "case.toml"
    path.write_text(tomli_w.dumps(plates()))
    with pytest.raises(RuptfxError, match=facts(message)):
        converge(path, tmp_path / "out", of=of, levels=levels)


def test_a_lumped_model_has_no_mesh(tmp_path: Path) -> None:
    with pytest.raises(RuptfxError, match=facts("spring_slider")):
        converge(Path(__file__).parents[2] / "demos" / "spring_slider.toml", tmp_path)
