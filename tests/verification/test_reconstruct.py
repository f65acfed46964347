"""Reconstruction: impulse responses against runs, the posterior against a closed form, clocks, ranks, refusals."""

from __future__ import annotations

import json
import re
import signal
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import tomli_w
import xarray
from helpers.messages import facts
from helpers.small_cases import COMPLIANT, merged, slip_weakening, strike_slip
from typer.testing import CliRunner

from ruptfx.app.cli import app
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError

pytest.importorskip("dolfinx")

from ruptfx import read_case, reconstruct, simulate
from ruptfx.many_runs.reconstruction import needs
from ruptfx.many_runs.reconstruction.experiment import Experiment
from ruptfx.many_runs.reconstruction.figures import (
    FIGURES,
    draw_friction,
    draw_information,
    draw_slip_rate,
    front,
)
from ruptfx.many_runs.reconstruction.geometry import Geometry
from ruptfx.many_runs.reconstruction.law_fit import LawFit
from ruptfx.many_runs.reconstruction.posterior import Posterior, Prior, Rows, likeliest, stretched
from ruptfx.many_runs.reconstruction.result import Curves, Reconstruction, Surface
from ruptfx.many_runs.reconstruction.twin import Knots, Tractions, Twin
from ruptfx.platform import launch, memory
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.readings.misfits import Trace

pytestmark = pytest.mark.fem

GAUGES = [
    {"kind": "strain_gauge", "name": f"g{number}", "interval": 1e-7, "point": [x, 1.3e-3],
     "angles": ["45 deg"], "bandwidth": 1e6} for number, x in enumerate((10e-3, 16e-3, 22e-3))
]  # fmt: skip
BODY = {"kind": "velocimeter", "name": "body", "interval": 1e-7, "point": [13e-3, -1e-3], "direction": [1.0, 0.0]}
LOADED = [
    {"kind": "absorbing", "edge": "upper.right"},
    {"kind": "driven", "edge": "lower.left", "component": "x", "velocity": 0.4, "ramp": 3e-6},
]  # fmt: skip
TIMES = np.arange(3e-7, 8.9e-6, 3e-7)
PRIOR = {"amplitude": 0.5, "length": 4e-3, "time": 1.2e-6, "begin": 1e-6, "samples": 2}
STRAIN, SPEED = 2e-6, 4e-3


def specimen(**changes: Any) -> dict[str, Any]:
    return slip_weakening({"instruments": [*GAUGES, BODY], "boundaries": LOADED, **changes})


def traces(values: dict[str, np.ndarray], times: np.ndarray = TIMES) -> list[dict[str, Any]]:
    return [
        {"kind": "traces", "instrument": name, "times": times.tolist(), "sigma": SPEED if name == "body" else STRAIN,
         "data": {"velocity" if name == "body" else "extension_1": list(each)},
         "units": {"velocity": "m/s"} if name == "body" else {"extension_1": "1"}}
        for name, each in values.items()
    ]  # fmt: skip


def rows_of(case: Case) -> tuple[Rows, Twin]:
    """The data of a case with their impulse responses, and its bodies."""
    data = Experiment(case)
    assert case.reconstruction is not None
    twin = Twin(case, interval=data.interval, begin=case.reconstruction.begin, end=data.end)
    data.bind(twin.model)
    readings = twin.readings(data.requests)
    lags = [{clock: twin.lags(readings, number, clock) for clock in readings.sources(number)}
            for number in range(len(data.channels))]  # fmt: skip
    rows = data.rows(twin.knots, lambda number, phase: twin.kernel(readings, number, lags[number], phase),
                     twin.run(readings).samples)  # fmt: skip
    return rows, twin


@pytest.mark.parametrize("solid", [False, True])
def test_missing_samples_are_as_if_their_rows_were_removed(solid: bool) -> None:
    """Of one channel of the second sensor; mean, deviation and the likelihood of the prior."""
    case = solid_experiment()[0] if solid else experiment()[0]
    rows, twin = solid_experiment()[2:] if solid else rows_of(case)
    terms, lost = case.table()["objective"], [4, 5, 9]
    name = next(iter(terms[1]["data"]))
    terms[1]["data"][name] = [np.nan if number in lost else each for number, each in enumerate(terms[1]["data"][name])]
    gaps = case.changed("objective", terms)
    without, _ = rows_of(gaps)
    before = sum(len(each) for each in terms[0]["data"].values())
    wanted = rows.some(np.delete(np.arange(len(rows.values)), before + np.array(lost)))
    assert len(without.values) == len(rows.values) - 3
    positions = stretched(twin.geometry.locations, 3e-3, 2e-3 if solid else None)
    made, like = (Posterior(Prior.of_lengths(0.5, 3e-3, 1.2e-6, positions, twin.knots.times), each)
                  for each in (without, wanted))  # fmt: skip
    for attribute in ("mean", "fit"):
        size = np.abs(getattr(like, attribute)).max()
        np.testing.assert_allclose(getattr(made, attribute), getattr(like, attribute), rtol=0, atol=1e-10 * size)
    np.testing.assert_allclose(made.deviation(), like.deviation(), rtol=0, atol=1e-10)
    assert np.abs(made.deviation() - Posterior(made.prior, rows).deviation()).max() > 1e-6
    known = {"amplitude": None, "length": 3e-3, "time": 1.2e-6}
    both = [
        likeliest(known, each, twin.geometry.locations, twin.knots.times)["amplitude"] for each in (without, wanted)
    ]
    assert both[0] == pytest.approx(both[1], rel=1e-10)
    data = Experiment(gaps)
    data.bind(twin.model)
    notes = replace(synthetic(), channels=data.channels, fits=[each.values for each in data.channels]).notes()
    count = len(terms[1]["times"])
    assert [each.split(": ")[1] for each in notes] == [f"3 of {count} samples are missing"] and notes[0].startswith(
        terms[1]["instrument"]
    )


@cache
def solid_experiment() -> tuple[Case, np.ndarray, Rows, Twin]:
    """Case of a surface with the data of a random slip rate, which is returned in its columns, and the bodies."""
    times, sigma = np.arange(3e-7, 5.35e-6, 3e-7), 4e-3
    terms = [
        {"kind": "traces", "instrument": each["name"], "times": times.tolist(), "sigma": sigma,
         "data": {f"velocity_{axis}": [0.0] * len(times) for axis in "xyz"},
         "units": {f"velocity_{axis}": "m/s" for axis in "xyz"}} for each in SENSORS
    ]  # fmt: skip
    plain = parse_case(solid_specimen(objective=terms, reconstruction=SOLID_PRIOR))
    assert isinstance(plain, Case)
    data = Experiment(plain)
    twin = Twin(plain, interval=data.interval, begin=SOLID_PRIOR["begin"], end=data.end)
    data.bind(twin.model)
    random = np.random.default_rng(7)
    prior = Prior.of_lengths(0.5, 3e-3, 1.2e-6, stretched(twin.geometry.locations, 3e-3, 2e-3), twin.knots.times)
    slip_rate = prior.fields(random.normal(size=prior.size))
    readings = twin.readings(data.requests)
    samples = iter(twin.run(readings, slip_rate).samples)
    for term in terms:
        term["data"] = {name: list(next(samples).values + sigma * random.normal(size=len(times)))
                        for name in term["data"]}  # fmt: skip
    case = plain.changed("objective", terms)
    rows, _ = rows_of(case)
    return case, slip_rate, rows, twin


