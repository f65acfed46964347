"""Data that a study keeps of a finished run: its scalars, two pictures for the page, or everything."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from ruptfx import Table
from ruptfx.results import summary_fields
from ruptfx.results.record import Files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = {
    "space_time": "Slip rate in space and time", "wavefield": "Particle speed in the bodies",
    "cracks": "Facets that failed, and the force", "emission": "Acoustic emission",
}  # fmt: skip
"""Figures of the page and their captions."""


def scalars(interfaces: Iterable[str] = ()) -> list[str]:
    """Return the names of all scalars that `harvest` may find in a run with bodies and these interfaces."""
    from ruptfx.results.analysis.energy import PARTS
    from ruptfx.results.summary_fields import DESCRIPTIONS

    energies = [f"energy_{name}" for name in (*PARTS, "boundary_work")]
    several = [f"interfaces.{interface}.{name}" for interface in interfaces for name in DESCRIPTIONS]
    return [*DESCRIPTIONS, *several, "rupture", *energies, *(f"{name}_share" for name in PARTS)]


def harvest(run: Path, keep: list[str]) -> Table:
    """Return the scalars of a run; save its pictures beside it; remove the run unless it is kept.

    Parameters
    ----------
    run : Path
        A complete run directory inside that of its point.
    keep : list of str
        pictures, run.
    """
    summary = json.loads((run / "summary.json").read_text())
    scalar = summary_fields.flat(summary).items()
    values = {key: value for key, value in scalar if value is None or isinstance(value, int | float | str)}
    slides = (run / "interface.h5").is_file() or list(run.glob("interface_*.h5"))
    if slides or (run / "events.h5").is_file():
        with Files(run, trust=True) as record:  # its plug-ins have just been executed by the run
            values |= {"rupture": _rupture(values)} if slides else {}
            values |= _energies(record)
            if "pictures" in keep:
                _draw(record, run.parent)
    if "run" not in keep:
        shutil.rmtree(run)
    return values


def _rupture(values: Table) -> str | None:
    """Return one word for the rupture: none, arrested, or the speed regime."""
    return values.get("mode") if values.get("mode") in ("none", "arrested") else values.get("speed_regime")


def _energies(record: Files) -> dict[str, float]:
    """Return final energies [J per metre of thickness in 2D], and the parts of the work as fractions of it."""
    from ruptfx.results.analysis.energy import PARTS, budget

    result = budget(record.energy)
    work = result["boundary_work"]
    parts = [name for name in PARTS if name in result]  # runs of older versions have fewer parts
    # Without work of the boundaries the initial stress supplies the energy.
    scale = work if work > 0 else max(sum(abs(result[name]) for name in parts), 1e-300)
    return {f"energy_{name}": result[name] for name in (*parts, "boundary_work")} | {
        f"{name}_share": result[name] / scale for name in parts
    }


def _draw(record: Files, directory: Path) -> None:
    """Draw small pictures for the page."""
    from ruptfx.results import plots

    for name in PICTURES:
        if not plots.suits(name, record):
            continue
        try:
            figure = plots.figure_of(plots.FIGURES[name](record))
        except Exception as error:  # a failed picture must not lose the run
            (directory / f"{name}.txt").write_text(f"{error}\n")
            continue
        _save_small(figure, directory / f"{name}.webp")


def _save_small(figure: Figure, path: Path) -> None:
    """Save a picture in full colour as a small file: a page contains hundreds of them."""
    from ruptfx.results.figure_style import save

    dpi = 130
    width, height = (int(inches * dpi) for inches in figure.get_size_inches())
    with io.BytesIO() as buffer:
        save(figure, buffer, "rgba", dpi)
        Image.frombytes("RGBA", (width, height), buffer.getvalue()).convert("RGB").save(path, quality=80)
