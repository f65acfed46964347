"""Methods of an inference: L-BFGS, Gauss-Newton, CMA-ES, and a sample of the posterior by an ensemble.

A method requests runs, one after the other or many at once, and keeps no files. With the same seed it requests the
same ones as long as it receives the same values, so that an inference goes on from the files of its runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.input.schema import CaseError

if TYPE_CHECKING:
    from ruptfx.case import Case
    from ruptfx.many_runs.inference.variables import Variable
    from ruptfx.readings.misfits import Inference

Floats = NDArray[np.float64]
Found = tuple[str, Floats | None]
"""Reason of the end, and samples of the variables, shape (count, n), or None."""
BURNED = 0.3
"""Part of the steps of an ensemble that is left out, in which it moves to the posterior."""
AT_ONCE = "cma_es", "ensemble"
"""Methods whose runs do not depend on each other within a generation or a step of the walkers."""
COLUMNS_AT_ONCE = ("gauss_newton",)
"""Methods whose runs depend on each other, and the columns of whose Jacobians do not."""
FIRST_STEP = 0.5
"""Standard deviation of the first generation of CMA-ES, in variables."""


class Runs(Protocol):
    """Runs that a method requests, of variables z; all are collective."""

    bounds: Floats

    def value(self, z: Floats) -> tuple[float, Floats]:
        """Return the sum of misfit and prior with its gradient."""
        ...

    def value_alone(self, z: Floats) -> float:
        """Return the sum of misfit and prior."""
        ...

    def values_alone(self, many: Sequence[Floats]) -> list[float]:
        """Return the sums of misfit and prior of runs that do not depend on each other."""
        ...

    def expect(self, count: int) -> None:
        """Set the largest number of runs of the search."""
        ...

    def residuals(self, z: Floats) -> Floats:
        """Return the residuals of data and prior."""
        ...

    def jacobian(self, z: Floats) -> Floats:
        """Return the derivative of the residuals, and count the run as an iterate."""
        ...

    def accept(self, z: Floats) -> None:
        """Count a run as an iterate."""
        ...

    def accept_best(self) -> None:
        """Count the best run as an iterate."""
        ...

    def tell(self, done: float, what: str) -> None:
        """Show the progress."""
        ...


def check(method: str, case: Case, variables: Sequence[Variable]) -> None:
    """Refuse what a method cannot do, before the first run.

    Raises
    ------
    RuptfxError
        A term is no sum of squares; an unknown of an ensemble has neither bounds nor a prior, or there are too few
        walkers; a library is missing.
    """
    if method == "gauss_newton":
        for number, term in enumerate(case.objective):
            if "squares" not in term.offers:
                raise CaseError(
                    f"objective.{number}.kind = '{term.kind()}': is no sum of squares, which inference.method = "
                    "'gauss_newton' needs; use method = 'l_bfgs'"
                )
    if method in AT_ONCE:
        _library(method)
    if method == "ensemble":
        for number, each in enumerate(variables):
            if not each.has_prior and not np.all(np.isfinite(each.box)):
                raise CaseError(
                    f"unknowns.{number}.sigma, bounds: inference.method = 'ensemble' samples between bounds or from a "
                    "prior; give one of them"
                )
        n, value = sum(each.size for each in variables), case.inference.population if case.inference else None
        if value is not None and value < 2 * n:
            raise CaseError(
                f"inference.population = {value}: an ensemble of {n} variables needs at least {2 * n} walkers"
            )


def _library(method: str) -> object:
    import importlib

    name = {"cma_es": "cma", "ensemble": "emcee"}[method]
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise RuptfxError(f"inference.method = '{method}' needs {name} ({error}): pip install 'ruptfx[search]'"
                          ) from None  # fmt: skip


def l_bfgs(inversion: Runs, settings: Inference) -> Found:
    """Minimise with gradients: L-BFGS-B of SciPy."""
    from scipy.optimize import minimize

    result = minimize(
        inversion.value, np.zeros(len(inversion.bounds)), jac=True, method="L-BFGS-B", bounds=inversion.bounds,
        callback=inversion.accept, options={
            "maxiter": settings.iterations, "ftol": settings.tolerance, "gtol": 0.0,
            "maxcor": 20, "maxfun": 10 * settings.iterations,
        },
    )  # fmt: skip
    return {0: "converged", 1: "iterations are used up"}.get(result.status, "no further decrease was found"), None


def gauss_newton(inversion: Runs, settings: Inference) -> Found:
    """Minimise with Jacobians: the trust-region reflective algorithm of SciPy, with Gauss-Newton's matrix."""
    from scipy.optimize import least_squares

    result = least_squares(
        inversion.residuals, np.zeros(len(inversion.bounds)), inversion.jacobian, tuple(inversion.bounds.T),
        method="trf", ftol=settings.tolerance, xtol=1e-6, gtol=None, max_nfev=settings.iterations,
    )  # fmt: skip
    reasons = {0: "iterations are used up", 3: "no further decrease was found"}
    return reasons.get(result.status, "converged"), None


