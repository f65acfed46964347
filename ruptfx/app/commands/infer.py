"""`ruptfx infer`."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer
from rich.table import Table

from ruptfx import RuptfxError
from ruptfx.app.commands._gradients import Memory, Quiet, Ranks, case_on_ranks
from ruptfx.app.commands._shared import CaseFile, Overrides, errors, reported, screen

if TYPE_CHECKING:
    from ruptfx.case import Case
    from ruptfx.lumped import LumpedModel
    from ruptfx.many_runs.inference.result import Recovered

HEADING = "Compute"


def infer(
    case: CaseFile,
    ranks: Ranks = 1,
    out: Annotated[Path | None, typer.Option(help="Directory; default inferences/<name of the case>.")] = None,
    set_: Overrides = None,
    memory: Memory = 4.0,
    cores: Annotated[
        int | None,
        typer.Option(min=1, help="Cores for simultaneous runs; default all for cma_es and ensemble, else 1."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a dask scheduler for these runs; default is this machine.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Recover the unknowns of a case from its data; started again, go on with an unfinished directory.

    A spring slider with an experiment of kind "fit" is fitted to its trace.

    Example: ruptfx infer case.toml --out inferences/first
    """
    from ruptfx.platform import launch

    out = out or Path("inferences") / case.stem
    with reported():
        from ruptfx.case import read_case

        read = read_case(case, set_ or [])
    if _fitted(read, ranks, out, quiet):
        return
    wanted = (cores or 1) > 1 or scheduler is not None
    at_once = _makes_runs_at_once(read, wanted)
    if not at_once and wanted:
        with reported():
            from ruptfx.many_runs.inference.pool import check_method

            check_method(cast("Case", read))
    parsed = case_on_ranks("infer", case, 1 if at_once else ranks, out, set_ or [], memory, quiet)
    with reported():
        import numpy as np

        from ruptfx.platform import fem

        comm = fem.MPI.COMM_WORLD
    with reported(comm):
        launch.check_size(comm.size)
        from ruptfx.many_runs.inference.inversion import infer as recover
        from ruptfx.readings.misfits import Inference

        of_machine = len(os.sched_getaffinity(0)) if at_once and scheduler is None and comm.size == 1 else 1
        made = recover(parsed, out, comm, not quiet, 1e9 * memory, cores=cores or of_machine,
                       ranks=ranks if at_once else 1, scheduler=scheduler)  # fmt: skip
        if comm.rank == 0 and not quiet:
            noise = f" ({2 * made.best.misfit / made.data:.3g} times that of noise)" if made.data else ""
            screen.print(
                f"misfit {made.runs[0].misfit:.6g} -> {made.best.misfit:.6g}{noise}; {len(made.iterates) - 1} "
                f"iterations, {len(made.runs)} runs, {made.reason}", style="bold", soft_wrap=True
            )  # fmt: skip
            table = Table("unknown", "case", "recovered", "68 %", "unit", "", box=None, pad_edge=False)
            for each, unknown in zip(made.unknowns, made.case.unknowns, strict=True):
                first, last = float(each.start.mean()), float(each.best.mean())
                best, interval = f"{last:.6g}", ""
                if each.interval is not None:
                    low, high = each.interval.mean(axis=1)
                    interval = shown_interval(float(low), float(high))
                if each.shape != "number":
                    best = f"{each.best.min():.6g} to {each.best.max():.6g}"
                    if each.interval is not None:
                        interval = f"± {0.5 * float(np.ptp(each.interval, axis=0).mean()):.3g} on average"
                table.add_row(unknown.label, f"{first:.6g}", best, interval, each.unit, _note(each, unknown.bounds))
            screen.print(table)
            search = made.case.inference or Inference()
            if made.exceeds_noise:
                errors.print(
                    "The misfit is larger than noise explains, and the intervals do not hold: the search has not found "
                    f"the minimum ({remedies_of(search.method, made.reason)}), or sigma, law or mesh are "
                    "wrong.",
                    style="yellow", soft_wrap=True,
                )  # fmt: skip
                for doubt in made.doubts():
                    errors.print(f"{doubt}.", style="yellow", soft_wrap=True)
            files = "best.toml, result.nc, unknowns.csv, misfit.csv, inference.png"
            files += ", tradeoffs.png" * (len(made.samples) > 1)
            screen.print(f"Files: {out} ({files})", soft_wrap=True)


def shown_interval(low: float, high: float) -> str:
    """Return both ends of an interval with two digits more than those in which they agree, from three to six."""
    width, size = high - low, max(abs(low), abs(high))
    digits = 3 if width >= size else 6 if width * 1e4 <= size else 2 + math.ceil(math.log10(size / width))
    return f"{low:.{max(digits, 3)}g} to {high:.{max(digits, 3)}g}"


def remedies_of(method: str, reason: str) -> str:
    """Return what to try where a search by a method, which ended for a reason, has not found the minimum."""
    ways = ["raise inference.iterations"] * (reason == "iterations are used up") + ["start elsewhere"]
    return ", or ".join(ways + ["use inference.method = 'cma_es'"] * (method in ("l_bfgs", "gauss_newton")))


def _note(unknown: Recovered, bounds: list[float] | None) -> str:
    """Return what a reader of a recovered value must know."""
    if unknown.interval is not None and bounds is not None:
        low, high = unknown.interval
        if float((high - low).min()) >= bounds[1] - bounds[0]:
            return "not determined"
    return "at bound" if unknown.at_bound else ""


def _makes_runs_at_once(case: Case | LumpedModel, wanted: bool) -> bool:
    """Return whether other processes make the runs: with some methods always, with others if it is wanted."""
    from ruptfx.case import Case
    from ruptfx.many_runs.inference.searches import AT_ONCE, COLUMNS_AT_ONCE

    methods = AT_ONCE + COLUMNS_AT_ONCE * wanted
    return isinstance(case, Case) and case.inference is not None and case.inference.method in methods


def _fitted(parsed: Case | LumpedModel, ranks: int, out: Path, quiet: bool) -> bool:
    """Run a lumped model that recovers parameters from data; return False for all other cases."""
    from ruptfx.lumped import LumpedModel, simulate
    from ruptfx.platform.progress import Progress

    with reported():
        if not isinstance(parsed, LumpedModel) or not parsed.recovers:
            return False
        if ranks > 1:
            raise RuptfxError(f"--ranks {ranks}: {parsed.kind()} is a lumped model and runs on one rank")
        with Progress(not quiet) as progress:
            result = simulate(parsed, out, progress.update, resume=out.exists())
        if not quiet:
            table = Table("unknown", "recovered", f"{100 * result.attrs['confidence']:g} %", "unit", box=None,
                          pad_edge=False)  # fmt: skip
            for name in result.data_vars:
                if f"{name}_low" in result:
                    low, high = (float(result[f"{name}_{end}"]) for end in ("low", "high"))
                    unit = result[name].attrs["units"]
                    table.add_row(str(name), f"{float(result[name]):.6g}", shown_interval(low, high), unit)
            screen.print(table)
            screen.print(f"Files: {out} (result.nc, summary.json, figures)", soft_wrap=True)
    return True
