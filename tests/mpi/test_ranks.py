"""What holds on every rank: passes under `python -m pytest` and under `mpiexec -n N python -m pytest` alike."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.crack_cases import block
from helpers.small_cases import (
    case,
    impact,
    march,
    slip_weakening,
    smooth_field,
    strike_slip,
    tilted,
    two_boxes,
    wavy_plates,
)

from benchmarks import scaling

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.app.bench import run_benchmark
from ruptfx.bodies.meshes import MeshSource
from ruptfx.bodies.meshes.gmsh_file import GmshFile
from ruptfx.bodies.meshes.two_plates import TwoPlates
from ruptfx.bodies.space.bodies import distribute
from ruptfx.bodies.space.nodes import Nodes
from ruptfx.bodies.spectrum import highest_frequency
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fault import fail
from ruptfx.interfaces.faults.interface import build_interface
from ruptfx.interfaces.faults.nearest import nearest_on_line
from ruptfx.interfaces.faults.projection import ProjectionError
from ruptfx.platform import fem, launch, parallel
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
MESHES = ("plates", "graded", "tilted", "triangles", "wavy", "boxes")


def source(kind: str, folder: Path) -> tuple[Any, int]:
    """Mesh source and order."""
    if kind == "tilted":
        pytest.importorskip("gmsh")
        table = tilted(folder) if COMM.rank == 0 else {"file": "unused", "interfaces": {}}
        table = COMM.bcast(table, root=0)
        return GmshFile.model_validate({key: table[key] for key in ("file", "interfaces")}), 3
    if kind == "triangles":
        pytest.importorskip("gmsh")
        file = Path(__file__).parents[1] / "data" / "two_bodies.geo"
        sides = {"main": {"plus": "upper", "minus": "lower"}}
        return GmshFile.model_validate({"file": str(file), "interfaces": sides}), 1
    if kind == "graded":
        return TwoPlates(length=20e-3, height=6e-3, element_size=1e-3, growth=1.4), 4
    return {
        "plates": (TwoPlates(length=10e-3, height=1e-3, element_size=1e-3), 2),
        "wavy": (wavy_plates(), 4),
        "boxes": (two_boxes(), 2),
    }[kind]


@pytest.fixture(params=MESHES)
def built(request: pytest.FixtureRequest, shared_tmp_path: Path) -> Any:
    mesh, order = source(request.param, shared_tmp_path)
    bodies = distribute(COMM, mesh)
    space = fem.lagrange(bodies.mesh, order, bodies.mesh.geometry.dim)
    face = build_interface(Nodes(space, bodies), "main")
    return bodies, space, face


def test_as_many_ranks_as_asked_for() -> None:
    launch.check_size(COMM.size)
    assert COMM.size == int(os.environ.get(launch.RANKS, COMM.size))


def test_nodes_move_alike_on_all_ranks() -> None:
    """Coefficients of a sponge follow from coordinates; a checkpoint has the values of owners only."""
    sponges = [{"kind": "sponge", "edge": f"{body}.far", "width": 1.5e-3} for body in ("plus", "minus")]
    model, _, state = march(parse_case(strike_slip({
        "order": 3, "duration": 1.5e-6, "mesh.element_size": 2e-3, "mesh.distance": 4e-3, "boundaries": sponges,
    })), comm=COMM)  # fmt: skip
    x = model.coordinates
    for found in (x.ravel(), state.displacement, state.velocity):
        of_owners = found.copy()
        model.layout.take_from_owners(of_owners)
        np.testing.assert_array_equal(found, of_owners)
    assert np.abs(state.velocity).max() > 1e-3


def test_every_point_is_owned_once_and_has_both_sides(built: Any) -> None:
    _, space, face = built
    local = space.dofmap.index_map.size_local + space.dofmap.index_map.num_ghosts
    assert np.all((face.plus >= 0) & (face.plus < local) & (face.minus >= 0) & (face.minus < local))
    owned = np.concatenate(COMM.allgather(face.number[face.owned]))
    np.testing.assert_array_equal(np.sort(owned), np.arange(face.total))
    # Wherever a node of the interface is, so is its pair: every rank that knows one side knows both.
    x = space.tabulate_dof_coordinates()
    np.testing.assert_allclose(x[face.plus], x[face.minus], atol=1e-12)


def test_every_rank_that_touches_the_interface_knows_its_points(built: Any) -> None:
    """Any local node at the place of an interface point belongs to a pair this rank knows."""
    _, space, face = built
    local = {tuple(row) for row in np.round(space.tabulate_dof_coordinates()[:, : face.points.shape[1]], 9)}
    points = parallel.share_rows(COMM, face.points[face.owned])
    here = {tuple(row) for row in np.round(points, 9)} & local
    assert here == {tuple(row) for row in np.round(face.points, 9)}


def test_weights_and_places_agree(built: Any) -> None:
    """A point that several ranks know is the same on all of them."""
    _, _, face = built
    frame = face.frame.reshape(len(face.plus), np.prod(face.frame.shape[1:]))
    rows = np.column_stack([face.number, face.position, face.weight, face.points, frame])
    everything = parallel.share_rows(COMM, rows)
    assert len(set(COMM.allgather((face.line.measure, face.line.first, face.line.last, *face.line.origin)))) == 1
    if face.points.shape[1] == 2:
        owned = parallel.share_rows(COMM, np.column_stack([face.position, face.points])[face.owned])
        position, *point = owned[len(owned) // 3]
        assert nearest_on_line(face, COMM, np.array(point))[0] == pytest.approx(position, abs=1e-12)
    for row in everything:
        same = everything[everything[:, 0] == row[0]]
        np.testing.assert_allclose(same, np.broadcast_to(same[0], same.shape), rtol=1e-12, atol=1e-12)


def test_exact_transpose_over_all_ranks(built: Any) -> None:
    """<W t, J u> = <J' W t, u>, every point and every node counted once."""
    _, space, face = built
    x = space.tabulate_dof_coordinates()
    components = face.frame.shape[2]
    u = np.sin(900 * x[:, :1] + 700 * x[:, 1:2] + np.arange(components)).ravel()
    # Different on both sides of the interface.
    sides = np.zeros((len(x), components))
    sides[face.plus] = np.cos(500 * face.points[:, :1])
    u += sides.ravel()
    t = np.cos(face.number[:, None] + np.arange(face.frame.shape[1]))
    force = np.zeros_like(u)
    face.assemble(t, force)
    owned = space.dofmap.index_map.size_local * components
    left = parallel.total(COMM, np.sum((face.owned * face.weight)[:, None] * t * face.jump(u)))
    right = parallel.total(COMM, force[:owned] @ u[:owned])
    size = parallel.total(COMM, np.abs(force[:owned] * u[:owned]).sum())
    assert abs(left - right) < 1e-13 * size
    # A common motion has no jump.
    common = np.sin(900 * x[:, :1] + 700 * x[:, 1:2] + np.arange(components)).ravel()
    assert np.abs(face.jump(common)).max(initial=0.0) < 1e-9


