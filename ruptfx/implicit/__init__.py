"""Implicit steps: the equilibrium at the end of a step, with PETSc. What is here needs neither PETSc nor DOLFINx."""

from __future__ import annotations

from ruptfx import RuptfxError


class ConvergenceError(RuptfxError):
    """An implicit step that found no equilibrium; raised on all ranks, the state is as before the step."""
