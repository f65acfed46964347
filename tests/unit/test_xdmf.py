"""Descriptors for ParaView: what they point to in the HDF5 file, evaluated as the format says."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np

from ruptfx.run.recording import xdmf


def picked(folder: Path, item: ElementTree.Element) -> np.ndarray:
    """The values of a data item: an array of an HDF5 file, or a slab of one."""
    if item.get("ItemType") == "HyperSlab":
        slab, array = item
        assert (slab.get("Dimensions") or "").split()[0] == "3"
        start, stride, count = np.array((slab.text or "").split(), int).reshape(3, -1)
        rows = tuple(slice(a, a + s * n, s) for a, s, n in zip(start, stride, count, strict=True))
        return picked(folder, array)[rows].ravel()
    name, _, path = (item.text or "").partition(":")
    with h5py.File(folder / name) as file:
        values = np.asarray(file[path])
    assert tuple(map(int, (item.get("Dimensions") or "").split())) == values.shape
    assert int(item.get("Precision") or 0) == values.dtype.itemsize
    return values


def test_a_descriptor_points_to_the_values(tmp_path: Path) -> None:
    """Two times, a vector and a scalar at three points, a scalar in single precision at one cell, a fixed array."""
    vector, scalar = np.arange(12.0).reshape(2, 3, 2), np.arange(6.0).reshape(2, 3)
    arrays = {
        "points": np.array([[0.0, 0], [1, 0], [0, 1]]), "cells": np.array([[0, 1, 2]], np.int32),
        "v": vector, "s": scalar,
        "body_of_cell": np.array([7], np.int32), "c": np.array([[5], [6]], np.float32),
    }  # fmt: skip
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in arrays.items():
            file[name] = values
    mesh = xdmf.Mesh("bodies", "Triangle", ("cells", (1, 3)), ("points", (3, 2)), ("body_of_cell",))
    fields = [
        *(xdmf.Field(f"v_{axis}", "v", vector.shape, k) for k, axis in enumerate("xy")),
        xdmf.Field("s", "s", scalar.shape),
        xdmf.Field("c", "c", (2, 1), center="Cell", bytes=4),
    ]  # fmt: skip
    xdmf.write(tmp_path / "a.xdmf", mesh, [0.5, 1.5], fields)
    grids = ElementTree.parse(tmp_path / "a.xdmf").findall("./Domain/Grid/Grid")
    assert [float(grid[0].get("Value") or "nan") for grid in grids] == [0.5, 1.5]
    for row, grid in enumerate(grids):
        topology, geometry = grid.find("Topology"), grid.find("Geometry")
        assert topology is not None and topology.get("NumberOfElements") == "1" and geometry is not None
        assert picked(tmp_path, topology[0]).tolist() == [[0, 1, 2]] and geometry.get("GeometryType") == "XY"
        np.testing.assert_array_equal(picked(tmp_path, geometry[0]), arrays["points"])
        fields_of_row = {each.get("Name"): picked(tmp_path, each[0]).tolist() for each in grid.findall("Attribute")}
        assert fields_of_row == {
            "body": [7], "v_x": vector[row, :, 0].tolist(), "v_y": vector[row, :, 1].tolist(),
            "s": scalar[row].tolist(),
            "c": [5.0 + row],
        }  # fmt: skip
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
