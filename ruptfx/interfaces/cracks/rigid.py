"""Facets that are rigid until their strength: `RigidCracks` ties corners and inserts facets, `rigid.c` does the work.

The corners of all cells at a vertex are its vertex patch. Tied facets connect corners to connected components, each
with a single motion. An inserted facet between two components is an interface of split nodes: its traction is found
together with the velocity after it, so that fields of facets belong to the time of the displacement before the step.

A rank advances every vertex that one of its cells touches, with all cells and facets of its patch, some of which other
ranks own: all of them compute bitwise the same. Corners further out get their velocity from the owner of their cell.
"""

from __future__ import annotations

import ctypes
import logging
from functools import cached_property
from importlib.resources import files

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies.operators import Damped
from ruptfx.bodies.space.bodies import Bodies
from ruptfx.bodies.state import FaultState, State
from ruptfx.interfaces.cracks.extrinsic import Extrinsic
from ruptfx.interfaces.cracks.step import ENDS, FACETS, SHARED, CrackStep, formulas
from ruptfx.interfaces.faults.point_code import normal_traction
from ruptfx.laws.materials import Plane
from ruptfx.laws.materials.stiffness import tangent_stiffness
from ruptfx.platform import fem, parallel
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address
from ruptfx.platform.codegen.tracing import to_c

LOG = logging.getLogger("ruptfx.run")
# Error of the tractions at a vertex over the tractions and the tensile strength there; patch.c asks for 1e-8.
# Where friction is above 1, a vertex may have no solution in a step: granite with mu_d = 1.27 has errors up to 0.2 in 1
# to 70 of 10 000 steps, at single vertices, and goes on.
CONVERGED = 1e-6
ALLOWED = 1.0
REPORTED = (1, 10, 100, 1000, 10_000)  # numbers of steps beyond CONVERGED at which the log says so


class _Rigid(ctypes.Structure):
    """`struct rigid` of the C source."""

    _fields_ = [("cells", ctypes.c_long), ("facets", ctypes.c_long), *((name, ctypes.c_void_p) for name in (
        "star_start", "star", "ends_start", "ends", "place", "corner", "cell", "group", "first_number", "dof", "body",
        "leader", "split", "inserted", "left", "normal", "weight", "owned", "number", "strength", "gradient",
        "stiffness", "mass", "initial", "along", "stress", "present",
    ))]  # fmt: skip


