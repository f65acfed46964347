"""Input blocks of SEM2DPACK: Fortran namelists, and the numbers that follow some of them.

`f90nml` reads each namelist. What it skips are the lines of numbers after a ``/``, which blocks of distributions need.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError

Value = float | bool | str
Floats = NDArray[np.float64]
GROUP = re.compile(r"&(\w+)(?:[^'\"/]|'[^']*'|\"[^\"]*\")*/")
LEFT_OUT = ("SNAP", "PLOT", "ECHO", "REC_LINEX")
"""Beginnings of blocks about output that a case does not need."""


class ConversionError(RuptfxError):
    """An input that cannot be converted; the message lists every reason, each with its block and key."""


NO_COUNTERPART = "a block without counterpart"


@dataclass
class Block:
    """One namelist: values by key in lower case, and the numbers that follow it."""

    name: str
    values: dict[str, list[Value]]
    numbers: list[float] = field(default_factory=list)

    def get(self, key: str, default: Value) -> Value:
        """Return the first value of a key."""
        result = self.values.get(key)
        return result[0] if result else default

    def word(self, key: str, default: str = "") -> str:
        """Return the first value of a key in upper case."""
        return str(self.get(key, default)).strip().upper()

    def words(self, key: str, default: str) -> list[str]:
        """Return all values of a key in upper case, without empty ones."""
        return [str(value).strip().upper() for value in self.values.get(key, [default]) if str(value).strip()]

    def number(self, key: str, default: float | None = None) -> float:
        """Return a number.

        Raises
        ------
        ConversionError
            The key is missing without a default, or has no number.
        """
        value = self.get(key, default) if default is not None else self.values.get(key, [""])[0]
        if isinstance(value, bool | str):
            wrong = f", and {value!r} is none" if value != "" else ""
            raise ConversionError(f"&{self.name} {key}: a number is required{wrong}")
        return float(value)

    def pair(self, key: str, default: tuple[float, float] | None = None) -> tuple[float, float]:
        """Return two numbers.

        Raises
        ------
        ConversionError
        """
        result = self.values.get(key, list(default or ()))
        if len(result) != 2 or any(isinstance(value, bool | str) for value in result):
            raise ConversionError(f"&{self.name} {key}: two numbers are required, and {len(result)} values are given")
        return float(result[0]), float(result[1])

    def integers(self, *keys: str) -> list[int]:
        """Return the integers of the first of several keys that is present."""
        match = next((self.values[key] for key in keys if key in self.values), [])
        return [int(float(value)) for value in match]


@dataclass
class Input:
    """The blocks of an input, and what the conversion has to say about them.

    Attributes
    ----------
    blocks : list of Block
        In the order of the file.
    folder : Path or None
        Folder of the files that the input names.
    without : set of str
        Names of refused features to leave out instead, such as ``general.w``.
    notes : list of str
        Differences between the input and the case.
    problems : list of str
        Reasons why there is no case.
    """

    blocks: list[Block]
    folder: Path | None = None
    without: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Add a note once."""
        if text not in self.notes:
            self.notes.append(text)

    def refuse(self, name: str, reason: str) -> None:
        """Report a feature without counterpart, or leave it out where the caller asked for that.

        Parameters
        ----------
        name : str
            Block and key, such as ``GENERAL.W``.
        reason : str
            What the feature is.
        """
        if name.lower() in self.without:
            self.note(f"left out as asked: {name} ({reason})")
        elif (text := f"{name}: {reason}") not in self.problems:
            self.problems.append(text)

    def refuse_keys(self, block: Block, reason: str, *keys: str) -> None:
        """Refuse keys, unless their value is zero, false or empty."""
        for key in keys:
            if block.get(key, 0.0) not in (0.0, False, ""):
                self.refuse(f"{block.name}.{key}", reason)

    def collect(self, stage: Callable[[], None]) -> None:
        """Run a stage of the conversion, and list its error with those of the others."""
        try:
            stage()
        except ConversionError as error:
            if str(error) not in self.problems:
                self.problems.append(str(error))

    def all(self, name: str) -> list[Block]:
        """Return the blocks of a name."""
        return [block for block in self.blocks if block.name == name]

    def one(self, name: str, required: bool = True) -> Block:
        """Return the block of a name; an empty one where it is missing.

        Raises
        ------
        ConversionError
            It is missing and required, or there are several.
        """
        same = self.all(name)
        if len(same) > 1 or (required and not same):
            remedy = "keep one of them" if same else "add it"
            raise ConversionError(f"&{name}: occurs {len(same)} times instead of once; {remedy}")
        return same[0] if same else Block(name, {})

    def following(self, block: Block, beginnings: tuple[str, ...], end: tuple[str, ...]) -> list[Block]:
        """Return the blocks right after one whose names have given beginnings, up to one of the names in `end`."""
        place = next(number for number, other in enumerate(self.blocks) if other is block)
        items = []
        for other in self.blocks[place + 1 :]:
            if other.name in end or not other.name.startswith(beginnings):
                break
            items.append(other)
        return items

    def table(self, block: Block, columns: int) -> Floats:
        """Return the numbers of the file that a block names, shape (rows, columns at least).

        Raises
        ------
        ConversionError
            There is no such file, or it has other contents.
        """
        path = self.path(block)
        rows = [[real(word) for word in line.split()] for line in path.read_text().splitlines() if line.strip()]
        if not rows or any(len(row) < columns for row in rows):
            raise ConversionError(
                f"&{block.name} file = '{path.name}': every row must have {columns} numbers; correct the rows, or name "
                "another file"
            )
        return np.array([row[:columns] for row in rows])

    def path(self, block: Block) -> Path:
        """Return the path of the file that a block names.

        Raises
        ------
        ConversionError
            There is no such file.
        """
        name = str(block.get("file", "")).strip()
        path = (self.folder or Path()) / name
        if not name or self.folder is None or not path.is_file():
            raise ConversionError(
                f"&{block.name} file = '{name}': no such file beside the input; copy it to {self.folder or '.'}"
            )
        return path


