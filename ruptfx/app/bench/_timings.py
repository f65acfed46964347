"""Timings that users notice: a fault problem to a given error, and the start of a run."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from ruptfx import RuptfxError, Table
from ruptfx.app.bench import Check
from ruptfx.app.bench._rupture import Rupture, elastic, rupture

SOURCE = "aim, one core"
HALF, HEIGHT = 30e3, 24e3  # m; edges absorb, and what they send back reaches the fault's ends in the last second
FAULT = 15e3  # m, half-length
DURATION = 9.0  # s
# Wall-clock time [s] of a fresh process until the named line has run.
PHASES = """
import time
began = time.perf_counter()
import json, sys
from ruptfx.app.bench.speed import problem
from ruptfx.run.model import Model
case = problem(2, 4, "affine", int(sys.argv[1]))
imported = time.perf_counter()
model = Model(case)
built = time.perf_counter()
motion, state = case.stepper.bind(model), model.initial_state()
motion.step(state)
print(json.dumps([t - began for t in (imported, built, time.perf_counter())]))
"""


def fault_case(spacing: float, half: bool, height: float = HEIGHT) -> Table:
    """Return in-plane slip weakening in uniform stress, order 5, nodes `spacing` [m] apart.

    The body is `height` [m] high; with `half`, only its antisymmetric half is meshed.
    """
    edges = ["upper.left", "upper.right", "upper.top"]
    if not half:
        edges += ["lower.left", "lower.right", "lower.bottom"]
    mesh = {"length": 2 * HALF, "height": height, "left": -HALF, "element_size": 5 * spacing}
    return {
        "plane": "strain", "order": 5, "duration": DURATION, "positions": "x",
        "mesh": {"kind": "half_plate" if half else "two_plates", **mesh},
        "materials": {"default": elastic(6000.0, 3464.0, 2670.0)},
        "damping": {"kelvin_voigt": {"fraction": 0.1}},
        "faults": {"main": {
            "contact": {"kind": "split_node"},
            "friction": {
                "kind": "linear_slip_weakening", "mu_d": 0.525, "D_c": 0.4,
                "mu_s": {"kind": "boxcar", "inside": 0.677, "outside": 1e4, "center": 0.0, "half_width": FAULT},
            },
            "initial_stress": {"normal": 120e6, "shear": 70e6},
            "nucleation": {"kind": "overstress", "extra": {
                "kind": "boxcar", "inside": 11.6e6, "outside": 0.0, "center": 0.0, "half_width": 1.5e3,
            }},
        }},
        "boundaries": [{"kind": "absorbing", "edge": edge} for edge in edges],
    }  # fmt: skip


def time_to_error(fine: bool) -> list[Check]:
    """Measure the processor time of the fault problem at 100 m, half and full model, and its errors."""
    runs = {name: rupture(fault_case(100.0, name == "half"), energies=1) for name in ("half", "full")}
    spacing = 25.0 if fine else 50.0
    reference = rupture(fault_case(spacing, half=True), energies=1)
    what, own = "fault problem, 15 km half-length, 100 m, order 5, 9 s", f"own {spacing:g} m"
    checks = [
        Check(f"{what}, {name} model", limit, runs[name].seconds, 0, "s, CPU", SOURCE, "at most")
        for name, limit in (("half", 1.5), ("full", 5.0))
    ]
    # 0.5 % as for TPV205; 10 % is the corridor that code comparisons give slip rates.
    limits = (("rupture time", 5e-3), ("slip rate", 0.1))
    for (quantity, limit), error in zip(limits, errors(runs["half"], reference), strict=True):
        checks.append(Check(f"its error: {quantity}, RMS", 0.0, error, limit, "1", own))
    return checks


def errors(run: Rupture, reference: Rupture) -> tuple[float, float]:
    """Return the relative RMS errors of the rupture times, and of all slip-rate histories of the stations."""
    stations = np.arange(-14.5e3, 14.501e3, 0.5e3)  # corners of elements in all meshes
    stations = stations[np.abs(stations) > 2e3]
    when, true = (np.interp(stations, r.position, r.rupture_time(1e-3)) for r in (run, reference))
    rates = [r.slip_rate[:, [r.at(x) for x in stations]] for r in (run, reference)]
    there = np.stack([np.interp(run.time, reference.time, column) for column in rates[1].T], axis=1)
    return (
        float(np.sqrt(np.mean((when / true - 1) ** 2))),
        float(np.linalg.norm(rates[0] - there) / np.linalg.norm(there)),
    )


def start_up() -> list[Check]:
    """Measure the wall-clock time of a fresh process to the first step, and to a large model; code is compiled."""
    _phases(1_000)  # compiles the code if it is not in the cache
    first = float(np.median([_phases(200_000)[2] for _ in range(3)]))
    return [
        Check("start to first step, 0.2 M nodes", 4.0, first, 0, "s", SOURCE, "at most"),
        Check("mesh and model, 4 M nodes", 60.0, _phases(4_000_000)[1], 0, "s", SOURCE, "at most"),
    ]


def _phases(nodes: int) -> list[float]:
    done = subprocess.run(
        [sys.executable, "-c", PHASES, str(nodes)], capture_output=True, text=True, check=False, timeout=1200
    )
    if done.returncode:
        raise RuptfxError(f"bench speed, start of {nodes} nodes: {done.stderr.strip()[-2000:]}")
    return [float(value) for value in done.stdout.strip().strip("[]").split(",")]