def test_posterior_of_a_surface_equals_the_closed_form() -> None:
    """Both components, and the part in a direction; a quarter of the data, so that dense matrices are small."""
    _, _, rows, twin = solid_experiment()
    geometry, times = twin.geometry, twin.knots.times
    rows = rows.some(np.arange(0, len(rows.values), 4))
    rows = replace(rows, values=np.random.default_rng(0).normal(size=len(rows.values)) * rows.sigma)
    x = geometry.locations / [3e-3, 2e-3]
    apart = np.sqrt(5) * np.hypot(*(x[:, None] - x).T)
    in_space = np.kron(np.eye(2), (1 + apart + apart**2 / 3) * np.exp(-apart))
    lengths = {"amplitude": 0.5, "length": 1.0, "time": 1.2e-6}
    mean, covariance = dense(rows, in_space, times, lengths)
    prior = Prior.of_lengths(0.5, 3e-3, 1.2e-6, stretched(geometry.locations, 3e-3, 2e-3), times, tail=0.0)
    made, shape = Posterior(prior, rows), (len(times), geometry.direction.size)
    np.testing.assert_allclose(prior.fields(made.mean), mean.reshape(shape), atol=1e-8)
    np.testing.assert_allclose(made.deviation() ** 2, np.diag(covariance).reshape(shape), atol=1e-8)
    # Along and up dip: the rake is 30 degrees, and the second tangent points down.
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    parts, points = covariance.reshape(shape[0], 2, -1, shape[0], 2, len(x)), range(len(x))
    wanted = np.array([[c * c * parts[t, 0, i, t, 0, i] + 2 * c * s * parts[t, 0, i, t, 1, i]
                        + s * s * parts[t, 1, i, t, 1, i] for i in points] for t in range(len(times))])  # fmt: skip
    directed = prior.of_columns(geometry.along)
    np.testing.assert_allclose(geometry.direction, np.tile([c, s], (len(x), 1)), atol=1e-12)
    np.testing.assert_allclose(made.deviation(prior=directed) ** 2, wanted, atol=1e-8)
    np.testing.assert_allclose(directed.deviation(), 0.5)


def test_bands_of_a_surface_hold_as_much_as_they_say() -> None:
    """40 random slip rates with noise of 2 %: 68 % within the deviation, of both components and along the direction."""
    _, _, rows, twin = solid_experiment()
    geometry, random = twin.geometry, np.random.default_rng(0)
    prior = Prior.of_lengths(1.0, 3e-3, 1.2e-6, stretched(geometry.locations, 3e-3, 2e-3), twin.knots.times)
    coefficients = random.normal(size=(40, prior.size))
    clean = coefficients @ replace(rows, sigma=np.ones(len(rows.values))).design(prior).T
    sigma = 0.02 * np.abs(clean).max()
    made = Posterior(prior, replace(rows, sigma=np.full(len(rows.values), sigma)))
    bands = made.deviation(), made.deviation(prior=prior.of_columns(geometry.along))
    assert np.median(bands[0]) < 0.5
    off = [prior.fields(made.solution(data + sigma * random.normal(size=len(data))) - truth)
           for data, truth in zip(clean, coefficients, strict=True)]  # fmt: skip
    for values, band in zip((np.array(off), geometry.along(np.array(off))), bands, strict=True):
        assert 0.64 < np.mean(np.abs(values) < band) < 0.72


@pytest.mark.slow
def test_slip_of_a_surface_is_reconstructed_within_its_deviation(tmp_path: Path) -> None:
    """By the command: two components of slip, maps at chosen times, tractions of runs, and the refusals of lines."""
    case, slip_rate, _, twin = solid_experiment()
    settings = {"points": [[0.0, 0.0, -1e-3], [2e-3, 0.0, -2e-3]], "map_times": [2e-6, 4e-6]}
    asked = case.changed("reconstruction", {**SOLID_PRIOR, **settings})
    (tmp_path / "case.toml").write_text(tomli_w.dumps(asked.table()))
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["reconstruct", str(tmp_path / "case.toml"), "--out", str(out), "--responses",
                                      str(tmp_path / "responses")])  # fmt: skip
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "summary.json").read_text())
    assert "% of the surface" in summary["verdict"] and 0 < summary["known_part"] <= 1 and not summary["notes"]
    assert len(summary["best_position"]) == 3 and summary["prior"]["dip_length"] == 2e-3
    truth, geometry = twin.geometry.split(slip_rate), twin.geometry
    with xarray.open_dataset(out / "reconstruction.nc", engine="h5netcdf") as made:
        for k in (0, 1):
            off = (truth[k] - made[f"slip_rate_{k + 1}"].values) / made[f"slip_rate_{k + 1}_deviation"].values
            assert 0.7 < np.sqrt(np.mean(off**2)) < 1.3  # some 25 independent values
        off = (geometry.along(slip_rate) - made.slip_rate.values) / made.slip_rate_deviation.values
        assert 0.7 < np.sqrt(np.mean(off**2)) < 1.3 and made.slip_rate.dims == ("time", "point")
        np.testing.assert_allclose(made.slip_rate, geometry.along(np.concatenate(
            [made.slip_rate_1.values, made.slip_rate_2.values], axis=1)), atol=1e-12)  # fmt: skip
        np.testing.assert_allclose(np.stack([made.x, made.y, made.z], axis=1), geometry.points, atol=1e-15)
        rates = np.concatenate([made.slip_rate_1.values, made.slip_rate_2.values], axis=1)
        ran = twin.run(twin.readings([]), rates)
        size = np.abs(ran.shear_traction).max()
        np.testing.assert_allclose(made.shear_traction, geometry.along(ran.shear_traction), atol=2e-2 * size)
        np.testing.assert_allclose(made.slip, geometry.along(ran.slip), atol=1e-12)
    assert all((out / f"{name}.png").stat().st_size > 1e4 for name in FIGURES)
    positive = reconstruct(case.changed("reconstruction.positive", True), tmp_path / "responses", progress=False)
    assert np.all(positive.samples >= -1e-12) and np.any(positive.mean < 0) and not positive.about["responses_computed"]
    assert "points = " in refused(case.changed("reconstruction.positions", [1e-3]))
    line, _, _ = experiment()
    for key, value in {"dip_length": 1e-3, "points": [[0.0, 0.0, 0.0]], "map_times": [1e-6]}.items():
        text = refused(line.changed(f"reconstruction.{key}", value))
        assert f"reconstruction.{key}" in text and "remove the key" in text


