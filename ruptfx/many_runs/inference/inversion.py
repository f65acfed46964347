"""Recovery of the unknowns of a case from the data of its objective."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.case import Case, read_case
from ruptfx.many_runs.adjoint.history import LARGEST
from ruptfx.many_runs.adjoint.sweeps import Told
from ruptfx.many_runs.inference import evaluations, posterior, searches
from ruptfx.many_runs.inference.evaluations import Derivatives, Evaluation
from ruptfx.many_runs.inference.evaluator import Evaluator
from ruptfx.many_runs.inference.pool import Pool, check_method, check_ranks, interruptible, kept_runs, opened
from ruptfx.many_runs.inference.posterior import Posterior
from ruptfx.many_runs.inference.result import Fit, Recovered, Result
from ruptfx.platform import fem, parallel, run_files
from ruptfx.platform.progress import Progress
from ruptfx.readings.misfits import Inference
from ruptfx.run.simulation import interruptible_progress

Floats = NDArray[np.float64]
DRAWS = 4000
"""Samples that are drawn of a normal posterior."""


@contextmanager
def _bar(show: bool) -> Iterator[Told]:
    """Yield the report of a progress bar."""
    with Progress(show) as bar:
        yield bar.update


class Inversion:
    """An inference in its directory.

    Parameters
    ----------
    comm : MPI communicator
    memory : float
        Largest memory of the history of the interfaces and of checkpoints on all ranks [bytes].

    Attributes
    ----------
    evaluator : Evaluator
    has_prior : ndarray of bool, shape (variables,)
    bounds : ndarray, shape (variables, 2)
    pool : Pool, optional
        Processes that make the runs; without it this one does.
    finished : int
        Number of runs that are known.
    reporting : callable
        Context in which the progress is reported, from whether it is shown.
    """

    def __init__(self, case: Case, out: Path, comm: fem.MPI.Comm, progress: bool, memory: float) -> None:
        self.case, self._out, self._comm = case, out, comm
        self._settings = case.inference or Inference()
        self.evaluator = Evaluator(case, comm, memory, progress)
        self.has_prior, self.bounds = self.evaluator.has_prior, self.evaluator.bounds
        self.pool: Pool | None = None
        self._runs: list[Evaluation] = []
        self._iterates: list[int] = []
        self._expected = 0
        self._first_of_iteration = 0  # the number of its first run
        self._posterior: Posterior | None = None
        self.reporting: Callable[[bool], AbstractContextManager[Told]] = _bar
        self._report: Told = Progress(False).update
        searches.check(self._settings.method, case, self.evaluator.variables)
        self._known: dict[int, Evaluation] = parallel.on_root(comm, self._open)
        measured = [term.measured() for term in case.objective]
        self._data = 0 if None in measured else sum(len(each.values) for of_term in measured for each in of_term or [])

    def _open(self) -> dict[int, Evaluation]:
        """Write the case, or check that the directory has this one; return the runs that are there."""
        path = self._out / "case.toml"
        if path.exists():
            if _without_settings(read_case(path)) != _without_settings(self.case):
                raise RuptfxError(f"{self._out}: has an inference of another case; give another --out, or remove it")
            run_files.check_inputs(self._out)
        elif self._out.exists() and any(self._out.iterdir()):
            raise RuptfxError(f"{self._out}: contains other files; give another --out")
        self._out.mkdir(parents=True, exist_ok=True)
        self.case.save(self._out)
        return evaluations.load(self._out / "evaluations")

    # -- runs --------------------------------------------------------------------------------------------------------

    def _evaluate(self, z: Floats, derivatives: Derivatives = "gradient") -> Evaluation:
        # After a run with a gradient more runs may follow in an iteration, after one with a history the Jacobian.
        part = {"gradient": 0.5, "history": 1 / (1 + len(z))}.get(derivatives, 1.0)
        report = self._told_within(0.0, part, len(self._runs))
        return self.evaluator.evaluate(z, derivatives, first=not self._runs, tell=report)

    def _known_run(self, number: int, z: Floats, derivatives: Derivatives) -> Evaluation | None:
        """Return a run from its file; without it forget those after it, which may be of another search."""
        known = self._known.get(number)
        if (
            known is not None
            and (derivatives != "gradient" or len(known.gradient))
            and (known.variables.shape == z.shape and np.allclose(known.variables, z, 1e-9, 1e-12))
        ):
            return known
        return None

    def _run(self, z: Floats, derivatives: Derivatives) -> Evaluation:
        """Return a run, from its file where it is there; collective."""
        number = len(self._runs)
        z = np.asarray(self._comm.bcast(np.array(z, float), root=0))  # the same bitwise on all ranks
        made = self._known_run(number, z, derivatives)
        if made is None and self.pool is not None:
            (made,) = self.pool.make({number: z}, derivatives)
        elif made is None:
            made = self._comm.bcast(self._evaluate(z, derivatives), root=0)
            self._save(number, made)
        self._runs.append(made)
        return made

    def _save(self, number: int, made: Evaluation) -> None:
        parallel.on_root(self._comm, lambda: evaluations.save(self._out / "evaluations", number, made))

    # -- what searches request ---------------------------------------------------------------------------------------

    def value(self, z: Floats) -> tuple[float, Floats]:
        """Return the sum of misfit and prior with its gradient; collective."""
        made = self._run(z, "gradient")
        if len(self._runs) == 1:
            self.accept(z)
        return made.total, made.gradient.copy()

    def value_alone(self, z: Floats) -> float:
        """Return the sum of misfit and prior; collective. The first run has a gradient, which finds unfelt unknowns."""
        made = self._run(z, "none" if self._runs else "gradient")
        if len(self._runs) == 1:
            self.accept(z)
        return made.total

    def values_alone(self, many: Sequence[Floats]) -> list[float]:
        """Return the sums of misfit and prior of runs that do not depend on each other; collective.

        With a pool they are made at once. The first run has been made before.
        """
        if self.pool is None:
            items = []
            for z in many:
                items.append(self.value_alone(z))
                self._tell_runs(len(self._runs))
            return items
        begin = len(self._runs)
        asked = {begin + number: np.array(z, float) for number, z in enumerate(many)}
        known = {number: self._known_run(number, z, "none") for number, z in asked.items()}
        missing = {number: z for number, z in asked.items() if known[number] is None}
        done = begin + len(asked) - len(missing)
        made = self.pool.make(missing, "none", lambda count: self._tell_runs(done + count))
        remaining = iter(made)
        runs = [each or next(remaining) for each in known.values()]
        self._runs += runs
        return [each.total for each in runs]

    def expect(self, count: int) -> None:
        """Set the largest number of runs of a search, by which the progress of runs is shown."""
        self._expected = count

    def _tell_runs(self, count: int) -> None:
        if self._expected:
            self._report(min(count / self._expected, 1.0), f"run {count} of {self._expected}, {self._told()}")

    def residuals(self, z: Floats) -> Floats:
        """Return the residuals of the data, and of the prior the variables that have one; collective."""
        return np.concatenate([self._run(z, "history").residuals, np.asarray(z)[self.has_prior]])

    def jacobian(self, z: Floats) -> Floats:
        """Return the derivative of `residuals`, and count the run as an iterate; collective."""
        result = self._jacobian(self._nearest(z))
        self.accept(z)
        return np.concatenate([result, np.eye(len(z))[self.has_prior]])

    def _jacobian(self, number: int) -> Floats:
        """Return the derivative of the residuals of a run; collective."""
        run = self._runs[number]
        if run.jacobian.size:
            return run.jacobian
        count = len(run.variables)
        report, first = self._told_within(1 / (1 + count), 1.0, number), not self._iterates
        if self.pool is not None:

            def finished(done: int) -> None:
                report(done / count, f"variables {done} of {count}")

            jacobian = self.evaluator.assembled(self.pool.columns(number, run.variables, finished), first)
        else:
            jacobian = self.evaluator.jacobian(run.variables, first, report)
        self._runs[number] = replace(run, jacobian=jacobian)
        self._save(number, self._runs[number])
        return jacobian

    def _nearest(self, z: Floats) -> int:
        return int(np.argmin([float(np.abs(run.variables - z).max()) for run in self._runs]))

    def accept(self, z: Floats) -> None:
        """Count a run as an iterate, and write the files; collective."""
        self._iterates.append(self._nearest(z))
        self._first_of_iteration = len(self._runs)
        if self._iterates[-1] >= max(self._known, default=-1):
            parallel.on_root(self._comm, self._write)
        self.tell(self._part_done(0.0), f"iteration {len(self._iterates) - 1}")

    def accept_best(self) -> None:
        """Count the best run as an iterate; collective."""
        self.accept(min(self._runs, key=lambda run: run.total).variables)

    def tell(self, done: float, what: str) -> None:
        """Show the progress."""
        self._report(min(done, 1.0), f"{what}, run {len(self._runs)}, {self._told()}")

    def _part_done(self, part: float) -> float:
        """Return the finished part of a search, from that of the run in progress; the search may end earlier."""
        if self._expected:
            return (len(self._runs) + part) / self._expected
        return (len(self._iterates) + part) / (self._settings.iterations + 1)

    def _told_within(self, begin: float, end: float, number: int) -> Told:
        """Return what shows the progress of work on a run that takes a part of an iteration.

        The number of runs of an iteration is unknown: each further one takes half of the rest.
        """
        about = f"run {number + 1}" + (f", {self._told()}" if self._iterates else "")
        weight = 1.0 if self._expected else 0.5 ** max(number - self._first_of_iteration, 0)

        def told(done: float, text: str) -> None:
            part = 1 - weight * (1 - begin - (end - begin) * done)
            self._report(min(self._part_done(part), 1.0), f"{about}, {text}")

        return told

    def _told(self) -> str:
        misfit = self._runs[self._iterates[-1]].misfit
        return f"misfit {misfit:.6g}" + (f", {2 * misfit / self._data:.3g} of noise" if self._data else "")

    def search(self, show: bool) -> Result:
        """Search with the method of the case; collective."""
        with self.reporting(show) as self._report:
            reason, samples = searches.METHODS[self._settings.method](self, self._settings)
        number = self._iterates[-1]
        with self.reporting(show) as self._report:
            self._posterior = self._uncertainty(number, samples)
        parallel.on_root(self._comm, self._write)
        best = self._runs[number]
        case = self.evaluator.case_with(best.variables)
        return Result(case, self._recovered(best.variables), self._runs, self._iterates, self._data, reason,
                      self._fits(best), self._drawn())  # fmt: skip

    def _uncertainty(self, number: int, samples: Floats | None) -> Posterior | None:
        """Return the posterior; None for fields without `directions`, and without independent data; collective."""
        if samples is not None:
            return posterior.of_samples(samples)
        best, fields = self._runs[number], any(each.unknown.shape == "field" for each in self.evaluator.variables)
        if not self._data or not len(best.residuals):
            return None
        if best.jacobian.size or not fields:
            return posterior.of_jacobian(best.variables, self._jacobian(number), self.has_prior)
        if not self._settings.directions or not self.has_prior.all():
            return None
        path, settings = self._out / "posterior.npz", self._settings

        def stored() -> Posterior | None:
            if not path.exists():
                return None
            with np.load(path) as file:
                same = file["directions"] == settings.directions and np.array_equal(file["mean"], best.variables)
                return Posterior(best.variables, file["spread"], np.zeros((0, len(best.variables)))) if same else None

        if (known := parallel.on_root(self._comm, stored)) is not None:
            return known
        products = 0

        def product(change: Floats) -> Floats:
            nonlocal products
            products += 1
            self.tell(products / (2 * settings.directions), f"band, product {products}")  # about two for each
            return self.evaluator.curvature_times(best.variables, change)

        uncertainty = posterior.of_products(best.variables, product, settings.directions)
        parallel.on_root(self._comm, lambda: np.savez(path, mean=uncertainty.mean, spread=uncertainty.spread,
                                                      directions=settings.directions))  # fmt: skip
        return uncertainty

    def _drawn(self) -> dict[str, Floats]:
        """Return samples of the posterior of all numbers by their keys."""
        if self._posterior is None or any(each.unknown.shape == "field" for each in self.evaluator.variables):
            return {}
        draws = self._posterior.draws(DRAWS, *self.bounds.T)
        return {
            each.unknown.key: np.array([each.values(row)[0] for row in of_draws.T])
            for each, of_draws in self.evaluator.split(draws.T) if each.unknown.shape == "number"
        }  # fmt: skip

    # -- results -----------------------------------------------------------------------------------------------------

    def _recovered(self, z: Floats) -> list[Recovered]:
        items = []
        of_posterior = None if self._posterior is None else self.evaluator.split(self._posterior.spread)
        for number, (each, part) in enumerate(self.evaluator.split(z)):
            unknown, sigma = each.unknown, each.unknown.sigma or 0.0
            log = unknown.scale == "log"
            interval = None
            if self._posterior is not None and of_posterior is not None:
                interval = each.interval(part, of_posterior[number][1])
                if len(self._posterior.samples):
                    _, of_samples = self.evaluator.split(self._posterior.samples.T)[number]
                    values_of = [each.values(row) for row in of_samples.T]
                    interval = np.quantile(values_of, [0.16, 0.84], axis=0)
            band = np.array([each.start * np.exp(s) if log else each.start + s for s in (-sigma, sigma)])
            items.append(Recovered(
                unknown.key, each.place.unit, unknown.shape, each.position, each.start, each.values(part), band,
                each.at_bound(part), interval, each.place.of_points,
            ))  # fmt: skip
        return items

    def _fits(self, best: Evaluation) -> list[Fit]:
        fits: list[Fit] = []
        if not self._data:
            return fits
        begin = 0
        for term in self.case.objective:
            for each in term.measured() or []:
                part = slice(begin, begin := begin + len(each.values))
                readings = self._runs[0].readings[part], best.readings[part]
                fits.append(Fit(each.name, each.times, each.values, *readings, each.unit))
        return fits

    def _write(self) -> None:
        """Write misfits, the best case and the unknowns; rank 0."""
        with (self._out / "misfit.csv").open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(["run", "iteration", "misfit", "prior", "misfit over that of noise"])
            for number, run in enumerate(self._runs):
                iteration = self._iterates.index(number) if number in self._iterates else ""
                rows.writerow([number + 1, iteration, run.misfit, run.prior,
                               2 * run.misfit / self._data if self._data else ""])  # fmt: skip
        z = self._runs[self._iterates[-1]].variables
        (self._out / "best.toml").write_text(self.evaluator.case_with(z).to_toml(), encoding="utf-8")
        with (self._out / "unknowns.csv").open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            head = ["unknown", "unit", "shape", "case, mean", "best, mean", "best, min", "best, max",
                    "68 % from, mean", "68 % to, mean", "at bound"]  # fmt: skip
            rows.writerow(head)
            for each in self._recovered(z):
                interval = ["", ""] if each.interval is None else each.interval.mean(axis=1).tolist()
                rows.writerow([each.key, each.unit, each.shape, each.start.mean(), each.best.mean(), each.best.min(),
                               each.best.max(), *interval, "yes" if each.at_bound else "no"])  # fmt: skip


def infer(  # noqa: PLR0913
    case: Case, out: str | Path, comm: fem.MPI.Comm | None = None, progress: bool = True, memory: float = LARGEST, *,
    cores: int = 1, ranks: int = 1, scheduler: str | None = None,
) -> Result:  # fmt: skip
    """Recover the unknowns of a case from the data of its objective; goes on with an unfinished directory; collective.

    Parameters
    ----------
    case : Case
        With `[[objective]]` and `[[unknowns]]`; its values are the start and the mean of the priors.
    out : str or Path
        Directory: `misfit.csv`, `unknowns.csv`, `best.toml`, `result.nc`, `inference.png`, `tradeoffs.png`, and all
        runs.
    comm : MPI communicator, optional
        Default is all ranks of the job.
    progress : bool
        Show progress with the misfit on rank 0.
    memory : float
        Largest memory of the history of the interfaces and of checkpoints on all ranks [bytes].
    cores : int
        With more than one, processes as those of a study compute at once the runs of a generation of `cma_es` and of
        the walkers of `ensemble`, and the columns of the Jacobians of `gauss_newton`. The result does not depend on it.
    ranks : int
        MPI ranks of each of these runs.
    scheduler : str, optional
        Address of a dask scheduler whose workers make these runs, and see `out` under the same path.

    Returns
    -------
    Result
        Best case, unknowns with intervals, samples and runs.

    Raises
    ------
    RuptfxError
        On all ranks, before the first step: no data, no unknowns, bounds that exclude the case, a field without a
        prior, features without an adjoint, a directory of another case; after the first run: an unknown that the
        objective does not depend on. With `cores` or `scheduler`: another method, or ranks that share this call;
        dask.distributed is missing, a run has failed; after Ctrl-C or SIGTERM, with the number of runs that are kept.
    """
    comm = fem.world(comm)
    out = Path(out)
    pooled = cores > 1 or ranks > 1 or scheduler is not None
    if pooled:
        check_method(case)
        check_ranks(comm)
    inversion, show = Inversion(case, out, comm, progress, memory), progress and comm.rank == 0
    if pooled:
        with opened(out.absolute(), memory, cores, ranks, scheduler) as inversion.pool:
            made = inversion.search(show)
    elif comm.size == 1:
        with interruptible(out):
            made = inversion.search(show)
    else:  # an interrupt of one rank would leave the others in a collective call
        inversion.reporting = lambda show: interruptible_progress(comm, show, lambda: kept_runs(out))
        made = inversion.search(show)

    def finish() -> None:
        from ruptfx.many_runs.inference.figure import draw, draw_tradeoffs
        from ruptfx.results.figure_style import save
        from ruptfx.results.hdf5 import write_netcdf

        write_netcdf(made.dataset(), out / "result.nc")
        save(draw(made), out / "inference.png", "png")
        if len(made.samples) > 1:
            save(draw_tradeoffs(made), out / "tradeoffs.png", "png")

    parallel.on_root(comm, finish)
    return made


def _without_settings(case: object) -> object:
    """Return the tables of a case without what only says when the search ends."""
    assert isinstance(case, Case)
    return {name: value for name, value in case.table().items() if name not in ("inference", "plugins")}
