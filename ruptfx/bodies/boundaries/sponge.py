"""Absorbing layers along edges."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx.bodies.boundaries import Action
from ruptfx.bodies.boundaries.absorbing import Absorbing
from ruptfx.input.quantities import at_most
from ruptfx.input.schema import CaseError
from ruptfx.input.units import Length
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.edges import Edge

RATE = (2.1, -0.7, 6.1, 5.7)
"""Coefficients of s, s^2 ... in the damping rate times width over wave speed."""
FLAT = 1e-6  # of the extent of the body: largest distance of an edge from a plane


class Sponge(Absorbing):
    """A layer inside of the bodies of an edge that damps waves, with the dashpots of `absorbing` on the edge.

    The force per volume is -rho D v, with D = (c / width) (2.1 s - 0.7 s^2 + 6.1 s^3 + 5.7 s^4) at the depth s in the
    layer over its width. c is c_p for the component along the normal of the edge, c_s for the others, and a mean of
    both at an angle to the axes. Plane P and S waves up to 60 degrees from the normal are reflected by at most 1 % of
    their amplitude if the layer is two of their wavelengths wide, by less if they are shorter. At one wavelength it is
    2 % at normal incidence, and at 60 degrees 6 % (P) and 19 % (S). The polynomial is the one of its degree that makes
    the largest reflection at two wavelengths smallest, where Poisson's ratio is 1/4.

    The layer resists velocities only, so that static displacements are those without it; layers of adjacent edges add
    up in the corner. It damps slip rates, too: end faults before it, or evaluate no slip there. The edge may be at an
    angle to the axes, as the far edges of a dipping fault are; its dashpots alone would send back some percent there.
    """

    example: ClassVar[str] = '{ kind = "sponge", edge = "upper.right", width = 2e-3 }'
    source: ClassVar[str] = "Sochacki et al. (1987)"

    width: Length
    """Width of the layer: two wavelengths of the P waves of the lowest frequency to be absorbed."""

    def act_on(self, edge: Edge, key: str) -> Action:
        model = edge.model
        bodies = np.unique(parallel.share_rows(model.comm, edge.bodies))
        normal, distance = self._distance(edge, model.layout.touches[bodies].any(axis=0), key)
        layer = np.clip(1 - distance / self.width, 0.0, 1.0)
        shape = np.sum([factor * layer**power for power, factor in enumerate(RATE, start=1)], axis=0)
        dashpot = edge.dashpot(oblique=True)
        for body in bodies.tolist():
            material = model.materials[body]
            impedance = np.diag(material.impedance(normal, model.plane))
            rate = shape[:, None] * impedance / (material.density * self.width)
            dashpot += model.mass_of(body) * rate.ravel()
        return Action(dashpot=dashpot)

    def _distance(self, edge: Edge, own: np.ndarray, key: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the unit normal of the edge, and the distance of every local node from it [m]; collective.

        Parameters
        ----------
        own : ndarray of bool, shape (nodes,)
            Nodes of the bodies that the edge belongs to.
        key : str
            Of the case, for messages.

        Raises
        ------
        CaseError
            On all ranks: the edge is no plane, or the body is narrower than the layer.
        """
        x, comm = edge.model.coordinates, edge.model.comm
        normal = parallel.share_rows(comm, edge.normals()[:1])[0]
        along = x @ normal
        low, high = (sign * parallel.largest(comm, (sign * along[edge.nodes]).max(initial=-np.inf)) for sign in (-1, 1))
        distance = np.abs(along - 0.5 * (low + high))
        deep = parallel.largest(comm, distance[own].max(initial=0.0))
        if high - low > FLAT * deep:
            raise CaseError(
                f"{key}.edge = '{self.edge}': is not a plane, from which the layer has its width; use "
                "kind = 'absorbing' there"
            )
        if self.width > deep * (1 + FLAT):
            raise CaseError(
                f"{key}.width = {self.width:.6g} m: '{self.edge}' has {at_most(deep)} m of its bodies behind it; make "
                "the layer narrower, or the body larger"
            )
        return normal, distance
