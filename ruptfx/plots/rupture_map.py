"""Figure of rupture times over the final slip of a surface."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import Normalize

from ruptfx.analysis.surface import magnitude_of
from ruptfx.figure_style import RATE_MAP, scale
from ruptfx.plots import _surface
from ruptfx.plots._record import has_surface
from ruptfx.plots._sheet import Sheet, Window, figure
from ruptfx.record import Files

STEPS = (1, 2, 5)
MOST = 30  # contours


def suits(record: Files) -> bool:
    """Return whether the run has a surface and a record."""
    return has_surface(record) and record.interface.sizes["time"] > 0


@figure
def rupture_map(sheet: Sheet, record: Files, *, x: Window | None = None) -> None:
    """Draw contours of the rupture time over the slip at the last record.

    Contours are every 0.5 s, or at another even step where that would be too many or too few.
    """
    data = record.interface
    slip, times = magnitude_of(data, "slip", -1), data["rupture_time"].values
    size, unit = sheet.scale("slip", slip, "m")
    x_scale = sheet.scale("x", _surface.extent(data), "m")
    ratio = np.ptp(data["dip"].values) / max(np.ptp(data["position"].values), 1e-300)
    ax = sheet.panels(1, 1, float(np.clip(0.9 + 5.6 * ratio, 1.8, 6.5)))[0, 0]
    drawn = _surface.draw(ax, data, slip / size, Normalize(0, max(slip.max() / size, 1e-300)), RATE_MAP, x_scale)
    sheet.figure.colorbar(drawn, ax=ax, label=f"Slip ({unit})", shrink=min(1.0, 2 * ratio + 0.2))
    known = times[np.isfinite(times)]
    said = "No point has ruptured."
    if len(known) and np.ptp(known) > 0:
        step = _step(float(np.ptp(known)))
        levels = step * np.arange(np.ceil(known.min() / step), np.floor(known.max() / step) + 1)
        t_size, t_unit = (1.0, "s") if step >= 0.01 else scale(step, "s")
        _surface.contours(ax, data, times / t_size, levels / t_size, lengths=x_scale)
        said = f"Contours: rupture time, every {step / t_size:g} {t_unit}, labels in {t_unit}."
    _surface.label(ax, data, lengths=x_scale)
    _surface.window(ax, x, x_scale, sheet.name)
    sheet.remark(said)


def _step(span: float) -> float:
    """Return the step between contours [s]: 0.5 s if that makes a readable number of them."""
    if 4 <= span / 0.5 <= MOST:
        return 0.5
    power = 10.0 ** np.floor(np.log10(span / 12))
    return float(next((step * power for step in STEPS if span / (step * power) <= 20), 10 * power))
