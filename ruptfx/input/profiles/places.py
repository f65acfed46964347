"""Positions along an interface in a case, also given as points that define the nearest position.

`ruptfx.interfaces.faults.interface.Line` defines positions: x where an interface is flat and its (first) tangent is
+x, a length from its `origin` elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
from pydantic import Discriminator, Field, Tag

from ruptfx import Table
from ruptfx.input.schema import Alternative, Part, Unit, has_mark


class Place(Part):
    """A point, which defines the position of the nearest point of the interface."""

    x: Annotated[float, Unit("m")]
    """Coordinate along x."""
    y: Annotated[float, Unit("m")]
    """Coordinate along y."""
    z: Annotated[float, Unit("m")] | None = None
    """Coordinate along z, in three dimensions."""


class _Along:
    """Mark of fields that contain positions along an interface."""


class _Reach:
    """Mark of fields with the half-width of a patch."""


class _Smooth:
    """Mark of fields with the half-width of a patch whose values change smoothly, without an edge."""


def _tag(value: object) -> str:
    return "<place>" if isinstance(value, dict | Place) else "<number>"


if TYPE_CHECKING:
    Position = float
    Center = Any
    HalfWidth = float
    SmoothHalfWidth = float
else:
    Position = Annotated[float, Unit("m"), _Along()]
    Center = Annotated[
        Annotated[float, Tag("<number>")] | Annotated[Place, Tag("<place>")], Discriminator(_tag), Unit("m"), _Along(),
    ]  # fmt: skip
    HalfWidth = Annotated[float, Field(gt=0), Unit("m"), _Reach()]
    SmoothHalfWidth = Annotated[float, Field(gt=0), Unit("m"), _Reach(), _Smooth()]


AnyPart = TypeVar("AnyPart", bound=Part)


def distance(places: np.ndarray, center: Any) -> np.ndarray:
    """Return the distance of points of an interface from a center [m], shape (n,).

    Over a surface a center that is one number is a position along strike: its patch is a strip across the surface.

    Parameters
    ----------
    places : ndarray, shape (n,) along a line or (n, 2) on a surface [m]
    center : float, or ndarray of shape (2,)
    """
    if np.ndim(center):
        return np.linalg.norm(places - center, axis=1)
    return np.abs((places if places.ndim == 1 else places[:, 0]) - center)


def located(part: AnyPart, locate: Callable[[str, Place], Any], key: str) -> AnyPart:
    """Return the part with every point replaced by its position.

    Parameters
    ----------
    locate : callable
        Position [m] of a point; its first argument is the key, for messages.
    key : str
        Dotted key of the part.
    """
    changes: Table = {}
    for name in type(part).model_fields:
        value, where = getattr(part, name), f"{key}.{name}"
        if isinstance(value, Place):
            changes[name] = locate(where, value)
        elif isinstance(value, Part):
            changes[name] = located(value, locate, where)
        elif isinstance(value, list) and any(isinstance(item, Part) for item in value):
            changes[name] = [
                located(item, locate, f"{where}.{number}") if isinstance(item, Part) else item
                for number, item in enumerate(value)
            ]
    return part.substituted(changes) if changes else part


def parts(part: Part, key: str) -> Iterator[tuple[str, Part]]:
    """Yield a part and all parts inside it, each with its dotted key."""
    yield key, part
    for name in type(part).model_fields:
        value = getattr(part, name)
        for where, item in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(item, Part):
                yield from parts(item, f"{key}.{name}" if where is None else f"{key}.{name}.{where}")


def positions(part: Part, key: str) -> Iterator[tuple[str, list[float]]]:
    """Yield keys and values of every position given as a number; keys without values for random fields."""
    for where, item in parts(part, key):
        fields = type(item).model_fields
        for name in fields:
            value = getattr(item, name)
            if has_mark(type(item), name, _Along) and value is not None and not isinstance(value, Place):
                yield f"{where}.{name}", value if isinstance(value, list) else [value]
        if "seed" in fields:
            yield where, []


@dataclass(frozen=True)
class Patch:
    """A part of an interface defined in a case.

    Attributes
    ----------
    key : str
        Dotted key of the part with the patch.
    kind : str
    ends : list of float
        First and last position [m]; one value for a single position.
    center : ndarray, shape (2,), or None
        Center that is a point of a surface; without it the patch is a strip across the surface.
    down_dip : bool
        True if the positions are distances down the dip of a surface.
    has_reach : bool
        True if the ends are a center minus and plus a half-width.
    has_edge : bool
        True if the values jump at the ends.
    part : Part or None
        The part itself.
    """

    key: str
    kind: str
    ends: list[float]
    center: np.ndarray | None = None
    down_dip: bool = False
    has_reach: bool = False
    has_edge: bool = False
    part: Part | None = None


def patches(part: Part, key: str) -> Iterator[Patch]:
    """Yield all parts with a center or with positions; points must have been replaced (`located`)."""
    inside_down_dip: list[str] = []
    for where, item in parts(part, key):
        if getattr(item, "down_dip", False):
            inside_down_dip.append(f"{where}.")
        down_dip = where.startswith(tuple(inside_down_dip))
        entries = {mark: [getattr(item, name) for name in type(item).model_fields if has_mark(type(item), name, mark)]
                 for mark in (_Along, _Reach, _Smooth)}  # fmt: skip
        kind = item.kind() if isinstance(item, Alternative) else ""
        for value in entries[_Along]:
            if isinstance(value, list):
                yield Patch(where, kind, [value[0], value[-1]], down_dip=down_dip)
            else:
                center = np.asarray(value) if np.ndim(value) else None
                value = float(np.ravel(value)[0])  # of a point on a surface: along strike
                reach = entries[_Reach][0] if entries[_Reach] else 0.0
                ends = [value - reach, value + reach] if reach else [value]
                yield Patch(where, kind, ends, center, down_dip, reach > 0, reach > 0 and not entries[_Smooth], item)


def shifted(items: list[tuple[str, list[float]]], shift: float) -> str:
    """Return text with the changes of positions from lengths from the left end to x, for messages."""
    texts = []
    for key, values in items:
        if not values:
            texts.append(f"{key} is drawn by position and becomes another sample")
        elif len(values) > 2:
            texts.append(f"add {shift:g} to every one of {key}")
        else:
            after = [value + shift if abs(value + shift) > 1e-9 * abs(shift) else 0.0 for value in values]
            before, now = (", ".join(f"{value:.6g}" for value in numbers) for numbers in (values, after))
            texts.append(f"{key} = {before} becomes {now}")
    return "; ".join(texts)
