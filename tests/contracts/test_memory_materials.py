"""Every material with memory of the folder keeps its contract; a new file is tested without an edit here."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.bent_meshes import twist
from helpers.messages import facts
from helpers.small_cases import HOMALITE, plates
from helpers.whole_runs import whole_and_resumed

from ruptfx import RuptfxError
from ruptfx.app.check_law import materials as checks
from ruptfx.app.check_law.checks import Broken
from ruptfx.app.check_law.examples import tables
from ruptfx.input.schema import alternatives
from ruptfx.laws.materials import IDENTITY, Material, RecordedState, Tensor
from ruptfx.laws.materials.continuum_damage import ContinuumDamage
from ruptfx.laws.materials.drucker_prager import DruckerPrager
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.laws.materials.maxwell import Maxwell
from ruptfx.laws.materials.mohr_coulomb import MohrCoulomb
from ruptfx.laws.materials.prony import Prony
from ruptfx.laws.materials.standard_linear_solids import StandardLinearSolids
from ruptfx.laws.materials.tensor import COMPONENTS
from ruptfx.laws.materials.traced import OF_PLANE, traced
from ruptfx.laws.materials.von_mises import VonMises
from ruptfx.platform.codegen import native

pytest.importorskip("dolfinx")

from ruptfx.bodies.operators import Bulk, matrix_free
from ruptfx.bodies.operators.matrix_free import MatrixFree
from ruptfx.bodies.operators.memory_sweep import MemorySweep
from ruptfx.case import parse_case
from ruptfx.interfaces.mechanisms.memory import Memory
from ruptfx.platform import fem, parallel
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.recording.bulk_fields import BulkFields, recorded_states

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD

KINDS = [kind for kind, cls in alternatives("ruptfx.laws.materials").items() if cls.has_memory()]
PUSH = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 20.0, "ramp": 1e-6}
SLS: dict[str, Any] = {
    **HOMALITE, "kind": "standard_linear_solids", "Q_p": 25.0, "Q_s": 15.0, "lowest_frequency": 5e4,
    "frequency_ratio": 10.0,
}  # fmt: skip
DP: dict[str, Any] = {
    **HOMALITE, "kind": "drucker_prager", "cohesion": 1e6, "friction_angle": 0.5, "relaxation_time": 1e-7,
    "initial_stress": [-6e6, -6e6, -6e6, 0.0, 0.0, 0.0],
}  # fmt: skip


def example(kind: str, seed: int = 0) -> Material:
    cls = alternatives("ruptfx.laws.materials")[kind]
    made = cls.model_validate(tables(cls, seed + 1, lambda table: None)[seed])
    assert isinstance(made, Material)
    return made


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", checks.CHECKS)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_contract(kind: str, name: str, seed: int) -> None:
    with np.errstate(all="ignore"):
        checks.CHECKS[name](example(kind, seed), seed)


class Wrong(IsotropicElastic):
    """Creates energy: a stress that grows with time."""

    def state_fields(self) -> dict[str, Any]:
        return {}

    def stress(self, strain: Tensor, state: dict[str, Any], dt: Any) -> tuple[Tensor, dict[str, Any]]:
        first, shear = self.lame("strain")
        return (1 + dt) * (first * strain.trace() * IDENTITY + 2 * shear * strain), {}

    def stored(self, strain: Tensor, state: dict[str, Any]) -> Any:
        return 0.5 * strain.dot(self.stress(strain, state, 0.0)[0])


def test_checks_find_a_wrong_material() -> None:
    wrong = Wrong(**{name: value for name, value in HOMALITE.items() if name != "kind"})
    for name in ("present stress", "stable time step"):
        with pytest.raises(Broken):
            checks.CHECKS[name](wrong, 0)


# -- the compiled sweep --------------------------------------------------------------------------------------------

MESHES = [("quadrilateral", 3, 0.0), ("quadrilateral", 2, 0.1), ("triangle", 1, 0.05), ("hexahedron", 1, 0.0),
          ("hexahedron", 2, 0.05)]  # fmt: skip
# Materials differ in the formulas that are traced, meshes in the C code around them: each once.
BENT = MESHES[1]
SWEEPS = [*((kind, BENT) for kind in KINDS), *(("von_mises", mesh) for mesh in MESHES if mesh != BENT),
          ("standard_linear_solids", MESHES[-1])]  # fmt: skip


def bulk_of(material: Material, cell: str, order: int, bend: float, plane: str) -> Bulk:
    kind = getattr(fem.dolfinx.mesh.CellType, cell)
    if cell == "hexahedron":
        mesh = fem.dolfinx.mesh.create_box(fem.MPI.COMM_SELF, [[0, 0, 0], [2, 1, 1]], [3, 2, 2], kind)
    else:
        mesh = fem.dolfinx.mesh.create_rectangle(fem.MPI.COMM_SELF, [[0, 0], [2, 1]], [3, 3], kind)
    if bend:
        twist(mesh.geometry.x, mesh.geometry.dim, bend)
    cells = mesh.topology.index_map(mesh.topology.dim).size_local
    space = fem.lagrange(mesh, order, {"antiplane": 1, "solid": 3}.get(plane, 2))
    return Bulk(space, plane, [material], np.zeros(cells, dtype=np.int32), only=np.arange(cells) != 1)  # type: ignore[arg-type]


def reference(bulk: Bulk, u: np.ndarray, states: dict[int, Any], dt: float) -> np.ndarray:
    """The force of the inelastic stress from the NumPy formula, cell by cell: -sum of w det J s : grad(test)."""
    law, space = traced(bulk.materials[0], bulk.plane), bulk.space
    element, mesh = space.element.basix_element, space.mesh
    tensor = mesh.basix_cell().name != "triangle"
    points = np.asarray(element.points)
    shape = np.asarray(element.tabulate(1, points))[1:, :, :, 0]
    coordinate = fem.basix.create_element(fem.basix.ElementFamily.P, mesh.basix_cell(), 1)
    slopes = np.asarray(coordinate.tabulate(1, points))[1:, :, :, 0]
    if tensor:
        rule = fem.basix.make_quadrature(mesh.basix_cell(), 2 * element.degree - 1, rule=fem.basix.QuadratureType.gll)
        match = np.abs(np.asarray(rule[0])[None] - points[:, None]).sum(axis=2).argmin(axis=1)
        weights = np.asarray(rule[1])[match]
    else:
        weights = np.full(len(points), 0.5 / len(points))
    c, dim = space.dofmap.index_map_bs, mesh.geometry.dim
    force = np.zeros_like(u)
    for cell, dofs in enumerate(space.dofmap.list):
        if not bulk.only[cell]:  # type: ignore[index]
            continue
        x = mesh.geometry.x[fem.geometry_dofmap(mesh)[cell], :dim]
        jacobian = np.einsum("dqk,ka->qda", slopes, x)
        inverse, size = np.linalg.inv(jacobian), np.abs(np.linalg.det(jacobian))
        gradient = np.einsum("qad,dqk->qka", inverse, shape)
        h = np.einsum("qka,kc->qca", gradient, u.reshape(-1, c)[dofs])
        entries = {name: ("xyz".index(name[0]), "xyz".index(name[1])) for name in law.components}
        strain = {
            name: 0.5 * h[:, 0, a] if c == 1 else 0.5 * (h[:, a, b] + h[:, b, a]) for name, (a, b) in entries.items()
        }  # fmt: skip
        if not tensor:  # one point with a state
            strain = {name: values[:1] for name, values in strain.items()}
        old = states.setdefault(cell, {
            name: np.full(len(strain[law.components[0]]), value) for name, value in law.state.items()
        })  # fmt: skip
        stress, states[cell] = law.evaluate(strain, old, dt)
        stiffness = checks.tangent_stiffness(bulk.materials[0], bulk.plane)
        s = np.zeros((len(points), c, dim))
        for name, (a, b) in entries.items():
            if c == 1:
                s[:, 0, a] = stress[name] - stiffness[a, a] * 2 * strain[name]
                continue
            elastic = sum(
                stiffness[a, b, i, j] * (1 if i == j else 2) * strain[other] for other, (i, j) in entries.items()
            )  # fmt: skip
            s[:, a, b] = s[:, b, a] = stress[name] - elastic
        np.subtract.at(
            force.reshape(-1, c), dofs, np.einsum("q,q,qca,qka->kc", weights, size, s, gradient)
        )  # fmt: skip
    return force


@pytest.mark.parametrize("kind, mesh", SWEEPS)
def test_sweep_agrees_with_the_formula(kind: str, mesh: tuple[str, int, float]) -> None:
    """Three steps of random displacements: force, state and energy, in every plane of the material."""
    material, (cell, order, bend) = example(kind), mesh
    for plane in material.planes():
        if (plane == "solid") != (cell == "hexahedron"):
            continue
        bulk, random = bulk_of(material, cell, order, bend, plane), np.random.default_rng(1)
        sweep, states = MemorySweep(bulk, material, "materials.rock"), dict[int, Any]()
        state, law = sweep.begin(), traced(material, plane)
        size = bulk.space.dofmap.index_map.size_local * bulk.space.dofmap.index_map_bs
        for dt in (0.0, 1e-6, 1e-2):
            u = 0.3 * random.normal(size=size)
            force = np.zeros(size)
            sweep.add_force(u, state, dt, force)
            expected = reference(bulk, u, states, dt)
            largest = np.abs(stiffness_force(sweep, u)).max()
            assert np.abs(force - expected).max() < 1e-12 * largest
        assert np.abs(force).max() > 1e-6 * largest, "the material does not feel time"
        rows = sweep.rows(state, np.arange(len(bulk.space.dofmap.list) * 100))
        found = {name: np.sort(rows[:, :, place].ravel()) for place, name in enumerate(law.state)}
        for name, values in found.items():
            other = np.sort(np.concatenate([states[int(cell)][name] for cell in sweep.cells]))
            assert np.allclose(values, other, rtol=1e-9, atol=1e-12 * np.abs(other).max())


@pytest.mark.parametrize("kind, mesh", SWEEPS)
def test_stiffness_is_the_derivative_of_the_force(kind: str, mesh: tuple[str, int, float]) -> None:
    """The matrices of implicit steps against differences of the force of the sweep, in every plane of the material."""
    material, (cell, order, bend) = example(kind), mesh
    for plane in material.planes():
        if (plane == "solid") != (cell == "hexahedron"):
            continue
        bulk, random = bulk_of(material, cell, order, bend, plane), np.random.default_rng(2)
        sweep, c = MemorySweep(bulk, material, "materials.rock"), bulk.space.dofmap.index_map_bs
        size, dt = bulk.space.dofmap.index_map.size_local * c, 1e-6
        state, u, way = sweep.begin(), 0.3 * random.normal(size=size), random.normal(size=size)
        sweep.add_force(u, state, dt, np.zeros(size))
        u = u + 0.1 * random.normal(size=size)
        matrices = sweep.matrices(sweep.tangent(u, state, dt), slice(None))
        dofs = (c * sweep.nodes_of_cells[..., None] + np.arange(c)).reshape(len(matrices), -1)
        expected = np.zeros(size)
        np.add.at(expected, dofs, np.einsum("eij,ej->ei", matrices, way[dofs]))

        step, found = 1e-6, np.zeros(size)
        for sign in (-1, 1):
            force = np.zeros(size)
            sweep.add_force(u + sign * step * way, state.copy(), dt, force)
            found -= sign * force / (2 * step)
        assert np.abs(expected).max() > 0
        assert np.abs(found - expected).max() < 1e-5 * np.abs(stiffness_force(sweep, way)).max()


def stiffness_force(sweep: MemorySweep, u: np.ndarray) -> np.ndarray:
    force = np.zeros_like(u)
    sweep.add_internal_force(u, force)
    return force


def steps(changes: dict[str, Any], number: int = 60) -> tuple[dict[str, float], np.ndarray, Model]:
    case = parse_case(plates({"boundaries": [PUSH], **changes}))
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    for _ in range(number):
        state.wants_energies = True
        motion.step(state)
    return motion.energies(state), state.displacement, model


@pytest.mark.parametrize(("plane", "material"), [("strain", SLS), ("stress", SLS), ("strain", DP)])
def test_budget_closes_and_material_dissipates(plane: str, material: dict[str, Any]) -> None:
    found, _, _ = steps({"plane": plane, "materials.default": material})
    work = found.pop("boundary_work")
    assert abs(sum(found.values()) - work) < 1e-10 * work
    assert found["material_dissipation"] > 0.02 * work


def test_elastic_limit() -> None:
    """Far below yield, and with quality factors that are hardly felt, displacements are those of elastic bodies."""
    elastic = steps({"plane": "strain"})[1]
    strong = steps({"plane": "strain", "materials.default": {**DP, "cohesion": 1e12}})[1]
    assert np.abs(strong - elastic).max() < 1e-12 * np.abs(elastic).max()
    one = {**SLS, "Q_p": 9e3, "Q_s": 9e3}
    hardly = steps({"plane": "strain", "materials.default": one})[1]
    assert np.abs(hardly - elastic).max() < 1e-2 * np.abs(elastic).max()


def test_one_body_with_memory() -> None:
    """Memory in one body only: the other one has none, and the budget closes."""
    found, _, model = steps({"plane": "strain", "materials.lower": HOMALITE, "materials.default": SLS})
    assert list(model.memory) == ["upper"]
    work = found.pop("boundary_work")
    assert abs(sum(found.values()) - work) < 1e-10 * work


@pytest.mark.parametrize("material", [SLS, DP])
@pytest.mark.parametrize("layered", [False, True])
def test_steps_agree_with_an_operator_that_makes_none(
    material: dict[str, Any], layered: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sweeps in blocks of the bulk kernel and before all elements have the same displacements, states and energies.

    Blocks are so small that nodes move on before most elements are computed.
    """
    monkeypatch.setattr(matrix_free, "BLOCK_NODES", 64)
    bodies = {"materials.default": material} | ({"materials.lower": HOMALITE} if layered else {})
    found = []
    for operator in ("matrix_free", "ufl_form"):
        case = parse_case(plates({
            "plane": "strain", "boundaries": [PUSH], "operator": operator, "mesh.element_size": 5e-4, **bodies,
        }))  # fmt: skip
        model = Model(case)
        motion, state = case.stepper.bind(model), model.initial_state()
        for _ in range(60):
            state.wants_energies = True
            motion.step(state)
        memory = next(each for each in motion.mechanisms if isinstance(each, Memory))
        assert (memory.inelastic is not None) == (operator == "matrix_free")
        rows = [sweep.rows(state.memory[name], model.layout.numbering) for name, sweep in model.memory.items()]
        energies = motion.energies(state)
        found.append([np.array([*energies.values()]), state.displacement, *rows])
        if operator == "matrix_free":
            assert isinstance(model.operator, MatrixFree)
            assert model.operator._blocks > 8
            assert energies["material_dissipation"] > 0
    for fused, apart in zip(*found, strict=True):
        np.testing.assert_allclose(fused, apart, rtol=1e-9, atol=1e-11 * np.abs(apart).max())


