"""TPV105: rupture with strong rate weakening and thermal pressurisation on a vertical fault, in three dimensions.

SCEC/USGS benchmark TPV105-3D. The values are those of the input of another code for it, EQdyna (folder
`case_input/test.tpv1053d` and file `scripts/defaultParameters.py` of the repository EQDYNA/EQdyna), checked against the
first rows of its station files: the effective normal stress grows with depth to 45 MPa, the shear stress is 0.41 of it,
and 50 MPa more in a patch of radius 1.5 km. Times of 1 m of slip, and pressure and temperature then, are compared with
those that EQdyna 5.1.0 of 11 September 2020 had with 100 m between nodes, station files in the folders
`scec_archive/tpv105-3d` and `tpv105-3d_arc`. Here nodes are 250 m apart, with `--fine` 188 m; the bars are those of
TPV104. The processor time that thermal pressurisation adds to a step is measured in turns with the same fault without
it.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from benchmarks._rate_and_state_3d import case, weakening
from benchmarks._surfaces import spacing
from benchmarks.tpv103 import LAW
from benchmarks.tpv104 import bars
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case, parse_case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

DURATION = 4.0  # s, when all stations have slid 1 m
SLIP = 1.0  # m
PUBLISHED = {
    (0.0, 7.5e3): (2.420, 9.379e6, 125.6), (-9e3, 7.5e3): (2.892, 9.455e6, 125.6), (0.0, 3e3): (3.751, 9.962e6, 125.2),
}  # fmt: skip
"""Time [s] of 1 m of slip, and the rise of the pressure [Pa] and the temperature [K] then, linear between samples 0.008
s apart, by position along strike and down dip [m]."""
SOURCE = "EQdyna 5.1.0, 100 m"
FLUID = {"kind": "thermal_pressurisation", "heat_capacity": 2.7e6, "thermal_diffusivity": 1e-6,
         "pressure_per_temperature": 0.1e6, "width": 20e-3}  # fmt: skip
DEEP, SHALLOW = 45e6, 9.8 * 1670.0  # Pa, Pa/m
LOADED, EXTRA, RADIUS = 0.41, 50e6, 1.5e3  # shear over normal stress; Pa and m of the patch
DRAINS = (4e-4, 1.0004)  # hydraulic diffusivity inside and outside, m2/s
BELOW = (9e3, 6e3)  # m down dip: middle and half width of the part that weakens, 3 km below the surface
MOST = 0.25  # of the processor time of a step


def make(element_size: float, fluid: bool) -> Table:
    """Return the case on elements of a size [m], with or without the fluid."""
    law = {**LAW, "a": weakening(0.01, 0.02, *BELOW), "V_w": weakening(0.1, 1.0, *BELOW)}
    table: Any = case(element_size, law, 0.0, EXTRA, DURATION)
    fault = table["faults"]["main"]

    def with_depth(factor: float) -> Table:
        positions = [0.0, 50.0, DEEP / SHALLOW, 1e5]
        values = [factor * stress for stress in (50.0 * SHALLOW, 50.0 * SHALLOW, DEEP, DEEP)]
        return {"kind": "along_dip", "profile": {"kind": "table", "positions": positions, "values": values}}

    fault["initial_stress"] = {"normal": with_depth(1.0), "shear": with_depth(LOADED)}
    fault["nucleation"] |= {"center": {"x": -4e3, "y": 0.0, "z": -7.5e3}, "radius": RADIUS}
    if fluid:
        fault["pore_pressure"] = {**FLUID, "hydraulic_diffusivity": weakening(*DRAINS)}
    return table


class March(NamedTuple):
    """Histories of the stations: times [s], shape (steps,); slip [m], pressure [Pa], temperature [K], (steps, 3)."""

    times: np.ndarray
    slip: np.ndarray
    pressure: np.ndarray
    temperature: np.ndarray

    def reached(self, station: int) -> tuple[float, float, float]:
        """Return the time of `SLIP`, and pressure and temperature then; NaN where it is not reached."""
        slip = self.slip[:, station]
        if slip[-1] < SLIP:
            return (np.nan, np.nan, np.nan)
        when = float(np.interp(SLIP, slip, self.times))
        pressure, warm = (float(np.interp(when, self.times, each[:, station])) for each in self[2:])
        return when, pressure, warm


def start(element_size: float, fluid: bool) -> tuple[Any, Any, Any]:
    """Return the steps, the state and the model of a case."""
    given = parse_case(make(element_size, fluid))
    assert isinstance(given, Case)
    model = Model(given, fem.MPI.COMM_SELF)
    return given.stepper.bind(model), model.initial_state(), model


def march(element_size: float) -> March:
    """Run the case with the fluid."""
    motion, state, model = start(element_size, True)
    face, fields = model.faults[0].interface, state.faults["main"]
    stations = [int(np.argmin(np.hypot(face.position - x, face.across - z))) for x, z in PUBLISHED]
    rows = []
    while state.fault_time < DURATION:
        motion.step(state)
        slip = np.hypot(fields["slip_1"], fields["slip_2"])
        rows.append((state.fault_time, *(each[stations] for each in (
            slip, fields["pore_pressure"], fields["temperature"]))))  # fmt: skip
    return March(*(np.array(each) for each in zip(*rows, strict=True)))


def added_time(element_size: float, rounds: int = 6, steps: int = 5) -> float:
    """Return the processor time that the fluid adds to a step over that without it, in turns."""
    runs = [start(element_size, fluid)[:2] for fluid in (False, True)]
    seconds: list[list[float]] = [[], []]
    for _ in range(rounds):
        for times, (motion, state) in zip(seconds, runs, strict=True):
            for _ in range(steps):
                begun = time.process_time()
                motion.step(state)
                times.append(time.process_time() - begun)
    dry, wet = (min(times[steps:]) for times in seconds)  # other processes only add
    return wet / dry - 1


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    sizes = (1000.0, 750.0) if fine else (1000.0,)
    checks, runs = [], {size: march(size) for size in sizes}
    for size, each in runs.items():
        for number, ((x, z), (when, pressure, warm)) in enumerate(PUBLISHED.items()):
            values, text = (
                each.reached(number),
                f"{spacing(size)}, {x / 1e3:g} km along strike, {z / 1e3:g} km down dip",
            )
            checks += [
                Check(f"time of 1 m of slip, {text}", when, values[0], bars(size), "s", SOURCE),
                Check(f"pore pressure then, {text}", pressure, values[1], 0.05, "Pa", SOURCE, relative=True),
                Check(f"temperature then, {text}", warm, values[2], 0.05, "K", SOURCE, relative=True),
            ]
    added = added_time(sizes[0])
    checks.append(
        Check("processor time that the fluid adds to a step", MOST, added, 0, "1", "same fault", "at most", timing=True)
    )
    return Outcome(checks, lambda: _draw(runs))


def _draw(runs: dict[float, March]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, (axes,) = new_figure(1, 2, 3.2, 8)
    for size, each in runs.items():
        for number, ((x, z), published) in enumerate(PUBLISHED.items()):
            label = f"{spacing(size)}, ({x / 1e3:g}, {z / 1e3:g}) km"
            line = axes[0].plot(each.times, each.slip[:, number], lw=0.8, label=label)[0]
            axes[0].plot(published[0], SLIP, "o", ms=4, color=line.get_color())
            axes[1].plot(each.times, each.pressure[:, number] / 1e6, lw=0.8, color=line.get_color())
            axes[1].plot(published[0], published[1] / 1e6, "o", ms=4, color=line.get_color())
    axes[0].set(xlabel="Time (s)", ylabel="Slip (m)", title=f"Circles: {SOURCE}")
    axes[1].set(xlabel="Time (s)", ylabel="Rise of the pore pressure (MPa)")
    axes[0].legend(loc="upper left", fontsize=6)
    return figure
