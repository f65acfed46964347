"""`ruptfx plot`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import (
    Interface,
    Overwrite,
    begin,
    completed_from,
    errors,
    reported,
    runs,
    screen,
    seconds,
    writing,
)  # fmt: skip
from ruptfx.input.quantities import with_prefix

HEADING = "Post-process"
FORMATS = ["png", "pdf", "svg"]
PNG = FORMATS[:1]


def figures() -> list[str]:
    """Return the names of all figures."""
    from ruptfx.results import plots

    return list(plots.FIGURES)


def plot(  # noqa: C901
    run: Annotated[Path, typer.Argument(help="Run or study directory.", autocompletion=runs, show_default=False)],
    format_: Annotated[
        list[str], typer.Option("--format", metavar="<png|pdf|svg>", help="File type; repeatable.")
    ] = PNG,
    figure: Annotated[
        list[str] | None,
        typer.Option(help="Only this figure, such as space_time; repeatable.", autocompletion=completed_from(figures)),
    ] = None,
    since: Annotated[
        str | None,
        typer.Option("--from", metavar="<time>", help="Only times from this one on, as '10 us', or a number in s."),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option("--to", metavar="<time>", help="Only times up to this one, as '30 us', or a number in s."),
    ] = None,
    interface: Interface = None,
    trust: Annotated[bool, typer.Option("--trust", help="Run plug-ins of the run where figures need them.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Draw the figures of a run, or the map of a study, again; needs no DOLFINx.

    Plug-ins of the run are not executed without --trust; figures that need them are then skipped and listed.

    Figures of a part of a run, with --from and --to, have the times in their names; those whose data have no time in
    it are skipped and listed. Those of another interface than that with the largest slip have its name.

    Example: ruptfx plot runs/impact --figure space_time --from "10 us" --to "30 us" --format pdf
    """
    begin(f"reading {run}")
    with reported():
        for kind in format_:
            if kind not in FORMATS:
                raise RuptfxError(f"--format {kind}: known: {', '.join(FORMATS)}")
        if (figure or since or until or interface) and any((run / n).exists() for n in ("study.json", "result.nc")):
            raise RuptfxError(f"{run}: --figure, --from, --to and --interface are for runs with bodies; leave them out")
        if (run / "study.json").exists():
            from ruptfx.many_runs.study.execute import draw

            with writing(run, overwrite=overwrite) as files:
                paths = draw(run, tuple(format_), files.place)
            for path in paths:
                _show(path)
            return
        if (run / "result.nc").exists():
            from ruptfx.lumped import redraw

            with writing(run / "figures", overwrite=overwrite) as files:
                paths = redraw(run, tuple(format_), trust, files.place)
            for path in paths:
                _show(path)
            return
        from ruptfx.input.schema import nearest
        from ruptfx.platform.progress import in_lines, working
        from ruptfx.results import plots
        from ruptfx.results.record import Files

        for name in figure or []:
            if name not in plots.FIGURES:
                raise RuptfxError(f"--figure {name}: {nearest(name, list(plots.FIGURES))}")
        first, last = seconds("--from", since), seconds("--to", until)
        with Files(run, trust) as run_files, run_files.on(interface) as record, \
                record.between(first, last) as part:  # fmt: skip
            for name in figure or []:
                if not plots.suits(name, part):
                    drawn = ", ".join(each for each in plots.FIGURES if plots.suits(each, part))
                    raise RuptfxError(f"--figure {name}: the run has no data for it; it has {drawn}")
            times = (first, last) if part.is_part else None
            suffix = f"_{interface}" * bool(interface) + "".join(
                f"_{word}_{with_prefix(time, 's').replace(' ', '')}"
                for word, time in (("from", first), ("to", last)) if time is not None
            )  # fmt: skip
            later: list[Path] = []  # a spinner would mix with the paths
            with writing(run / "figures", overwrite=overwrite) as files, working("drawing the figures"):
                show = _show if in_lines() else later.append

                def saved(path: Path) -> None:
                    files.claim(path.name)
                    show(path)

                plots.save_all(
                    record, files.place, formats=tuple(format_), only=figure or None, suffix=suffix, times=times,
                    saved=saved,
                )  # fmt: skip
            for path in later:
                _show(path)
            for name, reason in record.outside.items():
                errors.print(f"left out: {name}: {reason}", markup=False, highlight=False, soft_wrap=True)
            for omitted in dict.fromkeys(record.omitted):
                errors.print(f"left out: {omitted}; a plug-in of the run has the law. If you trust it, add --trust",
                             markup=False, highlight=False, soft_wrap=True)  # fmt: skip


def _show(path: Path) -> None:
    """Print the path that a file has at the end."""
    from ruptfx.results.outputs import final

    screen.print(str(final(path)), soft_wrap=True)
    screen.file.flush()
