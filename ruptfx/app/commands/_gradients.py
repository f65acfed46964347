"""What the commands with exact gradients share: their options, and the start of ranks."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ruptfx import RuptfxError
from ruptfx.app.commands._shared import begin, errors, reported

if TYPE_CHECKING:
    from ruptfx.case import Case

Ranks = Annotated[int, typer.Option(min=1, help="MPI ranks to start.")]
Memory = Annotated[float, typer.Option(min=0, help="Memory for checkpoints and the history of the interfaces, in GB.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress, no table.")]


def case_on_ranks(
    command: str, case: Path, ranks: int, out: Path, overrides: Sequence[str], memory: float | None, quiet: bool,
    flags: Sequence[str] = (),
) -> Case:  # fmt: skip
    """Return the case, where the command is to go on in this process; start it on several ranks and exit otherwise.

    Raises
    ------
    typer.Exit
        The case cannot be used, or the command has run on the ranks.
    """
    begin(f"reading {case}", not quiet)
    from ruptfx.case import Case, read_case
    from ruptfx.platform import launch

    with reported():
        parsed = read_case(case, overrides)
        if not isinstance(parsed, Case):
            raise RuptfxError(
                f"{case}: {parsed.kind()} is a lumped model and has no gradient; vary its keys in a study (`ruptfx "
                "study`), which with sampling = 'cma_es' also searches them"
            )
    if ranks == 1 or launch.RANKS in os.environ:
        return parsed
    options = [item for value in overrides for item in ("--set", value)] + ["--quiet"] * quiet
    options += [*flags, *([] if memory is None else ["--memory", str(memory)])]
    if not quiet:
        errors.print(f"starting {ranks} ranks")
    with reported():
        code = launch.run_on(ranks, [command, "--out", str(out), *options, "--", str(case)])
    raise typer.Exit(code)
