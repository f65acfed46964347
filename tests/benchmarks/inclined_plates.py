"""Inclined plates of `demos/inclined_plates.toml`: duration of slip, and signals of velocimeters.

The interface carries P cos^2 and P sin cos of the pressure P. Published, in this order: a narrow pulse at 20 degrees,
a wider one at 25, a crack at 30. The constants are ours, chosen so that it comes out; what is checked is that it does,
that the widths are those of the finer mesh of the page, and that what is called a pulse is one: it lasts equally long
on its way, and next to nothing slips behind it.

A pair of velocimeters, 0.5 mm above and below the interface at 20 mm from the wire, sees less than the slip rate V(t).
Of a front that runs along at v <= c_R, steadily, and leaves the normal stress as it is, that is the part of frequency w
times

    [2 exp(-k a_p y) - (1 + a_s^2) exp(-k a_s y)] / (1 - a_s^2),   k = w / v,   a_i = sqrt(1 - v^2 / c_i^2)

(u_x = A_p exp(-k a_p y) + A_s exp(-k a_s y), without sigma_yy at y = 0). The front at 20 degrees is compared with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ruptfx.app.bench import Check
from ruptfx.case import Case, read_case
from ruptfx.laws import fracture
from ruptfx.platform import fem
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

Array = np.ndarray

PUBLISHED = "Lu, Lapusta and Rosakis (2007)"
AWAY, PART, PRESSURE = 20e-3, 0.1, 10e6  # m, of the largest slip rate, Pa
HEIGHT = 0.5e-3  # m, of the velocimeters
MEETS_ENDS, SWINGS = 48e-6, 3e-6  # s: waves from the ends are back within 45 mm of the wire later than that
FINE = {20: 9.6e-6, 25: 19.4e-6}  # s, on elements of 2.5 mm


def plates(angle: int, size: float) -> Case:
    """Return the demo at another inclination [degrees], on elements of another size [m]."""
    path = Path(str(files("ruptfx").joinpath("demos/inclined_plates.toml")))
    case = read_case(path, overrides=[f"mesh.inclination={np.radians(angle)}", f"mesh.element_size={size}",
                                      "instruments=[]"])  # fmt: skip
    assert isinstance(case, Case)
    return case


def carried(angle: int, size: float) -> tuple[float, float]:
    """Return the largest errors of the initial normal and shear stress, over P cos^2 and P sin cos."""
    fault = Model(plates(angle, size), fem.MPI.COMM_SELF).faults[0]
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    normal, shear = fault.normal_stress_0 / (PRESSURE * c**2), np.abs(fault.shear_traction_0) / (PRESSURE * s * c)
    return float(np.abs(normal - 1).max()), float(np.abs(shear - 1).max())


@dataclass(frozen=True)
class Passage:
    """Result of a run.

    Attributes
    ----------
    time, seen_at : ndarray, shape (times,)
        Times of slip rates, and of velocimeters [s].
    away : ndarray, shape (points,)
        Distance of points from the wire along the interface, positive on the side of the velocimeters [m].
    rate : ndarray, shape (times, points)
        Magnitude of the slip rate [m/s].
    seen : ndarray, shape (times,)
        Velocity of the pair of velocimeters at AWAY [m/s].
    """

    time: Array
    seen_at: Array
    away: Array
    rate: Array
    seen: Array

    def at(self, away: float) -> Array:
        """Return the slip rate of the nearest point [m/s], shape (times,)."""
        return self.rate[:, int(np.argmin(np.abs(self.away - away)))]

    def first_slip(self, away: float) -> float:
        """Return how long a point slips faster than PART of its peak before its first stop, or the end [s]."""
        rate = self.at(away)[self.time < MEETS_ENDS]
        fast = rate > PART * rate.max()
        start = int(np.argmax(fast))
        # The wire makes the rate oscillate at first.
        stopped = ~fast & (self.time[: len(fast)] > self.time[start] + SWINGS)
        end = int(np.argmax(stopped)) if stopped.any() else len(fast) - 1
        return float(self.time[end] - self.time[start])

    def speed(self) -> float:
        """Return the speed of the front around AWAY [m/s]."""
        near = np.abs(self.away - AWAY) < 5e-3
        arrival = self.time[np.argmax(self.rate[:, near] > PART * self.at(AWAY).max(), axis=0)]
        return float(1 / np.polyfit(self.away[near], arrival, 1)[0])


def lasting(time: Array, rate: Array) -> float:
    """Return how long a rate is above PART of its peak [s], infinite if until the end."""
    fast = np.flatnonzero(rate > PART * rate.max())
    return np.inf if fast[-1] == len(time) - 1 else float(time[fast[-1]] - time[fast[0]])


@cache
def passage(angle: int, size: float) -> Passage:
    """Run the case with the velocimeters."""
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    place, across = np.array([75e-3, 75e-3]) + AWAY * along, HEIGHT * np.array([-along[1], along[0]])
    pair = {
        "kind": "velocimeter", "name": "pair", "interval": 2e-7, "direction": along.tolist(),
        "point": (place + across).tolist(), "relative_to": (place - across).tolist(),
    }  # fmt: skip
    case = plates(angle, size).changed("instruments", [pair]).changed("output.figures", False)
    with TemporaryDirectory() as folder, simulate(case, Path(folder) / "run", fem.MPI.COMM_SELF, progress=False) as run:
        rate, seen = abs(run.interface.slip_rate.load()), abs(run.instruments["pair"].velocity.load())
    away = rate.position.values - float(rate.position.mean())
    return Passage(rate.time.values, seen.time.values, away, rate.values, seen.values)


def steady(time: Array, rate: Array, speed: float, height: float) -> Array:
    """Return the velocity of a pair of points above and below a steadily moving slip rate [m/s], shape (times,)."""
    c_p, c_s, _ = plates(20, 2.5e-3).materials["default"].wave_speeds("stress")
    a_p, a_s = fracture.slowness_factors(speed, c_p, c_s)
    even = np.linspace(time[0], time[-1], len(time))
    spectrum = np.fft.rfft(np.interp(even, time, rate), 8 * len(even))
    k = 2 * np.pi * np.fft.rfftfreq(8 * len(even), even[1] - even[0]) / speed
    factor = (2 * np.exp(-k * a_p * height) - (1 + a_s**2) * np.exp(-k * a_s * height)) / (1 - a_s**2)
    return np.interp(time, even, np.fft.irfft(spectrum * factor, 8 * len(even))[: len(even)])


def run(fine: bool, comm: fem.MPI.Comm) -> list[Check]:
    """Run the benchmark; every rank returns the same checks."""
    del comm
    size = 2.5e-3 if fine else 3.75e-3
    runs = [passage(angle, size) for angle in (20, 25, 30)]
    narrow, wide, crack = (lasting(found.time, found.at(AWAY)) for found in runs)
    seen_narrow, seen_wide, seen_crack = (lasting(found.seen_at, found.seen) for found in runs)
    normal, shear = carried(25, size)
    pulse, wider, longest = runs
    record = steady(pulse.time, pulse.at(AWAY), pulse.speed(), HEIGHT)
    away = np.interp(pulse.seen_at, pulse.time, record) - pulse.seen
    widths = [wider.first_slip(place) for place in np.arange(10e-3, 41e-3, 5e-3)]

    def left(found: Passage) -> float:
        behind = (found.time > 35e-6) & (found.time < 40e-6)
        return float(found.at(AWAY)[behind].mean() / found.at(AWAY).max())

    return [
        Check("25 degrees: initial normal stress over P cos^2, largest error", 0.0, normal, 1e-6, "1", "closed form"),
        Check("25 degrees: initial shear stress over P sin cos, largest error", 0.0, shear, 1e-6, "1", "closed form"),
        Check("20 degrees: slip at 20 mm lasts", FINE[20], narrow, 0.15, "s", "elements of 2.5 mm", relative=True),
        Check("25 degrees: slip at 20 mm lasts", FINE[25], wide, 0.15, "s", "elements of 2.5 mm", relative=True),
        Check("25 over 20 degrees", 1.5, wide / narrow, 0, "1", PUBLISHED, "at least"),
        Check("30 degrees: slips to the end", 1, float(np.isinf(crack)), 0, "1", PUBLISHED),
        Check("25 degrees: slip from 10 to 40 mm lasts, longest over shortest", 1.25, max(widths) / min(widths), 0, "1",
              "a pulse does not widen", "at most"),
        Check("25 degrees: slip rate at 20 mm behind the pulse over the largest", 0.1, left(wider), 0, "1",
              "a pulse heals", "at most"),
        Check("30 degrees: slip rate at 20 mm at the same time over the largest", 0.1, left(longest), 0, "1",
              "a crack does not", "at least"),
        Check("20 degrees: velocimeters against the steady field of the slip rate, largest error over the largest", 0.0,
              float(np.abs(away).max() / pulse.seen.max()), 0.15, "1", "closed form"),
        Check("velocimeters: 25 over 20 degrees", 1.25, seen_wide / seen_narrow, 0, "1", PUBLISHED, "at least"),
        Check("velocimeters: 30 degrees move to the end", 1, float(np.isinf(seen_crack)), 0, "1", PUBLISHED),
    ]  # fmt: skip
