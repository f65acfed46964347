"""Rows of `ruptfx check` on the data of a case, its unknowns, and what `ruptfx infer` would refuse."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ruptfx import RuptfxError
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.many_runs.adjoint.gradients import refuse
from ruptfx.many_runs.adjoint.unknowns import chosen
from ruptfx.many_runs.inference import searches
from ruptfx.many_runs.inference.evaluator import Evaluator
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.readings.misfits import Inference, Measured, Misfit
from ruptfx.run.model import Model

MOST = 4  # keys of unknowns in a note


def data_rows(model: Model) -> Iterator[Row]:
    """Yield the data of every term of the objective, the unknowns, and whether an inference accepts both."""
    case = model.case
    if not case.objective:
        if case.unknowns:
            note = "their data are absent: add entries [[objective]] before an inference"
            yield Row("unknowns", len(case.unknowns), "", note)
        return
    counts = []
    for number, term in enumerate(case.objective):
        measured = term.measured()
        if measured is None:
            yield Row(f"objective.{number}: {term.kind()}", "no traces", "", "a number of the run at its end")
        else:
            counts.append(sum(len(each.values) for each in measured))
            yield Row(f"objective.{number}: samples", counts[-1], "", _about(term, measured))
    if not case.unknowns or any(term.unit != "1" for term in case.objective):  # of `ruptfx gradient`
        try:
            refuse(model)
            chosen(model, case.unknowns)
            for number, term in enumerate(case.objective):
                term.requests(ModelReadings(model, lambda points: np.ones((len(points), 6))), f"objective.{number}")
        except RuptfxError as error:
            yield Row("gradient", "refused", "", str(error), "warning")
        return
    search = case.inference or Inference()
    try:
        evaluator = Evaluator(case, model.comm, 0.0, model=model)
        searches.check(search.method, case, evaluator.variables)
    except RuptfxError as error:
        yield Row("infer", "refused", "", str(error), "warning")
        return
    keys = [each.unknown.label for each in evaluator.variables]
    listed = ", ".join(keys[:MOST]) + (f" and {len(keys) - MOST} more" if len(keys) > MOST else "")
    free = int(np.count_nonzero(~evaluator.has_prior))
    note = f"{listed}; {free} of them without a prior, {sum(counts)} samples, inference.method = '{search.method}'"
    if free > sum(counts):
        note += "; give sigma, or fewer unknowns"
        yield Row("unknowns: variables", len(evaluator.has_prior), "", note, "warning")
    else:
        yield Row("unknowns: variables", len(evaluator.has_prior), "", note)


def _about(term: Misfit, measured: Sequence[Measured]) -> str:
    """Return number and length of traces, their window, and their size in standard deviations of the noise."""
    lengths = sorted({len(each.values) for each in measured})
    count = " to ".join(f"{each}" for each in ([lengths[0], lengths[-1]] if len(lengths) > 1 else lengths))
    measured = [each for each in measured if len(each.values)]
    if not measured:
        return f"{term.kind()}: no samples between begin and end"
    first, last = min(each.times[0] for each in measured), max(each.times[-1] for each in measured)
    traces = f"{len(measured)} trace{'s' * (len(measured) > 1)}"
    text = f"{term.kind()}: {traces} x {count} samples, {first:.4g} to {last:.4g} s"
    sigma: float | None = getattr(term, "sigma", None)
    if sigma is None:
        return text
    largest = max(float(np.abs(each.values).max()) for each in measured)
    return f"{text}; sigma = {sigma:.4g}, the largest value is {largest / sigma:.3g} times that"
