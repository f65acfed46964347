"""Springs between all cells from the start: intrinsic facets."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ruptfx.cracks import Fracture
from ruptfx.materials import Material, Plane
from ruptfx.materials.isotropic_elastic import IsotropicElastic
from ruptfx.schema import CaseError, Unit

MOST = 0.5  # largest compliance of facets over that of the body


class Everywhere(Fracture):
    """Intrinsic facets: stiff springs between all cells, which soften once their strength is reached.

    A facet has the normal and shear stiffness k = alpha E / h per area, with the mean length h of the facets. Springs
    that have not yielded make a body more compliant, isotropically, by q = S / (2 k), with the length S of facets per
    area of the mesh; `compensate` subtracts it from the compliances of the cells, 1 / (2 mu) - q and 1 / (2 K) - q with
    K = lambda + mu, so that the broken body has the moduli of the case.
    """

    stiffness_ratio: Annotated[float, Field(ge=3), Unit("1")] = 10.0
    """alpha: stiffness of the springs times the mean length of facets over Young's modulus; a large one reduces the
    time step by its square root."""
    compensate: bool = True
    """Whether stiffer cells compensate the compliance of the springs."""

    def stiffness(self, material: Material, plane: Plane, edge: float) -> float:
        return self.stiffness_ratio * _isotropic(material).young_modulus / edge

    def of_cells(self, material: Material, plane: Plane, compliance: float) -> Material:
        if not self.compensate or compliance == 0:
            return material
        given = _isotropic(material)
        lame, shear = given.lame(plane)
        if compliance > MOST / (2 * (lame + shear)):
            raise CaseError(
                f"fracture.stiffness_ratio = {self.stiffness_ratio:g}: the springs have "
                f"{2 * compliance * (lame + shear):.0%} of the compliance of the body, at most {MOST:.0%} can be "
                "compensated; increase it, or set fracture.compensate = false"
            )
        stiffer = 0.5 / (0.5 / shear - compliance)
        effective = 0.5 / (0.5 / (lame + shear) - compliance) - stiffer
        first = 2 * stiffer * effective / (2 * stiffer - effective) if plane == "stress" else effective
        return given.model_copy(update={
            "young_modulus": stiffer * (3 * first + 2 * stiffer) / (first + stiffer),
            "poisson_ratio": first / (2 * (first + stiffer)),
        })  # fmt: skip


def _isotropic(material: Material) -> IsotropicElastic:
    if not isinstance(material, IsotropicElastic):
        raise CaseError(
            f"fracture.kind = 'everywhere': springs have the stiffness of isotropic bodies, not of "
            f"'{material.kind()}'; use 'isotropic_elastic'"
        )
    return material
