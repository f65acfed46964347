"""Seismic cycles of a fault of 100 x 40 km in a half-space: SCEC SEAS benchmark problem BP5-QD, quasi-dynamic.

Rate and state friction with the ageing law; velocity weakening in a core of 60 x 12 km that begins 4 km deep, with a
rim of 2 km. Around the fault the plates creep at 1e-9 m/s. In a square at one end of the core D_c is smaller, and a
higher slip rate at the start nucleates the first event there. The section of the half-space repeats along strike
(`mesh.along_strike`), with a period beyond the fault that creeps.

Compared with published results of codes with boundary elements: later events every 235 years or so, up to 250 years in
volume codes with finite boxes (Jiang et al. 2022). Derived from the parameters: initial age and traction; and the
moment that the plates supply between events: mu V_p times the area of the core.

Coarse: points 2 km apart, two events. With `--fine`: 1 km, 1000 years, again with a longer period along strike.

Source: Jiang et al. (2022), Community-driven code comparisons for three-dimensional dynamic modeling of sequences of
earthquakes and aseismic slip, J. Geophys. Res. 127, e2021JB023519.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.case import Case

if TYPE_CHECKING:

    pass

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
