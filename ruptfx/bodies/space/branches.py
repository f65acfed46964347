"""Branches: interfaces that end on another one are welded at their last nodes."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from itertools import combinations

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.meshes import RawMesh


def weld_branch_ends(raw: RawMesh, sliding: Collection[str] = ()) -> RawMesh:
    """Return the mesh with one node on both sides of a branch where it ends on another interface.

    Elements around a node are separate bodies in every sector between interfaces. Where an interface ends on one that
    goes on, its two sectors share their node, so that a branch does not slip at its last node (in 3D along the line in
    which it ends) and every point of the main interface has two sides. At a point in 2D, and at an edge in 3D, an
    interface with two facets goes on, and one with a single facet ends.

    Parameters
    ----------
    sliding : collection of str
        Interfaces with finite sliding, whose nodes have no partners.

    Raises
    ------
    RuptfxError
        A branch has both ends on other interfaces and is one facet long.
    """
    paired = [name for name in raw.interfaces if name not in raw.one_sided and name not in sliding]
    if len(paired) < 2:
        return raw
    plus, minus, owner = _ridges(raw, paired)
    both = [(p.ravel(), m.ravel()) for p, m in (raw.interfaces[name] for name in paired)]
    place = connected(len(raw.points), *(np.concatenate(side) for side in zip(*both, strict=True)))
    _, ridge = np.unique(np.sort(place[plus], axis=1), axis=0, return_inverse=True)
    ridge = ridge.ravel()
    count = np.zeros((ridge.max(initial=-1) + 1, len(paired)), dtype=np.int64)
    np.add.at(count, (ridge, owner), 1)
    goes_on = (count.max(axis=1) == 2) & (np.sum(count == 2, axis=1) == 1)
    ends = goes_on[ridge] & (count[ridge, owner] == 1)
    if not np.any(plus[ends] != minus[ends]):
        return raw
    welded = connected(len(raw.points), plus[ends].ravel(), minus[ends].ravel())
    kept, number = np.unique(welded, return_inverse=True)
    number = number.ravel()
    interfaces = {name: (number[p], number[m]) for name, (p, m) in raw.interfaces.items()}
    for name in paired:
        closed = np.all(interfaces[name][0] == interfaces[name][1], axis=1)
        if closed.any():
            where = ", ".join(f"{value:.6g}" for value in raw.points[raw.interfaces[name][0][closed][0]].mean(axis=0))
            raise RuptfxError(
                f"mesh: interface '{name}' is one facet long at ({where}) m between two interfaces on which it ends; "
                "refine the mesh there"
            )
    return replace(
        raw, points=raw.points[kept], cells=number[raw.cells], interfaces=interfaces,
        edges={name: number[facets] for name, facets in raw.edges.items()},
        open_facets=number[raw.open_facets], joints={name: number[facets] for name, facets in raw.joints.items()},
    )  # fmt: skip


def _ridges(raw: RawMesh, names: list[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ends of facets, edges of facets in 3D, by the vertices of both sides, and their interfaces.

    In 3D these are all pairs of vertices of a facet: no other facet shares a diagonal.

    Returns
    -------
    plus, minus : ndarray of int, shape (n, dim - 1)
    owner : ndarray of int, shape (n,)
        Index into `names`.
    """
    width = raw.points.shape[1] - 1
    plus, minus, owner = [], [], []
    for number, name in enumerate(names):
        sides = raw.interfaces[name]
        for corners in combinations(range(sides[0].shape[1]), width):
            plus.append(sides[0][:, corners])
            minus.append(sides[1][:, corners])
            owner.append(np.full(len(sides[0]), number))
    return np.concatenate(plus), np.concatenate(minus), np.concatenate(owner)


def connected(count: int, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return for each vertex the lowest one that is connected with it by pairs, shape (count,)."""
    from scipy import sparse  # imported late: lattices do not need it
    from scipy.sparse.csgraph import connected_components

    links = sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    _, label = connected_components(links, directed=False)
    _, lowest = np.unique(label, return_index=True)
    return np.asarray(lowest[label])
