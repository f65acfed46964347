"""The door for plug-ins and scripts: contracts, units and helpers under names that stay when modules move.

``from ruptfx.plugin import FrictionLaw, VaryingLength``: each name is imported when it is first read, so that a
friction law loads neither figures nor DOLFINx. `plugin.pyi`, which type checkers read, lists all names with their
modules.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

_HOME = {
    name.asname or name.name: (line.module, name.name)
    for line in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(line, ast.ImportFrom) and line.module
    for name in line.names
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'ruptfx.plugin' has no attribute '{name}'; it has {', '.join(__all__)}")
    module, attribute = _HOME[name]
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return __all__
