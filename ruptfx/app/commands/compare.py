"""`ruptfx compare`."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import (
    Interface,
    Overwrite,
    begin,
    picture,
    reported,
    runs,
    runs_and_files,
    screen,
    seconds,
    writing,
)  # fmt: skip

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

    from ruptfx.results.record import Record

HEADING = "Post-process"

UNINTERESTING = {"wall_time", "node_updates_per_second", "ranks", "host_cores", "versions", "case_hash", "title"}
NOISE = 1e-3
"""Relative difference of two results up to which they count as equal."""
ROUNDING = {"energy_closure": 1e-9}
"""Size of a result up to which it is an error of rounding."""


def compare(
    first: Annotated[Path, typer.Argument(help="A run directory.", autocompletion=runs, show_default=False)],
    second: Annotated[
        Path,
        typer.Argument(
            help="Another one, or a CSV file with measured signals.", autocompletion=runs_and_files, show_default=False
        ),
    ],
    out: Annotated[Path, typer.Option(help="Figure of both.")] = Path("comparison.png"),
    instrument: Annotated[
        str | None, typer.Option(help="Instrument of the run that measured signals are compared with.")
    ] = None,
    channel: Annotated[str | None, typer.Option(help="Only this channel, such as extension_2.")] = None,
    most_shift: Annotated[
        str | None,
        typer.Option(
            metavar="<time>",
            help="Largest time shift to try, as '5 us', or a number in s; default a quarter of the record.",
        ),
    ] = None,
    time_shift: Annotated[
        str | None,
        typer.Option(metavar="<time>", help="Time of the run minus that of the measured signals, as '-1234.5 s'."),
    ] = None,
    map_: Annotated[
        Path | None,
        typer.Option("--map", help="Case or TOML file with the mapping of the arrays, as data prints it."),
    ] = None,
    interface: Interface = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Also numbers that agree.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Compare a run with another one, or with measured signals: differences, numbers, and one figure.

    Two runs: first what differs in the cases, then results that differ by more than 0.1 %, in 3D also the rupture
    times. Measured signals: misfit and best time shift, as in `ruptfx compare RUN gauge.csv --instrument G1`; units
    are read from the header.

    Example: ruptfx compare runs/impact runs/pressed --out both.png
    """
    begin(f"reading {first} and {second}")
    with reported():
        _require_paths(first, second)
        path, is_measured = picture(out), second.is_file()
        largest_shift = seconds("--most-shift", most_shift)
        if largest_shift is not None and not largest_shift > 0:
            raise RuptfxError(f"--most-shift {most_shift}: give a positive time, such as '5 us'")
        if is_measured and interface:
            raise RuptfxError(f"{second}: a file of measured signals; --interface is for two runs")
        if not is_measured and (instrument or channel or most_shift or time_shift or map_):
            raise RuptfxError(
                f"{second}: a directory; --instrument, --channel, --most-shift, --time-shift and --map are for a file "
                "of measured signals"
            )
        with writing(path.parent, [second] * is_measured, overwrite) as files:
            if is_measured:
                from ruptfx.app.commands._measured import show

                shift = seconds("--time-shift", time_shift) or 0.0
                show(first, second, instrument, channel, largest_shift, shift, files.claim(path.name), map_)
            else:
                _compare_runs(first, second, interface, files.claim(path.name), verbose)
        screen.print(f"Picture: {path}", soft_wrap=True)


def _require_paths(first: Path, second: Path) -> None:
    """Refuse what is no run, and no file behind one."""
    if first.is_file() and second.is_dir():
        raise RuptfxError(f"{first}: a file of measured signals comes behind the run: ruptfx compare {second} {first}")
    if not second.exists():
        raise RuptfxError(
            f"{second}: no such file or directory; give a directory that 'ruptfx run' wrote, or a file with measured "
            "signals"
        )


def _compare_runs(first: Path, second: Path, interface: str | None, out: Path, verbose: bool) -> None:
    """Print what differs in the cases and results of two runs, and save a figure of both.

    The figure is of the interface of the first run with the largest slip, and of that of the same name in the second.
    """
    from ruptfx.platform.progress import working
    from ruptfx.results.record import Record

    with ExitStack() as opened:
        one, other = (opened.enter_context(Record(path)) for path in (first, second))
        name = interface or one.interface_name
        if interface or (name in other.interfaces and len(other.interfaces) > 1):
            one, other = (opened.enter_context(record.on(name)) for record in (one, other))
        changed = differences(one.case, other.case)
        screen.print("The cases differ in" if changed else "The cases are the same.", style="bold")
        table = Table("", str(first), str(second), "difference", box=None, pad_edge=False)
        for key, (a, b) in changed.items():
            table.add_row(key, _shown(a), _shown(b), _change(a, b))
        if changed:
            screen.print(table)
        _show_results(one, other, verbose)
        surfaces = _are_surfaces(one, other)
        if surfaces:
            _show_rupture_times(one, other)
        with working("drawing the figure"):
            (overlay_surfaces if surfaces else overlay)(one, other).savefig(out, dpi=150)