def test_a_mirrored_surface_and_other_units_give_the_mirrored_and_the_same_map() -> None:
    """Sensors, data and rake of the mirror image in the plane of y and z; data in mm/s and places in mm."""
    case, _, rows, twin = solid_experiment()
    lengths = {"amplitude": 0.5, "length": 3e-3, "time": 1.2e-6}

    def maps(rows: Rows, twin: Twin, side: float) -> tuple[np.ndarray, ...]:
        """Both components, and the mean and deviation in the direction of the shear stress, by the place of a point."""
        geometry, times = twin.geometry, twin.knots.times
        prior = Prior.of_lengths(**lengths, position=stretched(geometry.locations, 3e-3, 2e-3), times=times)
        made, order = Posterior(prior, rows), np.lexsort(np.round(geometry.points * [side, 1, 1], 9).T)
        fields = prior.fields(made.mean)
        parts = [
            *geometry.split(fields),
            geometry.along(fields),
            made.deviation(prior=prior.of_columns(geometry.along)),
        ]
        return tuple(each[:, order] for each in parts)

    base, table = maps(rows, twin, 1.0), case.table()
    terms, gauges = table["objective"], table["instruments"]
    mirrored = case.changed("faults.main.initial_stress.rake", 150.0)
    mirrored = mirrored.changed("instruments", [
        {**each, "point": [-each["point"][0], *each["point"][1:]]} for each in gauges
    ]).changed("objective", [
        {**each, "data": {**each["data"], "velocity_x": [-value for value in each["data"]["velocity_x"]]}}
        for each in terms
    ])  # fmt: skip
    image = maps(*rows_of(mirrored), -1.0)
    for sign, one, other in zip((-1, 1, 1, 1), base, image, strict=True):
        np.testing.assert_allclose(sign * other, one, rtol=0, atol=1e-8 * np.abs(one).max())
    scaled = case.changed("instruments", [
        {**each, "point": [f"{1e3 * x:.12g} mm" for x in each["point"]]} for each in gauges
    ]).changed("objective", [
        {**each, "sigma": f"{1e3 * each['sigma']:.12g} mm/s", "units": dict.fromkeys(each["units"], "mm/s"),
         "data": {name: (1e3 * np.array(values)).tolist() for name, values in each["data"].items()}} for each in terms
    ])  # fmt: skip
    for one, other in zip(base, maps(*rows_of(scaled), 1.0), strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-10 * np.abs(one).max())


@cache
def experiment() -> tuple[Case, np.ndarray, np.ndarray]:
    """Case with the data of a random slip rate, which is returned at its knots, and the slip at the last one."""
    names = [each["name"] for each in (*GAUGES, BODY)]
    plain = parse_case(specimen(objective=traces({name: np.zeros(len(TIMES)) for name in names}),
                                reconstruction=PRIOR))  # fmt: skip
    assert isinstance(plain, Case)
    data = Experiment(plain)
    twin = Twin(plain, interval=data.interval, begin=1e-6, end=data.end)
    data.bind(twin.model)
    random = np.random.default_rng(4)
    prior = Prior.of_lengths(0.5, 4e-3, 1.2e-6, twin.position, twin.knots.times)
    slip_rate = prior.fields(random.normal(size=prior.size))
    motion = twin.run(twin.readings(data.requests), slip_rate)
    noisy = {
        name: sample.values + each.sigma * random.normal(size=len(TIMES))
        for name, sample, each in zip(names, motion.samples, data.channels, strict=True)
    }
    return plain.changed("objective", traces(noisy)), slip_rate, motion.slip[-1]


SENSORS = [
    {"kind": "receiver", "name": f"s{number}", "interval": 1e-7, "point": point} for number, point in enumerate(
        [[x, side * 1e-3, z] for x in (-2.5e-3, 0.0, 2.5e-3) for side, z in ((1, -1e-3), (-1, -2.5e-3))])
]  # fmt: skip
BOX = {"kind": "box_with_fault", "fault_length": 8e-3, "fault_width": 4e-3, "element_size": 2e-3, "beyond": 2e-3,
       "distance": 4e-3}  # fmt: skip
SOLID_PRIOR = {"amplitude": 0.5, "length": 3e-3, "dip_length": 2e-3, "time": 1.2e-6, "begin": 6e-7, "samples": 2}


def solid_specimen(**changes: Any) -> dict[str, Any]:
    """A fault of 45 points that reaches the surface, six receivers beside it, with shear along strike and up dip."""
    return strike_slip({
        "duration": 5.4e-6, "mesh": BOX, "instruments": SENSORS, "faults.main.initial_stress.rake": 30.0,
        "faults.main.initial_stress.shear": 3e6,
        "boundaries": [{"kind": "absorbing", "edge": f"{side}.far"} for side in ("plus", "minus")], **changes,
    })  # fmt: skip


@pytest.mark.parametrize("plane, half", [("stress", False), ("strain", True), ("antiplane", False), ("solid", False)])
def test_impulse_responses_equal_runs_with_prescribed_slip(plane: str, half: bool) -> None:
    """Any slip rate, loads, damping, filters, and data between the steps; relative to the largest reading."""
    receiver = {"kind": "receiver", "name": "r", "interval": 1e-7, "point": [13e-3, 1e-3]}
    moved = "z" if plane == "antiplane" else "x"
    changes: dict[str, Any] = {
        "plane": plane, "damping": {"kelvin_voigt": {"fraction": 0.2}, "mass": 2e4},
        "instruments": [receiver] if plane == "antiplane" else [GAUGES[0], {**BODY, "point": [13e-3, 1e-3]}, receiver],
        "boundaries": [LOADED[0]] if half else [LOADED[0], {**LOADED[1], "component": moved}],
    }  # fmt: skip
    if half:
        changes["mesh"] = {"kind": "half_plate", "length": 32e-3, "height": 8e-3, "element_size": 2e-3}
    if plane == "solid":
        loaded = {"kind": "driven", "edge": "minus.left", "component": "y", "velocity": 0.4, "ramp": 3e-6}
        gauge = {**GAUGES[0], "point": [-1e-3, 1e-3, 0.0], "length": 1e-3}  # on the face of x and y
        below = {**GAUGES[0], "name": "below", "point": [-1e-3, 1e-3, -2e-3], "length": 1e-3,
                 "axes": [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]}  # fmt: skip
        case = parse_case(solid_specimen(damping=changes["damping"], duration=10e-6, boundaries=[loaded],
                                         instruments=[SENSORS[0], gauge, below]))  # fmt: skip
    else:
        case = parse_case(slip_weakening(changes))
    assert isinstance(case, Case)
    twin = Twin(case, interval=3e-7, begin=1e-6, end=9e-6)
    bodies = ModelReadings(twin.model, lambda points: np.ones((len(points), 6)))
    times = 1.1e-7 + TIMES
    requests = [
        Trace(channel, times, each.bandwidth)
        for number, each in enumerate(case.instruments) for channel in each.channels(bodies, f"instruments.{number}")
        if channel.offset == 0
    ]  # fmt: skip
    readings = twin.readings(requests)
    slip_rate = np.random.default_rng(0).normal(size=(twin.knots.count, twin.geometry.direction.size))
    still, moved = twin.run(readings), twin.run(readings, slip_rate)
    lag, phase = twin.knots.lags(times)
    assert len(requests) >= 4
    for number in range(len(requests)):
        lags = {clock: twin.lags(readings, number, clock) for clock in readings.sources(number)}
        kernel = twin.kernel(readings, number, lags, phase[0])
        summed = [sum(kernel[k - j] @ slip_rate[j] for j in range(min(k + 1, twin.knots.count))) for k in lag]
        change = moved.samples[number].values - still.samples[number].values
        np.testing.assert_allclose(np.array(summed, float), change, atol=1e-12 * np.abs(change).max(), rtol=0)
    # The integral of the slip rate until the last knot, and no slip without one.
    wanted = twin.knots.interval * (slip_rate.sum(axis=0) - 0.5 * slip_rate[-1])
    np.testing.assert_allclose(moved.slip[-1], wanted, rtol=1e-10, atol=1e-15)
    assert not np.any(still.slip) and twin.knots.times[-1] >= 9e-6
    np.testing.assert_allclose(twin.slip(slip_rate), moved.slip, rtol=1e-10, atol=1e-15)
    # Tractions of three modes of any history, relative to their largest change.
    shapes = np.random.default_rng(1).normal(size=(twin.geometry.direction.size, 3))
    rates = np.random.default_rng(2).normal(size=(2, twin.knots.count, 3))
    tractions = Tractions(still.shear_traction, still.normal_stress, twin.traction_kernels(still, shapes))
    shear, normal = tractions.of(rates)
    ran = twin.run(readings, rates[1] @ shapes.T)
    size = np.abs(ran.shear_traction - still.shear_traction).max()
    np.testing.assert_allclose(shear[1], ran.shear_traction, rtol=0, atol=1e-10 * size)
    np.testing.assert_allclose(normal[1], ran.normal_stress, rtol=0, atol=1e-8 * size)
    some = twin.geometry.columns(np.array([5]))
    np.testing.assert_allclose(tractions.of(rates, np.array([5]))[0], shear[..., some], rtol=1e-12)


