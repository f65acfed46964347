"""Numbers from text files, in SI units; errors give the file and the line.

`read_table` is the only reader. Columns are separated by semicolons, tabs, commas or blanks, cells may be quoted, and
exponents may be those of Fortran (1.5D-3). Decimal commas are read where neither columns nor decimal points need the
comma, times of day as seconds since the first row, and text files of oscilloscopes (Tektronix) and of LabVIEW. A header
may give the unit of a column: `time (us)`, `time [us]`, `t/us`, `time us`, `time_us`, or units alone in a line below
the names. A column whose header has no unit is in SI units.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import date
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
from pydantic import ValidationInfo

from ruptfx.input.quantities import OtherKind, factor, with_prefix
from ruptfx.platform.files import require_file

Units = tuple[str, str | None]

MOST_BYTES = 100_000_000  # largest size of a file with numbers
MOST_LINES = 1_000_000
MOST_CHARACTERS = 100_000  # of a line

NAMES_OF = {"time": ("time", "t"), "position": ("position", "x", "distance")}
"""Names of the first column of a table of two."""

_BRACKETED = re.compile(r"(.*?)[\s/]*[(\[]([^()\[\]]*)[)\]]")
_DESCRIBED = re.compile(r"[#%\s]*column\s*#?(\d+)\s*[=:][^(\[]*([(\[][^)\]]*[)\]]).*", re.I)  # unit, in files of SCEC
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eEdD][-+]?\d+)?")
_DATE = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})")
_CLOCK = re.compile(rf"(?:{_DATE.pattern}[ T])?(\d{{1,2}}):(\d{{2}})(?::(\d{{2}}(?:[.,]\d+)?))?")
_MISSING = (-999.0, -9999.0, -99999.0, -999.25, 1e30, 9.9e37, 9.91e37)  # marks of missing values in many files
_EMPTY = ("", "nan", "na", "n/a")  # cells without a sample, in lower case
_FAR = 20.0  # times the largest other number of a column: such a mark is no number
_OSCILLOSCOPE = 4  # columns at least, the last two of which are time and signal in files of oscilloscopes
_NAMES = ("min", "bar", "deg", "rad")  # units that are also parts of names: x_min
_SLASHED = re.compile(r"(\S.*?)\s*/\s*(\S.*)")
_COMMENT = ("#", "%")
_SEPARATORS = (";", "\t", ",")


@dataclass(frozen=True)
class NumberTable:
    """Cells of a text file.

    Attributes
    ----------
    path : Path
    lines : list of int
        Line of each row.
    rows : list of list of str
        Cells, of every row as many.
    headers : list of (int, list of str)
        Lines above the first row with as many cells, with their numbers, the nearest last.
    decisions : tuple of str
        How the text was read, but for the usual: separators, commas, times of day.
    """

    path: Path
    lines: list[int]
    rows: list[list[str]]
    headers: list[tuple[int, list[str]]]
    decisions: tuple[str, ...] = ()

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.rows[0])

    def column(self, place: int, scale: Fraction | int = 1, gaps: bool = False) -> list[float]:
        """Return the numbers of a column, times a factor.

        Parameters
        ----------
        place : int
        scale : Fraction or int
        gaps : bool
            Whether cells may be empty or not a number (`nan`); their value is not a number.

        Raises
        ------
        ValueError
            A cell is no finite number, or marks a missing value.
        """
        words = [row[place] for row in self.rows]
        values = [
            math.nan if gaps and word.lower() in _EMPTY else number(word, self.path, line)
            for word, line in zip(words, self.lines, strict=True)
        ]
        _refuse_marks(values, self.lines, self.path)
        return values if scale == 1 else _scaled(words, values, Fraction(scale))

    def factors(self, units: Mapping[int, str | None]) -> dict[int, Fraction | None]:
        """Return the factor of each column to its unit, from the nearest header with units; None without a unit.

        Raises
        ------
        ValueError
            A header with an unknown unit, or one of another kind.
        """
        for line, cells in reversed(self.headers):
            where = f"line {line} of {self.path}, column"
            entries = {i: _name_and_factor(cells[i], unit, f"{where} {i + 1}")[1] for i, unit in units.items()}
            if any(scale is not None for scale in entries.values()):
                return entries
        return dict.fromkeys(units)

    def named(self, units: Mapping[str, str]) -> dict[str, tuple[int, Fraction | int]]:
        """Return index and factor of each column that the nearest header names; ignore other columns.

        Raises
        ------
        ValueError
            A unit that is unknown, or of another kind; a name that is given twice.
        """
        entries: dict[str, tuple[int, Fraction | int]] = {}
        line, header = self.headers[-1] if self.headers else (0, [])
        for column, cell in enumerate(header):
            for name, unit in units.items():
                where, scale = f"line {line} of {self.path}, column {column + 1}", None
                if cell != name and re.match(rf"{name}[\s/_(\[]", cell):
                    called, scale = _name_and_factor(cell, unit, where)
                    if called.strip() != name or scale is None:
                        continue
                elif cell != name:
                    continue
                if name in entries:
                    raise ValueError(f"{where}: a second column {name}; rename or leave out one of them")
                entries[name] = column, scale or 1
        return entries

    def called(self, names: Sequence[str], unit: str) -> list[int]:
        """Return the columns that a header calls by one of these names, in lower case, with or without a unit."""
        columns = range(self.width)
        return [i for i in columns if any(_called(cells[i], names, unit) for _, cells in self.headers)]


def read_table(path: Path, is_named: bool = False) -> NumberTable:
    """Read the cells of a text file.

    Lines above the first row of numbers and lines that begin with # or % are no rows.

    Parameters
    ----------
    is_named : bool
        Whether the first line that is no comment is the header, and all others are rows, also those whose first cell is
        a text.

    Raises
    ------
    ValueError
        It cannot be read, has no rows (a named table may have none), or lines with more or fewer cells than others or
        the header.
    """
    above: list[tuple[int, str]] = []
    lines: list[int] = []
    rows: list[list[str]] = []
    separator, has_header = None, False
    text, encoding = _decoded(path)
    if (count := text.count("\n")) > MOST_LINES:
        raise ValueError(f"{path}: has {count} lines, and files with numbers at most {MOST_LINES}; leave out rows")
    for line, content in enumerate(text.splitlines(), 1):
        if not content.strip():
            continue
        if len(content) > MOST_CHARACTERS:
            raise ValueError(
                f"line {line} of {path}: has {len(content)} characters, and lines at most {MOST_CHARACTERS}; write a "
                "row into each line"
            )
        if content.lstrip().startswith(_COMMENT):
            above += [] if rows else [(line, content)]
            continue
        separator = separator if rows else _separator(content)
        words = _words(content, separator)
        if not (rows or (has_header if is_named else _is_row(words, separator))):
            has_header = True
            above.append((line, content))
            continue
        rows.append(words)
        lines.append(line)
    if not rows and not (is_named and has_header):
        return _of_oscilloscope(path, above)
    table = _aligned(NumberTable(path, lines, rows, []), above, separator)
    marks = {",": "commas", ";": "semicolons", "\t": "tabs"}
    decisions = (
        f"columns separated by {marks.get(separator or '', 'blanks')}",
        *[f"text in {encoding}"] * (encoding != "UTF-8"),
    )
    return _with_clocks(_with_points(replace(table, decisions=decisions), separator))


def _with_points(table: NumberTable, separator: str | None) -> NumberTable:
    """Return a table whose decimal commas are points, where no cell has a point and commas do not separate columns."""
    cells = [cell for row in table.rows for cell in row]
    commas = [cell for cell in cells if _DECIMAL_COMMA.fullmatch(cell)]
    if separator == "," or not commas or any("." in cell and is_number(cell) for cell in cells):
        return table
    rows = [[cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in table.rows]
    return replace(table, rows=rows, decisions=(*table.decisions, "decimal commas"))


def _with_clocks(table: NumberTable) -> NumberTable:
    """Return a table whose times of day are seconds since that of the first row; times after midnight are later."""
    rows, headers = [list(row) for row in table.rows], [(line, list(cells)) for line, cells in table.headers]
    clocks = [i for i in range(table.width) if all(_CLOCK.fullmatch(row[i]) for row in rows)] if rows else []
    for column in clocks:
        matches = [match for row in rows if (match := _CLOCK.fullmatch(row[column]))]
        times = list[Decimal]()
        days = 0
        for line, match in zip(table.lines, matches, strict=True):
            year, month, day, hour, minute, second = match.groups()
            try:
                days = days if year is None else date(int(year), int(month), int(day)).toordinal()
            except ValueError:
                raise ValueError(f"line {line} of {table.path}: {match[0]!r} is no date; give another one") from None
            of_day = 3600 * int(hour) + 60 * int(minute) + Decimal((second or "0").replace(",", "."))
            if year is None and times and 86400 * days + of_day < times[-1] - 43200:
                days += 1
            times.append(86400 * days + of_day)
        for row, time in zip(rows, times, strict=True):
            row[column] = str(time - times[0])
        for _, cells in headers:
            cells[column] = re.sub(r"\s*[(\[].*[)\]]", "", cells[column]) + " (s)"
    text = [f"column {i + 1} is a time of day, read as seconds since its first one" for i in clocks]
    return replace(table, rows=rows, headers=headers, decisions=(*table.decisions, *text)) if clocks else table


def _of_oscilloscope(path: Path, above: Sequence[tuple[int, str]]) -> NumberTable:
    """Return the last two columns of a file of an oscilloscope, whose other columns are settings or empty.

    Raises
    ------
    ValueError
        It is no such file.
    """
    lines = [(line, _words(content, ",")) for line, content in above if not content.lstrip().startswith(_COMMENT)]
    if all(not words[-1] for _, words in lines):  # every line ends with a comma
        lines = [(line, words[:-1]) for line, words in lines if words[:-1]]
    width = len(lines[-1][1]) if lines else 0
    settings = any(words[0] for _, words in lines) and not (lines and lines[-1][1][0])
    alike = all(len(words) == width and all(map(is_number, words[-2:])) for _, words in lines)
    if width < _OSCILLOSCOPE or not (settings and alike):
        raise ValueError(_reason(path, above))
    rows = [words[-2:] for _, words in lines]
    text = f"the last two of {width} columns, time and signal of an oscilloscope"
    return NumberTable(path, [line for line, _ in lines], rows, [], ("columns separated by commas", text))


def _refuse_marks(values: Sequence[float], lines: Sequence[int], path: Path) -> None:
    """Refuse a column in which a number that marks missing values is far beyond all others.

    Raises
    ------
    ValueError
    """
    marked = [place for place, value in enumerate(values) if value in _MISSING]
    others = [abs(value) for value in values if value not in _MISSING and not math.isnan(value)]
    if marked and others and abs(values[marked[0]]) > _FAR * max(others):
        raise ValueError(
            f"line {lines[marked[0]]} of {path}: {values[marked[0]]:g} marks a missing value in many files, and the "
            f"other numbers of its column are {max(others):g} at most; leave out the line, or correct the number"
        )


def describe_reading(path: Path) -> list[str]:
    """Return how a text file of signals is read, in two lines: its layout, and its times.

    Raises
    ------
    ValueError
        It cannot be read.
    """
    table = read_table(path)
    named = table.called(NAMES_OF["time"], "s")
    place = named[0] if len(named) == 1 else 0
    scale = table.factors({place: "s"})[place]
    times = np.array(table.column(place, scale or 1))
    unit = "without a unit, hence in s" if scale is None else f"1 is {with_prefix(float(scale), 's')}"
    steps = np.diff(times)
    apart = "one row"
    if len(steps):
        even = np.ptp(steps) <= 1e-3 * abs(np.mean(steps))
        apart = with_prefix(float(np.mean(steps)), "s") if even else (
            f"{with_prefix(float(steps.min()), 's')} to {with_prefix(float(steps.max()), 's')}")  # fmt: skip
        apart = f"from {with_prefix(float(times[0]), 's')} to {with_prefix(float(times[-1]), 's')}, {apart} apart"
    return [
        f"{path.name}: {'; '.join(table.decisions)}; {len(table.rows)} rows of {table.width} columns from line "
        f"{table.lines[0]} on",
        f"time in column {place + 1} ({unit}), {apart}",
    ]


def _is_row(words: Sequence[str], separator: str | None) -> bool:
    """Return whether cells are a row of numbers; between blanks all of them, as a sentence may begin with a number."""
    cells = words[:1] if separator else words
    forms = (_DECIMAL_COMMA, _CLOCK, _DATE)
    return all(is_number(word) or any(form.fullmatch(word) for form in forms) for word in cells)


def _aligned(table: NumberTable, above: Sequence[tuple[int, str]], separator: str | None) -> NumberTable:
    """Return the table without an empty last column, and with its headers; refuse lines with other numbers of cells.

    Raises
    ------
    ValueError
    """
    path, rows = table.path, table.rows
    # A separator at the end of each line.
    if separator and rows and len(rows[0]) > 1 and all(not row[-1] for row in rows):
        rows = [row[:-1] for row in rows]
    width = len(rows[0]) if rows else len(_words(above[-1][1], separator))
    hint = "are these decimal commas? Write decimal points" if separator == "," else "separate columns in one way"
    for line, row in zip(table.lines, rows, strict=True):
        if len(row) != width:
            raise ValueError(
                f"line {line} of {path}: {len(row)} cells, and {width} in line {table.lines[0]}; every line needs as "
                f"many; {hint}"
            )
    headers = []
    described = {int(match[1]): match[2] for _, content in above if (match := _DESCRIBED.fullmatch(content))}
    for line, content in above:
        if _DESCRIBED.fullmatch(content):
            continue
        cells = _header_cells(content, separator, width)
        if len(cells) == width + 1 and cells[-1].lower() in ("", "comment"):  # of LabVIEW
            cells = cells[:-1]
        if len(cells) == width:
            headers.append((line, cells))
        elif rows and len(cells) > 1 and line == above[-1][0] and not content.lstrip().startswith(_COMMENT):
            raise ValueError(
                f"line {table.lines[0]} of {path}: {width} cells under {len(cells)} names in line {line}; {hint}, or "
                "give every column a name"
            )
    if described and set(described) == set(range(1, width + 1)):
        line = next(line for line, content in reversed(above) if _DESCRIBED.fullmatch(content))
        headers.insert(0, (line, [described[column] for column in range(1, width + 1)]))
    return NumberTable(path, table.lines, rows, headers)


def _header_cells(content: str, separator: str | None, width: int) -> list[str]:
    """Return the cells of a line above the rows: as many as these have, if some separator gives so many."""
    text = content.lstrip("#% \t").strip()
    if width == 1:
        return [text.rstrip(";,")]
    ways = [_words(text, mark) for mark in dict.fromkeys((separator, *_SEPARATORS)) if mark and mark in text]
    bracketed = re.findall(r"[^()\[\]]*[(\[][^()\[\]]*[)\]]", text)
    ways += [] if ways else [bracketed, text.split()]
    ways = [way[:-1] if len(way) == width + 1 and not way[-1] else way for way in ways]
    fitting = next((way for way in ways if len(way) == width), None)
    # Words between blanks may be a title: only units show that they are columns.
    return fitting or (_words(text, separator) if separator else bracketed)


def _reason(path: Path, above: Sequence[tuple[int, str]]) -> str:
    """Return why a file has no rows: what its last line is, or that there is none."""
    last = next((each for each in reversed(above) if not each[1].lstrip().startswith(_COMMENT)), None)
    if last is None:
        return f"{path}: has no line with numbers; a header and lines with numbers are needed"
    line, content = last
    word = _words(content, _separator(content))[0]
    where = f"line {line} of {path}"
    if not word:
        return f"{where}: its first column is empty; leave out the columns before the time or position"
    if re.fullmatch(r"[\d/.-]*[ T]?\d+:\d+.*", word):
        return f"{where}: {word!r} is no time of day such as 12:30:05.1 or 2026-01-31 12:30:05.1; write seconds"
    return f"{where}: {word[:40]!r} is no number; lines with numbers are needed, separated by ; , tabs or blanks"


def _separator(content: str) -> str | None:
    """Return the mark between the columns of a line; None for blanks."""
    if re.fullmatch(rf"\s*{_DECIMAL_COMMA.pattern}(\s+{_DECIMAL_COMMA.pattern})+\s*", content):
        return None  # refused with its cause
    return next((mark for mark in _SEPARATORS if mark in content.strip(" ")), None)


def _words(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line without the blanks and quotation marks around them."""
    if separator is None:
        words = line.split()
    elif '"' in line:
        words = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    else:
        words = line.split(separator)
    return [word.strip(" \t\"'") for word in words] or [""]


