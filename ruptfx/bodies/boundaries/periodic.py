"""Periodic boundaries: two opposite edges with the same motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ruptfx.bodies.boundaries import Action, Boundary

if TYPE_CHECKING:
    from ruptfx.bodies.boundaries.loading import Loads


class Periodic(Boundary):
    """Two opposite edges whose nodes have the same motion, with the mass of both.

    The edges must be translated copies with the same nodes. An interface that ends at one of them continues at the
    other, where the bodies on both sides of it must be tied: its two ends are the same point.
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
