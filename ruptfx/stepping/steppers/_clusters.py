"""Clusters of elements for local time steps: the elements whose forces act in every substep, and the others."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ruptfx.bodies import operators
from ruptfx.bodies.operators.geometry import is_tensor, jacobian_at
from ruptfx.bodies.spectrum import highest_frequency
from ruptfx.platform import parallel

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms import Mechanism
    from ruptfx.interfaces.mechanisms.system import System

LAYERS = 2
"""Layers of larger elements around the small ones that act in every substep, too: `local_leapfrog` says why."""
BESIDE_INTERFACES = 1
"""Layers of elements beyond those that touch nodes of interfaces."""
MOST_SUBSTEPS = 31
WORTH = 0.9
"""Part of the element forces of equal steps, above which local steps are not chosen."""
TRIALS = 6
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Clusters:
    """Elements of this rank in two clusters.

    Attributes
    ----------
    substeps : int
        Substeps in a step, an odd number; 1 if the step of all elements is the same.
    small, fine : ndarray of bool, shape (local cells,)
        Elements whose own stable step is too short for a step, and those that act in every substep.
    work : float
        Element forces per time, of all ranks, over those of substeps everywhere.
    share : float
        Number of small elements over that of all, on all ranks.
    """

    substeps: int
    small: Flags
    fine: Flags
    work: float
    share: float


def travel_times(model: System) -> np.ndarray:
    """Return a length of every local element over its longitudinal wave speed [s], shape (local cells,).

    The length is 1 / |J^-1| with Frobenius' norm, smallest of the corners: the highest frequency of a box is in
    proportion to c_p sqrt(1/a^2 + 1/b^2 + 1/c^2). Only ratios of these times are used.
    """
    mesh, dim = model.mesh, model.mesh.topology.dim
    cells = np.arange(len(model.bulk.cell_material))
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    if not is_tensor(mesh):
        corners = np.full((1, dim), 1 / (dim + 1))
    inverse = np.linalg.inv(jacobian_at(mesh, cells, corners))
    length = 1 / np.linalg.norm(inverse, axis=(2, 3)).max(axis=1, initial=1e-300)
    plane = model.bulk.plane
    speeds = np.array([material.wave_speeds(plane).c_p for material in model.bulk.materials])
    of_cells = speeds[model.bulk.cell_material] if model.variation is None else model.variation.speed_of_cells
    return np.asarray(length / of_cells)


def with_neighbours(model: System, cells: Flags, layers: int) -> Flags:
    """Return the elements with those that touch their nodes, layer by layer; collective."""
    for _ in range(layers):
        cells = touching(model, nodes_of(model, cells))
    return cells


def nodes_of(model: System, cells: Flags) -> Flags:
    """Return a mask of the nodes of elements of all ranks, shape (nodes,); collective."""
    marked, owned = np.zeros(model.nodes, dtype=bool), owned_cells(model)
    marked[model.space.dofmap.list[:owned][cells[:owned]]] = True
    return on_all_ranks(model, marked)


def on_all_ranks(model: System, nodes: Flags) -> Flags:
    """Return a mask of the nodes that any rank has marked, shape (nodes,); collective."""
    marked = nodes.repeat(model.components).astype(float)
    model.layout.sum_shared(marked)
    return np.asarray(marked.reshape(model.nodes, -1)[:, 0] > 0)


def owned_cells(model: System) -> int:
    """Return the number of elements that this rank owns, which come first."""
    return int(model.mesh.topology.index_map(model.mesh.topology.dim).size_local)


def touching(model: System, nodes: Flags) -> Flags:
    """Return the local elements that have one of the nodes."""
    return np.asarray(nodes[model.space.dofmap.list].any(axis=1))


def smooth_elements(model: System, mechanisms: Sequence[Mechanism]) -> Flags:
    """Return the elements whose forces mechanisms need in every substep; collective."""
    nodes = np.zeros(model.nodes, dtype=bool)
    for each in mechanisms:
        nodes |= each.smooth_nodes()
    return with_neighbours(model, touching(model, on_all_ranks(model, nodes)), BESIDE_INTERFACES)


def divide(model: System, times: np.ndarray, smooth: Flags, substeps: int, margin: float = 1.0) -> Clusters:
    """Return the clusters for a number of substeps; collective.

    Parameters
    ----------
    times : ndarray
        `travel_times`.
    margin : float
        Elements whose time is below `substeps` times the shortest, times this, are small.
    """
    owned = owned_cells(model)
    shortest = -parallel.largest(model.comm, float((-times[:owned]).max(initial=-np.inf)))
    small = times < margin * substeps * shortest * (1 - 2e-3)
    fine = with_neighbours(model, small, LAYERS) | smooth
    counts = [len(small[:owned]), int(small[:owned].sum()), int(fine[:owned].sum())]
    cells, few, in_all = parallel.total(model.comm, counts).tolist()
    return Clusters(substeps, small, fine, (substeps * in_all + cells - in_all) / (substeps * cells), few / cells)


def best(model: System, times: np.ndarray, smooth: Flags) -> Clusters:
    """Return the clusters with the least work as the sizes of elements tell; collective."""
    owned = owned_cells(model)
    longest = parallel.largest(model.comm, float(times[:owned].max(initial=0.0)))
    shortest = -parallel.largest(model.comm, float((-times[:owned]).max(initial=-np.inf)))
    most = min(MOST_SUBSTEPS, int((1 + 1e-3) * longest / shortest))
    tried = [divide(model, times, smooth, substeps) for substeps in range(1, most + 1, 2)]
    chosen = min(tried, key=lambda each: each.work)
    return chosen if chosen.work < WORTH else tried[0]


def longest_step(model: System, small: Flags) -> float:
    """Return the stable step of the elements that are not small [s], by the Lanczos method; collective."""
    view = copy.copy(model)
    view.operator = part_of(model, ~small)
    return 2 / highest_frequency(view, [])


def stable(model: System, mechanisms: Sequence[Mechanism], wanted: int | None, step: float) -> Clusters:
    """Return clusters whose larger elements have a stable step of `substeps` times `step` [s]; collective.

    More elements become small until that is so, and then there are fewer substeps.

    Parameters
    ----------
    wanted : int or None
        Number of substeps; None chooses it.
    step : float
        Length of a substep over the part of the stable step that may be used.
    """
    times, smooth = travel_times(model), smooth_elements(model, mechanisms)
    longest: dict[float, float] = {}  # by share: small elements are those below a time, so that it tells them
    chosen = best(model, times, smooth) if wanted is None else divide(model, times, smooth, wanted)
    while chosen.substeps > 1:
        margin = 1.0
        for _ in range(TRIALS):
            if chosen.share == 1.0:
                break
            if chosen.share not in longest:
                longest[chosen.share] = longest_step(model, chosen.small)
            over = chosen.substeps * step / longest[chosen.share]
            if over <= 1:
                return chosen
            margin *= max(1.02, over)
            chosen = divide(model, times, smooth, chosen.substeps, margin)
        if wanted is not None:
            break
        chosen = divide(model, times, smooth, chosen.substeps - 2)
    return divide(model, times, smooth, 1)


def part_of(model: System, cells: Flags) -> operators.Operator:
    """Return the operator of some elements, of the same kind as that of the bodies; collective."""
    cls, owned = type(model.operator), owned_cells(model)
    if cells[:owned].any():
        return cls(replace(model.bulk, only=cells))
    one = np.zeros_like(cells)
    one[0] = True  # an operator needs an element, and other ranks its messages
    made = cls(replace(model.bulk, only=one))
    return IdleSteps() if isinstance(made, operators.FusedOperator) else Idle()


class Idle:
    """Operator of a rank that has no element of a cluster."""

    def add_internal_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        """Add nothing."""


class IdleSteps(Idle):
    """The same where the operators of other ranks also make steps."""

    damps = False

    def prepare_step(
        self, by_caller: np.ndarray, sweeps: Sequence[operators.InsertedSweep] = (), moves: bool = False
    ) -> None:  # fmt: skip
        """Update no nodes."""

    def step(self, *arguments: object, **options: object) -> float:
        """Update no nodes."""
        return 0.0