def test_internal_force_does_not_depend_on_the_partition() -> None:
    """<v, K u> of given fields: the same number on any number of ranks as on one."""
    here = Model(case({"mesh.length": 16e-3}))
    force = here.internal_force(smooth_field(here))
    product = float(parallel.total(COMM, here.layout.owned_dot(force, smooth_field(here, 1))))
    mass = float(parallel.total(COMM, here.layout.owned_dot(here.mass, np.ones_like(here.mass))))
    # Two plates of 16 x 4 mm, two components.
    assert mass == pytest.approx(2 * 2 * 16e-3 * 4e-3 * 1246.0, rel=1e-12)
    alone = Model(case({"mesh.length": 16e-3}), fem.MPI.COMM_SELF)
    force = alone.internal_force(smooth_field(alone))
    assert product == pytest.approx(alone.layout.owned_dot(force, smooth_field(alone, 1)), rel=1e-10)


@pytest.mark.parametrize("table", [slip_weakening, block], ids=["fault", "cracks"])
def test_the_time_step_does_not_depend_on_the_ranks(table: Callable[[], dict[str, Any]]) -> None:
    ours, alone = Model(parse_case(table())), Model(parse_case(table()), fem.MPI.COMM_SELF)
    # Before it is rounded to three digits, which hides a difference nearly always.
    assert highest_frequency(ours) == pytest.approx(highest_frequency(alone), rel=1e-12)
    assert ours.case.stepper.bind(ours).dt == alone.case.stepper.bind(alone).dt


@pytest.mark.parametrize("kind", [RuptfxError, CaseError, ProjectionError, ValueError])
def test_raise_on_all(kind: type[Exception]) -> None:
    """The error of the last rank reaches all, with its type if it is one of ours."""
    parallel.raise_on_all(COMM, None)
    error = kind("no good here") if COMM.rank == COMM.size - 1 else None
    expected = kind if issubclass(kind, RuptfxError) else RuptfxError
    with pytest.raises(expected, match="no good here"):
        parallel.raise_on_all(COMM, error)


def test_on_root() -> None:
    assert parallel.on_root(COMM, lambda: 7) == 7

    def fail() -> None:
        raise OSError("disk full")

    with pytest.raises(RuptfxError, match="disk full"):
        parallel.on_root(COMM, fail)


def test_gather_and_share() -> None:
    rows = np.full((COMM.rank + 1, 2), float(COMM.rank))
    everything = np.repeat(np.arange(COMM.size, dtype=float), np.arange(COMM.size) + 1)[:, None] * [1, 1]
    np.testing.assert_array_equal(parallel.share_rows(COMM, rows), everything)
    gathered = parallel.gather_rows(COMM, rows)
    assert (gathered is None) == (COMM.rank > 0)
    if gathered is not None:
        np.testing.assert_array_equal(gathered, everything)
    assert parallel.total(COMM, 1.0) == COMM.size


