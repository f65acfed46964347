"""`ruptfx events`."""

from __future__ import annotations

import math
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import Overwrite, begin, picture, reported, screen, writing
from ruptfx.input.quantities import with_prefix

if TYPE_CHECKING:
    from ruptfx.results.analysis.emission import Estimates

HEADING = "Post-process"
SHOWN = ("time", "duration", "magnitude", "slip", "stress_drop", "strike", "dip")  # columns of a table in 80 letters


def events(
    source: Annotated[
        Path,
        typer.Argument(
            help="Directory of a run with fracture or of cycles on surfaces, or a CSV file with the columns time (s), "
            "x, y (m) and magnitude or energy (J).",
            show_default=False,
        ),
    ],
    smallest: Annotated[
        float | None,
        typer.Option(
            help="Smallest magnitude that counts; default: no limit for a catalogue, -10 for a run.", show_default=False
        ),
    ] = None,
    completeness: Annotated[
        float | None,
        typer.Option(help="Magnitude above which the catalogue is complete; default: the most frequent magnitude."),
    ] = None,
    distances: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="Smallest and largest distance in m for the fractal dimension; default: for a catalogue 1/30 and 1/3 "
            "of its narrower extent, for a run two cells and 1/3 of its narrower side."
        ),
    ] = None,
    failure_time: Annotated[
        float | None,
        typer.Option(
            help="Time of the failure that follows the events, in s; default: for a run its first stress peak."
        ),
    ] = None,
    link: Annotated[
        tuple[float, float] | None,
        typer.Option(
            help="Distance in m and speed in m/s: events closer than the distance, and within the time that the speed "
            "needs for it, count as one; default: for a run three cells and half the lowest c_s."
        ),
    ] = None,
    table: Annotated[
        bool, typer.Option("--csv", help="Also write all events of a run to events.csv in its directory.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Picture; default: events.png, for a run RUN/figures/emission.png, of surfaces catalogue.png.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """List the earthquakes of a surface, or estimate b-value, fractal dimension and Omori exponent; draw a figure.

    Example: ruptfx events catalogue.csv --completeness -1.5 --failure-time 120
    """
    begin(f"reading {source}")
    with reported():
        if not source.exists():
            raise RuptfxError(f"{source}: no such file or directory; give that of a run, or a table of events")
        of_run = source.is_dir()
        if table and not of_run:
            raise RuptfxError(f"--csv: {source} is a table already; the option is for the directory of a run")
        surfaces = of_run and _has_surfaces(source)
        if surfaces and (completeness, distances, failure_time, link) != (None,) * 4:
            raise RuptfxError(
                "--completeness, --distances, --failure-time, --link: for acoustic emission, and this run has a "
                "catalogue of ruptures of a surface; leave them out"
            )
        name = "catalogue.png" if surfaces else "emission.png"
        path = picture(out or (source / "figures" / name if of_run else Path("events.png")))
        with ExitStack() as stack:
            target, to = stack.enter_context(writing(path.parent, [source], overwrite)).claim(path.name), None
            if table:
                to = stack.enter_context(writing(source, (), overwrite)).claim("events.csv")
            if surfaces:
                _of_surfaces(source, smallest, to, target)
            elif of_run:
                _of_run(source, smallest, completeness, distances, failure_time, link, to, target)
            else:
                _of_catalogue(source, smallest, completeness, distances, failure_time, link, target)
            drawn = target.exists()
        for each in [source / "events.csv"] * table:
            screen.print(f"Table: {each}", soft_wrap=True)
        if drawn:
            screen.print(f"Picture: {path}", soft_wrap=True)


def _has_surfaces(run: Path) -> bool:
    from ruptfx.results.analysis.surface import all_surfaces
    from ruptfx.results.record import Record

    with Record(run) as record:
        return all_surfaces(record)


def _of_surfaces(run: Path, smallest: float | None, table: Path | None, out: Path) -> None:
    """Print the catalogue of every surface of a run, write it, and draw that of the surface with most moment."""
    import pandas

    from ruptfx.results.analysis.interface_events import COLUMNS, DURING, interface_events, row_of
    from ruptfx.results.figure_style import save
    from ruptfx.results.record import Record
    from ruptfx.results.surface_catalogue import surface_catalogue

    rows = []
    with Record(run) as record:
        catalogues = {name: interface_events(data) for name, data in record.interfaces.items()}
        for name, items in catalogues.items():
            kept = [event for event in items if smallest is None or event.magnitude >= smallest]
            rows += [{"fault": name, **row_of(event)} for event in kept]
            printed = Table(*SHOWN, box=None, pad_edge=False)
            for event in kept:
                row = row_of(event)
                printed.add_row(*(_readable(row[key], COLUMNS[key]) for key in SHOWN))
            screen.print(f"{name}: {len(kept)} events faster than {DURING:g} m/s", soft_wrap=True)
            screen.print(printed)
        largest = max(catalogues, key=lambda name: sum(event.moment for event in catalogues[name]))
        if table is not None:
            units = {name: f"{name} ({unit})" for name, unit in COLUMNS.items() if unit != "1"}
            pandas.DataFrame(rows, columns=["fault", *COLUMNS]).rename(columns=units).to_csv(table, index=False)
        save(surface_catalogue(record.interfaces[largest], catalogues[largest], DURING), out, out.suffix[1:])


def _readable(value: float, unit: str) -> str:
    """Return a number with its unit, the magnitude alone."""
    return f"{value:.2f}" if unit == "1" else with_prefix(value, unit, 5 if unit == "s" else 3)


def _of_catalogue(
    path: Path, smallest: float | None, completeness: float | None, distances: tuple[float, float] | None,
    failure_time: float | None, link: tuple[float, float] | None, out: Path,
) -> None:  # fmt: skip
    from ruptfx.results.analysis.emission import clusters, estimate, read_catalogue
    from ruptfx.results.catalogue_statistics import catalogue_statistics

    least = -math.inf if smallest is None else smallest
    seismic = read_catalogue(path).seismic(least)
    if link is not None:
        seismic = clusters(seismic, *link).events.seismic(least)
    estimates = estimate(seismic, completeness, distances, failure_time)
    screen.print(f"{len(seismic)} {'clusters of events' if link else 'events'} that radiate energy")
    _show({"": estimates})
    if len(seismic):
        catalogue_statistics(seismic, estimates.b, estimates.D, estimates.p, failure_time).savefig(out, dpi=150)


def _of_run(
    run: Path, smallest: float | None, completeness: float | None, distances: tuple[float, float] | None,
    failure_time: float | None, link: tuple[float, float] | None, table: Path | None, out: Path,
) -> None:  # fmt: skip
    from ruptfx.results.analysis.compression import SMALLEST, emission_of
    from ruptfx.results.analysis.emission import Estimates
    from ruptfx.results.figure_style import save
    from ruptfx.results.plots.emission import emission
    from ruptfx.results.record import Record

    with Record(run) as record:
        least = SMALLEST if smallest is None else smallest
        value = emission_of(record, least, completeness, distances, failure_time, link)
        early = "" if value.failure_time is None else f", {value.before.sum()} of them until {value.failure_time:.4g} s"
        screen.print(f"Failed facets: {len(value.events)}{early}; clusters: {len(value.linked)}", soft_wrap=True)
        shares = ", ".join(f"{name} {share:.1%}" for name, share in value.shares.items())
        modes = f": {shares}" if len(value.seismic) else ""
        within = "" if value.failure_time is None else " until then"
        screen.print(f"Events of magnitude {least:g} or more{within}: {len(value.seismic)}{modes}", soft_wrap=True)
        if value.failure_time is not None and len(value.seismic):
            windows = ", ".join(f"{share:.1%} until {part:.0%}" for part, share in value.tensile_shares.items())
            screen.print(f"Tensile share by window: {windows} of the time of failure")
        _show({"events": value.of_events, "clusters": Estimates(value.of_clusters, None, None)})
        if table is not None:
            record.events.to_dataframe().to_csv(table, index_label="event")
        save(emission(record, found=value).figure, out, out.suffix[1:])


def _show(estimates: dict[str, Estimates]) -> None:
    """Print a table of all estimates."""
    table = Table("", "estimate", "from", box=None, pad_edge=False)
    for of, each in estimates.items():
        for what, value, source in each.rows():
            table.add_row(f"{what} of {of}" if of else what, value, source)
    screen.print(table)
