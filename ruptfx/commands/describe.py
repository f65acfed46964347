"""`ruptfx describe`."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from ruptfx import __version__
from ruptfx.commands._shared import reported, screen


def describe(
    what: Annotated[str | None, typer.Argument(help="friction, contact, ..., case, output, study, summary ...")] = None,
    schema: Annotated[bool, typer.Option("--schema", help="JSON schema of cases and studies, for editors.")] = False,
) -> None:
    """What a case may say: every kind and table with its keys, units, bounds, defaults, formula and source."""
    with reported():
        if schema:
            from ruptfx.describe import file_schema

            print(json.dumps(file_schema(), indent=2))
            return
        from ruptfx.describe import TOPICS, describe_topic

        if what is None:
            screen.print(f"ruptfx {__version__}. Choose one of: {', '.join(TOPICS)}; or --schema.")
            return
        for block in describe_topic(what):
            screen.print(block)
