"""Slip of an interface from the data of a case."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ruptfx.case import Case
from ruptfx.many_runs.adjoint.sweeps import Told
from ruptfx.many_runs.jobs import stoppable
from ruptfx.many_runs.reconstruction.experiment import Experiment
from ruptfx.many_runs.reconstruction.geometry import Geometry
from ruptfx.many_runs.reconstruction.law_fit import POSITIONS, SAMPLES, Histories, LawFit, fit_law
from ruptfx.many_runs.reconstruction.needs import needs_of, refuse_large
from ruptfx.many_runs.reconstruction.posterior import Posterior, Prior, Rows, likeliest, stretched
from ruptfx.many_runs.reconstruction.responses import Responses
from ruptfx.many_runs.reconstruction.result import KNOWN, Curves, Reconstruction, Surface
from ruptfx.many_runs.reconstruction.twin import Tractions, Twin
from ruptfx.platform import fem, parallel
from ruptfx.platform.progress import working
from ruptfx.readings.misfits import Reconstruction as Settings
from ruptfx.readings.misfits import Sample
from ruptfx.run.simulation import interruptible_progress

Floats = NDArray[np.float64]
PASSES = 3
"""Solutions with clocks and gains linearised about the fit of the one before."""
FIELDS = ("slip_rate", "shear_traction", "normal_stress")
"""Fields whose samples minus their mean are stored: the data do not change them."""


@dataclass(frozen=True)
class Solution:
    """Posterior of the slip rate; the same on all ranks.

    Attributes
    ----------
    rates : ndarray, shape (1 + samples, knots, columns)
        The mean first [m/s].
    deviation, slip_deviation : ndarray, shape (knots, n)
        In the direction of the points [m/s], [m].
    component_deviation : ndarray, shape (knots, columns)
        Of the slip rate [m/s].
    curves : Curves
    extra, extra_deviation : ndarray, shape (unknowns,)
        Over prior standard deviations.
    fit : list of ndarray
        Readings of all channels, with the changes by these unknowns.
    law : LawFit or None
    seconds : float
        Of the law.
    """

    rates: Floats
    deviation: Floats
    slip_deviation: Floats
    component_deviation: Floats
    curves: Curves
    extra: Floats
    extra_deviation: Floats
    fit: list[Floats]
    law: LawFit | None
    seconds: float


@dataclass(frozen=True)
class Setting:
    """Specimen, sensors, prior settings and responses of an experiment: all input of `solve` besides the prior."""

    experiment: Experiment
    rows: Rows
    twin: Twin
    still: list[Sample]
    settings: Settings
    stored: Responses
    tractions: Tractions
    lengths: dict[str, float]
    towards: float
    chosen: NDArray[np.int64] | None


def lengths_of(rows: Rows, twin: Twin, settings: Settings) -> dict[str, float]:
    """Return amplitude, length and time of the prior, on one rank."""
    known = {name: getattr(settings, name) for name in ("amplitude", "length", "time", "dip_length")}
    likely = likeliest(known, rows, twin.geometry.locations, twin.knots.times, order=settings.order)
    return {name: value if known[name] is not None else parallel.three_digits(value) for name, value in likely.items()}


def solve(at: Setting, prior: Prior) -> Solution:
    """Return the posterior of the slip rate, on one rank."""
    experiment, rows, settings, geometry = at.experiment, at.rows, at.settings, at.twin.geometry
    in_direction = prior.of_columns(geometry.along)
    loaded = np.concatenate([sample.values for sample in at.still])

    def independent(made: Posterior) -> dict[str, Floats]:
        # Slip is the integral of a slip rate that is linear between the knots and zero before the first interval.
        deviation, summed = made.deviation(prior=in_direction), at.twin.slip(np.eye(len(prior.time)))
        result = {"factor": made.factor, "deviation": deviation,
                  "slip_deviation": made.deviation(summed, in_direction),
                  "component_deviation": deviation if geometry.tangents == 1 else made.deviation()}  # fmt: skip
        spread, of_law = made.spread(settings.samples, settings.seed), made.spread(SAMPLES, settings.seed + 1)
        for name, each, points in (
            ("", spread, slice(None)),
            ("law_", of_law, _points_of_law(at, in_direction, deviation)),
        ):
            fields = (Prior(prior.space[geometry.columns(points)], prior.time).fields(each),
                      *at.tractions.changes(prior.of_modes(each), points))  # fmt: skip
            result |= {f"{name}{of}": values for of, values in zip(FIELDS, fields, strict=True)}
        return result

    if experiment.unknowns():
        posterior, fit = Posterior(prior, rows), loaded
        for _ in range(PASSES):
            fit = loaded + posterior.fit - (posterior.change if posterior.extra.size else 0.0)
            posterior = Posterior(prior, rows, experiment.columns(experiment.split(fit)))
        known = independent(posterior)
    else:
        about = {
            **settings.model_dump(mode="json", include={"samples", "seed", "positions", "points"}),
            "lengths": at.lengths,
        }
        known = at.stored.posterior(prior, rows, about, lambda: independent(Posterior(prior, rows)))
        posterior = Posterior(prior, rows, factor=known["factor"])
    mean = posterior.mean[None]
    fields = (prior.fields(mean), *at.tractions.of(prior.of_modes(mean)))
    rates, *tractions = (np.concatenate([each, each + known[name]]) for name, each in zip(FIELDS, fields, strict=True))
    begun = time.perf_counter()
    law = None
    if len(points := _points_of_law(at, in_direction, known["deviation"])):
        columns = geometry.columns(points)
        histories = [
            np.concatenate([each, each + known[f"law_{name}"]])
            for name, each in zip(FIELDS, (fields[0][..., columns], fields[1][..., columns], fields[2][..., points]),
                                  strict=True)
        ]  # fmt: skip
        law = _law(at, points, histories, known["deviation"])
    return Solution(
        rates, known["deviation"], known["slip_deviation"], known["component_deviation"],
        _curves(geometry, at.twin.slip(rates), *tractions),
        posterior.extra, posterior.extra_deviation, experiment.split(loaded + posterior.fit), law,
        time.perf_counter() - begun,
    )  # fmt: skip


def _curves(geometry: Geometry, slip: Floats, shear_traction: Floats, normal_stress: Floats) -> Curves:
    return Curves(geometry.along(slip), geometry.along(shear_traction), normal_stress)


def _points_of_law(at: Setting, prior: Prior, deviation: Floats) -> NDArray[np.int64]:
    """Return the points where the law is fitted: those of the case, or known ones a correlation length apart."""
    geometry = at.twin.geometry
    if at.chosen is not None:
        return at.chosen
    known = 1 - np.mean(deviation**2, axis=0) / np.mean(prior.deviation() ** 2, axis=0)
    apart, points = max(at.lengths["length"], geometry.apart(POSITIONS)), list[int]()
    order = np.argsort(geometry.position)
    for each in order[np.argsort(-known[order], kind="stable")]:
        if known[each] >= KNOWN and all(geometry.distance(each, one) >= apart for one in points):
            points.append(int(each))
    return np.array(sorted(points), int)


def _law(at: Setting, points: NDArray[np.int64], histories: list[Floats], deviation: Floats) -> LawFit | None:
    """Return the law of the case fitted to slip rate, shear traction and normal stress at some points."""
    twin, geometry, (rates, shear, normal) = at.twin, at.twin.geometry, histories
    rates, shear = geometry.along(rates, points), geometry.along(shear, points)
    width = max(1, round(0.5 * at.lengths["time"] / twin.knots.interval))
    made = Histories(
        points, twin.knots.times, at.towards * rates, at.towards * shear, normal, deviation[:, points],
        (twin.normal_stress[points], np.abs(twin.shear_traction[points])), geometry.locations[points],
    )  # fmt: skip
    return fit_law(at.experiment.case, twin.fault.name, made, width)


def reconstruct(
    case: Case, responses: str | Path | None = None, comm: fem.MPI.Comm | None = None, progress: bool = True
) -> Reconstruction:
    """Return slip rate, traction and friction along the interface of a case from its data; collective.

    Parameters
    ----------
    case : Case
        With `[[objective]]` entries of data; its friction law is used for nothing but the fit to the result.
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
        outside of the run or at irregular times, and more memory or runs than there may be; after Ctrl-C or SIGTERM.
    """
    comm = fem.world(comm)
    show, settings = progress and comm.rank == 0, case.reconstruction or Settings()
    experiment, begun = Experiment(case), time.perf_counter()
    with working("building the model", show):
        twin = Twin(case, comm, interval=experiment.interval, begin=settings.begin, end=experiment.end)
    geometry = twin.geometry
    chosen = geometry.chosen(settings)
    experiment.bind(twin.model)
    experiment.unknowns()  # refused before the first run
    readings = twin.readings(experiment.requests)
    needs = needs_of(experiment, twin, readings)
    refuse_large(needs, twin, settings)
    stored = Responses(twin, readings, experiment.sensors, None if responses is None else Path(responses))
    reporting = partial(interruptible_progress, comm, show, lambda: _kept(stored, responses))
    with reporting() as report:
        still = twin.run(readings, tell=report)
    count, lags = len(experiment.channels), list[dict[str, Floats]]()
    with reporting() as report:
        for number in range(count):
            lags.append(stored.lags(number, _part(report, number, count, "channel")))
    rows = experiment.rows(
        twin.knots, lambda number, phase: twin.kernel(readings, number, lags[number], phase), still.samples
    )
    with working("lengths of the prior", show), _stoppable(comm, stored, responses):
        lengths = parallel.on_root(comm, lambda: lengths_of(rows, twin, settings))
        if settings.length is None or settings.time is None:
            refuse_large(needs, twin, settings, lengths["length"], lengths["time"])
        dip_length = lengths.get("dip_length")
        prior = Prior.of_lengths(
            lengths["amplitude"], lengths["length"], lengths["time"],
            stretched(geometry.locations, lengths["length"], dip_length), twin.knots.times, order=settings.order,
        )  # fmt: skip
    with reporting() as report:
        tractions = stored.tractions(still, prior, lengths["amplitude"], report)
    towards = (float(np.sign(np.sum(twin.shear_traction))) or 1.0) if geometry.tangents == 1 else 1.0
    at = Setting(experiment, rows, twin, still.samples, settings, stored, tractions, lengths, towards, chosen)
    set_up, begun = time.perf_counter() - begun, time.perf_counter()
    with working("computing mean and deviation", show), _stoppable(comm, stored, responses):
        solution = parallel.on_root(comm, lambda: solve(at, prior))
    mean, samples, curves = solution.rates[0], solution.rates[1:], solution.curves
    solved, begun = time.perf_counter() - begun - solution.seconds, time.perf_counter()
    if settings.positive:  # no sum of modes: one run each
        samples = geometry.without_reverse(samples, towards)
        with reporting() as report:
            motions = [
                twin.run(readings, each, _part(report, number, len(samples), "run"))
                for number, each in enumerate(samples)
            ]
        of_samples = _curves(geometry, *(
            np.array([getattr(each, name) for each in motions]) for name in ("slip", "shear_traction", "normal_stress")
        ))  # fmt: skip
        curves = Curves(*(
            np.concatenate([getattr(curves, name)[:1], getattr(of_samples, name)])
            for name in ("slip", "shear_traction", "normal_stress")
        ))  # fmt: skip
    about = {
        "seconds": {"set_up": set_up, "posterior": solved, "law": solution.seconds,
                    "runs": time.perf_counter() - begun},
        "responses_computed": stored.computed, "responses_read": stored.read,
        "time_step": twin.knots.dt, "begin": twin.knots.begin, "interval": twin.knots.interval,
        "order": settings.order, "positivity": "samples projected" if settings.positive else "not imposed",
    }  # fmt: skip
    unknowns = {
        unknown.key: (float(unknown.sigma or 0.0) * float(value), float(unknown.sigma or 0.0) * float(deviation),
                      experiment.terms[terms[0]].parameters[name])
        for (unknown, terms, name), value, deviation in zip(
            experiment.unknowns(), solution.extra, solution.extra_deviation, strict=True
        )
    }  # fmt: skip
    surface = None if geometry.dip is None else Surface(
        geometry, geometry.split(mean), geometry.split(solution.component_deviation), settings.map_times
    )  # fmt: skip
    return Reconstruction(
        twin.position, twin.knots.times, geometry.along(mean), solution.deviation,
        prior.of_columns(geometry.along).deviation(), solution.slip_deviation, geometry.along(samples), curves,
        experiment.channels, solution.fit, unknowns, lengths, chosen, about, solution.law, surface,
    )  # fmt: skip


def _stoppable(comm: fem.MPI.Comm, stored: Responses, folder: str | Path | None) -> AbstractContextManager[None]:
    """Let Ctrl-C and SIGTERM end a phase without reports of progress.

    On several ranks the next report does, as an interrupt of one rank would leave the others in a collective call.
    """
    return stoppable(lambda: _kept(stored, folder)) if comm.size == 1 else nullcontext()


def _kept(stored: Responses, folder: str | Path | None) -> str:
    """Return what is kept of a reconstruction that ends early, for its message."""
    if folder is None:
        return "nothing is kept"
    return f"responses of {stored.channels} channels are kept in {folder}, the same command continues"


def _part(tell: Told, number: int, count: int, name: str) -> Told:
    """Return a report of one of several parts."""
    return lambda done, text: tell((number + done) / count, f"{name} {number + 1} of {count}, {text}")
