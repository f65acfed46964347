"""Figure of the moment rate of surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from ruptfx.results.analysis.interface_events import fast_periods, peak_rates
from ruptfx.results.analysis.surface import magnitude_of, moment, moment_magnitude
from ruptfx.results.analysis.surface import moment_rate as rate_of
from ruptfx.results.plots._record import has_surface
from ruptfx.results.plots._sheet import Sheet, figure
from ruptfx.results.record import Files, MissingFileError

PANELS = {"moment_rate": ("Moment rate", "N m/s"), "moment": ("Moment", "N m")}


def suits(record: Files) -> bool:
    """Return whether the run has a surface and two records."""
    return has_surface(record) and record.interface.sizes["time"] > 1


@figure
def moment_rate(sheet: Sheet, record: Files, *, field: str | Sequence[str] | None = None) -> None:
    """Draw the moment rate and the moment against time: those of every surface, and their sum if there are several.

    The moment rate is that of every step; of runs of earlier versions it is that of the records.

    Parameters
    ----------
    field
        Panels: "moment_rate", "moment". Default: both.
    """
    time, surfaces = record.interface["time"].values, record.interfaces
    times, rates = _rates(record, time)
    moments = {name: np.array([moment(data, row) for row in range(len(time))]) for name, data in surfaces.items()}
    values = {"moment_rate": (times, rates), "moment": (time, moments)}
    wanted = sheet.choose(field, list(PANELS))
    axes = sheet.panels(1, len(wanted), 2.6, sharex=True)[0]
    t_size, t_unit = sheet.scale("time", time, "s")
    for ax, name in zip(axes, wanted, strict=True):
        label, unit = PANELS[name]
        of_panel, curves = values[name]
        total = np.sum(list(curves.values()), axis=0)
        size, printed = sheet.scale(name, total, unit)
        ax.plot(of_panel / t_size, total / size, color="#1a1a1a", label="all")
        if len(surfaces) > 1:
            for fault, each in curves.items():
                ax.plot(of_panel / t_size, each / size, label=fault)
            ax.legend()
        ax.set(xlabel=f"Time ({t_unit})", ylabel=f"{label} ({printed})", xlim=(time[0] / t_size, time[-1] / t_size))
        ax.set_ylim(bottom=0)
    sheet.letter(axes)
    last = sum(float(each[-1]) for each in moments.values())
    if last > 0:
        potency = sum(float(data["area"].values @ magnitude_of(data, "slip", -1)) for data in surfaces.values())
        several = any(len(fast_periods(data, peak_rates(data))) > 1 for data in surfaces.values())
        of_one = f"Moment magnitude of the final slip {moment_magnitude(last):.2f}"
        sheet.remark(f"{'Several slip events' if several else of_one}; mean shear modulus {last / potency:.4g} Pa.")


def _rates(record: Files, time: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the moment rate of every surface by its name [N m/s], and its times [s]."""
    with suppress(MissingFileError):
        table = record.moment_rate
        if all(name in table for name in record.interfaces):
            return table["time"].values, {name: table[name].values for name in record.interfaces}
    return time, {name: rate_of(data) for name, data in record.interfaces.items()}
