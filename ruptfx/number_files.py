"""Numbers from text files: what is wrong with one names the file and the line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np


def number(word: str | None, path: str | Path, line: int) -> float:
    """A finite number.

    Raises
    ------
    ValueError
    """
    try:
        value = float(word or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise ValueError(f"line {line} of {path}: {(word or '').strip()!r} is not a finite number")
    return value


def is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def require_increasing(values: Sequence[float] | np.ndarray, lines: Sequence[int], path: str | Path) -> None:
    """Refuse a column in which a number is not larger than the one before.

    Raises
    ------
    ValueError
    """
    wrong = np.flatnonzero(np.diff(values) <= 0)
    if len(wrong):
        before, after = values[wrong[0]], values[wrong[0] + 1]
        raise ValueError(
            f"line {lines[wrong[0] + 1]} of {path}: {after:g} after {before:g}; numbers of this column must increase"
        )
