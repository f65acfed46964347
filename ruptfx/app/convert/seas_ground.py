"""Displacement and velocity of stations off the fault, for the files of the SEAS code comparison.

The record of a run has the slip of its interfaces; the bodies of its case, built again, give the motion of any of their
points from it (`ruptfx.stepping.implicit.receivers`). Component 1 is horizontal, towards the plus side, the last one
downwards, and that between them along strike. Where the section is drawn along x, as `strike_slip_section`, x is depth.

Source: descriptions of the benchmarks BP3-QD, BP5-QD and BP7-QD-A, https://strike.scec.org/cvws/seas
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError
from ruptfx.input.schema import CaseError

if TYPE_CHECKING:
    from ruptfx.results.record import Record
    from ruptfx.run.model import Model

Array = np.ndarray
Station = tuple[float, ...]
"""Horizontal distance from the fault, positive on its plus side; of a surface position along strike, this distance, and
depth [m]."""

OF_LINE: tuple[Station, ...] = tuple((1e3 * off,) for off in (-32, -16, -8, -0.0, 0, 8, 16, 32))
OF_SURFACE: tuple[Station, ...] = tuple((1e3 * strike, 1e3 * off, 1e3 * down) for strike, off, down in (
    (-16, 8, 0), (0, 8, 0), (16, 8, 0), (0, 16, 0), (0, 32, 0), (0, 48, 0), (0, 8, 10), (16, 8, 10), (0, 32, 10)
))  # fmt: skip
OF_PATCH: tuple[Station, ...] = ((0, 200, 0), (0, 400, 0), (0, 400, 300), (300, 400, 0), (-300, 400, 0))
"""Stations of BP3, BP5 and BP7 [m]."""
ASIDE = 1e-6  # of the length of the interface: distance of stations on the fault, which has two sides
SMALL = 1e3  # m: within it names of stations are in m, as in BP7


@dataclass(frozen=True)
class Ground:
    """Motion of stations at the times of a record.

    Attributes
    ----------
    stations : list of tuple of float
    displacement, velocity : ndarray, shape (stations, times, components)
        [m], [m/s]
    """

    stations: list[Station]
    displacement: Array
    velocity: Array


def ground_motion(record: Record, name: str, stations: Sequence[Station]) -> Ground:
    """Return the motion of stations off an interface; without stations that of those of the benchmarks in the bodies.

    Raises
    ------
    RuptfxError
        Antiplane motion, another stepper, a station that is not in the bodies.
    """
    from ruptfx.case import Case, read_case
    from ruptfx.platform import fem
    from ruptfx.run.model import Model
    from ruptfx.stepping.steppers.quasi_dynamic import QuasiDynamic

    case = read_case(record.path / "case.toml")
    if not isinstance(case, Case) or not isinstance(case.stepper, QuasiDynamic) or case.plane == "antiplane":
        raise RuptfxError(
            "export --off-fault: bodies follow from the slip of the interfaces in plane strain, plane stress or three "
            "dimensions with stepper.kind = 'quasi_dynamic'; record others with [[instruments]] of kind 'receiver'"
        )
    model = Model(case, fem.MPI.COMM_SELF)
    place = _Places(model, name)
    for station in stations:  # before the matrices of the bodies are computed
        place.require_inside(station)
    motion = case.stepper.bind(model)
    wanted = list(stations) or place.of_benchmarks()
    slip, rate = (_gathered(record, model, field) for field in ("slip", "slip_rate"))
    receivers = motion.receivers([place.point(each) for each in wanted], "export --off-fault")
    times = record.interfaces[name]["time"].values
    turn = place.turned
    displacement = [turn(receivers.displacement(t, s)) for t, s in zip(times.tolist(), slip, strict=True)]
    velocity = [turn(receivers.velocity(t, v)) for t, v in zip(times.tolist(), rate, strict=True)]
    return Ground(wanted, np.moveaxis(np.array(displacement), 0, 1), np.moveaxis(np.array(velocity), 0, 1))


def _gathered(record: Record, model: Model, field: str) -> Array:
    """Return a vector field of all interfaces, shape (times, points, tangents)."""
    parts = []
    for fault in model.faults:
        data = record.interfaces[fault.name]
        names = [field] if fault.tangents == 1 else [f"{field}_{axis + 1}" for axis in range(fault.tangents)]
        parts.append(np.stack([data[each].values for each in names], axis=2))
    return np.concatenate(parts, axis=1)


class _Places:
    """Coordinates of stations of an interface, and components of their motion."""

    def __init__(self, model: Model, name: str) -> None:
        from ruptfx.bodies.space.inside import CellBoxes

        section = model.section
        self._bodies = model if section is None else section
        face = next(fault.interface for fault in model.faults if fault.name == name)
        line = face if section is None else section.faces[name]
        if len(line.points[0]) == 3:
            raise RuptfxError(
                "export --off-fault: the surface is no section that repeats along strike (mesh.along_strike); record "
                "its ground with [[instruments]] of kind 'receiver'"
            )
        points = line.points[np.argsort(line.position)]
        extent = points[-1] - points[0]
        normal = line.frame[:, 0, :2].mean(axis=0)
        if abs(extent[1]) <= 1e-6 * np.linalg.norm(extent):
            self.down, self.off = extent / np.linalg.norm(extent), normal
        else:
            self.down, self.off = np.array([0.0, -1.0]), np.array([np.sign(normal[0]), 0.0])
        self.first = points[np.argmin(points @ self.down)]
        self.aside, self.surface = ASIDE * float(np.linalg.norm(extent)), section is not None
        self.width = float(np.linalg.norm(extent))
        self._boxes = CellBoxes.of(self._bodies)

    def point(self, station: Station) -> list[float]:
        """Return the coordinates of a station [m].

        Raises
        ------
        RuptfxError
            Another number of positions.
        """
        count = 3 if self.surface else 1
        if len(station) != count:
            example = "'-16 km, 8 km, 0 km' (along strike, off the fault, depth)" if self.surface else "'8 km'"
            raise RuptfxError(
                f"export --off-fault has {len(station)} positions, and this interface needs {count}; write {example}"
            )
        off, depth = (station[1], station[2]) if self.surface else (station[0], 0.0)
        aside = off if off != 0 else float(np.copysign(self.aside, off))
        point: list[float] = (self.first + aside * self.off + depth * self.down).tolist()
        return [*point, station[0]] if self.surface else point

    def of_benchmarks(self) -> list[Station]:
        """Return the stations of the benchmarks that are in the bodies.

        Raises
        ------
        RuptfxError
            None is.
        """
        known = (OF_PATCH if self.width < 1e4 else OF_SURFACE) if self.surface else OF_LINE
        inside = [station for station in known if self._outside(station) is None]
        if not inside:
            raise RuptfxError(
                "export --off-fault benchmark: none of the stations of BP3, BP5 and BP7 is in the bodies; name some of "
                "them, as --off-fault '8 km'"
            )
        return inside

    def require_inside(self, station: Station) -> None:
        """Refuse a station that is not in the bodies.

        Raises
        ------
        RuptfxError
        """
        error = self._outside(station)
        if error is not None:
            shown = ", ".join(f"{x:g} m" for x in station)
            raise RuptfxError(f"export --off-fault '{shown}' is not in the bodies: {str(error).partition(' = ')[2]}")

    def _outside(self, station: Station) -> CaseError | None:
        from ruptfx.bodies.space.inside import Inside

        try:
            Inside(self._bodies, self.point(station)[:2], None, "export", boxes=self._boxes, first=True)
        except CaseError as error:
            return error
        return None

    def turned(self, motion: Array) -> Array:
        """Return the components of the files from those along the axes, shape (stations, components)."""
        parts = [motion[:, :2] @ self.off, *([motion[:, 2]] if self.surface else []), motion[:, :2] @ self.down]
        return np.stack(parts, axis=1)
