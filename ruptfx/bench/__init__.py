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
from typing import Any, Literal

from ruptfx import RuptfxError
from ruptfx.schema import kinds, nearest


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
    draw: Callable[[], Any] | None = None
    rows: list[dict[str, Any]] | None = None


def run_benchmark(name: str, as_json: bool = False, fine: bool = False, out: str | Path = "bench") -> bool:
    """Run one benchmark, or `all`; print its table, save its figure and its numbers. `list` only lists them.

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
    if name != "all" and name not in known:
        raise RuptfxError(f"bench {name}: no such benchmark, {nearest(name, [*known, 'all', 'list'])}")
    # Speed is a measurement of this machine, to be made when it is quiet: not one of all.
    chosen = [each for each in known if each != "speed"] if name == "all" else [name]
    results = {each: _run(each, fine, Path(out), as_json) for each in chosen}
    if as_json:
        rows = {each: reported for each, (_, reported) in results.items()}
        print(json.dumps(rows if name == "all" else rows[name], indent=2))
    return all(passed for passed, _ in results.values())


def _list(names: list[str]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False, show_header=False)
    for name in names:
        # Read, not imported: most benchmarks need DOLFINx to run, none needs it to be listed.
        text = ast.get_docstring(ast.parse((Path(__file__).parent / f"{name}.py").read_text())) or ""
        text = text.partition("\n")[0]
        table.add_row(name, text)
    console = Console(highlight=False)
    console = console if console.is_terminal else Console(highlight=False, width=130)
    console.print(table)


def _run(name: str, fine: bool, out: Path, quiet: bool) -> tuple[bool, list[dict[str, Any]]]:
    """Run, save and (unless quiet) print one benchmark; whether it passed, and its rows."""
    module = importlib.import_module(f"ruptfx.bench.{name}")
    began = time.perf_counter()
    result = module.run(fine, _world())
    seconds = time.perf_counter() - began
    outcome = result if isinstance(result, Outcome) else Outcome(list(result))
    rows = [{**asdict(check), "passed": check.passed} for check in outcome.checks]
    for row in rows:  # JSON knows no NaN
        row.update({key: None for key, v in row.items() if isinstance(v, float) and not math.isfinite(v)})
    out.mkdir(parents=True, exist_ok=True)
    (out / f"{name}.json").write_text(json.dumps({"fine": fine, "seconds": seconds, "checks": rows}, indent=2) + "\n")
    if outcome.draw is not None:
        figure = outcome.draw()
        figure.savefig(out / f"{name}.png", dpi=150)
    if not quiet:
        _print(name, outcome.checks, seconds, out)
    return all(check.passed for check in outcome.checks), outcome.rows or rows


def _world() -> Any:
    """All ranks; None without the finite element stack, which lumped models do without."""
    if find_spec("dolfinx") is None:
        return None
    from ruptfx import fem

    return fem.MPI.COMM_WORLD


def _print(name: str, checks: list[Check], seconds: float, out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    title = f"{name}{'' if seconds < 1 else f', {seconds:.0f} s'}"
    table = Table("quantity", "expected", "found", "tolerance", "unit", "source", "", title=title, title_justify="left")
    for check in checks:
        verdict = "[green]pass[/]" if check.passed else "[bold red]FAIL[/]"
        numbers = f"{check.expected:.7g}", f"{check.found:.7g}"
        table.add_row(check.quantity, *numbers, check.limit, check.unit, check.source, verdict)
    console = Console(highlight=False)
    console = console if console.is_terminal else Console(highlight=False, width=130)
    console.print(table)
