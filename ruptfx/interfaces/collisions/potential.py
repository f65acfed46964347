"""Potential contact: the overlap of two triangles has an energy."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from ruptfx.input.schema import Unit
from ruptfx.interfaces.collisions import Collisions


class Potential(Collisions):
    """Contact forces of overlapping triangles from a potential, with friction between them.

    With the barycentric coordinates l_k of a triangle B its potential phi = 3 min(l_1, l_2, l_3) is 0 on its sides and
    1 in its middle, and the overlap of A and B has the energy

        p |B_0| / |B| int_(A and B) phi_B dx + p |A_0| / |A| int_(A and B) phi_A dx,

    |B_0| being the initial area. Forces are its derivative: the traction p |B_0| / |B| phi_B on the sides of A that are
    inside of B, and balancing forces on the corners of B. So energy is conserved up to the error of the step, momentum
    and angular momentum to rounding. Flush sides that overlap by d have the pressure 3 p d (1 / h_1 + 1 / h_2), h the
    heights.

    Friction is a spring of stiffness p per pair across the force between them, which slides at mu times that force.

    Source: Munjiza (2004), The combined finite-discrete element method, for the potential; the factor |B_0| / |B| makes
    its forces a gradient for triangles that deform, too.
    """

    stiffness: Annotated[float, Field(gt=0, le=1), Unit("1")] = 0.2
    """Contact stiffness of two flush equilateral triangles over that of the springs of `[fracture]` between them;
    between cells that are tied (extrinsic facets) over 10 E / h, with Young's modulus E and the mean length h of
    facets."""

    def modulus(self, spring: float, edge: float) -> float:
        return self.stiffness * spring * edge / (4 * float(np.sqrt(3)))  # 1 / h_1 + 1 / h_2 = 4 / (sqrt(3) edge)
