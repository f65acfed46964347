"""The explicit hot path: linear elasticity without a matrix, a vector of elements at a time, in compiled C.

The kernel is `matrix_free.c`. Where moduli vary in an element, it reads those of the nodes. This module sorts the
elements into batches, describes their geometry, and finds for every node the last element that touches it, after which
the node may move on within the same sweep.
"""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Sequence
from importlib.resources import files

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.operators import Bulk, Damped, Inelastic, InsertedSweep, StepPart, nodes_of_sweeps
from ruptfx.bodies.operators.geometry import AFFINE, BOX, VARYING, geometry_element, is_tensor, numbers, root_of_size
from ruptfx.bodies.space import numbering
from ruptfx.laws.materials.stiffness import linear_stiffness
from ruptfx.platform import fem
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import DOUBLE, address

# Nodes computed between updates in 2D. Measured: with 2000 the update is slower by half (short contiguous ranges).
BLOCK_NODES = 16384
# If every cell has its own nodes, the range is contiguous: as many nodes as fit into the second-level cache.
BROKEN_BLOCK_NODES = 3072


class _Plan(ctypes.Structure):
    """`struct plan` of the C source."""

    _fields_ = [(name, ctypes.c_void_p) for name in (
        "dof", "kind", "start", "number", "line", "block",
        "row", "row_start", "row_split", "single", "single_start", "single_split",
        "move", "move_start",
    )]  # fmt: skip


