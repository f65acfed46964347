"""Small cases of bodies that break; the meshes come from the plug-in `crack_meshes.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from helpers.small_cases import merged
from ruptfx.case import Case, parse_case

HERE = Path(__file__).parent
GRANITE = {"kind": "isotropic_elastic", "young_modulus": 50e9, "poisson_ratio": 0.25, "density": 2600.0}
WEAK = {"kind": "linear", "f_t": 4e6, "c": 10e6, "G_Ic": 20.0, "G_IIc": 60.0}
NEVER = {"kind": "linear", "f_t": 1e12, "c": 1e12, "G_Ic": 1e6, "G_IIc": 1e6}
BRITTLE = {"kind": "linear", "f_t": 1e6, "c": 1.5e6, "G_Ic": 0.01, "G_IIc": 0.03}
RUBS = {"kind": "coulomb", "mu_d": 0.6}
SOFT = {"kind": "compliant", "C_n": 2e14, "C_s": 1e14}


def block(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """A block that is torn apart: it breaks within 7 us, and the pieces touch again."""
    table = {
        "plugins": [str(HERE / "crack_meshes.py")], "plane": "strain", "order": 1, "duration": 10e-6,
        "mesh": {"kind": "triangles", "width": 8e-3, "height": 10e-3, "element_size": 1e-3, "turn": 0.25},
        "materials": {"default": GRANITE},
        "fracture": {"kind": "intrinsic", "default": {"cohesion": WEAK, "friction": RUBS}},
        "boundaries": [
            {"kind": "driven", "edge": "rock.top", "component": "y", "velocity": 3.0, "ramp": 1e-6},
            {"kind": "driven", "edge": "rock.bottom", "component": "y", "velocity": 0.0},
        ],
        "output": {"figures": False, "interface_interval": 1e-6, "bulk_interval": 5e-6},
    }  # fmt: skip
    return merged(table, changes or {})


def joined_bar(
    stepper: dict[str, Any], toughness: float, duration: float, changes: dict[str, Any] | None = None
) -> dict[str, Any]:
    """A bar of strong halves that are pulled apart along y at 1 mm/s; the facets between them may fail.

    It has no lateral contraction, so stress is uniform until they do.
    """
    weak = {"kind": "linear", "f_t": 4e6, "c": 10e6, "G_Ic": toughness, "G_IIc": 3 * toughness}
    ends = [("upper.top", "y", 1e-3), ("lower.bottom", "y", 0.0), ("upper.top", "x", 0.0), ("lower.bottom", "x", 0.0)]
    return block({
        "plane": "stress", "stepper": stepper, "duration": duration,
        "materials.default": {**GRANITE, "poisson_ratio": 0.0},
        "mesh": {"kind": "triangles", "width": 4e-3, "height": 8e-3, "element_size": 1e-3, "divide": 4e-3, "turn": 0.2},
        "fracture": {"kind": "intrinsic", "unresolved": True, "default": {"cohesion": NEVER, "friction": RUBS},
                     "pairs": {"lower-upper": {"cohesion": weak, "friction": RUBS}}},
        "boundaries": [{"kind": "driven", "edge": edge, "component": component, "velocity": speed, "ramp": 1e-4}
                       for edge, component, speed in ends],
        "output.interface_interval": 1e-4, "output.bulk_interval": 1e-3,
        **(changes or {}),
    })  # fmt: skip


def meeting_blocks(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """A brittle block that hits another one obliquely and breaks to pieces, which rub against each other."""
    brittle = {"kind": "linear", "f_t": 4e6, "c": 6e6, "G_Ic": 1.0, "G_IIc": 3.0}
    table = {
        "plane": "strain", "order": 1, "duration": 1.2e-5, "large_rotations": True,
        "mesh": {"kind": "pieces", "element_size": 1e-3, "bodies": {
            "plate": {"kind": "rectangle", "center": [0.0, 0.0], "width": 10e-3, "height": 2e-3},
            "stone": {"kind": "rectangle", "center": [0.3e-3, 2.95e-3], "width": 3e-3, "height": 3e-3, "angle": 20.0},
        }},
        "materials": {"default": GRANITE},
        "fracture": {"kind": "intrinsic", "unresolved": True, "default": {"cohesion": brittle, "friction": RUBS}},
        "collisions": {"kind": "potential", "activate_at": 0.1},
        "initial_velocity": {"stone": [30.0, -60.0]},
        "boundaries": [{"kind": "driven", "edge": "plate.bottom", "component": "y", "velocity": 0.0}],
        "output": {"figures": False, "interface_interval": 2e-6, "bulk_interval": 1e-5},
    }  # fmt: skip
    return merged(table, changes or {})


def faulted(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """A fault between two blocks that ruptures from its middle at 4 us; the facets beside it may break."""
    table = {
        "plugins": [str(HERE / "crack_meshes.py")], "plane": "strain", "order": 1, "duration": 4e-6, "positions": "x",
        "mesh": {"kind": "triangles", "width": 30e-3, "height": 20e-3, "element_size": 1e-3, "divide": 10e-3,
                 "fault": True, "turn": 0.2},
        "materials": {"default": GRANITE},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "initial_stress": {"tensor": [-10e6, -10e6, 5.5e6]},
            "friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 2e-6},
            "nucleation": [{"kind": "overstress", "extra": {
                "kind": "gaussian", "background": 0.0, "amplitude": 4e6, "center": 15e-3, "width": 4e-3}}],
        }},
        "fracture": {"kind": "intrinsic", "unresolved": True, "default": {"cohesion": NEVER, "friction": RUBS}},
        "output": {"figures": False, "interface_interval": 5e-7, "bulk_interval": 2e-6},
    }  # fmt: skip
    return merged(table, changes or {})


def beside_branches(kind: str, contact: dict[str, Any]) -> dict[str, Any]:
    """Changes of `branched` after which facets beside the fault and its branch break within 5 us."""
    patch = {"kind": "boxcar", "inside": 0.9e6, "outside": 0.0, "center": -4e-3, "half_width": 2e-3}
    stress = {"tensor": [-9e6, -9e6, 5e6]}
    return {
        "plugins": [str(HERE / "crack_meshes.py")], "order": 1, "duration": 5e-6, "stepper": {"kind": "leapfrog"},
        "mesh.kind": "branched_triangles", "mesh.element_size": 0.5e-3, "mesh.growth": 1.3,
        "faults.main.nucleation": [{"kind": "overstress", "extra": patch}],
        **{f"faults.{name}.initial_stress": stress for name in ("main", "branch")},
        **{f"faults.{name}.contact": contact for name in ("main", "branch")},
        "fracture": {"kind": kind, "unresolved": True, "default": {"cohesion": BRITTLE, "friction": RUBS}},
    }  # fmt: skip


def case(changes: dict[str, Any] | None = None) -> Case:
    return parse_case(block(changes), HERE)
