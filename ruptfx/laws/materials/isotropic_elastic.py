"""Isotropic linear elasticity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from math import sqrt
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import GetJsonSchemaHandler, ValidationError, ValidationInfo, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from ruptfx.input.profiles import Profile
from ruptfx.input.quantities import at_least
from ruptfx.input.schema import CaseError, Part
from ruptfx.input.units import VaryingDensity, VaryingModulus, VaryingPoissonRatio, VaryingSpeed
from ruptfx.laws.materials import Material, Plane, WaveSpeeds

if TYPE_CHECKING:
    from ruptfx.platform.fem import Expr


BY_NAME = ("young_modulus", "poisson_ratio")


def _table(value: Any) -> Any:
    """Return a profile as the table of a case, a number as it is."""
    return value.model_dump(exclude_none=True) if isinstance(value, Profile) else value


class ByShearModulus(Part):
    """Shear modulus instead of Young's modulus."""

    shear_modulus: VaryingModulus
    """G; with poisson_ratio it replaces Young's modulus."""
    poisson_ratio: VaryingPoissonRatio
    """Poisson's ratio."""

    def young_and_poisson(self) -> tuple[Any, Any]:
        """Return E = 2 G (1 + nu) [Pa] and nu, as tables of profiles where they vary."""
        G, nu = self.shear_modulus, self.poisson_ratio
        if isinstance(G, Profile) or isinstance(nu, Profile):
            nu = _table(nu)
            factor = {"kind": "product", "value": 2.0, "factor": {"kind": "sum", "terms": [1.0, nu]}}
            return {"kind": "product", "value": _table(G), "factor": factor}, nu
        return 2 * self.shear_modulus * (1 + self.poisson_ratio), self.poisson_ratio


class ByWaveSpeeds(Part):
    """Wave speeds instead of moduli."""

    density: VaryingDensity
    """Mass per volume."""
    c_p: VaryingSpeed
    """Speed of P waves in plane strain and 3D, not that of a plate; with c_s it replaces both moduli."""
    c_s: VaryingSpeed
    """Speed of S waves; with c_p it replaces both moduli."""

    def young_and_poisson(self) -> tuple[Any, Any]:
        """Return E and nu from G = rho c_s^2, nu = (r - 2) / (2 (r - 1)) with r = (c_p / c_s)^2.

        Where one of the three varies they are tables of profiles.

        Raises
        ------
        ValueError
            If no positive bulk modulus has these speeds.
        """
        entries = {name: _table(getattr(self, name)) for name in ("density", "c_p", "c_s")}
        if any(isinstance(value, dict) for value in entries.values()):
            first, second = ({"kind": "elastic_constant", "quantity": name, **entries} for name in BY_NAME)
            return first, second
        r = (self.c_p / self.c_s) ** 2
        if r <= 4 / 3:
            least = at_least(sqrt(4 / 3) * self.c_s)
            raise ValueError(f"c_p = {self.c_p:g}: must be more than sqrt(4/3) c_s = {least}")
        nu = (r - 2) / (2 * (r - 1))
        return 2 * self.density * self.c_s**2 * (1 + nu), nu


