"""The bodies and interfaces as instruments see them: what is read at a point, along a fault, on an edge, as weights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from ruptfx import parallel
from ruptfx.edges import Edge
from ruptfx.fields import FIELDS
from ruptfx.inside import Inside
from ruptfx.instruments import Channel, Share
from ruptfx.materials._stiffness import tangent_stiffness
from ruptfx.schema import CaseError, nearest

if TYPE_CHECKING:
    from ruptfx.fem import Expr
    from ruptfx.model import Model

Stresses = Callable[[np.ndarray], np.ndarray]
_ENTRIES = {
    1: {"xz": (0, 0), "yz": (1, 0)},
    2: {"xx": (0, 0), "yy": (1, 1), "xy": (0, 1)},
    3: {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "xz": (0, 2)},
}


class Sensed:
    """A model as instruments see it.

    Parameters
    ----------
    model : Model
    initial_stress : callable
        From points, shape (n, dim), to the initial stress of the bodies there [Pa], shape (n, stress components) in the
        order of `entries`.

    Attributes
    ----------
    axes : dict of str to int
        Components of the displacement by name.
    entries : dict of str to (int, int)
        Components of stress and strain by name; in antiplane axis and component of the gradient.
    force_unit : str
    """

    def __init__(self, model: Model, initial_stress: Stresses) -> None:
        self.model, self._initial_stress = model, initial_stress
        self.axes = {"z": 0} if model.components == 1 else {name: i for i, name in enumerate("xyz"[: model.components])}
        self.entries = _ENTRIES[model.components]
        self.force_unit = "N" if model.case.plane in ("solid", "axisymmetric") else "N/m"

    def unit_vector(self, component: int) -> np.ndarray:
        return np.eye(self.model.components)[component]

    def initial_stress(self, label: str, point: Sequence[float]) -> float:
        """A component of it at a point [Pa]."""
        return float(self._initial_stress(np.array([point]))[0, list(self.entries).index(label)])

    def point(self, point: Sequence[float], body: str | None, key: str, field: str = "point") -> SensedPoint:
        """A point of the bodies [m]; collective.

        Raises
        ------
        CaseError
            On all ranks: it is outside, or where several bodies meet and none is named.
        """
        return SensedPoint(self, Inside(self.model, point, body, key, field), point)

    def at_fault(self, name: str, position: float, key: str) -> list[Channel]:
        """Every field of an interface at a position [m], linear between its points; collective.

        Raises
        ------
        CaseError
            On all ranks: no such interface, one in 3D, or a position beyond its ends.
        """
        known = {fault.name: fault for fault in self.model.faults}
        if name not in known:
            raise CaseError(f"{key}.fault = '{name}': no such interface, {nearest(name, list(known))}")
        fault = known[name]
        face = fault.interface
        if fault.tangents > 1:
            raise CaseError(f"{key}.fault = '{name}': in 3D a position is a line; put a receiver on either side of it")
        slack = 1e-9 * face.line.length
        if not face.line.first - slack <= position <= face.line.last + slack:
            raise CaseError(
                f"{key}.position = {position:.6g} m: beyond the interface, which has {face.line.first:.6g} to "
                f"{face.line.last:.6g} m"
            )
        rows = parallel.share_rows(self.model.comm, np.column_stack([face.number, face.position])[face.owned])
        numbers, positions = rows[np.argsort(rows[:, 0])].T
        after = int(np.clip(np.searchsorted(positions, position), 1, len(positions) - 1))
        part = (position - positions[after - 1]) / (positions[after] - positions[after - 1])
        weights = {int(numbers[after - 1]): 1 - part, int(numbers[after]): part}
        here = np.flatnonzero(face.owned & np.isin(face.number, list(weights)))
        mine = np.array([weights[int(number)] for number in face.number[here]])
        described = {field.name: (field.unit, field.long_name) for field in FIELDS if field.recorded}
        described |= {
            state: (unit, f"state variable {state}") for state, unit in fault.state_fields().items()
        }
        return [
            Channel(field, unit, text, [Share((name, field), here, mine)]) for field, (unit, text) in described.items()
        ]

    def forces(self, name: str, key: str) -> list[tuple[str, list[Share], float]]:
        """Force from outside on an edge, along every axis [N, in 2D N/m]; collective.

        Its name, its shares, and what the initial stress gives. The sum over the nodes of the edge of K u + M a is, as
        K is symmetric, the sum of (K w + M a w) with w, one at these nodes and zero elsewhere.

        Raises
        ------
        RuptfxError
            On all ranks: no such edge.
        """
        model = self.model
        edge = Edge(model, name, key)
        found = []
        owned = np.arange(model.nodes * model.components) < model.owned_nodes * model.components

        initial = self._initial_force(edge)
        for label, component in self.axes.items():
            ones, force = np.zeros(len(owned)), np.zeros(len(owned))
            ones[edge.dofs(label)] = 1.0
            model.layout.sum_shared(ones)
            ones = (ones > 0).astype(float)
            model.operator.add_internal_force(ones, force)
            model.layout.sum_shared(force)
            shares = [_share("displacement", -force * owned)]
            if model.case.stepper.inertia:
                shares.append(_share("acceleration", model.mass * ones * owned))
            chosen = np.zeros(len(owned), dtype=bool)
            chosen[component :: model.components] = True
            offset = float(parallel.total(model.comm, float(initial[chosen & owned].sum())))
            found.append((label, shares, offset))
        return found


    def _initial_force(self, edge: Edge) -> np.ndarray:
        """Nodal force of the initial stress on an edge [N], at every local degree of freedom; collective."""
        c, stresses = self.model.components, self._initial_stress(self.model.coordinates)
        force = np.zeros((self.model.nodes, c))
        for (i, j), stress in zip(self.entries.values(), stresses.T, strict=True):
            for row, column in sorted({(i, j), (j, i)}) if c > 1 else [(0, i)]:
                weights = edge.integral(_component(row, column))
                force[:, row] += stress * weights.reshape(-1, c)[:, row]
        return force.ravel()


def _component(row: int, column: int) -> Callable[[list[Expr], Expr], Expr]:
    return lambda tests, n: n[column] * tests[row]


class SensedPoint:
    """A point of the bodies as instruments see it.

    Parameters
    ----------
    plates : Sensed
    place : Inside
    point : sequence of float
        Its coordinates [m].
    """

    def __init__(self, plates: Sensed, place: Inside, point: Sequence[float]) -> None:
        self._plates, self._place, self._point = plates, place, point
        model = plates.model
        self._shape = (1 + model.mesh.geometry.dim, model.components)

    def motion(self, source: Literal["displacement", "velocity"], along: np.ndarray) -> Share:
        """Displacement or velocity times a vector, shape (components,)."""
        coefficients = np.zeros(self._shape)
        coefficients[0] = along
        return self.reading(coefficients, source)

    def extension(self, along: np.ndarray) -> Share:
        """Strain n_i n_j du_i/dx_j along a unit vector, shape (dim,)."""
        coefficients = np.zeros(self._shape)
        coefficients[1:] = np.outer(along, along)
        return self.reading(coefficients)

    def strain(self, entry: tuple[int, int]) -> Share:
        """A component of the strain."""
        (i, j), coefficients = entry, np.zeros(self._shape)
        coefficients[1 + i, j] += 0.5
        if self._shape[1] > 1:
            coefficients[1 + j, i] += 0.5
        return self.reading(coefficients)

    def stress(self, entry: tuple[int, int]) -> Share:
        """A component of the stress beyond the initial one [Pa]."""
        model, coefficients = self._plates.model, np.zeros(self._shape)
        stiffness = tangent_stiffness(model.materials[self._place.body], model.case.plane)
        coefficients[1:] = stiffness[entry[0]][:, None] if stiffness.ndim == 2 else stiffness[entry].T
        if model.case.plane == "axisymmetric":
            around = tangent_stiffness(model.materials[self._place.body], "solid")[(*entry, 2, 2)]
            radius = self._point[1]  # on the axis u_r / r is du_r/dr
            coefficients[(0, 1) if radius > 0 else (2, 1)] += around / (radius or 1.0)
        return self.reading(coefficients)

    def initial_stress(self, label: str) -> float:
        """A component of the initial stress of the bodies [Pa]."""
        return self._plates.initial_stress(label, self._point)

    def reading(self, coefficients: np.ndarray, source: Literal["displacement", "velocity"] = "displacement") -> Share:
        """Any sum of the components of a field and of their derivatives times coefficients.

        Coefficients have shape (1 + dim, components); row 0 is for the field, rows 1, 2 ... for derivatives along x,
        y ...
        """
        return Share(source, *self._place.weights(coefficients))


def _share(source: Literal["displacement", "acceleration"], nodal: np.ndarray) -> Share:
    places = np.flatnonzero(nodal)
    return Share(source, places, nodal[places])
