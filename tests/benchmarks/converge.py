"""Error bars of `ruptfx converge` against the values at a quarter of the spacing, for cases that take seconds.

Six cases, and 32 with `--fine`.

Every case runs at a spacing h, at 2 h and 4 h, from which the bars are estimated, and at h / 4. At least 90 % of the
bars must hold the value at h / 4, and of those where `converge` does not warn that the case is not resolved. The median
bar in the asymptotic range of the latter may be four times the difference to it.
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
from ruptfx.many_runs.convergence.estimates import Row, estimate, unresolved
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
FURTHER: tuple[tuple[str, float, Table], ...] = (
    ("bimaterial", 1.28e-3, {"duration": 3e-6}),
    ("composite_impact", 8e-3, {"duration": 30e-6, "damping.kelvin_voigt.thickness": 20e-3}),
    ("stress_barrier", 8e-3, {"duration": 60e-6}),
    ("stress_barrier", 6e-3, {"duration": 80e-6}),
    ("sensitivity", 3200.0, {"duration": 8.0}),
    ("debonding", 4.8e-3, {"duration": 30e-6}),
    ("infer_antiplane", 1600.0, {"duration": 3.0}),
    ("inclined_plates", 10e-3, {"duration": 50e-6, "instruments.0.interval": 1e-6}),
    ("front_types", 8e-3, {"duration": 120e-6}),
    ("thermal_pressurisation", 1600.0, {"duration": 3.0}),
    ("off_fault_plasticity", 1600.0, {"duration": 3.0}),
    ("antiplane", 1200.0, {"duration": 4.0}),
    ("antiplane", 3200.0, {"duration": 4.0}),
    ("impact", 6e-3, {"duration": 40e-6}),
    ("impact", 8e-3, {"duration": 50e-6, "faults.main.initial_stress.normal": 30e6}),
    ("impact", 12e-3, {"duration": 40e-6}),
    ("rate_state", 1200.0, {"duration": 3.5}),
    ("rate_state", 2400.0, {"duration": 4.0}),
    ("slip_weakening", 1600.0, {"duration": 4.0}),
    ("slip_weakening", 3200.0, {"duration": 8.0}),
    ("viscoelastic_impact", 6e-3, {"duration": 40e-6}),
    ("viscoelastic_impact", 12e-3, {"duration": 40e-6}),
    ("infer_gauges", 4e-3, {"duration": 32e-6}),
    ("infer_gauges", 6e-3, {"duration": 48e-6}),
    ("fault_zone", 1000.0, {"duration": 3.0, "damping.kelvin_voigt.thickness": 2500.0}),
    ("injection", 1600.0, {"duration": 1e7}),
)
"""The same of further cases with `--fine`."""
FACTORS = (1.0, 2.0, 4.0)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    began = time.process_time()
    kept: list[bool] = []
    warned: list[bool] = []
    inside: list[bool] = []
    ratios: list[float] = []
    cases = [(name, *each) for name, each in CASES.items()]
    for name, spacing, changes in [*cases, *FURTHER] if fine else cases:
        levels = [_readings(name, spacing * factor, changes, comm) for factor in (0.25, *FACTORS)]
        table = [(quantity, values) for quantity, _, values in shared(levels) if np.any(values[1:])]
        rows = [Row(quantity, "", each.value, each.bar, {"mesh": each})
                for quantity, values in table for each in [estimate(values[1:], FACTORS)]]  # fmt: skip
        known = not unresolved(rows)
        for row, (_, (reference, *_)) in zip(rows, table, strict=True):
            error = abs(row.value - reference)
            holds = error <= row.bar + 1e-9 * abs(reference)
            (kept if known else warned).append(holds)
            if known and not row.outside:
                inside.append(holds)
                ratios += [row.bar / error] if error > 1e-9 * abs(reference) else []
    seconds = time.process_time() - began
    source = "values at a quarter of the spacing"
    return Outcome([
        Check("bars that hold the value at h/4", 0.9, float(np.mean(kept + warned)), relation="at least",
              source=f"{len(kept + warned)} numbers, {source}"),
        Check("the same of cases without a warning", 0.9, float(np.mean(kept)), relation="at least",
              source=f"{len(kept)} numbers, {source}"),
        Check("the same of their numbers in the asymptotic range", 0.9, float(np.mean(inside)),
              source=f"{len(inside)} numbers, {source}", relation="at least"),
        Check("median of bar over difference in that range", 4.0, float(np.median(ratios)), source=source,
              relation="at most"),
        Check("processor time", 300.0 if fine else 60.0, seconds, unit="s", relation="at most", timing=True),
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
