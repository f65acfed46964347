"""Formulas recorded once as derivatives, NumPy functions and C; C compiled at first use."""
