"""Figure of rupture times over the final slip of surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import Normalize

from ruptfx.results.analysis.surface import magnitude_of
from ruptfx.results.figure_style import RATE_MAP, scale
from ruptfx.results.plots import surface_maps as _surface
from ruptfx.results.plots._record import has_surface
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.record import Files

STEPS = (1, 2, 5)
MOST = 30  # contours


def suits(record: Files) -> bool:
    """Return whether the run has a surface and a record."""
    return has_surface(record) and record.interface.sizes["time"] > 0


@figure
def rupture_map(
    sheet: Sheet, record: Files, *, fault: str | Sequence[str] | None = None, x: Window | None = None
) -> None:
    """Draw contours of the rupture time over the slip at the last record, a panel for each surface.

    Colours begin at zero, or at the least slip if it is more than half of the largest.

    Contours are every 0.5 s, or at another even step where that would be too many or too few. There are none where a
    point has not ruptured, and none around neighbours that rupture further apart than the step, or than three times
    the median of all neighbours if that is longer: the mesh resolves no front there. Such neighbours are found where a
    front dies and points pass `output.rupture_threshold` one by one, and where slip begins ahead of the front, as
    along a free surface.

    Parameters
    ----------
    fault : str or sequence of str, optional
        Names of surfaces. Default: all.
    """
    surfaces = _surface.selected(sheet, record, fault)
    sheet.one_of(f"choose one with fault = {', '.join(map(repr, surfaces))}")
    slips = {name: magnitude_of(data, "slip", -1) for name, data in surfaces.items()}
    size, unit = sheet.scale("slip", np.concatenate(list(slips.values())), "m")
    x_scale = sheet.scale("x", max(map(_surface.extent, surfaces.values())), "m")
    low, high = (extreme([extreme(slip) for slip in slips.values()]) / size for extreme in (np.min, np.max))
    # Where all points have slipped, as after some earthquakes, the colours are those of the differences.
    norm = Normalize(low if low > 0.5 * high else 0.0, high or 1.0)
    axes, stretch = _surface.panels(sheet, surfaces)
    known = np.concatenate([data["rupture_time"].values for data in surfaces.values()])
    known, step = known[np.isfinite(known)], 0.0
    said = "No point has ruptured."
    if len(known) and np.ptp(known) > 0:
        step = _step(float(np.ptp(known)))
        t_size, t_unit = (1.0, "s") if step >= 0.01 else scale(step, "s")
        levels = step * np.arange(np.ceil(known.min() / step), np.floor(known.max() / step) + 1)
        largest = _surface.largest_difference(surfaces.values(), step)
        said = f"Contours: rupture time, every {step / t_size:g} {t_unit}, labels in {t_unit}."
    contoured = False
    for ((_, column), ax), (name, data) in zip(np.ndenumerate(axes), surfaces.items(), strict=True):
        drawn = _surface.draw(ax, data, slips[name] / size, norm, RATE_MAP, x_scale, stretch)
        if step:
            times = data["rupture_time"].values / t_size
            contoured |= _surface.contours(ax, data, times, levels / t_size, lengths=x_scale, largest=largest / t_size)
        _surface.label(ax, data, column == 0, lengths=x_scale)
        _surface.window(ax, x, x_scale, sheet.name)
        if len(record.interfaces) > 1:
            ax.set_title(name, loc="right")
    sheet.figure.colorbar(drawn, ax=axes.ravel().tolist(), label=f"Slip ({unit})", shrink=0.7 if len(axes) > 1 else 1.0)
    sheet.letter(axes)
    if step and not contoured:
        said = "No contours: rupture times of neighbours are too far apart."
    sheet.remark(said, _surface.stretched(stretch))


def _step(span: float) -> float:
    """Return the step between contours [s]: 0.5 s if that makes a readable number of them."""
    if 4 <= span / 0.5 <= MOST:
        return 0.5
    power = 10.0 ** np.floor(np.log10(span / 12))
    return float(next((step * power for step in STEPS if span / (step * power) <= 20), 10 * power))
