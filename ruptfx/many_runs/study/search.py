"""Search for the best set of constants: generations of sets, each set under all values of the other axes.

The optimiser (`ruptfx.many_runs.search_methods`) has no saved state. With the same seed it requests the same sets as
long as it receives the same scores, so an interrupted search replays the finished points without computing and
continues.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomli_w

from ruptfx import Table
from ruptfx.many_runs.search_methods import Generation
from ruptfx.many_runs.study.definition import Axis, Point, Study
from ruptfx.many_runs.study.goals import Search
from ruptfx.many_runs.study.scored import Runs, ScoredSet
from ruptfx.many_runs.study.table import Row, write_csv

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ruptfx.many_runs.study.count import Count

FILES = ("scores.csv", "best.toml", "search.png", "search.pdf")
BEST, APART = 4, 0.1  # number of sets in best.toml, and their smallest RMS distance in parts of the ranges


def find_best(study: Study, run: Callable[[list[Point]], Runs], count: Count) -> list[ScoredSet]:
    """Run the search and return all tried sets, in order.

    Parameters
    ----------
    study : Study
        A study with a search.
    run : callable
        Function that runs points, or reads their results.
    count : Count
        Progress display.

    Raises
    ------
    RuptfxError
        The library is missing.
    """
    best: list[ScoredSet] = []
    search, wanted, table = _search(study), study.samples or 1, study.base()
    crossed = len(list(study.crossed(study.start(search))))
    count.expect(wanted * crossed)
    for generation, (asked, tell) in enumerate(_generations(study, search)):
        samples = [_sample(study, unit) for unit in asked[: wanted - len(best)]]
        points = [[study.point(values, table=table) for values in study.crossed(sample)] for sample in samples]
        results = iter(run([point for of_set in points for point in of_set]))
        for sample, of_set in zip(samples, points, strict=True):
            best.append(_scored(search, study, len(best), generation, sample, [next(results) for _ in of_set]))
        count.note = f"; best score {max(one.score for one in best):.3f} of {len(best)} sets"
        if len(best) >= wanted:
            return best
        tell([1 - one.score for one in best[-len(asked) :]])
    raise AssertionError("generations never end")


def _search(study: Study) -> Search:
    assert study.search is not None
    return study.search


def _generations(study: Study, search: Search) -> Iterator[Generation]:
    """Yield populations in the unit cube without end, each with the function that accepts their losses."""
    start = study.start(search)
    begin = [axis.part(start[axis.column]) for axis in study.sampled]
    return search.method.generations(begin, search.step, search.population, np.random.default_rng(study.seed))


def _sample(study: Study, unit: Sequence[float]) -> dict[str, float]:
    return {axis.column: axis.value(float(part)) for axis, part in zip(study.sampled, unit, strict=True)}


def _scored(
    search: Search, study: Study, number: int, generation: int, sample: dict[str, float], runs: Runs
) -> ScoredSet:
    degrees = {
        name_of(study, point): search.degree(point.coordinates, result.get("values", {})) for point, result in runs
    }
    return ScoredSet(number, generation, sample, runs, degrees, search.score(degrees.values()))


def name_of(study: Study, point: Point) -> str:
    """Return the name of a run within its set: its coordinates on the axes without a range."""
    sampled = {axis.column for axis in study.sampled}
    return ", ".join(str(value) for name, value in point.coordinates.items() if name not in sampled) or "run"


def best_of(study: Study, sets: Sequence[ScoredSet], count: int = BEST) -> list[ScoredSet]:
    """Return the best sets that differ, best first."""
    chosen: list[ScoredSet] = []
    for one in sorted(sets, key=lambda one: -one.score):
        if all(_distance(study.sampled, one, other) > APART for other in chosen):
            chosen.append(one)
        if len(chosen) == count:
            break
    return chosen


def _distance(axes: Sequence[Axis], one: ScoredSet, other: ScoredSet) -> float:
    parts = [axis.part(one.sample[axis.column]) - axis.part(other.sample[axis.column]) for axis in axes]
    return math.sqrt(sum(part**2 for part in parts) / len(parts))


def save(study: Study, sets: Sequence[ScoredSet], directory: Path, out: Path) -> None:
    """Write ``scores.csv``, ``best.toml``, whose paths are relative to `directory`, and the figure ``search``."""
    scores, best, *pictures = [out / name for name in FILES]
    write_csv(scores, [_row(one) for one in sets])
    best.write_text(_study_of_best(study, sets, directory), encoding="utf-8")
    figure = draw(study, sets)
    for path in pictures:
        figure.savefig(path, dpi=200)


def _row(one: ScoredSet) -> Row:
    degrees = {f"degree_{name}": degree for name, degree in one.degrees.items()}
    return {"set": one.number, "generation": one.generation, "score": one.score, **degrees, **one.sample}


def _study_of_best(study: Study, sets: Sequence[ScoredSet], directory: Path) -> str:
    """Return the study file of the best sets under the same other axes, for other meshes or longer runs."""
    best = best_of(study, sets)
    axes = study.sampled
    keys = [key for axis in axes for key in axis.keys]
    values = [[one.sample[axis.column] for axis in axes for _ in axis.keys] for one in best]
    together = Axis(key=keys, name="set", values=values, labels=[f"B{number + 1}" for number in range(len(best))])
    crossed = [axis for axis in study.axes if axis not in axes]
    grid = study.model_copy(update={
        "axes": [together, *crossed], "sampling": "grid", "samples": None, "search": None,
    })  # fmt: skip
    scores = ", ".join(f"B{number + 1} {one.score:.3f}" for number, one in enumerate(best))
    head = f"# The best sets of the search that differ, with their scores: {scores}.\n"
    table: Table = grid.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    table["case"] = os.path.relpath(study.case, directory)
    if study.plugins:
        table["plugins"] = [os.path.relpath(path, directory) for path in study.plugins]
    return head + tomli_w.dumps(table)


def draw(study: Study, sets: Sequence[ScoredSet]) -> Figure:
    """Draw scores over the search, and the positions of good sets in the ranges."""
    from ruptfx.many_runs.study import search_figure

    return search_figure.draw(study, sets)
