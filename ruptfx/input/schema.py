"""Conversion of case files to objects: strict parts, alternatives found by file name, errors that name the key.

A `Part` is one table of a case file. An `Alternative` is a part chosen by `kind`, and its kind is the name of the
file it lives in: `ruptfx/laws/friction/coulomb.py` is ``kind = "coulomb"``; there is no registry. Furthermore,
installed packages offer alternatives by entry points, ``[project.entry-points."ruptfx.friction"]``, and a case may name
plug-ins (`ruptfx.input.plugins`).
"""

from __future__ import annotations

import ast
import copy
import difflib
import importlib
import inspect
import linecache
import pkgutil
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self, get_args

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    SerializeAsAny,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    model_serializer,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ruptfx import RuptfxError, Table
from ruptfx.input.former_names import warn_of_former
from ruptfx.input.quantities import parse
from ruptfx.platform.files import require_file

MOST_BYTES = 200_000_000  # largest size of a case file; resolved cases contain the numbers of other files


class CaseError(RuptfxError):
    """Error of an invalid case or part; every line names a key, its value and the remedy."""

    @classmethod
    def from_validation(cls, error: ValidationError, where: str = "") -> CaseError:
        """Convert the report of pydantic: one line per problem, ``key = value: problem``."""
        lines, meant = [], set[str]()
        items = error.errors(include_url=False)
        # Unknown keys first: a required key that one of them means is not reported as missing.
        for item in sorted(items, key=lambda item: not isinstance(item["input"], _UnknownKey)):
            # Tags of unions (`<number>`) and of dictionaries (`[key]`) are pydantic's own steps, not keys of the case.
            path = [shown_key(part) for part in (where, *item["loc"]) if not str(part).startswith(("<", "[key]"))]
            key = ".".join(part for part in path if part) or "case"
            unknown = item["input"]
            if isinstance(unknown, _UnknownKey):
                table = ".".join(part for part in path[:-1] if part)
                lines.append(f"{table or 'case'}: unknown key '{path[-1]}', {nearest(unknown.key, unknown.known)}")
                meant.add(".".join(filter(None, (table, closest(unknown.key, unknown.known)))))
            elif item["type"] == "missing":
                lines += [] if key in meant else [f"{key}: this key is required and missing"]
            elif item["type"] == "unknown_kind":
                lines.append(f"{key}: {item['msg']}")
            else:
                # A table is known by its key.
                shown = "" if isinstance(item["input"], Mapping | BaseModel) else f" = {shown_value(item['input'])}"
                reason = item["msg"].removeprefix("Value error, ")
                if item["type"] == "string_pattern_mismatch" and item["ctx"]["pattern"] == NAME:
                    reason = "a name has a letter first, followed by letters without accents, digits and _"
                lines += [f"{key}{shown}: {each[0].lower()}{each[1:]}" for each in reason.splitlines()]
        return cls("\n".join(dict.fromkeys(lines)))


def shown_key(key: object) -> str:
    """Return a key as shown in messages: on one line, and not too long."""
    text = str(key)
    text = text if text.isprintable() else repr(text)
    return text if len(text) < 60 else text[:57] + "..."


MAX_DEPTH = 40
_WORD = r"""(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')"""
DEEP_KEY = re.compile(rf"(?<![\w.-])(?:{_WORD}[ \t]*+\.[ \t]*+){{{MAX_DEPTH + 1}}}")
"""Beginning of a dotted key with more levels than a case may have."""


def shown_value(value: object) -> str:
    """Return a value as text of at most 80 characters."""
    shown = repr(value)
    return shown if len(shown) < 80 else shown[:77] + "..."


def dotted_keys(value: object, key: str = "") -> Iterator[str]:
    """Yield the dotted keys of the values below a part or a table; entries of lists of tables have numbers."""
    if isinstance(value, Part):
        items = [(name, getattr(value, name)) for name in type(value).model_fields]
    elif isinstance(value, Mapping):
        items = list(value.items())
    elif isinstance(value, list) and value and all(isinstance(each, Part | Mapping) for each in value):
        items = [(str(number), each) for number, each in enumerate(value)]
    else:
        yield key
        return
    for name, item in items:
        yield from dotted_keys(item, f"{key}.{name}".lstrip("."))


