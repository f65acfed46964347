"""Statistics of acoustic emission: magnitudes, b-value, fractal dimension, Omori exponent, clusters.

The functions take arrays, of a run or of a measured catalogue. Every
estimate has a standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

import numpy as np
import scipy

from ruptfx import RuptfxError
from ruptfx.input.number_files import read_table

Array = np.ndarray
T = TypeVar("T")

FEWEST = 10  # events: minimum for an estimate
RADII = 20  # number of radii at which pairs are counted


def magnitude(energy: Array) -> Array:
    """Return M = (2/3) (log10 E - 4.8) of radiated energies [J]; minus infinity for zero energy.

    Source: Gutenberg and Richter (1956).
    """
    with np.errstate(divide="ignore"):
        return 2 / 3 * (np.log10(np.maximum(energy, 0.0)) - 4.8)


def energy_of(magnitudes: Array) -> Array:
    """Return the radiated energy [J] of a magnitude."""
    return 10 ** (1.5 * np.asarray(magnitudes, dtype=float) + 4.8)


@dataclass(frozen=True)
class Catalogue:
    """Events in chronological order.

    Attributes
    ----------
    time : ndarray, shape (n,)
        [s].
    x, y : ndarray, shape (n,)
        Place [m].
    energy : ndarray, shape (n,)
        Radiated [J]; zero or less is an aseismic event.
    """

    time: Array
    x: Array
    y: Array
    energy: Array

    def __len__(self) -> int:
        """Return the number of events."""
        return len(self.time)

    @property
    def magnitude(self) -> Array:
        """Magnitude of every event, shape (n,)."""
        return magnitude(self.energy)

    def seismic(self, smallest: float = -np.inf) -> Catalogue:
        """Return the events that radiate at least the magnitude `smallest`."""
        keep = (self.energy > 0) & (self.magnitude >= smallest)
        return Catalogue(*(getattr(self, field.name)[keep] for field in fields(self)))


def read_catalogue(path: str | Path) -> Catalogue:
    """Read a catalogue from a CSV file with the columns time [s], x, y [m] and magnitude or energy [J].

    Headers may state other units. Further columns and lines that begin with # are ignored; events are sorted by time.

    Raises
    ------
    RuptfxError
        The file cannot be read, a column is missing, or an entry is no number.
    """
    units = {"time": "s", "x": "m", "y": "m", "energy": "J", "magnitude": "1"}
    try:
        table = read_table(Path(path), is_named=True)
        columns = table.named(units)
        size = next((name for name in ("energy", "magnitude") if name in columns), "magnitude")
        wanted = ("time", "x", "y", size)
        if missing := [name for name in wanted if name not in columns]:
            names = ", ".join(table.headers[-1][1]) if table.headers else "none"
            raise ValueError(
                f"{path}: no column {', '.join(missing)}; a catalogue has the columns time (s), x, y (m) and "
                f"magnitude or energy (J), and this file has {names}"
            )
        rows = zip(*(table.column(*columns[name]) for name in wanted), strict=True)
    except ValueError as error:
        raise RuptfxError(str(error)) from None
    time, x, y, last = np.array(sorted(rows), dtype=float).reshape(-1, len(wanted)).T
    return Catalogue(time, x, y, energy_of(last) if size == "magnitude" else last)


@dataclass(frozen=True)
class BValue:
    """Slope of log10 of the number of events above a magnitude.

    Attributes
    ----------
    b, error : float
        Slope and its standard error.
    completeness, bin : float
        Smallest magnitude M_c of the fit, and the width to which magnitudes were rounded.
    count : int
        Events of at least M_c when rounded.
    """

    b: float
    error: float
    completeness: float
    bin: float
    count: int


def b_value(magnitudes: Array, completeness: float | None = None, bin: float = 0.1) -> BValue:
    """Return the maximum likelihood estimate of b.

    b = log10(1 + bin / (mean(M) - M_c)) / bin over magnitudes rounded to `bin`, without the bias of 1 % and more that
    log10(e) / (mean(M) - M_c + bin / 2) has; its limit for small bins is that of Aki.

    Parameters
    ----------
    magnitudes : ndarray, shape (n,)
    completeness : float, optional
        M_c; default: the most frequent magnitude (maximum curvature), often 0.2 too small: check with
        `b_against_completeness`.
    bin : float
        Width to which magnitudes are rounded.

    Raises
    ------
    RuptfxError
        Fewer than ten events, or all alike.

    Source: Aki (1965); Tinti and Mulargia (1987) for rounded magnitudes; error: Shi and Bolt (1982).
    """
    steps = np.rint(np.asarray(magnitudes, dtype=float) / bin)
    steps = steps[np.isfinite(steps)]
    if completeness is None:
        if not len(steps):
            raise RuptfxError("b-value: the catalogue has no events; lower the smallest size, or take a longer window")
        values, counts = np.unique(steps, return_counts=True)
        first = values[np.argmax(counts)]
    else:
        first = np.rint(completeness / bin)
    above = (steps[steps >= first] - first) * bin
    if len(above) < FEWEST or not above.any():
        raise RuptfxError(
            f"{len(above)} events of at least magnitude {first * bin:.3g}: a b-value needs {FEWEST}, not all alike"
        )
    b = float(np.log10(1 + bin / above.mean()) / bin)
    error = float(np.log(10) * b**2 * above.std(ddof=1) / np.sqrt(len(above)))
    return BValue(b, error, float(first * bin), bin, len(above))


def b_against_completeness(magnitudes: Array, bin: float = 0.1) -> list[BValue]:
    """Return b for every M_c with enough events; a plateau means that the estimate is sound."""
    values = np.asarray(magnitudes, dtype=float)
    values = values[np.isfinite(values)]
    estimates = []
    for step in np.unique(np.rint(values / bin)):
        try:
            estimates.append(b_value(values, step * bin, bin))
        except RuptfxError:
            break
    return estimates


@dataclass(frozen=True)
class FractalDimension:
    """Correlation dimension of the positions of events.

    Attributes
    ----------
    D, error : float
        Slope of log C(r), and its standard error.
    radius, correlation : ndarray, shape (m,)
        r [m] and the part C(r) of pairs that are closer.
    """

    D: float
    error: float
    radius: Array
    correlation: Array


def fractal_dimension(x: Array, y: Array, smallest: float, largest: float) -> FractalDimension:
    """Return the correlation dimension D: the share of pairs closer than r, C(r), grows as r^D.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Places [m].
    smallest, largest : float
        Range of r [m], for example from two cells to a third of the narrower side of the specimen.

    Raises
    ------
    RuptfxError
        Fewer than ten events, hardly two of them closer than `smallest`, or no range.

    Source: Grassberger and Procaccia (1983), Hirata, Satoh and Ito (1987); the error is that of the jackknife, which
    leaves out one event at a time (Efron and Stein 1981), as pairs are not independent.
    """
    points = np.column_stack([x, y])
    n = len(points)
    if n < FEWEST:
        raise RuptfxError(f"{n} events: a fractal dimension needs {FEWEST}")
    if not 0 < smallest < largest:
        raise RuptfxError(f"distances from {smallest:g} to {largest:g} m: give a range above zero, the smallest first")
    radius = np.geomspace(smallest, largest, RADII)
    tree = scipy.spatial.KDTree(points)
    neighbours = np.array([tree.query_ball_point(points, r, return_length=True) - 1 for r in radius], dtype=float)
    pairs = neighbours.sum(axis=1)
    without = pairs[:, None] - 2 * neighbours
    if without.min() <= 0:
        raise RuptfxError(
            f"hardly any of the {n} events are closer than {smallest:.3g} m: a fractal dimension needs more events or "
            "a larger smallest distance"
        )
    log_r = np.log(radius / radius.mean())
    weights = (log_r - log_r.mean()) / np.sum((log_r - log_r.mean()) ** 2)
    each = weights @ np.log(without)
    error = np.sqrt((n - 1) / n * np.sum((each - each.mean()) ** 2))
    return FractalDimension(float(weights @ np.log(pairs)), float(error), radius, pairs / (n * (n - 1)))


@dataclass(frozen=True)
class Omori:
    """Rate K (t + c)^-p of events at the time t before a failure (or after a shock).

    Attributes
    ----------
    p, error : float
        Exponent and its standard error.
    c : float
        [s].
    K : float
        [s^(p - 1)].
    """

    p: float
    error: float
    c: float
    K: float

    def rate(self, time: Array) -> Array:
        """Return the events per second at the time to failure [s]."""
        return self.K * (np.asarray(time) + self.c) ** -self.p


def omori(time_to_failure: Array, longest: float | None = None) -> Omori:
    """Return the maximum likelihood estimate of the modified Omori law.

    Parameters
    ----------
    time_to_failure : ndarray, shape (n,)
        Of events, or time since a shock [s]; positive.
    longest : float, optional
        Length of the window [s] that begins (ends) at the failure; default: the longest time.

    Raises
    ------
    RuptfxError
        Fewer than ten events in the window, or no rate of this form describes them.

    Source: Utsu (1961); Ogata (1983); the error is from the curvature of the likelihood.
    """
    from scipy.optimize import minimize  # imported late: a run needs magnitudes only

    times = np.asarray(time_to_failure, dtype=float)
    end = float(times.max(initial=0.0)) if longest is None else longest
    times = times[(times > 0) & (times <= end)]
    n = len(times)
    if n < FEWEST:
        raise RuptfxError(f"{n} events in the window: an Omori exponent needs {FEWEST}")
    scaled = times / end

    def area(p: float, c: float) -> float:
        one = 1 - p
        if abs(one) < 1e-9:
            return float(np.log1p(1 / c))
        return float(((1 + c) ** one - c**one) / one)

    def unlikely(parameters: Array) -> float:
        p, log_c = parameters
        c = np.exp(log_c)
        return float(p * np.log(scaled + c).sum() + n * np.log(area(p, c)))

    smallest = np.log(np.quantile(scaled, 0.02))
    starts = [(p, smallest + shift) for p in (0.8, 1.2) for shift in (-2.0, 2.0)]
    bounds = [(0.0, 10.0), (np.log(1e-6), np.log(10.0))]
    best = min((minimize(unlikely, start, bounds=bounds, method="L-BFGS-B") for start in starts), key=lambda r: r.fun)
    p, log_c = best.x
    if not bounds[0][0] < p < bounds[0][1] or log_c >= bounds[1][1] - 1e-6:
        raise RuptfxError(
            f"the rate of these {n} events does not rise towards the failure as (t + c)^-p; take a window that ends at "
            "the failure"
        )
    c = float(np.exp(log_c))
    if log_c > bounds[1][0] + 1e-3:
        variance = np.linalg.inv(_hessian(unlikely, best.x))[0, 0]
    else:  # c is not distinguishable from zero
        variance = 1 / _hessian(lambda only: unlikely(np.array([only[0], log_c])), best.x[:1])[0, 0]
    if not variance > 0:
        raise RuptfxError(f"the likelihood of an Omori law has no maximum for these {n} events; take a longer window")
    return Omori(float(p), float(np.sqrt(variance)), c * end, n / area(p, c) * end ** (p - 1))


def _hessian(function: Callable[[Array], float], point: Array, step: float = 1e-3) -> Array:
    """Return the second derivatives by central differences."""
    n = len(point)
    moves = np.eye(n) * step
    return np.array(
        [
            [
                sum(s * t * function(point + s * moves[i] + t * moves[j]) for s in (1, -1) for t in (1, -1))
                / (4 * step**2)
                for j in range(n)
            ]
            for i in range(n)
        ]
    )


@dataclass(frozen=True)
class Clusters:
    """Linked events.

    Attributes
    ----------
    label : ndarray, shape (n,)
        Cluster of every event.
    events : Catalogue
        One for each cluster: the time of its first event, the place of its largest, the sum of energies.
    count : ndarray
        Events of each.
    """

    label: Array
    events: Catalogue
    count: Array


def clusters(catalogue: Catalogue, distance: float, speed: float) -> Clusters:
    """Link events closer than `distance` and within the time `distance` / `speed` (single linkage).

    One failed facet is a small event; a crack that runs over many of them is one large event. Magnitudes of single
    facets span two units at most, so that their b-value is poorly defined.

    Parameters
    ----------
    distance : float
        [m], for example three cells.
    speed : float
        [m/s], for example half the shear wave speed.
    """
    n = len(catalogue)
    tree = scipy.spatial.KDTree(np.column_stack([catalogue.x, catalogue.y]))
    pairs = tree.query_pairs(distance, output_type="ndarray").reshape(-1, 2)
    first, second = pairs[np.abs(np.subtract(*catalogue.time[pairs].T)) < distance / speed].T
    near = scipy.sparse.coo_array((np.ones(len(first)), (first, second)), (n, n))
    count, label = scipy.sparse.csgraph.connected_components(near, directed=False)
    energy = np.bincount(label, np.maximum(catalogue.energy, 0.0), count)
    rank = np.lexsort((-catalogue.energy, label))
    largest = rank[np.searchsorted(label[rank], np.arange(count))]
    time = np.full(count, np.inf)
    np.minimum.at(time, label, catalogue.time)
    order = np.argsort(time, kind="stable")
    events = Catalogue(time[order], catalogue.x[largest[order]], catalogue.y[largest[order]], energy[order])
    place = np.empty(count, dtype=int)
    place[order] = np.arange(count)
    return Clusters(place[label], events, np.bincount(label, minlength=count)[order])


@dataclass(frozen=True)
class Estimates:
    """Estimates of a catalogue; a failed one is its exception, one that was not requested is None."""

    b: BValue | RuptfxError
    D: FractalDimension | RuptfxError | None = None
    p: Omori | RuptfxError | None = None

    def rows(self) -> Iterator[tuple[str, str, str]]:
        """Yield name, value with error, and range of every estimate as text."""
        b, D, p = self.b, self.D, self.p
        if isinstance(b, RuptfxError):
            yield "b-value", "none", str(b)
        else:
            yield "b-value", f"{b.b:.3f} ± {b.error:.3f}", f"{b.count} of at least magnitude {b.completeness:.2f}"
        if isinstance(D, RuptfxError):
            yield "fractal dimension", "none", str(D)
        elif D is not None:
            yield "fractal dimension", f"{D.D:.3f} ± {D.error:.3f}", f"{D.radius[0]:.3g} to {D.radius[-1]:.3g} m"
        if isinstance(p, RuptfxError):
            yield "Omori exponent", "none", str(p)
        elif p is not None:
            yield "Omori exponent", f"{p.p:.3f} ± {p.error:.3f}", f"c = {p.c:.3g} s"


def estimate(
    catalogue: Catalogue,
    completeness: float | None = None,
    distances: tuple[float, float] | None = None,
    failure_time: float | None = None,
) -> Estimates:
    """Return all estimates that the catalogue allows.

    Parameters
    ----------
    catalogue : Catalogue
        Seismic events.
    completeness : float, optional
        As for `b_value`.
    distances : (float, float), optional
        As for `fractal_dimension` [m]; default: a thirtieth and a third of the narrower extent.
    failure_time : float, optional
        Time of the failure that follows the events [s]; without it, no Omori exponent is computed.
    """
    narrow = min(float(np.ptp(catalogue.x)), float(np.ptp(catalogue.y))) if len(catalogue) else 0.0
    near, far = distances or (narrow / 30, narrow / 3)
    return Estimates(
        tried(lambda: b_value(catalogue.magnitude, completeness)),
        tried(lambda: fractal_dimension(catalogue.x, catalogue.y, near, far)),
        None if failure_time is None else tried(lambda: omori(failure_time - catalogue.time)),
    )


def tried(estimate: Callable[[], T]) -> T | RuptfxError:
    """Return the estimate, or its exception."""
    try:
        return estimate()
    except RuptfxError as error:
        return error


def tensile_share(xx: Array, yy: Array, xy: Array) -> Array:
    """Return the share of opening in potencies, opening^2 / (opening^2 + slip^2): 1 opening, 0 slip.

    The symmetric part of (opening n + slip t) n has the trace `opening` and the difference sqrt(opening^2 + slip^2)
    of its eigenvalues.

    Parameters
    ----------
    xx, yy, xy : ndarray, shape (n,)
        Components of the potency [m2], of one facet or the sum over many.
    """
    trace, difference = xx + yy, np.hypot(xx - yy, 2 * xy)
    return (trace / np.where(difference > 0, difference, 1.0)) ** 2


def first_peak(stress: Array, fall: float = 0.03, smooth: int = 5) -> int | None:
    """Return the index of the first maximum followed by a fall before it is exceeded; None if there is none.

    Parameters
    ----------
    stress : ndarray, shape (n,)
        Along a loading path.
    fall : float
        Part of the maximum by which it falls.
    smooth : int
        Samples of a running mean (odd), against the ripple of waves.
    """
    if len(stress) < smooth:
        return None
    mean = np.convolve(stress, np.ones(smooth) / smooth, "valid")
    highest = np.maximum.accumulate(mean)
    fallen = np.flatnonzero((highest > 0) & (mean < (1 - fall) * highest))
    return int(np.argmax(mean[: fallen[0]])) + smooth // 2 if len(fallen) else None


def rose(inclination: Array, length: Array, sectors: int = 18) -> tuple[Array, Array]:
    """Return the length of cracks in sectors of their inclination.

    Parameters
    ----------
    inclination : ndarray, shape (n,)
        Counter-clockwise from x, 0 to 180 [degrees].
    length : ndarray, shape (n,)
        [m].

    Returns
    -------
    (ndarray of shape (sectors + 1,), ndarray of shape (sectors,))
        Limits of the sectors [degrees], and the length [m] in each.
    """
    limits = np.linspace(0.0, 180.0, sectors + 1)
    return limits, np.histogram(np.mod(inclination, 180.0), limits, weights=length)[0]
