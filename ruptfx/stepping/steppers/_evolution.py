"""The state of friction laws as variables of a differential equation in time, for Runge-Kutta steps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ruptfx.interfaces.faults.projection import parameters_as_symbols
from ruptfx.laws.friction import FrictionLaw, LawState
from ruptfx.laws.friction.rate_and_state_base import RateAndState
from ruptfx.platform.codegen.tracing import constant, derivative, record, symbol, to_numpy
from ruptfx.stepping.steppers.quasi_static import slip_to_resolve

if TYPE_CHECKING:
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


class Age:
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


class AnyState:
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


def evolution_of(model: System, fault: Fault) -> Evolution:
    """Return the evolution of the state of a fault; collective."""
    law, points = fault.friction, len(fault.interface.plus)
    if has_age(law):
        assert isinstance(law, RateAndState)
        return Age(law, points)
    return AnyState(law, np.full(points, PARTS_TO_RESOLVE * slip_to_resolve(model, fault)))


def has_age(law: FrictionLaw) -> bool:
    """Return whether the only state of a law is an age, of which it knows the rate."""
    return "age" in law.offers and set(law.state_fields) == {"theta"} and "law" not in type(law).model_fields
