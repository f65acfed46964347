"""Kelvin-Voigt damping of a case: which elements, and how much of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies import operators
from ruptfx.bodies.space.closest import closest
from ruptfx.bodies.spectrum import highest_frequency, stable_time_step
from ruptfx.input.schema import CaseError, nearest
from ruptfx.interfaces.mechanisms.system import Viscosity
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.case import Case
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.steppers import Stepper


def viscous_layer(model: System, case: Case) -> Viscosity | None:
    """Return the Kelvin-Voigt damping next to the interfaces."""
    given = case.damping.kelvin_voigt
    if given is None:
        return None
    centres = fem.dolfinx.mesh.compute_midpoints(
        model.mesh, model.mesh.topology.dim, np.arange(len(model.bodies.cell_body), dtype=np.int32)
    )[:, : model.mesh.geometry.dim]
    points = [parallel.share_rows(model.comm, fault.interface.surface_points) for fault in model.faults]
    if model.cracks is not None:
        for name in ("thickness", "bodies"):
            if getattr(given, name) is not None:
                raise CaseError(f"damping.kelvin_voigt.{name}: cracked bodies are damped everywhere; leave it out")
        chosen = np.ones(len(model.bodies.cell_body), dtype=bool)
    elif given.beta_2 is not None:
        chosen = np.ones(len(model.bodies.cell_body), dtype=bool)
    elif given.bodies is not None:
        chosen = np.isin(model.bodies.cell_body, _numbers(model, "damping.kelvin_voigt.bodies", given.bodies))
    elif not points:
        raise CaseError("damping.kelvin_voigt: there is no interface; name bodies, or use damping.mass")
    else:
        chosen = _near(model, np.concatenate(points), centres, given.thickness)
    if not parallel.total(model.comm, chosen.sum()):
        raise CaseError(
            f"damping.kelvin_voigt.thickness = {given.thickness:.4g} m: no element has its centre there"
            if given.thickness is not None
            else "damping.kelvin_voigt.bodies: name a body at least"
        )
    if given.beta_2 is not None:
        eta = (given.beta_2 - 0.5) * _damped_step(model, case.stepper, given.beta_2)
    else:
        eta = given.eta or parallel.three_digits(given.fraction * 2 / highest_frequency(model))
    bulk, rotates = replace(model.bulk, only=chosen, large_rotations=False), model.bulk.large_rotations
    touched = np.zeros(model.nodes, dtype=bool)
    owned = model.mesh.topology.index_map(model.mesh.topology.dim).size_local
    touched[model.space.dofmap.list[:owned][chosen[:owned]]] = True
    if not chosen[:owned].any():
        chosen[0] = True  # an operator needs an element; its nodes are not touched
    operator = operators.create(case.operator, replace(bulk, large_rotations=rotates), case.loaded)
    if rotates and not isinstance(operator, operators.ViscousOperator):
        raise CaseError(
            f"damping.kelvin_voigt: operator = '{case.operator}' does not damp bodies that rotate; use 'matrix_free'"
        )
    return Viscosity(eta, bulk, operator, touched, everywhere=model.cracks is not None, rotates=rotates)


def _damped_step(model: System, stepper: Stepper, beta_2: float) -> float:
    """Return the time step that a stepper takes with the numerical damping of `beta_2` [s].

    With eta = k dt, k = beta_2 - 1/2, its rule dt = safety eta (sqrt(1 + (dt_c / eta)^2) - 1) can be solved for dt.
    """
    step, safety = getattr(stepper, "time_step", None), getattr(stepper, "safety", None)
    if step is not None:
        return float(step)
    if safety is None:
        raise CaseError(
            f"damping.kelvin_voigt.beta_2: stepper '{stepper.kind}' has no time step that stability sets; give eta"
        )
    part = beta_2 - 0.5
    return float(stable_time_step(model) / (part * np.sqrt((1 + 1 / (part * safety)) ** 2 - 1)))


def _numbers(model: System, key: str, names: list[str]) -> list[int]:
    """Return the numbers of bodies by their names."""
    for name in names:
        if name not in model.bodies.names:
            raise CaseError(f"{key} = '{name}': no such body, {nearest(name, model.bodies.names)}")
    return [model.bodies.names.index(name) for name in names]


def _near(model: System, points: np.ndarray, centres: np.ndarray, thickness: float | None) -> np.ndarray:
    """Return a mask of cells with a centre within `thickness` of the points, or a node at one if it is None."""
    if thickness is None:
        dofs, x = model.space.dofmap.list, model.coordinates
        close = 1e-6 * np.linalg.norm([np.ptp(of_axis[dofs], axis=1) for of_axis in x.T], axis=0)
        # Distances of the other cells are not needed.
        low, high = points.min(axis=0) - close.max(initial=0.0), points.max(axis=0) + close.max(initial=0.0)
        there = np.flatnonzero(((x >= low) & (x <= high)).all(axis=1))
        distance = np.full(len(x), np.inf)
        distance[there] = closest(x[there], points)[0]
        return np.asarray(distance[dofs].min(axis=1) < close)
    return np.asarray(closest(centres, points)[0] <= thickness)
