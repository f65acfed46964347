"""Two opposite edges that are one."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.boundaries import Action, Boundary

if TYPE_CHECKING:
    from ruptfx.loading import Loads


class Periodic(Boundary):
    """What leaves through one edge comes in at the other: the nodes of both move alike, with the mass of both.

    The edges must be the same but for a shift, and meshed alike. An interface that ends at one of them goes on at the
    other, where the bodies on both sides of it must be tied: its two ends are one point.
    """

    example: ClassVar[str] = '{ kind = "periodic", first = "lower.bottom", second = "upper.top" }'

    first: str
    """``body.side``, for example ``upper.left``."""
    second: str
    """The opposite edge, which may be one of another body."""

    @property
    def tied_edges(self) -> tuple[str, str]:
        return self.first, self.second

    def act(self, loads: Loads, key: str) -> Action:
        return Action()  # what is tied belongs to the nodes of the model
