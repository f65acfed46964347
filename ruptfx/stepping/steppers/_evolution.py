"""The state of friction laws as variables of a differential equation in time, for Runge-Kutta steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ruptfx.interfaces.faults.fields import Heating
from ruptfx.interfaces.faults.projection import StrengthAtState, parameters_as_symbols
from ruptfx.laws.friction import FrictionLaw, LawState
from ruptfx.laws.friction.in_fields import InFields, rate_of
from ruptfx.laws.friction.rate_and_state_base import RateAndState
from ruptfx.platform.codegen.tracing import constant, derivative, record, symbol, to_numpy
from ruptfx.stepping.steppers.quasi_static import slip_to_resolve

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.system import System

PARTS_TO_RESOLVE = 50.0  # shortest length of a law over the slip that `slip_to_resolve` returns


class Evolution(Protocol):
    """State variables of the points of one fault and their rates.

    Attributes
    ----------
    columns : int
        Number of variables.
    D_c : ndarray, shape (n,)
        Slip over which the strength changes [m], for tolerances.
    """

    columns: int
    D_c: np.ndarray

    def begin(self, state: State, dt: float) -> None:
        """Prepare a step of the length `dt` [s] from a state; collective."""
        return

    def variables(self, state: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the variables of a state, shape (n, columns)."""
        ...

    def state(self, variables: np.ndarray) -> LawState:
        """Return the state of variables, the inverse of `variables`."""
        ...

    def rates(self, state: LawState, slip_rate: np.ndarray, normal_stress: np.ndarray) -> np.ndarray:
        """Return the time derivatives of the variables, shape (n, columns)."""
        ...

    def errors(
        self, variables: np.ndarray, wrong: np.ndarray, slip_rate: np.ndarray, normal_stress: np.ndarray
    ) -> np.ndarray:
        """Return relative errors, shape (n, columns), of absolute errors `wrong` of the variables."""
        ...


