"""What a run found, in one sentence and eight numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ruptfx import Table
from ruptfx.input.quantities import with_prefix
from ruptfx.results.analysis import UNITS

ROWS = (
    "moment", "rupture_area", "first_sliding", "peak_slip_rate", "max_slip",
    "max_opening", "pulse_width", "pulse_spacing", "healing_time",
    "first_peak_stress", "events", "tensile_share", "b_value", "fractal_dimension", "failed_length", "fragments",
    "energy_closure", "steps", "wall_time",
)  # fmt: skip
"""Fields of the summary in the order of their interest; the first eight that are known and not zero are shown."""
OF_EACH = ("max_slip", "moment", "stress_drop", "tip_speed", "rupture_speed", "first_sliding")
"""Fields of the row of each of several interfaces."""
_SHARES = ("tensile_share", "energy_closure")


def verdict(summary: Table) -> str:
    """Return what a run found in one line; empty where its summary names neither a mode nor facets that failed.

    Of several interfaces it names the one with the largest slip, of which mode, speeds and magnitude are.

    Parameters
    ----------
    summary : dict
        Content of `summary.json`.
    """
    parts = [*_events(summary)] or [*_sliding(summary), *_surface(summary)]
    if parts and "interfaces" in summary:
        parts[0] = f"{summary['interface']}: {parts[0]}"
    parts += _fracture(summary)
    if reason := summary.get("not_resolved"):
        parts.append(f"not resolved: {reason}")
    return ", ".join(parts)


def _events(summary: Table) -> Iterator[str]:
    """Yield number, magnitudes or slip, interval and front speed where a record has several slip events."""
    if not (count := summary.get("slip_events")):
        return
    complete = summary["slip_events_complete"]
    yield f"{count} slip events" + f", {complete or 'none'} of them complete" * (complete < count)
    bounds = [summary.get(f"{name}_event_magnitude") for name in ("smallest", "largest")]
    if None not in bounds:
        first, last = (f"{value:.2f}" for value in bounds)
        yield f"magnitude {last}" if first == last else f"magnitudes {first} to {last}"
    elif slip := summary.get("largest_event_slip"):
        yield f"slip up to {with_prefix(slip, 'm')}"
    least, most = (with_prefix(summary[f"{name}_event_interval"], "s") for name in ("shortest", "longest"))
    yield f"{least} apart" if least == most else f"{least} to {most} apart"
    if speed := summary.get("largest_event_front_speed"):
        yield f"front of the largest at {_barred(summary, 'largest_event_front_speed', speed, 'm/s')} (median)"
    elif reason := summary.get("largest_event_front_missing"):
        yield f"no front speed of the largest: {reason}"


def _sliding(summary: Table) -> Iterator[str]:
    if reason := summary.get("mode_missing"):
        yield f"no sliding mode: {reason}"
    mode = summary.get("mode")
    if mode == "none":
        yield "never slipped" if summary.get("first_sliding") is None else "no rupture ran along the interface"
        return
    if mode is None:
        return
    yield mode if mode != "not resolved" else f"perhaps {summary['mode_before_arrest']}"
    regime = summary.get("speed_regime")
    if regime not in (None, "unknown", "not resolved"):
        yield regime
    speed, error = summary.get("tip_speed"), summary.get("tip_speed_error") or 0.0
    for wave in ("c_R", "c_s"):
        if over := summary.get(f"tip_speed_over_{wave}"):
            of_mesh = _bars(summary).get(f"tip_speed_over_{wave}", {}).get("bar", 0.0)
            yield f"{over:.2f} {wave} ± {max(error * over / speed, of_mesh, 0.01):.2f}"
            return


def _surface(summary: Table) -> Iterator[str]:
    if "rupture_area" not in summary:
        return
    if summary.get("moment_magnitude") is None:
        yield "never slipped"
        return
    magnitude, share_bar = _bars(summary).get("moment_magnitude"), _bars(summary).get("supershear_share")
    yield f"magnitude {summary['moment_magnitude']:.2f}" + (
        f" ± {max(magnitude['bar'], 0.01):.2f}" if magnitude else ""
    )
    if speed := summary.get("rupture_speed"):
        yield f"front at {_barred(summary, 'rupture_speed', speed, 'm/s')} (median)"
    if share := summary.get("supershear_share"):
        of_mesh = f" ± {max(100 * share_bar['bar'], 1):.0f}" if share_bar else ""
        yield f"supershear on {100 * share:.0f}{of_mesh} %"


def _fracture(summary: Table) -> Iterator[str]:
    if summary.get("events") is None:
        return
    if stress := summary.get("first_peak_stress"):
        yield f"first peak at {_barred(summary, 'first_peak_stress', stress, 'Pa')}"
    yield f"{summary['events']} facets failed" if summary["events"] else "no facet failed"
    if (pieces := summary.get("fragments") or 0) > 1:
        yield f"{pieces} pieces"


def rows(summary: Table, most: int = 8) -> list[tuple[str, str]]:
    """Return names and values with units of the fields of most interest, and a row for each of several interfaces.

    Parameters
    ----------
    summary : dict
        Content of `summary.json`.
    """
    known = [(name, value) for name in ROWS if (value := summary.get(name))][:most]
    bars = _bars(summary)
    result = [(name, shown(name, value) + (_bar(name, bars[name]) if name in bars else "")) for name, value in known]
    return result + [(f"faults.{name}", _of_one(table)) for name, table in (summary.get("interfaces") or {}).items()]


def _of_one(summary: Table) -> str:
    """Return mode and numbers of one of several interfaces."""
    mode = str(summary.get("mode_before_arrest") or summary.get("mode") or "")
    numbers = [f"{name.replace('_', ' ')} {shown(name, value)}" for name in OF_EACH if (value := summary.get(name))]
    return ", ".join([*[mode] * bool(mode), *numbers]) or "no slip"


def _bars(summary: Table) -> Table:
    bars: Table = summary.get("error_bars") or {}
    return bars


def _barred(summary: Table, name: str, value: float, unit: str) -> str:
    """Return a value with its unit, and its error bar where the run has one."""
    entry = _bars(summary).get(name)
    return with_prefix(value, unit) + (f" ± {with_prefix(entry['bar'], unit, 2)}" if entry else "")


def _bar(name: str, entry: Table) -> str:
    return f" ± {shown(name, entry['bar'])} ({entry['of']}{', not in the asymptotic range' * bool(entry['outside'])})"


def with_bar(value: float, bar: float) -> str:
    """Return a value and its error bar with the digits that the bar leaves: 3.59 ± 0.04."""
    if not bar > 0 or not math.isfinite(bar):
        return f"{value:.6g} ± {bar:.2g}"
    place = math.floor(math.log10(bar)) - (bar < 3 * 10 ** math.floor(math.log10(bar)))
    digits = max(math.floor(math.log10(abs(value))) if value else place, place) - place
    if -5 < place <= 0 and abs(value) < 1e5:
        return f"{value:.{-place}f} ± {bar:.{-place}f}"
    return f"{value:.{min(digits, 15)}e} ± {bar:.1e}"


def shown(name: str, value: float) -> str:
    """Return a value of the summary as a reader wants it: three digits, unit with prefix, shares in per cent."""
    if name in _SHARES:
        return f"{100 * value:.3g} %"
    if name == "rupture_area":  # prefixes are those of lengths
        return f"{value / 1e6:.3g} km2" if value > 1e4 else f"{value:.3g} m2"
    unit = UNITS.get(name, "s" if name in ("wall_time", "time_step") else "")
    if unit == "N m":
        return f"{value:.3g} N m"
    return with_prefix(value, unit) if unit else f"{value:.3g}" if isinstance(value, float) else str(value)
