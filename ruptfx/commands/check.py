"""`ruptfx check`."""

from __future__ import annotations

import typer
from rich.table import Table

from ruptfx.commands._shared import EXIT_ERROR, CaseFile, Overrides, reported, screen


def check(case: CaseFile, set_: Overrides = None) -> None:
    """Check a case before it runs: lengths, resolution, warnings, time, memory, disk; exit non-zero on an error.

    Example: ruptfx check demos/impact.toml --set mesh.element_size="2 mm"
    """
    with reported():
        from ruptfx.case import Case, read_case

        parsed = read_case(case, set_ or [])
        if not isinstance(parsed, Case):
            from ruptfx.lumped import TRIAL, extreme, rehearse

            whole = rehearse(parsed)
            screen.print(f"{case}: {parsed.kind()}, {parsed.summary()} The case is valid.")
            if not whole:
                screen.print(f"It was computed for {TRIAL:g} s without an error, and not to its end.")
            for number in extreme(parsed):
                screen.print(f"warning: far from the usual: {number}", style="yellow")
            return
        from ruptfx.checks.preflight import preflight

        table = Table("quantity", "value", "unit", "note", title=parsed.title or str(case), title_justify="left")
        failed = False
        for row in preflight(parsed):
            failed |= row.verdict == "error"
            colour = {"error": "red", "warning": "yellow"}.get(row.verdict, "")
            table.add_row(row.quantity, row.text, row.unit, row.note, style=colour)
        screen.print(table)
        if failed:
            raise typer.Exit(EXIT_ERROR)
