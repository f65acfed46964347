"""Compliant contact: the Povirk-Needleman interface."""

from __future__ import annotations

from ruptfx.input.units import Stiffness
from ruptfx.laws.contact import Array, ContactMethod, Point, Trial


class Compliant(ContactMethod):
    """Povirk-Needleman interface: tractions follow the elastic part of the jump, T_s' = C_s ([u_s]' - V).

    The rates are integrated exactly: sigma = sigma_0 - C_n [u_n], tau = tau_0 + C_s ([u_s] - slip). Where sigma would
    be tensile the interface opens and it closes again when [u_n] returns.
    Source: Povirk and Needleman (1993); Coker, Lykotrafitis, Needleman, Rosakis (2005).
    """

    implicit = True
    traction_ends_slip = True

    C_n: Stiffness
    """Normal traction per elastic opening."""
    C_s: Stiffness
    """Shear traction per elastic tangential jump."""

    def trial(self, point: Point) -> Trial:
        stretch = zip(point.shear_traction_0, point.slip_jump, point.slip, strict=True)
        return Trial(
            normal_stress=point.normal_stress_0 - self.C_n * point.opening_jump,
            shear_traction=[tau_0 + self.C_s * (jump - slip) for tau_0, jump, slip in stretch],
            normal_compliance=1 / self.C_n,
            impedance=[self.C_s * point.since for _ in point.slip],
        )

    def dissipated(self, traction_old: Array, traction: Array, rate_old: Array, rate: Array) -> Array:
        # Slip happens between the two tractions: the trapezoidal rule closes the energy budget exactly.
        return 0.5 * (traction_old + traction) * rate

    def stored(self, normal_stress: Array, shear_traction: list[Array], opening: Array, slip: list[Array]) -> Array:
        shear = sum(0.5 * tau**2 / self.C_s + tau * added for tau, added in zip(shear_traction, slip, strict=True))
        return 0.5 * normal_stress**2 / self.C_n - normal_stress * opening + shear

    def stiffness(self) -> tuple[float, float]:
        return self.C_n, self.C_s