class Age(Evolution):
    """The logarithm of an age theta of which the law knows the rate; its absolute error is tolerated."""

    columns = 1

    def __init__(self, law: RateAndState, points: int) -> None:
        self._law = law
        self.D_c = np.broadcast_to(law.D_c, points)

    def variables(self, state: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.log(state["theta"])[:, None]

    def state(self, variables: np.ndarray) -> LawState:
        return {"theta": np.exp(variables[:, 0])}

    def rates(self, state: LawState, slip_rate: np.ndarray, normal_stress: np.ndarray) -> np.ndarray:
        return np.asarray(self._law.age_rate(state["theta"], slip_rate) / state["theta"])[:, None]

    def errors(
        self, variables: np.ndarray, wrong: np.ndarray, slip_rate: np.ndarray, normal_stress: np.ndarray
    ) -> np.ndarray:
        return wrong


class AnyState(Evolution):
    """The state variables of any law; their rates are the derivatives of `FrictionLaw.advance` at the step zero.

    The errors are those of the friction coefficient.
    """

    def __init__(self, law: FrictionLaw, D_c: np.ndarray) -> None:
        self._law, self.D_c = law, D_c
        self._names = list(law.all_state_fields())
        self.columns = len(self._names)
        values, traced = parameters_as_symbols(law, "p_")
        state = {name: symbol(f"s_{name}") for name in self._names}
        rate, stress, dt = symbol("slip_rate"), symbol("normal_stress"), symbol("since")
        later: LawState = record(traced.advance, state, rate, stress, dt)
        rates = {name: derivative(later[name] + constant(0), dt) for name in self._names}
        items = ["slip_rate", "normal_stress", "since", *values, *(f"s_{name}" for name in self._names)]
        self._values, self._function = values.values(), to_numpy(rates, items)

    def variables(self, state: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.array([state[name] for name in self._names]).reshape(self.columns, len(self.D_c)).T

    def state(self, variables: np.ndarray) -> LawState:
        return {name: variables[:, k] for k, name in enumerate(self._names)}

    def rates(self, state: LawState, slip_rate: np.ndarray, normal_stress: np.ndarray) -> np.ndarray:
        function = self._function(slip_rate, normal_stress, 0.0, *self._values, *state.values())
        columns = np.zeros((len(slip_rate), self.columns))
        for k, column in enumerate(function):
            columns[:, k] = column
        return columns

    def errors(
        self, variables: np.ndarray, wrong: np.ndarray, slip_rate: np.ndarray, normal_stress: np.ndarray
    ) -> np.ndarray:
        values = np.zeros_like(wrong)
        if self.columns:
            with np.errstate(all="ignore"):  # trial steps that are too long
                first, last = (
                    np.asarray(self._law.strength(slip_rate, normal_stress, self.state(each)))
                    for each in (variables, variables + wrong)
                )
                values[:, 0] = np.abs(first - last) / normal_stress
        return values


class WithFields(Evolution):
    """The states of a law in the fields of an interface: those of the law, the heat of a step and its time.

    The fields follow from the heat and the time by their exact solutions (`FaultFields.values`). Their tolerated error
    is that of a constant power over the step, although the power is linear, over the normal stress.
    """

    def __init__(self, fault: Fault, inner: Evolution) -> None:
        self._fault, self._inner = fault, inner
        self._strength = StrengthAtState(fault.friction)
        self.columns, self.D_c = inner.columns + 2, inner.D_c

    def begin(self, state: State, dt: float) -> None:
        self._memory, self._time = state.fluids[self._fault.name], state.time
        self._begun = {name: values.copy() for name, values in state.faults[self._fault.name].items()}
        self._fault.fields.prepare(self._memory, state.time, dt)

    def variables(self, state: Mapping[str, np.ndarray]) -> np.ndarray:
        inner = self._inner.variables(state)
        return np.column_stack([inner, np.zeros((len(inner), 2))])

    def _heating(self, variables: np.ndarray) -> Heating:
        elapsed = float(variables[:, -1].max(initial=0.0))
        aged = self._fault.fields.ageing(self._memory, self._begun, self._inner.state(variables[:, :-2]))
        return Heating(self._memory["power"][:, 0], variables[:, -2], elapsed, *aged)

    def state(self, variables: np.ndarray) -> LawState:
        heating = self._heating(variables)
        fields = self._fault.fields.values(self._memory, self._time, heating)
        step = heating.elapsed or 1.0
        rates = {rate_of(name): (values - self._begun[name]) / step for name, values in fields.items()}
        known = {**self._inner.state(variables[:, :-2]), **fields, **rates}
        if self._fault.fields.is_heated:
            known["frictional_heat"] = self._begun["frictional_heat"] + heating.heat
        return known

    def rates(self, state: LawState, slip_rate: np.ndarray, normal_stress: np.ndarray) -> np.ndarray:
        inner = self._inner.rates(state, slip_rate, normal_stress)
        power = self._strength(slip_rate, normal_stress, state)[0] * slip_rate
        return np.column_stack([inner, power, np.ones_like(power)])

    def errors(
        self, variables: np.ndarray, wrong: np.ndarray, slip_rate: np.ndarray, normal_stress: np.ndarray
    ) -> np.ndarray:
        inner = self._inner.errors(variables[:, :-2], wrong[:, :-2], slip_rate, normal_stress)
        heating = self._heating(variables)
        uncertain = self._fault.fields.uncertainty(self._memory, heating) / normal_stress
        return np.column_stack([inner, uncertain, np.zeros_like(uncertain)])


def evolution_of(model: System, fault: Fault) -> Evolution:
    """Return the evolution of the state of a fault; collective."""
    evolution = _evolution_of_law(model, fault)
    return WithFields(fault, evolution) if fault.fields else evolution


def _evolution_of_law(model: System, fault: Fault) -> Evolution:
    law, points = fault.friction, len(fault.interface.plus)
    if isinstance(law, InFields) and has_age(law.law):
        law = law.law
    if has_age(law):
        assert isinstance(law, RateAndState)
        return Age(law, points)
    return AnyState(law, np.full(points, PARTS_TO_RESOLVE * slip_to_resolve(model, fault)))


def has_age(law: FrictionLaw) -> bool:
    """Return whether the only state of a law is an age, of which it knows the rate."""
    return "age" in law.offers and set(law.state_fields) == {"theta"} and "law" not in type(law).model_fields
