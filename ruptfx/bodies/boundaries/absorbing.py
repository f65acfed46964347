"""Absorbing edges."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.bodies.boundaries import Action, EdgeBoundary

if TYPE_CHECKING:
    from ruptfx.bodies.space.edges import Edge


class Absorbing(EdgeBoundary):
    """Lysmer dashpots, exact for plane waves at normal incidence: traction = impedance times velocity.

    The impedance is rho c_p (normal) and rho c_s (tangential) where isotropic. Every component has its own dashpot, so
    the edge must be along an axis, and so must the axes of an anisotropic material.

    An interface may cross the edge and a rupture leave through it. Dashpots do not carry the static stress of the crack
    beyond, so that slip next to the edge becomes too large behind the front: keep the edge away from evaluated slip.
    Source: Lysmer and Kuhlemeyer (1969).
    """

    waves: ClassVar[bool] = True
    example: ClassVar[str] = '{ kind = "absorbing", edge = "upper.right" }'

    def act_on(self, edge: Edge, key: str) -> Action:
        return Action(dashpot=edge.dashpot())
