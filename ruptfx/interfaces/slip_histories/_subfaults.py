"""Histories of slip of finite-fault models: a grid of subfaults, each with a rake and a history of its own.

Between the centres of subfaults slip and the time of its onset are bilinear, so that a rupture spreads continuously.
From the outermost ones slip decreases to zero over one subfault, half of which is beyond the edge of the model, so that
the potency of every subfault is that of the file. At an edge of the interface it does not decrease: the surface of the
Earth, for example.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from ruptfx.input.schema import CaseError, CasePath
from ruptfx.input.units import Coordinate
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.slip_histories import History, SlipHistory

Array = np.ndarray
MOST_SUBFAULTS = 1_000_000
VERTICAL = 0.05  # horizontal part of the second tangent of a surface without dip: 3 degrees


@dataclass(frozen=True)
class Model:
    """A plane of subfaults; arrays have a row for each step down dip, and in it a column for each along strike.

    Attributes
    ----------
    length, width : float
        Of a subfault, along strike and down dip [m].
    rake : ndarray, shape (down, along)
        Direction of slip of the hanging wall [degrees]: 0 along strike, 90 up dip.
    onset : ndarray, shape (down, along)
        Time at which slip begins [s].
    final : ndarray, shape (down, along)
        Whether a subfault slips.
    course : callable
        Slip [m] and slip rate [m/s] along the rake, and across it (rake + 90 degrees), shape (2, n) each, of subfaults
        with given numbers, shape (n,), at times since their onset, shape (n,).
    """

    length: float
    width: float
    rake: Array
    onset: Array
    final: Array
    course: Callable[[Array, Array], tuple[Array, Array]]


class FiniteFault(SlipHistory):
    """A history from a file of a finite-fault model."""

    file: CasePath
    """The file, relative to the case file."""
    strike: Coordinate | None = None
    """Position of the end of the model at which its strike begins; default is that end of the interface. The strike
    runs so that the interface dips to its right, along the positions if it is vertical."""
    dip: Coordinate = 0.0
    """Distance of the upper edge of the model down dip from the upper edge of the interface."""
    delay: Annotated[float, Field(ge=0)] = 0.0
    """Time that is added to all times of the file [s]."""

    def model(self) -> Model:
        """Return the subfaults.

        Raises
        ------
        ValueError
            The file cannot be read.
        """
        raise NotImplementedError

    def bind(self, face: Interface, width: float) -> History:
        if face.across is None or face.tangents != 2:
            raise CaseError(
                f"{self.file}: a finite-fault model is for a surface in three dimensions; use kind = 'table'"
            )
        try:
            model = self.model()
        except ValueError as error:
            raise CaseError(str(error)) from None
        down, along = model.rake.shape
        forward = runs_forward(face)
        begin = (face.line.first if forward else face.line.last) if self.strike is None else self.strike
        x = (face.position - begin) * (1 if forward else -1) / model.length - 0.5
        y = (face.across - self.dip) / model.width - 0.5
        self._require_inside(face, model, (begin, forward), width)
        ends = np.array([face.line.first, face.line.last]) if forward else np.array([face.line.last, face.line.first])
        edge = (ends - begin) * (1 if forward else -1) / model.length
        rows = _hats(y, down, (-self.dip / model.width, (width - self.dip) / model.width))
        columns = _hats(x, along, (edge[0], edge[1]))
        weights = np.stack([r[0] * c[0] for r in rows for c in columns])
        number = np.stack([r[1] * along + c[1] for r in rows for c in columns])
        begun = weights * model.final.ravel()[number]  # slip begins at no time where there is none
        onset = self.delay + np.sum(begun * model.onset.ravel()[number], axis=0) / np.maximum(begun.sum(axis=0), 1e-300)
        # The normal is first x second tangent: where the strike runs backwards the plus side is the hanging wall.
        side, strike = (-1.0, 1.0) if forward else (1.0, -1.0)
        angle = np.radians(model.rake.ravel()[number])
        ahead = side * np.stack([strike * np.cos(angle), -np.sin(angle)], axis=2)
        aside = side * np.stack([-strike * np.sin(angle), -np.cos(angle)], axis=2)

        def spread(time: float, which: int) -> Array:
            total = np.zeros((len(onset), 2))
            for w, k, a, b in zip(weights, number, ahead, aside, strict=True):
                one, two = model.course(k, time - onset)[which]
                total += w[:, None] * (one[:, None] * a + two[:, None] * b)
            return total

        note = f"{self.file}: {along} x {down} subfaults of {model.length:.6g} m x {model.width:.6g} m"
        return History(
            (weights.sum(axis=0) > 0) & self.reaches(face), lambda time: spread(time, 0), lambda time: spread(time, 1),
            np.zeros(len(onset)), note,
        )  # fmt: skip

    def _require_inside(self, face: Interface, model: Model, strike: tuple[float, bool], width: float) -> None:
        """Refuse a model that is beyond the edges of an interface.

        Raises
        ------
        CaseError
        """
        (begin, forward), (down, along) = strike, model.rake.shape
        length, deep = along * model.length, self.dip + down * model.width
        first, last = (begin, begin + length) if forward else (begin - length, begin)
        # The rim of a fault that ends inside of the bodies is welded, and its last points are a spacing away from it. A
        # subfault is inside if its middle is.
        spacing = float(np.sqrt(face.area.max(initial=0.0)))
        along_slack, down_slack = max(0.5 * model.length, spacing), max(0.5 * model.width, spacing)
        if (
            first < face.line.first - along_slack or last > face.line.last + along_slack
            or self.dip < -down_slack or deep > width + down_slack
        ):  # fmt: skip
            raise CaseError(
                f"{self.file}: the model covers positions from {first:.6g} to {last:.6g} m and dips from "
                f"{self.dip:.6g} to "
                f"{deep:.6g} m; the interface has {face.line.first:.6g} to {face.line.last:.6g} m and 0 to "
                f"{width:.6g} m: "
                "make it larger, or move the model with strike and dip"
            )


def runs_forward(face: Interface) -> bool:
    """Return whether the strike, with the dip to its right, runs along the positions; on vertical surfaces it does."""
    along, down = face.frame[:, 1:].mean(axis=0) if len(face.plus) else np.eye(3)[[0, 2]]
    return bool(down @ np.cross(along, [0.0, 0.0, 1.0]) > -VERTICAL)


def _hats(at: Array, count: int, edge: tuple[float, float]) -> list[tuple[Array, Array]]:
    """Return weight and index of the two neighbours of places in a row, whose centres are at 0, 1 ... count - 1.

    `edge` has the ends of the interface in the same unit, counted from the beginning of the row at -1/2.
    """
    low = np.floor(at)
    part = at - low
    result = []
    for index, weight in ((low, 1 - part), (low + 1, part)):
        inside = (index >= 0) & (index <= count - 1)
        # Where the interface ends with the model the last value continues to the edge.
        kept = ((index < 0) & (edge[0] > -0.25) & (at >= -0.5 - 1e-6)) | (
            (index > count - 1) & (edge[1] < count + 0.25) & (at <= count - 0.5 + 1e-6)
        )
        result.append((np.where(inside | kept, weight, 0.0), np.clip(index, 0, count - 1).astype(int)))
    return result
