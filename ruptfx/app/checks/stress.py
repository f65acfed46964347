"""Rows of `ruptfx check` on the initial stress of the bodies: equilibrium, interfaces, edges, yield."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ruptfx.bodies.initial_stress import BodyStress, matrices, tractions
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.platform import fem
from ruptfx.run.model import Model

BALANCED = 1e-6
"""Largest unbalanced part of a force or traction that may be rounding of central differences."""
STEP = 0.2
"""Distance of central differences over the radius of an element: points between two layers do not meet both."""


def stress_rows(model: Model) -> Iterator[Row]:
    """Yield what is not in equilibrium with the initial stress, and how near to yield the bodies are."""
    stress = model.case.initial_stress
    if stress is not None:
        yield _equilibrium(model, stress)
        yield from _interfaces(model, stress)
        yield from _edges(model, stress)
    yield from _yield(model)


def _equilibrium(model: Model, stress: BodyStress) -> Row:
    """Compare the divergence of the total stress with the weight at the centres of elements."""
    mesh, dim = model.mesh, model.mesh.geometry.dim
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    points = fem.dolfinx.mesh.compute_midpoints(mesh, dim, cells)[:, :dim]
    corners = mesh.geometry.x[fem.geometry_dofmap(mesh)[cells]][:, :, :dim]
    step = STEP * np.abs(corners - points[:, None]).min(axis=(1, 2), where=corners != points[:, None], initial=np.inf)
    density = np.array([material.density for material in model.materials])[model.bodies.cell_body[cells]]
    if model.variation is not None:
        density = model.variation.evaluate(lambda material, _: material.density)[cells].mean(axis=1)
    weight = density[:, None] * stress.acceleration(dim)
    imbalance = np.linalg.norm(stress.divergence(points, step) + weight, axis=1)
    scale = max(np.linalg.norm(weight, axis=1).max(initial=0.0), _largest(stress.effective(points)) / _extent(model))
    worst = int(np.argmax(imbalance))
    key = "initial stress: unbalanced force"
    if imbalance[worst] <= BALANCED * scale:
        return Row(key, float(imbalance[worst]), "N/m3", "of the total stress and the weight of the bodies")
    note = (
        f"at ({_text(points[worst])}) m, where the bodies weigh {np.linalg.norm(weight[worst]):.4g} N/m3 by "
        f"materials.*.density = {density[worst]:.5g} kg/m3; the run takes this force as balanced"
    )
    return Row(key, float(imbalance[worst]), "N/m3", note, "warning")


def _interfaces(model: Model, stress: BodyStress) -> Iterator[Row]:
    """Compare the tractions of interfaces with those of the bodies on them."""
    for fault in model.faults:
        face = fault.interface
        normal, shear = tractions(stress.effective(face.points), face.frame)
        apart = np.hypot(fault.normal_stress_0 - normal, np.linalg.norm(fault.shear_traction_0 - shear, axis=1))
        worst = int(np.argmax(apart))
        key = f"faults.{fault.name}: unbalanced initial traction"
        if apart[worst] <= BALANCED * _largest(stress.effective(face.points)):
            yield Row(key, float(apart[worst]), "Pa", "against the stress of the bodies")
        else:
            note = (
                f"at ({_text(face.points[worst])}) m: normal {fault.normal_stress_0[worst]:.5g}, of the bodies "
                f"{normal[worst]:.5g} Pa; without faults.{fault.name}.initial_stress they are equal"
            )
            yield Row(key, float(apart[worst]), "Pa", note, "warning")


def _edges(model: Model, stress: BodyStress) -> Iterator[Row]:
    """Yield the largest traction of edges on which no boundary acts, a constant load of the bodies."""
    loaded = {getattr(boundary, "edge", None) for _, boundary in model.case.all_boundaries()}
    dim = model.mesh.geometry.dim
    largest = _largest(stress.effective(model.coordinates))
    for name in model.bodies.edges:
        if name in loaded:
            continue
        edge = model.loads.edge(name, "boundaries")
        middle = fem.dolfinx.mesh.compute_midpoints(model.mesh, dim - 1, edge.facets)[:, :dim]
        total_stress = matrices(stress.effective(middle)) - stress.pore_pressure(middle)[:, None, None] * np.eye(3)
        corner = np.linalg.norm(np.einsum("nij,nj->ni", total_stress[:, :dim, :dim], edge.normals()), axis=1)
        value = float(corner.max(initial=0.0))
        if value > BALANCED * largest:
            note = "no boundary acts on it: it keeps this traction of the bodies"
            yield Row(f"{name}: initial load", value, "Pa", note)


def _yield(model: Model) -> Iterator[Row]:
    """Yield how much of the strength of materials the initial stress needs."""
    for number, (name, material) in enumerate(zip(model.bodies.names, model.given, strict=True)):
        cells = np.flatnonzero(model.bodies.cell_body == number)
        varies = model.variation is not None and model.variation.varies(number)
        local = model.variation.local(number) if varies and model.variation is not None else material
        part = local.yielded()
        if part is None or not len(cells):
            continue
        worst = int(np.argmax(part))
        note = "uniform"
        if varies and model.variation is not None and part.size > 1:
            note = f"largest at ({_text(model.variation.points(cells).reshape(part.size, -1)[worst])}) m"
        yield Row(f"{name}: initial stress over yield", float(part.flat[worst]), "1", note)


def _largest(stress: np.ndarray) -> float:
    return float(np.abs(stress).max(initial=0.0))


def _extent(model: Model) -> float:
    return float(np.ptp(model.coordinates, axis=0).max(initial=0.0))


def _text(point: np.ndarray) -> str:
    return ", ".join(f"{x:.6g}" for x in point)
