"""Numbers from text files: what is wrong with one names the file and the line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pydantic import ValidationInfo


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


def two_columns(path: Path, first: str) -> tuple[list[float], list[float]]:
    """The first two columns of a CSV file, `first` (which increases) and values.

    Lines before the first number and lines that begin with # are skipped.

    Raises
    ------
    ValueError
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read ({error})") from None
    rows: list[list[float]] = []
    lines: list[int] = []
    for line, content in enumerate(text.splitlines(), 1):
        words = content.split(";" if ";" in content else ",")
        if not content.strip() or content.startswith("#") or not (rows or is_number(words[0])):
            continue
        if len(words) < 2:
            raise ValueError(f"line {line} of {path}: two columns are needed, {first} and value")
        rows.append([number(word, path, line) for word in words[:2]])
        lines.append(line)
    if len(rows) < 2:
        raise ValueError(f"{path}: at least two lines with a {first} and a value are needed, found {len(rows)}")
    column, values = zip(*rows, strict=True)
    require_increasing(column, lines, path)
    return list(column), list(values)


def with_file_read(values: object, info: ValidationInfo, key: str, first: str) -> object:
    """Tables of a part that may give a `file` instead of two lists: `key` and values; then with those of the file.

    Parameters
    ----------
    values : object
        What the part is made of.
    info : ValidationInfo
        Its context knows the directory of the case.
    key, first : str
        Name of the first list, and what one of its numbers is.

    Raises
    ------
    ValueError
    """
    if not isinstance(values, Mapping) or not isinstance(values.get("file"), str):
        return values
    if values.get(key) or values.get("values"):
        raise ValueError(f"give either a file or {key} and values")
    column, found = two_columns(Path((info.context or {}).get("directory") or ".", values["file"]), first)
    return {**{name: value for name, value in values.items() if name != "file"}, key: column, "values": found}