def test_elastic_bodies_have_the_kernel_without_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of isotropic bodies run the code and read the numbers of a program that has no other material.

    The sweeps of materials with memory are in a library of their own, and moduli that vary add code behind a macro; the
    numbers of moduli given as a profile of equal values are those of uniform ones.
    """
    sources: list[str] = []
    load = native.load

    def watched(name: str, source: str, *rest: Any) -> Any:
        if name == "matrix_free":
            sources.append(source)
        return load(name, source, *rest)

    monkeypatch.setattr(native, "load", watched)
    young = HOMALITE["young_modulus"]
    layers = {"kind": "layers", "boundaries": [0.0], "values": [young, young]}
    profile = {**HOMALITE, "young_modulus": {"kind": "along_axis", "axis": "y", "profile": layers}}
    found = []
    for material in (HOMALITE, DP, profile):
        sources.clear()
        operator = Model(parse_case(plates({"plane": "strain", "materials.default": material}))).operator
        assert isinstance(operator, MatrixFree)
        found.append((sources[0], operator._keep))
    plain, numbers = found[0]
    assert not any(f"#define {word}" in plain for word in ("VARIES", "ANISOTROPIC 1", "LAW_STEP"))
    for (source, others), more in zip(found[1:], ("", "#define VARIES 1\n"), strict=True):
        assert source == more + plain
        for name in ("dof", "kind", "start", "number", "line", "block"):
            np.testing.assert_array_equal(others[name], numbers[name])


@pytest.mark.parametrize("material", [SLS, DP])
def test_the_same_on_any_ranks(material: dict[str, Any]) -> None:
    found = []
    for comm in (COMM, fem.MPI.COMM_SELF):
        given = plates({"plane": "strain", "boundaries": [PUSH], "materials.default": material})
        model = Model(parse_case(given), comm)
        motion, state = model.case.stepper.bind(model), model.initial_state()
        for _ in range(60):
            motion.step(state)
        energies = motion.energies(state)
        groups = {
            name: values for each in model.mechanisms for group in each.saved(state).values()
            for name, values in group.items() if name.endswith("_xy")
        }  # fmt: skip
        found.append([np.array([*energies.values()]), *comm.bcast(groups, root=0).values()])
    assert len(found[0]) > 1
    for here, alone in zip(*found, strict=True):
        np.testing.assert_allclose(here, alone, rtol=1e-9, atol=1e-11 * np.abs(alone).max())


def test_ranks_without_a_body() -> None:
    """The elements of a material with memory may all be on some of the ranks."""
    mesh = {"mesh.length": 2e-3, "mesh.height": 12e-3, "mesh.element_size": 5e-4}
    found = []
    for comm in (COMM, fem.MPI.COMM_SELF):
        model = Model(parse_case(plates({
            "plane": "strain", "boundaries": [PUSH], "materials.default": DP, **mesh,
        })), comm)  # fmt: skip
        motion, state = model.case.stepper.bind(model), model.initial_state()
        for _ in range(20):
            motion.step(state)
        found.append(motion.energies(state))
        if comm.size == 2:
            assert comm.allreduce(len(model.memory)) < 4
    assert found[0] == pytest.approx(found[1], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("material", [SLS, DP])
def test_resumed_bitwise(material: dict[str, Any], shared_tmp_path: Path) -> None:
    given = parse_case(plates({
        "plane": "strain", "boundaries": [PUSH], "materials.default": material, "output.checkpoint_steps": 30,
        "output.interface_interval": 2e-7, "output.bulk_interval": 1e-6, "output.bulk_fields": ["stress", "state"],
    }))  # fmt: skip
    whole, cut = whole_and_resumed(given, shared_tmp_path / material["kind"])
    if COMM.rank == 0:
        with Record(whole) as one, Record(cut) as other:
            assert one.energy.identical(other.energy)
            assert float(np.abs(one.energy["closure"]).max()) < 1e-11
            assert float(one.energy["material_dissipation"][-1]) > 0
            assert one.interface.identical(other.interface)
            assert one.bulk.identical(other.bulk)
            assert ("plastic_strain" in one.bulk) == (material is DP)


# -- states in snapshots -------------------------------------------------------------------------------------------


def test_snapshots_contain_the_state_of_the_nodes() -> None:
    """A plastic strain e_xy that is linear in space is sqrt(4/3) |e_xy| at the nodes, and NaN in the elastic body."""
    given = {"plane": "strain", "materials.lower": HOMALITE, "materials.default": DP, "output.bulk_fields": ["state"]}
    model = Model(parse_case(plates(given)), COMM)
    state, bulk, numbering = model.initial_state(), BulkFields(model), np.arange(model.nodes)

    def sheared(x: np.ndarray) -> np.ndarray:
        return np.asarray(1e-3 * (1 + 20 * x[..., 0] + 30 * x[..., 1]))

    for body, sweep in model.memory.items():
        rows = sweep.rows(state.memory[body], numbering)
        nodes = np.sort(model.space.dofmap.list[sweep.cells], axis=1)
        rows[:, :, list(sweep.law.state).index("plastic_strain_xy")] = sheared(model.coordinates[nodes])
        sweep.fill(state.memory[body], rows, numbering)
    topology, found = bulk.topology(), bulk.gather(state)
    upper = topology.body == model.bodies.names.index("upper")
    expected = np.where(upper, np.sqrt(4 / 3) * sheared(topology.points), np.nan)
    assert list(found) == ["plastic_strain"] and parallel.total(COMM, int(upper.sum())) > 0
    np.testing.assert_allclose(found["plastic_strain"], expected, rtol=1e-12)


@pytest.mark.parametrize(("cell", "order", "bend"), MESHES)
def test_states_have_the_weight_of_their_elements(cell: str, order: int, bend: float) -> None:
    """Sums over nodes are integrals: of 1, and of a state that jumps from element to element."""
    bulk = bulk_of(example("von_mises"), cell, order, bend, "solid" if cell == "hexahedron" else "strain")
    sweep = MemorySweep(bulk, bulk.materials[0], "materials.default")
    state, mesh = sweep.begin(), bulk.space.mesh
    nodes = bulk.space.dofmap.index_map.size_local
    rows = sweep.rows(state, np.arange(nodes))
    rows[:, :, list(sweep.law.state).index("equivalent_plastic_strain")] = 1.0 + sweep.cells[:, None]
    sweep.fill(state, rows, np.arange(nodes))
    sums = np.zeros((nodes, 2))
    sweep.add_recorded(np.zeros(nodes * bulk.space.dofmap.index_map_bs), state, sums)
    piecewise = fem.ufl.TestFunction(fem.dolfinx.fem.functionspace(mesh, ("DG", 0)))
    form = fem.form(piecewise * fem.ufl.dx(metadata={"quadrature_degree": 4}))
    volume = np.where(bulk.only, fem.dolfinx.fem.assemble_vector(form).array, 0.0)
    np.testing.assert_allclose(sums[:, 1].sum(), volume.sum(), rtol=1e-12)
    np.testing.assert_allclose(sums[:, 0].sum(), volume @ (1.0 + np.arange(len(volume))), rtol=1e-12)


class Renamed(DruckerPrager):
    """Records a state of the name of another field."""

    def recorded_states(self) -> dict[str, RecordedState]:
        return {"velocity": RecordedState("1", "no velocity")}

    def recorded(self, state: dict[str, Any]) -> dict[str, Any]:
        return {"velocity": state["overstress"]}


def test_wrong_records_of_a_state_are_refused() -> None:
    table = {name: value for name, value in DP.items() if name != "kind"}
    model = SimpleNamespace(given=[Renamed(**table)])
    with pytest.raises(RuptfxError, match=r"renamed\.recorded_states: .*'velocity'"):
        recorded_states(model)  # type: ignore[arg-type]

    class Tensorial(DruckerPrager):
        def recorded(self, state: dict[str, Any]) -> dict[str, Any]:
            return {"plastic_strain": state["plastic_strain"]}

    with pytest.raises(RuptfxError, match=facts("recorded: 'plastic_strain' must be a number")):
        traced(Tensorial(**table), "strain")

    class Missing(DruckerPrager):
        def recorded(self, state: dict[str, Any]) -> dict[str, Any]:
            return {}

    with pytest.raises(RuptfxError, match=facts("missing.recorded: return a dict with plastic_strain")):
        traced(Missing(**table), "strain")


# -- points against closed forms -----------------------------------------------------------------------------------


def test_relaxation_of_standard_linear_solids() -> None:
    """Shear strain e at once: stress 2 G (1 - sum_l Y_l (1 - exp(-omega_l t))) e; a ramp has its integral."""
    given = StandardLinearSolids.model_validate({name: value for name, value in SLS.items() if name != "kind"})
    shear, (_, of_shear), rates = given.shear_modulus, given.coefficients, given.rates
    law = traced(given, "strain")
    state = {name: np.zeros(1) for name in law.state}
    strain = {"xx": np.zeros(1), "yy": np.zeros(1), "xy": np.full(1, 1e-3)}
    _, state = law.evaluate(strain, state, 0.0)
    state |= {"strain_xy": np.full(1, 1e-3)}
    for number in range(1, 50):
        stress, state = law.evaluate(strain, state, 1e-7)
        time = number * 1e-7
        left = 1 - sum(y * (1 - np.exp(-rate * time)) for y, rate in zip(of_shear, rates, strict=True))
        assert stress["xy"][0] == pytest.approx(2 * shear * 1e-3 * left, rel=1e-10)
    state, rate_of_strain = {name: np.zeros(1) for name in law.state}, 100.0
    for number in range(1, 50):
        time = number * 1e-7
        stress, state = law.evaluate({**strain, "xy": np.full(1, rate_of_strain * time)}, state, 1e-7)
        lag = sum(y * (time + np.expm1(-rate * time) / rate) for y, rate in zip(of_shear, rates, strict=True))
        assert stress["xy"][0] == pytest.approx(2 * shear * rate_of_strain * (time - lag), rel=1e-10)


def test_flow_of_drucker_prager() -> None:
    """Shear at a constant rate from yield on: tau = Y + 2 G T rate (1 - exp(-t / T)), exact for steps of any length."""
    given = DruckerPrager.model_validate({name: value for name, value in DP.items() if name != "kind"})
    law, shear, relaxation, rate = traced(given, "strain"), given.shear_modulus, given.relaxation_time, 1e4
    limit = float(1e6 * np.cos(0.5) + 6e6 * np.sin(0.5))
    begun = limit / (2 * shear * rate)

    def error(steps: int) -> float:
        state, dt, stress = {name: np.zeros(1) for name in law.state}, 5 * relaxation / steps, {}
        for number in range(steps + 1):
            strain = {"xx": np.zeros(1), "yy": np.zeros(1), "xy": np.full(1, rate * (begun + number * dt))}
            stress, state = law.evaluate(strain, state, dt)
        exact = limit + 2 * shear * relaxation * rate * (1 - np.exp(-5))
        return abs(float(stress["xy"][0]) - exact) / exact

    assert max(error(1), error(5), error(1000)) < 1e-10


@pytest.mark.parametrize("steps", [1, 7, 200])
def test_damage_in_uniaxial_strain(steps: int) -> None:
    """Strain that grows linearly from the strength on, against r' = (tau - r) / T solved to 1e-12."""
    from scipy.integrate import solve_ivp

    table = {name: value for name, value in HOMALITE.items() if name != "kind"}
    given = ContinuumDamage(**table, strength=5e7, softening_strain=1e-2, relaxation_time=1e-6)
    law, (first, shear), young = traced(given, "strain"), given.lame("strain"), HOMALITE["young_modulus"]
    size = np.sqrt(young * (first + 2 * shear))  # tau over the strain
    begun, rate, duration = 5e7 / size, 2e3, 6e-6
    exact = solve_ivp(
        lambda t, r: (size * (begun + rate * t) - r) / 1e-6, (0, duration), [5e7], "DOP853", rtol=1e-12, atol=1e-6,
        max_step=duration / 1000,
    ).y[0, -1]  # fmt: skip
    state, stress = {name: np.full(1, value) for name, value in law.state.items()}, {}
    for number in range(steps + 1):
        strain = begun + rate * duration * number / steps
        parts = {"xx": np.full(1, strain), "yy": np.zeros(1), "xy": np.zeros(1)}
        stress, state = law.evaluate(parts, state, duration / steps * (number > 0))
    whole = 5e7 / exact * np.exp((5e7 - exact) / (young * 1e-2))
    assert 0.05 < whole < 0.5
    assert stress["xx"][0] == pytest.approx(whole * (first + 2 * shear) * strain, rel=1e-10)
    lateral = whole * first * strain
    assert stress["yy"][0] == pytest.approx(lateral, rel=1e-10)


