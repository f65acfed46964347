"""`ruptfx converge`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ruptfx.app.commands._shared import CaseFile, Overrides, begin, reported, screen, table_console

if TYPE_CHECKING:
    from ruptfx.many_runs.convergence.estimates import Row

HEADING = "Compute"


def converge(
    case: CaseFile,
    out: Annotated[Path | None, typer.Option(help="Directory; default converge/<name of the case>.")] = None,
    levels: Annotated[int, typer.Option(help="Spacings: that of the case, and coarser ones by factors of 2.")] = 3,
    of: Annotated[str, typer.Option(help="What is made coarser: mesh, step, or mesh,step.")] = "mesh",
    set_: Overrides = None,
    ranks: Annotated[int, typer.Option(min=1, help="MPI ranks of every run.")] = 1,
    cores: Annotated[int | None, typer.Option(min=1, help="Cores to use on this machine; default all.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a dask scheduler; default is this machine.")] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Run failed levels again.")] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the convergence of another case in --out.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Compute an error bar of every number of a run from coarser meshes: of its summary and its instruments.

    Started again, it runs only the missing levels. The run of the case as it is has the bars in its summary.

    Example: ruptfx converge demos/antiplane.toml --set duration="1 s"
    """
    begin(f"reading {case}", not quiet)
    with reported():
        from ruptfx.many_runs.convergence import converge as run

        result = run(
            case, out or Path("converge") / case.stem, changes=set_ or [], levels=levels,
            of=[word.strip() for word in of.split(",")], ranks=ranks, cores=cores, scheduler=scheduler, retry=retry,
            show=not quiet, overwrite=overwrite,
        )  # fmt: skip
        table, remarks = table_of(result.rows)
        table_console().print(table)
        for remark in remarks:
            screen.print(remark, soft_wrap=True)
        for text in result.notes:
            screen.print(f"no result: {text}", style="red", soft_wrap=True)
        inside = sum(not row.outside for row in result.rows)
        if result.warning:
            screen.print(result.warning, style="red", soft_wrap=True)
        screen.print(f"{inside} of {len(result.rows)} numbers are in the asymptotic range", soft_wrap=True)
        screen.print(f"Run of the case, with its bars: {result.run}", soft_wrap=True)
        screen.print(f"Files: {', '.join(map(str, result.files))}", soft_wrap=True)


def table_of(rows: Sequence[Row]) -> tuple[Table, list[str]]:
    """Return the table of numbers with bars, and the remarks to which its last column refers."""
    table = Table("number", "value", "extrapolated", "order", "", box=None, pad_edge=False)
    reasons = list(dict.fromkeys(_reason(row) for row in rows if row.outside))
    for row in rows:
        table.add_row(*_cells(row), f"({1 + reasons.index(_reason(row))})" if row.outside else "")
    return table, [f"({number}) not in the asymptotic range: {reason}" for number, reason in enumerate(reasons, 1)]


def _cells(row: Row) -> list[str]:
    from ruptfx.results.analysis.verdict import with_bar

    one = next(iter(row.by.values()))
    orders = ", ".join("-" if each.order is None else f"{each.order:.2g}" for each in row.by.values())
    extrapolated = f"{one.extrapolated:.5g}" if len(row.by) == 1 and not one.outside else "-"
    return [row.name.replace("_", " "), f"{with_bar(row.value, row.bar)} {row.unit}".rstrip(), extrapolated, orders]


def _reason(row: Row) -> str:
    """Return why a number is not in the asymptotic range; observed orders are in the table."""
    from ruptfx.many_runs.convergence.estimates import HIGHEST_ORDER, LEAST_ORDER

    return re.sub(
        r"observed order [\d.e+-]+", f"observed order below {LEAST_ORDER:g} or above {HIGHEST_ORDER:g}", row.outside
    )
