"""Rows of `ruptfx check` on patches of a surface: points in them, and the area for which these stand."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ruptfx.faults.interface import Interface
from ruptfx.mechanisms._check_table import Row
from ruptfx.profiles._places import distance, parts, patches
from ruptfx.profiles._rim import Patch
from ruptfx.schema import Part

FEWEST = 3  # points across a patch
LARGEST_ERROR = 0.05  # of the area
SAMPLES = 400  # along each side of a patch
ROUNDING = 1e-6  # of the size of the surface


def surface_patch_rows(face: Interface, given: Part, label: str) -> Iterator[Row]:
    """Yield a row for every rectangle, ellipse and disc of a fault, a warning if the mesh does not resolve it.

    Parameters
    ----------
    face : Interface
        A surface.
    given : Part
        Tables of the fault, in which points have been replaced by positions.
    label : str
        Dotted key of these tables.
    """
    for key, part in parts(given, label):
        if isinstance(part, Patch):
            ends = np.array([part.strike, part.dip])
            yield _row(f"{label}: {key.removeprefix(f'{label}.')}, {part.kind()}", face, part.share, ends, part.rim)
    for disc in patches(given, label):
        if disc.center is None or len(disc.ends) < 2:
            continue
        center, radius = disc.center, 0.5 * (disc.ends[1] - disc.ends[0])

        def inside(places: np.ndarray, center: np.ndarray = center, radius: float = radius) -> np.ndarray:
            return (distance(places, center) <= radius * (1 + ROUNDING)).astype(float)

        ends = np.stack([center - radius, center + radius], axis=1)
        yield _row(f"{label}: {disc.key.removeprefix(f'{label}.')}, disc", face, inside, ends, 0.0)


def _row(
    quantity: str, face: Interface, share: Callable[[np.ndarray], np.ndarray], ends: np.ndarray, rim: float
) -> Row:  # fmt: skip
    """Return the row of one patch.

    Its area on the mesh is the sum of the areas of its points. It is compared with the area of the patch where the
    points surround the patch: beyond the outermost ones the rim of the surface takes part of it.

    Parameters
    ----------
    share : callable
        1 in the patch, 0 beyond it, at positions of shape (n, 2) [m].
    ends : ndarray, shape (2, 2)
        Both ends along strike and down dip [m].
    rim : float
        Width of the smooth edge outside of them [m].
    """
    places = face.locations
    at_points = share(places)
    rounded = np.round(places / (ROUNDING * np.ptp(places))).astype(np.int64)
    across = [len(np.unique(positions)) for positions in rounded[at_points > 0].T]
    value = " x ".join(str(number) for number in across) + " points"
    along, down = (f"{first:g} m to {last:g} m" for first, last in ends)
    notes = [f"strike {along}, dip {down}"]
    few = min(across) < FEWEST
    outer = ends + np.array([-rim, rim])
    extent = np.stack([places.min(axis=0), places.max(axis=0)], axis=1)
    slack = ROUNDING * np.ptp(places)
    if np.all(outer[:, 0] >= extent[:, 0] - slack) and np.all(outer[:, 1] <= extent[:, 1] + slack):
        middles = [first + (np.arange(SAMPLES) + 0.5) / SAMPLES * (last - first) for first, last in outer]
        samples = np.stack([each.ravel() for each in np.meshgrid(*middles)], axis=1)
        exact = float(np.mean(share(samples)) * np.prod(outer[:, 1] - outer[:, 0]))
        ratio = float(face.area @ at_points) / exact
        notes.append(f"these stand for {100 * ratio:.3g} % of its area")
        few = few or abs(ratio - 1) > LARGEST_ERROR
    if few:
        notes.append("put its edges on edges of elements, or reduce mesh.element_size")
    return Row(quantity, value, "", "; ".join(notes), "warning" if few else "ok")
