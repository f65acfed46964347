"""`ruptfx compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ruptfx.commands._shared import reported, screen

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

    from ruptfx.record import Record

UNINTERESTING = {"wall_time", "node_updates_per_second", "ranks", "host_cores", "versions", "case_hash", "title"}


def compare(
    first: Annotated[Path, typer.Argument(help="A run directory.", show_default=False)],
    second: Annotated[Path, typer.Argument(help="Another one.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Figure of both runs.")] = Path("comparison.png"),
) -> None:
    """Compare two runs: differences of the cases, the numbers of both, and one figure.

    Example: ruptfx compare runs/impact runs/pressed --out both.png
    """
    with reported():
        from ruptfx.record import Record
        from ruptfx.summary_fields import unit

        with Record(first) as one, Record(second) as other:
            table = Table("", str(first), str(second), "unit", "difference", box=None, pad_edge=False)
            for key, (a, b) in differences(one.case, other.case).items():
                table.add_row(key, _shown(a), _shown(b), "", _change(a, b))
            table.add_section()
            for key in {**(one.summary or {}), **(other.summary or {})}:
                a, b = ((record.summary or {}).get(key) for record in (one, other))
                if key not in UNINTERESTING and not (a is None and b is None):
                    table.add_row(key, _shown(a), _shown(b), unit(key), _change(a, b))
            screen.print(table)
            out.parent.mkdir(parents=True, exist_ok=True)
            overlay(one, other).savefig(out, dpi=150)
            screen.print(f"Picture: {out}", soft_wrap=True)


def differences(one: object, other: object, key: str = "") -> dict[str, tuple[object, object]]:
    """Return the values of the cases that differ, by dotted key."""
    if isinstance(one, dict | list) and type(one) is type(other):
        pairs: dict[str, tuple[object, object]] = {}
        first, second = _items(one), _items(other)
        for name in {**first, **second}:
            pairs |= differences(first.get(name), second.get(name), f"{key}.{name}".strip("."))
        return pairs
    return {} if one == other else {key: (one, other)}


def _items(value: object) -> dict[str, object]:
    if isinstance(value, dict):
        return value
    return {str(number): item for number, item in enumerate(value)} if isinstance(value, list) else {}


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)


def _change(a: object, b: object) -> str:
    if isinstance(a, bool) or isinstance(b, bool) or not (isinstance(a, int | float) and isinstance(b, int | float)):
        return "" if a == b else "differs"
    return "" if a == b else f"{100 * (b - a) / a:+.3g} %" if a else f"{b - a:+.3g}"


def overlay(one: Record, other: Record) -> Figure:
    """Draw arrival of the rupture, final slip, and slip rate at a position reached by both runs."""
    import numpy as np

    from ruptfx.figure_style import blank_figure, scale, styled

    names, both = [record.path.name for record in (one, other)], [record.interface for record in (one, other)]
    slips = [data["slip" if "slip" in data else "slip_1"] for data in both]
    rates = [data["slip_rate" if "slip_rate" in data else "slip_rate_1"] for data in both]

    def fitting(fields: list[DataArray], unit: str) -> tuple[float, str]:
        return scale(np.concatenate([field.values.ravel() for field in fields]), unit)

    x, x_unit = fitting([data.position for data in both], "m")
    t, t_unit = fitting([data.time for data in both], "s")
    (u, u_unit), (v, v_unit) = fitting(slips, "m"), fitting(rates, "m/s")
    at = _place(both)

    @styled
    def draw() -> Figure:
        figure = blank_figure(7.0, 2.6)
        arrival, slip, rate = figure.subplots(1, 3)
        for data, slipped, rated, line, name in zip(both, slips, rates, ("-", "--"), names, strict=True):
            arrival.plot(data.position / x, data.rupture_time / t, line, label=name)
            slip.plot(data.position / x, slipped.isel(time=-1) / u, line)
            rate.plot(data.time / t, rated.sel(position=at, method="nearest") / v, line)
        arrival.set(xlabel=f"Position ({x_unit})", ylabel=f"Rupture time ({t_unit})")
        slip.set(xlabel=f"Position ({x_unit})", ylabel=f"Slip at the end ({u_unit})")
        rate.set(xlabel=f"Time ({t_unit})", ylabel=f"Slip rate ({v_unit})", title=f"at {at / x:.4g} {x_unit}")
        figure.legend(loc="outside upper left", ncols=2)
        return figure

    return draw()


def _place(both: list[Dataset]) -> float:
    """Return the middle of the part that slid in both runs, else of the first interface [m]."""
    import numpy as np

    slid = [data.position.values[np.isfinite(data.rupture_time.values)] for data in both]
    if all(map(len, slid)):
        first, last = max(part.min() for part in slid), min(part.max() for part in slid)
        if first <= last:
            return float(first + last) / 2
    position = both[0].position.values
    return float(position.min() + position.max()) / 2
