"""Kelvin-Voigt damping of elements: the force -eta K v, with the K of their present position where they rotate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.operators import Damped, FusedOperator, Inelastic, LayerOperator
from ruptfx.input.fields import OF_VISCOSITY
from ruptfx.interfaces.mechanisms import Floats, Mechanism
from ruptfx.interfaces.mechanisms._inserted import InsertedForce

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.stepped_nodes import Kick, SteppedNodes
    from ruptfx.interfaces.mechanisms.system import System


class KelvinVoigt(Mechanism):
    """Damping in the sweep of the bulk kernel where that covers all elements, else by an operator of its own."""

    order = 20
    adjoint = True

    def __init__(self, model: System) -> None:
        super().__init__(model)
        assert model.viscosity is not None
        self._viscosity, self._force = model.viscosity, np.zeros(0)
        self._before = np.zeros(0)  # velocity before the kick in cracked bodies, not all of whose nodes are kicked
        operator = model.operator
        if self._viscosity.everywhere and isinstance(operator, FusedOperator) and operator.damps:
            self.damped = Damped(self._viscosity.eta, self._force, np.zeros(1))

    @classmethod
    def present(cls, model: System) -> bool:
        return model.viscosity is not None and not ViscousLayer.present(model)

    def nodes(self) -> NDArray[np.bool_]:
        return super().nodes() if self.damped is not None else self._viscosity.nodes

    def obstacle_to_substeps(self) -> str:
        operator = self.model.case.operator
        return (
            f"damping.kelvin_voigt: operator = '{operator}' damps in equal steps only; use operator = 'matrix_free', "
            "remove the damping, or use stepper.kind = 'leapfrog'"
        )

    def bind(self, stepped: SteppedNodes) -> None:
        self._stepped, self._force = stepped, np.zeros(len(self.model.mass))
        if self.damped is not None:
            self.damped.force = self._force
        viscous = np.flatnonzero(np.repeat(self._viscosity.nodes, self.model.components))
        self._dofs: NDArray[np.int64] = stepped.dofs if self.damped is not None else viscous
        every = len(self._dofs) == len(self._force)
        self._here: NDArray[np.int64] | slice = slice(None) if every else self._dofs
        self._places = places = stepped.among(self._dofs)
        self._among: NDArray[np.int64] | slice = slice(None) if len(places) == len(stepped.dofs) else places

    def add_first(self, state: State, kick: Kick) -> None:
        # Sums at a node have the same order on any number of ranks if those of all elements come first.
        if self._viscosity.everywhere and self.damped is None:
            self._add(state)

    def add_with_elements(self, state: State, kick: Kick) -> None:
        if not self._viscosity.everywhere:
            self._add(state)

    def _add(self, state: State) -> None:
        force = self._force
        if self._viscosity.everywhere:
            self._before = state.velocity.astype(float)
        self._stepped.clear(self._dofs, force)
        self._viscosity.add_force(state.displacement, state.velocity, force)
        self._stepped.add_damping(self._dofs, self._viscosity.eta, force, state.force)
        if self._viscosity.rotates:
            state.fields[OF_VISCOSITY] = viscous_force = force.copy()
            if not self._viscosity.everywhere:  # elements of other ranks have the same nodes
                self.model.layout.sum_shared(viscous_force)

    def outside_energy(self) -> list[tuple[NDArray[np.int64] | slice, Floats]]:
        if self._viscosity.everywhere and self.damped is None:  # the stepper knows what was added first
            return []
        return [(self._here, self._force[self._here].copy())]

    def account(self, state: State, kick: Kick) -> None:
        if self.damped is None:
            own = self._viscosity.everywhere
            power = self._stepped.damping_power(
                self._dofs, self._force, state.velocity, self._before if own else self._stepped.velocity_before,
                self._dofs if own else self._places,
            )  # fmt: skip
            state.energy["damping"] -= power * kick.clock.kick
            return
        only = self._stepped.only
        nodes, among = (self._here, self._among) if only is None else (only, only)
        before = self._stepped.velocity_before[among]
        lost = float(self.damped.lost[0]) - float(self._force[nodes] @ (0.5 * (before + state.velocity[nodes])))
        self.damped.lost[:] = 0
        self._force[nodes] = 0
        state.energy["damping"] += lost * kick.clock.kick


class ViscousLayer(InsertedForce):
    """Damping of some elements in the sweep of the bulk kernel, block by block before their elastic force.

    The kernel has one such force: in cases with a material with memory, `KelvinVoigt` damps the layer.
    """

    order = 20
    adjoint = local_steps = True

    def __init__(self, model: System) -> None:
        super().__init__(model)
        assert model.viscosity is not None
        assert isinstance(model.viscosity.operator, LayerOperator)
        layer = model.viscosity.operator.viscous_sweep(model.viscosity.eta)
        self.inelastic = Inelastic([layer] if model.viscosity.nodes.any() else [], self._force, np.zeros(2))

    @classmethod
    def present(cls, model: System) -> bool:
        viscosity = model.viscosity
        return (
            viscosity is not None and not viscosity.everywhere and not viscosity.rotates
            and isinstance(model.operator, FusedOperator) and isinstance(viscosity.operator, LayerOperator)
            and not any(material.has_memory() for material in model.materials)
        )  # fmt: skip

    def smooth_nodes(self) -> NDArray[np.bool_]:
        assert self.model.viscosity is not None
        return self.model.viscosity.nodes

    def bind(self, stepped: SteppedNodes) -> None:
        super().bind(stepped)
        self._among = stepped.among(self._dofs)

    def add_first(self, state: State, kick: Kick) -> None:
        assert self.inelastic is not None
        self.inelastic.states = [state.velocity] * len(self.inelastic.sweeps)

    def account(self, state: State, kick: Kick) -> None:
        assert self.inelastic is not None
        stepped, power = self._stepped, 0.5 * float(self.inelastic.power.sum())
        power += stepped.damping_power(
            self._dofs, self._force, state.velocity, stepped.velocity_before, self._among
        )  # fmt: skip
        state.energy["damping"] -= power * kick.clock.kick
        self.inelastic.power[:] = 0
        stepped.clear(self._dofs, self._force)
