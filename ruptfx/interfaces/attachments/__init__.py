"""Attachments of the bodies, one kind per file; the file name is the `kind` of an entry of ``[[attachments]]``.

An attachment is the table of a case, and makes a mechanism: an object that adds forces to the steps, has fields and
energies of its own, and keeps the contracts of `ruptfx.interfaces.mechanisms`. Steppers, the energy table,
checkpoints, records and the stable time step ask every mechanism for its part; none knows a kind of attachment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from ruptfx.input.fields import PointField
from ruptfx.input.schema import Alternative, Name, alternative
from ruptfx.interfaces.mechanisms import Floats, ImplicitForce, Mechanism, Reaction, Rows
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.laws.materials import Plane
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms.checks.table import Plan
    from ruptfx.interfaces.mechanisms.stepped_nodes import SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System


Integers = NDArray[np.int64]


class Attachment(Alternative):
    """The contract of an attachment; it acts in explicit steps, and in implicit ones where it says so."""

    example: ClassVar[str] = ""
    """Entry of a case of two plates in plane stress, each 12 mm long and 4 mm high."""
    source: ClassVar[str] = ""
    """Publication of the equations."""
    implicit: ClassVar[bool] = False
    """Whether its mechanism has the forces at the end of implicit steps (`ImplicitForce.respond`)."""
    inertia: ClassVar[bool] = False
    """Whether it acts by inertia only, so that it has no effect in steps of equilibrium."""

    closure: ClassVar[float] = 1e-12
    """Largest part of the kinetic energy that the budget of explicit steps may lack; above rounding it falls with the
    square of the step, and the class says why it is open."""
    why_open: ClassVar[str] = ""
    """Reason for a budget that is open by more than rounding."""

    name: Name
    """Name of its group in `attachments.h5`, different for each attachment."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        """Refuse fields that do not fit a plane, in which displacement has these components (``xy``, ``z`` or ``xyz``).

        Raises
        ------
        ValueError
            Names the key, the value and the remedy.
        """

    def bind(self, model: System, key: str) -> Attached:
        """Return its mechanism; the mass and the boundaries of the model are known; collective.

        Raises
        ------
        RuptfxError
            On all ranks, naming the key: an edge that is not there.
        """
        raise NotImplementedError


class EdgeAttachment(Attachment):
    """An attachment along a named edge."""

    edge: str
    """``body.side``, for example ``upper.top``."""

    def nodes_on(self, model: System, key: str) -> EdgeNodes:
        """Return the nodes of the edge; collective.

        Raises
        ------
        RuptfxError
            On all ranks: no such edge.
        """
        edge = model.loads.edge(self.edge, f"{key}.edge")
        nodes, c = np.asarray(edge.nodes, dtype=np.int64), model.components
        area = edge.integral(lambda tests, n: tests[0]).reshape(-1, c)[nodes, 0]
        dim = model.coordinates.shape[1]

        def component(axis: int) -> Floats:
            return np.asarray(edge.integral(lambda tests, n: n[axis] * tests[0]).reshape(-1, c)[nodes, 0])

        normal = np.stack([component(axis) for axis in range(dim)], axis=1)
        return EdgeNodes(nodes, area, normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300))


@dataclass(frozen=True)
class EdgeNodes:
    """Nodes of an edge on this rank, ghosts included.

    Attributes
    ----------
    nodes : ndarray of int, shape (n,)
    area : ndarray, shape (n,)
        Tributary area of every node, per metre of thickness in 2D [m2]; complete, as other ranks have it.
    normal : ndarray, shape (n, dim)
        Outward unit normal, the mean of both sides at a corner.
    """

    nodes: Integers
    area: Floats
    normal: Floats


class Attached(Mechanism, ImplicitForce):
    """A mechanism with fields at some nodes: `fields` declares them, `State.attached` has them.

    Without `Attachment.implicit` its `respond` is never called: a case with implicit steps is refused.

    Parameters
    ----------
    name : str
        Of the attachment.
    nodes : ndarray of int, shape (n,)
        Local nodes, ghosts included: every rank computes the fields at all of its nodes, and needs no messages.

    Attributes
    ----------
    at : ndarray of int, shape (n,)
        These nodes.
    owned : ndarray of bool, shape (n,)
        Whether this rank counts a node in sums.
    total : int
        Number of nodes of all ranks.
    fields : tuple of PointField
        Declared by the class; arrays of the state have the shape (n,), or (n, components) for vectors.
    """

    fields: ClassVar[tuple[PointField, ...]] = ()
    local_steps = True

    def __init__(self, model: System, name: str, nodes: Integers) -> None:
        super().__init__(model)
        self.name, self.at = name, nodes
        self.owned = nodes < model.owned_nodes
        number = model.layout.numbering[nodes]
        every = np.sort(parallel.share_rows(model.comm, number[self.owned]))
        self._number, self.total = np.searchsorted(every, number), len(every)

    def of(self, state: State) -> FaultState:
        """Return its fields in a state, by name."""
        return state.attached[self.name]

    def at_nodes(self, field: Floats, add: Floats | None = None) -> Floats:
        """Return a nodal field at its nodes, shape (n, components), after adding something to it."""
        rows = field.reshape(self.model.nodes, -1)
        if add is not None:
            rows[self.at] += add
        return np.asarray(rows[self.at])

    def start(self, field: PointField) -> Floats | float:
        """Return the values of a field at the start; `PointField.start` unless a mechanism knows better."""
        return field.start

    def nodes(self) -> NDArray[np.bool_]:
        result = super().nodes()
        result[self.at] = True
        return result

    def obstacle_to_substeps(self) -> str:
        remedy = "acts in equal steps only; remove it, or use stepper.kind = 'leapfrog'"
        return "" if self.local_steps else f"attachments: name = '{self.name}' {remedy}"

    def dashpot(self) -> Floats:
        """Return its damping force per velocity [N s/m], shape (nodes * components,); zero without dashpots.

        Steppers with inertia treat it as that of boundaries, by the velocity at the time of the force: the stable step
        stays as it is, and the energy budget closes. The loss is in the column `damping`.
        """
        return np.zeros(self.model.nodes * self.model.components)

    def bind(self, stepped: SteppedNodes) -> None:
        self._stepped, c = stepped, self.model.components
        self._among = stepped.among((self.at[:, None] * c + np.arange(c)).ravel())

    def mean_velocity(self, state: State) -> Floats:
        """Return the mean of the velocities before and after a kick at its nodes [m/s], shape (n, components).

        In the phase `account` of explicit steps it is the velocity at the time of the forces.
        """
        after = self.at_nodes(state.velocity)
        return 0.5 * (self._stepped.velocity_before[self._among].reshape(after.shape) + after)

    def no_reaction(self) -> Reaction:
        """Return the forces beside its dashpots of an attachment that has none."""
        c = self.model.components
        return Reaction(self.at[:0], np.zeros((0, c)), np.zeros((0, c, c)), {})

    def begin(self, state: State) -> None:
        n, c = len(self.at), self.model.components
        state.attached[self.name] = {
            field.name: np.full((n, c) if field.vector else n, self.start(field)) for field in self.fields
        }

    def check(self, plan: Plan) -> Iterator[Row]:
        yield Row(f"attachments '{self.name}': nodes", self.total)

    def saved(self, state: State) -> Mapping[str, Rows]:
        kept = [field for field in self.fields if field.checkpointed]
        return {f"attachments/{self.name}": self._gathered(self.of(state), kept)}

    def restore(self, state: State, read: Callable[[str], np.ndarray]) -> None:
        for field in self.fields:
            if field.checkpointed:
                names = [f"attachments/{self.name}/{name}" for name in field.names(self.model.components)]
                values = self.of(state)[field.name]
                values[:] = np.stack([read(name)[self._number] for name in names], axis=1).reshape(values.shape)

    def recorded(self, state: State) -> FaultState:
        """Return the fields at `State.fault_time`, the time of a record; by default those of the state."""
        return self.of(state)

    def record(self, state: State) -> Rows:
        """Return the numbers of a record, in an order that no partition changes, on rank 0; collective."""
        return self._gathered(self.recorded(state), self.recorded_fields())

    def recorded_fields(self) -> list[PointField]:
        """Return the fields that records have."""
        return [field for field in self.fields if field.recorded]

    def numbers_per_record(self) -> int:
        """Return how many numbers a record of it has."""
        return self.total * sum(len(field.names(self.model.components)) for field in self.recorded_fields())

    def positions(self) -> Rows:
        """Return the coordinates of the nodes [m] in the order of records, on rank 0; collective."""
        x = self.model.coordinates[self.at]
        axes = dict(zip("xyz", x.T, strict=False))
        return parallel.gather_fields(self.model.comm, self._number, self.owned, axes)

    def _gathered(self, values: FaultState, fields: Iterable[PointField]) -> Rows:
        rows: dict[str, np.ndarray] = {}
        for field in fields:
            names = field.names(self.model.components)
            rows |= dict(zip(names, values[field.name].reshape(len(self.at), len(names)).T, strict=True))
        return parallel.gather_fields(self.model.comm, self._number, self.owned, rows)


if TYPE_CHECKING:
    AnyAttachment = Attachment
else:
    AnyAttachment = alternative("ruptfx.interfaces.attachments")
