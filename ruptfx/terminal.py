"""Consoles that show text as it is: a name like ``m[bold]x`` or ``:x:`` is neither markup nor an emoji."""

from __future__ import annotations

from typing import Any

from rich.console import Console


def console(**options: Any) -> Console:
    """A rich console; styles are given as such, never inside a text."""
    return Console(markup=False, emoji=False, highlight=False, **options)
