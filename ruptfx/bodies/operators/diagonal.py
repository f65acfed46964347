"""Diagonal of the stiffness of quadrilaterals and hexahedra, without a matrix.

Forces are integrated at the nodes of an element. With the derivatives D of one-dimensional shape functions, the shape
function of a node has slopes along the lines through it only: along direction d at the points q of its line, D[q, i].
"""

from __future__ import annotations

import numpy as np

from ruptfx.bodies.operators import STRAINS, Bulk
from ruptfx.bodies.operators.geometry import is_tensor, jacobian_at
from ruptfx.bodies.operators.matrix_free import gauss_lobatto_legendre
from ruptfx.platform import fem

CHUNK = 30_000  # nodes of elements that are computed together


def has_diagonal(bulk: Bulk) -> bool:
    """Return whether `stiffness_diagonal` knows the elements and the plane."""
    return is_tensor(bulk.space.mesh) and bulk.plane != "axisymmetric" and not bulk.large_rotations


def stiffness_diagonal(bulk: Bulk) -> np.ndarray:
    """Return the diagonal of K of the cells owned by this rank, shape (nodes * components,) [N/m].

    The caller sums over ranks.
    """
    space = bulk.space
    mesh, element = space.mesh, space.element.basix_element
    order, dim, components = element.degree, mesh.topology.dim, space.dofmap.index_map_bs
    points, weights, derivative = gauss_lobatto_legendre(order)
    n = order + 1
    permutation = fem.tensor_order(space)
    tensor_points = np.stack(np.meshgrid(*[points] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    weight = np.prod(np.meshgrid(*[weights] * dim, indexing="ij"), axis=0).ravel()
    owned = mesh.topology.index_map(dim).size_local
    chosen = np.arange(owned) if bulk.only is None else np.flatnonzero(bulk.only[:owned])
    total = np.zeros((space.dofmap.index_map.size_local + space.dofmap.index_map.num_ghosts, components))
    ends = np.diagonal(derivative)
    for first in range(0, len(chosen), max(1, CHUNK // n**dim)):
        cells = chosen[first : first + max(1, CHUNK // n**dim)]
        jacobian = jacobian_at(mesh, cells, tensor_points)
        scale = weight * np.abs(np.linalg.det(jacobian))
        slopes = np.linalg.inv(jacobian)  # [cell, q, a, d] = d xi_d / d x_a
        moduli = _moduli(bulk, cells, permutation)
        stiffness = np.einsum("bq,bqad,bqcae,bqef->bqcdf", scale, slopes, moduli, slopes, optimize=True)
        stiffness = stiffness.reshape(len(cells), *[n] * dim, components, dim, dim)
        values = np.zeros((len(cells), *[n] * dim, components))
        for d in range(dim):
            along = np.moveaxis(stiffness[..., d, d], d + 1, -1)
            values += np.moveaxis(along @ derivative**2, -1, d + 1)
            for e in range(dim):
                if d != e:
                    shape = np.ones((2, dim + 1), dtype=int)
                    shape[0, d], shape[1, e] = n, n
                    values += ends.reshape(shape[0]) * ends.reshape(shape[1]) * stiffness[..., d, e]
        np.add.at(total, space.dofmap.list[cells][:, permutation], values.reshape(len(cells), -1, components))
    return total.ravel()


def _moduli(bulk: Bulk, cells: np.ndarray, permutation: np.ndarray) -> np.ndarray:
    """Return C_cacb at the nodes of cells in tensor order, shape (cells, 1 or nodes, components, dim, dim) [Pa]."""
    uniform, local = bulk.moduli(cells)
    rows = uniform[:, None] if local is None else local[:, permutation]
    dim = bulk.space.mesh.topology.dim
    components = bulk.space.dofmap.index_map_bs
    result = np.zeros((*rows.shape[:2], components, dim, dim))
    if bulk.isotropic:
        for c in range(components):
            result[:, :, c, range(dim), range(dim)] = rows[..., 1, None]
            if components > 1:
                result[:, :, c, c, c] += rows[..., 0] + rows[..., 1]
        return result
    strains = STRAINS.get(bulk.plane, STRAINS["axisymmetric"][:3])
    place = {pair: k for k, pair in enumerate(strains)} | {pair[::-1]: k for k, pair in enumerate(strains)}
    for c in range(components):
        for a in range(dim):
            for b in range(dim):
                i, j = (place[(c if components > 1 else 2, axis)] for axis in (a, b))
                result[:, :, c, a, b] = rows[..., max(i, j) * (max(i, j) + 1) // 2 + min(i, j)]
    return result
