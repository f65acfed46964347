"""Inclined plates of `demos/inclined_plates.toml`: how long the interface slips 20 mm away from the wire.

The interface carries P cos^2 and P sin cos of the pressure P. Published, in this order: a narrow pulse at 20 degrees,
a wider one at 25, a crack at 30. The constants are ours, chosen so that it comes out; what is checked is that it does,
and that the widths are those of the finer mesh of the page.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from ruptfx import fem
from ruptfx.bench import Check
from ruptfx.case import Case, read_case
from ruptfx.model import Model

PUBLISHED = "Lu, Lapusta and Rosakis (2007)"
AWAY, PART, PRESSURE = 20e-3, 0.1, 10e6  # m, of the largest slip rate, Pa
FINE = {20: 9.6e-6, 25: 19.4e-6}  # s, on elements of 2.5 mm


def plates(angle: int, size: float) -> Case:
    """The demo at another inclination [degrees], on elements of another size [m]."""
    path = Path(str(files("ruptfx").joinpath("demos/inclined_plates.toml")))
    case = read_case(path, overrides=[f"mesh.inclination={np.radians(angle)}", f"mesh.element_size={size}",
                                      "instruments=[]"])  # fmt: skip
    assert isinstance(case, Case)
    return case


def carried(angle: int, size: float) -> tuple[float, float]:
    """Largest errors of the normal and shear stress before anything happens, over P cos^2 and P sin cos."""
    fault = Model(plates(angle, size), fem.MPI.COMM_SELF).faults[0]
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    normal, shear = fault.normal_stress_0 / (PRESSURE * c**2), np.abs(fault.shear_traction_0) / (PRESSURE * s * c)
    return float(np.abs(normal - 1).max()), float(np.abs(shear - 1).max())


@cache
def lasting(angle: int, size: float) -> float:
    """How long the slip rate at AWAY is above a part of its largest value [s], infinite without end in 60 us."""
    case = plates(angle, size)
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    face = model.faults[0].interface
    point = int(np.argmin(np.abs(face.position - 0.5 * (face.line.first + face.line.last) - AWAY)))
    times, rates = [], []
    while state.time < case.duration:
        motion.step(state)
        times.append(state.time)
        rates.append(abs(float(state.faults["main"]["slip_rate"].reshape(len(face.position), -1)[point, 0])))
    fast = np.flatnonzero(np.array(rates) > PART * max(rates))
    return np.inf if fast[-1] == len(times) - 1 else times[fast[-1]] - times[fast[0]]


def run(fine: bool, comm: fem.MPI.Comm) -> list[Check]:
    """The same on every rank."""
    size = 2.5e-3 if fine else 3.75e-3
    narrow, wide, crack = (lasting(angle, size) for angle in (20, 25, 30))
    ends = float(np.isinf(crack))
    normal, shear = carried(25, size)
    return [
        Check("25 degrees: initial normal stress over P cos^2, largest error", 0.0, normal, 1e-6, "1", "closed form"),
        Check("25 degrees: initial shear stress over P sin cos, largest error", 0.0, shear, 1e-6, "1", "closed form"),
        Check("20 degrees: slip at 20 mm lasts", FINE[20], narrow, 0.15, "s", "elements of 2.5 mm", relative=True),
        Check("25 degrees: slip at 20 mm lasts", FINE[25], wide, 0.15, "s", "elements of 2.5 mm", relative=True),
        Check("25 over 20 degrees", 1.5, wide / narrow, 0, "1", PUBLISHED, "at least"),
        Check("30 degrees: slips to the end", 1, ends, 0, "1", PUBLISHED),
    ]
