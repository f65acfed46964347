"""Figure of a search: scores in the order of the search, and positions of the good sets in the ranges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ruptfx.many_runs.study.definition import Study
from ruptfx.results.figure_style import MUTED, WIDTH, letter, new_figure, styled

if TYPE_CHECKING:
    from ruptfx.many_runs.study.scored import ScoredSet

COLOURS = ("#0072B2", "#E69F00", "#D55E00", "#009E73", "#CC79A7", "#56B4E9")
MAP = matplotlib.colormaps["viridis_r"]


@styled
def draw(study: Study, sets: Sequence[ScoredSet]) -> Figure:
    """Draw (a) score of every set and degrees of the best so far; (b) all sets over their ranges, the best in front."""
    figure, axes = new_figure(2, 1, 5.2, WIDTH)
    _scores(axes[0, 0], sets)
    _ranges(axes[1, 0], study, sets)
    scores = [one.score for one in sets]
    colours = ScalarMappable(Normalize(0, max(scores) or 1.0), MAP)
    figure.colorbar(colours, ax=axes[1, 0], label="score", pad=0.01)
    letter(axes[:, 0])
    return figure


def _scores(ax: Axes, sets: Sequence[ScoredSet]) -> None:
    score = np.array([one.score for one in sets])
    best = np.array([np.argmax(score[: number + 1]) for number in range(len(sets))])
    ax.plot(score, ".", ms=2, color=MUTED, label="score of a set")
    ax.plot(score[best], color="black", lw=1.4, label="best so far")
    if len(sets[0].degrees) > 1:
        for name, colour in zip(sets[0].degrees, COLOURS, strict=False):
            ax.plot([sets[number].degrees[name] for number in best], color=colour, lw=0.8, label=f"of the best, {name}")
    ax.set(xlabel="set", ylabel="score", ylim=(0, 1.02), xlim=(0, max(len(sets) - 1, 1)))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(ncols=2, loc="lower right")


def _ranges(ax: Axes, study: Study, sets: Sequence[ScoredSet]) -> None:
    axes = study.sampled
    largest = max(one.score for one in sets) or 1.0
    for rank, one in enumerate(sorted(sets, key=lambda one: one.score)):
        front = rank >= len(sets) - 20
        parts = [axis.part(one.sample[axis.column]) for axis in axes]
        ax.plot(parts, color=MAP(one.score / largest), lw=1.2 if front else 0.3, alpha=1.0 if front else 0.25)
    for number, axis in enumerate(axes):
        low, high = axis.range or (0.0, 1.0)
        ax.axvline(number, color=MUTED, lw=0.4, zorder=0)
        for part, value, side in ((0, low, "top"), (1, high, "bottom")):
            ax.text(number, part + (-0.02 if part == 0 else 0.02), f"{value:.3g}", ha="center", va=side, fontsize=6)
    ax.set(ylim=(-0.1, 1.1), xlim=(-0.3, len(axes) - 0.7), yticks=[])
    ax.set_xticks(range(len(axes)), [axis.column for axis in axes], rotation=30, ha="right", parse_math=False)
