"""Shared parts of the commands: consoles, arguments, errors as messages."""

from __future__ import annotations

import os
import shlex
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TextIO

import typer

from ruptfx import RuptfxError
from ruptfx.input.former_names import FormerName
from ruptfx.platform.terminal import console

if TYPE_CHECKING:
    from mpi4py import MPI
    from rich.console import Console

    from ruptfx.results.outputs import Outputs

screen = console()
errors = console(stderr=True)

PIPE = 10_000  # columns of an output that is no terminal: each row of a table is one line


def table_console() -> Console:
    """Return the console of tables, as wide as they are where the output is neither a terminal nor has COLUMNS."""
    return screen if screen.is_terminal or "COLUMNS" in os.environ else console(width=PIPE)


CaseFile = Annotated[Path, typer.Argument(help="Case file (TOML).", show_default=False)]


def first_given(context: typer.Context, name: str) -> str | None:
    """Return the first argument of a command that is being completed, whose parameter has this name.

    The parser stops at an option that has no value yet, and leaves the arguments before it in `args`.
    """
    value = context.params.get(name) or next(iter(context.args), None)
    return None if value is None else str(value)


def keys(context: typer.Context, incomplete: str) -> list[str]:
    """Return the keys of the named case that begin with the typed text, for completion; also those not given in it."""
    from ruptfx.case import read_case, read_toml
    from ruptfx.input.schema import dotted_keys

    path = first_given(context, "case")
    if path is None or "=" in incomplete:
        return []
    result = set[str]()
    with suppress(RuptfxError):
        table = read_toml(Path(path))
        result.update(dotted_keys(table))
        if "plugins" not in table:  # whose code must not run at a Tab
            result.update(dotted_keys(read_case(path)))
    return sorted(f"{key}=" for key in result if key.startswith(incomplete))


Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="<key=value>",
        help='Replace a value of the case, e.g. mesh.element_size="2 mm"; repeatable.',
        autocompletion=keys,
    ),
]
Interface = Annotated[
    str | None,
    typer.Option(metavar="<name>", help="Of several interfaces the one to show; default: that with the largest slip."),
]
Overwrite = Annotated[
    bool,
    typer.Option("--overwrite", help="Also replace files that ruptfx did not write there, or that were changed since."),
]
EXIT_ERROR = RuptfxError.exit_code
PICTURES = ("png", "pdf", "svg", "eps", "jpg", "jpeg", "tif", "tiff", "webp")
"""Formats of single pictures, by the ending of the file."""


def begin(phase: str, show: bool = True) -> None:
    """Name the first phase of a command on standard error, before its modules are imported; not on launched ranks."""
    from ruptfx.platform import launch

    if show and launch.RANKS not in os.environ and launch.is_first_rank():
        errors.print(phase, soft_wrap=True)


@contextmanager
def reported(comm: MPI.Comm | None = None) -> Iterator[None]:
    """Print a RuptfxError as one message from one rank; print the traceback of other errors and end all ranks.

    Plug-ins are named before their code runs; on launched ranks the launcher has done so.
    """
    from ruptfx.input import plugins
    from ruptfx.input.schema import CaseError
    from ruptfx.platform import launch

    launched = launch.RANKS in os.environ
    token = None if launched else plugins.telling.set(_name_plugin)
    try:
        with _notes(shown=not launched):
            yield
        sys.stdout.flush()  # a closed pipe raises its error here, where it ends the command quietly
    except RuptfxError as error:
        if comm is None or comm.rank == 0:
            _print_error("case error" if isinstance(error, CaseError) else "error", error)
        if error.at_once:
            sys.stderr.flush()
            os._exit(error.exit_code)
        raise typer.Exit(error.exit_code) from None
    except SystemExit as left:
        if (exit_error := plugins.exit_error(left)) is None:
            raise
        _print_error("case error", exit_error)
        if comm is not None and comm.size > 1:
            launch.end_all(comm)
        raise typer.Exit(EXIT_ERROR) from None
    except Exception as error:
        from ruptfx.results.outputs import unwritable

        if isinstance(error, OSError) and (known := unwritable(Path(str(error.filename or "a file")), error)):
            _print_error("error", known)
            if comm is not None and comm.size > 1:
                launch.end_all(comm)
            raise typer.Exit(EXIT_ERROR) from None
        if comm is None or comm.size == 1:
            raise
        sys.stderr.write(traceback.format_exc())
        launch.end_all(comm)
    finally:
        if token is not None:
            plugins.telling.reset(token)


