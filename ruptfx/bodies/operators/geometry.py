"""Geometry and material of elements for the matrix-free kernel: sorted by kind, lane by lane."""

from __future__ import annotations

from typing import Any

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.operators import Bulk
from ruptfx.platform import fem
from ruptfx.platform.codegen import native

BOX, AFFINE, MULTILINEAR, POINTWISE = range(4)  # kinds of a batch, as in the C source
VARYING = 4  # is added to the kind of batches whose moduli vary in an element


def numbers(
    bulk: Bulk, cells: np.ndarray, padding: np.ndarray, permutation: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the kind of every batch, the start of its numbers (in vectors), and the numbers.

    A batch has the kind of its most demanding cell. Its numbers are `Bulk.moduli` (zero for padding
    cells), where they vary in a cell those of all its nodes, and the geometry; with large rotations 1 / sqrt(det J)
    follows; around an axis 2 pi r and 1 / r of the nodes follow, and sqrt(det J), which
    is one number in an affine cell, one for each node in a curved one, and computed by the kernel in others.

    Parameters
    ----------
    cells, padding : ndarray, shape (batches, lanes)
        Local cells, and True for padding cells.
    permutation : ndarray
        Permutation from tensor order to the nodes of the element.
    """
    mesh = bulk.space.mesh
    dim, lanes = mesh.geometry.dim, cells.shape[1]
    if dim != mesh.topology.dim:
        raise RuptfxError("matrix_free: the mesh must fill its space (2D cells in 2D, 3D cells in 3D)")
    kind = np.empty(len(cells), dtype=np.uint8)
    for part in _slices(len(cells)):
        kind[part] = _classify(mesh, cells[part])
    varies = np.zeros(len(cells), dtype=bool)
    for part in _slices(len(cells)) if bulk.variation is not None else []:
        local = bulk.moduli(cells[part])[1]
        if local is not None:
            varies[part] = np.any(local != local[..., :1, :], axis=(1, 2, 3))
    nodes, axisymmetric = len(permutation), bulk.plane == "axisymmetric"
    width = np.array([dim, dim**2, dim * (2**dim - 1), dim**2 * nodes])
    if axisymmetric:
        kind[kind == BOX] = AFFINE
        width += 2 * nodes + np.array([1, 1, 0, nodes])
    if bulk.large_rotations:
        width += 1
    moduli = bulk.moduli(cells[:1])[0].shape[-1]
    width = width[kind] + moduli * nodes * varies
    kind[varies] += VARYING
    start = np.r_[0, np.cumsum(width + moduli)].astype(np.int64)
    number = native.aligned((int(start[-1]), lanes), bulk.real)
    for value in np.unique(kind):
        batches = np.flatnonzero(kind == value)
        for part in _slices(len(batches)):
            batch = batches[part]
            chosen = cells[batch]
            of_geometry = int(value) % VARYING
            sign, geometry = _geometry(bulk.space, chosen, of_geometry, permutation)
            uniform, local = bulk.moduli(chosen)
            counts = (sign * ~padding[batch])[..., None]
            values = uniform * counts
            if value >= VARYING:
                assert local is not None
                of_nodes = local[..., permutation, :].reshape(*chosen.shape, -1)
                values = np.concatenate([values, of_nodes * counts], axis=-1)
            values = np.concatenate([values, geometry], axis=-1)
            if axisymmetric:
                values = np.concatenate([values, _rings(bulk.space, chosen, of_geometry, permutation)], axis=-1)
            if bulk.large_rotations:
                values = np.concatenate([values, 1 / root_of_size(mesh, chosen)[..., None]], axis=-1)
            number[start[batch][:, None] + np.arange(values.shape[-1])] = values.transpose(0, 2, 1)
    return kind, start[:-1], number


def _slices(count: int) -> list[slice]:
    """Return slices of a long range, to limit temporary memory."""
    return [slice(first, first + 4096) for first in range(0, count, 4096)]


def _geometry(
    space: fem.dolfinx.fem.FunctionSpace, cells: np.ndarray, kind: int, permutation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return sign of the moduli and geometry of cells, shapes (batches, lanes) and (batches, lanes, numbers)."""
    mesh = space.mesh
    x = _corners(mesh, cells)
    upright = np.ones(cells.shape)
    if kind == POINTWISE:
        return upright, _pointwise(mesh, _nodes(mesh, cells), space, permutation)
    jacobian, shape = _shape(x, is_tensor(mesh))
    if kind == MULTILINEAR:
        # The kernel divides by det J, which is negative in cells turned inside out; the sign is put into the moduli.
        return np.sign(np.linalg.det(jacobian)), shape.reshape(*cells.shape, -1)
    scaled = _scaled_inverse(jacobian)
    if kind == BOX:
        return upright, np.diagonal(scaled, axis1=-2, axis2=-1)
    return upright, scaled.reshape(*cells.shape, -1)


def _rings(space: fem.dolfinx.fem.FunctionSpace, cells: np.ndarray, kind: int, permutation: np.ndarray) -> np.ndarray:
    """Return 2 pi r, 1 / r (0 on the axis) of the nodes of cells, and sqrt(det J); shape (batches, lanes, numbers)."""
    mesh = space.mesh
    shape = _coordinate_element(mesh).tabulate(1, np.asarray(space.element.basix_element.points)[permutation])
    values, slopes = np.asarray(shape)[0, :, :, 0], np.asarray(shape)[1:, :, :, 0]
    x = _nodes(mesh, cells)
    radius = np.einsum("qk,blk->blq", values, x[..., 1])
    axis = radius <= 1e-12 * np.abs(x).max()
    inverse = np.where(axis, 0.0, 1 / np.where(axis, 1.0, radius))
    size = np.sqrt(np.abs(np.linalg.det(np.einsum("dqk,blka->blqda", slopes, x))))
    sizes = {AFFINE: size[..., :1], MULTILINEAR: size[..., :0], POINTWISE: size}[kind]
    return np.concatenate([2 * np.pi * np.where(axis, 0.0, radius), inverse, sizes], axis=-1)


def root_of_size(mesh: fem.dolfinx.mesh.Mesh, cells: np.ndarray, real: np.dtype = native.DOUBLE) -> np.ndarray:
    """Return the root of |det J| of cells with parallel edges, in the shape of `cells`."""
    root = native.aligned(cells.shape, real)
    for part in _slices(len(cells)):
        jacobian, _ = _shape(_corners(mesh, cells[part]), is_tensor(mesh))
        root[part] = np.sqrt(np.abs(np.linalg.det(jacobian)))
    return root


def jacobian_at(mesh: fem.dolfinx.mesh.Mesh, cells: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the Jacobian dx_a / dxi_d of cells at points of the reference cell, shape (cells, points, d, a)."""
    slopes = np.asarray(_coordinate_element(mesh).tabulate(1, points))[1:, :, :, 0]
    return np.einsum("dqk,bka->bqda", slopes, _nodes(mesh, cells))


def is_tensor(mesh: fem.dolfinx.mesh.Mesh) -> bool:
    """Return whether cells are quadrilaterals or hexahedra."""
    return mesh.basix_cell().name in ("quadrilateral", "hexahedron")


def _nodes(mesh: fem.dolfinx.mesh.Mesh, cells: np.ndarray) -> np.ndarray:
    return mesh.geometry.x[:, : mesh.geometry.dim][fem.geometry_dofmap(mesh)[cells]]


def _corners(mesh: fem.dolfinx.mesh.Mesh, cells: np.ndarray) -> np.ndarray:
    return _nodes(mesh, cells)[..., : mesh.geometry.dim + 1 if not is_tensor(mesh) else 2**mesh.geometry.dim, :]


def geometry_element(mesh: fem.dolfinx.mesh.Mesh) -> Any:
    """Return the UFL element of the coordinates of a mesh."""
    domain: Any = mesh.ufl_domain()
    return domain.ufl_coordinate_element()


def _coordinate_element(mesh: fem.dolfinx.mesh.Mesh) -> Any:
    """Return the Basix element of the map from the reference cell."""
    described, basix = geometry_element(mesh), fem.basix
    return basix.create_element(
        basix.ElementFamily.P, mesh.basix_cell(), described.degree, lagrange_variant=described.lagrange_variant
    )


def _shape(x: np.ndarray, tensor: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the Jacobian dx_a / dxi_d [..., d, a] at the first corner, and all coefficients of the map.

    Parameters
    ----------
    x : ndarray, shape (..., corners, dim)
    """
    dim = x.shape[-1]
    if not tensor:
        edges = x[..., 1:, :] - x[..., :1, :]
        return edges, edges
    # Differences of differences vanish exactly on a regular grid.
    corner = np.moveaxis(x, -2, 0)
    linear = [corner[1 << d] - corner[0] for d in range(dim)]
    pairs = [(0, 1)] if dim == 2 else [(0, 1), (0, 2), (1, 2)]
    mixed = [corner[(1 << d) + (1 << e)] - corner[1 << d] - linear[e] for d, e in pairs]
    if dim == 3:
        top = corner[7] - corner[6] - (corner[5] - corner[4])
        mixed.append(top - mixed[0])
    jacobian = np.stack(linear, axis=-2)
    return jacobian, np.concatenate([jacobian, np.stack(mixed, axis=-2)], axis=-2)


def _classify(mesh: fem.dolfinx.mesh.Mesh, cells: np.ndarray) -> np.ndarray:
    """Return the geometry kind of batches of cells, that of their most demanding one, shape (batches,)."""
    if not is_tensor(mesh) and geometry_element(mesh).degree > 1:
        return np.full(len(cells), POINTWISE, dtype=np.uint8)
    if not is_tensor(mesh):
        return np.full(len(cells), AFFINE, dtype=np.uint8)
    x = _corners(mesh, cells)
    jacobian, shape = _shape(x, True)
    dim = x.shape[-1]
    size = np.abs(jacobian).max(axis=(-2, -1))
    bend = np.abs(shape[..., dim:, :]).max(axis=(-2, -1))
    shear = np.abs(jacobian * (1 - np.eye(dim))).max(axis=(-2, -1))
    rounding = 4 * np.finfo(float).eps * np.abs(x).max(axis=(-2, -1))
    bent = bend > 1e-13 * size + rounding
    kind = np.where(bent, MULTILINEAR, np.where(shear <= 1e-15 * size, BOX, AFFINE))
    kind = np.where(_is_curved(mesh, cells, size), POINTWISE, kind)
    return kind.max(axis=1).astype(np.uint8)


def _is_curved(mesh: fem.dolfinx.mesh.Mesh, cells: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return which cells have nodes that differ from the map of their corners."""
    if geometry_element(mesh).degree == 1:
        return np.zeros(cells.shape, dtype=bool)
    flat = fem.basix.create_element(fem.basix.ElementFamily.P, mesh.basix_cell(), 1)
    linear = np.asarray(flat.tabulate(0, np.asarray(_coordinate_element(mesh).points)))[0, :, :, 0]
    nodes = _nodes(mesh, cells)
    away = np.abs(nodes - np.einsum("qk,blka->blqa", linear, _corners(mesh, cells))).max(axis=(-2, -1))
    return away > 1e-13 * size + 4 * np.finfo(float).eps * np.abs(nodes).max(axis=(-2, -1))


def _scaled_inverse(jacobian: np.ndarray) -> np.ndarray:
    """Return dxi_d / dx_a sqrt|det J|: the flux is G C G' of the reference gradient."""
    volume = np.sqrt(np.abs(np.linalg.det(jacobian)))
    return np.linalg.inv(jacobian).swapaxes(-1, -2) * volume[..., None, None]


def _pointwise(
    mesh: fem.dolfinx.mesh.Mesh, x: np.ndarray, space: fem.dolfinx.fem.FunctionSpace, permutation: np.ndarray
) -> np.ndarray:
    """Return the scaled inverse Jacobian at every node of cells with curved edges."""
    points = np.asarray(space.element.basix_element.points)[permutation]
    slopes = np.asarray(_coordinate_element(mesh).tabulate(1, points))[1:, :, :, 0]
    jacobian = np.einsum("dqk,blka->blqda", slopes, x)
    return _scaled_inverse(jacobian).reshape(*x.shape[:2], -1)
