"""Slip of an interface from the data of a case."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ruptfx.case import Case
from ruptfx.many_runs.adjoint.sweeps import Told
from ruptfx.many_runs.reconstruction.experiment import Experiment
from ruptfx.many_runs.reconstruction.posterior import Posterior, Prior, Rows, likeliest
from ruptfx.many_runs.reconstruction.responses import Responses
from ruptfx.many_runs.reconstruction.result import Curves, Reconstruction
from ruptfx.many_runs.reconstruction.twin import Motion, Twin
from ruptfx.platform import fem, parallel
from ruptfx.platform.progress import Progress, working
from ruptfx.readings.misfits import Reconstruction as Settings
from ruptfx.readings.misfits import Sample

Floats = NDArray[np.float64]
PASSES = 3
"""Solutions with clocks and gains linearised about the fit of the one before."""


@dataclass(frozen=True)
class Solution:
    """Posterior of the slip rate; the same on all ranks.

    Attributes
    ----------
    prior : dict of str to float
    mean, deviation, prior_deviation, slip_deviation : ndarray, shape (knots, n)
    samples : ndarray, shape (samples, knots, n)
    extra, extra_deviation : ndarray, shape (unknowns,)
        Over prior standard deviations.
    shifts : list of ndarray
        Changes of the readings of all channels by these unknowns.
    fit : list of ndarray
        Readings of all channels.
    """

    prior: dict[str, float]
    mean: Floats
    deviation: Floats
    prior_deviation: Floats
    slip_deviation: Floats
    samples: Floats
    extra: Floats
    extra_deviation: Floats
    shifts: list[Floats]
    fit: list[Floats]


def solve(experiment: Experiment, rows: Rows, twin: Twin, still: list[Sample], settings: Settings) -> Solution:
    """Return the posterior of the slip rate, on one rank."""
    times, position = twin.knots.times, twin.position
    known = {name: getattr(settings, name) for name in ("amplitude", "length", "time")}
    lengths = {name: parallel.three_digits(value) for name, value in likeliest(known, rows, position, times).items()}
    lengths |= {name: value for name, value in known.items() if value is not None}
    prior = Prior.of_lengths(**lengths, position=position, times=times)
    loaded = np.concatenate([sample.values for sample in still])
    posterior = Posterior(prior, rows)
    fit, changes = loaded + posterior.fit, np.zeros(len(loaded))
    for _ in range(PASSES if experiment.unknowns() else 0):
        columns = experiment.columns(experiment.split(fit))
        posterior = Posterior(prior, rows, columns)
        changes = columns @ posterior.extra
        fit = loaded + posterior.fit - changes
    knots = len(times)
    # Slip is the integral of a slip rate that is linear between the knots and zero before the first interval.
    summed = twin.knots.interval * (np.tril(np.ones((knots, knots))) - 0.5 * np.eye(knots))
    return Solution(
        lengths, prior.fields(posterior.mean), posterior.deviation(), prior.deviation(), posterior.deviation(summed),
        prior.fields(posterior.samples(settings.samples, settings.seed)), posterior.extra, posterior.extra_deviation,
        experiment.split(changes), experiment.split(fit),
    )  # fmt: skip


def reconstruct(
    case: Case, responses: str | Path | None = None, comm: fem.MPI.Comm | None = None, progress: bool = True
) -> Reconstruction:
    """Return slip rate, traction and friction along the interface of a case from its data; collective.

    Parameters
    ----------
    case : Case
        With `[[objective]]` entries of data; its friction law is not used.
    responses : str or Path, optional
        Folder of impulse responses, which are read where they are there and written where not.
    comm : MPI communicator, optional
        Default is all ranks of the job.
    progress : bool
        Show progress bars on rank 0.

    Raises
    ------
    RuptfxError
        On all ranks: no data or interface, bodies that are not linear, channels that see nothing of the interface, data
        outside of the run or at irregular times.
    """
    comm = fem.world(comm)
    show, settings = progress and comm.rank == 0, case.reconstruction or Settings()
    experiment, begun = Experiment(case), time.perf_counter()
    with working("building the model", show):
        twin = Twin(case, comm, interval=experiment.interval, begin=settings.begin, end=experiment.end)
    experiment.bind(twin.model)
    experiment.unknowns()  # refused before the first run
    readings = twin.readings(experiment.requests)
    with Progress(show) as bar:
        still = twin.run(readings, tell=bar.update)
    stored = Responses(twin, readings, experiment.sensors, None if responses is None else Path(responses))
    count, lags = len(experiment.channels), list[dict[str, Floats]]()
    with Progress(show) as bar:
        for number in range(count):
            lags.append(stored.lags(number, _part(bar.update, number, count, "channel")))
    rows = experiment.rows(
        twin.knots, lambda number, phase: twin.kernel(readings, number, lags[number], phase), still.samples
    )
    set_up, begun = time.perf_counter() - begun, time.perf_counter()
    with working("computing mean and deviation", show):
        solution = parallel.on_root(comm, lambda: solve(experiment, rows, twin, still.samples, settings))
    solved, begun = time.perf_counter() - begun, time.perf_counter()
    towards = np.sign(parallel.total(comm, float(np.sum(twin.fault.shear_traction_0)))) or 1.0
    samples = solution.samples
    if settings.positive:
        samples = towards * np.maximum(towards * samples, 0.0)
    motions = list[Motion]()
    with Progress(show) as bar:
        for number, slip_rate in enumerate([solution.mean, *samples]):
            motions.append(twin.run(readings, slip_rate, _part(bar.update, number, 1 + len(samples), "run")))
    curves = Curves(*(np.array([getattr(each, name) for each in motions])
                      for name in ("slip", "shear_traction", "normal_stress")))  # fmt: skip
    about = {
        "seconds": {"set_up": set_up, "posterior": solved, "runs": time.perf_counter() - begun},
        "responses_computed": stored.computed, "responses_read": stored.read,
        "time_step": twin.knots.dt, "begin": twin.knots.begin, "interval": twin.knots.interval,
        "positivity": "samples projected" if settings.positive else "not imposed",
        "fit_of_run": _closure(motions[0], solution),
    }  # fmt: skip
    unknowns = {
        unknown.key: (float(unknown.sigma or 0.0) * float(value), float(unknown.sigma or 0.0) * float(deviation),
                      experiment.terms[terms[0]].parameters[name])
        for (unknown, terms, name), value, deviation in zip(
            experiment.unknowns(), solution.extra, solution.extra_deviation, strict=True
        )
    }  # fmt: skip
    return Reconstruction(
        twin.position, twin.knots.times, solution.mean, solution.deviation, solution.prior_deviation,
        solution.slip_deviation, samples, curves, experiment.channels,
        [sample.values + shift for sample, shift in zip(motions[0].samples, solution.shifts, strict=True)],
        unknowns, solution.prior, settings.positions, about,
    )  # fmt: skip


def _part(tell: Told, number: int, count: int, name: str) -> Told:
    """Return a report of one of several parts."""
    return lambda done, text: tell((number + done) / count, f"{name} {number + 1} of {count}, {text}")


def _closure(motion: Motion, solution: Solution) -> float:
    """Return the largest difference of the run with the mean slip rate from the fit, over the largest reading."""
    pairs = [(sample.values, fit) for sample, fit in zip(motion.samples, solution.fit, strict=True)]
    return max(float(np.abs(run - fit).max() / max(np.abs(run).max(), 1e-300)) for run, fit in pairs)
