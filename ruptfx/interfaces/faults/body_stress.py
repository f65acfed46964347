"""Initial stress of the bodies: that of the case, or an assumed one that carries the tractions of an interface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx.bodies.initial_stress import matrices
from ruptfx.interfaces.faults.interface import local_frame
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.bodies.initial_stress import BodyStress
    from ruptfx.bodies.space.discretisation import Discretisation
    from ruptfx.interfaces.faults.fault import Fault


class InitialBodyStress:
    """Initial stress of the bodies of a model at any point; created on all ranks.

    Parameters
    ----------
    model : Discretisation
    faults : sequence of Fault
    stress : BodyStress, optional
        Table `[initial_stress]` of the case.
    tensor : ndarray, shape (dim, dim), optional
        Uniform stress of the case [Pa].
    entries : sequence of (int, int), in antiplane of int
        Components of the stress in files.

    Attributes
    ----------
    mean : ndarray, shape (components,)
        [Pa]; the mean where it varies.
    origin : str
        ``given``, ``none``, or the assumption.
    is_uniform : bool
    """

    def __init__(
        self, model: Discretisation, faults: Sequence[Fault], stress: BodyStress | None, tensor: np.ndarray | None,
        entries: Sequence[Any],
    ) -> None:  # fmt: skip
        self._model, self._faults, self._entries = model, faults, entries
        self._stress, self._tensor = stress, tensor
        self.mean, self.origin = self._mean()
        self._uneven = self._uneven_pressure()
        if self._uneven is not None:
            self.origin += ", but its pressure as it varies along it, everywhere across it"
        self.is_uniform = self._uneven is None and (stress is None or tensor is not None)

    def at(self, points: np.ndarray) -> np.ndarray:
        """Return the initial stress of the bodies at points, shape (points, stress components) [Pa].

        A varying pressure on a flat interface in 2D is constant across it: the normal stress of a point is that
        of the interface at the foot of its perpendicular. That is in equilibrium, and where the pressure is linear
        along the interface it is an elastic state as well.
        """
        if self._stress is not None:
            stresses = matrices(self._stress.effective(points))
            return np.stack([stresses[:, i, j] for i, j in self._entries], axis=1)
        stress = np.tile(self.mean, (len(points), 1))
        if self._uneven is not None:
            tangent, place, excess, across = self._uneven
            stress -= np.interp(points @ tangent, place, excess)[:, None] * across
        return stress

    @property
    def _reference(self) -> Fault:
        """Interface whose tractions the assumed stress carries: the one with most points, then the first by name."""
        return min(self._faults, key=lambda fault: (-fault.interface.total, fault.name))

    def _uneven_pressure(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
        """Return tangent of the reference interface, positions, pressure beyond the mean [Pa], and n n' as in the file.

        None if the pressure is uniform, the interface not flat, or the stress given; collective.
        """
        model = self._model
        flat = model.plane in ("stress", "strain")
        if not self._faults or not flat or self._tensor is not None or self._stress:
            return None
        fault = self._reference
        face = fault.interface
        rows = np.column_stack([face.points, fault.normal_stress_0, face.frame[:, 0]])[face.owned]
        rows = parallel.share_rows(model.comm, rows)
        points, pressure, normals = rows[:, :2], rows[:, 2], rows[:, 3:]
        normal = normals[0]
        if np.abs(normals - normal).max() > 1e-6 or np.ptp(pressure) < 1e-9 * np.abs(pressure).max():
            return None
        across = np.array([np.outer(normal, normal)[entry] for entry in self._entries])
        mean = -float(self.mean @ (across * [1, 1, 2]))
        tangent = np.array([normal[1], -normal[0]])
        place = points @ tangent
        order = np.argsort(place)
        return tangent, place[order], pressure[order] - mean, across

    def _mean(self) -> tuple[np.ndarray, str]:
        """Return the uniform initial stress and its origin; collective."""
        model, entries = self._model, self._entries
        value = self._tensor
        if self._stress is not None and value is None:
            return np.zeros(len(entries)), "given, as it varies in the bodies"
        if value is not None:
            return np.array([value[entry] for entry in entries]), "given"
        if not self._faults:
            return np.zeros(len(entries)), "none"
        if model.plane == "axisymmetric":
            return np.zeros(len(entries)), "unknown: what carries the tractions is left out"
        fault = self._reference
        stress = self._carried_by(fault)
        if not stress.any() and parallel.largest(model.comm, np.abs(fault.normal_stress_0).max(initial=0)) == 0:
            return np.zeros(len(entries)), "none"
        text = (
            f"assumed: the uniform stress that carries the mean initial tractions of interface '{fault.name}', all "
            "other components zero"
        )
        return np.array([stress[entry] for entry in entries]), text

    def _carried_by(self, fault: Fault) -> np.ndarray:
        """Return the stress of `carried` from the mean normal and tractions of an interface; collective."""
        model, face = self._model, fault.interface
        # The normal that leaves the plus body points into the minus one.
        outward = fem.ufl.FacetNormal(model.mesh)
        measure = model.edge_measure(model.bodies.tags[f"{fault.name}.plus"])
        area = [-fem.dolfinx.fem.assemble_scalar(fem.form(n * measure)) for n in outward]
        weight = face.owned * face.weight
        sums = parallel.total(
            model.comm, [*area, weight.sum(), weight @ fault.normal_stress_0, *(weight @ fault.shear_traction_0)]
        )
        dim = model.mesh.geometry.dim
        normal, (total, pressure, *shear) = sums[:dim], sums[dim:]
        return carried(normal / np.linalg.norm(normal), pressure / total, np.array(shear) / total, model.components)


def carried(normal: np.ndarray, pressure: float, shear: np.ndarray, components: int) -> np.ndarray:
    """Return the stress with given tractions on planes of a normal and no other component in their frame.

    With the tangents t_k it is -pressure n n' + sum_k shear_k (n t_k' + t_k n'); stresses along the plane, which
    tractions do not determine, are zero.

    Parameters
    ----------
    normal : ndarray, shape (dim,)
        Unit normal n.
    pressure : float
        Positive in compression [Pa].
    shear : ndarray, shape (tangents,)
        Shear tractions along the tangents of `local_frame`, in antiplane along z [Pa].
    components : int
        Number of components of the displacement.

    Returns
    -------
    ndarray, shape (dim, dim), in antiplane (2,) with the components xz and yz
        Tension positive [Pa].
    """
    if components == 1:
        return shear[0] * normal
    frame = local_frame(normal[None])[0]
    local = np.diag([-pressure] + [0.0] * (len(frame) - 1))
    local[0, 1:] = local[1:, 0] = shear
    return frame.T @ local @ frame
