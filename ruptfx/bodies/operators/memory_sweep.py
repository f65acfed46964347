"""The sweep over the elements of a material with memory, in compiled C: `memory.c` around the traced stress formula.

It adds the force of the inelastic stress, that of the material less the stress of its elastic energy. The elastic part
is that of the bulk operator, of any kind.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from functools import cached_property
from importlib.resources import files
from typing import Any

import numpy as np

from ruptfx.bodies.operators import Bulk
from ruptfx.bodies.operators.geometry import MULTILINEAR, POINTWISE, VARYING, is_tensor, jacobian_at, root_of_size
from ruptfx.bodies.operators.matrix_free import MatrixFree, _reference_cell, gauss_lobatto_legendre
from ruptfx.input.schema import CaseError
from ruptfx.laws.materials import Material
from ruptfx.laws.materials.traced import traced
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address

CHUNK = 64  # cells whose maps from displacement to strain are in memory at once
ROUNDING = 1e-12  # asymmetry of moduli over the largest that is rounding


class _Memory(ctypes.Structure):
    """`struct memory` of the C source."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("size", "inverse", "state", "parameter")]


class CellPoints:
    """Geometry of the points with a state in some cells.

    Parameters
    ----------
    space : FunctionSpace
    cells : ndarray of int, shape (n,)
        Local cells.
    count : int
        Points of a cell: its nodes, or one.
    permutation : ndarray of int
        Order of the nodes of the kernel.
    """

    def __init__(self, space: Any, cells: np.ndarray, count: int, permutation: np.ndarray) -> None:
        self._space, self._cells, self.count, self._permutation = space, cells, count, permutation

    @cached_property
    def slopes(self) -> np.ndarray:
        """Derivatives of the shape functions along the axes of the reference cell, shape (dim, points, nodes)."""
        return np.asarray(self._space.element.basix_element.tabulate(1, self.positions))[1:, :, self._permutation, 0]

    @cached_property
    def positions(self) -> np.ndarray:
        """Points with a state in the reference cell, shape (points, dim)."""
        points = np.asarray(self._space.element.basix_element.points)[self._permutation]
        return points if self.count > 1 else points.mean(axis=0, keepdims=True)

    @cached_property
    def _jacobian(self) -> np.ndarray:
        """dx_a / dxi_d at all points of the cells, shape (cells, points, d, a) [m]."""
        return jacobian_at(self._space.mesh, self._cells, self.positions)

    @cached_property
    def inverse_jacobian(self) -> np.ndarray:
        """dxi_d / dx_a at all points of the cells, shape (cells, points, a, d) [1/m]."""
        return np.linalg.inv(self._jacobian)

    @cached_property
    def volumes(self) -> np.ndarray:
        """Weights of the points, shape (cells, points) [m2 or m3]."""
        dim, weights = self.positions.shape[1], np.ones(1)
        if self.count > 1:
            of_axis = gauss_lobatto_legendre(self._space.element.basix_element.degree)[1]
            for _ in range(dim):
                weights = np.multiply.outer(weights, of_axis).ravel()
        else:
            weights = weights / (2, 6)[dim - 2]
        return np.asarray(weights * np.abs(np.linalg.det(self._jacobian)))


