"""Rows of the page from a paper to a command: their commands name demos and benchmarks that exist."""

from __future__ import annotations

import shlex
import tomllib
from pathlib import Path

import pytest

from ruptfx.app.bench import benchmarks
from ruptfx.app.cli import app

CHECKOUT = Path(__file__).parents[2]
TABLES = tomllib.loads((CHECKOUT / "docs" / "gallery" / "sources.toml").read_text(encoding="utf-8"))
AGREES = ("yes", "in part", "no", "not done")


@pytest.mark.parametrize("source", TABLES)
def test_a_row_has_a_command_that_exists_or_says_what_is_missing(source: str) -> None:
    commands = {command.name or command.callback.__name__.replace("_", "-") for command in app.registered_commands}
    for what, command, printed, computed, agrees in TABLES[source]:
        words = shlex.split(command)
        for word in (word for word in words if word.startswith("demos/")):
            assert (CHECKOUT / word).is_file(), what
        assert not words or words[0] == "python" or words[1] in commands, what
        if words[1:2] == ["bench"]:
            assert words[2] in benchmarks(), what
        assert agrees.startswith(AGREES) and printed, what
        assert computed or agrees.startswith("not done"), what
