"""`ruptfx check`."""

from __future__ import annotations

import re
import textwrap
from dataclasses import replace
from typing import TYPE_CHECKING

import typer
from rich.table import Column, Table

from ruptfx.app.commands._shared import EXIT_ERROR, PIPE, CaseFile, Overrides, begin, reported, screen, table_console
from ruptfx.input.quantities import factor, with_prefix

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ruptfx.interfaces.mechanisms.checks.table import Row

HEADING = "Compute"

SECONDS = 10.0  # s of processor time: what takes longer is said before it begins
NARROW = 100  # columns below which notes are not beside the values
COLOURS = {"error": "red", "warning": "yellow"}


def check(case: CaseFile, set_: Overrides = None) -> None:
    """Check a case before it runs: lengths, resolution, warnings, time, memory, disk; exit non-zero on an error.

    Example: ruptfx check demos/impact.toml --set mesh.element_size="2 mm"
    """
    begin(f"reading {case}")
    with reported():
        from ruptfx.case import Case, read_case
        from ruptfx.platform.progress import working

        parsed = read_case(case, set_ or [])
        if not isinstance(parsed, Case):
            from ruptfx.lumped import TRIAL, extreme, rehearse

            with working("computing the case"):
                is_complete = rehearse(parsed)
            screen.print(f"{case}: {parsed.kind()}, {parsed.summary()} The case is valid.")
            if not is_complete:
                screen.print(f"It was computed for {TRIAL:g} s without an error, and not to its end.")
            from ruptfx.results.summary_fields import unit

            for name, constant in parsed.constants().items():
                if not isinstance(constant, str):
                    screen.print(f"{name} = {constant:.6g} {unit(name)}".rstrip())
            for number in extreme(parsed):
                screen.print(f"warning: far from the usual: {number}", style="yellow")
            return
        with working("building the model, and measuring its steps"):
            from ruptfx.app.checks.preflight import preflight

            rows = merged([*_collected(preflight(parsed))])
        said = [row for row in rows if row.verdict != "ok"]
        notes = [readable(row.note) if row.verdict == "ok" else f"{row.verdict} {said.index(row) + 1}, below"
                 for row in rows]  # fmt: skip
        _print(rows, notes, parsed.title or str(case))
        for order, row in enumerate(said, 1):
            value = " ".join(filter(None, engineering(row)))
            sentence = f"{row.verdict} {order}: {row.quantity} = {value}: {readable(row.note)}"
            screen.print(sentence, style=COLOURS[row.verdict], soft_wrap=True)
        if any(row.verdict == "error" for row in said):
            raise typer.Exit(EXIT_ERROR)


def _collected(rows: Iterable[Row]) -> Iterator[Row]:
    """Yield rows, and print those that announce a computation as they come if it takes seconds."""
    announced: list[Row] = []
    for row in rows:
        yield row
        announced = [*announced, row] if row.early else []
        if row.early and row.unit == "s" and float(row.value) > SECONDS:
            for each in announced:
                screen.print(" ".join(filter(None, (f"{each.quantity}:", *engineering(each), f"({each.note})"))))


def _print(rows: list[Row], notes: list[str], title: str) -> None:
    """Print a table; in a narrow terminal notes that do not fit are below their rows, in a pipe a row is one line."""
    out = table_console()
    if NARROW <= out.width < PIPE:
        table = Table("quantity", "value", "unit", Column("note", overflow="fold"), title=title, title_justify="left")
        for row, note in zip(rows, notes, strict=True):
            table.add_row(row.quantity, *engineering(row), note, style=COLOURS.get(row.verdict, ""))
        out.print(table)
        return
    out.print(title, style="italic", soft_wrap=True)
    first = min(max(len(row.quantity) for row in rows), out.width // 2)
    for row, note in zip(rows, notes, strict=True):
        head = f"{row.quantity:<{first}}  {' '.join(filter(None, engineering(row))):<14}"
        fits = len(head) + 2 + len(note) <= out.width
        lines = textwrap.wrap(note, out.width - 4, break_on_hyphens=False, break_long_words=False)
        for line in [f"{head}  {note}"] if fits else [head, *(f"    {line}" for line in lines)]:
            out.print(line.rstrip(), style=COLOURS.get(row.verdict, ""), soft_wrap=True)


def merged(rows: list[Row]) -> list[Row]:
    """Return the rows with those of bodies that say the same as one: "upper, lower: c_p"."""
    entries: dict[Row, list[str]] = {}
    for row in rows:
        owner, colon, what = row.quantity.partition(": ")
        entries.setdefault(replace(row, quantity=what if colon else row.quantity), []).append(owner if colon else "")
    return [
        replace(row, quantity=f"{listed(list(dict.fromkeys(owners)))}: {row.quantity}" if owners[0] else row.quantity)
        for row, owners in entries.items()
    ]


def listed(names: list[str]) -> str:
    """Return up to three names in full, and of more the first and the last with their number."""
    return ", ".join(names) if len(names) < 4 else f"{names[0]} to {names[-1]} ({len(names)})"


def engineering(row: Row) -> tuple[str, str]:
    """Return value and unit of a row as text; times, stresses and lengths with the prefix that suits them."""
    scaled = row.unit in ("s", "Pa", "m")
    if isinstance(row.value, str):
        span = _SPAN.fullmatch(row.value) if scaled else None
        return _span(float(span[1]), float(span[2]), row.unit) if span else (row.value, row.unit)
    if not scaled:
        return f"{row.value:.5g}" if isinstance(row.value, float) else str(row.value), row.unit
    number, _, unit = with_prefix(row.value, row.unit, 4).partition(" ")
    return number, unit


_SPAN = re.compile(r"(-?[\d.]+(?:e[-+]?\d+)?) to (-?[\d.]+(?:e[-+]?\d+)?)")


def _span(first: float, last: float, unit: str) -> tuple[str, str]:
    """Return a range in the unit that suits the end farther from zero."""
    shown = with_prefix(max(first, last, key=abs), unit, 4).partition(" ")[2]
    size = float(factor(shown, unit))
    return f"{first / size:.4g} to {last / size:.4g}", shown


_NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
_QUANTITY = re.compile(rf"(?<![\w.,(/^-])(?:({_NUMBER}) to )?({_NUMBER}) (s|Pa|m)(?![\w/^*])")


def readable(note: str) -> str:
    """Return a note with its times, stresses and lengths in the same way: "1250 steps for 60 us"."""
    return _QUANTITY.sub(_with_prefix, note)


def _with_prefix(found: re.Match[str]) -> str:
    """Return a quantity or a range of a note with the prefix that suits it."""
    if found[1] is None:
        return with_prefix(float(found[2]), found[3], 4)
    return " ".join(_span(float(found[1]), float(found[2]), found[3]))
