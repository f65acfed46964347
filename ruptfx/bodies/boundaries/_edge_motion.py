"""Edges with prescribed motion."""

from __future__ import annotations

from ruptfx.bodies.boundaries import Component, EdgeBoundary, Range, check_component
from ruptfx.laws.materials import Plane


class EdgeMotion(EdgeBoundary):
    """Prescribed motion of an edge, or of a part of it, in one direction."""

    component: Component
    """Direction of the prescribed motion."""
    x_range: Range | None = None
    """Only the part of the edge between these x moves."""
    y_range: Range | None = None
    """Only the part of the edge between these y moves."""

    def check(self, key: str, plane: Plane, components: str) -> None:
        check_component(f"{key}.component", self.component, plane, components)

    @property
    def driven_edge(self) -> str:
        return self.edge
