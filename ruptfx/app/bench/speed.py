"""Speed: node updates per second of complete explicit steps with a frictional interface, against peers and limits.

Two plates (in 3D two boxes) slide on each other under rate-and-state friction along the whole interface. A node update
is one node with all its components through one complete step: bulk, boundaries, friction. Every row is a process of its
own; times are medians of processor time, because machines are shared.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np

from ruptfx import RuptfxError, Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._parts import Parts
from ruptfx.app.bench._speed_tables import STEPS, step_rows
from ruptfx.app.bench._timings import start_up, time_to_error
from ruptfx.app.bench._whole_runs import whole_runs
from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes.two_plates import TwoPlates
from ruptfx.bodies.operators.ufl_form import UflForm, energy, measure
from ruptfx.case import Case
from ruptfx.interfaces.faults.fault_step import FaultStep
from ruptfx.platform import fem, launch
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address
from ruptfx.platform.terminal import console
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.platform.fem import MPI
    from ruptfx.stepping.steppers import Motion

SAMPLES = 9
SOURCE = "aim, 8-lane processor with two 512-bit pipes"
# dimension, order, geometry, nodes, ranks; the first set is the default, the second that of the release table.
ROWS = [
    (2, 1, "affine", 600_000, 1), (2, 4, "affine", 350_000, 1), (2, 5, "affine", 350_000, 1),
    (2, 4, "general", 350_000, 1), (3, 4, "affine", 300_000, 1),
]  # fmt: skip
FINE_ROWS = [
    *((2, order, "affine", nodes, 1) for order in (1, 2, 4, 5, 7) for nodes in (600_000, 4_000_000)),
    (2, 4, "affine", 350_000, 1), (2, 5, "affine", 350_000, 1), (2, 4, "general", 350_000, 1),
    (3, 4, "affine", 1_000_000, 1), (3, 4, "general", 1_000_000, 1), (2, 4, "affine", 4_000_000, 2),
]  # fmt: skip
# Aims of the time in double over that in single precision.
AIMS_OF_SINGLE = {(3, 4, "affine", 1_000_000): 1.8, (3, 4, "general", 1_000_000): 1.7, (2, 4, "affine", 350_000): 1.7}
# Aims in million node updates per second and core, by (dimension, order, geometry, nodes).
AIMS = {
    (2, 4, "affine", 350_000): 200, (2, 5, "affine", 350_000): 200, (2, 4, "affine", 4_000_000): 160,
    (2, 5, "affine", 4_000_000): 160, (2, 4, "general", 350_000): 100, (3, 4, "affine", 1_000_000): 25,
}  # fmt: skip

AXPY = """
void axpy(long n, double a, const double *x, double *y) { for (long i = 0; i < n; i++) y[i] += a * x[i]; }
"""


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    """Measure one part after the other and compare it with its aims; what fails loses nothing of the others.

    Rows of steps hold dim, order, geometry, nodes, ranks, node_updates_per_second_per_core, bytes_per_node,
    ratio_to_ufl_form, ratio_to_stock_ufl_form (the form compiled with DOLFINx's own flags instead of ours for this
    processor), ratio_to_petsc, ratio_to_bandwidth, interface_share; for several ranks efficiency, and
    independent_efficiency of as many problems that share nothing but the machine. On one rank ratio_of_single is the
    time in double over that in single precision, and single_bytes_per_node what the latter holds. None where not
    measured. Rows of whole runs follow, see `whole_runs`, then the time that each part took: part, seconds.
    """
    if comm.size > 1:
        raise RuptfxError("bench speed starts its own ranks: run it on one")
    parts, rows = Parts(), []
    for wanted in FINE_ROWS if fine else ROWS:
        with parts.one("steps of " + describe(*wanted)):
            rows.append(measure_row(*wanted))
            _compare_ranks(rows)
    show(rows)
    parts.checks += _of_steps(rows)
    with parts.one("fault problem to a stated error"):
        parts.checks += time_to_error(fine)
    if fine:
        with parts.one("start"):
            parts.checks += start_up()
    phases = whole_runs(fine, parts)
    return Outcome(parts.checks, None, rows + phases + parts.rows)


def describe(dim: int, order: int, geometry: str, nodes: int, ranks: int) -> str:
    """Return a row of the table as text."""
    return f"{dim}D order {order} {geometry}, {nodes / 1e6:.2g} M nodes" + f", {ranks} ranks" * (ranks > 1)


def _of_steps(rows: list[Table]) -> list[Check]:
    """Return the checks of all aims of steps."""
    checks = []

    def at_least(quantity: str, aim: float, value: float, unit: str = "1") -> None:
        checks.append(Check(quantity, aim, value, 0, unit, SOURCE, "at least"))

    for row in rows:
        what = describe(row["dim"], row["order"], row["geometry"], row["nodes"], 1)
        aim = AIMS.get((row["dim"], row["order"], row["geometry"], row["asked"]))
        if aim and row["ranks"] == 1:
            at_least(what, aim, row["node_updates_per_second_per_core"] / 1e6, "M/s")
        of_single = AIMS_OF_SINGLE.get((row["dim"], row["order"], row["geometry"], row["asked"]))
        if of_single and row.get("ratio_of_single"):
            at_least(f"{what}, double over single precision", of_single, row["ratio_of_single"])
            held = row["single_bytes_per_node"]
            checks.append(Check(f"{what}, held in single", 90, held, 0, "bytes/node", SOURCE, "at most"))
        if row["efficiency"]:
            at_least(f"{what}, speed-up of 2 ranks", 1.8, row["efficiency"])
        if row["order"] == 1:
            at_least(f"{what}, to PETSc product", 1, row["ratio_to_petsc"])
        if aim and row["dim"] == 2 and row["geometry"] == "affine" and row["ranks"] == 1:
            at_least(f"{what}, to ufl_form with stock flags", 35, row["ratio_to_stock_ufl_form"])
            checks.append(Check(f"{what}, held", 150, row["bytes_per_node"], 0, "bytes/node", SOURCE, "at most"))
            if row["asked"] == 4_000_000:
                at_least(f"{what}, of bandwidth", 0.25, row["ratio_to_bandwidth"])
        if row["dim"] == 3 and row["asked"] == 1_000_000:
            share = row["interface_share"]
            checks.append(Check(f"{what}, interface share of a step", 0.12, share, 0, "1", SOURCE, "at most"))
            checks.append(Check(f"{what}, held", 100, row["bytes_per_node"], 0, "bytes/node", SOURCE, "at most"))
    return checks


def measure_row(dim: int, order: int, geometry: str, nodes: int, ranks: int) -> Table:
    """Measure one row in separate processes.

    Raises
    ------
    RuptfxError
        If these processes fail, with their output.
    """
    arguments = [str(value) for value in (dim, order, geometry, nodes)]
    command = [sys.executable, "-m", "ruptfx.app.bench.speed", *arguments]
    if ranks > 1:
        command = launch.mpi_command(ranks, "ruptfx.app.bench.speed", *arguments)
    done = subprocess.run(
        command, env=launch.mpi_environment(ranks), capture_output=True, text=True, check=False, timeout=1800
    )
    if done.returncode:
        raise RuptfxError(f"bench speed, {' '.join(arguments)}: {done.stderr.strip()[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def _compare_ranks(rows: list[Table]) -> None:
    """Add the speed-up of the last row over the row of one rank on the same problem."""
    last = rows[-1]
    last["efficiency"] = last["independent_efficiency"] = None
    independent = last.pop("independent", None)
    for row in rows[:-1]:
        same = all(row[key] == last[key] for key in ("dim", "order", "geometry", "asked"))
        if same and row["ranks"] == 1 < last["ranks"]:
            key = "node_updates_per_second_per_core"
            last["efficiency"] = last["ranks"] * last[key] / row[key]
            last["independent_efficiency"] = last["ranks"] * independent / row[key]


def show(rows: list[Table]) -> None:
    """Print the table."""
    from rich.table import Table

    table = Table(*STEPS, box=None)
    for row in step_rows(rows):
        table.add_row(*row)
    console(stderr=True, width=140).print(table)  # stdout is for --json


# -- the problem ---------------------------------------------------------------------------------------------------


class BentPlates(MeshSource):
    """Two plates of non-parallelogram quadrilaterals."""

    length: float
    height: float
    element_size: float

    def build(self) -> RawMesh:
        raw = TwoPlates(length=self.length, height=self.height, element_size=self.element_size).build()
        x, y = raw.points.T
        raw.points[:] = np.stack([x + 0.1 * y * np.sin(3 * x), y * (1 + 0.1 * np.sin(4 * x))], axis=1)
        return raw


class TwoBoxes(MeshSource):
    """Two boxes of hexahedra, one on the other: unit squares of half the height."""

    elements: int
    bend: float = 0.0

    def build(self) -> RawMesh:
        n = self.elements
        parts = [self._box(np.linspace(low, low + 0.5, max(1, n // 2) + 1)) for low in (0.0, -0.5)]
        (points, cells, bottom, _), (below, more, _, top) = parts
        shift = len(points)
        return RawMesh(
            cell="hexahedron", points=np.concatenate([points, below]), cells=np.concatenate([cells, more + shift]),
            bodies=["upper", "lower"], cell_body=np.repeat([0, 1], len(cells)),
            interfaces={"main": (bottom, top + shift)},
        )  # fmt: skip

    def _box(self, z: np.ndarray) -> tuple[np.ndarray, ...]:
        line = np.linspace(0, 1, self.elements + 1)
        points = np.stack(np.meshgrid(line, line, z, indexing="ij"), axis=-1).reshape(-1, 3)
        points[:, 2] *= 1 + self.bend * np.sin(3 * points[:, 0] + 2 * points[:, 1])
        number = np.arange(len(points)).reshape(len(line), len(line), len(z))
        first, last = slice(None, -1), slice(1, None)
        cells = [number[i, j, k].ravel() for k in (first, last) for j in (first, last) for i in (first, last)]
        faces = [[number[i, j, k].ravel() for j in (first, last) for i in (first, last)] for k in (0, -1)]
        return points, np.stack(cells, axis=1), *(np.stack(face, axis=1) for face in faces)


def problem(dim: int, order: int, geometry: str, nodes: int) -> Case:
    """Return bodies that slide everywhere, so that the interface has its largest cost."""
    if dim == 2:
        columns = max(2, round(np.sqrt(nodes) / order))
        plates = BentPlates if geometry == "general" else TwoPlates
        mesh: MeshSource = plates(length=1.0, height=0.5, element_size=1 / columns)
    else:
        mesh = TwoBoxes(elements=max(2, round(nodes ** (1 / 3) / order)), bend=0.1 if geometry == "general" else 0.0)
    return Case.model_validate({
        "plane": "stress" if dim == 2 else "solid", "order": order, "duration": 1e-3, "mesh": mesh,
        "materials": {
            "default": {"kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0}
        },
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "initial_stress": {"normal": 6e6, "shear": 3.8e6},
            "friction": {
                "kind": "rate_and_state_power_law", "mu_s": 0.6, "mu_d": 0.4, "V_0": 100.0, "V_1": 29.0, "p": 1.2,
                "m": 5.0, "L_0": 10e-6, "A_0": 1.0, "theta_0_initial": 2e-4,
            },
        }},
    })  # fmt: skip


# -- one row -------------------------------------------------------------------------------------------------------


def median_time(function: Callable[[], object], least: float = 0.05, samples: int = SAMPLES) -> float:
    """Return the median processor time of a call [s], each sample long enough for the clock."""
    began = time.process_time()
    function()
    count = max(1, int(least / max(time.process_time() - began, 1e-9)))
    times = []
    for _ in range(samples):
        began = time.process_time()
        for _ in range(count):
            function()
        times.append((time.process_time() - began) / count)
    return float(np.median(times))


def work(dim: int, order: int, geometry: str, nodes: int) -> Table | None:
    """Measure one row on the ranks of this job; return it on rank 0, None elsewhere."""
    comm = fem.MPI.COMM_WORLD
    model, motion, state, step = timed_steps(problem(dim, order, geometry, nodes), comm)
    row: Table = {
        "dim": dim, "order": order, "geometry": geometry, "nodes": model.total_nodes, "asked": nodes,
        "ranks": comm.size, "node_updates_per_second_per_core": model.total_nodes / step / comm.size,
        "bytes_per_node": held_bytes(model, motion, state) / model.nodes, "ratio_to_ufl_form": None,
        "ratio_to_stock_ufl_form": None, "ratio_to_petsc": None, "ratio_to_bandwidth": None, "interface_share": None,
    }  # fmt: skip
    if comm.size > 1:
        del model, motion, state
        size = nodes // comm.size
        own, *_, seconds = timed_steps(problem(dim, order, geometry, size), fem.MPI.COMM_SELF)
        row["independent"] = own.total_nodes / seconds
    else:
        # Displacement and velocity read and written, one inverse mass read.
        must_move = 8 * (4 * model.components + 1)
        row["ratio_to_bandwidth"] = must_move * model.total_nodes / step / bandwidth()
        row["interface_share"] = interface_share(motion, state)
        row["ratio_to_ufl_form"] = ufl_step(model, state, motion.dt, tuned=True) / step
        row["ratio_to_stock_ufl_form"] = ufl_step(model, state, motion.dt, tuned=False) / step
        del model, motion, state
        row["ratio_to_petsc"] = petsc_product(dim, order) * row["node_updates_per_second_per_core"]
        row["ratio_of_single"], row["single_bytes_per_node"] = single_precision(dim, order, geometry, nodes)
    return row if comm.rank == 0 else None


def timed_steps(case: Case, comm: MPI.Comm) -> tuple[Model, Motion, State, float]:
    """Return model, motion, state after some steps, and the processor time of one [s], the longest of all ranks."""
    model = Model(case, comm)
    motion, state = case.stepper.bind(model), model.initial_state()
    # The same number of steps on all ranks, which wait for each other.
    steps = max(2, int(2e6 * comm.size / model.total_nodes))
    times = []
    fem.MPI.COMM_WORLD.Barrier()
    for _ in range(SAMPLES):
        began = time.process_time()
        for _ in range(steps):
            motion.step(state)
        times.append((time.process_time() - began) / steps)
    if not np.isfinite(state.velocity).all():
        raise RuptfxError("bench speed: the velocities are not finite; report this as an error of ruptfx")
    return model, motion, state, fem.MPI.COMM_WORLD.allreduce(float(np.median(times)), op=fem.MPI.MAX)


def single_precision(dim: int, order: int, geometry: str, nodes: int) -> tuple[float, float]:
    """Return the processor time of steps in double over that in single precision, and bytes per node of the latter.

    The median of pairs: a step of each in turn, for which the machine is as busy.
    """
    runs, held = [], 0.0
    for precision in ("double", "single"):
        case = problem(dim, order, geometry, nodes).model_copy(update={"precision": precision})
        model = Model(case, fem.MPI.COMM_SELF)
        motion, state = case.stepper.bind(model), model.initial_state()
        held = held_bytes(model, motion, state) / model.nodes
        runs.append((motion, state))
    pairs = []
    for _ in range(4 * SAMPLES):
        seconds = []
        for motion, state in runs:
            began = time.process_time()
            for _ in range(max(1, 400_000 // nodes)):
                motion.step(state)
            seconds.append(time.process_time() - began)
        pairs.append(seconds[0] / seconds[1])
    return float(np.median(pairs[2:])), held


def held_bytes(model: Model, motion: Motion, state: State) -> float:
    """Return the memory that a step reads or writes [bytes]: vectors, inverse mass, arrays of the operator."""
    vectors = (state.displacement, state.velocity, state.force)
    per_node = float(model.real.itemsize * model.nodes)
    return sum(vector.nbytes for vector in vectors) + per_node + getattr(model.operator, "nbytes", 0)


def interface_share(motion: Motion, state: State) -> float:
    """Return the share of the fault in the processor time of steps, with caches as the bodies leave them."""
    plain, inside = FaultStep.__call__, []

    def timed(step: FaultStep, *value: Any) -> float:
        began = time.process_time()
        dissipated = plain(step, *value)
        inside.append(time.process_time() - began)
        return dissipated

    with patch.object(FaultStep, "__call__", timed):
        full_step = median_time(lambda: motion.step(state))
    return float(np.median(inside)) / full_step


def bandwidth() -> float:
    """Measure the bytes per second of y += a x on 200 MB."""
    library = native.load("axpy", AXPY)
    x, y = np.ones(12_500_000), np.ones(12_500_000)
    import ctypes

    pointers = [*map(address, (x, y))]
    seconds = median_time(lambda: library.axpy(ctypes.c_long(len(x)), ctypes.c_double(1e-9), *pointers))
    return 3 * x.nbytes / seconds


def ufl_step(model: Model, state: State, dt: float, tuned: bool) -> float:
    """Measure the processor time of the same bulk step with the reference operator [s]."""
    reference = UflForm(model.bulk, tuned)
    inverse_mass = dt / model.mass

    def step() -> None:
        reference.add_internal_force(state.displacement, state.force)
        state.velocity += inverse_mass * state.force
        state.displacement += dt * state.velocity
        state.force[:] = 0

    return median_time(step, samples=3)


def petsc_product(dim: int, order: int) -> float:
    """Measure the time of a matrix product per node [s], on a mesh whose matrix is larger than the caches."""
    case = problem(dim, order, "affine", 150_000 if dim == 2 else 30_000)
    model = Model(case, fem.MPI.COMM_SELF)
    ufl, u = fem.ufl, fem.dolfinx.fem.Function(model.space)
    test, trial = ufl.TestFunction(model.space), ufl.TrialFunction(model.space)
    form = ufl.derivative(ufl.derivative(energy(model.bulk, u, measure(model.bulk)), u, test), u, trial)
    matrix = fem.dolfinx.fem.petsc.assemble_matrix(fem.form(form))
    matrix.assemble()
    x, y = matrix.createVecs()
    x.set(1.0)
    return median_time(lambda: matrix.mult(x, y)) / model.nodes


if __name__ == "__main__":
    result = work(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
    if result is not None:
        print(json.dumps(result))
