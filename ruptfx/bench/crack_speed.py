"""What a step of bodies that break costs: triangles per second, over the cells alone, and with damaged facets.

The disc of the demo, in elastic steps with Kelvin-Voigt damping, which needs the force of the cells twice. Against that
of the cells alone, from the displacement and from the velocity; against the assembled weak form of cells and facets,
which is the definition; and, with facets that are half damaged, against the elastic step. Medians of processor time.
Rates are aims for an undisturbed machine with vectors of 512 bits; bounds of the first two ratios were set from what
was found, 5.8 and 3.9 on a busy one, to notice when a step becomes slower again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table, fem
from ruptfx.bench import Check, Outcome
from ruptfx.bench._broken import demo
from ruptfx.bench.speed import median_time
from ruptfx.model import Model
from ruptfx.operators.ufl_form import UflForm

if TYPE_CHECKING:
    from ruptfx.state import State
    from ruptfx.steppers import Motion

# Element size [m], and the aim in million triangles per second: 24 thousand and 0.9 million triangles.
SIZES, FINE_SIZES = [(0.5e-3, 20.0)], [(0.5e-3, 20.0), (0.08e-3, 10.0)]
BROKEN, DAMAGE = 0.1, 0.5  # part of the facets, and their damage
SOURCE = "aim, processor with two 512-bit pipes"


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    del comm
    checks: list[Check] = []
    rows: list[Table] = []
    for size, aim in FINE_SIZES if fine else SIZES:
        row = _costs(size)
        rows.append(row)
        name = f"{row['triangles'] / 1e3:.0f} thousand triangles"
        for what, key, value, unit in (
            ("steps", "steps", aim, "M/s"), ("assembled weak form over the step", "weak_form", 3.0, "1"),
        ):  # fmt: skip
            checks.append(Check(f"{name}: {what}", value, row[key], 0.0, unit, SOURCE, "at least"))
        for what, key, value in (
            ("step over the force of the cells, twice", "over_cells", 8.0),
            ("a tenth of the facets damaged, over the elastic step", "damaged", 3.0),
        ):
            checks.append(Check(f"{name}: {what}", value, row[key], 0.0, "1", SOURCE, "at most"))
    return Outcome(checks, rows=rows)


def _costs(size: float) -> Table:
    """Rates and ratios of one mesh."""
    case = demo("brazilian", [f"mesh.element_size={size}", "fracture.unresolved=true"])
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
        "triangles": triangles, "steps": triangles / step / 1e6, "over_cells": step / alone, "weak_form": weak / step,
        "damaged": broken / step,
    }  # fmt: skip


def _weak_form(model: Model, state: State) -> Callable[[], None]:
    """Assembles the force of cells, twice, and of facets."""
    assert model.cracks is not None
    bulk, ufl = UflForm(model.bulk), fem.ufl
    u, v = fem.dolfinx.fem.Function(model.space), ufl.TestFunction(model.space)
    ends = ufl.Measure("dS", domain=model.mesh, metadata={"quadrature_rule": "vertex", "quadrature_degree": 1})
    facets = fem.dolfinx.fem.form(model.cracks.stiffness[0] * ufl.inner(ufl.jump(u), ufl.jump(v)) * ends,
                                   jit_options=fem.JIT_OPTIONS)  # fmt: skip
    force = np.zeros_like(state.force)

    def assemble() -> None:
        for vector in (state.displacement, state.velocity):
            bulk.add_internal_force(vector, force)
        u.x.array[:] = state.displacement
        fem.dolfinx.fem.assemble_vector(force, facets)

    return assemble


def _with_damage(model: Model, motion: Motion, state: State) -> Callable[[], None]:
    """Steps with some facets, here and there, half way to failure."""
    assert model.case.fracture is not None
    law = model.case.fracture.default.cohesion
    assert law is not None
    count = len(state.cracks["damage"])
    chosen = np.random.default_rng(1).choice(count, int(BROKEN * count), replace=False)
    state.cracks["damage"][chosen] = DAMAGE
    state.cracks["largest_opening"][chosen] = DAMAGE * law.opening_at_failure
    return lambda: motion.step(state)
