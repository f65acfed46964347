"""Inference: exact priors, recovered numbers and fields, kills and ranks, and what is refused."""

from __future__ import annotations

import csv
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from messages import facts
from small_cases import merged, slip_weakening

from ruptfx.case import Case, parse_case, read_case
from ruptfx.schema import CaseError

pytest.importorskip("dolfinx")

from ruptfx import RuptfxError, fem, infer, simulate
from ruptfx.adjoint.gradients import Objective
from ruptfx.adjoint.unknowns import chosen
from ruptfx.inference import inversion
from ruptfx.inference.variables import Variable
from ruptfx.misfits import Unknown
from ruptfx.model import Model
from ruptfx.platform import launch

pytestmark = pytest.mark.fem

SHEAR = "faults.main.initial_stress.shear"
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
], ids=["linear", "bounds", "log", "log with bounds", "number", "factor"])  # fmt: skip
def test_values_and_their_derivatives(unknown: dict[str, Any]) -> None:
    made, random = variable(unknown), np.random.default_rng(0)
    z, change = random.normal(size=(2, made.size))
    factors = random.normal(size=len(made.start))
    np.testing.assert_allclose(made.values(np.zeros(made.size)), made.start, rtol=1e-14)
    difference = (made.values(z + 1e-5 * change) - made.values(z - 1e-5 * change)) / 2e-5
    assert made.pull(z, factors) @ change == pytest.approx(factors @ difference, rel=1e-5)
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


def test_a_field_is_recovered_and_its_case_runs(tmp_path: Path) -> None:
    out = tmp_path / "out"
    case = with_unknowns(measured(SHEAR, None), FIELD, iterations=25)
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
    assert tomllib.loads((out / "case.toml").read_text())["inference"]["iterations"] == 25
    assert (out / "inference.png").stat().st_size > 20000 and (out / "unknowns.csv").exists()


def test_an_interrupted_inference_goes_on_as_if_it_were_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = with_unknowns(measured(SHEAR, None), FIELD, iterations=5)
    whole = infer(case, tmp_path / "whole", progress=False)
    computed, evaluate = [], inversion.Inversion._evaluate

    def counted(self: inversion.Inversion, z: np.ndarray) -> Any:
        if len(computed) == 3:
            raise KeyboardInterrupt
        made = evaluate(self, z)
        computed.append(made)
        return made

    monkeypatch.setattr(inversion.Inversion, "_evaluate", counted)
    with pytest.raises(KeyboardInterrupt):
        infer(case, tmp_path / "part", progress=False)
    monkeypatch.setattr(inversion.Inversion, "_evaluate", evaluate)
    (tmp_path / "part/evaluations/0003.part").write_bytes(b"half")
    made = infer(case, tmp_path / "part", progress=False)
    assert len(made.runs) == len(whole.runs) > 4
    for one, other in zip(made.runs, whole.runs, strict=True):
        np.testing.assert_array_equal(one.variables, other.variables)
    monkeypatch.setattr(inversion.Inversion, "_evaluate", counted)  # 3 were made: no further run is
    assert infer(case, tmp_path / "part", progress=False).best.misfit == whole.best.misfit
    with pytest.raises(RuptfxError, match=facts(r"has an inference of another case")):
        infer(case.changed("duration", 1.59), tmp_path / "part", progress=False)


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
    ({"unknowns": [{**NUMBER, "bounds": [5e6, 6e6]}]}, r"unknowns\.0\.bounds = .*exclude the value of the case"),
    ({"unknowns": [{"key": SHEAR}]}, r"unknowns\.0\.sigma, correlation_length: .*prior"),
    ({"unknowns": [{**NUMBER, "scale": "log"}], "faults.main.initial_stress.shear": -1e6},
     r"unknowns\.0\.scale = 'log'.* -1e\+06"),
    ({"unknowns": [{"key": "faults.main.friction.mu"}]}, r"unknowns\.0\.key .*did you mean"),
])  # fmt: skip
def test_what_cannot_be_inferred_is_refused_before_the_first_step(
    changes: dict[str, Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object) -> None:
        raise AssertionError("a step was made")

    monkeypatch.setattr("ruptfx.steppers.leapfrog.LeapfrogMotion.step", refuse)
    receiver = {"kind": "fault_receiver", "name": "fault", "interval": 1e-7, "position": 16e-3}
    table = slip_weakening({"instruments": [receiver], "objective": [TRACE], "unknowns": [NUMBER], **changes})
    with pytest.raises(RuptfxError, match=message):
        infer(parse_case(table), tmp_path / "out", progress=False)


@pytest.mark.parametrize("unknown, message", [
    ({"bounds": [2.0, 1.0]}, "the first must be below the second"),
    ({"bounds": [-1.0, 1.0], "scale": "log"}, "they are positive"),
    ({"shape": "number", "correlation_length": 1.0}, "a number has none"),
])  # fmt: skip
def test_entries_that_contradict_themselves_are_refused(unknown: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=message):
        parse_case(slip_weakening({"unknowns": [{"key": SHEAR, **unknown}]}))


def test_an_unknown_that_the_data_do_not_feel_is_named(tmp_path: Path) -> None:
    """Cohesion that is lost has no effect."""
    law = {"kind": "cohesion", "c": 1e5, "D_cohesion": 1e-6, "law": {"kind": "coulomb", "mu_d": 1e3}}
    table = slip_weakening({"faults.main.friction": law, "objective": [{"kind": "final_slip", "sigma": 1e-6}]})
    case = with_unknowns(table, {"key": "faults.main.friction.c", "shape": "number"})
    with pytest.raises(RuptfxError, match=facts(r"does not depend on 'faults\.main\.friction\.c'")):
        infer(case, tmp_path / "out", progress=False)


def test_the_command_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    number = {"key": "faults.main.friction.D_c", "shape": "number", "scale": "log", "bounds": [1e-7, 1e-4]}
    objective = [{"kind": "final_slip", "sigma": 1e-6, "target": 1e-5}]
    path.write_text(tomli_w.dumps(slip_weakening({"objective": objective, "unknowns": [number]})))
    out = tmp_path / "out"
    runs = []
    for iterations in (1, 2):
        setting = ["--set", f"inference.iterations={iterations}"]
        assert launch.run_on(1, ["infer", str(path), "--out", str(out), "--quiet", *setting]) == 0
        runs.append(len(list((out / "evaluations").glob("*.npz"))))
    assert 1 < runs[0] < runs[1]
    best = read_case(out / "best.toml")
    assert isinstance(best, Case) and best.faults["main"].friction.D_c != 5e-6
    assert fem.MPI.COMM_WORLD.size == 1
