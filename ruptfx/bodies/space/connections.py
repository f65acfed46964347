"""Parts of a mesh that nothing connects: coincident nodes that are not shared, and bodies that touch nothing."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import COINCIDENT, RawMesh
from ruptfx.bodies.space.branches import connected


def check_connections(raw: RawMesh, tied: Iterable[tuple[np.ndarray, np.ndarray]]) -> None:
    """Refuse bodies that are beside others without a connection to them by nodes, interfaces or ties.

    Parameters
    ----------
    tied : iterable of (ndarray, ndarray)
        Facets of tied edges.

    Raises
    ------
    RuptfxError
        Names the bodies, the number of nodes and a position.
    """
    first, second = np.repeat(raw.cells[:, 0], raw.cells.shape[1] - 1), raw.cells[:, 1:].ravel()
    links = [(first, second)]
    for sides in (*raw.interfaces.values(), *tied):
        everything = np.concatenate([np.unique(side) for side in sides])
        links.append((np.repeat(everything[:1], len(everything)), everything))
    group = connected(len(raw.points), *(np.concatenate(side) for side in zip(*links, strict=True)))
    groups, of_cells = np.unique(group[raw.cells[:, 0]], return_inverse=True)
    if len(groups) == 1:
        return
    from scipy.spatial import cKDTree  # cases are read without SciPy

    dim, corners = raw.points.shape[1], raw.points[raw.cells[:, : 2 ** raw.points.shape[1]]]
    near = COINCIDENT * np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).min()
    used = np.unique(raw.cells)
    with_interface = {int(group[sides[0].flat[0]]) for sides in raw.interfaces.values() if len(sides[0])}
    for number, one in enumerate(groups.tolist()):
        own, others = used[group[used] == one], used[group[used] != one]
        distance, nearest = cKDTree(raw.points[others]).query(raw.points[own], distance_upper_bound=near)
        same = np.flatnonzero(np.isfinite(distance))
        names = _names(raw, raw.cell_body[of_cells == number])
        if len(same) >= dim:
            nodes = own[same[0]], others[nearest[same[0]]]
            names, beside = (_names(raw, raw.cell_body[(raw.cells == node).any(axis=1)]) for node in nodes)
            place = ", ".join(f"{x:.6g}" for x in raw.points[own[same[0]]])
            raise RuptfxError(
                f"mesh: {names} and {beside} coincide at {len(same)} nodes, the first at ({place}) m, but each has its "
                "own, and no interface is between them: nothing connects them. Remove the duplicate nodes (Coherence "
                "in the script of Gmsh, gmsh.model.mesh.removeDuplicateNodes() of a mesh), or name the facets there "
                "and list them in mesh.interfaces"
            )
        if with_interface and one not in with_interface:
            place = ", ".join(f"{x:.6g}" for x in raw.points[own].mean(axis=0))
            raise RuptfxError(
                f"mesh: {names}, around ({place}) m, has no connection to another body, an interface or a tied edge: "
                "its motion and its loads change nothing else. Close the gap so that it shares nodes with its "
                "neighbour, name an interface there, or remove it"
            )


def _names(raw: RawMesh, bodies: np.ndarray) -> str:
    return ", ".join(f"'{raw.bodies[number]}'" for number in np.unique(bodies))
