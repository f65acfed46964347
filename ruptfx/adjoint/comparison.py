"""Comparison of a gradient with differences of runs, which finds kinks near the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ruptfx.adjoint.gradients import Derivative, Objective
from ruptfx.adjoint.unknowns import perturbed
from ruptfx.platform import parallel

SIZE = 1e-4
"""Change of an unknown over its largest value along the interface."""
CLOSE = 0.01
"""Largest relative disagreement without a warning."""


@dataclass(frozen=True)
class Comparison:
    """Derivative of the objective by a uniform change of one unknown, and by differences of two runs.

    Attributes
    ----------
    key, unit : str
        Of the unknown.
    change : float
        Added and subtracted at all points.
    by_gradient, by_differences : float
        Derivatives by the change.
    """

    key: str
    unit: str
    change: float
    by_gradient: float
    by_differences: float


def disagree(by_gradient: float, by_differences: float) -> bool:
    """Return whether two derivatives differ by more than a part in a hundred: the change crosses kinks or is large."""
    return abs(by_gradient - by_differences) > CLOSE * max(abs(by_gradient), abs(by_differences))


def compare(made: Objective, derivatives: Sequence[Derivative], size: float = SIZE) -> list[Comparison]:
    """Return derivatives by uniform changes of unknowns, and central differences; collective.

    Two runs are made for each unknown. Constants of bodies are left out.

    Parameters
    ----------
    made : Objective
        With the run of which the gradient is.
    derivatives : sequence of Derivative
    size : float
        Change over the largest value of the unknown; of an unknown that is zero, over that of the normal stress if it
        is a stress, else 1 in its unit.
    """
    found = []
    for each in derivatives:
        place = each.place
        if place.constant is not None:
            continue
        values = []
        if place.term is not None:
            number, name = place.term
            change = size * made.case.duration
            for sign in (1, -1):
                terms = list(made.terms)
                value = float(getattr(terms[number], name)) + sign * change
                terms[number] = terms[number].substituted({name: value})
                other = Objective(made.case, terms, made.model.comm, model=made.model, record=False)
                values.append(other.value)
        else:
            change = size * _scale(made, each)
            points = np.full(len(made.sweeps.points[place.fault].fault.interface.weight), change)
            for sign in (1, -1):
                if place.nucleation is not None:
                    amplitudes = {(place.fault, int(place.key.split(".")[-2])): sign * points}
                    view = perturbed(made.sweeps.model, {}, amplitudes)
                else:
                    rows = {(place.fault, name): sign * part * points for name, part in place.rows}
                    view = perturbed(made.sweeps.model, rows)
                other = Objective(made.case, made.terms, made.model.comm, model=view, record=False)
                values.append(other.value)
        slope = (values[0] - values[1]) / (2 * change)
        found.append(Comparison(place.key, place.unit, change, float(each.values.sum()), slope))
    return found


def _scale(made: Objective, derivative: Derivative) -> float:
    """Return the largest size of an unknown along its interface; collective."""
    place = derivative.place
    parameters = made.sweeps.points[place.fault].parameters
    names = [name for name, _ in place.rows]
    if place.unit == "Pa":
        names.append("normal_stress_0")
    own = [float(np.abs(parameters[name]).max()) for name in names if np.size(parameters[name])]
    return parallel.largest(made.model.comm, max(own, default=0.0)) or 1.0