def check_tables(table: Mapping[str, object]) -> None:
    """Refuse deep nesting and integers beyond 64 bits, which TOML does not have.

    Raises
    ------
    CaseError
        Names the key.
    """
    todo: list[tuple[str, int, object]] = [("", 0, table)]
    while todo:
        key, depth, value = todo.pop()
        if depth > MAX_DEPTH:
            raise CaseError(
                f"{shown_key(key[1:])}: nested more than {MAX_DEPTH} levels deep; use fewer tables in tables"
            )
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise CaseError(f"{shown_key(key[1:])}: an integer of {value.bit_length()} bits, must have at most 63")
        items = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
        todo += [(f"{key}.{name}", depth + 1, item) for name, item in items]


def load_toml(text: str) -> Table:
    """Return the tables of a TOML text.

    Raises
    ------
    CaseError
    """
    if deep := DEEP_KEY.search(text):  # first: time and memory of the parser grow with the square of levels
        line = text.count("\n", 0, deep.start()) + 1
        raise CaseError(f"line {line}: a key of more than {MAX_DEPTH} levels; use fewer tables in tables")
    try:
        table = tomllib.loads(text)
    except RecursionError:
        raise CaseError(f"not valid TOML: nested too deeply; use at most {MAX_DEPTH} levels") from None
    except ValueError as error:
        if "set_int_max_str_digits" in str(error):  # Python's remedy is none for a case
            raise CaseError("not valid TOML: an integer of more than 4300 digits; write it with an exponent") from None
        raise CaseError(f"not valid TOML: {error}") from None
    check_tables(table)
    return table


def load_toml_file(path: Path) -> Table:
    """Return the tables of a TOML file.

    Raises
    ------
    CaseError
        No regular file, too large, or not TOML.
    """
    try:
        require_file(path, MOST_BYTES, "case files", "give a TOML file")
        return load_toml(path.read_text(encoding="utf-8-sig"))
    except CaseError as error:
        raise CaseError(f"{path}: {error}") from None
    except (OSError, ValueError) as error:  # ValueError: no regular file, invalid file name, bytes that are not text
        said = str(getattr(error, "strerror", None) or error)
        raise CaseError(said if said.startswith(f"{path}: ") else f"{path}: cannot be read: {said}") from None


