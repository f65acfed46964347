"""Springs between all cells from the start: intrinsic facets."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from ruptfx.input.schema import CaseError, Unit
from ruptfx.interfaces.cracks import FacetModulus, Fracture
from ruptfx.laws.materials import Material, Plane

MOST = 0.5  # largest compliance of facets over that of the body


class Intrinsic(Fracture):
    """Intrinsic facets: stiff springs between all cells, which soften once their strength is reached.

    A facet has the normal and shear stiffness k = alpha E / h per area, with the mean length h of the facets and, in
    orthotropic bodies, Young's modulus along its normal. Springs that have not yielded make a body more compliant,
    isotropically, by q = S / (2 k), with the length S of facets per area of the mesh; `compensate` takes that off the
    compliances of the cells, 1 / (2 mu) - q and 1 / (2 K) - q with K = lambda + mu, so that the broken body has the
    moduli of the case. Off the compliances of orthotropic bodies it takes the mean over all directions of facets.
    """

    former_kinds = ("everywhere",)
    implicit: ClassVar[bool] = True

    stiffness_ratio: Annotated[float, Field(ge=3), Unit("1")] = 10.0
    """alpha: stiffness of the springs times the mean length of facets over Young's modulus; a large one reduces the
    time step by its square root."""
    compensate: bool = True
    """Whether stiffer cells compensate the compliance of the springs."""

    def stiffness(self, modulus: FacetModulus, edge: float) -> FacetModulus:
        return self.stiffness_ratio * modulus / edge

    def of_cells(self, material: Material, plane: Plane, edge: float, length_per_area: float) -> Material:
        if not self.compensate or length_per_area == 0:
            return material

        def compliance(modulus: float) -> float:
            return float(length_per_area / (2 * self.stiffness(modulus, edge)))

        share = material.spring_share(plane, compliance)
        if share is None:
            raise CaseError(
                f"materials: '{material.kind()}' cannot be made stiffer by what springs are compliant; set "
                "fracture.compensate = false"
            )
        if share > MOST:
            raise CaseError(
                f"fracture.stiffness_ratio = {self.stiffness_ratio:g}: the springs have {share:.0%} of the compliance "
                f"of the body, at most {MOST:.0%} can be compensated; increase it, or set fracture.compensate = false"
            )
        return material.stiffened(plane, compliance)
