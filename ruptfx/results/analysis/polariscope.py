"""Frames of a camera behind a polariscope: with its frame rate, exposure and pixels.

Frames are computed from the snapshots of the bodies, with stresses interpolated linearly in time: snapshots have to
be so close that the fringe order changes by less than half a fringe from one to the next. Light, not stress, is
averaged over the exposure and over each pixel: fringes that are finer or faster than the camera fade to grey, as they
do in the laboratory.

A circular polariscope shows isochromatics, lines of equal sigma_1 - sigma_2. In a plane polariscope with crossed
polariser and analyser isoclinics are dark, too, where a principal direction is that of the polariser.
Source: J. W. Dally and W. F. Riley, Experimental Stress Analysis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.quantities import at_most
from ruptfx.results.analysis.photoelasticity import (
    fringe_order,
    intensity,
    plane_intensity,
    principal_difference,
    principal_direction,
)
from ruptfx.results.analysis.raster import Raster

if TYPE_CHECKING:
    import xarray

    from ruptfx.results.record import Files, Record

Array = np.ndarray
MOST_CHANGE = 0.5  # fringes: largest change between snapshots
FINER = 3  # sample points across a pixel, along x and y


class Pixels:
    """Square pixels on the plates of a run.

    Parameters
    ----------
    size : float
        Of a pixel [m].

    Attributes
    ----------
    raster : Raster
        Interpolation from nodes to sample points, `FINER` per pixel and direction.
    coordinates : dict
        `y` and `x` of the middles of pixels [m], as xarray takes them.
    """

    def __init__(self, record: Record, size: float) -> None:
        points = record.bulk["points"].values
        count = np.maximum(np.round(np.ptp(points, axis=0) / size), 1).astype(int)
        self.raster = Raster(points, record.bulk["cells"].values, pixels=FINER * int(count.max()))
        self._shape = tuple(length // FINER for length in self.raster.shape)
        left, right, bottom, top = self.raster.extent
        rows, columns = ((np.arange(n) + 0.5) / n for n in self._shape)
        self.coordinates = {
            "y": ("y", bottom + rows * (top - bottom), {"units": "m"}),
            "x": ("x", left + columns * (right - left), {"units": "m"}),
        }

    def mean(self, image: Array) -> Array:
        """Return the mean of the sample points in every pixel, shape (rows, columns)."""
        rows, columns = self._shape
        cut = image[: FINER * rows, : FINER * columns].reshape(rows, FINER, columns, FINER)
        return cut.mean(axis=(1, 3))


def fringe_orders(
    record: Record, pixel: float, fringe_constant: float | None = None, thickness: float | None = None
) -> xarray.DataArray:
    """Return the fringe order of every snapshot against `time`, `y` and `x`; NaN outside of the bodies.

    Parameters
    ----------
    pixel : float
        Size of a pixel [m].
    fringe_constant, thickness : float, optional
        Of all bodies [N/m], and of the plates [m], instead of those of the case.

    Raises
    ------
    RuptfxError
        No stresses in a plate, or unknown constants.
    """
    per_stress = _fringes_per_stress(record, fringe_constant, thickness)
    attrs = {"units": "1", "long_name": "fringe order"}
    return _of_difference(record, pixel, per_stress).rename("fringe_order").assign_attrs(attrs)


def max_shear(record: Record, pixel: float) -> xarray.DataArray:
    """Return the largest in-plane shear stress, (sigma_1 - sigma_2) / 2 [Pa], of every snapshot.

    Dimensions `time`, `y`, `x`; NaN outside of the bodies. Its contours are the isochromatics, half a fringe constant
    over the thickness apart.

    Parameters
    ----------
    pixel : float
        Size of a pixel [m].

    Raises
    ------
    RuptfxError
        No stresses in a plate.
    """
    attrs = {"units": "Pa", "long_name": "largest shear stress in the plane"}
    return _of_difference(record, pixel, 0.5).rename("max_shear").assign_attrs(attrs)


def _of_difference(record: Record, pixel: float, factor: Array | float) -> xarray.DataArray:
    """Return sigma_1 - sigma_2 [Pa] times a factor at every point, on pixels."""
    import xarray

    if not is_plate(record):
        raise RuptfxError(f"{record.path}: a polariscope needs stresses in a plate")
    bulk, pixels = record.bulk, Pixels(record, pixel)
    images = [
        pixels.mean(pixels.raster(principal_difference(*bulk["stress"].isel(time=row).values.T) * factor))
        for row in range(bulk.sizes["time"])
    ]
    time = ("time", bulk["time"].values, {"units": "s"})
    return xarray.DataArray(np.stack(images), {"time": time, **pixels.coordinates}, ("time", "y", "x"))


def is_plate(record: Files) -> bool:
    """Return whether the bodies are plates that light can pass: plane and not axisymmetric."""
    return record.bulk.sizes.get("component") == 2 and record.case.get("plane") != "axisymmetric"


@dataclass(frozen=True)
class Camera:
    """A camera behind a polariscope.

    Attributes
    ----------
    frame_rate : float
        [1/s].
    exposure : float
        [s]; a frame begins with it.
    pixel : float
        Size of a pixel on the plates [m].
    field : str
        "dark" or "light" of a circular polariscope, or "plane".
    polariser : float
        Angle of the polariser of a plane polariscope from x [rad]; the analyser is crossed.
    """

    frame_rate: float
    exposure: float
    pixel: float
    field: Literal["dark", "light", "plane"] = "dark"
    polariser: float = 0.0

    def __post_init__(self) -> None:
        for name in ("frame_rate", "exposure", "pixel"):
            if not getattr(self, name) > 0:
                raise RuptfxError(f"camera: {name} = {getattr(self, name)}: must be above zero")
        if self.exposure * self.frame_rate > 1:
            raise RuptfxError(
                f"camera: exposure = {self.exposure:g} s: longer than the {at_most(1 / self.frame_rate)} s from frame "
                "to frame; make it shorter"
            )

    def light(self, stress: Array, per_stress: Array) -> Array:
        """Return the transmitted light from 0 to 1.

        Parameters
        ----------
        stress : ndarray, shape (3, ...)
            xx, yy and xy [Pa].
        per_stress : ndarray
            Fringes per stress, thickness over fringe constant [1/Pa].
        """
        order = fringe_order(principal_difference(*stress), 1.0, 1.0) * per_stress
        if self.field == "plane":
            return plane_intensity(order, principal_direction(*stress), self.polariser)
        return intensity(order, self.field)

    def film(
        self, record: Record, fringe_constant: float | None = None, thickness: float | None = None
    ) -> xarray.DataArray:
        """Return frames of a run against `time` (start of the exposure), `y` and `x`; NaN outside of the bodies.

        Parameters
        ----------
        fringe_constant, thickness : float, optional
            Of all bodies [N/m], and of the plates [m], instead of those of the case.

        Raises
        ------
        RuptfxError
            No stresses in a plate, unknown constants, a run shorter than an exposure, or snapshots too far apart.
        """
        import xarray

        bulk = record.bulk
        if not is_plate(record) or bulk.sizes["time"] < 2:
            raise RuptfxError(f"{record.path}: a polariscope needs two snapshots or more of stresses in a plate")
        per_stress = _fringes_per_stress(record, fringe_constant, thickness)
        pixels = Pixels(record, self.pixel)
        constant = pixels.raster(per_stress)

        def seen(stress: Array) -> Array:
            return pixels.mean(self.light(np.stack([pixels.raster(part) for part in stress.T]), constant))

        starts = frame_times(record, self.frame_rate, self.exposure)
        frames = [
            np.mean([seen(stress) for stress in self._during(record, float(begin), per_stress)], axis=0)
            for begin in starts
        ]
        return xarray.DataArray(
            np.stack(frames),
            {"time": ("time", starts, {"units": "s", "long_name": "beginning of the exposure"}), **pixels.coordinates},
            name="light",
            attrs={
                "units": "1", "long_name": f"transmitted light, {self.field} field", "exposure": self.exposure,
                "initial_stress": str(bulk.attrs.get("initial_stress", "")),
            },
        )  # fmt: skip

    def _during(self, record: Record, begin: float, per_stress: Array) -> Iterator[Array]:
        """Yield the stresses [Pa] at the middles of the parts of an exposure, each shorter than a snapshot interval."""
        bulk = record.bulk
        times = bulk["time"].values
        parts = max(3, int(np.ceil(3 * self.exposure / np.diff(times).min())))
        for moment in begin + self.exposure * (np.arange(parts) + 0.5) / parts:
            after = int(np.clip(np.searchsorted(times, moment), 1, len(times) - 1))
            one, other = (bulk["stress"].isel(time=row).values for row in (after - 1, after))
            change = np.nanquantile(np.abs(principal_difference(*(other - one).T)) * per_stress, 0.99)
            if change > MOST_CHANGE:
                raise RuptfxError(
                    f"{record.path}: from {times[after - 1]:.4g} to {times[after]:.4g} s fringes change by "
                    f"{change:.2g} orders, and between snapshots no more than {MOST_CHANGE} is followed; reduce "
                    "output.bulk_interval"
                )
            part = (moment - times[after - 1]) / (times[after] - times[after - 1])
            yield one + part * (other - one)


def frame_times(record: Record, frame_rate: float, exposure: float) -> Array:
    """Return the beginnings of the exposures that lie between the first and the last snapshot of a run [s].

    Parameters
    ----------
    frame_rate : float
        Frames per second [Hz].
    exposure : float
        Duration of an exposure [s].

    Raises
    ------
    RuptfxError
        The snapshots last less than an exposure.
    """
    times = record.bulk["time"].values
    starts = np.arange(times[0], times[-1] - exposure * (1 - 1e-9), 1 / frame_rate)
    if not len(starts):
        raise RuptfxError(
            f"{record.path}: its snapshots last {np.ptp(times):.3g} s, less than an exposure of {exposure:g} s; "
            "shorten it"
        )
    return starts


def _fringes_per_stress(record: Record, fringe_constant: float | None, thickness: float | None) -> Array:
    """Return fringes per stress at every point [1/Pa]; NaN where the constant is unknown."""
    case, value = record.case, record.case.get("materials", {})
    names = [str(name) for name in np.atleast_1d(record.bulk.attrs.get("bodies", ["bodies"]))]
    constants = np.array([
        fringe_constant or value.get(name, value.get("default", {})).get("fringe_constant", np.nan) for name in names
    ], dtype=float)  # fmt: skip
    plate = thickness or case.get("output", {}).get("plate_thickness")
    if plate is None:
        raise RuptfxError(
            f"{record.path}: the case has no output.plate_thickness; run it with --set output.plate_thickness='9 mm', "
            "or in Python give thickness"
        )
    if not np.isfinite(constants).any():
        raise RuptfxError(
            f"{record.path}: no material has a fringe_constant; run the case with --set "
            "materials.default.fringe_constant='22 kN/m', or in Python give fringe_constant"
        )
    return plate / constants[record.bulk["body"].values]
