"""Interfaces whose sides slide over each other as far as they like, each with a mesh of its own.

Strains and rotations of the bodies stay small, their stiffness constant; only who faces whom follows the motion.
`surface` is one side as a chain of facets, `facing` finds what every point faces (a dual mortar), `interface` has the
jump and its transpose of that, frozen between updates, `follower` says when it is found again, and `step` is the
explicit step. Implicit steps find it again until it is that of their end (`ruptfx.implicit.equilibrium`).
"""

from __future__ import annotations

from typing import ClassVar

from ruptfx.materials import IN_PLANE, Plane
from ruptfx.schema import Part
from ruptfx.units import Positive


class Sliding(Part):
    """The two sides have meshes of their own, and what each point faces follows the motion."""

    planes: ClassVar[tuple[Plane, ...]] = IN_PLANE
    """Where surfaces are chains of facets."""

    follow: Positive = 0.05
    """Slip over the distance of nodes after which explicit steps find again what every point faces."""
    limit: Positive = 0.5
    """Largest slip of an implicit step over the distance of nodes; a step that slides farther is halved."""
