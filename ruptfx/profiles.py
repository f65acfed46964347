"""Scalars that vary along an interface: a law's parameter or an initial stress given as a table with ``kind``.

Every profile is called with positions along the interface, shape (n,) [m], and returns shape (n,).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationInfo, field_validator, model_validator

from ruptfx.number_files import with_file_read
from ruptfx.places import Center, HalfWidth, Position
from ruptfx.schema import Bound, CaseError, Part, Unit, has_mark

PositiveMetre = Annotated[float, Field(gt=0), Unit("m")]


class _OfKey:
    """Marks fields that have the unit of the key that varies."""


if TYPE_CHECKING:
    Value = float
else:
    Value = Annotated[float, _OfKey()]


class Constant(Part):
    """The same value everywhere."""

    kind: Literal["constant"] = "constant"
    value: Value
    """The value, everywhere."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return np.full_like(position, self.value)


class Boxcar(Part):
    """`inside` for |position - center| <= half_width, `outside` elsewhere."""

    kind: Literal["boxcar"]
    inside: Value
    """Value in the box."""
    outside: Value
    """Value beyond it."""
    center: Center
    """Middle of the box."""
    half_width: HalfWidth
    """Half the length of the box."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        # A node on the edge belongs to the box, whatever the rounding of its coordinate.
        near = np.abs(position - self.center) <= self.half_width * (1 + 1e-9)
        return np.where(near, self.inside, self.outside)


class Gaussian(Part):
    """`background + amplitude exp(-((position - center) / width)**2 / 2)`."""

    kind: Literal["gaussian"]
    background: Value
    """Value far away."""
    amplitude: Value
    """Added in the middle."""
    center: Center
    """Where it is largest."""
    width: HalfWidth
    """Standard deviation."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.background + self.amplitude * np.exp(-0.5 * ((position - self.center) / self.width) ** 2)


class Taper(Part):
    """`inside` within half_width, then a smooth step over `width` to `outside`.

    The step is B = (1 + tanh(w/(d - W - w) + w/(d - W))) / 2 for W < d < W + w, with d = |position - center|
    (Source: SCEC/USGS benchmark TPV101 description).
    """

    kind: Literal["taper"]
    inside: Value
    """Value within half_width."""
    outside: Value
    """Value beyond half_width + width."""
    center: Center
    """Middle of the profile."""
    half_width: HalfWidth
    """Where the step begins."""
    width: PositiveMetre
    """Length of the step."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        distance = np.abs(position - self.center)
        step = np.where(distance <= self.half_width, 1.0, 0.0)
        ramp = (distance > self.half_width) & (distance < self.half_width + self.width)
        over = distance[ramp] - self.half_width
        step[ramp] = 0.5 * (1 + np.tanh(self.width / (over - self.width) + self.width / over))
        return self.outside + (self.inside - self.outside) * step


class Cone(Part):
    """`tip + slope |position - center|`, at most `limit`; with slope = 1 / v the arrival time of a rupture."""

    kind: Literal["cone"]
    slope: float
    """Change per distance."""
    center: Center
    """Where the tip is."""
    tip: Value = 0.0
    """Value at the center."""
    limit: Value | None = None
    """Largest value."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        values = self.tip + self.slope * np.abs(position - self.center)
        return values if self.limit is None else np.minimum(values, self.limit)


class Parabola(Part):
    """`tip + (position - center)^2 / (2 radius)`: as a gap, a cylinder of that radius on a plane."""

    kind: Literal["parabola"]
    radius: PositiveMetre
    """Of curvature at the tip."""
    center: Center
    """Where the tip is."""
    tip: Value = 0.0
    """Value at the center."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.tip + (position - self.center) ** 2 / (2 * self.radius)


class Sinusoid(Part):
    """`mean + amplitude cos(2 pi position / wavelength + phase)`."""

    kind: Literal["sinusoid"]
    amplitude: Value
    """Of the cosine."""
    wavelength: PositiveMetre
    """Of the cosine."""
    mean: Value = 0.0
    """Added to it."""
    phase: Annotated[float, Unit("rad")] = 0.0
    """Of the cosine at position 0."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        return self.mean + self.amplitude * np.cos(2 * np.pi * position / self.wavelength + self.phase)


