"""Single precision: what it costs in accuracy, and how much faster its steps are.

The same cases in single and in double precision: shear impact (compliant contact, memory of the normal stress), TPV5 on
coarse nodes in three dimensions, a standing wave over 100 000 steps, and bodies that move slowly after a long way, so
that a step adds less than the rounding of a displacement in single precision. Slip and arrivals are compared with those
in double precision, energy with that at the start. The ratio of the times of both decides nothing: it depends on the
machine and on what else runs there.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import ruptfx
from benchmarks import tpv5
from benchmarks._surfaces import rupture as surface_rupture
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import rupture
from ruptfx.app.bench.speed import single_precision
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

IMPACT = Path(ruptfx.__file__).with_name("demos") / "impact.toml"
DOUBLE = "double precision"
HOMALITE = {"kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0}
WAVE_STEPS, SLOW_STEPS = 100_000, 2000
AWAY, SPEED = 1.0, 1e-3  # m, m/s; of the slow bodies
Errors = tuple[float, float, float]


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    """Compare both precisions; with `fine` the impact has the elements of the demo, and TPV5 nodes 188 m apart."""
    checks: list[Check] = []
    for what, errors in (
        ("shear impact", impact_errors(1e-3 if fine else 4e-3)),
        ("TPV5", tpv5_errors(tpv5.SIZES[1 if fine else 0], comm)),
    ):
        slip, steps, closure = errors
        checks += [
            Check(f"{what}: slip, over the largest", 0.0, slip, 1e-4, "1", DOUBLE, "at most"),
            Check(f"{what}: arrivals", 0.0, steps, 1.0, "steps", DOUBLE, "at most"),
            Check(f"{what}: energy unaccounted for, over the largest", 0.0, closure, 1e-5, "1", "exact", "at most"),
        ]
    drift = energy_drift(WAVE_STEPS)
    checks.append(Check(f"standing wave, {WAVE_STEPS} steps: drift of the energy", 0.0, drift, 1e-4, "1", "exact"))
    way, speed = slow_errors(SLOW_STEPS)
    what = f"bodies {AWAY:g} m away at {SPEED:g} m/s"
    checks.append(Check(f"{what}: way", 0.0, way, 1e-6, "1", "exact"))
    checks.append(Check(f"{what}: velocity", 0.0, speed, 1e-6, "1", "exact"))
    for dim, order in ((2, 4), (3, 4)):
        ratio, _ = single_precision(dim, order, "affine", 200_000)
        checks.append(Check(
            f"time in double over single precision, {dim}D order {order}", 1.0, ratio, 0, "1", "same machine",
            "at least", timing=True,
        ))  # fmt: skip
    return Outcome(checks)


def impact_errors(element_size: float) -> Errors:
    """Return errors of slip over the largest one, of arrivals in steps, and of the energy, of shear impact."""
    table: Table = tomllib.loads(IMPACT.read_text(encoding="utf-8"))
    table["mesh"] |= {"element_size": element_size}
    double = rupture(table)
    single = rupture({**table, "precision": "single", "stepper": {"time_step": double.time[2] - double.time[1]}})
    slips, arrivals = ([each.fields[name] for each in (double, single)] for name in ("slip", "rupture_time"))
    return _slip_error(*slips), _late(*arrivals) / (double.time[2] - double.time[1]), single.closure


def tpv5_errors(element_size: float, comm: MPI.Comm) -> Errors:
    """Return the same of TPV5 on elements of a size [m]."""
    table = tpv5.case(element_size)
    step = table["duration"] / surface_rupture(table, comm, tpv5.SLIP).steps  # the chosen step, but for the last one
    table["stepper"] = {"time_step": 0.999 * step}
    double, single = (surface_rupture({**table, "precision": name}, comm, tpv5.SLIP) for name in ("double", "single"))
    slips = (np.concatenate([each.fields["slip_1"], each.fields["slip_2"]]) for each in (double, single))
    late = _late(double.fields["slip_time"], single.fields["slip_time"])
    return _slip_error(*slips), late / (0.999 * step), abs(single.closure)


def _slip_error(double: np.ndarray, single: np.ndarray) -> float:
    return float(np.abs(single - double).max() / np.abs(double).max())


def _late(double: np.ndarray, single: np.ndarray) -> float:
    """Return the largest difference of arrivals [s]; infinite if a point has one in one precision only."""
    arrived = np.isfinite(double)
    if np.any(arrived != np.isfinite(single)):
        return np.inf
    return float(np.abs(single[arrived] - double[arrived]).max())


def stuck_plates(**changes: object) -> Table:
    """Return two small bodies that stick together, so that the interface takes no energy."""
    return {
        "plane": "strain", "order": 4, "duration": 1e-3, "materials": {"default": HOMALITE},
        "mesh": {"kind": "two_plates", "length": 12e-3, "height": 4e-3, "element_size": 2e-3},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 1e6},
            "initial_stress": {"normal": 6e6},
        }},
        **changes,
    }  # fmt: skip


def energy_drift(steps: int, precision: str = "single") -> float:
    """Return the change of the energy of a standing wave over many steps, over the energy."""
    case = Case.model_validate(stuck_plates(precision=precision))
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    x = model.coordinates
    state.velocity.reshape(-1, 2)[:, 0] = np.cos(np.pi * (x[:, 0] - x[:, 0].min()) / np.ptp(x[:, 0]))
    energies = []
    for count in (100, steps - 100):
        for _ in range(count):
            motion.step(state)
        energy = model.energies(state)
        energies.append(energy["kinetic"] + energy["strain"])
    return abs(energies[1] / energies[0] - 1)


def slow_errors(steps: int, precision: str = "single") -> tuple[float, float]:
    """Return the relative errors of way and velocity of bodies that move on slowly, far from where they began."""
    velocity = {"upper": [SPEED, 0.0], "lower": [SPEED, 0.0]}
    case = Case.model_validate(stuck_plates(initial_velocity=velocity, precision=precision))
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    state.displacement.reshape(-1, 2)[:, 0] = AWAY
    assert SPEED * motion.dt < 1e-7 * AWAY
    for _ in range(steps):
        motion.step(state)
    way = (state.displacement.reshape(-1, 2)[:, 0] - AWAY) / (SPEED * motion.dt * steps) - 1
    rate = state.velocity.reshape(-1, 2) / SPEED - [1, 0]
    return float(np.abs(way).max()), float(np.abs(rate).max())
