"""Shear moduli and wave speeds of the bodies on both sides of an interface, at its points and in its directions.

Every point has the mean of the elements that touch it, weighted with their extent along the interface; elements of
other bodies, and parts of the bodies away from the interface, do not count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.laws.materials import Material, Plane
from ruptfx.laws.materials.isotropic_elastic import rayleigh_speed
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.discretisation import Discretisation
    from ruptfx.interfaces.faults.interface import Interface

TOUCHING = 1e-9  # weight of an element that touches an interface with one node, relative to its size
DIGITS = 12  # of numbers, directions and ratios of wave speeds that count as different


@dataclass(frozen=True)
class Sides:
    """Moduli and wave speeds of the points of this rank; the first axis is the side: plus, minus.

    Attributes
    ----------
    moduli : ndarray, shape (2, n, tangents, tangents)
        Traction along one tangent per shear along another one: t_i n_j C_ijkl n_l t_k [Pa], infinite for a rigid side.
    along : ndarray, shape (2, n, 3)
        c_p, c_s and c_R along the first tangent [m/s]; of a rigid side those of the other one.
    across : ndarray, shape (2, n, 2)
        c_p and c_s along the second tangent of a surface [m/s], else along the first.
    bodies : dict of (float, float)
        c_p and c_s along the interface of the bodies beside it, the inverse of their mean slowness [m/s].
    """

    moduli: np.ndarray
    along: np.ndarray
    across: np.ndarray
    bodies: dict[str, tuple[float, float]]

    @property
    def modulus(self) -> np.ndarray:
        """Modulus of the seismic moment: harmonic mean of both sides, shape (n, tangents, tangents) [Pa]."""
        compliance = [np.zeros_like(side) if np.isinf(side).any() else np.linalg.inv(side) for side in self.moduli]
        return np.asarray(2 * np.linalg.inv(compliance[0] + compliance[1]))

    @property
    def slower(self) -> np.ndarray:
        """Side with the slower S wave along the first tangent, shape (n,)."""
        return np.argmin(self.along[:, :, 1], axis=0)

    def speeds(self) -> np.ndarray:
        """Return c_p, c_s and c_R of the slower side, shape (n, 3) [m/s]."""
        return np.asarray(self.along[self.slower, np.arange(self.along.shape[1])])

    def softer(self) -> np.ndarray:
        """Return rho c_s^2 along the first tangent of the slower side, shape (n,) [Pa]."""
        return np.asarray(self.moduli[self.slower, np.arange(self.along.shape[1]), 0, 0])

    def columns(self) -> dict[str, np.ndarray]:
        """Return what an interface file contains of them, each of shape (n,)."""
        modulus, speeds = self.modulus, self.speeds()
        entries = {"shear_modulus": modulus[:, 0, 0]} if modulus.shape[1] == 1 else {
            f"shear_modulus_{i + 1}{k + 1}": modulus[:, i, k] for i, k in ((0, 0), (1, 1), (0, 1))}  # fmt: skip
        entries |= dict(zip(("c_p", "c_s", "c_R"), speeds.T, strict=True))
        across = self.across.min(axis=0)[:, 1]
        if modulus.shape[1] > 1:
            entries["c_s_dip"] = across
        entries["fastest_wave"] = np.maximum(self.along[:, :, 0], self.across[:, :, 0]).max(axis=0)
        return entries


def sides_of(model: Discretisation, face: Interface) -> Sides:
    """Return moduli and wave speeds beside an interface; collective."""
    minus = face.minus if not face.one_sided else face.plus[:0]
    sides = [_Side(model, face, nodes) for nodes in (face.plus, minus)]
    both = [sides[0].at(face.plus), sides[1].at(face.minus) if len(minus) else sides[0].at(face.plus)]
    tangents = face.tangents
    moduli, along, across = [], [], []
    for values in both:
        moduli.append(values[:, : tangents**2].reshape(-1, tangents, tangents))
        along.append(values[:, -5:-2])
        across.append(values[:, -2:])
    if not face.elastic_sides:
        moduli[1] = np.full_like(moduli[1], np.inf)
    names, slowness = model.bodies.names, sides[0].slowness + sides[1].slowness
    slowness = parallel.total(model.comm, slowness.ravel().tolist()).reshape(-1, 3)
    bodies = {
        name: tuple(_rounded(weight / slow).tolist())
        for name, (weight, *slow) in zip(names, slowness, strict=True) if weight > 0
    }  # fmt: skip
    return Sides(np.stack(moduli), np.stack(along), np.stack(across), bodies)


class _Side:
    """Sums over the elements beside one side of an interface.

    Attributes
    ----------
    slowness : ndarray, shape (bodies, 3)
        Weight, and weight over c_p and c_s, of the elements of this rank.
    """

    def __init__(self, model: Discretisation, face: Interface, nodes: np.ndarray) -> None:
        layout, dofs = model.layout, model.space.dofmap.list
        owned = model.mesh.topology.index_map(model.mesh.topology.dim).size_local
        on = np.isin(dofs[:owned], nodes)
        cells = np.flatnonzero(on.any(axis=1))
        on, dofs = on[cells], dofs[cells]
        self._tangents = face.tangents
        self._sums = np.zeros((layout.count, face.tangents**2 + 6))
        self.slowness = np.zeros((len(model.bodies.names), 3))
        x = layout.coordinates[dofs]
        at_interface = np.where(on[:, :, None], x, np.nan)
        extent, size = (np.linalg.norm(np.nanmax(each, axis=1) - np.nanmin(each, axis=1), axis=1)
                        for each in (at_interface, x))  # fmt: skip
        weight = (extent + TOUCHING * size) ** (x.shape[-1] - 1)
        frames = _frames(face, layout.count, dofs, at_interface)
        for number in np.unique(model.bodies.cell_body[cells]):
            rows = np.flatnonzero(model.bodies.cell_body[cells] == number)
            values = _values(model, int(number), cells[rows], frames[rows], face.tangents)[on[rows]]
            weights = np.broadcast_to(weight[rows, None], on[rows].shape)[on[rows]]
            shares = weights[:, None] * np.column_stack([np.ones(len(values)), values])
            np.add.at(self._sums, dofs[rows][on[rows]], shares)
            self.slowness[number] += [weights.sum(), *(weights @ (1 / values[:, -5:-3]))]
        for column in self._sums.T:
            vector = np.zeros((layout.count, model.components))
            vector[:, 0] = column
            layout.sum_shared(flat := vector.ravel())
            column[:] = flat[:: model.components]

    def at(self, nodes: np.ndarray) -> np.ndarray:
        """Return moduli, c_p, c_s and c_R along the interface, c_p and c_s across, at nodes of this side."""
        sums = self._sums[nodes]
        return _rounded(sums[:, 1:] / sums[:, :1])


def _rounded(values: np.ndarray) -> np.ndarray:
    """Return numbers without their last digits, which depend on the partition."""
    scale = 10.0 ** np.floor(np.log10(np.maximum(np.abs(values), 1e-300)))
    return np.asarray(np.round(values / scale, DIGITS) * scale)


def _frames(face: Interface, count: int, dofs: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return first tangent, normal and second tangent at the nodes of elements, shape (cells, nodes, dim, dim).

    In antiplane, whose frames are out of the plane, those of the nodes of an element on the interface together;
    coordinates of other nodes are NaN.
    """
    dim = x.shape[-1]
    if face.has_normal:
        frames = np.zeros((count, dim, dim))
        order = [1, 0, 2][:dim]
        frames[:] = np.eye(dim)
        for nodes in (face.minus, face.plus):
            frames[nodes] = face.frame[:, order]
        return frames[dofs]
    away = np.nan_to_num(x - np.nanmean(x, axis=1, keepdims=True)) if len(x) else x
    xx, yy, xy = (away[:, :, i] * away[:, :, k] for i, k in ((0, 0), (1, 1), (0, 1)))
    angle = 0.5 * np.arctan2(2 * xy.sum(axis=1), (xx - yy).sum(axis=1))
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    return np.repeat(np.stack([tangent, normal], axis=1)[:, None], dofs.shape[1], axis=1)


