"""Two opposed waves pressed together: pressure, contact width and peak against Westergaard's solution.

Waves of 1 um and 0.6 mm on two bodies of 5.3 and 3.392 GPa in plane strain, without friction, half a wavelength between
walls of symmetry; 12 elements on 9, of order 4. They are pressed in stages of explicit steps, damped to rest in each,
and once more in implicit steps, from equilibrium to equilibrium. With the mean pressure p below p* = pi E* (2 A) /
wavelength, in contact |x| < a (Westergaard 1939; Johnson, Contact Mechanics, 1985, chapter 13)

    p(x) = 2 p cos(psi) sqrt(sin^2 psi_a - sin^2 psi) / sin^2 psi_a,  psi = pi x / wavelength,  sin^2 psi_a = p / p*,

and above p* in full contact p(x) = p + p* cos(2 psi).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks._cases import case_of, table_of
from ruptfx import Table
from ruptfx.app.bench import Check, Outcome
from ruptfx.bodies.state import State
from ruptfx.case import Case
from ruptfx.platform import fem, parallel
from ruptfx.run import stages
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BODIES = table_of("westergaard")
AMPLITUDE, WAVELENGTH = (BODIES["mesh"]["upper"]["profile"][name] for name in ("mean", "wavelength"))
STIFFNESS = 1 / sum((1 - body["poisson_ratio"] ** 2) / body["young_modulus"] for body in BODIES["materials"].values())
FULL = np.pi * STIFFNESS * 2 * AMPLITUDE / WAVELENGTH  # p*: 23.1 MPa
HOLD = 10e-6
HELD = [
    {"kind": "driven", "edge": edge, "component": axis, "velocity": 0.0} for edge, axis in (
        *((f"{body}.{side}", "x") for body in ("upper", "lower") for side in ("left", "right")), ("lower.bottom", "y"),
    )
]  # fmt: skip
SOURCE = "Westergaard (1939), closed form"

Floats = NDArray[np.float64]


def exact(x: Floats, share: float) -> Floats:
    """Return the pressure at x, for a mean pressure over p* [Pa]."""
    psi = np.pi * x / WAVELENGTH
    if share >= 1:
        return FULL * (share + np.cos(2 * psi))
    return 2 * FULL * np.cos(psi) * np.sqrt(np.maximum(share - np.sin(psi) ** 2, 0.0))


def case(shares: tuple[float, ...]) -> Case:
    """Return explicit steps, damped to rest at each share of p*."""
    return _case({
        "duration": HOLD * len(shares), "damping": {"mass": 3e6}, "stages": [
            {"duration": HOLD, "boundaries": [*HELD, _pressed(share, 3e-6)]} for share in shares
        ],
    }, "forward_lagrange")  # fmt: skip


def implicit(share: float, step: float) -> Case:
    """Return equilibria while the pressure grows to a share of p* within a second, in steps of `step`."""
    stepper = {"kind": "quasi_static", "first_step": step, "largest_step": step}
    return _case({
        "duration": 1.0, "stepper": stepper, "boundaries": [*HELD, _pressed(share, 1.0)],
    }, "augmented_lagrangian")  # fmt: skip


def _pressed(share: float, ramp: float) -> dict[str, object]:
    return {"kind": "traction", "edge": "upper.top", "traction": [0.0, -share * FULL], "ramp": ramp}


def _case(table: Table, contact: str) -> Case:
    half = 0.5 * WAVELENGTH
    return case_of("westergaard", {
        "mesh.upper.element_size": half / 12, "mesh.lower.element_size": half / 9,
        "faults.main.contact": {"kind": contact}, **table,
    })  # fmt: skip


def run(fine: bool, comm: fem.MPI.Comm) -> Outcome:
    shares = (0.1, 0.26, 0.5, 0.8, 1.3) if fine else (0.26, 1.3)
    model = Model(case(shares), comm)
    motion, state = stages.bind(model), model.initial_state()
    checks: list[Check] = []
    found = []
    for number, share in enumerate(shares):
        while state.time < HOLD * (number + 1) - 0.5 * motion.dt:
            motion.step(state)
        found.append((share, *pressures(model, state)))
        checks += _checks(*found[-1], "")
    given = implicit(shares[-1], 0.02 if fine else 0.1)
    model = Model(given, comm)
    motion, state = given.stepper.bind(model), model.initial_state()
    for share in shares:
        while state.time < share / shares[-1] - 1e-9:
            motion.step(state)
        checks += _checks(min(state.time, 1.0) * shares[-1], *pressures(model, state), "implicit, ")
    return Outcome(checks, lambda: _draw(found))


def pressures(model: Model, state: State) -> tuple[Floats, Floats, Floats]:
    """Return position [m], length [m] and normal stress [Pa] of all points; collective."""
    face = model.faults[0].interface
    rows = np.column_stack([face.points[:, 0], face.weight, state.faults["main"]["normal_stress"]])[face.owned]
    x, weight, pressure = parallel.share_rows(model.comm, rows).T
    order = np.argsort(x)
    return x[order], weight[order], pressure[order]


def _checks(share: float, x: Floats, weight: Floats, pressure: Floats, kind: str) -> list[Check]:
    wanted, name = exact(x, share), f"{kind}p / p* = {share:.3g}"
    if share >= 1:
        worst = float(np.abs(pressure - wanted).max() / FULL)
        return [Check(f"{name}: largest difference / p*", 0.0, worst, 0.01, "1", SOURCE)]
    apart = float(weight @ np.abs(pressure - wanted) / (weight @ wanted))
    width = WAVELENGTH / np.pi * np.arcsin(np.sqrt(share))
    return [
        Check(f"{name}: mean difference", 0.0, apart, 0.04 if share < 0.2 else 0.01, "1", SOURCE),
        Check(f"{name}: peak", float(wanted.max()), float(pressure.max()), 0.01, "Pa", SOURCE, relative=True),
        Check(f"{name}: half-width", width, float(x[pressure > 0].max()), float(np.diff(x).max()), "m", SOURCE),
    ]


def _draw(found: list[tuple[float, Floats, Floats, Floats]]) -> Figure:
    from ruptfx.results.figure_style import new_figure

    figure, ((axes,),) = new_figure(1, 1, 3.4, 5)
    fine = np.linspace(0, 0.5 * WAVELENGTH, 400)
    for share, x, _, pressure in found:
        (line,) = axes.plot(1e3 * x, 1e-6 * pressure, "o", ms=3, label=f"p / p* = {share:g}")
        axes.plot(1e3 * fine, 1e-6 * exact(fine, share), color=line.get_color(), lw=0.8)
    axes.set(xlabel="Distance from the crest (mm)", ylabel="Pressure (MPa); lines exact")
    axes.legend(frameon=False)
    return figure
