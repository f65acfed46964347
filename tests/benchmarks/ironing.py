"""A curved body is pressed on a flat one and dragged along it: forces without element noise.

A cylinder of 5 mm (upper, 5.3 GPa) on a plane (lower, 3.392 GPa) in plane strain, pressed by the motion of its top
until contact is about 0.4 mm wide, then dragged at constant height with friction 0.3 over two elements of the plane.
On an infinite plane nothing would change; here the forces drift with the distance from its ends along a smooth curve,
which is taken off: what is left repeats with the elements. In explicit steps the bodies are damped, and the elements
at the interface have a Kelvin-Voigt layer: without that they ring at order 4, by 27 % of the shear force. Implicit
steps go from equilibrium to equilibrium.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks._cases import case_of, table_of
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.platform import fem, parallel
from ruptfx.run import stages
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BODIES = table_of("ironing")
SIZE, RATIO = BODIES["mesh"]["upper"]["element_size"], 1.37  # of the upper body; that of the lower one's over it
DEPTH, FRICTION = 12e-6, BODIES["faults"]["main"]["friction"]["mu_d"]
HELD = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
PRESS, RAMP, SPEED = 20e-6, 15e-6, 10.0
WAY = 2 * RATIO * SIZE
SETTLED = 0.2e-3  # sliding distance before the evaluation of forces [m]

Floats = NDArray[np.float64]


def case(order: int) -> Case:
    """Return the explicit case: pressed, damped to rest, dragged at 10 m/s."""

    def edges(speed: tuple[float, float], ramp: float) -> list[Table]:
        return [*HELD, *(
            {"kind": "driven", "edge": "upper.top", "component": axis, "velocity": value, "ramp": ramp}
            for axis, value in zip("xy", speed, strict=True)
        )]  # fmt: skip

    down = 5e-6
    slide = (SETTLED + WAY) / SPEED + 0.5 * RAMP
    return _case(order, "forward_lagrange", {
        "duration": PRESS + slide, "damping": {"mass": 1e6, "kelvin_voigt": {"fraction": 0.1}}, "stages": [
            {"duration": down, "boundaries": edges((0.0, -DEPTH / down), 0.0)},
            {"duration": PRESS - down, "boundaries": edges((0.0, 0.0), 1e-6)},
            {"duration": slide, "boundaries": edges((SPEED, 0.0), RAMP)},
        ],
    })  # fmt: skip


def implicit(order: int) -> Case:
    """Return the implicit case: pressed within a second, dragged by a twentieth of an element per step."""
    step = 0.05
    speed = RATIO * SIZE / (20 * step)
    moves = {"y": ("displacement", [0.0, 1.0], [0.0, -DEPTH]), "x": ("velocity", [1.0, 1.1], [0.0, speed])}
    return _case(order, "augmented_lagrangian", {
        "duration": 1.05 + (SETTLED + WAY) / speed,
        "boundaries": [*HELD, *(
            {"kind": "moved", "edge": "upper.top", "component": axis, "quantity": what, "times": t, "values": values}
            for axis, (what, t, values) in moves.items()
        )],
        "stepper": {"kind": "quasi_static", "first_step": step, "largest_step": step},
    })  # fmt: skip


def _case(order: int, contact: str, table: Table) -> Case:
    return case_of("ironing", {
        "order": order, "mesh.curve_order": min(order, 2), "mesh.lower.element_size": RATIO * SIZE,
        "faults.main.contact": {"kind": contact}, **table,
    })  # fmt: skip


def forces(given: Case, comm: fem.MPI.Comm) -> tuple[Floats, Floats]:
    """Return the way of the top [m] and the force along y and x on the lower body [N/m], over two elements."""
    model = Model(given, comm)
    motion, state, face = stages.bind(model), model.initial_state(), model.faults[0].interface
    end = given.duration
    ways, found = [], []
    while state.time < end - 1e-9 * end:
        motion.step(state)
        way = _way(given, state.fault_time) - SETTLED
        if way < 0:
            continue
        fault = state.faults["main"]
        local = np.column_stack([-fault["normal_stress"], fault["shear_traction"]])
        here = np.einsum("i,ik,ikc->c", face.owned * face.weight, local, face.frame)
        ways.append(way)
        found.append(parallel.total(comm, here.tolist()))
    return np.array(ways), np.abs(np.array(found))


def _way(given: Case, time: float) -> float:
    """Return the distance by which the top has been dragged [m]."""
    if given.stages:
        return SPEED * (time - PRESS - 0.5 * RAMP)
    return (SETTLED + WAY) * (time - 1.05) / (given.duration - 1.05)


def noise(way: Floats, force: Floats) -> float:
    """Return peak to peak over the mean, after subtraction of a parabola."""
    return float(np.ptp(force - np.polyval(np.polyfit(way / WAY, force, 2), way / WAY)) / force.mean())


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    checks, curves = [], {}
    for kind, make in (("explicit", case), ("implicit", implicit)):
        for order in (1, 2, 4) if fine else (2,):
            way, force = forces(make(order), comm)
            curves[kind, order] = way, force
            name = f"{kind}, order {order}"
            checks += [
                Check(f"{name}: {axis} force, peak to peak over the mean", 0.0, noise(way, values), 0.02, "1", "aim")
                for axis, values in (("shear", force[:, 0]), ("normal", force[:, 1]))
            ]
            ratio = float(force[:, 0].mean() / force[:, 1].mean())
            checks.append(Check(f"{name}: ratio of the forces", FRICTION, ratio, 0.01, "1", "friction"))
    return Outcome(checks, lambda: _draw(curves))


def _draw(curves: dict[tuple[str, int], tuple[Floats, Floats]]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((axes,),) = new_figure(1, 1, 3, 5)
    for number, ((kind, order), (way, force)) in enumerate(curves.items()):
        for name, values, style in (("normal", force[:, 1], "-"), ("shear", force[:, 0], ":")):
            label = f"{name}, {kind}, order {order}"
            axes.plot(way / (RATIO * SIZE), values / values.mean(), style, color=f"C{number}", lw=1, label=label)
    axes.set(xlabel="Way over the size of an element", ylabel="Force over its mean", ylim=(0.97, 1.03))
    axes.legend(frameon=False, ncols=2, fontsize="small")
    return figure