@pytest.mark.slow
def test_slow_tension_softens_and_dissipates_what_it_should() -> None:
    """Uniaxial stress in long steps is f_t exp(-(e - f_t / E) / e_s), and its work f_t^2 / (2 E) + f_t e_s."""
    table = {name: value for name, value in HOMALITE.items() if name != "kind"}
    given = ContinuumDamage(**table, strength=5e7, softening_strain=1e-2, relaxation_time=1e-12)
    young, nu = HOMALITE["young_modulus"], HOMALITE["poisson_ratio"]
    law, limit = traced(given, "solid"), 5e7 / HOMALITE["young_modulus"]
    strains, state = np.linspace(0, limit + 0.25, 20001), {name: np.zeros(1) for name in law.state}
    found = []
    for strain in strains:
        parts = dict.fromkeys(COMPONENTS, np.zeros(1)) | {
            "xx": np.full(1, strain), "yy": np.full(1, -nu * strain), "zz": np.full(1, -nu * strain),
        }  # fmt: skip
        stress, state = law.evaluate(parts, state, 1.0)
        found.append(float(stress["xx"][0]))
        assert abs(stress["yy"][0]) < 1e-8 * 5e7
    expected = np.where(strains < limit, young * strains, 5e7 * np.exp((limit - strains) / 1e-2))
    np.testing.assert_allclose(found, expected, atol=1e-8 * 5e7)
    assert np.trapezoid(found, strains) == pytest.approx(0.5 * 5e7 * limit + 5e7 * 1e-2, rel=1e-5)


