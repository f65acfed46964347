"""Facets that are rigid until their strength is reached: extrinsic facets."""

from __future__ import annotations

from math import inf
from typing import Annotated, ClassVar

from pydantic import Field

from ruptfx.interfaces.cracks import FacetModulus, Fracture
from ruptfx.laws.materials import Material, Plane

SPRINGS = 10.0  # as `stiffness_ratio` of intrinsic facets


class Extrinsic(Fracture):
    """Extrinsic facets: cells are tied until the traction of a facet exceeds its strength.

    The trial traction of a tied facet is that of the mean stress of both cells. Beyond the strength the facet is
    inserted permanently: the corners at its ends separate into the connected components of tied facets, and every
    component has its own motion. A facet between two components begins with the traction that keeps them together, no
    more than its strength, so that tractions are continuous; then it softens by its cohesive law with rigid contact:
    opening and slip are the only displacement jumps, and damage it. Bodies have the moduli of the case, and the time
    step is that of their cells.
    Source: Camacho and Ortiz (1996), Pandolfi and Ortiz (2002) for the components.
    """

    former_kinds = ("on_strength",)
    rigid: ClassVar[bool] = True

    check_every: Annotated[int, Field(ge=1)] = 2
    """Steps between two checks of the strength of tied facets."""

    def stiffness(self, modulus: FacetModulus, edge: float) -> FacetModulus:
        return inf * modulus

    def spring_of_collisions(self, modulus: FacetModulus, edge: float) -> FacetModulus:
        return SPRINGS * modulus / edge

    def of_cells(self, material: Material, plane: Plane, edge: float, length_per_area: float) -> Material:
        return material