class MemorySweep(MatrixFree):
    """Forces, stresses and energies of the elements of one material with memory.

    Parameters
    ----------
    bulk : Bulk
        `only` marks the elements; at least one of this rank.
    material : Material
        As given, with the profiles of parameters that vary.
    key : str
        Of the material in the case, for messages.
    number : int
        Index of the body, where parameters vary.
    shared : ndarray of bool, optional
        As of `MatrixFree`; needed if some ranks have no elements of the material.

    Attributes
    ----------
    cells : ndarray of int, shape (n,)
        Local cells of this rank, each once.
    points : int
        Points of a cell with a state of their own.

    Raises
    ------
    CaseError
        Elements with curved edges.
    """

    def __init__(
        self, bulk: Bulk, material: Material, key: str, number: int = 0, shared: np.ndarray | None = None
    ) -> None:
        super().__init__(bulk, shared)
        self.law = traced(material, bulk.plane)
        space = bulk.space
        permutation, constants = _reference_cell(bulk)
        self._permutation = permutation
        macros = "".join(f"#define {name} {value}\n" for name, value in self.law.as_c().items())
        parts = [files("ruptfx").joinpath("platform/codegen/lanes.c")]
        parts += [files("ruptfx.bodies.operators").joinpath(name) for name in ("matrix_free.c", "memory.c")]
        source = macros + constants + "".join(part.read_text() for part in parts)
        self._compiled = native.load("memory", source)
        self._compiled.memory_energy.restype = ctypes.c_double
        batches, padding, _ = self._order_cells(bulk, self._library.lanes_per_batch())
        kind = self._keep["kind"] % VARYING
        if np.any(kind == POINTWISE):
            raise CaseError(f"{key}: a material with memory needs elements with straight edges; use a mesh of order 1")
        root = root_of_size(space.mesh, batches)
        varying = (kind == MULTILINEAR)[:, None]
        sign = np.sign(_orientation(bulk, batches)) if varying.any() else 1.0
        size, inverse = native.aligned(root.shape), native.aligned(root.shape)
        size[:] = np.where(padding, 0.0, np.where(varying, sign, root))
        inverse[:] = np.where(varying, 1.0, 1 / root)
        self.points = len(permutation) if is_tensor(space.mesh) else 1
        self.shape = (len(batches), self.points, len(self.law.state), batches.shape[1])
        parameters = native.aligned((len(batches), self.points, len(self.law.parameters), batches.shape[1]))
        if self.law.parameters:
            assert bulk.variation is not None
            local = bulk.variation.parameters(number, batches.ravel())
            order = permutation if self.points > 1 else np.zeros(1, dtype=int)
            for place, each in enumerate(self.law.parameters):
                parameters[:, :, place] = local[each][:, order].reshape(*batches.shape, -1).transpose(0, 2, 1)
        self._arrays = {"size": size, "inverse": inverse, "parameter": parameters}
        self._memory = _Memory(**{name: array.ctypes.data for name, array in self._arrays.items()})
        function = ctypes.cast(self._compiled.memory_force, ctypes.c_void_p).value
        assert function is not None
        self._function = function
        self._where = np.nonzero(~padding)
        self.cells = batches[self._where]
        self._nodes_of = space.dofmap.list[:, permutation][self.cells]
        self._geometry = CellPoints(space, self.cells, self.points, permutation)

    def begin(self) -> np.ndarray:
        """Return the initial state of all points in the layout of the sweep, shape `self.shape`."""
        state = native.aligned(self.shape)
        state[:] = np.array(list(self.law.state.values()), dtype=float)[:, None]
        return state

    def add_force(self, displacement: np.ndarray, state: np.ndarray, dt: float, force: np.ndarray) -> None:
        """Advance the state by dt, and add the force of the new inelastic stress [N]."""
        plan, memory, batches = self._start(state)
        self._compiled.memory_force(
            plan, memory, ctypes.c_long(0), batches, ctypes.c_double(dt), *self._pointers(displacement, force)
        )

    def call(self, state: np.ndarray) -> tuple[int, int, int]:
        """Return the addresses of the C function that `add_force` calls, of its plan and of its memory."""
        self._memory.state = state.ctypes.data
        return self._function, ctypes.addressof(self._plan), ctypes.addressof(self._memory)

    def add_inelastic_stress(self, displacement: np.ndarray, state: np.ndarray, sums: np.ndarray) -> None:
        """Add the present inelastic stress times weight and size of elements at their nodes, as `add_stress`."""
        assert sums.flags.c_contiguous and sums.dtype == np.float64 and len(sums) == self._nodes
        self._compiled.memory_stress(*self._start(state), *self._pointers(displacement), address(sums))

    def add_recorded(self, displacement: np.ndarray, state: np.ndarray, sums: np.ndarray) -> None:
        """Add recorded states, and in the last column 1, times weight and size of elements at their nodes.

        Parameters
        ----------
        displacement : ndarray
            Without effect [m].
        state : ndarray
        sums : ndarray, shape (nodes, recorded states + 1)
        """
        assert sums.flags.c_contiguous and sums.shape == (self._nodes, len(self.law.recorded) + 1)
        self._compiled.memory_states(*self._start(state), *self._pointers(displacement), address(sums))

    def tangent(self, displacement: np.ndarray, state: np.ndarray, dt: float) -> np.ndarray:
        """Return the derivative of the inelastic stress after a step by the strain, times weights of the points.

        Its rows of shear stresses count twice, as they do work on both of two equal components of strain.

        Parameters
        ----------
        displacement : ndarray, shape (nodes * components,)
            At the end of the step [m].
        state : ndarray
            At its beginning.
        dt : float
            [s].

        Returns
        -------
        ndarray, shape (cells, points, parts, parts)
            Exactly symmetric where it is up to rounding; the argument of `matrices`.
        """
        parts = len(self.law.components)
        strain, fields, value = self._at_points(displacement, state, np.arange(len(self.cells)))
        result = self.law.inelastic_tangent(strain, fields, dt, value)
        twice = np.array([1.0 if name[0] == name[1] else 2.0 for name in self.law.components])
        moduli = np.moveaxis(result, -1, 0).reshape(len(self.cells), self.points, parts, parts) * twice[:, None]
        turned = np.swapaxes(moduli, -2, -1)
        if np.abs(moduli - turned).max() <= ROUNDING * np.abs(moduli).max():
            moduli = 0.5 * (moduli + turned)
        return np.asarray(moduli * self._geometry.volumes[:, :, None, None])

    def inelastic_stress(self, displacement: np.ndarray, state: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return the present inelastic stress at the points of some cells [Pa], shape (rows, points, parts).

        Parameters
        ----------
        displacement, state : ndarray
        rows : ndarray of int
            Places of the cells in `cells`.
        """
        result = self.law.inelastic_stress(*self._at_points(displacement, state, rows))
        return np.asarray(result.T.reshape(len(rows), self.points, -1))

    def _at_points(
        self, displacement: np.ndarray, state: np.ndarray, rows: np.ndarray
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Return strain, state and parameters of the points of some cells by name, each of shape (rows * points,)."""
        batch, lane = (each[rows] for each in self._where)
        fields, value = (each[batch, :, :, lane] for each in (state, self._arrays["parameter"]))
        c, parts = self._components, len(self.law.components)
        strain = np.empty((len(rows), self.points, parts))
        for first in range(0, len(rows), CHUNK):
            part = slice(first, first + CHUNK)
            u = displacement.reshape(-1, c)[self._nodes_of[rows[part]]].reshape(-1, 1, self._nodes_of.shape[1] * c, 1)
            strain[part] = (self._strain_maps(rows[part]) @ u)[..., 0]

        def of_points(values: np.ndarray, names: Iterable[str]) -> dict[str, np.ndarray]:
            return {name: values[:, :, place].ravel() for place, name in enumerate(names)}

        return (
            of_points(strain, self.law.components), of_points(fields, self.law.state),
            of_points(value, self.law.parameters),
        )  # fmt: skip

    def shares(self, cell: int, functions: np.ndarray) -> tuple[int, np.ndarray]:
        """Return the place of a local cell in `cells`, and the weights of its points from its shape functions.

        Parameters
        ----------
        cell : int
        functions : ndarray, shape (nodes,)
            Shape functions at a point of the cell, in the order of the space.
        """
        row = int(np.flatnonzero(self.cells == cell)[0])
        return row, functions[self._permutation] if self.points > 1 else functions.sum(keepdims=True)

    def matrices(self, moduli: np.ndarray, part: slice) -> np.ndarray:
        """Return the stiffness of some cells [N/m] from the moduli of `tangent`.

        Returns
        -------
        ndarray, shape (k, nodes * components, nodes * components)
            Nodes in the order of `nodes_of_cells`.
        """
        maps = self._strain_maps(part)
        rows = (len(maps), -1, maps.shape[-1])
        return np.asarray(np.swapaxes(maps.reshape(rows), 1, 2) @ (moduli[part] @ maps).reshape(rows))

    @property
    def nodes_of_cells(self) -> np.ndarray:
        """Local nodes of `cells` in the order of the kernel, shape (cells, nodes)."""
        return self._nodes_of

    def _strain_maps(self, part: slice | np.ndarray) -> np.ndarray:
        """Return the maps from the displacement of cells to the strain of their points [1/m].

        Returns
        -------
        ndarray, shape (k, points, parts, nodes * components)
        """
        gradient = np.einsum("cqad,dqk->cqka", self._geometry.inverse_jacobian[part], self._geometry.slopes)
        c = self._components
        maps = np.zeros((*gradient.shape[:2], len(self.law.components), gradient.shape[2], c))
        for place, name in enumerate(self.law.components):
            a, b = ("xyz".index(axis) for axis in name)
            if c == 1:
                maps[:, :, place, :, 0] = 0.5 * gradient[..., a]
                continue
            maps[:, :, place, :, a] += 0.5 * gradient[..., b]
            maps[:, :, place, :, b] += 0.5 * gradient[..., a]
        return maps.reshape(*maps.shape[:3], -1)

    def stored(self, displacement: np.ndarray, state: np.ndarray) -> float:
        """Return the stored energy of the cells owned by this rank [J]."""
        return float(self._compiled.memory_energy(*self._start(state), *self._pointers(displacement)))

    def elastic(self, displacement: np.ndarray) -> float:
        """Return the elastic energy of the same cells [J]."""
        force = np.zeros_like(displacement)
        self.add_internal_force(displacement, force)
        return 0.0 - 0.5 * float(force @ displacement)

    def _start(self, state: np.ndarray) -> tuple[Any, Any, ctypes.c_long]:
        self._memory.state = state.ctypes.data
        return ctypes.byref(self._plan), ctypes.byref(self._memory), ctypes.c_long(self._batches)

    def rows(self, state: np.ndarray, numbering: np.ndarray) -> np.ndarray:
        """Return the state of cells, shape (cells, points, fields), points in the order of their node numbers."""
        batch, lane = self._where
        return np.asarray(np.take_along_axis(state[batch, :, :, lane], self._order(numbering)[..., None], axis=1))

    def fill(self, state: np.ndarray, rows: np.ndarray, numbering: np.ndarray) -> None:
        """Set the state from what `rows` has returned."""
        batch, lane = self._where
        values = np.empty_like(rows)
        np.put_along_axis(values, self._order(numbering)[..., None], rows, axis=1)
        state[batch, :, :, lane] = values

    def _order(self, numbering: np.ndarray) -> np.ndarray:
        if self.points == 1:
            return np.zeros((len(self.cells), 1), dtype=np.int64)
        return np.asarray(np.argsort(numbering[self._nodes_of], axis=1))


def _orientation(bulk: Bulk, cells: np.ndarray) -> np.ndarray:
    """Return det J at the first corner of cells."""
    from ruptfx.bodies.operators.geometry import _corners, _shape

    jacobian, _ = _shape(_corners(bulk.space.mesh, cells), is_tensor(bulk.space.mesh))
    return np.asarray(np.linalg.det(jacobian))
