"""Facets that are rigid until their strength is reached."""

from __future__ import annotations

from math import inf
from typing import Annotated, ClassVar

from pydantic import Field

from ruptfx.cracks import Fracture
from ruptfx.materials import Material, Plane
from ruptfx.materials.isotropic_elastic import IsotropicElastic
from ruptfx.schema import CaseError


class OnStrength(Fracture):
    """Cells are tied to each other until a facet has to carry more than its strength: the extrinsic method.

    The trial traction of a tied facet is that of the mean stress of both cells. Where it is too much the facet is
    inserted, for good: the corners at its ends fall into the pieces that tied facets still connect, and every piece
    moves for itself. A facet between two pieces begins with the traction that holds them together, no more than its
    strength, so that nothing jumps; then it softens by its cohesive law, as rigid contact does: opening and slip damage
    it, and nothing but them is a jump. Bodies have the moduli of the case, and the time step is that of their cells.
    Source: Camacho and Ortiz (1996), Pandolfi and Ortiz (2002) for the pieces.
    """

    rigid: ClassVar[bool] = True

    check_every: Annotated[int, Field(ge=1)] = 2
    """Steps between two looks at the strength of tied facets."""

    def stiffness(self, material: Material, plane: Plane, edge: float) -> float:
        return inf

    def of_cells(self, material: Material, plane: Plane, compliance: float) -> Material:
        if not isinstance(material, IsotropicElastic):
            raise CaseError(
                f"fracture.kind = 'on_strength': breaks isotropic bodies, not those of '{material.kind()}'; "
                "use 'isotropic_elastic'"
            )
        return material