def _show_results(one: Record, other: Record, verbose: bool) -> None:
    """Print the results of two runs that differ by more than noise; with `verbose` all of them."""
    from ruptfx.results.summary_fields import flat, unit

    first, second = (flat(record.summary or {}) for record in (one, other))
    table = Table("", one.path.name, other.path.name, "unit", "difference", box=None, pad_edge=False)
    equal = 0
    for key in {**first, **second}:
        a, b = first.get(key), second.get(key)
        if key in UNINTERESTING or (a is None and b is None):
            continue
        if is_noise(key, a, b):
            equal += 1
            if not verbose:
                continue
        table.add_row(key, _shown(a), _shown(b), unit(key), _change(a, b))
    if table.row_count:
        screen.print("The results" if verbose else "The results differ in", style="bold")
        screen.print(table)
    if equal and not verbose:
        screen.print(f"{equal} results agree to {100 * NOISE:g} %; --verbose shows them.", soft_wrap=True)


def _are_surfaces(one: Record, other: Record) -> bool:
    """Return whether both runs have surfaces.

    Raises
    ------
    RuptfxError
        One of them has a surface and the other one a line.
    """
    from ruptfx.results.analysis.surface import is_surface

    first, second = (is_surface(record.interface) for record in (one, other))
    if first != second:
        solid, plane = (one, other) if first else (other, one)
        raise RuptfxError(
            f"{solid.path} has a surface and {plane.path} a line: compare runs of the same dimension, or export both "
            "with ruptfx export --format csv"
        )
    return first


def _show_rupture_times(one: Record, other: Record) -> None:
    """Print how far the rupture times of two surfaces are apart."""
    import numpy as np

    from ruptfx.results.analysis.surface import rupture_time_difference

    rms, largest = rupture_time_difference(one.interface, other.interface)
    if np.isfinite(rms):
        screen.print(f"Rupture times differ by {rms:.3g} s (RMS), {largest:.3g} s at most.", soft_wrap=True)
    else:
        screen.print("No point ruptured in both runs.", soft_wrap=True)


def is_noise(key: str, a: object, b: object) -> bool:
    """Return whether two results of a run are equal up to noise: 0.1 %, or sizes that are errors of rounding."""
    if isinstance(a, bool) or isinstance(b, bool) or not (isinstance(a, int | float) and isinstance(b, int | float)):
        return a == b
    return abs(a - b) <= max(NOISE * max(abs(a), abs(b)), ROUNDING.get(key, 0.0))


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
    """Draw arrival of the rupture, final slip, and slip rate at a position reached by both runs.

    What is zero or unknown in both runs is left out; where neither slipped, tractions and the jump at the end are
    drawn.
    """
    import numpy as np

    from ruptfx.results.figure_style import blank_figure, letter, scale, styled

    names, both = [record.path.name for record in (one, other)], [record.interface for record in (one, other)]
    at = _place(both)
    x, x_unit = scale(np.concatenate([data.position.values for data in both]), "m")
    t, t_unit = scale(np.concatenate([data.time.values for data in both]), "s")
    profile, history = (f"Position ({x_unit})", x, ""), (f"Time ({t_unit})", t, f"at {at / x:.4g} {x_unit}")

    def field(data: Dataset, name: str) -> DataArray:
        return data[name if name in data else f"{name}_1"]

    def panel(
        label: str, unit: str, along: tuple[str, float, str], curves: list[tuple[DataArray, DataArray]]
    ) -> tuple[str, str, float, tuple[str, float, str], list[tuple[DataArray, DataArray]]]:
        size, printed = scale(np.concatenate([values.values for _, values in curves]), unit)
        return label, printed, size, along, curves

    def last(name: str) -> list[tuple[DataArray, DataArray]]:
        return [(data.position, field(data, name).isel(time=-1)) for data in both]

    arrivals = [(data.position, data.rupture_time) for data in both]
    rates = [(data.time, field(data, "slip_rate").sel(position=at, method="nearest")) for data in both]
    items = [
        ("Rupture time", "s", profile, arrivals),
        ("Slip at the end", "m", profile, last("slip")),
        ("Slip rate", "m/s", history, rates),
    ]
    instead = [
        (f"{name.capitalize().replace('_', ' ')} at the end", unit, profile, last(name))
        for name, unit in {"shear_traction": "Pa", "normal_stress": "Pa", "displacement_jump": "m"}.items()
    ]

    def has_values(curves: list[tuple[DataArray, DataArray]]) -> bool:
        return any(np.nan_to_num(values.values).any() for _, values in curves)

    shown = [panel(*each) for each in items if has_values(each[3])]
    shown = shown or [panel(*each) for each in instead if has_values(each[3])] or [panel(*items[1])]

    @styled
    def draw() -> Figure:
        figure = blank_figure(7.0, 2.6)
        axes = np.atleast_1d(figure.subplots(1, len(shown)))
        for ax, (label, printed, size, (abscissa, over, title), curves) in zip(axes, shown, strict=True):
            for (position, values), line, name in zip(curves, ("-", "--"), names, strict=True):
                ax.plot(position / over, values / size, line, label=name)
            ax.set(xlabel=abscissa, ylabel=f"{label} ({printed})")
            ax.set_title(title, loc="right")
        letter(axes)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
        return figure

    return draw()


