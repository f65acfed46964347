"""Faults whose surfaces slide over meshes that do not match."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ruptfx.input.fields import TAKEN_IN_SLIDING, Field, fields_of_sliding
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.mechanisms import Floats
from ruptfx.interfaces.mechanisms.faults import Faults
from ruptfx.interfaces.sliding.contact_states import sliding_fields
from ruptfx.interfaces.sliding.follower import Follower
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.interfaces.sliding.step import SlidingStep

if TYPE_CHECKING:
    from ruptfx.bodies.state import FaultState, State
    from ruptfx.interfaces.mechanisms.checks.table import Plan, Row
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System


class SlidingFaults(Faults):
    """Faults with a geometry that follows the motion.

    Attributes
    ----------
    followers : list of Follower
    """

    order = 70
    adjoint = local_steps = False

    def __init__(self, model: System) -> None:
        super().__init__(model)
        self.followers = [Follower(fault) for fault in self.faults]

    @classmethod
    def of(cls, model: System) -> list[Fault]:
        return [fault for fault in model.faults if fault.slides]

    def begin(self, state: State) -> None:
        super().begin(state)
        state.energy |= {f"{fault.name}.{name}": 0.0 for fault in self.faults for name in TAKEN_IN_SLIDING}

    def recorded_fields(self) -> tuple[Field, ...]:
        return (*super().recorded_fields(), *fields_of_sliding(self.model.components))

    def recorded(self, fault: Fault, state: State) -> FaultState:
        least, then = self.model.case.output.rupture_threshold, state.at_faults()[1]
        return super().recorded(fault, state) | sliding_fields(fault, state.faults[fault.name], then, least)

    def _check_surfaces(self, fault: Fault, plan: Plan) -> Iterator[Row]:
        from ruptfx.interfaces.mechanisms.checks import sliding as rows
        from ruptfx.interfaces.sliding.roughness import roughness

        assert isinstance(fault.interface, SlidingInterface)
        yield from rows.surface_rows(self.model, fault.name, fault.interface, plan.ends)
        yield from rows.spring_rows(self.model, fault, plan.stable)
        result = roughness(self.model, self.model.case.mesh, fault, plan.ends)
        yield from rows.rough_rows(f"faults.{fault.name}", result)

    def _step(self, fault: Fault, inverse_mass: Floats, kick: Kick, stepped: SteppedNodes) -> SlidingStep:
        assert isinstance(fault.interface, SlidingInterface)
        before = stepped.velocity_before, stepped.among(fault.interface.dofs)
        return SlidingStep(fault, inverse_mass, kick.clock, self.model.case.output.rupture_threshold, before)

    def _count_start(self, fault: Fault, state: State, way: Floats) -> None:
        """Do nothing: the sliding step takes the velocities before the kick."""

    def prepare(self, state: State, kick: Kick) -> None:
        for follower in self.followers:
            follower(state)
