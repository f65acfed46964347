"""Time of TPV5 on the small half model that a finite-difference code was timed on: set-up, steps and default outputs.

31 km x 10 km x 15.5 km on one side of the fault, until 12 s; waves come back from the edges of this box, so that only
the time counts. On elements of 800 m the box is larger, 31.6 km x 10 km x 15.8 km: a row of elements of 500 m at its
ends would shorten the time step by a third. On nodes 100 m apart the other code takes 192 s of one core in single
precision. The aims are 180 s of one rank and 100 s of two in double precision, 110 s and 58 s in single, and on nodes
200 m apart 30 s and 18 s of one rank. Without `--fine` only the latter are measured. By the clock: to be run on a
machine without other load, on two ranks with `mpiexec -n 2`.
"""

from __future__ import annotations

import tempfile
import time
import tomllib
from typing import TYPE_CHECKING, cast

from benchmarks._surfaces import half_model
from benchmarks.tpv5 import DEMO
from ruptfx import Table
from ruptfx.app.bench import Check
from ruptfx.case import parse_case
from ruptfx.run.simulation import simulate

if TYPE_CHECKING:
    from ruptfx.case import Case
    from ruptfx.platform.fem import MPI

AIMS = {
    "double": {(800.0, 1): 30.0, (400.0, 1): 180.0, (400.0, 2): 100.0},
    "single": {(800.0, 1): 18.0, (400.0, 1): 110.0, (400.0, 2): 58.0},
}
"""Seconds of the whole run, by precision, element size of order 4 [m] and number of ranks."""


def case(element_size: float) -> Table:
    """Return the case on even elements of a size [m]."""
    table = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    table["mesh"] |= {"element_size": element_size, "beyond": max(0.5e3, element_size), "distance": 10e3, "growth": 1.0}
    return half_model({**table, "instruments": []})


def run(fine: bool, comm: MPI.Comm) -> list[Check]:
    return [
        _timed(size, precision, comm)
        for size in ((800.0, 400.0) if fine else (800.0,)) for precision in ("double", "single")
    ]  # fmt: skip


def _timed(size: float, precision: str, comm: MPI.Comm) -> Check:
    """Return the check of the time of one run."""
    parsed = cast("Case", parse_case(case(size) | {"precision": precision}))
    with tempfile.TemporaryDirectory() as folder:
        folder = comm.bcast(folder, root=0)
        comm.Barrier()
        began, processor = time.perf_counter(), time.process_time()
        simulate(parsed, folder, comm, progress=False).close()
        own = time.process_time() - processor
        comm.Barrier()
        seconds = time.perf_counter() - began
    aims = AIMS[precision]
    aim = aims.get((size, comm.size), aims[size, 1] / comm.size)
    text = f"whole run, nodes {size / 4:.0f} m apart, {precision}, {comm.size} rank" + "s" * (comm.size > 1)
    source = f"aim; {comm.allreduce(own) / comm.size:.1f} s of processor time"
    return Check(text, aim, seconds, 0, "s", source, "at most", timing=True)
