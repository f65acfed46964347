"""Young's modulus or Poisson's ratio from wave speeds that vary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from ruptfx.input.profiles import Profile, in_body, varying

if TYPE_CHECKING:
    Varying = Any
    VaryingDensity = Varying
    VaryingSpeed = Varying
else:
    Positive = Annotated[float, Field(gt=0)]
    VaryingDensity, VaryingSpeed = varying(Positive, "kg/m3"), varying(Positive, "m/s")


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
        r = (c_p / c_s) ** 2
        nu = (r - 2) / (2 * (r - 1))
        return nu if self.quantity == "poisson_ratio" else 2 * density * c_s**2 * (1 + nu)
