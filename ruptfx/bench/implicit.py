"""Implicit steps on the interfaces alone against steps of the whole system: the same fields, in less processor time.

The shear impact in steps of ten times the stable explicit one, and the stick-slip block in the quasi-static steps of
its demo, on coarse meshes; with `--fine` on that of the impact demo (343 000 unknowns) and on one of 183 000 unknowns
of the block, where the aims are in seconds. A step is the median of some in which the interface slides as fast as it
says, and nobody looks at the bodies, as between two records; bringing them up to date is counted alone, and so is the
first step, with the factorisation and its action on the interface.
"""

from __future__ import annotations

import copy
import time
import tomllib
from collections.abc import Callable
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table, parallel
from ruptfx.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.implicit.equilibrium import Equilibrium
from ruptfx.model import Model

if TYPE_CHECKING:
    from ruptfx.fem import MPI

SOURCE = "aim, one core"
TIMED = 3


def demo(name: str, element_size: float, stepper: Table | None = None) -> Case:
    """A demo on another mesh with another stepper; without one, with the slow one of its hybrid."""
    table = tomllib.loads(files("ruptfx").joinpath(f"demos/{name}.toml").read_text())
    table["mesh"] |= {"element_size": element_size}
    stepper = stepper or table["stepper"]["slow"]
    return Case.model_validate(table | {"stepper": stepper, "output": {"figures": False}})


def measured(case: Case, comm: MPI.Comm, fast: float) -> dict[str, float]:
    """Processor times [s] of condensed steps and of those of the whole system, and how far the two differ.

    The times are of the first step, of a step when some point slides that fast [m/s], of a look at the bodies after it,
    and of a step of the whole system; the differences the largest of displacement and of slip, over the largest value.
    """
    model = Model(case, comm)
    motion, state = case.stepper.bind(model), model.initial_state()
    state.unseen = True

    def took(action: Callable[[], None]) -> float:
        began = time.process_time()
        action()
        return parallel.largest(model.comm, time.process_time() - began)

    first = took(lambda: motion.step(state))
    while parallel.largest(model.comm, np.abs(state.faults["main"]["slip_rate"]).max(initial=0.0)) < fast:
        motion.step(state)
    state.catch_up()
    theirs = copy.deepcopy(state)
    condensed = [took(lambda: motion.step(state)) for _ in range(TIMED)]
    look = took(state.catch_up)
    name = "equilibrium" if hasattr(motion, "equilibrium") else "_equilibrium"
    radiation = {fault: answer.radiation for fault, answer in getattr(motion, name).answers.items()}
    setattr(motion, name, Equilibrium(model, radiation=radiation, condensed=False))
    whole = [took(lambda: motion.step(theirs)) for _ in range(TIMED)]
    pairs = [(state.displacement, theirs.displacement), (state.faults["main"]["slip"], theirs.faults["main"]["slip"])]
    difference = max(
        parallel.largest(model.comm, np.abs(ours - other).max(initial=0.0))
        / parallel.largest(model.comm, np.abs(other).max(initial=0.0))
        for ours, other in pairs
    )
    return {
        "unknowns": model.total_nodes * model.components, "first": first, "condensed": float(np.median(condensed)),
        "whole": float(np.median(whole)), "difference": difference, "look": look,
    }  # fmt: skip


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    cases = {
        "impact": (demo("impact", 1e-3 if fine else 4e-3, {"kind": "generalized_alpha"}), 1.0, 0.3),
        "stick-slip": (demo("stick_slip", 0.19e-3 if fine else 1.25e-3), 1e-6, 0.05),
    }  # fmt: skip
    checks = []
    for name, (case, fast, aim) in cases.items():
        found = measured(case, comm, fast)
        text = f"{name}, {found['unknowns']:.0f} unknowns, {fast:g} m/s"
        checks.append(Check(f"{text}: difference", 0.0, found["difference"], 1e-9, "1", "the whole system"))
        ratio = found["condensed"] / found["whole"]
        aims = [("a step over one of the whole system", 0.5, ratio, "1", SOURCE)]
        if fine:
            aims.append(("a step", aim, found["condensed"], "s", SOURCE))
            if found["look"] > 1e-3:
                aims.append(("a look at the bodies", 0.2, found["look"], "s", "own aim"))
            paid = found["first"] / (found["whole"] - found["condensed"])
            aims.append(("steps that pay for the first", 50, paid, "1", "own aim"))
        for what, most, value, unit, source in aims:
            checks.append(Check(f"{text}: {what}", most, value, 0, unit, source, "at most", timing=True))
    return Outcome(checks)
