"""Mesh kind `moved_mesh`, a plug-in of tests: another mesh mapped, renumbered, with exchanged sides, or divided."""

from __future__ import annotations

import numpy as np

from ruptfx.bodies.meshes import AnyMesh, MeshSource, RawMesh
from ruptfx.input.schema import CaseError

MIRRORED = {"triangle": [0, 2, 1], "quadrilateral": [1, 0, 3, 2], "tetrahedron": [0, 2, 1, 3],
            "hexahedron": [1, 0, 3, 2, 5, 4, 7, 6]}  # fmt: skip
"""Vertices of a cell in the order that keeps its orientation under a reflection."""
SECOND = "_second"
"""End of the name of the second part of a body or an interface."""


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
    two_bodies: bool = False
    """Divide every body into two welded ones, right and left of the median of its cells."""
    two_interfaces: bool = False
    """Divide every interface into two adjoining ones, right and left of its middle."""

    def build(self) -> RawMesh:
        mesh = self.source.build()
        if mesh.order > 1 or mesh.one_sided or mesh.bases:
            raise CaseError("mesh.source: curved cells and sides that are not meshed are not moved; take another mesh")
        if self.two_bodies:
            _divide_bodies(mesh)
        if self.two_interfaces:
            _divide_interfaces(mesh)
        matrix = np.array(self.matrix)
        mesh.points = mesh.points @ matrix.T + np.array(self.offset)
        if np.linalg.det(matrix) < 0:
            mesh.cells = mesh.cells[:, MIRRORED[mesh.cell]]
        mesh.reference_normals = {
            name: matrix @ normal for name, normal in mesh.reference_normals.items() if len(matrix) == len(normal)
        }
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


def _divide_bodies(mesh: RawMesh) -> None:
    x, count = mesh.points[mesh.cells].mean(axis=1)[:, 0], len(mesh.bodies)
    for number in range(count):
        own = mesh.cell_body == number
        mesh.cell_body = np.where(own & (x > np.median(x[own])), number + count, mesh.cell_body)
    mesh.bodies = [*mesh.bodies, *(name + SECOND for name in mesh.bodies)]


def _divide_interfaces(mesh: RawMesh) -> None:
    for name, (plus, minus) in list(mesh.interfaces.items()):
        x = mesh.points[plus].mean(axis=1)[:, 0]
        second = x > 0.5 * (x.min() + x.max())
        mesh.interfaces[name] = plus[~second], minus[~second]
        mesh.interfaces[name + SECOND] = plus[second], minus[second]
        if name in mesh.reference_normals:
            mesh.reference_normals[name + SECOND] = mesh.reference_normals[name]
