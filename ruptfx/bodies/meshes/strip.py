"""The interfaces of a section that repeats along strike as surfaces: one layer of elements on either side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.bodies.meshes.lobatto import Basis
from ruptfx.input.schema import CaseError

THIN = 0.25  # thickness of the layer over the shortest facet


@dataclass(frozen=True)
class Strip:
    """Hexahedra of order 1 beside the interfaces, whose vertices there are the points of the interfaces.

    The elements carry no stress: they give the points a place in the mesh of a model.

    Attributes
    ----------
    section : MeshSource
        With `along_strike`.
    order : int
        Of the elements of the section.
    """

    section: MeshSource
    order: int

    def lattice(self) -> None:
        """Return None: every rank gets its part from rank 0."""

    def build(self) -> RawMesh:
        """Return the mesh.

        Raises
        ------
        CaseError
            A section that is no plane mesh of straight elements with matching interfaces.
        """
        along = self.section.along_strike
        assert along is not None
        flat = self.section.build()
        if flat.points.shape[1] != 2 or flat.order != 1 or flat.non_matching or len(flat.open_facets) or flat.joints:
            raise CaseError(
                f"mesh.along_strike: mesh.kind = '{self.section.kind()}' is no section of straight elements with "
                "matching interfaces; take a 2D kind, such as strike_slip_section, or remove along_strike"
            )
        if not flat.interfaces or flat.mirror_planes:
            raise CaseError(
                f"mesh.along_strike: mesh.kind = '{self.section.kind()}' has no interface whose ends are free or "
                "driven; take another kind, such as strike_slip_section, or remove along_strike"
            )
        layer = _Layer(flat, 0.5 + 0.5 * Basis.of_order(self.order).points)
        for name, sides in flat.interfaces.items():
            for side, facets in zip(("plus", "minus"), sides, strict=True):
                if side == "plus" or name not in flat.one_sided:
                    layer.add(name, side, facets)
        z, count = along.positions, len(layer.points)
        quads, levels = np.array(layer.quads), range(len(z) - 1)

        def raised(lines: np.ndarray) -> np.ndarray:
            return np.concatenate([np.hstack([lines + i * count, lines + (i + 1) * count]) for i in levels])

        interfaces = {}
        for name in flat.interfaces:
            plus = raised(np.array(layer.facets[name, "plus"]))
            interfaces[name] = plus, plus if name in flat.one_sided else raised(np.array(layer.facets[name, "minus"]))
        bodies, number = np.unique(layer.bodies, return_inverse=True)
        places = np.array(layer.points)
        return RawMesh(
            cell="hexahedron", points=np.concatenate([np.column_stack([places, np.full(count, at)]) for at in z]),
            cells=raised(quads), bodies=[flat.bodies[each] for each in bodies],
            cell_body=np.tile(number, len(levels)), interfaces=interfaces, one_sided=flat.one_sided, strike=2,
        )  # fmt: skip


class _Layer:
    """Quadrilaterals beside the interfaces of a section.

    Parameters
    ----------
    flat : RawMesh
        The section.
    places : ndarray
        Points of a facet, from 0 to 1.
    """

    def __init__(self, flat: RawMesh, places: np.ndarray) -> None:
        self._flat, self._places = flat, places
        self._numbers: dict[tuple[object, ...], int] = {}
        self.points: list[np.ndarray] = []
        self.quads: list[list[int]] = []
        self.bodies: list[int] = []
        self.facets: dict[tuple[str, str], list[list[int]]] = {}
        facets = np.concatenate([facets for sides in flat.interfaces.values() for facets in sides])
        self._thickness = THIN * np.linalg.norm(np.diff(flat.points[facets], axis=1)[:, 0], axis=1).min()
        at_interfaces = np.unique(facets)
        self._cells: dict[int, list[int]] = {}
        for cell in np.flatnonzero(np.isin(flat.cells, at_interfaces).sum(axis=1) > 1):
            for vertex in np.intersect1d(flat.cells[cell], at_interfaces):
                self._cells.setdefault(int(vertex), []).append(int(cell))

    def _vertex(self, key: tuple[object, ...], place: np.ndarray) -> int:
        if key not in self._numbers:
            self._numbers[key] = len(self.points)
            self.points.append(place)
        return self._numbers[key]

    def add(self, name: str, side: str, facets: np.ndarray) -> None:
        """Add the elements on one side of an interface."""
        flat, places = self._flat, self._places
        owners = [next(iter(set(self._cells[a]) & set(self._cells[b]))) for a, b in facets.tolist()]
        tangent = np.diff(flat.points[facets], axis=1)[:, 0]
        inward = np.column_stack([tangent[:, 1], -tangent[:, 0]]) / np.linalg.norm(tangent, axis=1, keepdims=True)
        middle, centre = flat.points[facets].mean(axis=1), flat.points[flat.cells[owners]].mean(axis=1)
        inward *= np.sign(np.sum(inward * (centre - middle), axis=1))[:, None]
        mean: dict[int, np.ndarray] = {}
        for ends, direction in zip(facets.tolist(), inward, strict=True):
            for vertex in ends:
                mean[vertex] = mean.get(vertex, np.zeros(2)) + direction
        lines = self.facets.setdefault((name, side), [])
        for number, (a, b) in enumerate(facets.tolist()):
            base, beside = [], []
            for i, part in enumerate(places):
                end = a if i == 0 else b if i == len(places) - 1 else None
                place = (1 - part) * flat.points[a] + part * flat.points[b] if end is None else flat.points[end]
                direction = inward[number] if end is None else mean[end] / np.linalg.norm(mean[end])
                key = (end,) if end is not None else (name, side, number, i)
                base.append(self._vertex(key, place))
                beside.append(self._vertex((name, side, "beside", *key), place + self._thickness * direction))
            for i in range(len(places) - 1):
                lines.append([base[i], base[i + 1]])
                self.quads.append([base[i], base[i + 1], beside[i], beside[i + 1]])
                self.bodies.append(int(flat.cell_body[owners[number]]))
