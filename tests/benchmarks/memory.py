"""Memory of the largest rank on 1, 2, 4 and 8 ranks: no array that grows with the mesh is gathered on one rank.

Two plates of order 4 with an interface all along; the mesh, the model, one explicit step and the numbering of the nodes
that records and checkpoints use. What Python and its libraries take before that is shown, not counted. Memory falls
from two ranks on as 1 over the number of ranks; 1.3 leaves room for what ranks share along their common lines. One rank
sends no mesh to others, which takes more memory than steps; two ranks may not take more each than one rank.
"""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.app.bench import Check, Outcome
from ruptfx.platform import launch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

RANKS = (1, 2, 4, 8)
SLACK = 1.3
COMPARED = ((2, 1, 1.0), (4, 2, SLACK * 2 / 4), (8, 2, SLACK * 2 / 8))
"""Ranks, the smaller number of them that they are compared with, and the bound of the ratio of their memory."""
# Largest resident memory [MB] of every rank: after libraries, C code and MPI have been used once, and at the end.
PROGRAM = """
import resource, sys
from ruptfx.platform import fem
from ruptfx.app.bench.speed import problem
from ruptfx.run.model import Model

def one_step(nodes, comm):
    model = Model(problem(2, 4, "affine", nodes), comm)
    motion, state = model.case.stepper.bind(model), model.initial_state()
    motion.step(state)
    return model

one_step(500, fem.MPI.COMM_SELF)
one_step(1000 * fem.MPI.COMM_WORLD.size, fem.MPI.COMM_WORLD)  # includes the buffers of the first MPI messages
memory = [resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]
model = one_step(int(sys.argv[1]), fem.MPI.COMM_WORLD)
model.layout.numbering
memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
found = model.comm.gather(memory)
if found is not None:
    print(*(max(row[1] - row[0] for row in found), max(row[0] for row in found), model.total_nodes))
"""


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    nodes = 8_000_000 if fine else 1_000_000  # with fewer, a megabyte of a library decides on 8 ranks
    largest, before = dict[int, float](), dict[int, float]()
    for ranks in RANKS:
        largest[ranks], before[ranks], nodes = _measured(ranks, nodes)
    checks = [
        Check(f"{nodes} nodes: largest rank of {ranks} over that of {fewer}", bound, largest[ranks] / largest[fewer],
              0.0, "1", f"{largest[ranks]:.0f} MB beyond the {before[ranks]:.0f} MB of libraries, "
              f"and {largest[fewer]:.0f} MB", "at most")
        for ranks, fewer, bound in COMPARED
    ]  # fmt: skip
    return Outcome(checks, lambda: _draw(nodes, list(largest.values())))


def _measured(ranks: int, nodes: int) -> tuple[float, float, int]:
    """Return memory of the largest rank beyond the libraries, that of the libraries [MB], and the number of nodes."""
    command = [launch.find_mpiexec(), "-n", str(ranks), sys.executable, "-c", PROGRAM, str(nodes)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=3600, env=launch.mpi_environment(ranks)
    )
    if done.returncode:
        raise RuptfxError(f"bench memory, {nodes} nodes on {ranks} ranks: {done.stderr.strip()[-2000:]}")
    more, libraries, total = done.stdout.split()[-3:]
    return float(more), float(libraries), int(total)


def _draw(nodes: int, largest: list[float]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((ax,),) = new_figure(1, 1, 3, 4)
    ax.loglog(RANKS, largest, "o-", label="measured")
    more = np.array(RANKS[1:])
    ax.loglog(more, SLACK * 2 * largest[1] / more, "k:", lw=1, label=f"{SLACK} of two ranks, shared")
    ax.set(xlabel="Ranks", ylabel="Memory of the largest rank (MB)", title=f"{nodes:.3g} nodes", xticks=RANKS,
           xticklabels=[str(ranks) for ranks in RANKS])  # fmt: skip
    ax.minorticks_off()
    ax.legend()
    return figure
