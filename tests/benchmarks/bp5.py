"""Seismic cycles of a fault of 100 x 40 km in a half-space: SCEC SEAS benchmark problem BP5-QD, quasi-dynamic.

Rate and state friction with the ageing law; velocity weakening in a core of 60 x 12 km that begins 4 km deep, with a
rim of 2 km. Around the fault the plates creep at 1e-9 m/s. In a square at one end of the core D_c is smaller, and a
higher slip rate at the start nucleates the first event there. The section of the half-space repeats along strike
(`mesh.along_strike`), with a period beyond the fault that creeps.

Compared with published results: later events every 235 years or so in codes with boundary elements, up to 250 years in
volume codes with finite boxes (Jiang et al. 2022). The initial traction follows from the parameters.

Coarse: points 2 km apart, two events, whose interval such points get wrong by a sixth. With `--fine`: 1 km and five
events, two of them again with a longer period along strike.

Source: Jiang et al. (2022), Community-driven code comparisons for three-dimensional dynamic modeling of sequences of
earthquakes and aseismic slip, J. Geophys. Res. 127, e2021JB023519.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

YEAR = 365.25 * 24 * 3600
DENSITY, C_S, NU, SIGMA = 2670.0, 3464.0, 0.25, 25e6
G = DENSITY * C_S**2
A, A_MAX, B, D_C, D_C_THERE, F_0, V_0, V_P, V_START = 0.004, 0.04, 0.03, 0.14, 0.13, 0.6, 1e-6, 1e-9, 0.03
LENGTH, WIDTH = 100e3, 40e3
CORE, DEPTHS, RIM, SQUARE = (-30e3, 30e3), (4e3, 16e3), 2e3, 12e3
FAR = 400e3  # m, distance of the far edges
BEGINS, ENDS = 1e-2, 1e-3  # m/s: an event begins and ends when the largest slip rate passes these
INTERVAL = 235.0  # a
SOURCE = "SEAS BP5-QD"


def direct_effect(z: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return a at positions along strike and depths [m]."""
    beyond = [np.abs(x - 0.5 * sum(ends)) - 0.5 * (ends[1] - ends[0]) for x, ends in ((z, CORE), (depth, DEPTHS))]
    return np.asarray(A + (A_MAX - A) * np.clip(np.maximum(*beyond) / RIM, 0, 1))


def problem(spacing: float, period: float = 128e3, duration: float = 1000.0) -> Case:
    """Return the case: node spacing and period along strike [m], duration [a]."""
    z, depth = np.arange(-0.5 * period, 0.5 * period + 1, 500.0), np.arange(0, WIDTH + 1, 500.0)
    values = direct_effect(z[None], depth[:, None])
    square = {"kind": "rectangle", "strike": [CORE[0], CORE[0] + SQUARE], "dip": list(DEPTHS)}
    moved = [{"kind": "driven", "edge": f"upper.{edge}", "component": axis, "velocity": velocity}
             for edge, axes in (("below", "xz"), ("top", "xyz"))
             for axis, velocity in (("x", 0.0), ("y", 0.0), ("z", V_P / 2)) if axis in axes]  # fmt: skip
    return Case.model_validate({
        "plane": "solid", "order": 2, "duration": duration * YEAR, "boundaries": moved,
        "mesh": {"kind": "strike_slip_section", "fault_depth": WIDTH, "depth": WIDTH + FAR, "distance": FAR,
                 "element_size": 2 * spacing, "growth": 1.3,
                 "along_strike": {"length": LENGTH, "period": period, "points": round(period / spacing), "creep": V_P}},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 2 * G * (1 + NU),
                                  "poisson_ratio": NU, "density": DENSITY}},
        "faults": {"main": {
            "contact": {"kind": "compliant", "C_n": 1e13, "C_s": 1e13},
            "initial_stress": {"normal": SIGMA},
            "friction": {
                "kind": "rate_and_state_ageing", "b": B, "f_0": F_0, "V_0": V_0, "theta_initial": D_C / V_P,
                "V_initial": {**square, "inside": V_START, "outside": V_P},
                "D_c": {**square, "inside": D_C_THERE, "outside": D_C},
                "a": {"kind": "surface_table", "strike": z.tolist(), "dip": depth.tolist(), "values": values.tolist()},
            },
        }},
        "stepper": {"kind": "quasi_dynamic"}, "output": {"figures": False, "interface_growth": 3.0},
    })  # fmt: skip


