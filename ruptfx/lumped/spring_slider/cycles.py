"""Stick-slip: how often and how far the slider slips, over drive speed, normal force and stiffness."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product
from typing import Annotated, Literal

import numpy as np
import xarray
from pydantic import Field
from scipy.signal import find_peaks

from ruptfx.input.schema import Unit
from ruptfx.input.units import Positive, Speed
from ruptfx.lumped import Progress, variable
from ruptfx.lumped.spring_slider.protocols import Experiment, Samples
from ruptfx.lumped.spring_slider.slider import Slider, critical_stiffness, integrate

_DISCARDED = 3  # first cycles, which depend on the start
_LONGEST = 12  # stretches of a run without enough cycles, after which sliding counts as steady


class StickSlip(Experiment):
    """Period and force drop of stick-slip, for every combination of drive speed, normal force and stiffness."""

    name = "stick_slip"
    kind: Literal["stick_slip"] = "stick_slip"
    speeds: Annotated[list[Speed], Field(min_length=1)] = [1e-7, 3e-7, 1e-6, 3e-6, 1e-5]
    """Drive speeds."""
    normal_forces: list[Annotated[Positive, Unit("N")]] = []
    """Normal forces; without any, that of the slider."""
    stiffnesses: list[Annotated[Positive, Unit("N/m")]] = []
    """Stiffnesses of the spring; without any, that of the slider."""
    cycles: Annotated[int, Field(ge=2, le=200)] = 5
    """Cycles over which period and drop are averaged, after three that are left out."""
    samples: Samples = 4000
    """Samples of a stretch of the motion, in which some ten cycles can be expected."""

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        slider.need_mass()
        forces = self.normal_forces or [slider.normal_force]
        stiffnesses = self.stiffnesses or [float(slider.stiffness)]
        shape = (len(forces), len(stiffnesses), len(self.speeds))
        rows = []
        for number, (force, stiffness, speed) in enumerate(product(forces, stiffnesses, self.speeds)):
            progress(number / np.prod(shape), f"{force:g} N, {stiffness:g} N/m, {speed:g} m/s")
            mass = slider.mass * force / slider.normal_force
            one = replace(slider, normal_force=force, stiffness=stiffness, mass=mass)
            rows.append((*self._cycles(one, speed), stiffness / (critical_stiffness(one, speed)[0] or np.nan)))
        period, scatter, drop, peak, ratio = np.array(rows).T.reshape(5, *shape)
        axes = ("normal_force", "stiffness", "speed")
        slope = [[_slope(self.speeds, row) for row in rows] for rows in period]
        return xarray.Dataset(
            {
                "period": variable(axes, period, "s", "time from slip to slip; not a number in steady sliding"),
                "period_scatter": variable(axes, scatter, "1", "standard deviation of the period over its mean"),
                "force_drop": variable(axes, drop, "N", "drop of the friction force in a slip"),
                "peak_friction": variable(axes, peak, "1", "friction coefficient before a slip"),
                "K_over_critical": variable(axes, ratio, "1", "stiffness over the critical one"),
                "period_exponent": variable(axes[:2], np.array(slope), "1", "slope of ln period over ln speed"),
            },
            coords={
                "normal_force": variable("normal_force", np.array(forces), "N", "normal force"),
                "stiffness": variable("stiffness", np.array(stiffnesses), "N/m", "stiffness of the spring"),
                "speed": variable("speed", np.array(self.speeds), "m/s", "drive speed"),
            },
            attrs={"experiment": self.name},
        )

    def _cycles(self, slider: Slider, speed: float) -> tuple[float, float, float, float]:
        """Return mean and scatter of the period [s], drop [N], peak coefficient; not numbers if sliding is steady."""
        steady = float(np.asarray(slider.law.steady_strength(speed, slider.normal_force)))
        y = slider.steady(speed)
        y[1] += 0.05  # steady sliding is an equilibrium, if an unstable one
        stretch = 2.5 * steady / (slider.stiffness * speed)  # the force falls by less than a quarter of it in a slip
        time, friction = [np.zeros(0)], [np.zeros(0)]
        for number in range(_LONGEST):
            times = stretch * (number + np.linspace(0, 1, self.samples))
            motion = integrate(slider, y, times, speed)
            y = motion.end
            time.append(times[1:])
            friction.append(motion.friction[1:])
            t, f = np.concatenate(time), np.concatenate(friction)
            peaks, _ = find_peaks(f, prominence=max(0.3 * np.ptp(f), 1e-4))
            if len(peaks) > _DISCARDED + self.cycles:
                break
        else:
            return (np.nan,) * 4
        peaks = peaks[_DISCARDED : _DISCARDED + self.cycles + 1]
        periods = np.diff(t[peaks])
        lows = [f[a:b].min() for a, b in pairwise(peaks)]
        drop = float(np.mean(f[peaks[:-1]] - lows)) * slider.normal_force
        return float(periods.mean()), float(periods.std() / periods.mean()), drop, float(f[peaks].mean())


def _slope(speeds: list[float], periods: np.ndarray) -> float:
    """Return the exponent of period over speed, not a number with fewer than two periods."""
    known = np.isfinite(periods)
    if known.sum() < 2:
        return np.nan
    return float(np.polyfit(np.log(np.array(speeds)[known]), np.log(periods[known]), 1)[0])
