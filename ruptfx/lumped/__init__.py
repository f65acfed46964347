"""Lumped models: a few masses and springs, with results in a dataset, read from the same kind of case file.

One model per file or package, whose name is the top-level `kind` of the case. They need neither DOLFINx nor MPI.
"""

from __future__ import annotations

import importlib
import io
import math
import shlex
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import copy_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ruptfx import RuptfxError, Table, __version__
from ruptfx.input.plugins import CaseFile, active, named
from ruptfx.input.schema import Alternative, CaseError, Part, find, kinds, load_toml_file
from ruptfx.platform import run_files
from ruptfx.results.directories import is_finished, prepare, refuse_links, replace, reserved
from ruptfx.results.hdf5 import write_netcdf

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

FAR = 1e5  # times the default: larger ratios count as extreme
FAR_AT_ALL = 1e12  # limit for numbers without a default, in SI units
TRIAL = 10.0  # seconds that `ruptfx check` computes for at most
Progress = Callable[[float, str], None]
Summary = Table


def silent(fraction: float, message: str) -> None:
    """Ignore the progress."""


class LumpedModel(CaseFile, Alternative):
    """Contract of a lumped model; parameters are the fields of the subclass, keys of the case file."""

    example: ClassVar[str] = ""
    """A case file of a second or less, without `kind`; the contract tests run it."""

    title: str = ""
    """Title of figures."""

    @property
    def recovers(self) -> bool:
        """True if a run recovers parameters from data, so that `ruptfx infer` takes the case."""
        return False

    def run(self, progress: Progress = silent) -> xarray.Dataset:
        """Return the full result, with units and names; random draws have a seed.

        Parameters
        ----------
        progress : callable
            Called with the finished fraction of the work and a line of text.
        """
        raise NotImplementedError

    def constants(self) -> dict[str, float | str]:
        """Return numbers that are known before the model is computed, by name, in SI units."""
        return {}

    @classmethod
    def figures(cls, dataset: xarray.Dataset) -> dict[str, Figure]:
        """Draw the figures of a result, by name, with `figures` of `figures.py` in its package."""
        drawn: dict[str, Figure] = importlib.import_module(f"{cls.__module__}.figures").figures(dataset)
        return drawn

    @staticmethod
    def summarise(dataset: xarray.Dataset) -> Summary:
        """Return the scalars of a result, ready for JSON: the 0-d variables and attributes of the dataset."""
        scalars = {str(name): v.item() for name, v in dataset.data_vars.items() if v.ndim == 0}
        return union(scalars, dataset.attrs)


def variable(dims: object, values: object, units: str, long_name: str) -> tuple[object, object, dict[str, str]]:
    """Return a variable of a dataset: dimensions, values, and attributes for units and name."""
    return dims, values, {"units": units, "long_name": long_name}


def union(first: Summary, second: Summary) -> Summary:
    """Return the entries of both tables.

    Raises
    ------
    RuptfxError
        A name is in both tables, so that one entry would replace the other.
    """
    if names := sorted(map(str, first.keys() & second.keys())):
        raise RuptfxError(f"two results have one name: {', '.join(names)}; give each result of a model its own name")
    return {**first, **second}


def simulate(
    model: LumpedModel, out: str | Path, progress: Progress = silent, resume: bool = False, overwrite: bool = False
) -> xarray.Dataset:
    """Run a model and write its directory: case, result, figures and, last, the summary that marks it complete.

    Parameters
    ----------
    model : LumpedModel
    out : str or Path
        Directory to create; may exist if empty. ``result.nc`` in it opens with `read_result`.
    progress : callable
        See `LumpedModel.run`.
    resume : bool
        Keep a finished run of this model; start an interrupted one again.
    overwrite : bool
        Replace the run in `out`, of any case, once this one is complete; other files stay.

    Raises
    ------
    RuptfxError
        If the directory contains other files, or another process writes there.
    """
    out = Path(out)
    if resume:
        refuse_links(out)
    if resume and is_finished(out, model):
        return read_result(out)
    with reserved(out):
        place = prepare(out, again=model if resume else None, overwrite=overwrite)
        dataset = _run(model, place, progress)
        replace(out)
    return dataset