@dataclass
class Event:
    """One rupture: time of its onset [s] and largest slip rate [m/s]."""

    onset: float
    peak: float = 0.0


@dataclass
class Course:
    """Events of a run; time [s] and largest slip rate [m/s] of every step; slip of each event [m]."""

    events: list[Event] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    slips: list[np.ndarray] = field(default_factory=list)

    @property
    def interval(self) -> float:
        """Mean time between onsets [s]."""
        return float(np.diff([event.onset for event in self.events]).mean())


def march(case: Case, events: int) -> tuple[Course, Model]:
    """Run on one rank until `events` events have begun, or to the end of the case; return also the model."""
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    state.lazy_bodies = True
    fault, fields, course = model.faults[0], state.faults["main"], Course()
    begun, slides = fields["slip_1"].copy(), False
    while state.time < case.duration and len(course.events) < events:
        motion.step(state)
        fastest = float(np.hypot(fields["slip_rate_1"], fields["slip_rate_2"])[~fault.is_held].max())
        course.times.append(state.time)
        course.speeds.append(fastest)
        if not slides and fastest > BEGINS:
            slides, begun = True, fields["slip_1"].copy()
            course.events.append(Event(state.time))
        if slides:
            course.events[-1].peak = max(course.events[-1].peak, fastest)
            if fastest < ENDS:
                slides = False
                course.slips.append(fields["slip_1"] - begun)
    return course, model


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    spacing, events, close = (1e3, 5, 0.03) if fine else (2e3, 2, 0.2)
    case = problem(spacing)
    course, model = march(case, events)
    fault = model.faults[0]
    z, depth = fault.interface.position, fault.interface.across
    assert depth is not None
    at = int(np.argmin(np.abs(z - 20e3) + np.abs(depth - 10e3)))  # in the core, away from the square
    carried = SIGMA * A * np.arcsinh(V_P / (2 * V_0) * np.exp((F_0 + B * np.log(V_0 / V_P)) / A))
    checks = [
        Check("initial traction in the core", carried, float(fault.shear_traction_0[at, 0]), 1e-9, "Pa", SOURCE,
              relative=True),
        Check("mean interval", INTERVAL, course.interval / YEAR, close, "a", "Jiang et al. (2022)", relative=True),
        Check("steps of a cycle", 4000, len(course.times) / (events - 1), 0, "1", "aim", "at most"),
    ]  # fmt: skip
    if fine:
        longer, _ = march(problem(spacing, 160e3, 300.0), 2)
        first = course.events[1].onset - course.events[0].onset
        checks.append(Check("first interval, period of 160 km", longer.interval / YEAR, first / YEAR, 0.01, "a",
                            "own run", relative=True))  # fmt: skip
    return Outcome(checks, lambda: _draw(course, z, depth))


def _draw(course: Course, z: np.ndarray, depth: np.ndarray) -> Figure:
    from ruptfx.results.figure_style import GUIDE, RATE_MAP, new_figure

    figure, (axes,) = new_figure(1, 2, 2.6, 8)
    axes[0].semilogy(np.array(course.times) / YEAR, course.speeds, lw=0.8, color=GUIDE)
    axes[0].axhline(V_P, color="0.6", lw=0.8, ls="--")
    axes[0].set(xlabel="Time (a)", ylabel="Largest slip rate (m/s)", title="Dashed: rate of the plates")
    mesh = axes[1].tripcolor(z / 1e3, depth / 1e3, course.slips[0], cmap=RATE_MAP, shading="gouraud")
    figure.colorbar(mesh, ax=axes[1], label="Slip (m)")
    axes[1].set(xlabel="Strike (km)", ylabel="Depth (km)", ylim=(WIDTH / 1e3, 0), title="Slip of the first event")
    return figure