def number(word: str, path: str | Path, line: int) -> float:
    """Return a finite number.

    Raises
    ------
    ValueError
    """
    try:
        value = float(_plain(word))
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or "_" in word:
        point = ", with a decimal point" if "," in word else ""
        raise ValueError(
            f"line {line} of {path}: {word[:40]!r} must be a finite number{point}; correct it, or leave out the line"
        )
    return value


def _scaled(words: Iterable[str], values: Sequence[float], scale: Fraction) -> list[float]:
    """Return numbers times a factor, in exact arithmetic, so that 60 in microseconds equals 60e-6 bitwise."""
    power = Decimal(scale.numerator) / Decimal(scale.denominator)
    shift = power.adjusted() if power == Decimal(1).scaleb(power.adjusted()) else None
    scaled = []
    for word, value in zip(words, values, strict=True):
        if math.isnan(value):
            scaled.append(value)
            continue
        exact = Decimal(_plain(word))
        if abs(exact.adjusted()) > 400:  # exact arithmetic would take time and memory of its exponent
            scaled.append(value * float(scale))
        else:
            scaled.append(float(Fraction(exact) * scale if shift is None else exact.scaleb(shift)))
    return scaled


def _plain(word: str) -> str:
    """Return a number with an exponent of Fortran as one with that of C."""
    return re.sub(r"(?<=[\d.])[dD](?=[-+]?\d)", "e", word) if "d" in word or "D" in word else word


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
    if match := _BRACKETED.fullmatch(cell):
        return match[1], factor(_symbol_of(match[2]), unit)
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
    if match := _SLASHED.fullmatch(cell):
        return match[1], factor(match[2], unit)
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


