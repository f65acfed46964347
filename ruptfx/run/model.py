"""The semi-discrete system: M a = -K u - C v - J' W (T - T_0) + boundary forces.

Vectors hold the local degrees of freedom of a blocked Lagrange space, ghosts included, node by node. Diagonal
quantities (mass, dashpots, edge forces) are complete at every local node, so that ranks update shared nodes alike and
exchange the internal force only.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import cached_property
from typing import Self

import numpy as np

from ruptfx import RuptfxError
from ruptfx.bodies import operators
from ruptfx.bodies.boundaries.loading import Loads
from ruptfx.bodies.meshes.strip import Strip
from ruptfx.bodies.operators.geometry import is_tensor
from ruptfx.bodies.operators.memory_sweep import MemorySweep
from ruptfx.bodies.space import mirror
from ruptfx.bodies.space.bodies import distribute
from ruptfx.bodies.state import State
from ruptfx.case import Case, FaultCase
from ruptfx.input.fields import ENERGIES, KEPT
from ruptfx.input.schema import CaseError, nearest
from ruptfx.interfaces.attachments import Attached
from ruptfx.interfaces.collisions.step import CollisionStep
from ruptfx.interfaces.cracks.rigid import RigidCracks
from ruptfx.interfaces.cracks.step import CrackStep
from ruptfx.interfaces.faults.fault import Fault, in_steps
from ruptfx.interfaces.mechanisms import mechanisms_of
from ruptfx.interfaces.mechanisms.system import System, Viscosity
from ruptfx.laws.contact import Way
from ruptfx.laws.materials import WaveSpeeds
from ruptfx.laws.materials.traced import TracedMaterial, traced
from ruptfx.platform import fem, parallel
from ruptfx.platform.codegen.native import DOUBLE
from ruptfx.run.faults import make_fault, require_separate_fluids
from ruptfx.run.viscous_layer import viscous_layer

ALONG = 1e-12  # a normal is along an axis if its largest component differs from 1 by less


class Model(System):
    """The discrete problem of a case on the ranks of a communicator.

    Parameters
    ----------
    comm : MPI communicator

    Raises
    ------
    RuptfxError
        On all ranks: a mesh without the named interface, bodies without material, unknown edges.
    """

    case: Case
    attachments: list[Attached]

    def __init__(self, case: Case, comm: fem.MPI.Comm | None = None) -> None:
        self.case = case
        sliding = [name for name, fault in case.faults.items() if fault.sliding is not None]
        world, broken = fem.world(comm), case.fracture is not None
        materials, order, boundaries = case.stressed_materials, case.order, case.boundaries
        if case.mesh.along_strike is None:
            self.section = None
            bodies = distribute(world, case.mesh, self._tied_edges(), sliding, broken)
        else:
            bodies = distribute(world, Strip(case.mesh, order))  # refuses meshes that are no sections
            from ruptfx.interfaces.section import Section  # needs SciPy, whose import takes long

            self.section = Section(case.mesh, materials, order, boundaries)
            materials = {name: each for name, each in materials.items() if name in ("default", *bodies.names)}
            order, boundaries = 1, []
        if broken and bodies.mesh.basix_cell().name != "triangle":
            cell = bodies.mesh.basix_cell().name
            raise CaseError(f"fracture: bodies break along triangles, this mesh has {cell}s; give one of triangles")
        if not broken and (len(bodies.open_facets) or bodies.joints):
            raise CaseError(
                "mesh: it has notches or joints, which open only where bodies may break; add the table [fracture]"
            )
        super().__init__(world, bodies, materials, case.plane, order, broken)
        mirror.refuse_other_images(self)
        self.cracks = None if case.fracture is None else (RigidCracks if case.fracture.rigid else CrackStep)(
            self.space, self.bodies, case.fracture, self.materials, case.plane, case.large_rotations,
            case.initial_tensor,
        )  # fmt: skip
        self.collisions = None if case.collisions is None or self.cracks is None else CollisionStep(
            self.cracks, self.bodies, case.collisions, self.materials, case.plane
        )  # fmt: skip
        of_cells = self.materials if self.cracks is None else self.cracks.cell_materials
        self.bulk = operators.Bulk(
            self.space,
            case.plane,
            of_cells,
            self.bodies.cell_body,
            large_rotations=case.large_rotations,
            variation=self.variation,
            real=case.real,
        )
        self.operator = operators.create(case.operator, self.bulk, case.loaded)
        self.force = fem.SharedVector(self.space, self.real, self.layout.shared)
        self.placed: dict[str, FaultCase] = {}  # what the case says of the faults, with positions instead of points
        self.faults = []
        for name, fault in case.faults.items():
            made, self.placed[name] = make_fault(self, case, name, fault)
            self.faults.append(made)
        require_separate_fluids(self)
        unknown = [name for name in self.bodies.interfaces if name not in case.faults]
        if unknown:
            raise CaseError(f"faults: the mesh has the interface '{unknown[0]}', which needs [faults.{unknown[0]}]")
        lines = {fault.name: fault.interface.line for fault in self.faults}
        if case.positions is not None and all(line.measure != "x" for line in lines.values()):
            measures = ", ".join(f"faults.{name}: {line.meaning}" for name, line in lines.items()) or "there is none"
            raise CaseError(f"positions = 'x': no interface is flat and along x; remove the line. {measures}")
        self.oblique = self._oblique_nodes()
        self.loads = Loads(self, boundaries)
        self.attachments = [each.bind(self, f"attachments.{number}") for number, each in enumerate(case.attachments)]
        for each in self.attachments:
            self.loads.add_dashpot(each.dashpot())
        self.memory = self._memory()
        self.viscosity: Viscosity | None = None
        self.mechanisms = mechanisms_of(self)
        self.viscosity = viscous_layer(self, case)  # as stable steps without it allow
        self.mechanisms = mechanisms_of(self)

    def _oblique_nodes(self) -> np.ndarray:
        """Return a mask of the nodes of faults whose normal is not along an axis; collective."""
        marked = np.zeros(self.nodes * self.components)
        of_nodes = marked.reshape(self.nodes, -1)
        for fault in self.faults:
            if self.components > 1 and not fault.slides:
                normal = fault.interface.frame[:, 0]
                of_nodes[fault.interface.nodes[np.tile(np.abs(normal).max(axis=1) < 1 - ALONG, 2)]] = 1
        self.layout.sum_shared(marked)
        return np.asarray(of_nodes[:, 0] > 0)

    def _tied_edges(self) -> dict[str, tuple[str, str]]:
        """Return the edges that boundaries tie, by key of the case."""
        boundaries = {f"boundaries.{number}": boundary for number, boundary in enumerate(self.case.boundaries)}
        return {key: boundary.tied_edges for key, boundary in boundaries.items() if boundary.tied_edges is not None}

    def free_inverse_mass(self) -> np.ndarray:
        """Return the inverse mass of all degrees of freedom [1/kg], with sums of tied ones; zero if prescribed."""
        mass = self.mass.copy()
        self.layout.sum_tied(mass)
        return np.where(self.loads.prescribed, 0.0, 1 / mass)

    @property
    def memory_laws(self) -> dict[str, TracedMaterial]:
        """Traced formulas of the materials with memory, by name of the body."""
        named = zip(self.bodies.names, self.given, strict=True)
        return {name: traced(material, self.case.plane) for name, material in named if material.has_memory()}

    @property
    def points_of_cells(self) -> int:
        """Number of points of a cell that have a state of their own."""
        return self.space.dofmap.list.shape[1] if is_tensor(self.mesh) else 1

    def _memory(self) -> dict[str, MemorySweep]:
        """Return the sweeps over the elements of materials with memory that this rank has, by name of the body."""
        owned = self.mesh.topology.index_map(self.mesh.topology.dim).size_local
        found, error = {}, None
        for number, (name, material) in enumerate(zip(self.bodies.names, self.given, strict=True)):
            only = self.bodies.cell_body == number
            if not material.has_memory() or not only[:owned].any():
                continue
            try:
                found[name] = MemorySweep(
                    replace(self.bulk, only=only, real=DOUBLE),
                    material,
                    f"materials.{name}",
                    number,
                    self.layout.shared,
                )
            except RuptfxError as caught:  # the elements of a rank may differ
                error = caught
        parallel.raise_on_all(self.comm, error)
        return found

    # -- for steppers ----------------------------------------------------------------------------------------------

    def initial_state(self) -> State:
        """Return the state at the start, with the initial stress and the given velocities."""
        zero = np.zeros(self.nodes * self.components)
        self.force.array[:] = 0
        velocity = self.initial_velocity()
        state = State(zero, velocity.astype(self.real, copy=False), self.force.array, {})
        for each in self.mechanisms:
            state.energy |= {energy.name: 0.0 for energy in each.energies if energy.name not in state.energy}
            each.begin(state)
        # The kinetic energy at the start counts as work of the boundaries.
        state.energy["boundary_work"] += 0.5 * self.layout.owned_dot(state.velocity, self.mass * state.velocity)
        return state

    def initial_slip_rate(self, fault: Fault) -> np.ndarray | None:
        """Return the slip rate at the start from the velocities of the bodies [m/s], None for compliant contact."""
        if fault.contact.traction_ends_slip or not self.case.initial_velocity:
            return None
        return np.asarray(fault.interface.split(fault.interface.rate(self.initial_velocity()))[1])

    def initial_velocity(self) -> np.ndarray:
        """Return the velocity of all local degrees of freedom at the start [m/s]; driven edges start at rest.

        Nodes where bodies are welded have the mean of their velocities by mass. Collective.
        """
        velocity = np.zeros((self.nodes, self.components))
        for name, given in self.case.initial_velocity.items():
            if name not in self.bodies.names:
                raise CaseError(f"initial_velocity.{name}: no such body, {nearest(name, self.bodies.names)}")
            share = self.mass_of(self.bodies.names.index(name)) / self.mass  # 1 inside of a body
            velocity += share.reshape(velocity.shape) * given
        velocity = velocity.ravel()
        velocity[self.loads.prescribed] = 0
        return velocity

    def internal_force(
        self, displacement: np.ndarray, at_rest: bool = False, out: np.ndarray | None = None
    ) -> np.ndarray:
        """Return -K u of bodies and elastic supports, summed over ranks [N].

        With the K of small motion, if `at_rest`.
        """
        force = np.empty_like(displacement) if out is None else out
        force[:] = 0
        small = at_rest and self.bulk.large_rotations
        (self._operator_at_rest if small else self.operator).add_internal_force(displacement, force)
        self.layout.sum_shared(force)
        self.loads.add_support_force(displacement, force)
        return force

    @cached_property
    def _operator_at_rest(self) -> operators.Operator:
        return operators.create(self.case.operator, replace(self.bulk, large_rotations=False), self.case.loaded)

    def in_steps(self, way: Way) -> Self:
        """Return this model with the contact methods for steps of one kind.

        Raises
        ------
        CaseError
            Contact that they cannot enforce.
        """
        view = copy.copy(self)
        view.faults = in_steps(self.faults, way, self.cracks is not None and self.cracks.ties_corners)
        view.mechanisms = mechanisms_of(view)
        return view

    @property
    def quadratic(self) -> bool:
        """True if the strain energy of the bodies is a quadratic form of the displacement."""
        return not self.bulk.large_rotations

    @property
    def copies(self) -> int:
        """2 if the bodies have a mirror image, whose energies count too, else 1."""
        return 2 if set(self.bodies.one_sided.values()) & {"antisymmetric", "symmetric"} else 1

    def energies(self, state: State, bulk: tuple[float, float] | None = None) -> dict[str, float]:
        """Return the energies over all ranks [J, per metre of thickness in 2D] at the time of the velocity.

        In the middle of a step the leapfrog scheme conserves v' M v / 2 + u_n' K u_(n+1) / 2 exactly. `boundary_work`
        contains the work of driven edges, tractions and the initial stress.

        Parameters
        ----------
        state : State
            With displacement and velocity at its time: not deferred.
        bulk : (float, float), optional
            Kinetic and strain energy of this rank [J] where the stepper knows them; else they cost a force evaluation.
        """
        assert not state.deferred
        kinetic, strain = bulk or self.bulk_energies(state)
        own_energies = {name: 0.0 if name in KEPT else state.energy.get(name, 0.0) for name in self.energy_columns}
        own_energies["kinetic"], own_energies["strain"] = kinetic, strain
        for each in self.mechanisms:
            each.add_energies(state, own_energies)
        for each in self.mechanisms:
            each.close_energies(state, own_energies)
        summed = self.copies * parallel.total(self.comm, list(own_energies.values()))
        return dict(zip(own_energies, summed.tolist(), strict=True))

    @property
    def energy_columns(self) -> list[str]:
        """Names of the energies: those of every case, then those of its mechanisms."""
        return list(dict.fromkeys([*ENERGIES, *(energy.name for each in self.mechanisms for energy in each.energies)]))

    def bulk_energies(self, state: State) -> tuple[float, float]:
        """Return kinetic and strain energy of this rank [J]; collective."""
        kinetic = 0.5 * self.layout.owned_dot(state.velocity, self.mass * state.velocity)
        then = state.at_faults()[1]
        if self.bulk.large_rotations:
            force = self.internal_force(then)
            return kinetic, self.strain_energy(then) - 0.5 * state.lag * self.layout.owned_dot(state.velocity, force)
        force = self.internal_force(state.displacement)
        return kinetic, 0.0 - 0.5 * self.layout.owned_dot(then, force)

    def strain_energy(self, displacement: np.ndarray) -> float:
        """Return the energy of the cells of this rank with large rotations, and of elastic supports [J]."""
        assert isinstance(self.operator, operators.EnergyOperator)
        support = np.zeros_like(displacement)
        self.loads.add_support_force(displacement, support)
        return self.operator.energy(displacement) - 0.5 * self.layout.owned_dot(displacement, support)

    def wave_speeds(self) -> WaveSpeeds:
        """Return the wave speeds of the body with the slowest S wave, the scale of the figures."""
        return min((m.wave_speeds(self.case.plane) for m in self.materials), key=lambda speeds: speeds.c_s)
