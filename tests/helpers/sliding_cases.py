"""Small cases of interfaces that slide, as tables."""

from __future__ import annotations

from typing import Any

from helpers.small_cases import merged

STIFF = {"kind": "isotropic_elastic", "young_modulus": 5.3e9, "poisson_ratio": 0.25, "density": 1246.0}
SOFT = {**STIFF, "young_modulus": 3.392e9}


def wave(side: int, amplitude: float = 10e-6) -> dict[str, Any]:
    """Of one side of two opposed waves, whose crests touch at height zero."""
    return {"kind": "sinusoid", "mean": side * amplitude, "amplitude": -side * amplitude, "wavelength": 0.6e-3}


SLIDES = {
    "contact": {"kind": "forward_lagrange"}, "friction": {"kind": "coulomb", "mu_d": 0.3},
    "initial_stress": {"normal": 0.0}, "sliding": {},
}  # fmt: skip


def rough(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """Two rough bodies of different materials and elements, the lower one held, the upper one pressed."""
    body = {"length": 1.2e-3, "height": 0.5e-3, "element_size": 0.1e-3, "profile": wave(1)}
    return merged({
        "plane": "strain", "order": 2, "duration": 2e-6,
        "mesh": {
            "kind": "rough_plates", "curve_order": 2, "upper": body,
            "lower": {**body, "left": -0.3e-3, "length": 2.4e-3, "element_size": 0.137e-3, "profile": wave(-1)},
        },
        "materials": {"upper": STIFF, "lower": SOFT},
        "faults": {"main": SLIDES},
        "boundaries": [
            {"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"
        ] + [
            {"kind": "traction", "edge": "upper.top", "traction": [0.0, -20e6], "ramp": 1e-6},
            {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 10.0},
        ],
        "output": {"figures": False},
    }, changes or {})  # fmt: skip


def solids(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """Two flat solids of different elements, the lower one held, the upper one pressed and dragged obliquely."""
    return merged({
        "plane": "solid", "order": 2, "duration": 2e-6,
        "mesh": {
            "kind": "rough_plates", "curve_order": 1,
            "upper": {"length": 1.5e-3, "width": 1e-3, "height": 0.5e-3, "element_size": 0.5e-3},
            "lower": {"length": 2.7e-3, "left": -0.3e-3, "width": 2.7e-3, "front": -0.3e-3, "height": 0.4e-3,
                      "element_size": 0.39e-3},
        },
        "materials": {"upper": STIFF, "lower": SOFT},
        "faults": {"main": SLIDES},
        "boundaries": [
            {"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xyz"
        ] + [
            {"kind": "traction", "edge": "upper.top", "traction": [0.0, 0.0, -20e6], "ramp": 1e-6},
            {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 8.0},
            {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": 6.0},
        ],
        "output": {"figures": False},
    }, changes or {})  # fmt: skip
