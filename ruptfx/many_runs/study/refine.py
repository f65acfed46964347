"""Refinement: bisect every step of the grid across which the mode changes, then run its ends on a finer mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ruptfx.many_runs.study.definition import Point, Study
from ruptfx.many_runs.study.store import Result

Known = Sequence[tuple[Point, Result]]


@dataclass(frozen=True)
class Step:
    """Two neighbouring points of a line of the grid between which the quantity changes."""

    column: str
    low: Point
    high: Point
    width: float
    """Width of the step as a part of the axis."""


def boundaries(study: Study, known: Known) -> Iterator[Step]:
    """Yield all steps across a boundary, on every line of the grid along every numeric axis."""
    for axis in study.axes:
        # Only numeric axes have values between their points.
        if not axis.numeric or axis.labels is not None or (axis.values is not None and len(axis.values) < 2):
            continue
        column = axis.column
        lines: dict[tuple[str, ...], list[tuple[Point, Result]]] = {}
        for point, result in known:
            others = tuple(str(value) for name, value in point.coordinates.items() if name != column)
            lines.setdefault(others, []).append((point, result))
        for line in lines.values():
            line.sort(key=lambda item: item[0].coordinates[column])
            for (low, one), (high, other) in pairwise(line):
                items = [_quantity(result, study.refine.by) for result in (one, other)]
                if None not in items and items[0] != items[1]:
                    width = axis.distance(low.coordinates[column], high.coordinates[column])
                    yield Step(column, low, high, width)


def bisections(study: Study, known: Known) -> list[Point]:
    """Return the midpoints of every boundary that is not yet located to `refine.width`."""
    table, points = study.base(), {}
    for step in boundaries(study, known):
        if step.width <= study.refine.width * (1 + 1e-9):
            continue
        middle = study.axis(step.column).middle(*(p.coordinates[step.column] for p in (step.low, step.high)))
        point = study.point({**step.low.values, step.column: middle}, "refined", table=table)
        points[point.hash] = point
    seen = {point.hash for point, _ in known}
    return [point for key, point in points.items() if key not in seen]


def finer(study: Study, known: Known) -> dict[str, Point]:
    """Return every boundary point on the finer mesh, by the hash of the point on the study's mesh."""
    table, points = study.base(), {}
    for step in boundaries(study, known):
        for point in (step.low, step.high):
            points[point.hash] = study.point(point.values, "fine", study.refine.fine, table)
    return points


def summary(study: Study, known: Known, fine: Mapping[str, Result]) -> str:
    """Return one sentence: accuracy of the boundaries, and agreement with the finer mesh."""
    steps = list(boundaries(study, known))
    if not steps:
        return f"no boundary: {study.refine.by} is the same everywhere"
    widest = max(step.width for step in steps)
    text = f"{len(steps)} boundaries located to {widest:.2%} of their axis"
    by_hash = {point.hash: result for point, result in known}
    pairs = [(by_hash[key], result) for key, result in fine.items() if key in by_hash]
    same = sum(_quantity(a, study.refine.by) == _quantity(b, study.refine.by) for a, b in pairs)
    if not pairs:
        return text
    return f"{text}; {same} of {len(pairs)} points beside them keep their {study.refine.by} on the finer mesh"


def _quantity(result: Result, name: str) -> object:
    return result.get("values", {}).get(name)
