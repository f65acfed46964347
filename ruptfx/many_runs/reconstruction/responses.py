"""Impulse responses of sensors and tractions, and factors of posteriors, in files that later experiments read."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx import Table, __version__
from ruptfx.many_runs.reconstruction.twin import Motion, Tractions, Twin
from ruptfx.platform import parallel
from ruptfx.platform.run_files import replacing, seal

if TYPE_CHECKING:
    from collections.abc import Callable

    from ruptfx.many_runs.adjoint.readings import Readings
    from ruptfx.many_runs.adjoint.sweeps import Told
    from ruptfx.many_runs.reconstruction.posterior import Prior, Rows

Floats = NDArray[np.float64]
SPECIMEN = ("plane", "order", "mesh", "materials", "damping", "boundaries", "attachments", "initial_velocity")
"""Tables of a case on which impulse responses depend."""
LARGEST = 8000
"""Largest side of a factor that is written."""


class Responses:
    """Impulse responses of a twin, from files where they are there.

    Parameters
    ----------
    twin : Twin
    readings : Readings
    sensors : list of Table
        Description of the sensor of every request of the readings.
    folder : Path, optional
        Of the files; without it nothing is read and written.

    Attributes
    ----------
    computed, read : int
        Number of sensors whose responses were computed, and read; tractions count as one.
    """

    def __init__(self, twin: Twin, readings: Readings, sensors: list[Table], folder: Path | None) -> None:
        self._twin, self._readings, self._sensors, self._folder = twin, readings, sensors, folder
        self.computed = self.read = 0
        table = twin.model.case.table()
        self._specimen = {name: table.get(name) for name in SPECIMEN} | {
            "dt": float(f"{twin.knots.dt:.12g}"), "version": __version__, "files": dict(twin.model.case.sums),
        }  # fmt: skip

    @property
    def channels(self) -> int:
        """Number of sensors whose responses are known; tractions do not count."""
        return min(self.computed + self.read, len(self._sensors))

    def lags(self, number: int, tell: Told) -> dict[str, Floats]:
        """Return the lags of the sources of a request by clock, shapes (steps, n); collective."""
        key = seal({**self._specimen, "sensor": self._sensors[number]})
        clocks = self._readings.sources(number)
        return self._stored(key, self._twin.knots.steps, lambda: {
            clock: self._twin.lags(self._readings, number, clock, tell) for clock in clocks
        })  # fmt: skip

    def tractions(self, still: Motion, prior: Prior, amplitude: float, tell: Told) -> Tractions:
        """Return the tractions of the modes of space of a prior; files contain those of amplitude 1; collective."""
        shapes = prior.space / amplitude
        knots = self._twin.knots
        key = seal({**self._specimen, "modes": _checksum(shapes), "every": knots.every, "first": knots.first})
        kernels = self._stored(key, 1 + knots.count, lambda: {
            "kernels": np.moveaxis(self._twin.traction_kernels(still, shapes, tell), 1, 0)
        })["kernels"]  # fmt: skip
        return Tractions(still.shear_traction, still.normal_stress, amplitude * np.moveaxis(kernels, 0, 1))

    def _stored(self, key: str, steps: int, compute: Callable[[], dict[str, Floats]]) -> dict[str, Floats]:
        """Return the first steps of arrays from a file, else compute and write them; collective."""
        comm = self._twin.model.comm
        path = None if self._folder is None else self._folder / f"{key}.h5"
        known = parallel.on_root(comm, lambda: _read(path, steps))
        if known is not None:
            self.read += 1
            return known
        result = compute()
        self.computed += 1
        parallel.on_root(comm, lambda: _write(path, result))
        return result

    def posterior(
        self, prior: Prior, rows: Rows, about: Table, compute: Callable[[], dict[str, Floats]]
    ) -> dict[str, Floats]:
        """Return what does not depend on the data from a file, else compute and write it; on one rank.

        Parameters
        ----------
        prior : Prior
        rows : Rows
        about : Table
            All else on which it depends, besides the specimen.
        compute : callable
        """
        if self._folder is None or min(len(rows.values), prior.size) > LARGEST:
            return compute()
        parts = (prior.space, prior.time, rows.kernels, rows.kernel, rows.lag, rows.sigma)
        key = seal({**self._specimen, "posterior": [_checksum(each) for each in parts], "about": about})
        path = self._folder / f"{key}.h5"
        known = _read(path, 0)
        if known is None:
            known = compute()
            _write(path, known)
        return known


def _checksum(values: NDArray[np.float64] | NDArray[np.int64]) -> str:
    return hashlib.sha256(np.ascontiguousarray(values).data).hexdigest()  # without a copy


def _read(path: Path | None, steps: int) -> dict[str, Floats] | None:
    """Return the first steps of responses; None without a file, with a damaged one, and with one of fewer steps."""
    import h5py

    if path is None or not path.is_file():
        return None
    try:
        with h5py.File(path) as file:
            result = {name: np.asarray(each[:]) for name, each in file.items()}
            if any(each.attrs["sha256"] != _checksum(result[name]) for name, each in file.items()):
                return None
    except (OSError, KeyError):
        return None
    if not result or any(len(each) < steps for each in result.values()):
        return None
    return {name: each[:steps] if steps else each for name, each in result.items()}


def _write(path: Path | None, lags: dict[str, Floats]) -> None:
    """Write responses; another process that reads them meanwhile finds the former file, or a complete one."""
    from ruptfx.results.hdf5 import new_hdf5

    if path is None:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary, new_hdf5(temporary) as (file, _):
        for name, values in lags.items():
            file.create_dataset(name, data=values).attrs["sha256"] = _checksum(values)
