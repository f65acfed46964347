"""Edges that move as sampled in a table."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import ModelWrapValidatorHandler, PrivateAttr, ValidationInfo, model_validator

from ruptfx.bodies.boundaries import Action, PrescribedMotion
from ruptfx.bodies.boundaries._edge_motion import EdgeMotion
from ruptfx.bodies.boundaries.histories import Samples
from ruptfx.input.number_files import with_file_read
from ruptfx.input.schema import Unit

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

    from ruptfx.bodies.space.edges import Edge


class Moved(EdgeMotion):
    """Edge with sampled motion in one direction, free in the others.

    Monotone piecewise cubics with continuous slope interpolate the samples. A displacement is constant before
    the first and after the last sample, where a slope that is not zero ends in a jump of the velocity; a velocity keeps
    its first and last value. The displacement is measured from its value at time zero.
    Source: Fritsch and Carlson (1980).
    """

    example: ClassVar[str] = (
        '{ kind = "moved", edge = "upper.left", component = "x", quantity = "velocity", '
        "times = [0.0, 2e-6, 5e-6, 1e-5], values = [0.0, 1.0, 2.0, -1.0] }"
    )
    source: ClassVar[str] = "Fritsch and Carlson (1980)"

    quantity: Literal["displacement", "velocity"]
    """Quantity of `values`: displacement [m] or velocity [m/s]."""
    times: Annotated[list[float], Unit("s")] = []
    """At least two, increasing."""
    values: list[float] = []
    """One for each time, in m or m/s."""
    file: str | None = None
    """CSV file with time and value, in place of the lists; relative to the case file. Its header may give units,
    as in `time (us), velocity (m/s)`; without, they are s and m or m/s. The resolved case holds the numbers."""

    _read_from: str = PrivateAttr("")

    @model_validator(mode="wrap")
    @classmethod
    def _from_file(cls, values: object, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        entries = values if isinstance(values, Mapping) else {}
        wanted = "m" if entries.get("quantity") == "displacement" else "m/s"
        called = str(entries.get("quantity"))
        moved = handler(with_file_read(values, info, "times", "time", ("s", wanted), called))
        if isinstance(entries.get("file"), str):
            moved._read_from = entries["file"]
        return moved

    @model_validator(mode="after")
    def _matching(self) -> Moved:
        late = next((b for a, b in pairwise(self.times) if b <= a), None)
        if late is not None:
            raise ValueError(f"times = {late:.6g} s follows a later or equal time; times must increase")
        if len(self.times) < 2 or len(self.values) != len(self.times):
            raise ValueError(
                f"times = {len(self.times)}, values = {len(self.values)} numbers: give at least two times, and one "
                "value for each"
            )
        return self

    @property
    def largest_speed(self) -> float:
        if self.quantity == "velocity":
            return float(np.abs(self.values).max())
        from scipy.interpolate import PchipInterpolator

        course = PchipInterpolator(self.times, self.values)
        turning = course.derivative(2).roots(extrapolate=False)
        times = [*self.times, *turning[np.isfinite(turning)]]
        return float(np.abs(course.derivative()(times)).max())

    @property
    def samples(self) -> Samples:
        motion, moves = self.motion(np.zeros(0, dtype=int)), self.quantity == "velocity"
        course, last = (motion.velocity, 0.0) if moves else (motion.displacement, self.values[-2])
        unit = "m/s" if moves else "m"
        constant_after = self.values[-1] == last
        return Samples(self.times, self.values, unit, lambda time: float(course(time)), constant_after, self._read_from)

    def motion(self, dofs: np.ndarray) -> PrescribedMotion:
        """Return displacement, velocity and acceleration of some degrees of freedom as functions of time."""
        from scipy.interpolate import PchipInterpolator

        first, last = self.times[0], self.times[-1]
        course = PchipInterpolator(self.times, self.values)
        slope = course.derivative()

        def within(time: float) -> float:
            return min(max(time, first), last)

        def value(time: float) -> float:
            return float(course(within(time)))

        def change(curve: PPoly, time: float) -> float:
            return float(curve(time)) if first <= time <= last else 0.0

        if self.quantity == "displacement":
            bend = course.derivative(2)
            return PrescribedMotion(dofs, value, lambda time: change(slope, time), lambda time: change(bend, time))
        area = course.antiderivative()

        def travelled(time: float) -> float:
            return float(area(within(time))) + (time - within(time)) * value(time)

        return PrescribedMotion(dofs, travelled, value, lambda time: change(slope, time))

    def act_on(self, edge: Edge, key: str) -> Action:
        return Action(motion=self.motion(edge.dofs(self.component, (self.x_range, self.y_range))))
