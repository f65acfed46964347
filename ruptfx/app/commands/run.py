"""`ruptfx run`."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import CaseFile, Overrides, begin, errors, reported, screen
from ruptfx.platform.progress import Progress, working

if TYPE_CHECKING:
    from ruptfx.case import Case
    from ruptfx.lumped import LumpedModel

HEADING = "Compute"


def run(
    case: CaseFile,
    ranks: Annotated[int, typer.Option(min=1, help="MPI ranks to start.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Run directory; default runs/<name of the case>.")] = None,
    set_: Overrides = None,
    resume: Annotated[bool, typer.Option("--resume", help="Resume from the newest checkpoint in --out.")] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the run in --out once this one is complete; other files stay.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress, no summary.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="All numbers of the summary.")] = False,
) -> None:
    """Run a case and write a run directory with data, figures and a summary.

    Example: ruptfx run demos/impact.toml --ranks 2 --set duration="20 us"
    """
    from ruptfx.platform import launch
    from ruptfx.results import figure_process

    begin(f"reading {case}", not quiet)
    launches = ranks > 1 and launch.RANKS not in os.environ
    if launches:
        figure_process.prepare()  # started now because a core is idle
    from ruptfx.case import Case, read_case

    out = out or Path("runs") / case.stem
    with reported():
        if resume and overwrite:
            raise RuptfxError("--resume goes on with a run that --overwrite would replace; give one of them")
        parsed = read_case(case, set_ or [])  # refuse a bad case before ranks are started
        if not isinstance(parsed, Case) and ranks > 1:
            raise RuptfxError(f"--ranks {ranks}: {parsed.kind()} is a lumped model and runs on one rank")
    if launches:
        assert isinstance(parsed, Case)
        options = [item for value in set_ or [] for item in ("--set", value)]
        options += ["--resume"] * resume + ["--overwrite"] * overwrite + ["--quiet"] * quiet + ["--verbose"] * verbose
        with reported():
            _launch(parsed, ranks, out, ["run", "--out", str(out), *options, "--", str(case)], quiet)
        return
    if not isinstance(parsed, Case):
        with reported():
            from ruptfx.lumped import simulate as simulate_lumped

            if resume:
                begin(_resumed(parsed, out), not quiet)
            with Progress(not quiet) as progress:
                simulate_lumped(parsed, out, progress.update, resume, overwrite)
            if not quiet:
                _show_summary(out, verbose)
                _show_pictures(out)
        return
    with reported(), working("loading DOLFINx", not quiet and launch.is_first_rank()):
        from ruptfx.platform import fem
        from ruptfx.run.simulation import simulate

        comm = fem.MPI.COMM_WORLD
    with reported(comm):
        launch.check_size(comm.size)

        def complete() -> None:
            if not quiet:
                _show_summary(out, verbose)

        simulate(parsed, out, comm, progress=not quiet, resume=resume, complete=complete, overwrite=overwrite)
        if comm.rank == 0 and not quiet and figure_process.LATER not in os.environ:
            _show_pictures(out)


def _resumed(model: LumpedModel, out: Path) -> str:
    """Return what resuming a lumped model does: it has no checkpoints.

    Raises
    ------
    RuptfxError
        The directory contains a run of another case.
    """
    from ruptfx.results.directories import is_finished, refuse_links

    refuse_links(out)
    if is_finished(out, model):
        return f"{out}: complete, nothing is computed; run without --resume and with --overwrite to compute it again"
    return f"{out}: a lumped model ({model.kind()}) has no checkpoints; it is computed from the start"


def _launch(case: Case, ranks: int, out: Path, arguments: list[str], quiet: bool) -> None:
    """Run on several ranks; draw figures after these have ended, when all cores are free."""
    from ruptfx.platform import launch
    from ruptfx.results import figure_process

    if not case.output.figures:
        figure_process.dismiss()
    before = _written(out)
    if not quiet:
        errors.print(f"starting {ranks} ranks")
    code = launch.run_on(ranks, arguments, **{figure_process.LATER: "1"})
    if code:
        raise typer.Exit(code)
    if case.output.figures and _written(out) != before:
        with working("drawing the figures", not quiet):
            figure_process.draw(out)
    if not quiet:
        _show_pictures(out)


def _written(out: Path) -> tuple[int, int] | None:
    """Return the identity of the summary of a complete run, to detect a new one."""
    path = out / "summary.json"
    return (path.stat().st_ino, path.stat().st_mtime_ns) if path.exists() else None


def _show_summary(out: Path, verbose: bool) -> None:
    """Print what the run found in one line, then the numbers of most interest; with `verbose` all of them."""
    from ruptfx.results.analysis.verdict import rows, verdict
    from ruptfx.results.summary_fields import flat, unit

    summary = json.loads((out / "summary.json").read_text())
    said = verdict(summary)
    if summary.get("mode") == "none" and (how := _closest_to_slip(out)):
        said = f"{said}: {how}"
    if said:
        screen.print(said, style="bold", soft_wrap=True)
    table = Table(show_header=False, box=None, pad_edge=False)
    if verbose or not said:  # lumped models have summaries of their own
        hidden = () if verbose else ("kind", "case_hash", "ruptfx")
        for key, value in flat(summary).items():
            if isinstance(value, int | float | str) and not isinstance(value, bool) and key not in hidden:
                table.add_row(key, f"{value:.6g}" if isinstance(value, float) else str(value), unit(key))
    else:
        for key, text in rows(summary):
            table.add_row(key if key.startswith("faults.") else key.replace("_", " "), text)
    screen.print(table)
    screen.print(f"Run directory: {out}" + " (all numbers: summary.json)" * bool(said and not verbose), soft_wrap=True)


def _closest_to_slip(out: Path) -> str:
    from ruptfx.results.record import Files
    from ruptfx.results.strength import closest_to_slip

    with Files(out, trust=True) as record:  # its code has just run
        return closest_to_slip(record)


def _show_pictures(out: Path) -> None:
    pictures = sorted((out / "figures").glob("*.png"))
    if pictures:
        screen.print(f"Pictures: {out / 'figures'} ({', '.join(p.name for p in pictures)})", soft_wrap=True)
