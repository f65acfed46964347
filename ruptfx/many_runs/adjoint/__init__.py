"""Derivatives of explicit runs: tangent-linear and adjoint sweeps through the history of the interfaces.

Bodies are linear and their stiffness is symmetric: both sweeps are steps of the same kind as the run, forward with
changes and backward with factors of the objective. At the points of interfaces the exact derivatives of the traced step
take the place of the step: that of the branch that was taken, stuck, sliding or open.
"""
