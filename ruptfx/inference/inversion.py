"""Recovery of the unknowns of a case from the data of its objective."""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError, fem
from ruptfx.adjoint.gradients import Derivative, Objective, refuse
from ruptfx.adjoint.history import LARGEST
from ruptfx.adjoint.unknowns import Place, chosen, perturbed
from ruptfx.case import Case, read_case
from ruptfx.inference import evaluations, posterior, searches
from ruptfx.inference.evaluations import Evaluation
from ruptfx.inference.posterior import Posterior
from ruptfx.inference.result import Fit, Recovered, Result
from ruptfx.inference.variables import Variable
from ruptfx.instruments._readings import ModelReadings
from ruptfx.misfits import Inference, Misfit
from ruptfx.model import Model
from ruptfx.platform import parallel
from ruptfx.platform.progress import Progress, working
from ruptfx.schema import CaseError

Floats = NDArray[np.float64]
DRAWS = 4000
"""Samples that are drawn of a normal posterior."""


class Inversion:
    """An inference in its directory.

    Parameters
    ----------
    case : Case
    out : Path
    comm : MPI communicator
    progress : bool
    memory : float
        Largest memory of the history of the interfaces and of checkpoints on all ranks [bytes].

    Attributes
    ----------
    has_prior : ndarray of bool, shape (variables,)
    bounds : ndarray, shape (variables, 2)
    """

    def __init__(self, case: Case, out: Path, comm: fem.MPI.Comm, progress: bool, memory: float) -> None:
        self.case, self._out, self._comm, self._memory = case, out, comm, memory
        self._settings = case.inference or Inference()
        _check(case)
        with working("building the model", progress and comm.rank == 0):
            model = Model(case, comm)
        refuse(model)
        self._model = model.in_steps("explicit")
        for number, (unknown, place) in enumerate(chosen(self._model, case.unknowns)):
            if place.constant is not None:
                raise CaseError(
                    f"unknowns.{number}.key = '{unknown.key}': infer recovers quantities of interfaces, and this is a "
                    "constant of bodies; remove it, ruptfx gradient has its sensitivity"
                )
        self._variables = [
            Variable(self._model, unknown, place, f"unknowns.{number}")
            for number, (unknown, place) in enumerate(chosen(self._model, case.unknowns))
        ]
        self._ends = np.cumsum([0, *(each.size for each in self._variables)]).tolist()
        self._check_bounds_of_terms()
        self._case_with(np.zeros(self._ends[-1]))  # refuses keys that take no profile before the first run
        self._runs: list[Evaluation] = []
        self._iterates: list[int] = []
        self._last: Objective | None = None
        self._posterior: Posterior | None = None
        self.has_prior = np.concatenate([np.full(each.size, each.has_prior) for each in self._variables])
        self.bounds = np.concatenate([np.tile(each.box, (each.size, 1)) for each in self._variables])
        searches.check(self._settings.method, case, self._variables)
        self._known: list[Evaluation] = parallel.on_root(comm, self._open)
        measured = [term.measured() for term in case.objective]
        self._data = 0 if None in measured else sum(len(each.values) for of_term in measured for each in of_term or [])

    def _check_bounds_of_terms(self) -> None:
        """Refuse bounds of a parameter of a term at which its data leave the run; collective."""
        bodies = ModelReadings(self._model, lambda points: np.zeros((len(points), 6)))
        for each in self._variables:
            if each.place.term is not None and each.unknown.bounds is not None:
                number, name = each.place.term
                for bound in each.unknown.bounds:
                    self.case.objective[number].substituted({name: bound}).requests(bodies, f"objective.{number}")

    def _open(self) -> list[Evaluation]:
        """Write the case, or check that the directory has this one; return the runs that are there."""
        path = self._out / "case.toml"
        if path.exists():
            if _without_settings(read_case(path)) != _without_settings(self.case):
                raise RuptfxError(f"{self._out}: has an inference of another case; give another --out, or remove it")
        elif self._out.exists() and any(self._out.iterdir()):
            raise RuptfxError(f"{self._out}: contains other files; give another --out")
        self._out.mkdir(parents=True, exist_ok=True)
        self.case.save(self._out)
        return evaluations.load(self._out / "evaluations")

    # -- runs --------------------------------------------------------------------------------------------------------

    def _values(self, z: Floats) -> list[Floats]:
        return [each.values(z[a:b]) for each, (a, b) in zip(self._variables, pairwise(self._ends), strict=True)]

    def _changed(self, z: Floats) -> Model:
        """Return the model with the values of z."""
        changes: dict[tuple[int, str], Floats] = {}
        amplitudes: dict[tuple[int, int], Floats] = {}
        for each, values in zip(self._variables, self._values(z), strict=True):
            place = each.place
            if not place.of_points:
                continue
            change = (values - each.start)[self._model.faults[place.fault].interface.number]
            if place.nucleation is not None:
                amplitudes[place.fault, int(place.key.split(".")[-2])] = change
            for name, part in place.rows:
                changes[place.fault, name] = changes.get((place.fault, name), 0.0) + part * change
        return perturbed(self._model, changes, amplitudes)

    def _terms(self, z: Floats) -> list[Misfit]:
        """Return the terms of the objective with the values of z."""
        found = list(self.case.objective)
        for each, values in zip(self._variables, self._values(z), strict=True):
            if each.place.term is not None:
                number, name = each.place.term
                found[number] = found[number].substituted({name: float(values[0])})
        return found

    def _evaluate(self, z: Floats, derivatives: str = "gradient") -> Evaluation:
        """Make a run, with its gradient or with the history for a Jacobian; collective."""
        made = Objective(self.case, self._terms(z), self._comm, self._memory, model=self._changed(z),
                         record=derivatives != "none")  # fmt: skip
        self._last = made if derivatives == "jacobian" else None
        prior = 0.5 * float(np.sum(np.square(z[self.has_prior])))
        gradient = np.zeros(0)
        if derivatives == "gradient":
            gradient = self._pull(z, made.gradient(self.case.unknowns)) + np.where(self.has_prior, z, 0.0)
        readings = np.concatenate([sample.values for _, sample in made.samples])
        residuals = made.residuals()
        if not np.isfinite(made.value) or not np.all(np.isfinite(gradient)):
            raise RuptfxError("infer: misfit or gradient are not finite; give bounds to the unknowns")
        of_terms = np.zeros(0) if residuals is None else residuals[0]
        return Evaluation(z, made.value, prior, gradient, readings, of_terms, np.zeros((0, 0)))

    def _pull(self, z: Floats, derivatives: list[Derivative]) -> Floats:
        """Return the derivative by z from those by the unknowns at all points."""
        found = []
        for each, of_points, (a, b) in zip(self._variables, derivatives, pairwise(self._ends), strict=True):
            if not self._runs and not np.any(of_points.values):
                self._refuse_unfelt(each)
            found.append(each.pull(z[a:b], of_points.values))
        return np.concatenate(found)

    def _refuse_unfelt(self, variable: Variable) -> None:
        raise RuptfxError(
            f"unknowns: the objective does not depend on '{variable.unknown.key}', its gradient is zero at all "
            "points; remove it, or choose data that feel it"
        )

    def _push(self, z: Floats, change: Floats) -> list[tuple[Place, Floats]]:
        """Return the changes of the unknowns at all points from that of z."""
        return [
            (each.place, each.push(z[a:b], change[a:b]))
            for each, (a, b) in zip(self._variables, pairwise(self._ends), strict=True) if np.any(change[a:b])
        ]  # fmt: skip

    def _run(self, z: Floats, derivatives: str) -> Evaluation:
        """Return a run, from its file where it is there; collective."""
        number = len(self._runs)
        z = np.asarray(self._comm.bcast(np.array(z, float), root=0))  # the same bitwise on all ranks
        known = self._known[number] if number < len(self._known) else None
        if known is not None and (derivatives != "gradient" or len(known.gradient)) and (
            known.variables.shape == z.shape and np.allclose(known.variables, z, 1e-9, 1e-12)
        ):
            made = known
        else:
            self._known = self._known[:number]
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

    def residuals(self, z: Floats) -> Floats:
        """Return the residuals of the data, and of the prior the variables that have one; collective."""
        return np.concatenate([self._run(z, "jacobian").residuals, np.asarray(z)[self.has_prior]])

    def jacobian(self, z: Floats) -> Floats:
        """Return the derivative of `residuals`, and count the run as an iterate; collective."""
        found = self._jacobian(self._nearest(z))
        self.accept(z)
        return np.concatenate([found, np.eye(len(z))[self.has_prior]])

    def _nearest(self, z: Floats) -> int:
        return int(np.argmin([float(np.abs(run.variables - z).max()) for run in self._runs]))

    def _jacobian(self, number: int) -> Floats:
        """Return the derivative of the residuals of a run, by a tangent-linear sweep for each variable; collective."""
        run = self._runs[number]
        if run.jacobian.size:
            return run.jacobian
        made, factor = self._linearised(number)
        found = np.array([factor * made.change(self._push(run.variables, row)) for row in np.eye(self._ends[-1])]).T
        for each, (a, b) in zip(self._variables, pairwise(self._ends), strict=True):
            if not self._iterates and not np.any(found[:, a:b]):
                self._refuse_unfelt(each)
        if not np.all(np.isfinite(found)):
            raise RuptfxError("infer: the sensitivities are not finite; give bounds to the unknowns")
        found = self._comm.bcast(found, root=0)
        self._runs[number] = replace(run, jacobian=found)
        self._save(number, self._runs[number])
        return np.asarray(found)

    def _linearised(self, number: int) -> tuple[Objective, Floats]:
        """Return a run with its history, and the derivative of its residuals by the readings; collective."""
        made = self._last if number == len(self._runs) - 1 else None
        if made is None:
            z = self._runs[number].variables
            made = Objective(self.case, self._terms(z), self._comm, self._memory, model=self._changed(z))
        residuals = made.residuals()
        assert residuals is not None
        return made, residuals[1]

    def accept(self, z: Floats) -> None:
        """Count a run as an iterate, and write the files; collective."""
        self._iterates.append(self._nearest(z))
        if self._iterates[-1] + 1 >= len(self._known):
            parallel.on_root(self._comm, self._write)
        self.tell((len(self._iterates) - 1) / self._settings.iterations, f"iteration {len(self._iterates) - 1}")

    def accept_best(self) -> None:
        """Count the best run as an iterate; collective."""
        self.accept(min(self._runs, key=lambda run: run.total).variables)

    def tell(self, done: float, what: str) -> None:
        """Show the progress."""
        self._bar.update(min(done, 1.0), f"{what}, run {len(self._runs)}, {self._told()}")

    def _told(self) -> str:
        misfit = self._runs[self._iterates[-1]].misfit
        return f"misfit {misfit:.6g}" + (f", {2 * misfit / self._data:.3g} of noise" if self._data else "")

    def search(self, show: bool) -> Result:
        """Search with the method of the case; collective."""
        with Progress(show) as self._bar:
            reason, samples = searches.METHODS[self._settings.method](self, self._settings)
            number = self._iterates[-1]
            self._posterior = self._uncertainty(number, samples)
        parallel.on_root(self._comm, self._write)
        best = self._runs[number]
        return Result(self._case_with(best.variables), self._recovered(best.variables), self._runs, self._iterates,
                      self._data, reason, self._fits(best), self._drawn())  # fmt: skip

    def _uncertainty(self, number: int, samples: Floats | None) -> Posterior | None:
        """Return the posterior; None for fields without `directions`, and without independent data; collective."""
        if samples is not None:
            return posterior.of_samples(samples)
        best, fields = self._runs[number], any(each.unknown.shape == "field" for each in self._variables)
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
        made, factor = self._linearised(number)
        products = 0

        def product(change: Floats) -> Floats:
            nonlocal products
            products += 1
            self.tell(1.0, f"band, product {products}")
            of_readings = factor**2 * made.change(self._push(best.variables, change))
            found = self._pull(best.variables, made.pull(of_readings, self.case.unknowns))
            return np.asarray(self._comm.bcast(found, root=0))

        found = posterior.of_products(best.variables, product, settings.directions)
        parallel.on_root(self._comm, lambda: np.savez(path, mean=found.mean, spread=found.spread,
                                                      directions=settings.directions))  # fmt: skip
        return found

    def _drawn(self) -> dict[str, Floats]:
        """Return samples of the posterior of all numbers by their keys."""
        if self._posterior is None or any(each.unknown.shape == "field" for each in self._variables):
            return {}
        draws = self._posterior.draws(DRAWS, *self.bounds.T)
        return {
            each.unknown.key: np.array([each.values(row[a:b])[0] for row in draws])
            for each, (a, b) in zip(self._variables, pairwise(self._ends), strict=True)
            if each.unknown.shape == "number"
        }  # fmt: skip

    # -- results -----------------------------------------------------------------------------------------------------

    def _case_with(self, z: Floats) -> Case:
        """Return the case with the values of z: numbers, and tables along the interface."""
        case = self.case
        for each, values in zip(self._variables, self._values(z), strict=True):
            uniform = each.unknown.shape == "number" and float(np.ptp(each.start)) == 0
            order = np.argsort(each.position)
            case = case.changed(each.unknown.key, float(values[0]) if uniform else {
                "kind": "table", "positions": each.position[order].tolist(), "values": values[order].tolist(),
                "extend": True,
            })  # fmt: skip
        return case

    def _recovered(self, z: Floats) -> list[Recovered]:
        found = []
        for each, (a, b), values in zip(self._variables, pairwise(self._ends), self._values(z), strict=True):
            unknown, sigma = each.unknown, each.unknown.sigma or 0.0
            log = unknown.scale == "log"
            interval = None
            if self._posterior is not None:
                interval = each.interval(z[a:b], self._posterior.spread[a:b])
                if len(self._posterior.samples):
                    values_of = [each.values(row[a:b]) for row in self._posterior.samples]
                    interval = np.quantile(values_of, [0.16, 0.84], axis=0)
            band = np.array([each.start * np.exp(s) if log else each.start + s for s in (-sigma, sigma)])
            found.append(Recovered(
                unknown.key, each.place.unit, unknown.shape, each.position, each.start, values, band,
                each.at_bound(z[a:b]), interval,
            ))  # fmt: skip
        return found

    def _fits(self, best: Evaluation) -> list[Fit]:
        found: list[Fit] = []
        if not self._data:
            return found
        begin = 0
        for term in self.case.objective:
            for each in term.measured() or []:
                here = slice(begin, begin := begin + len(each.values))
                found.append(Fit(each.name, each.times, each.values, self._runs[0].readings[here], best.readings[here]))
        return found

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
        (self._out / "best.toml").write_text(self._case_with(z).to_toml(), encoding="utf-8")
        with (self._out / "unknowns.csv").open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            head = ["unknown", "unit", "shape", "case, mean", "best, mean", "best, min", "best, max",
                    "68 % from, mean", "68 % to, mean", "at bound"]  # fmt: skip
            rows.writerow(head)
            for each in self._recovered(z):
                interval = ["", ""] if each.interval is None else each.interval.mean(axis=1).tolist()
                rows.writerow([each.key, each.unit, each.shape, each.start.mean(), each.best.mean(), each.best.min(),
                               each.best.max(), *interval, "yes" if each.at_bound else "no"])  # fmt: skip