class SelfAffine(Part):
    """A self-affine rough profile, the same for a seed on any mesh and any rank count.

    The sum of a_k cos(q_k x + phi_k), q_k = 2 pi k / length, with phases of the seed. Between the wavelengths `rolloff`
    and `shortest` the heights a_k^2 fall as q^-(1 + 2 hurst), from `longest` to `rolloff` they are equal. The root mean
    square of the heights over `length`, after which the profile repeats itself, is exactly `rms`.
    Source: Hu and Tonder (1992); Yastrebov, Anciaux, Molinari (2017).
    """

    kind: Literal["self_affine"]
    rms: Annotated[Value, Field(ge=0)]
    """Root mean square of the heights."""
    hurst: Annotated[float, Field(gt=0, lt=1), Unit("1")]
    """Hurst exponent."""
    length: PositiveMetre
    """Period of the profile."""
    longest: PositiveMetre
    """Longest wavelength."""
    shortest: PositiveMetre
    """Shortest wavelength."""
    rolloff: PositiveMetre | None = None
    """Without it, `longest`."""
    seed: Annotated[int, Field(ge=0)]
    """Of the random numbers."""
    mean: Value = 0.0
    """Added to it."""

    @model_validator(mode="after")
    def _ordered(self) -> SelfAffine:
        rolloff = self.longest if self.rolloff is None else self.rolloff
        if not self.shortest <= rolloff <= self.longest <= self.length:
            raise ValueError(
                f"wavelengths need shortest <= rolloff <= longest <= length, these are {self.shortest:g}, {rolloff:g}, "
                f"{self.longest:g} and {self.length:g} m"
            )
        if not len(self._waves()):
            raise ValueError(
                f"no wavelength length / k is between shortest = {self.shortest:g} and longest = {self.longest:g} m"
            )
        return self

    def _waves(self) -> np.ndarray:
        """Numbers k of the waves."""
        return np.arange(np.ceil(self.length / self.longest - 1e-9), np.floor(self.length / self.shortest + 1e-9) + 1)

    def __call__(self, position: np.ndarray) -> np.ndarray:
        wavenumber = 2 * np.pi * self._waves() / self.length
        amplitude = np.maximum(wavenumber, 2 * np.pi / (self.rolloff or self.longest)) ** (-0.5 - self.hurst)
        amplitude *= self.rms / np.sqrt(0.5 * np.sum(amplitude**2))
        phase = np.random.default_rng(self.seed).uniform(0, 2 * np.pi, len(wavenumber))
        return self.mean + np.cos(np.outer(position, wavenumber) + phase) @ amplitude


class Random(Part):
    """Gaussian random field with an exponential correlation, the same for a seed on any mesh and any rank count.

    Built from `modes` random cosines whose wavenumbers follow the Cauchy law, the spectrum of the correlation
    exp(-|d| / correlation_length); clipped at three standard deviations.
    """

    kind: Literal["random"]
    mean: Value
    """Of the field."""
    standard_deviation: Annotated[Value, Field(ge=0)]
    """Of the field; values beyond three of them are clipped."""
    correlation_length: PositiveMetre
    """Distance over which the correlation falls by 1/e."""
    seed: Annotated[int, Field(ge=0)]
    """Of the random numbers."""
    modes: Annotated[int, Field(ge=16)] = 512
    """Number of cosines."""

    def __call__(self, position: np.ndarray) -> np.ndarray:
        random = np.random.default_rng(self.seed)
        wavenumber = random.standard_cauchy(self.modes) / self.correlation_length
        phase = random.uniform(0, 2 * np.pi, self.modes)
        field = np.sqrt(2 / self.modes) * np.cos(np.outer(position, wavenumber) + phase).sum(axis=1)
        return self.mean + self.standard_deviation * np.clip(field, -3, 3)


class RandomClasses(Part):
    """Discrete values drawn with given weights, one draw per cell of length `cell` along the interface."""

    kind: Literal["random_classes"]
    values: list[Value]
    """One of them for each cell."""
    weights: list[Annotated[float, Field(ge=0)]]
    """How often, relative to each other; one for each value."""
    cell: PositiveMetre
    """Length of a cell."""
    seed: Annotated[int, Field(ge=0)]
    """Of the random numbers."""

    @model_validator(mode="after")
    def _matching(self) -> RandomClasses:
        if len(self.values) != len(self.weights) or sum(self.weights) <= 0:
            raise ValueError("values and weights need the same length and a positive total weight")
        return self

    def __call__(self, position: np.ndarray) -> np.ndarray:
        edges = np.cumsum(self.weights) / np.sum(self.weights)
        cells = np.floor(position / self.cell).astype(np.int64)
        # One generator per cell, so that the draw of a cell does not depend on how many others a rank holds.
        unique, inverse = np.unique(cells, return_inverse=True)
        draws = np.array([np.random.default_rng([self.seed, cell % 2**32]).random() for cell in unique])
        chosen = np.minimum(np.searchsorted(edges, draws[inverse]), len(self.values) - 1)
        return np.asarray(self.values)[chosen]


