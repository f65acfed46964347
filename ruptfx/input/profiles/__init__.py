"""Scalars that vary along or over an interface or in the bodies, one kind per file; its name is the `kind` in a case.

A parameter of a law or material, an initial stress or the height of a surface may be given as a table with ``kind``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationError, ValidationInfo
from pydantic_core import PydanticCustomError

from ruptfx.input.schema import Alternative, Bound, CaseError, OfKey, Unit, alternative, find, has_mark, kinds

PositiveMetre = Annotated[float, Field(gt=0), Unit("m")]


if TYPE_CHECKING:
    Value = float
else:
    Value = Annotated[float, OfKey()]


class PointsError(CaseError):
    """Values that are refused at some points of the bodies.

    Attributes
    ----------
    reason, remedy : str
    points : ndarray, shape (n, dimensions)
        [m].
    """

    def __init__(self, reason: str, points: np.ndarray, remedy: str) -> None:
        self.reason, self.points, self.remedy = reason, points, remedy
        size = 1e-8 * float(np.abs(points).max()) or 1.0  # points are a little inside of their elements
        known = np.unique(np.round(points / size), axis=0) * size + 0.0
        first = ", ".join(f"{x:.6g}" for x in known[0])
        super().__init__(f"{reason} at {len(known)} points, the first at ({first}) m; {remedy}")


class Profile(Alternative):
    """Contract of a profile."""

    example: ClassVar[str] = ""
    """Example table, which the contract tests evaluate between -1 and 1 m."""
    over_surface: ClassVar[bool] = False
    """True if `__call__` takes the two positions of a surface, shape (n, 2), and lines have no such values."""
    over_body: ClassVar[bool] = False
    """True if `__call__` takes points of the bodies, shape (n, dimensions), and interfaces have no such values."""
    radial: ClassVar[bool] = False
    """True if values depend on the distance from `center` only, which may then be a point of a surface."""
    down_dip: ClassVar[bool] = False
    """True if the profiles inside of this one vary down the dip of a surface."""

    @classmethod
    def with_files(cls, values: object, info: ValidationInfo, unit: str) -> object:
        """Return the keys of the profile with the numbers of the files named in them.

        Parameters
        ----------
        values : object
            Tables of the profile.
        info : ValidationInfo
            Validation context with the directory of the case.
        unit : str
            Unit of the key that varies.
        """
        return values

    def __call__(self, position: np.ndarray) -> np.ndarray:
        """Return the values, shape (n,); each depends on its position only.

        Parameters
        ----------
        position : ndarray, shape (n,)
            Position along the interface [m].
        """
        raise NotImplementedError

    def over(self, places: np.ndarray) -> np.ndarray:
        """Return the values at points of a line, shape (n,), or of a surface, shape (n, 2) [m].

        Over a surface, kinds of one position vary along the first one; `along_dip` makes them vary along the second.
        Radial kinds whose center is a point vary with the distance from it.

        Raises
        ------
        CaseError
            A kind for surfaces on a line, or one for bodies; a point as the center of a kind that is not radial.
        """
        if self.over_body:
            raise CaseError(f"{self.kind()} varies in the bodies; use a kind that varies along an interface")
        if self.over_surface:
            if places.ndim == 1:
                raise CaseError(
                    f"{self.kind()} varies over a surface, and there is one position here, on a line or in along_dip; "
                    "use boxcar or table"
                )
            return self(places)
        center: Any = getattr(self, "center", 0.0)
        if np.ndim(center):
            if not self.radial or places.ndim == 1:
                raise CaseError(f"{self.kind()}.center: this kind varies along one direction; give one position")
            return self.substituted({"center": 0.0})(np.linalg.norm(places - center, axis=1))
        return self(places if places.ndim == 1 else places[:, 0])

    def in_body(self, points: np.ndarray) -> np.ndarray:
        """Return the values at points of the bodies, shape (n, dimensions) [m]; shape (n,).

        Raises
        ------
        CaseError
            A kind for interfaces.
        """
        if self.over_body:
            return self(points)
        raise CaseError(
            f"{self.kind()} varies along an interface; in bodies use {{ kind = 'along_axis', axis = 'y', profile = "
            f"{{ kind = '{self.kind()}', ... }} }}"
        )


def with_units(values: object, info: ValidationInfo, units: Mapping[str, str]) -> object:
    """Return the keys of a profile, those with profiles inside of it by `with_unit`; `units` has the unit of each."""
    assert isinstance(values, dict)
    return {key: with_unit(item, info, units[key], key) if key in units else item for key, item in values.items()}


def with_unit(value: object, info: ValidationInfo, unit: str, *at: str | int) -> object:
    """Return the table of a profile with texts as numbers in the unit of its key, and with numbers of files.

    Parameters
    ----------
    value : object
        Table of the profile; anything else is returned as it is.
    info : ValidationInfo
        Validation context with the directory of the case.
    unit : str
        Unit of the key that varies.
    *at : str or int
        Keys that lead to the profile from the one that contains it, for messages.

    Raises
    ------
    ValidationError
        Of texts that are no number with this unit.
    """
    kind = value.get("kind") if isinstance(value, Mapping) else None
    if not isinstance(value, Mapping) or not isinstance(kind, str):
        return value
    try:
        cls = find("ruptfx.input.profiles", kind)
    except PydanticCustomError:
        return value  # refused by the reader
    assert issubclass(cls, Profile)
    of_key = Unit(unit)
    values, wrong = dict(value), list[tuple[tuple[str | int, ...], object, str]]()
    for key in value:
        if key in cls.model_fields and has_mark(cls, key, OfKey):
            try:
                values[key] = of_key.read(value[key])
            except ValueError as error:
                wrong.append(((key,), value[key], str(error)))
    if not wrong:
        try:
            return cls.with_files(values, info, unit)
        except ValidationError as error:  # of a profile inside
            wrong = [(each["loc"], each["input"], each["msg"]) for each in error.errors()]
    raise ValidationError.from_exception_data(kind, [
        {"type": PydanticCustomError("unit", "{why}", {"why": why}), "loc": (*at, *place), "input": item}
        for place, item, why in wrong
    ])  # fmt: skip


def _tag(value: object) -> str:
    return "<profile>" if isinstance(value, Mapping | Profile) else "<number>"


def varying(number: object, unit: str) -> Any:
    """Return the field type: a number of the given type, or a table with the ``kind`` of a profile."""
    of_key = Unit(unit)

    def read(value: object, info: ValidationInfo) -> object:
        """Texts in a table that have the unit of the key, as numbers, and numbers in place of files."""
        return with_unit(value, info, unit)

    def refuse_name(value: object) -> object:
        """Refuse the name of a profile alone."""
        if isinstance(value, str) and value in kinds("ruptfx.input.profiles"):
            table = f"{{ kind = '{value}', ... }}"
            raise ValueError(f"a profile is a table; give {table}, see 'ruptfx describe profiles.{value}'")
        return value

    profile = alternative("ruptfx.input.profiles")
    return Annotated[
        Annotated[number, Tag("<number>")] | Annotated[profile, Tag("<profile>")],
        Discriminator(_tag),
        Bound(number),
        BeforeValidator(read),
        of_key,
        BeforeValidator(refuse_name),
    ]


def evaluate(value: object, places: np.ndarray) -> np.ndarray:
    """Return a number or a profile at points of a line, shape (n,), or of a surface, shape (n, 2); shape (n,)."""
    if isinstance(value, Profile):
        return value.over(places)
    if callable(value):
        return np.asarray(value(places))
    return np.broadcast_to(np.asarray(value, float), places.shape[:1]).copy()


def in_body(value: object, points: np.ndarray) -> np.ndarray:
    """Return a number or a profile at points of the bodies, shape (n, dimensions); shape (n,)."""
    if isinstance(value, Profile):
        return value.in_body(points)
    return np.broadcast_to(np.asarray(value, float), len(points)).copy()


if TYPE_CHECKING:
    AnyProfile = Profile
    NumberOrProfile = float | Profile
    ValueOrProfile = float | Profile
else:
    AnyProfile = alternative("ruptfx.input.profiles")
    NumberOrProfile = Annotated[
        Annotated[float, Tag("<number>")] | Annotated[AnyProfile, Tag("<profile>")], Discriminator(_tag)
    ]
    ValueOrProfile = Annotated[NumberOrProfile, OfKey()]

SHARED = ("places", "rim")
"""Files of this folder that are no kinds."""
