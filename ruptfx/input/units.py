"""Annotated scalar types: unit and bound of a field, declared once and used in errors and `describe`.

SI everywhere. Text with a unit, as "6 MPa", becomes a number.
Types ending in a profile (`Varying...`) accept a number or a table that varies along an interface or in the bodies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from ruptfx.input.profiles import varying
from ruptfx.input.quantities import in_si
from ruptfx.input.schema import Unit, or_text


class _OfAnotherKey(BeforeValidator):
    """Validator of a number whose unit another key names; the part that knows that key reads text with a unit."""

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return or_text(handler(core), "A number and its unit.")


def without_unit(quantity: str) -> BeforeValidator:
    """Return the validator of numbers in the SI unit of a quantity that another key names: text is refused."""

    def check(value: object) -> object:
        items = value if isinstance(value, list) else [value]
        if any(isinstance(item, str) for item in items):
            numbers = [in_si(item) if isinstance(item, str) else item for item in items]
            shown = ", ".join("a number" if number is None else f"{number:g}" for number in numbers)
            raise ValueError(
                f"a number without unit is wanted, in the SI unit of {quantity}; write "
                f"{f'[{shown}]' if isinstance(value, list) else shown}"
            )
        return value

    return _OfAnotherKey(check)


def positive_or(remedy: str) -> BeforeValidator:
    """Return the validator of positive numbers whose refusal ends with a remedy."""

    def check(value: object) -> object:
        if isinstance(value, float | int) and value <= 0:
            raise ValueError(f"input should be greater than 0; {remedy}")
        return value

    return BeforeValidator(check)


Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]

Length = Annotated[float, Field(gt=0), Unit("m")]
Coordinate = Annotated[float, Unit("m")]
Duration = Annotated[float, Field(gt=0), Unit("s")]
Time = Annotated[float, Field(ge=0), Unit("s")]
Instant = Annotated[float, Unit("s")]
Speed = Annotated[float, Field(gt=0), Unit("m/s")]
Velocity = Annotated[float, Unit("m/s")]
Stress = Annotated[float, Unit("Pa")]
Modulus = Annotated[float, Field(gt=0), Unit("Pa")]
Strength = Annotated[float, Field(gt=0), Unit("Pa")]
Density = Annotated[float, Field(gt=0), Unit("kg/m3")]
ContractionRatio = Annotated[float, Unit("1")]  # Poisson's ratio of an anisotropic body, which has other bounds
Angle = Annotated[float, Unit("rad")]
FringeConstant = Annotated[float, Field(gt=0), Unit("N/m")]
Stiffness = Annotated[float, Field(gt=0), Unit("Pa/m")]
Rate = Annotated[float, Field(ge=0), Unit("1/s")]
Frequency = Annotated[float, Field(gt=0), Unit("1/s")]
Width = Annotated[float, Field(ge=0), Unit("m")]
HeatCapacity = Annotated[float, Field(gt=0), Unit("J/m3/K")]
PressurePerTemperature = Annotated[float, Field(gt=0), Unit("Pa/K")]
Viscosity = Annotated[float, Field(gt=0), Unit("Pa s")]
Compressibility = Annotated[float, Field(gt=0), Unit("1/Pa")]
Fraction = Annotated[float, Field(gt=0, le=1), Unit("1")]

if TYPE_CHECKING:
    # A number or a profile in a case, an array at the points, an expression while a law is traced.
    Varying = Any
    VaryingStress = Varying
    VaryingPressure = Varying
    VaryingCoefficient = Varying
    VaryingExponent = Varying
    VaryingEvolution = Varying
    VaryingRatio = Varying
    VaryingFactor = Varying
    VaryingLength = Varying
    VaryingGap = Varying
    VaryingEnergy = Varying
    VaryingDensity = Varying
    VaryingModulus = Varying
    VaryingPoissonRatio = Varying
    VaryingAngle = Varying
    VaryingHeight = Varying
    VaryingSpeed = Varying
    VaryingVelocity = Varying
    VaryingSquaredSpeed = Varying
    VaryingSlipRate = Varying
    VaryingTime = Varying
    VaryingDelay = Varying
    VaryingInstant = Varying
    VaryingDrag = Varying
    VaryingTemperature = Varying
    VaryingDiffusivity = Varying
    VaryingPermeability = Varying
else:
    VaryingStress = varying(float, "Pa")
    VaryingPressure = varying(NonNegative, "Pa")
    VaryingCoefficient = varying(NonNegative, "1")
    VaryingExponent = varying(Positive, "1")
    VaryingEvolution = varying(
        Annotated[float, Field(gt=0), positive_or(
            "without an evolution effect give 1e-6, which changes friction by less than 1e-4, and theta_initial where "
            "the law has this key: the age that carries the initial stress would overflow"
        )], "1",
    )  # fmt: skip
    VaryingRatio = varying(NonNegative, "1")
    VaryingFactor = varying(float, "1")
    VaryingLength = varying(Positive, "m")
    VaryingGap = varying(NonNegative, "m")
    VaryingEnergy = varying(Positive, "J/m2")
    VaryingDensity = varying(Positive, "kg/m3")
    VaryingModulus = varying(Positive, "Pa")
    VaryingPoissonRatio = varying(Annotated[float, Field(gt=-1, lt=0.5)], "1")
    VaryingAngle = varying(Annotated[float, Field(ge=0, lt=1.5)], "rad")
    VaryingHeight = varying(float, "m")
    VaryingSpeed = varying(Positive, "m/s")
    VaryingVelocity = varying(NonNegative, "m/s")
    VaryingSquaredSpeed = varying(Positive, "m2/s2")
    VaryingSlipRate = varying(float, "m/s")
    VaryingTime = varying(Positive, "s")
    VaryingDelay = varying(NonNegative, "s")
    VaryingInstant = varying(float, "s")
    VaryingDrag = varying(NonNegative, "1/m")
    VaryingTemperature = varying(Positive, "K")
    VaryingDiffusivity = varying(Positive, "m2/s")
    VaryingPermeability = varying(Positive, "m2")
