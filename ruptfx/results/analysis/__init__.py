"""Analysis of a run from saved arrays: sliding mode, fronts, energies, fringes; needs neither DOLFINx nor MPI."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError, Table
from ruptfx.results.analysis.energy import budget
from ruptfx.results.analysis.interface_events import of_events, peak_rates
from ruptfx.results.analysis.modes import QUIET, Modes, classify
from ruptfx.results.analysis.resolution import peak_is_resolved
from ruptfx.results.analysis.surface import (
    all_surfaces,
    is_surface,
    of_surface,
    of_surfaces,
    radiated_energy_of,
    wave_speeds,
)
from ruptfx.results.summary_fields import UNITS, UNITS_OF_FRACTURE, UNITS_OF_SURFACES

if TYPE_CHECKING:
    from ruptfx.results.record import Data, Files

__all__ = [
    "UNITS",
    "UNITS_OF_FRACTURE",
    "UNITS_OF_SURFACES",
    "Modes",
    "classify",
    "modes_of",
    "nucleation",
    "rupture_origin",
    "slides_far",
    "sliding_rate",
    "summarise",
]

OPEN, SLIDING, UNCOVERED = 0, 2, 3  # values of the field `contact`
LARGEST = ("peak_slip_rate", "max_slip", "max_opening")
EQUAL = 1e-6  # relative difference of the slips of two interfaces that counts as none


def slides_far(data: Data) -> bool:
    """Return whether the data are of an interface with finite sliding, which records contact states."""
    return "contact" in data


def _data_of(record: Files, interface: str | None) -> Data:
    return record.interface if interface is None else record.interfaces[interface]


def sliding_rate(record: Files, interface: str | None = None) -> np.ndarray:
    """Return the slip rate along an interface [m/s], shape (times, points).

    In finite sliding it is zero at open points: their surfaces pass each other without friction, which does not count
    as sliding.

    Parameters
    ----------
    interface : str, optional
        Name; default: that of `record.interface`.
    """
    data = _data_of(record, interface)
    rate = np.asarray(data["slip_rate"].values)
    if not slides_far(data):
        return rate
    return np.where(np.isin(data["contact"].values, (OPEN, UNCOVERED)), 0.0, rate)


def nucleation(data: Data) -> tuple[float, float]:
    """Return time [s] and position [m] of the nucleation of an interface after its loading; NaN if there is none."""
    return float(data.attrs.get("nucleation_time", -np.inf)), float(data.attrs.get("nucleation_position", np.nan))


def rupture_origin(record: Files, interface: str | None = None) -> tuple[float, float]:
    """Return the position [m] and time [s] from which the rupture of an interface runs; arguments as `sliding_rate`.

    With a nucleation in the case: its position and time. After an impact: the driven end at time zero. Otherwise,
    and if a slow drive makes the interface slide later than a shear wave needs to run along it: where and when
    sliding began: the median of the points that slid in the first hundredth of the time that the rupture took.
    """
    data = _data_of(record, interface)
    position = data["position"].values
    since, center = nucleation(data)
    if np.isfinite(center):
        return center, since
    arrival = data["rupture_time"].values
    end = float(data.attrs.get("loaded_end", position[0]))
    if not np.isfinite(arrival).any():
        return end, 0.0
    first, last = np.nanmin(arrival), np.nanmax(arrival)
    if data.attrs.get("V_imp", 0) > 0 and first * data.attrs.get("c_s", 0) < np.ptp(position):
        return end, 0.0
    return float(np.median(position[arrival <= first + 0.01 * (last - first)])), float(first)


def modes_of(record: Files, interface: str | None = None) -> Modes:
    """Classify the sliding along an interface of a run; arguments as `sliding_rate`."""
    data = _data_of(record, interface)
    rate, origin = sliding_rate(record, interface), rupture_origin(record, interface)[0]
    return classify(
        rate,
        data["time"].values,
        data["position"].values,
        loaded_end=origin,
        V_imp=data.attrs.get("V_imp"),
        quiet=float(data.attrs.get("rupture_threshold", QUIET)),
        **wave_speeds(data),
    )


def summarise(record: Files) -> Table:
    """Return scalars of a run, ready for JSON: floats in SI units (`UNITS`), names, None if undefined.

    Of several interfaces the table `interfaces` has the scalars of each by name. Those of the run are of the interface
    with the largest slip (`interface`), but for the sum of the moments and of the areas, and the first time and the
    largest values of all interfaces. The order of the interfaces in the case does not matter.
    """
    each = {name: _of_interface(record, name) for name in sorted(record.interfaces)}
    values: Table = _of_all(record, each) if each else dict.fromkeys(("first_sliding", *LARGEST), np.nan)
    if (record.path / "events.h5").is_file():
        from ruptfx.results.analysis.compression import summarise_fracture  # imported late: other runs do not need it

        values |= summarise_fracture(record)
    if (record.path / "energy.csv").is_file():
        values["energy_closure"] = budget(record.energy)["energy_closure"]
        if all_surfaces(record):
            values["radiated_energy"] = radiated_energy_of(record)
    if len(each) > 1:
        values["interfaces"] = {name: _plain(result) for name, result in each.items()}
    return _plain(values)


def _of_interface(record: Files, name: str) -> Table:
    """Return the scalars of one interface."""
    data = record.interfaces[name]
    events = of_events(
        data, np.abs(sliding_rate(record, name)).max(axis=1) if "slip_rate" in data else peak_rates(data)
    )
    try:
        values = _of_sliding(record, name) if "slip_rate" in data and not events else {}
    except RuptfxError as error:  # too few points for a mode; the other scalars remain valid
        values = {"mode": None, "mode_missing": str(error)}
    if events and "slip_rate" in data:
        values = {
            "mode": None,
            "mode_missing": f"a mode is of one slip event, and the record has {events['slip_events']}",
        }
    first = data["rupture_time"].values if "rupture_time" in data else np.array([])
    values["first_sliding"] = np.min(first[np.isfinite(first)], initial=np.inf)
    for quantity in LARGEST:
        field = quantity.removeprefix("max_")
        values[quantity] = _largest(data[field]) if field in data else np.nan
    return values | (of_surface(data, bool(events)) if is_surface(data) else {}) | events


def _of_all(record: Files, each: dict[str, Table]) -> Table:
    """Return the scalars of a run from those of its interfaces."""
    slips = {name: np.nan_to_num(value["max_slip"], nan=-1.0) for name, value in each.items()}
    # Of slips that are equal to rounding the first name decides, on any number of ranks.
    decisive = next(name for name, slip in slips.items() if slip >= max(slips.values()) * (1 - EQUAL))
    values = {"interface": decisive, **each[decisive]}
    values["first_sliding"] = min(value["first_sliding"] for value in each.values())
    for name in ("peak_slip_rate", "max_opening"):
        largest = max(each.values(), key=lambda result: np.nan_to_num(result[name], nan=-1.0))
        values |= {key: largest[key] for key in (name, f"{name}_resolved") if key in largest}
    if all_surfaces(record):
        values |= of_surfaces(record, list(each.values()))
    return values


def _of_sliding(record: Files, name: str) -> Table:
    """Return the result of the classification under the names of the summary."""
    data, modes = record.interfaces[name], modes_of(record, name)
    tip = modes.tip_speed
    speeds = {wave: modes.speeds.get(wave, np.nan) for wave in ("c_R", "c_s", "c_p")}
    if data.attrs.get("plane") == "antiplane":  # there are shear waves only
        speeds |= {"c_R": np.nan, "c_p": np.nan}
    while_closed = np.where(data["normal_stress"].values > 0, data["slip_rate"].values, 0.0)
    trailing = modes.trailing_speeds[np.isfinite(modes.trailing_speeds)]
    return {
        "mode": modes.mode,
        "mode_at_half_threshold": modes.mode_at_half_threshold,
        "mode_before_arrest": modes.pattern,
        "mode_confidence": modes.confidence,
        "tip_speed": tip.value,
        "tip_speed_error": tip.error,
        "tip_speed_over_c_R": tip.value / speeds["c_R"],
        "tip_speed_over_c_s": tip.value / speeds["c_s"],
        "tip_speed_over_c_l": tip.value / speeds["c_p"],
        "speed_regime": modes.regime,
        "not_resolved": "; ".join((*modes.doubts.mode, *modes.doubts.speed)) or None,
        "peak_slip_rate_resolved": peak_is_resolved(while_closed, data["position"].values),
        "reach": modes.reach,
        "sliding_fraction": modes.sliding_fraction,
        "zones": modes.zones,
        "pulse_width": modes.pulse_width,
        "pulse_width_scatter": modes.pulse_width_scatter,
        "pulse_width_points": modes.zone_points,
        "pulse_spacing": modes.pulse_spacing,
        "pulse_spacing_scatter": modes.pulse_spacing_scatter,
        "healing_time": modes.healing_time,
        "trailing_fronts": len(trailing),
        "fastest_trailing_speed": trailing.max(initial=-np.inf),
        "trailing_fronts_faster_than_c_l": int((trailing > speeds["c_p"]).sum()),
        **{f"{name}_degree": degree for name, degree in modes.degrees.items()},
        "noise": modes.doubts.noise,
    }


def _largest(values: object) -> float:
    numbers = np.abs(np.asarray(values))
    return float(np.nanmax(numbers)) if np.isfinite(numbers).any() else float(np.nan)


def _plain(values: Table) -> Table:
    """Convert NumPy numbers to Python, NaN to None, for JSON."""
    return {
        name: (float(value) if np.isfinite(value) else None) if isinstance(value, float | np.floating) else value
        for name, value in values.items()
    }
