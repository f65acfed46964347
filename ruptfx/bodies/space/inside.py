"""A point inside the bodies, for boundaries and instruments: shape functions, gradients, forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.input.schema import CaseError, nearest
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.discretisation import Discretisation

SLACK = 1e-8  # of a cell: tolerance for points on its side
HALVINGS = 40  # of an interval, to find where a line leaves a cell
SAMPLES = 9  # points of a line through the box of a cell, one of which is inside if it passes through the cell


@dataclass(frozen=True)
class CellBoxes:
    """Boxes around the cells that this rank owns, to find the cells of many points.

    Attributes
    ----------
    corners : ndarray, shape (cells, corners, dim)
        Vertices of the cells [m].
    low, high : ndarray, shape (cells, dim)
        [m], with a slack.
    """

    corners: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, model: Discretisation) -> CellBoxes:
        """Return the boxes of a model."""
        mesh = model.mesh
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        corners = mesh.geometry.x[:, : mesh.geometry.dim][fem.geometry_dofmap(mesh)[:owned]]
        slack = SLACK * np.ptp(corners, axis=1).max(axis=1, keepdims=True)
        return cls(corners, corners.min(axis=1) - slack, corners.max(axis=1) + slack)


class Inside:
    """A point of a model; adjacent cells contribute equally.

    Parameters
    ----------
    point : sequence of float
        [m].
    body : str or None
        Name, required if several bodies contain the point.
    key : str
        Of the case, for messages.
    field : str
        Name of the field with the coordinates of the point.
    boxes : CellBoxes, optional
        Those of the model, where many points are sought.
    first : bool
        Take the first of several bodies that contain the point.

    Attributes
    ----------
    body : int
        Index of the body that contains it.
    functions : dict of int to ndarray
        Shape functions of every local cell with the point, over the number of all these cells.
    point : list of float
        Its coordinates [m].
    note : str
        By how much it was moved; empty if it was not.

    Raises
    ------
    CaseError
        On all ranks: the point is outside of the bodies, or on a side of several.
    """

    def __init__(
        self, model: Discretisation, point: Sequence[float], body: str | None, key: str, field: str = "point",
        boxes: CellBoxes | None = None, first: bool = False,
    ) -> None:  # fmt: skip
        self.model = model
        self.point, self.note = [float(x) for x in point], ""
        names, position = model.bodies.names, "(" + ", ".join(f"{x:.6g}" for x in point) + ") m"
        if body is not None and body not in names:
            raise CaseError(f"{key}.body = '{body}': no such body, {nearest(body, names)}")
        inside = self._find(np.array(point, dtype=float), boxes or CellBoxes.of(model))
        items = [item for item in inside if body in (None, names[item[0]])]
        holders = parallel.share_rows(model.comm, np.array([number for number, *_ in items], dtype=np.int64))
        if not len(holders):
            body = "the bodies" if body is None else body
            ends = [
                [sign * parallel.largest(model.comm, (sign * x).max(initial=-np.inf)) for sign in (-1, 1)]
                for x in model.coordinates.T
            ]
            rounding = 1e-9 * max(np.ptp(each) for each in ends)
            low, high = np.where(np.abs(ends) < rounding, 0.0, ends).T
            ranges = ", ".join(f"{axis} from {x:.6g} to {y:.6g}" for axis, x, y in zip("xyz", low, high, strict=False))
            raise CaseError(
                f"{key}.{field} = {position}: is not inside of {body}; move it; the bodies are within {ranges} m"
            )
        if first:
            holders = holders[holders == holders.min()]
            items = [item for item in items if item[0] == holders[0]]
        if len(set(holders.tolist())) > 1:
            there = " and ".join(f"'{names[number]}'" for number in sorted(set(holders.tolist())))
            raise CaseError(f"{key}.{field} = {position}: {there} meet there; say in which it is with body")
        self.body = int(holders[0])
        self._cells = [(nodes, shape / len(holders)) for _, _, nodes, shape in items]
        self.functions = {cell: shape[0] / len(holders) for _, cell, _, shape in items}

    def _find(self, point: np.ndarray, boxes: CellBoxes) -> list[tuple[int, int, np.ndarray, np.ndarray]]:
        """Return body, number, nodes and shape functions of every local cell that contains the point.

        With their gradients the functions have shape (1 + dim, nodes).
        """
        mesh, space = self.model.mesh, self.model.space
        near = ((point >= boxes.low) & (point <= boxes.high)).all(axis=1)
        items = []
        for cell in np.flatnonzero(near):
            place = fem.reference_point(mesh, boxes.corners[cell], point)
            if place is None:
                continue
            reference, jacobian = place
            values = fem.tabulate(space, reference)
            gradient = np.linalg.solve(jacobian.T, values[1:])
            shape = np.concatenate([values[:1], gradient])
            items.append((int(self.model.bodies.cell_body[cell]), int(cell), space.dofmap.list[cell], shape))
        return items

    @classmethod
    def at_surface(
        cls, model: Discretisation, point: Sequence[float], body: str | None, key: str,
        boxes: CellBoxes | None = None, anyhow: bool = False,
    ) -> Inside:  # fmt: skip
        """Return a point inside, or one of the upper surface in its place, with a note; collective.

        A point above the surface, by half an element at most, is moved straight down to it.

        Parameters
        ----------
        anyhow : bool
            Move the point to the surface from any height, also up; it is not moved if it is inside otherwise.

        Raises
        ------
        CaseError
            On all ranks: there is no body below or above it, or it is farther from the surface.
        """
        boxes = boxes or CellBoxes.of(model)
        *plan, height = (float(x) for x in point)
        surface = _surface(model, np.array(plan), boxes)
        apart = height - surface
        if not np.isfinite(surface) or (apart <= 0 and not anyhow):
            return cls(model, point, body, key, boxes=boxes)
        place = cls(model, [*plan, surface], body, key, boxes=boxes)
        there = ", ".join(f"{x:.9g}" for x in place.point)
        if anyhow:
            place.note = f"on the surface, ({there}) m"
        elif apart > 0.5 * place.element_size:
            return cls(model, point, body, key, boxes=boxes)
        else:
            place.note = f"moved to the surface, ({there}) m, {apart:.4g} m below"
        return place

    def weights(self, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return local degrees of freedom and weights on this rank, for a sum of `value` times coefficients.

        The sum of a nodal field times the weights is that of its `value` times coefficients of shape
        (1 + dim, components).
        """
        c = coefficients.shape[1]
        empty = np.zeros(0, dtype=np.int64)
        dofs = [(nodes[:, None] * c + np.arange(c)).ravel() for nodes, _ in self._cells]
        values = [(shape.T @ coefficients).ravel() for _, shape in self._cells]
        return np.concatenate([empty, *dofs]), np.concatenate([np.zeros(0), *values])

    @property
    def element_size(self) -> float:
        """Size of the elements that contain the point, along x, y or z [m]; collective."""
        extents = [float(np.ptp(self.model.coordinates[nodes], axis=0).max()) for nodes, _ in self._cells]
        return parallel.largest(self.model.comm, max(extents, default=0.0))

    def _sum(self, weights: np.ndarray) -> np.ndarray:
        """Return the sum over shape functions and their derivatives, with weights of shape (1 + dim, components)."""
        nodal = np.zeros((self.model.nodes, self.model.components))
        for nodes, shape in self._cells:
            nodal[nodes] += shape.T @ weights
        total = nodal.ravel()
        self.model.layout.sum_shared(total)
        return total

    def value(self, field: np.ndarray) -> np.ndarray:
        """Return the contribution of this rank to a nodal field at the point, and to its derivatives along x, y ...

        Shape (1 + dim, components); the sum over the ranks is the field there.
        """
        nodal = field.reshape(self.model.nodes, -1)
        total = np.zeros((1 + self.model.mesh.geometry.dim, nodal.shape[1]))
        for nodes, shape in self._cells:
            total += shape @ nodal[nodes]
        return total

    def force(self, force: Sequence[float]) -> np.ndarray:
        """Return the nodal force of a force at the point [N], shape (nodes * components,); collective."""
        weights = np.zeros((1 + self.model.mesh.geometry.dim, self.model.components))
        weights[0] = force
        return self._sum(weights)

    def moment(self, moment: np.ndarray) -> np.ndarray:
        """Return the nodal force of a moment tensor M_ij at the point [N m], shape (components, dim); collective.

        M_ij d phi / dx_j, exact for any field of the elements.
        """
        return self._sum(np.concatenate([np.zeros((1, self.model.components)), moment.T]))


def _surface(model: Discretisation, plan: np.ndarray, boxes: CellBoxes) -> float:
    """Return the largest height of the bodies over a point of the plan [m], -inf outside; collective."""
    dim, highest = len(plan), -np.inf
    over = ((plan >= boxes.low[:, :dim]) & (plan <= boxes.high[:, :dim])).all(axis=1)
    for cell in np.flatnonzero(over).tolist():
        if boxes.high[cell, dim] <= highest:
            continue
        ends = boxes.corners[cell, :, dim]
        heights = np.linspace(ends.max(), ends.min(), SAMPLES)
        inside = (height for height in heights if _is_inside(model, boxes, cell, plan, height))
        low = next(inside, None)
        if low is None:
            continue
        high = min(low + heights[0] - heights[1], heights[0])
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _is_inside(model, boxes, cell, plan, middle) else (low, middle)
        highest = max(highest, float(low))
    return float(parallel.largest(model.comm, highest))


def _is_inside(model: Discretisation, boxes: CellBoxes, cell: int, plan: np.ndarray, height: float) -> bool:
    return fem.reference_point(model.mesh, boxes.corners[cell], np.append(plan, height)) is not None
