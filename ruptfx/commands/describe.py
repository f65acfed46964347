"""`ruptfx describe`."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from ruptfx import __version__
from ruptfx.commands._shared import completed_from, reported, screen


def topics() -> tuple[str, ...]:
    """What can be asked for."""
    from ruptfx.describe import TOPICS

    return TOPICS


def describe(
    what: Annotated[
        str | None,
        typer.Argument(
            help="friction, contact, ..., case, output, study, summary ...; nothing lists them.",
            autocompletion=completed_from(topics),
        ),
    ] = None,
    schema: Annotated[bool, typer.Option("--schema", help="JSON schema of cases and studies, for editors.")] = False,
) -> None:
    """What a case may say: every kind and table with its keys, units, bounds, defaults, formula and source.

    Example: ruptfx describe friction
    """
    with reported():
        if schema:
            from ruptfx.describe import file_schema

            print(json.dumps(file_schema(), indent=2))
            return
        from ruptfx.describe import describe_topic

        if what is None:
            screen.print(f"ruptfx {__version__}. Choose one of: {', '.join(topics())}; or --schema.")
            return
        for block in describe_topic(what):
            screen.print(block)
