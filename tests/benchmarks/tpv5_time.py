"""Time of TPV5 on the small half model that a finite-difference code was timed on: set-up, steps and default outputs.

31 km x 10 km x 15.5 km on one side of the fault, until 12 s; waves come back from the edges of this box, so that only
the time counts. On elements of 800 m the box is larger, 31.6 km x 10 km x 15.8 km: a row of elements of 500 m at its
ends would shorten the time step by a third. On nodes 100 m apart the other code takes 192 s of one core in single
precision. The aims are 180 s of one rank and 100 s of two, in double precision, and 30 s of one rank on nodes 200 m
apart. Without `--fine` only these are measured. By the clock: to be run on a machine without other load, on two ranks
with `mpiexec -n 2`.
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

AIMS = {(800.0, 1): 30.0, (400.0, 1): 180.0, (400.0, 2): 100.0}
"""Seconds of the whole run, by element size of order 4 [m] and number of ranks."""


def case(element_size: float) -> Table:
    """Return the case on even elements of a size [m]."""
    table = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    table["mesh"] |= {"element_size": element_size, "beyond": max(0.5e3, element_size), "distance": 10e3, "growth": 1.0}
    return half_model({**table, "instruments": []})


def run(fine: bool, comm: MPI.Comm) -> list[Check]:
    checks = []
    for size in (800.0, 400.0) if fine else (800.0,):
        parsed = cast("Case", parse_case(case(size)))
        with tempfile.TemporaryDirectory() as folder:
            folder = comm.bcast(folder, root=0)
            comm.Barrier()
            began = time.perf_counter()
            simulate(parsed, folder, comm, progress=False).close()
            comm.Barrier()
            seconds = time.perf_counter() - began
        aim = AIMS.get((size, comm.size), AIMS[size, 1] / comm.size)
        text = f"whole run, nodes {size / 4:.0f} m apart, {comm.size} rank" + "s" * (comm.size > 1)
        checks.append(Check(text, aim, seconds, 0, "s", "aim", "at most", timing=True))
    return checks
