"""Cost of explicit steps over the size of a mesh and over ranks: time, memory, and what ranks send to each other.

A fault in a box of hexahedra of order 4, single precision. Sizes: processor time of a step and largest memory, each in
a process of its own. Ranks: the same box on 1 to 16 ranks, more than cores, so that everything is counted and nothing
timed: messages and bytes that a rank sends in a step, bytes that a step reads and writes on it, elements.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError, Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench.speed import held_bytes, timed_steps
from ruptfx.case import Case
from ruptfx.platform import fem, launch
from ruptfx.platform.memory import largest_memory
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

ORDER = 4
SIZES, FINE_SIZES = (100_000, 300_000), (300_000, 1_000_000, 5_000_000, 20_000_000)
RANKS, FINE_RANKS = (1, 2, 4), (1, 2, 4, 8, 16)
NODES_OF_RANKS, FINE_NODES_OF_RANKS = 100_000, 1_000_000
LIKE, SLACK = 1.15, 1.2  # sizes: largest over smallest; ranks: a rank over an equal share
AIM = "aim"


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    """Measure and count; rows have the numbers of every size and of every number of ranks."""
    if comm.size > 1:
        raise RuptfxError("bench scaling starts its own ranks: run it on one")
    sizes = [_started(1, "size", nodes) for nodes in (FINE_SIZES if fine else SIZES)]
    rows = [_started(ranks, "ranks", FINE_NODES_OF_RANKS if fine else NODES_OF_RANKS)
            for ranks in (FINE_RANKS if fine else RANKS)]  # fmt: skip
    time, memory = ([row[name] for row in sizes] for name in ("seconds_per_node", "peak_per_node"))
    span = f"{sizes[0]['nodes']} to {sizes[-1]['nodes']} nodes"
    checks = [
        Check(f"time of a step per node, {span}: largest over smallest", LIKE, max(time) / min(time), 0, "1", AIM,
              "at most", timing=True),
        Check(f"largest memory per node, {span}: last over first", LIKE, memory[-1] / memory[0], 0, "1", AIM,
              "at most"),
    ]  # fmt: skip
    for row in rows[1:]:
        share = row["held"] * row["ranks"] / rows[0]["held"]
        what = f"{row['nodes']} nodes on {row['ranks']} ranks"
        checks.append(
            Check(f"{what}: bytes of a step on a rank, over an equal share", SLACK, share, 0, "1", AIM, "at most")
        )
        checks.append(Check(f"{what}: elements of a rank, over an equal share", SLACK, row["elements"] * row["ranks"]
                            / rows[0]["elements"], 0, "1", AIM, "at most"))  # fmt: skip
    return Outcome(checks, lambda: _draw(sizes, rows), sizes + rows)


def box(nodes: int) -> Case:
    """Return a fault in the middle of a cube with about as many nodes."""
    count = max(6, round(nodes ** (1 / 3) / ORDER) // 2 * 2)  # elements along an edge
    size, quarter = 100.0, count // 4
    beyond = (count - 2 * quarter) // 2 * size
    return Case.model_validate({
        "plane": "solid", "order": ORDER, "duration": 1.0, "precision": "single",
        "mesh": {
            "kind": "box_with_fault", "element_size": size, "fault_length": 2 * quarter * size, "growth": 1.0,
            "fault_width": (count * size) - beyond, "beyond": beyond, "distance": count // 2 * size,
        },
        "materials": {"default": {"kind": "isotropic_elastic", "c_p": 6000.0, "c_s": 3464.0, "density": 2670.0}},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "initial_stress": {"normal": 120e6, "shear": 70e6},
            "friction": {"kind": "linear_slip_weakening", "mu_s": 0.677, "mu_d": 0.525, "D_c": 0.4},
        }},
    })  # fmt: skip


def of_size(nodes: int) -> Table:
    """Return the time of a step and the largest memory beyond that of the libraries, per node."""
    timed_steps(box(1), fem.MPI.COMM_WORLD)  # loads and compiles
    before = largest_memory()
    model, _, _, seconds = timed_steps(box(nodes), fem.MPI.COMM_WORLD)
    return {"nodes": model.total_nodes, "seconds_per_node": seconds / model.total_nodes,
            "peak_per_node": (largest_memory() - before) / model.total_nodes}  # fmt: skip


def sent_in_step(model: Model) -> tuple[int, int]:
    """Return messages and bytes that this rank sends in a step for the forces of nodes; collective.

    Ghosts send their share to the owner, in doubles, and owners send the sum back.
    """
    index_map, comm = model.space.dofmap.index_map, model.comm
    to_owners = np.bincount(index_map.owners, minlength=comm.size)
    to_ghosts = np.array(comm.alltoall(to_owners.tolist()))
    numbers = int(to_owners.sum() + to_ghosts.sum()) * model.components
    return int(np.count_nonzero(to_owners) + np.count_nonzero(to_ghosts)), 8 * numbers


def of_ranks(nodes: int) -> Table | None:
    """Return the largest counts of a rank."""
    case, comm = box(nodes), fem.MPI.COMM_WORLD
    model = Model(case, comm)
    motion, state = case.stepper.bind(model), model.initial_state()
    messages, sent = sent_in_step(model)
    elements = model.mesh.topology.index_map(3).size_local
    held, ghosts = int(held_bytes(model, motion, state)), model.nodes - model.owned_nodes
    counts = np.array([messages, sent, held, elements, ghosts], dtype=np.int64)
    largest = np.empty_like(counts)
    comm.Allreduce(counts, largest, op=fem.MPI.MAX)
    names = ("messages", "sent", "held", "elements", "ghosts")
    row = {"nodes": model.total_nodes, "ranks": comm.size}
    return row | dict(zip(names, largest.tolist(), strict=True)) if comm.rank == 0 else None


def _started(ranks: int, what: str, nodes: int) -> Table:
    """Run `of_size` or `of_ranks` in processes of its own.

    Raises
    ------
    RuptfxError
        They fail.
    """
    command = [sys.executable, __file__, what, str(nodes)]
    if ranks > 1:
        command = [launch.find_mpiexec(), "-n", str(ranks), *command]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=3600, env=launch.mpi_environment(ranks)
    )
    if done.returncode:
        raise RuptfxError(f"bench scaling, {what}, {nodes} nodes on {ranks} ranks: {done.stderr.strip()[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def _draw(sizes: list[Table], rows: list[Table]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((left, right),) = new_figure(1, 2, 3, 8)
    nodes = [row["nodes"] / 1e6 for row in sizes]
    left.semilogx(nodes, [1e9 * row["seconds_per_node"] for row in sizes], "o-", label="time of a step (ns)")
    left.semilogx(nodes, [row["peak_per_node"] / 10 for row in sizes], "s--", label="largest memory (10 bytes)")
    left.set(xlabel="Nodes (millions)", ylabel="Per node", ylim=(0, None))
    left.legend()
    ranks = [row["ranks"] for row in rows]
    for name, style, text in (("held", "o-", "read and written in a step"), ("sent", "s--", "sent in a step")):
        chosen = [(rank, row[name] / 1e6) for rank, row in zip(ranks, rows, strict=True) if row[name]]
        right.loglog(*zip(*chosen, strict=True), style, label=text)
    right.loglog(ranks, rows[0]["held"] / 1e6 / np.array(ranks), "k:", label="equal shares")
    right.set(xlabel="Ranks", ylabel="Bytes of the largest rank (MB)", xticks=ranks, xticklabels=map(str, ranks))
    right.minorticks_off()
    right.legend()
    return figure


if __name__ == "__main__":
    result = (of_size if sys.argv[1] == "size" else of_ranks)(int(sys.argv[2]))
    if result is not None:
        print(json.dumps(result))
