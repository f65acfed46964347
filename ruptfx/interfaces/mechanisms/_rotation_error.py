"""The energy `rotation_error`: work of forces in finite steps beyond the change of the energies of rotating bodies."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ruptfx.bodies.state import State

DISSIPATED = "frictional_dissipation", "fracture", "impact_loss", "collision_loss"
"""Energies that facets dissipate, and that springs lose when collisions take over their facets."""


@contextmanager
def deducting_dissipation(state: State) -> Iterator[None]:
    """Subtract the dissipation of facets within the context from the energy `rotation_error`; it has its own column."""
    before = sum(state.energy[name] for name in DISSIPATED)
    yield
    state.energy["rotation_error"] -= sum(state.energy[name] for name in DISSIPATED) - before
