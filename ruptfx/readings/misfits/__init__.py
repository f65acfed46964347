"""Terms of an objective, one kind per file; the file name is the `kind` of an entry of ``[[objective]]``.

A term is a function of readings of a run that are linear in its fields: traces of instruments at given times, or a
field of an interface at the end. It returns its value and the derivative by every reading; the adjoint sweep
(`ruptfx.many_runs.adjoint`) does the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ruptfx.input.schema import Alternative, Part, Unit, alternative
from ruptfx.input.units import Duration, Length, Positive, Speed, Time, without_unit
from ruptfx.readings.instruments import Channel

if TYPE_CHECKING:
    from ruptfx.readings.instruments.model_readings import ModelReadings

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """One channel at given times.

    Attributes
    ----------
    channel : Channel
    times : ndarray, shape (m,), or None
        [s]; None for every step, where a channel has one source.
    bandwidth : float, optional
        Frequency of half power of a low-pass filter [Hz].
    """

    channel: Channel
    times: Floats | None
    bandwidth: float | None = None


@dataclass(frozen=True)
class Final:
    """A field of an interface at the end of the run, at all its points in their order.

    Attributes
    ----------
    fault, field : str
    """

    fault: str
    field: str


@dataclass(frozen=True)
class Sample:
    """Values of a reading, the same on all ranks.

    Attributes
    ----------
    at : ndarray, shape (m,)
        Times [s] of a trace, positions [m] of a final field.
    values : ndarray, shape (m,)
    weights : ndarray, shape (m,)
        Tributary lengths of the points [m] of a final field; 1 of a trace.
    slopes : ndarray, shape (m,), optional
        Derivatives of the values of a trace by its times.
    """

    at: Floats
    values: Floats
    weights: Floats
    slopes: Floats | None = None


@dataclass(frozen=True)
class Measured:
    """Data of a reading.

    Attributes
    ----------
    name : str
        Instrument and channel.
    times : ndarray, shape (m,)
        [s]
    values : ndarray, shape (m,)
        In the SI unit of the channel.
    unit : str
    missing : int
        Number of further times without a sample.
    """

    name: str
    times: Floats
    values: Floats
    unit: str = "1"
    missing: int = 0


Request = Trace | Final


class Misfit(Alternative):
    """Contract of a term of an objective."""

    example: ClassVar[str] = ""
    """Example table for a case of two plates in plane stress, 12 mm long and 4 mm high each, with a fault receiver
    named `fault` at 5.3 mm."""
    unit: ClassVar[str] = "1"
    """Unit of the value; terms of one objective have the same."""
    offers_with: ClassVar[dict[str, str]] = {"residuals": "squares"}

    @property
    def parameters(self) -> dict[str, str]:
        """Fields of the term that change what it expects of its readings and may be unknowns, with their units."""
        return {}

    def unit_of_field(self, name: str) -> str:
        return self.parameters.get(name) or super().unit_of_field(name)

    def requests(self, bodies: ModelReadings, key: str) -> list[Request]:
        """Return the readings that the term needs; collective.

        Raises
        ------
        CaseError
            On all ranks, if the case does not have them, or data are outside of its duration.
        """
        raise NotImplementedError

    def evaluate(self, samples: Sequence[Sample]) -> tuple[float, list[Floats]]:
        """Return the value and its derivative by the values of each reading."""
        raise NotImplementedError

    def expected(self, samples: Sequence[Sample]) -> list[Floats]:
        """Return what the data of each reading would be without noise."""
        return [sample.values for sample in samples]

    def change(self, parameter: str, samples: Sequence[Sample]) -> list[Floats]:
        """Return the derivative of the values of each reading by one of the `parameters`."""
        raise NotImplementedError

    def residuals(self, samples: Sequence[Sample]) -> list[tuple[Floats, Floats]] | None:
        """Return residuals of each reading, half of whose squares the term sums, and their derivatives by its values.

        None if the term is no sum of squares.
        """
        return None

    def measured(self) -> list[Measured] | None:
        """Return the data of each reading, whose noise is independent; None if the term has no such data."""
        return None


class Unknown(Part):
    """A quantity of a case by which an objective is differentiated, and which `ruptfx infer` recovers."""

    key: Annotated[str, Field(min_length=1)]
    """Dotted key: `faults.main.initial_stress.shear`, `faults.main.friction.mu_s`, `faults.main.nucleation.0.extra`,
    or time shift, gain and offset of data, `objective.0.time_shift`, of all terms at once `objective.*.time_shift`; in
    `ruptfx gradient` also constants of bodies, `materials.default.density`."""
    tied: list[Annotated[str, Field(min_length=1)]] = []
    """Further keys in the unit of `key` whose values are those of `key` times `factors`: one unknown stands for all."""
    factors: list[float] | None = None
    """Values of the tied keys over that of `key`, one for each; default is 1."""
    shape: Literal["field", "number", "knots"] = "field"
    """Values at all points of the interface, one number that is added everywhere, or numbers that are added at knots
    and interpolated linearly between them."""
    knots: Annotated[list[float], Field(min_length=2), Unit("m")] | None = None
    """Positions of the knots along the interface."""
    scale: Literal["linear", "log"] = "linear"
    """`ruptfx infer` changes the value, or its logarithm: a number is then a factor."""
    bounds: Annotated[Annotated[list[float], Field(min_length=2, max_length=2)] | None, without_unit("the key")] = None
    """Smallest and largest value for `ruptfx infer`, numbers in the SI unit of the key or texts with a unit."""
    sigma: Annotated[Positive | None, without_unit("the key, with scale = 'log' of its logarithm")] = None
    """Prior standard deviation from the value of the case, a number in the SI unit of the key or a text with a unit,
    with `log` of its logarithm; a field needs one."""
    correlation_length: Length | None = None
    """Length over which the prior correlation of a field falls to 1/e."""

    @property
    def label(self) -> str:
        """The key, with those that are tied to it and their factors."""
        parts = [f"{key} = {factor:g} x" if factor != 1 else f"{key} =" for key, factor in self.ties]
        return " ".join([*reversed(parts), self.key])

    @property
    def ties(self) -> list[tuple[str, float]]:
        """Tied keys with their factors."""
        return list(zip(self.tied, self.factors or [1.0] * len(self.tied), strict=True))

    @model_validator(mode="after")
    def _complete(self) -> Unknown:
        if self.bounds is not None and not self.bounds[0] < self.bounds[1]:
            raise ValueError(f"bounds = {self.bounds}: the first must be below the second")
        if self.bounds is not None and self.scale == "log" and self.bounds[0] <= 0:
            raise ValueError(f"bounds = {self.bounds}: must be positive with scale = 'log'")
        if self.shape != "field" and self.correlation_length is not None:
            name = "a number has" if self.shape == "number" else "knots have"
            raise ValueError(f"correlation_length: {name} none; remove it, or set shape = 'field'")
        if self.tied and self.shape != "number":
            raise ValueError(f"tied: keys that are tied have one number, and shape = '{self.shape}'; use 'number'")
        if self.factors is not None and len(self.factors) != len(self.tied):
            raise ValueError(f"factors: {len(self.factors)} for {len(self.tied)} tied keys; give one for each")
        if 0.0 in (self.factors or ()):
            raise ValueError(f"factors = {self.factors}: must not be 0, a tied key would be 0 for all values of key")
        if (self.shape == "knots") != (self.knots is not None):
            raise ValueError("shape = 'knots' and knots belong together; give both or none")
        if self.knots is not None and any(b <= a for a, b in pairwise(self.knots)):
            raise ValueError(f"knots = {self.knots}: must increase")
        return self


class Inference(Part):
    """Search of `ruptfx infer` for the unknowns."""

    method: Literal["l_bfgs", "gauss_newton", "cma_es", "ensemble"] = "l_bfgs"
    """L-BFGS-B of SciPy with the gradients of `ruptfx gradient`; Gauss-Newton (trust-region least squares of SciPy)
    with forward sensitivities, one sweep for each variable; evolution by CMA-ES without derivatives; or a sample of
    the posterior by the ensemble sampler of emcee."""
    iterations: Annotated[int, Field(ge=1)] = 50
    """Largest number of iterations: with `gauss_newton` of runs, with `cma_es` of generations, with `ensemble` of steps
    of the walkers."""
    tolerance: Positive = 1e-4
    """Relative decrease of misfit and prior in an iteration at which it ends; with `cma_es` the range of the best ones
    of recent generations over the best one."""
    directions: Annotated[int, Field(ge=0)] = 0
    """Directions in which data and prior are compared for the band of fields; 0: no band. Each takes about two sweeps
    forward and two backward. Intervals of numbers and knots need none."""
    population: Annotated[int, Field(ge=4)] | None = None
    """Runs of a generation of `cma_es`, or walkers of `ensemble`; default is 4 + 3 ln n or 2 n + 2 for n variables."""
    seed: int = 0
    """Seed of `cma_es` and `ensemble`."""


class Reconstruction(Part):
    """Prior of the slip rate of an interface in `ruptfx reconstruct`, and its output.

    The slip rate is a Gaussian random field of mean zero with Matern covariances in space and time. Amplitude, length
    and time that are not given maximise the likelihood of the data, with a length of at least twice the mean distance
    of the points that sensors see best.
    """

    amplitude: Speed | None = None
    """Prior standard deviation of the slip rate."""
    length: Length | None = None
    """Correlation length of the slip rate along the interface, of a surface along its strike."""
    dip_length: Length | None = None
    """Correlation length down the dip of a surface; default is `length`."""
    time: Duration | None = None
    """Correlation time of the slip rate."""
    order: Literal["5/2", "3/2"] = "5/2"
    """Order of the Matern covariances: 5/2, or 3/2 for steeper fronts, which takes more modes and gives a fitted
    friction law with less bias and wider intervals."""
    begin: Time = 0.0
    """Time before which nothing slips."""
    interval: Duration | None = None
    """Time between the instants at which the slip rate is computed, linear between them; default is the shortest
    interval of the data."""
    samples: Annotated[int, Field(ge=2)] = 64
    """Number of samples of the slip rate and its tractions; with `positive` each has a run."""
    seed: int = 0
    """Seed of the samples."""
    positive: bool = False
    """Set slip rates of samples against the direction of the initial shear stress to zero."""
    positions: Annotated[list[float], Field(min_length=1), Unit("m")] | None = None
    """Positions of the curves of traction against slip; default are four where the slip rate is known best.
    The friction law of the case is fitted there, by default at up to 12 of known slip rate."""
    points: Annotated[list[Annotated[list[float], Field(min_length=3, max_length=3)]], Field(min_length=1),
                      Unit("m")] | None = None  # fmt: skip
    """The same in 3D: points of the surface, each [x, y, z]."""
    map_times: Annotated[list[float], Field(min_length=1), Unit("s")] | None = None
    """Times of the maps of a surface; default are six while it slips."""


if TYPE_CHECKING:
    AnyMisfit = Misfit
else:
    AnyMisfit = alternative("ruptfx.readings.misfits")
