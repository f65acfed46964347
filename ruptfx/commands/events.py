"""`ruptfx events`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer
from rich.table import Table

from ruptfx import RuptfxError
from ruptfx.commands._shared import reported, screen

if TYPE_CHECKING:
    from ruptfx.analysis.emission import BValue, Catalogue, FractalDimension, Omori

T = TypeVar("T")


def events(
    catalogue: Annotated[Path, typer.Argument(
        help="CSV file with the columns time (s), x, y (m) and magnitude or energy (J).", show_default=False)],
    smallest: Annotated[float, typer.Option(help="Smallest magnitude that counts.")] = -100.0,
    completeness: Annotated[float | None, typer.Option(
        help="Magnitude from which on all events were recorded; default: where most are.")] = None,
    distances: Annotated[tuple[float, float] | None, typer.Option(
        help="Smallest and largest distance of the fractal dimension [m]; default: a thirtieth and a third of the "
             "narrower extent.")] = None,
    failure_time: Annotated[float | None, typer.Option(help="Of the failure that events precede [s].")] = None,
    link: Annotated[tuple[float, float] | None, typer.Option(
        help="Distance [m] and speed [m/s]: closer events within the time that the speed needs are one.")] = None,
    out: Annotated[Path, typer.Option(help="The figure.")] = Path("events.png"),
) -> None:
    """b-value, fractal dimension and Omori exponent of acoustic emission, each with its error, and a figure.

    Example: ruptfx events catalogue.csv --completeness -1.5 --failure-time 120
    """
    with reported():
        from ruptfx.analysis.emission import clusters, read_catalogue
        from ruptfx.plots._catalogue import catalogue_statistics

        found = read_catalogue(catalogue).seismic(smallest)
        if link is not None:
            found = clusters(found, *link).events.seismic(smallest)
        estimates = estimates_of(found, completeness, distances, failure_time)
        screen.print(f"{len(found)} {'clusters of events' if link else 'events'} that radiate energy")
        table = Table("", "estimate", "from", box=None, pad_edge=False)
        for row in estimates.rows():
            table.add_row(*row)
        screen.print(table)
        if len(found):
            out.parent.mkdir(parents=True, exist_ok=True)
            catalogue_statistics(found, estimates.b, estimates.D, estimates.p, failure_time).savefig(out, dpi=150)
            screen.print(f"Picture: {out}", soft_wrap=True)


@dataclass(frozen=True)
class Estimates:
    """Every estimate, or the error that says why there is none."""

    b: BValue | RuptfxError
    D: FractalDimension | RuptfxError
    p: Omori | RuptfxError | None

    def rows(self) -> Iterator[tuple[str, str, str]]:
        """What it is, its value with its error, and what it was taken from."""
        b, D, p = self.b, self.D, self.p
        if isinstance(b, RuptfxError):
            yield "b-value", "none", str(b)
        else:
            yield "b-value", f"{b.b:.3f} ± {b.error:.3f}", f"{b.count} of at least magnitude {b.completeness:.2f}"
        if isinstance(D, RuptfxError):
            yield "fractal dimension", "none", str(D)
        else:
            yield "fractal dimension", f"{D.D:.3f} ± {D.error:.3f}", f"{D.radius[0]:.3g} to {D.radius[-1]:.3g} m"
        if isinstance(p, RuptfxError):
            yield "Omori exponent", "none", str(p)
        elif p is not None:
            yield "Omori exponent", f"{p.p:.3f} ± {p.error:.3f}", f"c = {p.c:.3g} s"


def estimates_of(
    found: Catalogue, completeness: float | None, distances: tuple[float, float] | None, failure_time: float | None
) -> Estimates:
    """All that the catalogue allows."""
    import numpy as np

    from ruptfx.analysis.emission import b_value, fractal_dimension, omori

    narrow = min(float(np.ptp(found.x)), float(np.ptp(found.y))) if len(found) else 0.0
    near, far = distances or (narrow / 30, narrow / 3)
    return Estimates(
        tried(lambda: b_value(found.magnitude, completeness)),
        tried(lambda: fractal_dimension(found.x, found.y, near, far)),
        None if failure_time is None else tried(lambda: omori(failure_time - found.time)),
    )


def tried(estimate: Callable[[], T]) -> T | RuptfxError:
    """The estimate, or why there is none."""
    try:
        return estimate()
    except RuptfxError as error:
        return error
