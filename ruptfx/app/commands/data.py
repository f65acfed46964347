"""`ruptfx data`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ruptfx.app.commands._shared import reported, screen, table_console

if TYPE_CHECKING:
    from ruptfx.input.data_files import Variable

HEADING = "Post-process"


def data(
    file: Annotated[
        Path, typer.Argument(help="CSV, NetCDF, HDF5 or MATLAB file, or a folder with one file per event.")
    ],
    instrument: Annotated[
        str | None,
        typer.Option(
            help="Instrument of the case that all arrays belong to; default is the first word of their names."
        ),
    ] = None,
) -> None:
    """Print what is in a data file, and propose the mapping with which compare, infer and reconstruct read it.

    Example: ruptfx data event_12.mat --instrument G1
    """
    with reported():
        import numpy as np

        from ruptfx import RuptfxError
        from ruptfx.input.data_files import contents, events_of
        from ruptfx.input.data_guesses import guess, proposal

        try:
            files = events_of(file) if file.is_dir() else [file]
            variables = contents(files[0])
            others = [path for path in files[1:] if _names(contents(path)) != _names(variables)]
        except ValueError as error:
            raise RuptfxError(str(error)) from None
        if not variables:
            raise RuptfxError(f"{files[0]}: has no arrays of numbers with one or two dimensions; give another file")
        if len(files) > 1:
            screen.print(f"{len(files)} files; the arrays are those of {files[0].name}", soft_wrap=True)
        if others:
            shown = ", ".join(path.name for path in others[:3])
            screen.print(f"{len(others)} of them have other arrays or widths: {shown}", soft_wrap=True)
        length = max(each.shape[0] for each in variables)
        missing = [int(np.isnan(each.values).sum()) for each in variables]
        heads = ["array", "shape", "unit", "kind", "from", "to", "rate", *["missing"] * any(missing)]
        table = Table(*heads, box=None, pad_edge=False)
        for each, lost in zip(variables, missing, strict=True):
            known = guess(each, length)
            unit = f"{known.unit}?" if known.is_guess else known.unit
            rate = f"{known.rate:.6g} Hz" if known.rate is not None else ""
            shape = " x ".join(map(str, each.shape))
            ends = [f"{extreme.reduce(each.values, axis=None):.6g}" for extreme in (np.fmin, np.fmax)]
            table.add_row(each.name, shape, unit, known.kind, *ends, rate, *[str(lost or "")] * any(missing))
        table_console().print(table)
        screen.print("\nProposed mapping, ? is a guess; rename channels to those of the instrument:\n", soft_wrap=True)
        for line in proposal(variables, instrument, files[0].as_posix().replace("\\", "/")):
            screen.print(line, markup=False, highlight=False, soft_wrap=True)


def _names(variables: list[Variable]) -> list[tuple[str, tuple[int, ...]]]:
    """Return names and widths, which files of one series have in common; their lengths may differ."""
    return [(each.name, each.shape[1:]) for each in variables]
