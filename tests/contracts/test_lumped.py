"""Every lumped model of the folder, by its own example: files, the same result again, names and units, figures."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import xarray
from helpers.blank import leave_blank
from helpers.labels import label_faults
from helpers.messages import facts
from helpers.scaled_cases import mapped, unit_factor
from matplotlib import pyplot
from matplotlib.figure import Figure

from ruptfx import RuptfxError
from ruptfx.case import parse_case
from ruptfx.input.schema import Part, alternatives, descriptions, unit_of
from ruptfx.lumped import LumpedModel, Progress, read_result, rehearse, silent, simulate
from ruptfx.lumped.spring_slider import SpringSlider

MODELS = alternatives("ruptfx.lumped")
# Names of the results of the examples that are no pure numbers, by unit.
UNITS = {
    "asperity_population": {"m": "slip ageing_D_c slip_D_c", "m/s": "slip_rate speed",
                            "s": "mean_age ageing_theta slip_theta time hold"},
    "burridge_knopoff": {"s": "time duration", "m": "slip moment", "J": "released", "N": "force"},
    "maxwell_slip": {"s": "trace_time slip_time slip_period", "m": "R_a R_a_crit_low R_a_crit_high R_a_crit_min "
                     "R_a_crit_max R_a_scale_min R_a_scale_max"},
    "spring_block": {
        "N": "force elastic_force contact_force event_force event_drop largest_precursor_drop mean_large_drop "
             "first_break_force", "1/s": "event_speed chain_speed", "1/N": "length_slope", "m": "position",
        "s": "break_time event_start event_end first_break_time slow_front_start slow_front_end time",
    },
    "spring_slider": {"s": "time theta", "m/s": "drive_speed slip_rate step_speed", "m": "drive_displacement"},
}  # fmt: skip


def example(kind: str) -> LumpedModel:
    found = parse_case({"kind": kind, **tomllib.loads(MODELS[kind].example)})
    assert isinstance(found, LumpedModel)
    return found


def test_every_key_with_a_unit_reads_text() -> None:
    """Descriptions of keys do not name a unit, as the keys have it: '2 N' is read wherever 2 N is meant."""
    classes, todo = dict[type[Part], None](), [Part]
    while todo:
        cls = todo.pop()
        todo += cls.__subclasses__()
        classes[cls] = None
    for cls in [cls for cls in classes if cls.__module__.startswith("ruptfx.lumped")]:
        for key, text in descriptions(cls).items():
            unit = re.search(r"\[(N|N/m|kg|m|m/s|1/s|s|Pa)\]", text)
            has_number = "float" in str(cls.model_fields[key].annotation)
            assert not (unit and has_number) or unit_of(cls, key) == unit[1], f"{cls.__name__}.{key}"
    model = parse_case({"kind": "spring_slider", **tomllib.loads(MODELS["spring_slider"].example),
                        "normal_force": "2 kN", "stiffness": "3 N/um", "mass": "5 g"})  # fmt: skip
    assert isinstance(model, SpringSlider) and (model.normal_force, model.stiffness, model.mass) == (2e3, 3e6, 5e-3)


@pytest.mark.parametrize("kind", MODELS)
def test_example(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, told = example(kind), []
    assert rehearse(model)
    with monkeypatch.context() as patched:  # figures are drawn below; here they are files
        leave_blank(patched)
        data = simulate(model, tmp_path / "run", lambda fraction, text: told.append(fraction))
    assert told == sorted(told) and told[0] >= 0 and told[-1] == 1
    assert parse_case(tomllib.loads((tmp_path / "run" / "case.toml").read_text())) == model
    assert model.run().equals(data) and read_result(tmp_path / "run").equals(data)
    for name, values in data.variables.items():
        if values.dtype.kind in "fiu":
            units = UNITS.get(kind, {values.attrs["units"]: name})  # a new model has the units that it says
            known = [unit for unit, names in units.items() if name in names.split()]
            assert (values.attrs["units"], bool(values.attrs["long_name"])) == ((known or ["1"])[0], True), name
            assert not np.isinf(values).any(), name
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["kind"] == kind and summary["case_hash"] == model.hash
    scalars = {str(name): values.item() for name, values in data.data_vars.items() if values.ndim == 0}
    assert {name: summary[name] for name in scalars} == {
        name: None if value != value else value for name, value in scalars.items()
    }
    figures = model.figures(data)
    assert {f"{name}.png" for name in figures} == {path.name for path in (tmp_path / "run" / "figures").iterdir()}
    assert figures and pyplot.get_fignums() == []
    for figure in figures.values():
        assert label_faults(figure) == []
        labels = [axis.get_label_text() for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)]
        assert sum(map(bool, labels)) >= 2
        for ax in figure.axes:
            assert ax.lines or ax.collections or ax.images or ax.patches or not ax.get_visible()


class Twice(LumpedModel):
    """A model whose constant has the name of its result."""

    def run(self, progress: Progress = silent) -> xarray.Dataset:
        return xarray.Dataset({self.variable: ((), 0.0)}, attrs={self.attribute: 1.0})

    variable: str
    attribute: str

    @classmethod
    def figures(cls, dataset: xarray.Dataset) -> dict[str, Figure]:
        return {}


@pytest.mark.parametrize("names", [("a", "a"), ("kind", "b"), ("a", "run_time")])
def test_no_result_replaces_another_one(names: tuple[str, str], tmp_path: Path) -> None:
    twice = names[0] if names[0] == names[1] else ({"kind", "run_time"} & {*names}).pop()
    with pytest.raises(RuptfxError, match=facts(twice)):
        simulate(Twice(variable=names[0], attribute=names[1]), tmp_path / "run")


@pytest.mark.parametrize("error", [ValueError("no root"), OverflowError(), ZeroDivisionError(), MemoryError()])
@pytest.mark.parametrize("kind", MODELS)
def test_an_error_of_numbers_is_no_traceback(
    kind: str, error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise error

    model = example(kind)
    monkeypatch.setattr(type(model), "run", fail)
    with pytest.raises(RuptfxError, match=facts(f"^{kind}: ")):
        simulate(model, tmp_path / "run")


@pytest.mark.slow
def test_simulate_of_a_lumped_model_does_without_dolfinx(tmp_path: Path) -> None:
    """Neither DOLFINx nor MPI can be imported: `ruptfx.simulate` returns the result that it wrote."""
    program = f"""
