"""`ruptfx compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ruptfx.commands._shared import reported, screen

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.record import Record

UNINTERESTING = {"wall_time", "node_updates_per_second", "ranks", "host_cores", "versions", "case_hash", "title"}


def compare(
    first: Annotated[Path, typer.Argument(help="A run directory.", show_default=False)],
    second: Annotated[Path, typer.Argument(help="Another one.", show_default=False)],
    out: Annotated[Path, typer.Option(help="The figure that shows both.")] = Path("comparison.png"),
) -> None:
    """Two runs side by side: what differs in their cases, their numbers, and both in one figure.

    Example: ruptfx compare runs/impact runs/pressed --out both.png
    """
    with reported():
        from ruptfx.record import Record

        with Record(first) as one, Record(second) as other:
            table = Table("", str(first), str(second), "difference", box=None, pad_edge=False)
            for key, (a, b) in differences(one.case, other.case).items():
                table.add_row(key, _shown(a), _shown(b), _change(a, b))
            table.add_section()
            for key in {**(one.summary or {}), **(other.summary or {})}:
                a, b = ((record.summary or {}).get(key) for record in (one, other))
                if key not in UNINTERESTING and not (a is None and b is None):
                    table.add_row(key, _shown(a), _shown(b), _change(a, b))
            screen.print(table)
            out.parent.mkdir(parents=True, exist_ok=True)
            overlay(one, other).savefig(out, dpi=150)
            screen.print(f"Picture: {out}", soft_wrap=True)


def differences(one: object, other: object, key: str = "") -> dict[str, tuple[object, object]]:
    """Values of the cases that differ, by dotted key."""
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
    """Arrival of the rupture, final slip, and slip rate in the middle, of both runs."""
    from ruptfx.figure_style import blank_figure, styled

    @styled
    def draw() -> Figure:
        figure = blank_figure(7.0, 2.4)
        arrival, slip, rate = figure.subplots(1, 3)
        for record, line in ((one, "-"), (other, "--")):
            data, name = record.interface, record.path.name
            slips, rates = (data[n] if n in data else data[f"{n}_1"] for n in ("slip", "slip_rate"))
            arrival.plot(data.position, data.rupture_time, line, label=name)
            slip.plot(data.position, slips.isel(time=-1), line, label=name)
            middle = rates.isel(position=data.sizes["position"] // 2)
            rate.plot(data.time, middle, line, label=name)
            rate.set_title(f"at {float(middle.position):.4g} m")
        arrival.set(xlabel="Position (m)", ylabel="Rupture time (s)")
        slip.set(xlabel="Position (m)", ylabel="Slip at the end (m)")
        rate.set(xlabel="Time (s)", ylabel="Slip rate (m/s)")
        arrival.legend()
        return figure

    return draw()