def read(text: str) -> list[Block]:
    """Return the namelists of a text in order.

    Raises
    ------
    ConversionError
        There is none, f90nml is not installed, or cannot read one.
    """
    text = "\n".join(_without_comment(line) for line in text.splitlines())
    items = list(GROUP.finditer(text))
    if not items:
        raise ConversionError("no &NAME ... / block in it; is it an input of SEM2DPACK?")
    return list(_blocks(text, items))


def _blocks(text: str, items: list[re.Match[str]]) -> Iterator[Block]:
    try:
        import f90nml
    except ImportError:
        raise ConversionError("f90nml is not installed: pip install 'ruptfx[convert]'") from None
    ends = [match.start() for match in items[1:]] + [len(text)]
    for match, end in zip(items, ends, strict=True):
        name = match[1].upper()
        try:
            group = f90nml.Parser().reads(match[0])
            values: dict[str, object] = next(iter(group.values()), {})
        except Exception as error:  # f90nml raises several kinds for one mistake
            raise ConversionError(
                f"&{name}: not a namelist that can be read ({error!s:.100}); correct it, from & to /"
            ) from None
        table = {key.lower(): [_value(one) for one in _listed(value)] for key, value in values.items()}
        words = text[match.end() : end].split()
        yield Block(name, table, [real(word) for word in words if is_number(word)])


def _without_comment(line: str) -> str:
    """Return a line up to # or !, unless these are quoted."""
    match = re.match(r"(?:[^'\"#!]|'[^']*'|\"[^\"]*\")*", line)
    return match[0] if match else ""


def _listed(value: object) -> Iterable[object]:
    return value if isinstance(value, list) else [value]


def _value(value: object) -> Value:
    if isinstance(value, bool):
        return value
    return float(value) if isinstance(value, int | float) else str(value or "")


def is_number(word: str) -> bool:
    """Return whether a word is a number of Fortran."""
    return re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([edED][-+]?\d+)?,?", word) is not None


def real(word: str) -> float:
    """Return a number of Fortran; not a number where the word is none."""
    return float(re.sub("[dD]", "e", word.rstrip(","))) if is_number(word) else float("nan")
