"""Receivers of SEM2DPACK as instruments."""

from __future__ import annotations

import numpy as np

from ruptfx import Table
from ruptfx.app.convert.sem2dpack.blocks import ConversionError, Input
from ruptfx.app.convert.sem2dpack.layout import Layout

READS = {"REC_LINE"}
FIELDS = {"D": "displacement", "V": "velocity"}


def read(value: Input, layout: Layout, time_step: float, shortest: float) -> list[Table]:
    """Return an instrument for each receiver.

    Parameters
    ----------
    time_step : float
        Of the input [s]; receivers sample a multiple of it.
    shortest : float
        Interval that no time step of the case exceeds [s].

    Raises
    ------
    ConversionError
    """
    block = value.one("REC_LINE", required=False)
    if not block.values:
        return []
    if block.word("file") not in ("", "NONE"):
        points = value.table(block, 2)
    else:
        count = int(block.number("number"))
        points = np.linspace(block.pair("first"), block.pair("last"), count) if count else np.zeros((0, 2))
    field = block.word("field", "V")
    if field not in (*FIELDS, "A"):
        raise ConversionError(f"&REC_LINE field = '{field}': must be D, V or A")
    if field == "A":
        value.note("receivers record the velocity, not the acceleration")
    interval = block.number("isamp", 1) * time_step
    if interval < shortest:
        value.note("receivers sample less often, as the time step of the case is longer")
    interval = float(f"{max(interval, shortest):.4g}")
    at_node = bool(block.get("atnode", True))
    return [
        {"kind": "receiver", "name": f"receiver_{number:02d}", "interval": interval,
         "fields": [FIELDS.get(field, "velocity")], **layout.place((float(x), float(z)), at_node)}
        for number, (x, z) in enumerate(points, start=1)
    ]  # fmt: skip