class _Sweep(ctypes.Structure):
    """`struct sweep` of the C source."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("add_force", "plan", "memory", "end")]


class _Inelastic(ctypes.Structure):
    """`struct inelastic` of the C source."""

    _fields_ = [
        ("sweep", ctypes.POINTER(_Sweep)), ("sweeps", ctypes.c_long), ("dt", ctypes.c_double),
        ("force", ctypes.c_void_p), ("power", ctypes.c_void_p),
    ]  # fmt: skip


class MatrixFree:
    """Matrix-free operator and fused leapfrog step for quadrilaterals, hexahedra and order-1 simplices.

    Parameters
    ----------
    bulk : Bulk
    shared : ndarray of bool, shape (nodes,), optional
        True for every local node shared with another rank; found by communication if not given.

    Raises
    ------
    RuptfxError
        If the material or the element is not supported.
    """

    any_precision = True
    """Whether it computes with `Bulk.real`; displacements are doubles."""

    def __init__(self, bulk: Bulk, shared: np.ndarray | None = None) -> None:
        space = bulk.space
        _refuse_unknown(bulk)
        index_map = space.dofmap.index_map
        self._components = space.dofmap.index_map_bs
        self._nodes = index_map.size_local + index_map.num_ghosts
        self._shared = numbering.shared_nodes(index_map) if shared is None else shared
        permutation, constants = _reference_cell(bulk)
        self._real = bulk.real
        lanes = files("ruptfx").joinpath("platform/codegen/lanes.c").read_text()
        kernel = files(__package__).joinpath("matrix_free.c").read_text()
        extras = "#define VARIES 1\n" * (bulk.variation is not None)
        if self._real != DOUBLE:
            extras += f"#define LANE {self._real.itemsize}\n#define REAL {native.c_type(self._real)}\n"
        self._library = native.load("matrix_free", extras + constants + lanes + kernel)
        self._library.step.restype = self._library.strain_energy.restype = ctypes.c_double
        self._plan = _Plan()
        self._keep: dict[str, np.ndarray] = {}
        cells, padding, self._boundary_batches = self._order_cells(bulk, self._library.lanes_per_batch())
        self._batches, self.batches = len(cells), cells
        # (batch, node, lane): lanes of one node are neighbours in memory.
        nodes = space.dofmap.list[:, permutation][cells].transpose(0, 2, 1)
        self._hold("dof", np.ascontiguousarray(nodes * np.int32(self._components), dtype=np.int32))
        kind, start, number = numbers(bulk, cells, padding, permutation)
        for name, array in (("kind", kind), ("start", start), ("number", number)):
            self._hold(name, array)
        plain = is_tensor(space.mesh) and bulk.plane != "axisymmetric" and (kind % VARYING).max(initial=BOX) <= AFFINE
        self._root = root_of_size(space.mesh, cells, self._real) if plain else None
        self._cell_nodes, self._space = len(permutation), space
        self._moduli = bulk.moduli(cells[:1])[0].shape[-1]
        linear_simplex = not (is_tensor(space.mesh) or bulk.large_rotations)
        self._damps = linear_simplex and self._components == space.mesh.topology.dim
        connected = BLOCK_NODES if space.mesh.topology.dim == 2 else numbering.BLOCK_NODES_3D
        self._block_nodes = BROKEN_BLOCK_NODES if bool(space.element.basix_element.discontinuous) else connected
        self._hold_lines(_fetch(space))
        self.prepare_step(np.zeros(self._nodes, dtype=bool))

    def add_internal_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        """Subtract K displacement of the cells owned by this rank from `force` [N], in place."""
        own = force if force.dtype == self._real else np.zeros(force.shape, dtype=self._real)
        self._library.add_internal_force(
            ctypes.byref(self._plan), ctypes.c_long(0), ctypes.c_long(self._batches),
            *self._pointers(displacement.astype(float, copy=False)), *self._pointers(own, real=self._real),
        )  # fmt: skip
        if own is not force:
            force += own

    def energy(self, displacement: np.ndarray) -> float:
        """Return the strain energy of the cells owned by this rank [J per metre of thickness]; large rotations only."""
        return self._library.strain_energy(
            ctypes.byref(self._plan), ctypes.c_long(self._batches), *self._pointers(displacement)
        )

    def add_viscous_force(self, displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray) -> None:
        """Subtract the force of the cells' viscous stress from `force`, as `ViscousOperator`; large rotations only."""
        self._library.add_viscous_force(
            ctypes.byref(self._plan), ctypes.c_long(self._batches), *self._pointers(displacement, velocity, force)
        )

    @property
    def adds_stress(self) -> bool:
        """True if `add_stress` supports the cells of this rank: quadrilaterals and hexahedra with parallel edges."""
        return self._root is not None

    def add_stress(self, displacement: np.ndarray, sums: np.ndarray) -> None:
        """Add stress times weight and size of elements at their nodes, for the cells owned by this rank.

        Parameters
        ----------
        displacement : ndarray, shape (nodes * components,)
        sums : ndarray, shape (nodes, stress components)
            xx, yy, xy; in 3D xx, yy, zz, xy, yz, xz; in antiplane xz, yz [Pa times volume].
        """
        assert self._root is not None
        assert sums.flags.c_contiguous and sums.dtype == np.float64 and len(sums) == self._nodes
        self._library.add_stress(
            ctypes.byref(self._plan), ctypes.c_long(self._batches), address(self._root, self._real),
            *self._pointers(displacement), address(sums),
        )  # fmt: skip

    @property
    def damps(self) -> bool:
        """True if steps include the Kelvin-Voigt damping of all elements: linear simplices in 2D and 3D."""
        return self._damps

    # -- the fused step --------------------------------------------------------------------------------------------

    def prepare_step(
        self, by_caller: np.ndarray, sweeps: Sequence[InsertedSweep] = (), moves: bool = False
    ) -> None:  # fmt: skip
        """Set which nodes `step` leaves to the caller; nodes shared with other ranks always.

        Parameters
        ----------
        by_caller : ndarray of bool, shape (nodes,)
            True at nodes left to the caller.
        sweeps : sequence of InsertedSweep, optional
            Those of the argument `inelastic` of steps.
        moves : bool
            Whether steps have the argument `move`.
        """
        node = self._keep["dof"].reshape(self._batches, self._cell_nodes, -1) // self._components
        size = numbering.batches_of_block(self._block_nodes, *node.shape[1:])
        first = np.unique(np.r_[
            np.arange(0, self._boundary_batches, size), np.arange(self._boundary_batches, self._batches, size),
            self._batches,
        ])  # fmt: skip
        self._boundary_blocks = int(np.searchsorted(first, self._boundary_batches))
        self._blocks = len(first) - 1
        # Later assignments win: what remains is the last block that touches the node.
        done_in = np.full(self._nodes, -1, dtype=np.int32)
        for block in range(self._blocks):
            done_in[node[first[block] : first[block + 1]].ravel()] = block
        done_in[by_caller | self._shared] = -1
        nodes = np.argsort(done_in, kind="stable")[np.count_nonzero(done_in < 0) :].astype(np.int32)
        per_row = self._library.nodes_per_row()
        in_row = _rows(nodes, done_in[nodes], per_row)
        touched = nodes_of_sweeps(self._space, sweeps)
        for name, which, count in (("row", in_row == 0, per_row), ("single", in_row < 0, 1)):
            chosen = nodes[which]
            without = ~touched[chosen[:, None] + np.arange(count)].any(axis=1)
            order = np.lexsort((without, done_in[chosen]))  # in a block those with an inserted force first
            starts = np.searchsorted(2 * done_in[chosen[order]] + without[order], np.arange(2 * self._blocks + 1))
            self._hold(name, np.ascontiguousarray(chosen[order]))
            self._hold(f"{name}_start", starts[::2].astype(np.int32))
            self._hold(f"{name}_split", starts[1::2].astype(np.int32))
        self._hold("block", first.astype(np.int32))
        if moves:
            self._hold_moves(node, first, done_in >= 0)
        self._ends = [self._end_in_blocks(first, sweep.batches) for sweep in sweeps]

    def _hold_moves(self, node: np.ndarray, first: np.ndarray, advanced: np.ndarray) -> None:
        """Store for every block the ranges of advanced nodes that it is the first to touch."""
        begun_in = np.full(self._nodes, self._blocks, dtype=np.int32)
        for block in reversed(range(self._blocks)):
            begun_in[node[first[block] : first[block + 1]].ravel()] = block
        begun_in[~advanced] = self._blocks
        begin = np.flatnonzero(np.diff(begun_in, prepend=-1))
        ranges = np.column_stack([begin, np.append(begin[1:], self._nodes)]) * self._components
        order = np.argsort(begun_in[begin], kind="stable")
        starts = np.searchsorted(begun_in[begin][order], np.arange(self._blocks + 1))
        self._hold("move", np.ascontiguousarray(ranges[order[: starts[-1]]], dtype=np.int32))
        self._hold("move_start", starts.astype(np.int32))

    def __copy__(self) -> MatrixFree:
        """Return an operator with the same elements, for which other steps can be prepared."""
        new = object.__new__(type(self))
        new.__dict__ = self.__dict__ | {"_plan": _Plan.from_buffer_copy(self._plan), "_keep": dict(self._keep)}
        return new

    def viscous_sweep(self, eta: float) -> ViscousSweep:
        """Return the damping of the elements, the force -eta K v, for steps of another operator."""
        return ViscousSweep(self, eta)

    def _end_in_blocks(self, first: np.ndarray, batches: np.ndarray) -> np.ndarray:
        """Return how many batches of a sweep must be complete before each block of elements.

        The nodes of an element move on after its block, so that its batch must not come later.
        """
        count = np.diff(first)
        block_of = np.zeros(self.batches.max() + 1, dtype=np.int32)
        block_of[self.batches] = np.repeat(np.arange(self._blocks), count)[:, None]
        latest = np.minimum.accumulate(block_of[batches].min(axis=1)[::-1])[::-1]
        return np.searchsorted(latest, np.arange(self._blocks), side="right").astype(np.int32)

    def step(  # noqa: PLR0913
        self,
        displacement: np.ndarray,
        velocity: np.ndarray,
        force: np.ndarray,
        inverse_mass: np.ndarray,
        dt: float,
        decay: float = 1.0,
        energy: np.ndarray | None = None,
        damped: Damped | None = None,
        inelastic: Inelastic | None = None,
        part: StepPart = "all",
        move: float = 0.0,
    ) -> float:
        """Add the internal force of all elements and make one leapfrog step of every node not left to the caller.

        Updated nodes: velocity = decay velocity + dt force / mass, displacement += dt velocity, force = 0. At nodes of
        the caller the internal force is added to `force`, which the caller uses and sets to zero.

        Parameters
        ----------
        displacement, velocity, force : ndarray, shape (nodes * components,)
            The last two of the type `Bulk.real`.
        inverse_mass : ndarray, shape (nodes,)
            [1/kg]; of the same type.
        dt : float
            Time step [s].
        decay : float
            Factor of the old velocity; below 1 with mass damping.
        energy : ndarray, shape (2,), optional
            Of plain nodes the sums of |velocity|^2 / inverse_mass, and of the new displacement times the force that
            acted, are added to it; the latter without that of `damped`.
        damped : Damped, optional
            The elements are, where the operator `damps`.
        inelastic : Inelastic, optional
            Its force acts beside that of the elements, and its states advance; not together with `damped`.
        part : {"all", "boundary", "interior"}
            Elements at nodes shared with other ranks come first: after "boundary" `force` is ready to send, and
            "interior" does not access the force of these nodes.
        move : float
            Time for which the updated nodes move on with their old velocity before the elements act [s].

        Returns
        -------
        float
            With decay below 1: sum over plain nodes of |(old + new velocity) / 2|^2 / inverse_mass [J], else 0.
        """
        first = self._boundary_blocks if part == "interior" else 0
        last = self._boundary_blocks if part == "boundary" else self._blocks
        if not last:
            return 0.0
        assert damped is None or inelastic is None
        assert inelastic is not None or not self._ends, "nodes of inserted sweeps need their force"
        return self._library.step(
            ctypes.byref(self._plan), ctypes.c_long(first), ctypes.c_long(last),
            *self._pointers(displacement), *self._pointers(velocity, force, real=self._real),
            *self._pointers(inverse_mass, size=1, real=self._real), ctypes.c_double(dt), ctypes.c_double(decay),
            address(energy),
            ctypes.c_double(0.0 if damped is None else damped.eta),
            *([ctypes.c_void_p(None)] * 2 if damped is None else
              [*self._pointers(damped.force), address(damped.lost)]),
            None if inelastic is None else ctypes.byref(self._inserted(inelastic)), ctypes.c_double(move),
        )  # fmt: skip

    def _inserted(self, inelastic: Inelastic) -> _Inelastic:
        """Return `struct inelastic`; it holds a reference to its array of sweeps."""
        sweeps = zip(inelastic.sweeps, inelastic.states, self._ends, strict=True)
        rows = [_Sweep(*sweep.call(state), end.ctypes.data) for sweep, state, end in sweeps]
        force, power = self._pointers(inelastic.force)[0], inelastic.power.ctypes.data
        return _Inelastic((_Sweep * len(rows))(*rows), len(rows), inelastic.dt, force, power)

    # -- preparation -----------------------------------------------------------------------------------------------

    @property
    def nbytes(self) -> int:
        """Memory of the operator [bytes]."""
        return sum(array.nbytes for array in self._keep.values())

    def _hold(self, name: str, array: np.ndarray) -> None:
        self._keep[name] = array
        setattr(self._plan, name, array.ctypes.data)

    def _pointers(self, *arrays: np.ndarray, size: int | None = None, real: np.dtype = DOUBLE) -> list[ctypes.c_void_p]:
        """Return C pointers of vectors with `size` numbers per node, by default one per component."""
        size = size or self._components
        for array in arrays:
            if array.dtype != real or array.shape != (self._nodes * size,) or not array.flags.c_contiguous:
                raise RuptfxError(
                    f"matrix_free: a vector of {self._nodes * size} {native.c_type(real)}s is needed, not of shape "
                    f"{array.shape} and {array.dtype}"
                )
        return [address(array, real) for array in arrays]

    def _hold_lines(self, fetch: int) -> None:
        """Store the cache lines of forces that every batch is the first to access, for prefetching one batch ahead.

        All batches have the same number, so that the kernel needs no test: the last line is repeated if there are
        fewer.
        """
        size = 64 // self._real.itemsize
        lines = self._keep["dof"].reshape(self._batches, -1) // size
        first_touch = np.full(self._nodes * self._components // size + 1, self._batches, dtype=np.int32)
        for batch in range(self._batches - 1, -1, -1):
            first_touch[lines[batch]] = batch
        order = np.argsort(first_touch, kind="stable")
        starts = np.searchsorted(first_touch[order], np.arange(self._batches + 1))
        count = fetch * self._cell_nodes
        place = starts[:-1, None] + np.minimum(np.arange(count), np.maximum(np.diff(starts) - 1, 0)[:, None])
        chosen = order[np.minimum(place, len(order) - 1)].astype(np.int32)
        # One more row: every batch prefetches for the next one, also the last batch.
        self._hold("line", np.concatenate([chosen, np.zeros((1, count), dtype=np.int32)]))

    def _order_cells(self, bulk: Bulk, lanes: int) -> tuple[np.ndarray, np.ndarray, int]:
        """Return cells by batch (batch, lane), flags of padding cells, and the number of boundary batches.

        Elements at shared nodes come first, so that their force is communicated while the others are computed; within
        both groups the order is that of `numbering.sweep_order`, so that vectors are read nearly in order.
        """
        groups, fillers = [], []
        for group in numbering.sweep_order(bulk.space, self._shared, bulk.only):
            spare = -len(group) % lanes
            groups.append(np.r_[group, group[-1:].repeat(spare)].reshape(-1, lanes))
            fillers.append(np.arange(groups[-1].size).reshape(-1, lanes) >= len(group))
        return np.concatenate(groups), np.concatenate(fillers), len(groups[0])


class ViscousSweep:
    """`InsertedSweep` of the Kelvin-Voigt damping of elements; its state is the velocity of all nodes.

    Parameters
    ----------
    operator : MatrixFree
        Of the elements that are damped.
    eta : float
        [s]
    """

    def __init__(self, operator: MatrixFree, eta: float) -> None:
        self.batches, self._operator = operator.batches, copy.copy(operator)
        kept = self._operator._keep
        number = native.aligned(kept["number"].shape, operator._real)
        start, varying = kept["start"], kept["kind"] >= VARYING
        number[:] = kept["number"]
        moduli = operator._moduli
        for count, batches in ((moduli, ~varying), (moduli * (1 + operator._cell_nodes), varying)):
            number[start[batches, None] + np.arange(count)] *= eta
        self._operator._hold("number", number)
        function = ctypes.cast(operator._library.add_viscous_sweep, ctypes.c_void_p).value
        assert function is not None
        self._function = function

    def call(self, state: np.ndarray) -> tuple[int, int, int]:
        """Return the addresses of the C function, of its plan and of the velocities."""
        return self._function, ctypes.addressof(self._operator._plan), state.ctypes.data


def _refuse_unknown(bulk: Bulk) -> None:
    remedy = "operator = 'ufl_form' handles it"
    for number, material in enumerate(bulk.materials):
        if material.lame(bulk.plane) is not None:
            continue
        kind = material.kind()
        if bulk.large_rotations:
            raise RuptfxError(f"matrix_free knows large rotations of isotropic bodies only, not of '{kind}'; {remedy}")
        varying = set() if bulk.variation is None else set(bulk.variation.given[number].varying) - {"density"}
        if varying:
            raise RuptfxError(f"matrix_free knows one stiffness of '{kind}', and {min(varying)} varies; {remedy}")
        try:
            linear_stiffness(material, bulk.plane)
        except RuptfxError:
            raise RuptfxError(
                f"matrix_free needs an energy that is quadratic in the strain and depends on nothing else, unlike "
                f"that of '{kind}'; {remedy}"
            ) from None
    cell, order = bulk.space.mesh.basix_cell().name, bulk.space.element.basix_element.degree
    limit = 8 if is_tensor(bulk.space.mesh) else 1
    if order > limit:
        raise RuptfxError(f"matrix_free goes up to order {limit} on a {cell}, not {order}; {remedy}")
    if limit == 1 and bulk.plane == "axisymmetric":
        raise RuptfxError(f"matrix_free goes round an axis with quadrilaterals only, not with a {cell}; {remedy}")
    if bulk.large_rotations and cell != "triangle":
        raise RuptfxError(f"matrix_free knows large rotations of triangles only, not of a {cell}; {remedy}")
    if limit == 1 and geometry_element(bulk.space.mesh).degree > 1:
        raise RuptfxError(f"matrix_free wants a {cell} with straight edges; {remedy}")


def _fetch(space: fem.dolfinx.fem.FunctionSpace) -> int:
    """Return the cache lines of new nodes per node of a batch.

    order^dim new nodes per element, as many elements as numbers in a line.
    """
    order, dim = space.element.basix_element.degree, space.mesh.topology.dim
    return -(-space.dofmap.index_map_bs * order**dim // (order + 1) ** dim)


def _rows(nodes: np.ndarray, block: np.ndarray, per_row: int) -> np.ndarray:
    """Return the position (0 to per_row - 1) of a node in a full row of consecutive nodes of one block; -1 outside."""
    if len(nodes) == 0:
        return np.zeros(0, dtype=np.int64)
    new_run = np.r_[True, (np.diff(nodes) != 1) | (np.diff(block) != 0)]
    start = np.flatnonzero(new_run)
    length = np.diff(np.r_[start, len(nodes)])
    place = np.arange(len(nodes)) - np.repeat(start, length)
    return np.where(place < np.repeat(length // per_row * per_row, length), place % per_row, -1)


def _reference_cell(bulk: Bulk) -> tuple[np.ndarray, str]:
    """Return the tensor-product order of the nodes of a cell, and the constants of the C source."""
    space = bulk.space
    element = space.element.basix_element
    order, dim = element.degree, space.mesh.topology.dim
    sizes = {
        "DIM": dim, "COMPONENTS": space.dofmap.index_map_bs, "ORDER": order, "FETCH": _fetch(space),
        "SIMPLEX": int(not is_tensor(space.mesh)), "AXISYMMETRIC": int(bulk.plane == "axisymmetric"),
        "LARGE_ROTATIONS": int(bulk.large_rotations), "ANISOTROPIC": int(not bulk.isotropic),
    }  # fmt: skip
    text = "".join(f"#define {key} {value}\n" for key, value in sizes.items())
    if not is_tensor(space.mesh):
        volume = 1 / (2, 6)[dim - 2]
        return np.arange(dim + 1), text + _tables({"lane MINUS_WEIGHT[]": np.full(dim + 1, -volume)})
    points, weights, derivative = gauss_lobatto_legendre(order)
    permutation = fem.tensor_order(space)
    product = weights
    for _ in range(dim - 1):
        product = np.multiply.outer(product, weights)
    transposed = (weights[:, None] * derivative).T / weights[:, None]
    return permutation, text + _tables({
        "lane POINT[]": points, "lane MINUS_WEIGHT[]": -product.ravel(),
        "struct matrix DERIVATIVE": _halves(derivative), "struct matrix TRANSPOSED": _halves(transposed),
    })  # fmt: skip


def _halves(matrix: np.ndarray) -> np.ndarray:
    """Return even and odd half of a matrix that changes sign when rows and columns are reversed."""
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
    """Return points and weights on [0, 1], and the matrix of derivatives D[i, j] = l_j'(x_i)."""
    basix = fem.basix
    rule = basix.make_quadrature(basix.CellType.interval, 2 * order - 1, rule=basix.QuadratureType.gll)
    points, weights = np.asarray(rule[0]).ravel(), np.asarray(rule[1])
    x, weights = np.sort(points), weights[np.argsort(points)]
    difference = x[:, None] - x + np.eye(order + 1)
    barycentric = 1 / np.prod(difference, axis=1)
    derivative = barycentric / barycentric[:, None] / difference
    np.fill_diagonal(derivative, 0)
    derivative = 0.5 * (derivative - derivative[::-1, ::-1])
    # Rows must sum to zero exactly: a rigid translation gives no force.
    np.fill_diagonal(derivative, -derivative.sum(axis=1))
    return x, weights, derivative
