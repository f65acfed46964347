"""Thermal pressurisation: closed forms of weakening and heating, and a rupture after TPV105 in two dimensions.

Closed forms, of a point that slides at a constant rate: the temperature of a plane under a constant heat flow (Carslaw
and Jaeger 1959), the adiabatic undrained layer (Lachenbruch 1980), and slip on a plane over five decades of slip (Rice
2006). The order of the steps is that of pressures on three step sizes.

The rupture is TPV105 along a line: the friction law, fluid, stresses and patch of the problem in three dimensions at
depth (`tpv105`, from the input of another code), on the line of TPV103. The description of TPV105 in two dimensions
could not be read here, and no result of other codes is compared. What is checked is the shape in words: with the fluid
the front is faster and does not stop, and pressure rises by more than half of the effective normal stress.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import erfcx

from benchmarks.tpv101 import TAPER, line
from benchmarks.tpv103 import LAW
from benchmarks.tpv105 import DEEP, DRAINS, EXTRA, FLUID, LOADED, RADIUS
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import Rupture, rupture
from ruptfx.interfaces.faults.fields import Heating
from ruptfx.interfaces.pore_pressure.thermal_pressurisation import PressurisedLayer, ThermalPressurisation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

F, SIGMA, CAPACITY, LAMBDA = 0.6, 100e6, 2.7e6, 0.3e6


def slide(width: float, heat: float, water: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return friction [Pa] and rise of the temperature [K] at some times of a point that slides at 1 m/s.

    The heat of a step is that of the mean friction, by iteration.
    """
    table = ThermalPressurisation(heat_capacity=CAPACITY, thermal_diffusivity=heat, hydraulic_diffusivity=water,
                                  pressure_per_temperature=LAMBDA, width=width)  # fmt: skip
    layer = PressurisedLayer(table, float(times[-1]), 1)
    memory, friction, warm = layer.memory(), [F * SIGMA], [0.0]
    for dt in np.diff(times):
        end = friction[-1]
        for _ in range(50):
            heating = Heating(np.array([friction[-1]]), np.array([0.5 * dt * (friction[-1] + end)]), dt)
            fields = layer.values(memory, 0.0, heating)
            end = F * (SIGMA - float(fields["pore_pressure"][0]))
        layer.advance(memory, 0.0, heating)
        friction.append(end)
        warm.append(float(fields["temperature"][0]))
    return np.array(friction), np.array(warm)


def closed_forms() -> list[Check]:
    """Return the checks against closed forms."""
    heat, water, h = 1e-6, 4e-6, np.sqrt(2 * np.pi) * 10e-3
    times = np.linspace(0.0, 1.0, 401)
    friction, _ = slide(10e-3, 1e-14, 3e-14, times)
    layer = F * SIGMA * np.exp(-F * LAMBDA * times / (CAPACITY * h))
    length = 4 / F**2 * (CAPACITY / LAMBDA) ** 2 * (np.sqrt(heat) + np.sqrt(water)) ** 2
    steps = np.concatenate([[0.0], length * np.geomspace(1e-5, 10.0, 600)])
    plane, _ = slide(0.0, heat, water, steps)
    rice, late = F * SIGMA * erfcx(np.sqrt(steps / length)), steps >= 1e-4 * length
    _, warm = slide(0.0, 1e-6, 1e6, steps)  # drained: constant friction
    carslaw = F * SIGMA / CAPACITY * np.sqrt(steps / (np.pi * 1e-6))
    ends = [slide(5e-3, 1e-6, 1e-4, np.linspace(0.0, 1.0, n + 1))[0][-1] for n in (40, 80, 160)]
    order = float(np.log2(abs(ends[0] - ends[1]) / abs(ends[1] - ends[2])))

    def check(name: str, found: np.ndarray, expected: np.ndarray, limit: float, source: str) -> Check:
        error = float(np.abs(found / expected - 1).max())
        return Check(name, 0.0, error, limit, "1", source)

    return [
        check("adiabatic undrained layer", friction, layer, 1e-3, "Lachenbruch (1980)"),
        check("slip on a plane, five decades", plane[late], rice[late], 1e-3, "Rice (2006)"),
        check("temperature of a plane", warm[1:], carslaw[1:], 1e-3, "Carslaw and Jaeger (1959)"),
        Check("order of the steps", 1.8, order, 0, "1", "second order", "at least"),
    ]


def case(spacing: float, fluid: bool) -> Table:
    """Return the rupture with nodes `spacing` [m] apart, with or without thermal pressurisation."""
    law = {**LAW, "a": {**TAPER, "inside": 0.01, "outside": 0.02}, "V_w": {**TAPER, "inside": 0.1, "outside": 1.0}}
    table: Any = line(spacing, law, LOADED * DEEP, EXTRA, 5.0)
    fault = table["faults"]["main"]
    fault["initial_stress"]["normal"], fault["nucleation"]["radius"] = DEEP, RADIUS
    if fluid:
        inside, outside = DRAINS
        fault["pore_pressure"] = {**FLUID, "hydraulic_diffusivity": {**TAPER, "inside": inside, "outside": outside}}
    return table


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    spacings = (50.0, 25.0) if fine else (100.0, 50.0)
    runs = [rupture(case(spacing, True), energies=4) for spacing in spacings]
    dry = rupture(case(spacings[0], False), energies=4)
    checks, speeds = closed_forms(), []
    for each in (*runs, dry):
        arrival, x = each.rupture_time(0.1), each.position
        part = (x > 5e3) & (x < 10e3) & np.isfinite(arrival)
        speeds.append(float(np.polyfit(arrival[part], x[part], 1)[0]) if part.sum() > 10 else 0.0)
    risen = float(runs[-1].fields["pore_pressure"].max()) / DEEP
    ends = [float(each.position[np.isfinite(each.rupture_time(0.1))].max()) for each in (runs[-1], dry)]
    checks += [
        Check(
            "front speed, 5 to 10 km, on both meshes", speeds[1], speeds[0], 0.03, "m/s", "finer mesh", relative=True
        ),
        Check("front speed over that without fluid", 1.0, speeds[0] / max(speeds[2], 1.0), 0, "1", "shape", "at least"),
        Check(
            "distance of the front that stops without fluid over that with it",
            1.0,
            ends[1] / ends[0],
            0,
            "1",
            "shape",
            "at most",
        ),
        Check("largest pressure over the normal stress", 0.5, risen, 0, "1", "shape", "at least"),
        *(each.budget() for each in runs),
    ]
    return Outcome(checks, lambda: _draw([*runs, dry], spacings))


def _draw(runs: list[Rupture], spacings: tuple[float, float]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, (axes,) = new_figure(1, 2, 3.2, 8)
    labels = [*(f"with fluid, {spacing:g} m" for spacing in spacings), "without"]
    for each, label in zip(runs, labels, strict=True):
        axes[0].plot(each.position / 1e3, each.rupture_time(0.1), lw=1, label=label)
        if "pore_pressure" in each.fields:
            axes[1].plot(each.position / 1e3, each.fields["pore_pressure"] / 1e6, lw=1, label=label)
    axes[0].set(xlabel="x (km)", ylabel="Rupture time (s)")
    axes[0].legend(loc="upper left")
    axes[1].set(xlabel="x (km)", ylabel="Pore pressure at the end (MPa)")
    return figure
