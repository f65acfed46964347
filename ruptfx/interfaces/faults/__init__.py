"""Interfaces and their contact kernel: pairs, trial, projection, cohesion, the explicit step, in Python and C."""