def test_knots_are_hats_of_equal_steps() -> None:
    knots = Knots(dt=0.5, every=2, first=4, count=3)
    np.testing.assert_allclose(knots.times, [3.0, 4.0, 5.0])
    np.testing.assert_allclose(knots.hat, [0.25, 0.75, 0.75, 0.25])
    rates = knots.in_steps(np.array([[1.0], [2.0], [0.0]]))[:, 0]
    np.testing.assert_allclose(rates, [0, 0, 0, 0, 0.25, 0.75, 1.25, 1.75, 1.5, 0.5, 0, 0])


def dense(
    rows: Rows, position: np.ndarray, times: np.ndarray, lengths: dict[str, float], order: str = "5/2"
) -> tuple[np.ndarray, ...]:
    """Posterior mean and covariance of all slip rates by matrices of all points and knots.

    In place of positions there may be the correlations of columns.
    """

    def matern(points: np.ndarray, length: float) -> np.ndarray:
        r = np.abs(points[:, None] - points) / length
        if order == "3/2":
            return (1 + np.sqrt(3) * r) * np.exp(-np.sqrt(3) * r)
        return (1 + np.sqrt(5) * r + 5 * r**2 / 3) * np.exp(-np.sqrt(5) * r)

    knots, n = len(times), len(position)
    in_space = position if position.ndim == 2 else matern(position, lengths["length"])
    covariance = lengths["amplitude"] ** 2 * np.kron(matern(times, lengths["time"]), in_space)
    forward = np.zeros((len(rows.values), knots, n))
    for row, (kernel, lag) in enumerate(zip(rows.kernel, rows.lag, strict=True)):
        for knot in range(lag + 1):
            forward[row, knot] = rows.kernels[kernel, lag - knot]
    forward = forward.reshape(len(rows.values), -1)
    gain = covariance @ forward.T @ np.linalg.inv(forward @ covariance @ forward.T + np.diag(rows.sigma**2))
    return gain @ rows.values, covariance - gain @ forward @ covariance


def random_rows(random: np.random.Generator, knots: int, n: int, data: int) -> Rows:
    kernels = random.normal(size=(3, knots, n))
    lag = random.integers(0, knots, data)
    return Rows(kernels, random.integers(0, 3, data), lag, random.normal(size=data), random.uniform(0.5, 2.0, data))


@pytest.mark.parametrize("order", ["5/2", "3/2"])
def test_mean_and_deviation_equal_the_closed_form(order: str) -> None:
    random = np.random.default_rng(1)
    position, times = np.sort(random.uniform(0, 5, 9)), np.arange(1.0, 8.0)
    lengths = {"amplitude": 0.7, "length": 1.5, "time": 2.0}
    rows = random_rows(random, 7, 9, 25)
    mean, covariance = dense(rows, position, times, lengths, order)
    prior = Prior.of_lengths(**lengths, position=position, times=times, tail=0.0, order=order)
    made = Posterior(prior, rows)
    np.testing.assert_allclose(prior.fields(made.mean), mean.reshape(7, 9), atol=1e-8)
    np.testing.assert_allclose(made.deviation() ** 2, np.diag(covariance).reshape(7, 9), atol=1e-8)
    np.testing.assert_allclose(prior.deviation(), 0.7)
    weights = random.normal(size=(2, 7))
    summed = np.einsum("at,txsy,bs->axby", weights, covariance.reshape(7, 9, 7, 9), weights)
    np.testing.assert_allclose(made.deviation(weights) ** 2, [[summed[a, x, a, x] for x in range(9)] for a in (0, 1)],
                               atol=1e-8)  # fmt: skip
    drawn = prior.fields(made.samples(4000, 0)).reshape(4000, -1)
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=5 * 0.7 / np.sqrt(4000))
    np.testing.assert_allclose(np.cov(drawn.T), covariance, atol=5 * 0.49 * np.sqrt(2 / 4000))


def test_modes_leave_out_a_part_of_the_variance() -> None:
    position, times = np.linspace(0, 1, 60), np.linspace(0, 1, 50)
    full, less = (Prior.of_lengths(2.0, 0.2, 0.1, position, times, tail=tail) for tail in (0.0, 1e-4))
    assert less.size < full.size / 4
    assert 1 - 2e-4 < np.mean(less.deviation() ** 2) / 4.0 < 1


@pytest.mark.slow
def test_lengths_of_the_prior_maximise_the_likelihood() -> None:
    random = np.random.default_rng(3)
    position, times = np.linspace(0, 10, 20), np.arange(1.0, 31.0)
    prior = Prior.of_lengths(3.0, 1.2, 2.5, position, times)
    kernels = np.zeros((20, 30, 20))
    kernels[np.arange(20), 0, np.arange(20)] = 1.0  # each point is seen
    kernel, lag = (each.ravel() for each in np.meshgrid(np.arange(20), np.arange(30), indexing="ij"))
    truth = prior.fields(random.normal(size=prior.size))
    rows = Rows(kernels, kernel, lag, truth[lag, kernel] + 0.1 * random.normal(size=600), np.full(600, 0.1))
    known: dict[str, float | None] = {"amplitude": None, "length": None, "time": None}
    found = likeliest(known, rows, position, times)
    for name, value in {"amplitude": 3.0, "length": 1.2, "time": 2.5}.items():
        assert value / 1.5 < found[name] < 1.5 * value, name
    # No length is shorter than twice the distance of the points that are seen.
    uneven = Rows(kernels, kernel, lag, random.normal(size=600), np.full(600, 0.1))
    assert likeliest(known, uneven, position, times)["length"] >= 2 * 10 / 19 * (1 - 1e-9)
    assert likeliest(known | {"length": 2.0}, rows, position, times)["length"] == 2.0


