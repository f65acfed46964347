"""Time: explicit and implicit steppers, equilibrium, rules that stop a run."""
