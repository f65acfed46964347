"""Collision contact in an explicit step: search of close pairs, and their forces; `collide.c` has the formulas.

All ranks know the cells at surfaces, which have a side on an edge of the bodies or on a failed facet, and the
pairs of them that are close: found with a margin, again after a cell has moved by half of it. Pairs that do not touch
exert no force, so that the time of the search does not matter. A rank computes the pairs of its own cells, in the order
of their numbers in the input: forces are bitwise the same on any number of ranks.

Cells still connected at a vertex, through facets without collision contact, exert no collision forces there.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ruptfx import RuptfxError, Table
from ruptfx.bodies.meshes import FACETS
from ruptfx.bodies.state import FaultState, State
from ruptfx.input.fields import OF_COLLISIONS
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.collisions import Collisions
from ruptfx.interfaces.cracks import CrackLaws
from ruptfx.interfaces.cracks.step import CrackStep, formulas, varying
from ruptfx.laws.materials import Material, Plane
from ruptfx.platform import fem, parallel
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address
from ruptfx.platform.codegen.tracing import depends, record, symbol

if TYPE_CHECKING:
    from ruptfx.bodies.space.bodies import Bodies
    from ruptfx.laws.friction import FrictionLaw

EVERY = 16  # steps between two searches for failed facets and for those to be replaced by collision contact
MARGIN = 0.3  # largest distance of close pairs, over the mean edge
MEMORY = ("traction", "overlap")
LATE = 1e9  # s, after which states of laws are steady
MOST = 2**31  # larger than any number of a cell
FIELD = "hand_over"
FAILED, HANDED = 1.0, 2.0  # values of that field of facets: failed, replaced by collision contact


@dataclass(frozen=True)
class _Surface:
    """Cells at surfaces of all ranks, sorted by their numbers in the input.

    Attributes
    ----------
    number, body : ndarray of int, shape (cells,)
    vertices : ndarray of int, shape (cells, 3)
    label : ndarray of int, shape (cells, 3)
        Labels of the corners, equal for connected corners of a vertex.
    order : ndarray of int, shape (cells,)
        Permutation from the rows of all ranks to this order.
    owned : ndarray of bool, shape (cells,)
    cells : ndarray of int
        Local cells of this rank, in its order.
    counts : list of int
        Number of cells of every rank.
    rest : ndarray, shape (cells,)
        Twice the area at rest [m2].
    """

    number: np.ndarray
    body: np.ndarray
    vertices: np.ndarray
    label: np.ndarray
    order: np.ndarray
    owned: np.ndarray
    cells: np.ndarray
    counts: list[int]
    rest: np.ndarray


@dataclass(frozen=True)
class _Pairs:
    """Close pairs with a cell of this rank, sorted; arrays for `collide.c`.

    Attributes
    ----------
    pair : ndarray of int32, shape (n, 2)
        Indices of the cells among those at surfaces.
    law, modulus, friction, counted : ndarray, shape (n,)
        Number of the law by which pairs are sorted first, modulus of the potential [Pa], coefficient of friction (1 for
        other laws), 1 where this rank counts the energy.
    memory, initial : dict of str to ndarray, shape (n,)
        `overlap`, energy of the initial overlap without forces [J/m]; `traction`, force of friction [N/m];
        `pressure`, the force across it, and states of laws. `initial` has the values of pairs that do not touch.
    """

    pair: np.ndarray
    law: np.ndarray
    modulus: np.ndarray
    friction: np.ndarray
    counted: np.ndarray
    memory: dict[str, np.ndarray]
    initial: dict[str, np.ndarray]


class _Law:
    """Compiled step of pairs with the same friction.

    Parameters
    ----------
    friction : FrictionLaw, optional
        A law with rates or states; without it, the friction of a pair is a coefficient.

    Attributes
    ----------
    names : list of str
        Fields of a pair that it needs besides `MEMORY`.
    initial : dict of str to float
        Their values before contact.
    """

    def __init__(self, friction: FrictionLaw | None = None) -> None:
        self.names: list[str] = []
        self.initial: dict[str, float] = {}
        self._number = np.zeros(1)
        macros: Table = {"RATED": 0}
        parts = ["interfaces/faults/return_map.c", "interfaces/collisions/collide.c"]
        if friction is not None:
            states = list(friction.all_state_fields())
            zero = np.zeros(1)
            first = friction.initial_state(zero, zero, zero)
            self.initial = {"pressure": 0.0} | {name: float(np.ravel(first[name])[0]) for name in states}
            self.names = list(self.initial)
            parameters, macros = formulas(CrackLaws(friction=friction), rated=True)
            self._number = np.array([*parameters.values(), 0.0], dtype=float)
            macros |= {name: f"number[{place}]" for place, name in enumerate(parameters)}
            macros |= {f"s_{name}": f"OLD({name})" for name in states}
            macros |= {"RATED": 1, "STATES": ", ".join([*(f"STATE_{name}" for name in states), "STATE_COUNT"])}
            parts.insert(1, "interfaces/faults/rated.c")
        source = "".join(files("ruptfx").joinpath(part).read_text() for part in parts)
        self.library = native.load("collide", source, macros)

    def __call__(self, arrays: Sequence[np.ndarray], since: float, memory: Mapping[str, np.ndarray]) -> None:
        """Add the forces of some pairs, with the arguments of `collide` in `collide.c`."""
        more: list[object] = []
        if self.names:
            states = [memory[name] for name in self.names[1:]]
            pointers = (ctypes.c_void_p * max(len(states), 1))(*(each.ctypes.data for each in states))
            more = [ctypes.c_double(since), *map(_pointer, (self._number, memory["pressure"])), ctypes.byref(pointers)]
        self.library.collide(ctypes.c_long(len(arrays[0])), *map(_pointer, arrays), *more)


class CollisionStep:
    """Contact between all cells at surfaces of a model.

    Parameters
    ----------
    materials : sequence of Material
        Materials of the bodies.

    Raises
    ------
    CaseError
        On all ranks: friction that is not proportional to pressure.
    """

    def __init__(
        self, cracks: CrackStep, bodies: Bodies, collisions: Collisions, materials: Sequence[Material], plane: Plane
    ) -> None:
        self._cracks, self._collisions, self._network = cracks, collisions, cracks.network
        net = self._network
        self._space = cracks.space
        mesh = self._space.mesh
        self.comm, self._body = mesh.comm, bodies.cell_body
        index_map = mesh.topology.index_map(2)
        self._owned, count = index_map.size_local, index_map.size_local + index_map.num_ghosts
        self._number = np.asarray(mesh.topology.original_cell_index)[:count]
        geometry = mesh.geometry
        self._vertices = geometry.input_global_indices[fem.geometry_dofmap(mesh)[:count]]
        self._nodes, self._owned_nodes = self._space.dofmap.list, self._space.dofmap.index_map.size_local
        self._x = self._space.tabulate_dof_coordinates()[:, :2]
        corner = self._x[self._nodes[: self._owned]]
        side = corner[:, 1:] - corner[:, :1]
        self._rest = np.abs(side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0])
        inner = np.zeros(count, dtype=int)
        np.add.at(inner, net.cells.ravel(), 1)
        self._outer = inner[: self._owned] < len(FACETS["triangle"])
        young = np.array([float(material.young_modulus_along(np.eye(2)[:1])[0]) for material in materials])
        spring = cracks.fracture.spring_of_collisions(young, cracks.edge)
        both = 2 / (1 / spring[:, None] + 1 / spring)
        self._modulus = np.vectorize(lambda k: collisions.modulus(k, cracks.edge))(both)
        laws, names = cracks.fracture.laws_by_pair(bodies.names), bodies.names
        pairs = {(a, b): laws[min(a, b), max(a, b)].friction for a in names for b in names}
        coefficients = {key: _coefficient(law, "-".join(sorted(key))) for key, law in pairs.items()}
        rated: list[FrictionLaw] = []
        for key, law in pairs.items():
            if coefficients[key] is None and law not in rated:
                rated.append(law)
        self._laws = [_Law(), *map(_Law, rated)]
        self._law = np.array([
            [0 if coefficients[a, b] is not None else 1 + rated.index(pairs[a, b]) for b in names] for a in names
        ])  # fmt: skip
        self._friction = np.array([[coefficients[a, b] if coefficients[a, b] is not None else 1.0 for b in names]
                                   for a in names])  # fmt: skip
        self._memory = [*MEMORY, *dict.fromkeys(name for law in self._laws for name in law.names)]
        self._made: State | None = None
        self._surface: _Surface | None = None
        self._pairs: _Pairs | None = None
        self._then = self._now = np.zeros((0, 6))

    def initial_state(self) -> FaultState:
        """Return pairs with history: numbers of both cells, and their memory."""
        return {name: np.zeros(0) for name in ("first", "second", *self._memory)}

    def cells(self) -> int:
        """Return the number of surface cells on all ranks before any failure; collective."""
        return int(parallel.total(self.comm, self._outer.sum()))

    def without_partner(self) -> np.ndarray:
        """Return the stiffness of possible later contact of nodes on edges of the bodies, shape (nodes,) [N/m].

        It is twice the stiffness of a flush side, half at each end, as the other body may be equally light. Sides of
        all cells count where no springs are between them: collision contact may replace each of their facets.
        """
        values = np.zeros((len(self._x), 2))
        rigid = self._cracks.fracture.rigid
        known = set() if rigid else {tuple(facet) for facet in self._network.vertices.tolist()}
        modulus = self._modulus.max(axis=1)
        for cell in range(self._owned) if rigid else np.flatnonzero(self._outer):
            for places in map(list, FACETS["triangle"]):
                if tuple(sorted(self._vertices[cell, places].tolist())) not in known:
                    nodes = self._nodes[cell, places]
                    length = float(np.hypot(*(self._x[nodes[1]] - self._x[nodes[0]])))
                    # 3 p (2 / h) on half of the length, with h = rest / length.
                    values[nodes] += 2 * 3 * modulus[self._body[cell]] * length**2 / self._rest[cell]
        return np.asarray(fem.from_owners(self._space, values)[:, 0])

    def find(self, state: State) -> None:
        """Search close pairs at the displacement, before facets and pairs exert forces; collective."""
        self._prepare(state)
        (x,) = self._corners(self._x.ravel() + state.displacement)
        if state.step % EVERY == 0 and self._replace_failed(state):
            known = self._numbers()
            self._surface = self._find_surface(state)
            (x,) = self._corners(self._x.ravel() + state.displacement)
            self._find_pairs(state, x)
            # New pairs that overlap are free of forces at this overlap.
            assert self._pairs is not None
            overlap = self._pairs.memory["overlap"]
            overlap[:] = np.where(np.isin(self._numbers(), known), overlap, self._overlaps(x))
        elif np.abs(x - self._then).max(initial=0.0) > 0.25 * MARGIN * self._cracks.edge:
            self._find_pairs(state, x)
        self._now = x

    def __call__(self, state: State, since: float) -> None:
        """Add the forces at the displacement of `find`, at the nodes this rank owns; collective.

        The mean of two successive forces does work, so half of the work of the forces belongs to the next step. Work
        that is neither stored nor dissipated by friction is lost.

        Parameters
        ----------
        since : float
            Time since the previous forces [s].
        """
        x, moved = self._now, since * self._corners(state.velocity)[0]
        pairs, surface = self._pairs, self._surface
        assert pairs is not None and surface is not None
        force, result, stored = np.zeros_like(x), np.zeros(1), np.zeros(1)
        ends = np.searchsorted(pairs.law, np.arange(len(self._laws) + 1))
        for law, begin, end in zip(self._laws, ends[:-1], ends[1:], strict=True):
            some = slice(int(begin), int(end))
            memory = {name: values[some] for name, values in pairs.memory.items()}
            items = (pairs.pair[some], x, moved, surface.rest, pairs.modulus[some], pairs.friction[some],
                     pairs.counted[some], memory["overlap"], memory["traction"], force, result, stored)  # fmt: skip
            law(items, since, memory)
        if not np.isfinite(result[0]):
            raise RuptfxError(
                f"no slip rate of colliding cells balances friction and force at time {state.time:.6g} s; try ruptfx "
                "check-law"
            )
        added = np.zeros_like(state.force)
        added.reshape(-1, 2)[self._nodes[surface.cells]] = self._mine(force).reshape(-1, 3, 2)
        state.force += added
        before = state.fields.get(OF_COLLISIONS, np.zeros_like(added))
        work = 0.5 * since * self._over(before + added, state.velocity)
        state.fields[OF_COLLISIONS] = added
        energy, overlapping = state.energy, float(stored[0])
        energy["frictional_dissipation"] += float(result[0])
        energy["collision_loss"] += energy["collisions"] - overlapping - work - float(result[0])
        energy["collisions"] = overlapping
        self._remember(state)

    def stored(self, state: State) -> float:
        """Return the energy of pairs of this rank at the time of the velocity, half a step after the forces [J]."""
        acting = state.fields.get(OF_COLLISIONS)
        over = 0.0 if acting is None else 0.5 * state.lag * self._over(acting, state.velocity)
        return state.energy["collisions"] - over

    def _over(self, force: np.ndarray, way: np.ndarray) -> float:
        """Return the scalar product over the nodes this rank owns."""
        count = 2 * self._owned_nodes
        return float(force[:count] @ way[:count])

    # -- who touches whom ----------------------------------------------------------------------------------------------

    def _prepare(self, state: State) -> None:
        """Search all pairs at the start or restart of a run; collective."""
        if self._made is state:
            return
        self._cracks.release(state.cracks[FIELD] == HANDED)
        self._surface, self._made = self._find_surface(state), state
        self._find_pairs(state, *self._corners(self._x.ravel() + state.displacement))

    def _replace_failed(self, state: State) -> bool:
        """Return whether facets have failed or been replaced since the last search, on any rank; collective."""
        cracks, field = state.cracks, state.cracks[FIELD]
        gone = cracks["damage"] >= 1
        far = np.maximum(cracks["inelastic_opening"], np.abs(cracks["slip"])).max(axis=1)
        is_far = far > 2 * self._collisions.activate_at * self._cracks.half_length
        # No end is a hinge about which pieces fold: where their sides are opposite, the frame of a facet is undefined.
        handed = gone.any(axis=1) & is_far
        cracks["damage"][handed] = 1.0
        now = np.where(handed | (field == HANDED), HANDED, np.where(gone.all(axis=1), FAILED, 0.0))
        changed = not np.array_equal(now, field)
        if not parallel.anywhere(self.comm, changed):
            return False
        then, over = state.at_faults()[1], 0.5 * state.lag * state.velocity
        former = self._cracks.stored(cracks, over, then)
        self._cracks.release(now == HANDED)
        # Energy in the springs of a facet at its replacement.
        state.energy["collision_loss"] += former - self._cracks.stored(cracks, over, then)
        field[:] = now
        return True

    def _find_surface(self, state: State) -> _Surface:
        """Find the cells at surfaces and their labels; collective."""
        net, order = self._network, self._cracks.order
        status = np.zeros(len(order))
        status[order] = state.cracks[FIELD]
        chosen = np.zeros(len(self._number), dtype=bool)
        chosen[: self._owned] = self._outer
        chosen[net.cells[status >= FAILED].ravel()] = True
        cells = np.flatnonzero(chosen[: self._owned])
        rows = np.column_stack([self._number[cells], self._body[cells], self._vertices[cells], self._rest[cells]])
        rank = np.full((len(rows), 1), float(self.comm.rank))
        rows = parallel.share_rows(self.comm, np.column_stack([rows, rank]).astype(float))
        sorted_ = np.argsort(rows[:, 0], kind="stable")
        rows = rows[sorted_]
        number, body, vertices = rows[:, 0].astype(int), rows[:, 1].astype(int), rows[:, 2:5].astype(int)
        # Facets that connect corners at vertices of these cells.
        near = np.isin(net.vertices, np.unique(vertices)).any(axis=1) & net.owned & (status < HANDED)
        sides = np.column_stack([self._number[net.cells[near]], net.vertices[near]])
        sides = parallel.share_rows(self.comm, sides.astype(np.int64))
        return _Surface(
            number, body, vertices, _labels(number, vertices, sides), sorted_, rows[:, 6] == self.comm.rank, cells,
            np.bincount(rows[:, 6].astype(int), minlength=self.comm.size).tolist(), np.ascontiguousarray(rows[:, 5]),
        )  # fmt: skip

    def _find_pairs(self, state: State, x: np.ndarray) -> None:
        """Find pairs within the margin, with their stored friction."""
        from scipy.spatial import cKDTree  # a run without collisions starts without it

        surface = self._surface
        assert surface is not None
        self._then = x
        corners = x.reshape(-1, 3, 2)
        middle = corners.mean(axis=1)
        margin = MARGIN * self._cracks.edge
        radius = np.sqrt(((corners - middle[:, None]) ** 2).sum(axis=2).max(initial=0.0))
        pair = cKDTree(middle).query_pairs(2 * radius + margin, output_type="ndarray").astype(np.int32)
        low, high = corners.min(axis=1) - 0.5 * margin, corners.max(axis=1) + 0.5 * margin
        a, b = pair.T
        keep = ((low[a] <= high[b]) & (low[b] <= high[a])).all(axis=1) & (surface.owned[a] | surface.owned[b])
        pair = pair[keep]
        label = surface.label[pair]
        joined = (label[:, 0, :, None] == label[:, 1, None, :]).any(axis=(1, 2))
        pair = pair[~joined | self._is_replaced(state, pair)]
        of = surface.body[pair].T
        pair = np.ascontiguousarray(pair[np.lexsort([pair[:, 1], pair[:, 0], self._law[of[0], of[1]]])])
        of = surface.body[pair].T
        law = self._law[of[0], of[1]]
        initial = {
            name: np.array([each.initial.get(name, 0.0) for each in self._laws])[law] for name in self._memory
        }  # fmt: skip
        self._pairs = _Pairs(
            pair, law, self._modulus[of[0], of[1]], self._friction[of[0], of[1]],
            surface.owned[pair[:, 0]].astype(float), {name: values.copy() for name, values in initial.items()}, initial,
        )  # fmt: skip
        self._recall(state)

    def _is_replaced(self, state: State, pair: np.ndarray) -> np.ndarray:
        """Return a mask of the pairs that are the two sides of a replaced facet."""
        surface = self._surface
        assert surface is not None
        handed = self._network.cells[self._cracks.order[state.cracks[FIELD] == HANDED]]
        known = np.sort(self._number[handed], axis=1)
        return np.isin(surface.number[pair] @ [MOST, 1], known @ [MOST, 1])

    def _numbers(self) -> np.ndarray:
        """Return one number for each pair from the numbers of both cells in the input."""
        pairs, surface = self._pairs, self._surface
        assert pairs is not None and surface is not None
        return np.asarray(surface.number[pairs.pair] @ [MOST, 1])

    def _recall(self, state: State) -> None:
        """Restore the history of pairs from the state."""
        pairs, saved = self._pairs, state.pairs
        assert pairs is not None
        theirs = saved["first"].astype(int) * MOST + saved["second"].astype(int)
        _, mine, place = np.intersect1d(self._numbers(), theirs, return_indices=True)
        for name in self._memory:
            pairs.memory[name][mine] = saved[name][place]

    def _remember(self, state: State) -> None:
        """Store the history of pairs in the state."""
        pairs, surface = self._pairs, self._surface
        assert pairs is not None and surface is not None
        acting = [pairs.memory[name] != 0 for name in self._memory if name in (*MEMORY, "pressure")]
        holds = np.any(acting, axis=0)
        for name, values in pairs.memory.items():
            values[~holds] = pairs.initial[name][~holds]
        first, second = surface.number[pairs.pair[holds]].T.astype(float)
        state.pairs = {"first": first, "second": second} | {
            name: pairs.memory[name][holds] for name in self._memory
        }  # fmt: skip

    def gather(self, state: State) -> FaultState:
        """Return pairs with friction of all ranks on rank 0, no rows elsewhere; collective."""
        numbers = self._number[: self._owned]
        counted = np.isin(state.pairs["first"], numbers)
        rows = parallel.gather_rows(self.comm, np.column_stack([*state.pairs.values()])[counted])
        if rows is None:
            rows = np.zeros((0, len(state.pairs)))
        rows = rows[np.lexsort([rows[:, 1], rows[:, 0]])]
        return {name: np.ascontiguousarray(column) for name, column in zip(state.pairs, rows.T, strict=True)}

    # -- arrays of all ranks -------------------------------------------------------------------------------------------

    def _corners(self, *fields: np.ndarray) -> list[np.ndarray]:
        """Return the corner values of fields of all local nodes in all cells at surfaces, (cells, 6); collective."""
        surface = self._surface
        assert surface is not None
        nodes = self._nodes[surface.cells]
        rows = np.concatenate([field.reshape(-1, 2)[nodes].reshape(-1, 6) for field in fields], axis=1)
        if self.comm.size > 1:
            width, mine = rows.shape[1], np.ascontiguousarray(rows)
            rows = np.empty((sum(surface.counts), width))
            self.comm.Allgatherv(mine, (rows, [width * count for count in surface.counts]))
        return [np.ascontiguousarray(part) for part in np.split(rows[surface.order], len(fields), axis=1)]

    def _mine(self, rows: np.ndarray) -> np.ndarray:
        """Return the rows of the cells of this rank, in its own order."""
        surface = self._surface
        assert surface is not None
        back = np.empty_like(rows)
        back[surface.order] = rows
        mine = np.zeros(len(rows), dtype=bool)
        mine[surface.order] = surface.owned
        return back[mine]

    def _overlaps(self, x: np.ndarray) -> np.ndarray:
        """Return overlap energies of all pairs, initial overlaps included [J/m]."""
        pairs, surface = self._pairs, self._surface
        assert pairs is not None and surface is not None
        energy = np.zeros(len(pairs.pair))
        self._laws[0].library.overlaps(
            ctypes.c_long(len(energy)), *map(_pointer, (pairs.pair, x, surface.rest, pairs.modulus, energy))
        )
        return energy


def _labels(number: np.ndarray, vertices: np.ndarray, sides_at: np.ndarray) -> np.ndarray:
    """Return labels of corners, shape (cells, 3), from connecting facets: numbers of both cells, and both vertices."""
    from scipy import sparse

    own = np.stack([np.repeat(number, 3), vertices.ravel()], axis=1)
    sides = [np.concatenate([sides_at[:, [side, 2]], sides_at[:, [side, 3]]]) for side in (0, 1)]
    rows = np.concatenate([own, *sides])
    names, place = np.unique(rows, axis=0, return_inverse=True)
    place = place.reshape(-1)
    first, second = np.split(place[len(own) :], 2)
    graph = sparse.coo_array((np.ones(len(first)), (first, second)), shape=(len(names),) * 2)
    label = sparse.csgraph.connected_components(graph, directed=False)[1]
    return np.asarray(label[place[: len(own)]].reshape(-1, 3))


def _coefficient(law: FrictionLaw, pair: str) -> float | None:
    """Return the coefficient of a friction law without rates and states, None for others.

    Raises
    ------
    CaseError
        Strength that is not proportional to pressure, as forces between overlapping cells have no area; parameters that
        vary; a law with the time since the start.
    """
    for name, _ in varying(law, f"friction of {pair}"):
        raise CaseError(f"collisions: {name} varies, and colliding cells have no position on it; give a number")
    if "clock" in law.all_state_fields():
        raise CaseError(
            f"collisions: friction of {pair}, kind = '{law.kind()}', depends on the time since the start, and states "
            "of colliding cells begin when they meet; use 'coulomb'"
        )
    zero = np.zeros(1)
    first = law.initial_state(zero, zero, zero)
    for rate, dt in product((0.0, 1e-3, 1.0), (0.0, LATE)):
        loads = 1e6 + zero, 2e6 + zero
        then = [first if dt == 0 else law.advance(first, rate + zero, load, dt) for load in loads]
        one, two = (float(np.ravel(law.strength(rate + zero, load, state))[0])
                    for load, state in zip(loads, then, strict=True))  # fmt: skip
        if abs(two - 2 * one) > 1e-9 * abs(one):
            raise CaseError(f"collisions: friction of {pair} is not proportional to pressure; use 'coulomb'")
    state = {name: symbol(f"s_{name}") for name in law.all_state_fields()}
    rate_of = symbol("slip_rate")
    recorded: object = record(law.strength, rate_of, symbol("normal_stress"), state)
    if depends(recorded, [rate_of, *state.values()]):
        return None
    return float(np.ravel(law.strength(zero, 1 + zero, first))[0])


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    assert array.flags.c_contiguous and array.dtype in (np.float64, np.int32)
    return address(array)
