"""Grains: cells of a Voronoi tessellation, each of one phase."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ruptfx.bodies.phases import Phases
from ruptfx.input.schema import CaseError
from ruptfx.input.units import Length


class VoronoiGrains(Phases):
    """Grains: a cell belongs to the nearest of random points, as many as give the mean area grain_size^2.

    The boundaries of grains follow the cells.
    """

    example: ClassVar[str] = (
        '{ kind = "voronoi_grains", fractions = { feldspar = 0.7, quartz = 0.3 }, grain_size = 1e-3 }'
    )

    grain_size: Length
    """Square root of the mean area of grains; at least two cells."""

    def phase_of(self, centres: NDArray[np.float64], element_size: float) -> NDArray[np.int64]:
        if self.grain_size < 2 * element_size:
            raise CaseError(
                f"mesh.phases.grain_size = {self.grain_size:g} m is less than two cells of {element_size:g} m: refine "
                'the mesh, or draw a phase for every cell (kind = "random_cells")'
            )
        random = np.random.default_rng(self.seed)
        low = centres.min(axis=0) - self.grain_size
        size = centres.max(axis=0) + self.grain_size - low
        count = round(float(np.prod(size)) / self.grain_size**2)
        points = low + size * random.random((count, 2))
        grain = KDTree(points).query(centres)[1]
        return np.asarray(self.drawn(count, random)[grain])

    def draws(self, size: NDArray[np.float64], element_size: float) -> float:
        # Areas of Voronoi cells scatter by 0.53 of their mean: sums scatter sqrt(1 + 0.28) times as much.
        return float(np.prod(size)) / self.grain_size**2 / 1.28
