"""Transversely isotropic linear elasticity with the axis along y."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.plugin import Material, Modulus, Plane

if TYPE_CHECKING:
    from ruptfx.plugin import Expr


class TransverselyIsotropic(Material):
    """Layered rock by Love's constants, with the axis of symmetry along y."""

    example: ClassVar[str] = (
        '{ kind = "transversely_isotropic", density = 2500.0, A = 40e9, C = 25e9, F = 9e9, L = 8e9, N = 14e9 }'
    )
    A: Modulus
    """Stiffness along the layers."""
    C: Modulus
    """Stiffness across the layers."""
    F: Modulus
    """Coupling of both."""
    L: Modulus
    """Shear modulus across the layers."""
    N: Modulus
    """Shear modulus along the layers."""

    def energy_density(self, strain: Expr, plane: Plane) -> Expr:
        if plane == "antiplane":
            return 0.5 * (self.N * strain[0] ** 2 + self.L * strain[1] ** 2)
        xx, yy, xy = strain[0, 0], strain[1, 1], strain[0, 1]
        if plane == "stress":
            a, f = 4 * self.N * (self.A - self.N) / self.A, 2 * self.N * self.F / self.A
            c = self.C - self.F**2 / self.A
            return 0.5 * (a * xx**2 + c * yy**2) + f * xx * yy + 2 * self.L * xy**2
        flat = 0.5 * (self.A * xx**2 + self.C * yy**2) + self.F * xx * yy + 2 * self.L * xy**2
        if plane == "strain":
            return flat
        zz, xz, yz = strain[2, 2], strain[0, 2], strain[1, 2]
        beside = 0.5 * self.A * zz**2 + (self.A - 2 * self.N) * xx * zz + self.F * yy * zz
        return flat + beside + 2 * self.N * xz**2 + 2 * self.L * yz**2
