"""Execution of all points of a study on a dask.distributed cluster, by default a local one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ruptfx import RuptfxError, Table
from ruptfx.many_runs.jobs import Client, completed, opened, stoppable
from ruptfx.many_runs.study import refine, search, table
from ruptfx.many_runs.study.count import Count
from ruptfx.many_runs.study.definition import Point, Study
from ruptfx.many_runs.study.point_runs import run_point
from ruptfx.many_runs.study.scored import ScoredSet
from ruptfx.many_runs.study.store import Result, Store, commit, workspace
from ruptfx.platform import launch
from ruptfx.platform.progress import Progress
from ruptfx.platform.run_files import write_json
from ruptfx.results.outputs import Outputs, final


@dataclass
class Outcome:
    """Results of a study: every point, boundary points on the finer mesh, and sets with scores.

    `files` are the products of the whole study.
    """

    points: list[tuple[Point, Result]] = field(default_factory=list)
    sets: list[ScoredSet] = field(default_factory=list)
    fine: dict[str, Result] = field(default_factory=dict)
    known_before: int = 0
    files: list[Path] = field(default_factory=list)

    @property
    def failed(self) -> int:
        """Number of failed points."""
        return sum(result["status"] == "failed" for _, result in self.points)


def run_study(  # noqa: PLR0913
    study: Study,
    out: str | Path,
    *,
    scheduler: str | None = None,
    cores: int | None = None,
    refined: bool = False,
    retry: bool = False,
    show: bool = True,
    overwrite: bool = False,
) -> Outcome:
    """Run the unfinished points, then write the table, the data set, the map and its page.

    Parameters
    ----------
    out : path
        Directory of the study; an existing one of the same study is continued.
    scheduler : str, optional
        Address of a dask scheduler whose workers see `out` under the same path; default is a cluster in this
        process.
    cores : int, optional
        Cores of the local cluster; default is all that this process may use.
    refined : bool
        Locate the boundaries between modes and run the points beside them on a finer mesh.
    retry : bool
        Run failed points again.
    show : bool
        Show the progress.
    overwrite : bool
        Replace another study in `out`, except for points that both have, and files of the user with names of products.

    Raises
    ------
    RuptfxError
        DOLFINx is not installed, or another study or a file of the user would be replaced. After other errors finished
        points are kept, and the same call continues.
    """
    points = study.points()  # refuse a bad study before any file is written
    if scheduler is None:
        launch.need_fem()
    if refined and study.refine.fine:
        study.point(points[0].values, "fine", study.refine.fine)
    if refined and study.search is not None:
        raise RuptfxError("--refine locates boundaries on a grid, and a search has none; leave it out")
    outcome = Outcome()
    with Store(out, study, overwrite) as store, stoppable(lambda: _kept(study, points, store)):
        Outputs(store.path, overwrite=overwrite).claim(*_tables(study, refined))
        if retry:
            store.forget_failures()
        with opened(store.path / "study.json", scheduler, cores, study.ranks) as client, Progress(show) as progress:
            run = Runner(study, store, client, Count(progress, study.title or str(out)))
            if study.search is None:
                outcome.points = run(points, outcome)
            else:
                outcome.sets = search.find_best(study, lambda points: run(points, outcome), run.count)
                outcome.points = [known for one in outcome.sets for known in one.runs]
            if refined:
                _refine(study, run, outcome)
        outcome.files = _write(study, store, outcome, refined, overwrite)
    return outcome


def _kept(study: Study, points: Sequence[Point], store: Store) -> str:
    done = sum(store.result(point.hash) is not None for point in points)
    finished = f"{done} of {len(points)} points" if study.search is None else f"{store.finished} points"
    return f"{finished} are kept, the same command continues"


def _refine(study: Study, run: Runner, outcome: Outcome) -> None:
    while extra := refine.bisections(study, outcome.points):
        outcome.points += run(extra, outcome)
    if study.refine.fine:
        fine = refine.finer(study, outcome.points)
        results = {point.hash: result for point, result in run(list(fine.values()), outcome)}
        outcome.fine = {coarse: results[point.hash] for coarse, point in fine.items()}


def _tables(study: Study, refined: bool) -> list[str]:
    """Return the names of the products that every study has, and those of refined studies and of searches."""
    return ["table.csv", "table.nc"] + ["refinement.json"] * refined + list(search.FILES) * (study.search is not None)


def _write(study: Study, store: Store, outcome: Outcome, refined: bool, overwrite: bool) -> list[Path]:
    """Write the products, tables before the figures that are drawn from them; return their files."""
    rows = table.rows(study, outcome.points, outcome.fine)
    with Outputs(store.path, overwrite=overwrite) as files:
        table.write_csv(files.place / "table.csv", rows)
        table.write_dataset(files.place / "table.nc", table.dataset(study, rows))
        if refined:
            summary = refine.summary(study, outcome.points, outcome.fine)
            write_json(files.place / "refinement.json", {"summary": summary})
        if study.search is not None:
            search.save(study, outcome.sets, store.path, files.place)
    paths = [store.path / name for name in _tables(study, refined)]
    if study.search is None and _has_map(store.path):
        with Outputs(store.path, overwrite=overwrite) as files:
            paths += map(final, draw(store.path, out=files.place))
    return paths


def _has_map(directory: Path) -> bool:
    """Return whether a table has a numeric axis and a quantity for the map."""
    from ruptfx.many_runs.study import mode_map

    return mode_map.suits(mode_map.read_map(directory))


def draw(directory: Path, formats: Sequence[str] = ("png", "pdf"), out: Path | None = None) -> list[Path]:
    """Draw the map of a finished study and, if it has one axis, its curves into `out`; return the files."""
    from ruptfx.many_runs.study import curves, mode_map

    paths = mode_map.save(directory, formats, out)
    shown = mode_map.read_map(directory)
    return paths + (curves.save(shown, formats, out) if curves.suits(shown) else [])


@dataclass
class Runner:
    """Run lists of points, skipping finished ones."""

    study: Study
    store: Store
    client: Client
    count: Count

    def __call__(self, points: Sequence[Point], outcome: Outcome) -> list[tuple[Point, Result]]:
        """Run points and return all results; a lost worker counts as a failure of the point."""
        study, out = self.study, self.store.path
        results = {point.hash: self.store.result(point.hash) for point in points}
        todo = {point.hash: point for point in points if results[point.hash] is None}
        outcome.known_before += len(results) - len(todo)
        self.count.add(len(results), [r for r in results.values() if r is not None])
        jobs = {key: (str(out), key, self._table(point), list(study.keep), study.ranks, study.time_limit)
                for key, point in todo.items()}  # fmt: skip
        for key, result in completed(self.client, run_point, jobs, str(out)):
            if isinstance(result, str):
                lost = {"status": "failed", "error": result}
                result = self.store.result(key) or commit(out, key, workspace(out, key), lost)
            results[key] = result
            self.count.finished(result)
        names = {name for result in results.values() if result for name in result.get("values", {})}
        study.require_quantities(points[0].case, names)
        return [(point, results[point.hash]) for point in points]  # type: ignore[misc]

    def _table(self, point: Point) -> Table:
        """Return the case table of a point, with the copies of the plug-ins in the study directory."""
        table = point.case.copied(self.store.path)
        if "plugins" in table:
            table["plugins"] = [str(self.store.path / path) for path in table["plugins"]]
        return table
