"""Gaussian prior and posterior of a slip rate along an interface and in time, and of unknown clocks, gains and offsets.

The prior covariance is a product of Matern functions of order 5/2 or 3/2 of distance and of time. On a surface
distances down dip are scaled by the ratio of both lengths, and both components of the slip rate are independent. The
eigenvectors of both functions with all but `TAIL` of the variance are the modes Phi of space and Psi of time:
V = Phi c Psi' with independent normal coefficients c. With B the derivative of the data by the coefficients over the
standard deviation of the noise,
the posterior of data d over their standard deviations is computed in the space of the data, or of the coefficients,
whichever is smaller, by the Cholesky factor L of

    B B' + I = L L'    mean = B' (L L')^-1 d    covariance = I - W' W with W = L^-1 B
    B' B + I = L L'    mean = (L L')^-1 B' d    covariance = Z' Z with Z = L^-1

The factor depends on sensors, noise and prior, not on the data. Products with B are those by FFT in time.

Source: Rasmussen and Williams (2006); samples by Matheron's rule, Journel and Huijbregts (1978).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
TAIL = 1e-4
"""Part of the prior variance that the modes of space, and those of time, do not contain."""
SUBSET = 1000
"""Largest number of data of which the likelihood is maximised."""


@dataclass(frozen=True)
class Prior:
    """Modes of the slip rate.

    Attributes
    ----------
    space : ndarray, shape (n, r)
        [m/s]; of a surface its n columns are those of both tangents.
    time : ndarray, shape (knots, s)
    """

    space: Floats
    time: Floats

    @classmethod
    def of_lengths(
        cls, amplitude: float, length: float, time: float, position: Floats, times: Floats, *, tail: float = TAIL,
        order: str = "5/2",
    ) -> Prior:  # fmt: skip
        """Return the modes for a standard deviation [m/s] and correlation lengths in space [m] and time [s].

        Positions of the shape (n, 2) are those of a surface, after `stretched`.
        """
        space = np.asarray(amplitude * modes(position, length, tail, order), np.float64)
        if position.ndim == 2:
            space = np.asarray(np.kron(np.eye(2), space), np.float64)
        return cls(space, modes(times, time, tail, order))

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return int(self.space.shape[1] * self.time.shape[1])

    def of_modes(self, coefficients: Floats) -> Floats:
        """Return the time histories of the modes of space, shape (..., knots, r)."""
        shaped = coefficients.reshape(*coefficients.shape[:-1], self.space.shape[1], self.time.shape[1])
        return np.asarray(np.einsum("tp,...mp->...tm", self.time, shaped, optimize=True))

    def fields(self, coefficients: Floats, weights: Floats | None = None) -> Floats:
        """Return slip rates at the knots, shape (..., knots, n).

        With weights, shape (times, knots), return sums over the knots, shape (..., times, n).
        """
        time = self.time if weights is None else weights @ self.time
        shaped = coefficients.reshape(*coefficients.shape[:-1], self.space.shape[1], self.time.shape[1])
        return np.asarray(np.einsum("tp,...mp,xm->...tx", time, shaped, self.space, optimize=True))

    def deviation(self, weights: Floats | None = None) -> Floats:
        """Return the prior standard deviation of what `fields` returns, shape (times, n)."""
        time = self.time if weights is None else weights @ self.time
        return np.sqrt(np.outer((time**2).sum(axis=1), (self.space**2).sum(axis=1)))

    def of_columns(self, combine: Callable[[Floats], Floats]) -> Prior:
        """Return the prior of linear combinations of the columns, a function of rows of columns."""
        return Prior(np.ascontiguousarray(combine(self.space.T).T), self.time)


def matern(distance: Floats, length: float, order: str) -> Floats:
    """Return the Matern correlation of order 5/2 or 3/2 at distances."""
    scaled = np.sqrt(5.0 if order == "5/2" else 3.0) * np.abs(distance) / length
    return np.asarray((1 + scaled + (scaled**2 / 3 if order == "5/2" else 0.0)) * np.exp(-scaled))


def stretched(position: Floats, length: float, dip_length: float | None) -> Floats:
    """Return positions, of a surface scaled down dip so that its correlation length there is `length`, too."""
    scale = np.array([1.0, length / (dip_length or length)])
    return position if position.ndim == 1 else np.asarray(position * scale)


def modes(points: Floats, length: float, tail: float = TAIL, order: str = "5/2") -> Floats:
    """Return scaled eigenvectors of the Matern covariance of points, shape (points, modes), without a tail."""
    values, vectors = np.linalg.eigh(_covariance(points, length, order))
    values, vectors = values[::-1], vectors[:, ::-1]
    count = _count(values, tail)
    return np.asarray(vectors[:, :count] * np.sqrt(np.maximum(values[:count], 0.0)))


def count_modes(points: Floats, length: float, tail: float = TAIL, order: str = "5/2") -> int:
    """Return the number of `modes`."""
    return _count(np.linalg.eigvalsh(_covariance(points, length, order))[::-1], tail)


def _covariance(points: Floats, length: float, order: str) -> Floats:
    apart = points[:, None] - points
    return matern(apart if apart.ndim == 2 else np.linalg.norm(apart, axis=2), length, order)


def _count(values: Floats, tail: float) -> int:
    beyond = len(values) - np.cumsum(values)
    return 1 + int(np.argmax(beyond <= max(tail, 1e-14) * len(values)))


@dataclass(frozen=True)
class Rows:
    """Data that depend on the slip rate.

    Attributes
    ----------
    kernels : ndarray, shape (kernels, knots, n)
        Readings from a first knot of 1 m/s.
    kernel, lag : ndarray of int, shape (data,)
        Kernel of each datum, and how many knots after the first one it is.
    values, sigma : ndarray, shape (data,)
        Data without the response to known loads, and standard deviations of their noise.
    """

    kernels: Floats
    kernel: Integers
    lag: Integers
    values: Floats
    sigma: Floats

    def some(self, index: Integers) -> Rows:
        """Return some of the data."""
        return Rows(self.kernels, self.kernel[index], self.lag[index], self.values[index], self.sigma[index])

    def design(self, prior: Prior) -> Floats:
        """Return the derivatives of the data by the coefficients over sigma, shape (data, coefficients)."""
        return Products(prior, self).matrix()


class Products:
    """Products with the derivatives B of data by coefficients over sigma, by FFT in time."""

    def __init__(self, prior: Prior, rows: Rows) -> None:
        from scipy import fft

        self._prior, self._rows = prior, rows
        self._length = fft.next_fast_len(2 * len(prior.time), real=True)
        self._spectra = fft.rfft(rows.kernels @ prior.space, self._length, axis=1)  # (kernels, frequencies, modes)

    def matrix(self) -> Floats:
        """Return B, shape (data, coefficients)."""
        from scipy import fft

        prior, rows = self._prior, self._rows
        in_time = fft.rfft(prior.time, self._length, axis=0)
        result = np.empty((len(rows.kernel), prior.space.shape[1], prior.time.shape[1]))
        for number in np.unique(rows.kernel):  # that of zeros included
            mine = np.flatnonzero(rows.kernel == number)
            both = fft.irfft(self._spectra[number][:, :, None] * in_time[:, None, :], self._length, axis=0)
            result[mine] = both[rows.lag[mine]] / rows.sigma[mine, None, None]
        return result.reshape(len(rows.kernel), -1)

    def forward(self, coefficients: Floats) -> Floats:
        """Return B c, shape (..., data), of coefficients, shape (..., coefficients)."""
        from scipy import fft

        rows, rates = self._rows, fft.rfft(self._prior.of_modes(coefficients), self._length, axis=-2)
        readings = fft.irfft(np.einsum("kfm,...fm->...fk", self._spectra, rates), self._length, axis=-2)
        return np.asarray(readings[..., rows.lag, rows.kernel] / rows.sigma)

    def adjoint(self, values: Floats) -> Floats:
        """Return B' d, shape (coefficients,), of values d, shape (data,)."""
        from scipy import fft

        prior, rows = self._prior, self._rows
        series = np.zeros((len(prior.time), len(rows.kernels)))
        np.add.at(series, (rows.lag, rows.kernel), values / rows.sigma)
        spectrum = np.einsum("kfm,fk->fm", np.conj(self._spectra), fft.rfft(series, self._length, axis=0))
        in_modes = fft.irfft(spectrum, self._length, axis=0)[: len(prior.time)]
        return np.asarray((in_modes.T @ prior.time).ravel())


