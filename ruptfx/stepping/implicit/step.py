"""One implicit step to be solved: the residual of the forces at a displacement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ruptfx.bodies.state import FaultState, State
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.projection import ProjectionError
from ruptfx.interfaces.mechanisms import ImplicitForce, Reaction, StepEnd
from ruptfx.platform import parallel
from ruptfx.stepping.implicit.response import Response
from ruptfx.stepping.implicit.solution import Rates

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.interfaces.mechanisms.system import System
    from ruptfx.stepping.implicit.forces import Forces
    from ruptfx.stepping.implicit.response import FaultResponse
    from ruptfx.stepping.implicit.tangent import Tangent

MAX_OUTER = 100
FAR = 1e-7  # largest residual by rounding of displacements, over the forces


class Terms(Protocol):
    """Parts of the residual that all steps have in common.

    Attributes
    ----------
    answers : dict of str to FaultResponse
        Tractions for a jump, by fault.
    easings : tuple of float
        Factors of the penalty of multipliers, to be tried in turn.
    driven : ndarray of bool, shape (nodes * components,)
        Mask of the prescribed displacements.
    mechanisms : list of ImplicitForce
        Those with forces that depend on the displacement.
    """

    model: System
    answers: Mapping[str, FaultResponse]
    easings: tuple[float, ...]
    driven: np.ndarray
    forces: Forces
    tangent: Tangent
    mechanisms: Sequence[ImplicitForce]

    def body_stiffness(self, interface: Interface, rates: Rates | None) -> np.ndarray:
        """Return the stiffness of the bodies at the points of an interface."""


class Step:
    """One step to be solved: R(u) and its data.

    Attributes
    ----------
    driven : ndarray, shape (nodes * components,)
        Displacement with driven edges at the end of their motion [m].
    key : (float, float, float)
        c_M, c_C and the factor of the penalty, on which the matrix of closed, stuck interfaces depends.
    multipliers : dict of str to FaultState
        Fields with the tractions of the last outer iteration.
    displacement, residual, internal, responses, reactions, scale, round_off, error
        Results of the last evaluation; `residual` is that of the unknowns, zero at copies of tied nodes, and NaN where
        a law failed on this rank, which is `error`.
        `round_off` [N] is the part of the residual caused by rounding of large displacements.
    """

    def __init__(
        self, equilibrium: Terms, state: State, dt: float, rates: Rates | None, load: np.ndarray, easing: float
    ) -> None:
        self._equilibrium, self._state = equilibrium, state
        self.dt, self.time, self.rates, self._load = dt, state.time + dt, rates, load
        self.key = (*((rates.mass, rates.damping) if rates else (0.0, 0.0)), easing)
        self.driven = equilibrium.model.loads.moved(state.displacement, state.time, self.time)
        self.multipliers: dict[str, FaultState] = dict(state.faults)
        self._body = {
            fault.name: easing * equilibrium.body_stiffness(fault.interface, rates)
            for fault in equilibrium.model.faults
        }
        self._stiff_area = {
            fault.name: fault.interface.owned[:, None] * fault.interface.weight[:, None]
            * np.diagonal(equilibrium.answers[fault.name].stuck(self._body[fault.name]), axis1=1, axis2=2)
            for fault in equilibrium.model.faults
        }  # fmt: skip
        self.displacement = self.residual = self.internal = np.zeros(0)
        self.responses: dict[str, Response] = {}
        self.reactions: list[tuple[ImplicitForce, StepEnd, Reaction]] = []
        self.scale = self.round_off = 0.0
        self._least: float | None = None
        self.error: ProjectionError | None = None

    def enough(self, tolerance: float) -> float:
        """Return the tolerance of the norm of the residual [N] for a tolerance relative to the forces."""
        return max(tolerance * self.scale, self.round_off)

    @property
    def tangents(self) -> dict[str, np.ndarray]:
        return {name: response.tangent for name, response in self.responses.items()}

    def stuck(self) -> dict[str, np.ndarray]:
        """Return dT / d[u] by fault [Pa/m] for closed interfaces that do not slide; it depends on `key` only."""
        return {name: answer.stuck(self._body[name]) for name, answer in self._equilibrium.answers.items()}

    def update_multipliers(self) -> None:
        """Set the multipliers to the last tractions; earlier evaluations become invalid."""
        self.multipliers = {name: response.state for name, response in self.responses.items()}
        self.displacement = np.zeros(0)

    def multipliers_converged(self) -> bool:
        """Return whether the multipliers have converged to the tractions; collective."""
        model, settled = self._equilibrium.model, True
        for fault in model.faults:
            tolerance = fault.contact.multiplier_tolerance()
            if tolerance is None:
                continue
            now, before = self.responses[fault.name].state, self.multipliers[fault.name]
            ours, theirs = (tractions(fault, fields) for fields in (now, before))
            change = np.abs(ours - theirs).max(initial=0)
            size = max(np.abs(fault.normal_stress_0).max(initial=0), np.abs(ours).max(initial=0))
            if fault.cohesion is not None:  # before a load arrives only rounding loads an interface that holds tension
                size = max(size, np.max(fault.cohesion.f_t, initial=0.0), np.max(fault.cohesion.c, initial=0.0))
            change, size = (parallel.largest(model.comm, value) for value in (change, size))
            settled = settled and change <= tolerance * size
        return settled

    def respond(self, jumps: Mapping[str, np.ndarray]) -> None:
        """Evaluate all faults at given jumps [m], shape (n, local) each.

        Raises
        ------
        ProjectionError
            On the rank of a point without an admissible traction.
        """
        for fault in self._equilibrium.model.faults:
            fields, last = self.multipliers[fault.name], self.responses.get(fault.name)
            self.responses[fault.name] = self._equilibrium.answers[fault.name](
                self._state.faults[fault.name], jumps[fault.name], self.dt,
                self._state.numbers.get("dt_before", 0.0), self.time,
                (fields["normal_stress"], fault.components(fields, "shear_traction")), self._body[fault.name],
                last.state if last else None,
            )  # fmt: skip

    def at_interfaces(self, jumps: Mapping[str, np.ndarray]) -> tuple[float, float]:
        """Return squares of norms over the points of this rank [N2]: of tractions, and of stiffness times jumps.

        Tractions are the stiffness times the difference of jump and slip: the latter determines their rounding.
        """
        carried = jumped = 0.0
        for fault in self._equilibrium.model.faults:
            area = (fault.interface.owned * fault.interface.weight)[:, None]
            carried += float(np.sum((area * tractions(fault, self.responses[fault.name].state)) ** 2))
            jumped += float(np.sum((self._stiff_area[fault.name] * jumps[fault.name]) ** 2))
        return carried, jumped

    def evaluate(self, u: np.ndarray) -> None:
        """Evaluate residual, internal force and responses at a displacement; collective."""
        equilibrium, model = self._equilibrium, self._equilibrium.model
        self.displacement, self.error = u.copy(), None
        elastic, reduce = -model.internal_force(u), model.layout.reduce_tied
        parts = [elastic, self._load]
        if self.rates:
            parts.append(model.mass * self.rates.acceleration_of(u))
            parts.append(equilibrium.forces.damping_force(self.rates.velocity_of(u)))
        self.internal = elastic.copy()
        end = StepEnd(self.displacement, self.dt, self.rates.weights if self.rates else None)
        self.reactions = [(each, end, each.respond(self._state, end)) for each in equilibrium.mechanisms]
        for _, _, reaction in self.reactions:
            self.internal.reshape(model.nodes, -1)[reaction.nodes] -= reaction.force
        jumps = {fault.name: fault.interface.jump(u) for fault in model.faults}
        try:
            self.respond(jumps)
            for fault in model.faults:
                fault.assemble(self.responses[fault.name].traction, self.internal)
        except ProjectionError as error:
            self.error = error
            self.internal = np.full_like(u, np.nan)  # SNES takes a shorter step, on all ranks
        self.residual = reduce(self.internal - self._load + sum(parts[2:], np.zeros_like(u)))
        driven = equilibrium.driven
        if self.error is None:
            self.residual[driven] = equilibrium.tangent.unit * (u - self.driven)[driven]
            self.residual.reshape(model.nodes, -1)[model.layout.copies] = 0.0
        squares = [model.layout.owned_dot(part, part) for part in map(reduce, parts)]
        stiff = equilibrium.tangent.diagonal * u
        carried, jumped = (0.0, 0.0) if self.error else self.at_interfaces(jumps)
        *summed, stiffest, jumped = parallel.total(
            model.comm, [*squares, carried, model.layout.owned_dot(stiff, stiff), jumped]
        )
        self.scale = float(np.sqrt(max(summed)))
        rounding = float(np.finfo(float).eps * (20 * np.sqrt(stiffest) + 2 * np.sqrt(jumped)))
        # Rounding of the start always counts, also without forces, as in a body that follows its driven
        # edge. That of later increments counts in proportion to the forces: unsupported bodies fly far.
        self._least = rounding if self._least is None else self._least
        self.round_off = max(self._least, min(rounding, FAR * self.scale))


def tractions(fault: Fault, fields: FaultState) -> np.ndarray:
    """Return normal stress and shear tractions, shape (n, 1 + tangents) [Pa]."""
    return np.column_stack([fields["normal_stress"], fault.components(fields, "shear_traction")])
