"""Distributions of SEM2DPACK: fields of x and z, which become profiles along an interface.

A field that one kind of profile describes becomes that profile; any other one becomes a table with the values at the
nodes of the interface, from which points on straight lines are left out.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ruptfx import Table
from ruptfx.app.convert.sem2dpack.blocks import Block, ConversionError, Floats, Input
from ruptfx.app.convert.sem2dpack.fault_line import FaultLine

Field = Callable[[Floats, Floats], Floats]
"""Values at x and z."""


def value(values: Input, block: Block, key: str, default: float, shapes: list[Block], line: FaultLine) -> float | Table:
    """Return the value of a key along a fault: a number, or a profile where ``keyH`` names a distribution.

    Parameters
    ----------
    shapes : list of Block
        Distributions that follow the block; the one that is read is removed.

    Raises
    ------
    ConversionError
    """
    kind = block.word(f"{key}h")
    if not kind:
        return block.number(key, default)
    if not shapes or shapes[0].name != f"DIST_{kind}":
        text = f"&{shapes[0].name}" if shapes else "nothing"
        raise ConversionError(
            f"&{block.name} {key}H = '{kind}': &DIST_{kind} must follow, and {text} does; write its block after those "
            "of the keys before it"
        )
    shape = shapes.pop(0)
    return profile(field(values, shape), shape, line)


def field(value: Input, shape: Block) -> Field:
    """Return the field of a distribution.

    Raises
    ------
    ConversionError
        The kind is unknown, numbers or a file are missing.
    """
    kinds = {
        "DIST_ORDER0": _blocks, "DIST_PWCONR": _rings, "DIST_GAUSSIAN": _gaussian, "DIST_GRADIENT": _gradient,
        "DIST_LINEAR": _linear, "DIST_SPLINE": _spline, "DIST_HETE1": _grid,
    }  # fmt: skip
    if shape.name not in kinds:
        raise ConversionError(
            f"&{shape.name}: this distribution has no counterpart; use one of {', '.join(sorted(kinds))}"
        )
    return kinds[shape.name](value, shape)


def profile(values: Field, shape: Block, line: FaultLine) -> float | Table:
    """Return a field along a fault as a profile."""
    x, z = line.points.T
    result = values(x, z)
    if np.ptp(result) <= 1e-12 * np.abs(result).max(initial=0.0):
        return float(result[0])
    formula = _boxcar(shape, line) if shape.name == "DIST_PWCONR" else _bell(shape, line)
    if formula is not None:
        return formula
    keep = _corners(line.positions, result)
    return {"kind": "table", "positions": line.positions[keep].tolist(), "values": result[keep].tolist()}


def _corners(x: Floats, y: Floats) -> NDArray[np.int64]:
    """Return the places of the points that are not on the straight line between their neighbours."""
    slopes, scale = np.diff(y) / np.diff(x), np.ptp(y) / np.ptp(x)
    inner = np.abs(np.diff(slopes)) > 1e-9 * np.maximum(np.abs(slopes[1:]) + np.abs(slopes[:-1]), scale)
    return np.flatnonzero(np.concatenate([[True], inner, [True]]))


def _boxcar(shape: Block, line: FaultLine) -> Table | None:
    if int(shape.number("num")) != 2:
        return None
    position, distance = line.locate(shape.pair("ref", (0.0, 0.0)))
    radius, inside, outside = shape.numbers
    half_width = float(np.sqrt(max(radius**2 - distance**2, 0.0)))
    return {"kind": "boxcar", "center": position, "half_width": half_width, "inside": inside, "outside": outside}


def _bell(shape: Block, line: FaultLine) -> Table | None:
    if shape.name != "DIST_GAUSSIAN" or shape.number("order", 1) != 1 or not line.along_x:
        return None
    (x, z), (width, height) = shape.pair("centered_at", (0.0, 0.0)), shape.pair("length", (1.0, 1.0))
    amplitude = shape.number("ampli", 1.0) * np.exp(-(((line.points[0, 1] - z) / height) ** 2))
    return {
        "kind": "gaussian", "background": shape.number("offset", 0.0), "amplitude": float(amplitude), "center": x,
        "width": float(width / np.sqrt(2)),
    }  # fmt: skip


def _numbers(shape: Block, count: int) -> list[float]:
    if len(shape.numbers) != count:
        raise ConversionError(
            f"&{shape.name}: {count} numbers must follow it, and {len(shape.numbers)} do; correct its counts or the "
            "numbers"
        )
    return shape.numbers


def _blocks(value: Input, shape: Block) -> Field:
    """Rectangles of constant values."""
    columns, rows = int(shape.number("xn")), int(shape.number("zn"))
    numbers = np.array(_numbers(shape, columns - 1 + rows - 1 + columns * rows))
    right, top = numbers[: columns - 1], numbers[columns - 1 : columns + rows - 2]
    table = numbers[columns + rows - 2 :].reshape(rows, columns)
    # A point on a border belongs to the zone of larger coordinates, whatever the rounding of its coordinate.
    return lambda x, z: table[_zone(top, z), _zone(right, x)]


def _zone(borders: Floats, coordinate: Floats) -> NDArray[np.int64]:
    slack = 1e-9 * max(np.abs(borders).max(initial=0.0), np.abs(coordinate).max(initial=0.0))
    return np.searchsorted(borders, coordinate + slack, side="right")


def _rings(value: Input, shape: Block) -> Field:
    """Rings of constant values around a point."""
    count, (x_0, z_0) = int(shape.number("num")), shape.pair("ref", (0.0, 0.0))
    radii, values = np.split(np.array(_numbers(shape, 2 * count - 1)), [count - 1])
    return lambda x, z: values[np.searchsorted(radii * (1 + 1e-9), np.hypot(x - x_0, z - z_0))]


def _gaussian(value: Input, shape: Block) -> Field:
    (x_0, z_0), (a, b) = shape.pair("centered_at", (0.0, 0.0)), shape.pair("length", (1.0, 1.0))
    power, offset, amplitude = 2 * shape.number("order", 1), shape.number("offset", 0.0), shape.number("ampli", 1.0)
    return lambda x, z: offset + amplitude * np.exp(-(np.abs((x - x_0) / a) ** power) - np.abs((z - z_0) / b) ** power)


def _gradient(value: Input, shape: Block) -> Field:
    """Values that grow with the distance below a line, measured in the direction of the gradient."""
    line, angle = value.table(shape, 2), np.deg2rad(shape.number("angle", 0.0))
    c, s = np.cos(angle), np.sin(angle)
    across, along = line @ [c, s], line @ [-s, c]
    order = np.argsort(across)
    start, slope = shape.number("valref"), abs(shape.number("grad"))
    return lambda x, z: start + slope * (np.interp(c * x + s * z, across[order], along[order]) - (c * z - s * x))


def _along(shape: Block) -> Callable[[Floats, Floats], Floats]:
    return (lambda x, z: z) if shape.number("dim", 1) == 2 else (lambda x, z: x)


def _linear(value: Input, shape: Block) -> Field:
    """Return straight lines between points, continued beyond their ends."""
    if shape.number("length", 0.0) > 0:
        raise ConversionError(
            f"&DIST_LINEAR length = {shape.number('length'):g}: a moving average has no counterpart; remove the key, "
            "and give points of the averaged line"
        )
    if shape.word("file"):
        x_0, y_0 = value.table(shape, 2).T
    else:
        x_0, y_0 = np.array(_numbers(shape, 2 * int(shape.number("n")))).reshape(-1, 2).T
    if len(x_0) < 2:
        raise ConversionError(f"&DIST_LINEAR: {len(x_0)} points; give at least two")
    axis = _along(shape)

    def at(x: Floats, z: Floats) -> Floats:
        t = axis(x, z)
        i = np.clip(np.searchsorted(x_0, t) - 1, 0, len(x_0) - 2)
        return y_0[i] + (t - x_0[i]) * (y_0[i + 1] - y_0[i]) / (x_0[i + 1] - x_0[i])

    return at


def _spline(value: Input, shape: Block) -> Field:
    """Return the cubic spline with zero slope at both ends."""
    from scipy.interpolate import CubicSpline

    x_0, y_0 = value.table(shape, 2).T
    axis, curve = _along(shape), CubicSpline(x_0, y_0, bc_type="clamped")
    return lambda x, z: curve(axis(x, z))


def _grid(value: Input, shape: Block) -> Field:
    """Return bilinear interpolation on a grid; the file starts with columns, numbers, origin and spacing."""
    words = value.path(shape).read_text().split()
    try:
        columns, nx, nz = (int(word) for word in words[:3])
        numbers = [float(word.lower().replace("d", "e")) for word in words[3:]]
        (x_0, z_0, dx, dz), rows = numbers[:4], np.array(numbers[4:]).reshape(nz, nx, columns)
    except ValueError:
        raise ConversionError(
            f"&DIST_HETE1 file = '{shape.get('file', '')}': not a grid; it must have columns, nx, nz, origin, spacing "
            "and nx * nz rows of numbers"
        ) from None
    values = rows[:, :, int(shape.number("col", 1)) - 1]

    def at(x: Floats, z: Floats) -> Floats:
        xi, eta = (x - x_0) / dx, (z - z_0) / dz
        i, j = (np.clip(np.floor(t).astype(int), 0, n - 2) for t, n in ((xi, nx), (eta, nz)))
        u, v = xi - i, eta - j
        low = (1 - u) * values[j, i] + u * values[j, i + 1]
        return (1 - v) * low + v * ((1 - u) * values[j + 1, i] + u * values[j + 1, i + 1])

    return at
