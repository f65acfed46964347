"""The finite element stack, loaded at its first use in the required order, and differences between its versions.

Every other module uses ``from ruptfx.platform import fem`` and never imports DOLFINx, petsc4py or mpi4py itself. Hence
modules that compute can be imported where cases are only read, and without DOLFINx.
"""

# ruff: noqa: I001
from __future__ import annotations

import copy
import ctypes
import hashlib
import os
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast
from weakref import WeakMethod

import numpy as np

from ruptfx import RuptfxError
from ruptfx.platform.codegen import native
from ruptfx.platform import launch
from ruptfx import Table

VERSION: tuple[int, ...] = ()  # of DOLFINx, once it is loaded

Given = ParamSpec("Given")
Answer = TypeVar("Answer")

if TYPE_CHECKING:
    import basix as basix
    import basix.ufl
    import dolfinx as dolfinx
    import dolfinx.fem.petsc
    import dolfinx.graph
    import dolfinx.io
    import dolfinx.la
    import dolfinx.mesh
    import ufl as ufl
    from mpi4py import MPI as MPI
    from petsc4py import PETSc as PETSc
    from scipy.sparse import csr_matrix
    from ufl.core.expr import Expr as Expr
else:

    def __getattr__(name: str) -> Any:
        """Load the stack and return a part of it; functions below receive objects of the loaded stack."""
        if name not in ("MPI", "PETSc", "basix", "dolfinx", "ufl"):
            raise AttributeError(f"module 'ruptfx.platform.fem' has no attribute '{name}'")
        _load()
        return globals()[name]


def _load() -> None:
    """Import the stack.

    Raises
    ------
    RuptfxError
        It is missing, or too old.
    """
    import h5py  # noqa: F401  before DOLFINx: with numba installed the other order breaks HDF5

    with suppress(ModuleNotFoundError):
        # The wheel loads its own libraries, which must happen before petsc4py searches for them.
        import dolfinx_solver  # noqa: F401
    try:
        from mpi4py import MPI
        from petsc4py import PETSc
        import basix
        import basix.ufl
        import dolfinx
        import dolfinx.fem.petsc
        import dolfinx.graph
        import dolfinx.io
        import dolfinx.la
        import dolfinx.mesh
        import ufl
    except ModuleNotFoundError as missing:
        raise launch.no_fem(str(missing)) from None
    with suppress(ValueError):  # not the main thread
        # PETSc would abort the job if a reader such as `head` closes the pipe; Python raises BrokenPipeError.
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    version = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
    if version < (0, 9):
        raise RuptfxError(f"DOLFINx {dolfinx.__version__} is too old: ruptfx needs 0.9 to 0.11")
    remove_abandoned(_FORMS)
    globals().update(MPI=MPI, PETSc=PETSc, VERSION=version, basix=basix, dolfinx=dolfinx, ufl=ufl)


def world(comm: MPI.Comm | None = None) -> MPI.Comm:
    """Return a communicator, by default all ranks of the job, with the stack loaded: callers may have only mpi4py."""
    if not VERSION:
        _load()
    return comm or MPI.COMM_WORLD


def remove_abandoned(folder: Path, age: float = 300.0) -> None:
    """Remove the source files of forms whose compilation has ended without a library.

    FFCx creates the source of a form first and its mark `.cached` last; while there is a source without a mark, other
    processes wait for it and then give up. A process that was killed in between leaves such a source.

    Parameters
    ----------
    age : float
        Time after which nobody compiles a source any more [s].
    """
    with suppress(OSError):  # no folder yet
        names = {entry.name for entry in os.scandir(folder)}
        for name in names:
            path = folder / name
            if name.endswith(".c") and f"{name}.cached" not in names and time.time() - path.stat().st_mtime > age:
                path.unlink(missing_ok=True)


def is_loaded() -> bool:
    """Return whether the stack has been loaded."""
    return bool(VERSION)


