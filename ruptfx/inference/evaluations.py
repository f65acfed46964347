"""File of every run of an inference: variables, misfit, prior, derivatives and readings.

An interrupted inference is repeated from the files: the optimiser requests the same variables again, and runs that are
on disk are not computed a second time. So only the interrupted run is lost, and the result is that without an
interruption.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Evaluation:
    """A run with what a method has needed of its derivatives.

    Attributes
    ----------
    variables, gradient : ndarray, shape (m,)
        Variables z, and the derivative of misfit and prior by them; empty if it was not needed.
    misfit, prior : float
    readings, residuals : ndarray
        Readings of all terms of the objective, one after the other, and their residuals, if all terms have some.
    jacobian : ndarray, shape (residuals, m)
        Derivative of the residuals by the variables; empty if it was not needed.
    """

    variables: Floats
    misfit: float
    prior: float
    gradient: Floats
    readings: Floats
    residuals: Floats
    jacobian: Floats

    @property
    def total(self) -> float:
        """Sum of misfit and prior, which is minimised."""
        return self.misfit + self.prior


def save(folder: Path, number: int, made: Evaluation) -> None:
    """Write an evaluation; a file is there as a whole or not at all."""
    folder.mkdir(exist_ok=True)
    part = folder / f"{number:04d}.part"
    with part.open("wb") as file:
        np.savez(file, **vars(made))
        file.flush()
        os.fsync(file.fileno())
    part.replace(folder / f"{number:04d}.npz")


def load(folder: Path) -> list[Evaluation]:
    """Return the evaluations of a folder in their order, up to the first number that is missing.

    Raises
    ------
    RuptfxError
        A file is damaged.
    """
    found: list[Evaluation] = []
    while (path := folder / f"{len(found):04d}.npz").exists():
        try:
            with np.load(path) as data:
                found.append(Evaluation(
                    data["variables"], float(data["misfit"]), float(data["prior"]),
                    *(data[name] for name in ("gradient", "readings", "residuals", "jacobian")),
                ))  # fmt: skip
        except Exception as error:
            raise RuptfxError(f"{path}: is damaged ({error}); remove it, and what was computed after it is repeated"
                              ) from error  # fmt: skip
    return found