def test_slip_is_reconstructed_within_its_deviation(tmp_path: Path) -> None:
    """By the command: its files, its numbers, and the responses, which later experiments with fewer data read."""
    case, slip_rate, slip = experiment()
    (tmp_path / "case.toml").write_text(tomli_w.dumps(case.table()))
    out, shared = tmp_path / "out", tmp_path / "responses"
    arguments = ["reconstruct", str(tmp_path / "case.toml"), "--out", str(out), "--responses", str(shared)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "summary.json").read_text())
    assert summary["verdict"] in result.output.replace("\n", " ") and summary["responses_computed"] == 5
    assert not summary["notes"]
    assert {path.name for path in out.iterdir()} >= {
        "case.toml",
        "reconstruction.nc",
        *(f"{name}.png" for name in FIGURES),
    }
    with xarray.open_dataset(out / "reconstruction.nc", engine="h5netcdf") as made:
        off = (slip_rate - made.slip_rate.values) / made.slip_rate_deviation.values
        assert 0.9 < np.sqrt(np.mean(off**2)) < 1.1 and made.slip_rate.units == "m/s"
        seen = made.information.values[-1] > 0.3
        last = (slip - made.slip.values[-1]) / made.slip_deviation.values[-1]
        assert seen.any() and np.sqrt(np.mean(last[seen] ** 2)) < 1.6
        assert made.slip_rate_samples.shape == (2, *slip_rate.shape)
        first = made.load()
    # A missing channel and missing samples; one response is damaged.
    damaged = sorted(shared.iterdir())[0]
    with h5py.File(damaged, "r+") as file:
        next(iter(file.values()))[5, 5] += 1.0
    fewer = case.changed("objective", [
        {**case.table()["objective"][0], "end": 6e-6}, *case.table()["objective"][2:],
    ])  # fmt: skip
    made = reconstruct(fewer, shared, progress=False)
    assert made.about["responses_read"] + made.about["responses_computed"] == 4
    assert made.about["responses_computed"] <= 1 and len(made.channels[0].times) < len(TIMES)
    assert np.all(made.deviation >= first.slip_rate_deviation.values * (1 - 1e-9))
    again = reconstruct(case, shared, progress=False)
    assert again.about["responses_read"] >= 4
    np.testing.assert_allclose(again.mean, first.slip_rate.values, atol=1e-12)


@pytest.mark.parametrize(("phase", "number"), [("lengths_of", signal.SIGTERM), ("solve", signal.SIGINT)])
def test_a_posterior_that_is_stopped_says_what_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, phase: str, number: signal.Signals
) -> None:
    """Ctrl-C and SIGTERM after the set-up, where no progress is reported: the message and the exit code of a run."""
    from ruptfx.many_runs.reconstruction import reconstruct as module

    experiment()[0].save(tmp_path)
    command = ["reconstruct", str(tmp_path / "case.toml"), "--out", str(tmp_path / "out"), "--responses",
               str(tmp_path / "responses"), "--quiet"]  # fmt: skip

    def stopped(*arguments: Any) -> None:
        del arguments
        signal.raise_signal(number)
        pytest.fail("the signal had no effect")

    before = signal.getsignal(signal.SIGTERM)
    # A shell that runs the tests in the background ignores SIGINT for all that it starts.
    inherited = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with monkeypatch.context() as patch:
            patch.setattr(module, phase, stopped)
            result = CliRunner().invoke(app, command)
    finally:
        signal.signal(signal.SIGINT, inherited)
    said = f"stopped; responses of {len(GAUGES) + 1} channels are kept in {tmp_path / 'responses'}, the same command"
    assert result.exit_code == 130 and said in " ".join(result.output.split()), result.output
    assert signal.getsignal(signal.SIGTERM) == before and not (tmp_path / "out/summary.json").exists()
    files = len(list((tmp_path / "responses").iterdir()))
    assert files == len(GAUGES) + 1 + (phase == "solve")  # tractions come after the lengths


def test_a_matlab_file_with_its_mapping_gives_the_same(tmp_path: Path) -> None:
    """A gauge in the second column of a matrix, of opposite sign, in microstrain; times in microseconds."""
    case, _, _ = experiment()
    term = case.table()["objective"][1]
    strains = np.stack([np.zeros(len(TIMES)), -1e6 * np.array(term["data"]["extension_1"])])
    with h5py.File(tmp_path / "event.mat", "w") as file:  # version 7.3: axes in reverse order
        file["strain"], file["t"] = strains, 1e6 * TIMES[None, :]
        for each in file.values():
            each.attrs["MATLAB_class"] = np.bytes_("double")
    columns = {"time": {"variable": "t", "unit": "us"},
               "45 deg": {"variable": "strain", "column": 2, "unit": "ue", "sign": -1}}  # fmt: skip
    entry = {"kind": "traces", "instrument": "g1", "file": "event.mat", "sigma": "2 ue", "map": columns}
    read = parse_case({**case.table(), "objective": [entry]}, tmp_path)
    assert isinstance(read, Case)
    of_numbers, of_file = (reconstruct(each, tmp_path / "responses", progress=False)
                           for each in (case.changed("objective", [term]), read))  # fmt: skip
    assert of_file.about["responses_computed"] == 0
    size = np.abs(of_numbers.mean).max()
    np.testing.assert_allclose(of_file.mean, of_numbers.mean, rtol=0, atol=1e-8 * size)
    np.testing.assert_allclose(of_file.deviation, of_numbers.deviation, rtol=1e-10)
    for sample in (np.nan, np.inf):  # the first is missing, the other one a mistake
        with h5py.File(tmp_path / "event.mat", "r+") as file:
            file["strain"][1, 3] = sample
        if np.isnan(sample):
            read = parse_case({**case.table(), "objective": [entry]}, tmp_path)
            assert isinstance(read, Case)
            (measured,) = read.objective[0].measured()
            assert (len(measured.values), measured.missing) == (len(TIMES) - 1, 1)
            continue
        with pytest.raises(CaseError, match=facts(r"45 deg.*1 of 29 samples.*index 3.*NaN")):
            parse_case({**case.table(), "objective": [entry]}, tmp_path)


def test_pictures_of_a_camera_are_data() -> None:
    """Displacements at one time know the slip until then; those of the run that made the data are within noise."""
    plain, slip_rate, slip = experiment()
    x, y = (each.ravel() for each in np.meshgrid(np.arange(9e-3, 24e-3, 1e-3), [6e-4, -6e-4]))
    sigma, random = 2e-8, np.random.default_rng(8)
    term = {"kind": "displacement_field", "time": TIMES[-1], "sigma": sigma, "x": x.tolist(), "y": y.tolist(),
            "displacement_x": [0.0] * len(x), "displacement_y": [0.0] * len(x)}  # fmt: skip
    case = plain.changed("reconstruction", {**PRIOR, "interval": 3e-7}).changed("objective", [term])
    data = Experiment(case)
    twin = Twin(case, interval=data.interval, begin=1e-6, end=data.end)
    data.bind(twin.model)
    moved = [float(each.values[0]) + sigma * random.normal() for each in twin.run(
        twin.readings(data.requests), slip_rate[: twin.knots.count]).samples]  # fmt: skip
    both = {name: [value for value, each in zip(moved, data.channels, strict=True) if each.name.startswith(name)]
            for name in ("displacement_x", "displacement_y")}  # fmt: skip
    assert [len(each) for each in both.values()] == 2 * [len(x)]
    made = reconstruct(case.changed("objective", [{**term, **both}]), progress=False)
    seen = (made.position > 11e-3) & (made.position < 22e-3)
    off = (slip[: len(seen)] - made.curves.slip[0, -1])[seen] / made.slip_deviation[-1, seen]
    assert made.known_range is None or np.ptp(made.known_range) > 0
    assert np.sqrt(np.mean(off**2)) < 1.6 and np.median(made.slip_deviation[-1, seen]) < 0.25 * np.std(slip)


def test_samples_may_be_positive() -> None:
    case, _, _ = experiment()
    made = reconstruct(case.changed("reconstruction.positive", True), progress=False)
    assert np.all(made.samples >= 0) and np.any(made.samples == 0) and np.any(made.mean < 0)
    assert made.about["positivity"] == "samples projected"


