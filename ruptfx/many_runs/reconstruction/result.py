"""Result of a reconstruction: slip rate, traction and friction with deviations; dataset, summary and verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx import Table
from ruptfx.input.quantities import with_prefix
from ruptfx.many_runs.reconstruction.experiment import Channel
from ruptfx.many_runs.reconstruction.geometry import Geometry
from ruptfx.many_runs.reconstruction.law_fit import LawFit

if TYPE_CHECKING:
    import xarray

Floats = NDArray[np.float64]
KNOWN = 0.5
"""Part of the prior variance that the data remove where a slip rate counts as known."""
CURVES = 4
"""Number of positions of curves by default."""
SLIPS, MAPS = 0.1, 6
"""Part of the peak slip rate from which a surface slips, and number of maps by default."""
TOO_LARGE = 4.0
"""Standard deviations of the misfit of noise above which a channel is not fitted."""


@dataclass(frozen=True)
class Curves:
    """Traction against slip of the mean and of samples.

    Attributes
    ----------
    slip, shear_traction, normal_stress : ndarray, shape (1 + samples, knots, n)
        Those of the mean slip rate first [m], [Pa], [Pa].
    """

    slip: Floats
    shear_traction: Floats
    normal_stress: Floats

    def deviation(self, values: Floats) -> Floats:
        """Return the standard deviation of samples from the mean, shape (knots, n)."""
        return np.sqrt(np.mean((values[1:] - values[0]) ** 2, axis=0))

    @property
    def friction(self) -> Floats:
        """Magnitude of the shear traction over the normal stress; not a number where that is no compression."""
        closed = np.where(self.normal_stress > 0, self.normal_stress, np.nan)
        return np.abs(self.shear_traction) / closed

    def breakdown(self, slip_rate: Floats, interval: float) -> Floats:
        """Return the work above the lowest traction of the mean until it is reached [J/m2], shape (1 + samples, n).

        Parameters
        ----------
        slip_rate : ndarray, shape (1 + samples, knots, n)
        interval : float
            [s]
        """
        towards = np.sign(self.slip[0, -1])
        traction, points = towards * self.shear_traction, np.arange(len(towards))
        peak = np.argmax(traction[0], axis=0)
        after = np.arange(len(traction[0]))[:, None] >= peak
        end = np.argmin(np.where(after, traction[0], np.inf), axis=0)
        inside = np.arange(len(traction[0]))[:, None] <= end
        above = traction - traction[:, end, points][:, None]
        return np.asarray(interval * np.sum(np.where(inside, above * towards * slip_rate, 0.0), axis=1))


@dataclass(frozen=True)
class Surface:
    """Components of the slip rate of a surface; other fields of a result are those in the direction of its points.

    Attributes
    ----------
    geometry : Geometry
    mean, deviation : ndarray, shape (2, knots, n)
        Along both tangents [m/s].
    map_times : sequence of float or None
        Times of maps that the case asks for [s].
    """

    geometry: Geometry
    mean: Floats
    deviation: Floats
    map_times: Sequence[float] | None = None

    def knots(self, times: Floats, speed: Floats) -> list[int]:
        """Return the knots of the maps: those next to the times of the case, or some while the surface slips.

        Parameters
        ----------
        times : ndarray, shape (knots,)
        speed : ndarray, shape (knots,)
            Largest slip rate of all points [m/s].
        """
        if self.map_times is not None:
            return sorted({int(np.argmin(np.abs(times - each))) for each in self.map_times})
        slips = np.flatnonzero(speed >= SLIPS * speed.max())
        return sorted({round(each) for each in np.linspace(slips[0], slips[-1], MAPS)})


@dataclass(frozen=True)
class Reconstruction:
    """Slip rate of an interface from data; on all ranks.

    Attributes
    ----------
    position : ndarray, shape (n,)
        [m]
    times : ndarray, shape (knots,)
        [s]
    mean, deviation, prior_deviation : ndarray, shape (knots, n)
        Slip rate and standard deviations after and before the data [m/s].
    slip_deviation : ndarray, shape (knots, n)
        [m]
    samples : ndarray, shape (samples, knots, n)
        [m/s]
    curves : Curves
    channels : list of Channel
    fits : list of ndarray
        Readings of the run with the mean slip rate, of every channel, with corrected clock, gain and offset.
    unknowns : dict of str to (float, float, str)
        Mean change of clocks, gains and offsets from the case, standard deviation and unit.
    prior : dict of str to float
        `amplitude` [m/s], `length` [m], `time` [s], of a surface also `dip_length` [m].
    chosen : ndarray of int or None
        Points of curves that the case asks for.
    about : Table
        Further entries of the summary.
    law : LawFit or None
        Friction law of the case with parameters that fit; None where nothing slides surely.
    surface : Surface or None
        None of a line.
    """

    position: Floats
    times: Floats
    mean: Floats
    deviation: Floats
    prior_deviation: Floats
    slip_deviation: Floats
    samples: Floats
    curves: Curves
    channels: Sequence[Channel]
    fits: Sequence[Floats]
    unknowns: dict[str, tuple[float, float, str]]
    prior: dict[str, float]
    chosen: NDArray[np.int64] | None = None
    about: Table = field(default_factory=dict)
    law: LawFit | None = None
    surface: Surface | None = None

    @cached_property
    def information(self) -> Floats:
        """Part of the prior variance that the data remove, shape (knots, n)."""
        return 1 - (self.deviation / self.prior_deviation) ** 2

    @cached_property
    def known(self) -> Floats:
        """The same for the mean variance over all times, shape (n,)."""
        return 1 - np.mean(self.deviation**2, axis=0) / np.mean(self.prior_deviation**2, axis=0)

    @property
    def interval(self) -> float:
        """Time between knots [s]."""
        return float(np.diff(self.times).mean()) if len(self.times) > 1 else float(self.times[0])

    @cached_property
    def places(self) -> list[int]:
        """Points of the curves, by position: those that were asked for, or those known best, apart from each other."""
        if self.chosen is not None:
            return [int(each) for each in self.chosen]

        def distance(point: int, other: int) -> float:
            if self.surface is not None:
                return self.surface.geometry.distance(point, other)
            return float(abs(self.position[point] - self.position[other]))

        apart = float(np.ptp(self.position)) / (2 * CURVES)
        if self.surface is not None:
            apart = self.surface.geometry.apart(2 * CURVES)
        candidates, result = list(np.argsort(-self.known, kind="stable")), list[int]()
        for each in candidates:
            if len(result) < CURVES and all(distance(each, one) >= apart for one in result):
                result.append(int(each))
        return sorted(result, key=lambda each: float(self.position[each]))

    @cached_property
    def known_range(self) -> tuple[float, float] | None:
        """Ends of the part of a line around its best known point where the slip rate is known [m]."""
        order = np.argsort(self.position)
        known = self.known[order] >= KNOWN
        best = int(np.argmax(self.known[order]))
        if not known[best]:
            return None
        unknown = np.flatnonzero(~known)
        first = int(max(unknown[unknown < best], default=-1)) + 1
        last = int(min(unknown[unknown > best], default=len(order))) - 1
        along = self.position[order]
        return float(along[first]), float(along[last])

    @cached_property
    def known_part(self) -> float:
        """Part of the points, of a surface of its area, where the slip rate is known."""
        weights = None if self.surface is None else self.surface.geometry.area
        return float(np.average(self.known >= KNOWN, weights=weights))

    @property
    def extent(self) -> str | None:
        """Part of the interface where the slip rate is known, as text; None if there is none."""
        if self.surface is not None:
            return f"on {100 * self.known_part:.0f} % of the surface" if self.known_part else None
        if self.known_range is None:
            return None
        first, last = (with_prefix(each, "m") for each in self.known_range)
        return f"from {first} to {last}"

    def place(self, point: int) -> str:
        """Return the position of a point as text."""
        if self.surface is None:
            return with_prefix(float(self.position[point]), "m")
        return "(" + ", ".join(with_prefix(float(each), "m") for each in self.surface.geometry.points[point]) + ")"

    @cached_property
    def misfits(self) -> Floats:
        """Mean square of the residuals of every channel over those of noise."""
        pairs = zip(self.channels, self.fits, strict=True)
        return np.array([np.mean(((channel.values - fit) / channel.sigma) ** 2) for channel, fit in pairs])

    def notes(self) -> list[str]:
        """Return a sentence for each channel with missing samples, and for each that is not fitted.

        The latter has the time shift that would fit it better.
        """
        texts = [
            f"{each.name}: {each.missing} of {each.missing + len(each.times)} samples are missing"
            for each in self.channels if each.missing
        ]  # fmt: skip
        for channel, fit, misfit in zip(self.channels, self.fits, self.misfits, strict=True):
            count = len(channel.values)
            if misfit <= 1 + TOO_LARGE * np.sqrt(2 / count):
                continue
            text = (
                f"{channel.name}: the fit is {misfit:.3g} times noise; check sign, sigma, gain and place of the sensor"
            )
            if count > 2:
                slopes = np.gradient(fit, channel.times) / channel.sigma
                size = max(float(slopes @ slopes), 1e-300)
                shift = float(slopes @ ((channel.values - fit) / channel.sigma)) / size
                if abs(shift) > TOO_LARGE * np.sqrt(misfit / size):
                    text += f", and its clock: time_shift {-shift:+.3g} s would fit better"
            texts.append(text)
        return texts

    @cached_property
    def peak(self) -> tuple[float, float]:
        """Largest mean slip rate by magnitude where it is known, else of all, and its standard deviation [m/s]."""
        inside = np.broadcast_to(self.known >= KNOWN, self.mean.shape)
        sizes = np.where(inside, np.abs(self.mean), 0.0) if inside.any() else np.abs(self.mean)
        at = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        return float(abs(self.mean[at])), float(self.deviation[at])

    def summary(self) -> Table:
        """Return numbers with their standard deviations; SI units."""
        curves, best = self.curves, int(np.argmax(self.known))
        rates = np.concatenate([self.mean[None], self.samples])
        breakdown = curves.breakdown(rates, self.interval)[:, best]
        inside = self.known >= KNOWN
        peak, deviation = self.peak
        rms = np.sqrt(np.mean(self.deviation**2, axis=0))
        ends = None if self.surface is not None else self.known_range
        numbers: Table = {
            "peak_slip_rate": peak, "peak_slip_rate_deviation": deviation,
            "known_from": None if ends is None else ends[0], "known_to": None if ends is None else ends[1],
            "known_part": self.known_part,
            "relative_deviation": float(np.median(rms[inside if inside.any() else slice(None)])) / max(peak, 1e-300),
            "best_position": float(self.position[best]) if self.surface is None
            else self.surface.geometry.points[best].tolist(),
            "final_slip": float(curves.slip[0, -1, best]), "final_slip_deviation": float(self.slip_deviation[-1, best]),
            "breakdown_work": float(breakdown[0]),
            "breakdown_work_deviation": float(np.sqrt(np.mean((breakdown[1:] - breakdown[0]) ** 2))),
            "resolved_slip": 2 * self.interval * peak,
            "misfit": float(np.average(self.misfits, weights=[len(each.values) for each in self.channels])),
            "misfits": {each.name: float(size) for each, size in zip(self.channels, self.misfits, strict=True)},
            "data": int(sum(len(each.values) for each in self.channels)), "channels": len(self.channels),
            "points": len(self.position), "times": len(self.times), "prior": self.prior,
            "unknowns": {
                key: {"change": change, "deviation": deviation, "unit": unit}
                for key, (change, deviation, unit) in self.unknowns.items()
            },
            "law": None if self.law is None else self.law.table(), "notes": self.notes(),
        }  # fmt: skip
        return {"verdict": self.verdict(numbers), **numbers, **self.about}

    def verdict(self, numbers: Table) -> str:
        """Return the result in one sentence with numbers."""
        if self.extent is None:
            return (
                "The data leave more than half of the prior variance of the slip rate everywhere "
                f"({100 * (1 - float(self.known.max())):.0f} % at best); they are fitted to {numbers['misfit']:.3g} "
                "times noise."
            )
        place, slip = self.place(int(np.argmax(self.known))), with_prefix(numbers["final_slip"], "m")
        work, spread = numbers["breakdown_work"], numbers["breakdown_work_deviation"]
        peak = f"{numbers['peak_slip_rate']:.3g} +- {numbers['peak_slip_rate_deviation']:.2g} m/s"
        unsure = "" if work > 2 * spread else " (not resolved)"
        return (
            f"Slip rate known to {100 * numbers['relative_deviation']:.2g} % of its peak, "
            f"{peak}, {self.extent}; "
            f"at {place} slip {slip} +- {with_prefix(numbers['final_slip_deviation'], 'm', 2)} and breakdown work "
            f"{work:.3g} +- {spread:.2g} J/m2{unsure}; weakening within less than "
            f"{with_prefix(numbers['resolved_slip'], 'm', 2)} of slip is not resolved; the data are fitted to "
            f"{numbers['misfit']:.3g} times noise" + ("." if self.law is None else f"; {self.law.sentence()}.")
        )

    def dataset(self) -> xarray.Dataset:
        """Return all fields with positions, times and units."""
        import xarray

        curves, axis = self.curves, "position" if self.surface is None else "point"
        grid = ("time", axis)
        fields = {
            "slip_rate": (self.mean, "m/s", "slip rate, mean"),
            "slip_rate_deviation": (self.deviation, "m/s", "slip rate, standard deviation"),
            "prior_deviation": (self.prior_deviation, "m/s", "slip rate, standard deviation before the data"),
            "information": (self.information, "1", "part of the prior variance of the slip rate that the data remove"),
            "slip": (curves.slip[0], "m", "slip, mean"),
            "slip_deviation": (self.slip_deviation, "m", "slip, standard deviation"),
            "shear_traction": (curves.shear_traction[0], "Pa", "shear traction, mean"),
            "shear_traction_deviation": (curves.deviation(curves.shear_traction), "Pa",
                                         "shear traction, standard deviation of the samples"),
            "normal_stress": (curves.normal_stress[0], "Pa", "normal stress, mean, compression positive"),
            "friction": (curves.friction[0], "1", "shear traction over normal stress, of the means"),
            "friction_deviation": (curves.deviation(curves.friction), "1",
                                   "shear traction over normal stress, standard deviation of the samples"),
        }  # fmt: skip
        if self.surface is not None:
            for k in (0, 1):
                text = f"slip rate along tangent {k + 1}"
                fields[f"slip_rate_{k + 1}"] = (self.surface.mean[k], "m/s", f"{text}, mean")
                fields[f"slip_rate_{k + 1}_deviation"] = (
                    self.surface.deviation[k], "m/s", f"{text}, standard deviation"
                )  # fmt: skip
        data: dict[str, object] = {
            name: (grid, values, {"units": unit, "long_name": text}) for name, (values, unit, text) in fields.items()
        }
        for name, values, unit in (
            ("slip_rate", self.samples, "m/s"), ("slip", curves.slip[1:], "m"),
            ("shear_traction", curves.shear_traction[1:], "Pa"), ("normal_stress", curves.normal_stress[1:], "Pa"),
        ):  # fmt: skip
            data[f"{name}_samples"] = (("sample", *grid), values, {"units": unit, "long_name": f"{name}, samples"})
        for number, (channel, fit) in enumerate(zip(self.channels, self.fits, strict=True)):
            dim = f"time_{number}"
            data[dim] = (dim, channel.times, {"units": "s", "long_name": f"{channel.name}, time of the run"})
            for name, values in (("data", channel.values), ("fit", fit), ("sigma", channel.sigma)):
                about = {"units": channel.unit, "long_name": f"{channel.name}, {name}"}
                data[f"channel_{number}.{name}"] = (dim, values, about)
        if self.law is not None:
            fitted = np.full(self.mean.shape, np.nan)
            fitted[:, self.law.points] = self.law.friction
            data["friction_of_law"] = (grid, fitted, {"units": "1", "long_name": f"strength of {self.law.kind} over "
                                                      "normal stress while it slides"})  # fmt: skip
        coordinates = {
            "time": ("time", self.times, {"units": "s"}),
            "position": (axis, self.position, {"units": "m"}),
        }
        if self.surface is not None:
            geometry = self.surface.geometry
            columns = zip(("x", "y", "z", "dip"), [*geometry.points.T, geometry.dip], strict=True)
            coordinates |= {name: (axis, values, {"units": "m"}) for name, values in columns}
        return xarray.Dataset(data, coordinates, {"positivity": str(self.about.get("positivity", ""))})