def infer(
    case: Case, out: str | Path, comm: fem.MPI.Comm | None = None, progress: bool = True, memory: float = LARGEST
) -> Result:
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

    Returns
    -------
    Result
        Best case, unknowns with intervals, samples and runs.

    Raises
    ------
    RuptfxError
        On all ranks, before the first step: no data, no unknowns, bounds that exclude the case, a field without a
        prior, features without an adjoint, a directory of another case; after the first run: an unknown that the
        objective does not depend on.
    """
    comm = comm or fem.MPI.COMM_WORLD
    out = Path(out)
    made = Inversion(case, out, comm, progress, memory).search(progress and comm.rank == 0)

    def finish() -> None:
        from ruptfx.figure_style import save
        from ruptfx.inference.figure import draw, draw_tradeoffs

        made.dataset().to_netcdf(out / "result.nc", engine="h5netcdf")
        save(draw(made), out / "inference.png", "png")
        if len(made.samples) > 1:
            save(draw_tradeoffs(made), out / "tradeoffs.png", "png")

    parallel.on_root(comm, finish)
    return made


def _check(case: Case) -> None:
    """Refuse a case without data or unknowns."""
    if not case.objective:
        raise CaseError("objective: there are no data; add an entry [[objective]], such as kind = 'traces'")
    if not case.unknowns:
        raise CaseError("unknowns: there are none; add entries [[unknowns]] with the keys to recover")
    for number, term in enumerate(case.objective):
        if term.unit != "1":
            raise CaseError(
                f"objective.{number}.kind = '{term.kind()}': is a quantity in {term.unit} and no misfit of data; use "
                "'traces' or 'final_slip'"
            )
    for number, unknown in enumerate(case.unknowns):
        fault = case.faults.get(unknown.key.split(".")[1]) if unknown.key.count(".") > 1 else None
        if fault is not None and ".initial_stress." in unknown.key and fault.initial_stress.normal is None:
            raise CaseError(
                f"unknowns.{number}.key = '{unknown.key}': the case gives the tensor of the bodies in its place; give "
                "normal and shear"
            )


def _without_settings(case: object) -> object:
    """Return the tables of a case without what only says when the search ends."""
    assert isinstance(case, Case)
    return {name: value for name, value in case.table().items() if name not in ("inference", "plugins")}

