"""Figure of the state of the materials, such as plastic strain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.schema import nearest
from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import RATE_MAP, Array
from ruptfx.results.plots._panels import bulk_field, panels
from ruptfx.results.plots._record import has_pictures
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.record import Files


def suits(record: Files) -> bool:
    """Return whether a state of a material was saved, and has a value other than zero at the end."""
    return any(
        has_pictures(record, name) and record.bulk.sizes["time"] > 0
        and bool(np.nan_to_num(record.bulk[name].isel(time=-1).values).any()) for name in states(record)
    )  # fmt: skip


def states(record: Files) -> list[str]:
    """Return the names of the states in the snapshots of a run."""
    result = record.bulk.attrs.get("states", [])
    return [str(name) for name in np.atleast_1d(np.asarray(result, dtype=object))]


@figure
def material_state(
    sheet: Sheet,
    record: Files,
    *,
    at: float | Sequence[float] | None = None,
    x: Window | None = None,
    field: str | None = None,
) -> None:
    """Draw a state of the materials in the bodies, such as plastic strain.

    Parameters
    ----------
    at
        Times [s]; the nearest snapshots are drawn. Default: the last one.
    field : str
        A state that the materials record. Default: the first one.
    """
    if not record.bulk.sizes["time"] or (field is None and not states(record)):
        sheet.empty("no state was saved")
        return
    name = states(record)[0] if field is None else field
    if name not in states(record):
        raise RuptfxError(f"plots.{sheet.name}: field = '{name}': {nearest(str(name), states(record))}")
    values, unit = bulk_field(record, name, sheet.name, [])
    last = record.bulk.sizes["time"] - 1
    label, size = str(record.bulk[name].attrs.get("long_name", name)), 1.0
    label = label[:1].upper() + label[1:]
    if unit == "1":  # numbers such as 0.0002 would overlap on the scale
        power = int(np.floor(np.log10(np.nanmax(np.abs(values(last)), initial=1e-300))))
        if not -2 < power < 3:
            label, size, unit = f"{label} ($10^{{{power}}}$)", 10.0**power, ""

    def picture(row: int, raster: Raster) -> Array:
        return raster(values(row) / size)

    when = float(record.bulk["time"].values[last]) if at is None else at
    panels(sheet, record, when, x, picture, label, "#1a1a1a", None, "" if unit == "1" else unit, cmap=RATE_MAP)
