"""What instruments read is the exact wave at the time it is labelled with, to second order in the step."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, HOMALITE, case, slip_weakening, strike_slip, unstressed

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError, read_case, simulate
from ruptfx.case import parse_case
from ruptfx.readings.filter import low_pass
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.readings.instruments.strain_gauge import StrainGauge
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.recording.sampling import Samples

pytestmark = pytest.mark.fem

SIZE, AMPLITUDE = 8e-3, 1e-9
K = np.pi / SIZE
POINT = [2.9e-3, 3.3e-3]
ROSETTE = {"kind": "strain_gauge", "name": "rosette", "interval": 1.1e-7, "point": POINT, "length": 2e-3,
           "angles": [0.0, 0.8, 2.0]}  # fmt: skip
TABLES: list[dict[str, Any]] = [
    {"kind": "receiver", "name": "point", "interval": 1.1e-7, "point": POINT},
    {"kind": "velocimeter", "name": "pair", "interval": 1.1e-7, "point": POINT, "relative_to": [2.9e-3, -1.3e-3],
     "direction": [3.0, 4.0]},
    {"kind": "load_cell", "name": "free", "interval": 1.1e-7, "edge": "upper.right"},
    ROSETTE,
]  # fmt: skip


def mode(x: Any, y: Any) -> np.ndarray:
    """Of a free rectangle (Lame): omega = sqrt(2) c_s k, see test_waves."""
    return AMPLITUDE * np.stack([np.cos(K * x) * np.sin(K * y), -np.sin(K * x) * np.cos(K * y)], axis=-1)


def sampled(step: float) -> tuple[dict[str, dict[str, np.ndarray]], np.ndarray, float, float]:
    """Readings by instrument and channel, times, and frequency of the mode, exact and of leapfrog steps."""
    free = case({
        "order": 6, "faults.main.contact": COMPLIANT, "instruments": TABLES, "stepper.time_step": step,
        "mesh": {"kind": "two_plates", "length": SIZE, "height": SIZE, "element_size": 2e-3},
    })  # fmt: skip
    model = Model(free)
    motion, state = free.stepper.bind(model), model.initial_state()
    samples = Samples(model, motion.dt, lambda points: np.tile([0.0, -6e6, 1e6], (len(points), 1)))
    state.displacement[:] = mode(*model.coordinates.T).ravel()
    samples.observe(state)
    while state.fault_time < free.duration:
        motion.step(state)
        samples.observe(state)
    omega = np.sqrt(2) * model.wave_speeds().c_s * K
    found, names = {}, {each.name: [channel.name for channel in channels] for each, channels in samples.instruments}
    for name, moments, values in samples.gather():
        times = moments
        found[name] = dict(zip(names[name], values, strict=True))
    # sin(omega' dt / 2) = omega dt / 2: with it no error of the steps is left, only that of the samples.
    return found, times, omega, 2 / step * np.arcsin(0.5 * omega * step)


def test_an_exact_wave() -> None:
    """Linear between times dt apart, a cosine is off by (omega dt)^2 / 8 at most; a label half a step off would be
    omega dt / 2 off, ten times as much."""
    errors = []
    for step in (5e-8, 2.5e-8):
        found, times, omega, discrete = sampled(step)
        u, v = np.cos(discrete * times), -omega * np.sin(discrete * times)
        here, below = mode(*np.array(POINT)), mode(2.9e-3, -1.3e-3)
        x, y = POINT
        strain = -AMPLITUDE * K * np.sin(K * x) * np.sin(K * y)  # xx; yy is its negative, xy vanishes
        shear = HOMALITE["young_modulus"] / 2 / 1.35
        point, pair = found["point"], found["pair"]["velocity"]
        compared = [
            (point["displacement_x"], here[0] * u, here[0]), (point["displacement_y"], here[1] * u, here[1]),
            (point["velocity_x"], here[0] * v, here[0] * omega), (point["velocity_y"], here[1] * v, here[1] * omega),
            (point["strain_xx"], strain * u, strain), (point["strain_yy"], -strain * u, strain),
            (point["strain_xy"], 0 * u, strain),
            (point["stress_xx"], 2 * shear * strain * u, 2 * shear * strain),
            (point["stress_yy"] + 6e6, -2 * shear * strain * u, 2 * shear * strain),
            (point["stress_xy"] - 1e6, 0 * u, 2 * shear * strain),
            (pair, (here - below) @ [0.6, 0.8] * v, (here - below) @ [0.6, 0.8] * omega),
        ]  # fmt: skip
        bound = (omega * step) ** 2 / 8
        assert bound < omega * step / 2 / 10
        for number, (values, exact, size) in enumerate(compared):
            # Elements of order 6, a twelfth of a wavelength and smaller, add 1e-4 at most to strains.
            assert np.abs(values - exact).max() < (1.02 * bound + 1e-4) * abs(size), number
        errors.append(np.abs(point["velocity_x"] - here[0] * v).max())
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.2)


def test_a_gauge_averages_over_its_length() -> None:
    """The mean of the strain along a line is the relative displacement of its ends over its length; the three of the
    rosette give the tensor of a field that is nearly linear."""
    found, times, _, discrete = sampled(2.5e-8)
    for number, angle in enumerate(ROSETTE["angles"]):
        along = np.array([np.cos(angle), np.sin(angle)])
        ends = [mode(*(np.array(POINT) + sign * 1e-3 * along)) for sign in (1, -1)]
        exact = (ends[0] - ends[1]) @ along / 2e-3
        values = found["rosette"][f"extension_{number + 1}"]
        assert values == pytest.approx(exact * np.cos(discrete * times), abs=2e-3 * AMPLITUDE * K)
    tensor = [found["rosette"][f"strain_{label}"] for label in ("xx", "yy", "xy")]
    point = [found["point"][f"strain_{label}"] for label in ("xx", "yy", "xy")]
    # A length l smooths a wave of wave number k by 1 - (k l)^2 / 24 = 0.974 along x or y.
    np.testing.assert_allclose(tensor, point, atol=0.05 * AMPLITUDE * K)


@pytest.mark.parametrize("length", [None, 1e-3])
def test_a_rosette_has_the_tensor_of_a_uniform_strain(length: float | None) -> None:
    """u = (x + 4 y, -x - 2 y) 1e-6: xx = 1e-6, yy = -2e-6, xy = 1.5e-6; an extension is n (e n)."""
    model = Model(case({"order": 2}))
    angles, strain = [0.2, 1.1, 2.5], np.array([[1.0, 1.5], [1.5, -2.0]]) * 1e-6
    gauge = StrainGauge(name="rosette", interval=1e-6, point=[5.3e-3, 2.2e-3], angles=angles, length=length)
    field = (model.coordinates @ (np.array([[1.0, 4.0], [-1.0, -2.0]]) * 1e-6).T).ravel()
    readings = ModelReadings(model, lambda points: np.zeros((len(points), 3)))
    found = {channel.name: sum(float(share.weights @ field[share.places]) for share in channel.shares)
             for channel in gauge.channels(readings, "instruments.0")}  # fmt: skip
    directions = [np.array([np.cos(angle), np.sin(angle)]) for angle in angles]
    expected = {f"extension_{number}": n @ strain @ n for number, n in enumerate(directions, 1)}
    expected |= {"strain_xx": 1e-6, "strain_yy": -2e-6, "strain_xy": 1.5e-6}
    assert found == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("axes, labels", [
    (None, "xy"), ([[2.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "xz"), ([[0.0, 1.0, 0.0], [0.0, 0.0, 3.0]], "yz"),
    ([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]], "12"),
    ([[3.0, 4.0, 0.0], [-4.0, 3.0, 0.0]], "12"),
])  # fmt: skip
@pytest.mark.parametrize("length", [None, 1e-3])
def test_a_rosette_on_any_face_of_a_solid(axes: Any, labels: str, length: float | None) -> None:
    """A uniform strain of six components: an extension is n (e n), and the tensor is that along the axes."""
    model = Model(parse_case(strike_slip({"order": 1, "mesh.element_size": 2e-3})))
    gradient = 1e-6 * np.array([[1.0, 4.0, -2.0], [-1.0, -2.0, 0.5], [3.0, 1.5, 0.7]])
    strain, angles = 0.5 * (gradient + gradient.T), [0.2, 1.1, 2.5]
    gauge = StrainGauge(name="rosette", interval=1e-6, point=[0.5e-3, 0.7e-3, -2.5e-3], angles=angles,
                        length=length, axes=axes)  # fmt: skip
    gauge.check("instruments.0", "solid", "xyz")
    readings = ModelReadings(model, lambda points: np.zeros((len(points), 6)))
    field = (model.coordinates @ gradient.T).ravel()
    found = {channel.name: sum(float(share.weights @ field[share.places]) for share in channel.shares)
             for channel in gauge.channels(readings, "instruments.0")}  # fmt: skip
    first, second = (np.array(each) / np.linalg.norm(each) for each in axes or np.eye(3)[:2])
    grids = [np.cos(angle) * first + np.sin(angle) * second for angle in angles]
    expected = {f"extension_{number}": n @ strain @ n for number, n in enumerate(grids, 1)}
    a, b = labels
    expected |= {f"strain_{a}{a}": first @ strain @ first, f"strain_{b}{b}": second @ strain @ second,
                 f"strain_{a}{b}": first @ strain @ second}  # fmt: skip
    assert found == pytest.approx(expected, abs=1e-14)
    with pytest.raises(ValueError, match=facts(r"instruments\.0\.axes: .*plane = 'strain'.*remove axes")):
        StrainGauge(name="g", interval=1e-6, point=[0.0, 0.0], axes=axes or np.eye(3)[:2].tolist()).check(
            "instruments.0", "strain", "xy"
        )


def test_a_free_edge_carries_nothing() -> None:
    """K u + M a of nodes on which nothing acts is zero at the times of the forces, whatever the waves."""
    found, _, omega, _ = sampled(5e-8)
    model = Model(case({"order": 6, "mesh.length": SIZE, "mesh.height": SIZE}))
    right = np.isclose(model.coordinates[:, 0], SIZE) & (model.coordinates[:, 1] >= 0)
    inertia = omega**2 * AMPLITUDE * model.mass.reshape(-1, 2)[right, 0].sum()
    free = found["free"]["force_x"]
    assert inertia > 0.1
    assert np.abs(free[1:]).max() < 1e-6 * inertia


def test_force_times_velocity_is_the_work(tmp_path: Any) -> None:
    """Of a driven edge: with samples at every step the sum of force, mean velocity and step is what energy.csv has."""
    step = 5e-8
    driven = case({
        "duration": 4e-6, "stepper.time_step": step, "output.interface_interval": 4e-6,
        "boundaries": [{"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 2.0, "ramp": 1e-6}],
        "instruments": [{"kind": "load_cell", "name": "cell", "interval": step, "edge": "upper.top"}],
    })  # fmt: skip
    with simulate(driven, tmp_path / "run", progress=False) as record:
        force = record.instruments["cell"].force_x.values[:80]
        # The velocity half a step before and after each time; the first force acts for half a step.
        half = 2.0 * np.minimum((np.arange(81) - 0.5) * step / 1e-6, 1.0)
        mean = 0.5 * (half[:-1] + half[1:])
        mean[0], force = 0.0, force
        work = float(record.energy.boundary_work[-1])
        assert float(record.energy.time[-1]) == pytest.approx(4e-6 + 0.5 * step)
        later = float(record.instruments["cell"].force_x[80]) * 2.0 * step
        assert work > 1e-3
        assert force @ mean * step + later == pytest.approx(work, rel=1e-2)


@pytest.mark.parametrize("step", [1e-3, 0.05])
def test_half_of_the_power_passes_at_the_bandwidth(step: float) -> None:
    """One pole: a sine of that frequency comes out with 1 / sqrt(2) of its amplitude, an eighth of a period late. Taken
    as linear over steps of a 20th of the period the input loses 1 - (2 pi / 20)^2 / 12 of it."""
    constant, time = np.array([0.5 / np.pi]), step * np.arange(int(8 / step))  # 1 Hz
    signal, smooth, found = np.sin(2 * np.pi * time), np.zeros(1), [0.0]
    for before, now in pairwise(signal):
        smooth = low_pass(np.array([before]), np.array([now]), smooth, step, constant)
        found.append(float(smooth[0]))
    late = time > 6
    exact = np.sqrt(0.5) * np.sin(2 * np.pi * time - np.pi / 4)
    assert np.abs(np.array(found) - exact)[late].max() < (2 * np.pi * step) ** 2 / 12 + 1e-6
    assert low_pass(np.zeros(1), np.ones(1), np.zeros(1), step, np.zeros(1)) == 1.0


@pytest.mark.parametrize("bandwidth", [1e6, 2e6])
def test_the_bandwidth_of_an_instrument_is_that_of_its_filter(bandwidth: float) -> None:
    """A sine at the bandwidth comes out of the readings of a receiver with 1 / sqrt(2) of its amplitude: 0.447 of it
    with twice the time constant. Steps of a 100th of the period lose (2 pi / 100)^2 / 12 = 3e-4 of the input."""
    table = {"kind": "receiver", "interval": 2e-7, "point": [5.3e-3, 2.2e-3], "fields": ["velocity"]}
    filtered = case({"order": 2, "instruments": [{**table, "name": "a", "bandwidth": bandwidth}]})
    buffer = Samples(Model(filtered), 1e-8, unstressed)._buffers["velocity"]
    found, phase = [], 2 * np.pi * np.arange(800) / 100
    for number, angle in enumerate(phase):
        buffer.advance(number * 0.01 / bandwidth, np.full(2, np.sin(angle)))
        found.append(buffer.smooth.copy())
    # The last two periods, after 6 of them: what is left of the start is exp(-2 pi 6).
    assert np.abs(found[-200:]).max(axis=0) == pytest.approx([np.sqrt(0.5)] * 2, rel=1e-3)


@pytest.mark.parametrize("table,message", [
    ({"kind": "receiver", "point": [5e-3, 9e-3]}, r"instruments\.0\.point = \(0.005, 0.009\) m: is not inside"),
    ({"kind": "receiver", "point": [5e-3, 0.0]}, "'upper' and 'lower' meet there|'lower' and 'upper' meet there"),
    ({"kind": "velocimeter", "point": [5e-3, 1e-3], "direction": [1.0, 0.0], "relative_to": [9.0, 0.0]},
     r"instruments\.0\.relative_to = \(9, 0\) m: is not inside"),
    ({"kind": "strain_gauge", "point": [5e-3, 3.9e-3], "length": 1e-3, "angles": ["90 deg"]},
     r"instruments\.0\.length: the end = \(0.005, 0.0044\) m: is not inside"),
    ({"kind": "load_cell", "edge": "upper.rigth"}, r"instruments\.0\.edge = 'upper\.rigth': .*mean 'upper\.right'"),
    ({"kind": "fault_receiver", "position": 0.2}, r"instruments\.0\.position = 0\.2 m: beyond the interface"),
    ({"kind": "fault_receiver", "fault": "mian", "position": 0.0}, r"instruments\.0\.fault = 'mian': .*'main'"),
    ({"kind": "velocimeter", "point": [5e-3, 1e-3], "direction": [0.0, 0.0]}, "direction = .*must not be zero"),
    ({"kind": "strain_gauge", "point": [5e-3, 1e-3], "angles": ["0 deg", "90 deg", "180 deg"]}, "all three must"),
    ({"kind": "strain_gauge", "point": [5e-3, 1e-3], "axes": [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]}, "axes.*remove axes"),
])  # fmt: skip
def test_what_is_refused(table: dict[str, Any], message: str) -> None:
    with pytest.raises(RuptfxError, match=facts(message)):
        Samples(Model(case({"instruments": [{"name": "one", "interval": 1e-6, **table}]})), 1e-8, unstressed)


def test_at_an_interface(tmp_path: Any) -> None:
    """At a point of the interface and at the times of its records a receiver on it has what they have; the pair of
    velocimeters next to a split interface has the slip rate half a step away."""
    step = 5e-8
    table = slip_weakening({
        "duration": 3e-6, "stepper.time_step": step, "output.interface_interval": 5e-7, "instruments": [
            {"kind": "fault_receiver", "name": "fault", "interval": 5e-7, "position": 16e-3},
            {"kind": "velocimeter", "name": "pair", "interval": 5e-7, "point": [16e-3, 0.0], "body": "upper",
             "relative_to": [16e-3, 0.0], "relative_body": "lower", "direction": [1.0, 0.0]},
        ],
    })  # fmt: skip
    simulate(parse_case(table), tmp_path / "run", progress=False)
    with Record(tmp_path / "run") as record:
        there = record.interface.sel(position=16e-3, method="nearest")
        fault = record.instruments["fault"]
        np.testing.assert_allclose(fault.time, there.time, rtol=1e-9)
        for name in ("slip", "slip_rate", "shear_traction", "normal_stress", "slipped"):
            if name in there:
                # The record of the start is made before the first step, which knows the tractions there.
                np.testing.assert_allclose(fault[name][1:], there[name][1:], rtol=1e-9, atol=1e-15)
        assert float(fault.slip_rate[-1]) > 0.1
        assert record.instruments["pair"].velocity[2:].values == pytest.approx(fault.slip_rate[2:].values, rel=0.05)


def test_what_a_pressed_block_stands_on(tmp_path: Any) -> None:
    """The demo on coarser elements: the base carries what the platen (20 MPa on 60 mm) and the pusher (10 MPa on 20 mm)
    exert, as they ramp; the rosette on the axis of the block shears when it is pushed, and nothing slides."""
    path = Path(__file__).parents[2] / "demos" / "pressed_block.toml"
    coarse = read_case(path, ["mesh.element_size=10e-3", "order=3", "output.figures=false"])
    simulate(coarse, tmp_path / "run", progress=False)
    with Record(tmp_path / "run") as record:
        base = record.instruments["base"]
        # 100 N/m at the beginning: 1 kPa of initial stress on 100 mm.
        np.testing.assert_allclose(base.force_y, 100 + 1.2e6 * np.minimum(base.time, 1.0), rtol=1e-6, atol=0.1)
        np.testing.assert_allclose(base.force_x, -2e5 * np.maximum(base.time - 1.0, 0.0), rtol=1e-6, atol=1.0)
        rosette = record.instruments["rosette"]
        assert float(rosette.strain_yy[10]) < -2e-3 < 0 < float(rosette.strain_xx[10])
        assert abs(float(rosette.strain_xy[10])) < 1e-5 < float(rosette.strain_xy[20])  # symmetric until it is pushed
        assert float(np.abs(record.interface.slip).max()) == 0
