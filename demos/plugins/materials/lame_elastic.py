"""Isotropic material, given by the Lamé parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ruptfx.plugin import Material, Modulus, Plane

if TYPE_CHECKING:
    from ruptfx.plugin import Expr


class LameElastic(Material):
    """Isotropic, given by the Lamé parameters."""

    first: Modulus
    """Lamé's first parameter."""
    second: Modulus
    """Shear modulus, Lamé's second parameter."""

    def energy_density(self, strain: Expr, plane: Plane) -> Expr:
        import ufl

        if plane == "antiplane":
            return 0.5 * self.second * ufl.inner(strain, strain)
        ratio = 2 * self.second / (self.first + 2 * self.second) if plane == "stress" else 1.0
        return 0.5 * ratio * self.first * ufl.tr(strain) ** 2 + self.second * ufl.inner(strain, strain)
