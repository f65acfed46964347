"""Rigid motions of the bodies that nothing resists: without inertia such bodies have no equilibrium.

Every connected body has 1 (antiplane, axisymmetric), 3 (plane) or 6 (solid) rigid motions. Prescribed motion, elastic
supports, attachments, tied edges and interfaces resist some of them; an interface resists every jump of its sides that
its points have, whatever its friction law. What remains is the null space of a small matrix, summed over ranks.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.csgraph import connected_components

from ruptfx.bodies.space.edges import Edge
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.mechanisms import StepEnd, responding
from ruptfx.platform import parallel
from ruptfx.stepping.implicit.solvers import is_factorised

if TYPE_CHECKING:
    from ruptfx.interfaces.mechanisms.system import System

FREE = 1e-10  # eigenvalue of resistance, over that of a motion that is resisted, below which a motion is free
ALIGNED = 1e-6  # largest component across a direction that counts as along it
AXES = "xyz"


class RigidMotions:
    """Rigid motions of the connected bodies of a model, and their resistance; collective.

    Attributes
    ----------
    label : ndarray of int, shape (nodes,)
        Number of the connected body of every local node.
    names : list of list of str
        Names of the bodies that each connected body consists of.
    resistance : ndarray, shape (motions, motions)
        Sum of squares of resisted displacements, for lengths in units of the extent of each body.
    """

    def __init__(self, model: System) -> None:
        self._model, c = model, model.components
        self._rotations = {2: [(0, 1)], 3: [(1, 2), (2, 0), (0, 1)]}.get(c, [])
        self._translations = 1 if model.plane == "axisymmetric" else c
        if model.plane == "axisymmetric":
            self._rotations = []
        self._each = self._translations + len(self._rotations)
        self.label, self.names = self._connected()
        self._center, self._extent = self._sizes()
        self.resistance = np.zeros((len(self.names) * self._each,) * 2)
        self._count_all()
        self.resistance = parallel.total(model.comm, self.resistance)

    def _connected(self) -> tuple[np.ndarray, list[list[str]]]:
        """Return the labels of nodes, and the names of connected bodies: welded ones, and those joined by facets."""
        layout = self._model.layout
        welded, body = layout.welded, layout.body
        beside = np.zeros((welded.max() + 1,) * 2)
        for mechanism in responding(self._model.mechanisms):
            first, second = welded[body[mechanism.coupled()]].T
            beside[first, second] = 1
        label = connected_components(parallel.total(self._model.comm, beside), directed=False)[1][welded]
        bodies = self._model.bodies.names
        names = [[name for name, own in zip(bodies, label, strict=True) if own == n] for n in range(label.max() + 1)]
        return label[body], names

    def _sizes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the centre of every connected body, shape (bodies, dim) [m], and its extent, shape (bodies,) [m]."""
        x, comm = self._model.coordinates, self._model.comm
        high, low = np.zeros((2, len(self.names), x.shape[1]))
        for number in range(len(self.names)):
            own = x[self.label == number]
            for axis in range(x.shape[1]):
                high[number, axis] = parallel.largest(comm, own[:, axis].max(initial=-np.inf))
                low[number, axis] = -parallel.largest(comm, -own[:, axis].min(initial=np.inf))
        return 0.5 * (high + low), (high - low).max(axis=1)

    def at(self, nodes: np.ndarray) -> np.ndarray:
        """Return the rigid motions of local nodes, shape (n, components, motions)."""
        c, label = self._model.components, self.label[nodes]
        x = (self._model.coordinates[nodes] - self._center[label]) / self._extent[label][:, None]
        own = np.zeros((len(nodes), c, self._each))
        own[:, range(self._translations), range(self._translations)] = 1
        for k, (i, j) in enumerate(self._rotations, self._translations):
            own[:, i, k], own[:, j, k] = -x[:, j], x[:, i]
        motions = np.zeros((len(nodes), c, len(self.names), self._each))
        motions[np.arange(len(nodes)), :, label] = own
        return motions.reshape(len(nodes), c, len(self.names) * self._each)

    def _count(self, rows: np.ndarray) -> None:
        """Count resisted displacements, shape (..., motions)."""
        self.resistance += np.tensordot(rows, rows, (range(rows.ndim - 1),) * 2)

    def _count_all(self) -> None:
        model = self._model
        c = model.components
        driven = np.flatnonzero(model.loads.prescribed)
        self._count(self.of_dofs(driven))
        layout = model.layout
        self._count(self.at(layout.kept) - self.at(layout.copies))
        springs = [(each.nodes, each.stiffness) for each in model.loads.supports]
        mechanisms = responding(model.mechanisms)
        if mechanisms:
            state, end = model.initial_state(), StepEnd(np.zeros(model.nodes * c), 1.0)
            reactions = [each.respond(state, end) for each in mechanisms]
            springs += [(each.nodes, each.stiffness) for each in reactions if len(each.stiffness)]
        for nodes, stiffness in springs:
            size = parallel.largest(model.comm, np.abs(stiffness).max(initial=0.0))
            motions = self.at(nodes)
            if size > 0:
                self.resistance += np.einsum("nia,nij,njb->ab", motions, stiffness / size, motions, optimize=True)
        for fault in model.faults:
            nodes, blocks = fault.interface.stencil()
            rows = [np.einsum("nlc,ncm->nlm", blocks[:, k], self.at(nodes[:, k])) for k in range(nodes.shape[1])]
            self._count(np.sum(rows, axis=0))

    def of_dofs(self, dofs: np.ndarray) -> np.ndarray:
        """Return the rigid motions of local degrees of freedom, shape (n, motions)."""
        c = self._model.components
        return self.at(dofs // c)[np.arange(len(dofs)), dofs % c]

    def free(self) -> np.ndarray:
        """Return an orthonormal basis of the motions that nothing resists, shape (motions, free)."""
        size = np.sqrt(np.diagonal(self.resistance).clip(0))
        size = np.where(size > 1e-8 * size.max(initial=0.0), size, 0.0)
        inverse = np.where(size > 0, 1 / np.where(size > 0, size, 1.0), 0.0)
        values, vectors = np.linalg.eigh(inverse[:, None] * self.resistance * inverse)
        vectors = np.where(size > 0, inverse, 1.0)[:, None] * vectors
        return np.linalg.qr(vectors[:, values < FREE])[0]

    def in_words(self, free: np.ndarray) -> list[str]:
        """Return free motions by body as text: "body 'upper': translation along y, rotation about x"."""
        parts = free.reshape(len(self.names), self._each, -1)
        result: dict[str, list[str]] = {}
        for names, part in zip(self.names, parts, strict=True):
            basis = _range(part)
            moved, turned = basis[: self._translations], basis[self._translations :]
            along = _range(moved @ _null(turned))
            words = [f"translation along {way}" for way in self._directions(along)]
            if len(self._rotations) == 1 and basis.shape[1] > along.shape[1]:
                words.append("rotation in the plane")
            elif len(self._rotations) == 3:
                words += [f"rotation about {way}" for way in self._directions(_range(turned))]
            if words:
                result.setdefault(", ".join(words), []).extend(f"'{name}'" for name in names)
        return [
            f"{'bodies' if len(names) > 1 else 'body'} {', '.join(names)}: {text}" for text, names in result.items()
        ]

    def _directions(self, span: np.ndarray) -> list[str]:
        """Return names of directions that span a space of vectors: axes where possible."""
        axes = AXES[-1:] if self._model.components == 1 else AXES
        names = []
        for axis, row in zip(axes, span, strict=False):
            if np.linalg.norm(row) > 1 - ALIGNED:
                names.append(axis)
        axial = np.array([axes.index(name) for name in names], dtype=int)
        across = span.copy()
        across[axial] = 0
        others = _range(across)[:, : span.shape[1] - len(names)]
        return names + ["(" + ", ".join(f"{value:.3g}" for value in np.round(way, 6) + 0.0) + ")" for way in others.T]

    def remedy(self, free: np.ndarray) -> list[tuple[str, str]]:
        """Return edges and components that hold all free motions if they are driven; empty if none do; collective."""
        model = self._model
        acting = model.loads.prescribed
        driven = [boundary.driven_edge for boundary in model.case.boundaries]
        loaded = np.zeros(len(acting), dtype=bool)
        for force in (*model.loads.forces, *model.loads.ended):
            loaded[force.dofs] = True
        for support in model.loads.supports:
            loaded.reshape(-1, model.components)[support.nodes] = True
        letters = {1: "z", 2: "xy", 3: "xyz"}[model.components]
        candidates: dict[tuple[str, str], np.ndarray] = {}
        for name, component in product(sorted(model.bodies.edges, key=lambda each: each not in driven), letters):
            dofs = Edge(model, name, "boundaries").dofs(component)
            rows = self.of_dofs(dofs)
            unfit = parallel.anywhere(model.comm, bool(np.any(loaded[dofs])))
            count, driven_count = parallel.total(model.comm, [len(dofs), int(np.count_nonzero(acting[dofs]))])
            resisted = parallel.total(model.comm, rows.T @ rows)
            if not unfit and driven_count < count:
                candidates[name, component] = resisted
        chosen: list[tuple[str, str]] = []
        while free.shape[1] and candidates:
            remaining = {key: _unresisted(free, each) for key, each in candidates.items()}
            best = min(remaining, key=lambda key: remaining[key].shape[1])
            if remaining[best].shape[1] == free.shape[1]:
                return []
            free = remaining[best]
            chosen.append(best)
        return [] if free.shape[1] else chosen


def _unresisted(free: np.ndarray, resistance: np.ndarray) -> np.ndarray:
    """Return the part of a space of motions that a further resistance leaves free."""
    values, vectors = np.linalg.eigh(free.T @ resistance @ free)
    return free @ vectors[:, values <= FREE * max(values.max(initial=0.0), np.trace(resistance) * FREE)]


def _range(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the span of columns."""
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, sizes > ALIGNED]


def _null(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the null space of a matrix."""
    _, sizes, right = np.linalg.svd(rows)
    return right[np.count_nonzero(sizes > ALIGNED) :].T


def refuse_free_bodies(model: System) -> None:
    """Refuse bodies with rigid motions that nothing resists; collective.

    Without loads and driven edges no force moves the bodies as a whole; a factorisation then leaves them where they
    are.

    Raises
    ------
    CaseError
        Names bodies, motions, and edges that would hold them.
    """
    loads = model.loads
    if not (loads.motions or loads.forces or loads.ended) and is_factorised(model):
        return
    motions = RigidMotions(model)
    free = motions.free()
    if not free.shape[1]:
        return
    kind = model.case.stepper.kind()  # type: ignore[attr-defined]
    edges = motions.remedy(free)
    entries = ", ".join(
        f"{{ kind = 'driven', edge = '{edge}', component = '{component}', velocity = 0.0 }}"
        for edge, component in edges
    )
    remedy = f"add to the boundaries {entries}" if edges else "add a 'spring' or 'body_spring' to the boundaries"
    raise CaseError(
        f"stepper.kind = '{kind}': without inertia bodies need supports, and some can move freely: "
        f"{'; '.join(motions.in_words(free))}; {remedy}, or use 'generalized_alpha' or 'leapfrog', in which inertia "
        "balances the forces"
    )