def plain(value: object) -> object:
    """Convert NumPy arrays and numbers, also in lists, to Python types."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [plain(item) for item in value] if isinstance(value, list) else value


def value_at(node: object, key: str) -> object:
    """Return the value of a dotted key of tables, lists and parts."""
    for name in key.split("."):
        node = node[int(name)] if isinstance(node, list) else (
            node[name] if isinstance(node, Mapping) else getattr(node, name)
        )  # fmt: skip
    return node


def set_key(table: Table, key: str, value: object) -> None:
    """Set the value of one dotted key in place; list entries are addressed by number.

    Raises
    ------
    CaseError
        The key does not lead to a value.
    """
    *parents, last = key.split(".")
    node: Any = table
    try:
        for name in parents:
            node = node[int(name)] if isinstance(node, list) else node.setdefault(name, {})
        if isinstance(node, list):
            node[int(last)] = value
        else:
            node[last] = value
    except (ValueError, IndexError, TypeError, AttributeError):
        raise CaseError(
            f"{shown_key(key)}: does not lead to a value of the case; write keys and numbers of list entries with dots"
        ) from None


def nearest(word: str, known: Iterator[str] | list[str]) -> str:
    """Return `did you mean 'x'?` for the closest known word, or the list of known ones."""
    known = sorted(known)
    if not known:
        return "there are none"
    close = closest(word, known)
    return f"did you mean '{close}'?" if close else f"known: {', '.join(known)}"


def closest(word: str, known: list[str]) -> str:
    """Return the known word that is most like another one; the empty text if none is."""
    return next(iter(difflib.get_close_matches(word, sorted(known), n=1, cutoff=0.6)), "")


class _UnknownKey(NamedTuple):
    """Value in the place of that of an unknown key: pydantic refuses it together with all other errors of the table."""

    key: str
    known: list[str]


class Bound:
    """Number type of a field that may vary: its bounds also apply to the values of a profile."""

    def __init__(self, number: Any) -> None:
        self._type = TypeAdapter(number)

    def check(self, key: str, values: np.ndarray, position: np.ndarray) -> None:
        """Refuse values outside the bound.

        Raises
        ------
        CaseError
            Names the key, the value and the place.
        """
        for extreme in (np.argmin, np.argmax) if len(values) else ():
            place = int(extreme(values))
            try:
                self._type.validate_python(float(values[place]))
            except ValidationError as error:
                problem = error.errors()[0]
                reason = problem["msg"].removeprefix("Value error, ")
                remedy = "" if problem["type"] == "value_error" else "; change the profile"  # else it has its own
                where = f"position {', '.join(f'{x:.6g}' for x in np.atleast_1d(position[place]))} m"
                raise CaseError(
                    f"{key} = {values[place]:.6g} at {where}: {reason[0].lower()}{reason[1:]}{remedy}"
                ) from None


if TYPE_CHECKING:
    _Reworded = type
else:

    class _Reworded(type(BaseModel)):  # pydantic has no public name for it
        """Makes ``Coulomb(mu_d=-1.0)`` in Python raise the same `CaseError` as a case file does."""

        def __call__(cls, *args: object, **values: object) -> Any:
            try:
                return super().__call__(*args, **values)
            except ValidationError as error:
                raise CaseError.from_validation(error, cls.__name__) from None


_INTERNAL = {"choices", "copied", "former_keys", "hash_in", "loaded", "needs", "read_sums", "set_sums", "substituted"}
"""Methods of parts and cases that only the package calls: no completion offers them."""


class Part(BaseModel, metaclass=_Reworded):
    """One table of a case: immutable, strictly typed; an unknown key is an error that names the nearest one."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        arbitrary_types_allowed=True,
        validate_default=True,
    )

    former_keys: ClassVar[Mapping[str, str]] = {}
    """Keys by their names in the last version."""
    needs: ClassVar[frozenset[str]] = frozenset()
    """Capabilities that the stepper of a case must offer to this part."""

    def unit_of_field(self, name: str) -> str:
        """Return the unit of a field, which may depend on others."""
        return unit_of(type(self), name)

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema with descriptions of the keys and of `kind`."""
        schema = handler(core)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for name, text in {"kind": first_line(cls), **descriptions(cls)}.items():
            if name in properties:
                properties[name].setdefault("description", text)
        return schema

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, values: object) -> object:
        if isinstance(values, Mapping):
            values = {key: plain(value) for key, value in values.items()}
            for former in [key for key in values if key in cls.former_keys and cls.former_keys[key] not in values]:
                name = cls.former_keys[former]
                warn_of_former("the key", former, name)
                values[name] = values.pop(former)
            known = list(cls.model_fields)
            values |= {key: _UnknownKey(str(key), known) for key in values if key not in cls.model_fields}
        return values

    def __setattr__(self, name: str, value: object) -> None:
        if name not in type(self).model_fields:
            super().__setattr__(name, value)
            return
        key = f"'{name}'" if hasattr(self, "changed") else f"'TABLE.{name}'"
        raise CaseError(
            f"{name} = {shown_value(value)}: cases do not change; write  case = case.changed({key}, "
            f"{shown_value(value)})  for another one" + ", with the dotted key as after --set" * ("." in key)
        )

    def __dir__(self) -> list[str]:
        """Return the own keys and methods for completion, without those of pydantic and of the package itself."""
        hidden = set(dir(BaseModel)) - {"model_copy"} | _INTERNAL
        return sorted(name for name in super().__dir__() if not name.startswith("__") and name not in hidden)

    def files(self) -> list[Path]:
        """Return the files that a run reads, and a resumed one again; without those of the parts inside."""
        values = {name: getattr(self, name) for name in type(self).model_fields if has_mark(type(self), name, RunFile)}
        return [Path(value) for value in values.values() if isinstance(value, str)]

    def at(self, position: np.ndarray) -> Self:
        """Return the part with every profile evaluated at the points.

        Parameters
        ----------
        position : ndarray, shape (n,) or (n, 2)
            Positions along a line or on a surface [m].
        """
        changes: Table = {}
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            # A part that can be called but has no values over an interface is a history.
            if hasattr(value, "over") or (callable(value) and not isinstance(value, Part)):
                try:
                    changes[name] = getattr(value, "over", value)(position)
                except CaseError as error:
                    raise CaseError(f"{type(self).__name__}.{name}: {error}") from None
                for bound in (item for item in _marks(field) if isinstance(item, Bound)):
                    bound.check(f"{type(self).__name__}.{name}", changes[name], position)
            elif isinstance(value, Part):
                changes[name] = value.at(position)
        return self.substituted(changes) if changes else self

    def substituted(self, changes: Table) -> Self:
        """Return the part with unchecked values of other types: arrays at points, expressions."""
        return super().model_copy(update=changes)

    def model_copy(self, *, update: Mapping[str, object] | None = None, deep: bool = False) -> Self:
        """Return the part with other values, checked as if they came from a case.

        Raises
        ------
        CaseError
        """
        if not update:
            return super().model_copy(deep=deep)
        entries = {name: value for name, value in self if name in self.model_fields_set}
        return type(self)(**{**entries, **update})


@cache
def _classes_of(source: str) -> dict[str, list[ast.stmt]]:
    """Return the statements in the classes of a file, by the qualified names of the classes.

    `inspect.getsource` parses the file anew for each class.
    """
    result: dict[str, list[ast.stmt]] = {}

    def collect(parent: ast.AST, prefix: str) -> None:
        for node in ast.iter_child_nodes(parent):
            name = f"{prefix}{node.name}" if isinstance(node, ast.ClassDef | ast.FunctionDef) else ""
            if isinstance(node, ast.ClassDef):
                result[name] = node.body
            collect(node, f"{name}." if name else prefix)

    collect(ast.parse(source), "")
    return result


@cache
def descriptions(part: type[Part]) -> dict[str, str]:
    """Return the docstrings of the fields of a part; cached, because its source is parsed.

    The option of pydantic for it, `use_attribute_docstrings`, parses the source of every part when it is imported.
    """
    entries: dict[str, str] = {}
    for cls in reversed(part.__mro__):
        if cls is Part or not issubclass(cls, Part):
            continue
        try:
            file = inspect.getfile(cls)
            linecache.checkcache(file)
            classes = _classes_of("".join(linecache.getlines(file)))
        except (OSError, TypeError, SyntaxError):  # defined without a file
            continue
        definition = classes.get(cls.__qualname__.replace("<locals>.", ""), [])
        for field, text in pairwise(definition):
            match field, text:
                case ast.AnnAssign(target=ast.Name(name)), ast.Expr(ast.Constant(str(said))):
                    entries[name] = inspect.cleandoc(said)
    return {name: entries[name] for name in part.model_fields if name in entries}


class Alternative(Part):
    """A part chosen by ``kind``: the name of its file; for plug-ins the name of its class."""

    example: ClassVar[str] = ""
    """Example as an inline table of TOML. Of a law or a material, whose contract tests take random numbers without one:
    numbers that fit together; tests multiply those of one unit by one factor."""
    former_kinds: ClassVar[tuple[str, ...]] = ()
    """Kinds of the class in the last version."""
    former_attributes: ClassVar[Mapping[str, str]] = {}
    """Methods and class attributes of the contract by their names in the last version, which plug-ins may still use."""
    offers: ClassVar[frozenset[str]] = frozenset()
    """Capabilities of the class, which other parts of a case need."""
    offers_with: ClassVar[Mapping[str, str]] = {}
    """Optional methods of the contract, and the capability that a class offers by writing one."""
    needs_with: ClassVar[Mapping[str, str]] = {}
    """Optional methods and flags of the contract, and the capability that a class needs by writing or setting one."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # The contract itself writes every method: its own maps hold for the classes below it.
        above: Any = super(cls, cls)
        written = _written(cls)
        cls.offers |= {capability for name, capability in above.offers_with.items() if name in written}
        cls.needs |= {capability for name, capability in above.needs_with.items() if name in written}
        for former, name in cls.former_attributes.items():
            if former in vars(cls) and name not in vars(cls):
                warn_of_former(f"of {cls.__name__} the attribute", former, name)
                setattr(cls, name, vars(cls)[former])

    @classmethod
    def kind(cls) -> str:
        """Return the ``kind`` of the class."""
        return kind_in(cls)

    @classmethod
    def summary(cls) -> str:
        """Return the first line of the docstring."""
        return first_line(cls)

    @model_serializer(mode="wrap")
    def _with_kind(self, handler: Any) -> dict[str, object]:  # not Table, which a profile is called, too
        return {"kind": self.kind(), **handler(self)}