class Posterior:
    """Posterior of the coefficients of a prior and of further unknowns.

    Parameters
    ----------
    prior : Prior
    rows : Rows
    columns : ndarray, shape (data, extra), optional
        Changes of the data by one prior standard deviation of further unknowns.
    factor : ndarray, optional
        `factor` of a posterior of the same prior, rows and columns, whose data differ.

    Attributes
    ----------
    mean : ndarray, shape (coefficients,)
    extra, extra_deviation : ndarray, shape (extra,)
        Further unknowns and their posterior standard deviations, over those of the prior.
    fit : ndarray, shape (data,)
    factor : ndarray
        Lower triangle L.
    """

    def __init__(self, prior: Prior, rows: Rows, columns: Floats | None = None, factor: Floats | None = None) -> None:
        self.prior, self._rows = prior, rows
        self._columns = np.zeros((len(rows.values), 0)) if columns is None else columns / rows.sigma[:, None]
        self._products = Products(prior, rows)
        self._in_data = len(rows.values) <= prior.size + self._columns.shape[1]
        self.factor = self._factorised() if factor is None else factor
        mean = self.solution(rows.values)
        self.mean, self.extra = mean[: prior.size], mean[prior.size :]
        self.fit = rows.sigma * self._forward(mean)

    def _factorised(self) -> Floats:
        from scipy.linalg import cholesky

        design = self._design
        product = design @ design.T if self._in_data else design.T @ design
        product[np.diag_indices_from(product)] += 1.0
        return np.asarray(cholesky(product, lower=True, overwrite_a=True, check_finite=False))

    @cached_property
    def _design(self) -> Floats:
        return np.hstack([self._products.matrix(), self._columns])

    @cached_property
    def _half(self) -> Floats:
        """W in the space of the data, else Z."""
        from scipy.linalg import solve_triangular

        right = self._design if self._in_data else np.eye(len(self.factor))
        return np.asarray(solve_triangular(self.factor, right, lower=True, check_finite=False))

    def _forward(self, coefficients: Floats) -> Floats:
        size = self.prior.size
        return self._products.forward(coefficients[..., :size]) + coefficients[..., size:] @ self._columns.T

    def _adjoint(self, values: Floats) -> Floats:
        return np.concatenate([self._products.adjoint(values), self._columns.T @ values])

    def _solved(self, right: Floats) -> Floats:
        from scipy.linalg import cho_solve

        # The transpose is in the order of LAPACK: without it every solution would copy the factor.
        return np.asarray(cho_solve((self.factor.T, False), right, check_finite=False))

    def solution(self, values: Floats) -> Floats:
        """Return the mean of the coefficients and further unknowns for other values of the data, shape (data,)."""
        scaled = values / self._rows.sigma
        return self._adjoint(self._solved(scaled)) if self._in_data else self._solved(self._adjoint(scaled))

    @property
    def change(self) -> Floats:
        """Changes of the data by the mean of further unknowns, shape (data,)."""
        return np.asarray(self._rows.sigma * (self._columns @ self.extra))

    @property
    def extra_deviation(self) -> Floats:
        """Posterior standard deviations of further unknowns over those of the prior, shape (extra,)."""
        from scipy.linalg import solve_triangular

        size, count = self.prior.size, self._columns.shape[1]
        if not count:
            return np.zeros(0)
        right = self._columns if self._in_data else np.eye(size + count, count, -size)
        squares = np.sum(solve_triangular(self.factor, right, lower=True, check_finite=False) ** 2, axis=0)
        return np.sqrt(np.maximum(1 - squares if self._in_data else squares, 0.0))

    def deviation(self, weights: Floats | None = None, prior: Prior | None = None) -> Floats:
        """Return the posterior standard deviation of what `Prior.fields` returns, shape (times, n).

        It may be that of `Prior.of_columns` of the prior.
        """
        prior = prior or self.prior
        time = prior.time if weights is None else weights @ prior.time
        half = self._half[:, : prior.size].reshape(len(self._half), prior.space.shape[1], prior.time.shape[1])
        removed = np.empty((len(time), len(prior.space)))
        for point, row in enumerate(prior.space):
            removed[:, point] = np.sum((np.einsum("dmp,m->dp", half, row, optimize=True) @ time.T) ** 2, axis=0)
        variance = prior.deviation(weights) ** 2 - removed if self._in_data else removed
        return np.sqrt(np.maximum(variance, 0.0))

    def spread(self, count: int, seed: int) -> Floats:
        """Return samples of the coefficients minus their mean, which the data do not change, (count, coefficients)."""
        from scipy.linalg import solve_triangular

        random, size = np.random.default_rng(seed), self.prior.size
        start = random.normal(size=(count, size + self._columns.shape[1]))
        if not self._in_data:
            return np.asarray(
                solve_triangular(self.factor, start.T, lower=True, trans=1, check_finite=False).T[:, :size]
            )
        noise = random.normal(size=(count, len(self._rows.values)))
        weights = self._solved((self._forward(start) + noise).T).T
        return np.array([one - self._adjoint(each) for one, each in zip(start, weights, strict=True)])[:, :size]

    def samples(self, count: int, seed: int) -> Floats:
        """Return samples of the coefficients, shape (count, coefficients)."""
        return np.asarray(self.mean + self.spread(count, seed))


