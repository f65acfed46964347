"""Pressure that oscillates."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.plugin import Action, Duration, EdgeBoundary, Force, Plane, Stress

if TYPE_CHECKING:
    from ruptfx.plugin import Edge


class OscillatingPressure(EdgeBoundary):
    """Pressure that oscillates about the initial one."""

    example: ClassVar[str] = '{ kind = "oscillating_pressure", edge = "upper.top", amplitude = 1e6, period = 5e-6 }'
    amplitude: Stress
    """Largest pressure above the initial one."""
    period: Duration
    """Duration of an oscillation."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        if plane == "antiplane":
            raise ValueError(f"{key}: plane = 'antiplane' moves in z only; use traction")

    def act_on(self, edge: Edge, key: str) -> Action:
        nodal = edge.integral(lambda tests, n: -sum(n[i] * test for i, test in enumerate(tests)))
        return Action(force=Force.of(nodal, lambda time: self.amplitude * np.sin(2 * np.pi * time / self.period)))
