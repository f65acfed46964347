"""Seismic cycles on a strike-slip fault: SCEC SEAS benchmark problem BP1-QD, antiplane and quasi-dynamic.

Rate and state friction with the ageing law to a depth of 40 km, velocity weakening down to 15 km; below, the plates
move on at 1e-9 m/s. One side is meshed, the other moves the opposite way; elements of order 2.

Compared with boundary integrals in a half-space (`_half_space_fault`), which share nothing with the finite elements
but the parameters, and these with a published time series: HBI (S. Ozawa, 2024/06/16, elements of 10 m), station
fltst_dp000 of bp1-qd on strike.scec.org/cvws, as kept in github.com/chunhuizhao478/seas-mfem. Participants differ: the
first event is at 196.36 a there, 195.9 a in tandem (C. Uphoff, 2021) and 199.6 a in BICyclE (J. Jiang, 2018).

Derived from the parameters: initial traction and age; the length 2 L_inf = 2 L_b / (pi (1 - a/b)^2), L_b = G D_c /
(b sigma) = 342 m, to which the nucleation zone of the ageing law grows where a/b > 1/2 (Rubin and Ampuero 2005), here
the part that slides at a tenth of the largest slip rate or more, when that is 1 mm/s.

Coarse: one event on nodes 125 m apart. With `--fine` three on nodes 100 m apart, again to the first with edges twice
as far, and to the end of the first with a tenth of the tolerance.

Source: Erickson et al. (2020), The community code verification exercise for SEAS, Seismol. Res. Lett. 91, 874-890.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from benchmarks._cycles import Cycles
from benchmarks._half_space_fault import HalfSpaceFault
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

YEAR = 365.25 * 24 * 3600
DENSITY, C_S, SIGMA = 2670.0, 3464.0, 50e6
G = DENSITY * C_S**2
A, A_MAX, B, D_C, F_0, V_0, V_P = 0.010, 0.025, 0.015, 8e-3, 0.6, 1e-6, 1e-9
FAULT = 40e3  # m
DEPTHS, A_AT = [0.0, 15e3, 18e3, FAULT], [A, A, A_MAX, A_MAX]
FAR = 400e3  # m, distance of the far edges
SHOWN = 25e3  # m, depth shown in the figure
SOURCE = "SEAS BP1-QD"
ORDINALS = ("first", "second", "third")
PUBLISHED_ONSETS = (6.1965192e9, 8.5828065e9, 1.10383147e10)  # s
PUBLISHED_SLIP = (2.83979, 2.50596)  # m, at the surface, in the first two


def initial_traction() -> float:
    """Return tau_0 [Pa], uniform: steady creep with the largest a; radiation at V_p is 5 mPa of it."""
    return SIGMA * A_MAX * np.arcsinh(V_P / (2 * V_0) * np.exp((F_0 + B * np.log(V_0 / V_P)) / A_MAX))


def problem(spacing: float, far: float, tolerance: float = 1e-4) -> Case:
    """Return the case: node spacing `spacing` [m], distance of the far edges [m], error tolerance of a step."""
    moved = [{"kind": "driven", "edge": f"upper.{edge}", "component": "z", "velocity": V_P / 2}
             for edge in ("below", "top")]  # fmt: skip
    return Case.model_validate({
        "plane": "antiplane", "order": 2, "duration": 3e3 * YEAR, "boundaries": moved, "output": {"figures": False},
        "mesh": {"kind": "strike_slip_section", "fault_depth": FAULT, "depth": FAULT + far, "distance": far,
                 "element_size": 2 * spacing, "growth": 1.3},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 2.5 * G, "poisson_ratio": 0.25,
                                  "density": DENSITY}},
        "faults": {"main": {
            # Nearly rigid: 10 MPa move it by 1 um.
            "contact": {"kind": "compliant", "C_n": 1e13, "C_s": 1e13},
            "initial_stress": {"normal": SIGMA, "shear": initial_traction()},
            "friction": {
                "kind": "rate_and_state_ageing", "b": B, "D_c": D_C, "f_0": F_0, "V_0": V_0, "V_initial": V_P,
                "a": {"kind": "table", "positions": DEPTHS, "values": A_AT},
            },
        }},
        "stepper": {"kind": "quasi_dynamic", "tolerance": tolerance},
    })  # fmt: skip


def reference(spacing: float, events: int) -> Cycles:
    """Return the cycles computed by boundary integrals."""
    cells = np.linspace(0, FAULT, round(FAULT / spacing) + 1)
    a = np.interp(0.5 * (cells[1:] + cells[:-1]), DEPTHS, A_AT)
    return HalfSpaceFault(cells, a, B, D_C, F_0, V_0, SIGMA, G, C_S, V_P, initial_traction()).march(events)


def march(case: Case, events: int, whole: bool) -> tuple[Cycles, float]:
    """Run on one rank until `events` events have begun, or have ended; return also the initial age at the surface."""
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    state.lazy_bodies = True
    fields, age = state.faults["main"], float(state.faults["main"]["theta"][0])
    found = Cycles(model.faults[0].interface.position)
    while (found.over if whole else len(found.events)) < events:
        motion.step(state)
        found.look(state.time, fields["slip_rate"], fields["slip"])
    return found, age


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    events, spacing, cells = (3, 100.0, 50.0) if fine else (1, 125.0, 100.0)
    found, age = march(problem(spacing, FAR), events, True)
    expected = reference(cells, events)
    # The age that carries tau_0 at V_p in the zone of small a, from the regularised law.
    ratio = initial_traction() / (A * SIGMA)
    theta = D_C / V_0 * np.exp(A / B * np.log(2 * V_0 / V_P * np.sinh(ratio)) - F_0 / B)
    checks = [Check("initial age at the surface", theta, age, 1e-9, "s", SOURCE, relative=True)]
    checks += _against("boundary integrals", expected, PUBLISHED_ONSETS, PUBLISHED_SLIP, 1e-3, 5e-3, "HBI, published")
    onsets = [event.onset for event in expected.events]
    slips = [event.first_slip for event in expected.events]
    own, close, loose = "boundary integrals", 0.005, 0.02
    checks += _against("finite elements", found, onsets, slips, close, loose, own)
    first, theirs = found.events[0], expected.events[0]
    length = 2 * G * D_C / (B * SIGMA) / (np.pi * (1 - A / B) ** 2)
    checks += [
        Check("depth of nucleation", theirs.depth, first.depth, 0.04, "m", own, relative=True),
        Check("length of the nucleation zone", theirs.nucleation, first.nucleation, 0.15, "m", own, relative=True),
        Check("the same", length, first.nucleation, 0.25, "m", "Rubin and Ampuero (2005)", relative=True),
    ]
    for name, event, other in zip(ORDINALS, found.events, expected.events, strict=False):
        checks.append(Check(f"peak slip rate, {name} event", other.peak, event.peak, 0.05, "m/s", own, relative=True))
    checks.append(Check("steps before the first event", 1000, first.first_step, 0, "1", "aim", "at most"))
    if fine:
        checks += _alone(found)
    return Outcome(checks, lambda: _draw(found, expected))


def _against(
    what: str, found: Cycles, onsets: Sequence[float], slips: Sequence[float], close: float, loose: float, source: str
) -> list[Check]:
    """Return checks of the first onset, the intervals after it and the slip at the surface."""
    checks = [Check(f"{what}: first event", onsets[0] / YEAR, found.events[0].onset / YEAR, close, "a", source,
                    relative=True)]  # fmt: skip
    for name, ours, other in zip(ORDINALS[1:], found.intervals, np.diff(onsets), strict=False):
        text = f"{what}: interval before the {name}"
        checks.append(Check(text, other / YEAR, ours / YEAR, close, "a", source, relative=True))
    for name, event, slip in zip(ORDINALS, found.events, slips, strict=False):
        text = f"{what}: slip at the surface, {name} event"
        checks.append(Check(text, slip, event.first_slip, loose, "m", source, relative=True))
    return checks


def _alone(found: Cycles) -> list[Check]:
    """Return checks of the position of the far edges, of the step tolerance and of the number of steps per cycle."""
    first, own = found.events[0], "own run"
    far, _ = march(problem(100.0, 2 * FAR), 1, False)
    fine, _ = march(problem(100.0, FAR, 1e-5), 1, True)
    finer = fine.events[0]
    steps = found.events[2].first_step - found.events[1].first_step
    return [
        Check("first event, edges twice as far", far.events[0].onset / YEAR, first.onset / YEAR, 0.003, "a", own,
              relative=True),
        Check("first event, a tenth of the tolerance", finer.onset / YEAR, first.onset / YEAR, 1e-4, "a", own,
              relative=True),
        Check("slip at the surface, the same", finer.first_slip, first.first_slip, 0.01, "m", own, relative=True),
        Check("steps of a cycle", 5000, steps, 0, "1", "aim", "at most"),
    ]  # fmt: skip


def _draw(found: Cycles, expected: Cycles) -> Figure:
    from ruptfx.results.figure_style import ACCENT, GUIDE, new_figure

    figure, (axes,) = new_figure(1, 2, 3.2, 8)
    axes[0].semilogy(np.array(expected.times) / YEAR, expected.speeds, lw=2.5, color="0.75", label="boundary integrals")
    axes[0].semilogy(np.array(found.times) / YEAR, found.speeds, lw=0.8, color=GUIDE, label="finite elements")
    axes[0].axhline(V_P, color="0.6", lw=0.8, ls="--")
    axes[0].set(xlabel="Time (a)", ylabel="Largest slip rate (m/s)", title="Dashed: rate of the plates")
    axes[0].legend(loc="center left", handlelength=1.0)
    for profile in found.profiles:
        style = {"color": ACCENT, "lw": 0.3} if profile.ruptures else {"color": GUIDE, "lw": 0.6}
        axes[1].plot(profile.slip, found.position / 1e3, **style)
    most = found.profiles[-1].slip[found.position < SHOWN].max()
    axes[1].set(xlabel="Slip (m)", ylabel="Depth (km)", title="Every 5 a, in ruptures every second",
                xlim=(0, 1.02 * most), ylim=(SHOWN / 1e3, 0))  # fmt: skip
    return figure
