"""Figure of the moment rate of a surface."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ruptfx.analysis.surface import magnitude_of, shear_modulus
from ruptfx.analysis.surface import moment_rate as rate_of
from ruptfx.figure_style import letter, new_figure, remark, scale, styled
from ruptfx.plots._record import has_surface
from ruptfx.record import Files


def suits(record: Files) -> bool:
    """Return whether the run has a surface and two records."""
    return has_surface(record) and record.interface.sizes["time"] > 1


@styled
def moment_rate(record: Files) -> Figure:
    """Draw the moment rate and the moment of the surface against time."""
    data = record.interface
    time, area = data["time"].values, data["area"].values
    moments = [float(area @ magnitude_of(data, "slip", row)) for row in range(len(time))]
    rate, moment = rate_of(data), shear_modulus(data) * np.array(moments)
    t_size, t_unit = scale(time, "s")
    figure, axes = new_figure(1, 2, 2.6, sharex=True)
    for ax, values, label in zip(axes[0], (rate, moment), ("Moment rate (N m/s)", "Moment (N m)"), strict=True):
        ax.plot(time / t_size, values, color="#1a1a1a")
        ax.set(xlabel=f"Time ({t_unit})", ylabel=label, xlim=(time[0] / t_size, time[-1] / t_size))
        ax.set_ylim(bottom=0)
    if moment[-1] > 0:
        magnitude = (np.log10(moment[-1]) - 9.1) / 1.5
        remark(figure, f"Moment magnitude {magnitude:.2f}; shear modulus {shear_modulus(data):.4g} Pa.")
    letter(axes[0])
    return figure
