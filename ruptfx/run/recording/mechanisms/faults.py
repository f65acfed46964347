"""Histories of the fields at the points of interfaces."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.bodies.space.edges import Edge
from ruptfx.input.fields import ADDED_SHEAR
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.interface import FLAT, Interface
from ruptfx.interfaces.faults.sides import Sides, sides_of
from ruptfx.interfaces.mechanisms.faults import Faults
from ruptfx.laws.nucleation import first_begun
from ruptfx.platform import fem, parallel
from ruptfx.run.recording.interface_file import InterfaceFile
from ruptfx.run.recording.mechanisms import Opening, Records

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model


OF_LINES = {"space_time": 2, "snapshots": 9, "slip_profiles": 2, "front": 2}
OF_SURFACES = {"rupture_map": 6, "slip_rate_maps": 8, "moment_rate": 1}
"""Figures of the two kinds of interfaces, each with its cost in plain panels."""


class FaultRecords(Records):
    """`interface.h5`, or `interface_NAME.h5` for each of several faults."""

    of = Faults

    def __init__(self, model: Model, mechanisms: Sequence[Faults]) -> None:
        super().__init__(model, mechanisms)
        surfaces = [fault.interface.across is not None for fault in model.faults]
        self.figures = OF_SURFACES if all(surfaces) else OF_LINES
        self._of = {fault.name: mechanism for mechanism in mechanisms for fault in mechanism.faults}
        self._places: list[dict[str, np.ndarray]] = []
        self._sides: list[Sides] = []
        self._frames: list[np.ndarray | None] = []
        self._loaded: list[float] = []
        self._files: dict[str, InterfaceFile] = {}

    def names(self) -> list[str]:
        return [file_name(self.model, fault, "interface", "h5") for fault in self.model.faults]

    def gather(self) -> None:
        self._sides = [sides_of(self.model, fault.interface) for fault in self.model.faults]
        self._frames = [_frame(self.model.comm, fault.interface) for fault in self.model.faults]
        self._places = [
            _columns(self.model.comm, fault.interface, sides)
            for fault, sides in zip(self.model.faults, self._sides, strict=True)
        ]
        self._loaded = [self._loaded_end(place) for place in self._places]

    def _loaded_end(self, place: dict[str, np.ndarray]) -> float:
        """Return the position of the end of an interface next to the edge that is driven fastest [m]; collective.

        Without one, and where both ends are as near, it is the first position; NaN on other ranks than 0.
        """
        model, ends = self.model, None
        if model.comm.rank == 0:
            points = np.stack([place[axis] for axis in "xyz" if axis in place], axis=1)
            ends = points[[0, -1], : model.coordinates.shape[1]]
        ends = model.comm.bcast(ends, root=0)
        driven = model.case.driven_edges if model.section is None else []  # edges of a section are beside no end
        nodes = [model.coordinates[Edge(model, name, "boundaries").nodes] for name in driven]
        apart = [
            -parallel.largest(model.comm, max((-np.linalg.norm(x - end, axis=1).min(initial=np.inf) for x in nodes),
                                              default=-np.inf))
            for end in ends
        ]  # fmt: skip
        last = apart[1] < (1 - 1e-9) * apart[0]
        return float(place["position"][-1 if last else 0]) if model.comm.rank == 0 else np.nan

    def open(self, opening: Opening) -> None:
        rows = zip(self.model.faults, self._places, self._sides, self._frames, self._loaded, self.names(), strict=True)
        for fault, place, sides, frame, loaded, name in rows:
            attributes = self._attributes(fault, place, sides, frame) | {"loaded_end": loaded} | opening.about
            fields = self._of[fault.name].recorded_fields()
            self._files[fault.name] = InterfaceFile(
                opening.out / name, fault, place, attributes, opening.kept("interface"), fields
            )

    def read(self, state: State) -> tuple[float, dict[str, dict[str, np.ndarray]]]:
        return state.fault_time, {fault.name: self._gather(fault, state) for fault in self.model.faults}

    def _gather(self, fault: Fault, state: State) -> dict[str, np.ndarray]:
        """Return every field of a fault in order along the interface, on rank 0; needs an up-to-date displacement."""
        face, fields = fault.interface, self._of[fault.name].recorded(fault, state)
        if fault.is_loaded:
            added = fault.load(state.fault_time) - fault.load(0.0)
            fields = fields | dict(zip(ADDED_SHEAR.names(fault.tangents), added.T, strict=True))
        return parallel.gather_fields(self.model.comm, face.number, face.owned, fields)

    def append(self, time: float, data: dict[str, dict[str, np.ndarray]]) -> None:
        for name, fields in data.items():
            self._files[name].append(time, fields)

    def largest_slip_rate(self, data: dict[str, dict[str, np.ndarray]]) -> float:
        rates = [v for each in data.values() for name, v in each.items() if name.startswith("slip_rate")]
        return float(max((np.abs(rate).max() for rate in rates), default=0.0))

    def reopen(self) -> list[Path]:
        for file in self._files.values():
            file.reopen()
        return [file.path for file in self._files.values()]

    def complete(self) -> None:
        for file in self._files.values():
            file.complete()

    def close(self) -> None:
        for file in self._files.values():
            file.close()

    def numbers(self, records: int, snapshots: int) -> float:
        numbers = 0.0
        for fault in self.model.faults:
            recorded = [field for field in self._of[fault.name].recorded_fields() if field.recorded]
            names = [name for field in recorded for name in field.names(fault.tangents)]
            numbers += records * fault.interface.total * (len(names) + len(fault.state_fields()))
        return numbers

    def _attributes(self, fault: Fault, place: dict[str, np.ndarray], sides: Sides, frame: np.ndarray | None) -> Table:
        case, line, bodies = self.model.case, fault.interface.line, self.model.bodies
        about: Table = {}
        if not (body := self.model.materials[bodies.names.index(next(iter(sides.bodies)))]).isotropic:
            about["mach_free_speed"] = np.nan if frame is None else body.mach_free_speed(case.plane, frame)
        onset, center = first_begun(fault.nucleation)
        return {
            "fault": fault.name, "position_measure": line.measure, "origin": line.origin, "plane": case.plane,
            # One over the mean slowness of the points.
            **{name: float(1 / np.mean(1 / place[name])) for name in ("c_p", "c_s", "c_R")},
            "bodies": list(sides.bodies), "c_p_of_bodies": np.array([c_p for c_p, _ in sides.bodies.values()]),
            "c_s_of_bodies": np.array([c_s for _, c_s in sides.bodies.values()]),
            "V_imp": case.impact_speed, "rupture_threshold": case.output.rupture_threshold,
            "complete": 0,
            "nucleation_time": onset, "nucleation_position": center,
            "record": "all fields of a record are those of its time; tractions, slip rate, slip and state satisfy the "
            "laws of contact and friction there",
            **about,
        }  # fmt: skip


def file_name(model: Model, fault: Fault, begin: str, ending: str) -> str:
    """Return the name of a file of a fault, without the name of the fault if it is the only one."""
    return f"{begin}.{ending}" if len(model.faults) == 1 else f"{begin}_{fault.name}.{ending}"


def _columns(comm: fem.MPI.Comm, face: Interface, sides: Sides) -> dict[str, np.ndarray]:
    """Return what does not change at the points of an interface, on rank 0.

    These are positions and coordinates [m], of a surface dip and area, moduli and wave speeds beside the points.
    """
    columns = {"position": face.position, **dict(zip("xyz", face.points.T, strict=False))}
    if face.across is not None:
        columns |= {"dip": face.across, "area": face.area}
    return parallel.gather_fields(comm, face.number, face.owned, columns | sides.columns())


def _frame(comm: fem.MPI.Comm, face: Interface) -> np.ndarray | None:
    """Return tangent, normal and second tangent of a plane interface; None of others, and in antiplane."""
    if not face.has_normal:
        return None
    dim = face.frame.shape[2]
    frames = parallel.share_rows(comm, face.frame[face.owned].reshape(-1, dim * dim))  # a rank may have no points
    if np.ptp(frames, axis=0).max() > FLAT:
        return None
    return np.asarray(frames[0].reshape(dim, dim)[[1, 0, 2][:dim]])
