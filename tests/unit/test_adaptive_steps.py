"""Lengths of adaptive steps: halved without a result, repeated after errors, cut where loads change."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from ruptfx.stepping.steppers._adaptive import AdaptiveMotion


class Motion(AdaptiveMotion[float]):
    """Steps of y' = 1 whose results exist up to a length, with errors (length / tolerated)^5."""

    def __init__(self, solvable: float = 10.0, tolerated: float = 10.0, change: float = 10.0) -> None:
        self._solvable, self._tolerated, self.tried = solvable, tolerated, list[float]()
        self.dt, self.greatest = 1.0, 4.0
        loads: Any = SimpleNamespace(shortened=lambda time, dt: min(dt, change - time))
        self.model: Any = SimpleNamespace(loads=loads)

    def attempt(self, state: Any, dt: float, halvings: int) -> float | None:
        self.tried.append(dt)
        return None if dt > self._solvable else dt

    def error(self, state: Any, result: float) -> float:
        return float((result / self._tolerated) ** 5)

    def commit(self, state: Any, result: float) -> None:
        state.time += result


def made(motion: Motion, **numbers: float) -> Any:
    """The state after a step."""
    state: Any = SimpleNamespace(time=0.0, numbers=numbers)
    motion.step(state)
    return state


def test_a_step_without_result_is_halved_and_the_next_one_grows_within_its_bounds() -> None:
    motion = Motion(solvable=0.3)
    assert made(motion).numbers["dt"] == 1.25 and motion.tried == [1.0, 0.5, 0.25]  # five times as long
    assert made(Motion()).numbers["dt"] == 4.0


def test_lengths_follow_the_fifth_root_of_the_error() -> None:
    motion = Motion(tolerated=0.5)
    state = made(motion)  # error 32: 0.9 / 2 of the length, whose error is 0.9^5
    assert motion.tried == pytest.approx([1.0, 0.45]) and state.numbers["dt"] == pytest.approx(0.45)
    motion = Motion(tolerated=0.01)  # not below a fifth at once
    made(motion)
    assert motion.tried == pytest.approx([1.0, 0.2, 0.04, 0.009])


def test_a_step_that_ends_where_loads_change_does_not_shorten_the_next_one() -> None:
    motion = Motion(tolerated=1.0, change=0.1)
    state = made(motion, dt=0.8)
    assert motion.tried == [0.1] and state.time == 0.1 and state.numbers["dt"] == 0.8
