"""Measured signals against those of an instrument of a run: misfit, best time shift, ratio of amplitudes."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.number_files import named_histories
from ruptfx.input.quantities import with_prefix

if TYPE_CHECKING:
    from ruptfx.results.record import Files

SHIFTED = 0.25  # largest shift over the common duration, without one of the user
TRIED = 400  # shifts on the coarse grid, to each side
RESOLVED = 1e-6  # shortest time shift over the sample interval that is not rounding
THINNED = 4000  # largest number of samples for the coarse grid
_ANGLE = re.compile(r"at (-?[\d.e+-]+) degrees")


class UnnamedError(RuptfxError):
    """Error of a file in which no column has the name of a channel.

    Attributes
    ----------
    channels : list of str
        Names that are known.
    """

    def __init__(self, message: str, channels: list[str]) -> None:
        super().__init__(message)
        self.channels = channels


@dataclass(frozen=True)
class Misfit:
    """A measured signal m(t) against a computed one c(t), over the times of both.

    Attributes
    ----------
    misfit : float
        rms(c - m) / rms(m) at the samples of m; NaN of one among several measured signals that is zero.
    shift : float
        s of the smallest rms(m(t) - a c(t - s)) over all a > 0 [s]: positive if the measured signal comes later. A
        wrong calibration does not change it.
    shifted : float
        Misfit after that shift, with a = 1.
    ratio : float
        a at that shift; below zero, at shift 0, where both are of opposite sign at every shift.
    limited : bool
        True if s is at the end of the searched range.
    """

    misfit: float
    shift: float
    shifted: float
    ratio: float
    limited: bool


@dataclass(frozen=True)
class Pair:
    """A measured and a computed signal of one channel.

    Attributes
    ----------
    label, unit : str
    measured_time, measured, computed_time, computed : ndarray, shape (n,)
        Each with its own samples; times in s.
    result : Misfit
    """

    label: str
    unit: str
    measured_time: np.ndarray
    measured: np.ndarray
    computed_time: np.ndarray
    computed: np.ndarray
    result: Misfit

    @property
    def shift(self) -> str:
        """Time shift as text; that of zero has the unit of the samples."""
        unit = with_prefix(_interval(self.measured_time), "s").split()[1]
        return with_prefix(self.result.shift, "s") if self.result.shift else f"0 {unit}"


def _interval(times: np.ndarray) -> float:
    """Return the shortest time between samples [s]."""
    return float(np.diff(times).min())


def channel_label(name: str, attributes: Mapping[str, object]) -> str:
    """Return the readable name of a channel; a strain gauge is named by its angle, "45°"."""
    match = _ANGLE.search(str(attributes.get("long_name", "")))
    return f"{name.rsplit('_', 1)[0]} {float(match[1]):g}°" if match else name.replace("_", " ")


def compare_with_file(
    record: Files,
    path: str | Path,
    instrument: str | None = None,
    channel: str | None = None,
    most_shift: float | None = None,
    time_shift: float = 0.0,
    more: Callable[[str], Mapping[str, tuple[np.ndarray, str]]] = lambda instrument: {},
) -> dict[str, Pair]:
    """Compare measured signals with those of an instrument.

    Parameters
    ----------
    path : path
        Text file with a column of times, which is called time or t or is the first one, and columns whose header names
        a channel. A strain gauge may be named by its angle (``45 deg``). In a file of two columns the header is free if
        the channel is clear.
    instrument : str, optional
        Name of the instrument; needed if there are several.
    channel : str, optional
        The only channel to compare.
    most_shift : float, optional
        Largest time shift that is tried [s]; default is a quarter of the common duration.
    time_shift : float
        Time of the run minus that of the file [s]: the time stamp of its beginning with a minus sign.
    more : callable
        Returns values at the times of an instrument, and their units, by further names that the header may have.

    Returns
    -------
    dict of str to Pair
        By channel.

    Raises
    ------
    RuptfxError
        Unknown instrument or channel; a file that cannot be read; no common time.
    """
    known = list(record.instruments)
    if not known:
        raise RuptfxError(f"{record.path}: the run has no instruments; add [[instruments]] to its case")
    if instrument is None and len(known) > 1:
        raise RuptfxError(f"{record.path} has the instruments {', '.join(known)}; choose one with --instrument")
    name = instrument or known[0]
    if name not in known:
        raise RuptfxError(f"--instrument {name}: {record.path} has {', '.join(known)}; choose one of them")
    data = record.instruments[name]
    if "point" in data.sizes:
        raise RuptfxError(f"--instrument {name}: is a grid of receivers; add a receiver where the signal was measured")
    labels = {str(key): channel_label(str(key), data[key].attrs) for key in data if key != "time"}
    further = more(name)
    if channel is not None and channel not in (*labels, *further):
        raise RuptfxError(f"--channel {channel}: {name} has {', '.join((*labels, *further))}; choose one of them")
    computed = {key: np.asarray(data[key].values) for key in labels}
    computed |= {key: values for key, (values, _) in further.items()}
    units = {key: str(data[key].attrs.get("units", "1")) for key in labels}
    units |= {key: unit for key, (_, unit) in further.items()}
    wanted = {key: (_aliases(name, key, labels.get(key, key)), units[key]) for key in units if channel in (None, key)}
    path = Path(path)
    try:
        only = next(iter(wanted)) if len(wanted) == 1 or len(labels) == 1 else None
        times, columns = named_histories(path, wanted, only)
    except ValueError as error:
        raise RuptfxError(str(error)) from None
    if not columns:
        first = next(iter(wanted))
        example = f"{_header(first, labels.get(first, first))} ({units[first]})"
        raise UnnamedError(
            f"{path}: no column is named like a channel of {name}: {', '.join(map(_header, labels, labels.values()))}; "
            f"rename one in its header, such as 'time (us), {example}', or give --channel and a file of two columns",
            list(map(_header, labels, labels.values())),
        )
    computed_time, times = np.asarray(data["time"].values), times + time_shift
    pairs = {}
    for key in [key for key in wanted if key in columns]:
        if columns[key].any() or len(columns) == 1:
            result = misfit(
                computed_time, computed[key], times, columns[key], most_shift, f"{path} and {name}", time_shift
            )
        else:
            result = Misfit(np.nan, 0.0, np.nan, np.nan, False)
        pairs[key] = Pair(labels.get(key, key), units[key], times, columns[key], computed_time, computed[key], result)
    return pairs


def _header(channel: str, label: str) -> str:
    """Return the name of a channel for the header of a file."""
    return f"{label.split()[-1][:-1]} deg" if label.endswith("°") else channel


def _aliases(instrument: str, channel: str, label: str) -> list[str]:
    names = [channel, channel.replace("_", " "), label]
    if label.endswith("°"):
        angle = label.split()[-1][:-1]
        names += [form.format(angle) for form in ("{}°", "{} °", "{} deg", "{}deg", "extension {} deg", "gauge {} deg")]
    return [form.lower() for name in names for form in (name, f"{instrument}.{name}", f"{instrument} {name}")]


def misfit(
    computed_time: np.ndarray, computed: np.ndarray, measured_time: np.ndarray, measured: np.ndarray,
    most_shift: float | None = None, what: str = "the signals", time_shift: float = 0.0,
) -> Misfit:  # fmt: skip
    """Return misfit and best time shift of two signals with their own samples, linear between them.

    At least half of the common time is compared at every shift. The measured times include `time_shift`.

    Raises
    ------
    RuptfxError
        The signals have no common time, or the measured one is zero.
    """
    first, last = max(computed_time[0], measured_time[0]), min(computed_time[-1], measured_time[-1])
    # A sample at the end of a run counts, although 15 us and 15 times 1e-6 s differ by rounding.
    slack = 1e-9 * max(last - first, 0.0)
    begin, end = computed_time[0] - slack, computed_time[-1] + slack
    inside = (measured_time >= begin) & (measured_time <= end)
    if last <= first or inside.sum() < 2:
        begun = computed_time[0] - (measured_time[0] - time_shift)
        clock = (
            " Are these times of a clock? Then subtract its time at the beginning of the run: --time-shift "
            f"'{begun:.12g} s' if that is the first one"
            if begun
            else f" With --time-shift '{time_shift:g} s' they are; leave it out"
        )
        raise RuptfxError(
            f"{what} have no two samples at common times: {measured_time[0]:.4g} to {measured_time[-1]:.4g} s "
            f"were measured, {computed_time[0]:.4g} to {computed_time[-1]:.4g} s computed; is the unit of time in the "
            f"header?{clock if begun or time_shift else ''}"
        )
    least = inside.sum() / 2
    if not measured[inside].any():
        raise RuptfxError(f"{what}: the measured signal is zero at all common times; choose another channel")

    def both(shift: float, every: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Return the measured signal, and the computed one after a shift; empty if too few samples are left."""
        t, m = measured_time[::every] - shift, measured[::every]
        there = (t >= begin) & (t <= end)
        if there.sum() * every < least or not m[there].any():
            there[:] = False
        return m[there], np.interp(t[there], computed_time, computed)

    def residual(shift: float, every: int = 1) -> float:
        """Return min over a > 0 of rms(m - a c) / rms(m)."""
        m, c = both(shift, every)
        product = m @ c
        return float(np.sqrt(max(0.0, 1 - product**2 / (m @ m) / (c @ c)))) if product > 0 else 1.0

    def size(shift: float) -> float:
        m, c = both(shift)
        return float(np.linalg.norm(c - m) / np.linalg.norm(m)) if len(m) else np.nan

    most = SHIFTED * (last - first) if most_shift is None else most_shift
    shift, limited = _best(residual, most, max(1, len(measured) // THINNED))
    if abs(shift) < RESOLVED * min(_interval(computed_time), _interval(measured_time)):
        shift = 0.0
    m, c = both(shift)
    return Misfit(size(0.0), shift, size(shift), float(m @ c / (c @ c)) if c.any() else np.nan, limited)


def _best(residual: Callable[..., float], most: float, every: int) -> tuple[float, bool]:
    """Return the shift of least residual, and whether it is an end of the searched range."""
    from scipy.optimize import minimize_scalar

    if most <= 0:
        return 0.0, False
    tried = np.linspace(-most, most, 2 * TRIED + 1)  # zero is one of them
    values = np.array([residual(shift, every) for shift in tried])
    best = int(np.lexsort((np.abs(tried), np.round(values, 6)))[0])  # the smallest shift of a signal that is constant
    if values[best] >= 1:  # the signals are of opposite sign at every shift
        return 0.0, False
    step, centre = tried[1] - tried[0], tried[best]
    ends = max(-most, centre - step), min(most, centre + step)
    refined = float(minimize_scalar(residual, bounds=ends, method="bounded", options={"xatol": 1e-4 * step}).x)
    shift = refined if residual(refined) < residual(centre) - 1e-7 else float(centre)
    return shift, best in (0, len(tried) - 1)
