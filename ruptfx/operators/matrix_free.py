"""The explicit hot path: isotropic linear elasticity without a matrix, eight elements at a time, in compiled C.

The kernel is `matrix_free.c`. This module sorts the elements into batches, describes their geometry, and finds for
every node the last element that touches it, after which the node may move on within the same sweep.
"""

from __future__ import annotations

import ctypes
from importlib.resources import files
from typing import Any

import numpy as np

from ruptfx import RuptfxError, fem, native
from ruptfx.materials.isotropic_elastic import IsotropicElastic
from ruptfx.operators import Bulk

BOX, AFFINE, MULTILINEAR, POINTWISE, VISCOUS, ADVANCE = 0, 1, 2, 3, 4, 8  # kinds of a batch, as in the C source
BLOCK_NODES = 2048  # nodes computed between updates: few enough to stay in the second-level cache
WINDOW_NODES = 32768  # nodes computed before memory is taken to have left the caches
_TENSOR_CELLS = ("quadrilateral", "hexahedron")


class _Plan(ctypes.Structure):
    """`struct plan` of the C source."""

    _fields_ = [(name, ctypes.c_void_p) for name in (
        "dof", "kind", "start", "number", "inner_mass", "line", "line_start", "rim_line", "rim_line_start", "block",
        "row", "row_start", "single", "single_start",
    )]  # fmt: skip