def finish() -> None:
    """Finalise PETSc and MPI; collective; neither can be used afterwards."""
    finalize: Callable[[], None] = PETSc._finalize
    finalize()
    if not MPI.Is_finalized():
        MPI.Finalize()


# FFCx names a compiled form after its text and flags only. Code for -march=native may crash on another processor that
# shares the cache (network disk, image): each processor has its own folder.
_MACHINE = hashlib.sha256(native._processor().encode()).hexdigest()[:12]
_FORMS = native.cache_directory() / f"forms-{_MACHINE}"
ZERO = 1e-12  # entry of an interpolation between elements that is rounding
JIT_OPTIONS = {
    "cffi_extra_compile_args": ["-O3", f"-march={native.target()}"],
    "cache_dir": str(_FORMS),
    "timeout": 60,  # [s] for another process that compiles the same, on a busy machine
}


def lagrange(mesh: dolfinx.mesh.Mesh, order: int, components: int) -> dolfinx.fem.FunctionSpace:
    """Return the Lagrange space on Gauss-Lobatto-Legendre points, blocked by components (scalar if 1)."""
    shape = (components,) if components > 1 else None
    element = basix.ufl.element(
        "Lagrange", mesh.basix_cell().name, order, lagrange_variant=basix.LagrangeVariant.gll_warped, shape=shape
    )
    return dolfinx.fem.functionspace(mesh, element)


def renumbered(space: dolfinx.fem.FunctionSpace, number: np.ndarray) -> dolfinx.fem.FunctionSpace:
    """Return a space with other numbers of its nodes; collective.

    Parameters
    ----------
    number : ndarray of int32, shape (nodes,)
        New local number of every local node; a permutation of the owned nodes, ghosts keep theirs.
    """
    old, mesh = space.dofmap.index_map, space.mesh
    numbers = dolfinx.la.vector(old, 1, dtype=np.int64)
    numbers.array[:] = number + old.local_range[0]
    numbers.scatter_forward()  # ghosts: the new numbers of their owners
    cpp_space: Any = dolfinx.cpp.fem.FunctionSpace_float64
    # Without a tag and with a shape in 0.9.
    tag = (1201,) if "tag" in str(dolfinx.common.IndexMap.__init__.__doc__) else ()
    shape = (list(cast("Any", space).value_shape),) if "value_shape" in str(cpp_space.__init__.__doc__) else ()
    ghosts = numbers.array[old.size_local :]
    index_map = dolfinx.common.IndexMap(mesh.comm, old.size_local, ghosts, old.owners, *tag)
    cells = dolfinx.graph.adjacencylist(np.ascontiguousarray(number[space.dofmap.list], dtype=np.int32))
    layout, block = space.dofmap.dof_layout, space.dofmap.index_map_bs
    dofmap = dolfinx.cpp.fem.DofMap(layout, index_map, block, _of_cpp(cells), space.dofmap.bs)
    made = cpp_space(_of_cpp(mesh), _of_cpp(space.element), dofmap, *shape)
    return dolfinx.fem.FunctionSpace(mesh, cast("Any", space).ufl_element(), made)


def _of_cpp(wrapped: Any) -> Any:
    """Return the object of C++ behind one of Python, which is itself that in some versions."""
    return getattr(wrapped, "_cpp_object", wrapped)


def broken_lagrange(mesh: dolfinx.mesh.Mesh, components: int) -> dolfinx.fem.FunctionSpace:
    """Return the Lagrange space of order 1 in which every cell has its own nodes, blocked by components."""
    element = basix.ufl.element("Lagrange", mesh.basix_cell().name, 1, discontinuous=True, shape=(components,))
    return dolfinx.fem.functionspace(mesh, element)


def scalars_of_cells(mesh: dolfinx.mesh.Mesh, order: int) -> dolfinx.fem.FunctionSpace:
    """Return the scalars with values of their own at the quadrature points of every tensor cell, at one of others."""
    cell = mesh.basix_cell().name
    if cell in ("triangle", "tetrahedron"):
        return dolfinx.fem.functionspace(mesh, ("DG", 0))
    variant = basix.LagrangeVariant.gll_warped
    element = basix.ufl.element("Lagrange", cell, order, lagrange_variant=variant, discontinuous=True)
    return dolfinx.fem.functionspace(mesh, element)


