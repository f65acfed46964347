"""Labels of a figure as they are drawn: those that lie on top of each other, and those that are cut off."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from unittest.mock import patch

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

TOUCH = 0.3  # of the shorter side of a label: its box has room for letters that reach below the line
OUTSIDE = 2.0  # pixels


@dataclass(frozen=True)
class Label:
    """A text as drawn: the corners of its box [pixels], turned as it is, in their order."""

    text: str
    corners: np.ndarray

    @classmethod
    def of(cls, text: Text, renderer: RendererAgg) -> Label:
        level = Text(text=text.get_text(), fontproperties=text.get_fontproperties(), linespacing=text._linespacing)
        level.set_figure(text.get_figure())
        flat, box = level.get_window_extent(renderer), Text.get_window_extent(text, renderer)
        angle = np.radians(text.get_rotation())
        along = flat.width / 2 * np.array([np.cos(angle), np.sin(angle)])
        across = flat.height / 2 * np.array([-np.sin(angle), np.cos(angle)])
        sides = np.array([along + across, along - across, -along - across, across - along])
        return cls(text.get_text(), np.array([box.x0 + box.x1, box.y0 + box.y1]) / 2 + sides)

    def depth(self, other: Label) -> float:
        """How far two boxes reach into each other [pixels]; negative where they are apart.

        Boxes overlap where their shadows do, along every side of both.
        """
        depths = []
        for box in (self.corners, other.corners):
            for side in (box[0] - box[1], box[1] - box[2]):
                length = np.linalg.norm(side)
                mine, theirs = self.corners @ side / length, other.corners @ side / length
                depths.append(min(mine.max(), theirs.max()) - max(mine.min(), theirs.min()))
        return float(min(depths))

    @property
    def smallest(self) -> float:
        """The shorter side of the box [pixels]."""
        return float(np.linalg.norm(np.diff(self.corners[:3], axis=0), axis=1).min())


def drawn(figure: Figure) -> list[Label]:
    """Every text that a drawing of the figure shows, where its layout puts it."""
    texts: list[Label] = []
    draw = Text.draw

    def remember(text: Text, renderer: RendererAgg, *others: object, **more: object) -> None:
        draw(text, renderer, *others, **more)
        if text.get_visible() and text.get_text().strip():
            texts.append(Label.of(text, renderer))

    with patch.object(Text, "draw", remember):
        figure.draw_without_rendering()
    return texts


def label_faults(figure: Figure) -> list[str]:
    """What is wrong with the labels of a figure, in words."""
    labels, found = drawn(figure), []
    for one, other in combinations(labels, 2):
        if one.depth(other) > TOUCH * min(one.smallest, other.smallest):
            found.append(f"{one.text!r} and {other.text!r} are on top of each other")
    width, height = figure.bbox.width, figure.bbox.height
    for label in labels:
        (x0, y0), (x1, y1) = label.corners.min(axis=0), label.corners.max(axis=0)
        if min(x0, y0) < -OUTSIDE or x1 > width + OUTSIDE or y1 > height + OUTSIDE:
            found.append(f"{label.text!r} is cut off at the edge of the figure")
    return found


def crossed_labels(axes: Axes) -> list[str]:
    """Labels inside axes that a line along one of them crosses, such as that of `axvline`."""
    figure = axes.figure
    figure.draw_without_rendering()
    legend, renderer = axes.get_legend(), figure._get_renderer()
    texts = [*axes.texts, *(legend.get_texts() if legend else [])]
    result = []
    for line in axes.lines:
        points = line.get_transform().transform(line.get_xydata())
        for axis, (low, high) in enumerate(zip(points.min(axis=0), points.max(axis=0), strict=True)):
            for text in texts if high - low < 1 else ():
                corners = text.get_window_extent(renderer).get_points()
                reach = points[:, 1 - axis]
                beside = corners[1, 1 - axis] < reach.min() or corners[0, 1 - axis] > reach.max()
                if corners[0, axis] < low < corners[1, axis] and not beside:
                    result.append(text.get_text())
    return result