def test_cycle_of_drucker_prager_is_of_second_order() -> None:
    """Sinusoidal shear beyond yield in both senses against an ODE, tau' = 2 G e' - overstress / T, solved to 1e-10."""
    from scipy.integrate import solve_ivp

    given = DruckerPrager.model_validate({name: value for name, value in DP.items() if name != "kind"})
    law, shear, size, period = traced(given, "strain"), given.shear_modulus, 5e-3, 4e-6
    limit = float(1e6 * np.cos(0.5) + 6e6 * np.sin(0.5))

    def rate(t: float, stress: np.ndarray) -> np.ndarray:
        beyond = np.sign(stress) * np.maximum(np.abs(stress) - limit, 0.0)
        forced = 2 * shear * size * 2 * np.pi / period * np.cos(2 * np.pi * t / period)
        return np.asarray(forced - beyond / given.relaxation_time)

    exact = solve_ivp(rate, (0, 0.55 * period), [0.0], "DOP853", rtol=1e-11, atol=1e-3, max_step=period / 2000).y[0, -1]

    def error(steps: int) -> float:
        state, stress = {name: np.zeros(1) for name in law.state}, {}
        for number in range(1, steps + 1):
            xy = np.full(1, size * np.sin(2 * np.pi * 0.55 * number / steps))
            stress, state = law.evaluate({"xx": 0 * xy, "yy": 0 * xy, "xy": xy}, state, 0.55 * period / steps)
        return abs(float(stress["xy"][0]) - exact) / limit

    coarse, fine = error(200), error(400)
    assert fine < 2e-5
    assert coarse / fine > 3.5


