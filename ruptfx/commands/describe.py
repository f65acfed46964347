"""`ruptfx describe`."""

from __future__ import annotations

import json
from typing import Annotated

import typer
from rich.table import Table

from ruptfx import __version__
from ruptfx.commands._shared import completed_from, reported, screen


def topics() -> tuple[str, ...]:
    """Return the topics."""
    from ruptfx.describe import TOPICS

    return TOPICS


def topics_and_kinds() -> tuple[str, ...]:
    """Return topics and kinds, for completion."""
    from ruptfx.describe import FOLDERS, TOPICS, names_of

    return (*TOPICS, *(name for topic in FOLDERS for name in names_of(topic)))


def describe(
    what: Annotated[
        str | None,
        typer.Argument(
            help="A topic (case, friction, output, study, summary ...) or a kind (coulomb, boundaries.driven); without "
            "one, all topics are listed.",
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
            from ruptfx.describe import file_schema

            print(json.dumps(file_schema(), indent=2))
            return
        from ruptfx.describe import about, describe_topic

        if what is None:
            screen.print(f"ruptfx {__version__}: `describe TOPIC` describes one of these, `describe KIND` a kind.\n")
            listed = Table(box=None, pad_edge=False, show_header=False)
            for topic in topics():
                listed.add_row(topic, about(topic))
            screen.print(listed)
            return
        for block in describe_topic(what):
            screen.print(block)
