"""Displacement off the faults from their slip: Okada's half-space, and the bodies of the steps themselves."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.strike_cases import faulted
from typer.testing import CliRunner

from benchmarks._okada import surface_displacement
from benchmarks.bp3 import problem as dipping
from ruptfx.app.cli import app
from ruptfx.bodies.space.inside import Inside
from ruptfx.case import Case, read_case
from ruptfx.platform import fem
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate
from ruptfx.stepping.steppers.quasi_dynamic import QuasiDynamicMotion

pytestmark = pytest.mark.fem


def bound(case: Case) -> tuple[Model, QuasiDynamicMotion]:
    model = Model(case, fem.MPI.COMM_SELF)
    motion = case.stepper.bind(model)
    assert isinstance(motion, QuasiDynamicMotion)
    return model, motion


def test_section_that_repeats_gives_the_ground_above_a_vertical_fault() -> None:
    """Slip of 1 m at most on 12 km along strike and 8 km down dip, and its images every 30 km.

    Nodes 1 km apart in a box of 60 km.
    """
    case = faulted({
        "mesh.fault_depth": 12e3, "mesh.depth": 60e3, "mesh.distance": 60e3, "mesh.element_size": 2e3,
        "mesh.along_strike": {"length": 24e3, "period": 30e3, "points": 30, "creep": 0.0},
        "faults.main.friction.a": 0.02,
    })  # fmt: skip
    model, motion = bound(case)
    z, depth = model.faults[0].interface.position, model.faults[0].interface.across
    assert depth is not None

    def bell(z: np.ndarray, depth: np.ndarray) -> np.ndarray:
        inside = (np.abs(z) < 6e3) & (np.abs(depth - 5e3) < 4e3)
        return np.asarray(inside * np.cos(np.pi * z / 12e3) ** 2 * np.cos(np.pi * (depth - 5e3) / 8e3) ** 2)

    slip = np.column_stack([bell(z, depth), np.zeros(len(z))])
    strike, away = np.array([0.0, 4e3, -2e3, 0.0]), np.array([2e3, 3e3, 5e3, 8e3])
    points = np.column_stack([np.zeros(4), away, strike]).tolist()
    ours = motion.receivers(points, "points").by_slip(slip)
    # Okada: x along strike, y away from the fault, z up; there slip of the far side to the left is positive.
    half = 250.0
    centres = np.meshgrid(np.arange(-6e3 + half, 6e3, 2 * half), np.arange(1e3 + half, 9e3, 2 * half), indexing="ij")
    image = 30e3 * np.arange(-20, 21)
    x = (image[:, None] + centres[0].ravel()).ravel() - half
    bottom = np.tile(centres[1].ravel() + half, len(image))
    left = -np.tile(bell(*(each.ravel() for each in centres)), len(image))
    corner = x, np.zeros(len(x)), bottom
    theirs = surface_displacement(
        strike, away, corner, (2 * half, 2 * half), np.deg2rad(89.99), (left, np.zeros(len(x))), 0.25
    )
    theirs = theirs[:, [2, 1, 0]] * [-1.0, 1.0, 1.0]  # x of the section points down, and its z along strike
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=0.015 * np.abs(theirs).max())


def test_receivers_on_the_fault_of_a_section_move_by_half_of_its_slip() -> None:
    """Under driven edges as well, between the points, too; contact of 1e13 Pa/m adds less than 1e-6 m."""
    model, motion = bound(faulted())
    state, fault = model.initial_state(), model.faults[0]
    for _ in range(8):
        motion.step(state)
    at, fields = [3, 70, 130], state.faults["main"]
    receivers = motion.receivers(fault.interface.points[at].tolist(), "points")
    for answer, name in ((receivers.displacement, "slip"), (receivers.velocity, "slip_rate")):
        along, down = (fields[f"{name}_{number}"] for number in (1, 2))
        result = answer(state.time, np.column_stack([along, down]))
        assert np.abs(along[at]).min() > 1e-3 * np.abs(along).max()
        np.testing.assert_allclose(result[:, 2], along[at] / 2, rtol=1e-4)
        np.testing.assert_allclose(result[:, 0], down[at] / 2, rtol=0, atol=1e-4 * np.abs(along).max())


def test_receivers_of_a_plane_move_as_its_bodies() -> None:
    """A thrust that creeps and slips for three steps; between steps bodies move as the mean slip rate says."""
    model, motion = bound(dipping(60.0, 1.0, 4e3, 0.05))
    points = [[8e3, 0.0], [-16e3, 0.0], [3e3, -9e3]]
    places = [Inside(model, point, None, "points") for point in points]
    receivers, state = motion.receivers(points, "points"), model.initial_state()
    ends = []
    for _ in range(3):
        motion.step(state)
        moved = np.array([place.value(state.displacement)[0] for place in places])
        ends.append((state.time, state.faults["main"]["slip"].copy(), moved))
    for time, slip, moved in ends:
        result = receivers.displacement(time, slip[:, None])
        np.testing.assert_allclose(result, moved, rtol=0, atol=1e-7 * np.abs(moved).max())
    (begin, slip, before), (end, later, after) = ends[-2:]
    velocity = receivers.velocity(0.5 * (begin + end), (later - slip)[:, None] / (end - begin))
    np.testing.assert_allclose(velocity, (after - before) / (end - begin), rtol=0, atol=1e-6 * np.abs(velocity).max())


def in_file(path: Path) -> np.ndarray:
    """Return the numbers of a file, without its header."""
    return np.array([each.split() for each in path.read_text().splitlines() if each[0] not in "#t"], dtype=float)


def motion_of(path: Path, point: list[float]) -> np.ndarray:
    """Return the displacement of a point of the bodies of a run at the times of its record [m], along the axes."""
    with Record(path) as record:
        case = read_case(path / "case.toml")
        assert isinstance(case, Case)
        receivers, data = bound(case)[1].receivers([point], "point"), record.interfaces["main"]
        names = [name for name in ("slip", "slip_1", "slip_2") if name in data]
        slip = np.stack([data[name].values for name in names], axis=2)
        return np.array([receivers.displacement(t, s)[0] for t, s in zip(data["time"].values, slip, strict=True)])


@pytest.mark.slow
def test_stations_off_a_dipping_fault_move_up_and_over_it(tmp_path: Path) -> None:
    """Of a thrust that dips to the right, the plus side is the hanging wall, and x is away from the fault there."""
    case = dipping(60.0, 1.0, 4e3, 0.05)
    short = case.changed("duration", 3e8).changed("output", {"figures": False, "interface_steps": 1})
    simulate(short, out=tmp_path / "run")
    words = ["export", str(tmp_path / "run"), "--format", "seas", "--out", str(tmp_path / "out"), "--station", "10 km"]
    result = CliRunner().invoke(app, [*words, "--off-fault", "8 km", "--off-fault", "-16 km"])
    assert result.exit_code == 0, result.output
    for name, x in (("srfst_fn+08.dat", 8e3), ("srfst_fn-16.dat", -16e3)):
        moved = motion_of(tmp_path / "run", [x, 0.0])
        columns = in_file(tmp_path / "out" / name)[:, 1:3]
        np.testing.assert_allclose(columns, moved * [1, -1], rtol=0, atol=1e-5 * np.abs(moved).max())


@pytest.mark.slow
def test_export_of_stations_off_the_fault(tmp_path: Path) -> None:
    """Names, columns and numbers of the files, and refusals; the point beside the fault moves by half of its slip."""
    simulate(faulted({"duration": 12.0, "output": {"figures": False, "interface_steps": 4}}), out=tmp_path / "run")

    def export(*options: str) -> str:
        words = ["export", str(tmp_path / "run"), "--format", "seas", "--out", str(tmp_path / "out"), "--overwrite"]
        return " ".join(CliRunner().invoke(app, [*words, *options]).output.split())

    export("--station", "0 m, 1 m", "--off-fault", "1.25 m, 0 m, 2 m", "--off-fault", "0 m, 3 m, 0 m")
    assert {path.name for path in (tmp_path / "out").glob("blkst*")} == {
        "blkst_strk+001fn+000dp+002.dat", "blkst_strk+000fn+003dp+000.dat"
    }  # fmt: skip
    lines = (tmp_path / "out" / "blkst_strk+001fn+000dp+002.dat").read_text().splitlines()
    assert "t disp_1 disp_2 disp_3 vel_1 vel_2 vel_3" in lines
    assert "# location=1.25 m along strike, 0 m off fault, 2 m depth" in lines
    rows = in_file(tmp_path / "out" / "blkst_strk+001fn+000dp+002.dat")
    with Record(tmp_path / "run") as record:
        data = record.interfaces["main"]
        at = int(np.flatnonzero((np.abs(data["position"] - 1.25) < 1e-9) & (np.abs(data["dip"] - 2.0) < 1e-9))[0])
        slip, rate = (data[name].values[:, at] for name in ("slip_1", "slip_rate_1"))
        np.testing.assert_allclose(rows[:, 0], data["time"].values)
    np.testing.assert_allclose(rows[:, 2], slip / 2, rtol=1e-4, atol=1e-12)
    np.testing.assert_allclose(rows[:, 5], rate / 2, rtol=1e-4)
    # The section has x downwards, y towards the plus side and z along strike.
    export("--station", "0 m, 1 m", "--off-fault", "1.25 m, 3 m, 0 m")
    of_station = motion_of(tmp_path / "run", [0.0, 3.0, 1.25])[:, [1, 2, 0]]
    assert np.abs(of_station).max(axis=0).min() > 1e-3 * np.abs(of_station).max()
    columns = in_file(tmp_path / "out" / "blkst_strk+001fn+003dp+000.dat")[:, 1:4]
    np.testing.assert_allclose(columns, of_station, rtol=0, atol=1e-5 * np.abs(of_station).max())
    for stations, words in (
        (["0 m, 900 m, 0 m"], "'0 m, 900 m, 0 m' is not in the bodies: .* y from 0 to 4 m"),
        (["8 m"], "1 positions, .* needs 3; write '-16 km, 8 km, 0 km'"),
        (["benchmark"], "none of the stations of BP3, BP5"),
        (["1.1 m, 1 m, 0 m", "0.9 m, 1 m, 0 m"], "are both blkst_strk.*fn.*dp.* 1 m"),
    ):
        output = export(*(word for station in stations for word in ("--off-fault", station)))
        assert re.search(facts(words), output), output
