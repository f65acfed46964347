"""Experiments on the slider: velocity steps, slide-hold-slide, modulated speed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
import xarray
from pydantic import Field, field_validator

from ruptfx import Table
from ruptfx.input.schema import CaseError, Part, Unit
from ruptfx.input.units import Duration, Length, Speed
from ruptfx.laws.friction.rate_and_state_base import RateAndState
from ruptfx.laws.friction.rate_and_state_thermal import RateAndStateThermal
from ruptfx.lumped import Progress, silent, variable
from ruptfx.lumped.spring_slider.slider import Slider, Trajectory, integrate

Samples = Annotated[int, Field(ge=20, le=1_000_000)]


class Experiment(Part):
    """Contract of an experiment on a slider."""

    name: ClassVar[str]

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        """Return the result of the experiment."""
        raise NotImplementedError

    def run_with(self, law: RateAndState, slider: Slider, progress: Progress) -> xarray.Dataset:
        """Return the result of the experiment; `law` is that of the slider before it was given one temperature."""
        return self.run(slider, progress)

    def resulting(self, slider: Slider, dataset: xarray.Dataset) -> Slider:
        """Return the slider that the result describes, of which K_c and other constants are reported."""
        return slider


def follow(
    slider: Slider, segments: Iterable[tuple[float, float]], samples: int, start: np.ndarray | None = None
) -> list[Trajectory]:
    """Return the motion through segments (duration [s], drive speed [m/s]), from steady sliding at the first speed.

    Times are cumulative; each segment has `samples` times, denser after its start where the friction changes fast.
    """
    motions: list[Trajectory] = []
    time = 0.0
    for duration, speed in segments:
        y = motions[-1].end if motions else slider.steady(speed) if start is None else start
        times = time + duration * np.linspace(0, 1, samples) ** 1.5
        motions.append(integrate(slider, y, times, speed))
        time += duration
    return motions


def traces(motions: list[Trajectory], speeds: Iterable[float]) -> Table:
    """Return variables of a dataset along `time`."""
    time = np.concatenate([m.time for m in motions])
    drive = np.concatenate([np.full(len(m.time), speed) for m, speed in zip(motions, speeds, strict=True)])
    travel = np.concatenate([[0.0], np.cumsum(drive[1:] * np.diff(time))])
    theta = np.exp(np.concatenate([m.y[1] for m in motions]))
    return {
        "time": variable("sample", time, "s", "time"),
        "drive_speed": variable("sample", drive, "m/s", "speed of the drive"),
        "drive_displacement": variable("sample", travel, "m", "displacement of the drive"),
        "friction": variable("sample", np.concatenate([m.friction for m in motions]), "1", "friction coefficient"),
        "slip_rate": variable("sample", np.concatenate([m.slip_rate for m in motions]), "m/s", "slip rate"),
        "theta": variable("sample", theta, "s", "age of the contacts"),
    }


class VelocitySteps(Experiment):
    """The drive jumps from one speed to the next."""

    name = "velocity_steps"
    kind: Literal["velocity_steps"] = "velocity_steps"
    speeds: Annotated[list[Speed], Field(min_length=2)] = [1e-6, 1e-5, 1e-6]
    """Drive speeds in order."""
    distance: Length = 20e-6
    """Drive displacement at each speed [m]."""
    samples: Samples = 1500
    """Samples of each speed."""

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        progress(0.1, f"{len(self.speeds)} speeds")
        motions = follow(slider, [(self.distance / speed, speed) for speed in self.speeds], self.samples)
        ends = np.array([m.friction[-1] for m in motions])
        logs = np.diff(np.log(self.speeds))
        # The direct effect is the first extreme, a maximum after an increase of speed.
        peaks = [m.friction.max() if up > 0 else m.friction.min() for m, up in zip(motions[1:], logs, strict=True)]
        return xarray.Dataset(
            {
                **traces(motions, self.speeds),
                "step_direct": variable("step", (peaks - ends[:-1]) / logs, "1", "peak change per e-fold of speed"),
                "step_steady": variable("step", np.diff(ends) / logs, "1", "steady change per e-fold of speed"),
                "step_speed": variable("step", np.array(self.speeds[1:]), "m/s", "speed after the step"),
            },
            attrs={"experiment": self.name},
        )


class SlideHoldSlide(Experiment):
    """The drive stops for a time and starts again; the peak on restarting is the static friction."""

    name = "slide_hold_slide"
    kind: Literal["slide_hold_slide"] = "slide_hold_slide"
    speed: Speed = 1e-6
    """Speed of the drive before and after a hold."""
    holds: Annotated[list[Duration], Field(min_length=2)] = [1.0, 10.0, 100.0, 1000.0, 10000.0]
    """Durations of the holds, one run each."""
    distance: Length = 10e-6
    """Drive displacement after each hold [m]."""
    samples: Samples = 4000
    """Samples of each run."""

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        runs, peaks, lows = [], [], []
        for number, hold in enumerate(self.holds):
            progress(number / len(self.holds), f"hold of {hold:g} s")
            sliding = self.distance / self.speed
            # Steady sliding, hold, reload; a drive at rest is a very slow one.
            motions = follow(slider, [(0.1 * sliding, self.speed), (hold, 0.0), (sliding, self.speed)], self.samples)
            runs.append(traces(motions, [self.speed, 0.0, self.speed]))
            peaks.append(motions[2].friction.max())
            lows.append(motions[1].friction[-1])
        steady = float(np.asarray(slider.law.steady_strength(self.speed, slider.normal_force))) / slider.normal_force
        slope = np.diff(peaks) / np.diff(np.log(self.holds))
        together = {
            name: variable(("hold", "sample"), np.array([run[name][1] for run in runs]), *runs[0][name][2].values())
            for name in runs[0]
        }
        return xarray.Dataset(
            {
                **together,
                "static_friction": variable("hold", np.array(peaks), "1", "static friction coefficient"),
                "relaxed_friction": variable("hold", np.array(lows), "1", "friction at the end of the hold"),
                "steady_friction": variable((), steady, "1", "steady friction coefficient"),
                "healing_slope": variable((), slope[-1], "1", "static friction per e-fold of hold, longest holds"),
            },
            coords={"hold": variable("hold", np.array(self.holds), "s", "duration of the hold")},
            attrs={"experiment": self.name},
        )


class Temperatures(SlideHoldSlide):
    """Slide-hold-slide at several temperatures: static friction over contact time, and its master curve."""

    name = "temperatures"
    kind: Literal["temperatures"] = "temperatures"  # type: ignore[assignment]
    temperatures: Annotated[list[Annotated[float, Field(gt=0), Unit("K")]], Field(min_length=2)] = [
        293.0, 313.0, 333.0, 353.0,
    ]  # fmt: skip
    """Temperatures, increasing."""

    @field_validator("temperatures")
    @classmethod
    def _increasing(cls, temperatures: list[float]) -> list[float]:
        if np.any(np.diff(temperatures) <= 0):
            raise ValueError("temperatures must increase")
        return temperatures

    def run_with(self, law: RateAndState, slider: Slider, progress: Progress) -> xarray.Dataset:
        if not isinstance(law, RateAndStateThermal):
            raise CaseError(
                f"experiment.kind = 'temperatures': friction.kind = '{law.kind()}' does not depend on temperature; use "
                "friction.kind = 'rate_and_state_thermal'"
            )
        runs = []
        for number, temperature in enumerate(self.temperatures):
            progress(number / len(self.temperatures), f"{temperature:g} K")
            one = law.substituted({"temperature_initial": temperature}).isothermal()
            runs.append(self.run(replace(slider, law=one), silent))
        shift = np.array([float(np.asarray(law.shift(temperature))) for temperature in self.temperatures])
        static = np.array([each.static_friction.values for each in runs])
        slope = np.array([np.polyfit(np.log(self.holds), row, 1)[0] for row in static])
        at, both = "temperature", ("temperature", "hold")
        return xarray.Dataset(
            {
                "static_friction": variable(both, static, "1", "static friction coefficient"),
                "reduced_time": variable(both, np.array(self.holds) / shift[:, None], "s", "contact time over shift"),
                "shift_factor": variable(at, shift, "1", "shift factor of time"),
                "ageing_slope": variable(at, slope, "1", "static friction per e-fold of contact time"),
            },
            coords={
                "temperature": variable(at, np.array(self.temperatures), "K", "temperature"),
                "hold": variable("hold", np.array(self.holds), "s", "duration of the hold"),
            },
            attrs={"experiment": self.name},
        )


class ModulatedSpeed(Experiment):
    """Slow oscillation of the drive speed, V = speed ratio^sin(2 pi t / period); friction forms a loop."""

    name = "modulated_speed"
    kind: Literal["modulated_speed"] = "modulated_speed"
    speed: Speed = 1e-6
    """Mean drive speed, on a logarithmic scale."""
    ratio: Annotated[float, Field(gt=1, le=1000)] = 10.0
    """Largest over mean speed."""
    periods: Annotated[list[Duration], Field(min_length=1)] = [3.0, 30.0, 300.0]
    """Periods of the oscillation, one run each."""
    cycles: Annotated[int, Field(ge=2, le=50)] = 3
    """Number of cycles; the last one is recorded."""
    samples: Samples = 600
    """Samples of the recorded cycle."""

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        phase = np.linspace(0, 1, self.samples)
        drive = self.speed * self.ratio ** np.sin(2 * np.pi * phase)
        loops, areas = [], []
        for number, period in enumerate(self.periods):
            progress(number / len(self.periods), f"period of {period:g} s")

            def speed(time: float, period: float = period) -> float:
                return self.speed * self.ratio ** np.sin(2 * np.pi * time / period)

            before = integrate(slider, slider.steady(self.speed), np.array([0, (self.cycles - 1) * period]), speed)
            last = integrate(slider, before.end, period * (self.cycles - 1 + phase), speed)
            loops.append(last.friction)
            # Oriented area of the loop in the plane of ln V and friction.
            areas.append(np.trapezoid(last.friction, np.log(drive)))
        steady = slider.law.steady_strength(drive, slider.normal_force) / slider.normal_force
        return xarray.Dataset(
            {
                "friction": variable(("period", "phase"), np.array(loops), "1", "friction coefficient"),
                "drive_speed": variable("phase", drive, "m/s", "speed of the drive"),
                "steady_friction": variable("phase", steady, "1", "steady friction coefficient"),
                "loop_area": variable("period", np.array(areas), "1", "area of the loop in ln V and friction"),
            },
            coords={
                "period": variable("period", np.array(self.periods), "s", "period of the modulation"),
                "phase": variable("phase", phase, "1", "fraction of the cycle"),
            },
            attrs={"experiment": self.name},
        )