def likeliest(
    known: dict[str, float | None], rows: Rows, position: Floats, times: Floats, seed: int = 0, order: str = "5/2"
) -> dict[str, float]:
    """Return amplitude, length and time of the prior; those that are None maximise the likelihood of the data.

    The length is at least twice the mean distance of the points that sensors see best: with a shorter one the interface
    would slip in front of each sensor and nowhere else.

    Parameters
    ----------
    known : dict
        `amplitude` [m/s], `length` [m] and `time` [s]; of a surface `dip_length` [m], by default `length`.
    rows : Rows
        Up to `SUBSET` of them, chosen at random, are used.
    position, times : ndarray
        Points of the interface [m], shape (n,) or (n, 2), and knots [s].
    seed : int
    order : str
        Of the covariances.
    """
    from scipy.optimize import minimize, minimize_scalar

    dip_length = known.get("dip_length")
    if all(known[name] is not None for name in ("amplitude", "length", "time")):
        return {name: float(value) for name, value in known.items() if value is not None}
    count = len(rows.values)
    if count > SUBSET:
        rows = rows.some(np.sort(np.random.default_rng(seed).choice(count, SUBSET, replace=False)))
    scaled = rows.values / rows.sigma
    extents = {"length": float(np.ptp(position, axis=0).max()), "time": float(np.ptp(times))}
    free = [name for name in extents if known[name] is None]

    def best(lengths: dict[str, float]) -> tuple[float, float]:
        """Return minus twice the logarithm of the likelihood, and the amplitude."""
        scaled_positions = stretched(position, lengths["length"], dip_length)
        prior = Prior.of_lengths(
            1.0, lengths["length"], lengths["time"], scaled_positions, times, tail=1e-3, order=order
        )
        design = rows.design(prior)
        in_data = design.shape[0] <= design.shape[1]
        values, vectors = np.linalg.eigh(design @ design.T if in_data else design.T @ design)
        values = np.maximum(values, 0.0)
        # Squares of B'd in the directions of the eigenvectors of B'B, from those of B B' if there are fewer data.
        squares = values * (vectors.T @ scaled) ** 2 if in_data else (vectors.T @ (design.T @ scaled)) ** 2

        def cost(logarithm: float) -> float:
            factor = np.exp(2 * logarithm)
            variance = factor * values + 1
            return float(scaled @ scaled - np.sum(factor * squares / variance - np.log(variance)))

        if known["amplitude"] is not None:
            return cost(np.log(known["amplitude"])), known["amplitude"]
        middle = 0.5 * np.log(max(float(scaled @ scaled), 1e-300) / max(float(values.sum()), 1e-300))
        found = minimize_scalar(cost, bounds=(middle - 7, middle + 7), method="bounded", options={"xatol": 1e-3})
        return float(found.fun), float(np.exp(found.x))

    def lengths_of(logarithms: Floats) -> dict[str, float]:
        chosen = dict(zip(free, np.exp(logarithms).tolist(), strict=True))
        return {name: chosen.get(name, known[name]) for name in extents}  # type: ignore[misc]

    logarithms = np.log([extents[name] / 8 for name in free])
    if free:
        shortest = {"length": _spacing(rows.kernels, position), "time": float(np.diff(times).mean())}
        lowest = np.log([shortest[name] for name in free])
        highest = np.log([2 * extents[name] for name in free])
        logarithms = np.clip(logarithms, lowest, highest)
        logarithms = minimize(
            lambda at: best(lengths_of(np.clip(at, lowest, highest)))[0], logarithms, method="Nelder-Mead",
            options={"xatol": 0.05, "fatol": 0.1, "maxfev": 40 * len(free)},
        ).x  # fmt: skip
        logarithms = np.clip(logarithms, lowest, highest)
    lengths = lengths_of(logarithms)
    return {"amplitude": best(lengths)[1], **lengths, **({} if dip_length is None else {"dip_length": dip_length})}


def _spacing(kernels: Floats, position: Floats) -> float:
    """Return twice the mean distance of the points that sensors see best [m], an eighth of the interface for one point.

    On a surface it is that to the nearest other one.
    """
    best = np.argmax(np.sum(kernels**2, axis=1), axis=1)[np.any(kernels != 0, axis=(1, 2))]
    seen = np.unique(position[best % len(position)], axis=0)  # columns of the second tangent have the same points
    if len(seen) < 2:
        return float(np.ptp(position, axis=0).max()) / 8
    if seen.ndim == 1:
        return 2 * float(np.ptp(seen)) / (len(seen) - 1)
    apart = np.linalg.norm(seen[:, None] - seen, axis=2) + np.diag(np.full(len(seen), np.inf))
    return 2 * float(apart.min(axis=1).mean())
