"""Facets in implicit steps: tractions at a trial displacement by the compiled step of `cracks.c`, and their tangent."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.interfaces.cracks.step import Kernel
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.cracks.step import CrackStep

APART = 1e-7  # difference of jumps in derivatives, over their size


class FacetResponse:
    """Tractions of facets for trial displacements.

    The kernel is that of explicit steps. It works on copies of the corners, in which every facet end has two nodes of
    its own: jumps are then independent of each other, and three sweeps give all derivatives.

    Attributes
    ----------
    pairs : ndarray of int, shape (2 * owned facets, 2)
        Local nodes on the minus and the plus side of each end.
    """

    def __init__(self, cracks: CrackStep) -> None:
        self._cracks = cracks
        corners = np.arange(4 * len(cracks.order)).reshape(-1, 2, 2)
        self._kernels = [Kernel(cracks, group, corners) for group in cracks.groups]
        self.pairs = cracks.corners[cracks.owned].transpose(0, 2, 1).reshape(-1, 2).astype(np.int64)

    def fields(
        self, state: State, mass: np.ndarray, displacement: np.ndarray, dt: float, shift: np.ndarray | None = None
    ) -> tuple[FaultState, np.ndarray]:
        """Return the fields of all facets at the end of a step and the results of `CrackStep.sweep`.

        Parameters
        ----------
        mass, displacement : ndarray, shape (nodes * 2,)
            [kg], and at the end of the step [m].
        dt : float
            Length of the step [s].
        shift : ndarray, shape (facets, 2 ends, 2), optional
            Added to the jumps [m].
        """
        corners = self._cracks.corners
        fields = {name: values.copy() for name, values in state.cracks.items()}
        moved, *others = (each.reshape(-1, 2)[corners] for each in (displacement, state.velocity, mass))
        if shift is not None:
            moved[:, 1] += shift
        nodes = [each.ravel() for each in (moved, *others, np.zeros_like(moved))]
        return fields, self._cracks.sweep(self._kernels, fields, nodes, state.time + dt, dt)

    def stiffness(
        self, state: State, mass: np.ndarray, displacement: np.ndarray, dt: float, fields: FaultState
    ) -> np.ndarray:
        """Return the derivative of the forces on the minus sides by the jumps, owned facets only [N/m].

        That of ends that have not yielded is exact; that of others is a finite difference.

        Parameters
        ----------
        fields : dict of ndarray
            Those for the displacement, from `fields`.

        Returns
        -------
        ndarray, shape (2 * owned facets, 2, 2)
        """
        cracks = self._cracks
        tangent = cracks.stiffness[:, None, None, None] * np.eye(2) * np.ones((1, 2, 1, 1))
        yielded = (fields["damage"] > 0) | (fields["inelastic_opening"] != 0) | (fields["slip"] != 0)
        if yielded.any():
            rows = displacement.reshape(-1, 2)
            jump = rows[cracks.corners[:, 1]] - rows[cracks.corners[:, 0]]
            size = np.linalg.norm(jump, axis=2) + fields["largest_opening"] + fields["cohesive_slip"]
            small = APART * np.where(size > 0, size, 1.0)
            by_axis, axes = [], (cracks.normal, cracks.tangent)
            for axis in axes:
                shift = small[..., None] * axis[:, None]
                further, _ = self.fields(state, mass, displacement, dt, shift)
                change = cracks.tractions(further) - cracks.tractions(fields)
                by_axis.append(change / small[..., None])
            differences = sum(
                change[..., :, None] * axis[:, None, None, :] for change, axis in zip(by_axis, axes, strict=True)
            )
            tangent = np.where(yielded[..., None, None], differences, tangent)
        return np.asarray((cracks.weight[:, None, None, None] * tangent)[cracks.owned].reshape(-1, 2, 2))

    def advance(self, state: State, mass: np.ndarray, displacement: np.ndarray, dt: float) -> None:
        """Advance the fields of the state and count losses; collective.

        Raises
        ------
        RuptfxError
            On all ranks: no damage of a facet is consistent with opening and slip.
        """
        fields, result = self.fields(state, mass, displacement, dt)
        for name, values in fields.items():
            state.cracks[name][:] = values
        self._cracks.count(state, result)
        error = None
        try:
            self._cracks.require_balance(state.time + dt)
        except RuptfxError as caught:
            error = caught
        parallel.raise_on_all(self._cracks.network.comm, error)
