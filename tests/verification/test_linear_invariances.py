"""Demos with clamped interfaces are linear: loads superpose, sources and receivers are exchanged, time runs back."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.coarse_demos import coarse, names, resolved
from helpers.moved_cases import Table
from helpers.plain_cases import CLAMPED, centre_beside, welded
from helpers.run_data import Data, Run, differences, read

from ruptfx.case import Case, parse_case

pytest.importorskip("dolfinx")

from ruptfx.platform import fem
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

MEMORY = ("drucker_prager", "continuum_damage")
DEFAULT = ("impact", "bimaterial", "antiplane")
"""Demos of the default selection; `-m slow` has all others."""


def is_linear(table: Table) -> bool:
    return (
        table["stepper"]["kind"] == "leapfrog" and not table.get("fracture") and not table.get("large_rotations")
        and table["plane"] != "axisymmetric" and not any("sliding" in fault for fault in table["faults"].values())
        and not any(material["kind"] in MEMORY for material in table["materials"].values())
    )  # fmt: skip


def demos(*without: str) -> list[Any]:
    return [*_demos(*without)]


def _demos(*without: str) -> Iterator[Any]:
    for name in names():
        table = resolved(name)
        if is_linear(table) and not any(material["kind"] in without for material in table["materials"].values()):
            yield pytest.param(name, marks=[] if name in DEFAULT else [pytest.mark.slow])


@pytest.fixture(params=demos())
def case(request: pytest.FixtureRequest) -> Table:
    return welded(copy.deepcopy(coarse(request.param)))


WEAK = 1e-3  # stress of the forces over that of the clamped interfaces


def two_points(table: Table) -> tuple[list[list[float]], float]:
    """Return two points on different sides of the interface, where it has two, and the size of forces there [N].

    They are so near to each other that waves arrive above the rounding of the tractions that clamp the interface.
    """
    case = parse_case(table)
    assert isinstance(case, Case)
    mesh = case.mesh.build()
    one_sided = bool(mesh.one_sided)
    points = [centre_beside(mesh, side, part) for side, part in ((0, 0.45), (int(not one_sided), 0.55))]
    # Away from the middle of the cell, where shape functions of even order have their symmetry.
    places = [[x + 0.1 * size for x in point] for point, size in points]
    return places, WEAK * CLAMPED * points[0][1] ** (len(places[0]) - 1)


def force(table: Table, size: float, rng: np.random.Generator) -> list[float]:
    return (size * rng.normal(size={"antiplane": 1, "solid": 3}.get(table["plane"], 2))).tolist()


def with_forces(table: Table, points: list[list[float]], *loads: Table) -> Table:
    """Return a case with forces at points and receivers at all of them."""
    result = copy.deepcopy(table)
    result["boundaries"] += [{"kind": "point_force", **load} for load in loads]
    result["instruments"] = [
        {"kind": "receiver", "name": f"at_{number}", "point": point, "interval": table["duration"] / 20,
         "fields": ["displacement", "velocity", "strain"]} for number, point in enumerate(points)
    ]  # fmt: skip
    return result


def run(table: Table, out: Path) -> Run:
    """Run a case, and return its displacements, velocities, strains and the change of its tractions."""
    case = parse_case(table)
    assert isinstance(case, Case)
    simulate(case, out, progress=False)
    fields = ("displacement", "velocity", "strain_", "displacement_jump", "normal_stress", "shear_traction", "slip")
    kept = {name: data for name, data in read(out, table["plane"]).items()
            if name.partition(":")[2].rpartition("/")[2].startswith(fields) and ".csv" not in name}  # fmt: skip
    for name in [name for name in kept if name.endswith(":normal_stress")]:
        kept[name] = Data(kept[name].values - CLAMPED, "Pa")
    slips = [data.values for name, data in kept.items() if ":slip" in name]
    assert all(not np.any(slip) for slip in slips)  # else it is not linear
    if all(fault["contact"]["kind"] == "split_node" for fault in table["faults"].values()):
        kept = {name: data for name, data in kept.items() if "displacement_jump" not in name}  # rounding
    moved = [data.values for name, data in kept.items() if name.startswith("instruments") and "displacement" in name]
    assert all(np.any(each) for each in moved)
    return kept


def test_loads_superpose(case: Table, tmp_path: Path) -> None:
    """A run under two loads times factors is the sum of the runs under each, times these factors."""
    rng, (points, size) = np.random.default_rng(20261128), two_points(case)
    forces = [force(case, size, rng), force(case, size, rng)]
    first = {"point": points[0], "force": forces[0], "ramp": 0.3 * case["duration"]}
    ricker = {"kind": "ricker", "frequency": 4 / case["duration"], "delay": 0.3 * case["duration"]}
    second = {"point": points[1], "force": forces[1], "history": ricker}
    one, other = (run(with_forces(case, points, load), tmp_path / name) for load, name in ((first, "a"), (second, "b")))
    scaled = [{**first, "force": [2.0 * each for each in forces[0]]},
              {**second, "force": [-0.7 * each for each in forces[1]]}]  # fmt: skip
    both = run(with_forces(case, points, *scaled), tmp_path / "c")
    expected = {name: Data(2.0 * data.values - 0.7 * other[name].values, data.unit) for name, data in one.items()}
    assert not [*differences(expected, both, 1e-9)]


def test_sources_and_receivers_are_exchanged(case: Table, tmp_path: Path) -> None:
    """Betti and Maxwell: the displacement at Q along b under a force a at P is that at P along a under b at Q."""
    rng, (points, size) = np.random.default_rng(20261128), two_points(case)
    forces = [force(case, size, rng), force(case, size, rng)]
    work = []
    for here, there in ((0, 1), (1, 0)):
        load = {"point": points[here], "force": forces[here], "ramp": 0.3 * case["duration"]}
        found = run(with_forces(case, points, load), tmp_path / str(here))
        axes = "z" if case["plane"] == "antiplane" else "xyz"[: len(forces[0])]
        read_there = [found[f"instruments.h5:at_{there}/displacement_{axis}"].values for axis in axes]
        work.append(np.stack(read_there, axis=-1) @ forces[there])
    np.testing.assert_allclose(work[0], work[1], rtol=0, atol=1e-9 * np.abs(work[0]).max())


@pytest.mark.parametrize("demo", demos("standard_linear_solids"))
def test_time_runs_back(demo: str) -> None:
    """Without damping, the velocities reversed bring the bodies back to where they were.

    Leapfrog has displacements u(n) and velocities v(n + 1/2) = (u(n+1) - u(n)) / dt: reversed, the displacement is that
    one step before, and the velocity is -v.
    """
    table = welded(copy.deepcopy(coarse(demo)), silent=False)
    table["damping"] = {}
    pulse = {"kind": "sampled", "times": [0.0, 0.1 * table["duration"], 0.2 * table["duration"]],
             "values": [0.0, 1.0, 0.0]}  # fmt: skip
    points, size = two_points(table)
    load = {"point": points[0], "force": force(table, size, np.random.default_rng(20261128)), "history": pulse}
    case = parse_case(with_forces(table, [], load))
    assert isinstance(case, Case)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    while state.time <= 0.3 * case.duration:
        motion.step(state)
    before, speed, step = state.displacement.copy(), state.velocity.copy(), state.step
    while state.time < case.duration:
        motion.step(state)
    far, count = state.displacement.copy(), state.step - step
    state.displacement -= motion.dt * state.velocity
    state.velocity *= -1
    for _ in range(count - 1):
        motion.step(state)
    largest = np.abs(before).max()
    assert count > 10 and np.abs(far - before).max() > 0.1 * largest > 0
    np.testing.assert_allclose(state.displacement, before, rtol=0, atol=1e-10 * largest)
    motion.step(state)
    np.testing.assert_allclose(state.velocity, -speed, rtol=0, atol=1e-10 * np.abs(speed).max())