def cma_es(inversion: Runs, settings: Inference) -> Found:
    """Minimise without derivatives: evolution with covariance matrix adaptation (Hansen, arXiv:1604.00772)."""
    import cma

    n, random = len(inversion.bounds), np.random.default_rng(settings.seed)
    low, high = inversion.bounds.T
    population = settings.population or 4 + int(3 * math.log(n))
    inversion.expect(1 + population * settings.iterations)
    inversion.value_alone(np.zeros(n))
    evolution = cma.CMAEvolutionStrategy(np.zeros(n), FIRST_STEP, {
        "bounds": [low, high], "popsize": population, "verbose": -9,
        "seed": math.nan, "signals_filename": "", "tolfun": 0.0, "tolfunrel": 0.0, "tolfunhist": 0.0,
        "randn": lambda *shape: random.standard_normal(shape),
    })  # fmt: skip
    best: list[float] = []
    for _ in range(settings.iterations):
        asked = evolution.ask()
        values = inversion.values_alone(asked)
        evolution.tell(asked, values)
        inversion.accept_best()
        best.append(min(values))
        recent = best[-5 - n :]
        if len(best) > 5 + n and max(recent) - min(recent) < settings.tolerance * abs(min(recent)):
            return "converged", None
        if evolution.stop():
            return "no further decrease was found", None
    return "iterations are used up", None


def ensemble(inversion: Runs, settings: Inference) -> Found:
    """Sample the posterior: affine-invariant ensemble of walkers (Goodman and Weare 2010; emcee, arXiv:1202.3665)."""
    import emcee

    n = len(inversion.bounds)
    count = settings.population or 2 * n + 2
    low, high = inversion.bounds.T
    inversion.expect(1 + count * (settings.iterations + 1))
    inversion.value_alone(np.zeros(n))

    def log_probabilities(walkers: Floats) -> Floats:
        values = np.full(len(walkers), -np.inf)
        inside = np.all((walkers >= low) & (walkers <= high), axis=1)
        values[inside] = [-value for value in inversion.values_alone(list(walkers[inside]))]
        return values

    sampler = emcee.EnsembleSampler(count, n, log_probabilities, vectorize=True)
    start = np.clip(0.1 * np.random.default_rng(settings.seed).normal(size=(count, n)), 0.9 * low, 0.9 * high)
    generator = np.random.RandomState(settings.seed).get_state()  # of the kind that emcee keeps
    begin = emcee.State(start, random_state=generator)
    for number, _ in enumerate(sampler.sample(begin, iterations=settings.iterations)):
        inversion.tell((number + 1) / settings.iterations, f"step {number + 1} of {count} walkers")
    inversion.accept_best()
    samples = sampler.get_chain(discard=int(BURNED * settings.iterations), flat=True)
    length = float(np.max(sampler.get_autocorr_time(tol=0)))
    enough = np.isfinite(length) and settings.iterations >= 50 * length
    report = f"correlated over {length:.3g} steps" if np.isfinite(length) else "correlation unknown"
    return f"{len(samples)} samples, {report}" + ("" if enough else "; longer chains are safer"), samples


METHODS: dict[str, Callable[[Runs, Inference], Found]] = {
    "l_bfgs": l_bfgs, "gauss_newton": gauss_newton, "cma_es": cma_es, "ensemble": ensemble,
}  # fmt: skip
