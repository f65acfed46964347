"""Faults on bodies whose corners move together: tractions that are known before the kick act as forces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fault_step import FaultStep
from ruptfx.interfaces.mechanisms import Floats, Mechanism
from ruptfx.interfaces.mechanisms.faults import Faults, ties_corners

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System


class FaultForces(Faults):
    """Faults whose tractions follow from the displacement alone (`ContactMethod.traction_ends_slip`).

    Their forces act on single corners before the corners of a component are given the sum of their forces. So they
    need not know which facets have been inserted.
    """

    order = 10
    adjoint = local_steps = False

    @classmethod
    def of(cls, model: System) -> list[Fault]:
        tied = ties_corners(model)
        return [fault for fault in model.faults if tied and not fault.slides and fault.contact.traction_ends_slip]

    def _step(self, fault: Fault, inverse_mass: Floats, kick: Kick, stepped: SteppedNodes) -> FaultStep:
        at_rest = np.zeros_like(inverse_mass)  # the step changes forces, and no velocity
        return FaultStep(fault, at_rest, kick.clock, self.model.case.output.rupture_threshold)

    def add_first(self, state: State, kick: Kick) -> None:
        super().before_kick(state, kick)
        super().after_kick(state, kick)

    def add_resistance(self, state: State, force: Floats) -> None:
        values = np.zeros_like(force)
        for fault in self.faults:
            fields = state.faults[fault.name]
            shear = fault.components(fields, "shear_traction") - fault.driving_shear(state.fault_time)
            fault.assemble(np.column_stack([fields["normal_stress"] - fault.normal_stress_0, -shear]), values)
        self.model.layout.take_from_owners(values)
        force += values

    before_kick = Mechanism.before_kick
    after_kick = Mechanism.after_kick
    exchange = Mechanism.exchange
    started = Mechanism.started
