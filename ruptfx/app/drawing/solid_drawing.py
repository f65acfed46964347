"""Drawing of `ruptfx mesh` in three dimensions: bodies in perspective, and a map of every surface."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ruptfx.bodies.meshes import RawMesh
from ruptfx.case import Case
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.sliding.interface import SlidingInterface
from ruptfx.platform import fem
from ruptfx.results.figure_style import RATE_MAP, blank_figure, scale, set_box, styled
from ruptfx.results.plots import figure_of
from ruptfx.results.plots.surface_maps import triangulated
from ruptfx.run.model import Model

Array = np.ndarray

SURFACE, OPPOSITE, ARROWS = "#c8501e", "#3b8ea5", ("#1769aa", "#2e7d32", "#6a1b9a")
ROUNDING = 1e-10  # gap of surfaces that touch, over the length of the surface, and differences of equal values
BASE = 24  # rectangles along both directions of a rigid base
NAME_STEP = 0.045  # least distance between names, over the height of the drawing
COLUMNS = -0.08, 1.2  # of names, left of the drawing with its numbers on the axes, and right of it; over its width
LETTERS = ("n", "1", "2")  # normal, first and second tangent


@styled
def draw(case: Case, raw: RawMesh) -> Figure:
    """Draw outer facets and names of the edges, surfaces with normal and tangents, and maps of the initial shear.

    Runs on one rank. Nodes of the rim of a surface that are welded have no traction and stay blank. With finite sliding
    both surfaces are drawn, and maps have the elements of both and the initial gap.

    Parameters
    ----------
    raw : RawMesh
        Its mesh.
    """
    model = Model(case, fem.MPI.COMM_SELF)
    count = len(model.faults)
    figure = blank_figure(7.0, 4.5 + 3.0 * count)
    grid = figure.add_gridspec(1 + count, 1, height_ratios=[4.5, *[3.0] * count])
    axes = figure.add_subplot(grid[0], projection="3d")
    assert isinstance(axes, Axes3D)
    axes.computed_zorder = False  # arrows and names in front of the surfaces
    size, unit = scale(np.ptp(raw.points, axis=0), "m")
    corners = 4 if raw.cell == "hexahedron" else 3  # the first nodes of a curved facet
    middles: dict[str, Array] = {}
    for name, nodes in raw.edges.items():
        sides = polygons(raw.points[nodes[:, :corners]] / size)
        outside = Poly3DCollection(sides, facecolor=(0.6, 0.7, 0.8, 0.05), edgecolor=(0, 0, 0, 0.12), linewidth=0.3)
        axes.add_collection3d(outside)
        middles[name] = sides.mean(axis=(0, 1))
    for number, fault in enumerate(model.faults):
        facets = polygons(raw.points[raw.interfaces[fault.name][0][:, :corners]])
        surface = Poly3DCollection(facets / size, facecolor=SURFACE, edgecolor="white", lw=0.2, alpha=0.6, zorder=2)
        axes.add_collection3d(surface)
        other = opposite_facets(raw, fault.name)
        axes.add_collection3d(
            Poly3DCollection(other / size, facecolor=OPPOSITE, edgecolor="white", lw=0.2, alpha=0.5, zorder=1)
        )
        _draw_frame(axes, fault, size, 0.25 * float(np.ptp(facets.reshape(-1, 3), axis=0).max()))
        _draw_map(figure.add_subplot(grid[number + 1]), fault, facets, other)
    set_box(axes, raw.points.min(axis=0) / size, raw.points.max(axis=0) / size, unit)
    axes.set(title=case.title or None)
    axes.view_init(25, -60)
    _name_edges(axes, middles)
    return figure


def _name_edges(axes: Axes3D, middles: dict[str, Array]) -> None:
    """Write the names of edges in columns on both sides, in the order of their heights, with lines to their middles."""
    if not middles:
        return
    projected = np.array(proj3d.proj_transform(*np.array(list(middles.values())).T, axes.get_proj())[:2]).T
    placed = axes.transAxes.inverted().transform(axes.transData.transform(projected))
    order = np.argsort(placed[:, 0], kind="stable")
    for column, rows in enumerate(np.array_split(order, 2)):
        rows = rows[np.argsort(placed[rows, 1], kind="stable")]
        step = min(NAME_STEP, 0.9 / max(len(rows), 1))
        heights = np.mean(placed[rows, 1]) + step * (np.arange(len(rows)) - 0.5 * (len(rows) - 1))
        heights += max(0.0, 0.05 - heights.min(initial=1.0)) - max(0.0, heights.max(initial=0.0) - 0.95)
        for row, height in zip(rows, heights, strict=True):
            x, y = projected[row].tolist()
            axes.annotate(
                list(middles)[row], (x, y), (COLUMNS[column], float(height)), textcoords="axes fraction", size=6,
                ha="left", va="center", annotation_clip=False, zorder=4,
                arrowprops={"arrowstyle": "-", "color": "#888888", "linewidth": 0.4, "shrinkA": 1, "shrinkB": 0},
            )  # fmt: skip


def polygons(corners: Array) -> Array:
    """Return corners of facets in their order around the facet, shape (facets, corners, 3)."""
    if corners.shape[1] == 3:
        return corners
    a, b, c, d = (corners[:, number] for number in range(4))
    # The order with the larger area does not cross itself.
    around, crossed = (np.linalg.norm(np.cross(*pair), axis=1) for pair in ((c - a, d - b), (d - a, c - b)))
    turned: Array = np.where((crossed > around)[:, None, None], corners[:, [0, 1, 3, 2]], corners)
    return turned


def opposite_facets(raw: RawMesh, name: str) -> Array:
    """Return corners of the facets of the minus side [m], shape (facets, corners, 3); none if nodes coincide."""
    if name in raw.bases:
        base = raw.bases[name]
        assert base.sides is not None
        lines = [np.linspace(*ends, BASE + 1) for ends in (base.ends, base.sides)]
        points = base.points(np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2))
        number = np.arange(len(points)).reshape(BASE + 1, BASE + 1)
        around = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
        rectangles: Array = points[np.stack(around, axis=-1).reshape(-1, 4)]
        return rectangles
    if name in raw.non_matching:
        return polygons(raw.points[raw.interfaces[name][1][:, :4]])
    return np.zeros((0, 4, 3))


def positions(fault: Fault, points: Array) -> Array:
    """Return positions along strike and down dip of points of a surface [m], shape (..., 2).

    Both are linear in the coordinates.
    """
    face = fault.interface
    assert face.across is not None
    middle = face.points.mean(axis=0)
    known = np.column_stack([face.points - middle, np.ones(len(face.points))])
    linear, *_ = np.linalg.lstsq(known, np.stack([face.position, face.across], axis=1), rcond=None)
    result: Array = (points - middle) @ linear[:3] + linear[3]
    return result


def _draw_frame(axes: Axes3D, fault: Fault, size: float, length: float) -> None:
    """Draw normal and tangents at the point next to the middle of a surface."""
    face = fault.interface
    middle = int(np.argmin(np.linalg.norm(face.points - face.points.mean(axis=0), axis=1)))
    start = face.points[middle] / size
    for direction, colour, letter in zip(face.frame[middle], ARROWS, LETTERS, strict=True):
        arrow = length / size * direction
        axes.quiver(*start, *arrow, color=colour, linewidth=1.4, zorder=3)
        axes.text(*(start + 1.1 * arrow), letter, color=colour, size=8, weight="bold", zorder=4)


def _draw_map(axes: Axes, fault: Fault, facets: Array, other: Array) -> None:
    """Draw elements and initial shear traction of a surface over its positions, or the gap to the opposite surface."""
    face = fault.interface
    assert face.across is not None
    values, text, si = np.linalg.norm(fault.shear_traction_0, axis=1), "Initial shear traction", "Pa"
    size, unit = scale(np.ptp(positions(fault, facets).reshape(-1, 2), axis=0), "m")
    triangles = triangulated(face.position / size, face.across / size)
    if isinstance(face, SlidingInterface):
        seen = face.covered & (face.resting_jump > ROUNDING * np.ptp(face.points, axis=0).max())
        values, text, si = np.where(seen, face.resting_jump, 0.0), "Initial gap", "m"
        triangles.set_mask(triangles.mask | ~face.covered[triangles.triangles].all(axis=1))
    value, value_unit = scale(values, si)
    largest = float(np.abs(values).max(initial=0.0))
    # A colour bar of rounding would have thirteen digits.
    is_even = np.ptp(values) <= ROUNDING * largest
    norm = Normalize(0, 1.25 * largest / value or 1) if is_even else None
    drawn = axes.tripcolor(triangles, values / value, norm=norm, cmap=RATE_MAP, shading="gouraud")
    corners = positions(fault, facets) / size
    axes.add_collection(PolyCollection(list(corners), facecolor="none", edgecolor="#888888", linewidth=0.3))
    if len(other):
        lines = list(positions(fault, other) / size)
        axes.add_collection(PolyCollection(lines, facecolor="none", edgecolor=OPPOSITE, linewidth=0.5))
    figure_of(axes).colorbar(drawn, ax=axes, label=f"{text} ({value_unit})", pad=0.02)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(high[1], low[1]), xlabel=f"Along tangent 1 ({unit})")
    meaning = face.line.meaning_in(size, unit)
    sides = "; elements of the minus side in blue" if len(other) else ""
    axes.set(ylabel=f"Along tangent 2 ({unit})", title=f"interface {fault.name}: position = {meaning}{sides}")
