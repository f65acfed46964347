"""Split-node contact: rigid until it slips or opens."""

from __future__ import annotations

from ruptfx.laws.contact import Array, Point, Trial
from ruptfx.laws.contact._rigid import RigidContact


class SplitNode(RigidContact):
    """Traction at split nodes: exactly the traction that stops the jump in this step, unless friction gives way.

    tau = tau_0 + Z [v], sigma = sigma_0 - Z ([v_n] + [u_n] / dt), with [v] the velocity jump of the bodies
    without contact forces (explicit steps only; the same as forward Lagrange multipliers).
    Source: Andrews (1973, 1999); Day et al. (2005).
    """

    def trial(self, point: Point) -> Trial:
        z_n, z_s = point.normal_impedance, point.shear_impedance
        return Trial(
            normal_stress=point.normal_stress_0 - z_n * (point.opening_velocity + point.opening_jump / point.dt),
            shear_traction=[
                tau_0 + z * v for tau_0, z, v in zip(point.shear_traction_0, z_s, point.slip_velocity, strict=True)
            ],
            normal_compliance=point.dt / z_n,
            impedance=z_s,
        )

    def lost_in_impact(self, normal_stress: Array, rate_old: Array, rate: Array) -> Array:
        # Rigid contact stops the gap at once: a plastic impact of the two nodal masses.
        return -0.5 * normal_stress * (rate_old + rate)

    def dissipated(self, traction_old: Array, traction: Array, rate_old: Array, rate: Array) -> Array:
        # The traction acts in the middle between the two slip rates.
        return 0.5 * traction * (rate_old + rate)
