"""Shared part of the rupture benchmarks: run a case in memory and sample the interface at every step."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check
from ruptfx.bodies.state import State
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.results.analysis.front import crossing
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

Array = np.ndarray

ROCK = {"kind": "isotropic_elastic", "density": 2670.0, "young_modulus": 80092391910.0, "poisson_ratio": 0.25}
"""c_p 6000, c_s 3464 m/s: nu = (c_p^2 - 2 c_s^2) / (2 (c_p^2 - c_s^2)) = 0.25 to four digits."""


def elastic(c_p: float, c_s: float, density: float) -> Table:
    """Return the material table of given wave speeds in plane strain."""
    nu = (c_p**2 - 2 * c_s**2) / (2 * (c_p**2 - c_s**2))
    young = 2 * (1 + nu) * density * c_s**2
    return {"kind": "isotropic_elastic", "density": density, "young_modulus": young, "poisson_ratio": nu}


@dataclass(frozen=True)
class Rupture:
    """Result of one run.

    Attributes
    ----------
    position : ndarray, shape (n,)
        Along the interface [m].
    time : ndarray, shape (k,)
        Time of the slip rates [s], the middle of a step.
    slip_rate : ndarray, shape (k, n)
        At every `stride`-th step [m/s].
    opening : ndarray, shape (k, n)
        [m]
    fields : dict of ndarray, shape (n,)
        The interface at the end.
    closure : float
        Largest unaccounted energy over the largest work or, without work, the largest energy.
    seconds : float
        Processor time of the steps.
    """

    position: Array
    time: Array
    slip_rate: Array
    opening: Array
    fields: dict[str, Array]
    closure: float
    seconds: float
    model: Model
    state: State

    def rupture_time(self, threshold: float) -> Array:
        """Return the first passage of the threshold [s], interpolated between steps; NaN if none; shape (n,)."""
        rate = np.abs(self.slip_rate)
        first = np.argmax(rate > threshold, axis=0)
        slid, point = rate.max(axis=0) > threshold, np.arange(rate.shape[1])
        before = np.maximum(first - 1, 0)
        part = crossing(np.maximum(rate[before, point], 1e-30), np.maximum(rate[first, point], 1e-30), threshold)
        when = self.time[before] + np.clip(part, 0, 1) * (self.time[first] - self.time[before])
        return np.where(slid, when, np.nan)

    def slip_time(self, slip: float) -> Array:
        """Return the time at which the slip reaches a value [s], NaN if never; shape (n,). Needs `stride` 1."""
        step = self.time[2] - self.time[1]
        slips = np.cumsum(np.abs(self.slip_rate), axis=0) * step
        first = np.argmax(slips > slip, axis=0)
        rate = np.take_along_axis(np.abs(self.slip_rate), first[None], axis=0)[0]
        after = np.take_along_axis(slips, first[None], axis=0)[0]
        # The rate is constant over a step.
        when = self.time[first] + 0.5 * step - (after - slip) / np.maximum(rate, 1e-300)
        return np.where(slips[-1] > slip, when, np.nan)

    def mean_peak(self, over: float) -> Array:
        """Return the largest running mean of the slip rate over a time `over` [s], in m/s; shape (n,)."""
        width = max(1, round(over / (self.time[2] - self.time[1])))
        total = np.cumsum(np.abs(self.slip_rate), axis=0)
        return (total[width:] - total[:-width]).max(axis=0) / width

    def at(self, position: float) -> int:
        """Return the index of the nearest point."""
        return int(np.argmin(np.abs(self.position - position)))

    def budget(self, source: str = "exact", tolerance: float = 1e-3) -> Check:
        """Return the check of the energy closure that every benchmark has."""
        return Check("energy closure", 0.0, self.closure, tolerance, "1", source)


def rupture(table: Table, stride: int = 1, energies: int = 10, comm: MPI.Comm | None = None) -> Rupture:
    """Run a case in memory on one rank.

    Parameters
    ----------
    table : dict
        The case.
    stride : int
        Steps between samples of the slip rate.
    energies : int
        Number of evaluations of the energy budget.
    """
    case = Case.model_validate(table)
    model = Model(case, comm or fem.MPI.COMM_SELF)
    motion = case.stepper.bind(model)
    state = model.initial_state()
    fault = model.faults[0]
    steps = int(np.ceil(case.duration / motion.dt * (1 - 1e-9))) + 1  # tractions are a step behind
    zero = np.zeros(len(fault.interface.position))
    times, rates, gaps, lost, scale = [0.0], [zero], [zero], [0.0], 1e-300
    seconds = 0.0
    for step in range(1, steps + 1):
        began = time.process_time()
        motion.step(state)
        seconds += time.process_time() - began
        if step % stride == 0:
            times.append(state.fault_time)
            rates.append(fault.components(state.faults[fault.name], "slip_rate")[:, 0].copy())
            gaps.append(state.faults[fault.name]["opening"].copy())
        if step % max(1, steps // energies) == 0 or step == steps:
            energy = model.energies(state)
            lost.append(energy["boundary_work"] - sum(v for name, v in energy.items() if name != "boundary_work"))
            scale = max(scale, *map(abs, energy.values()))
    fields = {name: value.copy() for name, value in state.faults[fault.name].items()}
    closure = float(np.abs(lost).max() / scale)
    time_, rate, gap = (np.array(values) for values in (times, rates, gaps))
    return Rupture(fault.interface.position, time_, rate, gap, fields, closure, seconds, model, state)
