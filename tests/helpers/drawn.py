"""Numbers of figures in SI units, by the units in the labels of their axes."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ruptfx.input.quantities import factor


def size(label: str) -> float:
    """Return the size of the unit at the end of a label."""
    unit = re.search(r"\(([^()]*)\)$", label)
    try:
        return float(factor(unit[1], None)) if unit else 1.0
    except ValueError:
        return 1.0


def sizes_of(ax: Axes) -> list[float]:
    """Return the sizes of the units of both axes; the label of x may be that of another panel."""
    beside = [ax, *ax.get_shared_x_axes().get_siblings(ax), *reversed(ax.figure.axes)]
    return [size(next(each.get_xlabel() for each in beside if each.get_xlabel())), size(ax.get_ylabel())]


def shows(ax: Axes, *curves: tuple[Any, Any], close: float = 1e-6) -> None:
    """Assert that lines of more than two points, and those with markers, are these curves of SI values."""
    drawn = [[np.asarray(values, float) * unit for values, unit in zip(line.get_data(), sizes_of(ax), strict=True)]
             for line in ax.lines if np.size(line.get_xdata()) > 2 or line.get_marker() != "None"]  # fmt: skip
    drawn = [line for line in drawn if len(line[0])]
    assert len(drawn) == len(curves), ax.get_ylabel()
    for line, curve in zip(drawn, curves, strict=True):
        for values, expected in zip(line, curve, strict=True):
            np.testing.assert_allclose(values, np.asarray(expected), rtol=close, err_msg=ax.get_ylabel())
