"""The code blocks of a page of docs/, run from top to bottom in one directory, as its reader would.

- `sh` and `console` blocks are run by bash and must succeed. Output that a `console` block shows below a `$ command`
  must come: line by line, `...` standing for anything.
- `python` blocks share their names.
- A `toml`, `python` or other block with a `:caption:` is saved under that name, and not run.
- `toml` blocks without one are parts of a case: they are put into one, which must know every key; other languages are
  only shown.
- `<!-- output of the block above -->` before a `text` block: what the `python` block must print,
  `...` standing for anything.
- `<!-- not run: why -->` before a block leaves it out.
"""

from __future__ import annotations

import contextlib
import fnmatch
import io
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FENCE = re.compile(
    r"^(?P<indent> *)(?P<fence>```+|:::+)(?P<head>[^\n`]*)\n(?P<body>.*?)^(?P=indent)(?P=fence) *$",
    re.MULTILINE | re.DOTALL,
)
OUTPUT = re.compile(r"<!-- output of the block above -->\s*$")
NOT_RUN = re.compile(r"<!-- not run: \S.*?-->\s*$", re.DOTALL)
SECONDS = 240


@dataclass(frozen=True)
class Block:
    """One code block: where, in which language, under which name it is to be saved (empty: to be run)."""

    page: Path
    line: int
    language: str
    caption: str
    text: str
    wanted: bool
    output: bool = False

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks(page: Path) -> Iterator[Block]:
    """The code blocks of a page, also those inside of directives such as tabs and admonitions."""
    yield from _blocks(page, page.read_text(), 1)


def _blocks(page: Path, text: str, first_line: int) -> Iterator[Block]:
    for found in FENCE.finditer(text):
        line = first_line + text.count("\n", 0, found.start())
        head, body = found["head"].strip(), found["body"]
        directive = re.fullmatch(r"\{([\w-]+)\}(.*)", head)
        if directive and directive[1] != "code-block":
            yield from _blocks(page, body, line + 1)
            continue
        language = directive[2].strip() if directive else head
        options = dict(re.findall(r"^ *:([\w-]+): *(.*)\n", body, re.MULTILINE)) if directive else {}
        code = re.sub(r"\A( *:[\w-]+:.*\n)+\n*", "", body) if options else body
        code = re.sub(f"^{found['indent']}", "", code, flags=re.MULTILINE)
        wanted = not NOT_RUN.search(text[: found.start()])
        output = bool(OUTPUT.search(text[: found.start()]))
        yield Block(page, line, language, options.get("caption", ""), code, wanted, output)


def run_page(page: Path, directory: Path) -> None:
    """Run all blocks of a page in a directory that holds the demos, as a clone does."""
    shutil.copytree(ROOT / "demos", directory / "demos", ignore=shutil.ignore_patterns("__pycache__"))
    names: dict[str, object] = {"__name__": "__main__"}
    printed = io.StringIO()
    for block in blocks(page):
        if not block.wanted:
            continue
        if block.caption:
            path = directory / block.caption
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text)
        elif block.language == "toml":
            _check_part(block)
        elif block.language == "python":
            source = "\n" * block.line + block.text  # tracebacks name the line of the page
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(source, str(page), "exec"), names)
        elif block.output:
            assert matches(block.text, printed.getvalue()), f"{block} shows otherwise than\n{printed.getvalue()}"
        elif block.language in ("sh", "console"):
            _run_shell(block, directory)


def _check_part(block: Block) -> None:
    """Put a part of a case into a whole one: what is known must be known by that name, and take that value.

    What it lacks, as the page does not show it, does not count.
    """
    from helpers.small_cases import plates
    from ruptfx.case import Case, parse_case
    from ruptfx.input.schema import CaseError

    part = tomllib.loads(block.text)
    if not part.keys() <= Case.model_fields.keys():
        return  # of a file that is no case
    try:
        parse_case(_joined(plates(), part))
    except CaseError as error:
        wrong = [line for line in str(error).splitlines() if "unknown key" in line or "input should" in line]
        assert not wrong, f"{block}: {wrong}"


def _joined(table: dict, part: dict) -> dict:
    """A table with what is given; a table of another kind is replaced."""
    if "kind" in part and part["kind"] != table.get("kind"):
        return part
    both = {**table, **part}
    for key in table.keys() & part.keys():
        if isinstance(table[key], dict) and isinstance(part[key], dict):
            both[key] = _joined(table[key], part[key])
    return both


def _run_shell(block: Block, directory: Path) -> None:
    for command, shown in _commands(block):
        environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "COLUMNS": "95"}
        done = subprocess.run(
            ["bash", "-e", "-o", "pipefail", "-c", command], cwd=directory, env=environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=SECONDS,
        )  # fmt: skip
        assert done.returncode == 0, f"{block}: {command!r} ended with {done.returncode}\n{done.stdout}"
        assert matches(shown, done.stdout), f"{block}: {command!r} shows otherwise:\n{done.stdout}"


def _commands(block: Block) -> Iterator[tuple[str, str]]:
    """Commands and what a console block shows below them."""
    if block.language == "sh":
        yield block.text, ""
        return
    for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
        command, shown = re.fullmatch(r"((?:[^\n]*\\\n)*[^\n]*\n?)(.*)", part, re.DOTALL).groups()  # type: ignore[union-attr]
        yield command, shown


def matches(shown: str, printed: str) -> bool:
    """Whether the lines shown follow each other in what was printed.

    `...` stands for anything, also for lines; borders of tables do not count.
    """
    lines = [re.sub(r"[\s│┃]+", " ", line).strip() for line in printed.splitlines()]
    place = 0
    for wanted in (re.sub(r"\s+", " ", line).strip() for line in shown.splitlines() if line.strip()):
        if wanted == "...":
            continue
        pattern = fnmatch.translate(re.sub(r"([*?[])", r"[\1]", wanted).replace("...", "*"))
        found = [number for number in range(place, len(lines)) if re.match(pattern, lines[number])]
        if not found:
            return False
        place = found[0] + 1
    return True
