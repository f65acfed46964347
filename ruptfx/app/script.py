"""What scripts that run cases begin and end with: check of arguments and outputs, one voice for all ranks."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from ruptfx import RuptfxError
from ruptfx.input.quantities import parse, with_prefix
from ruptfx.platform.launch import end_all, is_first_rank
from ruptfx.results import directories

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read_words() -> list[str]:
    """Return the arguments of this script, and show errors of ruptfx without traceback from now on.

    There are none in a notebook, whose process has arguments of its own.
    """
    main = getattr(sys.modules["__main__"], "__file__", None)
    is_script = main is not None and os.path.realpath(main) == os.path.realpath(sys.argv[0])
    if is_script:
        sys.excepthook = _shown
    return sys.argv[1:] if is_script else []


def read_number(text: str, what: str, unit: str) -> float:
    """Return a positive number from an argument, in a unit, such as `2e-3` or `"2 mm"` in m.

    Parameters
    ----------
    text : str
        The argument.
    what : str
        What it is, in errors.
    unit : str
        Unit of numbers without one.

    Raises
    ------
    RuptfxError
        If it is no positive number, or has a unit of another kind.
    """
    try:
        value = float(text)
    except ValueError:
        try:
            value = parse(text, unit)
        except ValueError as error:
            raise RuptfxError(f"{what} {text!r}: {error}") from None
    if not 0 < value < math.inf:
        raise RuptfxError(f"{what} {text!r}: must be a positive number of {unit}, such as 2 or '2 {unit}'")
    return value


def begin(*outputs: str | Path, ranks: bool = True, words: Sequence[str] = ()) -> None:
    """Check arguments and that outputs can be written before any computation; show errors of ruptfx without traceback.

    Under `mpirun` only the first rank prints.

    Parameters
    ----------
    outputs : str or Path
        Run directories, whose runs will be replaced with `overwrite=True`, and files or folders of results.
    ranks : bool
        False if the script has no use for more than one rank, as lumped models: the others end here.
    words : sequence of str
        Arguments that the script has read by `read_words`; others are refused.

    Raises
    ------
    RuptfxError
        If there is another argument, or an output is not writable or contains files other than a run.
    """
    sys.excepthook = _shown
    if unknown := " ".join(read_words()[len(words) :]):
        known = f"no more arguments than {' '.join(words)}" if words else "no arguments"
        raise RuptfxError(f"{unknown}: {Path(sys.argv[0]).name} takes {known}; run it without {unknown}")
    if not is_first_rank():
        if not ranks:
            raise SystemExit(0)
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - until the end of the process
    for path in map(Path, outputs):
        there = next(place for place in (path, *path.absolute().parents) if place.exists())
        if not os.access(there, os.W_OK) or not (there.is_dir() or there == path):
            raise RuptfxError(f"{path}: cannot be written ({there}); run the script in another directory")
        if (path / "case.toml").exists():
            directories.check_replaceable(path)


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure on the first rank, and say where it is.

    Parameters
    ----------
    path : str or Path
        Its folder is made if it is missing.
    """
    if is_first_rank():
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=200)
        print(f"picture: {path}")


def save_numbers(folder: str | Path, numbers: Mapping[str, str | float | tuple[float, str]]) -> None:
    """Write numbers as `numbers.json` on the first rank, and print them: pages of the site and tests read that file.

    Parameters
    ----------
    folder : str or Path
        It is made if it is missing.
    numbers : mapping of str to str, float or (float, str)
        Results by name: a word, a pure number, or a number with its unit.
    """
    if is_first_rank():
        rows = {
            name: value if isinstance(value, str) else [float(value[0]), value[1]] if isinstance(value, tuple)
            else float(value) for name, value in numbers.items()
        }  # fmt: skip
        Path(folder).mkdir(parents=True, exist_ok=True)
        Path(folder, "numbers.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        for name, value in numbers.items():
            print(f"{name}: {number_text(value)}")


def number_text(value: str | float | tuple[float, str] | list[Any]) -> str:
    """Return a result of `save_numbers` as text, with its unit."""
    if isinstance(value, str):
        return value
    number, unit = (value, "") if isinstance(value, float | int) else value
    if unit in ("m", "s"):
        return with_prefix(number, unit)
    digits = ".0f" if 1e3 <= abs(number) < 1e5 else ".3g"  # no power of ten for speeds and the like
    return f"{number:{digits}} {unit}".rstrip()


def _shown(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print an error of ruptfx, which all ranks have, in one line; of others the traceback, and end all ranks."""
    if isinstance(error, RuptfxError):
        if is_first_rank():
            sys.stderr.write(f"error: {error}\n")
        return
    sys.__excepthook__(kind, error, trace)
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is not None and mpi.COMM_WORLD.size > 1:
        end_all(mpi.COMM_WORLD)