def writing(folder: Path, inputs: Iterable[Path] = (), overwrite: bool = False) -> Outputs:
    """Return the files that a command writes into a folder; those that it replaces are named on standard error."""
    from ruptfx.results.outputs import Outputs

    def tell(names: list[str]) -> None:
        shown = ", ".join(names) if len(names) < 6 else f"{', '.join(names[:3])} ... {names[-1]} ({len(names)} files)"
        errors.print(f"replacing in {folder}: {shown}", soft_wrap=True)

    return Outputs(folder, inputs, overwrite, tell)


def picture(path: Path) -> Path:
    """Return the path of a picture, with .png where it has no ending.

    Raises
    ------
    RuptfxError
        Its ending is no format of pictures.
    """
    if not path.suffix:
        return path.with_name(f"{path.name}.png")
    if path.suffix[1:].lower() not in PICTURES:
        raise RuptfxError(f"--out {path}: '{path.suffix}' is no format of pictures; known: .{', .'.join(PICTURES)}")
    return path


@contextmanager
def _notes(shown: bool) -> Iterator[None]:
    """Print warnings of former names as notes, each once; none if they are not to be shown."""
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(
            message: Warning | str, category: type[Warning], filename: str, lineno: int, file: TextIO | None = None,
            line: str | None = None,
        ) -> None:  # fmt: skip
            if issubclass(category, FormerName):
                errors.print(f"note: {message}", soft_wrap=True)
            else:
                usual(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        warnings.simplefilter("default" if shown else "ignore", FormerName)
        yield


def _print_error(label: str, error: Exception) -> None:
    errors.print(f"{label}: ", style="bold red", end="")
    errors.print(str(error), soft_wrap=True)


@contextmanager
def _name_plugin(path: Path) -> Iterator[list[str]]:
    """Name a plug-in on standard error: its file before its code runs, then its definitions."""
    report = list[str]()
    sys.stderr.write(f"plug-in {shlex.quote(str(path))}")
    sys.stderr.flush()
    try:
        yield report
    finally:
        sys.stderr.write("".join(f": {text}" for text in report) + "\n")
        sys.stderr.flush()


def seconds(option: str, text: str | None) -> float | None:
    """Return the time that an option gives as a number or with a unit [s]; None without the option.

    Raises
    ------
    RuptfxError
    """
    from ruptfx.input.quantities import parse

    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return parse(text, "s")
    except ValueError as error:
        raise RuptfxError(f"{option} {text}: {error}") from None


def runs(incomplete: str) -> list[str]:
    """Return run and study directories that begin with the typed text, and folders that lead to some."""
    parent, _, start = incomplete.rpartition("/")
    folder = Path(parent or ("/" if incomplete.startswith("/") else "."))
    items = []
    with suppress(OSError):
        for path in sorted(folder.iterdir()):
            if path.name.startswith(start) and not path.name.startswith(".") and path.is_dir():
                shown = incomplete[: len(incomplete) - len(start)] + path.name
                if _is_run(path):
                    items.append(shown)
                elif any(map(_is_run, path.iterdir())):
                    items.append(shown + "/")
    return [each for one in items for each in (runs(one) if one.endswith("/") and len(items) == 1 else [one])]


def _is_run(path: Path) -> bool:
    return any((path / name).is_file() for name in ("case.toml", "study.json"))


def runs_and_files(incomplete: str) -> list[str]:
    """Return the same with CSV files."""
    parent, _, start = incomplete.rpartition("/")
    result = runs(incomplete)
    with suppress(OSError):
        for path in sorted(Path(parent or ".").iterdir()):
            if path.name.startswith(start) and path.suffix.lower() in (".csv", ".txt", ".dat"):
                result.append(incomplete[: len(incomplete) - len(start)] + path.name)
    return result


def completed_from(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return a shell completion: the names, evaluated when the Tab key is hit, with the typed prefix."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]
