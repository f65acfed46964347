"""Row of `ruptfx check` on facets that are missing in an interface: bodies are welded there."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.platform import fem, parallel

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.system import System

# A hole of so many of the facets beside it is taken for a mistake of the mesh, a longer one for a bridge that is meant.
FACETS = 1.5


def hole_rows(model: System, fault: Fault) -> Iterator[Row]:
    """Warn of single facets that are missing inside an interface, with the middle of the first; collective."""
    mesh, bodies = model.bodies.mesh, model.bodies
    dim = mesh.geometry.dim
    facets = bodies.facets.find(bodies.tags[f"{fault.name}.minus"])
    corners = 2 if dim == 2 else 3 if mesh.topology.cell_name() == "tetrahedron" else 4
    owned = facets[facets < mesh.topology.index_map(dim - 1).size_local]
    places = mesh.geometry.x[fem.corners_of_facets(mesh, owned, corners), :dim]
    rows = parallel.share_rows(model.comm, places.reshape(len(owned), -1))
    middles = holes(rows.reshape(-1, corners, dim))
    if len(middles):
        at = ", ".join(f"{value:.6g}" for value in middles[0])
        yield Row(
            f"faults.{fault.name}: missing facets", len(middles), "",
            f"the first at ({at}) m: the bodies are welded there; add these facets to the interface in the mesh, or "
            "make the bridge longer than its neighbours if it is meant", "warning",
        )  # fmt: skip


def holes(facets: np.ndarray) -> np.ndarray:
    """Return the middles of holes of the size of one facet in a line or surface, shape (holes, dim) [m].

    Parameters
    ----------
    facets : ndarray, shape (facets, corners, dim)
        Corners of all facets [m], those of quadrilaterals row by row.
    """
    count, corners, dim = facets.shape
    digits = np.round(facets.reshape(-1, dim) / max(np.ptp(facets), 1e-300), 9)
    _, first, number = np.unique(digits, axis=0, return_index=True, return_inverse=True)
    points, number = facets.reshape(-1, dim)[first], number.reshape(count, corners)
    if dim == 2:
        return _between_ends(points, number)
    around = [0, 1, 3, 2] if corners == 4 else [0, 1, 2]
    edges = np.sort(np.stack([number[:, around], np.roll(number[:, around], -1, axis=1)], axis=-1).reshape(-1, 2))
    edges, used = np.unique(edges, axis=0, return_counts=True)
    return _inside_loops(points, edges[used == 1], corners)


def _between_ends(points: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Return the middles between ends of lines that are nearer to each other than their facets are long."""
    ends, used = np.unique(lines, return_counts=True)
    length = np.zeros(len(points))
    length[lines] = np.linalg.norm(np.diff(points[lines], axis=1), axis=2)
    facets = {frozenset(line) for line in lines.tolist()}
    pairs = [pair for pair in combinations(ends[used == 1].tolist(), 2) if frozenset(pair) not in facets]
    near = [
        pair
        for pair in pairs
        if np.linalg.norm(np.diff(points[list(pair)], axis=0)) <= FACETS * length[list(pair)].max()
    ]
    return np.array([points[list(pair)].mean(axis=0) for pair in near]).reshape(-1, points.shape[1])


def _inside_loops(points: np.ndarray, rim: np.ndarray, corners: int) -> np.ndarray:
    """Return the middles of closed loops of as many edges as a facet has, beside a longer rim."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(rim)), rim.T), shape=(len(points), len(points)))
    _, piece = connected_components(graph, directed=False)
    size = np.bincount(piece[rim[:, 0]], minlength=piece.max(initial=0) + 1)
    loops = np.flatnonzero((size == corners) & (np.count_nonzero(size) > 1))
    return np.array([points[np.isin(piece, loop)].mean(axis=0) for loop in loops]).reshape(-1, points.shape[1])
