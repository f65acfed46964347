"""A specimen compressed until it fractures: stress against strain, emission, and number of fragments.

All is read from the files of a run: `edges.csv`, `events.h5`, `cracks.h5`, `bulk.h5`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy

from ruptfx import RuptfxError, Table
from ruptfx.results.analysis.emission import (
    Array,
    BValue,
    Catalogue,
    Estimates,
    b_value,
    clusters,
    estimate,
    first_peak,
    tried,
)

if TYPE_CHECKING:
    from ruptfx.results.record import Data, Files

SMALLEST = -10.0
"""Magnitude of the smallest events that count, as in Zhao (2013)."""
CELLS = 3.0  # largest distance of linked events, in facets
RIPPLES = 0.5  # part of the largest stress; a maximum below it counts as a wave
ELASTIC = (0.2, 0.5)  # parts of the first peak between which the modulus is fitted
WINDOWS = (0.95, 0.98, 1.0)
"""Parts of the time of the first peak until which tensile shares are given; the last is the window of Zhao (2013)."""
MODES = ("tensile", "shear", "mixed")
_NO_SPEED = (
    "cracks.h5: an earlier version wrote it without {}_of_bodies, wave speeds by which events are linked to clusters; "
    "give distance and speed, ruptfx events RUN --link DISTANCE SPEED, or run the case again"
)


@dataclass(frozen=True)
class Loading:
    """Loading curve of a specimen between two edges, its bottom and its top.

    Attributes
    ----------
    time, strain, stress : ndarray, shape (n,)
        [s]; approach of the edges over the height of the specimen; mean force at both over its width [Pa]. Both are
        positive in compression, and negative where a specimen is pulled.
    peak : int or None
        The first maximum that is followed by a fall of 3 % before it is exceeded; maxima below half of the largest
        stress are waves.
    """

    time: Array
    strain: Array
    stress: Array
    peak: int | None

    @property
    def modulus(self) -> float:
        """Slope of stress over strain between 20 and 50 % of the first peak, or of the largest stress [Pa]."""
        size = np.abs(self.stress)
        top = float(size.max() if self.peak is None else size[self.peak])
        until = int(np.argmax(size >= ELASTIC[1] * top)) + 1
        below = np.flatnonzero(size[:until] <= ELASTIC[0] * top)
        part = slice(int(below[-1]) if len(below) else 0, until)
        if until - part.start < 3 or np.ptp(self.strain[part]) == 0:
            return float(np.nan)
        return float(np.polyfit(self.strain[part], self.stress[part], 1)[0])


def loading(record: Files) -> Loading | None:
    """Return the loading curve of a rectangular specimen; None for other bodies or without driven ends."""
    mesh = record.case.get("mesh", {})
    shape = mesh.get("shape", {})
    if mesh.get("kind") != "specimen" or shape.get("kind") != "rectangle":
        return None
    body = mesh["platens"].get("body", "platen") if mesh.get("platens") else "specimen"
    if not (record.path / "edges.csv").is_file():
        return None
    edges = record.edges
    names = [f"{body}.{side}.{what}_y" for what in ("displacement", "force") for side in ("bottom", "top")]
    if any(name not in edges for name in names) or not edges.sizes["time"]:
        return None
    bottom, top, below, above = (edges[name].values for name in names)
    strain, stress = (bottom - top) / shape["height"], 0.5 * (below - above) / shape["width"]
    loaded = stress * (1 if stress.max() >= -stress.min() else -1)  # pressed or pulled
    begin = int(np.argmax(loaded > RIPPLES * loaded.max()))
    peak = first_peak(loaded[begin:])
    return Loading(edges["time"].values, strain, stress, None if peak is None else begin + peak)


@dataclass(frozen=True)
class Emission:
    """Acoustic emission of a run.

    Attributes
    ----------
    events : Catalogue
        All facets that failed, in the order of their failure.
    before : ndarray of bool, shape (events,)
        True for facets that failed before the specimen.
    mode : ndarray of str, shape (events,)
    inclination, length, time_of_failure : ndarray, shape (events,)
        Properties of the facets [degrees, m, s].
    failure_time : float or None
        Time of the first peak of the stress, or the parameter of that name [s].
    seismic : Catalogue
        Events before it that radiate, from the smallest magnitude on.
    linked : Catalogue
        Clusters of seismic events of the whole run; empty if the default of `link` is not known.
    of_events : Estimates
        Estimates of `seismic`.
    of_clusters : BValue, or the exception of a failed estimate or of an unknown default of `link`
    """

    events: Catalogue
    before: Array
    mode: Array
    inclination: Array
    length: Array
    time_of_failure: Array
    failure_time: float | None
    seismic: Catalogue
    counted: Array
    linked: Catalogue
    of_events: Estimates
    of_clusters: BValue | RuptfxError

    @property
    def shares(self) -> dict[str, float]:
        """Share of each mode in `seismic`; NaN without events."""
        return {name: _share(self.mode[self.counted], name) for name in MODES}

    @property
    def tensile_shares(self) -> dict[float, float]:
        """Tensile share of `seismic` in each time window (`WINDOWS`); NaN without a time of failure."""
        failed = self.time_of_failure[self.counted] / (np.nan if self.failure_time is None else self.failure_time)
        return {part: _share(self.mode[self.counted][failed <= part], "tensile") for part in WINDOWS}


def emission_of(
    record: Files, smallest: float = SMALLEST, completeness: float | None = None,
    distances: tuple[float, float] | None = None, failure_time: float | None = None,
    link: tuple[float, float] | None = None,
) -> Emission:  # fmt: skip
    """Return the events of a run and their statistics.

    Parameters
    ----------
    smallest : float
        Magnitude of the smallest events that count.
    completeness : float, optional
        As for `b_value`.
    distances : (float, float), optional
        Range of the fractal dimension [m]; default: two facets and a third of the narrower side of the bodies.
    failure_time : float, optional
        Of the specimen [s]; default: that of the first peak of the stress, if there is one.
    link : (float, float), optional
        Distance [m] and speed [m/s] of `clusters`; default: three facets and half the shear wave speed
        of the slowest body beside facets.
    """
    data, facets = record.events, record.cracks
    time_of_failure = np.asarray(data["time_of_failure"].values)
    events, before, counted, failure_time = _counted(record, smallest, failure_time)
    size = float(np.mean(facets["length"].values))
    points = facets["points"].values
    near, far = distances or (2 * size, float(np.ptp(points, axis=0).min()) / 3)
    seismic = Catalogue(events.time[counted], events.x[counted], events.y[counted], events.energy[counted])
    seen = tried(
        lambda: clusters(events.seismic(smallest), *(link or (CELLS * size, 0.5 * slowest(facets, "c_s")))).events
    )
    linked = Catalogue(*np.zeros((4, 0))) if isinstance(seen, RuptfxError) else seen
    return Emission(
        events, before, np.asarray(data["mode"].values), np.asarray(data["inclination"].values),
        np.asarray(data["length"].values), time_of_failure, failure_time, seismic, counted, linked,
        estimate(seismic, completeness, (near, far), failure_time),
        seen if isinstance(seen, RuptfxError) else tried(lambda: b_value(linked.magnitude, completeness)),
    )  # fmt: skip


def _counted(
    record: Files, smallest: float, failure_time: float | None
) -> tuple[Catalogue, Array, Array, float | None]:
    """Return all events, flags of those before the failure, flags of those that count, and the failure time [s]."""
    data = record.events
    x, y, energy, time, failed = (np.asarray(data[name].values) for name in ("x", "y", "energy", "time",
                                                                            "time_of_failure"))  # fmt: skip
    events = Catalogue(time, x, y, energy)
    pressed = loading(record)
    if failure_time is None and pressed is not None and pressed.peak is not None:
        failure_time = float(pressed.time[pressed.peak])
    before = failed <= (np.inf if failure_time is None else failure_time)
    return events, before, before & (events.energy > 0) & (events.magnitude >= smallest), failure_time


def events_that_count(record: Files) -> int:
    """Return the number of events before the failure with a radiated magnitude of at least -10."""
    return int(_counted(record, SMALLEST, None)[2].sum())


def _share(modes: Array, name: str) -> float:
    """Return the share of events of a mode; NaN without events."""
    return float(np.mean(modes == name)) if len(modes) else float(np.nan)


def slowest(data: Data, wave: Literal["c_s", "c_R"]) -> float:
    """Return the speed of a wave in the slowest body beside the facets [m/s], of anisotropic ones along x.

    Waves that link events, and fronts, run from facet to facet; the slowest body gives the longest time. Bodies
    without facets, such as platens, do not count.

    Parameters
    ----------
    data : Data
        `cracks` of a record.

    Raises
    ------
    RuptfxError
        The run is of an earlier version, whose file has no speeds.
    """
    if f"{wave}_of_bodies" not in data.attrs:
        raise RuptfxError(_NO_SPEED.format(wave))
    return float(np.min(np.atleast_1d(data.attrs[f"{wave}_of_bodies"])[np.unique(data["bodies"].values)]))


def fragments(record: Files) -> int | None:
    """Return the number of fragments (cells connected by unfailed facets); None without facets."""
    if not (record.path / "bulk.h5").is_file():
        return None
    bulk, data = record.bulk, record.cracks
    if not data.sizes["time"]:
        return None
    points, cells = bulk["points"].values, bulk["cells"].values
    count, ends = len(points), data["points"].values
    both = np.concatenate([points[:, :2], ends])
    near = 1e-9 * np.ptp(both, axis=0).max()
    vertex = np.unique(np.rint(both / near).astype(np.int64), axis=0, return_inverse=True)[1].reshape(-1)
    sides = np.sort(np.concatenate([vertex[:count][cells[:, pair]] for pair in ([0, 1], [1, 2], [0, 2])]), axis=1)
    facets = np.sort(vertex[count:][data["lines"].values], axis=1)
    intact = facets[data["status"].values[-1] < 2]
    scale = int(vertex.max()) + 1
    owner, code = np.tile(np.arange(len(cells)), 3), sides @ [scale, 1]
    order = np.argsort(code, kind="stable")
    place = np.searchsorted(code[order], intact @ [scale, 1])
    first, second = owner[order[place]], owner[order[place + 1]]
    joined = scipy.sparse.coo_array((np.ones(len(first)), (first, second)), (len(cells),) * 2)
    return int(scipy.sparse.csgraph.connected_components(joined, directed=False)[0])


def summarise_fracture(record: Files) -> Table:
    """Return the scalars of a run with fracture, under the names of the summary."""
    result, pressed = emission_of(record), loading(record)
    D, p = result.of_events.D, result.of_events.p
    values: Table = {}
    if pressed is not None:
        values = {
            "first_peak_stress": np.nan if pressed.peak is None else pressed.stress[pressed.peak],
            "first_peak_strain": np.nan if pressed.peak is None else pressed.strain[pressed.peak],
            "first_peak_time": np.nan if pressed.peak is None else pressed.time[pressed.peak],
            "largest_stress": float(np.abs(pressed.stress).max()), "elastic_modulus": pressed.modulus,
        }  # fmt: skip
    values |= {
        "events": len(result.events), "events_before_peak": len(result.seismic),
        "aseismic_share": 1 - len(result.seismic) / result.before.sum() if result.before.any() else np.nan,
        **{f"{name}_share": share for name, share in result.shares.items()},
        **{f"tensile_share_until_{part:.0%}".rstrip("%"): result.tensile_shares[part] for part in WINDOWS[:-1]},
        "largest_magnitude": float(np.max(result.events.magnitude, initial=-np.inf)),
        **_with_error("b_value", result.of_clusters, "b"),
        **_with_error("b_value_of_facets", result.of_events.b, "b"),
        **_with_error("fractal_dimension", D, "D"), **_with_error("omori_exponent", p, "p"),
        "failed_length": float(result.length.sum()),
        "fragments": fragments(record),
    }  # fmt: skip
    return values


def _with_error(name: str, estimate: object, value: str) -> dict[str, float]:
    """Return an estimate and its standard error under two names; NaN if there is none."""
    return {name: getattr(estimate, value, np.nan), f"{name}_error": getattr(estimate, "error", np.nan)}
