"""Highest frequency of a model by the Lanczos method, and the stable explicit time step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ruptfx import RuptfxError
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.bodies.space.nodes import Nodes
    from ruptfx.platform.fem import MPI

MOST_ITERATIONS = 1000
PART = 16384
"""Numbers of a long vector that are computed together: six vectors of them fit into the second-level cache."""
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Springs:
    """Springs of a mechanism, as the stable time step counts them.

    Attributes
    ----------
    text : str
        What they are, for messages: "the contact stiffness of faults.main".
    plural : bool
        Whether the text is a plural.
    add : callable, (displacement, force) -> None, optional
        Add their forces, complete at every local node [N].
    add_with_elements : callable, (displacement, force) -> None, optional
        Add the forces of this rank, which are summed over ranks afterwards.
    bound : ndarray, shape (nodes,), optional
        Upper bound of their stiffness at every node [N/m], where it is not known exactly.
    own_frequency : float
        Highest angular frequency of unknowns that the mechanism has besides the nodes of the bodies [rad/s].
    margin : float
        Part of the stable step that may be used with them.
    """

    text: str
    plural: bool = False
    add: Callable[[Floats, Floats], None] | None = None
    add_with_elements: Callable[[Floats, Floats], None] | None = None
    bound: Floats | None = None
    own_frequency: float = 0.0
    margin: float = 1.0


class Sprung(Protocol):
    """A part of a model that may have springs."""

    def springs(self) -> list[Springs]:
        """Return its springs."""


class Viscous(Protocol):
    """Viscous damping of elements."""

    @property
    def eta(self) -> float:
        """Viscosity over modulus [s]."""


class Vibrating(Protocol):
    """Bodies with mass and stiffness, and the springs between them."""

    comm: MPI.Comm
    layout: Nodes
    coordinates: np.ndarray
    components: int
    nodes: int
    owned_nodes: int
    total_nodes: int

    @property
    def mechanisms(self) -> Sequence[Sprung]:
        """Parts that may have springs."""

    @property
    def viscosity(self) -> Viscous | None:
        """Damping of some elements."""

    def free_inverse_mass(self) -> np.ndarray:
        """Return the inverse mass of all degrees of freedom [1/kg], zero if prescribed."""

    def internal_force(
        self, displacement: np.ndarray, at_rest: bool = False, out: np.ndarray | None = None
    ) -> np.ndarray:
        """Return -K u [N]; collective."""


def stable_time_step(model: Vibrating, springs: Sequence[Springs] | None = None) -> float:
    """Return the largest stable explicit step [s], with all springs of mechanisms or those given; collective.

    2 / omega_max = dt_c without damping; with the viscous force of the previous half step eta (sqrt(1 + dt_c^2 /
    eta^2) - 1), the root of omega^2 dt^2 + 2 eta omega^2 dt = 4.

    Springs between cells are not damped; if they are the stiffest part, up to twice this step is stable. This is not
    used, because impacts of open cracks then dissipate more: twice as much in granite with a step 1.5 times as long.
    """
    counted = springs_of(model) if springs is None else springs
    stable = 2 / highest_frequency(model, counted) * min((each.margin for each in counted), default=1.0)
    if model.viscosity is None:
        return stable
    eta = model.viscosity.eta
    return eta * (float(np.sqrt(1 + (stable / eta) ** 2)) - 1)


def springs_of(model: Vibrating) -> list[Springs]:
    """Return the springs of all mechanisms of a model."""
    return [springs for each in model.mechanisms for springs in each.springs()]


def highest_frequency(model: Vibrating, springs: Sequence[Springs] | None = None) -> float:
    """Return the highest angular frequency of bodies and springs [rad/s], by the Lanczos method; collective.

    Parameters
    ----------
    model : Vibrating
    springs : sequence of Springs, optional
        Springs that are included; default is all.
    """
    counted = springs_of(model) if springs is None else springs
    known, what = _known.setdefault(model, {}), tuple(each.text for each in counted)
    if what not in known:
        known[what] = max(_lanczos(model, counted), *(each.own_frequency for each in counted), 0.0)
    return known[what]


_known: WeakKeyDictionary[Vibrating, dict[tuple[str, ...], float]] = WeakKeyDictionary()
"""By model and what counts: damping and the step ask for the same."""


def _lanczos(model: Vibrating, springs: Sequence[Springs]) -> float:  # noqa: C901
    root = np.sqrt(model.free_inverse_mass())
    later = np.zeros(model.nodes)
    for each in springs:
        if each.bound is not None:
            later += each.bound
    later = np.repeat(later, model.components) if later.any() else later[:0]

    def apply(u: np.ndarray, force: np.ndarray) -> None:
        """force = -K u."""
        model.internal_force(u, at_rest=True, out=force)
        for each in springs:
            if each.add is not None:
                each.add(u, force)
        if len(later):
            force -= later * u
        for each in springs:
            if each.add_with_elements is not None:
                between = np.zeros_like(force)
                each.add_with_elements(u, between)
                model.layout.sum_shared(between)
                force += between
        model.layout.sum_tied(force)

    others = np.flatnonzero(np.repeat(model.layout.once, model.components) == 0)
    # Long vectors are computed part by part, so that all operations on a part find it in the cache.
    parts = [slice(first, first + PART) for first in range(0, len(root), PART)]

    def product(of_part: Callable[[slice], float], a: np.ndarray, b: np.ndarray) -> float:
        """Return a . b over ranks, every degree of freedom once, from the products of the parts."""
        return float(parallel.total(model.comm, sum(map(of_part, parts)) - a[others] @ b[others]))

    # A partition-independent start vector: pseudo-random in the coordinates.
    x = model.coordinates @ (np.array([12.9898, 78.233, 37.719])[: model.coordinates.shape[1]])
    scale = parallel.total(model.comm, np.abs(x[: model.owned_nodes]).sum()) / model.total_nodes
    vector = np.repeat(np.sin(4.3758e4 * x / scale), model.components) * (root > 0)
    model.layout.equalise(vector)
    beta = np.sqrt(product(lambda part: vector[part] @ vector[part], vector, vector))
    w, before = vector, np.zeros_like(vector)
    vector, u = np.zeros_like(vector), np.empty_like(vector)
    diagonal: list[float] = []
    off: list[float] = []
    last, highest, converged = 0.0, 0.0, False
    for _ in range(MOST_ITERATIONS):
        before, vector, w = vector, w, before
        for part in parts:
            vector[part] /= beta
            np.multiply(root[part], vector[part], out=u[part])
        apply(u, w)
        diagonal.append(product(partial(_less_before, w, before, vector, root, beta), w, vector))
        if not np.isfinite(diagonal[-1]):
            break
        beta = np.sqrt(product(partial(_less_along, w, vector, diagonal[-1]), w, w))
        if len(diagonal) % 10 == 0 or beta == 0:
            last, highest = highest, _largest_of(diagonal, off)
            if converged := highest - last < 2e-3 * highest or beta == 0:
                break
        off.append(beta)
    if not np.isfinite(diagonal[-1]) or highest <= 0:
        raise RuptfxError(
            "the highest frequency could not be found; look for elements without area, and for moduli or densities "
            "that are zero"
        )
    if not converged:
        raise RuptfxError(
            f"the highest frequency was not found in {MOST_ITERATIONS} iterations (the last ten changed its square by "
            f"{(highest - last) / highest:.2g} of it, and 0.002 is allowed); are elements or moduli too unequal?"
        )
    return float(np.sqrt(highest))


def _less_before(
    w: np.ndarray, before: np.ndarray, vector: np.ndarray, root: np.ndarray, beta: float, part: slice
) -> float:  # fmt: skip
    """Change w from -K u to M^-1/2 K u - beta before in a part, and return its product with the vector there."""
    w[part] *= -root[part]
    w[part] -= beta * before[part]
    return float(w[part] @ vector[part])


def _less_along(w: np.ndarray, vector: np.ndarray, along: float, part: slice) -> float:
    """Subtract `along` times the vector from w in a part, and return the square of what remains there."""
    w[part] -= along * vector[part]
    return float(w[part] @ w[part])


def _largest_of(diagonal: list[float], off: list[float]) -> float:
    """Return the largest eigenvalue of a small symmetric tridiagonal matrix, without the import of a solver."""
    return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, -1))[-1])
