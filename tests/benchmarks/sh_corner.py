"""SH waves of a force and of a moment inside of a quarter space, against the sum of a source and its three images.

Antiplane, c_s 2000 m/s, Ricker wavelet f of 10 Hz. A line force in an infinite body moves what is at the distance r by

    w = 1 / (2 pi mu) integral of f(t - (r / c_s) cosh s) over s from 0 to infinity

and free edges at right angles mirror it: every image has the sign of the source. A moment is the derivative with
respect to the place of the source. The source is not at a node.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.app.bench._rupture import elastic
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

C_P, C_S, RHO = 3464.0, 2000.0, 2000.0
FREQUENCY, DELAY, DURATION = 10.0, 0.15, 0.75
LENGTH, HEIGHT = 1250.0, 700.0
PLACE = (303.7, 391.3)  # m, from the left edge and below the upper one
RECEIVERS = {"corner": (0.0, 0.0), "upper edge": (600.0, 0.0), "left edge": (0.0, 700.0), "inside": (700.0, 300.0)}
SOURCES = {"point_force": {"force": [1e6]}, "moment": {"moment": [4e7, 3e7]}}
SOURCE = "Aki and Richards (2002), images"


def case(size: float, kind: str) -> Table:
    """Return a quarter space so large that echoes of its far ends come too late; its two plates are glued."""
    glued = {
        "contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 1.0},
        "initial_stress": {"normal": 1e7},
    }  # fmt: skip
    source = {
        "kind": kind, "point": [PLACE[0], HEIGHT - PLACE[1]], **SOURCES[kind],
        "history": {"kind": "ricker", "frequency": FREQUENCY, "delay": DELAY},
    }  # fmt: skip
    return {
        "plane": "antiplane", "order": 4, "duration": DURATION, "stepper": {"kind": "leapfrog", "safety": 0.5},
        "mesh": {"kind": "two_plates", "length": LENGTH, "height": HEIGHT, "element_size": size},
        "materials": {"default": elastic(C_P, C_S, RHO)}, "faults": {"main": glued}, "boundaries": [source],
    }  # fmt: skip


def exact(kind: str, receiver: tuple[float, float], time: np.ndarray) -> np.ndarray:
    """Return the displacement of a receiver [m], shape (times,)."""
    if kind == "point_force":
        return 1e6 * line_force(PLACE, receiver, time)
    x, y = PLACE
    h = 0.1  # m, of 200 m from crest to crest
    along = (line_force((x + h, y), receiver, time) - line_force((x - h, y), receiver, time)) / (2 * h)
    down = (line_force((x, y + h), receiver, time) - line_force((x, y - h), receiver, time)) / (2 * h)
    return 4e7 * along - 3e7 * down  # depth grows against y


def line_force(place: tuple[float, float], receiver: tuple[float, float], time: np.ndarray) -> np.ndarray:
    """Return the displacement of a receiver [m] by a unit force and its images, shape (times,)."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    result = np.zeros(len(time))
    for side in (1, -1):
        for above in (1, -1):
            delay = np.hypot(receiver[0] - side * place[0], receiver[1] - above * place[1]) / C_S
            end = np.arccosh(np.maximum(time / delay, 1.0))
            s = 0.5 * end[:, None] * (nodes + 1)
            a = (np.pi * FREQUENCY * (time[:, None] - delay * np.cosh(s) - DELAY)) ** 2
            result += 0.5 * end * (((1 - 2 * a) * np.exp(-a)) @ weights)
    return result / (2 * np.pi * RHO * C_S**2)


def seismograms(size: float, kind: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return times, displacement of the receivers, shape (times, receivers) [m], and energy closure."""
    problem = Case.model_validate(case(size, kind))
    model = Model(problem, fem.MPI.COMM_SELF)
    motion, state = problem.stepper.bind(model), model.initial_state()
    upper = model.layout.body == model.bodies.names.index("upper")
    nodes = []
    for x, depth in RECEIVERS.values():
        away = np.hypot(*(model.coordinates - [x, HEIGHT - depth]).T)
        nodes.append(int(np.argmin(np.where(upper, away, np.inf))))
    times, found = [0.0], [np.zeros(len(nodes))]
    while state.time < DURATION:
        motion.step(state)
        if state.step % 5 == 0:
            times.append(state.time)
            found.append(state.displacement[nodes].copy())
    energy = motion.energies(state)
    lost = 2 * energy["boundary_work"] - sum(energy.values())
    return np.array(times), np.array(found), abs(lost / energy["boundary_work"])


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    checks, drawn = [], {}
    for kind in SOURCES:
        time, found, closure = seismograms(12.5 if fine else 25.0, kind)
        reference = np.stack([exact(kind, place, time) for place in RECEIVERS.values()], axis=1)
        drawn[kind] = time, found, reference
        for i, name in enumerate(RECEIVERS):
            worst = float(np.abs(found[:, i] - reference[:, i]).max() / np.abs(reference[:, i]).max())
            checks.append(Check(f"{kind}, {name}: largest misfit over peak", 0.0, worst, 0.02, "1", SOURCE))
        checks.append(Check("energy closure", 0.0, closure, 1e-3, "1", "exact"))
    return Outcome(checks, lambda: _draw(drawn))


def _draw(drawn: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, (axes,) = new_figure(1, 2, 3.2, 8, sharex=True)
    for ax, (kind, (time, found, reference)) in zip(axes, drawn.items(), strict=True):
        for i, name in enumerate(RECEIVERS):
            ax.plot(time, 1e3 * found[:, i], label=name)
            ax.plot(time, 1e3 * reference[:, i], "k:", lw=1)
        ax.set(xlabel="time (s)", title=kind.replace("_", " "), xlim=(0, DURATION))
    axes[0].set_ylabel("displacement (mm)")
    axes[0].legend(frameon=False)
    return figure
