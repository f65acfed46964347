"""Loading in stages: press, hold, shear, with the same bodies but other boundaries and damping.

Time, state, records and checkpoints are continuous. Boundaries use the time since the start of their stage. A boundary
of the previous stage with another amount continues from its value: over its ramp it changes from the old
velocity or traction to the new one. Implicit steps end at the end of a stage, explicit ones with the first step beyond
it; as a traction acts from half a step earlier, that step is shared between the two stages.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.boundaries import Action, Boundary, Force, PrescribedMotion
from ruptfx.bodies.boundaries.histories import ramp
from ruptfx.bodies.boundaries.loading import Loads
from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.bodies.state import State
from ruptfx.interfaces.mechanisms import mechanisms_of
from ruptfx.run.model import Model
from ruptfx.run.viscous_layer import viscous_layer
from ruptfx.stepping.steppers import Motion, StagedMotion, sync_bodies

Floats = NDArray[np.float64]


def bind(model: Model) -> Motion:
    """Return the stepper of a case, through all its stages if it has some; collective.

    Raises
    ------
    CaseError
        If a stage does not allow the time step.
    """
    return Staged(model) if model.case.stages else model.case.stepper.bind(model)


def loads_of(model: Model, motion: Motion) -> list[tuple[float, Loads]]:
    """Return the loads of every stage and when it ends [s]; without stages those of the run."""
    return motion.ends if isinstance(motion, Staged) else [(model.case.duration, model.loads)]


class Staged:
    """Stepper of a case through its stages; a fixed step is the smallest that the stages allow.

    Attributes
    ----------
    starts : list of float
        When the stages begin [s].
    """

    def __init__(self, model: Model) -> None:
        self.starts = np.cumsum([0.0] + [stage.duration for stage in model.case.stages[:-1]]).tolist()
        self._models: list[Model] = []
        for number, start in enumerate(self.starts):
            self._models.append(_in_stage(model, number, start, self._models[-1].loads if number else None))
        for view, end in zip(self._models, self.starts[1:], strict=False):  # the last one acts for ever
            view.loads.end = end
        self._stepper = model.case.stepper.fixed(min(self._models, key=stable_time_step))
        self._motion, self._number = self._bind(0), 0
        self.dt, self.collective = self._motion.dt, self._motion.collective

    @property
    def ends(self) -> list[tuple[float, Loads]]:
        """End of every stage [s] with its loads."""
        value = zip(self.starts, self._models, strict=True)
        return [(start + view.case.stages[number].duration, view.loads) for number, (start, view) in enumerate(value)]

    def step(self, state: State) -> None:
        motion = self._of(state)
        try:
            motion.step(state)
        finally:  # collective: a rank with an error must take part
            if self._stage_of(state) > self._number:
                motion.leave(state)
                self._of(state).enter(state)
            self.collective = self._motion.collective

    def energies(self, state: State) -> dict[str, float]:
        return self._of(state).energies(state)

    def advance_bodies(self, state: State) -> None:
        """Compute displacement and velocity that steps of the present stage have deferred; collective."""
        sync_bodies(self._of(state), state)

    def _stage_of(self, state: State) -> int:
        """Return the stage of the next step."""
        return int(np.searchsorted(self.starts, state.time + 1e-6 * self.dt, side="right")) - 1

    def _of(self, state: State) -> StagedMotion:
        """Return the motion of the next step.

        Its arrays are created at the start of its stage, because the bulk kernel stores those of one motion only.
        """
        number = self._stage_of(state)
        if number > self._number:
            self._motion, self._number = self._bind(number), number
        return self._motion

    def _bind(self, number: int) -> StagedMotion:
        return cast(StagedMotion, self._stepper.bind(self._models[number]))


def _in_stage(model: Model, number: int, start: float, before: Loads | None) -> Model:
    """Return a view of the model with the boundaries and the damping of a stage."""
    stage, case = model.case.stages[number], model.case
    view = copy.copy(model)
    changes = {"damping": stage.damping, "boundaries": stage.boundaries}
    view.case = case.model_copy(update={key: value for key, value in changes.items() if value is not None})
    boundaries = case.boundaries if stage.boundaries is None else stage.boundaries
    key = "boundaries" if stage.boundaries is None else f"stages.{number}.boundaries"
    view.loads = StageLoads(view, boundaries, key, start, before)
    for each in view.attachments:
        view.loads.add_dashpot(each.dashpot())
    view.viscosity = viscous_layer(view, view.case)
    view.mechanisms = mechanisms_of(view)
    return view


class StageLoads(Loads):
    """Boundaries of a stage, which continue from the values of the previous stage.

    Parameters
    ----------
    model, boundaries, key :
        As for `Loads`.
    start : float
        Start of the stage [s].
    before : Loads, optional
        Loads of the previous stage.
    """

    def __init__(
        self, model: Model, boundaries: Sequence[Boundary], key: str, start: float, before: Loads | None
    ) -> None:
        self.start, self._before = start, before
        super().__init__(model, boundaries, key)
        self.ended = [] if before is None else before.forces

    def mean_factors(self, time: float, since: float) -> list[float | Floats]:
        """Return the factors in an explicit step, shared with the previous stage around its end.

        A step acts from half a step before its time to half a step after it; if the first one of a stage is late,
        the part of the previous stage is negative. Thus constant forces give the impulse of their duration.
        """
        own = 0.5 + (time - self.start) / since if time - self.start < (1 - 1e-6) * since else 1.0
        shares = [*(own for _ in self.forces), *(1 - own for _ in self.ended)]
        return [
            share * force.factor(time) if share else 0.0
            for share, force in zip(shares, (*self.forces, *self.ended), strict=True)
        ]

    def act(self, boundary: Boundary, key: str) -> list[Action]:
        """Return the delayed action of a boundary, and the decaying one of its predecessor."""
        result, start = boundary.act(self, key), self.start
        before = [] if self._before is None else self._before.actions_of(boundary)
        speed = sum(old.motion.velocity(start) for old in before if old.motion is not None)
        rise = getattr(boundary, "ramp", 0.0)
        motion = None if result.motion is None else _following(result.motion, start, speed, rise)
        force = None if result.force is None else replace(result.force, factor=_shifted(result.force.factor, start))
        rests = [
            Action(force=Force(old.force.dofs, old.force.factor(start) * old.force.values, _ending(start, rise)))
            for old in before if old.force is not None
        ]  # fmt: skip
        return [replace(result, motion=motion, force=force), *rests]


def _shifted(course: Callable[[float], float | Floats], start: float) -> Callable[[float], float | Floats]:
    return lambda time: course(_since(start, time))


def _ending(start: float, rise: float) -> Callable[[float], float]:
    """Return a factor that falls from one to zero over a ramp [s] from a time on [s]."""
    return lambda time: 1 - ramp(_since(start, time), rise)


def _following(motion: PrescribedMotion, start: float, speed: float | Floats, rise: float) -> PrescribedMotion:
    """Return a motion from a time on, plus a speed [m/s] that decays over its ramp."""

    def rest(time: float) -> float | Floats:
        """Return the displacement added by the decaying speed [m]."""
        return speed * (time - 0.5 * time**2 / rise if time < rise else 0.5 * rise)

    return PrescribedMotion(
        motion.dofs,
        lambda time: motion.displacement(_since(start, time)) + rest(_since(start, time)),
        lambda time: motion.velocity(_since(start, time)) + speed * (1 - ramp(time - start, rise)),
        lambda time: motion.acceleration(_since(start, time)) - (speed / rise if _since(start, time) < rise else 0.0),
    )


def _since(start: float, time: float) -> float:
    """Return the time since the start of a stage, not negative by rounding."""
    return max(time - start, 0.0)
