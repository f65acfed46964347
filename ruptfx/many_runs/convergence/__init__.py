"""Error bars of a run from the same case on coarser meshes or in longer steps, `ruptfx converge`."""

from ruptfx.many_runs.convergence.estimates import Estimate, estimate
from ruptfx.many_runs.convergence.levels import converge

__all__ = ["Estimate", "converge", "estimate"]
