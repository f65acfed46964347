"""The rooms of the package as text: `python tests/helpers/package_tree.py` renews the tree in DESIGN.md."""

from __future__ import annotations

import ast
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "ruptfx"
PAGE = ROOT / "DESIGN.md"
BEGIN, END = "```text\n", "```"
WIDTH = 22


def summary(file: Path) -> str:
    """Return the first sentence of the docstring of a file."""
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return text.partition("\n")[0].rstrip(".")


def rooms() -> list[str]:
    """Return the rooms from the bottom to the top, as the contract of imports orders them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (layers,) = (contract["layers"] for contract in contracts if contract["type"] == "layers")
    return [name.removeprefix("ruptfx.") for line in reversed(layers) for name in line.split(" | ")]


def tree() -> str:
    """Return a line for each room, and for each folder and file in it."""
    lines = ["ruptfx/"]
    for room in rooms():
        lines.append(f"  {room + '/':<{WIDTH}} {summary(PACKAGE / room / '__init__.py')}")
        inside = [path for path in (PACKAGE / room).iterdir() if path.name not in ("__init__.py", "__pycache__")]
        folders = [path for path in inside if (path / "__init__.py").is_file()]
        files = [path for path in inside if path.suffix == ".py"]
        for path in sorted(folders):
            lines.append(f"    {path.name + '/':<{WIDTH - 2}} {summary(path / '__init__.py')}")
        for path in sorted(files):
            lines.append(f"    {path.name:<{WIDTH - 2}} {summary(path)}")
    lines.append(f"  {'plugin.py':<{WIDTH}} {summary(PACKAGE / 'plugin.py')}")
    return "\n".join(lines) + "\n"


def in_page(page: str) -> str:
    """Return the tree that a page has."""
    return page.partition(BEGIN)[2].partition(END)[0]


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(text.replace(in_page(text), tree(), 1), encoding="utf-8")
    sys.stdout.write(tree())
