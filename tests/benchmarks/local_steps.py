"""Local time steps: what the substeps of small elements change, and how much shorter runs become.

Two plates with columns of thin elements from edge to edge, 1 % of all. They are thinner by 11.4, so that their own
step is 8 times shorter than that of the others. A rupture along the interface crosses them. Slip is compared with that
of leapfrog in steps as long as the substeps. Without friction the scheme conserves a modified energy exactly. The ratio
of the times of both decides nothing: it depends on the machine and on what else runs there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes.two_plates import TwoPlates
from ruptfx.case import Case
from ruptfx.platform import parallel
from ruptfx.run.model import Model
from ruptfx.stepping.steppers.local_leapfrog import LocalMotion

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.platform.fem import MPI
    from ruptfx.stepping.steppers import Motion

SIZE, THINNER = 1e-3, 11.4  # m; sqrt(1 + 11.4^2) / sqrt(2) = 8.1
SAMPLES = 9
HOMALITE = {"kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0}
WEAKENING = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 4e-6}
EQUAL = "leapfrog with steps as long as the substeps"


@dataclass
class Steps:
    """A motion, its state, and its model."""

    model: Model
    motion: Motion
    state: State


class ThinColumns(MeshSource):
    """Two plates of square elements with some thin columns in the middle."""

    columns: int
    rows: int
    thin: int

    def build(self) -> RawMesh:
        raw = TwoPlates(length=self.columns * SIZE, height=self.rows * SIZE, element_size=SIZE).build()
        widths = np.full(self.columns, SIZE)
        middle = self.columns // 2
        widths[middle : middle + self.thin] /= THINNER
        ends = np.concatenate([[0.0], np.cumsum(widths)])
        raw.points[:, 0] = np.interp(raw.points[:, 0], np.arange(self.columns + 1) * SIZE, ends)
        return raw


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    """Compare both; with `fine` on 2 million nodes, else on 0.4 million."""
    columns, rows, thin = (400, 160, 4) if fine else (200, 60, 2)
    local, equal = pair(ThinColumns(columns=columns, rows=rows, thin=thin), comm)
    motion = cast("LocalMotion", local.motion)
    what = f"{local.model.total_nodes / 1e6:.2g} M nodes, {motion.clusters.substeps} substeps"
    checks = [
        Check(f"{what}: slip, over the largest", 0.0, slip_error(local, equal), 1e-3, "1", EQUAL, "at most"),
        Check(
            f"{what}: energy unaccounted for, over the work", 0.0, closure(local),
            cast("Case", local.model.case).stepper.closure, "1", "exact", "at most",
        ),
        Check("free vibration: drift of the modified energy", 0.0, drift(comm), 1e-10, "1", "exact", "at most"),
        Check(
            f"{what}: time of equal steps over that of local ones", 4.0, gain(local, equal), 0, "1", "aim", "at least",
            timing=True,
        ),
    ]  # fmt: skip
    return Outcome(checks)


def case(mesh: MeshSource, stepper: Table, **changes: object) -> Case:
    """Return two plates, of which 20 mm beside the thin columns slip from the start."""
    columns = cast("ThinColumns", mesh).columns
    return Case.model_validate({
        "plane": "stress", "order": 4, "duration": 1.0, "mesh": mesh, "materials": {"default": HOMALITE},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": WEAKENING,
            "initial_stress": {"normal": 6e6, "shear": {
                "kind": "boxcar", "inside": 3.8e6, "outside": 2.5e6,
                "center": (columns // 2 - 8) * SIZE, "half_width": 10 * SIZE,
            }},
        }},
        "stepper": stepper, **changes,
    })  # fmt: skip


def begun(parsed: Case, comm: MPI.Comm) -> Steps:
    model = Model(parsed, comm)
    return Steps(model, parsed.stepper.bind(model), model.initial_state())


def pair(mesh: MeshSource, comm: MPI.Comm) -> tuple[Steps, Steps]:
    """Return local steps, and equal ones as long as their substeps."""
    local = begun(case(mesh, {"kind": "local_leapfrog"}), comm)
    assert isinstance(local.motion, LocalMotion)
    substep = local.motion.dt / local.motion.clusters.substeps
    return local, begun(case(mesh, {"kind": "leapfrog", "time_step": substep}), comm)


def slip_error(local: Steps, equal: Steps) -> float:
    """Return the largest difference of slip over the largest slip, after waves have crossed 10 elements."""
    motion = cast("LocalMotion", local.motion)
    steps = int(10e-6 / motion.dt)
    for _ in range(steps):
        local.motion.step(local.state)
    for _ in range(steps * motion.clusters.substeps):
        equal.motion.step(equal.state)
    slip, exact = (each.state.faults["main"]["slip"] for each in (local, equal))
    comm = local.model.comm
    error = parallel.largest(comm, float(np.abs(slip - exact).max(initial=0.0)))
    return error / parallel.largest(comm, float(exact.max(initial=0.0)))


def closure(local: Steps) -> float:
    """Return what is missing in the energy budget over the work of the boundaries."""
    energy = local.motion.energies(local.state)
    return abs(2 * energy["boundary_work"] - sum(energy.values())) / abs(energy["boundary_work"])


def drift(comm: MPI.Comm) -> float:
    """Return the relative change of (v(n)' M u(n+1) - u(n)' M v(n+1)) / (2 dt) over 1000 steps of a free vibration."""
    stuck = {
        "contact": {"kind": "compliant", "C_n": 300e9, "C_s": 100e9}, "friction": {"kind": "coulomb", "mu_d": 1e6},
        "initial_stress": {"normal": 6e6},
    }  # fmt: skip
    mesh = ThinColumns(columns=20, rows=8, thin=2)
    glued = case(mesh, {"kind": "local_leapfrog", "substeps": 5}, faults={"main": stuck})
    steps = begun(glued, comm)
    model, motion, state = steps.model, steps.motion, steps.state
    x = model.coordinates
    state.velocity[:] = np.sin(4.3758e7 * (x @ np.array([12.9898, 78.233, 37.719])[: x.shape[1]])).repeat(2) * 1e-3
    model.layout.equalise(state.velocity)
    state.numbers["lag"] = motion.dt / cast("LocalMotion", motion).clusters.substeps
    values = []
    for _ in range(1000):
        displacement, velocity = state.displacement.copy(), state.velocity.copy()
        motion.step(state)
        products = [
            model.layout.owned_dot(velocity, model.mass * state.displacement),
            -model.layout.owned_dot(displacement, model.mass * state.velocity),
        ]
        values.append(float(parallel.total(comm, products).sum()) / (2 * motion.dt))
    return float(np.ptp(values) / values[0])


def gain(local: Steps, equal: Steps) -> float:
    """Return the processor time of equal steps over that of local ones, the median of pairs in turn."""
    substeps = cast("LocalMotion", local.motion).clusters.substeps
    pairs = []
    for _ in range(SAMPLES):
        began = time.process_time()
        for _ in range(substeps):
            equal.motion.step(equal.state)
        between = time.process_time()
        local.motion.step(local.state)
        pairs.append((between - began) / (time.process_time() - between))
    return float(np.median(pairs))
