"""The matrix of an implicit step: bodies, inertia and damping, and the tangents of the interfaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx.bodies import operators
from ruptfx.bodies.operators.assembled import stiffness_form
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.mechanisms import responding
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms import ElementStiffness, Reaction
    from ruptfx.interfaces.mechanisms.system import System

CHUNK = 64  # elements whose matrices are in memory at once


class Tangent:
    """K + J' W (dT / d[u]) J + c_M M + c_C (C + eta K_v), filled again only after a change.

    Tied nodes have one unknown, that of the kept node (`fem.matrix`); the unknown of a copy stays zero.

    Parameters
    ----------
    model : System
    dashpot : ndarray, shape (nodes * components,)
        The diagonal C [N s/m].

    Attributes
    ----------
    matrix : PETSc.Mat
        The operator, by default the assembled matrix.
    filled : PETSc.Mat
        The assembled matrix, or the part of it that is assembled.
    diagonal : ndarray, shape (nodes * components,)
        Diagonal of K with the elastic supports [N/m], also at ghosts; tied nodes have the sum.
    unit : float
        Mean of the diagonal [N/m].
    """

    def __init__(self, model: System, dashpot: np.ndarray) -> None:
        self._model, self._dashpot = model, dashpot
        self._owned = model.owned_nodes * model.components
        self._stiffness = self._assemble(model.bulk)
        _add_supports(self._stiffness, model)
        self._viscous = self._assemble(model.viscosity.bulk) if model.viscosity is not None else None
        self.filled = self._stiffness.duplicate()
        self.filled.setOption(fem.PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self.matrix = self.filled
        ghosted = fem.dolfinx.fem.Function(model.space)
        ghosted.x.array[: self._owned] = self._stiffness.getDiagonal().array + self._diagonal_of_elements()
        ghosted.x.scatter_forward()
        self.diagonal = ghosted.x.array.copy()
        total = parallel.total(model.comm, self.diagonal[: self._owned].sum())
        self.unit = float(total) / (model.total_nodes * model.components)
        layout, c = model.layout, model.components
        layout.equalise(self.diagonal)
        value = model.loads.prescribed.copy()
        value.reshape(model.nodes, c)[layout.copies] = True
        own_entries = np.flatnonzero(value[: self._owned])
        rows = model.space.dofmap.index_map.local_to_global((own_entries // c).astype(np.int32)) * c + own_entries % c
        self._given_rows = rows.astype(fem.PETSc.IntType)
        self._built: tuple[tuple[float, float], dict[str, np.ndarray], list[np.ndarray]] | None = None

    def _diagonal_of_elements(self) -> np.ndarray | float:
        """Return the diagonal of elements that are not in the assembled matrix, at owned degrees of freedom [N/m]."""
        return 0.0

    def _assemble(self, bulk: operators.Bulk) -> Any:
        """Return K of some elements as a matrix with room for the tangents of the interfaces."""
        faces = [fault.interface for fault in self._model.faults if not (fault.interface.one_sided or fault.slides)]
        pairs = [np.stack([face.plus, face.minus], axis=1) for face in faces]
        pairs += [each.coupled() for each in responding(self._model.mechanisms)]
        layout = self._model.layout
        coupled = np.concatenate([np.zeros((0, 2), dtype=np.int64), *pairs])
        tied = (layout.kept, layout.copies) if layout.bodies.ties else None
        return fem.matrix(stiffness_form(bulk), coupled, tied)

    def update(
        self, c_M: float, c_C: float, blocks: dict[str, np.ndarray], driven: float, springs: np.ndarray | None = None,
        reactions: Sequence[Reaction] = (),
    ) -> bool | None:  # fmt: skip
        """Fill the matrix; return whether it is symmetric, or None if it has not changed; collective.

        Parameters
        ----------
        blocks : dict of str to ndarray, shape (n, local, local)
            dT / d[u] by fault [Pa/m]; missing faults contribute nothing.
        driven : float
            Diagonal entry of rows of driven nodes and of copies of tied nodes, whose other entries are zero.
        springs : ndarray, shape (nodes * components,), optional
            Springs to the ground [N/m]; they must be a function of the other parameters.
        reactions : sequence of Reaction
            Forces of mechanisms, with their stiffness.
        """
        model, matrix = self._model, self.filled
        between = [reaction.between() for reaction in reactions]
        elements = [each for reaction in reactions for each in reaction.elements()]
        added = [*(reaction.stiffness for reaction in reactions), *between, *(each.moduli for each in elements)]
        # Assembly and factors cost more than the rest of a step, and steps of stuck interfaces have equal blocks.
        same = (
            self._built is not None
            and self._built[0] == (c_M, c_C)
            and all(np.array_equal(block, self._built[1][name]) for name, block in blocks.items())
            and len(added) == len(self._built[2])
            and all(np.array_equal(block, built) for block, built in zip(added, self._built[2], strict=True))
        )
        if not parallel.anywhere(model.comm, not same):
            return None
        self._built = ((c_M, c_C), blocks, added)
        self._stiffness.copy(matrix, fem.PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        if model.viscosity is not None and self._viscous is not None and c_C:
            matrix.axpy(model.viscosity.eta * c_C, self._viscous, fem.PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        diagonal = matrix.createVecLeft()
        diagonal.array[:] = model.layout.reduce_tied(c_M * model.mass + c_C * self._dashpot)[: self._owned]
        if springs is not None:
            diagonal.array[:] += springs[: self._owned]
        matrix.setDiagonal(diagonal, addv=fem.PETSc.InsertMode.ADD_VALUES)
        diagonal.destroy()
        for fault in model.faults:
            if fault.name in blocks:
                _add_interface(matrix, fault.interface, blocks[fault.name])
        for reaction, blocks_between in zip(reactions, between, strict=True):
            if len(reaction.stiffness):
                _add_at_nodes(matrix, reaction.nodes, reaction.stiffness, model.owned_nodes)
            _add_between(matrix, reaction.pairs, blocks_between)
        for each in elements:
            _add_in_elements(matrix, each)
        matrix.assemble()
        # Columns, too: the matrix remains symmetric, and residuals of other rows contain the driven motion already.
        matrix.zeroRowsColumns(self._given_rows, diag=driven)
        # Friction lets shear tractions depend on the opening; normal tractions do not depend on slip.
        skew = any(np.any(block[:, 1:, 0]) for block in blocks.values())
        skew = skew or any(np.any(block != np.swapaxes(block, -2, -1)) for block in added)
        return not parallel.anywhere(model.comm, skew)


def _add_supports(matrix: Any, model: System) -> None:
    """Add the stiffness of the elastic supports, every node once; collective."""
    for support in model.loads.supports:
        _add_at_nodes(matrix, support.nodes, support.stiffness, model.owned_nodes)
    matrix.assemble()


def _add_at_nodes(matrix: Any, nodes: np.ndarray, blocks: np.ndarray, owned: int) -> None:
    """Add stiffness to the ground, every node once."""
    for node, block in zip(nodes.astype(fem.PETSc.IntType), blocks, strict=True):
        if node < owned:
            matrix.setValuesBlockedLocal([node], [node], block, addv=fem.PETSc.InsertMode.ADD_VALUES)


def _add_between(matrix: Any, pairs: np.ndarray, blocks: np.ndarray) -> None:
    """Add stiffness between the nodes of pairs."""
    both = np.block([[blocks, -blocks], [-blocks, blocks]])
    for pair, block in zip(pairs.astype(fem.PETSc.IntType), both, strict=True):
        matrix.setValuesBlockedLocal(pair, pair, block, addv=fem.PETSc.InsertMode.ADD_VALUES)


def _add_in_elements(matrix: Any, added: ElementStiffness) -> None:
    """Add stiffness between all nodes of elements, in parts that limit temporary memory."""
    nodes = added.nodes.astype(fem.PETSc.IntType)
    for first in range(0, len(nodes), CHUNK):
        part = slice(first, first + CHUNK)
        for node, block in zip(nodes[part], added.matrices(part), strict=True):
            matrix.setValuesBlockedLocal(node, node, block, addv=fem.PETSc.InsertMode.ADD_VALUES)


def _add_interface(matrix: Any, face: Interface, tangent: np.ndarray) -> None:
    """Add J' W tangent J, every point once."""
    rows = face.rows if face.one_sided else np.concatenate([face.rows, -face.rows], axis=2)
    # PETSc uses contiguous arrays without a copy.
    blocks = np.ascontiguousarray(np.einsum("i,ika,ikl,ilb->iab", face.weight, rows, tangent, rows, optimize=True))
    nodes = face.plus[:, None] if face.one_sided else np.stack([face.plus, face.minus], axis=1)
    nodes = nodes.astype(fem.PETSc.IntType)
    for i in np.flatnonzero(face.owned):
        matrix.setValuesBlockedLocal(nodes[i], nodes[i], blocks[i], addv=fem.PETSc.InsertMode.ADD_VALUES)
