"""Check that an untrusted Gmsh script only describes a geometry.

Gmsh runs commands, writes files and ends the process when a script says so, already while it opens the file. The
scanner knows comments and strings as Gmsh does (no escapes, no nesting, strings may go over several lines) and refuses
by single words, whatever their meaning in context.
"""

from __future__ import annotations

import re
from pathlib import Path

from ruptfx import RuptfxError

_TOKEN = re.compile(r"""//[^\n]* | /\*.*?\*/ | "[^"]*" | '[^']*' | [A-Za-z_]\w* | \S""", re.S | re.X | re.A)
_WORD = re.compile(r"[A-Za-z_]\w*", re.A)
_REFUSED = re.compile(
    r"(system\w*|nonblockingsystem\w*|onelab\w*|externalprocess|plugin|save|print|createdir|exit|\w*filename)", re.I
)
_READS = re.compile(r"(include|merge\w*|shapefromfile)", re.I)
_SCRIPTS = {".geo", ".geo_unrolled", ".opt", ".pos", ".txt"}
_DATA = {".msh", ".step", ".stp", ".iges", ".igs", ".brep", ".stl"}


def check(path: Path) -> None:
    """Refuse a script that does more than describe a geometry, with all the files that it reads.

    Parameters
    ----------
    path : Path
        Script; the files that it reads must be in the same directory or below.

    Raises
    ------
    RuptfxError
        Names the file, the line and the word.
    """
    directory = path.resolve().parent
    todo, seen = [path.resolve(), *_options(path)], set()
    while todo:
        file = todo.pop()
        if file not in seen:
            seen.add(file)
            todo += _scan(file, directory)


def _options(path: Path) -> list[Path]:
    """Return the file of options that Gmsh runs with a script or a mesh, if there is one."""
    options = path.with_name(path.name + ".opt")
    return [options.resolve()] if options.exists() else []


def sources(path: Path) -> list[Path]:
    """Return the existing files that a script names after Include, Merge and ShapeFromFile, and their options."""
    return [file for file in _readings(path) if file != path.absolute()]


def is_ended(path: Path) -> bool:
    """Return whether the last line of a script has an end, or is blank; True without such a file."""
    return not path.is_file() or path.read_bytes().rstrip(b" \t")[-1:] in (b"\n", b"")


def check_ends(path: Path) -> None:
    """Refuse a script that merges another one whose last line has no end: Gmsh reads only a part of that line.

    Raises
    ------
    RuptfxError
        Names the other one.
    """
    for file, is_merged in _readings(path).items():
        if is_merged and file.suffix in _SCRIPTS and not is_ended(file):
            raise RuptfxError(
                f"{file}: its last line does not end with a newline, and Gmsh skips a part of such a line in a file "
                "that is read by Merge; add the newline, or read it by Include"
            )


def _readings(path: Path) -> dict[Path, bool]:
    """Return a script and all existing files that it reads, and whether another one merges them."""
    todo = [(path, False, True)]
    merged: dict[Path, bool] = {}
    while todo:
        named, is_merged, is_script = todo.pop()
        file = named.absolute()
        if file in merged or not file.is_file():
            merged.update({file: True} if file in merged and is_merged else {})
            continue
        merged[file] = is_merged
        todo += [(options, False, True) for options in _options(named)]
        if not is_script and file.suffix not in _SCRIPTS:
            continue
        words = [token.group() for token in _TOKEN.finditer(file.read_bytes().decode("latin-1"))]
        for number, word in enumerate(words):
            if _READS.fullmatch(word):
                names = [name[1:-1] for name in words[number + 1 : number + 3] if name.startswith('"')]
                included = word.lower() == "include"
                todo += [(file.parent / name, not included, included) for name in names]
    return merged


def _scan(path: Path, directory: Path) -> list[Path]:  # noqa: C901
    """Scan a script and return the scripts that it reads."""
    text = path.read_bytes().decode("latin-1")
    items: list[Path] = []

    def refuse(what: str, place: int) -> RuptfxError:
        return RuptfxError(
            f"{path}, line {1 + text.count(chr(10), 0, place)}: {what}; a mesh file may only describe a geometry. If "
            "you trust it and all it reads, add trust = true to [mesh]"
        )

    if "\0" in text:
        raise refuse("a zero byte, where Gmsh ends comments", text.index("\0"))
    tokens = [match for match in _TOKEN.finditer(text) if not match.group().startswith(("//", "/*"))]
    for number, token in enumerate(tokens):
        word, place = token.group(), token.start()
        if word.startswith("'") and '"' in word:
            raise refuse("quotation marks of both kinds in each other", place)
        for item in _WORD.findall(word) if word.startswith("'") else [word]:
            if _REFUSED.fullmatch(item):
                raise refuse(f"'{item}' may run commands, read or write files or end the program", place)
        if word.lower() == "printf":
            end = next((i for i in range(number, len(tokens)) if tokens[i].group() == ";"), len(tokens))
            if any(item.group() == ">" for item in tokens[number:end]):
                raise refuse(f"'{word}' writes a file", place)
        if _READS.fullmatch(word):
            name = next((t.group() for t in tokens[number + 1 : number + 3] if t.group() != "("), "")
            if not name.startswith('"'):
                raise refuse(f"'{word}' is not followed by the name of a file", place)
            file = (path.parent / name[1:-1]).resolve()
            if not file.is_relative_to(directory):
                raise refuse(f"'{word}' reads {file}, which is not in {directory}", place)
            items += _options(path.parent / name[1:-1])
            if word.lower() == "include" or file.suffix in _SCRIPTS:
                items += [file] if file.is_file() else []  # Gmsh says what is missing
            elif file.suffix not in _DATA:
                raise refuse(f"'{word}' reads {file.name}, which is neither a script nor a geometry", place)
    return items
