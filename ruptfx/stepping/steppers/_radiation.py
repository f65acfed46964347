"""Radiation damping: traction per slip rate of the waves that leave a fault."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.laws.materials import Material
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.discretisation import Discretisation
    from ruptfx.bodies.space.variation import Variation


def radiation_impedance(model: Discretisation, fault: Fault) -> np.ndarray:
    """Return the traction per slip rate of plane waves that leave both sides [Pa s/m], shape (n,); collective.

    (1/Z+ + 1/Z-)^-1 with the impedances of the bodies along the normal: mu / (2 c_s) between equal isotropic ones and
    Z+ on a rigid base. At points shared by welded bodies it is their mean by area.

    Raises
    ------
    CaseError
        On all ranks, if it depends on the direction of slip, or slip would radiate normal stress.
    """
    face = fault.interface
    plus = _side(model, fault, "plus")
    if not face.elastic_sides:
        both = plus
    else:
        if face.one_sided:  # the mirror image
            normal = face.frame[:, 0] if face.has_normal else np.zeros((len(plus), 1))
            mirror = np.eye(normal.shape[1]) - 2 * normal[:, :, None] * normal[:, None, :]
            minus = mirror @ plus @ mirror
        else:
            minus = _side(model, fault, "minus")
        both = np.linalg.inv(np.linalg.inv(plus) + np.linalg.inv(minus))
    local = face.frame @ both @ face.frame.swapaxes(1, 2)
    shear = local[:, face.has_normal :, face.has_normal :]
    mean = np.trace(shear, axis1=1, axis2=2) / face.tangents
    left_out = local[:, :, face.has_normal :].copy()
    left_out[:, face.has_normal :] -= mean[:, None, None] * np.eye(face.tangents)
    worst = parallel.largest(model.comm, float((np.abs(left_out).max(axis=(1, 2)) / mean).max(initial=0.0)))
    if worst > 1e-6:
        raise CaseError(
            f"stepper.radiation_damping: between the anisotropic bodies of faults.{fault.name} it would depend on the "
            f"direction of slip, or change the normal stress, by {worst:.2g} of itself; use kind = 'hybrid'"
        )
    return mean


def _side(model: Discretisation, fault: Fault, side: str) -> np.ndarray:
    """Return the impedance of the bodies on one side of every point, shape (n, components, components)."""
    face, bodies = fault.interface, model.bodies
    nodes = face.plus if side == "plus" else face.minus
    measure = model.edge_measure(tuple(bodies.tags[f"{name}.{side}"] for name in bodies.interfaces))
    test = model.sum_of(fem.ufl.TestFunction(model.space))
    result, area, error = np.zeros((len(nodes), model.components, model.components)), np.zeros(len(nodes)), None
    for index, material in enumerate(model.materials):
        inside = model.by_cell(bodies.cell_body == index)
        areas = model.layout.reduce_tied(fem.assemble_summed(model.space, inside * test * measure))
        share = areas.reshape(model.nodes, -1)[nodes, 0]
        area += share
        try:
            of_body = _impedance(material, fault, model)
            if model.variation is None or not model.variation.varies(index):
                result += share[:, None, None] * of_body
                continue
            # Their mean by area; waves along the normal and across it have moduli of their own.
            normal = face.frame[:, 0] if face.has_normal else np.zeros((len(nodes), 1))
            along = normal[:, :, None] * normal[:, None, :]
            across = np.eye(model.components) - along
            for part, is_normal in ((along, True), (across, False)):
                size = np.einsum("nij,nij->n", of_body, part) / np.maximum(np.trace(part, axis1=1, axis2=2), 1e-300)
                relative = _relative(model.variation, index, is_normal)
                weighted = fem.assemble_summed(model.space, inside * relative * test * measure)
                weighted = model.layout.reduce_tied(weighted)
                result += (weighted.reshape(model.nodes, -1)[nodes, 0] * size)[:, None, None] * part
        except RuptfxError as caught:
            error = caught
    parallel.raise_on_all(model.comm, error)
    return result / area[:, None, None]


def _relative(variation: Variation, index: int, along_normal: bool) -> fem.Expr:
    """Return the impedance of a body whose parameters vary over that of its reference, as a function."""
    reference = variation.impedance(variation.references[index], index, along_normal, 1.0)
    return variation.function(variation.evaluate(
        lambda material, body: variation.impedance(material, body, along_normal, 1.0) / reference
    ))  # fmt: skip


def _impedance(material: Material, fault: Fault, model: Discretisation) -> np.ndarray:
    """Return the impedance along the normal of every point, shape (n or 1, components, components)."""
    if fault.interface.has_normal:
        return material.impedance(fault.interface.frame[:, 0], model.plane)
    axes = material.impedance(np.eye(model.mesh.geometry.dim), model.plane)
    if np.ptp(axes) > 1e-6 * axes.max():
        raise CaseError(
            f"stepper.radiation_damping: the impedance of '{material.kind()}' depends on the direction of the normal, "
            "which antiplane faults do not know; use kind = 'hybrid'"
        )
    return axes[:1]