def _name_and_factor(cell: str, unit: str | None, where: str) -> tuple[str, Fraction | None]:
    try:
        return name_and_factor(cell, unit)
    except ValueError as error:
        wanted = f"({unit}) or a multiple" if unit else "for example (m)"
        raise ValueError(
            f"{where}, {cell.strip()!r}: {error}; write the unit in brackets behind the name, {wanted}"
        ) from None


def is_number(word: str) -> bool:
    """Return whether a word is a number."""
    try:
        float(_plain(word))
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
    """Return the text of a file in UTF-8, UTF-16 with its mark, or Latin-1.

    Raises
    ------
    ValueError
        If it cannot be read, is a device or a pipe, too large, or no text.
    """
    return _decoded(path)[0]


def _decoded(path: Path) -> tuple[str, str]:
    """Return the text of a file and the name of its encoding, as `text_of`."""
    content = require_file(path, MOST_BYTES).read_bytes()
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    encodings = {"utf-16": "UTF-16"} if wide else {"utf-8-sig": "UTF-8", "latin-1": "Latin-1"}
    for encoding, name in encodings.items():
        with suppress(UnicodeDecodeError):
            text = content.decode(encoding)
            if "\0" not in text:
                return text, name
    raise ValueError(f"{path}: is no text in UTF-8, UTF-16 or Latin-1; write it as text in UTF-8")


