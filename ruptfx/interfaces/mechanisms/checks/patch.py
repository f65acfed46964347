"""Rows of `ruptfx check` on patches of a surface: points in them, and the area for which these stand."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ruptfx.input.profiles import evaluate
from ruptfx.input.profiles.places import Patch as Strip
from ruptfx.input.profiles.places import distance, parts, patches
from ruptfx.input.profiles.rim import Patch
from ruptfx.input.schema import Part
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.laws.nucleation import Nucleation

FEWEST = 3  # points across a patch
LARGEST_ERROR = 0.05  # of the area
SAMPLES = 400  # along each side of a patch
ROUNDING = 1e-6  # of the size of the surface
LEAST = 1e-3  # of its middle value: smallest values of a smooth disc
FLAT = 1e-3  # height over length of a surface whose own plane is that of its positions


def surface_patch_rows(face: Interface, value: Part, label: str) -> Iterator[Row]:
    """Yield a row for every rectangle, ellipse, disc and strip of a fault, a warning if the mesh does not resolve it.

    Parameters
    ----------
    face : Interface
        A surface.
    value : Part
        Tables of the fault, in which points have been replaced by positions.
    label : str
        Dotted key of these tables.
    """
    for key, part in parts(value, label):
        if isinstance(part, Patch):
            ends = np.array([part.strike, part.dip])
            yield _row(f"{label}: {key.removeprefix(f'{label}.')}, {part.kind()}", face, part.share, ends, part.rim)
    for disc in patches(value, label):
        if disc.has_reach and disc.center is None:
            yield _strip_row(f"{label}: {disc.key.removeprefix(f'{label}.')}, strip", face, disc)
        if disc.center is None or not disc.has_reach:
            continue
        center, radius = disc.center, 0.5 * (disc.ends[1] - disc.ends[0])

        def inside(places: np.ndarray, center: np.ndarray = center, radius: float = radius) -> np.ndarray:
            return (distance(places, center) <= radius * (1 + ROUNDING)).astype(float)

        quantity = f"{label}: {disc.key.removeprefix(f'{label}.')}, disc"
        ends = np.stack([center - radius, center + radius], axis=1)
        shape = None if disc.has_edge else _shape(disc)
        rim = 0.0 if shape is None else _reach(shape, center, radius) - radius
        yield _row(quantity, face, inside, ends, rim, shape)


def _shape(disc: Strip) -> Callable[[np.ndarray], np.ndarray] | None:
    """Return the values of a smooth disc, 1 at its center and 0 far away, at positions of shape (n, 2) [m].

    None if the values at the center are those far away, as of an amplitude of zero.
    """
    part, center = disc.part, np.asarray(disc.center)

    def values(places: np.ndarray) -> np.ndarray:
        if isinstance(part, Nucleation):
            return part.shear_traction(places, np.inf)
        return evaluate(part, places)

    beyond = 1e6 * float(np.ptp(disc.ends))
    middle, far = values(np.stack([center, center + np.array([beyond, 0.0])]))
    return None if middle == far else lambda places: (values(places) - far) / (middle - far)


def _reach(shape: Callable[[np.ndarray], np.ndarray], center: np.ndarray, radius: float) -> float:
    """Return the distance from the center of a smooth disc beyond which its values are below a thousandth [m]."""
    distances = np.geomspace(1e-2, 1e2, 2001) * radius
    values = shape(center + distances[:, None] * [1.0, 0.0])
    return float(distances[np.flatnonzero(values >= LEAST)[-1]])


def _strip_row(quantity: str, face: Interface, strip: Strip) -> Row:
    """Return the row of a strip that crosses the surface.

    If its values jump at its edges, and these are between the outermost points, the area of its points is compared
    with its area. That follows from the areas of all points, half of which is on either side of a point, so that the
    surface may have any outline.
    """
    positions = face.locations[:, 1 if strip.down_dip else 0]
    extent = np.ptp(positions)
    slack = ROUNDING * extent
    first, last = strip.ends
    rows, of_row = np.unique(np.round((positions - positions.min()) / slack).astype(np.int64), return_inverse=True)
    rows = positions.min() + slack * rows
    areas = np.bincount(of_row, _area_in_plane(face))
    inside = (rows >= first - slack) & (rows <= last + slack)
    number = int(inside.sum())
    few = number < FEWEST
    notes = [f"the strip from {first:g} m to {last:g} m {'down dip' if strip.down_dip else 'along strike'}"]
    if number:
        notes[0] += f", its points from {_from_to(rows[inside])}"
    if strip.has_edge and rows[0] - slack <= first and last <= rows[-1] + slack:
        exact = float(np.ptp(np.interp(strip.ends, rows, np.cumsum(areas) - 0.5 * areas)))
        ratio = float(areas[inside].sum()) / exact
        notes.append(f"its points stand for {100 * ratio:.3g} % of its area")
        few = few or abs(ratio - 1) > LARGEST_ERROR
    if last < rows[0] or rows[-1] < first:
        notes.append("beyond the surface; move it there if it should act")
    elif few:
        notes.append("reduce mesh.element_size; use rectangle for a profile, with its edges on edges of elements")
    return Row(quantity, f"{number} points across", "", "; ".join(notes), "warning" if few else "ok")


def _from_to(positions: np.ndarray) -> str:
    """Return the range of positions of points as text."""
    rounded = np.round([positions.min(), positions.max()], 12) + 0.0  # no minus zero
    return f"{rounded[0]:.6g} m to {rounded[1]:.6g} m"


def axes_of_positions(face: Interface) -> np.ndarray:
    """Return the directions in which both positions of a surface grow by one metre per metre, shape (2, 3)."""
    points, places = (values - values.mean(axis=0) for values in (face.points, face.locations))
    return np.asarray(np.linalg.lstsq(points, places, rcond=FLAT)[0].T)


def _area_in_plane(face: Interface) -> np.ndarray:
    """Return the area of the points in the plane of both positions [m2], which a rough surface exceeds, shape (n,)."""
    return np.asarray(face.area * np.abs(face.frame[:, 0] @ np.cross(*axes_of_positions(face))))


def _row(
    quantity: str, face: Interface, share: Callable[[np.ndarray], np.ndarray], ends: np.ndarray, rim: float,
    shape: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Row:  # fmt: skip
    """Return the row of one patch.

    Its area on the mesh is the sum of the areas of its points, in the plane of the positions. It is compared with the
    area of the patch where the points surround the patch: beyond the outermost ones the rim of the surface takes part
    of it. A smooth profile without an edge is judged by its integral instead.

    Parameters
    ----------
    share : callable
        1 in the patch, 0 beyond it, at positions of shape (n, 2) [m].
    ends : ndarray, shape (2, 2)
        Both ends along strike and down dip [m].
    rim : float
        Width of the smooth edge outside of them [m].
    shape : callable, optional
        Values of a smooth profile, 1 in its middle and 0 beyond the rim, as `share`.
    """
    places = face.locations
    at_points = share(places)
    rounded = np.round(places / (ROUNDING * np.ptp(places))).astype(np.int64)
    across = [len(np.unique(positions)) for positions in rounded[at_points > 0].T]
    value = " x ".join(str(number) for number in across) + " points"
    along, down = (f"{first:g} m to {last:g} m" for first, last in ends)
    notes = [f"the patch: strike {along}, dip {down}" + f", its rim {rim:g} m wide" * (rim > 0 and shape is None)]
    if min(across):
        strike, dip = (_from_to(positions) for positions in places[at_points > 0].T)
        reach = (strike, dip) == (along, down)
        notes.append("its points reach its edges" if reach else f"its points: strike {strike}, dip {dip}")
    few = min(across) < FEWEST
    outer = ends + np.array([-rim, rim])
    extent = np.stack([places.min(axis=0), places.max(axis=0)], axis=1)
    slack = ROUNDING * np.ptp(places)
    if np.all(outer[:, 0] >= extent[:, 0] - slack) and np.all(outer[:, 1] <= extent[:, 1] + slack):
        middles = [first + (np.arange(SAMPLES) + 0.5) / SAMPLES * (last - first) for first, last in outer]
        samples = np.stack([each.ravel() for each in np.meshgrid(*middles)], axis=1)
        exact = float(np.mean((shape or share)(samples)) * np.prod(outer[:, 1] - outer[:, 0]))
        ratio = float(_area_in_plane(face) @ (at_points if shape is None else shape(places))) / exact
        notes.append(
            f"these stand for {100 * ratio:.3g} % of its area" if shape is None
            else f"the values of all points sum to {100 * ratio:.3g} % of the integral of its profile"
        )  # fmt: skip
        few = few or abs(ratio - 1) > LARGEST_ERROR
    if few:
        edges = "put its edges on edges of elements, or " if shape is None else ""
        notes.append(f"{edges}reduce mesh.element_size")
    return Row(quantity, value, "", "; ".join(notes), "warning" if few else "ok")
