"""Implicit second-order steps: generalized-alpha with Newmark, HHT and average acceleration as choices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.input.quantities import at_least
from ruptfx.input.units import Duration, Positive
from ruptfx.laws.contact import Way
from ruptfx.platform import parallel
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.implicit.options import PetscOptions
from ruptfx.stepping.implicit.solution import Rates
from ruptfx.stepping.steppers import Stepper
from ruptfx.stepping.steppers._adaptive import AdaptiveMotion

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.mechanisms.system import System

SchemeName = Literal["generalized_alpha", "average_acceleration", "newmark", "hht"]


class GeneralizedAlpha(Stepper):
    """M a(n+1-alpha_m) + (1 - alpha_f) f(n+1) + alpha_f f(n) = 0 with Newmark's rules.

    f are the forces of bodies, damping and interfaces, less the loads. Second order, friction included (`TracedLaw`),
    unconditionally stable: but the step must resolve the motion of interest. Average acceleration conserves the energy;
    the others damp unresolved motion, and the energy budget is in error by that amount. A step that finds no
    equilibrium is halved, and doubled again after it converges well.

    PETSc's TSALPHA2 is the same scheme, but not the engine here. It evaluates forces at the displacement of the stage
    n+1-alpha_f, where an interface with memory has no defined traction: friction is advanced from step to step, and
    a traction in between does not belong to the state of the next step. TSALPHA2 also starts with two half steps, and
    again after every rejected one, and each would require a reset of the friction history. The
    weighted sum of tractions at both ends needs neither. `petsc_ts` nevertheless uses it, with stage tractions.
    Source: Newmark (1959); Hilber, Hughes and Taylor (1977); Chung and Hulbert (1993).
    """

    time_schemes: ClassVar[tuple[Way, ...]] = ("implicit",)
    conserving: ClassVar[dict[str, object] | None] = {"scheme": "average_acceleration"}
    offers = Stepper.offers | {"ties", "stages", "fracture", "attachments", "memory"}
    closure: ClassVar[float] = 0.01
    why_open: ClassVar[str] = "the default scheme damps what its steps do not resolve"

    scheme: SchemeName = "generalized_alpha"
    """Member of the family."""
    spectral_radius: Annotated[float, Field(ge=0, le=1)] = 0.8
    """Remaining part of unresolved motion after a step: 1 keeps it, 0 removes it; 0.5 to 1 for `hht`."""
    gamma: Annotated[float, Field(ge=0.5, le=1)] | None = None
    """gamma of `newmark`; 0.5 is second order."""
    beta: Positive | None = None
    """beta of `newmark`, at least gamma / 2 for stability; default: (gamma + 0.5)^2 / 4."""
    time_step: Duration | None = None
    """Length of a step; from `courant` without it."""
    courant: Positive = 10.0
    """Time step over the stable explicit one, without `time_step`."""
    halvings: Annotated[int, Field(ge=0, le=30)] = 10
    """Number of halvings of a step before the run stops."""
    petsc_options: PetscOptions = {}
    """Options of PETSc's solvers that replace the defaults."""

    @model_validator(mode="after")
    def _consistent(self) -> GeneralizedAlpha:
        if self.scheme != "newmark" and (self.gamma, self.beta) != (None, None):
            raise ValueError(
                f"gamma and beta belong to scheme = 'newmark'; scheme = '{self.scheme}' has its own; remove them"
            )
        if self.scheme == "hht" and self.spectral_radius < 0.5:
            raise ValueError(f"spectral_radius = {self.spectral_radius:g}: must be 0.5 to 1 with scheme = 'hht'")
        if self.beta is not None and self.beta < 0.5 * (self.gamma or 0.5):
            raise ValueError(
                f"beta = {self.beta:g}: unstable, it must be gamma / 2 = {at_least(0.5 * (self.gamma or 0.5))} or more"
            )
        return self

    def weights(self) -> tuple[float, float, float, float]:
        """Return alpha_m, alpha_f, gamma, beta."""
        rho = self.spectral_radius
        alpha_m, alpha_f = {
            "generalized_alpha": ((2 * rho - 1) / (rho + 1), rho / (rho + 1)), "hht": (0.0, (1 - rho) / (1 + rho)),
        }.get(self.scheme, (0.0, 0.0))  # fmt: skip
        gamma = 0.5 - alpha_m + alpha_f
        if self.scheme == "newmark":
            gamma = 0.5 if self.gamma is None else self.gamma
        beta = 0.25 * (0.5 + gamma) ** 2
        return alpha_m, alpha_f, gamma, beta if self.beta is None else self.beta

    def bind(self, model: System) -> GeneralizedAlphaMotion:
        return GeneralizedAlphaMotion(model.in_steps("implicit"), self, self._step_of(model))

    def fixed(self, model: System) -> GeneralizedAlpha:
        return self.model_copy(update={"time_step": self._step_of(model)})

    def _step_of(self, model: System) -> float:
        return self.time_step or parallel.three_digits(self.courant * stable_time_step(model))


