"""All numbers of a run directory with their units, and their comparison."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ruptfx.input.fields import extensive_unit
from ruptfx.results.summary_fields import unit

OF_THE_MACHINE = {"wall_time", "node_updates_per_second", "ranks", "case_hash", "versions", "host_cores", "title"}
NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")
ROUNDING = {"closure", "energy_closure", "noise", "tip_speed_error", "rotation_error", "pairing_update_loss"}
"""Columns and scalars that are differences of nearly equal numbers."""


@dataclass(frozen=True)
class Data:
    """A dataset, a column or a scalar; `unit` in SI, or None for names."""

    values: Any
    unit: str | None


Run = dict[str, Data]


def read(run: Path, plane: str) -> Run:
    """Return every dataset, column and scalar of a run by name."""
    data: Run = {}
    for path in sorted(run.glob("*.h5")):
        with h5py.File(path) as file:
            file.visititems(lambda name, item, path=path: data.update(_dataset(path.name, name, item)))
    for path in sorted(run.glob("*.csv")):
        default = "N m/s" if path.name == "moment_rate.csv" else extensive_unit("J", plane)
        data |= _columns(path, default, extensive_unit("N", plane))
    return data | dict(_scalars(json.loads((run / "summary.json").read_text()), "summary.json:"))


def _scalars(table: dict[str, Any], prefix: str) -> Iterator[tuple[str, Data]]:
    for name, value in table.items():
        if isinstance(value, dict) and name not in OF_THE_MACHINE:
            yield from _scalars(value, f"{prefix}{name}.")
        elif name not in OF_THE_MACHINE:
            yield f"{prefix}{name}", Data(value, unit(name) or "1")


def _dataset(file: str, name: str, item: object) -> Run:
    if not isinstance(item, h5py.Dataset):
        return {}
    values, of = item[()], item.attrs.get("units", "1")
    text = of.decode() if isinstance(of, bytes) else str(of)
    return {f"{file}:{name}": Data(values, {"degree": "1"}.get(text, text) if values.dtype.kind in "fiu" else None)}


def _columns(path: Path, energy: str, force: str) -> Run:
    rows = list(csv.reader(path.read_text().splitlines()[1:]))
    table = np.array([[float(cell) for cell in row] for row in rows[1:]]).reshape(len(rows) - 1, len(rows[0]))
    units = {"time": "s", "closure": "1", "normal_force": force, "shear_force": force,
             "shear_force_1": force, "shear_force_2": force, "friction_work": energy,
             "impact_work": energy, "sticking": "1", "sliding": "1", "open": "1", "uncovered": "1"}  # fmt: skip

    def of(name: str) -> str:
        if ".force_" in name or ".displacement_" in name:
            return force if ".force_" in name else "m"
        return units.get(name, energy)

    return {f"{path.name}:{name}": Data(table[:, i], of(name)) for i, name in enumerate(rows[0])}


def differences(expected: Run, actual: Run, tolerance: float, ignored: Callable[[str], bool] = lambda _: False
                ) -> Iterator[str]:  # fmt: skip
    """Yield a line for every number that differs.

    Differences are relative to the largest value of a dataset, or to a hundredth of the largest one of its unit in its
    file, or a millionth of a millionth of that in all files, where the dataset itself is rounding.
    """
    largest: dict[tuple[str, str | None], float] = {}
    for name, data in expected.items():
        if data.unit is not None and isinstance(data.values, np.ndarray):
            key = name.partition(":")[0], data.unit
            largest[key] = max(largest.get(key, 0.0), float(np.nanmax(np.abs(data.values), initial=0.0)))
    for name in sorted(expected.keys() | actual.keys()):
        if name.replace(":", ".").rpartition(".")[2] in ROUNDING or ignored(name):
            continue
        if name not in expected or name not in actual:
            yield f"{name}: only in the {'expected' if name in expected else 'other'} run"
            continue
        one, other = expected[name].values, actual[name].values
        if not isinstance(one, np.ndarray | int | float) or not isinstance(other, np.ndarray | int | float):
            is_reason = name.endswith("_missing") and isinstance(one, str) and isinstance(other, str)
            if is_reason and NUMBER.sub("", str(one)) == NUMBER.sub("", str(other)):
                continue  # numbers in it have units and change with them
            if np.any(np.asarray(one) != np.asarray(other)):
                yield f"{name}: {str(one)[:60]} {str(other)[:60]}"
            continue
        a, b = np.asarray(one, float), np.asarray(other, float)
        if a.shape != b.shape:
            yield f"{name}: shapes {a.shape} {b.shape}"
            continue
        if not np.array_equal(np.isnan(a), np.isnan(b)):
            yield f"{name}: {int((np.isnan(a) != np.isnan(b)).sum())} values are missing in one of them"
            continue
        file, of = name.partition(":")[0], expected[name].unit
        everywhere = max((value for (_, unit), value in largest.items() if unit == of), default=0.0)
        floor = max(0.01 * largest.get((file, of), 0.0), 1e-12 * everywhere)
        if of == "1":
            floor = 1.0 if file == "summary.json" else 1e-4
        size = max(np.nanmax(np.abs(a), initial=0.0), floor)
        with np.errstate(invalid="ignore"):
            apart = np.nanmax(np.abs(a - b), initial=0.0)
        if apart > tolerance * size:
            yield f"{name}: {apart / size if size else apart:.2e} of {size:.3e}"
