"""Readings of instruments on bodies and interfaces: at a point, along a fault, on an edge, as weights."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from ruptfx.bodies.space.edges import Edge
from ruptfx.bodies.space.inside import CellBoxes, Inside
from ruptfx.input.fields import FIELDS, STRESSES, extensive_unit, stress_entries
from ruptfx.input.quantities import at_least, at_most
from ruptfx.input.schema import CaseError, nearest
from ruptfx.laws.materials.stiffness import tangent_stiffness
from ruptfx.platform import parallel
from ruptfx.readings.instruments import Channel, Share
from ruptfx.readings.instruments._inelastic import InelasticStress

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.platform.fem import Expr

LOG = logging.getLogger("ruptfx.run")
Stresses = Callable[[np.ndarray], np.ndarray]
OFF = 1e-6  # of an element: largest distance of a point from its interface


class ModelReadings:
    """A model with the readings that instruments may request.

    Parameters
    ----------
    initial_stress : callable
        Function from points, shape (n, dim), to the initial stress of the bodies [Pa], shape (n, stress components), in
        the order of `entries`.

    Attributes
    ----------
    axes : dict of str to int
        Components of the displacement by name.
    entries : dict of str to (int, int)
        Components of stress and strain by name; in antiplane axis and component of the gradient.
    force_unit : str
    """

    def __init__(self, model: System, initial_stress: Stresses) -> None:
        self.model, self._initial_stress = model, initial_stress
        self.axes = {"z": 0} if model.components == 1 else {name: i for i, name in enumerate("xyz"[: model.components])}
        self.entries = stress_entries(model.case.plane, model.components)
        self.force_unit = extensive_unit("N", model.case.plane)

    def unit_vector(self, component: int) -> np.ndarray:
        """Return the unit vector of a component, shape (components,)."""
        vector: np.ndarray = np.eye(self.model.components)[component]
        return vector

    def initial_stress(self, label: str, point: Sequence[float]) -> float:
        """Return a component of the initial stress at a point [Pa]."""
        return float(self._initial_stress(np.array([point]))[0, list(self.entries).index(label)])

    @cached_property
    def inelastic(self) -> InelasticStress:
        """Inelastic stresses at the points of elements."""
        return InelasticStress(self.model)

    @cached_property
    def _boxes(self) -> CellBoxes:
        return CellBoxes.of(self.model)

    def point(
        self, point: Sequence[float], body: str | None, key: str, field: str = "point", first: bool = False
    ) -> SensedPoint:
        """Return a point of the bodies [m]; collective.

        Parameters
        ----------
        key, field : str
            Of the case, for messages.
        first : bool
            Take the first of several bodies that contain the point, if none is named.

        Raises
        ------
        CaseError
            On all ranks, if it is outside, or in several bodies of which none is named, unless `first`.
        """
        place = Inside(self.model, point, body, key, field, self._boxes, first)
        return SensedPoint(self, place, point)

    def at_surface(self, point: Sequence[float], body: str | None, key: str, anyhow: bool) -> tuple[SensedPoint, str]:
        """Return a point of the bodies, moved to their upper surface, and a note if it is; see `Inside.at_surface`."""
        place = Inside.at_surface(self.model, point, body, key, self._boxes, anyhow)
        return SensedPoint(self, place, place.point), place.note

    def at_fault(self, name: str, place: float | Sequence[float], key: str, field: str = "position") -> list[Channel]:
        """Return a channel for every field of an interface at a position; collective.

        Parameters
        ----------
        place : float or sequence of float
            In 2D the position [m], linear between its points; in 3D the coordinates [m] of a point of it, by the shape
            functions of its elements, or of one beside it, whose nearest node is taken and named in each channel.
        key, field : str
            Of the case, for messages; `field` that of a position.

        Raises
        ------
        CaseError
            On all ranks, if there is no such interface, or the position is farther than half an element from it.
        """
        known = {fault.name: fault for fault in self.model.faults}
        if name not in known:
            raise CaseError(f"{key}.fault = '{name}': no such interface, {nearest(name, list(known))}")
        fault = known[name]
        face, moved = fault.interface, ""
        if isinstance(place, float):
            weights = self._along(face, place, f"{key}.{field}")
        else:
            weights, moved = self._on(fault, place, key)
        own_points = np.flatnonzero(face.owned & np.isin(face.number, list(weights)))
        mine = np.array([weights[int(number)] for number in face.number[own_points]])
        items = []
        for each in FIELDS:
            for number, label in enumerate(each.names(fault.tangents) if each.recorded else ()):
                text = each.long_name
                if label != each.name:
                    # A rank without such points contributes nothing.
                    tangent = parallel.total(self.model.comm, mine @ face.frame[own_points, 1 + number])
                    along = ", ".join(f"{value:.3g}" for value in tangent / np.linalg.norm(tangent) + 0.0)
                    text += f" along tangent {number + 1}, ({along})"
                items.append(Channel(label, each.unit, text + moved, [Share((name, label), own_points, mine)]))
        for label, unit in fault.state_fields().items():
            text = f"state variable {label}{moved}"
            items.append(Channel(label, unit, text, [Share((name, label), own_points, mine)]))
        return items

    def _along(self, face: Interface, position: float, key: str) -> dict[int, float]:
        """Return weights of points of an interface in 2D, by number; collective."""
        slack = 1e-9 * face.line.length
        if not face.line.first - slack <= position <= face.line.last + slack:
            raise CaseError(
                f"{key} = {position:.6g} m: must be on the interface, {at_least(face.line.first)} to "
                f"{at_most(face.line.last)} m"
            )
        rows = parallel.share_rows(self.model.comm, np.column_stack([face.number, face.position])[face.owned])
        numbers, positions = rows[np.argsort(rows[:, 0])].T
        after = int(np.clip(np.searchsorted(positions, position), 1, len(positions) - 1))
        part = (position - positions[after - 1]) / (positions[after] - positions[after - 1])
        return {int(numbers[after - 1]): 1 - part, int(numbers[after]): part}

    def _on(self, fault: Fault, point: Sequence[float], key: str) -> tuple[dict[int, float], str]:
        """Return weights of points of an interface in 3D, by number, and a note if it is another point; collective.

        They are the shape functions of the plus side. A point beside the interface, by half an element at most, as
        stations on the mean plane of a rough one are, is moved to the nearest node; a point on it at a welded end,
        which has no slip of its own, is not.
        """
        model, face, comm = self.model, fault.interface, self.model.comm
        numbers = dict(zip(face.plus.tolist(), face.number.tolist(), strict=True))
        value = np.zeros((1 + len(point), model.components))
        value[0, 0] = 1.0
        rows = [np.zeros((0, 2))]
        for body in np.flatnonzero(parallel.total(comm, model.layout.touches[:, face.plus].any(axis=1))):
            with suppress(CaseError):  # the point is in another body
                dofs, weights = Inside(model, point, model.bodies.names[body], key).weights(value)
                chosen = slice(None, None, model.components)
                nodes = [numbers.get(int(dof), -1) for dof in dofs[chosen] // model.components]
                rows.append(np.column_stack([nodes, weights[chosen]]))
        shared = parallel.share_rows(comm, np.concatenate(rows))
        on = shared[:, 0] >= 0
        if not on.any() or np.abs(shared[~on, 1]).sum() > OFF:
            near = parallel.share_rows(comm, np.column_stack([face.number, face.points, face.frame[:, 0]])[face.owned])
            away = np.linalg.norm(near[:, 1:4] - np.asarray(point), axis=1)
            best = int(np.argmin(away))
            # Digits enough that the remedy is accepted.
            here, there = ("(" + ", ".join(f"{v:.12g}" for v in each) + ") m" for each in (point, near[best, 1:4]))
            edge, across = self._facet_edge(fault), abs(near[best, 4:] @ (near[best, 1:4] - np.asarray(point)))
            if OFF * edge < across and away[best] <= 0.5 * edge:
                moved = f", at the nearest node, {there}, {away[best]:.4g} m away"
                LOG.warning("%s.point = %s is beside the interface%s", key, here, moved)
                return {int(near[best, 0]): 1.0}, moved
            raise CaseError(
                f"{key}.point = {here}: is not on interface '{fault.name}', or in an element at its welded end; use "
                f"its nearest node, {there}"
            )
        which, place = np.unique(shared[on, 0], return_inverse=True)
        sums = np.bincount(place, weights=shared[on, 1])
        return dict(zip(which.astype(int).tolist(), (sums / sums.sum()).tolist(), strict=True)), ""

    def _facet_edge(self, fault: Fault) -> float:
        """Return the root of the mean area of the facets of an interface [m]; collective."""
        model, face = self.model, fault.interface
        facets = model.bodies.facets.find(model.bodies.tags[f"{fault.name}.minus"])
        owned = np.count_nonzero(facets < model.mesh.topology.index_map(model.mesh.topology.dim - 1).size_local)
        area, count = parallel.total(model.comm, np.array([face.area[face.owned].sum(), owned]))
        return float(np.sqrt(area / count))

    def forces(self, name: str, key: str) -> list[tuple[str, list[Share], float]]:
        """Return the external force on an edge, along every axis [N, in 2D N/m]; collective.

        Each entry has axis, shares, and the force of the initial stress. The sum over the nodes of the edge of K u + M
        a is, as K is symmetric, the sum of (K w + M a w) with w, one at these nodes and zero elsewhere. Materials with
        memory add the forces of their inelastic stress at these nodes.

        Raises
        ------
        RuptfxError
            On all ranks: no such edge.
        """
        model = self.model
        edge = Edge(model, name, key)
        items = []
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
            if "inertia" in model.case.stepper.offers:
                shares.append(_share("acceleration", model.mass * ones * owned))
            if model.memory_laws:
                shares.append(_share("inelastic_force", -ones))  # every rank has the forces of its own elements
            chosen = np.zeros(len(owned), dtype=bool)
            chosen[component :: model.components] = True
            offset = float(parallel.total(model.comm, float(initial[chosen & owned].sum())))
            items.append((label, shares, offset))
        return items

    def _initial_force(self, edge: Edge) -> np.ndarray:
        """Return the nodal force of the initial stress on an edge [N], at every local degree of freedom; collective."""
        c, stresses = self.model.components, self._initial_stress(self.model.coordinates)
        force = np.zeros((self.model.nodes, c))
        for (i, j), stress in zip(STRESSES[c].values(), stresses.T, strict=False):
            for row, column in sorted({(i, j), (j, i)}) if c > 1 else [(0, i)]:
                weights = edge.integral(_component(row, column))
                force[:, row] += stress * weights.reshape(-1, c)[:, row]
        return force.ravel()


def _component(row: int, column: int) -> Callable[[list[Expr], Expr], Expr]:
    return lambda tests, n: n[column] * tests[row]


class SensedPoint:
    """A point of the bodies with its readings.

    Parameters
    ----------
    point : sequence of float
        Its coordinates [m].
    """

    def __init__(self, readings: ModelReadings, place: Inside, point: Sequence[float]) -> None:
        self._readings, self._place, self._point = readings, place, point
        model = readings.model
        self._shape = (1 + model.mesh.geometry.dim, model.components)

    def motion(self, source: Literal["displacement", "velocity"], along: np.ndarray) -> Share:
        """Return displacement or velocity times a vector, shape (components,)."""
        coefficients = np.zeros(self._shape)
        coefficients[0] = along
        return self.reading(coefficients, source)

    def extension(self, along: np.ndarray) -> Share:
        """Return the strain n_i n_j du_i/dx_j along a unit vector, shape (dim,)."""
        coefficients = np.zeros(self._shape)
        coefficients[1:] = np.outer(along, along)
        return self.reading(coefficients)

    def strain(self, entry: tuple[int, int]) -> Share:
        """Return a component of the strain."""
        (i, j), coefficients = entry, np.zeros(self._shape)
        if self._readings.model.case.plane == "axisymmetric" and i == 2:
            self._add_around(coefficients, 1.0)
            return self.reading(coefficients)
        coefficients[1 + i, j] += 0.5
        if self._shape[1] > 1:
            coefficients[1 + j, i] += 0.5
        return self.reading(coefficients)

    def stresses(self, label: str) -> list[Share]:
        """Return a component of the stress beyond the initial one [Pa]: elastic, and inelastic with memory."""
        model, result = self._readings.model, [self.stress(self._readings.entries[label])]
        if model.bodies.names[self._place.body] in model.memory_laws:
            result.append(Share("inelastic_stress", *self._readings.inelastic.at(self._place, label)))
        return result

    def stress(self, entry: tuple[int, int]) -> Share:
        """Return a component of the elastic stress beyond the initial one [Pa]."""
        model, coefficients = self._readings.model, np.zeros(self._shape)
        material, plane = model.materials[self._place.body], model.case.plane
        if model.variation is not None:
            material = model.variation.at_point(self._place.body, np.array(self._point, dtype=float))
        if plane == "axisymmetric":
            stiffness = tangent_stiffness(material, "solid")[entry]
            coefficients[1:] = stiffness[:2, :2].T
            self._add_around(coefficients, stiffness[2, 2])
        else:
            stiffness = tangent_stiffness(material, plane)
            coefficients[1:] = stiffness[entry[0]][:, None] if stiffness.ndim == 2 else stiffness[entry].T
        return self.reading(coefficients)

    def _add_around(self, coefficients: np.ndarray, factor: float) -> None:
        """Add the strain around the axis, u_r / r, times a factor."""
        radius = self._point[1]  # on the axis u_r / r is du_r/dr
        coefficients[(0, 1) if radius > 0 else (2, 1)] += factor / (radius or 1.0)

    def initial_stress(self, label: str) -> float:
        """Return a component of the initial stress of the bodies [Pa]."""
        return self._readings.initial_stress(label, self._point)

    def reading(self, coefficients: np.ndarray, source: Literal["displacement", "velocity"] = "displacement") -> Share:
        """Return a sum of the components of a field and of their derivatives times coefficients.

        Coefficients have shape (1 + dim, components); row 0 is for the field, rows 1, 2 ... for derivatives along x,
        y ...
        """
        return Share(source, *self._place.weights(coefficients))


def _share(source: Literal["displacement", "acceleration", "inelastic_force"], nodal: np.ndarray) -> Share:
    places = np.flatnonzero(nodal)
    return Share(source, places, nodal[places])