def gll_metadata(mesh: dolfinx.mesh.Mesh, order: int) -> Table:
    """Return the quadrature that collocates with the nodes (diagonal mass) on tensor cells; exact elsewhere."""
    if mesh.basix_cell().name in ("quadrilateral", "hexahedron", "interval"):
        return {"quadrature_rule": "GLL", "quadrature_degree": 2 * order - 1}
    return {"quadrature_degree": 2 * order}


def interpolation_points(element: Any) -> np.ndarray:
    """Return the interpolation points of an element, in any version of DOLFINx."""
    points = element.interpolation_points
    return points() if callable(points) else points


def geometry_dofmap(mesh: dolfinx.mesh.Mesh) -> np.ndarray:
    """Return the geometry nodes of every local cell, shape (cells, nodes per cell)."""
    geometry = mesh.geometry
    return geometry.dofmaps[0] if VERSION >= (0, 11) else geometry.dofmap


def corners_of_facets(mesh: dolfinx.mesh.Mesh, facets: np.ndarray, count: int) -> np.ndarray:
    """Return the geometry nodes at the `count` corners of each local facet, shape (facets, count)."""
    if len(facets) == 0:  # DOLFINx 0.9 divides by their number
        return np.zeros((0, count), dtype=np.int64)
    nodes = dolfinx.mesh.entities_to_geometry(mesh, mesh.topology.dim - 1, facets).reshape(len(facets), -1)
    return nodes[:, :count].astype(np.int64)  # nodes on curved sides come after the corners


def tensor_order(space: dolfinx.fem.FunctionSpace) -> np.ndarray:
    """Return the nodes of a quadrilateral or hexahedron, shape (nodes of a cell,), the first coordinate slowest."""
    points = np.round(np.asarray(space.element.basix_element.points), 10)  # points of a line differ by round-off
    return np.lexsort(points.T[::-1])


def tabulate(space: dolfinx.fem.FunctionSpace, reference: np.ndarray) -> np.ndarray:
    """Return shape functions of a cell and derivatives along its axes, shape (1 + dim, nodes), at a reference point."""
    return np.asarray(space.element.basix_element.tabulate(1, reference[None]))[:, 0, :, 0]


