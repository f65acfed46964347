"""Facets with springs of one stiffness."""

from __future__ import annotations

from typing import ClassVar

from ruptfx.plugin import FacetModulus, Fracture, Material, Plane, Stiffness


class EvenSprings(Fracture):
    """Springs between all cells, as stiff in soft bodies as in hard ones."""

    implicit: ClassVar[bool] = True

    spring: Stiffness = 5e14
    """Normal and shear stiffness of a facet per area."""

    def stiffness(self, modulus: FacetModulus, edge: float) -> FacetModulus:
        return 0 * modulus + self.spring

    def of_cells(self, material: Material, plane: Plane, edge: float, length_per_area: float) -> Material:
        return material
