"""Plug-ins: files named in a case, whose classes are alternatives like those of the folders.

A plug-in is one Python file that defines alternatives, classes derived from `FrictionLaw`, `Material` ...; the `kind`
of each is its name with underscores: ``class MyLaw`` is ``kind = "my_law"``. The file is part of the case, and a
copy is written with every copy of the case. Packages offer alternatives by entry points (`ruptfx.input.schema`).
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import NoReturn, Self

import tomli_w
from pydantic import ModelWrapValidatorHandler, PrivateAttr, ValidationInfo, model_validator

from ruptfx import RuptfxError, Table
from ruptfx.input.schema import (
    Alternative,
    CaseError,
    Part,
    home,
    installed,
    kind_in,
    load_error,
    load_toml_file,
    own_kinds,
    plugged,
    set_key,
)
from ruptfx.platform import run_files
from ruptfx.platform.files import Sums, identity, require_file

MOST_BYTES = 10_000_000  # largest size of a plug-in
FOLDER = "plugins"
"""Where a run directory keeps the copies."""
MODULE = "ruptfx_plugin_"
"""Names of the modules of plug-ins begin so."""
Tell = Callable[[Path], AbstractContextManager[list[str]]]
telling: ContextVar[Tell] = ContextVar("telling", default=lambda path: nullcontext([]))
"""What is entered with the path of a plug-in before its code runs, and is then given what it defines."""

_loading: ContextVar[Path | None] = ContextVar("loading", default=None)
_loaded: dict[str, Plugin] = {}  # by name of the module


@dataclass(frozen=True)
class Plugin:
    """A plug-in file and its classes.

    Attributes
    ----------
    path : Path
    source : bytes
        Loaded content, independent of later changes of the file.
    classes : dict of dict of type
        By package and kind: ``classes["ruptfx.laws.friction"]["my_law"]``.
    """

    path: Path
    source: bytes = field(repr=False)
    classes: Mapping[str, Mapping[str, type]] = field(compare=False)

    @property
    def digest(self) -> str:
        """sha256 of the content."""
        return hashlib.sha256(self.source).hexdigest()

    def listed(self) -> str:
        """Return the definitions of the plug-in as text."""
        items = (f"{package.rpartition('.')[2]} {kind}" for package, named in self.classes.items() for kind in named)
        return ", ".join(items)


def load(path: str | Path) -> Plugin:
    """Load a file, which executes it; equal content is loaded once.

    Raises
    ------
    CaseError
        If it cannot be read, does not load (with the line), defines no alternative, or uses a name that exists.
    """
    path = Path(path).absolute()
    source = _source(path)
    name = f"{MODULE}{path.stem}_{hashlib.sha256(source).hexdigest()}"
    if name not in _loaded:
        with telling.get()(path) as report:
            plugin = Plugin(path, source, _defined(_execute(name, path, source)))
            report.append(plugin.listed())
        _loaded[name] = plugin
    plugin = Plugin(path, source, _loaded[name].classes)
    _check(plugin)
    return plugin


def digests(directory: Path, names: object) -> list[tuple[str, str]]:
    """Return file names and sha256 of the plug-ins that a case in a directory names, sorted; none of them is loaded.

    Raises
    ------
    CaseError
        One of them cannot be read, or the names are none.
    """
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise CaseError(f"plugins: must be a list of file names, not {names!r}")
    paths = [Path(directory, name).absolute() for name in names]
    return sorted((path.name, hashlib.sha256(_source(path)).hexdigest()) for path in paths)


def _source(path: Path) -> bytes:
    """Return the content of a plug-in.

    Raises
    ------
    CaseError
    """
    if path.suffix != ".py" or (path.exists() and not path.is_file()):
        raise CaseError(f"plugins: {path}: not a Python file; its name must end with .py")
    try:
        return require_file(path, MOST_BYTES, "plug-ins", "give a Python file").read_bytes()
    except (OSError, ValueError) as error:
        raise CaseError(f"plugins: {getattr(error, 'strerror', None) or error}") from None


def _defined(module: ModuleType) -> dict[str, dict[str, type]]:
    """Return the alternatives that a module defines, by package and kind."""
    classes: dict[str, dict[str, type]] = {}
    for value in vars(module).values():
        if isinstance(value, type) and value.__module__ == module.__name__ and not value.__name__.startswith("_"):
            package = home(value)
            if package is not None:
                classes.setdefault(package, {})[kind_in(value)] = value
    return classes


def _check(plugin: Plugin) -> None:
    """Refuse a plug-in that defines nothing, or a kind that is known already.

    Raises
    ------
    CaseError
    """
    path = plugin.path
    if not plugin.classes:
        raise CaseError(
            f"plugins: {path}: defines no alternative; derive a class from FrictionLaw, ContactMethod, Material ..."
        )
    for package, named in plugin.classes.items():
        for kind, cls in named.items():
            if kind in own_kinds(package) or kind in installed(package):
                raise CaseError(
                    f"plugins: {path}: {cls.__name__} would hide the {package.rpartition('.')[2]} '{kind}' that is "
                    "there already; give the class another name"
                )


def _execute(name: str, path: Path, source: bytes) -> ModuleType:
    module = ModuleType(name)
    module.__file__ = str(path)
    os._exit = _exit  # type: ignore[assignment]
    sys.modules[name] = module  # pydantic looks up types there
    token = _loading.set(path)
    try:
        exec(compile(source, str(path), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise CaseError(f"plugins: {load_error(path, error)}") from error
    finally:
        _loading.reset(token)
    beside = [m for m in _imported(module) if Path(m).parent == path.parent]
    if beside:
        del sys.modules[name]
        raise CaseError(
            f"plugins: {path}: imports {Path(beside[0]).name} beside it, which would not be copied with it; put both "
            "into one file, or into a package that is installed"
        )
    return module


_leave = os._exit


def _exit(code: int) -> NoReturn:
    """Replace `os._exit`, with which a plug-in would end the program without a message."""
    if str(sys._getframe(1).f_globals.get("__name__")).startswith(MODULE):
        raise SystemExit(code)
    _leave(code)


def exit_error(left: SystemExit) -> CaseError | None:
    """Return the error of a plug-in that ends the program, None where another one does."""
    for frame, line in reversed([*traceback.walk_tb(left.__traceback__)]):
        if str(frame.f_globals.get("__name__")).startswith(MODULE):
            return CaseError(
                f"plugins: {frame.f_code.co_filename}, line {line}: ends the program with exit code {left.code}; raise "
                "an error instead, for example ValueError with what is wrong"
            )
    return None


def _imported(module: ModuleType) -> Iterator[str]:
    """Yield the files of the modules that define the names of a module."""
    for value in vars(module).values():
        origin = value if isinstance(value, ModuleType) else sys.modules.get(getattr(value, "__module__", None) or "")
        file = getattr(origin, "__file__", None)
        if file and origin is not module:
            yield file


def of_class(cls: type) -> Plugin:
    """Return the file that defines a class, as a plug-in.

    Raises
    ------
    CaseError
        If there is no file, or it does not define the class.
    """
    if cls.__module__ in _loaded:
        return _loaded[cls.__module__]
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    remedy = f"save it in a file of its own, for example {kind_in(cls)}.py, and import it from there"
    if file is None or not Path(file).is_file():
        raise CaseError(f"{cls.__name__} is not defined in a file, and a case could not be read again: {remedy}")
    plugin = load(file)
    if kind_in(cls) not in plugin.classes.get(home(cls) or "", {}):
        raise CaseError(f"{cls.__name__} is not defined at the top level of {file}, where it could be found: {remedy}")
    return plugin


@contextmanager
def active(plugins: Iterable[Plugin]) -> Iterator[None]:
    """Make the kinds of these plug-ins known within the context.

    Raises
    ------
    CaseError
        If two of them define the same name.
    """
    merged: dict[str, dict[str, type]] = {}
    files: dict[str, Plugin] = {}
    origin: dict[tuple[str, str], Plugin] = {}
    for plugin in plugins:
        if files.setdefault(plugin.path.name, plugin) is not plugin:
            other = files[plugin.path.name]
            raise CaseError(f"plugins: {other.path} and {plugin.path}: two files of the same name; rename one")
        for package, named in plugin.classes.items():
            for kind, cls in named.items():
                other = origin.setdefault((package, kind), plugin)
                if other is not plugin:
                    raise CaseError(
                        f"plugins: {other.path} and {plugin.path}: both define the {package.rpartition('.')[2]} "
                        f"'{kind}'; rename one of the classes"
                    )
                merged.setdefault(package, {})[kind] = cls
    token = plugged.set(merged)
    try:
        yield
    finally:
        plugged.reset(token)


def named(table: Mapping[str, object], directory: Path | None) -> list[Plugin]:
    """Return the plug-ins named in the tables of a case, relative to `directory`; ignore invalid lists.

    Raises
    ------
    CaseError
    """
    plugins = table.get("plugins")
    if not isinstance(plugins, list) or not all(isinstance(item, str | Plugin) for item in plugins):
        return []
    items = (item if isinstance(item, Plugin) else Path(directory or ".", item).resolve() for item in plugins)
    return [item if isinstance(item, Plugin) else load(item) for item in dict.fromkeys(items)]


class CaseFile(Part):
    """Common part of all case files: plug-ins, writing and hashing."""

    plugins: list[str] = []
    """Python files that define further kinds, relative to the case file. They run when the case is read."""
    _plugins: tuple[Plugin, ...] = PrivateAttr(())

    @model_validator(mode="wrap")
    @classmethod
    def _with_plugins(cls, values: object, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        if (file := _loading.get()) is not None:
            raise CaseError(
                f"makes a case when {file.name} is loaded as a plug-in; put what is not to run then under: "
                'if __name__ == "__main__":'
            )
        if not isinstance(values, Mapping):
            return handler(values)
        result = named(values, (info.context or {}).get("directory"))
        with active(result):
            case = handler({**values, "plugins": [str(plugin.path) for plugin in result]} if result else values)
        case._plugins = tuple(result)
        return case

    @property
    def loaded(self) -> tuple[Plugin, ...]:
        """Plug-ins named in the case."""
        return self._plugins

    def model_copy(self, *, update: Mapping[str, object] | None = None, deep: bool = False) -> Self:
        # Keep the loaded code, independent of later changes of the files.
        kept = {"plugins": list(self._plugins)} if update and self._plugins else {}
        return super().model_copy(update={**kept, **update} if update else None, deep=deep)

    def changed(self, key: str, value: object) -> Self:
        """Return the case with another value of one key, checked as if it came from a file.

        Parameters
        ----------
        key : str
            Dotted, entries of lists by number: ``"boundaries.0.velocity"``.
        value : object
            A number, text with a unit, a table, an array, or a part such as ``Coulomb(mu_d=0.3)``.

        Raises
        ------
        CaseError
        """
        table = {**self.table(), "plugins": self.plugin_files()}
        table.pop("kind", None)  # of a lumped model: its class
        set_key(table, key, value)
        return type(self)(**table)

    def _repr_html_(self) -> str:
        from ruptfx.input.notebook import shown_part

        return shown_part(self)

    def plugin_files(self) -> list[Plugin]:
        """Return the plug-ins of the case and the files of classes of objects given in Python.

        Raises
        ------
        CaseError
            If a class is not defined in a file.
        """
        items = list(self._plugins)
        for cls in dict.fromkeys(type(part) for part in _parts(self)):
            if not issubclass(cls, Alternative) or home(cls) is None or _is_at_home(cls):
                continue
            if not any(cls in named.values() for plugin in items for named in plugin.classes.values()):
                plugin = of_class(cls)
                if all(plugin.digest != other.digest for other in items):
                    items.append(plugin)
        with active(items):
            return items

    def table(self) -> Table:
        """Return the resolved case as plain tables, ready for TOML."""
        table = self.model_dump(mode="json", exclude_none=True)
        table.pop("plugins", None)
        files = self.plugin_files()
        return {"plugins": [str(plugin.path) for plugin in files], **table} if files else table

    def to_toml(self) -> str:
        """Return the resolved case as TOML text."""
        return tomli_w.dumps(self.table())

    @cached_property
    def sums(self) -> Sums:
        """Size and sha256 of all files that a run of the case reads, as they were when this was first asked for.

        No private attribute, because cases with the same keys are equal.
        """
        return self.read_sums()

    def read_sums(self) -> Sums:
        """Return size and sha256 of these files as they are now."""
        paths = dict.fromkeys(path.absolute() for part in _parts(self) for path in part.files())
        return {str(path): identity(path) for path in paths}

    def set_sums(self, sums: Sums) -> None:
        """Set size and sha256 of these files, at the start of a run, on all ranks to those of one."""
        self.__dict__["sums"] = sums

    @property
    def hash(self) -> str:
        """Content hash, equal for cases of the same run, with all files that it reads; plug-ins may be anywhere."""
        return self._hash(self.sums)

    @property
    def hash_without_files(self) -> str:
        """Content hash of earlier versions, without the content of meshes and other files that a run reads."""
        return self._hash({})

    def _hash(self, sums: Sums) -> str:
        table = self.table()
        if "plugins" in table:
            table["plugins"] = sorted([plugin.path.name, plugin.digest] for plugin in self.plugin_files())
        if sums:
            table["sums"] = sums
        return hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()[:16]

    def hash_in(self, directory: Path) -> str | None:
        """Return the hash of the case of the run in a directory; None if unknown.

        No code of the directory runs: a case is read only where its plug-ins are those of this one, which are loaded.
        """
        loaded = {(plugin.path.name, plugin.digest) for plugin in self.plugin_files()}
        try:
            table = load_toml_file(directory / run_files.CASE)
            sources = digests(directory, table.get("plugins", []))
            if loaded.issuperset(sources) and table.get("kind") == self.table().get("kind"):
                table.pop("kind", None)  # of a lumped model: its class
                return type(self).model_validate(table, context={"directory": directory}).hash
            return run_files.seal({**table, "plugins": sources} if sources else table)[:16]  # as `hash` of those tables
        except (RuptfxError, OSError, ValueError, TypeError, RecursionError):  # not TOML, or not such a case
            pass
        try:
            return str(json.loads((directory / run_files.SUMMARY).read_text())["case_hash"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def copied(self, directory: Path) -> Table:
        """Copy the plug-ins to `plugins` of a directory; return the tables with relative names of the copies."""
        table, files = self.table(), self.plugin_files()
        for plugin in files:
            (directory / FOLDER).mkdir(exist_ok=True)
            (directory / FOLDER / plugin.path.name).write_bytes(plugin.source)
        return {**table, "plugins": [f"{FOLDER}/{p.path.name}" for p in files]} if files else table

    def save(self, directory: Path) -> None:
        """Write ``case.toml``, the plug-ins, and the checksums of all files that a run reads."""
        (directory / run_files.CASE).write_text(tomli_w.dumps(self.copied(directory)), encoding="utf-8")
        if self.sums:
            run_files.write_json(directory / run_files.INPUTS, self.sums)


def _parts(value: object) -> Iterator[Part]:
    """Yield a part and all parts in it."""
    if isinstance(value, Part):
        yield value
        inner: Iterable[object] = (getattr(value, name) for name in type(value).model_fields)
    else:
        inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ()
    for item in inner:
        yield from _parts(item)


def _is_at_home(cls: type) -> bool:
    """Return whether the kind of a class is found without a plug-in."""
    if cls.__module__.startswith("ruptfx."):
        return True
    package = home(cls)
    offered = installed(package).get(kind_in(cls)) if package else None
    return offered is not None and offered.module == cls.__module__
