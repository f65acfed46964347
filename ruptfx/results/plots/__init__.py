"""Figures of a run, from its record; good enough for a paper and drawn without a display or DOLFINx.

A figure is one file of this folder, found by its name, or a module that a package offers as entry point, group
``ruptfx.figures``. Its function of the same name draws a `Record`, on a new figure
or into given axes, and returns the axes; its `suits` says which runs it is drawn for.

>>> from ruptfx import Record, plots                                                     # doctest: +SKIP
>>> plots.space_time(Record("out/impact")).figure.savefig("space_time.pdf")              # doctest: +SKIP
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ruptfx import RuptfxError
from ruptfx.input.schema import installed, kinds, module_of, own_kinds, own_module
from ruptfx.results.figure_style import save, style
from ruptfx.results.outputs import final, unwritable
from ruptfx.results.plots._sheet import Panels, Window, figure_of, pair, remarks
from ruptfx.results.record import Files, MissingFileError, OutsideError

__all__ = ["FIGURES", "Panels", "all_figures", "figure_of", "remarks", "save_all", "set_up", "style", "suits"]

Draw = Callable[..., Axes | Panels]

SHARED = ("surface_maps",)
"""Files of this folder that are no kinds."""
_FILES: dict[str, ModuleType] = {}
for _name in kinds(__name__):
    try:
        _FILES[_name] = module_of(__name__, _name)
    except RuptfxError as _error:
        if _name in own_kinds(__name__) and _name not in installed(__name__):
            raise
        warnings.warn(str(_error), stacklevel=2)  # one broken package does not keep the other figures from users
        if _name in own_kinds(__name__):
            _FILES[_name] = own_module(__name__, _name)
FIGURES: dict[str, Draw] = {name: getattr(file, name) for name, file in _FILES.items()}
"""The functions that draw, by name."""
globals().update(FIGURES)

if TYPE_CHECKING:

    def __getattr__(name: str) -> Draw: ...


def __dir__() -> list[str]:
    """Return the public names, for completion."""
    return sorted({*__all__, *FIGURES})


def suits(name: str, record: Files) -> bool:
    """Return whether a figure is drawn for a run: the data exist and the figure is not empty."""
    try:
        return bool(_FILES[name].suits(record))
    except MissingFileError:
        return False


def set_up(record: Files) -> None:
    """Prepare what all body pictures share; the mesh of the run suffices."""
    from ruptfx.results.plots._panels import raster_of

    if record.bulk["points"].shape[1] == 2:
        raster_of(record)


def all_figures(
    record: Files, only: Sequence[str] | None = None, *, times: Window | None = None, **options: Any
) -> dict[str, Figure]:
    """Return every figure that suits the run, by name, or only the requested ones.

    Of a part of a run, figures whose data have no time in it are left out and named in ``record.outside``, unless they
    are requested.

    Parameters
    ----------
    only : sequence of str, optional
        Names of figures; default is all. Those that do not suit the run are left out.
    times : (float, float), optional
        First and last time to use [s]; default is all.
    **options
        Other arguments of the figures, such as ``units``.

    Raises
    ------
    OutsideError
        A requested figure, or every one, has no data in this part of the run.
    """
    return dict(_drawn(record, only, times, options))


def _drawn(
    record: Files, only: Sequence[str] | None, times: Sequence[float | None] | None, options: dict[str, Any]
) -> Iterator[tuple[str, Figure]]:
    """Yield names and figures, each when it is drawn; see `all_figures`."""
    if times is not None:
        with record.between(*pair("all_figures", "times", times)) as part:
            yield from _drawn(part, only, None, options)
        return
    count = 0
    for name in only or FIGURES:
        try:
            figure = figure_of(FIGURES[name](record, **options)) if suits(name, record) else None
        except OutsideError as error:
            if only:
                raise
            record.outside[name] = str(error)
            continue
        if figure is not None:
            count += 1
            yield name, figure
    if record.outside and not count:
        raise OutsideError(next(iter(record.outside.values())))


def save_all(
    record: Files,
    directory: str | Path | None = None,
    formats: Sequence[str] = ("png",),
    only: Sequence[str] | None = None,
    suffix: str = "",
    saved: Callable[[Path], None] | None = None,
    **options: Any,
) -> list[Path]:
    """Draw and save every figure.

    Parameters
    ----------
    directory : path, optional
        Output directory; default is ``figures`` in the run directory.
    formats : sequence of str
        File types, for example ``("png", "pdf")``.
    only : sequence of str, optional
        Names of figures; default is all. Those that do not suit the run are left out.
    suffix : str
        End of the file names before their types.
    saved : callable, optional
        Called with the path of every file when it is written.
    **options
        Arguments of the figures, such as ``times``.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    RuptfxError
        The directory cannot be written, or a format is unknown.
    """
    target = record.path / "figures" if directory is None else Path(directory)
    paths = []
    try:
        target.mkdir(parents=True, exist_ok=True)
        for name, figure in _drawn(record, only, options.pop("times", None), options):
            for kind in formats:
                paths.append(target / f"{name}{suffix}.{kind}")
                save(figure, paths[-1], kind)
                if saved is not None:
                    saved(paths[-1])
    except (OSError, ValueError) as error:
        known = unwritable(target, error) if isinstance(error, OSError) else None
        raise known or RuptfxError(f"{final(target)}: figures cannot be saved there: {error}") from None
    return paths
