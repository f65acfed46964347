"""Error bars of `ruptfx converge` against the values at a quarter of the spacing, for cases that take seconds.

Every case runs at a spacing h, at 2 h and 4 h, from which the bars are estimated, and at h / 4. At least 90 % of the
bars must hold the value at h / 4, and the median bar in the asymptotic range may be four times the difference to it.
The spacings are those of a quick look: half of the numbers are not in the asymptotic range.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import ruptfx
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case, parse_case, read_toml
from ruptfx.input.schema import set_key
from ruptfx.many_runs.convergence.estimates import estimate
from ruptfx.many_runs.convergence.readings import Reading, readings, shared
from ruptfx.run.simulation import simulate

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

DEMOS = Path(ruptfx.__file__).with_name("demos")
CASES: dict[str, tuple[float, Table]] = {
    "antiplane": (1600.0, {"duration": 2.5}),
    "impact": (8e-3, {"duration": 30e-6}),
    "rate_state": (1600.0, {"duration": 2.5}),
    "viscoelastic_impact": (8e-3, {"duration": 30e-6}),
    "slip_weakening": (3200.0, {"duration": 5.0}),
    "infer_gauges": (6e-3, {"duration": 32e-6}),
}
"""Spacing and changes of demos."""
FACTORS = (1.0, 2.0, 4.0)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del fine
    began, kept, inside, ratios = time.process_time(), [], [], []
    for name, (spacing, changes) in CASES.items():
        levels = [_readings(name, spacing * factor, changes, comm) for factor in (0.25, *FACTORS)]
        for _, _, (reference, *values) in shared(levels):
            if not np.any(values):
                continue
            result = estimate(values, FACTORS)
            error = abs(result.value - reference)
            holds = error <= result.bar + 1e-9 * abs(reference)
            kept.append(holds)
            if not result.outside:
                inside.append(holds)
                ratios += [result.bar / error] if error > 1e-9 * abs(reference) else []
    seconds = time.process_time() - began
    source = "values at a quarter of the spacing"
    return Outcome([
        Check("bars that hold the value at h/4", 0.9, float(np.mean(kept)), source=f"{len(kept)} numbers, {source}",
              relation="at least"),
        Check("the same of numbers in the asymptotic range", 0.9, float(np.mean(inside)),
              source=f"{len(inside)} numbers, {source}", relation="at least"),
        Check("median of bar over difference in that range", 4.0, float(np.median(ratios)), source=source,
              relation="at most"),
        Check("processor time", 60.0, seconds, unit="s", relation="at most", timing=True),
    ])  # fmt: skip


def _readings(name: str, spacing: float, changes: Table, comm: MPI.Comm) -> dict[str, Reading]:
    from ruptfx.many_runs.study.harvest import harvest

    table = read_toml(DEMOS / f"{name}.toml")
    for key, value in {**changes, "mesh.element_size": spacing, "output.figures": False}.items():
        set_key(table, key, value)
    case = parse_case(table, DEMOS)
    assert isinstance(case, Case)
    with tempfile.TemporaryDirectory() as folder:
        run = Path(comm.bcast(folder)) / "run"
        simulate(case, run, comm, progress=False)
        result = readings(run, harvest(run, ["run"]), case.plane) if comm.rank == 0 else None
        comm.barrier()
    return comm.bcast(result)
