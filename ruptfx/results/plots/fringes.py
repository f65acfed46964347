"""Figure of isochromatic fringes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.schema import nearest
from ruptfx.results.analysis.photoelasticity import fringe_order, intensity
from ruptfx.results.analysis.polariscope import is_plate
from ruptfx.results.analysis.raster import Raster
from ruptfx.results.figure_style import Array, scale
from ruptfx.results.plots._panels import panels
from ruptfx.results.plots._record import has_pictures
from ruptfx.results.plots._sheet import Sheet, Window, figure
from ruptfx.results.record import Files

FIELDS = ("dark", "light")
MOST_FRINGES = 60  # the pixels of a figure resolve no more


class Plates:
    """Data for stress fringes: fringe constants of the bodies and thickness of the plates.

    Parameters
    ----------
    fringe_constant, thickness : float, optional
        Constant of all bodies [N/m] and thickness of the plates [m], instead of those of the case.

    Attributes
    ----------
    constants : dict of str to float
        Fringe constant by body [N/m]; NaN if unknown.
    thickness : float
        Thickness [m], NaN if unknown.
    missing : str
        Reason why there are no fringes; empty otherwise.
    """

    def __init__(self, record: Files, fringe_constant: float | None = None, thickness: float | None = None) -> None:
        case, self._bulk = record.case, record.bulk
        materials = case.get("materials", {})
        self.constants = {}
        for name in map(str, np.atleast_1d(self._bulk.attrs.get("bodies", ["bodies"]))):
            material = materials.get(name, materials.get("default", {}))
            self.constants[name] = float(fringe_constant or material.get("fringe_constant", np.nan))
        self.thickness = float(thickness or case.get("output", {}).get("plate_thickness", np.nan))
        self.missing = ""
        if "fringe" not in self._bulk or not is_plate(record):
            self.missing = "no fringes: they are of stresses in a plate"
        elif not np.isfinite(list(self.constants.values())).any():
            self.missing = "no fringes: no material\nhas a fringe_constant"
        elif not np.isfinite(self.thickness):
            self.missing = "no fringes:\noutput.plate_thickness is not given"

    def order(self, row: int) -> Array:
        """Return the fringe order at every point of a snapshot."""
        constant = np.array(list(self.constants.values()))[self._bulk["body"].values]
        return fringe_order(self._bulk["fringe"].isel(time=row).values, constant, self.thickness)

    def per_fringe(self) -> str:
        """Return the stress of one fringe as text, for every body if they differ."""
        texts = {}
        for name, constant in self.constants.items():
            size, unit = scale(constant / self.thickness, "Pa")
            known = np.isfinite(constant)
            texts[name] = f"{constant / self.thickness / size:.3g} {unit} per fringe" if known else "no fringe constant"
        if len(set(texts.values())) == 1:
            return next(iter(texts.values()))
        return ", ".join(f"{text} ({name})" for name, text in texts.items())


def most_fringes(record: Files) -> float:
    """Return the 99 % quantile of the fringe order at the last snapshot; 0 without fringes."""
    plates = Plates(record)
    if plates.missing or not record.bulk.sizes["time"]:
        return 0.0
    return float(np.nanquantile(plates.order(-1), 0.99))


def suits(record: Files) -> bool:
    """Return whether there are fringes, and few enough to be resolved."""
    return has_pictures(record, "fringe") and 0 < most_fringes(record) < MOST_FRINGES


@figure
def fringes(
    sheet: Sheet,
    record: Files,
    *,
    at: float | Sequence[float] | None = None,
    x: Window | None = None,
    field: str = "dark",
    fringe_constant: float | None = None,
    thickness: float | None = None,
) -> None:
    """Draw isochromatic fringes as seen in a polariscope, with the interface.

    Bodies whose material has no fringe constant are left blank; without a constant or the thickness of the plates the
    figure states what is missing. If the initial stress of the bodies is an assumption, a remark says so.

    Parameters
    ----------
    at
        Times [s]; the nearest snapshots are drawn. Default: four while the rupture runs.
    field : str
        "dark" or "light" field of the polariscope.
    fringe_constant : float, optional
        Constant of all bodies [N/m]. Default: `fringe_constant` of the materials.
    thickness : float, optional
        Thickness of the plates [m]. Default: `output.plate_thickness` of the case.
    """
    if field not in FIELDS:
        raise RuptfxError(f"plots.fringes: field = '{field}': {nearest(str(field), list(FIELDS))}")
    plates = Plates(record, fringe_constant, thickness)
    if plates.missing:
        sheet.empty(plates.missing)
        return

    def light(row: int, raster: Raster) -> Array:
        return intensity(raster(plates.order(row)), field)

    label = f"{field.capitalize()}-field intensity; {plates.per_fringe()}"
    panels(sheet, record, at, x, light, label, "#d9480f", cmap="gray", vmin=0, vmax=1)
    stress = str(record.bulk.attrs.get("initial_stress", ""))
    sheet.remark(f"Initial stress {stress}." if stress.startswith("assumed") else "")
