"""Seismic cycles on a strike-slip fault: SCEC SEAS benchmark problem BP1-QD, antiplane and quasi-dynamic.

Rate and state friction with the ageing law to a depth of 40 km, velocity weakening down to 15 km; below, the plates
move on at 1e-9 m/s. One side is meshed, the other moves the opposite way. The steps follow slip and state.

Derived from the parameters: initial traction and age; the length 2 L_inf = 2 L_b / (pi (1 - a/b)^2), L_b = G D_c /
(b sigma), to which the nucleation zone of the ageing law grows where a/b > 1/2 (Rubin and Ampuero 2005), here the part
that slides at a tenth of the largest slip rate or more, when that is 1 mm/s. The far edges are where twice the distance
changes the first event no more than shorter steps do: at 181 a with edges at 80 km, 191 a at 160 km, 190 a at 400 km,
187 a at 800 km; at 80 km, 185 a in half as long steps and 183 a on half of the spacing. With `--fine` three events; the
first begins from the initial state and is not counted in the recurrence, which times V_p is the slip of an event, but
for afterslip and creep. The time series of the participants (strike.scec.org) are not compared with.

Source: Erickson et al. (2020), The community code verification exercise for SEAS.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import fem
from ruptfx.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.fem import MPI

YEAR = 365.25 * 24 * 3600
DENSITY, C_S, SIGMA = 2670.0, 3464.0, 50e6
G = DENSITY * C_S**2
A, A_MAX, B, D_C, F_0, V_0, V_P = 0.010, 0.025, 0.015, 8e-3, 0.6, 1e-6, 1e-9
FAULT = 40e3  # m
SOURCE = "SEAS BP1-QD"
BEGINS, ENDS = 1e-3, 1e-4  # m/s, of the largest slip rate


def initial_traction() -> float:
    """tau_0 [Pa], the same everywhere: steady creep with the largest a; radiation at V_p is 5 mPa of it."""
    return SIGMA * A_MAX * np.arcsinh(V_P / (2 * V_0) * np.exp((F_0 + B * np.log(V_0 / V_P)) / A_MAX))


def problem(spacing: float, far: float) -> Case:
    """Nodes some `spacing` [m] apart, far edges at a distance [m]."""
    moved = [{"kind": "driven", "edge": f"upper.{edge}", "component": "z", "velocity": V_P / 2}
             for edge in ("below", "top")]  # fmt: skip
    return Case.model_validate({
        "plane": "antiplane", "order": 4, "duration": 3e3 * YEAR, "boundaries": moved, "output": {"figures": False},
        "mesh": {"kind": "strike_slip_section", "fault_depth": FAULT, "depth": FAULT + far, "distance": far,
                 "element_size": 4 * spacing, "growth": 1.3},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 2.5 * G, "poisson_ratio": 0.25,
                                  "density": DENSITY}},
        "faults": {"main": {
            # Next to rigid: 10 MPa move it by 1 um.
            "contact": {"kind": "compliant", "C_n": 1e13, "C_s": 1e13},
            "initial_stress": {"normal": SIGMA, "shear": initial_traction()},
            "friction": {
                "kind": "rate_and_state_ageing", "b": B, "D_c": D_C, "f_0": F_0, "V_0": V_0, "V_initial": V_P,
                "a": {"kind": "table", "positions": [0.0, 15e3, 18e3, FAULT], "values": [A, A, A_MAX, A_MAX]},
            },
        }},
        "stepper": {"kind": "quasi_static", "radiation_damping": True, "strength_tolerance": 0.004,
                    "slip_tolerance": 2e-4, "largest_step": 2 * YEAR},
    })  # fmt: skip


@dataclass
class Event:
    """One rupture: its first and last step, where [m] and when [s] it begins, and what comes of it."""

    onset: float
    depth: float
    nucleation: float
    """Length of the zone it grew from [m]."""
    first_step: int
    peak: float = 0.0
    """Largest slip rate [m/s]."""
    slip: float = 0.0
    """Largest slip [m]."""


@dataclass
class Cycles:
    """What a run leaves: its events, and of every step time [s] and largest slip rate [m/s]."""

    theta: np.ndarray
    events: list[Event] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)


def march(case: Case, events: int, whole: bool) -> Cycles:
    """Run on one rank until so many events have begun, or are over."""
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    fields, position = state.faults["main"], model.faults[0].interface.position
    found = Cycles(fields["theta"].copy())
    under_way, slip = False, fields["slip"].copy()
    while True:
        motion.step(state)
        rate = fields["slip_rate"]
        fastest = float(rate.max())
        found.times.append(state.time)
        found.speeds.append(fastest)
        if not under_way and fastest > BEGINS:
            zone = position[rate > 0.1 * fastest]
            found.events.append(Event(
                state.time, float(position[np.argmax(rate)]), float(np.ptp(zone)), state.step
            ))  # fmt: skip
            under_way, slip = True, fields["slip"].copy()
            if not whole and len(found.events) == events:
                return found
        if under_way:
            event = found.events[-1]
            event.peak = max(event.peak, fastest)
            if fastest < ENDS:
                under_way, event.slip = False, float((fields["slip"] - slip).max())
                if len(found.events) == events:
                    return found


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    spacing, events = (100.0, 3) if fine else (125.0, 1)
    near = march(problem(spacing, 400e3), events, fine)
    far = march(problem(spacing, 800e3), 1, False)
    first = near.events[0]
    # The age that carries tau_0 at V_p in the zone of small a, from the regularised law.
    ratio = initial_traction() / (A * SIGMA)
    theta = D_C / V_0 * np.exp(A / B * np.log(2 * V_0 / V_P * np.sinh(ratio)) - F_0 / B)
    length = 2 * G * D_C / (B * SIGMA) / (np.pi * (1 - A / B) ** 2)
    checks = [
        Check("initial age at the surface", theta, float(near.theta[0]), 1e-9, "s", SOURCE, relative=True),
        Check("first event, edges twice as far", far.events[0].onset / YEAR, first.onset / YEAR, 0.03, "a",
              "own run", relative=True),
        Check("depth of nucleation: above", 15e3, first.depth, 0, "m", "velocity weakening", "at most"),
        Check("length of the nucleation zone", length, first.nucleation, 0.25, "m", "Rubin and Ampuero (2005)",
              relative=True),
        Check("steps before the first event", 1500, first.first_step, 0, "1", "aim", "at most"),
    ]  # fmt: skip
    if fine:
        second, third = near.events[1:]
        recurrence = third.onset - second.onset
        checks += [
            Check("recurrence times V_p over slip", 1.0, recurrence * V_P / third.slip, 0.15, "1", "budget of slip"),
            Check("peak slip rate", 1.0, third.peak, 0, "m/s", "seismic", "at least"),
            Check("peak slip rate, second and third", second.peak, third.peak, 0.2, "m/s", "own", relative=True),
            Check("steps of a cycle", 5000, third.first_step - second.first_step, 0, "1", "aim", "at most"),
        ]
    return Outcome(checks, lambda: _draw(near))


def _draw(found: Cycles) -> Figure:
    from ruptfx.figure_style import new_figure

    figure, (axes,) = new_figure(1, 2, 3.2, 8)
    time = np.array(found.times)
    axes[0].semilogy(time / YEAR, found.speeds, lw=1)
    axes[0].axhline(V_P, color="0.6", lw=0.8, ls="--")
    axes[0].set(xlabel="Time (a)", ylabel="Largest slip rate (m/s)", title="Dashed: rate of the plates")
    axes[1].semilogy(np.diff(time, prepend=0.0), lw=1)
    axes[1].set(xlabel="Step", ylabel="Length of the step (s)", title="Steps")
    return figure