def test_clocks_and_offsets_are_unknowns() -> None:
    """Data of a gauge are 0.1 us late, another one has an offset of 20 microstrain."""
    case, _, _ = experiment()
    terms = case.table()["objective"]
    terms[0]["times"] = (np.array(terms[0]["times"]) + 1e-7).tolist()
    terms[1]["data"]["extension_1"] = (np.array(terms[1]["data"]["extension_1"]) + 20e-6).tolist()
    terms[0]["end"] = 8.8e-6
    keys = {"objective.0.time_shift": 2e-7, "objective.1.offset": 5e-5}
    unknowns = [{"key": key, "shape": "number", "sigma": sigma} for key, sigma in keys.items()]
    made = reconstruct(case.changed("objective", terms).changed("unknowns", unknowns), progress=False)
    for key, wanted in {"objective.0.time_shift": -1e-7, "objective.1.offset": 2e-5}.items():
        change, deviation, _ = made.unknowns[key]
        assert abs(change - wanted) < 3 * deviation < 3 * keys[key], key
    assert np.all(made.misfits < 1.5)
    plain = reconstruct(case.changed("objective", terms), progress=False)
    assert plain.misfits[1] > 2 * made.misfits[1]


@pytest.mark.slow
@pytest.mark.parametrize("solid", [False, True])
def test_two_ranks_give_the_same(tmp_path: Path, solid: bool) -> None:
    case = solid_experiment()[0] if solid else experiment()[0]
    (tmp_path / "case.toml").write_text(tomli_w.dumps(case.table()))
    results = []
    for ranks in (1, 2):
        out = tmp_path / f"out{ranks}"
        arguments = ["reconstruct", str(tmp_path / "case.toml"), "--out", str(out), "--quiet", "--responses",
                     str(tmp_path / f"responses{ranks}")]  # fmt: skip
        assert launch.run_on(ranks, arguments) == 0
        with xarray.open_dataset(out / "reconstruction.nc", engine="h5netcdf") as made:
            results.append(made.load())
    for name in ("slip_rate", "slip_rate_deviation", "slip", "shear_traction", "shear_traction_deviation"):
        one, two = (each[name].values for each in results)
        np.testing.assert_allclose(two, one, atol=1e-10 * np.abs(one).max(), rtol=0, err_msg=name)


def test_more_data_than_coefficients_give_the_same_posterior() -> None:
    """In the space of the coefficients, of the data, and from a stored factor."""
    random = np.random.default_rng(6)
    position, times = np.linspace(0, 5, 6), np.arange(1.0, 6.0)
    lengths = {"amplitude": 0.7, "length": 4.0, "time": 3.0}
    rows = random_rows(random, 5, 6, 60)
    mean, covariance = dense(rows, position, times, lengths)
    prior = Prior.of_lengths(**lengths, position=position, times=times, tail=0.0)
    made = Posterior(prior, rows)
    assert len(made.factor) == prior.size == 30
    np.testing.assert_allclose(prior.fields(made.mean), mean.reshape(5, 6), atol=1e-8)
    np.testing.assert_allclose(made.deviation() ** 2, np.diag(covariance).reshape(5, 6), atol=1e-8)
    drawn = prior.fields(made.samples(4000, 0)).reshape(4000, -1)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, atol=5 * 0.49 * np.sqrt(2 / 4000))
    np.testing.assert_allclose(made.fit, rows.sigma * (rows.design(prior) @ made.mean), atol=1e-10)
    other = replace(rows, values=random.normal(size=60))
    np.testing.assert_allclose(Posterior(prior, other, factor=made.factor).mean, Posterior(prior, other).mean,
                               atol=1e-12)  # fmt: skip
    # A further unknown, as a mode of the slip rate that no prior has.
    columns = random.normal(size=(60, 1))
    both = Posterior(prior, rows, columns)
    full = np.hstack([rows.design(prior), columns / rows.sigma[:, None]])
    inverse = np.linalg.inv(full.T @ full + np.eye(31))
    np.testing.assert_allclose(both.extra, (inverse @ full.T @ (rows.values / rows.sigma))[-1:], atol=1e-10)
    np.testing.assert_allclose(both.extra_deviation**2, inverse[-1:, -1], atol=1e-10)


LAW = {"mu_s": 0.6, "mu_d": 0.3, "D_c": 4e-6}


def ruptured(element_size: float, **law: float) -> dict[str, Any]:
    """Plates with a smooth patch of high stress from which a rupture runs, and nine rosettes beside the interface."""
    shear = {"kind": "gaussian", "background": 3.0e6, "amplitude": 0.8e6, "center": 8e-3, "width": 4e-3}
    return slip_weakening({
        "duration": 16e-6, "mesh.height": 10e-3, "mesh.element_size": element_size,
        "faults.main.friction": {"kind": "linear_slip_weakening", **LAW, **law},
        "faults.main.initial_stress.shear": shear,
        "instruments": [
            {"kind": "strain_gauge", "name": f"g{number}", "interval": 3e-7, "point": [5e-3 + 2.6e-3 * number, 1e-3],
             "length": 1e-3, "angles": ["45 deg", "135 deg"], "bandwidth": 2e6} for number in range(9)
        ],
    })  # fmt: skip


@cache
def rosettes() -> tuple[str, np.ndarray, list[dict[str, np.ndarray]], float]:
    """Mode, times and signals of a run on a finer mesh, and noise of 2 %."""
    with (
        tempfile.TemporaryDirectory() as folder,
        simulate(parse_case(ruptured(5e-4)), Path(folder) / "data", progress=False) as data,
    ):
        times = data.instruments["g0"]["time"].values
        used = (times > 0) & (times <= 15.01e-6)
        whole = [{name: data.instruments[f"g{number}"][name].values for name in ("extension_1", "extension_2")}
                 for number in range(9)]  # fmt: skip
        sigma = 0.02 * max(float(np.abs(each - each[0]).max()) for both in whole for each in both.values())
        return data.summary["mode"], times[used], [{k: v[used] for k, v in both.items()} for both in whole], sigma


def of_rosettes(seed: int) -> dict[str, Any]:
    """Case of the reconstruction, which has other parameters of the law, with a realisation of the noise."""
    _, times, signals, sigma = rosettes()
    random, table = np.random.default_rng(seed), ruptured(1.6e-3, mu_s=0.7, mu_d=0.2, D_c=10e-6)
    table["objective"] = [
        {"kind": "traces", "instrument": f"g{number}", "times": times.tolist(), "sigma": sigma,
         "units": dict.fromkeys(both, "1"),
         "data": {name: (each + sigma * random.normal(size=len(times))).tolist() for name, each in both.items()}}
        for number, both in enumerate(signals)
    ]  # fmt: skip
    table["reconstruction"] = {"amplitude": 2.0, "length": 4e-3, "time": 1.5e-6}
    return table


@pytest.mark.slow
def test_intervals_contain_the_law_as_often_as_they_say(tmp_path: Path) -> None:
    """Ten realisations of the noise, three parameters: 20 of 30 within one deviation, and 29 within two."""
    apart = []
    for seed in range(10):
        law = reconstruct(parse_case(of_rosettes(seed)), tmp_path, progress=False).law
        assert law is not None
        apart += [abs(np.log(law.values[key] / wanted)) / law.deviations[key] for key, wanted in LAW.items()]
    assert 15 <= np.sum(np.array(apart) < 1) <= 26 and np.sum(np.array(apart) < 2) >= 27