def _written(cls: type[Part]) -> set[str]:
    """Return the names in the body of a class and of classes without a kind that it mixes in; flags that are set."""
    mixed_in = [each for base in cls.__bases__ if not issubclass(base, Part) for each in base.__mro__]
    return {name for body in (cls, *mixed_in) for name, value in vars(body).items() if value is not False}


plugged: ContextVar[Mapping[str, Mapping[str, type]]] = ContextVar("plugged", default={})  # noqa: B039
"""Classes of the plug-ins of the case at hand, by package and kind."""


def kind_in(cls: type) -> str:
    """Return the ``kind`` of a class: the name of its file in a folder of this package; elsewhere MyLaw is `my_law`."""
    if cls.__module__.startswith("ruptfx."):
        return cls.__module__.rpartition(".")[2]
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", cls.__name__).lower()


def home(cls: type) -> str | None:
    """Return the package of the contract of a class, `ruptfx.laws.friction` for friction laws; None if it has none."""
    for base in cls.__mro__[1:]:
        if Alternative in base.__bases__ or base.__module__ == "ruptfx.bodies.operators":
            return base.__module__
    return None


@cache
def directory_of(folder: str) -> Path:
    """Return where a folder of alternatives is, in one of the rooms of the package.

    Raises
    ------
    FileNotFoundError
        No room has it.
    """
    root = Path(__file__).parents[1]
    for init in (*root.glob(f"*/{folder}/__init__.py"), root / folder / "__init__.py"):
        if init.is_file():
            return init.parent
    raise FileNotFoundError(f"no folder {folder} in the rooms of {root}")


