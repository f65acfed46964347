"""Layers of minerals across y."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ruptfx.plugin import Length, Phases


class Layered(Phases):
    """Layers of one thickness, each of a random phase."""

    example: ClassVar[str] = '{ kind = "layered", thickness = 2e-3, fractions = { feldspar = 0.7, quartz = 0.3 } }'
    thickness: Length
    """Thickness of a layer."""

    def phase_of(self, centres: NDArray[np.float64], element_size: float) -> NDArray[np.int64]:
        layer = np.floor((centres[:, 1] - centres[:, 1].min()) / self.thickness).astype(int)
        phases = self.drawn(int(layer.max()) + 1, np.random.default_rng(self.seed))
        return np.asarray(phases[layer])

    def draws(self, size: NDArray[np.float64], element_size: float) -> float:
        return float(size[1]) / self.thickness
