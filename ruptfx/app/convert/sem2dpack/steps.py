"""Duration and time steps of SEM2DPACK."""

from __future__ import annotations

import numpy as np

from ruptfx import Table
from ruptfx.app.convert.sem2dpack.blocks import Block, Input
from ruptfx.app.convert.sem2dpack.layout import Layout
from ruptfx.app.convert.sem2dpack.materials import Medium

READS = {"TIME", "TIME_NEWMARK", "TIME_HHTA"}
EXPLICIT = ("leapfrog", "newmark", "hht-alpha", "symp_pv", "symp_pfr", "symp_pefrl")

LARGEST = 0.75
"""Courant number, in their definition, above which no time step of a case is."""


def duration(time: Block) -> float:
    """Return the simulated time [s].

    Raises
    ------
    ConversionError
    """
    if "totaltime" in time.values:
        return time.number("totaltime")
    return time.number("nbsteps") * time.number("dt")


def stepper(value: Input, time: Block) -> Table:
    """Return the table ``stepper`` of a case, empty where its defaults serve."""
    kind = str(time.get("kind", "leapfrog")).strip().lower()
    if kind not in EXPLICIT:
        near = [name for name in EXPLICIT if name.startswith(kind[:4])]
        if not near:
            value.refuse("TIME.kind", f"kind = '{kind}'; {', '.join(EXPLICIT)} are read")
        else:
            value.note(f"kind = '{kind}' is read as {near[0]}")
    elif kind != "leapfrog":
        value.note(f"{kind} is leapfrog here")
    if "dt" in time.values:
        return {"time_step": time.number("dt")}
    value.note("courant: left out; the time step is 0.9 of the stable one, which is computed")
    return {}


def step(time: Block, layout: Layout, media: dict[int, Medium], antiplane: bool) -> float:
    """Return the time step of the input [s]: its Courant number times the smallest node distance over the speed."""
    if "dt" in time.values:
        return time.number("dt")
    fastest = max(_fastest(medium.table, antiplane) for medium in media.values())
    return time.number("courant", 0.5) * layout.spacing() / fastest


def _fastest(material: Table, antiplane: bool) -> float:
    if "c_p" in material:
        return float(material["c_s" if antiplane else "c_p"])
    return float(np.sqrt(max(material["E_1"], material["E_2"]) / material["density"]))
