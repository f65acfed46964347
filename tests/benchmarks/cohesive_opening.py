"""A crack opens across a bar that is pulled at a steady rate: the exact opening of a cohesive interface.

Plane strain without lateral contraction. At t = 0 the stress is f_t everywhere and grows with E strain_rate t. The
waves that the crack sends out are plane, so that its opening follows the equation

    (rho c / 2) d(delta)/dt = f_t + E strain_rate t - T(delta)

(cf. Drugan 2001). With linear softening, tau = rho c delta_c / (2 f_t),

    delta = (2 E strain_rate / (rho c)) tau^2 (exp(t / tau) - 1 - t / tau);

other laws are integrated (SciPy, tolerance 1e-10). Ends are so far that their waves come too late.

Three ways: a cohesive interface between elements of order 2; a joint of a mesh of triangles whose facets
are extrinsic; the same with intrinsic facets, alpha = 100, compensated. Bodies with facets
are pulled at that rate from rest, so that the springs extend together with the body.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from pydantic import TypeAdapter
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from benchmarks._broken import openings, rigid
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.laws.cohesion import AnyCohesion, CohesiveLaw
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

YOUNG, DENSITY, STRAIN_RATE = 50e9, 2600.0, 50.0
BOND: Table = {"f_t": 4e6, "c": 8e6, "G_Ic": 2.0, "G_IIc": 8.0}
SPEED = np.sqrt(YOUNG / DENSITY)
PARTS = (0.2, 0.5, 0.8, 1.0)  # of the opening at failure
LENGTH = 5e-3  # of either half
WIDTH = 2e-3  # of the bar of triangles
AT_REST = BOND["f_t"] / (YOUNG * STRAIN_RATE)  # s, before the stress is f_t
SOURCE = "wave equation; cf. Drugan (2001)"


def law_of(kind: str) -> CohesiveLaw:
    """Return the cohesive law of a kind."""
    return TypeAdapter(AnyCohesion).validate_python({"kind": kind, **BOND})


def exact(kind: str) -> np.ndarray:
    """Return the times at which the opening reaches the fractions `PARTS` of that at failure [s]."""
    law = law_of(kind)
    end, impedance = law.opening_at_failure, DENSITY * SPEED

    def rate(t: float, opening: np.ndarray) -> np.ndarray:
        left = law.remaining_fraction(np.minimum(opening / end, 1.0))
        return np.asarray(2 / impedance * (law.f_t * (1 - left) + YOUNG * STRAIN_RATE * t))

    def reached(part: float) -> object:
        return lambda t, opening: opening[0] - part * end

    found = solve_ivp(rate, (0, 4e-6), [0.0], rtol=1e-10, atol=1e-10 * end, events=[reached(part) for part in PARTS])
    return np.array([times[0] for times in found.t_events])


def linear() -> np.ndarray:
    """Return the same times in closed form for linear softening."""
    end = law_of("linear").opening_at_failure
    tau = DENSITY * SPEED * end / (2 * BOND["f_t"])
    time = np.linspace(0, 4e-6, 200001)
    opening = 2 * YOUNG * STRAIN_RATE / (DENSITY * SPEED) * tau**2 * (np.exp(time / tau) - 1 - time / tau)
    return np.interp(np.array(PARTS) * end, opening, time)


STIFF: Table = {"kind": "isotropic_elastic", "young_modulus": YOUNG, "poisson_ratio": 0.0, "density": DENSITY}


def pulled(ends: dict[str, float]) -> list[Table]:
    """Return the boundaries that move edges at the steady rate, from the coordinates of the edges."""
    return [{"kind": "driven", "edge": edge, "component": "y", "velocity": STRAIN_RATE * y} for edge, y in ends.items()]


def interface(kind: str, size: float) -> Case:
    """Return a bar that begins at f_t, with elements of that size."""
    return Case.model_validate({
        "plane": "strain", "order": 2, "duration": 2.2e-6,
        "mesh": {"kind": "two_plates", "length": size, "height": LENGTH, "element_size": size},
        "materials": {"default": STIFF},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 0.5},
            "cohesion": {"kind": kind, **BOND}, "initial_stress": {"tensor": [0.0, BOND["f_t"], 0.0]},
        }},
        "boundaries": pulled({"upper.top": LENGTH, "lower.bottom": -LENGTH}),
    })  # fmt: skip


def triangles(kind: str, size: float) -> Case:
    """Return a bar that begins at rest, with intrinsic facets."""
    never = {"kind": "linear", "f_t": 1e12, "c": 1e12, "G_Ic": 1e6, "G_IIc": 1e6}
    rubs = {"kind": "coulomb", "mu_d": 0.5}
    return Case.model_validate({
        "plane": "strain", "order": 1, "duration": 2.2e-6 + AT_REST,
        "mesh": {
            "kind": "specimen", "shape": {"kind": "rectangle", "width": WIDTH, "height": 2 * LENGTH},
            "element_size": size, "joints": {"plane": [-0.5 * WIDTH, 0.0, 0.5 * WIDTH, 0.0]},
        },
        "materials": {"default": STIFF},
        "fracture": {
            "kind": "intrinsic", "stiffness_ratio": 100.0, "default": {"cohesion": never, "friction": rubs},
            "joints": {"plane": {"cohesion": {"kind": kind, **BOND}, "friction": rubs}},
        },
        "boundaries": pulled({"specimen.top": LENGTH, "specimen.bottom": -LENGTH}),
    })  # fmt: skip


def opened(case: Case, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times since the stress was f_t [s] and openings [m], up to the opening `end`."""
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    state.velocity.reshape(-1, 2)[:, 1] = STRAIN_RATE * model.coordinates[:, 1]
    begun = AT_REST if case.fracture is not None else 0.0
    time, opening = [], []
    while state.time < case.duration:
        motion.step(state)
        now = state.faults["main"]["opening"].mean() if not begun else openings(model, state)["plane"]
        time.append(state.fault_time - begun)
        opening.append(float(now))
        if opening[-1] > end:
            break
    return np.array(time), np.array(opening)


