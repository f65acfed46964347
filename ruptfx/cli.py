"""The command line: run | check | check-law | study | plot | describe | demos | bench."""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from ruptfx import RuptfxError, __version__
from ruptfx.terminal import console

app = typer.Typer(
    help="Frictional contact and rupture on FEniCSx.", no_args_is_help=True, add_completion=False,
    pretty_exceptions_enable=False,
)  # fmt: skip
screen = console()
errors = console(stderr=True)

CaseFile = Annotated[Path, typer.Argument(help="Case file (TOML).", show_default=False)]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", help="KEY=VALUE, e.g. faults.main.initial_stress.normal=30e6; repeatable.")
]
EXIT_ERROR, EXIT_INTERRUPTED = 1, 130


@contextmanager
def _reported(comm: Any = None) -> Iterator[None]:
    """Our errors are one message from one rank; a bug shows its traceback and ends all ranks."""
    from ruptfx.schema import CaseError

    try:
        yield
        sys.stdout.flush()  # a reader that has seen enough is noticed here, where it ends the command quietly
    except RuptfxError as error:
        if comm is None or comm.rank == 0:
            label = "case error" if isinstance(error, CaseError) else "error"
            errors.print(f"{label}: ", style="bold red", end="")
            errors.print(str(error), soft_wrap=True)
        if type(error).__name__ == "DiskError":
            # HDF5 cannot write what it still holds and would fall over it at exit.
            sys.stderr.flush()
            os._exit(EXIT_ERROR)
        raise typer.Exit(EXIT_INTERRUPTED if type(error).__name__ == "Interrupted" else EXIT_ERROR) from None
    except Exception:
        if comm is None or comm.size == 1:
            raise
        traceback.print_exc()
        sys.stderr.flush()
        comm.Abort(EXIT_ERROR)


@app.command()
def run(
    case: CaseFile,
    ranks: Annotated[int, typer.Option(min=1, help="MPI ranks to start.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Run directory; default runs/<name of the case>.")] = None,
    set_: Overrides = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the newest checkpoint in --out.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress, no summary.")] = False,
) -> None:
    """Run a case and leave a run directory with data, figures and a summary."""
    from ruptfx import launch
    from ruptfx.case import Case, read_case

    out = out or Path("runs") / case.stem
    with _reported():
        parsed = read_case(case, set_ or [])  # a bad case needs no ranks to be refused
        _show_plugins(parsed, not quiet and launch.RANKS not in os.environ)
        if not isinstance(parsed, Case) and ranks > 1:
            raise RuptfxError(f"--ranks {ranks}: {parsed.kind()} is a lumped model and runs on one rank")
    if ranks > 1 and launch.RANKS not in os.environ:
        options = [item for value in set_ or [] for item in ("--set", value)]
        options += ["--resume"] * resume + ["--quiet"] * quiet
        with _reported():
            raise typer.Exit(launch.run_on(ranks, ["run", "--out", str(out), *options, "--", str(case)]))
    if not isinstance(parsed, Case):
        with _reported():
            from ruptfx.lumped import simulate as simulate_lumped

            with _fraction_bar(not quiet) as progress:
                simulate_lumped(parsed, out, progress)
            if not quiet:
                _show_summary(out)
        return
    with _reported():
        from ruptfx import fem

        comm = fem.MPI.COMM_WORLD
    with _reported(comm):
        launch.check_size(comm.size)
        from ruptfx.simulation import simulate

        simulate(parsed, out, comm, progress=not quiet, resume=resume)
        if comm.rank == 0 and not quiet:
            _show_summary(out)


def _show_plugins(case: Any, wanted: bool) -> None:
    """Which files of the user's a command runs code of."""
    from ruptfx.plugins import shown

    for line in shown(case) if wanted else []:
        errors.print(line, markup=False, highlight=False, soft_wrap=True)


@contextmanager
def _fraction_bar(show: bool) -> Iterator[Callable[[float, str], None]]:
    """A bar for work that tells its fraction and what it is at."""
    columns = TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    with Progress(*columns, console=errors, disable=not (show and errors.is_terminal)) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda fraction, text: bar.update(task, completed=fraction, description=text)


