"""Cases of sections that repeat along strike."""

from __future__ import annotations

from typing import Any

from ruptfx.case import Case


def faulted(changes: dict[str, Any] | None = None) -> Case:
    """Return a small vertical fault under a free surface that creeps and slips, with ends that creep."""
    moved = [{"kind": "driven", "edge": f"upper.{edge}", "component": axis, "velocity": speed}
             for edge in ("below", "top") for axis, speed in (("x", 0.0), ("z", 1e-6))]  # fmt: skip
    moved.append({"kind": "driven", "edge": "upper.top", "component": "y", "velocity": 0.0})
    table: dict[str, Any] = {
        "plane": "solid", "order": 2, "duration": 6000.0, "boundaries": moved,
        "mesh": {"kind": "strike_slip_section", "fault_depth": 4.0, "depth": 8.0, "distance": 4.0, "element_size": 1.0,
                 "growth": 1.3, "along_strike": {"length": 5.0, "period": 8.0, "points": 16, "creep": 2e-6}},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 3e9, "poisson_ratio": 0.25,
                                  "density": 1200.0}},
        "faults": {"main": {
            "contact": {"kind": "compliant", "C_n": 1e13, "C_s": 1e13}, "initial_stress": {"normal": 5e6},
            "friction": {"kind": "rate_and_state_ageing", "b": 0.014, "D_c": 1e-4, "f_0": 0.6, "V_0": 1e-6,
                         "theta_initial": 100.0, "V_initial": 1e-6,
                         "a": {"kind": "rectangle", "strike": [-1.5, 1.5], "dip": [0.0, 2.0], "inside": 0.008,
                               "outside": 0.02}},
        }},
        "stepper": {"kind": "quasi_dynamic"}, "output": {"figures": False, "interface_steps": 10},
    }  # fmt: skip
    for key, value in (changes or {}).items():
        *path, last = key.split(".")
        part = table
        for name in path:
            part = part[name]
        part[last] = value
    return Case.model_validate(table)
