"""Tractions of all facets in an explicit step: `CrackStep` has the constant data, `cracks.c` the formulas.

Tractions and state belong to the time of the displacement. The mean of two successive tractions does work, so that
leapfrog conserves energy: in the middle of a step the stored energy is that at the last tractions plus half of their
work until the next ones.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ruptfx import RuptfxError, Table
from ruptfx.bodies.state import FaultState, State
from ruptfx.input.schema import CaseError, Part
from ruptfx.interfaces.cracks import CrackLaws, Fracture
from ruptfx.interfaces.cracks._network import CrackNetwork
from ruptfx.interfaces.faults.point_code import ITERATION, scalar_step
from ruptfx.interfaces.faults.projection import TracedLaw, parameters_as_symbols
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.materials import Material, Plane
from ruptfx.platform import fem, parallel
from ruptfx.platform.codegen import native
from ruptfx.platform.codegen.native import address
from ruptfx.platform.codegen.tracing import Expression, constant, depends, record, symbol, to_c

if TYPE_CHECKING:
    from scipy import sparse

    from ruptfx.bodies.space.bodies import Bodies

SHARED = "platform/codegen/lanes.c", "interfaces/faults/return_map.c"  # C in front of the code of all facets
BALANCED = 1e-6  # largest residual of a damage
ENDS = {
    "normal_traction": ("Pa", "normal traction, positive in tension"),
    "shear_traction": ("Pa", "shear traction"),
    "inelastic_opening": ("m", "opening beyond that of the spring"),
    "largest_opening": ("m", "largest inelastic opening until failure"),
    "slip": ("m", "inelastic slip"),
    "cohesive_slip": ("m", "inelastic slip until failure, whatever its direction"),
    "damage": ("1", "0 to 1, where nothing but friction is left"),
}
"""Fields of the two ends of every facet, shape (facets, 2)."""
FACETS = {
    "time_of_yield": ("s", "when the strength was reached first"),
    "time_of_failure": ("s", "when both ends had failed"),
    "time_of_gain": ("s", "when the kinetic energy around it was largest in between"),
    "energy_at_yield": ("J/m", "kinetic energy of the four corners at its yield"),
    "energy_gain": ("J/m", "largest increase of it until failure"),
    "slip_at_failure": ("m", "inelastic slip at failure, mean of both ends"),
}
"""Fields of every facet, shape (facets,); times are NaN until then."""


@dataclass(frozen=True)
class Group:
    """Facets with the same laws: a slice of all facets.

    Attributes
    ----------
    facets : slice
    laws : CrackLaws
        Their profiles are evaluated at the ends of the facets, first and second end of one after the other.
    rated : bool
        Whether friction depends on the slip rate, or its state changes without slip.
    """

    facets: slice
    laws: CrackLaws
    rated: bool = False


class FacetFrames:
    """Present position and directions of facets, which rotate with the bodies, and forces at their ends.

    Attributes
    ----------
    corners : ndarray of int, shape (facets, 2, 2)
        Local nodes of both sides and both ends.
    normal : ndarray, shape (facets, 2)
        Unit normal in the mesh.
    along : ndarray, shape (facets,)
        Length in the mesh [m], with the sign of its sense along the tangent.
    weight : ndarray, shape (facets,)
        Length that an end stands for [m].
    """

    large_rotations: bool
    corners: np.ndarray
    normal: np.ndarray
    along: np.ndarray
    weight: np.ndarray
    _owned_nodes: int

    def _turned(self, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return present tangents of the facets, the mean of both sides, and their signed lengths."""
        mean = displacement.reshape(-1, 2)[self.corners].mean(axis=1)
        sense = np.sign(self.along)
        along = self.along[:, None] * self.tangent + mean[:, 1] - mean[:, 0]
        length = np.hypot(along[:, 0], along[:, 1])
        return (sense / length)[:, None] * along, sense * length

    def _frame(self, displacement: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        if displacement is None or not self.large_rotations:
            return self.normal, self.tangent
        tangent = self._turned(displacement)[0]
        return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1), tangent

    def _moment(self, state: FaultState, displacement: np.ndarray) -> np.ndarray:
        """Return the work of tractions per rotation of the frame of the jumps, shape (facets,) [N]."""
        normal, tangent = self._frame(displacement)
        rows = displacement.reshape(-1, 2)
        jump = rows[self.corners[:, 1]] - rows[self.corners[:, 0]]
        opened, slipped = (np.einsum("fec,fc->fe", jump, axis) for axis in (normal, tangent))
        turning = state["shear_traction"] * opened - state["normal_traction"] * slipped
        return np.asarray(self.weight * turning.sum(axis=1))

    @property
    def tangent(self) -> np.ndarray:
        return np.stack([self.normal[:, 1], -self.normal[:, 0]], axis=1)

    def _assemble(self, minus: np.ndarray, plus: np.ndarray, total: np.ndarray) -> None:
        """Add forces at the ends of both sides, shape (facets, 2 ends, 2), at the nodes this rank owns."""
        rows = total.reshape(-1, 2)
        added = np.zeros_like(rows)
        np.add.at(added, self.corners[:, 0], minus)
        np.add.at(added, self.corners[:, 1], plus)
        rows[: self._owned_nodes] += added[: self._owned_nodes]


