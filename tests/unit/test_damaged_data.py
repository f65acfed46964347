"""Data of an objective in NetCDF files that are damaged, or claim more values than fit into memory."""

from __future__ import annotations

import os
import re
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray
from helpers.damaged import damaged
from helpers.messages import facts
from pydantic import ValidationError

from ruptfx.input.schema import CaseError
from ruptfx.readings.misfits import Misfit
from ruptfx.readings.misfits.displacement_field import MOST, DisplacementField
from ruptfx.readings.misfits.traces import Traces

UNITS = {"time": "s", "velocity": "m/s", "x": "m", "y": "m", "displacement_x": "m", "displacement_y": "m"}


def validated(cls: type[Misfit], path: Path, values: dict[str, Any]) -> Any:
    try:
        return cls.model_validate({**values, "file": path.name}, context={"directory": path.parent})
    except ValidationError as error:
        raise CaseError.from_validation(error) from None


def traces(path: Path, **changes: Any) -> Any:
    return validated(Traces, path, {"instrument": "G", "sigma": 0.1, **changes})


def field(path: Path, **changes: Any) -> Any:
    return validated(DisplacementField, path, {"time": 1e-6, "sigma": 1e-6, **changes})


def write_traces(path: Path) -> None:
    time = ("time", np.arange(5.0), {"units": "us"})
    xarray.Dataset({"velocity": ("time", np.ones(5), {"units": "m/s"})}, {"time": time}).to_netcdf(
        path, engine="h5netcdf", encoding={"velocity": {"zlib": True, "chunksizes": (2,)}})  # fmt: skip


def write_field(path: Path, shape: tuple[int, int] = (3, 4)) -> None:
    axes = {name: (name, np.arange(float(n)), {"units": "mm"}) for name, n in zip("yx", shape, strict=True)}
    moved = {f"displacement_{axis}": (("y", "x"), np.ones(shape), {"units": "um"}) for axis in "xy"}
    xarray.Dataset(moved, axes).to_netcdf(path, engine="h5netcdf")


KINDS: dict[str, tuple[Callable[..., Any], Callable[[Path], None]]] = {
    "traces": (traces, write_traces), "displacement_field": (field, write_field),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_read_or_refused(kind: str, tmp_path: Path) -> None:
    """200 files with wrong bytes, or cut off: no other error than that of a file which cannot be read."""
    read, write = KINDS[kind]
    write(tmp_path / "whole.nc")
    path, count = tmp_path / "wrong.nc", 0
    whole = (tmp_path / "whole.nc").read_bytes()
    for content in damaged(whole, 200, 4, seed=5):
        path.write_bytes(content)
        try:
            read(path)
            count += content == whole
        except CaseError as error:
            assert content != whole
            assert "wrong.nc" in str(error) or re.match(r"case: (times|units|data|sigma)", str(error)), error
    assert count > 15


def huge(path: Path, names: dict[str, tuple[str, ...]], sizes: dict[str, int]) -> None:
    """A small file of compressed variables of which no value was written."""
    with h5py.File(path, "w") as file:
        for name, axes in names.items():
            shape = tuple(sizes[axis] for axis in axes)
            file.create_dataset(name, shape=shape, dtype="f8", compression="gzip", fillvalue=1.0,
                                chunks=tuple(min(n, 1000) for n in shape))  # fmt: skip
            file[name].attrs["units"] = UNITS[name]
        for axis in sizes:
            file[axis].make_scale(axis)
        for name, axes in names.items():
            for number, axis in enumerate(axes if name not in sizes else ()):
                file[name].dims[number].attach_scale(file[axis])


@pytest.mark.parametrize("kind, shape", [
    ("traces", (2_000_000_000,)),
    ("displacement_field", (200_000, 200_000)),
    ("displacement_field", (2_000_000_000, 2)),
])  # fmt: skip
def test_values_beyond_the_memory_are_refused_before_they_are_read(
    kind: str, shape: tuple[int, ...], tmp_path: Path
) -> None:
    axes = ("time",) if kind == "traces" else ("y", "x")
    data = ["velocity"] if kind == "traces" else ["displacement_x", "displacement_y"]
    huge(tmp_path / "m.nc", {**{axis: (axis,) for axis in axes}, **dict.fromkeys(data, axes)},
         dict(zip(axes, shape, strict=True)))  # fmt: skip
    assert (tmp_path / "m.nc").stat().st_size < 2e8
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(CaseError, match=facts(r"m\.nc: '\w+' has [24]e\+\d+ values")):
        KINDS[kind][0](tmp_path / "m.nc")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000  # kB


@pytest.mark.parametrize("kind", KINDS)
def test_pipes_and_missing_files_are_refused_at_once(kind: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.nc")
    with pytest.raises(CaseError, match=facts(r"pipe\.nc: cannot be read: it is no regular file")):
        KINDS[kind][0](tmp_path / "pipe.nc")
    with pytest.raises(CaseError, match=facts(r"absent\.nc: cannot be read")):
        KINDS[kind][0](tmp_path / "absent.nc")


def test_the_printed_distance_of_points_is_accepted(tmp_path: Path) -> None:
    """290 x 291 points: with every second one 145 x 146, which is more than 20 000, with every third 97 x 97."""
    write_field(tmp_path / "m.nc", (290, 291))
    with pytest.raises(CaseError, match=rf"every = 1: {290 * 291} points") as refused:
        field(tmp_path / "m.nc")
    printed = re.search(r"give every = (\d+)", str(refused.value))
    assert printed is not None and 145 * 146 > MOST > 97 * 97
    assert len(field(tmp_path / "m.nc", every=int(printed[1])).x) == 97 * 97
    for wrong in ("a", 0, [2]):
        with pytest.raises(CaseError, match="every"):
            field(tmp_path / "m.nc", every=wrong)
