"""Histories of slip from samples in time and space: tables, and the records of other runs.

In time monotone piecewise cubics with continuous slope interpolate the samples, which they pass through; between points
of an interface slip is linear. A point that coincides with a sampled one has its slip.
Source: Fritsch and Carlson (1980).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.slip_histories import History, SlipHistory

Array = np.ndarray
SAME = 1e-9  # of the length of an interface: points closer than this coincide


@dataclass(frozen=True)
class Samples:
    """Slip at times and places.

    Attributes
    ----------
    file : str
        For messages.
    times : ndarray, shape (times,)
        Increasing [s].
    places : ndarray, shape (m,) or (m, 2)
        Positions along a line, or on a surface [m].
    slip : ndarray, shape (times, m, tangents)
        [m]
    """

    file: str
    times: Array
    places: Array
    slip: Array


class Course:
    """Values between samples in time, by monotone cubics, and their rates; constant beyond the first and the last.

    Parameters
    ----------
    times : ndarray, shape (times,)
    values : ndarray, shape (times, ...)
    """

    def __init__(self, times: Array, values: Array) -> None:
        self._times, self._values = times, values
        self._steps = np.diff(times)
        self._secants = np.diff(values, axis=0) / self._steps.reshape(-1, *(1,) * (values.ndim - 1))

    def _slope(self, i: int) -> Array:
        """Return the slope at a sample, zero at the ends, where slip rests, and where the secants change their sign."""
        if i in (0, len(self._times) - 1):
            return np.zeros_like(self._values[0])
        before, after = self._secants[i - 1], self._secants[i]
        long, short = 2 * self._steps[i] + self._steps[i - 1], self._steps[i] + 2 * self._steps[i - 1]
        same = before * after > 0
        with np.errstate(all="ignore"):
            mean = (long + short) / (long / before + short / after)
        return np.where(same, mean, 0.0)

    def at(self, time: float) -> tuple[Array, Array]:
        """Return the values at a time [s], and their rates."""
        times = self._times
        i = int(np.searchsorted(times, time, side="right")) - 1
        if i < 0 or i >= len(times) - 1:
            return self._values[0 if i < 0 else -1].copy(), np.zeros_like(self._values[0])
        h = self._steps[i]
        x = (time - times[i]) / h
        first, last, a, b = self._values[i], self._values[i + 1], self._slope(i), self._slope(i + 1)
        grown = x * x * (3 - 2 * x)
        value = first + grown * (last - first) + h * x * (1 - x) * ((1 - x) * a - x * b)
        rate = 6 * x * (1 - x) * self._secants[i] + (1 - x) * (1 - 3 * x) * a - x * (2 - 3 * x) * b
        return value, rate


class Sampled(SlipHistory):
    """A history that is sampled in time and space."""

    def samples(self, face: Interface) -> Samples:
        """Return the samples.

        Raises
        ------
        CaseError
            The file cannot be read, or does not fit the interface.
        """
        raise NotImplementedError

    def bind(self, face: Interface, width: float) -> History:
        data = self.samples(face)
        if (data.places.ndim == 1) != (face.across is None) or data.slip.shape[2] != face.tangents:
            raise CaseError(
                f"{data.file}: has {data.places.ndim} coordinates and {data.slip.shape[2]} components of slip of "
                "each point, "
                f"and the interface {1 if face.across is None else 2} and {face.tangents}; give samples of such "
                "an interface"
            )
        inside, weights, columns = _weights(face, data)
        course = Course(data.times, data.slip)

        def spread(values: Array) -> Array:
            return np.asarray(np.einsum("nk,nkt->nt", weights, values[columns]))

        return History(
            inside & self.reaches(face),
            lambda time: spread(course.at(time)[0]), lambda time: spread(course.at(time)[1]),
            np.zeros(len(inside)), f"{data.file}: {len(data.times)} times, {len(data.places)} points",
        )  # fmt: skip


def _weights(face: Interface, data: Samples) -> tuple[Array, Array, Array]:
    """Return which points of an interface are among the samples, shape (n,), and weights and columns of these, (n, k).

    Raises
    ------
    CaseError
        Samples with slip that lie beyond the interface.
    """
    places, at = face.locations, data.places
    slack = max(1e-6 * face.line.length, np.finfo(float).eps)
    moves = np.abs(data.slip).max(axis=(0, 2)) > 0
    position = at if at.ndim == 1 else at[:, 0]
    beyond = moves & ((position < face.line.first - slack) | (position > face.line.last + slack))
    if np.any(beyond):
        raise CaseError(
            f"{data.file}: slips at position {position[np.argmax(beyond)]:.6g} m, beyond the interface, which "
            "extends from "
            f"{face.line.first:.6g} to {face.line.last:.6g} m; leave out what lies beyond, or move the samples"
        )
    if at.ndim == 1:
        order = np.argsort(at)
        line = at[order]
        last = np.clip(np.searchsorted(line, places), 1, max(len(line) - 1, 1))
        if len(line) == 1:
            near = np.abs(places - line[0]) <= slack
            return near, np.ones((len(places), 1)), np.zeros((len(places), 1), dtype=int)
        part = (places - line[last - 1]) / (line[last] - line[last - 1])
        part = np.where(np.abs(part) * np.diff(line)[last - 1] <= SAME * face.line.length, 0.0, part)
        part = np.where(np.abs(1 - part) * np.diff(line)[last - 1] <= SAME * face.line.length, 1.0, part)
        inside = (places >= line[0] - slack) & (places <= line[-1] + slack)
        part = np.clip(part, 0.0, 1.0)
        return inside, np.stack([1 - part, part], axis=1), order[np.stack([last - 1, last], axis=1)]
    return _on_surface(places, at, SAME * face.line.length)


def _on_surface(places: Array, at: Array, same: float) -> tuple[Array, Array, Array]:
    """Return masks, weights and columns of `_weights` on a surface, by a triangulation of the samples."""
    from scipy.spatial import Delaunay, QhullError, cKDTree

    distance, nearest = cKDTree(at).query(places)
    weights, columns = np.zeros((len(places), 3)), np.repeat(np.atleast_1d(nearest)[:, None], 3, axis=1)
    weights[:, 0] = 1.0
    inside = distance <= same
    others = np.flatnonzero(~inside)
    if len(others):
        try:
            mesh = Delaunay(at)
        except (QhullError, ValueError):  # on one line
            return inside, weights, columns
        triangle = mesh.find_simplex(places[others])
        here = triangle >= 0
        others, triangle = others[here], triangle[here]
        shape = mesh.transform[triangle]
        two = np.einsum("nij,nj->ni", shape[:, :2], places[others] - shape[:, 2])
        weights[others] = np.column_stack([two, 1 - two.sum(axis=1)])
        columns[others] = mesh.simplices[triangle]
        inside[others] = True
    return inside, weights, columns
