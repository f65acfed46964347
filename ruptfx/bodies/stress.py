"""Stress of the bodies and states of their materials at the nodes, averaged over elements by mass lumping."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx.bodies.operators import Bulk, Operator, ufl_form
from ruptfx.bodies.operators.matrix_free import MatrixFree
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.bodies.operators.memory_sweep import MemorySweep
    from ruptfx.bodies.space.discretisation import Discretisation
    from ruptfx.bodies.state import State


class NodalFields:
    """Stress and recorded states of materials at local nodes.

    Parameters
    ----------
    model : Discretisation
    bulk : Bulk
    operator : Operator
    memory : dict of str to MemorySweep
        Sweeps of materials with memory by name of the body.
    entries : sequence of (int, int), in antiplane of int
        Components of the stress.
    """

    def __init__(
        self, model: Discretisation, bulk: Bulk, operator: Operator, memory: Mapping[str, MemorySweep],
        entries: Sequence[Any],
    ) -> None:  # fmt: skip
        self._model, self._bulk, self._operator, self._memory, self._entries = model, bulk, operator, memory, entries
        self._stress_forms: list[Any] | None = None
        self._volume: np.ndarray | None = None

    def stress(self, displacement: np.ndarray, state: State) -> np.ndarray:
        """Return the stress by the displacement, shape (nodes, components), tension positive [Pa]; collective."""
        model, c = self._model, self._model.components
        if self._volume is None:
            test, dx = fem.ufl.TestFunction(model.space), model.measure()
            self._volume = fem.assemble_summed(
                model.space, sum(model.sum_of(test) * dx(i) for i in range(len(model.materials)))
            )[::c, None]
        vector, sums = self._vector(len(self._entries))  # one exchange of all entries
        if isinstance(self._operator, MatrixFree) and self._by_kernel:
            self._operator.add_stress(displacement, sums)
        else:
            self._add_stress(displacement, sums)
        for name, sweep in self._memory.items():
            sweep.add_inelastic_stress(displacement, state.memory[name], sums)
        self._sum_over_ranks(vector)
        return np.asarray(sums / self._volume)

    @cached_property
    def _by_kernel(self) -> bool:
        """True if the kernel supports the cells of every rank; forms, which do without it, are collective."""
        supports = isinstance(self._operator, MatrixFree) and self._operator.adds_stress
        return not parallel.anywhere(self._model.comm, not supports)

    def states(self, names: Sequence[str], displacement: np.ndarray, state: State) -> dict[str, np.ndarray]:
        """Return recorded states by name, shape (nodes,), averaged over the elements that have them; collective.

        NaN at the nodes of bodies without them.
        """
        vector, columns = self._vector(2 * len(names))
        sums = columns.reshape(len(columns), 2, -1)
        for body, sweep in self._memory.items():
            if not sweep.law.recorded:
                continue
            of_body = np.zeros((len(columns), len(sweep.law.recorded) + 1))
            sweep.add_recorded(displacement, state.memory[body], of_body)
            places = [list(names).index(name) for name in sweep.law.recorded]
            sums[:, 0, places] += of_body[:, :-1]
            sums[:, 1, places] += of_body[:, -1:]
        self._sum_over_ranks(vector)
        volume = sums[:, 1]
        values = np.where(volume > 0, sums[:, 0] / np.where(volume > 0, volume, 1.0), np.nan)
        return dict(zip(names, values.T, strict=True))

    def _vector(self, width: int) -> tuple[Any, np.ndarray]:
        """Return a vector with some zeros per local node, and its array."""
        vector = fem.dolfinx.la.vector(self._model.space.dofmap.index_map, width)
        vector.array[:] = 0
        return vector, vector.array.reshape(self._model.nodes, -1)

    def _sum_over_ranks(self, vector: Any) -> None:
        if self._model.comm.size > 1:
            vector.scatter_reverse(fem.dolfinx.la.InsertMode.add)
            vector.scatter_forward()

    def _add_stress(self, displacement: np.ndarray, sums: np.ndarray) -> None:
        """Add the stress as `MatrixFree.add_stress` defines it, for any material and element."""
        model, ufl = self._model, fem.ufl
        space, c = model.space, model.components
        if self._stress_forms is None:
            self._displacement = fem.dolfinx.fem.Function(space)
            test, dx = ufl.TestFunction(space), model.measure()
            large = self._bulk.large_rotations
            variable = ufl.variable(ufl_form.strain(self._displacement, model.mesh, model.plane, large))
            forms = []
            entries = self._entries
            for pair in [entries[i : i + c] for i in range(0, len(entries), c)]:
                form: Any = 0
                for index in range(len(self._bulk.materials)):
                    stress = ufl.diff(ufl_form.energy_density(self._bulk, index, variable), variable)
                    if stress.ufl_shape[1:]:  # an energy may be a formula of one of two equal components
                        stress = ufl.sym(stress)
                    if large:  # as it is turned with the body; volumes hardly change
                        turn = ufl_form.rotation(self._displacement)
                        stress = turn * stress * turn.T
                    picked = [stress[entry] for entry in pair] + [0.0] * (c - len(pair))
                    form += (picked[0] * test if c == 1 else ufl.inner(ufl.as_vector(picked), test)) * dx(index)
                forms.append((fem.form(form), len(pair)))
            self._stress_forms = forms
        self._displacement.x.array[:] = displacement
        first = 0
        for form, used in self._stress_forms:
            vector = np.zeros_like(displacement)
            fem.dolfinx.fem.assemble_vector(vector, form)
            sums[:, first : first + used] += vector.reshape(-1, c)[:, :used]
            first += used
