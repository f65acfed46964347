"""Implicit steps: the equilibrium at the end of a step, with PETSc. This file needs neither PETSc nor DOLFINx."""

from __future__ import annotations

from ruptfx import RuptfxError


class ConvergenceError(RuptfxError):
    """An implicit step without an equilibrium; raised on all ranks, with the state before the step."""