def with_units(
    path: Path, first: str | None = None, others: str | None = None, gaps: bool = False
) -> dict[str, tuple[list[float], str]]:
    """Return all columns of a text file with the units of its header, by name.

    Parameters
    ----------
    first, others : str, optional
        Unit of which those of the first column and of all others must be multiples; None accepts every known unit.
    gaps : bool
        Whether cells of the others may be empty or not a number (`nan`); their value is not a number.

    Raises
    ------
    ValueError
        The header has no unit for a column, or an unknown one, or one of another kind; a name is given twice, or lines
        have other numbers of columns.
    """
    table = read_table(path)
    if not table.headers:
        raise ValueError(f"{path}: a header with the unit of every column is needed, such as time (us), slip (um)")
    line, header = table.headers[-1]
    named: list[tuple[str, str]] = []
    for column, cell in enumerate(header):
        where = f"line {line} of {path}, column {column + 1}"
        match = _BRACKETED.fullmatch(cell)
        if match is None:
            raise ValueError(f"{where}, {cell!r}: has no unit; write it in brackets behind the name, as time (us)")
        _name_and_factor(cell, others if column else first, where)
        named.append((match[1].strip(), _symbol_of(match[2])))
    if len(dict(named)) < len(named):
        raise ValueError(f"{path}: two columns have the same name; rename one of them")
    return {name: (table.column(place, gaps=gaps and place > 0), unit) for place, (name, unit) in enumerate(named)}


