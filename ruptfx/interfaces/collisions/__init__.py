"""Collision contact of bodies and fragments, one method per file, the `kind` of the table ``[collisions]``.

Facets that have failed are in contact with their neighbour cell. After opening or slip by a part of their length, at
one of their ends, they are replaced by collision contact, which searches contacts by position. `_step` finds close
pairs and stores their friction, `collide.c` contains the formulas.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from ruptfx.input.schema import Alternative, Unit, alternative


class Collisions(Alternative):
    """The contract of a way to meet."""

    former_keys: ClassVar[dict[str, str]] = {"hand_over": "activate_at"}

    activate_at: Annotated[float, Field(gt=0, le=1), Unit("1")] = 0.3
    """Opening or slip of a failed facet, over its length, beyond which collision contact replaces it."""

    def modulus(self, spring: float, edge: float) -> float:
        """Return the modulus of the potential between two bodies [Pa], from the stiffness of springs between them.

        Parameters
        ----------
        spring : float
            Stiffness of facet springs between these bodies [Pa/m].
        edge : float
            Mean length of facets [m].
        """
        raise NotImplementedError


if TYPE_CHECKING:
    AnyCollisions = Collisions
else:
    AnyCollisions = alternative("ruptfx.interfaces.collisions")

SHARED = ("step",)
"""Files of this folder that are no kinds."""
