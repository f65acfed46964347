"""Uncertainty of the variables: Laplace's approximation at the best run, and samples.

At the best variables the misfit is close to half the square of linearised residuals, and the posterior close to a
normal distribution with the inverse of J'J + P as its covariance: J is the derivative of the residuals by the
variables, and P is 1 for variables with a prior, in which the prior is |z|^2 / 2, and 0 for others.

For fields J has too many columns. There P is the identity, and eigenvectors V of J'J with the largest eigenvalues L
give the covariance I - V L / (1 + L) V' (Bui-Thanh, Ghattas, Martin and Stadler, SIAM J. Sci. Comput. 2013). Directions
that are left out keep the variance of the prior, so that the band is rather too wide than too narrow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SMALLEST = 1e-14
"""Smallest eigenvalue of a matrix of curvature over its largest one; below it, data and prior determine nothing."""


@dataclass(frozen=True)
class Posterior:
    """Distribution of the variables.

    Attributes
    ----------
    mean : ndarray, shape (n,)
        Most probable variables, of samples their mean.
    spread : ndarray, shape (n, m)
        S of the covariance S S'.
    samples : ndarray, shape (count, n)
        Samples; empty for Laplace's approximation.
    """

    mean: Floats
    spread: Floats
    samples: Floats

    def draws(self, count: int, low: Floats, high: Floats) -> Floats:
        """Return samples within bounds, shape (at most count, n): those that were made, or new ones.

        New ones are of the normal distribution, without those outside of the bounds.
        """
        if len(self.samples):
            return self.samples
        random = np.random.default_rng(0)
        result = self.mean + random.normal(size=(count, self.spread.shape[1])) @ self.spread.T
        inside = np.all((result >= low) & (result <= high), axis=1)
        return np.asarray(result[inside] if inside.any() else np.clip(result, low, high))


def of_jacobian(mean: Floats, jacobian: Floats, prior: NDArray[np.bool_]) -> Posterior:
    """Return the posterior of a few variables.

    Parameters
    ----------
    mean : ndarray, shape (n,)
    jacobian : ndarray, shape (residuals, n)
    prior : ndarray of bool, shape (n,)
        Which variables have a prior.
    """
    values, vectors = np.linalg.eigh(jacobian.T @ jacobian + np.diag(prior.astype(float)))
    values = np.maximum(values, SMALLEST * max(float(values[-1]), 1e-300))
    return Posterior(mean, vectors / np.sqrt(values), np.zeros((0, len(mean))))


def of_products(mean: Floats, product: Callable[[Floats], Floats], directions: int) -> Posterior:
    """Return the posterior of variables that all have a prior.

    Parameters
    ----------
    mean : ndarray, shape (n,)
    product : callable
        J'J times a vector.
    directions : int
        Largest number of directions that differ from the prior.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    n = len(mean)
    operator = LinearOperator((n, n), matvec=lambda x: product(np.asarray(x).ravel()), dtype=float)
    start = np.random.default_rng(0).normal(size=n)
    # Eigenvalues well below 1 change nothing: the prior has 1.
    values, vectors = eigsh(operator, k=min(directions, n - 1), which="LA", v0=start, tol=1e-2)
    values = np.maximum(values, 0.0)
    spread = np.eye(n) - (vectors * (1 - 1 / np.sqrt(1 + values))) @ vectors.T
    return Posterior(mean, spread, np.zeros((0, n)))


def of_samples(samples: Floats) -> Posterior:
    """Return the posterior from samples, shape (count, n)."""
    mean = samples.mean(axis=0)
    return Posterior(mean, (samples - mean).T / np.sqrt(len(samples)), samples)
