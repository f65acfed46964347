"""Forward Lagrange multipliers: rigid contact also where neighbouring points are coupled."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ruptfx.input.schema import Unit
from ruptfx.laws.contact.split_node import SplitNode

Tolerance = Annotated[float, Field(gt=0, lt=1), Unit("1")]


class ForwardLagrange(SplitNode):
    """Rigid contact of points that depend on each other: tractions with which the jump is admissible after the step.

    The trial is that of split nodes, with the stress contained in the velocities in place of the initial one: on an
    interface that slides, and beside extrinsic facets, the stress of the last sweep. Sweeps over all points repeat
    until the tractions converge; a step that does not within `sweeps` continues with the last tractions. Where points
    are not coupled it is split-node contact. Implicit steps enforce the same rigid contact by `augmented_lagrangian`.
    Source: Carpenter, Taylor, Katona (1991).
    """

    tolerance: Tolerance = 1e-6
    """Change of the tractions in a sweep, over the largest one, at which they have converged."""
    sweeps: Annotated[int, Field(ge=1)] = 30
    """Largest number of sweeps in a step."""

    def sweeps_to(self) -> tuple[float, int]:
        return self.tolerance, self.sweeps
