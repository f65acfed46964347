"""Energy and checks of slip that is prescribed; the points of the interfaces do the steps (`interfaces.faults`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.input.fields import PRESCRIBED, Energy
from ruptfx.interfaces.mechanisms import Mechanism
from ruptfx.interfaces.mechanisms.checks.table import Row

if TYPE_CHECKING:
    from ruptfx.interfaces.faults.fault import Fault
    from ruptfx.interfaces.mechanisms.checks.table import Plan
    from ruptfx.interfaces.mechanisms.system import System

TIMES = 201
"""Times at which the check asks for the slip rate."""


class PrescribedSlips(Mechanism):
    """The column of the energy table, and what `ruptfx check` says of the histories."""

    energies = (
        Energy(PRESCRIBED, "energy that prescribed slip takes from the bodies, negative if it drives", "dissipated"),
    )
    adjoint = False

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