@pytest.mark.slow
def test_law_of_a_rupture_is_within_its_intervals(tmp_path: Path) -> None:
    """Data from a finer mesh with noise of 2 %; the case of the reconstruction has other parameters of the law."""
    table = of_rosettes(0)
    (tmp_path / "twin.toml").write_text(tomli_w.dumps(table))
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["reconstruct", str(tmp_path / "twin.toml"), "--out", str(out), "--responses",
                                      str(tmp_path / "responses")])  # fmt: skip
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "summary.json").read_text())
    law = summary["law"]
    assert law["kind"] == "linear_slip_weakening" and law["parameters"].keys() == LAW.keys()
    for key, wanted in LAW.items():
        each = law["parameters"][key]
        factor = each["interval"][1] / each["value"]
        assert factor**-2 < each["value"] / wanted < factor**2 < 1.5, key
        assert each["resolved"] and f"{key} = " in summary["verdict"]
    fitted = read_case(out / "fitted.toml")
    assert isinstance(fitted, Case) and law["parameters"]["D_c"]["unit"] == "m"
    assert fitted.faults["main"].friction.D_c == pytest.approx(law["parameters"]["D_c"]["value"], rel=1e-5)
    again = simulate(fitted, tmp_path / "again", progress=False)
    assert again.summary["mode"] == rosettes()[0] == "crack"
    with xarray.open_dataset(out / "reconstruction.nc", engine="h5netcdf") as made:
        sliding = np.isfinite(made.friction_of_law.values)
        off = (made.friction_of_law - made.friction).values[sliding]
        assert sliding.sum() > 50 and np.sqrt(np.mean(off**2)) < 0.1


@pytest.mark.slow
def test_intervals_of_a_law_do_not_depend_on_order_units_and_direction(tmp_path: Path) -> None:
    """Gauges in reverse order, data in microstrain, and a mirror image: the same to the error of 240 samples."""
    names, angles = ("extension_1", "extension_2"), ["45 deg", "135 deg"]
    table = ruptured(1.6e-3)
    table |= {"duration": 13e-6, "instruments": table["instruments"][1:7]}
    data = simulate(parse_case(table), tmp_path / "data", progress=False)
    times, random, sigma = np.arange(3e-7, 12.8e-6, 3e-7), np.random.default_rng(2), 1e-5
    signals = {
        each["name"]: {name: np.interp(times, data.instruments[each["name"]]["time"].values,
                                       data.instruments[each["name"]][name].values)
                       + sigma * random.normal(size=len(times)) for name in names}
        for each in table["instruments"]
    }  # fmt: skip

    def fitted(changes: dict[str, Any], size: float, unit: str, gauges: list[str]) -> Any:
        terms = [
            {"kind": "traces", "instrument": gauge, "times": times.tolist(),
             "sigma": f"{sigma / size:g} {unit}" if unit else sigma, "units": dict.fromkeys(names, unit or "1"),
             "data": {name: (each / size).tolist() for name, each in signals[gauge].items()}} for gauge in gauges
        ]  # fmt: skip
        prior = {"amplitude": 2.0, "length": 4e-3, "time": 1.5e-6, "samples": 2}
        case = merged({**table, "objective": terms, "reconstruction": prior}, changes)
        return reconstruct(parse_case(case), tmp_path / "responses", progress=False).law

    length, order = 32e-3, list(signals)
    mirrored = [{**each, "point": [length - each["point"][0], each["point"][1]], "angles": angles[::-1]}
                for each in table["instruments"]]  # fmt: skip
    stress = table["faults"]["main"]["initial_stress"]["shear"]
    stress = {**stress, "background": -stress["background"], "amplitude": -stress["amplitude"],
              "center": length - stress["center"]}  # fmt: skip
    base = fitted({}, 1.0, "", order)
    others = {
        "order": fitted({}, 1.0, "", order[::-1]), "units": fitted({}, 1e-6, "ue", order),
        "mirror": fitted({"instruments": mirrored, "faults.main.initial_stress.shear": stress}, 1.0, "", order),
    }  # fmt: skip
    for what, law in others.items():
        for key, deviation in base.deviations.items():
            apart = np.log(law.values[key] / base.values[key]) / deviation
            wider = law.deviations[key] / deviation
            assert abs(apart) < (1e-3 if what == "units" else 0.5), (what, key, apart)
            assert wider == pytest.approx(1.0, abs=1e-3 if what == "units" else 0.35), (what, key)
    assert base.rows == others["units"].rows and base.values.keys() == LAW.keys()


def synthetic() -> Reconstruction:
    """A front at 1 m/s that is known for positions from 2 to 8 m."""
    position, times = np.linspace(0, 10, 21), np.arange(1.0, 11.0)
    mean = np.exp(-((times[:, None] - position) ** 2))
    known = np.abs(position - 5) <= 3
    deviation = np.where(known, 0.1, 0.9) * np.ones((10, 1))
    slip = np.cumsum(mean, axis=0)
    traction = 3.0 - 2.0 * np.minimum(slip / 0.5, 1.0)
    both = [np.stack([each, each]) for each in (slip, traction, np.full_like(slip, 5.0))]
    fields = mean, deviation, np.ones((10, 21)), deviation, mean[None], Curves(*both)
    return Reconstruction(position, times, *fields, [], [], {}, {"amplitude": 1.0, "length": 1.0, "time": 1.0})


def test_numbers_of_a_known_front() -> None:
    made = synthetic()
    assert made.known_range == (2.0, 8.0)
    np.testing.assert_allclose(made.known, np.where(np.abs(made.position - 5) <= 3, 0.99, 1 - 0.81))
    assert made.peak == (1.0, 0.1)
    places, when = front(made)
    np.testing.assert_array_equal(places, made.position[(made.position >= 2) & (made.position <= 8)])
    # exp(-(t - x)^2) is below a fifth until 1.27 before the front.
    np.testing.assert_array_equal(
        when, [max(t for t in made.times if t < x - 1.268) if x > 2.268 else 1.0 for x in places]
    )
    # Traction falls linearly from 3 to 1 within 0.5 of slip; the work above 1 is half of 2 times 0.5, in coarse steps.
    work = made.curves.breakdown(made.mean[None], 1.0)[0, 10]
    slip, traction = made.curves.slip[0, :, 10], made.curves.shear_traction[0, :, 10]
    assert work == pytest.approx(np.sum((traction - 1.0) * made.mean[:, 10]))
    assert np.ptp(slip) > 0.5


def test_figures_show_the_numbers() -> None:
    made = synthetic()
    top, below, _ = draw_information(made).axes
    np.testing.assert_allclose(top.lines[0].get_ydata(), made.known)
    (mesh,) = below.collections
    np.testing.assert_allclose(np.asarray(mesh.get_array()).reshape(10, 21), made.information)
    left, right = draw_slip_rate(made).axes[:2]
    for ax, values in ((left, made.mean), (right, made.deviation)):
        np.testing.assert_allclose(np.asarray(ax.collections[0].get_array()).reshape(10, 21), values)
    np.testing.assert_allclose(left.lines[0].get_xdata(), front(made)[0])
    traction, *others = draw_friction(made).axes
    place = made.places[0]
    curve = next(line for line in traction.lines if line.get_label() == "mean")
    np.testing.assert_allclose(curve.get_ydata(), np.abs(made.curves.shear_traction[0, :, place]))
    assert len(others) == 2 * len(made.places) - 1
    law = LawFit("coulomb", {}, {}, {}, [], 1.0, 0.0, 10, np.array([place]), np.full((10, 1), 0.5))
    (legend,) = draw_friction(made).legends
    assert [text.get_text() for text in legend.texts] == ["mean", "intervals of 68 %"]
    (legend,) = draw_friction(replace(made, law=law)).legends
    assert [text.get_text() for text in legend.texts][-1] == "coulomb, fitted, while it slides"
    assert all(2.0 <= made.position[each] <= 8.0 for each in made.places[1:-1])


