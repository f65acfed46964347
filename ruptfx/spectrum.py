"""Highest frequency of a model by the Lanczos method, and the stable explicit time step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from ruptfx import RuptfxError, parallel

if TYPE_CHECKING:
    from ruptfx.fault import Fault
    from ruptfx.model import Model

SLIDING = 0.92
"""The largest eigenvalue of compliant contact between different meshes changes with their place by up to a tenth of its
mean or, between elements of unequal size, a sixth."""


def stable_time_step(model: Model, compliant: Sequence[Fault] | None = None, springs: bool = True) -> float:
    """Return the largest stable explicit step [s], with the contact stiffness of all or the given faults.

    With or without the springs of cohesive facets.

    2 / omega_max = dt_c without damping; with the viscous force of the previous half step eta (sqrt(1 + dt_c^2 /
    eta^2) - 1), the root of omega^2 dt^2 + 2 eta omega^2 dt = 4.

    Springs between cells are not damped; if they are the stiffest part, up to twice this step is stable. This is not
    used, because impacts of open cracks then dissipate more: twice as much in granite with a step 1.5 times as long.
    """
    stable = 2 / highest_frequency(model, compliant, springs)
    counted = model.faults if compliant is None else compliant
    if any(fault.slides and any(fault.contact.stiffness()) for fault in counted):
        stable *= SLIDING
    if model.viscosity is None:
        return stable
    eta = model.viscosity.eta
    return eta * (float(np.sqrt(1 + (stable / eta) ** 2)) - 1)


def highest_frequency(model: Model, compliant: Sequence[Fault] | None = None, springs: bool = True) -> float:
    """Return the highest angular frequency of bodies and compliant interfaces [rad/s], by the Lanczos method.

    Parameters
    ----------
    model : Model
    compliant : sequence of Fault, optional
        Interfaces whose contact stiffness is included; default is all.
    springs : bool
        Include the springs of cohesive facets, all undamaged.
    """
    counted = model.faults if compliant is None else compliant
    known, what = _known.setdefault(model, {}), (springs, *(fault.name for fault in counted))
    if what not in known:
        known[what] = _lanczos(model, counted, springs)
    return known[what]


_known: WeakKeyDictionary[Model, dict[tuple[object, ...], float]] = WeakKeyDictionary()
"""By model and what counts: damping and the step ask for the same."""


def _lanczos(model: Model, counted: Sequence[Fault], springs: bool) -> float:
    root = np.sqrt(model.free_inverse_mass())
    stiffness = [(fault, np.array(fault.contact.stiffness())) for fault in counted]
    # Unpaired surfaces that may touch later: C |u+ - u-|^2 <= 2 C (|u+|^2 + |u-|^2), with equality for equal bodies.
    later = np.zeros(model.nodes)
    for fault, springs_of in stiffness:
        nodes, lengths = fault.interface.without_partner()
        later[nodes] += 2 * springs_of.max() * lengths
    if springs and model.collisions is not None:
        later += model.collisions.without_partner()
    later = np.repeat(later, model.components) if later.any() else later[:0]
    work = np.empty_like(root)  # long vectors are allocated once: allocation costs more than arithmetic

    def apply(vector: np.ndarray, force: np.ndarray) -> None:
        """force = M^-1/2 K M^-1/2 vector."""
        u = np.multiply(root, vector, out=work)
        model.internal_force(u, at_rest=True, out=force)
        for fault, (normal, shear) in stiffness:
            if normal or shear:
                face = fault.interface
                spring = np.array([normal] * face.has_normal + [shear] * face.tangents)
                face.assemble(-spring * face.rate(u), force)
        if len(later):
            force -= later * u
        if springs and model.cracks is not None:
            between = np.zeros_like(force)
            model.cracks.add_spring_force(u, between)
            model.layout.sum_shared(between)
            force += between
        model.layout.sum_tied(force)
        force *= root
        np.negative(force, out=force)

    once = np.repeat(model.layout.once, model.components).astype(float)

    def dot(a: np.ndarray, b: np.ndarray) -> float:
        return float(parallel.total(model.comm, np.multiply(once, a, out=work) @ b))

    # A partition-independent start vector: pseudo-random in the coordinates.
    x = model.coordinates @ (np.array([12.9898, 78.233, 37.719])[: model.coordinates.shape[1]])
    scale = parallel.total(model.comm, np.abs(x[: model.owned_nodes]).sum()) / model.total_nodes
    vector = np.repeat(np.sin(4.3758e4 * x / scale), model.components) * (root > 0)
    model.layout.equalise(vector)
    vector /= np.sqrt(dot(vector, vector))
    before, w, beta = np.zeros_like(vector), np.empty_like(vector), 0.0
    diagonal: list[float] = []
    off: list[float] = []
    highest = 0.0
    for _ in range(200):
        apply(vector, w)
        before *= beta
        w -= before
        diagonal.append(dot(w, vector))
        if not np.isfinite(diagonal[-1]):
            break
        w -= np.multiply(vector, diagonal[-1], out=work)
        beta = np.sqrt(dot(w, w))
        if len(diagonal) % 10 == 0 or beta == 0:
            last, highest = highest, _largest_of(diagonal, off)
            if highest - last < 2e-3 * highest:
                break
        off.append(beta)
        w /= beta
        before, vector, w = vector, w, before
    if not np.isfinite(diagonal[-1]) or highest <= 0:
        raise RuptfxError("the highest frequency could not be found: is the mesh or a material degenerate?")
    return float(np.sqrt(highest))


def _largest_of(diagonal: list[float], off: list[float]) -> float:
    """Return the largest eigenvalue of a small symmetric tridiagonal matrix, without the import of a solver."""
    return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, -1))[-1])