def package_of(folder: str) -> str:
    """Return the package of a folder of alternatives, ``ruptfx.laws.friction`` for ``friction``."""
    root = Path(__file__).parents[1]
    return ".".join((root.name, *directory_of(folder).relative_to(root).parts))


def own_kinds(package: str) -> list[str]:
    """Return the names of the files in a folder of alternatives, without those that its kinds share.

    The tuple `SHARED` of a folder names the files that other rooms use, too; the names of others begin with ``_``.
    `FORMER_KINDS` has those of them that cases of the last version name as kinds, and what to write now.
    """
    folder = importlib.import_module(package)
    shared = getattr(folder, "SHARED", ())
    return [name for name in _modules_in(*folder.__path__) if name not in shared]


@cache
def _modules_in(*folders: str) -> list[str]:
    """Return the names of the modules in folders; cached, because a case asks some hundred times."""
    return sorted(module.name for module in pkgutil.iter_modules(folders) if not module.name.startswith("_"))


@cache
def offered() -> dict[str, dict[str, EntryPoint]]:
    """Return the entry points of installed packages, by contract; cached, because one file per package is read."""
    entries: dict[str, dict[str, EntryPoint]] = {}
    for entry in entry_points():
        entries.setdefault(entry.group, {})[entry.name] = entry
    return entries


def group_of(package: str) -> str:
    """Return the group of entry points of a folder: ``ruptfx.friction`` for friction laws, wherever the folder is.

    Figures, whose folder is `plots`, have the group ``ruptfx.figures``.
    """
    folder = package.rpartition(".")[2]
    return f"ruptfx.{'figures' if folder == 'plots' else folder}"


