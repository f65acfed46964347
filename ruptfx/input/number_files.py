"""Numbers from text files, in SI units; errors give the file and the line.

A header may give the unit of a column: `time (us)`, `time [us]`, `t/us`, `time us`, `time_us`, or units alone in a line
below the names. A column whose header has no unit is in SI units.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
from pydantic import ValidationInfo

from ruptfx.input.quantities import OtherKind, factor

Units = tuple[str, str | None]

MOST_BYTES = 100_000_000  # largest size of a file with numbers

_BRACKETED = re.compile(r"(.*?)[\s/]*[(\[]([^()\[\]]*)[)\]]")
_NAMES = ("min", "bar", "deg", "rad")  # units that are also parts of names: x_min
_SLASHED = re.compile(r"(\S.*?)\s*/\s*(\S.*)")


def number(word: str | None, path: str | Path, line: int, scale: Fraction | int = 1) -> float:
    """Return a finite number, times the factor of its column.

    Raises
    ------
    ValueError
    """
    try:
        value = float(word or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        point = ", with a decimal point" if "," in (word or "") else ""
        raise ValueError(
            f"line {line} of {path}: {(word or '').strip()!r} must be a finite number{point}; correct it, or leave out "
            "the line"
        )
    # In exact arithmetic, so that 60 in microseconds equals 60e-6 bitwise.
    return value if scale == 1 else float(Fraction(Decimal((word or "").strip())) * scale)


def name_and_factor(cell: str, unit: str | None) -> tuple[str, Fraction | None]:
    """Return the name of a column and the factor of its numbers to a unit, None if its header has no unit.

    Parameters
    ----------
    cell : str
        Header of the column.
    unit : str or None
        Target unit; None for the SI unit of the unit in the header.

    Raises
    ------
    ValueError
        An unknown unit, or one of another kind.
    """
    cell = cell.strip().strip("\"'").strip()
    if found := _BRACKETED.fullmatch(cell):
        return found[1], factor(_symbol_of(found[2]), unit)
    # Without brackets a word may be part of the name: it is a unit if it is one of the right kind.
    *words, last = cell.split() or [""]
    likely = [("", cell), (" ".join(words), last)]
    *words, last = cell.replace("_per_", "/").split("_")
    if len(words) > 1:
        likely.append(("_".join(words[:-1]), f"{words[-1]}/{last}"))
    if words:
        likely.append(("_".join(words), last))
    for name, text in likely:
        scale = _factor_or_none(text, unit)
        if scale is not None:
            return name, scale
    if found := _SLASHED.fullmatch(cell):
        return found[1], factor(found[2], unit)
    return cell, None


def _symbol_of(bracketed: str) -> str:
    """Return the unit in the brackets of a header; empty ones and a dash are a number without unit."""
    return bracketed.strip() if bracketed.strip() not in ("", "-") else "1"


def _factor_or_none(text: str, unit: str | None) -> Fraction | None:
    """Return the factor of a text that is a unit of the right kind, else None.

    Raises
    ------
    ValueError
        A unit with a prefix, of another kind.
    """
    if unit is None or not text or (re.search(r"\d", text) and "/" not in text):  # v_1, x2 are names
        return None
    try:
        return factor(text, unit)
    except OtherKind:
        if len(text) > 1 and "/" not in text and text not in _NAMES:  # t/us is no unit, but a name and one
            raise
    except ValueError:
        pass
    return None


def factors(
    above: Sequence[tuple[int, str]], units: Sequence[str | None], given: int, path: str | Path
) -> list[Fraction | None]:
    """Return the factor of each column to its unit, from the header; None without a unit.

    Parameters
    ----------
    above : sequence of (int, str)
        Lines above the first number, with their numbers; the last that gives units is the header.
    units : sequence of str or None
        Target units of the columns.
    given : int
        Number of columns of the data. A comment is a header only if it has as many cells as the data or `units`.

    Raises
    ------
    ValueError
        A header with an unknown unit, or one of another kind.
    """
    for line, content in reversed(above):
        cells = _cells(content.lstrip("#").strip(), len(units))
        comment = content.startswith("#")
        if len(cells) < len(units) or (comment and len(cells) not in (len(units), given)):
            continue
        found = [_name_and_factor(cell, unit, f"line {line} of {path}, column {column}")[1]
                 for column, (cell, unit) in enumerate(zip(cells, units, strict=False), 1)]  # fmt: skip
        if any(scale is not None for scale in found):
            return found
    return [None] * len(units)


def named_columns(
    header: Sequence[str], units: Mapping[str, str], path: str | Path, line: int
) -> dict[str, tuple[int, Fraction | int]]:
    """Return index and factor of each named column of a header; ignore other columns.

    Raises
    ------
    ValueError
        A unit that is unknown, or of another kind.
    """
    found: dict[str, tuple[int, Fraction | int]] = {}
    for column, cell in enumerate(header):
        for name, unit in units.items():
            if cell.strip() == name:
                found[name] = column, 1
            elif re.match(rf"{name}[\s/_(\[]", cell.strip()):
                called, scale = _name_and_factor(cell, unit, f"line {line} of {path}, column {column + 1}")
                if called.strip() == name and scale is not None:
                    found.setdefault(name, (column, scale))
    return found


def _name_and_factor(cell: str, unit: str | None, where: str) -> tuple[str, Fraction | None]:
    try:
        return name_and_factor(cell, unit)
    except ValueError as error:
        wanted = f"({unit}) or a multiple" if unit else "for example (m)"
        raise ValueError(
            f"{where}, {cell.strip()!r}: {error}; write the unit in brackets behind the name, {wanted}"
        ) from None


def _cells(text: str, columns: int) -> list[str]:
    """Return the cells of a header, separated by semicolons, commas, tabs, closing brackets or else blanks."""
    if columns == 1:
        return [text.rstrip(";,")]
    separator = next((mark for mark in ";,\t" if mark in text), None)
    if separator is None and re.search(r"[(\[]", text):
        return re.findall(r"[^()\[\]]*[(\[][^()\[\]]*[)\]]", text)
    return text.split(separator)


def is_number(word: str) -> bool:
    """Return whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def require_increasing(values: Sequence[float] | np.ndarray, lines: Sequence[int], path: str | Path) -> None:
    """Refuse a column that is not strictly increasing.

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


def text_of(path: Path) -> str:
    """Return the text of a file named in a case.

    Raises
    ------
    ValueError
        If it cannot be read, is a device or a pipe, or too large.
    """
    try:
        if path.exists() and not path.is_file():
            raise ValueError(f"{path}: cannot be read: it is no regular file; give a file with numbers")
        if (size := path.stat().st_size) > MOST_BYTES:
            raise ValueError(
                f"{path}: has {size / 1e6:.0f} MB, and files with numbers at most {MOST_BYTES / 1e6:.0f}; leave out "
                "columns or rows"
            )
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None


def with_units(path: Path, first: str | None = None, others: str | None = None) -> dict[str, tuple[list[float], str]]:
    """Return all columns of a CSV file with the units of its header, by name.

    Parameters
    ----------
    path : Path
    first, others : str, optional
        Unit of which those of the first column and of all others must be multiples; None accepts every known unit.

    Raises
    ------
    ValueError
        The header has no unit for a column, or an unknown one, or one of another kind; a name is given twice, or lines
        have other numbers of columns.
    """
    lines = [(i, line) for i, line in enumerate(text_of(path).splitlines(), 1) if line.strip()]
    start = next((i for i, (_, line) in enumerate(lines) if is_number(_words(line)[0])), None)
    if start is None or start == 0:
        raise ValueError(
            f"{path}: a header with the unit of every column and lines with numbers are needed, with commas or "
            "semicolons between the columns"
        )
    named: list[tuple[str, str]] = []
    above, header = lines[start - 1]
    for column, cell in enumerate(_words(header.lstrip("# "))):
        where = f"line {above} of {path}, column {column + 1}"
        found = _BRACKETED.fullmatch(cell)
        if found is None and re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", cell):
            raise ValueError(f"{where}, {cell!r}: is no number; write numbers with a decimal point")
        if found is None:
            raise ValueError(f"{where}, {cell!r}: has no unit; write it in brackets behind the name, as time (us)")
        _name_and_factor(cell, others if column else first, where)
        named.append((found[1].strip(), _symbol_of(found[2])))
    if len(dict(named)) < len(named):
        raise ValueError(f"{path}: two columns have the same name; rename one of them")
    rows = [(line, [number(word, path, line) for word in _words(text)]) for line, text in lines[start:]]
    if wrong := next((line for line, row in rows if len(row) != len(named)), None):
        raise ValueError(f"line {wrong} of {path}: {len(named)} columns have names; every line needs as many numbers")
    columns = zip(*(row for _, row in rows), strict=True)
    return {name: (list(column), unit) for (name, unit), column in zip(named, columns, strict=True)}


def _words(line: str) -> list[str]:
    return [word.strip() for word in line.split(";" if ";" in line else ",")]


def two_columns(path: Path, first: str, units: Units) -> tuple[list[float], list[float]]:
    """Read the first two columns of a CSV file, `first` (increasing) and values, in the given units.

    Lines before the first number and lines that begin with # are skipped, except for the units of the header.

    Raises
    ------
    ValueError
    """
    text = text_of(path)
    rows: list[list[float]] = []
    lines: list[int] = []
    above: list[tuple[int, str]] = []
    scales: list[Fraction | int] = []
    for line, content in enumerate(text.splitlines(), 1):
        words = content.split(";" if ";" in content else ",")
        if not content.strip() or content.startswith("#") or not (rows or is_number(words[0])):
            above.append((line, content))
            continue
        if len(words) < 2:
            raise ValueError(f"line {line} of {path}: two columns are needed, {first} and value")
        if not rows:
            scales = [scale or 1 for scale in factors(above, units, len(words), path)]
        rows.append([number(word, path, line, scale) for word, scale in zip(words, scales, strict=False)])
        lines.append(line)
    if len(rows) < 2:
        raise ValueError(f"{path}: at least two lines with a {first} and a value are needed, found {len(rows)}")
    column, values = zip(*rows, strict=True)
    require_increasing(column, lines, path)
    return list(column), list(values)


def named_histories(
    path: Path, wanted: Mapping[str, tuple[Sequence[str], str]], only: str | None = None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Read times [s] from the first column of a CSV file, and the columns whose header names a wanted quantity.

    Parameters
    ----------
    path : Path
    wanted : mapping of str to (sequence of str, str)
        Names that the header may have for a quantity, in lower case, and its unit. Other columns are ignored.
    only : str, optional
        The wanted quantity in a file of two columns, whatever its header.

    Returns
    -------
    times : ndarray, shape (n,)
    columns : dict of str to ndarray, shape (n,)
        The quantities found, in their units.

    Raises
    ------
    ValueError
        Numbers that are not finite, times that do not increase, an unknown unit, or one of another kind.
    """
    above: list[tuple[int, list[str]]] = []
    rows: list[tuple[int, list[str]]] = []
    for line, content in enumerate(text_of(path).splitlines(), 1):
        words = content.lstrip("#").strip().split(";" if ";" in content else ",")
        if not content.strip() or content.startswith("#") or not (rows or is_number(words[0])):
            above.append((line, words))
        else:
            rows.append((line, words))
    if len(rows) < 2 or len(rows[0][1]) < 2:
        raise ValueError(f"{path}: at least two lines with a time and a value are needed, found {len(rows)}")
    count = len(rows[0][1])
    headers = [(line, cells) for line, cells in above if len(cells) == count]
    places = {only: 1} if only is not None and count == 2 else {}
    for _line, cells in headers:
        for column, cell in enumerate(cells[1:], 1):
            for name, (aliases, unit) in wanted.items():
                if name not in places and _called(cell, aliases, unit):
                    places[name] = column
    times, found = _column(rows, headers, 0, "s", path), {}
    require_increasing(times, [line for line, _ in rows], path)
    for name, column in places.items():
        found[name] = _column(rows, headers, column, wanted[name][1], path)
    return times, found