class MatrixFree:
    """Matrix-free operator and fused leapfrog step for quadrilaterals, hexahedra and order-1 simplices.

    Parameters
    ----------
    bulk : Bulk

    Raises
    ------
    RuptfxError
        A material or an element this operator does not know.
    """

    def __init__(self, bulk: Bulk) -> None:
        space = bulk.space
        _refuse_unknown(bulk)
        index_map = space.dofmap.index_map
        self._components = space.dofmap.index_map_bs
        self._nodes = index_map.size_local + index_map.num_ghosts
        self._shared = _shared_nodes(index_map)
        permutation, constants = _reference_cell(space)
        self._library = native.load("matrix_free", constants + files(__package__).joinpath("matrix_free.c").read_text())
        lanes = self._library.lanes_per_batch()
        self._plan, self._keep = _Plan(), {}
        cells, padding, self._boundary_batches = self._order_cells(bulk, lanes)
        self._batches = len(cells)
        # (batch, node, lane): lanes of one node are neighbours in memory.
        nodes = space.dofmap.list[:, permutation][cells].transpose(0, 2, 1)
        self._hold("dof", np.ascontiguousarray(nodes * np.int32(self._components), dtype=np.int32))
        kind, start, number = _numbers(bulk, cells, padding, permutation)
        self._hold("kind", kind), self._hold("start", start), self._hold("number", number)
        self._inner = _inner(space, permutation)
        self._padded = padding.any(axis=1)
        self._inverse_mass: np.ndarray | None = None
        self._hold_lines()
        self.prepare_step(np.zeros(self._nodes, dtype=bool))

    def add_internal_force(self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        """force -= K (displacement + eta velocity), from the cells this rank owns."""
        pointers = self._pointers(displacement, velocity, force)
        self._library.add_internal_force(
            ctypes.byref(self._plan), ctypes.c_long(0), ctypes.c_long(self._batches), *pointers
        )

    # -- the fused step --------------------------------------------------------------------------------------------

    def prepare_step(self, held: np.ndarray) -> None:
        """Say which nodes `step` leaves to the caller; nodes known to other ranks are held in any case.

        Parameters
        ----------
        held : ndarray of bool, shape (nodes,)
        """
        node = self._keep["dof"].reshape(self._batches, len(self._inner), -1) // self._components
        size = max(1, BLOCK_NODES * 4 // node[0].size)
        first = np.unique(np.r_[
            np.arange(0, self._boundary_batches, size), np.arange(self._boundary_batches, self._batches, size),
            self._batches,
        ])  # fmt: skip
        self._boundary_blocks = int(np.searchsorted(first, self._boundary_batches))
        self._blocks = len(first) - 1
        held = held | self._shared
        # Nodes inside elements move with their batch, unless one is held or a cell is there twice to fill the batch.
        inside = node[:, self._inner]
        advance = ~(self._padded | held[inside].any(axis=(1, 2)))
        self._keep["kind"][:] = self._keep["kind"] % ADVANCE + ADVANCE * advance
        # Later assignments win: what remains is the last block that touches the node.
        done_in = np.full(self._nodes, -1, dtype=np.int32)
        for block in range(self._blocks):
            done_in[node[first[block] : first[block + 1]].ravel()] = block
        done_in[held] = -1
        done_in[inside[advance].ravel()] = -1
        nodes = np.argsort(done_in, kind="stable")[np.count_nonzero(done_in < 0) :].astype(np.int32)
        in_row = _rows(nodes, done_in[nodes], node.shape[2])
        for name, which in (("row", in_row == 0), ("single", in_row < 0)):
            self._hold(name, np.ascontiguousarray(nodes[which]))
            starts = np.searchsorted(done_in[nodes[which]], np.arange(self._blocks + 1))
            self._hold(f"{name}_start", starts.astype(np.int32))
        self._hold("block", first.astype(np.int32))

    def step(
        self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, inverse_mass: np.ndarray,
        dt: float, decay: float = 1.0,
    ) -> None:
        """Internal force of all elements, and one leapfrog step of every node that is not held.

        Plain nodes: velocity = decay velocity + dt force / mass, displacement += dt velocity, force = 0. Held nodes:
        the internal force is added to `force`, which the caller uses and sets to zero.

        Parameters
        ----------
        displacement, velocity, force : ndarray, shape (nodes * components,)
        inverse_mass : ndarray, shape (nodes,)
            [1/kg].
        dt : float
            Time step [s].
        decay : float
            Factor of the old velocity; below 1 with mass damping.
        """
        self.step_boundary(displacement, velocity, force, inverse_mass, dt, decay)
        self.step_interior(displacement, velocity, force, inverse_mass, dt, decay)

    def step_boundary(
        self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, inverse_mass: np.ndarray,
        dt: float, decay: float = 1.0,
    ) -> None:
        """First part of `step`: the elements at nodes that other ranks know; after it `force` is ready to send."""
        if self._boundary_blocks:
            self._run(0, self._boundary_blocks, (displacement, velocity, force, inverse_mass), dt, decay)

    def step_interior(
        self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, inverse_mass: np.ndarray,
        dt: float, decay: float = 1.0,
    ) -> None:
        """The rest of `step`; neither reads nor writes the force of nodes that other ranks know."""
        self._run(self._boundary_blocks, self._blocks, (displacement, velocity, force, inverse_mass), dt, decay)

    def _run(self, first: int, last: int, arrays: tuple[np.ndarray, ...], dt: float, decay: float) -> None:
        if arrays[3] is not self._inverse_mass:
            inside = self._keep["dof"].reshape(self._batches, len(self._inner), -1)[:, self._inner] // self._components
            mass = _aligned((inside.size // inside.shape[2], inside.shape[2]))
            mass[:] = arrays[3][inside].reshape(mass.shape)
            self._hold("inner_mass", mass)
            self._inverse_mass = arrays[3]
        self._library.step(
            ctypes.byref(self._plan), ctypes.c_long(first), ctypes.c_long(last), *self._pointers(*arrays),
            ctypes.c_double(dt), ctypes.c_double(decay),
        )  # fmt: skip

    # -- preparation -----------------------------------------------------------------------------------------------

    @property
    def nbytes(self) -> int:
        """Memory held by the operator [bytes]."""
        return sum(array.nbytes for array in self._keep.values())

    def _hold(self, name: str, array: np.ndarray) -> None:
        self._keep[name] = array
        setattr(self._plan, name, array.ctypes.data)

    def _pointers(self, *arrays: np.ndarray) -> list[ctypes.c_void_p]:
        for array, size in zip(arrays, (self._components,) * 3 + (1,), strict=False):
            if array.dtype != np.float64 or array.shape != (self._nodes * size,) or not array.flags.c_contiguous:
                raise RuptfxError(f"matrix_free: a vector of {self._nodes * size} doubles is needed, not {array.shape}")
        return [ctypes.c_void_p(array.ctypes.data) for array in arrays]

    def _hold_lines(self) -> None:
        """Cache lines (8 doubles) every batch touches for the first time in a while, to be fetched one batch earlier."""
        dof = self._keep["dof"].reshape(self._batches, len(self._inner), -1)
        window = max(1, WINDOW_NODES // dof[0, self._inner | (np.arange(len(self._inner)) % 2 == 0)].size)
        for prefix, part in (("", dof), ("rim_", dof[:, ~self._inner])):
            lines = np.sort(part.reshape(self._batches, -1) // 8, axis=1)
            batch, place = np.nonzero(np.diff(lines, axis=1, prepend=-1))
            line = lines[batch, place]
            order = np.argsort(line, kind="stable")  # by line, then by batch
            again = np.zeros(len(line), dtype=bool)
            again[order[1:]] = (np.diff(line[order]) == 0) & (np.diff(batch[order]) <= window)
            starts = np.searchsorted(batch[~again], np.r_[: self._batches + 1, self._batches])
            self._hold(f"{prefix}line", line[~again].astype(np.int32))
            self._hold(f"{prefix}line_start", starts.astype(np.int32))

    @staticmethod
    def _place(space: Any, dofmap: np.ndarray) -> np.ndarray:
        return dofmap.min(axis=1)

    def _order_cells(self, bulk: Bulk, lanes: int) -> tuple[np.ndarray, np.ndarray, int]:
        """Cells by batch (batch, lane), which of them only fill up a batch, and how many batches come first.

        Elements at shared nodes come first, so that their force travels while the others are computed; within both
        groups elements follow the numbering of their nodes, so that vectors are read nearly in order.
        """
        space = bulk.space
        owned = space.mesh.topology.index_map(space.mesh.topology.dim).size_local
        dofmap = space.dofmap.list[:owned]
        boundary = self._shared[dofmap].any(axis=1)
        counts = np.ones(owned, dtype=bool) if bulk.only is None else bulk.only[:owned]
        place = self._place(space, dofmap)
        groups, fillers = [], []
        for group in (np.flatnonzero(boundary & counts), np.flatnonzero(~boundary & counts)):
            group = group[np.argsort(place[group], kind="stable")]
            spare = -len(group) % lanes
            groups.append(np.r_[group, group[-1:].repeat(spare)].reshape(-1, lanes))
            fillers.append(np.arange(groups[-1].size).reshape(-1, lanes) >= len(group))
        return np.concatenate(groups), np.concatenate(fillers), len(groups[0])


def _refuse_unknown(bulk: Bulk) -> None:
    remedy = "operator = 'ufl_form' handles it"
    for material in bulk.materials:
        if type(material) is not IsotropicElastic:
            raise RuptfxError(f"matrix_free knows isotropic elasticity only, not '{material.kind()}'; {remedy}")
    cell, order = bulk.space.mesh.basix_cell().name, bulk.space.element.basix_element.degree
    limit = 8 if cell in _TENSOR_CELLS else 1
    if order > limit:
        raise RuptfxError(f"matrix_free goes up to order {limit} on a {cell}, not {order}; {remedy}")
    if limit == 1 and _geometry_element(bulk.space.mesh).degree > 1:
        raise RuptfxError(f"matrix_free wants a {cell} with straight edges; {remedy}")


def _shared_nodes(index_map: Any) -> np.ndarray:
    """True for every local node that another rank knows too; collective."""
    flag = fem.dolfinx.la.vector(index_map, 1)
    flag.array[:] = 0
    flag.array[index_map.size_local :] = 1
    flag.scatter_reverse(fem.dolfinx.la.InsertMode.add)
    flag.scatter_forward()
    return flag.array > 0


def _inner(space: Any, permutation: np.ndarray) -> np.ndarray:
    """True for the nodes inside a cell, in tensor order."""
    element = space.element.basix_element
    inner = np.zeros(len(permutation), dtype=bool)
    inner[element.entity_dofs[space.mesh.topology.dim][0]] = True
    return inner[permutation]


def _rows(nodes: np.ndarray, block: np.ndarray, lanes: int) -> np.ndarray:
    """Place (0 to lanes - 1) of a node in a full row of consecutive nodes of one block; -1 outside of full rows."""
    if len(nodes) == 0:
        return np.zeros(0, dtype=np.int64)
    new_run = np.r_[True, (np.diff(nodes) != 1) | (np.diff(block) != 0)]
    start = np.flatnonzero(new_run)
    length = np.diff(np.r_[start, len(nodes)])
    place = np.arange(len(nodes)) - np.repeat(start, length)
    return np.where(place < np.repeat(length // lanes * lanes, length), place % lanes, -1)


def _reference_cell(space: Any) -> tuple[np.ndarray, str]:
    """Tensor-product order of the nodes of a cell, and the constants of the C source."""
    element = space.element.basix_element
    name, order, dim = space.mesh.basix_cell().name, element.degree, space.mesh.topology.dim
    sizes = {"DIM": dim, "COMPONENTS": space.dofmap.index_map_bs, "ORDER": order, "SIMPLEX": int(name not in _TENSOR_CELLS)}
    text = "".join(f"#define {key} {value}\n" for key, value in sizes.items())
    if name not in _TENSOR_CELLS:
        tables = {"double MINUS_WEIGHT[]": np.full(dim + 1, -1 / (2, 6)[dim - 2]), "char INNER[]": np.zeros(dim + 1, dtype=int)}
        return np.arange(dim + 1), text + _tables(tables)
    points, weights, derivative = gauss_lobatto_legendre(order)
    # Lexicographic, the first coordinate slowest; rounded because points of a line differ by round-off.
    permutation = np.lexsort(np.round(element.points, 10).T[::-1])
    product = weights
    for _ in range(dim - 1):
        product = np.multiply.outer(product, weights)
    transposed = (weights[:, None] * derivative).T / weights[:, None]
    return permutation, text + _tables({
        "double POINT[]": points, "double MINUS_WEIGHT[]": -product.ravel(),
        "char INNER[]": _inner(space, permutation).astype(int),
        "struct matrix DERIVATIVE": _halves(derivative), "struct matrix TRANSPOSED": _halves(transposed),
    })  # fmt: skip


def _halves(matrix: np.ndarray) -> np.ndarray:
    """Even and odd half of a matrix that changes sign when rows and columns are turned round."""
    half = (len(matrix) + 1) // 2
    even, odd = (0.5 * (matrix + sign * matrix[:, ::-1])[:half, :half] for sign in (1, -1))
    if len(matrix) % 2:
        even[:, -1] = matrix[:half, half - 1]  # the middle node is its own opposite
    return np.stack([even, odd])


def _tables(tables: dict[str, np.ndarray]) -> str:
    constants = (f"static const {name} = {_braces(values)};" for name, values in tables.items())
    return f"#define TABLES {' '.join(constants)}\n"


def _braces(values: np.ndarray) -> str:
    items = [_braces(row) if np.ndim(row) else repr(row.item()) for row in values]
    return "{" + ", ".join(items) + "}"


def gauss_lobatto_legendre(order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points and weights on [0, 1], and the matrix of derivatives D[i, j] = l_j'(x_i) of the interpolation."""
    basix = fem.basix
    points, weights = basix.make_quadrature(basix.CellType.interval, 2 * order - 1, rule=basix.QuadratureType.gll)
    x = np.sort(points[:, 0])
    weights = weights[np.argsort(points[:, 0])]
    difference = x[:, None] - x + np.eye(order + 1)
    barycentric = 1 / np.prod(difference, axis=1)
    derivative = barycentric / barycentric[:, None] / difference
    np.fill_diagonal(derivative, 0)
    derivative = 0.5 * (derivative - derivative[::-1, ::-1])
    # Rows that sum to zero: a rigid translation gives no force at all.
    np.fill_diagonal(derivative, -derivative.sum(axis=1))
    return x, weights, derivative


# -- geometry ------------------------------------------------------------------------------------------------------


def _numbers(
    bulk: Bulk, cells: np.ndarray, padding: np.ndarray, permutation: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kind of every batch, where its numbers begin (in vectors), and the numbers.

    A batch takes the kind of its most demanding cell.
    """
    mesh = bulk.space.mesh
    corners = fem.geometry_dofmap(mesh)
    coordinates = mesh.geometry.x[:, : mesh.geometry.dim]
    if mesh.geometry.dim != mesh.topology.dim:
        raise RuptfxError("matrix_free: the mesh must fill its space (2D cells in 2D, 3D cells in 3D)")
    tensor = mesh.basix_cell().name in _TENSOR_CELLS
    curved = _geometry_element(mesh).degree > 1
    viscosity = None if bulk.viscosity_time is None else np.asarray(bulk.viscosity_time, dtype=float)
    geometry = np.full(cells.shape, POINTWISE, dtype=np.uint8) if curved else _classify(coordinates, corners, cells, tensor)
    kind = geometry.max(axis=1)
    if viscosity is not None:
        kind = kind + np.uint8(VISCOUS) * (viscosity[cells] != 0).any(axis=1)
    dim, lanes = mesh.geometry.dim, cells.shape[1]
    width = np.array([dim, dim**2, dim * (2**dim - 1), dim**2 * len(permutation)])[kind % VISCOUS] + 2 + kind // VISCOUS
    start = np.r_[0, np.cumsum(width)].astype(np.int64)
    number = _aligned((int(start[-1]), lanes))
    elastic = np.array([[0 if bulk.plane == "antiplane" else m.lame_lambda(bulk.plane), m.shear_modulus] for m in bulk.materials])
    for value in np.unique(kind):
        batches = np.flatnonzero(kind == value)
        for part in np.array_split(batches, max(1, len(batches) // 4096)):
            chosen = cells[part]
            jacobian, shape = (None, None) if curved else _shape(coordinates[corners[chosen]], tensor)
            modulus = elastic[bulk.cell_material[chosen]] * ~padding[part][..., None]
            if value % VISCOUS == POINTWISE:
                numbers = _pointwise(mesh, coordinates[corners[chosen]], bulk.space, permutation)
            elif value % VISCOUS == MULTILINEAR:
                numbers = shape.reshape(*chosen.shape, -1)
                # The kernel divides by det J; the sign of a cell turned inside out goes with the moduli.
                modulus = modulus * np.sign(np.linalg.det(jacobian))[..., None]
            else:
                scaled = _scaled_inverse(jacobian)
                numbers = np.diagonal(scaled, axis1=-2, axis2=-1) if value % VISCOUS == BOX else scaled.reshape(*chosen.shape, -1)
            numbers = np.concatenate([modulus, numbers], axis=-1)
            if value >= VISCOUS:
                numbers = np.concatenate([viscosity[chosen][..., None], numbers], axis=-1)
            rows = start[part][:, None] + np.arange(numbers.shape[-1])
            number[rows] = numbers.transpose(0, 2, 1)
    return kind, start[:-1], number


def _aligned(shape: tuple[int, int]) -> np.ndarray:
    """Uninitialised array that begins on a cache line, as vector loads want it."""
    raw = np.empty(shape[0] * shape[1] + 8)
    offset = (-raw.ctypes.data // 8) % 8
    return raw[offset : offset + shape[0] * shape[1]].reshape(shape)


def _geometry_element(mesh: Any) -> Any:
    return mesh.ufl_domain().ufl_coordinate_element()


def _shape(x: np.ndarray, tensor: bool) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian dx_a / dxi_d [..., d, a] at the first corner, and all coefficients of the map from the reference cell.

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


def _classify(coordinates: np.ndarray, corners: np.ndarray, cells: np.ndarray, tensor: bool) -> np.ndarray:
    """BOX, AFFINE or MULTILINEAR for every cell."""
    if not tensor:
        return np.full(cells.shape, AFFINE, dtype=np.uint8)
    rounding = 4 * np.finfo(float).eps * np.abs(coordinates).max(initial=0)
    geometry = np.empty(cells.shape, dtype=np.uint8)
    for first in range(0, len(cells), 4096):
        part = slice(first, first + 4096)
        jacobian, shape = _shape(coordinates[corners[cells[part]]], tensor)
        dim = shape.shape[-1]
        size = np.abs(jacobian).max(axis=(-2, -1))
        bend = np.abs(shape[..., dim:, :]).max(axis=(-2, -1))
        shear = np.abs(jacobian * (1 - np.eye(dim))).max(axis=(-2, -1))
        geometry[part] = np.where(shear <= 1e-15 * size, BOX, AFFINE)
        geometry[part][bend > 1e-13 * size + rounding] = MULTILINEAR
    return geometry


def _scaled_inverse(jacobian: np.ndarray) -> np.ndarray:
    """dxi_d / dx_a sqrt|det J|: the flux is G C G' of the reference gradient."""
    volume = np.sqrt(np.abs(np.linalg.det(jacobian)))
    return np.linalg.inv(jacobian).swapaxes(-1, -2) * volume[..., None, None]


def _pointwise(mesh: Any, x: np.ndarray, space: Any, permutation: np.ndarray) -> np.ndarray:
    """Scaled inverse Jacobian at every node of cells with curved edges."""
    described, basix = _geometry_element(mesh), fem.basix
    element = basix.create_element(
        basix.ElementFamily.P, mesh.basix_cell(), described.degree, lagrange_variant=described.lagrange_variant
    )
    slopes = element.tabulate(1, space.element.basix_element.points[permutation])[1:, :, :, 0]
    jacobian = np.einsum("dqk,blka->blqda", slopes, x)
    return _scaled_inverse(jacobian).reshape(*x.shape[:2], -1)
