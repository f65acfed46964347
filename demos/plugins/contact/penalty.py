"""Contact by springs of one stiffness."""

from ruptfx.plugin import Array, ContactMethod, Point, Stiffness, Trial


class Penalty(ContactMethod):
    """The same stiffness in all directions."""

    traction_ends_slip = True
    stiff: Stiffness
    """Traction per elastic jump."""

    def trial(self, point: Point) -> Trial:
        shear = zip(point.shear_traction_0, point.slip_jump, point.slip, strict=True)
        return Trial(
            normal_stress=point.normal_stress_0 - self.stiff * point.opening_jump,
            shear_traction=[tau_0 + self.stiff * (jump - slip) for tau_0, jump, slip in shear],
            normal_compliance=1 / self.stiff,
            impedance=[self.stiff * point.since for _ in point.slip],
        )

    def dissipated(self, traction_old: Array, traction: Array, rate_old: Array, rate: Array) -> Array:
        return 0.5 * (traction_old + traction) * rate  # slip happens between the two tractions

    def stored(self, normal_stress: Array, shear_traction: list[Array], opening: Array, slip: list[Array]) -> Array:
        shear = sum(0.5 * tau**2 / self.stiff + tau * added for tau, added in zip(shear_traction, slip, strict=True))
        return 0.5 * normal_stress**2 / self.stiff - normal_stress * opening + shear

    def stiffness(self) -> tuple[float, float]:
        return self.stiff, self.stiff
