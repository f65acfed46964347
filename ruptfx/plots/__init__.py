"""Figures of a run, from its record; good enough for a paper and drawn without a display or DOLFINx.

>>> from ruptfx import Record, plots                                                     # doctest: +SKIP
>>> plots.space_time(Record("out/impact")).savefig("space_time.pdf")                     # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from ruptfx import RuptfxError
from ruptfx.plots.along import front, slip_profiles, snapshots, space_time
from ruptfx.plots.budget import energy_budget
from ruptfx.plots.bulk import fringes, most_fringes, wavefield
from ruptfx.plots.cycles import cycles, is_uneven
from ruptfx.plots.style import STYLE
from ruptfx.record import Record

__all__ = [
    "all_figures", "cycles", "energy_budget", "fringes", "front", "save_all", "slip_profiles", "snapshots",
    "space_time", "wavefield",
]

_ALONG = (space_time, snapshots, slip_profiles, front)
MOST_FRINGES = 60


def all_figures(record: Record) -> dict[str, Figure]:
    """Every figure the run has the data for, by name: of the interface and the bodies only in two dimensions.

    Fringes are left out where materials have no fringe constant, and where there are too many to be seen. Runs with
    slow and fast phases have a figure of their own.
    """
    draw: list[Callable[[Record], Figure]] = []
    if record.interfaces and "slip_rate" in record.interface:
        draw += (cycles, slip_profiles) if is_uneven(record) else _ALONG
    if (record.path / "bulk.h5").is_file() and record.bulk["points"].shape[1] == 2:
        draw += [fringes] * (0 < most_fringes(record) < MOST_FRINGES) + [wavefield]
    if (record.path / "energy.csv").is_file():
        draw += [energy_budget]
    return {function.__name__: function(record) for function in draw}


def save_all(
    record: Record, directory: str | Path | None = None, formats: Sequence[str] = ("png",)
) -> list[Path]:
    """Draw and save every figure.

    Parameters
    ----------
    record : Record
    directory : path, optional
        Where to; default is ``figures`` in the run directory.
    formats : sequence of str
        File types, for example ``("png", "pdf")``.

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
        with matplotlib.rc_context(STYLE):
            for name, figure in all_figures(record).items():
                for kind in formats:
                    figure.savefig(target / f"{name}.{kind}", format=kind)
                    paths.append(target / f"{name}.{kind}")
    except (OSError, ValueError) as error:
        raise RuptfxError(f"{target}: figures cannot be saved there: {error}") from None
    return paths
