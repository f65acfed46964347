"""Checks of a case before it runs: resolution, cost, memory."""