class IsotropicElastic(Material):
    """Isotropic linear elasticity (Hooke's law).

    Instead of young_modulus and poisson_ratio a case may give shear_modulus and poisson_ratio, or c_p and c_s, the wave
    speeds of the bulk (in plane strain and 3D; `ruptfx check` shows those of the case). The resolved case contains
    young_modulus and poisson_ratio. All of them and the density may vary in the bodies.
    """

    isotropic: ClassVar[bool] = True

    young_modulus: VaryingModulus
    """Young's modulus."""
    poisson_ratio: VaryingPoissonRatio
    """Poisson's ratio."""

    @model_validator(mode="before")
    @classmethod
    def _from_other_constants(cls, values: object, info: ValidationInfo) -> object:
        if not isinstance(values, Mapping):
            return values
        for other in (ByShearModulus, ByWaveSpeeds):
            asked = [key for key in values if key in other.model_fields and key not in cls.model_fields]
            if not asked:
                continue
            keys = [key for key in other.model_fields if key != "density"]
            wrong = [key for key in ("young_modulus", "poisson_ratio") if key in values and key not in keys]
            if wrong:
                raise ValueError(f"give either {' and '.join(keys)} or {' and '.join(wrong)}")
            try:
                picked = {key: values[key] for key in other.model_fields if key in values}
                items = other.model_validate(picked, context=info.context)
            except ValidationError as error:
                raise ValueError("; ".join(str(CaseError.from_validation(error)).splitlines())) from None
            young, nu = items.young_and_poisson()
            others = {key: value for key, value in values.items() if key not in keys}
            return {**others, "young_modulus": young, "poisson_ratio": nu}
        return values

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema with the alternative keys."""
        schema = super().__get_pydantic_json_schema__(core, handler)
        entry = handler.resolve_ref_schema(schema)
        for other in (ByShearModulus, ByWaveSpeeds):
            entry["properties"] = {**other.model_json_schema()["properties"], **entry["properties"]}
        entry["required"] = ["density"]
        return schema

    @property
    def shear_modulus(self) -> float:
        """G = E / (2 (1 + nu)) [Pa]."""
        return self.young_modulus / (2 * (1 + self.poisson_ratio))

    def lame_lambda(self, plane: Plane) -> float:
        """Return the first Lamé parameter [Pa]; in plane stress the effective one, 2 lambda G / (lambda + 2 G)."""
        nu = self.poisson_ratio
        if plane == "stress":
            return self.young_modulus * nu / (1 - nu**2)
        return self.young_modulus * nu / ((1 + nu) * (1 - 2 * nu))

    def lame(self, plane: Plane) -> tuple[float, float]:
        return self.lame_lambda(plane), self.shear_modulus

    def energy_density(self, strain: Expr, plane: Plane) -> Expr:
        """Return lambda tr(e)^2 / 2 + G e:e [J/m3]; in antiplane G |grad w|^2 / 2."""
        import ufl

        if plane == "antiplane":
            return 0.5 * self.shear_modulus * ufl.inner(strain, strain)
        return 0.5 * self.lame_lambda(plane) * ufl.tr(strain) ** 2 + self.shear_modulus * ufl.inner(strain, strain)

    def young_modulus_along(self, direction: np.ndarray) -> np.ndarray:
        return np.full(len(direction), self.young_modulus)

    def spring_share(self, plane: Plane, compliance: Callable[[float], float]) -> float:
        lame, shear = self.lame(plane)
        return 2 * compliance(self.young_modulus) * (lame + shear)

    def stiffened(self, plane: Plane, compliance: Callable[[float], float]) -> IsotropicElastic:
        """1 / (2 mu) and 1 / (2 K), K = lambda + mu, are less by that of the springs."""
        lame, shear = self.lame(plane)
        less = compliance(self.young_modulus)
        stiffer = 0.5 / (0.5 / shear - less)
        effective = 0.5 / (0.5 / (lame + shear) - less) - stiffer
        first = 2 * stiffer * effective / (2 * stiffer - effective) if plane == "stress" else effective
        return self.model_copy(update={
            "young_modulus": stiffer * (3 * first + 2 * stiffer) / (first + stiffer),
            "poisson_ratio": first / (2 * (first + stiffer)),
        })  # fmt: skip

    def wave_speeds(self, plane: Plane) -> WaveSpeeds:
        c_s = sqrt(self.shear_modulus / self.density)
        if plane == "antiplane":
            return WaveSpeeds(c_s, c_s, c_s)
        c_p = sqrt((self.lame_lambda(plane) + 2 * self.shear_modulus) / self.density)
        return WaveSpeeds(c_p, c_s, rayleigh_speed(c_p, c_s))


@lru_cache
def rayleigh_speed(c_p: float, c_s: float) -> float:
    """Return the root of D = 4 a_s a_p - (1 + a_s^2)^2 with a_i = sqrt(1 - c^2 / c_i^2) (Source: Rayleigh 1885).

    Parameters
    ----------
    c_p, c_s : float
        Body wave speeds [m/s].

    Returns
    -------
    float
        Rayleigh speed [m/s].
    """

    # Squared, with x = (c / c_s)^2 and without its root x = 0: 16 (1 - x) (1 - k x) = (2 - x)^4.
    k = (c_s / c_p) ** 2
    roots = np.roots([1, -8, 24 - 16 * k, -16 * (1 - k)])
    return c_s * sqrt(next(root.real for root in roots if abs(root.imag) < 1e-6 and 0 < root.real < 1))