def installed(package: str) -> dict[str, EntryPoint]:
    """Return the entry points of installed packages for a folder, by kind."""
    return offered().get(group_of(package), {})


def kinds(package: str) -> list[str]:
    """Return the kinds of a folder, for example ``kinds("ruptfx.laws.friction")``, with plug-ins and installed ones."""
    return sorted({*own_kinds(package), *installed(package), *plugged.get().get(package, {})})


def from_outside(package: str, kind: str) -> type | None:
    """Return the class of a ``kind`` from a plug-in or an installed package; None if there is none.

    Raises
    ------
    RuptfxError
        The package does not load, or its name is taken.
    """
    if kind in plugged.get().get(package, {}):
        return plugged.get()[package][kind]
    if kind not in installed(package):
        return None
    offer, cls = _loaded(package, kind)
    if not isinstance(cls, type) or home(cls) != package or kind_in(cls) != kind:
        raise RuptfxError(f"{offer} must be a class with the contract of {package} called '{kind}'")
    return cls


def _loaded(package: str, kind: str) -> tuple[str, object]:
    """Return what an installed package offers for a folder, after its name for messages.

    Raises
    ------
    RuptfxError
        It does not load, or its name is that of a file of the folder.
    """
    entry = installed(package)[kind]
    offer = f"entry point {group_of(package)} '{kind}' of {entry.dist.name if entry.dist else 'a package'}"
    if kind in own_kinds(package):
        raise RuptfxError(f"{offer}: would hide the '{kind}' that is there already; uninstall it")
    try:
        return f"{offer}: {entry.value}", entry.load()
    except Exception as error:
        raise RuptfxError(f"{offer}: {load_error(entry.module, error)}") from error


def module_of(package: str, kind: str) -> ModuleType:
    """Return the module of a figure or movie, a file of the folder or one of an installed package.

    Raises
    ------
    RuptfxError
        It does not load, or has no function of that name.
    """
    if kind not in installed(package):
        return own_module(package, kind)
    offer, module = _loaded(package, kind)
    if not isinstance(module, ModuleType) or not callable(getattr(module, kind, None)):
        raise RuptfxError(f"{offer} must be a module with a function '{kind}', as the files of {package}")
    return module


def load_error(file: str | Path, error: BaseException) -> str:
    """Return the message of an error during the loading of a file, with its line."""
    line = error.lineno if isinstance(error, SyntaxError) else None
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(file):
            line = trace.tb_lineno
        trace = trace.tb_next
    reason = str(error) if isinstance(error, RuptfxError) else f"{type(error).__name__}: {error}"
    return f"{file}, line {line}: {reason}" if line else f"{file}: {reason}"


def find(package: str, kind: str) -> type[Alternative]:
    """Return the class of a ``kind`` in a folder of alternatives.

    Raises
    ------
    PydanticCustomError
        No file of that name; the nearest one is named.
    RuptfxError
        A file that does not load, with the line.
    """
    if (cls := from_outside(package, kind)) is not None:
        assert issubclass(cls, Alternative)
        return cls
    former = getattr(importlib.import_module(package), "FORMER_KINDS", {})
    if kind in former:
        warn_of_former(f"in {package} the kind", kind, former[kind])
    elif kind not in own_kinds(package):
        for name in own_kinds(package):
            if kind in _former_kinds(package, name):
                warn_of_former(f"in {package} the kind", kind, name)
                return find(package, name)
        words = {"kind": shown_key(kind), "hint": nearest(kind, kinds(package))}
        raise PydanticCustomError("unknown_kind", "unknown kind '{kind}', {hint}", words)
    module = own_module(package, kind)
    classes = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Alternative) and value.__module__ == module.__name__
    ]
    if len(classes) != 1:
        raise RuptfxError(f"{module.__name__} must define exactly one alternative, found {len(classes)}")
    return classes[0]


def own_module(package: str, kind: str) -> ModuleType:
    """Import a file of a folder of alternatives.

    Raises
    ------
    RuptfxError
        It does not load.
    """
    try:
        return importlib.import_module(f"{package}.{kind}")
    except Exception as error:
        result = find_spec(f"{package}.{kind}")
        raise RuptfxError(load_error(result.origin if result and result.origin else kind, error)) from error


