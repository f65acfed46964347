"""TPV12 and TPV13 in the plane: a normal fault that dips at 60 degrees, in elastic rock and in rock that yields.

Section along the dip through the SCEC/USGS benchmarks, in plane strain: half space under weight, pore pressure and
tectonic stress, slip weakening with cohesion, and a patch of 3 km of lower static friction, 12 km down dip, of which
the initial shear stress exceeds the strength. TPV13 has Drucker-Prager plasticity without dilatancy; the relaxation
time is 0.03 s, as one of the published codes takes it.

The benchmarks are three-dimensional, and the plane has no published curve: a rupture that is endless along strike is
another one. Checked are the energy budget, the slip rate in rock that yields against that in elastic rock, and times of
rupture on nodes 150 and 75 m apart, with `--fine` 50 m, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import Table
from ruptfx.app.bench import Check
from ruptfx.bodies.meshes import MeshSource, RawMesh
from ruptfx.case import Case
from ruptfx.platform import parallel
from ruptfx.run.model import Model

if TYPE_CHECKING:
    from ruptfx.platform.fem import MPI

DIP = np.pi / 3
ELASTIC: Table = {"kind": "isotropic_elastic", "density": 2700.0, "c_p": 5716.0, "c_s": 3300.0}
YIELDING: Table = {
    **ELASTIC, "kind": "drucker_prager", "cohesion": 5e6, "friction_angle": float(np.arctan(0.85)),
    "relaxation_time": 0.03,
}  # fmt: skip
SLIP = 0.05  # m, that marks the front
DURATION = 3.5  # s: waves that the sides and the bottom send back reach the fault above 12 km down dip later
STATIONS = (7.5e3, 4.5e3, 1.5e3)
"""Positions down dip [m]."""


class Section(MeshSource):
    """A section with a fault that dips at 60 degrees from the surface to the bottom.

    Elements follow the fault; their columns become vertical towards the sides.
    """

    half_length: float = 24e3
    down_dip: float = 24e3
    size: float

    def build(self) -> RawMesh:
        """Return the elements of both walls row by row."""
        points: list[np.ndarray] = []
        cells, facets = [], []
        edges: dict[str, np.ndarray] = {}
        rows = round(self.down_dip / self.size)
        s = np.linspace(0.0, self.down_dip, rows + 1)
        first = 0
        for name, low, high in (("foot", -self.half_length, 0.0), ("hanging", 0.0, self.half_length)):
            x = np.linspace(low, high, round(self.half_length / self.size) + 1)
            # The fault is at x = s cos(dip) at depth s sin(dip); the sides of the section are vertical.
            moved = s[:, None] * np.cos(DIP) * (1 - np.abs(x) / self.half_length)
            height = np.broadcast_to(-s[:, None] * np.sin(DIP), moved.shape)
            points.append(np.stack([x + moved, height], axis=-1).reshape(-1, 2))
            number = first + np.arange(moved.size).reshape(moved.shape)
            first += moved.size
            below, above = number[1:], number[:-1]
            cells.append(np.stack([below[:, :-1], below[:, 1:], above[:, :-1], above[:, 1:]], axis=-1).reshape(-1, 4))
            fault, side = (number[:, -1], number[:, 0]) if name == "foot" else (number[:, 0], number[:, -1])
            facets.append(np.stack([fault[:-1], fault[1:]], axis=1))
            edges |= {
                f"{name}.{edge}": np.stack([line[:-1], line[1:]], axis=1)
                for edge, line in (("top", number[0]), ("bottom", number[-1]), ("side", side))
            }
        return RawMesh(
            "quadrilateral", np.concatenate(points), np.concatenate(cells), bodies=["foot", "hanging"],
            cell_body=np.repeat([0, 1], [len(each) for each in cells]), edges=edges,
            interfaces={"main": (facets[1], facets[0])},
        )  # fmt: skip


def case(material: Table, size: float) -> Case:
    """Return the section with elements of order 4 of a size [m]."""
    patch = {"kind": "boxcar", "inside": 0.54, "outside": 0.70, "center": 12e3, "half_width": 1.5e3}
    deep = {"kind": "layers", "boundaries": [15e3], "values": [0.0, 1e3]}
    law = {"kind": "linear_slip_weakening", "mu_s": {"kind": "sum", "terms": [patch, deep]}, "mu_d": 0.10, "D_c": 0.50}
    return Case.model_validate({
        "plane": "strain", "order": 4, "duration": DURATION, "mesh": Section(size=size),
        "materials": {"default": material},
        "initial_stress": {
            "kind": "depth", "density": 2700.0, "fluid_density": 1000.0, "gravity": 9.8, "along": 0.3496,
            "across": 0.6748, "isotropic": [11951.0, 11951.0],
        },
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": {"kind": "cohesion", "c": 0.2e6, "law": law},
        }},
        "damping": {"kelvin_voigt": {"fraction": 0.1, "thickness": 600.0}}, "output": {"figures": False},
    })  # fmt: skip


@dataclass
class Rupture:
    """Fields of a run at the points of the fault, in the order of the distance down dip.

    Attributes
    ----------
    down_dip : ndarray
        [m].
    time : ndarray
        Of a slip of `SLIP` [s].
    peak : ndarray
        Largest slip rate [m/s].
    slip : ndarray
        At the end [m].
    closure : float
        Unaccounted energy over the work of the initial stress.
    """

    down_dip: np.ndarray
    time: np.ndarray
    peak: np.ndarray
    slip: np.ndarray
    closure: float

    def at(self, field: str, place: float) -> float:
        """Return a field at a distance down dip [m]."""
        return float(np.interp(place, self.down_dip, getattr(self, field)))


def rupture(material: Table, size: float, comm: MPI.Comm, duration: float = DURATION) -> Rupture:
    """Return a run until a time [s]."""
    given = case(material, size)
    model = Model(given, comm)
    state, motion = model.initial_state(), given.stepper.bind(model)
    face = model.faults[0].interface
    peak, time = np.zeros(len(face.points)), np.full(len(face.points), np.inf)
    while state.time < duration:
        motion.step(state)
        fields = state.faults["main"]
        peak = np.maximum(peak, np.abs(fields["slip_rate"]).reshape(len(peak), -1)[:, 0])
        slip = np.abs(fields["slip"]).reshape(len(peak), -1)[:, 0]
        time = np.where(np.isinf(time) & (slip > SLIP), state.time, time)
    energies = model.energies(state)
    work = energies.pop("boundary_work")
    closure = (sum(energies.values()) - work) / work
    down = np.linalg.norm(face.points, axis=1)
    rows = parallel.share_rows(comm, np.column_stack([down, time, peak, slip]))
    down, time, peak, slip = rows[np.argsort(rows[:, 0])].T
    return Rupture(down, time, peak, slip, float(closure))


def run(fine: bool, comm: MPI.Comm) -> list[Check]:
    sizes = (600.0, 300.0, 200.0)[: 2 + fine]
    found = {
        name: {size: rupture(material, size, comm) for size in sizes}
        for name, material in (("elastic", ELASTIC), ("yielding", YIELDING))
    }
    finest, checks = sizes[-1], []
    for name, runs in found.items():
        for size, each in runs.items():
            nodes = f"nodes {size / 4:g} m apart"
            checks.append(Check(f"{name} rock, {nodes}: energy closure", 0.0, each.closure, 1e-12, "1", "exact"))
        for place in STATIONS:
            times = [runs[size].at("time", place) for size in (sizes[-2], finest)]
            checks.append(Check(
                f"{name} rock, {place / 1e3:g} km down dip: time of slip, nodes {sizes[-2] / 4:g} m apart", times[1],
                times[0], 0.05, "s", f"own {finest / 4:g} m",
            ))  # fmt: skip
    for place in STATIONS:
        ratio = found["yielding"][finest].at("peak", place) / found["elastic"][finest].at("peak", place)
        checks.append(Check(
            f"{place / 1e3:g} km down dip: largest slip rate over that in elastic rock", 1.0, ratio, relation="at most"
        ))  # fmt: skip
    return checks
