"""Comparison of a gradient with differences of runs, which finds kinks near the run."""

from __future__ import annotations

from dataclasses import dataclass

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