def test_maps_of_a_surface_show_the_numbers() -> None:
    """Two components of 3 and 4 m/s at half of the points, of a grid; the part along the first tangent is known."""
    s, d = (each.ravel() for each in np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij"))
    points = np.stack([s, 0 * s, -d], axis=1)
    geometry = Geometry(points, s, d, np.ones(20), np.tile([1.0, 0.0], (20, 1)))
    times, slips = np.arange(1.0, 5.0), np.where((s < 2), 1.0, 0.0)
    both = np.array([np.outer(times / 4, 3 * slips), np.outer(times / 4, 4 * slips)])
    deviation = np.where(d < 2, 0.1, 0.9) * np.ones((4, 1))
    curves = Curves(*(np.stack([each, each]) for each in (np.cumsum(both[0], axis=0), 1 + both[0], 2 + both[0])))
    surface = Surface(geometry, both, np.array([deviation, deviation]), [2.1, 3.9])
    made = Reconstruction(s, times, both[0], deviation, np.ones((4, 20)), deviation, both[:1], curves, [], [], {},
                          {"amplitude": 1.0}, surface=surface)  # fmt: skip
    assert made.known_part == 0.5 and made.extent == "on 50 % of the surface"
    assert made.place(5) == "(1 m, 0 m, -1 m)" and made.peak == (3.0, 0.1)
    assert replace(surface, map_times=None).knots(times, both[0].max(axis=1)) == [0, 1, 2, 3]
    maps = [ax for ax in draw_slip_rate(made).axes if ax.get_ylim() == (3.0, 0.0)]
    assert len(maps) == 4 and [ax.get_title(loc="right") for ax in maps[::2]] == ["2 s", "4 s"]
    for ax, values in zip(maps, (2.5 * slips, deviation[1], 5 * slips, deviation[3]), strict=True):
        np.testing.assert_allclose(np.asarray(ax.collections[0].get_array()).reshape(4, 5), values.reshape(5, 4).T)
    (ax, _) = draw_information(made).axes
    known = np.where(d < 2, 1 - 0.01, 1 - 0.81)
    np.testing.assert_allclose(np.asarray(ax.collections[0].get_array()).reshape(4, 5), known.reshape(5, 4).T)
    # Turned by 90 degrees the part in the direction is that along the second tangent.
    turned = replace(geometry, direction=np.tile([0.0, 1.0], (20, 1)))
    np.testing.assert_allclose(turned.along(np.concatenate(both, axis=1)), both[1])
    back = turned.without_reverse(np.concatenate([both[0], -both[1]], axis=1), 1.0)
    np.testing.assert_allclose(turned.split(back), [both[0], 0 * both[1]])


def refused(case: Case) -> str:
    with pytest.raises(CaseError) as caught:
        reconstruct(case, progress=False)
    return str(caught.value)


def test_refusals_name_keys_and_remedies() -> None:
    case, _, _ = experiment()
    terms = case.table()["objective"]
    early = [terms[0], {**terms[1], "end": 2e-6}, {**terms[2], "begin": 4e-6}]
    text = refused(case.changed("objective", early))
    assert all(each in text for each in ("objective.2.times", "objective.1", "time_shift"))
    blind = [{**terms[3], "end": 1.25e-6}, *terms[:3]]
    far = case.changed("mesh.height", 16e-3).changed("instruments.3.point", [31e-3, 15e-3])
    text = refused(far.changed("objective", blind))
    assert "objective.0: 'body, velocity'" in text and "channels" in text
    late = [{**terms[0], "times": (TIMES + 5e-6).tolist()}]
    assert "objective.0.times" in refused(case.changed("objective", late))
    irregular = [{**terms[0], "times": (TIMES + 1e-8 * np.sin(TIMES * 1e9)).tolist()}]
    assert "reconstruction.interval" in refused(case.changed("objective", irregular))
    assert "objective" in refused(case.changed("objective", []))
    assert "final_slip" in refused(case.changed("objective", [{"kind": "final_slip", "sigma": 1e-6}]))
    assert "stepper.time_step" in refused(case.changed("stepper.time_step", 7e-8))
    assert "reconstruction.begin" in refused(case.changed("reconstruction.begin", 9.5e-6))
    assert "split_node" in refused(case.changed("faults.main.contact", COMPLIANT))
    unknown = [{"key": "objective.0.offset", "shape": "number"}]
    assert "unknowns.0" in refused(case.changed("unknowns", unknown))


def test_memory_and_runs_are_refused_before_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Responses, modes and runs: the message has the bound, and what it tells to set is accepted."""
    case, _, _, twin = solid_experiment()

    class RunError(Exception):
        pass

    def begins(*args: Any, **kwargs: Any) -> None:
        raise RunError

    monkeypatch.setattr(Twin, "run", begins)

    def accepted(case: Case) -> bool:
        with pytest.raises(RunError):
            reconstruct(case, progress=False)
        return True

    assert accepted(case)
    monkeypatch.setattr(memory, "available", lambda: 1e5)
    text = refused(case)
    steps, count = twin.knots.steps, len(twin.position)
    responses = 8 * 2 * count * 18 * (steps + twin.knots.count)  # two components, 18 channels
    assert f"objective: responses of 18 channels at {count} points and {steps} steps" in text
    assert f"take {responses / 1e9:.3g} GB, and 0.0001 GB are free" in text
    shorts: list[dict[str, Any]] = [{"length": "0.5 mm", "dip_length": dip_length} for dip_length in ("0.4 mm", None)]
    for short in shorts:
        with monkeypatch.context() as few:
            asked = case.changed("reconstruction", {**SOLID_PRIOR, **short})
            few.setattr(memory, "available", lambda: 1e9)
            few.setattr(needs, "MOST_RUNS", 50)
            text = refused(asked)
            assert "reconstruction.length = " in text and "at most 50 are made" in text
            remedy = dict(re.findall(r'(length|dip_length) = ("[^"]+")', text.split(";")[1]))
            assert ("dip_length" in remedy) == (short["dip_length"] is not None)
            longer = {key: json.loads(value) for key, value in remedy.items()}
            assert accepted(case.changed("reconstruction", {**SOLID_PRIOR, **short, **longer}))
    # Lengths of the likelihood are known after the responses; here memory is for fewer modes than they have.
    made = needs.Needs(2 * count, count, twin.knots.count, steps, 18, 18, 300, 1)
    monkeypatch.setattr(memory, "available", lambda: made.bytes(50, 14))
    assert case.reconstruction is not None
    likely = case.reconstruction.model_copy(update={"length": None, "dip_length": None, "time": None})
    needs.refuse_large(made, twin, likely)
    with pytest.raises(CaseError, match=facts(r"of the likelihood.*are free; set length = ")):
        needs.refuse_large(made, twin, likely, 5e-4, 1.2e-6)
