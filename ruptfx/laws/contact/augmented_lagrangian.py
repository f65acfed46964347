"""Augmented Lagrangian contact: rigid, the method of implicit steps."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ruptfx.input.schema import Unit
from ruptfx.laws.contact import Array, Point, Trial
from ruptfx.laws.contact._rigid import RigidContact

Penalty = Annotated[float, Field(gt=0), Unit("1")]
Tolerance = Annotated[float, Field(gt=0, le=1e-4), Unit("1")]


class AugmentedLagrangian(RigidContact):
    """Rigid contact by augmented Lagrange multipliers: sticking and closure are exact.

    sigma = lambda_n - k [u_n], tau = lambda_s + k ([u_s] - slip), and their admissible part is the next lambda,
    until it changes no more: then [u_n] = 0 where the interface is closed and [u_s] = slip everywhere. k speeds up
    this iteration and does not change its result. Explicit steps enforce the same rigid contact by `split_node`, or by
    `forward_lagrange` on interfaces that slide and beside extrinsic facets.
    Source: Simo and Laursen (1992); Alart and Curnier (1991).
    """

    explicit = False
    implicit = True

    penalty: Penalty = 100.0
    """k over the stiffness of the bodies at a point; reduced where Newton's iteration does not converge."""
    tolerance: Tolerance = 1e-8
    """Change of the tractions over the largest one at which the iteration ends."""

    def trial(self, point: Point) -> Trial:
        k = self.penalty * point.body_stiffness
        stretch = zip(point.shear_multiplier, point.slip_jump, point.slip, strict=True)
        return Trial(
            normal_stress=point.normal_multiplier - k * point.opening_jump,
            shear_traction=[shear + k * (jump - slip) for shear, jump, slip in stretch],
            normal_compliance=1 / k,
            impedance=[k * point.since for _ in point.slip],
        )

    def multiplier_tolerance(self) -> float | None:
        return self.tolerance

    def dissipated(self, traction_old: Array, traction: Array, rate_old: Array, rate: Array) -> Array:
        return 0.5 * (traction_old + traction) * rate
