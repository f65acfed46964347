"""Snapshots of the bodies for ParaView and for `Record`: `bulk.h5` with its descriptor `bulk.xdmf`.

Every element is written as linear cells between its own nodes, so that any viewer shows all nodes.
Stresses are total: those of the displacement plus the initial stress of the bodies. This is the tensor of the case, or,
where the case gives only the tractions of interfaces, the one that `carried` assumes, with the pressure of a flat
interface as it varies; the attribute `initial_stress` of the file names the choice.
States of materials are those of the last step, `Material.recorded_states`; NaN at the nodes of bodies without them. The
attribute `states` lists their names.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.initial_stress import matrices
from ruptfx.bodies.operators import ufl_form
from ruptfx.bodies.operators.matrix_free import MatrixFree
from ruptfx.input.fields import stress_entries
from ruptfx.interfaces.faults.interface import local_frame
from ruptfx.platform import fem, parallel
from ruptfx.platform.distributed_rows import RowDistribution
from ruptfx.run.recording import xdmf
from ruptfx.run.recording.shared_file import SharedFile

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.interfaces.faults.fault import Fault
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
    initial_stress : ndarray, shape (stress components,)
        Initial stress of the bodies [Pa], in the order of the file; the mean where it varies.
    initial_stress_from : str
        ``given``, ``none``, or the assumption.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self._stresses = stress_entries(model.case.plane, model.components)
        # In antiplane stress is a vector.
        self._entries: list[Any] = [entry if model.components > 1 else entry[0] for entry in self._stresses.values()]
        self._fields = [name for name in FIELDS if name in model.case.output.bulk_fields]
        self._states = recorded_states(model) if "state" in model.case.output.bulk_fields else {}
        self._type = np.dtype({"double": "f8", "single": "f4"}[model.case.output.bulk_precision])
        self.initial_stress, self.initial_stress_from = self._initial_stress()
        self._uneven = self._uneven_pressure()
        if self._uneven is not None:
            self.initial_stress_from += ", but its pressure as it varies along it, everywhere across it"
        self._initial_at_nodes = self.initial_stress_at(model.coordinates)
        self._stress_forms: list[Any] | None = None
        self._volume: np.ndarray | None = None

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
        name, p = model.mesh.basix_cell().name, model.case.order
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
            file.whole.attrs["initial_stress"] = self.initial_stress_from
            if self._uneven is None and (model.case.initial_stress is None or model.case.initial_tensor is not None):
                file.whole.attrs["initial_stress_values"] = self.initial_stress
        file.flush()

    def restore(self, saved: Path, kept: int | None) -> None:
        """Append the first snapshots of another file, of any number of ranks; every rank reads its part."""
        with h5py.File(saved, locking=False) as file:
            for row, time in enumerate(file["time"][:kept]):
                here = self.model.layout.rows.here
                self.append(float(time), {name: file[name][row, here] for name in [*self._fields, *self._states]})

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
            entries["stress"] = self._stress(displacement, state)
        if self._states:
            entries |= {name: values[:, None] for name, values in self._state_values(displacement, state).items()}
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

    def _stress(self, displacement: np.ndarray, state: State) -> np.ndarray:
        """Return the total stress at local nodes, averaged over elements by mass lumping, tension positive [Pa]."""
        model, c = self.model, self.model.components
        if self._volume is None:
            test, dx = fem.ufl.TestFunction(model.space), model.measure()
            self._volume = fem.assemble_summed(
                model.space, sum(model.sum_of(test) * dx(i) for i in range(len(model.materials)))
            )[::c, None]
        vector = fem.dolfinx.la.vector(model.space.dofmap.index_map, len(self._entries))  # one exchange of all entries
        sums = vector.array.reshape(model.nodes, -1)
        sums[:] = 0
        if not (isinstance(model.operator, MatrixFree) and model.operator.add_stress(displacement, sums)):
            self._add_stress(displacement, sums)
        for name, sweep in model.memory.items():
            sweep.add_inelastic_stress(displacement, state.memory[name], sums)
        if model.comm.size > 1:
            vector.scatter_reverse(fem.dolfinx.la.InsertMode.add)
            vector.scatter_forward()
        stress = sums / self._volume
        stress += self._initial_at_nodes
        return stress

    def _state_values(self, displacement: np.ndarray, state: State) -> dict[str, np.ndarray]:
        """Return recorded states at local nodes by name, averaged over the elements that have them; collective.

        The weights are those of stresses, by mass lumping.
        """
        model, names = self.model, list(self._states)
        vector = fem.dolfinx.la.vector(model.space.dofmap.index_map, 2 * len(names))
        sums = vector.array.reshape(model.nodes, 2, -1)
        sums[:] = 0
        for body, sweep in model.memory.items():
            if not sweep.law.recorded:
                continue
            of_body = np.zeros((model.nodes, len(sweep.law.recorded) + 1))
            sweep.add_recorded(displacement, state.memory[body], of_body)
            places = [names.index(name) for name in sweep.law.recorded]
            sums[:, 0, places] += of_body[:, :-1]
            sums[:, 1, places] += of_body[:, -1:]
        if model.comm.size > 1:
            vector.scatter_reverse(fem.dolfinx.la.InsertMode.add)
            vector.scatter_forward()
        volume = sums[:, 1]
        values = np.where(volume > 0, sums[:, 0] / np.where(volume > 0, volume, 1.0), np.nan)
        return dict(zip(names, values.T, strict=True))

    def _add_stress(self, displacement: np.ndarray, sums: np.ndarray) -> None:
        """Add the stress as `MatrixFree.add_stress` defines it, for any material and element."""
        model, ufl = self.model, fem.ufl
        space, c = model.space, model.components
        if self._stress_forms is None:
            self._displacement = fem.dolfinx.fem.Function(space)
            test, dx = ufl.TestFunction(space), model.measure()
            large = model.bulk.large_rotations
            variable = ufl.variable(ufl_form.strain(self._displacement, model.mesh, model.case.plane, large))
            forms = []
            entries = self._entries
            for pair in [entries[i : i + c] for i in range(0, len(entries), c)]:
                form: Any = 0
                for index in range(len(model.bulk.materials)):
                    stress = ufl.diff(ufl_form.energy_density(model.bulk, index, variable), variable)
                    if stress.ufl_shape[1:]:  # an energy may be a formula of one of two equal components
                        stress = ufl.sym(stress)
                    if large:  # as it is turned with the body; volumes hardly change
                        turn = ufl_form.rotation(self._displacement)
                        stress = turn * stress * turn.T
                    picked = [stress[entry] for entry in pair] + [0.0] * (c - len(pair))
                    form += (picked[0] * test if c == 1 else ufl.inner(ufl.as_vector(picked), test)) * dx(index)
                forms.append((fem.form(form), len(pair)))
            self._stress_forms = forms
        self._displacement.x.array[:] = displacement
        first = 0
        for form, used in self._stress_forms:
            vector = np.zeros_like(displacement)
            fem.dolfinx.fem.assemble_vector(vector, form)
            sums[:, first : first + used] += vector.reshape(-1, c)[:, :used]
            first += used

    def initial_stress_at(self, points: np.ndarray) -> np.ndarray:
        """Return the initial stress of the bodies at points, shape (points, stress components) [Pa].

        A varying pressure on a flat interface in 2D is constant across it: the normal stress of a point is that
        of the interface at the foot of its perpendicular. That is in equilibrium, and where the pressure is linear
        along the interface it is an elastic state as well.
        """
        initial_stress = self.model.case.initial_stress
        if initial_stress is not None:
            whole = matrices(initial_stress.effective(points))
            return np.stack([whole[:, i, j] for i, j in self._entries], axis=1)
        stress = np.tile(self.initial_stress, (len(points), 1))
        if self._uneven is not None:
            tangent, place, excess, across = self._uneven
            stress -= np.interp(points @ tangent, place, excess)[:, None] * across
        return stress

    @property
    def _reference(self) -> Fault:
        """Interface whose tractions the assumed stress carries: the one with most points, then the first by name."""
        return min(self.model.faults, key=lambda fault: (-fault.interface.total, fault.name))

    def _uneven_pressure(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
        """Return tangent of the reference interface, positions, pressure beyond the mean [Pa], and n n' as in the file.

        None if the pressure is uniform, the interface not flat, or the stress given; collective.
        """
        model = self.model
        flat = model.case.plane in ("stress", "strain")
        if not model.faults or not flat or model.case.initial_tensor is not None or model.case.initial_stress:
            return None
        fault = self._reference
        face = fault.interface
        rows = np.column_stack([face.points, fault.normal_stress_0, face.frame[:, 0]])[face.owned]
        rows = parallel.share_rows(model.comm, rows)
        points, pressure, normals = rows[:, :2], rows[:, 2], rows[:, 3:]
        normal = normals[0]
        if np.abs(normals - normal).max() > 1e-6 or np.ptp(pressure) < 1e-9 * np.abs(pressure).max():
            return None
        across = np.array([np.outer(normal, normal)[entry] for entry in self._entries])
        mean = -float(self.initial_stress @ (across * [1, 1, 2]))
        tangent = np.array([normal[1], -normal[0]])
        place = points @ tangent
        order = np.argsort(place)
        return tangent, place[order], pressure[order] - mean, across

    def _initial_stress(self) -> tuple[np.ndarray, str]:
        """Return the uniform initial stress and its origin; collective."""
        model, entries = self.model, self._entries
        value = model.case.initial_tensor
        if model.case.initial_stress is not None and value is None:
            return np.zeros(len(entries)), "given, as it varies in the bodies"
        if value is not None:
            return np.array([value[entry] for entry in entries]), "given"
        if not model.faults:
            return np.zeros(len(entries)), "none"
        if model.case.plane == "axisymmetric":
            return np.zeros(len(entries)), "unknown: what carries the tractions is left out"
        fault = self._reference
        stress = self._carried_by(fault)
        if not stress.any() and parallel.largest(model.comm, np.abs(fault.normal_stress_0).max(initial=0)) == 0:
            return np.zeros(len(entries)), "none"
        text = (
            f"assumed: the uniform stress that carries the mean initial tractions of interface '{fault.name}', all "
            "other components zero"
        )
        return np.array([stress[entry] for entry in entries]), text

    def _carried_by(self, fault: Fault) -> np.ndarray:
        """Return the stress of `carried` from the mean normal and tractions of an interface; collective."""
        model, face = self.model, fault.interface
        # The normal that leaves the plus body points into the minus one.
        outward = fem.ufl.FacetNormal(model.mesh)
        measure = model.edge_measure(model.bodies.tags[f"{fault.name}.plus"])
        area = [-fem.dolfinx.fem.assemble_scalar(fem.form(n * measure)) for n in outward]
        weight = face.owned * face.weight
        sums = parallel.total(
            model.comm, [*area, weight.sum(), weight @ fault.normal_stress_0, *(weight @ fault.shear_traction_0)]
        )
        dim = model.mesh.geometry.dim
        normal, (total, pressure, *shear) = sums[:dim], sums[dim:]
        return carried(normal / np.linalg.norm(normal), pressure / total, np.array(shear) / total, model.components)

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


def carried(normal: np.ndarray, pressure: float, shear: np.ndarray, components: int) -> np.ndarray:
    """Return the stress with given tractions on planes of a normal and no other component in their frame.

    With the tangents t_k it is -pressure n n' + sum_k shear_k (n t_k' + t_k n'); stresses along the plane, which
    tractions do not determine, are zero.

    Parameters
    ----------
    normal : ndarray, shape (dim,)
        Unit normal n.
    pressure : float
        Positive in compression [Pa].
    shear : ndarray, shape (tangents,)
        Shear tractions along the tangents of `local_frame`, in antiplane along z [Pa].
    components : int
        Number of components of the displacement.

    Returns
    -------
    ndarray, shape (dim, dim), in antiplane (2,) with the components xz and yz
        Tension positive [Pa].
    """
    if components == 1:
        return shear[0] * normal
    frame = local_frame(normal[None])[0]
    local = np.diag([-pressure] + [0.0] * (len(frame) - 1))
    local[0, 1:] = local[1:, 0] = shear
    return frame.T @ local @ frame
