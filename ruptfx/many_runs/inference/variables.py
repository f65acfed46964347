"""Unknowns as the variables of an optimisation: scales, bounds and priors.

A number is an offset from the value of the case, with `log` the logarithm of a factor; box bounds hold for it. Knots
are such numbers at given positions, between which the offset is linear. A field
has the Gaussian prior with covariance sigma^2 exp(-|x - y| / l), Green's function of the Helmholtz operator
(1 - l^2 d^2/dx^2) / (2 l sigma^2). Along the points of a line its inverse is tridiagonal, with the exact factor

    z_0 = s_0 / sigma        z_i = (s_i - r_i s_(i-1)) / (sigma sqrt(1 - r_i^2))        r_i = exp(-(x_i - x_(i-1)) / l)

so that |z|^2 / 2 is the prior. The variables are z, in which the prior is uniform in all directions. A field with
bounds is a logistic function of s with slope 1 at the value of the case.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from scipy.special import expit, logit

from ruptfx.input.profiles import evaluate
from ruptfx.input.schema import CaseError
from ruptfx.laws.friction import FrictionLaw
from ruptfx.many_runs.adjoint.unknowns import hats, whole
from ruptfx.readings.misfits import Unknown

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.interface import Interface
    from ruptfx.many_runs.adjoint.unknowns import Place
    from ruptfx.run.model import Model

Floats = NDArray[np.float64]
SAME = 1e-9
"""Largest relative difference of values of tied keys in the case."""


def values_of_case(model: Model, place: Place) -> Floats:
    """Return the value of a single key in the case, at the points of this rank."""
    if place.term is not None:
        number, name = place.term
        return np.array([float(getattr(model.case.objective[number], name))])
    fault = model.faults[place.fault]
    face = fault.interface
    if place.nucleation is not None:
        number = int(place.key.split(".")[-2])
        return np.asarray(evaluate(fault.nucleation[number].extra, face.locations) + np.zeros(len(face.position)))  # type: ignore[attr-defined]
    total = np.zeros(len(face.position))
    for name, part in place.rows:
        if name == "normal_stress_0":
            total += part * fault.normal_stress_0
        elif name.startswith("shear_traction_0_"):
            total += part * fault.shear_traction_0[:, int(name.rpartition("_")[2])]
        else:
            law: FrictionLaw = fault.friction
            suffix = name.removeprefix("p_")
            while suffix not in type(law).model_fields:
                law, suffix = law.law, suffix.removeprefix("law_")  # type: ignore[attr-defined]
            total += part * getattr(law, suffix)
    return total


def start_values(model: Model, place: Place, key: str) -> Floats:
    """Return an unknown as the case has it, at all points of its interface or as one number; collective.

    Raises
    ------
    CaseError
        Tied keys that vary along their interface, or do not have one value times their factors.
    """
    starts = []
    for member, factor in place.members:
        values = values_of_case(model, member)
        if member.of_points:
            values = whole(model, model.faults[member.fault].interface, values)
        starts.append(values / factor)
    if not place.tied:
        return starts[0]
    first, low, high = starts[0][0], min(map(np.min, starts)), max(map(np.max, starts))
    if high - low > SAME * max(abs(low), abs(high)):
        listed = ", ".join(
            f"'{member.key}' is {factor * part.min():g}" + (f" to {factor * part.max():g}" if np.ptp(part) else "")
            for (member, factor), part in zip(place.tied, starts, strict=True)
        )
        raise CaseError(
            f"{key}: {listed} in the case; give all of them one value, times their factors, or make each an unknown"
        )
    return np.array([first])


class Variable:
    """One unknown as variables z; z = 0 is the case.

    Parameters
    ----------
    key : str
        Of the entry, for messages.

    Attributes
    ----------
    size : int
        Number of variables.
    position : ndarray, shape (n,)
        Positions of all points of the interface in their order [m].
    start : ndarray, shape (n,)
        Values of the case.
    box : tuple of float
        Bounds of each variable.
    on_surface : bool
        True if the points lie on a surface, along which no table of a line gives the values.

    Raises
    ------
    CaseError
        On all ranks: bounds that exclude the case, a field without a prior, knots that are outside of the interface,
        a logarithm of a value that is not positive.
    """

    def __init__(self, model: Model, unknown: Unknown, place: Place, key: str) -> None:
        self.unknown, self.place = unknown, place
        face = model.faults[max(place.fault, 0)].interface
        self.position, self.start = np.zeros(1), start_values(model, place, f"{key}.key = '{unknown.key}'")
        self.on_surface = place.of_points and face.across is not None
        if place.of_points:
            self.position = whole(model, face, face.position)
        elif unknown.bounds is None and any(member.term is not None for member, _ in place.members):
            raise CaseError(f"{key}.bounds: '{unknown.key}' needs some, within which the data stay in the run")
        elif unknown.shape != "number":
            raise CaseError(f"{key}.shape = '{unknown.shape}': '{unknown.key}' is one number; use shape = 'number'")
        low, high = unknown.bounds or (-np.inf, np.inf)
        if unknown.scale == "log" and self.start.min() <= 0:
            raise CaseError(
                f"{key}.scale = 'log': '{unknown.key}' is {self.start.min():g} in the case, and its logarithm needs "
                "positive values; use 'linear'"
            )
        inside = (low < self.start) & (self.start < high)
        if not inside.all():
            unit = f" {place.unit}" if place.unit != "1" else ""
            raise CaseError(
                f"{key}.bounds = {unknown.bounds}: do not contain the value of the case, "
                f"{self.start[np.argmin(inside)]:g}{unit}, from which the search begins, between them; widen them, or "
                "change the case"
            )
        self._t0 = self._t(self.start)
        self._low, self._high = ((-np.inf, np.inf) if unknown.bounds is None else
                                 (float(self._t(np.array(low))), float(self._t(np.array(high)))))  # fmt: skip
        if unknown.shape == "field":
            self._begin_field(face, key)
        else:
            number = unknown.shape == "number"
            self._basis = np.ones((len(self.start), 1)) if number else hats(unknown, face, self.position, key)
            self._begin_numbers()

    @property
    def keys(self) -> list[tuple[str, float]]:
        """Keys of the case that have its value, times factors."""
        return [(place.key, factor) for place, factor in self.place.members]

    def _t(self, values: Floats) -> Floats:
        return np.log(values) if self.unknown.scale == "log" else values

    def _begin_numbers(self) -> None:
        self.size = self._basis.shape[1]
        low, high = float(np.max(self._low - self._t0)), float(np.min(self._high - self._t0))
        width = 0.25 * (high - low)  # without a prior: a change that counts as one
        if not np.isfinite(width):
            width = 1.0 if self.unknown.scale == "log" else 0.1 * float(np.abs(self.start).max()) or 1.0
        self._sigma = self.unknown.sigma or width
        self.box = low / self._sigma, high / self._sigma

    def _begin_field(self, face: Interface, key: str) -> None:
        unknown = self.unknown
        if unknown.sigma is None or unknown.correlation_length is None:
            raise CaseError(
                f"{key}.sigma, correlation_length: a field is recovered with a prior; give both, or shape = 'number'"
            )
        if face.across is not None:
            raise CaseError(f"{key}.shape = 'field': priors are along lines, and this is a surface; use 'number'")
        self.size, self.box, self._sigma = len(self.start), (-np.inf, np.inf), unknown.sigma
        self._order = np.argsort(self.position, kind="stable")
        ratio = np.exp(-np.diff(self.position[self._order]) / unknown.correlation_length)
        spread = np.concatenate([[1.0], np.sqrt(-np.expm1(2 * np.log(ratio)))])
        self._bands = np.zeros((2, self.size))  # of the lower factor: diagonal, and below it
        self._bands[0] = 1.0 / (self._sigma * spread)
        self._bands[1, :-1] = -ratio / (self._sigma * spread[1:])
        upper = np.zeros((2, self.size))
        upper[1], upper[0, 1:] = self._bands[0], self._bands[1, :-1]
        self._upper = upper

    def profile_on_surface(self, value: object, values: Floats) -> dict[str, object]:
        """Return the profile of a number on a surface, from that of the case and the values at all points."""
        if self.unknown.scale == "log":
            return {"kind": "product", "value": value, "factor": float(values[0] / self.start[0])}
        return {"kind": "sum", "terms": [value, float(values[0] - self.start[0])]}

    @property
    def has_prior(self) -> bool:
        """True if |z|^2 / 2 is added to the misfit."""
        return self.unknown.sigma is not None

    def _offset(self, z: Floats) -> Floats:
        if self.unknown.shape != "field":
            return self._sigma * (self._basis @ z)
        offset = np.empty(self.size)
        offset[self._order] = solve_banded((1, 0), self._bands, z)
        return offset

    def values(self, z: Floats) -> Floats:
        """Return the unknown at all points of the interface."""
        return self._at(self._offset(z))

    def _at(self, s: Floats) -> Floats:
        if self.unknown.shape == "field" and self.unknown.bounds is not None:
            values = self._value(self._low + (self._high - self._low) * expit(self._logistic(s)))
        else:
            values = self._value(self._t0 + s)
        if self.unknown.bounds is not None:  # rounding
            values = np.clip(values, self.unknown.bounds[0], self.unknown.bounds[1])
        return values

    def _value(self, t: Floats) -> Floats:
        return np.exp(t) if self.unknown.scale == "log" else t

    def _logistic(self, s: Floats) -> Floats:
        part = (self._t0 - self._low) / (self._high - self._low)
        return logit(part) + s / ((self._high - self._low) * part * (1 - part))

    def _slope(self, z: Floats) -> Floats:
        """Return the derivative of the values by the offset s."""
        slope = self.values(z) if self.unknown.scale == "log" else np.ones(len(self.start))
        if self.unknown.shape == "field" and self.unknown.bounds is not None:
            part = (self._t0 - self._low) / (self._high - self._low)
            now = expit(self._logistic(self._offset(z)))
            slope = slope * now * (1 - now) / (part * (1 - part))
        return slope

    def push(self, z: Floats, change: Floats) -> Floats:
        """Return the change of the values at the points from that of z."""
        return self._slope(z) * self._offset(change)

    def pull(self, z: Floats, gradient: Floats) -> Floats:
        """Return the derivative by z from that by the values at the points."""
        by = gradient * self._slope(z)
        if self.unknown.shape != "field":
            return np.asarray(self._sigma * (self._basis.T @ by))
        return solve_banded((0, 1), self._upper, by[self._order])

    def interval(self, z: Floats, spread: Floats) -> Floats:
        """Return the values one standard deviation below and above those of z, shape (2, n).

        Parameters
        ----------
        z : ndarray, shape (size,)
        spread : ndarray, shape (size, m)
            S of the covariance S S' of z.
        """
        deviation = np.sqrt(sum(self._offset(column) ** 2 for column in spread.T))
        with np.errstate(over="ignore"):  # what the data do not determine
            values = np.array([self._at(self._offset(z) + part * deviation) for part in (-1.0, 1.0)])
        return values

    def at_bound(self, z: Floats) -> bool:
        """Return whether the unknown is at one of its bounds somewhere, within a thousandth of their distance."""
        if self.unknown.bounds is None:
            return False
        t = self._t(self.values(z))
        near = 1e-3 * (self._high - self._low)
        return bool(np.any((t < self._low + near) | (t > self._high - near)))
