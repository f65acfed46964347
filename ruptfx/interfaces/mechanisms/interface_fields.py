"""Pore pressure and temperature of interfaces in explicit steps, and their memory in checkpoints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.interfaces.faults.fields import power_of
from ruptfx.interfaces.mechanisms import Mechanism, Rows
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick
    from ruptfx.interfaces.mechanisms.system import System


BEFORE = ("shear_traction", "slip", "frictional_heat", "theta", "normal_stress", "pore_pressure")
"""Begins of the names of fields before a step that its end needs."""


class InterfaceFields(Mechanism):
    """Fields of interfaces: planned before the tractions of a step are computed, completed after it."""

    order = 98
    adjoint = local_steps = True

    def __init__(self, model: System) -> None:
        super().__init__(model)
        self._faults = [fault for fault in model.faults if fault.fields]
        self._before: dict[str, FaultState] = {}

    @classmethod
    def present(cls, model: System) -> bool:
        return any(fault.fields for fault in model.faults)

    def begin(self, state: State) -> None:
        for fault in self._faults:
            fields = fault.initial_state(self.model.initial_slip_rate(fault))
            state.fluids[fault.name] = fault.fields.memory(power_of(fault, fields))

    def saved(self, state: State) -> Mapping[str, Rows]:
        entries = {}
        for fault in self._faults:
            columns = {
                f"{name}.{k}": column for name, values in state.fluids[fault.name].items()
                for k, column in enumerate(values.T)
            }  # fmt: skip
            face = fault.interface
            entries[f"fluids/{fault.name}"] = parallel.gather_fields(self.model.comm, face.number, face.owned, columns)
        return entries

    def restore(self, state: State, read: Callable[[str], np.ndarray]) -> None:
        for fault in self._faults:
            for name, values in state.fluids[fault.name].items():
                for k in range(values.shape[1]):
                    values[:, k] = read(f"fluids/{fault.name}/{name}.{k}")[fault.interface.number]

    def prepare(self, state: State, kick: Kick) -> None:
        for fault in self._faults:
            fault.fields.plan(fault, state, state.lag)
            fields = state.faults[fault.name]
            self._before[fault.name] = {
                name: values.copy() for name, values in fields.items()
                if name.startswith(BEFORE)
            }  # fmt: skip

    def account(self, state: State, kick: Kick) -> None:
        # The tractions are those at `State.time`, which the stepper advances after this phase.
        for fault in self._faults:
            before, fields = self._before[fault.name], state.faults[fault.name]
            heating = fault.fields.complete(fault, state, before, fields, kick.clock.since, ends_at=state.time)
            fault.fields.require_short(fault, state, heating)