@pytest.mark.parametrize("rows", [0, 1, 2, 400])
def test_places_are_those_of_one_sort(rows: int) -> None:
    """Few distinct values, so that many rows are the same; some ranks may have none."""
    mine = np.random.default_rng(COMM.rank).integers(0, 5, (rows * (COMM.rank + 1) + (COMM.rank == 0), 3)).astype(float)
    everything = parallel.share_rows(COMM, mine)
    wanted = np.empty(len(everything), dtype=int)
    wanted[np.lexsort(everything.T)] = np.arange(len(everything))
    found = COMM.allgather(parallel.places(COMM, mine))
    np.testing.assert_array_equal(np.concatenate(found), wanted)


def test_an_error_in_a_mesh_source_is_raised_on_all() -> None:
    class Broken(MeshSource):
        def build(self) -> Any:
            raise RuptfxError("no mesh today")

    with pytest.raises(RuptfxError, match="no mesh today"):
        distribute(COMM, Broken())


def test_an_existing_directory_is_refused_on_all(shared_tmp_path: Path) -> None:
    with pytest.raises(RuptfxError, match="taken:"):
        if COMM.rank == 0:
            (shared_tmp_path / "taken").mkdir(exist_ok=True)
            (shared_tmp_path / "taken" / "something").write_text("")
        COMM.barrier()
        simulate(case(), shared_tmp_path / "taken", progress=False)


PLUS_RANK = '''"""An example."""
from ruptfx.app.bench import Check


def run(fine, comm):
    return [Check("rank", 0.0, comm.rank)]
'''


def test_rank_0_prints_and_saves_a_benchmark_and_decides(shared_tmp_path: Path, capsys) -> None:
    folder = shared_tmp_path / "own_benchmarks"
    if COMM.rank == 0:
        folder.mkdir()
        (folder / "plus_rank.py").write_text(PLUS_RANK)
    COMM.barrier()
    assert run_benchmark("plus_rank", out=folder / "out", folder=folder)  # the check of rank 1 fails
    printed = capsys.readouterr().out
    assert ("checks that failed: 0 of 1" in printed) if COMM.rank == 0 else not printed
    COMM.barrier()
    assert [row["found"] for row in json.loads((folder / "out" / "plus_rank.json").read_text())["checks"]] == [0]


@pytest.mark.parametrize("steps", [3, 40])
def test_an_error_on_one_rank_ends_all(steps: int, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One interface point has no admissible traction in one step, on one rank: no hang, one message, files kept."""
    from ruptfx.interfaces.faults.fault_step import FaultStep

    plain = FaultStep.__call__

    def once(self: FaultStep, state: Any, displacement: Any, velocity: Any, force: Any, time: float) -> float:
        result = plain(self, state, displacement, velocity, force, time)
        point = np.flatnonzero(self.fault.interface.owned & (self.fault.interface.number == 5))
        if round(time / self.clock.dt) == steps and len(point):
            values = {"trial_shear_traction": 1.0, "trial_normal_stress": 2.0, "Z": 1.0}
            fail(self.fault, state, int(point[0]), time, values)
        return result

    monkeypatch.setattr(FaultStep, "__call__", once)
    out = shared_tmp_path / f"fails-{steps}"
    failing = case({"duration": 8e-6, "output.interface_interval": 4e-6})
    message = r"coulomb: no slip rate.*interface point 5 of fault 'main' at \(.*\) m, time"
    with pytest.raises(ProjectionError, match=facts(message)):
        simulate(failing, out, progress=False)
    COMM.barrier()
    with Record(out) as record:
        assert not record.complete and record.summary is None
        assert record.interface.sizes["time"] >= 1 and record.interface.attrs["complete"] == 0
        assert np.isfinite(record.interface.normal_stress.values).all()
        assert "no slip rate" in (out / "run.log").read_text()


def test_a_run_in_process(shared_tmp_path: Path) -> None:
    """`simulate` called by every rank returns the finished record on every rank."""
    short = parse_case(impact(6e6, 2.0, changes={"duration": 3e-6}))
    with simulate(short, shared_tmp_path / "run", progress=False) as record:
        assert record.complete and record.summary["ranks"] == COMM.size


@pytest.mark.skipif(COMM.size > 3, reason="6 columns of elements")
def test_bytes_that_ranks_send_in_a_step_are_those_of_the_planes_between_them() -> None:
    """6 x 6 x 6 elements of order 4, in blocks along x: planes of 25 x 25 nodes, each sent once and back.

    The plane in the middle of the fault has 16 nodes twice, 4 elements below the surface without the rim; those at the
    ends of the fault have none.
    """
    messages, sent = scaling.sent_in_step(Model(scaling.box(1)))
    planes = {1: 0, 2: 25 * 25 + 16, 3: 2 * 25 * 25}[COMM.size]
    assert COMM.allreduce(sent) == 2 * planes * 3 * 8
    assert messages <= 2 * (COMM.size - 1) and (messages > 0) == (COMM.size > 1)
