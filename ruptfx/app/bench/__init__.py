"""Verification and speed benchmarks with acceptance numbers that can fail: ``ruptfx bench NAME``.

A benchmark is one file, found by its name: of this folder, the core set that checks an installation, or of
``tests/benchmarks`` in a checkout, which reproduces published problems. It defines ``run(fine, comm)``, which returns
an `Outcome` (or just its checks). Its docstring says what the problem is and where the expected numbers come from; a
number that does not come out is a failed check, not a wider tolerance.
"""

from __future__ import annotations

import ast
import importlib
import json
import math
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ruptfx import RuptfxError, Table
from ruptfx.input.schema import nearest
from ruptfx.platform.terminal import console
from ruptfx.results.outputs import Outputs

if TYPE_CHECKING:
    from types import ModuleType

    from matplotlib.figure import Figure
    from rich.console import Console

    from ruptfx.platform.fem import MPI


# Measurements of speed and cost, to be made when nothing else runs: not among all.
OF_THE_MACHINE = (
    "speed", "crack_speed", "sliding_cost", "command_cost", "mode_map", "demo_times", "tpv5_time", "scaling",
)  # fmt: skip


CORE = Path(__file__).parent
IN_A_CHECKOUT = Path("tests", "benchmarks")


@dataclass(frozen=True)
class Check:
    """One acceptance number.

    Attributes
    ----------
    quantity : str
    expected, found, tolerance : float
        In `unit`; a relative tolerance is a fraction of `expected`.
    unit : str
    source : str
        Where `expected` comes from.
    relation : str
        `within`: |found - expected| <= tolerance; `at most` and `at least`: one-sided, with the tolerance as slack.
    relative : bool
    timing : bool
        A time, or made of times: it is shown among `all`, where the machine may be busy, but decides only in a
        benchmark that is run by its name.
    """

    quantity: str
    expected: float
    found: float
    tolerance: float = 0.0
    unit: str = "1"
    source: str = ""
    relation: Literal["within", "at most", "at least"] = "within"
    relative: bool = False
    timing: bool = False

    @property
    def passed(self) -> bool:
        """True if the number meets its tolerance; False if it is NaN."""
        slack = self.tolerance * (abs(self.expected) if self.relative else 1.0)
        away = self.found - self.expected
        return bool({"within": abs(away) <= slack, "at most": away <= slack, "at least": -away <= slack}[self.relation])

    @property
    def limit(self) -> str:
        """The tolerance as text."""
        number = f"{100 * self.tolerance:.3g} %" if self.relative else f"{self.tolerance:.3g}"
        if self.relation == "within":
            return number
        return self.relation if self.tolerance == 0 else f"{self.relation} +{number}"


@dataclass(frozen=True)
class Outcome:
    """Checks of a benchmark, a function that draws its figure, and rows to report as JSON instead of the checks."""

    checks: list[Check]
    draw: Callable[[], Figure] | None = None
    rows: list[Table] | None = None


def checkout_folder() -> Path | None:
    """Return the folder of the other benchmarks if the package runs from a checkout, None if it is installed."""
    checkout = CORE.parents[2]
    result = checkout / IN_A_CHECKOUT
    return result if result.is_dir() and (checkout / "pyproject.toml").is_file() else None


def benchmarks(folder: str | Path | None = None) -> dict[str, Path]:
    """Return the files of all benchmarks by their names, those of the core set first.

    Parameters
    ----------
    folder : str or Path, optional
        Further benchmarks, by default those of the checkout that the package runs from.

    Raises
    ------
    RuptfxError
        The folder has no benchmarks, or a name is in both folders.
    """
    others = checkout_folder() if folder is None else Path(folder).resolve()
    core, result = _files(CORE), {} if others is None else _files(others)
    if folder is not None and not result:
        raise RuptfxError(f"bench --from {folder}: no benchmarks there; give the folder {IN_A_CHECKOUT} of a checkout")
    if both := sorted(core.keys() & result):
        raise RuptfxError(f"bench {both[0]}: both in {CORE} and in {others}; rename one of them")
    return {**core, **result}