def two_columns(path: Path, first: str, units: Units, second: str | None = None) -> tuple[list[float], list[float]]:
    """Read two columns of a text file, `first` (increasing) and values, in the given units.

    Parameters
    ----------
    first : str
        `time` or `position`. The header decides which column it is if it names one; otherwise it is the first.
    units : (str, str or None)
    second : str, optional
        Name of the values in a file of more columns.

    Raises
    ------
    ValueError
        Also more than two columns without one that is called `second`.
    """
    table = read_table(path)
    if table.width < 2:
        raise ValueError(f"line {table.lines[0]} of {path}: two columns are needed, {first} and value")
    named = table.called(NAMES_OF[first], units[0])
    place = named[0] if len(named) == 1 else 0
    values = [column for column in range(table.width) if column != place]
    if len(values) > 1:
        named = [column for column in table.called([second], units[1] or "1") if column != place] if second else []
        if len(named) != 1:
            wanted = f", or call one of them {second}" if second else ""
            raise ValueError(f"line {table.lines[0]} of {path}: {table.width} columns; keep {first} and value{wanted}")
        values = named
    scales = table.factors({place: units[0], values[0]: units[1]})
    if len(table.rows) < 2:
        raise ValueError(f"{path}: at least two lines with a {first} and a value are needed, found {len(table.rows)}")
    column = table.column(place, scales[place] or 1)
    require_increasing(column, table.lines, path)
    return column, table.column(values[0], scales[values[0]] or 1)


