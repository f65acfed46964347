"""Young's modulus or Poisson's ratio from wave speeds that vary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from ruptfx.input.profiles import PointsError, Profile, in_body, varying
from ruptfx.input.quantities import at_least

if TYPE_CHECKING:
    Varying = Any
    VaryingDensity = Varying
    VaryingSpeed = Varying
else:
    Positive = Annotated[float, Field(gt=0)]
    VaryingDensity, VaryingSpeed = varying(Positive, "kg/m3"), varying(Positive, "m/s")


FLUID = 1e-6
"""Ratio c_s / c_p of a fluid: Poisson's ratio would be 1/2 but for the last digits."""


class ElasticConstant(Profile):
    """An elastic constant of an isotropic body, from density and wave speeds that vary.

    Cases give `c_p` and `c_s` of the material; the resolved case contains this.
    """

    over_body: ClassVar[bool] = True
    example: ClassVar[str] = (
        '{ kind = "elastic_constant", quantity = "young_modulus", density = 2700.0, c_p = 5200.0, c_s = '
        '{ kind = "along_axis", axis = "x", profile = { kind = "layers", boundaries = [0.0], values = [3e3, 2e3] } } }'
    )
    quantity: Literal["young_modulus", "poisson_ratio"]
    """Which constant."""
    density: VaryingDensity
    """Mass per volume."""
    c_p: VaryingSpeed
    """Speed of P waves."""
    c_s: VaryingSpeed
    """Speed of S waves."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        density, c_p, c_s = (in_body(value, position) for value in (self.density, self.c_p, self.c_s))
        if len(fluid := np.flatnonzero(~(c_s > FLUID * c_p))):
            raise PointsError(
                f"c_s = {c_s[fluid[0]]:g} m/s, a fluid without shear waves, is not supported:", position[fluid],
                "give the rock below it, with the fluid left out of the mesh, or a c_s above zero there",
            )  # fmt: skip
        if len(wrong := np.flatnonzero(~(c_p > np.sqrt(4 / 3) * c_s))):
            raise PointsError(
                f"c_p = {c_p[wrong[0]]:g} m/s must be more than sqrt(4/3) c_s = "
                f"{at_least(np.sqrt(4 / 3) * c_s[wrong[0]])} m/s, and is less", position[wrong],
                "increase c_p or reduce c_s there",
            )  # fmt: skip
        r = (c_p / c_s) ** 2
        nu = (r - 2) / (2 * (r - 1))
        return nu if self.quantity == "poisson_ratio" else 2 * density * c_s**2 * (1 + nu)