def _files(folder: Path) -> dict[str, Path]:
    return {path.stem: path for path in sorted(folder.glob("*.py")) if not path.stem.startswith("_")}


def module_of(path: Path) -> ModuleType:
    """Return the module of a benchmark.

    A file outside of the package is imported as one of the package that its folder is, so that it can import files
    beside it (``from benchmarks.tpv101 import line``).

    Raises
    ------
    RuptfxError
        Another package of the same name was imported before.
    """
    if path.parent == CORE:
        return importlib.import_module(f"ruptfx.app.bench.{path.stem}")
    above = str(path.parent.parent)
    if above not in sys.path:
        sys.path.insert(0, above)
    module = importlib.import_module(f"{path.parent.name}.{path.stem}")
    if module.__file__ is None or Path(module.__file__).resolve() != path:
        raise RuptfxError(f"bench {path.stem}: {path.parent.name} is also the name of a package, {module.__file__}")
    return module


def run_benchmark(  # noqa: PLR0913
    name: str, as_json: bool = False, fine: bool = False, out: str | Path = "bench", jobs: int = 1,
    folder: str | Path | None = None, overwrite: bool = False, without: Sequence[str] = (),
) -> bool:  # fmt: skip
    """Run one benchmark, or `all`; print its table, save its figure and its numbers from rank 0.

    `list` only lists them; `table` prints the saved numbers of earlier runs as one table in Markdown. `all` goes on
    when one breaks down, and does not decide by times. The last lines printed say which checks failed.

    Parameters
    ----------
    as_json : bool
        Print the rows as JSON, not as a table.
    fine : bool
        The resolution of the release table.
    out : str or Path
        Folder of figures and numbers.
    jobs : int
        Benchmarks of `all` that run at the same time, each in a process of its own.
    folder : str or Path, optional
        Further benchmarks, by default those of the checkout that the package runs from.
    overwrite : bool
        Also replace files in `out` that no benchmark wrote there.
    without : sequence of str
        Benchmarks that are left out of `all`.

    Returns
    -------
    bool
        Whether every check passed that decides.

    Raises
    ------
    RuptfxError
        No benchmark of that name, one that was run by its name broke down, or a file of the user would be replaced.
    """
    known = benchmarks(folder)
    if name == "list":
        _list(known)
        return True
    every = [each for each in known if each not in OF_THE_MACHINE]
    if name == "table":
        return _markdown(every, Path(out))
    if name != "all" and name not in known:
        raise RuptfxError(f"bench {name}: {_unknown(name, known)}")
    alone = name != "all"
    for each in without:
        if each not in known or alone:
            why = f"{name} is run alone; leave out --without" if alone else _unknown(each, known)
            raise RuptfxError(f"bench {name} --without {each}: {why}")
    outcomes = {}
    chosen = [name] if alone else [each for each in every if each not in without]
    Outputs(Path(out), overwrite=overwrite).claim(*(f"{each}.{kind}" for each in chosen for kind in ("png", "json")))
    ended = _each({each: known[each] for each in chosen}, fine, Path(out), alone, jobs)
    for number, (each, (outcome, seconds)) in enumerate(ended, 1):
        outcomes[each] = outcome
        if not as_json and _is_first():
            _print(each, outcome.checks, seconds, alone)
        if not alone and _is_first():
            console(stderr=True).print(f"{number} of {len(chosen)} benchmarks ended")
    outcomes = {each: outcomes[each] for each in chosen}  # not in the order in which they ended
    if as_json and _is_first():
        rows = {each: outcome.rows or _rows(outcome.checks) for each, outcome in outcomes.items()}
        print(json.dumps(rows[name] if alone else rows, indent=2))
    failed, lines = verdict({each: outcome.checks for each, outcome in outcomes.items()}, alone)
    if (failed or not as_json) and _is_first():
        print("\n".join(lines), file=sys.stderr if as_json else sys.stdout)
    world = _world()
    return not (failed if world is None else world.bcast(failed))  # ranks measure different times


