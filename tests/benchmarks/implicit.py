"""Implicit steps on the interfaces alone against steps of the whole system: the same fields, in less processor time.

The shear impact in steps of ten times the stable explicit one, and the stick-slip block in the quasi-static steps of
its demo, on coarse meshes; with `--fine` on that of the impact demo (343 000 unknowns) and on one of 183 000 unknowns
of the block, where the aims are in seconds. A step is the median of some in which the interface slides as fast as it
says, and nobody looks at the bodies, as between two records; bringing them up to date is counted alone, and so is the
first step, with the factorisation and its action on the interface. Nucleation is the mean of all steps from there on
until the block slides a hundred times faster, those included that found no equilibrium and were repeated.
"""

from __future__ import annotations

import copy
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError, Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._parts import Parts
from ruptfx.case import Case
from ruptfx.platform import parallel
from ruptfx.platform.terminal import console
from ruptfx.run.model import Model
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.steppers import sync_bodies

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.platform.fem import MPI

SOURCE = "aim, one core"
TIMED = 3
MOST = 400  # steps, limit until an interface slides


@dataclass(frozen=True)
class Problem:
    """A case to measure, the slip rate [m/s] from which on, and the largest time of a step [s] with `--fine`."""

    name: str
    case: Case
    fast: float
    aim: float
    nucleates: bool = False


def demo(name: str, element_size: float, stepper: Table | None = None) -> Case:
    """Return a demo on another mesh with another stepper, by default the slow one of its hybrid stepper."""
    table = tomllib.loads(files("ruptfx").joinpath(f"demos/{name}.toml").read_text())
    table["mesh"] |= {"element_size": element_size}
    stepper = stepper or table["stepper"]["slow"]
    if stepper["kind"] == "quasi_static":  # damping acts on waves, which only the demo's fast steps have
        table.pop("damping", None)
    return Case.model_validate(table | {"stepper": stepper, "output": {"figures": False}})


class Measured:
    """One problem, run step by step; every timing is printed in processor seconds."""

    def __init__(self, problem: Problem, comm: MPI.Comm) -> None:
        self.name, self.model = problem.name, Model(problem.case, comm)
        self.motion, self.state = problem.case.stepper.bind(self.model), self.model.initial_state()
        self.state.lazy_bodies = True

    def timed(self, what: str, action: Callable[[], object]) -> float:
        """Time an action: processor time of the slowest rank [s]; collective."""
        began = time.process_time()
        action()
        seconds = parallel.largest(self.model.comm, time.process_time() - began)
        console(stderr=True).print(f"{self.name}: {what}, {seconds:.3g} s", highlight=False)
        return seconds

    def step(self) -> None:
        """Advance by one step."""
        self.motion.step(self.state)

    def sync_bodies(self) -> None:
        """Compute displacement and velocity that steps have deferred; collective."""
        sync_bodies(self.motion, self.state)

    def until(self, fast: float) -> int:
        """Step until some point reaches the slip rate `fast` [m/s]; return the number of steps; collective."""
        for steps in range(MOST):
            if parallel.largest(self.model.comm, np.abs(self.state.faults["main"]["slip_rate"]).max(initial=0)) > fast:
                return steps
            self.step()
        raise RuptfxError(f"{self.name}: no point slides at {fast:g} m/s after {MOST} steps")

    def whole(self) -> Callable[[State], None]:
        """Return the step of the whole system of the same motion; condensed steps end with this call."""
        name = "equilibrium" if hasattr(self.motion, "equilibrium") else "_equilibrium"
        radiation = {fault: answer.radiation for fault, answer in getattr(self.motion, name).answers.items()}
        setattr(self.motion, name, Equilibrium(self.model, radiation=radiation, condensed=False))
        return self.motion.step

    def difference(self, theirs: State) -> float:
        """Return the largest relative difference of displacement and slip from another state; collective."""
        ours = self.state
        pairs = [(ours.displacement, theirs.displacement), (ours.faults["main"]["slip"], theirs.faults["main"]["slip"])]
        return max(
            parallel.largest(self.model.comm, np.abs(one - other).max(initial=0.0))
            / parallel.largest(self.model.comm, np.abs(other).max(initial=0.0))
            for one, other in pairs
        )


def checks(problem: Problem, fine: bool, comm: MPI.Comm) -> list[Check]:
    """Return the checks of one problem; collective."""
    run = Measured(problem, comm)
    first = run.timed("the first step", run.step)
    run.timed(f"until {problem.fast:g} m/s", lambda: run.until(problem.fast))
    run.sync_bodies()
    theirs = copy.deepcopy(run.state)
    step = float(np.median([run.timed("a step", run.step) for _ in range(TIMED)]))
    look = run.timed("a look", run.sync_bodies)
    ours = copy.deepcopy(run.state)
    unknowns = run.model.total_nodes * run.model.components
    text = f"{problem.name}, {unknowns} unknowns, {problem.fast:g} m/s"
    aims = []
    if problem.nucleates:
        steps: list[int] = []
        seconds = run.timed("nucleation", lambda: steps.append(run.until(100 * problem.fast)))
        if fine:
            what, source = f"on to {100 * problem.fast:g} m/s, the mean step", f"{SOURCE}; {steps[0]} steps"
            aims.append((what, problem.aim, seconds / steps[0], "s", source))
    advance, run.state = run.whole(), ours
    whole = float(np.median([run.timed("a step of the whole system", lambda: advance(theirs)) for _ in range(TIMED)]))
    aims.append(("a step over one of the whole system", 0.5, step / whole, "1", SOURCE))
    if fine:
        aims.append(("a step", problem.aim, step, "s", SOURCE))
        if look > 1e-3:
            aims.append(("a look at the bodies", 0.2, look, "s", "own aim"))
        aims.append(("steps that pay for the first", 50, first / (whole - step), "1", "own aim"))
    return [
        Check(f"{text}: difference", 0.0, run.difference(theirs), 1e-9, "1", "the whole system"),
        *(Check(f"{text}: {what}", most, value, 0, unit, source, "at most", timing=True)
          for what, most, value, unit, source in aims),
    ]  # fmt: skip


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    parts = Parts()
    for problem in (
        Problem("impact", demo("impact", 1e-3 if fine else 4e-3, {"kind": "generalized_alpha"}), 0.5, 0.3),
        Problem("stick-slip", demo("stick_slip", 0.19e-3 if fine else 1.25e-3), 1e-6, 0.05, nucleates=True),
    ):
        with parts.one(problem.name):
            parts.checks.extend(checks(problem, fine, comm))
    return Outcome(parts.checks)
