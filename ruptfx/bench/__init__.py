"""Verification and speed benchmarks with acceptance numbers that can fail: ``ruptfx bench NAME``.

A benchmark is one file of this folder, found by its name. It defines ``run(fine, comm)``, which returns an `Outcome`
(or just its checks). Its docstring says what the problem is and where the expected numbers come from; a number that
does not come out is a failed check, not a wider tolerance.
"""

from __future__ import annotations

import ast
import importlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ruptfx import RuptfxError, Table
from ruptfx.schema import kinds, nearest
from ruptfx.terminal import console

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from ruptfx.fem import MPI


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
    """

    quantity: str
    expected: float
    found: float
    tolerance: float = 0.0
    unit: str = "1"
    source: str = ""
    relation: Literal["within", "at most", "at least"] = "within"
    relative: bool = False

    @property
    def passed(self) -> bool:
        """False also where anything is not a number."""
        slack = self.tolerance * (abs(self.expected) if self.relative else 1.0)
        away = self.found - self.expected
        return bool({"within": abs(away) <= slack, "at most": away <= slack, "at least": -away <= slack}[self.relation])

    @property
    def limit(self) -> str:
        """The tolerance in words."""
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


def run_benchmark(name: str, as_json: bool = False, fine: bool = False, out: str | Path = "bench") -> bool:
    """Run one benchmark, or `all`; print its table, save its figure and its numbers.

    `list` only lists them; `table` prints the saved numbers of earlier runs as one table in Markdown.

    Parameters
    ----------
    name : str
    as_json : bool
        Print the rows as JSON, not as a table.
    fine : bool
        The resolution of the release table.
    out : str or Path
        Folder of figures and numbers.

    Returns
    -------
    bool
        Whether every check passed.

    Raises
    ------
    RuptfxError
        No benchmark of that name.
    """
    known = kinds("ruptfx.bench")
    if name == "list":
        _list(known)
        return True
    # Speed and cost are measurements of this machine, to be made when it is quiet: not among all.
    every = [each for each in known if each not in ("speed", "sliding_cost", "command_cost", "mode_map")]
    if name == "table":
        return _markdown(every, Path(out))
    if name != "all" and name not in known:
        raise RuptfxError(f"bench {name}: no such benchmark, {nearest(name, [*known, 'all', 'list', 'table'])}")
    chosen = every if name == "all" else [name]
    results = {}
    for number, each in enumerate(chosen, 1):
        console(stderr=True).print(f"{number}/{len(chosen)} {each}")
        outcome = _run(each, fine, Path(out))
        results[each] = _report(each, *outcome, Path(out), as_json)
    if as_json:
        rows = {each: reported for each, (_, reported) in results.items()}
        print(json.dumps(rows if name == "all" else rows[name], indent=2))
    return all(passed for passed, _ in results.values())


def _list(names: list[str]) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, show_header=False)
    for name in names:
        # Read, not imported: most benchmarks need DOLFINx to run, none needs it to be listed.
        text = ast.get_docstring(ast.parse((Path(__file__).parent / f"{name}.py").read_text())) or ""
        text = text.partition("\n")[0]
        table.add_row(name, text)
    _screen().print(table)


def _screen() -> Console:
    """Wide enough for the tables also where it is none."""
    screen = console()
    return screen if screen.is_terminal else console(width=130)


_MANY = 30  # checks that are one row of the table where all passed


def _run(name: str, fine: bool, out: Path) -> tuple[Outcome, float]:
    """Run one benchmark and save its numbers and figure; what came out, and the seconds it took."""
    module = importlib.import_module(f"ruptfx.bench.{name}")
    began = time.perf_counter()
    result = module.run(fine, _world())
    seconds = time.perf_counter() - began
    outcome = result if isinstance(result, Outcome) else Outcome(list(result))
    out.mkdir(parents=True, exist_ok=True)
    saved = {"fine": fine, "seconds": seconds, "checks": _rows(outcome.checks), "rows": outcome.rows or []}
    (out / f"{name}.json").write_text(json.dumps(saved, indent=2) + "\n")
    if outcome.draw is not None:
        outcome.draw().savefig(out / f"{name}.png", dpi=150)
    return outcome, seconds


def _report(name: str, outcome: Outcome, seconds: float, out: Path, quiet: bool) -> tuple[bool, list[Table]]:
    """Print a benchmark (unless quiet); whether it passed, and its rows."""
    if not quiet:
        _print(name, outcome.checks, seconds, out)
    return all(check.passed for check in outcome.checks), outcome.rows or _rows(outcome.checks)


def _rows(checks: list[Check]) -> list[Table]:
    rows = [{**asdict(check), "passed": check.passed} for check in checks]
    for row in rows:  # JSON knows no NaN
        row.update({key: None for key, v in row.items() if isinstance(v, float) and not math.isfinite(v)})
    return rows


def _markdown(names: list[str], out: Path) -> bool:
    """Print the saved checks of all benchmarks as a table; whether there are any and all passed."""
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
            # Of several runs in one benchmark, the worst closure of energy.
            key = "closure" if check.quantity == "energy closure" else number
            if key not in rows or not check.found <= rows[key].found:
                rows[key] = check
        for check in rows.values():
            verdicts.append(check.passed)
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
    from ruptfx import fem

    return fem.MPI.COMM_WORLD


def _print(name: str, checks: list[Check], seconds: float, out: Path) -> None:
    from rich.table import Table
    from rich.text import Text

    title = f"{name}{'' if seconds < 1 else f', {seconds:.0f} s'}"
    table = Table("quantity", "expected", "found", "tolerance", "unit", "source", "", title=title, title_justify="left")
    for check in checks:
        verdict = Text("pass", style="green") if check.passed else Text("FAIL", style="bold red")
        numbers = f"{check.expected:.7g}", f"{check.found:.7g}"
        table.add_row(check.quantity, *numbers, check.limit, check.unit, check.source, verdict)
    _screen().print(table)
