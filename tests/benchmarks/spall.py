"""A compressive pulse returns from the free end of a bar as tension and breaks its end off: spalling.

Without lateral contraction waves are plane: P = sigma - rho c v keeps its value along dx/dt = c, Q = sigma + rho c v
along dx/dt = -c. At a plane that may break, with P from the left and Q from the right,

    d(delta)/dt = (Q + P - 2 T) / (rho c),

and T is the cohesive traction, at most the strength f_t (1 - delta / delta_c). On a lattice with steps of dx / c
that is exact but for the opening, of first order in dx = 0.01 mm. The pulse rises in 0.4 us and falls for 6 us. Behind
the front of the reflected pulse the tension is 2 sigma_0 x / (c t_fall) at the distance x from the end, f_t at 4.5 mm.
Two planes may break, 8 and 16 mm from the end; nothing else does. What is off is the dispersion of steep waves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks._broken import openings, rigid
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

YOUNG, DENSITY = 50e9, 2600.0
SPEED = float(np.sqrt(YOUNG / DENSITY))
STRENGTH, ENERGY = 4e6, 2.0
LENGTH, WIDTH, PLANES, APART = 40e-3, 2e-3, 2, 8e-3
STRESS, RISE = 12e6, 0.4e-6
FALL = 4.5e-3 * 2 * STRESS / (STRENGTH * SPEED)
END = 15e-6  # s
SOURCE = "characteristics"


@dataclass(frozen=True)
class Spalled:
    """Result of a run.

    Attributes
    ----------
    time, velocity : ndarray, shape (samples,)
        Of the free end [s, m/s].
    openings : ndarray, shape (planes,)
        At the end of the run, by their distance from the free end [m].
    scab : float
        Mean velocity at the end of the part beyond the first plane [m/s].
    closure : float
    """

    time: np.ndarray
    velocity: np.ndarray
    openings: np.ndarray
    scab: float
    closure: float = 0.0


def pulse(time: np.ndarray | float) -> np.ndarray:
    """Return the pressure on the loaded end over its largest value."""
    return np.asarray(np.interp(time, [0.0, RISE, RISE + FALL], [0.0, 1.0, 0.0]))


def exact(step: float = 1e-5) -> Spalled:
    """Return the solution along characteristics, on a lattice of spacing `step` [m]."""
    count, dt, impedance = round(LENGTH / step), step / SPEED, DENSITY * SPEED
    at = count - np.round(APART * np.arange(1, PLANES + 1) / step).astype(int)  # nodes of the planes
    right, left = np.zeros(count), np.zeros(count)  # P at the left end of every cell, Q at the right end
    opening, largest, critical = np.zeros(PLANES), np.zeros(PLANES), 2 * ENERGY / STRENGTH
    times, velocities = [], []
    for n in range(round(END / dt)):
        # To the nodes, each half a cell away on both sides.
        arrived_right, arrived_left = right.copy(), left.copy()
        pressure = STRESS * float(pulse((n + 1) * dt))
        into_right, into_left = np.empty(count), np.empty(count)
        into_right[1:], into_left[:-1] = arrived_right[:-1], arrived_left[1:]
        into_right[0] = -2 * pressure - arrived_left[0]  # sigma = -p: P = 2 sigma - Q
        into_left[-1] = -arrived_right[-1]  # sigma = 0
        P, Q = arrived_right[at - 1], arrived_left[at]
        held = np.where(largest < critical, STRENGTH * (1 - largest / critical), 0.0)
        secant = np.where((opening < largest) & (largest > 0), np.maximum(opening, 0) / np.maximum(largest, 1e-30), 1.0)
        closing = 0.5 * (P + Q) + 0.5 * impedance * opening / dt  # stops, and closes what is open
        traction = np.where(closing < 0, closing, np.minimum(held * secant, closing))
        opening = np.maximum(opening + dt * (P + Q - 2 * traction) / impedance, 0.0)
        largest = np.maximum(largest, opening)
        into_right[at], into_left[at - 1] = 2 * traction - Q, 2 * traction - P
        right, left = into_right, into_left
        times.append((n + 1) * dt)
        velocities.append(-arrived_right[-1] / impedance)
    beyond = slice(at[0], None)
    mean = float(np.mean(left[beyond] - right[beyond])) / (2 * impedance)
    return Spalled(np.array(times), np.array(velocities), opening, mean)


def bar(size: float) -> Case:
    """Return the case with intrinsic facets."""
    planes = [0.5 * LENGTH - APART * (i + 1) for i in range(PLANES)]
    never = {"kind": "linear", "f_t": 1e12, "c": 1e12, "G_Ic": 1e6, "G_IIc": 1e6}
    bond = {"kind": "linear", "f_t": STRENGTH, "c": 1e9, "G_Ic": ENERGY, "G_IIc": 1e6}
    rubs = {"kind": "coulomb", "mu_d": 0.0}
    times = [0.0, RISE, RISE + FALL]
    return Case.model_validate({
        "plane": "strain", "order": 1, "duration": END,
        "mesh": {
            "kind": "specimen", "shape": {"kind": "rectangle", "width": WIDTH, "height": LENGTH}, "element_size": size,
            "joints": {f"plane{i + 1}": [-0.5 * WIDTH, y, 0.5 * WIDTH, y] for i, y in enumerate(planes)},
        },
        "materials": {"default": {
            "kind": "isotropic_elastic", "young_modulus": YOUNG, "poisson_ratio": 0.0, "density": DENSITY,
        }},
        "fracture": {
            "kind": "intrinsic", "stiffness_ratio": 30.0, "default": {"cohesion": never, "friction": rubs},
            "joints": {f"plane{i + 1}": {"cohesion": bond, "friction": rubs} for i in range(PLANES)},
        },
        "boundaries": [{
            "kind": "traction", "edge": "specimen.bottom", "traction": [0.0, STRESS],
            "history": {"kind": "sampled", "times": times, "values": [0.0, 1.0, 0.0]},
        }],
    })  # fmt: skip


def spalled(case: Case) -> Spalled:
    """Run a case in memory."""
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    y, mass = model.coordinates[:, 1], model.mass.reshape(-1, 2)[:, 1]
    top = np.flatnonzero(y > 0.5 * LENGTH - 1e-9)
    cells = model.space.dofmap.list
    beyond = cells[y[cells].mean(axis=1) > 0.5 * LENGTH - APART].ravel()
    times, velocities, lost, work = [], [], [0.0], 1e-300
    while state.time < END:
        motion.step(state)
        velocity = state.velocity.reshape(-1, 2)[:, 1]
        times.append(state.at_velocity()[0])
        velocities.append(velocity[top] @ mass[top] / mass[top].sum())
        if state.step % 50 == 0:
            energy = motion.energies(state)
            lost.append(energy["boundary_work"] - sum(v for name, v in energy.items() if name != "boundary_work"))
            work = max(work, abs(energy["boundary_work"]))
    opened = openings(model, state)
    scab = float(velocity[beyond] @ mass[beyond] / mass[beyond].sum())
    found = np.array([opened[f"plane{i + 1}"] for i in range(PLANES)])
    return Spalled(np.array(times), np.array(velocities), found, scab, float(np.max(np.abs(lost))) / work)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    known, case = exact(), bar(0.125e-3 if fine else 0.25e-3)
    found = {"extrinsic": spalled(rigid(case)), "intrinsic": spalled(case)}
    checks = []
    for kind, each in found.items():
        whole = float(np.sqrt(np.mean(known.velocity**2)))
        error = np.interp(each.time, known.time, known.velocity) - each.velocity
        checks += [
            Check(f"{kind}: openings of planes, largest error over the widest", 0.0,
                  float(np.max(np.abs(each.openings - known.openings)) / known.openings.max()), 0.04, "1", SOURCE),
            Check(f"{kind}: velocity of the scab", known.scab, each.scab, 0.01, "m/s", SOURCE, relative=True),
            Check(f"{kind}: velocity of the free end, rms error over rms", 0.0,
                  float(np.sqrt(np.mean(error**2))) / whole, 0.08, "1", SOURCE),
            Check(f"{kind}: energy closure", 0.0, each.closure, 1e-10, "1", "exact"),
        ]  # fmt: skip
    return Outcome(checks, lambda: _draw(known, found))


def _draw(known: Spalled, found: dict[str, Spalled]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((left, right),) = new_figure(1, 2, 2.6, 7)
    left.plot(1e6 * known.time, known.velocity, "k", lw=0.8, label="characteristics")
    right.plot(np.arange(1, PLANES + 1), 1e6 * known.openings, "k_", ms=12)
    for number, (kind, each) in enumerate(found.items()):
        left.plot(1e6 * each.time, each.velocity, f"C{number}", lw=0.8, label=kind)
        right.plot(np.arange(1, PLANES + 1), 1e6 * each.openings, f"C{number}{'ox'[number]}", mfc="none")
    left.set(xlabel="Time (µs)", ylabel="Velocity of the free end (m/s)")
    left.legend(frameon=False, fontsize=7)
    right.set(xlabel="Plane", ylabel="Opening (µm)", xlim=(0, PLANES + 1), ylim=(0, None))
    right.set_xticks(range(1, PLANES + 1))
    return figure
