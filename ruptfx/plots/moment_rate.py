"""Figure of the moment rate of a surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ruptfx.analysis.surface import magnitude_of, shear_modulus
from ruptfx.analysis.surface import moment_rate as rate_of
from ruptfx.plots._record import has_surface
from ruptfx.plots._sheet import Sheet, figure
from ruptfx.record import Files

PANELS = {"moment_rate": ("Moment rate", "N m/s"), "moment": ("Moment", "N m")}


def suits(record: Files) -> bool:
    """Return whether the run has a surface and two records."""
    return has_surface(record) and record.interface.sizes["time"] > 1


@figure
def moment_rate(sheet: Sheet, record: Files, *, field: str | Sequence[str] | None = None) -> None:
    """Draw the moment rate and the moment of the surface against time.

    Parameters
    ----------
    field
        Panels: "moment_rate", "moment". Default: both.
    """
    data = record.interface
    time, area = data["time"].values, data["area"].values
    moments = [float(area @ magnitude_of(data, "slip", row)) for row in range(len(time))]
    values = {"moment_rate": rate_of(data), "moment": shear_modulus(data) * np.array(moments)}
    wanted = sheet.choose(field, list(PANELS))
    axes = sheet.panels(1, len(wanted), 2.6, sharex=True)[0]
    t_size, t_unit = sheet.scale("time", time, "s")
    for ax, name in zip(axes, wanted, strict=True):
        label, unit = PANELS[name]
        size, printed = sheet.scale(name, values[name], unit)
        ax.plot(time / t_size, values[name] / size, color="#1a1a1a")
        ax.set(xlabel=f"Time ({t_unit})", ylabel=f"{label} ({printed})", xlim=(time[0] / t_size, time[-1] / t_size))
        ax.set_ylim(bottom=0)
    sheet.letter(axes)
    last = values["moment"][-1]
    if last > 0:
        magnitude = (np.log10(last) - 9.1) / 1.5
        sheet.remark(f"Moment magnitude {magnitude:.2f}; shear modulus {shear_modulus(data):.4g} Pa.")