def reference_point(
    mesh: dolfinx.mesh.Mesh, corners: np.ndarray, point: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the reference coordinates of a point and dx_i / dxi_j there, by Newton's method; None if outside.

    Parameters
    ----------
    corners : ndarray, shape (geometry nodes, dim)
        Corners of one cell [m].
    point : ndarray, shape (dim,)
        [m].
    """
    described: Any = mesh.ufl_domain()
    described = described.ufl_coordinate_element()
    element = basix.create_element(
        basix.ElementFamily.P, mesh.basix_cell(), described.degree, lagrange_variant=described.lagrange_variant
    )
    middle = basix.geometry(mesh.basix_cell()).mean(axis=0)
    place, slack = middle.copy(), 1e-8
    for _ in range(30):
        values = np.asarray(element.tabulate(1, place[None]))[:, 0, :, 0]
        jacobian = corners.T @ values[1:].T
        step = np.linalg.solve(jacobian, point - values[0] @ corners)
        place = place + step
        if np.abs(step).max() < 1e-14:
            break
    # Barycentric on simplices, between 0 and 1 along every axis elsewhere.
    simplex = mesh.basix_cell().name in ("triangle", "tetrahedron")
    converged = np.abs(step).max() < slack
    inside = converged and place.min() > -slack and (place.sum() < 1 + slack if simplex else place.max() < 1 + slack)
    return (place, jacobian) if inside else None


def create_mesh(
    comm: MPI.Comm,
    cells: np.ndarray,
    points: np.ndarray,
    cell: str,
    partitioner: Callable[..., object],
    order: int = 1,
) -> dolfinx.mesh.Mesh:
    """Create a mesh from connectivity in DOLFINx vertex order and coordinates, distributed by `partitioner`."""
    element = basix.ufl.element("Lagrange", cell, order, shape=(points.shape[1],))
    return dolfinx.mesh.create_mesh(comm, cells=cells, x=points, e=element, partitioner=partitioner)  # type: ignore[arg-type]


def assemble_summed(space: dolfinx.fem.FunctionSpace, expression: ufl.Form) -> np.ndarray:
    """Return an assembled linear form, complete at every local degree of freedom and ghost, shape (local dofs,)."""
    vector = dolfinx.fem.Function(space)
    dolfinx.fem.assemble_vector(vector.x.array, form(expression))
    vector.x.scatter_reverse(dolfinx.la.InsertMode.add)
    vector.x.scatter_forward()
    return vector.x.array.copy()


def from_owners(space: dolfinx.fem.FunctionSpace, nodal: np.ndarray) -> np.ndarray:
    """Return a nodal field with the values of the owner on all ranks, hence bitwise identical; collective.

    Parameters
    ----------
    nodal : ndarray, shape (local nodes, components)
    """
    function = dolfinx.fem.Function(space)
    function.x.array[:] = nodal.ravel()
    function.x.scatter_forward()
    return function.x.array.reshape(nodal.shape).copy()


def form(expression: ufl.Form, tuned: bool = True) -> Any:
    """Return a compiled form, from the folder of compiled forms if it is there; collective.

    Parameters
    ----------
    tuned : bool
        Compile for this processor; else with the flags that DOLFINx chooses.

    Raises
    ------
    RuptfxError
        Another process has not compiled the same form in time: it was killed, or it is slow.
    """
    options = dict(JIT_OPTIONS)
    if not tuned:
        del options["cffi_extra_compile_args"]
    try:
        return dolfinx.fem.form(expression, jit_options=options)
    except (TimeoutError, RuntimeError) as failed:
        if "JIT compilation" not in str(failed):
            raise
        raise RuptfxError(
            f"the weak form could not be compiled: {failed}; if another run that was killed began to compile it, try "
            f"again in 5 min, or remove the folder {options['cache_dir']}"
        ) from failed


def matrix(form: Any, coupled: np.ndarray, tied: tuple[np.ndarray, np.ndarray] | None = None) -> PETSc.Mat:
    """Return a compiled bilinear form as an AIJ matrix, summed over ranks, with entries for coupled nodes; collective.

    Where nodes are tied, the matrix is T' K T, with T the map from the unknowns of the kept nodes to those of all
    nodes: local indices of copies are mapped to the global ones of the kept nodes, also in later additions of values
    by local indices. Rows and columns of copies are zero.

    Parameters
    ----------
    coupled : ndarray of int, shape (pairs, 2)
        Additional pairs of local nodes with coupled unknowns: zero entries that may be filled later.
    tied : (ndarray, ndarray) of int, optional
        Local nodes that are kept, and their copies; given on all ranks or on none.
    """
    pairs = np.asarray(coupled, dtype=np.int32)
    pattern = dolfinx.fem.create_sparsity_pattern(form)
    if tied is not None:
        (space, _), copies = form.function_spaces, tied[1].astype(np.int32)
        owned = form.mesh.topology.index_map(form.mesh.topology.dim).size_local
        cells = np.asarray(space.dofmap.map())[:owned]
        node = np.arange(int(space.dofmap.index_map.size_local + space.dofmap.index_map.num_ghosts), dtype=np.int32)
        node[copies] = tied[0]
        for cell in cells[np.isin(cells, copies).any(axis=1)]:
            pattern.insert(node[cell], node[cell])
        pairs = np.concatenate([node[pairs], np.stack([copies, copies], axis=1)])
    for pair in pairs:
        pattern.insert(pair, pair)
    pattern.finalize()
    never_freed = dolfinx.cpp.la.petsc.create_matrix(form.mesh.comm, pattern)  # DOLFINx counts a reference too many
    made: Any = copy.copy(never_freed)  # the same matrix
    never_freed.destroy()  # gives the reference back
    zeros = np.zeros((2 * made.getBlockSize(), 2 * made.getBlockSize()))
    for pair in pairs:  # what is not set at the first assembly is dropped
        made.setValuesBlockedLocal(pair, pair, zeros, addv=PETSc.InsertMode.ADD_VALUES)
    if tied is not None:
        numbers = made.getLGMap()[0].getBlockIndices().copy()
        numbers[copies] = numbers[node[copies]]
        mapped: Any = PETSc.LGMap()
        mapped = mapped.create(numbers, made.getBlockSize(), made.comm)
        made.setLGMap(mapped, mapped)
    dolfinx.fem.petsc.assemble_matrix(made, form)
    made.assemble()
    return made


def nodal_matrix(
    space: dolfinx.fem.FunctionSpace, groups: Sequence[np.ndarray], tied: tuple[np.ndarray, np.ndarray] | None = None
) -> PETSc.Mat:
    """Return an AIJ matrix of zeros with room for its diagonal and for blocks of coupled nodes; collective.

    Parameters
    ----------
    space : FunctionSpace
    groups : sequence of ndarray of int, shape (n, k)
        Local nodes that are coupled, k at a time; every group on at least one rank.
    tied : (ndarray, ndarray) of int, optional
        As for `matrix`.
    """
    index_map, size = space.dofmap.index_map, space.dofmap.index_map_bs
    count = index_map.size_local + index_map.num_ghosts
    numbers = index_map.local_to_global(np.arange(count, dtype=np.int32)).astype(PETSc.IntType)
    diagonal = (numbers[: index_map.size_local, None] * size + np.arange(size)).ravel()
    if tied is not None:
        numbers[tied[1]] = numbers[tied[0]]
    rows, columns = [diagonal.astype(np.int64)], [diagonal]
    for group in groups:
        dofs = (numbers[group][..., None] * size + np.arange(size)).astype(PETSc.IntType)
        dofs = dofs.reshape(len(group), group.shape[1] * size)
        pairs = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
        rows.append(pairs[0].ravel())
        columns.append(pairs[1].ravel())
    made: Any = PETSc.Mat()
    made.create(space.mesh.comm)
    made.setSizes([[index_map.size_local * size, index_map.size_global * size]] * 2, bsize=size)
    made.setType("aij")
    made.setUp()
    # By rows, as the petsc4py of Debian 13 takes no lists of places.
    total = np.int64(index_map.size_global * size)
    row, column = np.divmod(np.unique(np.concatenate(rows) * total + np.concatenate(columns)), total)
    own, first = np.unique(row, return_index=True)
    ends, own, column = (each.astype(PETSc.IntType) for each in (np.append(first, len(row)), own, column))
    made.setValuesIJV(ends, column, np.zeros(len(column)), addv=PETSc.InsertMode.ADD_VALUES, rowmap=own)
    made.assemble()
    mapped: Any = PETSc.LGMap()
    mapped.create(numbers, size, space.mesh.comm)
    made.setLGMap(mapped, mapped)
    return made


def interpolation(coarse: dolfinx.fem.FunctionSpace, fine: dolfinx.fem.FunctionSpace) -> PETSc.Mat:
    """Return the interpolation from one space to another of the same mesh as an AIJ matrix; collective.

    DOLFINx stores dense blocks of elements; their zeros, eleven of twelve entries from order 1 to 2, are left out.
    """
    never_freed = dolfinx.fem.petsc.interpolation_matrix(coarse, fine)  # DOLFINx counts a reference too many
    made: Any = copy.copy(never_freed)
    never_freed.destroy()
    made.assemble()
    start, column, value = made.getValuesCSR()
    kept = np.abs(value) > ZERO
    start = np.concatenate([[0], np.cumsum(kept)])[start].astype(start.dtype)
    result: Any = PETSc.Mat()
    result.createAIJ(made.getSizes(), csr=(start, column[kept], value[kept]), comm=made.comm)
    made.destroy()
    return result


def local_matrix(form: Any) -> csr_matrix:
    """Return a compiled bilinear form over the cells owned by this rank, as a SciPy matrix over local unknowns."""
    rows = dolfinx.fem.assemble_matrix(form).to_scipy(ghosted=True).tocsr()
    # Remove columns beyond the local unknowns, which are reserved for contributions of other ranks.
    return rows[:, : rows.shape[0]].copy()


def callback(method: Callable[Given, Answer]) -> Callable[Given, Answer]:
    """Return a function for PETSc that calls a bound method without keeping its object.

    PETSc objects keep their callbacks where Python's garbage collector does not look: an object that has a solver and
    is its callback would stay for ever, with its model and their communicators, of which MPI has about two thousand.
    """
    weak = WeakMethod(method)

    def call(*arguments: Given.args, **options: Given.kwargs) -> Answer:
        alive = weak()
        assert alive is not None, "a solver outlived the object that it belongs to"
        return alive(*arguments, **options)

    call.__name__ = method.__name__  # petsc4py keeps one of each name
    return call


def option_was_read(name: str) -> bool:
    """Return whether an option (name with prefix, without dash) of PETSc's database was read."""
    database = PETSc.Options()
    if hasattr(database, "used"):
        return bool(database.used(name))
    # petsc4py before 3.23 does not wrap it.
    used = ctypes.c_int(0)
    library = ctypes.CDLL(PETSc.__file__)  # symbols of the PETSc it is linked to
    library.PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    return bool(used.value)


class SharedVector:
    """Vector of local degrees of freedom, ghosts included, whose sum over ranks overlaps with other work.

    If every cell has its own nodes, there is no sum: ghosts receive the values of their owner.

    Parameters
    ----------
    space : FunctionSpace
    real : dtype
        Type of its numbers; sums are those of doubles.
    shared : ndarray of bool, shape (local nodes,)
        True at nodes shared with other ranks.

    Attributes
    ----------
    array : ndarray, shape (local dofs,)
        Between `begin` and `end` the entries of nodes shared with other ranks must not be modified.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace, real: np.dtype, shared: np.ndarray) -> None:
        owned, block = space.dofmap.index_map, space.dofmap.index_map_bs
        # Long arrays of NumPy are in huge pages, those of DOLFINx are not; they make large steps 4 % longer.
        self.array = np.empty((owned.size_local + owned.num_ghosts) * block, dtype=real)
        self.array[:] = 0
        self._shared = np.flatnonzero(np.repeat(shared, block))
        # PETSc sums doubles; of a second array only the pages of shared nodes are ever used.
        self._doubles = self.array if real == np.float64 else np.zeros(len(self.array))
        self._vector: Any = None if space.mesh.comm.size == 1 else PETSc.Vec().createGhostWithArray(
            owned.ghosts.astype(PETSc.IntType), cast("Any", self._doubles),
            size=(owned.size_local * block, owned.size_global * block), bsize=block, comm=owned.comm,
        )  # fmt: skip
        self._sums = not space.element.basix_element.discontinuous
        self._way = (PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE) if self._sums else (
            PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)  # fmt: skip

    def begin(self) -> None:
        """Start to send the contributions of this rank to nodes of others."""
        if self._vector is not None:
            if self._doubles is not self.array:
                self._doubles[self._shared] = self.array[self._shared]
            self._vector.ghostUpdateBegin(*self._way)

    def end(self) -> None:
        """Wait for the sums; every rank then has them at all its nodes."""
        if self._vector is not None:
            self._vector.ghostUpdateEnd(*self._way)
        if self._vector is not None and self._sums:
            self._vector.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
        if self._doubles is not self.array:
            self.array[self._shared] = self._doubles[self._shared]
