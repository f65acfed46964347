"""Energy and checks of slip that is prescribed; the points of the interfaces do the steps (`interfaces.faults`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.input.fields import PRESCRIBED, Energy
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.mechanisms import Mechanism
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.checks.table import Plan
    from ruptfx.interfaces.mechanisms.system import System

IMMOBILE = 1e-9
"""Part of a motion, or of the largest slip, that is rounding."""
DRIVEN_TIMES = 11
TIMES = 201
"""Times at which the check asks for the slip rate."""


class PrescribedSlips(Mechanism):
    """The column of the energy table, and what `ruptfx check` says of the histories."""

    energies = (
        Energy(PRESCRIBED, "energy that prescribed slip takes from the bodies, negative if it drives", "dissipated"),
    )
    adjoint = False
    local_steps = True

    def __init__(self, model: System) -> None:
        super().__init__(model)
        for fault in model.faults:
            if fault.prescribed is not None:
                parallel.raise_on_all(model.comm, self._contradiction(fault))

    def _contradiction(self, fault: Fault) -> CaseError | None:
        """Return the error of points whose two sides are driven otherwise than their slip says; None without one."""
        slip, face, loads = fault.prescribed, fault.interface, self.model.loads
        assert slip is not None
        free = (~loads.prescribed).reshape(self.model.nodes, -1).astype(float)
        moves = free[face.plus] + (0.0 if face.one_sided else free[face.minus])
        mobility = np.einsum("ikc,ic->ik", face.rows**2, moves)[:, int(face.has_normal) :]
        driven = slip.held & np.all(mobility < IMMOBILE, axis=1)
        for time in np.linspace(0, self.model.case.duration, DRIVEN_TIMES):
            wanted = slip.slip(time)
            jump = face.split(face.jump(loads.moved(np.zeros(len(self.model.mass)), 0.0, time)))[1]
            off = np.abs(jump - wanted).max(axis=1, initial=0.0)
            wrong = driven & (off > IMMOBILE * np.abs(wanted).max(initial=0.0))
            if np.any(wrong):
                point = int(np.argmax(wrong * off))
                x = ", ".join(f"{value:.6g}" for value in face.points[point])
                return CaseError(
                    f"faults.{fault.name}.prescribed_slip: slips {np.linalg.norm(wanted[point]):.4g} m at time "
                    f"{time:.6g} s "
                    f"at ({x}) m, where boundaries drive both sides, with a jump of "
                    f"{np.linalg.norm(jump[point]):.4g} m; "
                    "let slip vanish there (where), or drive the edges with it"
                )
        return None

    @classmethod
    def present(cls, model: System) -> bool:
        return any(fault.prescribed is not None for fault in model.faults)

    def check(self, plan: Plan) -> Iterator[Row]:
        for fault in self.model.faults:
            if fault.prescribed is not None and len(fault.interface.plus):
                yield from self._rows(fault)

    def _rows(self, fault: Fault) -> Iterator[Row]:
        slip, duration, label = fault.prescribed, self.model.case.duration, f"faults.{fault.name}: prescribed slip"
        assert slip is not None
        held, area = slip.held, fault.interface.area
        part = float(area[held].sum() / area.sum())
        notes = dict.fromkeys(each.note for each in slip.histories if each.note)
        yield Row(f"{label}, part of the area", part, "", "; ".join(notes))
        final = np.linalg.norm(slip.slip(duration), axis=1)
        yield Row(f"{label}, largest at the end", float(final.max()), "m", "", "ok" if final.any() else "warning")
        peak = max(float(np.linalg.norm(slip.rate(t), axis=1).max()) for t in np.linspace(0, duration, TIMES))
        yield Row(f"{label}, peak rate", peak, "m/s", f"of {TIMES} times")
