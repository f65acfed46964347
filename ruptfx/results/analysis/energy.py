"""Energy budget of a run: distribution of the boundary work, and the part that is unaccounted for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ruptfx.results.record import Data

Array = np.ndarray

PARTS = (
    "kinetic", "strain", "interface_elastic", "frictional_dissipation", "fracture", "damping", "impact_loss",
    "collisions", "collision_loss", "pairing_update_loss", "rotation_error",
)  # fmt: skip


def parts_of(energy: Mapping[str, object] | Data) -> list[str]:
    """Return the columns that the boundary work went to: those of every run, then those of attachments."""
    others = [str(name) for name in energy if str(name) not in (*PARTS, "time", "boundary_work", "closure")]
    return [name for name in PARTS if name in energy] + others


def closure(boundary_work: Array, parts: Mapping[str, Array]) -> Array:
    """Return the unaccounted energy as a fraction of the largest boundary work; shape (times,).

    closure = (W - sum of the parts) / max |W|; without boundary work (a rupture driven by its initial
    stress) the largest part replaces W in the denominator.

    Parameters
    ----------
    boundary_work : ndarray, shape (times,)
        Work done by the boundaries [J].
    parts : mapping of ndarray, shape (times,)
        Parts of the budget [J], as changes since the start.
    """
    values = np.array(list(parts.values()))
    scale = np.abs(boundary_work).max(initial=0.0) or np.abs(values).max(initial=0.0)
    return (boundary_work - values.sum(axis=0)) / (scale or 1.0)


def budget(energy: Mapping[str, object] | Data) -> dict[str, float]:
    """Return the final energies [J] by name, and `energy_closure`, the largest |closure| of the run.

    Parameters
    ----------
    energy : mapping of arrays, shape (times,)
        The columns of a run's energy table; `Record.energy` fits.
    """
    names = [*parts_of(energy), *(["boundary_work"] if "boundary_work" in energy else [])]
    columns = {name: np.asarray(energy[name]) for name in names}
    if not columns or not len(next(iter(columns.values()))):
        return {"energy_closure": float(np.nan)}
    final = {name: float(values[-1]) for name, values in columns.items()}
    work = columns.pop("boundary_work")
    return {**final, "energy_closure": float(np.abs(closure(work, columns)).max())}