def test_perfect_plasticity_of_drucker_prager() -> None:
    """With steps much longer than the relaxation time the stress stays on the yield surface: 1e-8 of Y."""
    given = DruckerPrager.model_validate({name: value for name, value in DP.items() if name != "kind"})
    law = traced(given, "strain")
    state = {name: np.zeros(1) for name in law.state}
    for number in range(1, 20):
        strain = {"xx": np.zeros(1), "yy": np.zeros(1), "xy": np.full(1, 1e-3 * number)}
        stress, state = law.evaluate(strain, state, 1e12 * given.relaxation_time)
    assert stress["xy"][0] == pytest.approx(1e6 * np.cos(0.5) + 6e6 * np.sin(0.5), rel=1e-8)


ELASTIC = {name: value for name, value in HOMALITE.items() if name != "kind"}


def sheared(material: Material, strain: np.ndarray, dt: float) -> np.ndarray:
    """Return the shear stress of one point along a path of shear strain, which begins at zero."""
    law, found = traced(material, "strain"), []
    state = {name: np.full(1, value) for name, value in law.state.items()}
    for xy in strain:
        stress, state = law.evaluate({"xx": np.zeros(1), "yy": np.zeros(1), "xy": np.full(1, xy)}, state, dt)
        found.append(float(stress["xy"][0]))
    return np.array(found)


