"""Tractions of surfaces in bodies that repeat along strike, in the place of `loaded_bodies`."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ruptfx.bodies.space.inside import CellBoxes, Inside
from ruptfx.input.schema import CaseError
from ruptfx.stepping.implicit.compliance import Jumps
from ruptfx.stepping.implicit.loaded_bodies import IMMOBILE, compliance, time_of_loads
from ruptfx.stepping.implicit.receivers import Receivers, rows_of
from ruptfx.stepping.implicit.response import FaultResponse
from ruptfx.stepping.implicit.strike_series import Loaded, StrikeSeries

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System

LOG = logging.getLogger("ruptfx.run")
UNIFORM = 1e-12  # change of the compliance of contact along strike that is rounding


class SurfaceResponses:
    """In the place of `Equilibrium`: the model for implicit steps and the responses of its faults.

    Parameters
    ----------
    model : System
    radiation : mapping of str to ndarray
        As in `Equilibrium`.
    """

    def __init__(self, model: System, radiation: Mapping[str, np.ndarray]) -> None:
        self.model = model = model.in_steps("implicit")
        threshold = model.case.output.rupture_threshold
        self.answers = {f.name: FaultResponse(f, threshold, radiation[f.name]) for f in model.faults}


class SeriesBodies:
    """Bodies that repeat along strike, in equilibrium with driven edges and with elastic contact of known slip.

    Parameters
    ----------
    model : System
    time : float
        First time at which loads are compared with others [s]; doubled until loads act.

    Attributes
    ----------
    jumps : Jumps
    prescribed : ndarray of bool, shape (points,)
        True at points whose slip follows the motion of the bodies.
    """

    def __init__(self, model: System, time: float) -> None:
        self._model, self.jumps = model, Jumps(model)
        section = model.section
        assert section is not None and section.mesh_table.along_strike is not None
        self._section, along = section, section.mesh_table.along_strike
        names, offset, row = [fault.name for fault in model.faults], 0, {}
        for name in names:
            row[name], offset = offset, offset + len(section.faces[name].plus)
        faces = {fault.name: fault.interface for fault in model.faults}
        first, spacing = along.positions[0], along.spacing
        place = {name: np.rint((face.points[:, 2] - first) / spacing) for name, face in faces.items()}
        below = {name: row[name] + section.points_of(name, face.points) for name, face in faces.items()}
        numbers = {name: place[name] * offset + below[name] for name in names}
        grid = np.rint(self.jumps.gather(numbers)).astype(np.int64)
        if not np.array_equal(np.sort(grid), np.arange(along.points * offset)):
            raise CaseError(
                f"mesh.along_strike: the interfaces of the section have {offset} points, their surfaces "
                f"{len(grid)} instead of {along.points * offset}: an interface ends inside welded bodies or on another "
                "one; take a mesh whose interfaces end at an edge"
            )
        in_order = np.array_equal(grid, np.arange(len(grid)))  # of one interface whose points go down dip
        orders: tuple[Any, Any] = (slice(None),) * 2 if in_order else (np.argsort(grid), grid)
        self._order, self._place = orders
        self._grid = (along.points, offset)
        contact = self._on_grid(self.jumps.gather({fault.name: compliance(fault) for fault in model.faults}))
        if np.abs(np.ptp(contact, axis=0)).max() > UNIFORM * contact.max():
            raise CaseError(
                "faults.contact: its stiffness varies along strike, and that of a section that repeats "
                "(mesh.along_strike) does not; give C_n and C_s that vary down dip only"
            )
        self._contact = contact[0]
        self.series = StrikeSeries(section, names, contact[0], along.period, along.points, model.comm)
        LOG.info("%s", self.series.report)
        own = self.series.own[:, 1:]
        immobile = np.any(own < IMMOBILE * own.max(), axis=1)
        self.prescribed = np.broadcast_to(immobile, self._grid).ravel()[grid]
        self._area = self.series.weight[::3] * along.spacing
        self._immobile, self._free = immobile[:, None], self._area[:, None] * ~immobile[:, None]
        self._length = along.period
        moved = self._moved(time_of_loads(time, model.case.duration, lambda t: bool(self._moved(t).any())))
        self._reference = moved, self.series.loaded(moved)

    def _on_grid(self, values: np.ndarray) -> np.ndarray:
        """Return values of all points by place along strike and point of the section."""
        return values[self._order].reshape(*self._grid, *values.shape[1:])

    def _moved(self, time: float) -> np.ndarray:
        """Return the displacement of driven edges [m], zero at other degrees of freedom of the section."""
        return self._section.loads.moved(np.zeros(3 * self._section.nodes), 0.0, time)

    def _loaded(self, time: float) -> Loaded:
        """Return the response to the loads of a time, a multiple of the reference where loads are proportional."""
        moved, (old, reference) = self._moved(time), self._reference
        square = float(old @ old)
        part = float(moved @ old) / square if square > 0 else 0.0
        if not np.allclose(moved, part * old, 1e-12, 0.0):
            return self.series.loaded(moved)
        return Loaded(part * reference.traction, part * reference.jump, part**2 * reference.energy,
                      part * reference.displacement)  # fmt: skip

    def loaded_jump(self, time: float) -> np.ndarray:
        """Return the jump of bodies with stuck faults under the loads of a time, shape (points, local) [m]."""
        jump = self._loaded(time).jump
        return np.array(np.broadcast_to(jump, (self._grid[0], *jump.shape)).reshape(-1, 3)[self._place])

    def held(self, jump: np.ndarray) -> np.ndarray:
        """Return T - T_0 [Pa] without slip from `loaded_jump` [m], both of shape (points, local); it is linear."""
        traction = self.series.held(self._on_grid(jump)[0])
        return np.array(np.broadcast_to(traction, (self._grid[0], *traction.shape)).reshape(-1, 3)[self._place])

    def traction(self, held: np.ndarray, slip: np.ndarray) -> np.ndarray:
        """Return T - T_0 [Pa], shape (points, local); collective.

        Parameters
        ----------
        held : ndarray, shape (points, local)
            That without slip [Pa].
        slip : ndarray, shape (points, tangents)
            [m]
        """
        return np.asarray(held - self.series.traction(self._on_grid(slip)).reshape(-1, 3)[self._place])

    def displacement(
        self, moved: np.ndarray, time: float, slip: np.ndarray, traction: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return displacement [m] and force [N] of the layer beside the surfaces; it carries no force.

        Its jump is that of the interfaces, half of it on each side.
        """
        del moved, time
        model = self._model
        nodal = np.zeros((model.nodes, model.components))
        for fault in model.faults:
            face = fault.interface
            local = np.pad(self.jumps.pick(slip, fault.name), ((0, 0), (1, 0)))
            local += compliance(fault) * self.jumps.pick(traction, fault.name)
            factor = face.jump_factor if face.one_sided else np.full(3, 2.0)
            half = np.where(factor > 0, local / np.where(factor > 0, factor, 1.0), 0.0)
            vector = np.einsum("ikc,ik->ic", face.frame, half)
            nodal[face.plus] = vector
            if not face.one_sided:
                nodal[face.minus] = -vector
        return nodal.ravel(), np.zeros(nodal.size)

    def receivers(self, points: Sequence[Sequence[float]], key: str) -> Receivers:
        """Return receivers at points of the bodies [m], on one rank.

        Raises
        ------
        CaseError
            A point is outside of the bodies; the message begins with the key.
        """
        section, along = self._section, self._section.mesh_table.along_strike
        assert along is not None
        boxes = CellBoxes.of(section)
        places = [Inside(section, point[:2], None, key, boxes=boxes, first=True) for point in points]
        rows = rows_of(section, places)
        strike = np.array([point[2] for point in points]) - along.positions[0]
        motion = self.series.motion_by_slip(rows, strike)
        return Receivers(
            lambda time: np.asarray(rows @ self._loaded(time).displacement), lambda slip: motion(self._on_grid(slip)),
            self._model.case.duration,
        )  # fmt: skip

    def strain_energy(self, time: float, slip: np.ndarray, traction: np.ndarray) -> float:
        """Return the energy of the bodies of a period [J], without that of contact, from slip and T - T_0."""
        loaded, s, T = self._loaded(time), self._on_grid(slip), self._on_grid(traction)
        shear = loaded.traction[:, 1:]
        by_slip = -0.5 * np.sum(self._free * s * (shear + T[..., 1:]))
        return float(loaded.energy * self._length + by_slip - 0.5 * np.sum(self._free * self._contact * T**2))

    def work(
        self, times: tuple[float, float], slips: tuple[np.ndarray, np.ndarray],
        tractions: tuple[np.ndarray, np.ndarray],
    ) -> float:  # fmt: skip
        """Return the work of driven edges between two times [J], for slip and T - T_0 that are linear between them."""
        first, last = (self._loaded(time) for time in times)
        s, T = ([self._on_grid(each) for each in pair] for pair in (slips, tractions))
        by_loads = 0.5 * np.sum(self._free * (last.traction - first.traction)[:, 1:] * (s[0] + s[1]))
        moved = np.pad(s[1] - s[0], ((0, 0), (0, 0), (1, 0))) + self._contact * (T[1] - T[0])
        at_driven = 0.5 * np.sum(self._area[:, None] * self._immobile * (T[0] + T[1]) * moved)
        return float((last.energy - first.energy) * self._length - by_loads + at_driven)
