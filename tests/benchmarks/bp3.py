"""Seismic cycles on a dipping fault: SCEC SEAS benchmark problem BP3-QD, plane strain and quasi-dynamic.

A thrust that dips by 60 degrees and a normal fault that dips by 30. Rate and state friction with the ageing law to
40 km down dip, velocity weakening to 15 km; below, the fault creeps at 1e-9 m/s. Slip beside the free surface changes
the normal stress. The far edges of the hanging wall move at the same rate, those of the foot wall are at rest.

Compared with boundary integrals in a half-space (`_half_space_fault`): edge dislocations, which share nothing with the
finite elements but the parameters. Also: energy, the sign of the change of normal stress, and the same intervals with
hanging walls whose far edges are free, so that only the creep below the fault loads it.

Coarse: to the first event of both faults on nodes 250 m apart. With `--fine` three events on nodes 125 m apart.

Source: Erickson et al. (2023), Incorporating full elastodynamic effects and dipping fault geometries in community code
verification exercises for simulations of SEAS, Bull. Seismol. Soc. Am. 113, 499-523.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks._cycles import Cycles
from benchmarks._half_space_fault import DippingFault
from benchmarks.bp1 import A, A_AT, B, C_S, D_C, DENSITY, DEPTHS, F_0, FAULT, SIGMA, V_0, V_P, YEAR, G, initial_traction
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


def problem(dip: float, sense: float, spacing: float, loaded_edges: bool = True) -> Case:
    """Return the case: node spacing [m], and whether the far edges of the hanging wall move."""
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
                "kind": "rate_and_state_ageing", "b": B, "D_c": D_C, "f_0": F_0, "V_0": V_0, "V_initial": V_P,
                "a": {"kind": "table", "positions": DEPTHS, "values": A_AT, "extend": True},
            },
        }},
        "stepper": {"kind": "quasi_dynamic"},
    })  # fmt: skip


@dataclass
class Run:
    """Cycles of a run, change of normal stress over time of each kind, and energy closure.

    Attributes
    ----------
    locked, broken : ndarray
        Change of normal stress before and after the first event [Pa], at `cycles.position`.
    slip : ndarray
        Of the first event [m].
    """

    cycles: Cycles
    closure: float
    locked: np.ndarray
    broken: np.ndarray
    slip: np.ndarray


def march(case: Case, events: int, whole: bool) -> Run:
    """Run on one rank until `events` events have begun, or have ended."""
    model = Model(case, fem.MPI.COMM_SELF)
    motion, state = case.stepper.bind(model), model.initial_state()
    state.lazy_bodies = True
    fault, fields = model.faults[0], state.faults["main"]
    inside = fault.interface.position <= FAULT
    cycles = Cycles(fault.interface.position[inside])
    start, locked, broken = fields["normal_stress"][inside].copy(), None, None
    begun = slip = np.zeros(len(start))
    while (cycles.over if whole else len(cycles.events)) < events:
        motion.step(state)
        cycles.look(state.time, np.abs(fields["slip_rate"][inside]), np.abs(fields["slip"][inside]))
        change = fields["normal_stress"][inside] - start
        if locked is None and cycles.events:
            locked, begun = change, np.abs(fields["slip"][inside])
        if broken is None and cycles.over:
            broken, slip = change, np.abs(fields["slip"][inside]) - begun
    assert locked is not None
    state.lazy_bodies = False
    return Run(cycles, 0.0, locked, locked if broken is None else broken, slip)


def reference(dip: float, sense: float, spacing: float) -> DippingFault:
    """Return the boundary integrals."""
    cells = np.linspace(0, FAULT, round(FAULT / spacing) + 1)
    a = np.interp(0.5 * (cells[1:] + cells[:-1]), DEPTHS, A_AT)
    return DippingFault(
        cells, a, B, D_C, F_0, V_0, SIGMA, G, C_S, V_P, initial_traction(), np.deg2rad(dip), NU, sense
    )  # fmt: skip
