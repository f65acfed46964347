"""Two elastic bars collide: time, pressure and duration of contact, and their speed afterwards.

E = 900 Pa, rho = 1 kg/m3, 10 m long, 10 m/s each, 10 m apart, of different elements; each is the mirror image of the
other, so that either does what a bar does that meets a rigid wall (Doyen, Ern, Piperno 2011): with c = 30 m/s contact
from 0.5 s to 0.5 s + 2 L / c = 1.1667 s at the pressure rho c v = 300 Pa, after which the bars leave with 10 m/s. Nodes
of rigid contact have mass and ring; the Kelvin-Voigt layer takes most of that. Springs in contact, without that layer,
give all energy back (ten times stiffer ones, which chatter, let the undamped bars buckle). Before they meet, the bars
are too far apart to face each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks._cases import case_of, table_of
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPEED = 10.0
BARS = table_of("impact_bar")["mesh"]
GAP, LENGTH, WIDTH = BARS["closest"], BARS["upper"]["height"], BARS["upper"]["length"]
WAVE, PRESSURE = 30.0, 300.0
BEGIN = 0.5 * GAP / SPEED
END = BEGIN + 2 * LENGTH / WAVE

Floats = NDArray[np.float64]


RIGID = {"kind": "forward_lagrange"}
SPRINGS = {"kind": "compliant", "C_n": 1e4, "C_s": 1e4}  # 3 cm at the pressure, a quarter of the distance of nodes


def case(size: float, contact: Table, damping: Table) -> Case:
    """Return the case with elements of some size in the upper bar [m]; the lower one has one more across."""
    return case_of("impact_bar", {
        "mesh.upper.element_size": size, "mesh.lower.element_size": WIDTH / (WIDTH / size + 1),
        "faults.main.contact": contact, "damping": damping,
    })  # fmt: skip


@dataclass
class Impact:
    """Result of an impact.

    Attributes
    ----------
    time, pressure : ndarray
        [s], [Pa]
    leaves : float
        Mean speed of the upper bar at the end [m/s].
    change : float
        Absolute change of the energy of bodies and contact over the initial energy.
    """

    time: Floats
    pressure: Floats
    leaves: float
    change: float


def collide(given: Case, comm: fem.MPI.Comm) -> Impact:
    """Run a case and return its pressure history and final speed; collective."""
    model = Model(given, comm)
    motion, state, face = given.stepper.bind(model), model.initial_state(), model.faults[0].interface
    upper = model.layout.body == 0
    state.velocity.reshape(-1, 2)[:, 1] = np.where(upper, -SPEED, SPEED)
    mass = model.mass.reshape(-1, 2)[:, 1] * (np.arange(model.nodes) < model.owned_nodes)
    times, pressures = [], []
    while state.time < given.duration:
        motion.step(state)
        times.append(state.fault_time)
        here = face.owned * face.weight
        pressures.append(float(comm.allreduce(here @ state.faults["main"]["normal_stress"])) / WIDTH)
    speed = state.velocity.reshape(-1, 2)[:, 1]
    leaves = comm.allreduce((mass * upper) @ speed) / comm.allreduce((mass * upper).sum())
    began = 0.5 * comm.allreduce(mass.sum()) * SPEED**2
    energies = motion.energies(state)
    change = abs(sum(energies[name] for name in ("kinetic", "strain", "interface_elastic")) - began) / began
    return Impact(np.array(times), np.array(pressures), float(leaves), change)


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    size = 0.25 if fine else 0.5
    rigid = collide(case(size, RIGID, {"kelvin_voigt": {"fraction": 0.1}}), comm)
    springs = collide(case(size, SPRINGS, {}), comm)
    time, pressure = rigid.time, rigid.pressure
    held = (time > BEGIN + 0.05) & (time < END - 0.05)
    closed = time[pressure > 0.1 * PRESSURE]
    source = "Doyen, Ern, Piperno (2011), closed form"
    checks = [
        Check("contact begins", BEGIN, float(closed[0]), 0.01, "s", source, relative=True),
        Check("contact ends", END, float(closed[-1]), 0.005, "s", source, relative=True),
        Check("mean pressure", PRESSURE, float(pressure[held].mean()), 0.002, "Pa", source, relative=True),
        Check("root mean square of its noise", 0.0, float(pressure[held].std() / PRESSURE), 0.025, "1", "aim"),
        Check("speed of leaving", SPEED, rigid.leaves, 0.015, "m/s", source, relative=True),
        Check("with springs: change of energy", 0.0, springs.change, 0.002, "1", "conservation"),
    ]
    return Outcome(checks, lambda: _draw(time, pressure))


def _draw(time: Floats, pressure: Floats) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((axes,),) = new_figure(1, 1, 3, 5)
    axes.plot(time, pressure, lw=0.8, label="two bars, different elements")
    axes.step([0, BEGIN, END, 1.6], [0, PRESSURE, 0, 0], where="post", color="k", ls="--", lw=0.8, label="exact")
    axes.set(xlabel="Time (s)", ylabel="Mean pressure (Pa)")
    axes.legend(frameon=False, loc="center left")
    return figure
