"""Diffusion along an interface by finite elements of its own nodes.

    storage dp/dt = div (mobility grad p) + source

over the line or surface of the interface, with the spectral elements of its edges or faces and their lumped mass. The
mobility is interpolated between the points, and may change from step to step. Every rank has the matrices of the whole
interface and solves the same system, so that results are the same on any number of ranks. Steps are
implicit, of second order and L-stable (Alexander 1977, SIAM J. Numer. Anal. 14, 1006).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_matrix, diags, identity
from scipy.sparse.linalg import splu

from ruptfx.bodies.operators.geometry import jacobian_at
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU

    from ruptfx.bodies.space.discretisation import Discretisation
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System

GAMMA = 1 - 1 / np.sqrt(2)
"""Of the two stages; the step is of second order and L-stable."""


@dataclass(frozen=True)
class AlongStep:
    """A step of the pressure of all points, in the order of their numbers.

    Attributes
    ----------
    begin, end : ndarray, shape (total,)
        Pressure [Pa].
    end_rate : ndarray, shape (total,)
        Time derivative at the end [Pa/s].
    length : float
        [s].
    error : ndarray, shape (total,)
        Difference from a step of first order [Pa].
    injected : float
        Integral of the sources over the step.
    """

    begin: np.ndarray
    end: np.ndarray
    end_rate: np.ndarray
    length: float
    error: np.ndarray
    injected: float

    def at(self, part: float) -> np.ndarray:
        """Return the pressure at a part of the step [Pa], quadratic in time, shape (total,)."""
        change = self.end - self.begin
        return np.asarray(self.begin + part * change + part * (part - 1) * (self.length * self.end_rate - change))


@dataclass(frozen=True)
class Elements:
    """Elements of an interface of one kind, with the points that integrals over them are sums of.

    Attributes
    ----------
    nodes : ndarray of int, shape (elements, j)
        Numbers of the points of the interface; -1 for a node that is none.
    values : ndarray, shape (elements, q, j)
        Shape functions at the points of integration.
    slopes : ndarray, shape (elements, q, t, j)
        Their gradients there, times the root of the area of the point of integration.
    """

    nodes: np.ndarray
    values: np.ndarray
    slopes: np.ndarray

    def without_rim(self, places: np.ndarray, collocated: bool) -> Elements:
        """Return the elements without flow out of nodes that are no points, where the pressure is that of the nearest.

        Parameters
        ----------
        places : ndarray, shape (elements, j, dim)
            Of the nodes [m].
        collocated : bool
            Whether points of integration are nodes; those of nodes that are no points have no area.
        """
        values, slopes, missing = self.values.copy(), self.slopes.copy(), self.nodes < 0
        for e in np.flatnonzero(missing.any(axis=1)):
            out, inside = np.flatnonzero(missing[e]), np.flatnonzero(~missing[e])
            if collocated:
                slopes[e, values[e][:, out].sum(axis=1) > 0.5] = 0.0
            if len(inside):
                away = np.linalg.norm(places[e][out][:, None] - places[e][inside], axis=2)
                for m, n in zip(out, inside[away.argmin(axis=1)], strict=True):
                    values[e, :, n] += values[e, :, m]
                    slopes[e, :, :, n] += slopes[e, :, :, m]
            values[e][:, out] = 0.0
            slopes[e][:, :, out] = 0.0
        return Elements(self.nodes, values, slopes)

    def matrices(self, mobility: np.ndarray) -> np.ndarray:
        """Return the integrals of mobility grad u . grad v, shape (elements, j, j); zero for nodes that are no points.

        They are positive semidefinite for any positive mobility.
        """
        known = np.where(self.nodes >= 0, mobility[self.nodes], np.inf)
        least = known.min(axis=1, keepdims=True)
        at_q = np.einsum("eqj,ej->eq", self.values, np.where(self.nodes >= 0, known, 0.0))
        at_q = np.where(np.isfinite(least), np.maximum(at_q, least), 0.0)
        result = np.einsum("eq,eqtj,eqtk->ejk", at_q, self.slopes, self.slopes, optimize=True)
        return 0.5 * (result + result.transpose(0, 2, 1))


def elements_of(model: Discretisation, face: Interface, name: str) -> Elements:
    """Return the elements of the plus side of an interface, those of all ranks in one order; collective."""
    mesh, space, dim = model.mesh, model.space, model.mesh.topology.dim
    cell, element, basix = mesh.basix_cell(), space.element.basix_element, fem.basix
    corners, sides = basix.geometry(cell), basix.topology(cell)[dim - 1]
    plane = basix.CellType[{2: "interval", 3: "quadrilateral" if len(sides[0]) == 4 else "triangle"}[dim]]
    about = fem.gll_metadata(mesh, model.order)
    rule = basix.QuadratureType.gll if "quadrature_rule" in about else basix.QuadratureType.default
    places, weights = basix.make_quadrature(plane, about["quadrature_degree"], rule=rule)
    mesh.topology.create_connectivity(dim - 1, dim)
    mesh.topology.create_connectivity(dim, dim - 1)
    to_cells, to_sides = (mesh.topology.connectivity(*pair) for pair in ((dim - 1, dim), (dim, dim - 1)))
    number = np.full(model.nodes, -1)
    number[face.plus] = face.number
    dofs, owned = np.asarray(space.dofmap.list), mesh.topology.index_map(dim).size_local
    facets = model.bodies.facets.find(model.bodies.tags[f"{name}.plus"])
    cells = np.array([to_cells.links(facet)[0] for facet in facets], dtype=np.int64)
    local = [int(np.flatnonzero(to_sides.links(c) == f)[0]) for c, f in zip(cells, facets, strict=True)]
    rows = []
    for side in sorted(set(local)):
        mine = cells[(np.array(local) == side) & (cells < owned)]
        axes = (corners[sides[side][1:dim]] - corners[sides[side][0]]).T  # of the reference side, in the cell
        points = corners[sides[side][0]] + places @ axes.T
        on_side = element.entity_closure_dofs[dim - 1][side]
        tabulated = np.asarray(element.tabulate(1, points))[:, :, on_side, 0]
        slopes = np.einsum("dqj,dt->qtj", tabulated[1:], axes)
        tangents = np.einsum("eqda,dt->eqta", jacobian_at(mesh, mine, points), axes)
        metric = np.einsum("eqta,eqsa->eqts", tangents, tangents)
        size = weights * np.sqrt(np.linalg.det(metric))
        if model.plane == "axisymmetric":
            size *= 2 * np.pi * model.layout.coordinates[dofs[mine][:, on_side], 1] @ tabulated[0].T
        scale = np.sqrt(size)
        slopes = np.linalg.solve(np.linalg.cholesky(metric), np.broadcast_to(slopes, (len(mine), *slopes.shape)))
        values = np.broadcast_to(tabulated[0], (len(mine), *tabulated[0].shape))
        nodes = dofs[mine][:, on_side]
        made = Elements(number[nodes], values, slopes * scale[:, :, None, None])
        made = made.without_rim(model.layout.coordinates[nodes], rule == basix.QuadratureType.gll)
        parts = made.nodes, made.values, made.slopes
        rows.append(np.concatenate([part.reshape(len(mine), -1) for part in parts], axis=1))
    j = len(element.entity_closure_dofs[dim - 1][0])
    q, t = np.size(weights), dim - 1
    table = parallel.share_rows(model.comm, np.concatenate([np.zeros((0, j + q * j * (1 + t))), *rows]))
    table = table[np.lexsort(table.T[::-1])]
    values, slopes = table[:, j : j + q * j], table[:, j + q * j :]
    return Elements(table[:, :j].astype(int), values.reshape(-1, q, j), slopes.reshape(-1, q, t, j))


def repeated_elements(model: System, face: Interface, name: str) -> list[Elements]:
    """Return the elements of a section that repeats along strike; collective.

    Those of the section down dip, and pairs of points along strike. No fluid flows beyond the ends of the fault.
    """
    section, along = model.section, model.case.mesh.along_strike
    assert section is not None and along is not None
    line = section.faces[name]
    places = on_all_ranks(model.comm, face, face.points)
    column = np.round((places[:, 2] - along.positions[0]) / along.spacing).astype(int)
    point = np.full((len(line.plus), along.points), -1)
    point[section.points_of(name, places), column] = np.arange(face.total)
    point[:, along.beyond] = -1
    down, by_number = elements_of(section, line, name), np.empty_like(line.number)
    by_number[line.number] = np.arange(len(line.number))
    inside = np.flatnonzero(~np.asarray(along.beyond))
    columns = point[by_number][:, inside].T
    nodes = np.where(down.nodes >= 0, columns[:, down.nodes], -1).reshape(-1, down.nodes.shape[1])
    many, root = len(columns), np.sqrt(along.spacing)
    dip = Elements(nodes, np.tile(down.values, (many, 1, 1)), root * np.tile(down.slopes, (many, 1, 1, 1)))
    first, second = point[:, :-1].ravel(), point[:, 1:].ravel()
    root = np.sqrt(np.repeat(line.area, along.points - 1) / along.spacing)
    pairs = (first >= 0) & (second >= 0)
    slopes = root[pairs, None, None, None] * np.array([-1.0, 1.0])
    half = np.full((int(pairs.sum()), 1, 2), 0.5)
    return [dip, Elements(np.stack([first, second], axis=1)[pairs], half, slopes)]


class Along:
    """Matrices of the diffusion along one interface.

    Parameters
    ----------
    model : System
    face : Interface
    name : str
        Of the interface.
    storage : float
        [1/Pa].
    area : ndarray, shape (total,)
        Of all points [m2], in 2D length [m].
    fixed : ndarray of bool, shape (total,)
        Points of known pressure.
    """

    stiffness: csr_matrix

    def __init__(
        self, model: System, face: Interface, name: str, storage: float, area: np.ndarray, fixed: np.ndarray
    ) -> None:  # fmt: skip
        self.total, self.mass, self._fixed = face.total, storage * area, fixed
        is_repeated = model.section is not None
        self._elements = repeated_elements(model, face, name) if is_repeated else [elements_of(model, face, name)]
        self._free = diags((~fixed).astype(float))
        self._known: tuple[float, SuperLU] | None = None

    def set_mobility(self, mobility: np.ndarray) -> None:
        """Assemble the stiffness from permeability over viscosity of all points [m2/(Pa s)], shape (total,)."""
        entries = []
        for each in self._elements:
            pairs = np.broadcast_arrays(each.nodes[:, :, None], each.nodes[:, None, :], each.matrices(mobility))
            row, column, value = (np.ravel(part) for part in pairs)
            entries.append(np.stack([row, column, value])[:, (row >= 0) & (column >= 0)])
        row, column, value = np.concatenate(entries, axis=1)
        matrix = csr_matrix((value, (row.astype(int), column.astype(int))), (self.total, self.total))
        # Rows sum to zero without rounding, so that no fluid is lost.
        self.stiffness = csr_matrix(matrix - diags(np.asarray(matrix.sum(axis=1)).ravel()))
        self._known = None

    def _solver(self, dt: float) -> SuperLU:
        if self._known is None or self._known[0] != dt:
            matrix = diags(self.mass) + GAMMA * dt * self.stiffness
            fixed = identity(self.total, format="csr") - self._free
            self._known = dt, splu((self._free @ matrix + fixed).tocsc())
        return self._known[1]

    def step(
        self, pressure: np.ndarray, time: float, dt: float, source: Callable[[float], np.ndarray], known: np.ndarray,
        steady: np.ndarray | float = 0.0,
    ) -> AlongStep:  # fmt: skip
        """Return a step from the pressure of all points [Pa].

        Parameters
        ----------
        source : callable, time -> ndarray, shape (total,)
            Source integrated over the area of each point.
        known : ndarray, shape (total,)
            Rate of the pressure at fixed points [Pa/s], zero elsewhere.
        steady : ndarray, shape (total,)
            A further source that is constant over the step and not counted as injected.
        """
        solver, first = self._solver(dt), source(time + GAMMA * dt)
        last = source(time + dt)

        def rate(force: np.ndarray, value: np.ndarray) -> np.ndarray:
            return np.asarray(solver.solve(np.where(self._fixed, known, force + steady - self.stiffness @ value)))

        k1 = rate(first, pressure)
        k2 = rate(last, pressure + (1 - GAMMA) * dt * k1)
        end = pressure + dt * ((1 - GAMMA) * k1 + GAMMA * k2)
        injected = dt * float(((1 - GAMMA) * first + GAMMA * last).sum())
        return AlongStep(pressure, end, k2, dt, dt * GAMMA * (k2 - k1), injected)


def on_all_ranks(comm: fem.MPI.Comm, face: Interface, values: np.ndarray) -> np.ndarray:
    """Return values at all points of an interface on every rank, in the order of their numbers; collective.

    Parameters
    ----------
    values : ndarray, shape (n,) or (n, k)
    """
    rows = parallel.share_rows(comm, np.column_stack([face.number, values])[face.owned])
    ordered = rows[np.argsort(rows[:, 0]), 1:]
    return ordered if values.ndim == 2 else ordered[:, 0]
