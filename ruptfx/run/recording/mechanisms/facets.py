"""Snapshots and events of the facets along which bodies break."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.state import FaultState
from ruptfx.interfaces.mechanisms.facets import Facets
from ruptfx.run.recording.crack_files import NAMES, SNAPSHOTS, CrackFiles, facets_of
from ruptfx.run.recording.mechanisms import Opening, Records

if TYPE_CHECKING:
    from ruptfx.bodies.state import State
    from ruptfx.run.model import Model


class FacetRecords(Records):
    """`cracks.h5`, `cracks.xdmf` and `events.h5`, at every snapshot of the bodies."""

    of = Facets
    schedule = "bulk"
    figures = {"cracks": 6, "emission": 12}
    memory, pictures = 160e6, 1.1e6

    def __init__(self, model: Model, mechanisms: Sequence[Facets]) -> None:
        super().__init__(model, mechanisms)
        (mechanism,) = mechanisms
        self._cracks = mechanism.cracks
        self._facets: dict[str, np.ndarray] = {}
        self._files: CrackFiles | None = None

    def names(self) -> list[str]:
        return list(NAMES)

    def gather(self) -> None:
        self._facets = self._cracks.gather(facets_of(self._cracks))

    def open(self, opening: Opening) -> None:
        bodies, thickness = self.model.bodies, self._cracks.fracture.thickness
        joints, kept = list(bodies.joints), opening.kept("bulk")
        speeds = [material.wave_speeds(self.model.case.plane) for material in self.model.materials]
        self._files = CrackFiles(opening.out, self._facets, bodies.names, speeds, joints, thickness, kept)

    def read(self, state: State) -> tuple[float, FaultState]:
        return state.fault_time, self._cracks.gather(state.cracks)

    def append(self, time: float, data: FaultState) -> None:
        assert self._files is not None
        self._files.append(time, data)

    def reopen(self) -> list[Path]:
        assert self._files is not None
        return self._files.reopen()

    def close(self) -> None:
        if self._files is not None:
            self._files.close()

    def numbers(self, records: int, snapshots: int) -> float:
        # Once per facet: ends, line, normal, length, bodies; per snapshot: its fields, the status with one byte.
        return int(self._cracks.owned.sum()) * (10 + snapshots * (len(SNAPSHOTS) - 1 + 1 / 8))
