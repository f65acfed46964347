"""Source documents, from `sources.toml`: their figures and formulas, and the demos that compute them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ruptfx import RuptfxError


@dataclass(frozen=True)
class Row:
    """One figure or formula of a document.

    Attributes
    ----------
    what : str
        The figure, equation or statement.
    command : str
        Command that computes it here; empty if there is none.
    printed, computed : str
        Result of the document, and the result here. In the second `[[NAME|NUMBER]]` is a saved number: a check of the
        benchmark NAME, or a number of the run of the demo NAME, with its ending. Code in backticks has inputs and
        formulas.
    agrees : str
        Yes, in part, no or not done, and the reason.
    picture : str
        Picture of the site, relative to docs/; empty if there is none.
    holds : list of str
        Conditions on saved numbers that the verdict rests on, beside the checks of benchmarks.
    """

    what: str
    command: str
    printed: str
    computed: str
    agrees: str
    picture: str = ""
    holds: Sequence[str] = ()


@cache
def sources() -> dict[str, tuple[Row, ...]]:
    """Return the rows of every document by its name."""
    tables = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return {name: tuple(Row(*row) for row in rows) for name, rows in tables.items()}


def rows_of(source: str) -> tuple[Row, ...]:
    """Return the rows of a document by its name or its number, 000 for the first.

    Raises
    ------
    RuptfxError
    """
    names = list(sources())
    number = int(source) if source.isdecimal() else -1
    name = names[number] if 0 <= number < len(names) else source
    if name not in names:
        known = ", ".join(f"{number:03} or {name}" for number, name in enumerate(names))
        raise RuptfxError(f"--source {source}: no such document; there are {known}")
    return sources()[name]


def files_of(source: str, demos: Path) -> list[Path]:
    """Return the demos in a folder that the commands of a document run, and all files that these need.

    Raises
    ------
    RuptfxError
        There is no such document.
    """
    known = {path.name: path for path in sorted(demos.iterdir()) if path.is_file() and path.suffix != ".md"}
    names = [word for row in rows_of(source) for word in re.findall(r"demos/([\w.]+)", row.command)]
    needed: dict[str, Path] = {}
    while names:
        name = names.pop()
        if name not in needed and name in known:
            needed[name] = known[name]
            # Comments name scripts that use a case; neither needs the other then.
            code = re.sub(r"(?m)^\s*#.*$|\s#.*$", "", known[name].read_text(encoding="utf-8"))
            names += [other for other in known if other in code or f'"{Path(other).stem}"' in code]
            names += [f"{Path(name).stem}.toml"]  # a script often names its case by its own name
    return sorted(needed.values())
