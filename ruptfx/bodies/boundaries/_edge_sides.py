"""Loads on some sides of elements of an edge."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ruptfx.bodies.boundaries import EdgeBoundary, Range
from ruptfx.input.schema import CaseError
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.edges import Edge


class EdgeSides(EdgeBoundary):
    """Load on an edge, or on the sides of its elements within limits."""

    x_range: Range | None = None
    """Only the sides of elements whose middle is between these x count."""
    y_range: Range | None = None
    """Only the sides of elements whose middle is between these y count."""

    @property
    def limits(self) -> list[Range | None]:
        """Limits along x and y [m]."""
        return [self.x_range, self.y_range]

    def refuse_empty(self, key: str, edge: Edge, values: np.ndarray) -> None:
        """Refuse limits within which no side has its middle, and values are zero; collective.

        Raises
        ------
        CaseError
            On all ranks.
        """
        if any(self.limits) and not parallel.total(edge.model.comm, np.abs(values).sum()):
            ranges = zip(("x_range", "y_range"), self.limits, strict=True)
            value = ", ".join(f"{name} = {limits}" for name, limits in ranges if limits)
            raise CaseError(f"{key}: {self.edge} has no side with its middle in {value} m; make it longer")
