"""A phase drawn for every cell by itself."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies.phases import Phases


class RandomCells(Phases):
    """An independent random phase for every cell.

    Grains are then as small as cells, and results that depend on grains depend on the mesh.
    """

    example: ClassVar[str] = '{ kind = "random_cells", fractions = { feldspar = 0.7, quartz = 0.3 } }'

    def phase_of(self, centres: NDArray[np.float64], element_size: float) -> NDArray[np.int64]:
        return self.drawn(len(centres), np.random.default_rng(self.seed))
