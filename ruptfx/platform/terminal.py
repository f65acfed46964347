"""Consoles that print text without markup: a name like ``m[bold]x`` or ``:x:`` is neither markup nor an emoji."""

from __future__ import annotations

from typing import Any

from rich.console import Console


def console(**options: Any) -> Console:
    """Return a rich console; styles are separate arguments, never inside a text."""
    return Console(markup=False, emoji=False, highlight=False, **options)
