"""One unknown for several keys of a case: derivatives by the chain rule, an inference, and what is refused."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from helpers.messages import facts
from helpers.scaled_cases import mapped, unit_factor
from helpers.small_cases import branched, slip_weakening

from ruptfx.case import parse_case, read_case
from ruptfx.input.schema import CaseError, value_at

pytest.importorskip("dolfinx")

from benchmarks import adjoint as bench
from ruptfx import gradient, infer
from ruptfx.app.checks.data import data_rows
from ruptfx.many_runs.adjoint.gradients import Objective
from ruptfx.readings.misfits import Unknown
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

MU_D = "faults.main.friction.mu_d"
DROP_MU_D = "faults.main.nucleation.0.mu_d"
D_C = "faults.main.friction.D_c"
BODY = {"kind": "velocimeter", "name": "body", "interval": 1e-7, "point": [18e-3, 2e-3], "direction": [1.0, 0.0]}
SLIP = [{"kind": "final_slip", "sigma": 1e-6}]


def dropped(**changes: Any) -> dict[str, Any]:
    """A rupture from a patch where friction falls to half of `mu_d` of the law."""
    drop = {"kind": "friction_drop", "mu_d": 0.15, "center": 16e-3, "half_width": 3e-3, "t_w": 3e-6}
    shear = {"kind": "boxcar", "inside": 3.2e6, "outside": 2.8e6, "center": 16e-3, "half_width": 3e-3}
    return slip_weakening({"duration": 12e-6, "objective": SLIP, "faults.main.initial_stress.shear": shear,
                           "faults.main.nucleation": [drop], **changes})  # fmt: skip


def two_faults() -> dict[str, Any]:
    receiver = {"kind": "fault_receiver", "name": "r", "interval": 1e-7, "position": 2e-3}
    return branched({
        "faults.branch.friction.mu_d": 0.24,
        "objective": [{"kind": "final_slip", "sigma": 1e-6, "fault": name} for name in ("main", "branch")],
        "instruments": [{**receiver, "fault": "main"}],
    })  # fmt: skip


def two_gains() -> dict[str, Any]:
    """A rupture with the ageing law and two signals."""
    table = bench.rupture().table()
    (signal,) = (term for term in table["objective"] if term["kind"] == "traces")
    table["objective"] = [{**signal, "gain": 0.8}, {**signal, "gain": 1.2, "times": [0.5, 0.7, 0.9]}]
    return table


@pytest.mark.parametrize("table, key, tied, factors", [
    (dropped(), MU_D, [DROP_MU_D], [0.5]),
    (two_faults(), MU_D, ["faults.branch.friction.mu_d"], [0.8]),
    (two_gains(), "faults.main.friction.a", ["faults.main.friction.b"], [1.5]),
    (two_gains(), "objective.0.gain", ["objective.1.gain"], [1.5]),
    (dropped(**{"faults.main.friction.mu_d": 0.15}), MU_D, [DROP_MU_D], None),
])  # fmt: skip
def test_derivatives_by_tied_keys_equal_central_differences(
    table: dict[str, Any], key: str, tied: list[str], factors: list[float] | None
) -> None:
    """The case itself is changed, every key by its own factor."""
    case = parse_case(table)
    unknown = Unknown(key=key, tied=tied, factors=factors, shape="number")
    exact = gradient(case, unknowns=[unknown], progress=False)[key]
    assert exact.ndim == 0
    values = []
    for sign in (1, -1):
        other = case
        for each, factor in [(key, 1.0), *unknown.ties]:
            other = other.changed(each, float(value_at(case.table(), each)) + sign * 1e-6 * factor)
        values.append(Objective(other, other.objective, record=False).value)
    assert float(exact) == pytest.approx((values[0] - values[1]) / 2e-6, rel=1e-6)
    single = gradient(case, unknowns=[key, *tied], progress=False)
    parts = [factor * float(single[each].sum()) for each, factor in [(key, 1.0), *unknown.ties]]
    assert float(exact) == pytest.approx(sum(parts), rel=1e-12) and all(parts)


def test_differences_of_check_are_those_of_tied_keys() -> None:
    unknown = Unknown(key="faults.main.friction.a", tied=["faults.main.friction.b"], factors=[1.5], shape="number")
    about = gradient(parse_case(two_gains()), unknowns=[unknown], progress=False, check=True)[unknown.key].attrs
    assert about["by_differences"] == pytest.approx(about["uniform_change"], rel=1e-3)
    assert about["difference_step"] == pytest.approx(1e-4 * 0.008)


def measured(method: str) -> dict[str, Any]:
    """A case with a noisy signal of one in which both tied numbers, and another, have other values."""
    times = np.arange(2e-6, 11.5e-6, 2.5e-7).tolist()
    term = {"kind": "traces", "instrument": "body", "times": times, "data": {"velocity": [0.0] * len(times)},
            "units": {"velocity": "m/s"}, "sigma": 0.005}  # fmt: skip
    true = parse_case(dropped(instruments=[BODY], objective=[term]))
    ((_, sample),) = Objective(true, true.objective, record=False).samples
    noise = np.random.default_rng(4).normal(size=len(times))
    data = {"velocity": (sample.values + 0.005 * noise).tolist()}
    unknowns = [
        {"key": MU_D, "tied": [DROP_MU_D], "factors": [0.5], "shape": "number", "bounds": [0.2, 0.4]},
        {"key": D_C, "shape": "number", "bounds": ["3 um", "9 um"]},
    ]
    table = dropped(instruments=[BODY], objective=[{**term, "data": data}], unknowns=unknowns,
                    inference={"method": method, "iterations": 30})  # fmt: skip
    table["faults"]["main"]["friction"] |= {"mu_d": 0.32, "D_c": 5.5e-6}
    table["faults"]["main"]["nucleation"][0]["mu_d"] = 0.16
    return table


@pytest.mark.parametrize("method", [pytest.param("l_bfgs", marks=pytest.mark.slow), "gauss_newton"])
def test_one_number_for_two_keys_is_recovered(method: str, tmp_path: Path) -> None:
    """Dynamic friction of a law, and half of it where the rupture begins; beside it an unknown of the interface."""
    case = parse_case(measured(method))
    (row,) = [row for row in data_rows(Model(case)) if row.quantity == "unknowns: variables"]
    assert row.value == 2 and f"{DROP_MU_D} = 0.5 x {MU_D}, {D_C}" in row.note
    made = infer(case, tmp_path / "out", progress=False)
    for each, wanted in zip(made.unknowns, (0.3, 5e-6), strict=True):
        low, high = each.interval[:, 0]
        assert abs(each.best[0] - wanted) < 2 * (high - low), each.key  # four standard deviations
    best = read_case(tmp_path / "out/best.toml")
    value = made.unknowns[0].best[0]
    assert best.faults["main"].friction.mu_d == value and best.faults["main"].nucleation[0].mu_d == 0.5 * value
    assert Objective(best, best.objective, record=False).value == pytest.approx(made.best.misfit, rel=1e-9)
    with xarray.open_dataset(tmp_path / "out/result.nc", engine="h5netcdf") as result:
        assert float(result[f"{MU_D}.best"][0]) == value


@pytest.mark.slow
def test_an_inference_does_not_depend_on_how_its_ties_are_written(tmp_path: Path) -> None:
    """The other key first, with the inverse factor; entries in another order; lengths as texts in other units."""
    table = measured("gauss_newton")
    other = copy.deepcopy(table)
    mu_d, d_c = other["unknowns"]
    mu_d |= {"key": DROP_MU_D, "tied": [MU_D], "factors": [2.0], "bounds": [0.1, 0.2]}
    d_c["bounds"] = ["0.003 mm", "9000 nm"]
    other["unknowns"] = [d_c, mu_d]
    other["faults"]["main"]["friction"]["D_c"] = "0.0055 mm"
    results = []
    for number, way in enumerate((table, other)):
        made = infer(parse_case(way), tmp_path / str(number), progress=False)
        values = {each.key: np.concatenate([each.best, each.interval[:, 0]]) for each in made.unknowns}
        tied = values[MU_D] if MU_D in values else 2.0 * values[DROP_MU_D]
        best = made.case.faults["main"]
        drop, runs = best.nucleation[0].mu_d, len(made.runs)
        results.append([*tied, *values[D_C], best.friction.mu_d, drop, made.best.misfit, runs])
    np.testing.assert_allclose(results[1], results[0], rtol=1e-6)


FEWER = {"m": 2.0**-3, "s": 2.0**5, "kg": 2.0**9}
STRESS = "faults.main.initial_stress.{}"


def test_derivatives_by_tied_keys_follow_units_and_the_order_of_keys() -> None:
    """Base units changed by powers of two: the derivative by a stress has the unit 1/Pa, to 1e-12."""
    step = {"kind": "leapfrog", "time_step": 8e-8}  # those that are computed are rounded to three digits
    table = slip_weakening({"duration": 6e-6, "objective": SLIP, "stepper": step})
    unknown = {"key": STRESS.format("shear"), "tied": [STRESS.format("normal")], "factors": [0.5], "shape": "number"}
    other = {"key": STRESS.format("normal"), "tied": [STRESS.format("shear")], "factors": [2.0], "shape": "number"}

    def slope(case: dict[str, Any], entry: dict[str, Any]) -> float:
        return float(gradient(parse_case(case), unknowns=[Unknown(**entry)], progress=False)[entry["key"]])

    exact = slope(table, unknown)
    assert exact != 0
    assert slope(table, other) == 2 * exact
    scaled = mapped(table, lambda number, unit, _: number * unit_factor(unit, FEWER))
    assert slope(scaled, unknown) == pytest.approx(exact / unit_factor("Pa", FEWER), rel=1e-12)
    texts = copy.deepcopy(table)
    texts["faults"]["main"]["initial_stress"]["normal"] = "0.006 GPa"
    texts["objective"] = [{"kind": "final_slip", "sigma": "1 um"}]
    assert slope(texts, unknown) == exact


NUMBER = {"key": MU_D, "shape": "number", "tied": [DROP_MU_D]}
TERM = {"kind": "traces", "instrument": "body", "times": [1e-6], "data": {"velocity": [0.0]}, "sigma": 1e-6,
        "units": {"velocity": "m/s"}}  # fmt: skip


@pytest.mark.parametrize("unknowns, message", [
    ([{**NUMBER, "tied": ["faults.main.friction.D_c"]}],
     r"unknowns\.0\.tied\.0 = 'faults\.main\.friction\.D_c': is in m, and 'faults\.main\.friction\.mu_d' in 1; "
     r"tie keys of one unit"),
    ([{**NUMBER, "tied": ["faults.main.friction.mu"]}], r"unknowns\.0\.tied\.0 = .*mu': .*did you mean"),
    ([NUMBER], r"unknowns\.0\.key = .*'faults\.main\.friction\.mu_d' is 0\.3, .*nucleation\.0\.mu_d' is 0\.15 in the "
     r"case; give all of them one value, times their factors"),
    ([{**NUMBER, "tied": ["faults.main.initial_stress.normal"], "key": "faults.main.initial_stress.shear"}],
     r"shear' is 2\.8e\+06 to 3\.2e\+06, 'faults\.main\.initial_stress\.normal' is 6e\+06 in the case"),
    ([{**NUMBER, "factors": [0.5]}, {"key": DROP_MU_D, "shape": "number"}],
     r"unknowns\.1\.key = .*nucleation\.0\.mu_d': .* belongs to 'faults\.main\.friction\.mu_d' already"),
    ([{**NUMBER, "tied": [MU_D]}], r"unknowns\.0\.key = .*mu_d' belongs to .* already; remove"),
    ([{**NUMBER, "factors": [0.5], "bounds": [-0.2, 0.5]}],
     r"unknowns\.0\.bounds = \[-0\.2, 0\.5\]: -0\.2 is refused, faults\.main\.friction\.mu_d = -0\.2"),
])  # fmt: skip
def test_ties_that_cannot_be_are_refused_before_the_first_step(
    unknowns: list[dict[str, Any]], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object) -> None:
        raise AssertionError("a step was made")

    monkeypatch.setattr("ruptfx.stepping.steppers.leapfrog.LeapfrogMotion.step", refuse)
    case = parse_case(dropped(instruments=[BODY], objective=[TERM], unknowns=unknowns))
    with pytest.raises(CaseError, match=facts(message)):
        infer(case, tmp_path / "out", progress=False)


@pytest.mark.parametrize("changes, message", [
    ({"shape": "field"}, r"tied: keys that are tied have one number, and shape = 'field'; use 'number'"),
    ({"factors": [1.0, 2.0]}, r"factors: 2 for 1 tied keys; give one for each"),
    ({"factors": [0.0]}, r"factors = \[0\.0\]: must not be 0"),
])  # fmt: skip
def test_entries_that_contradict_themselves_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        parse_case(dropped(unknowns=[{**NUMBER, **changes}]))


def test_a_reconstruction_names_what_it_has_in_place_of_ties() -> None:
    from ruptfx.many_runs.reconstruction.experiment import Experiment

    case = dropped(instruments=[BODY], objective=[{**TERM, "times": [1e-6, 2e-6], "data": {"velocity": [0.0, 0.1]}}],
                   unknowns=[{**NUMBER, "factors": [0.5]}])  # fmt: skip
    with pytest.raises(
        CaseError, match=facts(r"unknowns\.0\.tied: .*make each an unknown, or use objective\.\*\.NAME")
    ):
        Experiment(parse_case(case)).unknowns()