def test_ramp_of_maxwell() -> None:
    """Shear at a constant rate: tau = 2 G T rate (1 - exp(-t / T)); then relaxation with exp(-t / T)."""
    given, rate, dt = Maxwell.model_validate({**ELASTIC, "relaxation_time": 1e-6}), 100.0, 1.7e-7
    t = dt * np.arange(1, 41)
    found = sheared(given, rate * np.minimum(t, t[19]), dt)
    risen = 2 * given.shear_modulus * 1e-6 * rate * -np.expm1(-np.minimum(t, t[19]) / 1e-6)
    np.testing.assert_allclose(found, risen * np.exp(-np.maximum(t - t[19], 0) / 1e-6), rtol=1e-10)


def test_ramp_of_prony() -> None:
    """Shear and volume at constant rates: the integral of the relaxation function, 2 G(t) rate and 3 K(t) rate."""
    times, moduli, bulk = np.array([3e-7, 2e-6, 4e-5]), np.array([2e8, 3e8, 1e8]), np.array([1e8, 5e7, 4e8])
    given = Prony.model_validate({
        **ELASTIC, "times": times.tolist(), "shear_moduli": moduli.tolist(), "bulk_moduli": bulk.tolist(),
    })  # fmt: skip
    rate, dt = 100.0, 1.7e-7
    t = dt * np.arange(1, 41)
    lag = t[:, None] + times * np.expm1(-t[:, None] / times)
    found = sheared(given, rate * t, dt)
    np.testing.assert_allclose(found, 2 * rate * (given.shear_modulus * t - lag @ moduli), rtol=1e-10)
    law = traced(given, "solid")
    state, K = {name: np.zeros(1) for name in law.state}, given.lame("strain")[0] + 2 * given.shear_modulus / 3
    for each, lost in zip(t, lag @ bulk, strict=True):
        strain = {name: np.full(1, rate * each * (name[0] == name[1])) for name in law.components}
        stress, state = law.evaluate(strain, state, dt)
        assert stress["zz"][0] == pytest.approx(3 * rate * (K * each - lost), rel=1e-10)


