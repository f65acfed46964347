"""Pictures of a speckled surface, as image correlation needs them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from pydantic import Field

from ruptfx import RuptfxError
from ruptfx.input.schema import Unit
from ruptfx.laws.materials import IN_PLANE, Plane
from ruptfx.results.cameras import Camera

if TYPE_CHECKING:
    import xarray

    from ruptfx.results.record import Record

Greys = Annotated[float, Field(ge=0), Unit("1")]
Pixels = Annotated[float, Field(gt=0), Unit("1")]


class Speckles(Camera):
    """A camera before a speckled surface: the speckles move with the bodies, for `ruptfx dic`.

    Displacements are linear in time between snapshots; a frame shows their mean over the exposure.
    """

    example: ClassVar[str] = (
        '{ kind = "speckles", name = "surface", frame_rate = "1 MHz", exposure = "0.2 us", pixel = "0.1 mm" }'
    )

    speckle_size: Pixels = 4.0
    """Size of a speckle in pixels."""
    noise: Greys = 2.0
    """Standard deviation of the grey levels, of 255."""

    def check(self, key: str, plane: Plane) -> None:
        super().check(key, plane)
        if plane not in IN_PLANE:
            raise ValueError(f"{key}.kind = 'speckles': it shows motion in a plane, not plane = '{plane}'; remove it")

    def film(self, record: Record) -> xarray.DataArray:
        import xarray

        from ruptfx.results.analysis import (  # SciPy: not for those who only read the case
            image_correlation,
            polariscope,
        )

        bulk = record.bulk
        if bulk.sizes.get("component") != 2 or bulk.sizes["time"] < 2:
            raise RuptfxError(
                f"{record.path}: speckles need two snapshots or more of displacements in a plane; shorten "
                "output.bulk_interval"
            )
        times = bulk["time"].values
        starts = polariscope.frame_times(record, self.frame_rate, self.exposure)
        frames: list[np.ndarray] = []
        for number, start in enumerate(starts):
            moved = _mean(times, bulk, float(start), self.exposure)
            along_x, along_y, plate, (x, y) = image_correlation.pixel_displacements(record, moved, self.pixel)
            if not frames:
                first = image_correlation.speckle(plate.shape, self.speckle_size)
            seen = image_correlation.photographed(first, along_x, along_y, self.noise, number + 1)
            frames.append(np.where(plate, seen / image_correlation.GREYS, np.nan))
        return xarray.DataArray(
            np.stack(frames),
            {
                "time": ("time", starts, {"units": "s", "long_name": "beginning of the exposure"}),
                "y": ("y", y, {"units": "m"}), "x": ("x", x, {"units": "m"}),
            },
            name="light", attrs={"units": "1", "long_name": "grey level over 255", "exposure": self.exposure},
        )  # fmt: skip


def _mean(times: np.ndarray, bulk: xarray.Dataset, start: float, exposure: float) -> np.ndarray:
    """Return the mean displacement during an exposure, of a motion that is linear between snapshots [m]."""
    moments = np.unique(np.clip(np.concatenate([[start, start + exposure], times]), start, start + exposure))
    middles, lengths = 0.5 * (moments[1:] + moments[:-1]), np.diff(moments)
    total = 0.0
    for moment, length in zip(middles, lengths, strict=True):
        after = int(np.clip(np.searchsorted(times, moment), 1, len(times) - 1))
        part = (moment - times[after - 1]) / (times[after] - times[after - 1])
        one, other = (bulk["displacement"].isel(time=row).values for row in (after - 1, after))
        total = total + length / exposure * (one + part * (other - one))
    return np.asarray(total)
