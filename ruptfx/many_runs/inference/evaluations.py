"""File of every run of an inference: variables, misfit, prior, derivatives and readings.

An interrupted inference is repeated from the files: the optimiser requests the same variables again, and runs that are
on disk are not computed a second time. So only interrupted runs are lost, and the result is that without an
interruption.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError

Floats = NDArray[np.float64]
Derivatives = Literal["none", "gradient", "history"]


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
    part = file_of(folder, number).with_suffix(".part")
    with part.open("wb") as file:
        np.savez(file, **vars(made))
        file.flush()
        os.fsync(file.fileno())
    part.replace(file_of(folder, number))


def load(folder: Path) -> dict[int, Evaluation]:
    """Return the evaluations of a folder by their numbers.

    Raises
    ------
    RuptfxError
        A file is damaged.
    """
    return {int(path.stem): load_one(path) for path in sorted(folder.glob("*.npz"))}


def load_one(path: Path) -> Evaluation:
    """Return the evaluation of a file.

    Raises
    ------
    RuptfxError
        The file is damaged.
    """
    try:
        with np.load(path) as data:
            return Evaluation(
                data["variables"], float(data["misfit"]), float(data["prior"]),
                *(data[name] for name in ("gradient", "readings", "residuals", "jacobian")),
            )  # fmt: skip
    except Exception as error:
        raise RuptfxError(f"{path}: is damaged ({error}); remove it, and the run is repeated") from error


def file_of(folder: Path, number: int) -> Path:
    """Return the file of an evaluation."""
    return folder / f"{number:04d}.npz"
