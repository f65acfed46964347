"""Cases made of a demo that keep its mesh, materials and laws, and on which transformations of any direction can act.

`uniform` is free at all edges and slips by one force in the bodies; `welded` is linear, as its interfaces never slip.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from helpers.moved_cases import faults
from ruptfx.bodies.meshes import RawMesh
from ruptfx.case import parse_case
from ruptfx.input.schema import kinds

Table = dict[str, Any]
PROFILES = {*kinds("ruptfx.input.profiles")} - {"linear", "exponential"}
PRESSURE = 1e6  # of uniform interfaces whose normal stress varies in the demo [Pa]
CLAMPED = 1e9  # normal stress of welded interfaces [Pa], far above the stress of the loads
PUSH = 30.0  # force over normal stress and the face of an element, enough for slip
LOADED = ("stages", "boundaries", "instruments", "attachments", "initial_velocity", "initial_stress", "positions")
SILENT = ("absorbing", "sponge")


def has_profiles(node: Any) -> bool:
    """Return whether a table has a profile along an interface or in a body."""
    if isinstance(node, list):
        return any(has_profiles(each) for each in node)
    if not isinstance(node, dict):
        return False
    return node.get("kind") in PROFILES or any(has_profiles(each) for each in node.values())


def centre_beside(mesh: RawMesh, side: int, part: float) -> tuple[list[float], float]:
    """Return the centre of a cell beside the first interface, or in the middle of the bodies, and its diameter [m].

    Parameters
    ----------
    side : int
        0 of the plus side, 1 of the minus side.
    part : float
        Of the way along x.
    """
    places = mesh.points[:, :2]
    centres = mesh.points[mesh.cells].mean(axis=1)
    if mesh.interfaces:
        facets = next(iter(mesh.interfaces.values()))[side]
        rows = np.flatnonzero(np.isin(mesh.cells, facets).sum(axis=1) >= facets.shape[1])
        target = mesh.points[facets].mean(axis=(0, 1))
        places = mesh.points[np.unique(facets), :2]
    else:
        rows, target = np.arange(len(centres)), centres.mean(axis=0)
    target[0] = places[:, 0].min() + part * np.ptp(places[:, 0])
    cell = rows[np.argmin(np.linalg.norm(centres[rows] - target, axis=1))]
    return centres[cell].tolist(), float(np.ptp(mesh.points[mesh.cells[cell]], axis=0).max())


def _plain(table: Table) -> Table:
    """Return a case without loads, profiles and instruments."""
    result = copy.deepcopy(table)
    for key in LOADED:
        result.pop(key, None)
    for fault in faults(result):
        fault["nucleation"] = []
        fault.pop("cohesion", None)
    return result


def uniform(table: Table) -> Table:
    """Return a free case with a force next to an interface; laws with profiles are slip weakening by numbers."""
    result, mesh = _plain(table), parse_case(table).mesh.build()
    point, size = centre_beside(mesh, 0, 0.4)
    extent = float(np.ptp(mesh.points, axis=0).max())
    for fault in faults(result):
        normal = fault.get("initial_stress", {}).get("normal")
        fault["initial_stress"] = {"normal": normal if isinstance(normal, float) else PRESSURE}
        if has_profiles(fault["friction"]):
            fault["friction"] = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 1e-6 * extent}
    largest = max(fault["initial_stress"]["normal"] for fault in faults(result))
    dim = mesh.points.shape[1]
    force = (np.array([1.0, -0.3, 0.5])[:dim] * PUSH * largest * size ** (dim - 1)).tolist()
    result["boundaries"] = [{"kind": "point_force", "point": point, "force": force, "ramp": 0.3 * table["duration"]}]
    return result


def welded(table: Table, silent: bool = True) -> Table:
    """Return a linear case without loads: interfaces are clamped, absorbing edges stay where `silent`, driven rest."""
    result = _plain(table)
    for fault in faults(result):
        fault["initial_stress"] = {"normal": CLAMPED}
        fault["friction"] = {"kind": "coulomb", "mu_d": 1e6}
    kept = [b for b in table.get("boundaries", []) if silent and b["kind"] in SILENT]
    fixed = [{k: b[k] for k in ("kind", "edge", "component")} | {"velocity": 0.0}
             for b in table.get("boundaries", []) if b["kind"] == "driven"]  # fmt: skip
    result["boundaries"] = kept + fixed
    result["output"]["bulk_fields"] = ["displacement", "velocity"]
    return result