class CrackStep(FacetFrames):
    """All facets of a model: springs, laws, state, forces.

    Parameters
    ----------
    space : FunctionSpace
        Broken, of order 1.
    materials : sequence of Material
        Materials of the bodies, as in the case.
    large_rotations : bool
        Whether facets rotate with the cells on both sides.
    initial_stress : ndarray, shape (2, 2), optional
        Uniform initial stress of the bodies, tension positive [Pa]; facets carry it in the initial state.

    Attributes
    ----------
    network : CrackNetwork
    order : ndarray of int, shape (facets,)
        Facets of the network in the order of the arrays of this class, grouped by laws.
    stiffness : ndarray, shape (facets,)
        Stiffness of the springs [Pa/m].
    length_per_area : float
        Length of the bonded facets per area [1/m].
    cell_materials : list of Material
        Material of the cells of every body.
    edge : float
        Mean length of facets [m].
    residual : float
        Largest residual of this rank in the last step: error of the damage for opening and slip; for rigid
        facets, error of the tractions at a vertex over their size.
    weight, half_length : ndarray, shape (facets,)
        Length that an end stands for [m], nothing where somebody else cares for the contact, and half of the facet.
    position : ndarray, shape (facets, 2)
        Coordinate of the ends at which profiles are evaluated [m].
    initial_stress : ndarray, shape (2, 2)
        Uniform initial stress of the bodies, tension positive [Pa].
    initial : ndarray, shape (facets, 2)
        Normal and shear traction of the initial state, in equilibrium with the bodies [Pa].

    Raises
    ------
    CaseError
        On all ranks: pairs of unknown bodies, laws that cracks do not support.
    """

    ties_corners: ClassVar[bool] = False
    """Whether corners at a vertex move as one until facets separate them."""

    def __init__(
        self, space: fem.dolfinx.fem.FunctionSpace[np.float64], bodies: Bodies, fracture: Fracture,
        materials: Sequence[Material], plane: Plane, large_rotations: bool = False,
        initial_stress: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.space, self.fracture, self.large_rotations = space, fracture, large_rotations
        self.residual, self._worst = 0.0, 0
        for key, laws in fracture.all_laws():
            _check(key, laws, fracture)
        self.network = net = CrackNetwork(space, bodies, fracture.rigid)
        names = bodies.names
        of_pair = fracture.laws_by_pair(names)
        of_joint = fracture.laws_of_joints(bodies.joints)
        kinds = _distinct([*of_pair.values(), *of_joint.values()])
        table = np.zeros((len(names), len(names)), dtype=int)
        for i, a in enumerate(names):
            for j, b in enumerate(names):
                table[i, j] = kinds.index(of_pair[min(a, b), max(a, b)])
        kind = table[net.bodies[:, 0], net.bodies[:, 1]]
        for number, name in enumerate(bodies.joints):
            if name in of_joint:
                kind[net.joint == number] = kinds.index(of_joint[name])
        # Grouped by laws, with neighbours close. Every corner has two facets at most: their order changes no bit.
        self.order = np.lexsort((net.cells.min(axis=1), kind))
        bounds = np.searchsorted(kind[self.order], np.arange(len(kinds) + 1))
        self.position = net.ends[self.order][..., "xy".index(fracture.profiles_along)]
        self.groups = [
            self._group(slice(int(begin), int(end)), laws)
            for laws, begin, end in zip(kinds, bounds[:-1], bounds[1:], strict=True)
        ]
        owned, self._open = net.owned, net.open[self.order]
        total_length = net.total(net.length[owned])
        self.edge = total_length / max(net.total(np.ones(int(owned.sum()))), 1.0)
        bonded = np.array([laws.cohesion is not None for laws in kinds])[kind] & ~net.open
        self.length_per_area = net.total(net.length[owned & bonded]) / net.area
        of_sides = np.empty(net.bodies.shape)
        for number, material in enumerate(materials):
            at, side = np.nonzero(net.bodies == number)
            of_sides[at, side] = fracture.stiffness(material.young_modulus_along(net.normal[at]), self.edge)
        with np.errstate(divide="ignore"):  # rigid ones have no compliance
            self.stiffness = (2 / (1 / of_sides).sum(axis=1))[self.order]
        self.corners = net.corners[self.order]
        self.owned = owned[self.order]
        self.half_length = 0.5 * net.length[self.order]
        self.weight = self.half_length.copy()
        self.normal = net.normal[self.order]
        self.initial = np.zeros((len(self.order), 2))
        self.initial_stress = np.zeros((2, 2)) if initial_stress is None else initial_stress
        if initial_stress is not None:
            traction = self.normal @ initial_stress
            self.initial = np.stack([np.sum(traction * axis, axis=1) for axis in (self.normal, self.tangent)], axis=1)
        along = (net.ends[:, 1] - net.ends[:, 0])[self.order]
        self.along = np.sum(along * self.tangent, axis=1)  # length, with the sign of its sense along the tangent
        self._owned_nodes = space.dofmap.index_map.size_local
        self._nodes = self._owned_nodes + space.dofmap.index_map.num_ghosts
        self.cell_materials = [
            fracture.of_cells(material, plane, self.edge, self.length_per_area) for material in materials
        ]
        self.law_states = {
            name: unit for group in self.groups for name, unit in group.laws.friction.all_state_fields().items()
        }
        if initial_stress is not None:
            self._require_admissible()
        self._prepare(space, bodies, plane)

    def _group(self, facets: slice, laws: CrackLaws) -> Group:
        """Evaluate the laws of some facets at their ends; collective.

        Raises
        ------
        CaseError
            On all ranks: values that a profile must not have.
        """
        error = None
        try:
            result = laws.at(self.position[facets].ravel())
            for name in ("f_t", "c"):
                if result.cohesion is not None and np.min(getattr(result.cohesion, name), initial=np.inf) <= 0:
                    error = CaseError(f"fracture: cohesion.{name} is zero somewhere; it must be above zero")
        except CaseError as caught:
            result, error = laws, CaseError(f"fracture: {caught}")
        parallel.raise_on_all(self.network.comm, error)
        return Group(facets, result, is_rated(laws.friction))

    def _require_admissible(self) -> None:
        """Refuse initial stress that facets cannot carry; collective.

        Raises
        ------
        CaseError
            On all ranks: names the place, the tractions and the strengths.
        """
        error = None
        for group in self.groups:
            facets, laws = group.facets, group.laws
            normal, shear = np.repeat(self.initial[facets], 2, axis=0).T
            pressure = np.maximum(-normal, 0.0)
            state = laws.friction.initial_state(pressure, np.abs(shear), np.zeros_like(pressure))
            # A law that creeps carries what makes it slide as fast as it may at the start.
            rate = np.full_like(pressure, laws.friction.largest_initial_slip_rate())
            friction = np.where(pressure > 0, laws.friction.strength(rate, pressure, state), 0.0)
            bonded = np.where(self._open[facets], 0.0, 1.0).repeat(2) * (laws.cohesion is not None)
            tensile, cohesion = (
                bonded * (0.0 if laws.cohesion is None else getattr(laws.cohesion, name)) for name in ("f_t", "c")
            )
            bad = (normal > tensile) | (np.abs(shear) > cohesion + friction)
            bad &= self.owned[facets].repeat(2)
            if np.any(bad):
                first = int(np.argmax(bad))
                x = ", ".join(f"{value:.6g}" for value in self.network.ends[self.order[facets]][first // 2, first % 2])
                error = CaseError(
                    f"initial_stress.tensor: the facet at ({x}) m would carry {normal[first]:.4g} Pa normal to it "
                    f"(tension is positive) and {abs(shear[first]):.4g} Pa of shear, more than its strength "
                    f"({tensile[first]:.4g} Pa and {cohesion[first] + friction[first]:.4g} Pa); reduce it, or make the "
                    "facets stronger"
                )
        parallel.raise_on_all(self.network.comm, error)

    def _prepare(self, space: fem.dolfinx.fem.FunctionSpace[np.float64], bodies: Bodies, plane: Plane) -> None:
        """Compile the step."""
        self._kernels = [Kernel(self, group, self.corners) for group in self.groups]

    def initial_state(self) -> FaultState:
        """Return the fields of all facets in the initial state."""
        count = len(self.order)
        state: FaultState = {name: np.zeros((count, 2)) for name in (*ENDS, *self.law_states)}
        state["normal_traction"] += self.initial[:, :1]
        state["shear_traction"] += self.initial[:, 1:]
        for group in self.groups:
            normal, shear = np.repeat(self.initial[group.facets], 2, axis=0).T
            result = group.laws.friction.initial_state(np.maximum(-normal, 0.0), np.abs(shear), np.zeros_like(shear))
            for name, value in result.items():
                state[name][group.facets] = np.broadcast_to(value, len(shear)).reshape(-1, 2)
            if group.laws.cohesion is None:
                state["damage"][group.facets] = 1.0
        state |= {name: np.full(count, np.nan if unit == "s" else 0.0) for name, (unit, _) in FACETS.items()}
        state["damage"][self._open] = 1.0
        state["time_of_failure"][self._open] = -np.inf  # before all others, and no event
        return state

    def __call__(self, state: State, mass: np.ndarray, since: float) -> None:
        """Compute the tractions at the displacement, and add their forces at the nodes this rank owns.

        Parameters
        ----------
        state : State
            State with zero force.
        mass : ndarray, shape (nodes * components,)
            [kg].
        since : float
            Time since the previous tractions [s].
        """
        nodes = state.displacement, state.velocity, mass, state.force
        sweep = self.sweep(self._kernels, state.cracks, nodes, state.time, since)
        components = len(state.force) // self._nodes
        state.force[self._owned_nodes * components :] = 0
        self.count(state, sweep)

    def sweep(
        self, kernels: Sequence[Kernel], cracks: FaultState, nodes: Sequence[np.ndarray], time: float, since: float
    ) -> np.ndarray:
        """Call the kernels of all groups; return the losses in friction, fracture and contact [J], and the residual."""
        energy = np.zeros(5)
        for kernel, group in zip(kernels, self.groups, strict=True):
            before = energy[3]
            kernel(cracks, nodes, time, since, energy)
            if not energy[3] <= before:
                self._worst = group.facets.start + int(energy[4])
        return energy[:4]

    def require_balance(self, time: float) -> None:
        """Check the residual of the last step.

        Raises
        ------
        RuptfxError
            On the rank of the facet: its damage is not consistent with opening and slip.
        """
        if self.residual <= BALANCED:
            return
        x = ", ".join(f"{value:.6g}" for value in self.network.ends[self.order[self._worst]].mean(axis=0))
        raise RuptfxError(
            f"no damage of the facet at ({x}) m agrees with the opening and slip that its strength leaves at time "
            f"{time:.6g} s: it is wrong by {self.residual:.3g}, {BALANCED:g} is allowed; is the cohesive law "
            "continuous? Try ruptfx check-law"
        )

    def count(self, state: State, values: np.ndarray) -> None:
        """Count energy losses of facets in a step, and the largest residual of their laws."""
        *energies, self.residual = values.tolist()
        for name, amount in zip(("frictional_dissipation", "fracture", "impact_loss"), energies, strict=True):
            state.energy[name] += amount

    def add_force(self, state: FaultState, force: np.ndarray, displacement: np.ndarray | None = None) -> None:
        """Add the forces of the tractions on the nodes this rank owns [N].

        Parameters
        ----------
        displacement : ndarray, shape (nodes * components,), optional
            Displacement of that time [m], for the position of facets that rotate.
        """
        normal, tangent = self._frame(displacement)
        forces = self.weight[:, None, None] * self._beyond_initial(state, normal, tangent)
        self._assemble(forces, -forces, force)
        if displacement is not None and self.large_rotations:
            pull = (0.5 * self._moment(state, displacement) / self._turned(displacement)[1])[:, None] * normal
            both = np.stack([pull, -pull], axis=1)
            self._assemble(both, both, force)

    def counted(self, nodes: np.ndarray) -> np.ndarray:
        """Return those of some local nodes that this rank counts in sums over all ranks, shape (counted,)."""
        return np.asarray(nodes[nodes < self._owned_nodes])

    def release(self, facets: np.ndarray) -> None:
        """Stop all tractions of some facets, shape (facets,) of bool, which collision contact replaces."""
        self.weight[:] = np.where(facets, 0.0, self.half_length)
        for kernel in self._kernels:
            kernel.weigh(self.weight)

    def add_spring_force(self, displacement: np.ndarray, force: np.ndarray) -> None:
        """Add the forces of all springs, all elastic, at the nodes this rank owns [N]."""
        rows = displacement.reshape(-1, 2)
        force -= (self._springs @ rows).ravel()

    @cached_property
    def _springs(self) -> sparse.csr_matrix:
        """Return the stiffness between nodes, equal for both components [N/m]; rows of other ranks' nodes are empty."""
        from scipy import sparse  # a run without cracks starts without it

        minus, plus = (self.corners[:, side].ravel() for side in (0, 1))
        stiffness = np.repeat(self.weight * self.stiffness, 2)
        rows, columns = np.concatenate([minus, plus, minus, plus]), np.concatenate([minus, plus, plus, minus])
        values = np.concatenate([stiffness, stiffness, -stiffness, -stiffness])
        is_owned = rows < self._owned_nodes
        return sparse.csr_matrix((values[is_owned], (rows[is_owned], columns[is_owned])), shape=(self._nodes,) * 2)

    def tractions(
        self, state: FaultState, normal: np.ndarray | None = None, tangent: np.ndarray | None = None
    ) -> np.ndarray:
        """Return tractions on the minus sides, shape (facets, 2 ends, 2 components) [Pa].

        They are in the frame of the mesh, or in a given one.
        """
        n, t = self.normal if normal is None else normal, self.tangent if tangent is None else tangent
        normal_part = state["normal_traction"][..., None] * n[:, None]
        return np.asarray(normal_part + state["shear_traction"][..., None] * t[:, None])

    def _beyond_initial(self, state: FaultState, normal: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """Return tractions less the initial ones, with which the bodies are in equilibrium."""
        initial = self.initial[:, :1] * normal + self.initial[:, 1:] * tangent
        return np.asarray(self.tractions(state, normal, tangent) - initial[:, None])

    def preload_work(self, displacement: np.ndarray) -> float:
        """Return the work of the initial tractions on the jumps of a displacement, facets of this rank [J]."""
        rows = displacement.reshape(-1, 2)
        jump = (rows[self.corners[:, 1]] - rows[self.corners[:, 0]]).sum(axis=1)
        initial = self.initial[:, :1] * self.normal + self.initial[:, 1:] * self.tangent
        return float((self.owned * self.weight) @ np.sum(initial * jump, axis=1))

    def stored(self, state: FaultState, added: np.ndarray, displacement: np.ndarray | None = None) -> float:
        """Return the energy of springs and open secants, and later work of tractions; facets of this rank [J].

        Parameters
        ----------
        added : ndarray, shape (nodes * components,)
            Displacement since the tractions [m], on which they do work.
        displacement : ndarray, shape (nodes * components,), optional
            Displacement at the tractions [m], for the position of facets that rotate.
        """
        normal, shear, opened = (state[name] for name in ("normal_traction", "shear_traction", "inelastic_opening"))
        stiff = self.stiffness[:, None]
        density = 0.5 * (normal**2 + shear**2) / stiff + 0.5 * np.maximum(normal, 0.0) * opened
        density -= 0.5 * np.sum(self.initial**2, axis=1, keepdims=True) / stiff
        rows = added.reshape(-1, 2)
        jump = rows[self.corners[:, 1]] - rows[self.corners[:, 0]]
        frame = self._frame(displacement)
        density += np.sum(self.tractions(state, *frame) * jump, axis=2)
        stored = float((self.owned * self.weight) @ density.sum(axis=1))
        if displacement is not None and self.large_rotations:
            mean = rows[self.corners].mean(axis=1)
            turned = np.sum(frame[0] * (mean[:, 1] - mean[:, 0]), axis=1) / self._turned(displacement)[1]
            stored += float((self.owned * self._moment(state, displacement)) @ turned)
        return stored

    def gather(self, state: FaultState) -> FaultState:
        """Return fields of all facets on rank 0, in an order independent of the partition; collective.

        Other ranks have no rows.

        Parameters
        ----------
        state : dict of ndarray, shape (facets,) or (facets, ...)
        """
        columns = np.column_stack([*state.values()])
        sorted_ = np.empty_like(columns)
        sorted_[self.order] = columns
        rows = self.network.gather(sorted_)
        if rows is None:
            rows = columns[:0]
        ends = np.cumsum([int(np.prod(values.shape[1:])) for values in state.values()])
        parts = np.split(rows, ends[:-1], axis=1)
        return {
            name: np.ascontiguousarray(part.reshape(-1, *values.shape[1:]))
            for (name, values), part in zip(state.items(), parts, strict=True)
        }

    @property
    def number(self) -> np.ndarray:
        """Return the index of every facet in that order; collective at its first use."""
        return self.network.number[self.order]


def _distinct(laws: Iterable[CrackLaws]) -> list[CrackLaws]:
    distinct: list[CrackLaws] = []
    for each in laws:
        if each not in distinct:
            distinct.append(each)
    return distinct


class Kernel:
    """The compiled step of one group.

    Parameters
    ----------
    corners : ndarray of int, shape (all facets, 2 sides, 2 ends)
        Rows of the ends of all facets in the arrays of nodes that the step is called with.
    """

    def __init__(self, cracks: CrackStep, group: Group, corners: np.ndarray) -> None:
        facets, self._states = group.facets, [*ENDS, *cracks.law_states]
        self._facets, self._count = facets, facets.stop - facets.start
        parameters, macros = formulas(group.laws, group.rated)
        varied = {name: value for name, value in parameters.items() if isinstance(value, np.ndarray)}
        self._number = np.array([*(0.0 if name in varied else value for name, value in parameters.items()), 0.0])
        macros |= {name: f"number[{place}]" for place, name in enumerate(parameters)}
        macros |= {
            "GROUP": 0,
            "RATED": int(group.rated),
            "NUMBERS": len(parameters) + 1,
            "VARIED": len(varied),
            "VARIED_NUMBERS": ", ".join(str(list(parameters).index(name)) for name in varied) or "0",
        }
        for name, parameter in (("TENSION", "c_f_t"), ("BOND", "c_c")):
            place = list(varied).index(parameter) if parameter in varied else None
            macros[f"{name}_AT_ENDS"] = (
                f"*(const loose *)(varied + {place} * LANES)" if place is not None
                else "TENSILE_STRENGTH - none" if name == "TENSION" else "COHESION - none"
            )  # fmt: skip
        macros |= {f"s_{name}": f"OLD({name})" for name in cracks.law_states}
        macros |= {
            "BONDED": int(group.laws.cohesion is not None), "LARGE_ROTATIONS": int(cracks.large_rotations),
            "PRELOADED": int(cracks.initial.any()),
            "STATES": ", ".join([f"STATE_{name}" for name in self._states] + ["STATE_COUNT"]),
            "FACETS": ", ".join(f"FACET_{name}" for name in FACETS),
        }  # fmt: skip
        parts = *SHARED, "interfaces/faults/rated.c", "interfaces/cracks/facet_law.c", "interfaces/cracks/cracks.c"
        source = "".join(files("ruptfx").joinpath(part).read_text() for part in parts)
        self._library = native.load("cracks", source, macros)
        width = self._library.lanes_per_batch() // 2  # facets per batch
        fill = np.minimum(np.arange(-(-self._count // width) * width), max(self._count - 1, 0))
        corners = corners[facets].transpose(1, 0, 2)[:, fill]  # [side, facet, end]
        rows = [*cracks.normal.T, cracks.weight, cracks.stiffness, *([cracks.along] * cracks.large_rotations)]
        rows += [*cracks.initial.T] * int(cracks.initial.any())
        columns = np.stack([row[facets] for row in rows])[:, fill]
        self._node = np.ascontiguousarray(2 * corners.reshape(2, -1, 2 * width).transpose(1, 0, 2), np.int32)
        self._fixed = np.ascontiguousarray(columns.reshape(len(rows), -1, width).transpose(1, 0, 2))
        self._owned = cracks.owned[facets].astype(float)
        blocks = -(-self._count // width)
        ends = np.minimum(np.arange(blocks * 2 * width), max(2 * self._count - 1, 0))
        columns = np.array([value[ends] for value in varied.values()]).reshape(len(varied), blocks, 2 * width)
        self._varied = np.ascontiguousarray(columns.transpose(1, 0, 2))
        self.weigh(cracks.weight)

    def weigh(self, weight: np.ndarray) -> None:
        """Set the tributary length of ends, of all facets [m]; padding of the last block exerts no force."""
        blocks = self._fixed[:, 2]
        lengths = np.zeros(blocks.size)
        lengths[: self._count] = weight[self._facets]
        blocks[:] = lengths.reshape(blocks.shape)

    def __call__(
        self, cracks: FaultState, nodes: Sequence[np.ndarray], time: float, since: float, energy: np.ndarray
    ) -> None:
        """Advance the fields of the facets and add their forces at all corners.

        Parameters
        ----------
        cracks : dict of ndarray
            Fields of all facets.
        nodes : sequence of ndarray, shape (nodes * 2,)
            Displacement, velocity, mass and force.
        time, since : float
            Of the displacement, and since the previous tractions [s].
        energy : ndarray, shape (5,)
            Sums of the losses in friction, fracture and contact [J], the largest residual and its facet.
        """
        if not self._count:
            return
        ends = (ctypes.c_void_p * len(self._states))(*(self._begin(cracks[name]) for name in self._states))
        facets = (ctypes.c_void_p * len(FACETS))(*(self._begin(cracks[name]) for name in FACETS))
        arrays = self._node, self._fixed, self._number, self._varied, self._owned, *nodes
        self._library.update(
            ctypes.c_long(self._count), ctypes.c_double(since), ctypes.c_double(time),
            *map(address, arrays), ctypes.byref(ends), ctypes.byref(facets),
            address(energy),
        )  # fmt: skip

    def _begin(self, field: np.ndarray) -> int:
        return int(field.ctypes.data + self._facets.start * field.strides[0])


# -- laws ------------------------------------------------------------------------------------------------------------


def formulas(laws: CrackLaws, rated: bool = False) -> tuple[Table, Table]:
    """Return the values of the parameters by the names of their symbols, and the traced formulas as macros.

    A law with rates is that of interfaces with springs (`TracedLaw`), with the mean slip rate of the step as that at
    its end: of first order in a step which the springs of facets make short.
    """
    parameters, friction = parameters_as_symbols(laws.friction, "p_")
    state = {name: symbol(f"s_{name}") for name in laws.friction.all_state_fields()}
    formulas: dict[str, dict[str, Expression | float]] = {
        "LEFT": {"left": constant(0)}, "DAMAGE": {"damage": constant(1)},
    }  # fmt: skip
    macros: Table = {"TENSILE_STRENGTH": "0.0", "COHESION": "0.0"}
    if rated:
        law = TracedLaw(laws.friction, at_end=True)
        macros["BEGUN"] = ", ".join([*(f"BEGUN_{name}" for name in law.start), "BEGUN_COUNT"])
        macros |= {name: f"begun[BEGUN_{name}]" for name in law.start}
        formulas["BEGIN"] = {f"begun[BEGUN_{name}]": value for name, value in law.start.items()}
        formulas |= scalar_step()
        macros |= ITERATION
        formulas["STRENGTH"] = {name: law.outputs[name] for name in ("strength", "slope")}
        formulas["ADVANCE"] = {f"OLD({name})": law.outputs[f"n_{name}"] for name in law.state_names}
    else:
        sigma, rate = symbol("normal_stress"), symbol("slip_rate")
        advanced: Table = record(friction.advance, state, rate, sigma, symbol("since"))
        formulas["FRICTION"] = {"friction": record(friction.strength, constant(0), sigma, state)}
        formulas["ADVANCE"] = {f"OLD({name})": value for name, value in advanced.items()}
    if laws.cohesion is not None:
        result, cohesion = parameters_as_symbols(laws.cohesion, "c_")
        parameters |= result
        formulas["LEFT"] = {"left": record(cohesion.remaining_fraction, symbol("damage"))}
        formulas["DAMAGE"] = {"damage": record(cohesion.damage, symbol("opening"), symbol("slip"))}
        macros |= {"TENSILE_STRENGTH": "c_f_t", "COHESION": "c_c"}
    return parameters, macros | {name: to_c(outputs, end=" \\\n") for name, outputs in formulas.items()}


def is_rated(friction: FrictionLaw) -> bool:
    """Return whether the strength of a law depends on the slip rate, or its state changes without slip."""
    state = {name: symbol(f"s_{name}") for name in friction.all_state_fields()}
    rate, sigma, since = symbol("slip_rate"), symbol("normal_stress"), symbol("since")
    _, friction = parameters_as_symbols(friction.at(np.zeros(1)), "p_")
    at_rest: Table = record(friction.advance, state, constant(0), sigma, since)
    return depends(record(friction.strength, rate, sigma, state), [rate]) or any(
        at_rest[name] is not value for name, value in state.items()
    )


def _check(key: str, laws: CrackLaws, fracture: Fracture) -> None:
    """Refuse laws that facets all over a body cannot have.

    Raises
    ------
    CaseError
        Names the key.
    """
    for name in ("f_t", "c"):
        value = None if laws.cohesion is None else getattr(laws.cohesion, name)
        if value is not None and not callable(value) and value <= 0:
            raise CaseError(f"{key}.cohesion.{name} = 0: must be above zero; facets that hold nothing have no cohesion")
    for name, value in varying(laws, key) if fracture.rigid else ():
        raise CaseError(
            f"{name} = {value}: varies, and facets of fracture.kind = '{fracture.kind()}' have one number; give a "
            "number, or use 'intrinsic'"
        )
    friction: FrictionLaw = laws.friction
    for name in friction.all_state_fields():
        if name in ENDS:
            raise CaseError(
                f"{key}.friction.kind = '{friction.kind()}': its state '{name}' is one of facets, too; give cohesion "
                f"as {key}.cohesion, with another law of friction"
            )
    if not is_rated(friction):
        return
    kind = f"{key}.friction.kind = '{friction.kind()}'"
    if fracture.rigid:
        raise CaseError(
            f"{kind}: depends on the slip rate or on time, and facets of fracture.kind = '{fracture.kind()}' take laws "
            "like coulomb, slip weakening; use 'intrinsic'"
        )
    pressed = np.full(1, 1e6)
    values = friction.at(np.zeros(1))
    first, second = (values.initial_state(pressed, part * pressed, np.zeros(1)) for part in (0.3, 0.5))
    if any(np.any(first[name] != second[name]) for name in first):
        keys = [name for name in type(friction).model_fields if name.endswith("_initial")]
        raise CaseError(
            f"{kind}: its initial state follows from the shear stress, which facets do not know before they yield; "
            "give " + " and ".join(f"{key}.friction.{name}" for name in keys)
        )


def varying(part: Part, key: str) -> Iterator[tuple[str, object]]:
    """Yield profiles in a part, with their keys."""
    for name in type(part).model_fields:
        value = getattr(part, name)
        if isinstance(value, Part) and not callable(value):
            yield from varying(value, f"{key}.{name}")
        elif callable(value):
            yield f"{key}.{name}", value
