"""`ruptfx describe`."""

from __future__ import annotations

import json
from string import ascii_uppercase
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Column, Table
from rich.text import Text

from ruptfx import __version__
from ruptfx.app.commands._shared import completed_from, reported, screen

HEADING = "Begin"

SUPPORT = "support"


def topics() -> tuple[str, ...]:
    """Return the topics."""
    from ruptfx.app.reference.describe import TOPICS

    return *TOPICS, SUPPORT


def topics_and_kinds() -> tuple[str, ...]:
    """Return topics and kinds, for completion."""
    from ruptfx.app.reference.describe import FOLDERS, TOPICS, names_of

    return (*TOPICS, SUPPORT, *(name for topic in FOLDERS for name in names_of(topic)))


def describe(
    what: Annotated[
        str | None,
        typer.Argument(
            help="A topic (case, friction, output, study, summary, support ...) or a kind (coulomb, "
            "boundaries.driven); without one, all topics are listed.",
            autocompletion=completed_from(topics_and_kinds),
        ),
    ] = None,
    schema: Annotated[bool, typer.Option("--schema", help="JSON schema of cases and studies, for editors.")] = False,
) -> None:
    """Describe kinds and tables of a case: keys, units, bounds, defaults, formula and source.

    Example: ruptfx describe friction
    """
    with reported():
        if schema:
            from ruptfx.app.reference.describe import file_schema

            print(json.dumps(file_schema(), indent=2))
            return
        if what == SUPPORT:
            _show_support()
            return
        from ruptfx.app.reference.describe import about, describe_topic

        if what is None:
            screen.print(f"ruptfx {__version__}: `describe TOPIC` describes one of these, `describe KIND` a kind.\n")
            listed = Table(box=None, pad_edge=False, show_header=False)
            for topic in topics():
                listed.add_row(topic, "Which features work together" if topic == SUPPORT else about(topic))
            screen.print(listed)
            return
        for block in describe_topic(what):
            screen.print(block)


def _show_support() -> None:
    """Print which features work with which steppers, contact methods, planes and materials."""
    from ruptfx.app.reference.support_table import tables

    for each in tables():
        rows, notes = each.numbered()
        first = Column(f"feature x {each.topic}", overflow="fold", min_width=20)
        names = each.columns
        if max(map(len, names)) > (screen.width - 21) // len(names) - 1:
            # A name broken over lines cannot be read: letters head the columns of a narrow terminal.
            names = tuple(ascii_uppercase[: len(names)])
            screen.print(", ".join(f"{letter}={name}" for letter, name in zip(names, each.columns, strict=True)))
        columns = (Column(name, overflow="fold") for name in names)
        shown = Table(first, *columns, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        for name, *cells in rows:
            shown.add_row(name, *(Text(cell, style="" if cell.startswith("yes") else "red") for cell in cells))
        screen.print(shown)
        for number, note in enumerate(notes, 1):
            screen.print(f"({number}) {note}")
        screen.print()
