"""More than one run: studies, gradients of runs, unknowns from data."""
