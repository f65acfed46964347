"""Cases on mapped meshes, and numbers of runs as they are after a motion: rotations, reflections and translations."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np

from helpers.run_data import Data, Run
from ruptfx.input.fields import STRESSES
from ruptfx.results.summary_fields import UNITS_OF_FRACTURE

Table = dict[str, Any]
PLUGIN = str(Path(__file__).parent / "moved_mesh.py")
ALONG = ("slip", "slip_rate", "shear_traction", "displacement_jump", "cohesive_slip", "added_shear")
"""Numbers along the tangent of an interface, which a reflection turns round."""
VECTORS = ("displacement", "velocity", "points", "normal")
WITHOUT_AXES = ("position", "paired_position", "dip", "c_s_dip", "shear_modulus_11", "shear_modulus_22",
                "shear_modulus_12")  # fmt: skip
"""Numbers of an interface that depend on the directions of its tangents or on where positions begin."""


def loads(table: Table) -> list[Table]:
    """Return the boundaries of a case and of its stages."""
    return [*table.get("boundaries", []), *(b for stage in table.get("stages", []) for b in stage["boundaries"])]


def faults(table: Table) -> list[Table]:
    return list(table.get("faults", {}).values())


def on_mesh(table: Table, matrix: np.ndarray, offset: np.ndarray, **keys: Any) -> Table:
    """Return a case on the mesh of the plug-in `moved_mesh`, without what names points of the mesh before."""
    result = copy.deepcopy(table)
    result.pop("positions", None)
    result["instruments"] = []
    result["plugins"] = [PLUGIN]
    result["mesh"] = {"kind": "moved_mesh", "source": table["mesh"], "matrix": matrix.tolist(),
                      "offset": offset.tolist(), **keys}  # fmt: skip
    return result


def moved(table: Table, matrix: np.ndarray, offset: np.ndarray, **keys: Any) -> Table:
    """Return a case on the mapped mesh, with its directions and places mapped.

    Components and ranges of edges need a matrix that maps axes to axes.
    """
    result, axes = on_mesh(table, matrix, offset, **keys), "xyz"[: len(matrix)]
    for boundary in loads(result):
        if boundary["kind"] == "driven":
            old = axes.index(boundary["component"])
            new = int(np.argmax(np.abs(matrix[:, old])))
            boundary |= {"component": axes[new], "velocity": boundary["velocity"] * float(matrix[new, old])}
        for key in ("traction", "force"):
            if key in boundary:
                boundary[key] = (matrix @ boundary[key]).tolist()
        if "point" in boundary:
            boundary["point"] = (matrix @ boundary["point"] + offset).tolist()
        ranges = {axis: boundary.pop(f"{axis}_range", None) for axis in axes}
        for old, limits in enumerate(ranges.values()):
            if limits is not None:
                new = int(np.argmax(np.abs(matrix[:, old])))
                boundary[f"{axes[new]}_range"] = sorted(float(matrix[new, old] * v + offset[new]) for v in limits)
    for material in result["materials"].values():
        if material["kind"] == "orthotropic_elastic":  # directions of fibres
            turn = float(np.arctan2(matrix[1, 0], matrix[0, 0]))
            material["angle"] = material.get("angle", 0.0) * float(np.linalg.det(matrix)) + turn
    for body, velocity in result.get("initial_velocity", {}).items():
        result["initial_velocity"][body] = (matrix @ velocity).tolist()
    return result


def placed(run: Run, matrix: np.ndarray, offset: np.ndarray) -> Run:
    """Return the numbers of a run as they are after a motion, in an order that does not depend on the numbering."""
    result = {name: data for name, data in run.items() if not name.startswith("instruments")}
    dim = len(matrix)
    axes = "xyz"[:dim]

    def put(name: str, values: np.ndarray) -> None:
        result[name] = Data(values, result[name].unit)

    for name in list(result):
        base = name.removesuffix("x")
        if name.endswith(("_x", ":x")) and all(base + axis in result for axis in axes):
            vector = np.stack([result[base + axis].values for axis in axes], axis=-1) @ matrix.T
            is_place = name.endswith((":x", ":deformed_x", ":paired_x"))
            vector = vector + offset if is_place else vector
            for number, axis in enumerate(axes):
                put(base + axis, vector[..., number])
    for name in [f"{file}:{vector}" for file in ("bulk.h5", "cracks.h5") for vector in VECTORS]:
        if name in result:
            put(name, result[name].values[..., :dim] @ matrix.T + offset * name.endswith("points"))
    if "bulk.h5:stress" in result:
        entries = list(STRESSES[dim].values())
        stress = np.zeros((*result["bulk.h5:stress"].values.shape[:-1], dim, dim))
        for number, (i, j) in enumerate(entries):
            stress[..., i, j] = stress[..., j, i] = result["bulk.h5:stress"].values[..., number]
        turned = matrix @ stress @ matrix.T
        put("bulk.h5:stress", np.stack([turned[..., i, j] for i, j in entries], axis=-1))
    if dim == 2 and np.linalg.det(matrix) < 0:
        for name in result:
            if name.startswith("interface") and name.partition(":")[2] in ALONG:
                put(name, -result[name].values)
    return ordered(without_tangents(result))


def without_tangents(run: Run) -> Run:
    """Return the numbers of a run with the lengths of tangential vectors for their components along two tangents."""
    result = dict(run)
    for name in run:
        if name.startswith(("interface", "forces")) and name.endswith("_1") and name[:-1] + "2" in run:
            first, second = result.pop(name), result.pop(name[:-1] + "2")
            result[name.removesuffix("_1")] = Data(np.hypot(first.values, second.values), first.unit)
    return result


def ordered(run: Run) -> Run:
    """Return the numbers of points by the place of the points; what only numbers them is left out."""
    result = dict(run)
    for file in {name.partition(":")[0] for name in run}:
        if file.startswith("interface"):
            places = np.stack([run[f"{file}:{axis}"].values for axis in "xyz" if f"{file}:{axis}" in run], axis=1)
            size = places
        elif file == "bulk.h5":
            size = run["bulk.h5:points"].values
            places = np.column_stack([size, run["bulk.h5:body"].values]) if "bulk.h5:body" in run else size
        else:
            continue
        grid = np.round(places / (1e-6 * np.ptp(size, axis=0).max()))
        if len(np.unique(grid, axis=0)) < len(grid):  # cells have nodes of their own
            result = {name: data for name, data in result.items() if not name.startswith("bulk.h5")}
            continue
        order = np.lexsort(grid.T[::-1])
        for name, data in run.items():
            shape = np.shape(data.values)
            if name.startswith(f"{file}:") and len(places) in shape:
                result[name] = Data(np.take(data.values, order, axis=shape.index(len(places))), data.unit)
    if "bulk.h5:points" in result and result["bulk.h5:points"].values.shape[1] > 2:
        result.pop("bulk.h5:fringe", None)  # of light along z
    specimen = [f"summary.json:{name}" for name in UNITS_OF_FRACTURE if name != "failed_length"]
    left_out = {"bulk.h5:cells", "bulk.h5:body_of_cell", *specimen, "summary.json:first_peak_strain"}
    # The specimen is of the mesh kind `specimen` only.
    left_out |= {name for name in result if name.startswith(("cracks.h5", "events.h5"))}
    left_out |= {n for n in result if n.startswith("interface") and n.partition(":")[2] in WITHOUT_AXES}
    return {name: data for name, data in result.items() if name not in left_out}
