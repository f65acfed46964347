"""Data of an objective: files with units, time shifts, filters, fields of image correlation, degrees of modes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from helpers.messages import facts
from helpers.small_cases import slip_weakening

from ruptfx.case import Case, parse_case, read_case
from ruptfx.input.schema import CaseError
from ruptfx.readings.misfits.mode_degree import _DEGREES, _several, degree_of
from ruptfx.results.analysis.modes import _degrees, classify

pytest.importorskip("dolfinx")

from ruptfx import RuptfxError, gradient, infer
from ruptfx.many_runs.adjoint.gradients import Objective
from ruptfx.many_runs.adjoint.unknowns import perturbed
from ruptfx.platform import launch
from ruptfx.readings.misfits import Unknown
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

TIMES = np.arange(2e-6, 10e-6, 2.5e-7)
BODY = {"kind": "velocimeter", "name": "body", "interval": 1e-7, "point": [18e-3, 2e-3], "direction": [1.0, 0.0]}
SHIFT = "objective.0.time_shift"
D_C = "faults.main.friction.D_c"


def trace(**keys: Any) -> dict[str, Any]:
    return {"kind": "traces", "instrument": "body", "times": TIMES.tolist(), "data": {"velocity": [0.1] * len(TIMES)},
            "units": {"velocity": "m/s"}, "sigma": 0.02, **keys}  # fmt: skip


def case_with(term: dict[str, Any], directory: Path | None = None, **keys: Any) -> Case:
    changes = {"duration": 12e-6, "instruments": [BODY], "objective": [term], **keys}
    made = parse_case(slip_weakening(changes), directory) if directory else parse_case(slip_weakening(changes))
    assert isinstance(made, Case)
    return made


def readings(case: Case) -> np.ndarray:
    return np.concatenate([sample.values for _, sample in Objective(case, case.objective, record=False).samples])


def test_the_derivative_by_a_time_shift_equals_central_differences() -> None:
    """Readings are linear between steps, and so is the shift as long as no datum passes one: 1e-10 s here."""
    case = case_with(trace(time_shift=3.1e-7))
    exact = gradient(case, unknowns=[SHIFT, D_C], progress=False)
    assert exact[SHIFT].ndim == 0 and exact[SHIFT].attrs["units"] == "1/s"
    values = [
        Objective(case, [case.objective[0].substituted({"time_shift": 3.1e-7 + step})], record=False).value
        for step in (-1e-10, 1e-10)
    ]
    assert float(exact[SHIFT]) == pytest.approx((values[1] - values[0]) / 2e-10, rel=1e-8)
    both = gradient(case, unknowns=[D_C], progress=False)
    np.testing.assert_array_equal(exact[D_C], both[D_C])


@pytest.mark.parametrize("method", [pytest.param("l_bfgs", marks=pytest.mark.slow), "gauss_newton"])
def test_a_time_shift_is_recovered_with_a_number(method: str, tmp_path: Path) -> None:
    """Data are 0.4 us late, and D_c is 4 um in place of 5 um; beyond the bounds there is another minimum, at 0.4 us."""
    true = case_with(trace(time_shift=-4e-7)).changed(D_C, 4e-6)
    data = readings(true) + 0.02 * np.random.default_rng(1).normal(size=len(TIMES))
    unknowns = [
        {"key": SHIFT, "shape": "number", "bounds": [-7e-7, 0.0]},
        {"key": D_C, "shape": "number", "scale": "log", "bounds": [1e-6, 2e-5]},
    ]
    case = case_with(
        trace(data={"velocity": data.tolist()}, time_shift=-1e-7),
        unknowns=unknowns,
        inference={"method": method, "iterations": 30},
    )
    made = infer(case, tmp_path / "out", progress=False)
    for each, wanted in zip(made.unknowns, (-4e-7, 4e-6), strict=True):
        low, high = each.interval[:, 0]
        assert abs(each.best[0] - wanted) < 2 * (high - low), each.key  # four standard deviations
    best = read_case(tmp_path / "out/best.toml")
    assert isinstance(best, Case)
    assert best.objective[0].time_shift == made.unknowns[0].best[0]
    assert Objective(best, best.objective, record=False).value == pytest.approx(made.best.misfit, rel=1e-9)
    with xarray.open_dataset(tmp_path / "out/result.nc", engine="h5netcdf") as result:
        assert float(result[f"{SHIFT}.best"][0]) == made.unknowns[0].best[0]


@pytest.mark.parametrize("first, second", [
    ("G1 (ue)", "G2 (ue)"), ("G1.extension_1 (ue)", "G2.extension_1 (ue)"), ("g1 45 deg (ue)", "G2 -45° (ue)"),
])  # fmt: skip
def test_one_file_of_several_gauges_serves_all_terms(first: str, second: str, tmp_path: Path) -> None:
    """Each term takes the columns with the name of its instrument, and is that of a file of its own."""
    gauges = [{"kind": "strain_gauge", "name": name, "interval": 1e-7, "point": [18e-3, 2e-3], "angles": [angle]}
              for name, angle in (("G1", np.pi / 4), ("G2", -np.pi / 4))]  # fmt: skip
    values = [(1e6 * float(t), 10 * n, -3 * n) for n, t in enumerate(TIMES)]
    rows = "\n".join(f"{t!r},{a},{b}" for t, a, b in values)
    (tmp_path / "logger.csv").write_text(f"time (us),{first},{second}\n{rows}\n")
    terms = [{"kind": "traces", "instrument": name, "file": "logger.csv", "sigma": "8 ue"} for name in ("G1", "G2")]
    case = case_with(terms[0], tmp_path, instruments=gauges, objective=terms)
    for term, column in zip(case.objective, (1, 2), strict=True):
        (measured,) = term.measured()
        np.testing.assert_allclose(measured.values, [1e-6 * row[column] for row in values], rtol=1e-12)
    both = Objective(case, case.objective, record=False)
    strains = [sample.values for _, sample in both.samples]
    wanted = sum(
        0.5 * np.sum(((strain - 1e-6 * np.array(values)[:, column]) / 8e-6) ** 2)
        for strain, column in zip(strains, (1, 2), strict=True)
    )
    assert both.value == pytest.approx(wanted, rel=1e-12) and np.abs(strains[0] + strains[1]).max() > 1e-7


def test_gain_and_offset_are_in_value_and_derivatives() -> None:
    """Half the sum of ((1.2 r - 30 mm/s - d) / sigma)^2: both derivatives by hand, and that of D_c times the gain."""
    changed = {"gain": 1.2, "offset": "-30 mm/s"}
    case, plain = case_with(trace(**changed)), case_with(trace())
    r, sigma = readings(plain), 0.02
    residual = (1.2 * r - 0.03 - 0.1) / sigma
    np.testing.assert_array_equal(readings(case), r)
    assert Objective(case, case.objective, record=False).value == pytest.approx(0.5 * residual @ residual, rel=1e-12)
    exact = gradient(case, unknowns=["objective.0.gain", "objective.0.offset", D_C], progress=False)
    assert float(exact["objective.0.gain"]) == pytest.approx(residual @ r / sigma, rel=1e-12)
    assert float(exact["objective.0.offset"]) == pytest.approx(residual.sum() / sigma, rel=1e-12)
    assert exact["objective.0.offset"].attrs["units"] == "1/(m/s)"
    values = [Objective(each := case.changed(D_C, 5e-6 * (1 + h)), each.objective, record=False).value
              for h in (-1e-5, 1e-5)]  # fmt: skip
    assert float(exact[D_C].sum()) == pytest.approx((values[1] - values[0]) / 1e-10, rel=1e-5)


@pytest.mark.parametrize("method", ["l_bfgs", "gauss_newton"])
def test_offset_gain_and_one_delay_of_two_gauges_are_recovered(method: str, tmp_path: Path) -> None:
    """Two gauges on one trigger, 0.4 us late; one has a baseline of 50 mm/s, the other an amplifier of 0.9."""
    other = {**BODY, "name": "other", "point": [22e-3, 2e-3]}
    terms = [trace(time_shift=-4e-7, offset=0.05), trace(instrument="other", time_shift=-4e-7, gain=0.9)]
    true = case_with(terms[0], instruments=[BODY, other], objective=terms)
    made = Objective(true, true.objective, record=False)
    noise = np.random.default_rng(2).normal(size=(2, len(TIMES)))
    signals = np.array(made.expected()) + 0.005 * noise
    data = [{"velocity": values.tolist()} for values in signals]
    wanted = {"objective.*.time_shift": -4e-7, "objective.0.offset": 0.05, "objective.1.gain": 0.9}
    bounds = dict(zip(wanted, (["-0.7 us", 0.0], ["-200 mm/s", 0.2], [0.5, 2.0]), strict=True))
    widths = dict(zip(wanted, (7e-7, 0.4, 1.5), strict=True))
    start = [trace(time_shift=-1e-7, instrument=name, data=each, sigma=0.005)
             for name, each in zip(("body", "other"), data, strict=True)]  # fmt: skip
    case = case_with(
        start[0],
        instruments=[BODY, other],
        objective=start,
        inference={"method": method, "iterations": 40},
        unknowns=[{"key": key, "shape": "number", "bounds": bounds[key]} for key in wanted],
    )
    result = infer(case, tmp_path / "out", progress=False)
    for each in result.unknowns:
        low, high = each.interval[:, 0]
        assert abs(each.best[0] - wanted[each.key]) < 2 * (high - low), each.key  # four standard deviations
        assert high - low < 0.2 * widths[each.key]
    best = read_case(tmp_path / "out/best.toml")
    assert best.objective[0].time_shift == best.objective[1].time_shift == result.unknowns[0].best[0]
    assert 2 * result.best.misfit / (2 * len(TIMES)) == pytest.approx(1.0, abs=0.5)
    for fit, values in zip(result.fits, signals, strict=True):
        assert np.std(values - fit.best) < 0.0075


@pytest.mark.parametrize("unknowns, message", [
    ([{"key": "objective.*.time_shift"}], r"unknowns\.0\.key = 'objective\.\*\.time_shift'.* 0 .* 1e-07 "),
    ([{"key": "objective.*.gain"}, {"key": "objective.1.gain"}], r"unknowns\.1\.key = 'objective\.1\.gain'"),
    ([{"key": "objective.0.gain", "bounds": [0.0, 2.0]}], r"unknowns\.0\.bounds = \[0\.0, 2\.0\]: 0 "),
])  # fmt: skip
def test_nuisance_parameters_that_cannot_be_recovered_are_refused(
    unknowns: list[dict[str, Any]], message: str, tmp_path: Path
) -> None:
    numbers = [{"shape": "number", "bounds": [-1e-6, 2.0], **each} for each in unknowns]
    case = case_with(trace(), objective=[trace(), trace(time_shift=1e-7)], unknowns=numbers)
    with pytest.raises(CaseError, match=facts(message)):
        infer(case, tmp_path / "out", progress=False)


@pytest.mark.parametrize("unknown, message", [
    ({"shape": "number", "bounds": [-3e-6, 1e-6]}, r"objective\.0\.times: .* -1e-06 s .*time_shift = -3e-06 s"),
    ({"shape": "number"}, r"unknowns\.0\.bounds: .*within which the data stay"),
    ({"bounds": [-1e-6, 1e-6]}, r"unknowns\.0\.shape = 'field': .*is one number"),
    ({"shape": "knots", "knots": [0.0, 1.0]}, r"unknowns\.0\.shape = 'knots': .*is one number"),
    ({"key": "objective.1.time_shift", "shape": "number"}, r"unknowns\.0\.key = 'objective\.1\.time_shift'"),
])  # fmt: skip
def test_a_time_shift_that_cannot_be_recovered_is_refused(unknown: Any, message: str, tmp_path: Path) -> None:
    case = case_with(trace(), unknowns=[{"key": SHIFT, **unknown}])
    with pytest.raises(CaseError, match=facts(message)):
        infer(case, tmp_path / "out", progress=False)


def test_one_filter_acts_on_data_and_readings() -> None:
    """Data of every step of the run, from the start on, are filtered as its readings are."""
    dt = Objective(whole := case_with(trace()), whole.objective, record=False).sweeps.dt
    times = [0.0, *((n + 0.5) * dt for n in range(int(10e-6 / dt)))]
    term = trace(times=times, data={"velocity": [0.0] * len(times)})
    data = readings(case_with(term)).tolist()
    filtered = case_with({**term, "data": {"velocity": data}, "bandwidth": 3e5})
    made = Objective(filtered, filtered.objective, record=False)
    assert np.abs(made.samples[0][1].values - data).max() > 0.01  # m/s
    assert made.value < 1e-20
    with pytest.raises(CaseError, match=facts(r"objective\.0\.bandwidth = 300000 Hz: 'body' has a filter")):
        own = case_with(trace(bandwidth=3e5), instruments=[{**BODY, "bandwidth": 1e6}])
        Objective(own, own.objective)


@pytest.mark.parametrize("group", ["/", "/body"])
def test_data_are_read_from_netcdf_with_units(group: str, tmp_path: Path) -> None:
    found = xarray.Dataset(
        {"velocity": ("time", [10.0, 20.0], {"units": "cm/s"})}, {"time": ("time", [3.0, 5.0], {"units": "us"})}
    )
    found.to_netcdf(tmp_path / "data.nc", group=group, engine="h5netcdf")
    term = {"kind": "traces", "instrument": "body", "file": "data.nc", "sigma": 0.1}
    made = case_with(term, tmp_path)
    assert made.objective[0].times == pytest.approx([3e-6, 5e-6], rel=1e-15)
    value = Objective(made, made.objective, record=False)
    assert value.value == pytest.approx(50 * np.sum((value.samples[0][1].values - [0.1, 0.2]) ** 2))
    for name, unit, message in (
        ("velocity", None, "'velocity' has no unit"),
        ("velocity", "furlong", r"data\.nc: 'velocity' .* units = 'furlong': .* m, "),
        ("time", "mm", r"data\.nc: 'time' .* units = 'mm': .* s "),
    ):
        wrong = found.copy(deep=True)
        wrong[name].attrs = {"units": unit} if unit else {}
        wrong.to_netcdf(tmp_path / "data.nc", group=group, engine="h5netcdf")
        with pytest.raises(CaseError, match=facts(message)):
            case_with(term, tmp_path)


PACKED = {"dtype": "i2", "scale_factor": 0.5, "add_offset": 10.0, "_FillValue": -9999}


def test_packed_and_missing_values_of_netcdf_files(tmp_path: Path) -> None:
    """Integers with scale and offset are unpacked; a channel has the samples that are not missing."""
    values = {"velocity": ("time", [10.0, 20.5], {"units": "cm/s"}), "lost": ("time", [1.0, np.nan], {"units": "cm/s"})}
    found = xarray.Dataset(values, {"time": ("time", [3.0, 5.0], {"units": "us"})})
    packing = {"velocity": PACKED, "lost": PACKED, "time": {"dtype": "i4", "scale_factor": 0.25}}
    found.to_netcdf(tmp_path / "data.nc", engine="h5netcdf", encoding=packing)
    term = {"kind": "traces", "instrument": "body", "file": "data.nc", "sigma": 0.1}
    (made,) = case_with({**term, "channels": ["velocity"]}, tmp_path).objective
    assert made.times == pytest.approx([3e-6, 5e-6]) and made.data == {"velocity": pytest.approx([10.0, 20.5])}
    (made,) = case_with(term, tmp_path).objective
    assert made.missing == {"lost": [1]} and [len(each.times) for each in made.measured()] == [2, 1]
    found = found.assign_coords(time=("time", [3.0, np.nan], {"units": "us"}))
    found.to_netcdf(tmp_path / "data.nc", engine="h5netcdf")
    with pytest.raises(
        CaseError, match=facts(r"objective\.0: .*data\.nc: 'time' .* 1 of 2 times.*leave out these times")
    ):
        case_with(term, tmp_path)


def test_missing_samples_of_one_channel_do_not_count(tmp_path: Path) -> None:
    """Empty cells, nan and listed numbers are the same; the objective is the sum over the other samples of the two."""
    receiver = {"kind": "receiver", "name": "r", "interval": 1e-7, "point": [18e-3, 2e-3]}
    lines = ["time (us),velocity_x (mm/s),velocity_y (mm/s)", "3,10,1", "4,,2", "5,30,NaN", "6,40,4", "7,50,5"]
    (tmp_path / "gaps.csv").write_text("\n".join(lines))
    (tmp_path / "full.csv").write_text("\n".join(lines).replace(",,", ",20,").replace("NaN", "3"))
    term = {"kind": "traces", "instrument": "r", "file": "full.csv", "sigma": "2 mm/s"}
    gaps = {"velocity_x": [1], "velocity_y": [2]}
    made = case_with({**term, "file": "gaps.csv"}, tmp_path, instruments=[receiver])
    listed = case_with({**term, "missing": gaps}, tmp_path, instruments=[receiver])
    full = case_with(term, tmp_path, instruments=[receiver])
    assert made.objective[0].missing == gaps and parse_case(made.table()) == made
    assert made.objective[0].data["velocity_x"] == pytest.approx([10, 20, 30, 40, 50])  # linear in between
    of_gaps, of_list, of_all = (Objective(each, each.objective, record=False) for each in (made, listed, full))
    residuals = of_all.residuals()
    assert residuals is not None and of_gaps.value == of_list.value
    left = np.delete(residuals[0], [1, 5 + 2])
    assert of_gaps.value == pytest.approx(0.5 * left @ left, rel=1e-14)
    assert [len(each.times) for each in made.objective[0].measured()] == [4, 4]
    for change, message in (
        ({"missing": {"velocity_z": [1]}}, r"objective\.0: missing\.velocity_z: .*velocity_"),
        ({"missing": {"velocity_x": [5]}}, r"objective\.0: missing\.velocity_x: sample 5 of 5.*remove it"),
        ({"missing": {"velocity_y": [4, 0, 1, 2, 3]}}, r"objective\.0: data\.velocity_y: all samples.*in channels"),
        ({"missing": {"velocity_x": [1]}, "bandwidth": 1e5}, r"bandwidth = 100000 Hz: .* 4e-06 s; remove bandwidth"),
        ({"missing": {"velocity_x": [0, 1]}, "end": 4e-6}, r"objective\.0\.data\.velocity_x: all samples.*channels"),
    ):  # fmt: skip
        with pytest.raises(CaseError, match=facts(message)):
            wrong = case_with({**term, **change}, tmp_path, instruments=[receiver])
            Objective(wrong, wrong.objective, record=False)


def test_decimal_commas_are_read_where_semicolons_separate_columns(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("time (us);velocity (m/s)\n1,5;2\n2;3,25\n")
    (term,) = case_with({"kind": "traces", "instrument": "body", "file": "data.csv", "sigma": 0.1}, tmp_path).objective
    assert term.times == pytest.approx([1.5e-6, 2e-6]) and term.data == {"velocity": [2.0, 3.25]}


@pytest.mark.parametrize("text, message", [
    ("time (us),velocity (m/s)\n1,2\n2,#OVF\n", r"line 3 .*: '#OVF' must be a finite number; .*leave out the line"),
    ("time (us),velocity (m/s)\n1,2\n,3\n", r"line 3 .*: '' must be a finite number; .*leave out the line"),
    ("time (us),velocity\n1,2\n", r"line 1 of .*, column 2, 'velocity': has no unit"),
    ("time (us)\n1\n2\n", r"data\.csv: has one column"),
    ("time (us),velocity (m/s)\n1,2\n1,3\n", "1e-06 s after 1e-06 s.*remove one of the two"),
    ("time (us),velocity (m/s)\n2,2\n1,3\n", "1e-06 s after 2e-06 s.*sort the data"),
])  # fmt: skip
def test_data_files_that_cannot_be_used_are_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text(text)
    with pytest.raises(CaseError, match=facts(message)):
        case_with({"kind": "traces", "instrument": "body", "file": "data.csv", "sigma": 0.1}, tmp_path)


@pytest.mark.parametrize("packed", [False, True])
def test_fields_are_read_in_both_orders_of_their_axes(packed: bool, tmp_path: Path) -> None:
    moved = [[1.0, 9.0, 3.0], [4.0, np.nan, 5.5]]
    grid = xarray.Dataset(
        {"displacement_x": (("y", "x"), moved, {"units": "um"})},
        {"x": ("x", [5.0, 6.0, 7.0], {"units": "mm"}), "y": ("y", [1.0, 2.0], {"units": "mm"})},
    )
    encoding = {"displacement_x": PACKED} if packed else {}
    for axes in (("y", "x"), ("x", "y")):
        grid.transpose(*axes).to_netcdf(tmp_path / "moved.nc", engine="h5netcdf", encoding=encoding)
        (made,) = case_with(field(file="moved.nc"), tmp_path).objective
        assert made.x == pytest.approx([5e-3, 6e-3, 7e-3, 5e-3, 7e-3])
        assert made.displacement_x == pytest.approx([1e-6, 9e-6, 3e-6, 4e-6, 5.5e-6])
    (made,) = case_with(field(file="moved.nc", every=2), tmp_path).objective  # of the rows, too
    assert (made.x, made.y) == (pytest.approx([5e-3, 7e-3]), pytest.approx([1e-3] * 2))
    wide = xarray.concat([grid, grid.assign_coords(y=[3.0, 4.0])], "y")
    wide.to_netcdf(tmp_path / "moved.nc", engine="h5netcdf", encoding=encoding)
    (made,) = case_with(field(file="moved.nc", every=2), tmp_path).objective
    assert made.y == pytest.approx([1e-3, 1e-3, 3e-3, 3e-3])
    assert made.displacement_x == pytest.approx([1e-6, 3e-6] * 2)
    grid.expand_dims("time").to_netcdf(tmp_path / "moved.nc", engine="h5netcdf")
    with pytest.raises(CaseError, match=facts(r"moved\.nc: 'displacement_x' has the axes time, y, x; give it x and y")):
        case_with(field(file="moved.nc"), tmp_path)


def field(**keys: Any) -> dict[str, Any]:
    return {"kind": "displacement_field", "time": 8e-6, "sigma": 1e-6, **keys}


def test_displacements_are_read_from_files_with_units(tmp_path: Path) -> None:
    """Two points of a CSV file and of a grid in NetCDF are those of a list."""
    listed = case_with(field(x=[15e-3, 17e-3], y=[1e-3, 1e-3], displacement_x=[1e-6, 3e-6], body="upper"))
    text = "x (mm),y (mm),displacement_x (um)\n5,1,1\n7,1,3\n"
    (tmp_path / "moved.csv").write_text(text)
    of_text = case_with(field(file="moved.csv", origin=[10e-3, 0.0], body="upper"), tmp_path)
    grid = xarray.Dataset(
        {"displacement_x": (("y", "x"), [[1.0, 9.0, 3.0, 9.0, np.nan]], {"units": "um"})},
        {"x": ("x", [5.0, 6.0, 7.0, 8.0, 9.0], {"units": "mm"}), "y": ("y", [1.0], {"units": "mm"})},
    )
    grid.to_netcdf(tmp_path / "moved.nc", engine="h5netcdf")
    of_grid = case_with(field(file="moved.nc", origin=[10e-3, 0.0], every=2, body="upper"), tmp_path)
    values = [Objective(case, case.objective, record=False).value for case in (listed, of_text, of_grid)]
    assert values[0] > 0 and values == pytest.approx([values[0]] * 3, rel=1e-12)
    moved = readings(listed)
    assert values[0] == pytest.approx(0.5e12 * np.sum((moved - [1e-6, 3e-6]) ** 2))


def test_a_number_is_recovered_from_a_field_of_displacements(tmp_path: Path) -> None:
    x, y = (each.ravel().tolist() for each in np.meshgrid(np.linspace(10e-3, 22e-3, 7), [-2e-3, 1e-3, 3e-3]))
    zero = [0.0] * len(x)
    true = case_with(field(x=x, y=y, displacement_x=zero, displacement_y=zero, sigma=2e-7)).changed(D_C, 4e-6)
    noise = 2e-7 * np.random.default_rng(2).normal(size=2 * len(x))
    data = np.split(readings(true) + noise, 2)
    term = field(x=x, y=y, displacement_x=data[0].tolist(), displacement_y=data[1].tolist(), sigma=2e-7)
    number = {"key": D_C, "shape": "number", "scale": "log", "bounds": [1e-6, 2e-5]}
    case = case_with(term, unknowns=[number], inference={"method": "gauss_newton"})
    (found,) = infer(case, tmp_path / "out", progress=False).unknowns
    low, high = found.interval[:, 0]
    assert abs(found.best[0] - 4e-6) < 2 * (high - low) < 2e-6


def test_data_that_are_fitted_exactly_have_no_gradient() -> None:
    """Readings of the case itself; at another value of the unknown there is a gradient."""
    x, y = [10e-3, 16e-3, 22e-3], [1e-3, -2e-3, 1e-3]
    empty = field(x=x, y=y, displacement_x=[0.0] * 3, displacement_y=[0.0] * 3)
    data = np.split(readings(case_with(empty)), 2)
    case = case_with(field(x=x, y=y, displacement_x=data[0].tolist(), displacement_y=data[1].tolist()))
    with pytest.raises(RuptfxError, match=facts(rf"objective = 0: the misfit is zero.*'{D_C}'.*--set KEY=VALUE")):
        gradient(case, unknowns=[D_C], progress=False)
    start = float(case.faults["main"].friction.D_c)
    found = gradient(case.changed(D_C, 1.1 * start), unknowns=[D_C], progress=False)
    assert float(found["objective"]) > 0 and np.any(found[D_C].values)


def test_an_objective_that_is_not_finite_is_refused() -> None:
    """Its gradient would be no number."""
    with pytest.raises(RuptfxError, match=facts("objective = inf: .*sigma")), np.errstate(over="ignore"):
        gradient(case_with({"kind": "final_slip", "sigma": 1e-200}), progress=False)


@pytest.mark.parametrize("term, message", [
    (field(), "there are no data"),
    (field(x=[1e-3], y=[1e-3], displacement_x=[0.0, 1.0]), "2 values at 1 points"),
    (field(x=[15e-3], y=[1e-3], displacement_x=[0.0], time=1.0), r"objective\.0\.time = 1 s: the run lasts"),
    (field(x=[1.0], y=[1e-3], displacement_x=[0.0]), r"objective\.0\.x\.0.*1"),
])  # fmt: skip
def test_fields_that_cannot_be_used_are_refused(term: dict[str, Any], message: str) -> None:
    with pytest.raises(RuptfxError, match=facts(message)):
        gradient(case_with(term), progress=False)


def test_a_field_in_pixels_and_antiplane_motion_are_refused(tmp_path: Path) -> None:
    xarray.Dataset(
        {"displacement_x": (("y", "x"), [[1.0]], {"units": "pixel"})},
        {"x": ("x", [0.0], {"units": "pixel"}), "y": ("y", [0.0], {"units": "pixel"})},
    ).to_netcdf(tmp_path / "moved.nc", engine="h5netcdf")
    with pytest.raises(CaseError, match=facts("in pixels .*--pixel")):
        case_with(field(file="moved.nc"), tmp_path)
    out_of_plane = case_with(
        field(x=[15e-3], y=[1e-3], displacement_x=[0.0]), plane="antiplane", instruments=[], boundaries=[]
    )
    with pytest.raises(CaseError, match=facts(r"objective\.0\.kind = 'displacement_field': .*plane = 'antiplane'")):
        gradient(out_of_plane, progress=False)


def pulses(kind: str) -> np.ndarray:
    """Slip rate [m/s] at 60 times and 100 points; the tip is 1.6 points faster than time."""
    t, x = np.arange(60)[:, None], np.arange(100)[None]
    behind = 1.6 * t - x
    return {
        "crack": np.where(behind > 0, 1.0, 0.0),
        "pulse": np.exp(-(((behind - 8) / 6.0) ** 2)),
        "train": np.where(behind > 0, np.abs(np.sin(behind * np.pi / 12)) ** 3, 0.0),
    }[kind]


@pytest.mark.parametrize("kind", ["crack", "pulse", "train"])
def test_smooth_degrees_are_close_to_those_of_the_analysis(kind: str) -> None:
    rates = pulses(kind)
    exact = classify(rates, 1e-6 * np.arange(60), 1e-3 * np.arange(100), V_imp=2.0).degrees
    for mode in ("crack", "pulse", "train"):
        assert degree_of(rates, mode, 0.04)[0] == pytest.approx(exact[mode], abs=0.15), mode
    assert max(("crack", "pulse", "train"), key=lambda mode: degree_of(rates, mode, 0.04)[0]) == kind


@pytest.mark.parametrize("zones", range(8))
@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.6, 0.95])
def test_degrees_of_whole_zones_are_those_of_the_analysis(fraction: float, zones: int) -> None:
    f, r = np.array([fraction]), np.array([float(zones)])
    exact = _degrees(f, r, np.arange(1), np.arange(1))
    smooth = {mode: float(degree(f, r).value[0]) for mode, degree in _DEGREES.items()}
    smooth["pulses_into_crack"] = float(np.sqrt(smooth["crack"] * _several(f, r).value[0]))
    assert smooth == pytest.approx(exact)


@pytest.mark.parametrize("steepness", [1.0, 4.0])
@pytest.mark.parametrize("mode", ["crack", "pulse", "train", "pulses_into_crack"])
@pytest.mark.parametrize("kind", ["crack", "pulse", "train"])
def test_smooth_degrees_have_exact_derivatives(kind: str, mode: str, steepness: float) -> None:
    random = np.random.default_rng(0)
    rates = 0.3 * pulses(kind) + 0.01 * random.random((60, 100))
    change = rates * random.normal(size=rates.shape)
    degree, slope = degree_of(rates, mode, 0.04, 5.0, steepness)
    both = [degree_of(rates + sign * 1e-6 * change, mode, 0.04, 5.0, steepness)[0] for sign in (1, -1)]
    assert 0 <= degree <= 1
    assert float(np.sum(slope * change)) == pytest.approx((both[0] - both[1]) / 2e-6, rel=1e-5, abs=1e-9)


def test_taylor_remainder_of_a_degree_is_of_second_order_through_a_run() -> None:
    """Ageing law, which has no kinks: the remainder falls by 100 for a tenth of the change."""
    law = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.015, "D_c": 5e-6, "f_0": 0.4, "V_0": 1e-2,
           "V_initial": 1e-2}  # fmt: skip
    term = {"kind": "mode_degree", "mode": "crack", "threshold": 0.05, "loaded_end": 16e-3, "far_end": 30e-3,
            "spacing": 1e-3, "interval": 5e-7, "steepness": 1.0}  # fmt: skip
    case = case_with(term, **{"faults.main.friction": law, "faults.main.initial_stress.shear.inside": 4.5e6})
    made = Objective(case, case.objective)
    (by_shear,) = made.gradient([Unknown(key="faults.main.initial_stress.shear")])
    model = Model(case).in_steps("explicit")
    shape = 1e6 * np.cos(200 * model.faults[0].interface.position)
    slope = float(by_shear.values @ shape)
    assert 0.05 < made.value < 0.95
    sizes, rest = (1e-2, 1e-3, 1e-4), []
    for size in sizes:
        view = perturbed(model, {(0, "shear_traction_0_0"): size * shape})
        value = Objective(case, case.objective, model=view, record=False).value
        rest.append(abs(value - made.value - size * slope) / abs(slope))
    assert rest[0] < 0.05 and np.log10(rest[0] / rest[-1]) / 2 > 1.9


@pytest.mark.slow
def test_terms_are_the_same_on_two_ranks(tmp_path: Path) -> None:
    """A shifted and filtered trace, displacements of a surface and a degree, in one objective."""
    mode = {"kind": "mode_degree", "mode": "pulse", "threshold": 0.1, "loaded_end": 16e-3, "far_end": 30e-3,
            "spacing": 1e-3, "interval": 5e-7}  # fmt: skip
    moved = field(x=[10e-3, 15e-3, 20e-3], y=[1e-3, -2e-3, 3e-3], displacement_x=[0.0, 1e-6, 2e-6])
    terms = [trace(time_shift=1e-7, bandwidth=5e5), moved, mode]
    unknowns = [{"key": key} for key in (SHIFT, D_C, "faults.main.initial_stress.shear")]
    case = case_with(terms[0], objective=terms, unknowns=unknowns)
    (tmp_path / "case.toml").write_text(case.to_toml())
    found = []
    for ranks in (1, 2):
        out = tmp_path / str(ranks)
        assert launch.run_on(ranks, ["gradient", str(tmp_path / "case.toml"), "--out", str(out), "--quiet"]) == 0
        found.append(xarray.load_dataset(out / "gradient.nc", engine="h5netcdf"))
    for name, values in found[0].data_vars.items():
        np.testing.assert_allclose(found[1][name], values, rtol=1e-10, atol=1e-10 * float(np.abs(values).max()))


def test_modes_need_enough_positions_and_times() -> None:
    term = {"kind": "mode_degree", "mode": "crack", "threshold": 0.5, "loaded_end": 16e-3, "far_end": 17e-3,
            "spacing": 1e-3, "interval": 5e-7}  # fmt: skip
    with pytest.raises(CaseError, match=facts(r"spacing = 0\.001 m: fewer than 6")):
        case_with(term)
    few = case_with({**term, "far_end": 30e-3, "interval": 1e-5})
    with pytest.raises(CaseError, match=facts(r"objective\.0\.interval = 1e-05 s: at most a quarter")):
        gradient(few, progress=False)


@pytest.mark.parametrize("end, position", [("far_end", 0.3), ("loaded_end", -0.3)])
def test_ends_of_modes_are_on_the_interface(end: str, position: float) -> None:
    term = {"kind": "mode_degree", "mode": "crack", "threshold": 0.5, "loaded_end": 16e-3, "far_end": 30e-3,
            "spacing": 1e-3, "interval": 5e-7, end: position}  # fmt: skip
    said = facts(rf"objective\.0\.{end} = {position:g} m: must be on the interface, 0 to")
    with pytest.raises(CaseError, match=said):
        gradient(case_with(term), progress=False)


def test_infer_fits_a_spring_slider_and_refuses_other_lumped_models(tmp_path: Path) -> None:
    time = np.linspace(0.0, 3.0, 600)
    drive = np.where(time < 1, 1e-6, 5e-6)
    from ruptfx.lumped.spring_slider import SpringSlider
    from ruptfx.lumped.spring_slider.fit import modelled

    slider = SpringSlider().slider()
    friction = modelled(slider, np.array([*np.log([0.013, 0.026, 0.42e-6]), 0.36]), time, drive)
    rows = "\n".join(f"{a:.9g},{b:.9g},{c:.12g}" for a, b, c in zip(time, drive, friction, strict=True))
    (tmp_path / "trace.csv").write_text(f"time,drive_speed,friction\n{rows}\n")
    head = 'kind = "spring_slider"\n'
    law = 'friction = { kind = "rate_and_state_ageing", a = 0.01, b = 0.02, D_c = 0.7e-6, f_0 = 0.36, V_0 = 1e-6 }\n'
    (tmp_path / "fit.toml").write_text(f'{head}{law}experiment = {{ kind = "fit", trace = "trace.csv" }}\n')
    (tmp_path / "steps.toml").write_text(head)
    from typer.testing import CliRunner

    from ruptfx.app.cli import app

    out = tmp_path / "out"
    for _ in range(2):  # the second time from the files
        done = CliRunner().invoke(app, ["infer", str(tmp_path / "fit.toml"), "--out", str(out), "--quiet"])
        assert done.exit_code == 0, done.output
    with xarray.open_dataset(out / "result.nc", engine="h5netcdf") as found:
        assert [float(found[name]) for name in ("a", "b", "D_c")] == pytest.approx([0.013, 0.026, 0.42e-6], rel=1e-2)
    said = CliRunner().invoke(app, ["infer", str(tmp_path / "steps.toml"), "--out", str(tmp_path / "other")])
    assert said.exit_code != 0 and "cma_es" in " ".join(said.output.split())
