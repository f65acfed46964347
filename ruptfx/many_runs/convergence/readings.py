"""Numbers of a run that have a limit as the spacing falls: of its summary, and of the signals of its instruments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ruptfx import Table
from ruptfx.results.record import Files
from ruptfx.results.summary_fields import unit

WITHOUT_LIMIT = (
    "wall_time", "time_step", "node_updates_per_second", "noise", "mode_confidence", "energy_closure",
    "energy_closure_share",
)  # fmt: skip
"""Numbers of the mesh, of the machine, or measures of an error."""
ERRORS = ("_error", "_scatter", "_points")
ARRIVAL = 0.2  # of the largest change of a signal


class Reading(NamedTuple):
    """A number of a run and its unit."""

    value: float
    unit: str


def readings(run: Path, values: Table, plane: str) -> dict[str, Reading]:
    """Return the numbers of a run by name.

    Parameters
    ----------
    run : Path
        Directory of the complete run.
    values : dict
        Its scalars, as a study keeps them.
    plane : str
        Of the case, for the units of energies.
    """
    result = {
        name: Reading(value, unit(name, plane))
        for name, value in values.items()
        if isinstance(value, float) and np.isfinite(value) and _has_limit(name)
    }
    with Files(run, trust=True) as record:  # its plug-ins have just been executed by the run
        for name, data in record.instruments.items():
            for channel in (str(key) for key in data if key != "time"):
                if data[channel].dims != ("time",):  # a grid of receivers: its fields, and its places
                    continue
                of_channel = of_signal(np.asarray(data["time"].values), np.asarray(data[channel].values))
                units = {"peak": str(data[channel].attrs.get("units", "")), "arrival": "s"}
                units["rms"] = units["peak"]
                result |= {f"{name}.{channel} {what}": Reading(value, units[what]) for what, value in of_channel}
    return result


def _has_limit(name: str) -> bool:
    last = name.rpartition(".")[2]
    return last not in WITHOUT_LIMIT and not last.endswith(ERRORS)


def of_signal(time: np.ndarray, signal: np.ndarray) -> Iterator[tuple[str, float]]:
    """Yield the peak, the arrival and the root mean square of the change of a signal.

    The arrival is the first time at which the change since the first sample exceeds a fifth of the largest one,
    interpolated between samples. A signal that does not change has none of them.
    """
    if len(signal) < 3 or not np.all(np.isfinite(signal)):
        return
    change = np.abs(signal - signal[0])
    largest = float(change.max())
    if largest == 0:
        return
    # Peaks between samples: the parabola through the largest sample and its neighbours.
    k = int(change.argmax())
    peak = largest
    if 0 < k < len(change) - 1:
        below, above = change[k - 1], change[k + 1]
        bend = below - 2 * largest + above
        peak -= float((above - below) ** 2 / (8 * bend)) if bend < 0 else 0.0
    yield "peak", peak
    after = int(np.argmax(change > ARRIVAL * peak))
    part = (ARRIVAL * peak - change[after - 1]) / (change[after] - change[after - 1])
    yield "arrival", float(time[after - 1] + part * (time[after] - time[after - 1]))
    yield "rms", float(np.sqrt(np.mean(change**2)))


def shared(levels: Sequence[Mapping[str, Reading]]) -> Iterator[tuple[str, str, list[float]]]:
    """Yield name, unit and values of the numbers that every level has."""
    for name, reading in levels[0].items():
        if all(name in level for level in levels):
            yield name, reading.unit, [level[name].value for level in levels]
