"""Mesh kind `moved_mesh`, a plug-in of tests: another mesh mapped, renumbered, or with exchanged sides."""

from __future__ import annotations

import numpy as np

from ruptfx.bodies.meshes import AnyMesh, MeshSource, RawMesh
from ruptfx.input.schema import CaseError

MIRRORED = {"triangle": [0, 2, 1], "quadrilateral": [1, 0, 3, 2], "tetrahedron": [0, 2, 1, 3],
            "hexahedron": [1, 0, 3, 2, 5, 4, 7, 6]}  # fmt: skip
"""Vertices of a cell in the order that keeps its orientation under a reflection."""


class MovedMesh(MeshSource):
    """Another mesh, mapped by x -> matrix x + offset."""

    source: AnyMesh
    """The mesh."""
    matrix: list[list[float]]
    """Orthogonal."""
    offset: list[float]
    """[m]"""
    seed: int = 0
    """Of a random numbering of nodes and cells; 0 keeps it."""
    exchanged: bool = False
    """Exchange the sides plus and minus of every interface."""

    def build(self) -> RawMesh:
        mesh = self.source.build()
        if mesh.order > 1 or mesh.one_sided or mesh.bases:
            raise CaseError("mesh.source: curved cells and sides that are not meshed are not moved; take another mesh")
        matrix = np.array(self.matrix)
        mesh.points = mesh.points @ matrix.T + np.array(self.offset)
        if np.linalg.det(matrix) < 0:
            mesh.cells = mesh.cells[:, MIRRORED[mesh.cell]]
        mesh.reference_normals = {name: each for name, each in mesh.reference_normals.items() if not self.matrix}
        if self.exchanged:
            mesh.interfaces = {name: (minus, plus) for name, (plus, minus) in mesh.interfaces.items()}
        if self.seed:
            rng = np.random.default_rng(self.seed)
            order, cells = rng.permutation(len(mesh.points)), rng.permutation(len(mesh.cells))
            number = np.argsort(order)  # of a node in the new order
            mesh.points = mesh.points[order]
            mesh.cells, mesh.cell_body = number[mesh.cells][cells], mesh.cell_body[cells]
            mesh.edges = {name: number[each] for name, each in mesh.edges.items()}
            mesh.interfaces = {name: (number[a], number[b]) for name, (a, b) in mesh.interfaces.items()}
            mesh.open_facets = number[mesh.open_facets]
            mesh.joints = {name: number[each] for name, each in mesh.joints.items()}
        return mesh
