"""Cost of a fracture step: triangles per second, relative to the cells alone, and with damaged facets.

The disc of the demo, with springs between all cells and with facets that are rigid until their strength, in elastic
steps with Kelvin-Voigt damping. Against the force of the cells from the displacement and from the velocity; against the
assembled weak form of cells and facets, which is the definition; and, with facets that are half damaged, against the
elastic step. Medians of processor time. `--fine` adds a million triangles, on one rank and on two, and the specimen of
`demos/granite.toml` with cells of 0.8 mm until its first peak, from the mesh to the last step, without files and
pictures. Rates and times are aims for an undisturbed machine with vectors of 512 bits; the bound of the ratio to the
cells was set from what was found once, 5.8 on a busy one, to notice when a step becomes slower again.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks._broken import demo, rigid
from ruptfx import RuptfxError, Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench.speed import median_time, timed_steps
from ruptfx.bodies.operators.ufl_form import UflForm
from ruptfx.case import Case
from ruptfx.platform import fem, launch
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.stepping.steppers import Motion

# Element sizes [m]: 24 thousand and 0.9 million triangles; by kind the aims in million triangles per second there, and
# for the time of the specimen [s].
SMALL, LARGE = 0.5e-3, 0.08e-3
RATES = {"intrinsic": {SMALL: 20.0, LARGE: 10.0}, "extrinsic": {SMALL: 40.0, LARGE: 20.0}}
WHOLE = {"intrinsic": 60.0, "extrinsic": 15.0}
FIRST_PEAK = 0.45e-3  # of the specimen [s]
BROKEN, DAMAGE = 0.1, 0.5  # part of the facets, and their damage
SOURCE = "aim, processor with two 512-bit pipes"


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    """Rows hold kind, triangles and steps per kind and mesh, then ranks, and of the specimen seconds and number."""
    if comm.size > 1:
        raise RuptfxError("bench crack_speed starts its own ranks: run it on one")
    checks: list[Check] = []
    rows: list[Table] = []

    def compare(what: str, aim: float, found: float, unit: str = "1", at_least: bool = True) -> None:
        checks.append(Check(what, aim, found, 0.0, unit, SOURCE, "at least" if at_least else "at most"))

    for kind in RATES if fine else ():
        alone, both = (_on_ranks(ranks, kind) for ranks in (1, 2))
        rows.append({"kind": kind, "triangles": alone["triangles"], "ranks": 2, "gain": alone["step"] / both["step"]})
        name = f"{kind}, {alone['triangles'] / 1e3:.0f} thousand triangles"
        compare(f"{name}: two ranks over one", 1.7, rows[-1]["gain"])
    for kind, aims in RATES.items():
        for size in (SMALL, LARGE) if fine else (SMALL,):
            row = _costs(kind, size)
            rows.append(row)
            name = f"{kind}, {row['triangles'] / 1e3:.0f} thousand triangles"
            compare(f"{name}: steps", aims[size], row["steps"], "M/s")
            compare(f"{name}: assembled weak form over the step", 3.0, row["weak_form"])
            compare(f"{name}: step over the force of the cells, twice", 8.0, row["over_cells"], at_least=False)
            damaged = f"{name}: a tenth of the facets damaged, over the elastic step"
            compare(damaged, 3.0, row["damaged"], at_least=False)
    for kind, aim in WHOLE.items() if fine else ():
        rows.append(_specimen(kind))
        compare(f"{kind}, granite of 0.8 mm to its first peak", aim, rows[-1]["seconds"], "s", at_least=False)
    return Outcome(checks, rows=rows)


def _disc(kind: str, size: float) -> Case:
    case = demo("brazilian", [f"mesh.element_size={size}", "fracture.unresolved=true"])
    return rigid(case) if kind == "extrinsic" else case


def _costs(kind: str, size: float) -> Table:
    """Return the rates and ratios of one mesh."""
    case = _disc(kind, size)
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    triangles = len(model.bodies.cell_body)
    step = median_time(lambda: motion.step(state))
    force = np.zeros_like(state.force)

    def cells() -> None:
        for vector in (state.displacement, state.velocity):
            model.operator.add_internal_force(vector, force)

    form = _weak_form(model, state)
    alone, weak = median_time(cells), median_time(form)
    broken = median_time(_with_damage(model, motion, state))
    return {
        "kind": kind, "triangles": triangles, "steps": triangles / step / 1e6, "over_cells": step / alone,
        "weak_form": weak / step, "damaged": broken / step,
    }  # fmt: skip


def _weak_form(model: Model, state: State) -> Callable[[], None]:
    """Return a call that assembles the force of cells, twice, and of facets that are springs."""
    assert model.cracks is not None
    bulk, ufl = UflForm(model.bulk), fem.ufl
    u, v = fem.dolfinx.fem.Function(model.space), ufl.TestFunction(model.space)
    ends = ufl.Measure("dS", domain=model.mesh, metadata={"quadrature_rule": "vertex", "quadrature_degree": 1})
    facets = None if model.cracks.fracture.rigid else fem.form(
        model.cracks.stiffness[0] * ufl.inner(ufl.jump(u), ufl.jump(v)) * ends
    )  # fmt: skip
    force = np.zeros_like(state.force)

    def assemble() -> None:
        for vector in (state.displacement, state.velocity):
            bulk.add_internal_force(vector, force)
        if facets is not None:
            u.x.array[:] = state.displacement
            fem.dolfinx.fem.assemble_vector(force, facets)

    return assemble


def _with_damage(model: Model, motion: Motion, state: State) -> Callable[[], None]:
    """Return a call that steps with random facets damaged by half; extrinsic ones are inserted before."""
    assert model.case.fracture is not None
    law = model.case.fracture.default.cohesion
    assert law is not None
    state = copy(state)  # a new object, so that the motion rebuilds its list of active facets
    count = len(state.cracks["damage"])
    chosen = np.random.default_rng(1).choice(count, int(BROKEN * count), replace=False)
    state.cracks["damage"][chosen] = DAMAGE
    state.cracks["largest_opening"][chosen] = DAMAGE * law.opening_at_failure
    state.cracks["time_of_yield"][chosen] = state.time
    return lambda: motion.step(state)


def _specimen(kind: str) -> Table:
    """Return the processor time of granite under compression until its first peak, including the mesh."""
    began = time.process_time()
    case = demo("granite", ["mesh.element_size=0.8e-3"])
    if kind == "extrinsic":
        case = rigid(case)
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    while state.time < FIRST_PEAK:
        motion.step(state)
    seconds, failed = time.process_time() - began, np.isfinite(state.cracks["time_of_failure"]).sum()
    return {
        "kind": kind, "specimen": len(model.bodies.cell_body), "number": state.step, "failed": int(failed),
        "seconds": seconds,
    }  # fmt: skip


def _on_ranks(ranks: int, kind: str) -> Table:
    """Return the processor time of a step of the large mesh, measured in separate processes.

    Raises
    ------
    RuptfxError
        If these processes fail, with their output.
    """
    path = [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        launch.mpi_command(ranks, "benchmarks.crack_speed", kind, str(LARGE)), capture_output=True, text=True,
        env={**launch.mpi_environment(ranks), "PYTHONPATH": os.pathsep.join(path)}, check=False, timeout=1800,
    )  # fmt: skip
    if done.returncode:
        raise RuptfxError(f"bench crack_speed, {kind} on {ranks} ranks: {done.stderr.strip()[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    model, *_, step = timed_steps(_disc(sys.argv[1], float(sys.argv[2])), fem.MPI.COMM_WORLD)
    if fem.MPI.COMM_WORLD.rank == 0:
        print(json.dumps({"triangles": model.total_nodes // 3, "step": step}))