def verdict(checks: Mapping[str, Sequence[Check]], alone: bool) -> tuple[bool, list[str]]:
    """Return whether benchmarks failed, and the lines that list the missed checks.

    Each missed check has one line; the checks that decide come last.

    Parameters
    ----------
    checks : dict
        Of every benchmark.
    alone : bool
        Times decide, too.
    """
    missed = [(name, check) for name, each in checks.items() for check in each if not check.passed]
    failed = [(name, check) for name, check in missed if alone or not check.timing]
    slow = [pair for pair in missed if pair not in failed]
    total = sum(map(len, checks.values()))
    lines = [f"times that were missed and do not decide here: {len(slow)}"] * bool(slow) + _in_words(slow)
    lines += [f"checks that failed: {len(failed)} of {total}", *_in_words(failed)]
    return bool(failed), lines


def _in_words(checks: Sequence[tuple[str, Check]]) -> list[str]:
    """Return one line of text per check."""
    return [
        f"{name}: {check.quantity}: found {check.found:.7g}, expected {check.expected:.7g}"
        f"{'' if check.unit == '1' else f' {check.unit}'}, "
        f"tolerance {check.limit}" + f" ({check.source})" * bool(check.source)
        for name, check in checks
    ]


def _unknown(name: str, known: Mapping[str, Path]) -> str:
    """Return why there is no benchmark of that name; without a checkout, also where the others are."""
    said = f"no such benchmark, {nearest(name, [*known, 'all', 'list', 'table'])}"
    if any(path.parent != CORE for path in known.values()):
        return said
    return f"{said}; those that reproduce published problems are in a checkout of ruptfx: --from {IN_A_CHECKOUT}"


def description(path: Path) -> str:
    """Return the docstring of a benchmark, read without an import: most need DOLFINx to run, but not to be listed."""
    return ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""


def _list(known: Mapping[str, Path]) -> None:
    from rich.table import Table

    for folder in dict.fromkeys(path.parent for path in known.values()):
        title = "core set: checks an installation" if folder == CORE else f"published problems: {folder}"
        table = Table(box=None, pad_edge=False, show_header=False, title=title, title_justify="left")
        for name, path in known.items():
            if path.parent == folder:
                table.add_row(name, description(path).partition("\n")[0])
        _screen().print(table)


def _screen() -> Console:
    """Return a console wide enough for the tables, also without a terminal."""
    screen = console()
    return screen if screen.is_terminal else console(width=130)


_MANY = 30  # a benchmark with more passed checks than this is shown as one row


def _each(
    files: Mapping[str, Path], fine: bool, out: Path, alone: bool, jobs: int
) -> Iterator[tuple[str, tuple[Outcome, float]]]:
    """Yield benchmarks with their outcomes and seconds, in the order in which they end."""
    if jobs == 1 or alone:
        yield from ((name, _run(path, fine, out, alone)) for name, path in files.items())
        return
    # A process for each benchmark, started afresh: MPI cannot be forked, and communicators are never exhausted.
    with ProcessPoolExecutor(jobs, get_context("spawn"), max_tasks_per_child=1) as pool:
        pending = {pool.submit(_run_apart, path, fine, out): name for name, path in files.items()}
        for done in as_completed(pending):
            yield pending[done], done.result()


def _run_apart(path: Path, fine: bool, out: Path) -> tuple[Outcome, float]:
    """Run one benchmark of `all`; return what another process can read of it."""
    outcome, seconds = _run(path, fine, out, alone=False)
    return replace(outcome, draw=None), seconds