class RigidCracks(CrackStep):
    """All facets of a model: ties, strength, laws, state.

    Arguments as of `CrackStep`.

    Attributes
    ----------
    unconverged : int
        Steps in which the tractions at a vertex of this rank had an error above 1e-6.
    leader : ndarray of int32, shape (nodes,)
        First corner, in the order of the input, of the component of every corner.
    losses : ndarray, shape (5,)
        Losses of the step in friction, fracture and contact [J], the largest error of the tractions at a vertex over
        their size, and that vertex.
    coupling, coupled : ndarray of int32
        Vertices that another mechanism updates (`couple`), and those of them with several components.
    fields_of_ends : list of str
        Names of the fields that `hold` changes.
    components_changed : bool
        True once components have been found again, until the mechanism of coupled vertices sets it to False.
    """

    ties_corners = True

    def _prepare(self, space: fem.dolfinx.fem.FunctionSpace[np.float64], bodies: Bodies, plane: Plane) -> None:
        assert isinstance(self.fracture, Extrinsic)
        self._every = self.fracture.check_every
        mesh = space.mesh
        count = len(self.network.cell_vertices)
        self._dof = np.ascontiguousarray(space.dofmap.list[:count], np.int32)
        self.fields_of_ends = [*ENDS, *self.law_states]
        self.unconverged = 0
        self._arrays: dict[str, np.ndarray] = {}  # arrays of the structure, which Python must keep alive
        self._c = _Rigid(count, len(self.order))
        x = mesh.geometry.x[:, :2][fem.geometry_dofmap(mesh)[:count]]
        after, last = np.roll(x, -1, axis=1), np.roll(x, -2, axis=1)
        size = (x[:, 1, 0] - x[:, 0, 0]) * (x[:, 2, 1] - x[:, 0, 1]) - (x[:, 2, 0] - x[:, 0, 0]) * (
            x[:, 1, 1] - x[:, 0, 1])  # fmt: skip
        gradient = np.stack([after[..., 1] - last[..., 1], last[..., 0] - after[..., 0]], axis=2) / size[:, None, None]
        moduli = [tangent_stiffness(material, plane) for material in self.cell_materials]
        entries = ((0, 0, 0, 0), (0, 0, 1, 1), (0, 0, 0, 1), (1, 1, 1, 1), (1, 1, 0, 1), (0, 1, 0, 1))
        self._keep("gradient", gradient.reshape(count, 6).T)  # numbers of neighbouring cells next to each other
        self._keep("stiffness", np.array([[modulus[entry] for entry in entries] for modulus in moduli]))
        self._keep("stress", np.zeros((3, count)))
        self._keep("initial", self.initial_stress[[0, 1, 0], [0, 1, 1]])
        self._keep("dof", self._dof.T)
        self._keep("body", bodies.cell_body[:count].astype(np.int32))
        self._keep("corner", self.corners.astype(np.int32))
        self._keep("cell", self.network.cells[self.order].astype(np.int32))
        self._keep("normal", self.normal)
        self._keep("present", self.normal.copy() if self.large_rotations else self.normal)
        self._keep("weight", self.weight)
        self._keep("along", self.along)
        self._keep("owned", self.owned.astype(float))
        self._keep("inserted", np.zeros(len(self.order), np.int32))
        self._find_stars()
        self._compile()

    def _keep(self, name: str, array: np.ndarray) -> None:
        self._arrays[name] = np.ascontiguousarray(array)
        setattr(self._c, name, self._arrays[name].ctypes.data)

    def _find_stars(self) -> None:
        """Find corners and facet ends of every vertex that a cell of this rank touches."""
        net = self.network
        vertex, node = net.cell_vertices.ravel(), self._dof.ravel()
        _, first, vertex = np.unique(vertex, return_index=True, return_inverse=True)
        # Neighbours in memory as their corners are; numbers of vertices change no bit.
        vertex = np.argsort(np.argsort(node[first]))[vertex]
        touched = np.zeros(len(first), dtype=bool)
        touched[vertex[: 3 * net.owned_cells]] = True
        # Corners of a patch in the order of the cells in the input.
        order = np.lexsort([np.repeat(net.cell_numbers, 3), vertex])
        order = order[touched[vertex[order]]]
        star, vertex = node[order], (np.cumsum(touched) - 1)[vertex[order]]
        count = int(touched.sum())
        bounds = np.searchsorted(vertex, np.arange(count + 1))
        self._vertex_of = np.full(self._nodes, -1)
        self._vertex_of[star] = vertex
        place = np.zeros(self._nodes, np.int32)
        place[star] = np.arange(len(star)) - np.repeat(bounds[:-1], np.diff(bounds))
        # Ends in the order of facets independent of the partition, by their local indices.
        position = np.empty(len(self.order), np.int64)
        position[self.order] = np.arange(len(self.order))
        facet, end = np.repeat(position, 2), np.tile([0, 1], len(position))
        at = self._vertex_of[self.corners[facet, 0, end]]
        sorted_ = np.argsort(at, kind="stable")
        sorted_ = sorted_[at[sorted_] >= 0]
        facet, end = facet[sorted_], end[sorted_]
        ends_start = np.searchsorted(at[sorted_], np.arange(count + 1))
        self._keep("star", star.astype(np.int32))
        self._keep("star_start", bounds.astype(np.int32))
        self._keep("ends", (2 * facet + end).astype(np.int32))
        self._keep("ends_start", ends_start.astype(np.int32))
        self._keep("place", np.stack([place[self.corners[facet, side, end]] for side in (0, 1)], axis=1))
        self._keep("split", np.zeros(count, np.int32))
        self._keep("left", np.ones(count, np.int32))
        self.summed_vertices = np.arange(count, dtype=np.int32)
        self._keep("leader", np.arange(self._nodes, dtype=np.int32))
        self.leader = self._arrays["leader"]
        # Sizes in the C code: other ones may be rounded differently.
        largest = [int(np.diff(values).max(initial=1)) for values in (bounds, ends_start)]
        self._most = [int(parallel.largest(net.comm, value)) for value in largest]

    def _compile(self) -> None:
        """Compile the formulas of all groups with the code that uses them."""
        text, numbers, first, strengths = "", [0.0], [], []
        for number, group in enumerate(self.groups):
            parameters, macros = formulas(group.laws)
            macros |= {name: f"number[{place}]" for place, name in enumerate(parameters)}
            macros |= {f"s_{name}": f"OLD({name})" for name in self.law_states} | {"GROUP": number, "RATED": 0}
            text += "".join(f"#define {name} {value}\n" for name, value in macros.items())
            text += _source("facet_law.c") + "".join(f"#undef {name}\n" for name in macros)
            first.append(len(numbers))
            numbers += [float(value) for value in parameters.values()]
            law = group.laws.cohesion
            strengths.append([0.0, 0.0] if law is None else [float(law.f_t), float(law.c)])
        names = "left", "damage", "friction", "advance"
        laws = ", ".join(
            "{" + ", ".join(f"{name}_{number}" for name in names) + "}" for number in range(len(self.groups))
        )
        entries = {
            "STATES": ", ".join([f"STATE_{name}" for name in self.fields_of_ends] + ["STATE_COUNT"]),
            "FACETS": ", ".join(f"FACET_{name}" for name in FACETS),
            "MOST_CORNERS": self._most[0], "MOST_ENDS": self._most[1], "PRELOADED": int(self.initial_stress.any()),
            "LARGE_ROTATIONS": int(self.large_rotations), "NORMAL_TRACTION": to_c(normal_traction(), end=" \\\n"),
        }  # fmt: skip
        source = _source("rigid_types.c") + text + f"static const struct law LAWS[] = {{{laws}}};\n"
        shared = "".join(files("ruptfx").joinpath(part).read_text() for part in SHARED)
        self._library = native.load("rigid", shared + source + _source("patch.c") + _source("rigid.c"), entries)
        self._library.check.restype = ctypes.c_long
        group_of = np.zeros(len(self.order), np.int32)
        for number, group in enumerate(self.groups):
            group_of[group.facets] = number
        self._keep("group", group_of)
        self._keep("first_number", np.array(first, np.int32))
        self._keep("number", np.array(numbers))
        self._keep("strength", np.array(strengths))
        self._found = np.zeros(len(self.order) + 1, np.int32)
        self.losses = np.zeros(5)
        self._others = np.zeros(len(self._arrays["split"]), dtype=bool)
        self.coupling = np.zeros(0, np.int32)
        self._pieces = np.zeros(0, np.int32)
        self._waiting = np.zeros(0, np.int32)
        self._mend(np.arange(len(self._arrays["split"]), dtype=np.int32))

    # -- corners that move together --------------------------------------------------------------------------------

    def total(self, values: np.ndarray, sums: np.ndarray, vertices: np.ndarray | None = None) -> None:
        """Sum values over the corners of every component, of all vertices or of some of them.

        Parameters
        ----------
        values, sums : ndarray, shape (nodes * 2,)
            May be the same array.
        vertices : ndarray of int32, optional
        """
        count = len(self._arrays["split"]) if vertices is None else len(vertices)
        self._library.total(
            ctypes.byref(self._c), ctypes.c_long(count),
            address(vertices), address(values), address(sums),
        )  # fmt: skip

    def corners_at(self, vertices: np.ndarray) -> np.ndarray:
        """Return the local nodes of some vertices, shape (nodes of all of them,)."""
        return self._at_vertices("star", vertices)

    def _mend(self, vertices: np.ndarray) -> None:
        """Find the components of some patches again."""
        self._library.split(ctypes.byref(self._c), ctypes.c_long(len(vertices)), address(vertices))
        split = self._arrays["split"] > 0
        self._pieces = np.flatnonzero(split & ~self._others).astype(np.int32)
        self.coupled = np.flatnonzero(split & self._others).astype(np.int32)
        self.components_changed = True

    def _vertices_of(self, facets: np.ndarray) -> np.ndarray:
        """Return the vertices of this rank at the ends of facets, each once."""
        values = np.unique(self._vertex_of[self.corners[facets, 0]])
        return values[values >= 0].astype(np.int32)

    def adopt(self, state: FaultState) -> bool:
        """Set tied and inserted facets from a state; return whether any has changed."""
        inserted = (np.isfinite(state["time_of_yield"]) | (state["damage"] >= 1).any(axis=1)).astype(np.int32)
        changed = np.flatnonzero(inserted != self._arrays["inserted"])
        self._arrays["inserted"][:] = inserted
        if len(changed):
            self._mend(self._vertices_of(changed))
        self._wait(state)
        return bool(len(changed))

    def _wait(self, state: FaultState) -> None:
        listens = np.isfinite(state["time_of_yield"]) & np.isnan(state["time_of_failure"]) & self.owned
        self._waiting = np.flatnonzero(listens).astype(np.int32)

    def hold_vertices(self, acting: np.ndarray) -> np.ndarray:
        """Find the vertices that `advance` leaves unchanged; return local nodes that it does not move.

        Parameters
        ----------
        acting : ndarray of bool, shape (nodes,)
            Nodes with loads, whose vertices are left unchanged, as are those with several components and those that
            `couple` has left to another mechanism.
        """
        excluded = (self._arrays["split"] > 0) | self._others
        touched = acting & (self._vertex_of >= 0)
        excluded[self._vertex_of[touched]] = True
        self._arrays["left"][:] = excluded
        self.summed_vertices = np.flatnonzero(excluded).astype(np.int32)
        return np.flatnonzero((self._vertex_of < 0) | excluded[self._vertex_of])

    # -- steps -----------------------------------------------------------------------------------------------------

    def grow(self, state: State, mass: np.ndarray) -> np.ndarray:
        """Insert the facets whose strength is reached; return their vertices, shape (n,).

        Parameters
        ----------
        state : State
            State that was adopted.
        mass : ndarray, shape (nodes * 2,)
            Mass of every single corner [kg].
        """
        if self.large_rotations:
            self._library.orient(ctypes.byref(self._c), address(state.displacement))
        if "mass" not in self._arrays:  # a resumed run has inserted facets before its first search
            self._keep("mass", mass)
        if state.step % self._every:
            return self._found[:0]
        cracks = state.cracks
        count = self._library.check(
            ctypes.byref(self._c), address(state.displacement), self._ends(cracks), address(self._found)
        )
        if not count:
            return self._found[:0]
        new = self._found[:count]
        self._library.insert(
            ctypes.byref(self._c), ctypes.c_long(count), address(new), ctypes.c_double(state.time),
            address(state.velocity), self._facets(cracks),
        )  # fmt: skip
        self._arrays["inserted"][new] = 1
        vertices = self._vertices_of(new)
        self._mend(vertices)
        self._wait(cracks)
        return vertices

    def advance(self, state: State, dt: float, keep: np.ndarray, push: np.ndarray, damped: Damped | None) -> None:
        """Advance vertices that are unbroken and free, all corners equally: v = keep v + push f, u += dt v.

        Parameters
        ----------
        state : State
            State, whose force becomes zero there.
        dt : float
            Time step [s].
        keep, push : ndarray, shape (nodes * 2,)
            Factors of every component [1, m/s/N].
        damped : Damped, optional
            Damping of their motion, whose force becomes zero there.
        """
        self._library.advance(
            ctypes.byref(self._c), ctypes.c_long(len(self._arrays["left"])), ctypes.c_double(dt),
            *map(address, (keep, push, state.force, state.velocity, state.displacement)),
            *((ctypes.c_void_p(None),) * 2 if damped is None else map(address, (damped.force, damped.lost))),
        )  # fmt: skip

    def hold(  # noqa: PLR0913
        self,
        state: State,
        dt: float,
        kick: float,
        since: float,
        push: np.ndarray,
        before: np.ndarray,
        vertices: np.ndarray | None = None,
        losses: np.ndarray | None = None,
    ) -> None:
        """Compute the tractions of inserted facets, and the velocity after them.

        Parameters
        ----------
        state : State
            State with the velocity without these tractions.
        dt, kick, since : float
            Time step, duration of the tractions in it, and time since the previous ones [s].
        push : ndarray, shape (nodes * 2,)
            Velocity per force of every component [m/s/N].
        before : ndarray, shape (nodes * 2,)
            Velocity before the step [m/s].
        vertices : ndarray of int32, optional
            Some of `coupled`; all other vertices with several components without it.
        losses : ndarray, shape (5,), optional
            Where to add the losses, in place of `losses` of this object.
        """
        vertices = self._pieces if vertices is None else vertices
        if len(vertices):
            self._library.hold(
                ctypes.byref(self._c), ctypes.c_long(len(vertices)), address(vertices),
                *map(ctypes.c_double, (dt, kick, since)),
                *map(address, (state.displacement, push, before, state.velocity, state.force)),
                self._ends(state.cracks), address(self.losses if losses is None else losses),
            )  # fmt: skip

    def count_losses(self, state: State) -> None:
        """Count the losses of a step, and find which facets fail; the velocities are final."""
        cracks, losses = state.cracks, self.losses
        self._worst = int(losses[4])
        self.count(state, losses[:4])
        losses[:] = 0
        if not (len(self._pieces) or len(self.coupled)):
            return
        self._library.listen(
            ctypes.byref(self._c), ctypes.c_long(len(self._waiting)), address(self._waiting),
            ctypes.c_double(state.time), address(state.velocity), self._ends(cracks), self._facets(cracks),
        )  # fmt: skip
        if len(self._waiting) and np.isfinite(cracks["time_of_failure"][self._waiting]).any():
            self._wait(cracks)

    def couple(self, nodes: np.ndarray) -> None:
        """Leave the vertices of some local nodes to another mechanism: `advance` and `hold` do not change them."""
        self._others[:] = False
        result = self._vertex_of[nodes]
        self._others[result[result >= 0]] = True
        self.coupling = np.flatnonzero(self._others).astype(np.int32)
        self._mend(self.coupling)

    def ends_at(self, vertices: np.ndarray) -> np.ndarray:
        """Return the facets that end at some vertices, each once."""
        return np.unique(self._at_vertices("ends", vertices) // 2)

    def _at_vertices(self, name: str, vertices: np.ndarray) -> np.ndarray:
        """Return the corners (`star`) or facet ends (`ends`) at some vertices."""
        start = self._arrays[f"{name}_start"]
        chosen = np.zeros(len(start) - 1, dtype=bool)
        chosen[vertices] = True
        return np.asarray(self._arrays[name][np.repeat(chosen, np.diff(start))])

    def require_balance(self, time: float) -> None:
        """Refuse tractions with an error above `ALLOWED`, and log some of the steps with one above `CONVERGED`.

        Raises
        ------
        RuptfxError
            On the ranks of the vertex: an error above `ALLOWED`.
        """
        if self.residual <= CONVERGED:
            return
        if not self.residual <= ALLOWED:
            end = self._arrays["ends"][self._arrays["ends_start"][self._worst]]
            x = ", ".join(f"{value:.6g}" for value in self.network.ends[self.order[end // 2], end % 2])
            raise RuptfxError(
                f"no tractions of the inserted facets at ({x}) m satisfy cohesion, contact and friction at time "
                f"{time:.6g} s: the error is {self.residual:.3g} of them, {ALLOWED:g} is allowed; a shorter "
                "stepper.time_step may help, or a smaller mu_d"
            )
        self.unconverged += 1
        if self.unconverged in REPORTED:
            LOG.warning(
                "fracture: the tractions of the inserted facets at a vertex have an error of %.2g of their size at "
                "%.6g s (%d steps with more than %g so far); a shorter stepper.time_step reduces it",
                self.residual, time, self.unconverged, CONVERGED,
            )  # fmt: skip

    def _ends(self, state: FaultState) -> ctypes.Array[ctypes.c_void_p]:
        return (ctypes.c_void_p * len(self.fields_of_ends))(*(state[name].ctypes.data for name in self.fields_of_ends))

    def _facets(self, state: FaultState) -> ctypes.Array[ctypes.c_void_p]:
        return (ctypes.c_void_p * len(FACETS))(*(state[name].ctypes.data for name in FACETS))

    # -- what is asked for between steps ---------------------------------------------------------------------------

    def add_force(self, state: FaultState, force: np.ndarray, displacement: np.ndarray | None = None) -> None:
        """Add the forces of tractions, and give all corners of a component their sum [N]."""
        self.adopt(state)
        facet, end = np.nonzero(self.leader[self.corners[:, 0]] != self.leader[self.corners[:, 1]])
        forces = self.weight[facet, None] * self._beyond_initial(state, *self._frame(displacement))[facet, end]
        rows = force.reshape(-1, 2)
        np.add.at(rows, self.corners[facet, 0, end], forces)
        np.add.at(rows, self.corners[facet, 1, end], -forces)
        self.total(force, force)

    def counted(self, nodes: np.ndarray) -> np.ndarray:
        """Return a mask of the corners that this rank counts: the first one of every component."""
        order = nodes[np.lexsort([self._cell_number[nodes], self.leader[nodes]])]
        first = np.append(True, self.leader[order][1:] != self.leader[order][:-1])[: len(order)]
        return np.asarray(order[first & (order < self._owned_nodes)])

    @cached_property
    def _cell_number(self) -> np.ndarray:
        """Return the number of the cell of every corner in the input."""
        number = np.empty(self._nodes, np.int64)
        number[self._dof] = self.network.cell_numbers[:, None]
        return number

    def release(self, facets: np.ndarray) -> None:
        self._arrays["weight"][:] = self.weight[:] = np.where(facets, 0.0, self.half_length)

    def add_spring_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        """Add nothing: there are no springs."""

    def stored(self, state: FaultState, added: np.ndarray, displacement: np.ndarray | None = None) -> float:
        """Return the energy that open facets would release by closing, T w / 2; facets of this rank [J]."""
        density = 0.5 * np.maximum(state["normal_traction"], 0.0) * state["inelastic_opening"]
        return float((self.owned * self.weight) @ density.sum(axis=1))


def _source(name: str) -> str:
    return files("ruptfx.interfaces.cracks").joinpath(name).read_text()