def _called(cell: str, aliases: Sequence[str], unit: str) -> bool:
    """Return whether the header of a column has one of the names, with or without a unit."""
    plain = cell.strip().strip("\"'").strip()
    names = [plain]
    if found := _BRACKETED.fullmatch(plain):
        names.append(found[1])
    else:
        with suppress(ValueError):  # a unit of another kind: the column is another quantity, or has no unit
            names.append(name_and_factor(plain, unit)[0])
    return any(name.strip().lower() in aliases for name in names)


def _column(
    rows: Sequence[tuple[int, list[str]]], headers: Sequence[tuple[int, list[str]]], column: int, unit: str, path: Path
) -> np.ndarray:
    scale: Fraction | None = None
    for line, cells in headers:
        where = f"line {line} of {path}, column {column + 1}"
        scale = scale or _name_and_factor(cells[column], unit, where)[1]
    short = next((line for line, words in rows if len(words) <= column), None)
    if short is not None:
        raise ValueError(f"line {short} of {path}: has fewer columns than the lines above it; add them")
    return np.array([number(words[column], path, line) for line, words in rows]) * float(scale or 1)


def with_file_read(values: object, info: ValidationInfo, key: str, first: str, units: Units) -> object:
    """Replace `file` in the tables of a part by the two lists that it contains.

    Parameters
    ----------
    values : object
        Tables of the part.
    info : ValidationInfo
        Validation context with the directory of the case.
    key, first : str
        Name of the first list, and of one of its numbers.
    units : (str, str or None)
        Units of the two columns; headers may give multiples.

    Raises
    ------
    ValueError
    """
    if not isinstance(values, Mapping) or not isinstance(values.get("file"), str):
        return values
    if values.get(key) or values.get("values"):
        raise ValueError(f"give either a file or {key} and values")
    column, found = two_columns(Path((info.context or {}).get("directory") or ".", values["file"]), first, units)
    return {**{name: value for name, value in values.items() if name != "file"}, key: column, "values": found}
