"""Free edges."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.bodies.boundaries import Action, EdgeBoundary

if TYPE_CHECKING:
    from ruptfx.bodies.space.edges import Edge


class Free(EdgeBoundary):
    """No traction beyond the initial load; the default of edges that are not named."""

    acts: ClassVar[bool] = False
    example: ClassVar[str] = '{ kind = "free", edge = "upper.top" }'

    def act_on(self, edge: Edge, key: str) -> Action:
        return Action()