@pytest.mark.parametrize("part, accepted", [(0.999, True), (1.001, False)])
def test_all_of_the_bulk_modulus_may_relax_and_no_more(part: float, accepted: bool) -> None:
    """K = E / (3 (1 - 2 nu))."""
    modulus = HOMALITE["young_modulus"] / (3 * (1 - 2 * HOMALITE["poisson_ratio"]))
    material = {**HOMALITE, "kind": "prony", "times": [1e-6, 1e-5], "shear_moduli": [1e8, 1e8],
                "bulk_moduli": [0.25 * part * modulus, 0.75 * part * modulus]}  # fmt: skip
    if accepted:
        parse_case(plates({"materials.default": material}))
    else:
        with pytest.raises(Exception, match="bulk_moduli"):
            parse_case(plates({"materials.default": material}))


@pytest.mark.parametrize(("changes", "said"), [
    ({"shear_moduli": [1e8]}, "one for each time"), ({"shear_moduli": [1e9, 2e9]}, "exceeds the shear modulus"),
    ({"bulk_moduli": [1e10, 1e10]}, "exceeds the bulk modulus"),
])  # fmt: skip
def test_bad_prony_series_are_refused(changes: dict[str, Any], said: str) -> None:
    prony = {**HOMALITE, "kind": "prony", "times": [1e-6, 1e-5], "shear_moduli": [1e8, 1e8]}
    with pytest.raises(Exception, match=facts(said)):
        parse_case(plates({"materials.default": {**prony, **changes}}))


METAL: dict[str, Any] = {**ELASTIC, "yield_stress": 2e7, "hardening": 3e8, "kinematic_hardening": 5e8}


def test_cycle_of_von_mises() -> None:
    """Shear beyond yield and back, far slower than the relaxation: isotropic and kinematic hardening, bilinear."""
    given = VonMises.model_validate({**METAL, "relaxation_time": 1e-18})
    three = 3 * given.shear_modulus  # q = sqrt(3) tau grows by 3 G for each equivalent strain 2 / sqrt(3) e_xy
    slope, top = three * 8e8 / (three + 8e8), 0.05
    q_of = np.sqrt(3) * sheared(given, np.sqrt(3) / 2 * np.array([0.01, 0.03, top, 0.04, 0.0, -top]), 1.0)
    kappa = (three * top - 2e7) / (three + 8e8)
    peak, turned = 2e7 + 8e8 * kappa, 5e8 * kappa - (2e7 + 3e8 * kappa)  # the latter: where it yields backwards
    at = top - (peak - turned) / three
    expected = [2e7 + slope * (e - 2e7 / three) for e in (0.01, 0.03, top)]
    expected += [max(peak - three * (top - e), turned + slope * (e - at)) if e > at else turned + slope * (e - at)
                 for e in (0.04, 0.0, -top)]  # fmt: skip
    np.testing.assert_allclose(q_of, expected, rtol=1e-8)


def test_rate_of_von_mises() -> None:
    """Shear at a constant rate from yield on: overstress g T (1 - exp(-t / T)), exact for steps of any length."""
    T, rate = 1e-6, 1e3
    given = VonMises.model_validate({**METAL, "relaxation_time": T})
    three = 3 * given.shear_modulus
    t = 0.7 * T * np.arange(20)
    found = np.sqrt(3) * sheared(given, np.sqrt(3) / 2 * (2e7 / three + rate * t), 0.7 * T)
    over = three * rate * T * -np.expm1(-t / T)
    hardened = (three * rate * t - over) * 8e8 / (three + 8e8)
    np.testing.assert_allclose(found, 2e7 + hardened + over, rtol=1e-8)