def alternatives(package: str) -> dict[str, type[Alternative]]:
    """Return every alternative of a folder that loads, by kind."""
    return {kind: cls for kind in kinds(package) if isinstance(cls := _attempt(package, kind), type)}


def broken(package: str) -> dict[str, str]:
    """Return the reason why each other file of a folder does not load, by kind."""
    return {kind: error for kind in kinds(package) if isinstance(error := _attempt(package, kind), str)}


def _attempt(package: str, kind: str) -> type[Alternative] | str:
    try:
        return find(package, kind)
    except RuptfxError as error:
        return str(error)


def _former_kinds(package: str, kind: str) -> tuple[str, ...]:
    """Return the former kinds of an alternative; none if it does not load."""
    cls = _attempt(package, kind)
    return vars(cls).get("former_kinds", ()) if isinstance(cls, type) else ()  # not those of the class it extends


class OwnJsonSchema(WithJsonSchema):
    """JSON schema of a field type, a copy for every field: pydantic 2.10 writes the default of a field into it."""

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return copy.deepcopy(super().__get_pydantic_json_schema__(core, handler))


_FOLDER = "x-folder"  # placeholder of a folder's `$ref`, which pydantic would refuse as unknown


def alternative(package: str) -> Any:
    """Return the field type of a folder: any of its alternatives, as an object or a table with ``kind``."""

    def choose(value: object, info: ValidationInfo) -> object:
        if isinstance(value, str):
            value = {"kind": value}
        if not isinstance(value, Mapping):
            return value
        others = dict(value)
        kind = others.pop("kind", None)
        if not isinstance(kind, str):
            raise PydanticCustomError(
                "unknown_kind", "'kind' is required, one of: {known}", {"known": ", ".join(kinds(package))}
            )
        return find(package, kind).model_validate(others, context=info.context)

    folder = package.rpartition(".")[2]
    return Annotated[
        SerializeAsAny[Alternative],
        BeforeValidator(choose),
        OwnJsonSchema({_FOLDER: folder}),
    ]


def _one_or_several(schema: Table) -> None:
    array = {key: schema.pop(key) for key in ("type", "items")}
    schema["anyOf"] = [array, array["items"]]


ONE_OR_SEVERAL = Field(json_schema_extra=_one_or_several)
"""Of a list for which one table may stand: so says its JSON schema."""


def by_kind(*kinds: str) -> Discriminator:
    """Return the choice between the parts of a union by their key `kind`; each has a tag, `Tag("<KIND>")`."""

    def tag(value: object) -> str:
        return f"<{value.get('kind') if isinstance(value, Mapping) else getattr(value, 'kind', None)}>"

    message = f"a table is needed whose 'kind' is one of: {', '.join(kinds)}"
    return Discriminator(tag, custom_error_type="unknown_kind", custom_error_message=message)


def by_name(folder: str, names: list[str]) -> Table:
    """Return the JSON schema of an alternative of a folder, a name, or a table with a key `name`."""
    name = {"enum": names, "description": "Whose constants are used where the table gives none."}
    named = {"type": "object", "properties": {"name": name}, "required": ["name"]}
    return {"anyOf": [{_FOLDER: folder}, {"enum": names}, named]}


def json_schema(root: type[Part], packages: list[str]) -> Table:
    """Return the JSON schema of a case, with one ``oneOf`` under ``$defs`` per folder of alternatives."""
    schema = root.model_json_schema()
    definitions = schema.setdefault("$defs", {})
    for package in packages:
        choices = []
        for kind, cls in alternatives(package).items():
            entry = cls.model_json_schema(mode="validation")
            definitions.update(entry.pop("$defs", {}))
            what = {"const": kind, "description": first_line(cls)}
            entry["properties"] = {"kind": what, **entry.get("properties", {})}
            entry["required"] = ["kind", *entry.get("required", [])]
            choices.append(entry)
        definitions[package.rpartition(".")[2]] = {"oneOf": choices}

    def link(node: object) -> Any:
        if isinstance(node, dict):
            entries = {"$ref": f"#/$defs/{node[_FOLDER]}"} if _FOLDER in node else {}
            return entries | {key: link(value) for key, value in node.items() if key != _FOLDER}
        return [link(item) for item in node] if isinstance(node, list) else node

    return link(schema)