class GeneralizedAlphaMotion(AdaptiveMotion[bool]):
    """Generalized-alpha bound to a model, with the longest steps that have an equilibrium.

    The acceleration is `state.fields["acceleration"]`.
    """

    factors = (0.5, 2.0)

    def __init__(self, model: System, stepper: GeneralizedAlpha, dt: float) -> None:
        self.model, self.dt, self.greatest = model, dt, dt
        self._weights, self._halvings = stepper.weights(), stepper.halvings
        self._equilibrium = Equilibrium(model, stepper.petsc_options)
        self._driven = model.loads.prescribed

    def begin(self, state: State) -> None:
        self._equilibrium.begin(state)
        self._carried = self._equilibrium.forces.carried(state)
        if "acceleration" not in state.fields:
            state.fields["acceleration"] = self._equilibrium.forces.acceleration(-self._carried)

    def attempt(self, state: State, dt: float, halvings: int) -> bool | None:
        try:
            self._advance(state, dt, self._carried)
        except ConvergenceError as error:
            if dt < 1.5 * self.dt * 0.5**self._halvings:
                raise ConvergenceError(
                    f"{error}; the step was halved {self._halvings} times: reduce stepper.time_step, or raise "
                    "stepper.halvings"
                ) from None
            return None
        return True

    def leave(self, state: State) -> None:
        """Store the difference between the acceleration of the present loads and that of the scheme."""
        self._exchange(state, 1.0)

    def enter(self, state: State) -> None:
        """Change the acceleration of the scheme by the jump of loads; equal loads leave it unchanged."""
        self._exchange(state, -1.0)

    def _exchange(self, state: State, sign: float) -> None:
        self._equilibrium.begin(state)
        forces, acceleration = self._equilibrium.forces, state.fields["acceleration"]
        by_forces = forces.acceleration(forces.carried(state))
        acceleration[:] = np.where(self._driven, 0.0, acceleration + sign * by_forces)

    def energies(self, state: State) -> dict[str, float]:
        """Return the energies at the end of the last step [J]."""
        return self.model.energies(state)

    def _advance(self, state: State, dt: float, carried: np.ndarray) -> None:
        """Make one step of size `dt` with the forces `carried` at its beginning."""
        alpha_m, alpha_f, gamma, beta = self._weights
        acceleration = state.fields["acceleration"]
        # Newmark: u = u* + beta dt^2 a, v = v* + gamma dt a with a the new acceleration.
        predictor = state.displacement + dt * state.velocity + (0.5 - beta) * dt**2 * acceleration
        velocity = state.velocity + (1 - gamma) * dt * acceleration
        c_M, c_C = 1 / (beta * dt**2), gamma / (beta * dt)
        # Velocities of driven edges are prescribed: v has their value for any u.
        loads, end = self.model.loads, state.time + dt
        loads.drive(velocity, end)
        velocity -= np.where(self._driven, c_C * (loads.moved(state.displacement, state.time, end) - predictor), 0.0)
        # Divided by 1 - alpha_f, so that the forces at the end of the step have the factor 1.
        rates = Rates(c_M * (1 - alpha_m) / (1 - alpha_f), c_C, predictor, velocity, self._weights)
        added = -(alpha_m * self.model.mass * acceleration + alpha_f * carried) / (1 - alpha_f)
        solution = self._equilibrium.solve(state, dt, rates, added, guess=state.displacement + dt * state.velocity)
        self._equilibrium.forces.count_work(state, solution, rates.velocity_of(solution.displacement), carried)
        state.velocity[:] = rates.velocity_of(solution.displacement)
        acceleration[:] = np.where(self._driven, 0.0, c_M * (solution.displacement - predictor))
        solution.commit(state)
