"""Finite sliding: the two sides have separate meshes, and the pairing of their points follows the motion.

Strains and rotations of the bodies remain small and their stiffness constant; only the pairing follows the motion.
`surface` is one side, lines or quadrilaterals, `mortar` finds the pairing (a dual mortar), `interface` has the
jump and its transpose, frozen between updates, `follower` decides when to update, and `step` is the
explicit step. Implicit steps repeat the update until it is that of their end (`ruptfx.stepping.implicit.equilibrium`).
"""

from __future__ import annotations

from typing import ClassVar

from ruptfx.input.schema import Part
from ruptfx.input.units import Positive
from ruptfx.laws.materials import IN_PLANE, Plane


class Sliding(Part):
    """Finite sliding: the two sides have separate meshes, and the pairing of their points follows the motion."""

    planes: ClassVar[tuple[Plane, ...]] = (*IN_PLANE, "solid")
    """Where surfaces are chains of facets, or sides of hexahedra."""

    former_keys: ClassVar[dict[str, str]] = {"follow": "update_slip"}

    update_slip: Positive = 0.05
    """Slip over the distance of nodes after which explicit steps update the pairing."""
    limit: Positive = 0.5
    """Largest slip of an implicit step over the distance of nodes; a step that slides farther is halved."""
