"""Stability of the slider: stability diagram, bifurcation, and the effect of a modulated normal load."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
import xarray
from pydantic import Field
from scipy.optimize import brentq, fsolve

from ruptfx import RuptfxError
from ruptfx.input.schema import Unit
from ruptfx.input.units import Positive, Speed
from ruptfx.lumped import Progress, variable
from ruptfx.lumped.spring_slider.protocols import Experiment, Samples
from ruptfx.lumped.spring_slider.slider import (
    Slider,
    Trajectory,
    critical_stiffness,
    integrate,
    linear_rates,
    oscillates,
)

Amplitude = Annotated[float, Field(ge=0, lt=0.95)]


class StabilityDiagram(Experiment):
    """Steady sliding or stick-slip over drive speed and stiffness, by simulation and by linear analysis."""

    name = "stability"
    kind: Literal["stability"] = "stability"
    slowest: Speed = 1e-7
    """Lowest drive speed."""
    fastest: Speed = 1e-4
    """Highest drive speed."""
    speeds: Annotated[int, Field(ge=2, le=200)] = 40
    """Number of drive speeds."""
    softest: Positive = 0.2
    """Smallest stiffness over W (b - a) / D_c."""
    stiffest: Positive = 1.8
    """Highest stiffness, over the critical one."""
    stiffnesses: Annotated[int, Field(ge=2, le=200)] = 40
    """Number of stiffnesses."""

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        law = slider.law
        unit = float(law.b - law.a) / float(law.D_c)
        if unit <= 0:
            raise RuptfxError(
                f"friction.b = {float(law.b):g} must exceed friction.a = {float(law.a):g}: this slider is stable at "
                "every stiffness, so that there is no boundary to find"
            )
        speeds = np.geomspace(self.slowest, self.fastest, self.speeds)
        ratio = np.linspace(self.softest, self.stiffest, self.stiffnesses)
        progress(0.0, "linear analysis")
        linear = np.array([critical_stiffness(slider, speed) for speed in speeds])
        progress(0.1, f"{self.speeds} x {self.stiffnesses} sliders")
        grid, drive = np.meshgrid(ratio * unit * slider.normal_force, speeds, indexing="ij")
        unstable = oscillates(slider.with_stiffness(grid.ravel()), drive.ravel()).reshape(grid.shape)
        # Boundary by simulation: half a cell above the stiffest slider that oscillates.
        cell = ratio[1] - ratio[0]
        edge = np.where(unstable.any(axis=0), np.max(np.where(unstable, ratio[:, None], 0), axis=0) + cell / 2, np.nan)
        return xarray.Dataset(
            {
                "oscillates": variable(("stiffness", "speed"), unstable, "1", "steady sliding is unstable"),
                "k_c_linear": variable("speed", linear[:, 0] / slider.normal_force, "1/m", "K_c / W, linear analysis"),
                "k_c_simulated": variable("speed", edge * unit, "1/m", "K_c / W, simulation"),
                "frequency": variable("speed", linear[:, 1] / (2 * np.pi), "Hz", "frequency at onset"),
                "cell": variable((), cell * unit, "1/m", "resolution of the simulated K_c / W"),
            },
            coords={
                "speed": variable("speed", speeds, "m/s", "drive speed"),
                "stiffness": variable("stiffness", ratio * unit, "1/m", "K / W"),
            },
            attrs={"experiment": self.name, "unit": unit},
        )


class Bifurcation(Experiment):
    """Growth of the oscillations as the spring is made softer than K_c; needs a mass to end the slips."""

    name = "bifurcation"
    kind: Literal["bifurcation"] = "bifurcation"
    speed: Speed = 1e-6
    """Of the drive."""
    ratios: Annotated[list[Positive], Field(min_length=1)] = [0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.94, 0.97, 0.985, 1.02]
    """Stiffness over K_c, in the order of computation; each starts from the previous motion, so that rising order
    converges fastest (close to K_c oscillations grow very slowly)."""
    periods: Annotated[int, Field(ge=10, le=1000)] = 40
    """Simulated periods of each stiffness."""
    samples: Samples = 6000
    """Of each stiffness."""

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        slider.need_mass()
        critical, omega = critical_stiffness(slider, self.speed)
        if not critical:
            raise RuptfxError(
                f"the slider is stable at every stiffness at speed = {self.speed:g} m/s; choose a speed at which "
                "friction weakens"
            )
        duration, shown = self.periods * 2 * np.pi / omega, 8
        y, before = slider.with_stiffness(critical).steady(self.speed), critical
        y[1] += 0.05
        rows, waves = [], []
        for number, ratio in enumerate(self.ratios):
            progress(number / len(self.ratios), f"K / K_c = {ratio:g}")
            softer = slider.with_stiffness(ratio * critical)
            # The same force at the start: the new spring is stretched accordingly.
            y[0] *= before / (ratio * critical)
            motion = integrate(softer, y, np.linspace(0, duration, self.samples), self.speed)
            y, before = motion.end.copy(), ratio * critical
            third, last = np.array_split(motion.friction, 4)[2:]
            rows.append((np.ptp(last), np.ptp(last) / np.ptp(third) - 1, last.mean(), *_cycles(motion, omega)))
            waves.append(motion.friction[-self.samples * shown // self.periods :])
        amplitude, drift, mean, frequency, harmonic = np.array(rows).T
        return xarray.Dataset(
            {
                "amplitude": variable("ratio", amplitude, "1", "peak-to-peak friction coefficient"),
                "drift": variable("ratio", drift, "1", "relative change of the amplitude over the last quarter"),
                "mean_friction": variable("ratio", mean, "1", "mean friction coefficient"),
                "frequency": variable("ratio", frequency / 2 / np.pi, "Hz", "frequency"),
                "harmonic": variable("ratio", harmonic, "1", "second over first harmonic"),
                "wave": variable(("ratio", "wave_time"), np.array(waves), "1", "friction coefficient"),
                "K_c": variable((), critical, "N/m", "critical stiffness, linear analysis"),
            },
            coords={
                "ratio": variable("ratio", np.array(self.ratios), "1", "K / K_c"),
                "wave_time": variable("wave_time", np.arange(len(waves[0])) * duration / self.samples, "s", "time"),
            },
            attrs={"experiment": self.name},
        )


def _cycles(motion: Trajectory, omega: float) -> tuple[float, float]:
    """Return frequency [rad/s] and second over first harmonic, over the whole cycles in the later half of a motion."""
    half = len(motion.time) // 2
    signal = motion.friction[half:] - motion.friction[half:].mean()
    rises = np.flatnonzero((signal[:-1] < 0) & (signal[1:] >= 0))
    if len(rises) < 2 or np.ptp(signal) < 1e-9:
        return omega, 0.0
    cycles, span = len(rises) - 1, slice(rises[0], rises[-1])
    spectrum = np.abs(np.fft.rfft(signal[span]))
    duration = motion.time[half + rises[-1]] - motion.time[half + rises[0]]
    return 2 * np.pi * cycles / duration, float(spectrum[2 * cycles] / spectrum[cycles])


def onset(slider: Slider, speed: float) -> tuple[float, float]:
    """Return K_c [N/m] and frequency at onset [rad/s] by simulation, at which small oscillations are neutral.

    The growth rate is the slope of the logarithm of successive maxima of ln theta over ten periods.
    """
    guess, omega = critical_stiffness(slider, speed)
    entries = {}

    def growth(ratio: float) -> float:
        trial = slider.with_stiffness(ratio * guess)
        start = trial.steady(speed)
        start[1] += 1e-3
        motion = integrate(trial, start, np.linspace(0, 12 * 2 * np.pi / omega, 6000), speed, rtol=1e-11)
        signal = motion.y[1] - trial.steady(speed)[1]
        inner = np.flatnonzero((signal[1:-1] > signal[:-2]) & (signal[1:-1] >= signal[2:]) & (signal[1:-1] > 0)) + 1
        left, middle, right = signal[inner - 1], signal[inner], signal[inner + 1]
        # Parabola through the three samples about each maximum.
        shift = 0.5 * (left - right) / (left - 2 * middle + right)
        times = motion.time[inner] + shift * (motion.time[1] - motion.time[0])
        heights = middle - 0.25 * (left - right) * shift
        entries["omega"] = 2 * np.pi / np.polyfit(np.arange(len(times) - 1), times[1:], 1)[0]
        return float(np.polyfit(times[1:], np.log(heights[1:]), 1)[0])

    ratio = brentq(growth, 0.9, 1.1, xtol=1e-6)
    growth(ratio)
    return float(ratio * guess), float(entries["omega"])


class ModulatedLoad(Experiment):
    """Fast oscillation of the normal load, W (1 + eps cos 2 pi f t), which reduces friction and stabilises sliding."""

    name = "modulated_load"
    kind: Literal["modulated_load"] = "modulated_load"
    speed: Speed = 1e-6
    """Of the drive."""
    frequency: Annotated[Positive, Unit("1/s")] = 120.0
    """Of the load."""
    amplitudes: Annotated[list[Amplitude], Field(min_length=1)] = [0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3]
    """eps, one run each."""
    critical: bool = True
    """Also find the critical stiffness at each amplitude."""
    samples: Samples = 512
    """Of the cycle that is shown."""

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        base = float(np.asarray(slider.law.steady_strength(self.speed, slider.normal_force))) / slider.normal_force
        rows, critical, waves = [], [], []
        for number, eps in enumerate(self.amplitudes):
            progress(number / len(self.amplitudes), f"eps = {eps:g}")
            orbit = self.orbit(slider, eps)
            wave = orbit.friction[:-1]
            spectrum = np.fft.rfft(wave) / len(wave)
            rows.append((spectrum[0].real, *(2 * np.abs(spectrum[1:3]))))
            waves.append(wave)
            critical.append(self.critical_stiffness(slider, eps) if self.critical else np.nan)
        mean, first, second = np.array(rows).T
        return xarray.Dataset(
            {
                "mean_friction": variable("eps", mean, "1", "mean friction force over W"),
                "mean_change": variable("eps", mean / base - 1, "1", "relative change of the mean friction"),
                "first_harmonic": variable("eps", first, "1", "amplitude at f"),
                "second_harmonic": variable("eps", second, "1", "amplitude at 2 f"),
                "law": variable(
                    "eps",
                    small_amplitude_change(np.array(self.amplitudes), base, float(slider.law.a)),
                    "1",
                    "-(a / mu) ln I_0(eps mu / a)",
                ),
                "K_c_loaded": variable("eps", np.array(critical), "N/m", "critical stiffness under the load"),
                "wave": variable(("eps", "phase"), np.array(waves), "1", "friction force over W"),
            },
            coords={
                "eps": variable("eps", np.array(self.amplitudes), "1", "amplitude of the load"),
                "phase": variable("phase", np.arange(self.samples) / self.samples, "1", "fraction of the cycle"),
            },
            attrs={"experiment": self.name, "frequency": self.frequency},
        )

    def _cycle(self, slider: Slider, start: np.ndarray, eps: float, samples: int = 1) -> Trajectory:
        period = 1 / self.frequency

        def load(time: float) -> float:
            return slider.normal_force * (1 + eps * np.cos(2 * np.pi * self.frequency * time))

        times = np.linspace(0, period, samples + 1)
        return integrate(slider, start, times, self.speed, load, rtol=1e-10, longest_step=period / 16)

    def orbit(self, slider: Slider, eps: float) -> Trajectory:
        """Return the motion that is periodic with the load: a fixed point of the map over one cycle.

        Raises
        ------
        RuptfxError
            If none is found.
        """
        scale, start = slider.scales(self.speed), slider.steady(self.speed)
        # The forced interface carries less on average; its age hardly changes within a cycle.
        change = small_amplitude_change(eps, 1.0, float(slider.law.a) / self._friction(slider))
        start[0] *= 1 + float(change)

        def defect(z: np.ndarray) -> np.ndarray:
            return self._cycle(slider, z * scale, eps).end / scale - z

        result, _, status, message = fsolve(defect, start / scale, full_output=True, xtol=1e-10, epsfcn=1e-10)
        if status != 1 and np.abs(defect(result)).max() > 1e-6:
            raise RuptfxError(
                f"no periodic sliding found at load amplitude {eps:g}: {message.strip()}; decrease "
                "experiment.amplitudes"
            )
        return self._cycle(slider, result * scale, eps, self.samples)

    def _friction(self, slider: Slider) -> float:
        return float(np.asarray(slider.law.steady_strength(self.speed, slider.normal_force))) / slider.normal_force

    def multiplier(self, slider: Slider, eps: float) -> float:
        """Return ln of the largest Floquet multiplier over one cycle; if positive, periodic sliding is unstable."""
        start, scale = self.orbit(slider, eps).y[:, 0], slider.scales(self.speed)
        matrix = np.empty((slider.size, slider.size))
        for column in range(slider.size):
            step = np.zeros(slider.size)
            step[column] = 1e-4 * scale[column]
            ends = [self._cycle(slider, start + sign * step, eps).end for sign in (1, -1)]
            matrix[:, column] = (ends[0] - ends[1]) / (2e-4 * scale)
        return float(np.log(np.abs(np.linalg.eigvals(matrix)).max()))

    def critical_stiffness(self, slider: Slider, eps: float) -> float:
        """Return K_c [N/m] under the modulated load; NaN if it is not between 0.02 and 1.2 of that at rest."""
        unmodulated, _ = critical_stiffness(slider, self.speed)
        if eps == 0 or not unmodulated:
            return unmodulated

        def growth(ratio: float) -> float:
            return self.multiplier(slider.with_stiffness(ratio * unmodulated), eps)

        low, high = 0.02, 1.2
        if growth(low) <= 0 or growth(high) >= 0:
            return float("nan")
        return float(unmodulated * brentq(growth, low, high, xtol=1e-4))


def small_amplitude_change(eps: np.ndarray | float, friction: float, a: float) -> np.ndarray:
    """Return the relative change of mean friction at constant age, -(a / mu) ln I_0(eps mu / a).

    The slip rate V0 exp((F / W - ...) / a) with F / W = mu (1 - eps cos) must average to the drive's speed, and the
    average of exp(x cos) is I_0(x).
    """
    return -a / friction * np.log(np.i0(np.asarray(eps) * friction / a))


__all__ = [
    "Bifurcation",
    "ModulatedLoad",
    "StabilityDiagram",
    "linear_rates",
    "onset",
    "small_amplitude_change",
]
