"""Snapshots of the bodies for ParaView and for `Record`: `bulk.h5` with its descriptor `bulk.xdmf`.

Every element is written as linear cells between its own nodes, so that any viewer shows all nodes.
Stresses are total: those of the displacement plus the initial stress of the bodies. This is the tensor of the case, or,
where the case gives only the tractions of interfaces, the one that `InitialBodyStress` assumes, with the pressure
of a flat interface as it varies; the attribute `initial_stress` of the file names the choice.
States of materials are those of the last step, `Material.recorded_states`; NaN at the nodes of bodies without them. The
attribute `states` lists their names.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.stress import NodalFields
from ruptfx.input.fields import stress_entries
from ruptfx.interfaces.faults.body_stress import InitialBodyStress
from ruptfx.platform import parallel
from ruptfx.platform.distributed_rows import RowDistribution
from ruptfx.run.recording import xdmf
from ruptfx.run.recording.shared_file import SharedFile

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.laws.materials import RecordedState
    from ruptfx.run.model import Model

FIELDS = {
    "velocity": ("m/s", "particle velocity"), "displacement": ("m", "displacement from the initial state"),
    "stress": ("Pa", "total stress, tension positive"), "fringe": ("Pa", "sigma_1 - sigma_2 in the plane of x and y"),
}  # fmt: skip
"""Fields of the nodes, and their units."""


class Topology(NamedTuple):
    """Mesh as in files, the rows of this rank: points [m], cells by number of their points, body of points and cells.

    Points where bodies are welded have the first of these.
    """

    points: np.ndarray
    cells: np.ndarray
    number_of_cells: int
    body: np.ndarray
    body_of_cell: np.ndarray


class BulkFields:
    """Velocity, displacement, total stress and sigma_1 - sigma_2 at the nodes of the bodies; created on all ranks.

    Attributes
    ----------
    initial_stress : InitialBodyStress
    nodal : NodalFields
        Stress by the displacement, and states of materials.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self._stresses = stress_entries(model.case.plane, model.components)
        # In antiplane stress is a vector.
        entries: list[Any] = [entry if model.components > 1 else entry[0] for entry in self._stresses.values()]
        self._fields = [name for name in FIELDS if name in model.case.output.bulk_fields]
        self._states = recorded_states(model) if "state" in model.case.output.bulk_fields else {}
        self._type = np.dtype({"double": "f8", "single": "f4"}[model.case.output.bulk_precision])
        self.initial_stress = InitialBodyStress(
            model, model.faults, model.case.initial_stress, model.case.initial_tensor, entries
        )
        self._initial_at_nodes = self.initial_stress.at(model.coordinates)
        self.nodal = NodalFields(model, model.bulk, model.operator, model.memory, entries)

    def topology(self) -> Topology:
        """Return points, cells and their bodies, in an order independent of the partition; collective."""
        model, layout = self.model, self.model.layout
        cells = layout.numbering[self._linear_cells()].astype(float)
        total = int(parallel.total(model.comm, len(cells)))
        place = parallel.places(model.comm, np.sort(cells, axis=1))
        owned = model.mesh.topology.index_map(model.mesh.topology.dim).size_local
        body = np.repeat(model.bodies.cell_body[:owned], len(cells) // max(owned, 1))
        rows = RowDistribution(model.comm, place, total).collect(np.column_stack([cells, body])).astype(np.int64)
        return Topology(
            points=layout.collect(model.coordinates.ravel()), cells=rows[:, :-1], number_of_cells=total,
            body=layout.collect(np.repeat(layout.body, model.components))[:, 0].astype(np.int32),
            body_of_cell=rows[:, -1].astype(np.int32),
        )  # fmt: skip

    def _linear_cells(self) -> np.ndarray:
        """Return owned elements cut into linear cells at their nodes, shape (linear cells, corners)."""
        model = self.model
        count = model.mesh.topology.index_map(model.mesh.topology.dim).size_local
        dofs = model.space.dofmap.list[:count]
        name, p = model.mesh.basix_cell().name, model.order
        if name in ("triangle", "tetrahedron"):
            return dofs
        dim = model.mesh.topology.dim
        reference = np.round(np.asarray(model.space.element.basix_element.points, dtype=float), 9)
        lattice = np.lexsort(reference.T[::-1]).reshape((p + 1,) * dim)  # [ix, iy, (iz)]
        low, high = slice(None, -1), slice(1, None)
        if dim == 2:
            corners = [(low, low), (high, low), (high, high), (low, high)]
        else:
            square = [(low, low), (high, low), (high, high), (low, high)]
            corners = [(*corner, level) for level in (low, high) for corner in square]  # type: ignore[misc]
        local = np.stack([lattice[corner].ravel() for corner in corners], axis=1)
        linear = dofs[:, local].reshape(-1, len(corners))
        if dim == 2:
            x = model.coordinates[linear]
            a, b = x[:, 1] - x[:, 0], x[:, 3] - x[:, 0]
            clockwise = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0
            linear[clockwise] = linear[clockwise][:, ::-1]
        return linear

    def create(self, out: Path, topology: Topology) -> None:
        """Open the file; every rank writes its part."""
        model = self.model
        nodes, (_, self._dim) = model.total_nodes, topology.points.shape
        self._out, self._cells = out, (topology.number_of_cells, topology.cells.shape[1])
        self._file = file = SharedFile(model.comm, out / "bulk.h5", model.case.output.bulk_compression)
        file.write("points", topology.points, nodes, units="m")
        file.write("cells", topology.cells, topology.number_of_cells, units="1")
        file.write("body", topology.body, nodes, units="1")
        file.write("body_of_cell", topology.body_of_cell, topology.number_of_cells, units="1")
        if file.whole is not None:
            file.whole.create_dataset("time", (0,), maxshape=(None,), dtype=float).attrs["units"] = "s"
            file.whole.attrs["bodies"] = model.bodies.names
            if self._states:
                file.whole.attrs["states"] = list(self._states)
            file.whole.attrs["record"] = "all fields of a snapshot are those of its time, that of the velocities"
            file.whole.attrs["initial_stress"] = self.initial_stress.origin
            if self.initial_stress.is_uniform:
                file.whole.attrs["initial_stress_values"] = self.initial_stress.mean
        file.flush()

    def restore(self, saved: Path, kept: int | None) -> None:
        """Append the first snapshots of another file, of any number of ranks; every rank reads its part."""
        with h5py.File(saved, locking=False) as file:
            for row, time in enumerate(file["time"][:kept]):
                own_rows = self.model.layout.rows.here
                self.append(float(time), {name: file[name][row, own_rows] for name in [*self._fields, *self._states]})

    def reopen(self) -> list[Path]:
        """Return the files that this rank has written, which may then be copied."""
        self._file.reopen()
        descriptor = self._out / "bulk.xdmf"
        return [*self._file.paths, *[descriptor] * (self._file.whole is not None and descriptor.exists())]

    def gather(self, state: State) -> dict[str, np.ndarray]:
        """Return the requested fields at the points of this rank's block; collective."""
        model, c = self.model, self.model.components
        _, displacement = state.at_velocity()
        entries = {"velocity": state.velocity.reshape(-1, c), "displacement": displacement.reshape(-1, c)}
        entries = {name: values for name, values in entries.items() if name in self._fields}
        if {"stress", "fringe"} & set(self._fields):
            entries["stress"] = self.nodal.stress(displacement, state) + self._initial_at_nodes
        if self._states:
            states = self.nodal.states(list(self._states), displacement, state)
            entries |= {name: values[:, None] for name, values in states.items()}
        if not entries:
            return {}
        ends = np.cumsum([values.shape[1] for values in entries.values()])
        rows = model.layout.collect(np.column_stack(list(entries.values())).ravel())
        entries = dict(zip(entries, np.split(rows, ends[:-1], axis=1), strict=True))
        if "fringe" in self._fields:
            from ruptfx.results.analysis.photoelasticity import difference_of

            entries["fringe"] = difference_of(entries["stress"])
        entries |= {name: entries[name][:, 0] for name in self._states}
        return {name: entries[name].astype(self._type, copy=False) for name in [*self._fields, *self._states]}

    def append(self, time: float, fields: dict[str, np.ndarray]) -> None:
        """Write this rank's part of one snapshot."""
        for name, values in fields.items():
            unit, text = self._states.get(name) or FIELDS[name]
            text = "twice the shear stress" if name == "fringe" and self.model.components == 1 else text
            text += "; zz goes round the axis" * (name == "stress" and self.model.case.plane == "axisymmetric")
            self._file.append(name, values, self.model.total_nodes, units=unit, long_name=text)
        self._file.flush()
        if self._file.whole is not None:
            times = self._file.whole["time"]
            times.resize(len(times) + 1, axis=0)
            times[-1] = time
            self._file.whole.flush()
            self._write_descriptor(times[:], {name: values.shape[1:] for name, values in fields.items()})

    def close(self) -> None:
        self._file.close()

    def _labels(self, field: str) -> list[str]:
        axes = "xyz"[: self.model.components] if self.model.components > 1 else "z"
        return list(self._stresses if field == "stress" else axes)

    def _write_descriptor(self, times: np.ndarray, columns: dict[str, tuple[int, ...]]) -> None:
        points, dim, (cells, corners) = self.model.total_nodes, self._dim, self._cells
        shape = {(2, 3): "Triangle", (2, 4): "Quadrilateral", (3, 4): "Tetrahedron", (3, 8): "Hexahedron"}[dim, corners]
        mesh = xdmf.Mesh("bodies", shape, ("cells", (cells, corners)), ("points", (points, dim)), ("body_of_cell",))
        xdmf.write(self._out / "bulk.xdmf", mesh, times, [
            xdmf.Field(f"{field}{label}", field, (len(times), points, *column), part, bytes=self._type.itemsize)
            for field, column in columns.items()
            for part, label in enumerate([f"_{axis}" for axis in self._labels(field)] if column else [""])
        ])  # fmt: skip


def recorded_states(model: Model) -> dict[str, RecordedState]:
    """Return what the materials of a model record of their states, by name; the same on all ranks.

    Raises
    ------
    RuptfxError
        A name of another field of the file, or of two states with different units or meanings.
    """
    entries: dict[str, RecordedState] = {}
    for material in model.given:
        for name, declared in material.recorded_states().items():
            reserved = {*FIELDS, "points", "cells", "body", "body_of_cell", "time"}
            if name in reserved or entries.setdefault(name, declared) != declared:
                raise RuptfxError(
                    f"{material.kind()}.recorded_states: another field of snapshots has the name '{name}'; rename it"
                )
    return entries