def _values(model: Discretisation, number: int, cells: np.ndarray, frames: np.ndarray, tangents: int) -> np.ndarray:
    """Return moduli, c_p, c_s and c_R along, c_p and c_s across the interface at the nodes of elements of one body."""
    varying = model.variation is not None and model.variation.varies(number)
    material = model.variation.local(number, cells) if varying else model.materials[number]  # type: ignore[union-attr]
    shape, plane = frames.shape[:2], model.plane
    lame = material.lame(plane)
    if lame is not None:
        items = (*lame, material.density)
        first, shear, density = (np.broadcast_to(np.asarray(value, dtype=float), shape) for value in items)
        c_s = np.sqrt(shear / density)
        c_p = c_s if plane == "antiplane" else np.sqrt((first + 2 * shear) / density)
        c_R = c_s if plane == "antiplane" else c_s * _rayleigh(c_s / c_p)
        moduli = shear[..., None] * np.eye(tangents).ravel()
        return np.concatenate([moduli, np.stack([c_p, c_s, c_R, c_p, c_s], axis=-1)], axis=-1)
    reference = model.materials[number]
    flat = np.round(frames.reshape(-1, *frames.shape[2:]), DIGITS)
    directions, which = np.unique(flat, axis=0, return_inverse=True)
    result = np.array([_anisotropic(reference, frame, plane, tangents) for frame in directions])
    values = result[which.ravel()].reshape(*shape, -1)
    # The stiffness of an anisotropic body is uniform; its density may vary.
    density = np.broadcast_to(np.asarray(material.density, float), shape)
    values[..., -5:] *= np.sqrt(reference.density / density)[..., None]
    return values


def _rayleigh(ratio: np.ndarray) -> np.ndarray:
    """Return c_R over c_s of ratios c_s over c_p."""
    ratios, which = np.unique(np.round(ratio, DIGITS), return_inverse=True)
    return np.array([rayleigh_speed(1 / float(each), 1.0) for each in ratios])[which].reshape(ratio.shape)


def _anisotropic(material: Material, frame: np.ndarray, plane: Plane, tangents: int) -> list[float]:
    """Return moduli, c_p, c_s and c_R along the first tangent, c_p and c_s along the second one.

    Parameters
    ----------
    frame : ndarray, shape (dim, dim)
        First tangent, normal, second tangent.
    """
    root = material.impedance(frame[1], plane)
    christoffel = root @ root / material.density
    shear = np.ones((1, 1)) if plane == "antiplane" else frame[[0, 2][:tangents]]
    speeds = material.wave_speeds_along(frame, plane)
    across = speeds if len(frame) < 3 else material.wave_speeds_along(frame[[2, 1, 0]], plane)
    return [*(shear @ christoffel @ shear.T).ravel(), *speeds, *across[:2]]
