"""The sweep over the elements of a material with memory, in compiled C: `memory.c` around the traced stress formula.

It adds the force of the inelastic stress, that of the material less the stress of its elastic energy. The elastic part
is that of the bulk operator, of any kind.
"""

from __future__ import annotations

import ctypes
from importlib.resources import files

import numpy as np

from ruptfx.codegen import native
from ruptfx.materials import Material
from ruptfx.materials._traced import traced
from ruptfx.operators import Bulk
from ruptfx.operators._geometry import MULTILINEAR, POINTWISE, VARYING, is_tensor, root_of_size
from ruptfx.operators.matrix_free import MatrixFree, _reference_cell
from ruptfx.schema import CaseError


class _Memory(ctypes.Structure):
    """`struct memory` of the C source."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("size", "inverse", "state", "parameter")]


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

    def __init__(self, bulk: Bulk, material: Material, key: str, number: int = 0) -> None:
        super().__init__(bulk)
        self.law = traced(material, bulk.plane)
        space = bulk.space
        permutation, constants = _reference_cell(space, False, False)
        macros = "".join(f"#define {name} {value}\n" for name, value in self.law.as_c().items())
        parts = [files("ruptfx").joinpath("codegen/lanes.c")]
        parts += [files(__package__).joinpath(name) for name in ("matrix_free.c", "memory.c")]
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
        self._where = np.nonzero(~padding)
        self.cells = batches[self._where]
        self._nodes_of = space.dofmap.list[:, permutation][self.cells]

    def begin(self) -> np.ndarray:
        """Return the initial state of all points, in the layout of the sweep."""
        state = native.aligned(self.shape)
        state[:] = np.array(list(self.law.state.values()), dtype=float)[:, None]
        return state

    def add_force(self, displacement: np.ndarray, state: np.ndarray, dt: float, force: np.ndarray) -> None:
        """Advance the state by dt, and add the force of the new inelastic stress [N]."""
        self._compiled.memory_force(*self._start(state), ctypes.c_double(dt), *self._pointers(displacement, force))

    def add_inelastic_stress(self, displacement: np.ndarray, state: np.ndarray, sums: np.ndarray) -> None:
        """Add the present inelastic stress times weight and size of elements at their nodes, as `add_stress`."""
        assert sums.flags.c_contiguous and sums.dtype == np.float64 and len(sums) == self._nodes
        self._compiled.memory_stress(
            *self._start(state), *self._pointers(displacement), ctypes.c_void_p(sums.ctypes.data)
        )

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
        self._compiled.memory_states(
            *self._start(state), *self._pointers(displacement), ctypes.c_void_p(sums.ctypes.data)
        )

    def stored(self, displacement: np.ndarray, state: np.ndarray) -> float:
        """Return the stored energy of the cells owned by this rank [J]."""
        return float(self._compiled.memory_energy(*self._start(state), *self._pointers(displacement)))

    def elastic(self, displacement: np.ndarray) -> float:
        """Return the elastic energy of the same cells [J]."""
        force = np.zeros_like(displacement)
        self.add_internal_force(displacement, force)
        return 0.0 - 0.5 * float(force @ displacement)

    def _start(self, state: np.ndarray) -> tuple[object, ...]:
        arrays = self._arrays | {"state": state}
        memory = _Memory(**{name: array.ctypes.data for name, array in arrays.items()})
        return ctypes.byref(self._plan), ctypes.byref(memory), ctypes.c_long(self._batches)

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
    from ruptfx.operators._geometry import _corners, _shape

    jacobian, _ = _shape(_corners(bulk.space.mesh, cells), is_tensor(bulk.space.mesh))
    return np.asarray(np.linalg.det(jacobian))
