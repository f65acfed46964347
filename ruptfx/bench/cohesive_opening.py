"""A crack opens across a bar that is pulled at a steady rate: the exact opening of a cohesive interface.

Plane strain without lateral contraction. At t = 0 the stress is f_t everywhere and grows with E strain_rate t. The
waves that the crack sends out are plane, so that its opening follows the equation

    (rho c / 2) d(delta)/dt = f_t + E strain_rate t - T(delta)

(cf. Drugan 2001). With linear softening, tau = rho c delta_c / (2 f_t),

    delta = (2 E strain_rate / (rho c)) tau^2 (exp(t / tau) - 1 - t / tau);

other laws are integrated (SciPy, tolerance 1e-10). Ends are so far that their waves come too late.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import TypeAdapter
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from ruptfx import Table
from ruptfx.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.cohesion import AnyCohesion, CohesiveLaw
from ruptfx.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.fem import MPI

YOUNG, DENSITY, STRAIN_RATE = 50e9, 2600.0, 50.0
BOND: Table = {"f_t": 4e6, "c": 8e6, "G_Ic": 2.0, "G_IIc": 8.0}
SPEED = np.sqrt(YOUNG / DENSITY)
PARTS = (0.2, 0.5, 0.8)  # of the opening at failure
LENGTH = 5e-3  # of either half
SOURCE = "wave equation; cf. Drugan (2001)"


def law_of(kind: str) -> CohesiveLaw:
    return TypeAdapter(AnyCohesion).validate_python({"kind": kind, **BOND})


def exact(kind: str) -> np.ndarray:
    """When the opening has reached `PARTS` of that at failure [s]."""
    law = law_of(kind)
    end, impedance = law.opening_at_failure, DENSITY * SPEED

    def rate(t: float, opening: np.ndarray) -> np.ndarray:
        left = law.left(np.minimum(opening / end, 1.0))
        return np.asarray(2 / impedance * (law.f_t * (1 - left) + YOUNG * STRAIN_RATE * t))

    def reached(part: float) -> object:
        return lambda t, opening: opening[0] - part * end

    found = solve_ivp(rate, (0, 4e-6), [0.0], rtol=1e-10, atol=1e-10 * end, events=[reached(part) for part in PARTS])
    return np.array([times[0] for times in found.t_events])


def linear() -> np.ndarray:
    """The same in closed form for linear softening."""
    end = law_of("linear").opening_at_failure
    tau = DENSITY * SPEED * end / (2 * BOND["f_t"])
    time = np.linspace(0, 4e-6, 200001)
    opening = 2 * YOUNG * STRAIN_RATE / (DENSITY * SPEED) * tau**2 * (np.exp(time / tau) - 1 - time / tau)
    return np.interp(np.array(PARTS) * end, opening, time)


def opened(kind: str, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and openings [m] of a bar with elements of that size."""
    law = law_of(kind)
    ends = {"upper.top": LENGTH, "lower.bottom": -LENGTH}
    case = Case.model_validate({
        "plane": "strain", "order": 2, "duration": 2.2e-6,
        "mesh": {"kind": "two_plates", "length": size, "height": LENGTH, "element_size": size},
        "materials": {"default": {
            "kind": "isotropic_elastic", "young_modulus": YOUNG, "poisson_ratio": 0.0, "density": DENSITY,
        }},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": {"kind": "coulomb", "mu_d": 0.5},
            "cohesion": {"kind": kind, **BOND}, "initial_stress": {"tensor": [0.0, BOND["f_t"], 0.0]},
        }},
        "boundaries": [
            {"kind": "driven", "edge": edge, "component": "y", "velocity": STRAIN_RATE * y} for edge, y in ends.items()
        ],
    })  # fmt: skip
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    state.velocity.reshape(-1, 2)[:, 1] = STRAIN_RATE * model.coordinates[:, 1]
    time, opening = [], []
    while state.time < case.duration:
        motion.step(state)
        time.append(state.fault_time)
        opening.append(float(state.faults["main"]["opening"].mean()))
        if opening[-1] > law.opening_at_failure:
            break
    return np.array(time), np.array(opening)


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    sizes = [2.5e-3, 0.5e-3, 0.25e-3, *([0.125e-3] if fine else [])]
    checks, curves = [], []
    known = exact("linear")
    checks.append(Check("times of linear softening, integrated", 0.0, float(np.max(np.abs(known / linear() - 1))), 1e-6,
                        "1", "closed form"))  # fmt: skip
    for kind in ("linear", "munjiza"):
        known, errors = exact(kind), []
        for size in sizes:
            time, opening = opened(kind, size)
            end = law_of(kind).opening_at_failure
            begun = opening > 0.01 * end
            reached = CubicSpline(opening[begun], time[begun])(np.array(PARTS) * end)
            errors.append(float(np.max(np.abs(reached / known - 1))))
        checks.append(Check(f"{kind}: error of times at elements of 0.5 mm", 0.0, errors[1], 5e-3, "1", SOURCE))
        order = float(np.log(errors[0] / errors[-1]) / np.log(sizes[0] / sizes[-1]))
        checks.append(Check(f"{kind}: order", 1.7, order, 0.0, "1", "leapfrog", "at least"))
        curves.append((kind, time, opening / end, known))
    return Outcome(checks, lambda: _draw(curves))


def _draw(curves: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]) -> Figure:
    from ruptfx.figure_style import new_figure

    figure, ((ax,),) = new_figure(1, 1, 3.0, 5)
    for number, (kind, time, opening, known) in enumerate(curves):
        ax.plot(1e6 * time, opening, f"C{number}", lw=1, label=kind)
        ax.plot(1e6 * known, PARTS, f"C{number}o", mfc="none")
    ax.set(xlabel="Time (µs)", ylabel="opening / opening at failure")
    ax.legend(frameon=False)
    return figure