class Table(Part):
    """Interpolation between given points, which cover the interface unless `extend` is set."""

    kind: Literal["table"]
    interpolation: Literal["linear", "cubic"] = "linear"
    """`cubic`: the spline whose curvature is continuous (not-a-knot ends), for measured surfaces."""
    positions: list[Position] = []
    """At least two, increasing."""
    values: list[Value] = []
    """One for each position."""
    extend: bool = False
    """Beyond the ends the first and the last value go on."""
    file: str | None = None
    """CSV file with two columns, position and value, instead; relative to the case file. Lines before the first number
    and lines that begin with # are skipped. The resolved case holds its numbers."""

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, values: object, info: ValidationInfo) -> object:
        return with_file_read(values, info, "positions", "position")

    @field_validator("positions")
    @classmethod
    def _increasing(cls, positions: list[float]) -> list[float]:
        if len(positions) < 2 or np.any(np.diff(positions) <= 0):
            raise ValueError("positions must increase and be at least two")
        return positions

    @model_validator(mode="after")
    def _matching(self) -> Table:
        if len(self.values) != len(self.positions):
            raise ValueError("values and positions need the same length")
        return self

    def __call__(self, position: np.ndarray) -> np.ndarray:
        first, last = self.positions[0], self.positions[-1]
        slack = 1e-9 * (last - first)  # rounding of coordinates
        if not self.extend and len(position) and not first - slack <= position.min() <= position.max() <= last + slack:
            raise CaseError(
                f"the table from {first:.6g} to {last:.6g} m does not cover the interface, which has points from "
                f"{position.min():.6g} to {position.max():.6g} m; add to the table, or set extend = true to go on with "
                "its first and last value"
            )
        if self.interpolation == "cubic":
            from scipy.interpolate import CubicSpline

            return CubicSpline(self.positions, self.values)(np.clip(position, first, last))
        return np.interp(position, self.positions, self.values)


KINDS: dict[str, type[Part]] = {
    "constant": Constant,
    "boxcar": Boxcar,
    "gaussian": Gaussian,
    "taper": Taper,
    "cone": Cone,
    "parabola": Parabola,
    "sinusoid": Sinusoid,
    "self_affine": SelfAffine,
    "random": Random,
    "random_classes": RandomClasses,
    "table": Table,
}


def varying(number: object, unit: str) -> Any:
    """Field type: a number of the given type, or a table with the ``kind`` of a profile."""
    of_key = Unit(unit)

    def tag(value: object) -> str:
        if isinstance(value, Mapping):
            return f"<{value.get('kind')}>"
        return f"<{getattr(value, 'kind')}>" if isinstance(value, tuple(KINDS.values())) else "<number>"  # noqa: B009

    def read(value: object) -> object:
        """Texts in a table that have the unit of the key, as numbers."""
        kind = value.get("kind") if isinstance(value, Mapping) else None
        if not isinstance(value, Mapping) or not isinstance(kind, str) or kind not in KINDS:
            return value
        cls = KINDS[kind]
        marked = {name for name in cls.model_fields if has_mark(cls, name, _OfKey)}
        return {key: of_key.read(item) if key in marked else item for key, item in value.items()}

    members = [Annotated[number, Tag("<number>")], *(Annotated[cls, Tag(f"<{kind}>")] for kind, cls in KINDS.items())]
    return Annotated[
        Union[tuple(members)],  # noqa: UP007
        Discriminator(
            tag,
            custom_error_type="unknown_kind",
            custom_error_message=f"a profile needs a 'kind', one of: {', '.join(KINDS)}",
        ),
        Bound(number),
        BeforeValidator(read),
        of_key,
    ]


def evaluate(value: object, position: np.ndarray) -> np.ndarray:
    """A number or a profile at the points, shape (n,)."""
    return value(position) if callable(value) else np.broadcast_to(np.asarray(value, float), position.shape).copy()
