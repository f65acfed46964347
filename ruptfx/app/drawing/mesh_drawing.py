"""Drawing of `ruptfx mesh`: names, normals and positions of a case on its mesh."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from ruptfx.bodies.meshes import RawMesh
from ruptfx.case import Case
from ruptfx.input.profiles.places import patches
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.platform import fem
from ruptfx.results.figure_style import blank_figure, scale, styled
from ruptfx.run.model import Model

BODIES = ("#dfe9f2", "#f3e6dd", "#e3efdd", "#efe0ef", "#f2efd8")
LINE = 9  # distance between labels in points
NORMAL, TANGENT, PATCH = "#1769aa", "#2e7d32", "#c8501e"


@styled
def draw(case: Case) -> Figure:
    """Draw elements and names of bodies, edges and interfaces, with origin, normal, tangent and patches; one rank.

    In 3D the initial shear traction of the surfaces is drawn instead of patches.

    Raises
    ------
    RuptfxError
        If the mesh is invalid.
    """
    raw = case.mesh.build()
    if raw.points.shape[1] != 2:
        from ruptfx.app.drawing import solid_drawing

        return solid_drawing.draw(case, raw)
    extent = np.ptp(raw.points, axis=0)
    figure = blank_figure(7.0, float(np.clip(7.0 * extent[1] / extent[0] + 1.0, 2.0, 9.0)))
    axes = figure.add_subplot()
    _draw_bodies(axes, raw)
    for name, facets in raw.edges.items():
        _name(axes, raw.points[facets], name)
    size, unit = scale(extent, "m")
    model = Model(case, fem.MPI.COMM_SELF)
    for fault in model.faults:
        meaning = fault.interface.line.meaning_in(size, unit)
        _draw_interface(axes, model, fault, 0.12 * float(extent.min()), meaning)
    for axis in (axes.xaxis, axes.yaxis):  # the places of names and arrows stay in metres
        axis.set_major_formatter(lambda value, _: f"{value / size:g}")
    axes.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})", aspect="equal", title=case.title or None)
    axes.margins(0.06)
    return figure


def _draw_bodies(axes: Axes, raw: RawMesh) -> None:
    order = [0, 1, 3, 2] if raw.cell == "quadrilateral" else [0, 1, 2]
    corners = raw.points[raw.cells[:, order]]
    named: list[np.ndarray] = []
    for number, name in enumerate(raw.bodies):
        own = corners[raw.cell_body == number]
        colour = BODIES[number % len(BODIES)]
        axes.add_collection(PolyCollection(own, facecolor=colour, edgecolor="#bbbbbb", linewidth=0.2))
        place = _free_place(own.mean(axis=1), named, 0.08 * np.ptp(raw.points, axis=0).max())
        named.append(place)
        axes.text(place[0], place[1], name, ha="center", va="center", weight="bold", size=10)
    axes.autoscale_view()


def _free_place(centres: np.ndarray, items: list[np.ndarray], apart: float) -> np.ndarray:
    """Return the middle of a body or, if another label is there, as for mixed grains, a free cell."""
    middle = centres.mean(axis=0)
    free = np.ones(len(centres), dtype=bool)
    for place in items:
        free &= np.linalg.norm(centres - place, axis=1) > apart
        middle = np.full(2, np.nan) if np.linalg.norm(middle - place) <= apart else middle
    if np.isfinite(middle).all() or not free.any():
        return np.where(np.isfinite(middle), middle, centres.mean(axis=0))
    return centres[free][np.argmin(np.linalg.norm(centres[free] - centres.mean(axis=0), axis=1))]


def _name(axes: Axes, sides: np.ndarray, name: str) -> None:
    """Draw an edge in black, with its name beside its middle."""
    axes.add_collection(LineCollection(list(sides), color="black", linewidth=1.2))
    middles = sides.mean(axis=1)
    middle = middles[np.argmin(np.linalg.norm(middles - middles.mean(axis=0), axis=1))]  # on it, where it is curved
    along = np.ptp(sides.reshape(-1, 2), axis=0)
    axes.text(middle[0], middle[1], name, ha="center", va="center", size=7, rotation=90 if along[1] > along[0] else 0,
              bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.8})  # fmt: skip


def _draw_interface(axes: Axes, model: Model, fault: Fault, length: float, meaning: str) -> None:
    face = fault.interface
    order = np.argsort(face.position)
    x, y = face.points[order].T
    axes.plot(x, y, color="black", linewidth=1.8)
    if face.line.measure != "x":
        axes.plot(*face.line.origin, "o", color="black", markersize=4)
    middle = order[len(order) // 4]
    below = face.other_side == "meshed"  # else the tick labels of the axis are there
    marked = list(patches(model.placed[fault.name], f"faults.{fault.name}"))
    label = f"interface {fault.name}: position = {meaning}"
    place = face.points[middle if below else order[len(order) // 2]]
    axes.annotate(label, place, (0, -18 if below else 5 + LINE * len(marked)), textcoords="offset points", size=7,
                  ha="left" if below else "center")  # fmt: skip
    normal = np.array([face.frame[middle, 0, 0], face.frame[middle, 0, 1]]) if model.components > 1 else _across(x, y)
    tangent = np.array([normal[1], -normal[0]])  # the convention of `Interface`
    for direction, colour, label in ((normal, NORMAL, "n"), (tangent, TANGENT, "t")):
        start, end = face.points[middle], face.points[middle] + length * direction
        axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.4})
        axes.annotate(label, end, (2, 2), textcoords="offset points", color=colour)
    for number, patch in enumerate(marked):
        ends = np.clip(patch.ends, face.line.first, face.line.last)
        inside = order[(face.position[order] >= ends[0]) & (face.position[order] <= ends[1])]
        axes.plot(*face.points[inside].T, color=PATCH, linewidth=3.5, alpha=0.7, solid_capstyle="butt")
        if len(inside):
            key = patch.key.removeprefix(f"faults.{fault.name}.")
            place = face.points[inside[len(inside) // 2]]
            height = 5 + LINE * number
            axes.annotate(key, place, (0, height), textcoords="offset points", color=PATCH, ha="center", size=7)


def _across(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the normal of an interface in antiplane, which has no local frame in the plane, from its chord."""
    along = np.array([x[-1] - x[0], y[-1] - y[0]])
    return np.array([-along[1], along[0]]) / np.linalg.norm(along)
