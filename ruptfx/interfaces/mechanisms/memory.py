"""Materials with memory: the force of the inelastic stress, and what the bodies store and dissipate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.operators import FusedOperator, Inelastic
from ruptfx.input.fields import Energy
from ruptfx.interfaces.mechanisms import ElementStiffness, Floats, ImplicitForce, Reaction, Rows, StepEnd
from ruptfx.interfaces.mechanisms._inserted import InsertedForce
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.operators.memory_sweep import MemorySweep
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms.checks.table import Plan
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick
    from ruptfx.interfaces.mechanisms.system import System

WORK, HALF = "work of inelastic stress", "half a step of it"


def _stiffness(sweep: MemorySweep, moduli: Floats) -> ElementStiffness:
    return ElementStiffness(sweep.nodes_of_cells, moduli, partial(sweep.matrices, moduli))


def inelastic_force(model: System, state: State) -> Floats:
    """Return the force of the inelastic stress at the time of the faults, of the elements of this rank [N]."""
    force = np.zeros(len(model.mass))
    for name, sweep in model.memory.items():
        sweep.add_force(state.at_faults()[1], state.memory[name].copy(), 0.0, force)  # the present stress
    return force


class Memory(InsertedForce, ImplicitForce):
    """State of the points of elements, and the force that the inelastic stress adds to the elastic one.

    The bulk kernel calls the sweep before that of its own elements, block by block, and advances nodes with both
    forces; with an operator that makes no steps the sweep comes first. Implicit steps solve for the stress at their
    end, with its exact derivative.
    """

    order = 10
    energies = (Energy("material_dissipation", "energy dissipated in materials with memory", "dissipated"),)

    def __init__(self, model: System) -> None:
        super().__init__(model)
        if isinstance(model.operator, FusedOperator):
            self.inelastic = Inelastic(list(model.memory.values()), self._force, np.zeros(2))

    @classmethod
    def present(cls, model: System) -> bool:
        return any(material.has_memory() for material in model.materials)

    def begin(self, state: State) -> None:
        state.memory = {name: sweep.begin() for name, sweep in self.model.memory.items()}
        state.energy |= {WORK: 0.0, HALF: 0.0}

    def add_first(self, state: State, kick: Kick) -> None:
        self._before = state.velocity[self._index].copy()
        if self.inelastic is not None:
            self.inelastic.states = [state.memory[name] for name in self.model.memory]
            self.inelastic.dt = kick.clock.since
            return
        self._force[:] = 0
        for name, sweep in self.model.memory.items():
            sweep.add_force(state.displacement, state.memory[name], kick.clock.since, self._force)
        state.force += self._force

    def account(self, state: State, kick: Kick) -> None:
        force = self._force[self._index]
        before, after = float(force @ self._before), float(force @ state.velocity[self._index])
        if self.inelastic is not None:
            before, after = before + self.inelastic.power[0], after + self.inelastic.power[1]
            self.inelastic.power[:] = 0
            self._force[self._index] = 0
        state.energy[WORK] -= 0.5 * kick.clock.kick * (before + after)
        state.energy[HALF] = -0.5 * kick.clock.dt * after

    # -- implicit steps ----------------------------------------------------------------------------

    def respond(self, state: State, end: StepEnd) -> Reaction:
        advanced = {name: values.copy() for name, values in state.memory.items()}

        def elements() -> list[ElementStiffness]:
            return [
                _stiffness(sweep, sweep.tangent(end.displacement, state.memory[name], end.dt))
                for name, sweep in self.model.memory.items()
            ]

        return self._reaction(end.displacement, advanced, end.dt, elements)

    def force_of(self, state: State) -> Reaction:
        present = {name: values.copy() for name, values in state.memory.items()}
        return self._reaction(state.at_faults()[1], present, 0.0, list)

    def _reaction(
        self, displacement: Floats, fields: FaultState, dt: float, elements: Callable[[], list[ElementStiffness]]
    ) -> Reaction:
        """Return the force of the inelastic stress after a step, to which the fields are advanced; collective."""
        model = self.model
        force, c = np.zeros_like(displacement), model.components
        for name, sweep in model.memory.items():
            sweep.add_force(displacement, fields[name], dt, force)
        model.layout.sum_shared(force)
        return Reaction(np.arange(model.nodes), force.reshape(-1, c), np.zeros((0, c, c)), fields, elements=elements)

    def advance(self, state: State, end: StepEnd, reaction: Reaction) -> None:
        """Copy the state of the points; the work is that of the mean of the forces at both ends of the step."""
        mean = 0.5 * (self.force_of(state).force + reaction.force).ravel()
        moved = end.displacement - state.at_faults()[1]  # after explicit steps the memory is one step behind
        state.energy[WORK] -= state.energy[HALF] + self.model.layout.owned_dot(mean, moved)
        state.energy[HALF] = 0.0
        for name, values in state.memory.items():
            values[:] = reaction.fields[name]

    # -- energies ----------------------------------------------------------------------------------

    def add_energies(self, state: State, energies: dict[str, float]) -> None:
        """Dissipated until the time of the faults: work of the stress less what is stored then."""
        then = state.at_faults()[1]
        stored = sum(
            sweep.stored(then, state.memory[name]) - sweep.elastic(then) for name, sweep in self.model.memory.items()
        )  # fmt: skip
        work = state.energy[WORK]
        dissipated = work - state.energy[HALF] - stored
        energies["material_dissipation"] += dissipated
        energies["strain"] += work - dissipated  # that of the elastic operator is of the whole strain

    def add_resistance(self, state: State, force: Floats) -> None:
        inelastic = inelastic_force(self.model, state)
        self.model.layout.sum_shared(inelastic)
        force += inelastic

    def check(self, plan: Plan) -> Iterator[Row]:
        for name, law in self.model.memory_laws.items():
            yield Row(f"body '{name}': state variables per point", len(law.state))

    # -- checkpoints -------------------------------------------------------------------------------

    def saved(self, state: State) -> Mapping[str, Rows]:
        numbering, comm = self.model.layout.numbering, self.model.comm
        entries: dict[str, Rows] = {}
        for name, law in self.model.memory_laws.items():
            sweep, number = self.model.memory.get(name), self._cells(name)
            every, group = np.ones(len(number), dtype=bool), {}
            for place, field in enumerate(law.state):
                points = range(self.model.points_of_cells)
                rows = np.zeros((0, len(points))) if sweep is None else (
                    sweep.rows(state.memory[name], numbering)[:, :, place])  # fmt: skip
                columns = {str(point): rows[:, point] for point in points}
                gathered = parallel.gather_fields(comm, number, every, columns)
                group[field] = np.stack(list(gathered.values()), axis=1)
            entries[f"memory/{name}"] = group
        return entries

    def restore(self, state: State, read: Callable[[str], np.ndarray]) -> None:
        numbering = self.model.layout.numbering
        for name, law in self.model.memory_laws.items():
            number, sweep = self._cells(name), self.model.memory.get(name)
            fields = [read(f"memory/{name}/{field}")[number] for field in law.state]
            if sweep is not None and fields:
                sweep.fill(state.memory[name], np.stack(fields, axis=2), numbering)

    def _cells(self, name: str) -> np.ndarray:
        """Return the place of the cells of a body in an order that no partition changes; collective."""
        model = self.model
        sweep = model.memory.get(name)
        cells = np.zeros(0, dtype=np.int64) if sweep is None else sweep.cells
        corners = model.mesh.geometry.dim + 1 if model.points_of_cells == 1 else 2**model.mesh.geometry.dim
        numbers = model.layout.numbering[model.space.dofmap.list[cells, :corners]]
        return parallel.places(model.comm, np.sort(numbers, axis=1).astype(float))
