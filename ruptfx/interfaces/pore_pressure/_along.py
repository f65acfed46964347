"""Diffusion along an interface by finite elements of its own nodes.

    storage dp/dt = div (mobility grad p) + source

over the line or surface of the interface, with the spectral elements of its edges or faces and their lumped mass. Every
rank has the matrices of the whole interface and solves the same system, so that results are the same on any number of
ranks. Steps are implicit, of second order and L-stable (Alexander 1977, SIAM J. Numer. Anal. 14, 1006).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_matrix, diags, identity
from scipy.sparse.linalg import splu

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


class Along:
    """Matrices of the diffusion along one interface.

    Parameters
    ----------
    model : System
    face : Interface
    name : str
        Of the interface.
    mobility : ndarray, shape (n,)
        At the points of this rank, permeability over viscosity [m2/(Pa s)].
    storage : float
        [1/Pa].
    area : ndarray, shape (total,)
        Of all points [m2], in 2D length [m].
    fixed : ndarray of bool, shape (total,)
        Points of known pressure.
    """

    def __init__(
        self, model: System, face: Interface, name: str, mobility: np.ndarray, storage: float, area: np.ndarray,
        fixed: np.ndarray,
    ) -> None:  # fmt: skip
        self.total, self.mass, self._fixed = face.total, storage * area, fixed
        make = self._repeated if model.section is not None else self._assembled
        self.stiffness = make(model, face, name, mobility)
        self._free = diags((~fixed).astype(float))
        self._known: tuple[float, SuperLU] | None = None

    @staticmethod
    def _assembled(model: Discretisation, face: Interface, name: str, mobility: np.ndarray) -> csr_matrix:
        """Return the stiffness of all points; collective."""
        ufl, dolfinx = fem.ufl, fem.dolfinx
        space = model.space.sub(0).collapse()[0] if model.components > 1 else model.space
        factor = dolfinx.fem.Function(space)
        factor.x.array[face.plus] = mobility
        factor.x.scatter_forward()
        trial, test, normal = ufl.TrialFunction(space), ufl.TestFunction(space), ufl.FacetNormal(model.mesh)

        def along(u: fem.Expr) -> fem.Expr:
            return ufl.grad(u) - normal * ufl.dot(normal, ufl.grad(u))

        measure = model.edge_measure(model.bodies.tags[f"{name}.plus"])
        form = fem.form(factor * ufl.dot(along(trial), along(test)) * measure)
        local = fem.local_matrix(form).tocoo()
        number = np.full(model.nodes, -1)
        number[face.plus] = face.number
        row, column = number[local.row], number[local.col]
        inside = (row >= 0) & (column >= 0) & (local.data != 0)
        entries = np.column_stack([row, column, local.data])[inside]
        entries = parallel.share_rows(model.comm, entries)
        entries = entries[np.lexsort(entries.T)]  # the sum of a pair of points in an order that no partition changes
        shape = (face.total, face.total)
        matrix = csr_matrix((entries[:, 2], (entries[:, 0].astype(int), entries[:, 1].astype(int))), shape)
        # No flow across the rim, also where its nodes are no points: rows sum to zero.
        return csr_matrix(matrix - diags(np.asarray(matrix.sum(axis=1)).ravel()))

    @staticmethod
    def _repeated(model: System, face: Interface, name: str, mobility: np.ndarray) -> csr_matrix:
        """Return the stiffness of all points of a section that repeats along strike; collective.

        Elements of the section down dip, differences of second order along strike, and no flow beyond the ends of the
        fault. Between two points the mobility is their mean.
        """
        section, along = model.section, model.case.mesh.along_strike
        assert section is not None and along is not None
        line = section.faces[name]
        down = Along._assembled(section, line, name, np.ones(len(line.plus))).tocoo()
        places, values = np.split(on_all_ranks(model.comm, face, np.column_stack([face.points, mobility])), [3], axis=1)
        column = np.round((places[:, 2] - along.positions[0]) / along.spacing).astype(int)
        point = np.full((len(line.plus), along.points), -1)
        point[section.points_of(name, places), column] = np.arange(face.total)
        point[:, along.beyond] = -1
        weight, apart = line.area[:, None] / along.spacing, down.row != down.col
        number = line.number
        pairs = [
            (point[:, :-1], point[:, 1:], np.broadcast_to(-weight, (len(line.plus), along.points - 1))),
            (point[:, 1:], point[:, :-1], np.broadcast_to(-weight, (len(line.plus), along.points - 1))),
            (point[number[down.row[apart]]], point[number[down.col[apart]]],
             np.repeat(down.data[apart, None] * along.spacing, along.points, axis=1)),
        ]  # fmt: skip
        first, second, entry = (np.concatenate([np.ravel(pair[k]) for pair in pairs]) for k in range(3))
        inside = (first >= 0) & (second >= 0)
        first, second = first[inside], second[inside]
        entry = entry[inside] * 0.5 * (values[first, 0] + values[second, 0])
        matrix = csr_matrix((entry, (first, second)), (face.total, face.total))
        return csr_matrix(matrix - diags(np.asarray(matrix.sum(axis=1)).ravel()))

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