def named_histories(
    path: Path, wanted: Mapping[str, tuple[Sequence[str], str]], only: str | None = None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Read times [s] and the columns of a text file whose header names a wanted quantity.

    Parameters
    ----------
    wanted : mapping of str to (sequence of str, str)
        Names that the header may have for a quantity, in lower case, and its unit. Other columns are ignored.
    only : str, optional
        The wanted quantity in a file of two columns, whatever its header.

    Returns
    -------
    times : ndarray, shape (n,)
        Of the column that is called time or t, otherwise the first one.
    columns : dict of str to ndarray, shape (n,)
        The quantities found, in their units.

    Raises
    ------
    ValueError
        Numbers that are not finite, times that do not increase, an unknown unit, or one of another kind, two columns of
        one name.
    """
    table = read_table(path)
    if table.width < 2 or len(table.rows) < 2:
        raise ValueError(
            f"{path}: at least two lines with a time and a value are needed, it has {len(table.rows)} of {table.width} "
            "columns"
        )
    named = table.called(NAMES_OF["time"], "s")
    time = named[0] if len(named) == 1 else 0
    places = {only: 1 - time} if only is not None and table.width == 2 else {}
    for name, (aliases, unit) in wanted.items():
        columns = [column for column in table.called(aliases, unit) if column != time]
        if len(columns) > 1:
            shown = " and ".join(str(column + 1) for column in columns)
            raise ValueError(f"{path}: columns {shown} are both called {name}; rename or leave out one of them")
        if columns and name not in places:
            places[name] = columns[0]
    times = _column(table, time, "s")
    require_increasing(times, table.lines, path)
    return np.array(times), {name: np.array(_column(table, place, wanted[name][1])) for name, place in places.items()}


def _called(cell: str, aliases: Sequence[str], unit: str) -> bool:
    """Return whether the header of a column has one of the names, with or without a unit."""
    names = [cell]
    if match := _BRACKETED.fullmatch(cell):
        names.append(match[1])
    else:
        with suppress(ValueError):  # a unit of another kind: the column is another quantity, or has no unit
            names.append(name_and_factor(cell, unit)[0])
    return any(name.strip().lower() in aliases for name in names)


def _column(table: NumberTable, place: int, unit: str) -> list[float]:
    """Return the numbers of a column in a unit."""
    scale: Fraction | None = None
    for line, cells in reversed(table.headers):
        where = f"line {line} of {table.path}, column {place + 1}"
        scale = scale or _name_and_factor(cells[place], unit, where)[1]
    return table.column(place, scale or 1)


def with_file_read(
    values: object, info: ValidationInfo, key: str, first: str, units: Units, second: str | None = None
) -> object:
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
    second : str, optional
        Name of the values in a file of more than two columns.

    Raises
    ------
    ValueError
    """
    if not isinstance(values, Mapping) or not isinstance(values.get("file"), str):
        return values
    if values.get(key) or values.get("values"):
        raise ValueError(f"give either a file or {key} and values")
    path = Path((info.context or {}).get("directory") or ".", values["file"])
    column, result = two_columns(path, first, units, second)
    return {**{name: value for name, value in values.items() if name != "file"}, key: column, "values": result}
