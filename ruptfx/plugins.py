"""Laws from outside: files that a case names, whose classes are alternatives like those of the folders.

A plug-in is one Python file that defines alternatives, classes derived from `FrictionLaw`, `Material` ...; the `kind`
of each is its name with underscores: ``class MyLaw`` is ``kind = "my_law"``. Its content is part of the case, and a
copy goes wherever the case is written. Packages offer theirs by entry points instead (`ruptfx.schema`).
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
from pathlib import Path
from types import ModuleType
from typing import NoReturn, Self

import tomli_w
from pydantic import ModelWrapValidatorHandler, PrivateAttr, ValidationInfo, model_validator

from ruptfx import Table
from ruptfx.schema import (
    Alternative,
    CaseError,
    Part,
    home,
    installed,
    kind_in,
    load_error,
    own_kinds,
    plugged,
    set_key,
)

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
    """A file and what it defines.

    Attributes
    ----------
    path : Path
    source : bytes
        What was loaded, whatever becomes of the file.
    classes : dict of dict of type
        By package and kind: ``classes["ruptfx.friction"]["my_law"]``.
    """

    path: Path
    source: bytes = field(repr=False)
    classes: Mapping[str, Mapping[str, type]] = field(compare=False)

    @property
    def digest(self) -> str:
        return hashlib.sha256(self.source).hexdigest()

    def listed(self) -> str:
        """What it defines, in words."""
        found = (f"{package.rpartition('.')[2]} {kind}" for package, named in self.classes.items() for kind in named)
        return ", ".join(found)


def load(path: str | Path) -> Plugin:
    """Load a file, which runs its code; the same content is loaded once.

    Raises
    ------
    CaseError
        It cannot be read or does not load (with the line), defines nothing, or takes a name that is taken.
    """
    path = Path(path).absolute()
    with telling.get()(path) as told:
        plugin = _load(path)
        told.append(plugin.listed())
    return plugin


def _load(path: Path) -> Plugin:
    if path.suffix != ".py" or (path.exists() and not path.is_file()):
        raise CaseError(f"plugins: {path}: not a Python file; its name must end with .py")
    try:
        source = path.read_bytes()
    except OSError as error:
        raise CaseError(f"plugins: {path}: cannot be read: {error.strerror}") from None
    name = f"{MODULE}{path.stem}_{hashlib.sha256(source).hexdigest()}"
    if name not in _loaded:
        module = _execute(name, path, source)
        classes: dict[str, dict[str, type]] = {}
        for value in vars(module).values():
            if isinstance(value, type) and value.__module__ == name and not value.__name__.startswith("_"):
                package = home(value)
                if package is not None:
                    classes.setdefault(package, {})[kind_in(value)] = value
        _loaded[name] = Plugin(path, source, classes)
    plugin = Plugin(path, source, _loaded[name].classes)
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
    return plugin


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
    """Stand for `os._exit`, with which code of a plug-in would end the program without a message."""
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
    """Files of the modules that the names of a module come from."""
    for value in vars(module).values():
        origin = value if isinstance(value, ModuleType) else sys.modules.get(getattr(value, "__module__", None) or "")
        file = getattr(origin, "__file__", None)
        if file and origin is not module:
            yield file


def of_class(cls: type) -> Plugin:
    """The file that defines a class, as a plug-in.

    Raises
    ------
    CaseError
        There is no file, or the class is not found when it is loaded.
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
    """Within, the kinds of these plug-ins are known.

    Raises
    ------
    CaseError
        Two of them have a name in common.
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
    """The plug-ins that the tables of a case name, relative to `directory`; what is no list of names is not looked at.

    Raises
    ------
    CaseError
    """
    given = table.get("plugins")
    if not isinstance(given, list) or not all(isinstance(item, str | Plugin) for item in given):
        return []
    found = (item if isinstance(item, Plugin) else Path(directory or ".", item).resolve() for item in given)
    return [item if isinstance(item, Plugin) else load(item) for item in dict.fromkeys(found)]


class CaseFile(Part):
    """What a case file holds whatever it computes: plug-ins, and how it is written and told from others."""

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
        found = named(values, (info.context or {}).get("directory"))
        with active(found):
            case = handler({**values, "plugins": [str(plugin.path) for plugin in found]} if found else values)
        case._plugins = tuple(found)
        return case

    @property
    def loaded(self) -> tuple[Plugin, ...]:
        """The plug-ins that it names."""
        return self._plugins

    def model_copy(self, *, update: Mapping[str, object] | None = None, deep: bool = False) -> Self:
        # With the code it was read with, whatever became of the files.
        kept = {"plugins": list(self._plugins)} if update and self._plugins else {}
        return super().model_copy(update={**kept, **update} if update else None, deep=deep)

    def changed(self, key: str, value: object) -> Self:
        """The same case with another value of one key, checked as if it came from a file.

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
        from ruptfx.notebook import shown_part

        return shown_part(self)

    def plugin_files(self) -> list[Plugin]:
        """Plug-ins of the case and, of objects given in Python, the files that define their classes.

        Raises
        ------
        CaseError
            A class that could not be found again in a file.
        """
        found = list(self._plugins)
        for cls in dict.fromkeys(type(part) for part in _parts(self)):
            if not issubclass(cls, Alternative) or home(cls) is None or _is_at_home(cls):
                continue
            if not any(cls in named.values() for plugin in found for named in plugin.classes.values()):
                plugin = of_class(cls)
                if all(plugin.digest != other.digest for other in found):
                    found.append(plugin)
        with active(found):
            return found

    def table(self) -> Table:
        """The resolved case as plain tables, ready for TOML."""
        table = self.model_dump(mode="json", exclude_none=True)
        table.pop("plugins", None)
        files = self.plugin_files()
        return {"plugins": [str(plugin.path) for plugin in files], **table} if files else table

    def to_toml(self) -> str:
        return tomli_w.dumps(self.table())

    @property
    def hash(self) -> str:
        """Content hash: equal for cases that mean the same run, wherever their plug-ins are."""
        table = self.table()
        if "plugins" in table:
            table["plugins"] = sorted([plugin.path.name, plugin.digest] for plugin in self.plugin_files())
        return hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()[:16]

    def copied(self, directory: Path) -> Table:
        """The tables, with copies of the plug-ins: in `plugins` of the directory, to which their names are relative."""
        table, files = self.table(), self.plugin_files()
        for plugin in files:
            (directory / FOLDER).mkdir(exist_ok=True)
            (directory / FOLDER / plugin.path.name).write_bytes(plugin.source)
        return {**table, "plugins": [f"{FOLDER}/{p.path.name}" for p in files]} if files else table

    def save(self, directory: Path) -> None:
        """Write ``case.toml`` and the plug-ins: what the directory needs to be understood by itself."""
        (directory / "case.toml").write_text(tomli_w.dumps(self.copied(directory)), encoding="utf-8")


def _parts(value: object) -> Iterator[Part]:
    """A part and all parts in it."""
    if isinstance(value, Part):
        yield value
        inner: Iterable[object] = (getattr(value, name) for name in type(value).model_fields)
    else:
        inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ()
    for item in inner:
        yield from _parts(item)


def _is_at_home(cls: type) -> bool:
    """Whether its kind is found without a plug-in."""
    if cls.__module__.startswith("ruptfx."):
        return True
    package = home(cls)
    offered = installed(package).get(kind_in(cls)) if package else None
    return offered is not None and offered.module == cls.__module__

