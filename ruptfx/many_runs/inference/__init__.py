"""Unknowns of a case from data: variables with priors, L-BFGS with exact gradients, and the files of an inference."""
