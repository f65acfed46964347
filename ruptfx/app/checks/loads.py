"""Rows of `ruptfx check` on loads that are given by samples in time."""

from __future__ import annotations

from collections.abc import Iterator

from ruptfx.bodies.boundaries import Boundary
from ruptfx.bodies.boundaries.histories import Samples
from ruptfx.case import Case
from ruptfx.interfaces.mechanisms.checks.table import Row

LONG_AFTER = 100  # times the duration of the run: samples that end later are probably not in seconds


def load_rows(case: Case) -> Iterator[Row]:
    """Yield the number of samples of boundaries in time, and the range that the run uses."""
    items = [("boundaries", case.boundaries, case.duration)]
    if case.stages:
        items = [
            ("boundaries", case.boundaries, stage.duration) if stage.boundaries is None else
            (f"stages.{number}.boundaries", stage.boundaries, stage.duration)
            for number, stage in enumerate(case.stages)
        ]  # fmt: skip
    for key, boundaries, end in items:
        for number, boundary in enumerate(boundaries):
            if boundary.samples is not None:
                yield _samples_row(f"{key}.{number}: samples", boundary, boundary.samples, end)


def _samples_row(quantity: str, boundary: Boundary, samples: Samples, end: float) -> Row:
    first, last = samples.times[0], samples.times[-1]
    low, high = samples.until(end)
    unit = "" if samples.unit == "1" else f" {samples.unit}"
    where = ", ".join(filter(None, (boundary.kind(), getattr(boundary, "edge", ""), samples.file)))
    note = f"{where}: {first:.4g} to {last:.4g} s; the run sees {low:.4g} to {high:.4g}{unit} in {end:.4g} s"
    if last > LONG_AFTER * end:
        note += (
            f"; they end {last / end:.3g} times later than the run: are the times in SI units? A header such as "
            "'time (us)' says so"
        )
    elif first >= end:
        note += "; the run ends before the first: a longer duration, or earlier times"
    elif last < end * (1 - 1e-9) and not samples.constant_after:
        note += "; they end before the run, and not at rest: more samples, or a shorter duration"
    else:
        return Row(quantity, len(samples.times), "", note)
    return Row(quantity, len(samples.times), "", note, "warning")
