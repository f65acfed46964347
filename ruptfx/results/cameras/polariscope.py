"""Photoelastic fringes behind a polariscope."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from ruptfx.input.units import Angle
from ruptfx.laws.materials import IN_PLANE, Plane
from ruptfx.results.cameras import Camera

if TYPE_CHECKING:
    import xarray

    from ruptfx.results.record import Record


class Polariscope(Camera):
    """A camera behind a circular or plane polariscope: fringes of the difference of principal stresses in plates.

    Light, not stress, is averaged over the exposure and over each pixel. The materials need a `fringe_constant`, the
    case `output.plate_thickness`, and fringes may change by half an order from one snapshot to the next.
    """

    example: ClassVar[str] = (
        '{ kind = "polariscope", name = "fringes", frame_rate = "1 MHz", exposure = "0.2 us", pixel = "0.2 mm" }'
    )
    source: ClassVar[str] = "Dally and Riley, Experimental Stress Analysis"

    field: Literal["dark", "light", "plane"] = "dark"
    """Dark or light field of a circular polariscope, or a plane polariscope with crossed filters."""
    polariser: Angle = 0.0
    """Angle of the polariser of a plane polariscope from x."""

    def check(self, key: str, plane: Plane) -> None:
        super().check(key, plane)
        if plane not in IN_PLANE:
            raise ValueError(f"{key}.kind = 'polariscope': fringes are of plates, and plane = '{plane}'; remove it")
        if self.polariser and self.field != "plane":
            raise ValueError(
                f"{key}.polariser = {self.polariser:g}: without effect with field = '{self.field}'; remove it"
            )

    def film(self, record: Record) -> xarray.DataArray:
        from ruptfx.results.analysis import polariscope  # SciPy: not for those who only read the case

        return polariscope.Camera(self.frame_rate, self.exposure, self.pixel, self.field, self.polariser).film(record)