def first_line(described: object) -> str:
    """Return the first line of a docstring."""
    return (described.__doc__ or "").strip().partition("\n")[0]


NUMBER = r"^\s*[-+.0-9]"
"""How text begins that is a number with a unit."""


def or_text(schema: JsonSchemaValue, description: str) -> JsonSchemaValue:
    """Return the JSON schema of numbers that may be text with a unit, alone or in a list."""
    text = {"type": "string", "pattern": NUMBER, "description": description}
    if schema.get("type") == "number":
        return {"anyOf": [schema, text]}
    if schema.get("type") == "array":
        return schema | {"items": {"anyOf": [schema["items"], text]}}
    for choices in schema.keys() & {"oneOf", "anyOf"}:
        lists = [or_text(each, description) if each.get("type") == "array" else each for each in schema[choices]]
        schema = schema | {choices: [*lists, text]}
    return schema


class Unit(str):
    """Unit of a field, as metadata of its type: ``Annotated[float, Unit("m")]``; text like "3 mm" becomes a number."""

    __slots__ = ()

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self.read, handler(source))

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return or_text(handler(core), f"A number and its unit, as '2 {self}'.")

    def read(self, value: object) -> object:
        """Convert text with a unit to a number, alone or in a list; return everything else unchanged.

        Raises
        ------
        ValueError
        """
        if isinstance(value, str):
            return parse(value, self)
        return [self.read(item) for item in value] if isinstance(value, list) else value


def unit_of(part: type[Part], name: str) -> str:
    """Return the unit of a field, `1` if it has none."""
    items = [item for item in _marks(part.model_fields[name]) if isinstance(item, Unit)]
    return str(items[0]) if items else "1"


def unit_of_key(case: Part, key: str) -> str:
    """Return the unit of a dotted key of a case; 1 if the key is not a number of a part.

    Values of a profile have the unit of the key that varies.
    """
    node: object = case
    unit = "1"
    for name in key.split("."):
        if isinstance(node, Mapping):
            node = node.get(name)
        elif isinstance(node, list):
            number = "0" if name == "*" else name  # of all entries, which have one unit
            inside = number.lstrip("-").isdecimal() and -len(node) <= int(number) < len(node)
            node = node[int(number)] if inside else None
        elif isinstance(node, Part) and name in type(node).model_fields:
            unit = unit if has_mark(type(node), name, OfKey) else node.unit_of_field(name)
            node = getattr(node, name)
        else:
            return "1"
    return unit


class OfKey:
    """Mark of fields of profiles with the unit of the key that varies."""

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        text = {"type": "string", "pattern": NUMBER, "description": "A number and the unit of the key."}
        return {"anyOf": [handler(core), text]}


def has_mark(part: type[Part], name: str, mark: type) -> bool:
    """Return whether the type of a field has metadata of a class."""
    return any(isinstance(item, mark) for item in _marks(part.model_fields[name]))


def _marks(field: FieldInfo) -> list[object]:
    """Return the metadata of a field; those of an optional field are inside its union with None."""
    inner = [item for member in get_args(field.annotation) for item in getattr(member, "__metadata__", ())]
    return [*field.metadata, *inner]


class RunFile:
    """Mark of keys that name a file which a run reads; the resolved case contains the numbers of other files."""


def _resolve(path: object, info: ValidationInfo) -> object:
    return str(Path((info.context or {}).get("directory") or ".", path).absolute()) if isinstance(path, str) else path


CasePath = Annotated[str, BeforeValidator(_resolve), RunFile()]
"""A file named in a case, relative to the case file; absolute in the resolved case."""
NAME = r"^[A-Za-z][A-Za-z0-9_]*$"
Name = Annotated[str, Field(pattern=NAME)]
