"""The pinned interface: loading and unloading below the static threshold, and the resonance of small oscillations."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
import xarray
from pydantic import Field

from ruptfx import RuptfxError
from ruptfx.input.schema import Unit
from ruptfx.input.units import Duration, Positive, Speed
from ruptfx.lumped import Progress, variable
from ruptfx.lumped.spring_slider.protocols import Experiment, Samples
from ruptfx.lumped.spring_slider.slider import Slider, integrate

OfStatic = Annotated[float, Field(gt=0, lt=1)]


def _need_elastic_interface(slider: Slider) -> None:
    if slider.interface_length == 0:
        raise RuptfxError("interface_length = 0: a rigid interface does not move below the threshold; give lambda")


class LoadingUnloading(Experiment):
    """Force and displacement of a slider that is loaded to a part of its static force, and unloaded."""

    name = "loading_unloading"
    kind: Literal["loading_unloading"] = "loading_unloading"
    speed: Speed = 1e-5
    """Of the drive, forward and backward."""
    rest: Duration = 100.0
    """Age of the contacts at the start."""
    fractions: Annotated[list[OfStatic], Field(min_length=1)] = [0.3, 0.5, 0.8, 0.9, 0.95, 0.98]
    """Largest force over the static force, one run each."""
    samples: Samples = 1000
    """Samples of loading, and of unloading."""

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        _need_elastic_interface(slider)
        slow = replace(slider, mass=0.0)  # of inertia only the vibration of the slider would be seen
        start = np.array([0.0, np.log(self.rest)])
        threshold = float(np.asarray(slider.law.strength(self.speed, slider.normal_force, {"theta": self.rest})))
        soft = 1 / (1 / slider.stiffness + slider.interface_length / slider.normal_force)
        progress(0.0, "to the first slip")
        times = np.linspace(0, 2 * threshold / soft / self.speed, 2 * self.samples)
        # The threshold of the source: the slip rate is that of the drive for the first time.
        motion = integrate(slow, start, times, self.speed, stop_at=self.speed)
        static = motion.friction[-1]
        moved = self.speed * motion.time - motion.friction * slider.normal_force / slider.stiffness
        forces, positions, slips = [], [], []
        for number, fraction in enumerate(self.fractions):
            progress((1 + number) / (1 + len(self.fractions)), f"{fraction:g} of the static force")
            turn = float(np.interp(fraction * static, motion.friction, motion.time))
            rise = np.linspace(0, turn, self.samples)
            first = integrate(slow, start, rise, self.speed)
            # The drive returns by what spring and interface are stretched.
            back = turn + np.linspace(0, 1, self.samples) * first.friction[-1] * slider.normal_force / soft / self.speed
            second = integrate(slow, first.end, back, -self.speed)
            drive = self.speed * np.concatenate([rise, 2 * turn - back])
            friction = np.concatenate([first.friction, second.friction])
            forces.append(friction)
            positions.append(drive - friction * slider.normal_force / slider.stiffness)
            slips.append(drive[-1] - second.y[0, -1])
        return xarray.Dataset(
            {
                "friction": variable(("fraction", "sample"), np.array(forces), "1", "force over normal force"),
                "displacement": variable(("fraction", "sample"), np.array(positions), "m", "displacement"),
                "irreversible": variable("fraction", np.array(slips), "m", "irreversible slip after unloading"),
                "whole_friction": variable("whole", motion.friction, "1", "force over normal force, to the slip"),
                "whole_displacement": variable("whole", moved, "m", "its displacement"),
                "static_friction": variable((), static, "1", "friction coefficient where the slip rate is the drive's"),
            },
            coords={"fraction": variable("fraction", np.array(self.fractions), "1", "largest force over static force")},
            attrs={"experiment": self.name},
        )


class FrequencyResponse(Experiment):
    """Small oscillations of the pinned slider under an oscillating shear force: resonance and quality factor.

    Displacement over force is 1 / (W (1 + i tan delta) / lambda + K - M (2 pi f)^2) (Baumberger, Berthoud, Caroli et
    al. 2001, section 2); the drive is at rest and the law does not creep at forces this small.
    """

    name = "frequency_response"
    kind: Literal["frequency_response"] = "frequency_response"
    lowest: Annotated[Positive, Unit("1/s")] = 300.0
    """Lowest frequency."""
    highest: Annotated[Positive, Unit("1/s")] = 1500.0
    """Highest frequency."""
    loss_tangent: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """tan delta of the interface, the same at all frequencies."""
    samples: Samples = 4000
    """Number of frequencies."""

    def run(self, slider: Slider, progress: Progress) -> xarray.Dataset:
        _need_elastic_interface(slider)
        if slider.mass == 0:
            raise RuptfxError("mass = 0: a slider without mass has no resonance; give mass (normal_force / 9.81)")
        frequency = np.geomspace(self.lowest, self.highest, self.samples)
        interface = slider.normal_force / slider.interface_length
        response = 1 / (
            interface * (1 + 1j * self.loss_tangent) + slider.stiffness - slider.mass * (2 * np.pi * frequency) ** 2
        )
        amplitude = np.abs(response)
        top = int(np.argmax(amplitude))
        if top in (0, len(frequency) - 1):
            raise RuptfxError(
                f"experiment: no resonance from lowest = {self.lowest:g} to highest = {self.highest:g} 1/s; include "
                f"{np.sqrt((interface + slider.stiffness) / slider.mass) / (2 * np.pi):.6g} 1/s"
            )
        half = amplitude[top] / np.sqrt(2)
        below = np.interp(half, amplitude[: top + 1], frequency[: top + 1], left=np.nan)
        above = np.interp(-half, -amplitude[top:], frequency[top:], right=np.nan)
        resonance = float(frequency[top])
        return xarray.Dataset(
            {
                "compliance": variable("frequency", amplitude, "m/N", "displacement over force"),
                "phase": variable("frequency", np.angle(response), "rad", "phase of the displacement after the force"),
                "resonance": variable((), resonance, "1/s", "frequency of the largest displacement"),
                "quality": variable((), resonance / (above - below), "1", "resonance over its width at half power"),
            },
            coords={"frequency": variable("frequency", frequency, "1/s", "frequency")},
            attrs={"experiment": self.name},
        )
