"""Meshes of SEM2DPACK: boxes, layers and files of its mesh generator."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ruptfx.app.convert.sem2dpack import distributions
from ruptfx.app.convert.sem2dpack.blocks import Block, ConversionError, Floats, Input, real

Ints = NDArray[np.int64]
READS = {"MESH_DEF", "MESH_CART", "MESH_CART_DOMAIN", "MESH_LAYERED", "MESH_LAYER", "MESH_MESH2D", "MESH_EMC2"}
REFUSED = {"EMC2": "a mesh of EMC2 (.ftq)"}
SIDES = {1: "bottom", 2: "right", 3: "top", 4: "left"}


@dataclass
class Mesh:
    """Quadrilaterals, before bodies have names.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        x and z [m].
    cells : ndarray of int, shape (cells, 4)
        Vertices, counter-clockwise.
    tags : ndarray of int, shape (cells,)
        Material of each cell.
    sides : dict of int to ndarray of int, shape (facets, 2)
        Vertices of the facets of each boundary; 5 and 6 are the minus and the plus side of a fault inside.
    rows : ndarray of int, shape (cells,)
        Row of each cell in a box, from below; empty in other meshes.
    cut : int
        Rows below a fault inside of a box.
    square : float
        Size of the elements of a box [m], where they are squares; else zero.
    """

    points: Floats
    cells: Ints
    tags: Ints
    sides: dict[int, Ints]
    rows: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    cut: int = 0
    square: float = 0.0

    @property
    def middles(self) -> Floats:
        """Centers of the cells, shape (cells, 2) [m]."""
        return np.asarray(self.points[self.cells].mean(axis=1))

    def touching(self, side: int) -> NDArray[np.bool_]:
        """Return which cells have a facet on a side."""
        width = len(self.points)
        wanted = np.sort(self.sides[side], axis=1) @ [width, 1]
        facets = np.sort(np.stack([self.cells, np.roll(self.cells, -1, axis=1)], axis=2), axis=2) @ [width, 1]
        return np.asarray(np.isin(facets, wanted).any(axis=1))


def read(value: Input) -> Mesh:
    """Return the mesh of an input.

    Raises
    ------
    ConversionError
    """
    method = value.one("MESH_DEF").word("method")
    kinds = {"CARTESIAN": _box, "LAYERED": _layers, "MESH2D": _file}
    if method not in kinds:
        name = REFUSED.get(method, "a mesh without counterpart")
        raise ConversionError(f"MESH_DEF.{method}: {name}; write it as a Gmsh file and use gmsh_file")
    return kinds[method](value)


def _box(value: Input) -> Mesh:
    box = value.one("MESH_CART")
    value.refuse_keys(box, "a split of the box", "split")
    (left, right), (low, high), nelem = box.pair("xlim"), box.pair("zlim"), box.pair("nelem")
    nx, nz = int(nelem[0]), int(nelem[1])
    if min(nx, nz) < 1 or right <= left or high <= low:
        raise ConversionError(
            f"&MESH_CART xlim = {left:g}, {right:g}, zlim = {low:g}, {high:g}, nelem = {nx}, {nz}: limits must "
            "increase, and nelem must be positive"
        )
    cut = -1 if box.get("faultx", False) else int(box.number("ezflt", 0))
    cut = nz // 2 if cut < 0 else cut
    tags = np.ones((nz, nx), dtype=np.int64)
    domains = value.all("MESH_CART_DOMAIN")
    if domains:
        tags[:] = 0
    for domain in domains:
        (i, j), (k, m) = domain.pair("ex"), domain.pair("ez")
        tags[int(k) - 1 : int(m), int(i) - 1 : int(j)] = int(domain.number("tag"))
    if zone := int(box.number("fztag", 0)):
        near = int(box.number("fznz", 1))
        tags[max(cut - near, 0) : cut + near] = zone
    if not tags.all():
        raise ConversionError(
            f"&MESH_CART_DOMAIN: {(tags == 0).sum()} of {tags.size} elements are in no domain; extend ex and ez, which "
            f"must reach from 1 to {nx} and {nz}"
        )
    x, z = np.linspace(left, right, nx + 1), np.linspace(low, high, nz + 1)
    mesh = _structured(x, np.repeat(z[:, None], nx + 1, axis=1), tags, cut)
    width, height = (right - left) / nx, (high - low) / nz
    mesh.square = width if abs(height - width) <= 0.01 * width else 0.0
    return mesh


def _layers(value: Input) -> Mesh:
    block = value.one("MESH_LAYERED")
    (left, right), nx, low = block.pair("xlim"), int(block.number("nx")), block.number("zmin")
    x = np.linspace(left, right, nx + 1)
    tops: list[Floats] = []
    rows: list[int] = []
    tags: list[int] = []
    if block.word("file"):
        for top, count, tag in value.table(block, 3):
            tops, rows, tags = [*tops, np.full(nx + 1, top)], [*rows, int(count)], [*tags, int(tag)]
    else:
        for number, layer in enumerate(value.all("MESH_LAYER"), start=1):
            tops, rows = [*tops, _top(value, layer, x)], [*rows, int(layer.number("nz"))]
            tags = [*tags, int(layer.number("tag", number))]
    if not tops or len(tops) != int(block.number("nlayer", len(tops))):
        raise ConversionError(
            f"&MESH_LAYERED nlayer = {block.get('nlayer', 0)}: {len(tops)} layers follow; give as many &MESH_LAYER"
        )
    z, names = [np.full(nx + 1, low)], []
    for top, count, tag in zip(reversed(tops), reversed(rows), reversed(tags), strict=True):
        below = z[-1]
        z += [below + share * (top - below) for share in np.arange(1, count + 1) / count]
        names += [tag] * count
    return _structured(x, np.array(z), np.repeat(np.array(names)[:, None], nx, axis=1), 0)


def _top(value: Input, layer: Block, x: Floats) -> Floats:
    kind = layer.word("ztoph")
    if not kind:
        return np.full(len(x), layer.number("ztop"))
    shape = next(iter(value.following(layer, ("DIST_",), ("MESH_LAYER",))), None)
    if shape is None or shape.name != f"DIST_{kind}":
        raise ConversionError(
            f"&MESH_LAYER ztopH = '{kind}': &DIST_{kind} must follow; write its block after the layer"
        )
    if kind != "LINEAR":
        value.note("curved layers are straight from vertex to vertex")
    return distributions.field(value, shape)(x, np.zeros_like(x))


def _structured(x: Floats, z: Floats, tags: Ints, cut: int) -> Mesh:
    """Make a mesh of columns, from heights of shape (rows + 1, columns + 1)."""
    rows, columns = tags.shape
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]]
    lines = {1: number[0], 2: number[:, -1], 3: number[-1], 4: number[:, 0]}
    if cut:
        lines |= {5: number[cut], 6: number[cut]}
    return Mesh(
        np.stack([np.repeat(x[None], rows + 1, axis=0), z], axis=2).reshape(-1, 2),
        np.stack(corners, axis=2).reshape(-1, 4), tags.ravel(),
        {side: np.stack([line[:-1], line[1:]], axis=1) for side, line in lines.items()},
        np.repeat(np.arange(rows), columns), cut,
    )  # fmt: skip


def _file(value: Input) -> Mesh:
    """Read a .mesh2d file: headers in words, then numbers of elements, nodes per element, nodes and boundaries."""
    block = value.one("MESH_MESH2D")
    path = value.path(block)
    lines = path.read_text().splitlines()
    try:
        (cells, corners, nodes, boundaries), lines_below = _numbers(lines[1:], 1)[0][0].astype(int), lines[2:]
        points, lines_below = _numbers(lines_below[1:], nodes)
        elements, lines_below = _numbers(lines_below[1:], cells)
        number = np.zeros(int(points[:, 0].max()) + 1, dtype=np.int64)
        number[points[:, 0].astype(int)] = np.arange(nodes)
        quads = number[elements[:, 1:5].astype(int)]
        sides: dict[int, Ints] = {}
        for _ in range(boundaries):
            (tag, count), lines_below = _numbers(lines_below[1:], 1)[0][0].astype(int), lines_below[2:]
            edges, lines_below = _numbers(lines_below[1:], count)
            cell, edge = edges[:, 1].astype(int) - 1, edges[:, 2].astype(int) - 1
            sides[int(tag)] = np.stack([quads[cell, edge], quads[cell, (edge + 1) % 4]], axis=1)
    except (IndexError, ValueError):
        raise ConversionError(
            f"&{block.name} file = '{path.name}': not a mesh of this format, which begins with NEL NPEL NNOD "
            "NBC and has nodes, elements and sides"
        ) from None
    if corners != 4:
        value.note("curved elements are straight from vertex to vertex")
    mesh = Mesh(points[:, 1:3], quads, elements[:, -1].astype(np.int64), sides)
    a, b, c, _ = np.moveaxis(mesh.points[mesh.cells], 1, 0)
    clockwise = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    mesh.cells[clockwise] = mesh.cells[clockwise][:, ::-1]
    return mesh


def _numbers(lines: list[str], count: int) -> tuple[Floats, list[str]]:
    """Return the numbers of the first lines, and the lines after them."""
    return np.array([[real(word) for word in line.split()] for line in lines[:count]]), lines[count:]
