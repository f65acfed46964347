"""Recovery of the unknowns of a case from the data of its objective."""

from __future__ import annotations

import csv
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError, fem
from ruptfx.adjoint.gradients import Objective, refuse
from ruptfx.adjoint.history import LARGEST
from ruptfx.adjoint.unknowns import chosen, perturbed
from ruptfx.case import Case, read_case
from ruptfx.inference import evaluations
from ruptfx.inference.evaluations import Evaluation
from ruptfx.inference.result import Fit, Recovered, Result
from ruptfx.inference.variables import Variable
from ruptfx.misfits import Inference
from ruptfx.model import Model
from ruptfx.platform import parallel
from ruptfx.platform.progress import Progress, working
from ruptfx.schema import CaseError

Floats = NDArray[np.float64]


class Inversion:
    """An inference in its directory.

    Parameters
    ----------
    case : Case
    out : Path
    comm : MPI communicator
    progress : bool
    memory : float
        Largest memory of the history of the interfaces on all ranks [bytes].
    """

    def __init__(self, case: Case, out: Path, comm: fem.MPI.Comm, progress: bool, memory: float) -> None:
        self.case, self._out, self._comm, self._memory = case, out, comm, memory
        self._settings = case.inference or Inference()
        _check(case)
        with working("building the model", progress and comm.rank == 0):
            model = Model(case, comm)
        refuse(model)
        self._model = model.in_steps("explicit")
        self._variables = [
            Variable(self._model, unknown, place, f"unknowns.{number}")
            for number, (unknown, place) in enumerate(chosen(self._model, case.unknowns))
        ]
        self._ends = np.cumsum([0, *(each.size for each in self._variables)]).tolist()
        self._case_with(np.zeros(self._ends[-1]))  # refuses keys that take no profile before the first run
        self._runs: list[Evaluation] = []
        self._iterates: list[int] = []
        self._known: list[Evaluation] = parallel.on_root(comm, self._open)
        measured = [term.measured() for term in case.objective]
        self._data = 0 if None in measured else sum(len(each.values) for of_term in measured for each in of_term or [])

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
            change = (values - each.start)[self._model.faults[place.fault].interface.number]
            if place.nucleation is not None:
                amplitudes[place.fault, int(place.key.split(".")[-2])] = change
            for name, part in place.rows:
                changes[place.fault, name] = changes.get((place.fault, name), 0.0) + part * change
        return perturbed(self._model, changes, amplitudes)

    def _evaluate(self, z: Floats) -> Evaluation:
        """Make a run and its gradient; collective."""
        made = Objective(self.case, self.case.objective, self._comm, self._memory, model=self._changed(z))
        gradient, prior = np.zeros(len(z)), 0.0
        derivatives = made.gradient(self.case.unknowns)
        for each, found, (a, b) in zip(self._variables, derivatives, pairwise(self._ends), strict=True):
            if not self._runs and not np.any(found.values):
                raise RuptfxError(
                    f"unknowns: the objective does not depend on '{each.unknown.key}', its gradient is zero at all "
                    "points; remove it, or choose data that feel it"
                )
            gradient[a:b] = each.pull(z[a:b], found.values)
            if each.has_prior:
                gradient[a:b] += z[a:b]
                prior += 0.5 * float(z[a:b] @ z[a:b])
        readings = np.concatenate([sample.values for _, sample in made.samples])
        if not np.isfinite(made.value) or not np.all(np.isfinite(gradient)):
            raise RuptfxError("infer: misfit or gradient are not finite; give bounds to the unknowns")
        return Evaluation(z, made.value, prior, gradient, readings)

    def _value(self, z: Floats) -> tuple[float, Floats]:
        """Return the sum of misfit and prior with its gradient, from the files where it is there; collective."""
        number = len(self._runs)
        z = np.asarray(self._comm.bcast(z.copy(), root=0))  # the same bitwise on all ranks
        known = self._known[number] if number < len(self._known) else None
        if known is not None and known.variables.shape == z.shape and np.allclose(known.variables, z, 1e-9, 1e-12):
            made = known
        else:
            self._known = self._known[:number]
            made = self._comm.bcast(self._evaluate(z), root=0)
            parallel.on_root(self._comm, lambda: evaluations.save(self._out / "evaluations", number, made))
        self._runs.append(made)
        if number == 0:
            self._accept(z)
        return made.total, made.gradient.copy()

    def _accept(self, z: Floats) -> None:
        """Count a run as an iterate, and write the files; collective."""
        distances = [float(np.abs(run.variables - z).max()) for run in self._runs]
        number = int(np.argmin(distances))
        self._iterates.append(number)
        if number + 1 >= len(self._known):
            parallel.on_root(self._comm, self._write)
        done = (len(self._iterates) - 1) / self._settings.iterations
        self._bar.update(done, f"iteration {len(self._iterates) - 1}, run {len(self._runs)}, {self._told()}")

    def _told(self) -> str:
        misfit = self._runs[self._iterates[-1]].misfit
        return f"misfit {misfit:.6g}" + (f", {2 * misfit / self._data:.3g} of noise" if self._data else "")

    def minimise(self, show: bool) -> Result:
        """Minimise, and return the result; collective."""
        from scipy.optimize import minimize

        bounds = [pair for each in self._variables for pair in [each.box] * each.size]
        with Progress(show) as self._bar:
            found = minimize(
                self._value, np.zeros(self._ends[-1]), jac=True, method="L-BFGS-B", bounds=bounds,
                callback=self._accept, options={
                    "maxiter": self._settings.iterations, "ftol": self._settings.tolerance, "gtol": 0.0,
                    "maxcor": 20, "maxfun": 10 * self._settings.iterations,
                },
            )  # fmt: skip
        parallel.on_root(self._comm, self._write)
        reason = {0: "converged", 1: "iterations are used up"}.get(found.status, "no further decrease was found")
        best = self._runs[self._iterates[-1]]
        return Result(self._case_with(best.variables), self._recovered(best.variables), self._runs, self._iterates,
                      self._data, reason, self._fits(best))  # fmt: skip

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
            band = np.array([each.start * np.exp(s) if log else each.start + s for s in (-sigma, sigma)])
            found.append(Recovered(
                unknown.key, each.place.unit, unknown.shape, each.position, each.start, values, band,
                each.at_bound(z[a:b]),
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
            head = ["unknown", "unit", "shape", "case, mean", "best, mean", "best, min", "best, max", "at bound"]
            rows.writerow(head)
            for each in self._recovered(z):
                rows.writerow([each.key, each.unit, each.shape, each.start.mean(), each.best.mean(), each.best.min(),
                               each.best.max(), "yes" if each.at_bound else "no"])  # fmt: skip


def infer(
    case: Case, out: str | Path, comm: fem.MPI.Comm | None = None, progress: bool = True, memory: float = LARGEST
) -> Result:
    """Recover the unknowns of a case from the data of its objective; goes on with an unfinished directory; collective.

    Parameters
    ----------
    case : Case
        With `[[objective]]` and `[[unknowns]]`; its values are the start and the mean of the priors.
    out : str or Path
        Directory: `misfit.csv`, `unknowns.csv`, `best.toml`, `result.nc`, `inference.png`, and all runs.
    comm : MPI communicator, optional
        Default is all ranks of the job.
    progress : bool
        Show progress with the misfit on rank 0.
    memory : float
        Largest memory of the history of the interfaces on all ranks [bytes].

    Returns
    -------
    Result
        Best case, unknowns and runs.

    Raises
    ------
    RuptfxError
        On all ranks, before the first step: no data, no unknowns, bounds that exclude the case, a field without a
        prior, features without an adjoint, a directory of another case; after the first run: an unknown that the
        objective does not depend on.
    """
    comm = comm or fem.MPI.COMM_WORLD
    out = Path(out)
    made = Inversion(case, out, comm, progress, memory).minimise(progress and comm.rank == 0)

    def finish() -> None:
        from ruptfx.figure_style import save
        from ruptfx.inference.figure import draw

        made.dataset().to_netcdf(out / "result.nc", engine="h5netcdf")
        save(draw(made), out / "inference.png", "png")

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
        if fault is not None and ".initial_stress." in unknown.key and fault.initial_stress.tensor is not None:
            raise CaseError(
                f"unknowns.{number}.key = '{unknown.key}': the case gives the tensor of the bodies in its place; give "
                "normal and shear"
            )


def _without_settings(case: object) -> object:
    """Return the tables of a case without what only says when the search ends."""
    assert isinstance(case, Case)
    return {name: value for name, value in case.table().items() if name not in ("inference", "plugins")}