Way = tuple[Callable[[str, float], Case], list[float], float]
WAYS: dict[str, Way] = {
    "interface": (interface, [2.5e-3, 0.5e-3, 0.25e-3, 0.125e-3], 5e-3),
    "rigid facets": (lambda *of: rigid(triangles(*of), check_every=1), [1e-3, 0.5e-3, 0.25e-3, 0.125e-3], 5e-3),
    "springs": (triangles, [1e-3, 0.5e-3, 0.25e-3, 0.125e-3], 1.5e-2),
}  # fmt: skip
"""Case by law and size, sizes [m], of which the last is fine, and the aim at the second."""


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    checks, curves = [], []
    known = exact("linear")
    checks.append(Check("times of linear softening, integrated", 0.0, float(np.max(np.abs(known / linear() - 1))), 1e-6,
                        "1", "closed form"))  # fmt: skip
    for (way, (case, sizes, aim)), kind in product(WAYS.items(), ("linear", "munjiza")):
        known, end, errors = exact(kind), float(np.asarray(law_of(kind).opening_at_failure)), []
        for size in sizes[: None if fine else 3]:
            time, opening = opened(case(kind, size), end)
            begun = opening > 0.01 * end
            reached = CubicSpline(opening[begun], time[begun])(np.array(PARTS) * end)
            errors.append(float(np.max(np.abs(reached / known - 1))))
        checks.append(Check(f"{way}, {kind}: error of times at elements of 0.5 mm", 0.0, errors[1], aim, "1", SOURCE))
        if way != "springs":
            order = float(np.log(errors[0] / errors[-1]) / np.log(sizes[0] / size))
            checks.append(Check(f"{way}, {kind}: order", 1.7, order, 0.0, "1", "leapfrog", "at least"))
        if kind == "linear":
            curves.append((way, time, opening / end))
    return Outcome(checks, lambda: _draw(curves))


def _draw(curves: list[tuple[str, np.ndarray, np.ndarray]]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((ax,),) = new_figure(1, 1, 3.0, 5)
    for number, (way, time, opening) in enumerate(curves):
        ax.plot(1e6 * time, opening, f"C{number}{('-', '--', ':')[number]}", lw=1 + 0.5 * number, label=way)
    ax.plot(1e6 * exact("linear"), PARTS, "ko", mfc="none", label="wave equation")
    ax.set(xlabel="Time (µs)", ylabel="opening / opening at failure", xlim=(0, None), ylim=(0, 1.05))
    ax.legend(frameon=False)
    return figure