def _show_summary(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    table = Table(show_header=False, box=None, pad_edge=False)
    for key, value in summary.items():
        if isinstance(value, int | float | str) and not isinstance(value, bool):
            table.add_row(key, f"{value:.6g}" if isinstance(value, float) else str(value))
    screen.print(table)
    screen.print(f"Run directory: {out}")
    pictures = sorted((out / "figures").glob("*.png"))
    screen.print(f"Pictures: {out / 'figures'} ({', '.join(p.name for p in pictures)})", soft_wrap=True)


@app.command()
def check(case: CaseFile, set_: Overrides = None) -> None:
    """What a careful user computes by hand before a run; exits non-zero on an error."""
    with _reported():
        from ruptfx.case import Case, read_case

        parsed = read_case(case, set_ or [])
        _show_plugins(parsed, True)
        if not isinstance(parsed, Case):
            screen.print(f"{case}: {parsed.kind()}, {parsed.summary()} The case is valid.")
            return
        from ruptfx.preflight import preflight

        table = Table("quantity", "value", "unit", "note", title=parsed.title or str(case), title_justify="left")
        failed = False
        for row in preflight(parsed):
            failed |= row.verdict == "error"
            colour = {"error": "red", "warning": "yellow"}.get(row.verdict, "")
            table.add_row(row.quantity, row.text, row.unit, row.note, style=colour)
        screen.print(table)
        if failed:
            raise typer.Exit(EXIT_ERROR)


@app.command()
def study(
    file: Annotated[Path, typer.Argument(help="Study file (TOML).", show_default=False)],
    out: Annotated[Path | None, typer.Option(help="Study directory; default studies/<name of the file>.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a dask scheduler; default is this machine.")] = None,
    cores: Annotated[int | None, typer.Option(min=1, help="Cores to use on this machine; default all.")] = None,
    refine: Annotated[bool, typer.Option("--refine", help="Locate mode boundaries, check on a finer mesh.")] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Run failed points again.")] = False,
    set_: Overrides = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
) -> None:
    """Run a case over axes of parameters; started again, it runs only what is new."""
    with _reported():
        from ruptfx.study import read_study, run_study

        out = out or Path("studies") / file.stem
        parsed = read_study(file, set_ or [])
        _show_plugins(parsed.point(next(parsed.combinations())).case, not quiet)
        found = run_study(parsed, out, scheduler=scheduler, cores=cores, refined=refine, retry=retry, show=not quiet)
        screen.print(f"{len(found.points)} points, {found.failed} failed, {found.known_before} known before")
        if refine:
            screen.print(json.loads((out / "refinement.json").read_text())["summary"])
        products = "table.csv, table.nc, mode_map.png, mode_map.pdf, mode_map.html"
        screen.print(f"Study directory: {out} ({products})", soft_wrap=True)
        if found.failed == len(found.points):
            raise typer.Exit(EXIT_ERROR)


@app.command()
def plot(
    run: Annotated[Path, typer.Argument(help="Run or study directory.", show_default=False)],
    format_: Annotated[list[str], typer.Option("--format", help="png, pdf or svg; repeatable.")] = ["png"],  # noqa: B006
) -> None:
    """Draw the figures of a run, or the map of a study, again; needs no DOLFINx."""
    with _reported():
        if (run / "study.json").exists():
            from ruptfx.study import mode_map

            for path in mode_map.save(run, formats=tuple(format_)):
                screen.print(str(path))
            return
        if (run / "result.nc").exists():
            from ruptfx.lumped import redraw

            for path in redraw(run, formats=tuple(format_)):
                screen.print(str(path))
            return
        from ruptfx import plots
        from ruptfx.record import Record

        for path in plots.save_all(Record(run), formats=tuple(format_)):
            screen.print(str(path))


@app.command()
def describe(
    what: Annotated[str | None, typer.Argument(help="A folder: friction, contact, materials, meshes, ...")] = None,
    schema: Annotated[bool, typer.Option("--schema", help="JSON schema of cases and studies, for editors.")] = False,
) -> None:
    """List the alternatives of a folder with their fields, units, formula and source."""
    with _reported():
        if schema:
            from ruptfx.describe import file_schema

            print(json.dumps(file_schema(), indent=2))
            return
        from ruptfx.describe import FOLDERS, describe_folder

        if what is None:
            screen.print(f"ruptfx {__version__}. Choose one of: {', '.join(FOLDERS)}; or --schema.")
            return
        for block in describe_folder(what):
            screen.print(block)


@app.command(name="check-law")
def check_law(
    law: Annotated[str, typer.Argument(help="Python file with friction laws, or a kind.", show_default=False)],
    set_: Annotated[list[str] | None, typer.Option("--set", help="KEY=VALUE, a parameter, e.g. mu_s=0.6.")] = None,
    out: Annotated[Path, typer.Option(help="Where the pictures go.")] = Path("."),
) -> None:
    """Check that a friction law keeps its contract, and draw it; exits non-zero when something fails or is missing."""
    with _reported():
        from ruptfx.check_law import check_law as check
        from ruptfx.check_law import save_figure

        sound = True
        for report in check(law, set_ or []):
            kind, sound = report.law.kind(), sound and report.sound
            table = Table("check", "verdict", "note", title=f"friction law {kind}", title_justify="left")
            for row in report.rows:
                colour = {"failed": "red", "missing": "yellow"}.get(row.verdict, "")
                table.add_row(row.check, row.verdict, Text(row.note), style=colour)
            screen.print(table)
            numbers = report.law.model_dump(mode="json", exclude_none=True)
            screen.print(f"Drawn with {numbers}", markup=False, highlight=False, soft_wrap=True)
            out.mkdir(parents=True, exist_ok=True)
            save_figure(report.law, out / f"{kind}.png")
            screen.print(f"Picture: {out / f'{kind}.png'}", soft_wrap=True)
        if not sound:
            raise typer.Exit(EXIT_ERROR)


@app.command()
def demos(out: Annotated[Path, typer.Argument(help="A directory that does not exist yet.")] = Path("demos")) -> None:
    """Copy the demo cases and scripts, which an installed ruptfx brings along."""
    import shutil

    with _reported():
        if out.exists():
            raise RuptfxError(f"{out}: exists already; give another directory: ruptfx demos DIRECTORY")
        given = Path(__file__).with_name("demos")
        shutil.copytree(given, out, ignore=shutil.ignore_patterns("__pycache__", "pictures"))
        screen.print(f"{out}: try  ruptfx check {out / 'impact.toml'}", soft_wrap=True)


@app.command()
def bench(
    name: Annotated[str, typer.Argument(help="A benchmark, `all`, `list`, or `table` (of saved numbers).")] = "list",
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable rows.")] = False,
    fine: Annotated[bool, typer.Option("--fine", help="The resolution of the release table.")] = False,
    out: Annotated[Path, typer.Option(help="Where figures go.")] = Path("bench"),
) -> None:
    """Run verification and speed benchmarks; exits non-zero when a check fails."""
    with _reported():
        from ruptfx.bench import run_benchmark

        if not run_benchmark(name, as_json=as_json, fine=fine, out=out):
            raise typer.Exit(EXIT_ERROR)


@app.callback(invoke_without_command=True)
def main(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        typer.echo(__version__)
        raise typer.Exit


if __name__ == "__main__":
    app()