@pytest.mark.parametrize("way", ["shear", "squeeze"])
def test_mohr_coulomb_stays_on_its_line(way: str) -> None:
    """Largest |tau| + sigma tan phi over all planes of the section is the cohesion; sigma_zz follows elastically."""
    values = {name: value for name, value in DP.items() if name not in ("kind", "initial_stress")}
    given = MohrCoulomb.model_validate({**values, "initial_stress": [-6e6, -6e6, -1e6, 0.0, 0.0, 0.0]})
    law, state = traced(given, "strain"), {}
    state = {name: np.zeros(1) for name in law.state}
    for number in range(1, 20):
        size = 1e-3 * number
        strain = {"xx": np.full(1, size if way == "squeeze" else 0.0), "yy": np.full(1, -2 * size * (way == "squeeze")),
                  "xy": np.full(1, size if way == "shear" else 0.0)}  # fmt: skip
        stress, state = law.evaluate(strain, state, 1e12 * given.relaxation_time)
    xx, yy, xy = (float(stress[name][0]) for name in ("xx", "yy", "xy"))
    angle = np.linspace(0, np.pi, 20001)
    c, s = np.cos(angle), np.sin(angle)
    normal = (xx - 6e6) * c**2 + (yy - 6e6) * s**2 + 2 * xy * c * s
    tau = (yy - xx) * c * s + xy * (c**2 - s**2)
    assert np.max(np.abs(tau) + normal * np.tan(0.5)) == pytest.approx(1e6, rel=1e-5)


def test_quality_factors() -> None:
    """Fitted mechanisms keep Q within 5 % over a band of two decades, with one mechanism per decade and one more."""
    values = {name: value for name, value in SLS.items() if name != "kind"}
    given = StandardLinearSolids.model_validate({
        **values, "Q_p": 50.0, "Q_s": 30.0, "lowest_frequency": 1e4, "frequency_ratio": 100.0, "mechanisms": 4,
    })  # fmt: skip
    of_p, of_s = given.quality(np.geomspace(1e4, 1e6, 100))
    assert np.abs(of_p / 50 - 1).max() < 0.05
    assert np.abs(of_s / 30 - 1).max() < 0.05


@pytest.mark.parametrize(("changes", "said"), [
    ({"Q_p": 100.0}, "at most"), ({"frequency_ratio": 0.5}, "greater than 1"), ({"Q_s": 1.0}, "greater than 3"),
])  # fmt: skip
def test_bad_solids_are_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(Exception, match=facts(said)):
        parse_case(plates({"materials.default": {**SLS, **changes}}))


def test_initial_stress_beyond_yield_is_refused() -> None:
    with pytest.raises(Exception, match=facts(r"initial_stress: .*sqrt\(J2\) = \S+ Pa .* \S+ Pa")):
        parse_case(plates({"plane": "strain", "materials.default": {**DP, "initial_stress": [0, 0, 0, 9e6, 0, 0]}}))


def test_components_of_a_plane() -> None:
    """Components that stay zero are not stored: plane strain needs three of a strain, and plane stress sigma_zz = 0."""
    given = StandardLinearSolids.model_validate({name: value for name, value in SLS.items() if name != "kind"})
    assert len(traced(given, "strain").state) == 3 * 4
    assert len(traced(given, "antiplane").state) == 2 * 4
    law = traced(given, "stress")
    assert "strain_zz" in law.state and OF_PLANE["stress"] == law.components


PRESTRESSED = [kind for kind in KINDS if "initial_stress" in alternatives("ruptfx.laws.materials")[kind].model_fields]


@pytest.mark.parametrize("kind", PRESTRESSED)
def test_an_initial_stress_acts_as_the_strain_that_makes_it(kind: str) -> None:
    """Stress S and energy W of strain e after the stress C:E; those of E + e are S + C:E and W + e:C:E + E:C:E / 2."""
    free = example(kind).model_copy(update={"initial_stress": [0.0] * 6})
    _, shear = free.lame("strain")
    along = Tensor(xx=1e-9, yy=-1e-9, xy=7e-10)
    unit = free.model_copy(update={"initial_stress": list((2 * shear * along).components)})
    part = unit.yielded()
    assert part is not None
    begun = (0.5 / float(part)) * along
    stressed = free.model_copy(update={"initial_stress": list((2 * shear * begun).components)})
    assert float(stressed.yielded()) == pytest.approx(0.5)
    states = [
        {name: Tensor() if field.tensor else field.start for name, field in each.state_fields().items()}
        for each in (free, stressed)
    ]
    step = 0.4 * begun + Tensor(xx=0.1 * begun.xx, zz=-0.05 * begun.xx)
    for number in range(1, 13):
        strain = number * step
        (whole, states[0]), (added, states[1]) = (
            each.stress(of, state, 0.3 * free.relaxation_time)
            for each, of, state in zip((free, stressed), (begun + strain, strain), states, strict=True)
        )
        given = 2 * shear * begun
        np.testing.assert_allclose((added + given).components, whole.components, rtol=0, atol=1e-11 * shear * begun.xx)
        energy = stressed.stored(strain, states[1]) + given.dot(strain) + 0.5 * given.dot(begun)
        assert free.stored(begun + strain, states[0]) == pytest.approx(energy, rel=1e-10)
    elastic = 2 * shear * (begun + strain).deviator()
    assert not np.allclose(whole.deviator().components, elastic.components, rtol=1e-3)  # it has yielded


def test_damage_is_zero_at_rest_and_grows() -> None:
    """1 - r_0 / r exp((r_0 - r) / (E e_s)): with a growth of r by 1, half of exp(-f_t / E / e_s) remains."""
    rock = ContinuumDamage(
        young_modulus=30e9, poisson_ratio=0.2, density=2500.0, strength=3e6, softening_strain=1e-3, relaxation_time=1e-6
    )
    damage = rock.recorded({"growth": np.array([0.0, 1.0])})["damage"]
    assert damage == pytest.approx([0.0, 1 - np.exp(-3e6 / 30e9 / 1e-3) / 2])
