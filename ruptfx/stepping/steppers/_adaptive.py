"""Steps of adaptive length: the one loop that repeats a step until it converges and is accurate enough."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System

Result = TypeVar("Result")
LEAST_ERROR = 1e-12  # over the tolerance; smaller ones make no longer steps


class AdaptiveMotion(Generic[Result]):
    """Steps bound to a model; the length of the next one is `State.numbers["dt"]`.

    A step without a result is halved. One with an error above its tolerance is repeated with a length times
    safety error^-power, which also gives the length of the step after an accepted one.

    Attributes
    ----------
    model : System
    dt : float
        Length of the first step [s].
    smallest, greatest : float
        Bounds of lengths that follow errors [s].
    safety : float
    powers : (float, float)
        Of the error, for a repeated step and for the next one.
    factors : (float, float)
        Bounds of the ratio of lengths.
    """

    collective = True
    model: System
    dt: float
    greatest: float
    smallest: float = 0.0
    safety: ClassVar[float] = 0.9
    powers: ClassVar[tuple[float, float]] = (0.2, 0.2)
    factors: ClassVar[tuple[float, float]] = (0.2, 5.0)

    def step(self, state: State) -> None:
        """Make one step that converged and is accurate enough; collective.

        Raises
        ------
        ConvergenceError
            On all ranks, with an unchanged state: no step is short enough.
        """
        self.begin(state)
        planned, halvings = min(state.numbers.get("dt", self.dt), self.greatest), 0
        dt = longest = self.longest(state, planned)
        while True:
            result = self.attempt(state, dt, halvings)
            if result is None:
                dt, halvings = self.rounded(0.5 * dt), halvings + 1
                continue
            error = self.error(state, result)
            if self.accepts(state, dt, result, error):
                break
            dt = self.scaled(dt, error, self.powers[0])
        self.commit(state, result)
        following = self.following(dt, error, result)
        # A step that ends where loads change does not shorten later ones.
        state.numbers["dt"] = max(following, planned) if dt == longest < planned else following

    def begin(self, state: State) -> None:
        """Prepare the attempts of a step; collective."""

    def longest(self, state: State, planned: float) -> float:
        """Return the length of the first attempt [s]."""
        return self.model.loads.shortened(state.time, planned)

    def attempt(self, state: State, dt: float, halvings: int) -> Result | None:
        """Return the result of a step, None where a shorter step may have one; collective.

        Parameters
        ----------
        halvings : int
            Number of halvings of this step so far.

        Raises
        ------
        ConvergenceError
            On all ranks: none, and the step has been halved often enough.
        """
        raise NotImplementedError

    def error(self, state: State, result: Result) -> float:
        """Return the error of a step over its tolerance; collective."""
        return 0.0

    def accepts(self, state: State, dt: float, result: Result, error: float) -> bool:
        """Return whether a step is not repeated; collective."""
        return error <= 1

    def commit(self, state: State, result: Result) -> None:
        """Set the state at the end of a step, and count energies; collective."""

    def following(self, dt: float, error: float, result: Result) -> float:
        """Return the length of the step after an accepted one [s]."""
        return self.scaled(dt, error, self.powers[1])

    def rounded(self, dt: float) -> float:
        """Return a length of a step as it is used [s]."""
        return dt

    def ratio(self, factor: float) -> float:
        """Return a ratio of lengths as it is used."""
        return factor

    def scaled(self, dt: float, error: float, power: float) -> float:
        """Return the length of a step after one with an error over its tolerance [s]."""
        least, largest = self.factors
        factor = min(max(self.safety * max(error, LEAST_ERROR) ** -power, least), largest)
        return self.rounded(min(max(dt * self.ratio(factor), self.smallest), self.greatest))
