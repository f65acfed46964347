"""Shared queries of figures to a record: reference wave speeds, labels along the interface, default times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.schema import nearest as nearest_name
from ruptfx.results.analysis import OPEN, SLIDING, UNCOVERED, nucleation, slides_far
from ruptfx.results.analysis.modes import LEVEL
from ruptfx.results.analysis.surface import is_surface
from ruptfx.results.figure_style import Array
from ruptfx.results.plots._sheet import Window, pair
from ruptfx.results.record import Data, Files

DIRECTED = ("slip", "slip_rate", "displacement_jump", "shear_traction")  # along the interface
STYLES = {"--": "dashed", ":": "dotted", "-.": "dash-dotted"}  # one line style per body
LONGEST_LABEL = 28  # letters: longer ones would reach beyond a panel


class Guide(NamedTuple):
    """Reference wave speed: symbol, speed [m/s], line style of its body."""

    symbol: str
    speed: float
    style: str = "--"


def guides(record: Files, *wanted: str) -> list[Guide]:
    """Return the reference wave speeds (``c_R c_s Eshelby c_p``; default all) that exist for the bodies.

    Antiplane motion has only c_s. If bodies differ, these are c_s and c_p of each, in a line style of its own:
    neither the Rayleigh nor the Eshelby speed of one body is a speed of the interface.
    """
    attrs = record.interface.attrs
    plane = attrs.get("plane")
    symbols = {
        "c_R": "$c_R$", "c_s": "$c_s$", "Eshelby": r"$\sqrt{2}\,c_s$", "c_p": "$c_l$" if plane == "stress" else "$c_p$",
    }  # fmt: skip
    bodies = list(_bodies_by_speeds(record))
    if len(bodies) > 1:
        items = [
            Guide(symbols[name], speed, style)
            for speeds, style in zip(bodies, STYLES, strict=False)
            for name, speed in zip(("c_p", "c_s"), speeds, strict=True)
            if name in (wanted or symbols) and (name == "c_s" or plane != "antiplane")
        ]
        items.sort(key=lambda guide: guide.speed)
    else:
        speed = {name: attrs.get(name, np.nan) for name in ("c_R", "c_s", "c_p")}
        speed["Eshelby"] = np.sqrt(2) * speed["c_s"]
        if "mach_free_speed" in attrs:  # of an anisotropic body
            speed["Eshelby"], symbols["Eshelby"] = attrs["mach_free_speed"], "$v_c$"
        known = ["c_s"] if plane == "antiplane" else list(symbols)
        items = [Guide(symbols[name], float(speed[name])) for name in known if name in (wanted or symbols)]
    return [guide for guide in items if np.isfinite(guide.speed)]


def _bodies_by_speeds(record: Files) -> dict[tuple[float, float], list[str]]:
    """Return the names of the bodies that share c_p and c_s [m/s]."""
    attrs = record.interface.attrs
    columns = [np.atleast_1d(attrs.get(name, [])) for name in ("bodies", "c_p_of_bodies", "c_s_of_bodies")]
    groups: dict[tuple[float, float], list[str]] = {}
    for name, c_p, c_s in zip(*columns, strict=True):
        groups.setdefault((float(c_p), float(c_s)), []).append(str(name))
    return groups


def along(record: Files, size: float, unit: str) -> str:
    """Return the label of an axis along `record.interface`: x, or the origin of positions, and its name of several."""
    attrs = record.interface.attrs
    name = f" on {record.interface_name}" * (len(record.interfaces) > 1)
    if attrs.get("position_measure") == "x":
        return f"x{name} ({unit})"
    if attrs.get("position_measure") == "arc length":
        start = ", ".join(f"{value / size:.4g}" for value in attrs["origin"])
        return f"Arc length{name} from ({start}) ({unit})"
    return f"Position{name or ' along the interface'} ({unit})"


def at_positions(data: Data, x: Window | None, title: str) -> Data:
    """Return the data of an interface between two positions, both included; all of them without a window.

    Raises
    ------
    RuptfxError
        No point of the interface lies there.
    """
    if x is None:
        return data
    position = data["position"].values
    low, high = pair(title, "x", x)
    room = 1e-9 * float(np.ptp(position))
    rows = np.flatnonzero(
        (position >= (-np.inf if low is None else low - room)) & (position <= (np.inf if high is None else high + room))
    )
    if len(rows) < 2:
        raise RuptfxError(
            f"plots.{title}: x = ({low}, {high}) has no two points of the interface, which runs from "
            f"{position.min():g} to {position.max():g} m; widen x"
        )
    cut: Data = data.isel(position=rows)  # type: ignore[attr-defined]
    return cut


def histories(data: Data) -> list[str]:
    """Return the fields of an interface that have a value at every time and position."""
    shape = len(data["time"].values), len(data["position"].values)
    return [name for name in map(str, data) if np.shape(data[name]) == shape]


class Quantity(NamedTuple):
    """Field of an interface in a figure: label, and unit of its numbers."""

    label: str
    unit: str


def quantity(data: Data, name: str, title: str) -> Quantity:
    """Return label and unit of a field of an interface.

    Raises
    ------
    RuptfxError
        There is no such field with histories.
    """
    known = histories(data)
    if name not in known:
        raise RuptfxError(f"plots.{title}: field = '{name}': {nearest_name(name, known)}")
    result = data[name].attrs
    label = str(result.get("long_name", name)).partition(",")[0].replace("_", " ")
    label = label if len(label) <= LONGEST_LABEL else name.replace("_", " ")
    return Quantity(label[:1].upper() + label[1:], str(result.get("units", "1")))


def signed(record: Files, name: str) -> float:
    """Return the sign of a field in figures: those along the interface are positive in the direction of the slip."""
    return direction(record) if name in DIRECTED else 1.0


def chosen(saved: Array, at: float | Sequence[float] | None, default: Array) -> Array:
    """Return the rows of the saved times nearest to the wanted ones, or the default rows."""
    return default if at is None else nearest(saved, np.atleast_1d(np.asarray(at, dtype=float)))


def sliding(data: Data, time: float) -> Array:
    """Return the points that are closed and slip faster than `rupture_threshold`, at the nearest saved time.

    Parameters
    ----------
    data : Data
        Data of the interface.
    time : float
        [s]

    Returns
    -------
    ndarray of bool, shape (points,)
        False everywhere where no slip rates were saved.
    """
    names = [name for name in ("slip_rate", "slip_rate_1", "slip_rate_2") if name in data]
    if not names or not data.sizes["time"]:
        return np.zeros(data.sizes["position"], dtype=bool)
    row = int(nearest(data["time"].values, np.asarray(time))[0])
    speed = np.linalg.norm([data[name].isel(time=row).values for name in names], axis=0)
    closed = data["normal_stress"].isel(time=row).values > 0
    return np.asarray(closed & (speed > data.attrs.get("rupture_threshold", 1e-3)))


def open_faces(data: Data, rows: Array | slice = slice(None)) -> Array:
    """Return the open points of an interface at some saved times, shape (times, points) of bool.

    A stretched cohesive point carries tension and counts as closed.
    """
    if slides_far(data):
        return np.isin(data["contact"].isel(time=rows).values, (OPEN, UNCOVERED))
    normal = data["normal_stress"].isel(time=rows).values
    if "opening" not in data:
        return np.zeros(normal.shape, dtype=bool)
    return np.asarray((data["opening"].isel(time=rows).values > 0) & (normal == 0))


def not_resolved(record: Files) -> str:
    """Return the resolution warning of the summary as a sentence for a figure; empty if there is none."""
    summary = record.summary or {}
    reasons = [str(summary["not_resolved"])] if summary.get("not_resolved") else []
    if summary.get("peak_slip_rate_resolved") is False:
        reasons.append("the largest slip rate is that of a peak a few nodes wide")
    return f"Not resolved: {'; '.join(reasons)}." if reasons else ""


def end_time(record: Files) -> float:
    """Return the last saved time [s], or the planned end if only the start was saved."""
    last = record.interface["time"].values[-1:]
    return float(last[0]) if last.sum() > 0 else float(record.case.get("duration", 1.0))


def whose_speeds(record: Files) -> str:
    """Return text that assigns line styles to bodies with different wave speeds."""
    groups = [", ".join(names) for names in _bodies_by_speeds(record).values()]
    if len(groups) < 2:
        return ""
    return "Wave speeds: " + "; ".join(f"{STYLES[s]} {g}" for s, g in zip(STYLES, groups, strict=False)) + "."


def turned(record: Files) -> str:
    """Return a remark if figures reverse the sign of slip and shear traction, else an empty text."""
    against = "Slip is against the tangent of the interface: signs of slip, slip rate and shear traction are turned."
    return against if direction(record) < 0 else ""


def direction(record: Files) -> float:
    """Return the sign of the slip; figures count slip and shear traction positive in its direction."""
    last = record.interface["slip"].isel(time=slice(-1, None)).values
    return -1.0 if last.sum() < 0 else 1.0


def default_times(record: Files, saved: Array, count: int) -> Array:
    """Return indices of up to `count` saved times during the rupture.

    If fewer were saved during it, times from its start on are used, else times of the whole run.
    """
    tracked = [data["rupture_time"].values for data in record.interfaces.values() if "rupture_time" in data]
    arrival = np.concatenate([*tracked, np.array([])])
    arrival = arrival[np.isfinite(arrival)]
    first, last = np.quantile(arrival, [0.15, 1.0]) if len(arrival) else (0.0, np.inf)
    last = last if has_front(record) else np.inf
    running = np.flatnonzero((saved >= first) & (saved <= last))
    for since in (first, -np.inf):
        running = running if len(running) >= count else np.flatnonzero(saved >= since)
    # Equal steps back from the last time, at which slip is largest.
    step = max(1, (len(running) - 1) // max(count - 1, 1))
    return running[::-step][:count][::-1]


def nearest(saved: Array, wanted: Array) -> Array:
    """Return the index of the saved time nearest to each wanted time."""
    return np.abs(np.asarray(saved)[None, :] - np.atleast_1d(wanted)[:, None]).argmin(axis=1)


def rate_range(data: Data, rate: Array) -> tuple[float, float, bool]:
    """Return sliding threshold, 99.9 % quantile of the slip rate, and whether to use a logarithmic scale."""
    low = LEVEL * (data.attrs.get("V_imp") or rate.max())
    sliding = rate[rate > low]
    middle, high = np.quantile(sliding, [0.5, 0.999]) if len(sliding) else (low, rate.max())
    return float(low), float(high), bool(high > 10 * middle)


UNEVEN = 100.0  # largest over median time between records above which a run counts as uneven


def has_slip_rates(record: Files) -> bool:
    """Return whether the run has an interface with slip rates."""
    return bool(record.interfaces) and "slip_rate" in record.interface


def has_surface(record: Files) -> bool:
    """Return whether `record.interface` is a surface."""
    return bool(record.interfaces) and is_surface(record.interface)


def slid(record: Files) -> bool:
    """Return whether `record.interface` slipped in some record; in finite sliding, whether a closed point did."""
    if not has_slip_rates(record):
        return False
    data = record.interface
    field = data["contact"].values == SLIDING if slides_far(data) else data["slip_rate"].values
    return bool(np.any(field))


LEAST = 4  # points, for the speed of a front


def has_front(record: Files) -> bool:
    """Return whether enough of `record.interface` slipped for a front (in finite sliding, half of it)."""
    if not has_slip_rates(record):
        return False
    began = np.isfinite(record.interface["rupture_time"].values)
    return bool(began.sum() >= LEAST and (began.mean() >= 0.5 or not slides_far(record.interface)))


def has_origin(record: Files) -> bool:
    """Return whether waves start at one position of `record.interface`: a front, or a nucleation of the case."""
    return has_front(record) or bool(np.isfinite(nucleation(record.interface)[1]))


def is_uneven(record: Files) -> bool:
    """Return whether saved times are so uneven that fast phases would be invisible."""
    gaps = np.diff(record.interface["time"].values)
    return len(gaps) > 3 and float(gaps.max()) > UNEVEN * float(np.median(gaps[gaps > 0]))


def is_quasi_static(record: Files) -> bool:
    """Return whether the run is quasi-static, without waves."""
    return bool(record.case.get("stepper", {}).get("kind") == "quasi_static")


def has_pictures(record: Files, field: str) -> bool:
    """Return whether a field of the bodies was saved, in two dimensions."""
    there = (record.path / "bulk.h5").is_file()
    return there and record.bulk["points"].shape[1] == 2 and field in record.bulk