def _run(model: LumpedModel, out: Path, progress: Progress) -> xarray.Dataset:
    """Run a model in a directory that is ready, and write all files."""
    (out / "figures").mkdir(exist_ok=True)
    model.save(out)
    run_files.begin(out, ["result.nc", run_files.SUMMARY])
    with _solvable(model):
        start = time.perf_counter()
        dataset = _finite(model, progress)
        elapsed = time.perf_counter() - start
        write_netcdf(dataset, out / "result.nc", _compression(dataset))
        progress(1.0, "drawing figures")
        run_files.add(out, _draw(type(model), dataset, out / "figures", ("png",)))
        summary = model.summarise(dataset)
    about = {"kind": model.kind(), "case_hash": model.hash, "ruptfx": __version__, "run_time": elapsed}
    run_files.complete(out, _plain(union(summary, about)))
    return dataset


@contextmanager
def _solvable(model: LumpedModel) -> Iterator[None]:
    """Convert numerical errors of integrators and linear algebra into one that names extreme parameters.

    Raises
    ------
    RuptfxError
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except RuptfxError as error:
        far = list(extreme(model))
        if type(error) is not RuptfxError or not far:
            raise
        raise RuptfxError(f"{error}; far from the usual: {', '.join(far)}") from None
    except (ArithmeticError, ValueError, IndexError, MemoryError) as error:
        far = list(extreme(model))
        remedy = f"far from the usual: {', '.join(far)}" if far else "bring its parameters nearer to their defaults"
        raise RuptfxError(f"{model.kind()}: it cannot be computed with these numbers ({error}); {remedy}") from error


def _finite(model: LumpedModel, progress: Progress) -> xarray.Dataset:
    """Return the result of a model.

    Raises
    ------
    ArithmeticError
        A number in it is infinite.
    RuptfxError
        A variable and an attribute have one name.
    """
    dataset = model.run(progress)
    union({str(name): values for name, values in dataset.variables.items()}, dataset.attrs)
    for name, values in dataset.variables.items():
        if values.dtype.kind == "f" and np.isinf(values.values).any():
            raise ArithmeticError(f"{name} is infinite")
    return dataset


def rehearse(model: LumpedModel, limit: float = TRIAL) -> bool:
    """Compute a model and its figures as `simulate` does, without files, and return whether that ended in time.

    The parameters that make a model fail are found by its integrators only, so it is computed.

    Parameters
    ----------
    model : LumpedModel
    limit : float
        Wall time [s].

    Raises
    ------
    RuptfxError
        The error with which `simulate` refuses the model.
    """
    late = threading.Event()
    failed: list[BaseException] = []

    def progress(fraction: float, message: str) -> None:
        if late.is_set():
            raise SystemExit  # of the thread

    def compute() -> None:
        try:
            with _solvable(model):
                dataset = _finite(model, progress)
                for figure in type(model).figures(dataset).values():
                    progress(1.0, "drawing")  # matplotlib's caches are no place for two threads
                    figure.savefig(io.BytesIO(), dpi=50)
                model.summarise(dataset)
        except BaseException as error:
            failed.append(error)

    # A thread, because integrators report no progress within one solution; what runs too long ends with the program.
    thread = threading.Thread(target=copy_context().run, args=(compute,), daemon=True)
    thread.start()
    thread.join(limit)
    if thread.is_alive():
        late.set()
        return False
    for error in failed:
        raise error
    return True


def extreme(part: Part, usual: Part | None = None, key: str = "") -> Iterator[str]:
    """Yield the numbers of a part that are far from their defaults, as `key = value (usual default)`.

    Parameters
    ----------
    part : Part
    usual : Part, optional
        Default of the part itself.
    key : str
        Key of the part, with a trailing dot.
    """
    for name, field in type(part).model_fields.items():
        value = getattr(part, name)
        default = getattr(usual, name) if type(usual) is type(part) else field.get_default(call_default_factory=True)
        if isinstance(value, Part):
            yield from extreme(value, default if isinstance(default, Part) else None, f"{key}{name}.")
            continue
        numbers, known = (
            [float(item) for item in (each if isinstance(each, list) else [each])
             if isinstance(item, int | float) and not isinstance(item, bool)]
            for each in (value, default)
        )  # fmt: skip
        sizes = [abs(number) for number in known if number]
        low, high = (min(sizes) / FAR, max(sizes) * FAR) if sizes else (1 / FAR_AT_ALL, FAR_AT_ALL)
        for number, item in enumerate(numbers):
            if item and not low <= abs(item) <= high:
                where = f"{key}{name}.{number}" if isinstance(value, list) else f"{key}{name}"
                yield f"{where} = {item:g}" + (f" (usual {known[min(number, len(known) - 1)]:g})" if known else "")


def read_result(run: str | Path) -> xarray.Dataset:
    """Return the full result of a finished run, as returned by `LumpedModel.run`.

    Raises
    ------
    RuptfxError
        If the directory contains no result of a lumped model.
    """
    import xarray

    path = Path(run) / "result.nc"
    if not path.is_file():
        raise RuptfxError(f"{run}: no result.nc in it; give a directory that 'ruptfx run' of a lumped model wrote")
    run_files.check(Path(run), path.name)
    # Keep durations as numbers of seconds.
    return xarray.load_dataset(path, engine="h5netcdf", decode_times=False, decode_timedelta=False)


def redraw(
    run: str | Path, formats: Sequence[str] = ("png",), trust: bool = False, directory: Path | None = None
) -> list[Path]:
    """Draw the figures of a finished run again and return their paths.

    Parameters
    ----------
    run : path
    formats : sequence of str
        File types.
    trust : bool
        Run the plug-ins of the run if one of them defines the model.
    directory : Path, optional
        Output directory; default is ``figures`` in the run directory.

    Raises
    ------
    RuptfxError
        The directory is no run of a lumped model, or a plug-in defines it and is not trusted.
    """
    dataset = read_result(run)
    try:
        table = load_toml_file(Path(run) / "case.toml")
        kind = table["kind"]
    except (CaseError, KeyError) as error:
        raise RuptfxError(f"{run}: case.toml is missing or damaged ({error}); run the case again") from None
    known = kind in kinds("ruptfx.lumped")
    if table.get("plugins") and not (known or trust):
        raise RuptfxError(
            f"{run}: a plug-in ({', '.join(map(str, table['plugins']))}) defines the model '{kind}' and draws its "
            f"figures; if you trust it: ruptfx plot {shlex.quote(str(run))} --trust"
        )
    with active([] if known else named(table, Path(run))):
        cls = find("ruptfx.lumped", kind)
    assert issubclass(cls, LumpedModel)
    return _draw(cls, dataset, directory or Path(run) / "figures", formats)


def _draw(cls: type[LumpedModel], dataset: xarray.Dataset, out: Path, formats: Sequence[str]) -> list[Path]:
    paths = []
    for name, figure in cls.figures(dataset).items():
        for suffix in formats:
            paths.append(out / f"{name}.{suffix}")
            figure.savefig(paths[-1], dpi=200)
    return paths


def _compression(dataset: xarray.Dataset) -> dict[object, Table]:
    large = [name for name, values in dataset.variables.items() if values.size > 10_000 and values.dtype.kind in "fiu"]
    return {name: {"zlib": True, "complevel": 4} for name in large}


def _plain(value: object) -> Any:
    """Convert to JSON types; NaN and infinity become null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