def overlay_surfaces(one: Record, other: Record) -> Figure:
    """Draw rupture times, slip at the end along strike, and slip rate at a position, of two surfaces.

    Contours of the rupture time of the first run are labelled. The position is the middle of the points of the first
    run that ruptured in both, or of its surface without such points; the slip is along strike through it.
    """
    import numpy as np
    from matplotlib.ticker import MaxNLocator

    from ruptfx.results.analysis.surface import SurfaceInterpolation, magnitude_of
    from ruptfx.results.figure_style import blank_figure, scale, styled
    from ruptfx.results.plots import surface_maps as _surface

    names, both = [record.path.name for record in (one, other)], [record.interface for record in (one, other)]
    strike, dip = (both[0][name].values for name in ("position", "dip"))
    ruptured = np.isfinite(SurfaceInterpolation(both[1], strike, dip)(both[1]["rupture_time"].values))
    ruptured &= np.isfinite(both[0]["rupture_time"].values)
    chosen = ruptured if ruptured.any() else np.full(len(strike), True)
    x_0, y_0 = (float(values[chosen].min() + values[chosen].max()) / 2 for values in (strike, dip))
    ends = [(data.position.values.min(), data.position.values.max()) for data in both]
    line = np.linspace(max(low for low, _ in ends), min(high for _, high in ends), 400)
    slips, rates = [], []
    for data in both:
        along = SurfaceInterpolation(data, line, np.full(len(line), y_0))
        slips.append(along(magnitude_of(data, "slip", -1)))
        at = int(np.argmin(np.hypot(data.position.values - x_0, data.dip.values - y_0)))
        rates.append(np.hypot(data.slip_rate_1.values[:, at], data.slip_rate_2.values[:, at]))
    times = np.concatenate([data.rupture_time.values for data in both])
    known = times[np.isfinite(times)]
    size, x_unit = _surface.axis_scale(both[0])
    t, t_unit = scale(np.concatenate([data.time.values for data in both]), "s")
    (u, u_unit), (v, v_unit) = scale(np.concatenate(slips), "m"), scale(np.concatenate(rates), "m/s")
    place = f"{x_0 / size:.4g}, {y_0 / size:.4g} {x_unit}"

    @styled
    def draw() -> Figure:
        figure = blank_figure(7.0, 5.0)
        axes = figure.subplot_mosaic("AA;BC", height_ratios=[1.2, 1])
        levels = np.array(MaxNLocator(12).tick_values(known.min() / t, known.max() / t) if len(known) else [])
        looks = (("-", "C0"), ("--", "C1"))
        for data, slip, rate, (style, colour) in zip(both, slips, rates, looks, strict=True):
            arrival, labels = data.rupture_time.values / t, data is both[0]
            if np.isfinite(arrival).any():
                _surface.contours(axes["A"], data, arrival, levels, colour, style, labels)
            axes["B"].plot(line / size, slip / u, style, color=colour)
            axes["C"].plot(data.time.values / t, rate / v, style, color=colour)
        axes["A"].set(title=f"Rupture time ({t_unit})", aspect="equal")
        axes["A"].set(xlim=(strike.min() / size, strike.max() / size), ylim=(dip.max() / size, dip.min() / size))
        _surface.label(axes["A"], both[0])
        axes["B"].set(xlabel=_surface.axis_names(both[0])[0], ylabel=f"Slip at the end ({u_unit})")
        axes["B"].set_title(f"{y_0 / size:.4g} {x_unit} down dip")
        axes["C"].set(xlabel=f"Time ({t_unit})", ylabel=f"Slip rate ({v_unit})", title=f"at {place}")
        handles = [axes["C"].lines[number] for number in range(2)]
        figure.legend(handles, names, loc="outside upper left", ncols=2)
        return figure

    return draw()


def _place(both: list[Dataset]) -> float:
    """Return the middle of the part that slid in both runs, else of the interface [m]."""
    import numpy as np

    slid = [data.position.values[np.isfinite(data.rupture_time.values)] for data in both]
    if all(map(len, slid)):
        first, last = max(part.min() for part in slid), min(part.max() for part in slid)
        if first <= last:
            return float(first + last) / 2
    position = both[0].position.values
    return float(position.min() + position.max()) / 2