def _run(path: Path, fine: bool, out: Path, alone: bool) -> tuple[Outcome, float]:
    """Run one benchmark, save its numbers and figure; return the outcome and the time in seconds.

    A benchmark that raises an error while several are run becomes a failed check, so that the others still run.
    """
    name = path.stem
    began = time.perf_counter()
    if _is_first():
        console(stderr=True).print(f"{name} ...")
    figure = None
    try:
        result = module_of(path).run(fine, _world())
        seconds = time.perf_counter() - began
        outcome = result if isinstance(result, Outcome) else Outcome(list(result))
        if outcome.draw is not None and _is_first():
            from ruptfx.results.figure_style import styled  # needs matplotlib

            figure = styled(outcome.draw)()
    except Exception as error:
        if alone:
            raise
        traceback.print_exc()
        said = f"{type(error).__name__}: {error}"[:300]
        outcome, seconds = Outcome([Check("ran to its end", 1.0, math.nan, source=said)]), time.perf_counter() - began
    if _is_first():
        saved = {"fine": fine, "seconds": seconds, "checks": _rows(outcome.checks), "rows": outcome.rows or []}
        tell = console(stderr=True).print
        with Outputs(out, (), True, lambda names: tell(f"replacing in {out}: {', '.join(names)}")) as files:
            if figure is not None:
                figure.savefig(files.place / f"{name}.png", dpi=200)
            (files.place / f"{name}.json").write_text(json.dumps(saved, indent=2) + "\n")
    return outcome, seconds


def _rows(checks: list[Check]) -> list[Table]:
    rows = [{**asdict(check), "passed": check.passed} for check in checks]
    for row in rows:  # JSON knows no NaN
        row.update({key: None for key, v in row.items() if isinstance(v, float) and not math.isfinite(v)})
    return rows


def _markdown(names: list[str], out: Path) -> bool:
    """Print the saved checks of all benchmarks as a table; return whether there are any and all passed."""
    print("| problem | quantity | expected | found | tolerance | unit | | command |\n|---|---|---|---|---|---|---|---|")
    verdicts = []
    for name in names:
        path = out / f"{name}.json"
        if not path.exists():
            continue
        saved = json.loads(path.read_text())
        command = f"`ruptfx bench {name}{' --fine' if saved['fine'] else ''}`"
        passed = [row["passed"] for row in saved["checks"]]
        if len(passed) > _MANY and all(passed):
            verdicts += passed
            print(f"| {name} | {len(passed)} quantities | | | | | pass | {command} |")
            continue
        rows: dict[object, Check] = {}
        for number, row in enumerate(saved["checks"]):
            values: Table = {key: math.nan if value is None else value for key, value in row.items()}
            check = Check(**{key: value for key, value in values.items() if key != "passed"})
            # Several runs in one benchmark: keep the worst energy closure.
            key = "closure" if check.quantity == "energy closure" else number
            if key not in rows or not check.found <= rows[key].found:
                rows[key] = check
        for check in rows.values():
            verdicts.append(check.passed or check.timing)
            quantity = check.quantity.replace("|", "\\|")
            numbers = f"{check.expected:.6g} | {check.found:.6g} | {check.limit} | {check.unit}"
            print(f"| {name} | {quantity} | {numbers} | {'pass' if check.passed else '**fail**'} | {command} |")
    if not verdicts:
        raise RuptfxError(f"bench table: no numbers in {out}; run `ruptfx bench all` first")
    return all(verdicts)


def _world() -> MPI.Comm | None:
    """All ranks; None without the finite element stack, which lumped models do without."""
    if find_spec("dolfinx") is None:
        return None
    from ruptfx.platform import fem

    return fem.MPI.COMM_WORLD


def _is_first() -> bool:
    """Return whether this rank prints and saves."""
    world = _world()
    return world is None or world.rank == 0


def _print(name: str, checks: list[Check], seconds: float, alone: bool) -> None:
    from rich.table import Table
    from rich.text import Text

    title = f"{name}{'' if seconds < 1 else f', {seconds:.0f} s'}"
    table = Table("quantity", "expected", "found", "tolerance", "unit", "source", "", title=title, title_justify="left")
    missed = {True: Text("FAIL", style="bold red"), False: Text("missed", style="yellow")}
    for check in checks:
        shown = Text("pass", style="green") if check.passed else missed[alone or not check.timing]
        numbers = f"{check.expected:.7g}", f"{check.found:.7g}"
        table.add_row(check.quantity, *numbers, check.limit, check.unit, check.source, shown)
    _screen().print(table)
