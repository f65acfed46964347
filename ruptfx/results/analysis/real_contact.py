"""Real contact of a surface with finite sliding: which points touch, their area, and the part of the surface around."""

from __future__ import annotations

import numpy as np

from ruptfx.results.analysis import OPEN, UNCOVERED
from ruptfx.results.record import Data

MARGIN = 0.15  # of the larger extent of the contact, kept around it
SMALL = 0.6  # of the extent of the surface: a larger contact is shown with the whole surface

Box = tuple[tuple[float, float], tuple[float, float]]


def touching(data: Data, row: int | slice = slice(None)) -> np.ndarray:
    """Return which points stick or slide at a record, shape (points,) of bool; of all, shape (times, points)."""
    states: np.ndarray = data["contact"].values[row]
    return (states != OPEN) & (states != UNCOVERED)


def contact_area(data: Data) -> np.ndarray:
    """Return the real area of contact at every record [m2], shape (times,): that of the points that touch."""
    area: np.ndarray = touching(data) @ data["area"].values
    return area


def contact_box(data: Data) -> Box:
    """Return the ends, along strike and down dip [m], of the part of a surface with all points that ever touch.

    It is the whole surface if the contact is not much smaller, or if there is none.
    """
    ever = touching(data).any(axis=0)
    places = np.stack([data[name].values for name in ("position", "dip")])
    whole = np.stack([places.min(axis=1), places.max(axis=1)], axis=1)
    if ever.any():
        part = np.stack([places[:, ever].min(axis=1), places[:, ever].max(axis=1)], axis=1)
        margin = MARGIN * np.ptp(part, axis=1).max()
        part = np.clip(part + np.array([-margin, margin]), whole[:, :1], whole[:, 1:])
        if np.all(np.ptp(part, axis=1) < SMALL * np.ptp(whole, axis=1)):
            whole = part
    (left, right), (top, bottom) = whole.tolist()
    return (left, right), (top, bottom)
