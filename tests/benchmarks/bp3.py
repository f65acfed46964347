"""Seismic cycles on a dipping fault: SCEC SEAS benchmark problem BP3-QD, plane strain and quasi-dynamic.

A thrust that dips by 60 degrees and a normal fault that dips by 30. Rate and state friction with the ageing law to
40 km down dip, velocity weakening to 15 km; below, the fault creeps at 1e-9 m/s. Slip beside the free surface changes
the normal stress. The far edges of the hanging wall move at the same rate, those of the foot wall are at rest.

Compared with boundary integrals in a half-space (`_half_space_fault`): edge dislocations, which share nothing with the
finite elements but the parameters. Slip of the run and their matrix give the change of the normal stress, too: locked
below its upper end a thrust is pressed together there, a normal fault pulled apart.

Coarse: twice the D_c of the problem, to the first event, nodes 250 m apart. With `--fine` that of the problem, nodes
125 m apart, and again with free far edges of the hanging wall, so that only the creep below the fault loads it.

Source: Erickson et al. (2023), Incorporating full elastodynamic effects and dipping fault geometries in community code
verification exercises for simulations of SEAS, Bull. Seismol. Soc. Am. 113, 499-523.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks._cycles import Cycles
from benchmarks._half_space_fault import DippingFault
from benchmarks.bp1 import A_AT, C_S, D_C, DENSITY, DEPTHS, F_0, FAULT, SIGMA, V_0, V_P, YEAR, B, G, initial_traction
from ruptfx.app.bench import Check, Outcome
from ruptfx.case import Case
from ruptfx.platform import fem
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.platform.fem import MPI

NU, FAR = 0.25, 400e3
FAULTS = {"thrust, 60 degrees": (60.0, 1.0), "normal, 30 degrees": (30.0, -1.0)}
"""Dip in degrees and 1 for a thrust, -1 for a normal fault."""


def problem(dip: float, sense: float, spacing: float, D_c: float, loaded_edges: bool = True) -> Case:
    """Return the case: node spacing and D_c [m], and whether the far edges of the hanging wall move."""
    angle, rate = np.deg2rad(dip), -sense * V_P  # slip is positive down dip
    motion = {"x": rate * np.cos(angle), "y": -rate * np.sin(angle)}
    moved = [
        {"kind": "driven", "edge": f"{body}.{edge}", "component": axis, "velocity": motion[axis] * (body == "plus")}
        for body in ("plus", "minus")[not loaded_edges :] for edge in ("far", "bottom") for axis in "xy"
    ]  # fmt: skip
    creeps = {"kind": "table", "positions": [FAULT, FAULT + 1.0], "values": [0.0, 1.0], "extend": True}
    return Case.model_validate({
        "plane": "strain", "order": 2, "duration": 3e3 * YEAR, "boundaries": moved, "output": {"figures": False},
        "mesh": {"kind": "dipping_section", "fault_width": FAULT, "beyond": FAR, "distance": FAR, "dip": dip,
                 "element_size": 2 * spacing, "growth": 1.3},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 2 * G * (1 + NU),
                                  "poisson_ratio": NU, "density": DENSITY}},
        "faults": {"main": {
            "contact": {"kind": "compliant", "C_n": 1e13, "C_s": 1e13},
            "initial_stress": {"normal": SIGMA, "shear": -sense * initial_traction()},
            "prescribed_slip": [{"kind": "constant_rate", "rate": rate, "where": creeps}],
            "friction": {
                "kind": "rate_and_state_ageing", "b": B, "D_c": D_c, "f_0": F_0, "V_0": V_0, "V_initial": V_P,
                "a": {"kind": "table", "positions": DEPTHS, "values": A_AT, "extend": True},
            },
        }},
        "stepper": {"kind": "quasi_dynamic"},
    })  # fmt: skip


@dataclass
class Run:
    """To the begin of the first event of a fault.

    Attributes
    ----------
    cycles : Cycles
    slip, pressure : ndarray
        Slip [m], positive in the direction of the plates, and change of the normal stress [Pa], at `cycles.position`.
    time : float
        [s]
    closure : float
        Work less all energies, over the work.
    """

    cycles: Cycles
    slip: np.ndarray
    pressure: np.ndarray
    time: float
    closure: float


def march(case: Case) -> Run:
    """Run on one rank until an event has begun."""
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    fault, fields = model.faults[0], state.faults["main"]
    inside = fault.interface.position <= FAULT
    cycles = Cycles(fault.interface.position[inside])
    start = fields["normal_stress"][inside].copy()
    while not cycles.events:
        motion.step(state)
        cycles.look(state.time, np.abs(fields["slip_rate"][inside]), np.abs(fields["slip"][inside]))
    energies = motion.energies(state)
    work = energies.pop("boundary_work")
    slip, pressure = np.abs(fields["slip"][inside]), fields["normal_stress"][inside] - start
    return Run(cycles, slip, pressure, state.time, abs(work - sum(energies.values())) / abs(work))


def reference(dip: float, sense: float, spacing: float, D_c: float) -> DippingFault:
    """Return the boundary integrals."""
    cells = np.linspace(0, FAULT, round(FAULT / spacing) + 1)
    a = np.interp(0.5 * (cells[1:] + cells[:-1]), DEPTHS, A_AT)
    return DippingFault(
        cells, a, B, D_c, F_0, V_0, SIGMA, G, C_S, V_P, initial_traction(), np.deg2rad(dip), NU, sense
    )  # fmt: skip


def misfit(ours: np.ndarray, theirs: np.ndarray, position: np.ndarray) -> float:
    """Return the RMS difference of the means over elements of order 2 within 30 km, over the largest value.

    Where slip has a kink, stresses at the two kinds of nodes of an element err in opposite directions.
    """
    means = [(each[:-2:2] + 4 * each[1:-1:2] + each[2::2]) / 6 for each in (ours, theirs)]
    within = position[1:-1:2] < 30e3
    return float(np.sqrt(np.mean((means[0] - means[1])[within] ** 2)) / np.abs(means[1][within]).max())


def run(fine: bool, comm: MPI.Comm) -> Outcome:
    del comm
    spacing, cells, D_c, close = (125.0, 50.0, D_C, 0.01) if fine else (250.0, 100.0, 2 * D_C, 0.02)
    checks, drawn = [], {}
    for name, (dip, sense) in FAULTS.items():
        integrals = reference(dip, sense, cells, D_c)
        theirs, ours = integrals.march(1), march(problem(dip, sense, spacing, D_c))
        first, expected = ours.cycles.events[0], theirs.events[0]
        # The stress that their matrix makes of the slip of this run; at the ends of the fault the slip has kinks.
        slip = np.interp(theirs.position, ours.cycles.position, ours.slip) - V_P * ours.time
        pressure = np.interp(ours.cycles.position, theirs.position, integrals.normal_stiffness() @ slip)
        off = misfit(ours.pressure, pressure, ours.cycles.position)
        own = "boundary integrals"
        checks += [
            Check(f"{name}: first event", expected.onset / YEAR, first.onset / YEAR, close, "a", own, relative=True),
            Check(f"{name}: change of normal stress, misfit over peak", 0.0, off, 0.02, "1", own),
            Check(f"{name}: normal stress at the surface, sign", sense, np.sign(ours.pressure[0]), 0, "1", own),
            Check(f"{name}: energy closure", 0.0, ours.closure, 1e-8, "1", "exact"),
        ]  # fmt: skip
        if fine:  # with twice the D_c the zone is half of the fault, and the largest rate at either end of it
            depth = f"{name}: depth of nucleation"
            checks.append(Check(depth, expected.depth, first.depth, 0.05, "m", own, relative=True))
            free = march(problem(dip, sense, spacing, D_c, False)).cycles.events[0]
            quantity = f"{name}: first event, free far edges"
            checks.append(Check(quantity, first.onset / YEAR, free.onset / YEAR, 0.01, "a", "own run", relative=True))
        drawn[name] = ours, theirs, pressure
    return Outcome(checks, lambda: _draw(drawn))


def _draw(drawn: dict[str, tuple[Run, Cycles, np.ndarray]]) -> Figure:
    from ruptfx.results.figure_style import ACCENT, GUIDE, new_figure

    figure, (axes,) = new_figure(1, 2, 2.8, 8)
    for (name, (ours, theirs, pressure)), colour in zip(drawn.items(), (ACCENT, GUIDE), strict=True):
        axes[0].semilogy(np.array(theirs.times) / YEAR, theirs.speeds, lw=2.0, color="0.75")
        axes[0].semilogy(np.array(ours.cycles.times) / YEAR, ours.cycles.speeds, lw=0.8, color=colour, label=name)
        axes[1].plot(pressure / 1e6, ours.cycles.position / 1e3, lw=2.5, color="0.75")
        axes[1].plot(ours.pressure / 1e6, ours.cycles.position / 1e3, lw=0.8, color=colour)
    axes[0].set(xlabel="Time (a)", ylabel="Largest slip rate (m/s)", title="Grey: boundary integrals")
    axes[0].legend(loc="upper left", handlelength=1.0)
    axes[1].set(xlabel="Change of the normal stress (MPa)", ylabel="Down dip (km)", ylim=(FAULT / 1e3, 0),
                title="Where the first event begins")  # fmt: skip
    return figure