import sys
for name in ("dolfinx", "mpi4py", "petsc4py", "basix", "ufl"):
    sys.modules[name] = None
import ruptfx
from ruptfx.case import parse_case
case = parse_case({{"kind": "spring_slider"}})
result = ruptfx.simulate(case, {str(tmp_path / "run")!r}, progress=False)
assert len(result.data_vars) > 3
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=120)
    assert (tmp_path / "run" / "summary.json").is_file()


@pytest.mark.parametrize("base", ["m", "s", "kg"])
@pytest.mark.parametrize("kind", MODELS)
def test_results_have_their_dimensions(kind: str, base: str) -> None:
    """All lengths, times or masses larger by a factor: results are larger by the factor of their units."""
    factors = {base: float(np.random.default_rng([20261128, ord(base[0])]).uniform(2, 5))}
    table = {"kind": kind, **example(kind).table()}
    larger = parse_case(mapped(table, lambda number, unit, _: number * unit_factor(unit, factors)))
    assert isinstance(larger, LumpedModel)
    expected, scaled = example(kind).run(), larger.run()
    assert expected.variables.keys() == scaled.variables.keys()
    for name, values in expected.variables.items():
        if values.dtype.kind not in "fiu" or name == "energy_error":  # rounding
            continue
        unit = values.attrs["units"]
        wanted = values.values * unit_factor({"degree": "1"}.get(unit, unit), factors)
        largest = float(np.nan_to_num(np.abs(wanted)).max(initial=0.0))
        # Fits of laws end where they improve by 1e-6 and less.
        np.testing.assert_allclose(scaled[name].values, wanted, rtol=1e-5, atol=1e-9 * largest, err_msg=str(name))
