"""The line of a fault and the positions along it, as `ruptfx.interfaces.faults.interface.Interface` defines them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ruptfx.app.convert.sem2dpack.blocks import ConversionError, Floats
from ruptfx.bodies.meshes.lobatto import Basis

FLAT = 1e-6


@dataclass(frozen=True)
class FaultLine:
    """Nodes along a fault.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        x and z of the nodes in the input [m], in order.
    positions : ndarray, shape (n,)
        Positions along the interface of the case [m], increasing.
    along_x : bool
        Whether positions are x.
    """

    points: Floats
    positions: Floats
    along_x: bool

    @classmethod
    def of(cls, facets: Floats, normal: Floats, order: int) -> FaultLine:
        """Make the line of facets, shape (facets, 2, 2), with the unit normal from the minus to the plus side."""
        tangent = np.array([normal[1], -normal[0]])
        reverse = (facets[:, 1] - facets[:, 0]) @ tangent < 0
        facets = np.where(reverse[:, None, None], facets[:, ::-1], facets)
        facets = facets[np.argsort(facets[:, 0] @ tangent)]
        share = 0.5 * (1 + Basis.of_order(order).points)
        nodes = facets[:, :1] + share[None, :, None] * (facets[:, 1:] - facets[:, :1])
        points = np.concatenate([nodes[:, :-1].reshape(-1, 2), facets[-1:, 1]])
        if np.ptp(points @ normal) < FLAT * np.ptp(points, axis=0).max() and abs(tangent[0] - 1) < FLAT:
            return cls(points, points[:, 0], True)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        return cls(points, np.concatenate([[0.0], np.cumsum(steps)]), False)

    def locate(self, point: tuple[float, float]) -> tuple[float, float]:
        """Return the position of the foot of a point on the line through the ends, and its distance [m].

        Raises
        ------
        ConversionError
            The fault is curved.
        """
        first, last = self.points[0], self.points[-1]
        along = (last - first) / np.linalg.norm(last - first)
        across = np.array([-along[1], along[0]])
        if np.ptp(self.points @ across) > FLAT * np.ptp(self.positions):
            raise ConversionError(
                f"&BC_DYNFLT: the point {point[0]:g}, {point[1]:g} of a distribution has no position on a curved "
                "fault; give values along x or z (DIST_LINEAR, DIST_SPLINE)"
            )
        from_first = np.asarray(point) - first
        return float(self.positions[0] + from_first @ along), float(abs(from_first @ across))
