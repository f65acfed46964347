"""Number by number comparison of two run directories."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np


def _datasets(path: Path) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return {name: data for name, data in found.items() if data.dtype.kind in "fi"}


def largest_difference(one: Path, other: Path) -> dict[str, float]:
    """Largest difference of every data set of `interface.h5`, `bulk.h5`, `instruments.h5` if there are instruments, and
    `energy.csv`, relative to its largest value; shapes and places of missing values must be equal."""
    differences = {}
    assert (one / "instruments.h5").exists() == (other / "instruments.h5").exists()
    for name in ("interface.h5", "bulk.h5", *["instruments.h5"] * (one / "instruments.h5").exists()):
        a, b = _datasets(one / name), _datasets(other / name)
        assert a.keys() == b.keys()
        for key in a:
            assert a[key].shape == b[key].shape, key
            np.testing.assert_array_equal(np.isnan(a[key]), np.isnan(b[key]), err_msg=key)
            scale = np.nanmax(np.abs(a[key]), initial=0.0)
            change = np.nanmax(np.abs(a[key].astype(float) - b[key].astype(float)), initial=0.0)
            differences[f"{name}:{key}"] = change / scale if scale > 0 else change
    # The last column, closure, is round-off itself.
    a, b = (np.loadtxt(path / "energy.csv", delimiter=",", skiprows=2)[:, :-1] for path in (one, other))
    differences["energy.csv"] = float(np.max(np.abs(a - b)) / np.max(np.abs(a)))
    return differences
