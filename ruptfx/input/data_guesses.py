"""Guesses about arrays of a data file: what is the time, sampling rates, units from names and sizes, a mapping.

A guess is a proposal that the user checks: units of files count, guesses fill what is missing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ruptfx.input.data_files import Variable

TIMES = re.compile(r"(^|[/_ ])(t|time|times|zeit|tt|time_?vec\w*)([_ ]|$)", re.I)
RATES = re.compile(r"(^|[/_ ])(fs|rate|sampling_?(rate|frequency)|sample_?rate|freq)([_ ]|$)", re.I)
PLACES = re.compile(r"(^|[/_ ])(x|y|z|[xyz]?_?pos\w*|coord\w*|location\w*|sensor_?\w*)([_ ]|$)", re.I)
KINDS: tuple[tuple[str, str, tuple[tuple[float, str], ...]], ...] = (
    (r"strain|eps|gauge|^sg|ext", "strain", ((0.02, "1"), (np.inf, "um/m"))),
    (r"vel|slip_?rate|ldv", "velocity", ((50.0, "m/s"), (np.inf, "mm/s"))),
    (r"slip|disp|^d$|lvdt|gap", "displacement", ((1e-3, "m"), (3.0, "mm"), (np.inf, "um"))),
    (r"acc", "acceleration", ((np.inf, "m/s2"),)),
    (r"stress|tau|sigma|press", "stress", ((1e4, "MPa"), (np.inf, "Pa"))),
    (r"force|load", "force", ((1e3, "kN"), (np.inf, "N"))),
)
"""Pattern of a name, kind, and the guessed units up to a largest size of the values."""
LONGEST = 1e5  # s of an experiment


@dataclass(frozen=True)
class Guess:
    """Kind and unit that an array probably has.

    Attributes
    ----------
    kind : str
        time, rate, positions, strain, velocity, ..., or empty.
    unit : str
        Unit of the file or the guess, empty without one.
    is_guess : bool
        Whether the unit is a guess.
    rate : float or None
        Sampling rate of a time in that unit [1/s].
    """

    kind: str
    unit: str
    is_guess: bool
    rate: float | None = None


def guess(variable: Variable, length: int) -> Guess:
    """Return what an array may be; `length` is the number of samples of the longest one."""
    values, unit = variable.values, variable.unit
    name = variable.name
    if values.size == 1:
        return Guess("rate", unit or "Hz", not unit) if RATES.search(name) else Guess("", unit, False)
    if _is_time(variable, length):
        used = unit or _time_unit(values)
        scale = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}.get(used)
        spacing = float(np.median(np.diff(values)))
        return Guess("time", used, not unit, None if scale is None or spacing <= 0 else 1 / (spacing * scale))
    if len(values) < length and PLACES.search(name):
        largest = float(np.nanmax(np.abs(values), initial=0.0))
        return Guess("positions", unit or ("mm" if largest > 5 else "m"), not unit)
    known = values[np.isfinite(values)]
    largest = float(np.abs(known - known.mean()).max()) if known.size else 0.0
    last = name.rpartition("/")[2]
    for pattern, kind, units in KINDS:
        if re.search(pattern, last, re.I):
            return Guess(kind, unit or next(text for most, text in units if largest <= most), not unit)
    return Guess("", unit, False)


def _is_time(variable: Variable, length: int) -> bool:
    values = variable.values
    if values.ndim != 1 or len(values) != length or not np.all(np.diff(values) > 0):
        return False
    if TIMES.search(variable.name):
        return True
    steps = np.diff(values)
    return bool(np.ptp(steps) <= 1e-3 * np.median(steps))  # evenly spaced numbers


def _time_unit(values: np.ndarray) -> str:
    """Return the unit in which a time has a usual sampling rate, from 1 Hz to 1 GHz, seconds first."""
    spacing, last = float(np.median(np.diff(values))), float(values[-1] - values[0])
    if spacing < 0.02 or last > LONGEST:
        return "s"
    return "us" if spacing <= 100 and last < 1e5 and float(values[0]).is_integer() else "ms"


def proposal(variables: Sequence[Variable], instrument: str | None = None, file: str = "") -> list[str]:
    """Return lines of TOML that map the arrays to channels of instruments; comments say what is a guess.

    Channels are called by their arrays: the user replaces the names by those of the instrument. Without an instrument,
    arrays that are called `G1 45 deg`, `G1 135 deg`, `G2 45 deg` ... have an entry for each of G1, G2 ...

    Parameters
    ----------
    variables : sequence of Variable
    instrument : str, optional
        Instrument of all arrays.
    file : str
        Name for the entries; without it they have none.
    """
    length = max((each.shape[0] for each in variables), default=0)
    guesses = {each.name: guess(each, length) for each in variables}
    clock = _clock(variables, guesses)
    others = ("time", "rate", "positions")
    signals = [each for each in variables if each.shape[0] == length and guesses[each.name].kind not in others]
    plain = [(re.sub(r"\W+", "_", each.name.rpartition("/")[2]).strip("_"), each) for each in signals]
    groups = (_by_instrument(signals) if instrument is None else {}) or {instrument or "NAME": plain}
    lines = []
    for name, members in groups.items():
        noisy = next((each for _, each in members if guesses[each.name].unit), None)
        sigma = _noise(noisy, guesses[noisy.name].unit) if noisy is not None else ""
        lines += ["[[objective]]", 'kind = "traces"', f'instrument = "{name}"', *[f'file = "{file}"'] * bool(file)]
        lines += [sigma or "sigma = 1.0   # replace by the noise, with a unit", clock]
        for channel, each in members:
            lines += _mapped(channel, each, guesses[each.name])
    return lines


def _clock(variables: Sequence[Variable], guesses: Mapping[str, Guess]) -> str:
    """Return the line of the time."""
    times = [name for name, each in guesses.items() if each.kind == "time"]
    times.sort(key=lambda name: TIMES.search(name) is None)
    rates = [each for each in variables if guesses[each.name].kind == "rate"]
    if times:
        clock = guesses[times[0]]
        return f'map.time = {{ variable = "{times[0]}", unit = "{clock.unit}" }}{_mark(clock)}'
    if rates:
        return f'map.time = {{ rate = "{float(rates[0].values.ravel()[0]):.10g} Hz" }}   # from {rates[0].name}'
    return 'map.time = { rate = "1 MHz" }   # no time in the file: give the sampling rate'


def _by_instrument(signals: Sequence[Variable]) -> dict[str, list[tuple[str, Variable]]]:
    """Return channels and arrays by instrument if names are `G1 45 deg`, and all instruments have the same channels."""
    groups: dict[str, list[tuple[str, Variable]]] = {}
    for each in signals:
        parts = re.fullmatch(r"(\w+)[. ](\S.*)", each.name)
        if parts is None or len(each.shape) > 1:
            return {}
        groups.setdefault(parts[1], []).append((f'"{parts[2]}"', each))
    channels = {tuple(channel for channel, _ in members) for members in groups.values()}
    return groups if len(groups) > 1 and len(channels) == 1 else {}


def _mapped(channel: str, variable: Variable, known: Guess) -> list[str]:
    """Return the line of every column of an array."""
    width = variable.shape[1] if len(variable.shape) == 2 else 1
    unit = f', unit = "{known.unit or "?"}"' if known.is_guess or not known.unit else ""
    mark = _mark(known) if known.unit else "   # unit not known: replace ?"
    lines = []
    for column in range(1, width + 1):
        where, name = (f", column = {column}", f"{channel}_{column}") if width > 1 else ("", channel)
        lines.append(f'map.{name} = {{ variable = "{variable.name}"{where}{unit}, sign = 1 }}{mark}')
    return lines


def _noise(variable: Variable, unit: str) -> str:
    """Return the line of the noise: the scatter of second differences of a signal, which a smooth signal has not."""
    values = variable.values if variable.values.ndim == 1 else variable.values[:, 0]
    values = values[np.isfinite(values)]
    scatter = 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / np.sqrt(6) if len(values) > 3 else 0.0
    return f'sigma = "{scatter:.3g} {unit}"   # scatter of {variable.name} between samples, a guess' if scatter else ""


def _mark(known: Guess) -> str:
    return f"   # {known.unit} is a guess" if known.is_guess else ""
