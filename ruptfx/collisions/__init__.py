"""How pieces meet that were no neighbours, one way per file; the file name is the `kind` of the table ``[collisions]``.

Facets that have failed know the cell that they faced. Once they have opened or slid by a part of their length they are
handed over to collisions, which know every cell by where it is. `_step` finds who may touch whom and keeps friction,
`collide.c` does the work.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from ruptfx.schema import Alternative, Unit, alternative


class Collisions(Alternative):
    """The contract of a way to meet."""

    hand_over: Annotated[float, Field(gt=0, le=1), Unit("1")] = 0.3
    """Opening or slip of a failed facet, over its length, from which on it is left to collisions."""

    def modulus(self, spring: float, edge: float) -> float:
        """Of the potential between two bodies [Pa], from the springs that would be there.

        Parameters
        ----------
        spring : float
            Stiffness of springs between these bodies [Pa/m].
        edge : float
            Mean length of facets [m].
        """
        raise NotImplementedError


if TYPE_CHECKING:
    AnyCollisions = Collisions
else:
    AnyCollisions = alternative("ruptfx.collisions")
