"""Every operator agrees with the UFL form, on any number of ranks; the fused step equals the plain one."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.bent_meshes import twist

from ruptfx import RuptfxError
from ruptfx.bodies import operators
from ruptfx.bodies.meshes.rough_plates import RoughPlate
from ruptfx.bodies.operators import Bulk, FusedOperator
from ruptfx.bodies.operators.matrix_free import MatrixFree
from ruptfx.bodies.operators.ufl_form import UflForm
from ruptfx.bodies.space import numbering
from ruptfx.bodies.space.variation import Variation
from ruptfx.input.schema import kinds, own_module
from ruptfx.laws.materials import Material
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.laws.materials.orthotropic_elastic import OrthotropicElastic
from ruptfx.platform import fem

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

SOFT = IsotropicElastic(density=1.0, young_modulus=2.0, poisson_ratio=0.3)
STIFF = IsotropicElastic(density=1.0, young_modulus=5.0, poisson_ratio=0.2)
HARDENED = IsotropicElastic(density=1.0, poisson_ratio=0.2, young_modulus={
    "kind": "random", "mean": 5.0, "standard_deviation": 1.0, "correlation_length": 0.3, "seed": 2,
})  # fmt: skip


FIBRES = OrthotropicElastic(
    E_1=9.0, E_2=2.0, E_3=1.5, nu_12=0.3, nu_23=0.4, nu_13=0.25, G_12=0.8, G_13=0.7, G_23=0.5, angle=0.4,
    density={"kind": "random", "mean": 5.0, "standard_deviation": 1.0, "correlation_length": 0.3, "seed": 3},
)  # fmt: skip


class Crystal(Material):
    """A body without symmetry: 21 constants."""

    def energy_density(self, strain: Any, plane: Any) -> Any:
        root = np.random.default_rng(5).normal(size=(6, 6))
        stiffness = root @ root.T + 2 * np.eye(6)
        if plane == "antiplane":
            e, places = strain, [4, 3]
        else:
            pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
            places = list(range(6)) if plane == "solid" else [0, 1, 5]
            e = fem.ufl.as_vector([strain[i, j] * (1 if i == j else 2) for i, j in (pairs[k] for k in places)])
        return 0.5 * fem.ufl.inner(e, fem.ufl.as_matrix(stiffness[np.ix_(places, places)].tolist()) * e)


CRYSTAL = Crystal(density=1.0)


class Setting(NamedTuple):
    cell: str
    order: int
    plane: Any
    shape: str  # box, affine, bent, curved
    varies: bool = False  # moduli of one material, from point to point
    first: Material = SOFT  # of the first material, the second one is isotropic


# Pairs of element and order, of plane and geometry, of material and variation, each once; each distinct form costs a
# compilation, so not all combinations.
SETTINGS = [
    Setting("quadrilateral", 1, "stress", "box"),
    Setting("quadrilateral", 1, "strain", "bent"),
    Setting("quadrilateral", 2, "stress", "affine"),
    Setting("quadrilateral", 4, "stress", "box"),
    Setting("quadrilateral", 4, "stress", "affine"),
    Setting("quadrilateral", 4, "stress", "bent"),
    Setting("quadrilateral", 3, "antiplane", "bent"),
    Setting("quadrilateral", 8, "antiplane", "affine"),
    Setting("quadrilateral", 3, "stress", "curved"),
    Setting("quadrilateral", 1, "axisymmetric", "box"),
    Setting("quadrilateral", 4, "axisymmetric", "affine"),
    Setting("quadrilateral", 3, "axisymmetric", "bent"),
    Setting("triangle", 1, "axisymmetric", "box"),
    Setting("hexahedron", 1, "solid", "bent"),
    Setting("hexahedron", 2, "solid", "box"),
    Setting("hexahedron", 2, "solid", "affine"),
    Setting("hexahedron", 3, "solid", "bent"),
    Setting("hexahedron", 3, "solid", "curved"),
    Setting("triangle", 1, "strain", "bent"),
    Setting("triangle", 1, "antiplane", "bent"),
    Setting("tetrahedron", 1, "solid", "bent"),
    Setting("quadrilateral", 2, "strain", "box", True),
    Setting("quadrilateral", 3, "antiplane", "box", True),
    Setting("quadrilateral", 4, "strain", "bent", True),
    Setting("quadrilateral", 2, "stress", "curved", True),
    Setting("quadrilateral", 3, "axisymmetric", "bent", True),
    Setting("hexahedron", 1, "solid", "bent", True),
    Setting("triangle", 1, "strain", "bent", True),
    Setting("quadrilateral", 4, "strain", "box", first=FIBRES),
    Setting("quadrilateral", 3, "antiplane", "affine", first=FIBRES),
    Setting("quadrilateral", 3, "axisymmetric", "affine", first=FIBRES),
    Setting("quadrilateral", 2, "stress", "box", first=CRYSTAL),
    Setting("quadrilateral", 5, "strain", "affine", first=CRYSTAL),
    Setting("quadrilateral", 1, "strain", "bent", first=CRYSTAL),
    Setting("quadrilateral", 2, "strain", "curved", first=CRYSTAL),
    Setting("quadrilateral", 2, "antiplane", "bent", first=CRYSTAL),
    Setting("quadrilateral", 3, "axisymmetric", "bent", first=CRYSTAL),
    Setting("quadrilateral", 2, "axisymmetric", "curved", first=CRYSTAL),
    Setting("hexahedron", 2, "solid", "affine", first=CRYSTAL),
    Setting("triangle", 1, "strain", "bent", first=CRYSTAL),
    Setting("triangle", 1, "antiplane", "bent", first=CRYSTAL),
    Setting("tetrahedron", 1, "solid", "bent", first=CRYSTAL),
    Setting("quadrilateral", 2, "strain", "box", True, FIBRES),
    Setting("quadrilateral", 2, "antiplane", "affine", True, CRYSTAL),
    Setting("hexahedron", 1, "solid", "bent", True, CRYSTAL),
    Setting("triangle", 1, "stress", "bent", True, FIBRES),
]
# Uniform bodies whose volume is that of their quadrature: that of order 1 is not exact in twisted hexahedra.
STRAIGHT = [setting for setting in SETTINGS if setting.shape != "curved" and not setting.varies
            and (setting.cell, setting.order, setting.shape) != ("hexahedron", 1, "bent")]  # fmt: skip


def make_mesh(cell: str, shape: str) -> Any:
    """Two plates' worth of cells, sheared, bent at the corners, or with curved edges."""
    meshes = fem.dolfinx.mesh
    kind = getattr(meshes.CellType, cell)
    if shape == "curved":
        return curved_mesh(cell)
    if cell in ("quadrilateral", "triangle"):
        mesh = meshes.create_rectangle(fem.MPI.COMM_WORLD, [[0, 0], [1, 0.75]], [8, 6], kind)
    else:
        mesh = meshes.create_box(fem.MPI.COMM_WORLD, [[0, 0, 0], [1, 0.75, 0.5]], [4, 3, 2], kind)
    x = mesh.geometry.x
    if shape == "affine":
        x[:, 0] += 0.3 * x[:, 1] - 0.2 * x[:, 2]
    if shape == "bent":
        twist(x, mesh.geometry.dim)
    return mesh


def curved_mesh(cell: str) -> Any:
    """A strip of two quadrilaterals, or four hexahedra, with second-order geometry."""
    solid = {"width": 0.5} if cell == "hexahedron" else {}
    plate = RoughPlate(length=1.0, height=0.5, element_size=0.5, **solid)
    points, cells, _ = plate.build(2, 1, "plate")
    points += 0.05 * np.sin(4 * np.roll(points, 1, axis=1))
    comm = fem.MPI.COMM_WORLD
    if comm.rank:
        cells, points = cells[:0], points[:0]

    def partitioner(_: Any, parts: int, *__: Any) -> Any:
        owner = np.arange(len(cells), dtype=np.int32) % parts
        lists = fem.dolfinx.graph.adjacencylist(owner, np.arange(len(cells) + 1, dtype=np.int32))
        return getattr(lists, "_cpp_object", lists)

    return fem.create_mesh(comm, cells, points, cell, partitioner, order=2)


@cache
def make_bulk(setting: Setting) -> Bulk:
    mesh = make_mesh(setting.cell, setting.shape)
    if setting.plane == "axisymmetric" and setting.shape in ("bent", "curved"):
        mesh.geometry.x[:, 1] += 0.2  # the others reach the axis
    components = {"antiplane": 1, "solid": 3}.get(setting.plane, 2)
    space = fem.lagrange(mesh, setting.order, components)
    # By place, not by number: the same on any number of ranks.
    middle = mesh.geometry.x[fem.geometry_dofmap(mesh)].mean(axis=1)
    material = (np.sin(40 * middle.sum(axis=1)) > 0).astype(np.int32)
    if setting.varies:
        variation = Variation(space, ["soft", "stiff"], material, [setting.first, HARDENED], setting.plane)
        return Bulk(space, setting.plane, variation.references, material, variation=variation)
    return Bulk(space, setting.plane, [setting.first.with_values({"density": 1.0}), STIFF], material)


@cache
def make_operator(kind: str, setting: Setting) -> Any:
    try:
        return operators.create(kind, make_bulk(setting))
    except RuptfxError as refusal:
        pytest.skip(str(refusal))


@cache
def make_reference(setting: Setting) -> UflForm:
    return UflForm(make_bulk(setting))


def local_size(bulk: Bulk) -> int:
    index_map = bulk.space.dofmap.index_map
    return (index_map.size_local + index_map.num_ghosts) * bulk.space.dofmap.index_map_bs


def random_fields(bulk: Bulk, count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(7 + fem.MPI.COMM_WORLD.rank)
    return [rng.standard_normal(local_size(bulk)) for _ in range(count)]


def internal_force(operator: Any, displacement: np.ndarray) -> np.ndarray:
    force = np.zeros_like(displacement)
    operator.add_internal_force(displacement, force)
    return force


def nodal(bulk: Bulk, values: np.ndarray) -> np.ndarray:
    """Vector of local degrees of freedom from values at the nodes, shape (nodes, components)."""
    return np.ascontiguousarray(values[:, : bulk.space.dofmap.index_map_bs]).ravel()


def name(setting: Setting) -> str:
    return "-".join(part.kind() if isinstance(part, Material) else str(part) for part in setting)


fast = pytest.mark.parametrize("kind", [kind for kind in kinds("ruptfx.bodies.operators") if kind != "ufl_form"])
every = pytest.mark.parametrize("kind", kinds("ruptfx.bodies.operators"))


@every
def test_every_operator_takes_some_setting(kind: str) -> None:
    """The settings that it refuses are skipped below."""

    def takes(setting: Setting) -> bool:
        try:
            operators.create(kind, make_bulk(setting))
        except RuptfxError:
            return False
        return True

    assert any(takes(setting) for setting in SETTINGS)


@fast
@pytest.mark.parametrize("setting", SETTINGS, ids=name)
def test_agrees_with_the_form(kind: str, setting: Setting) -> None:
    bulk, operator = make_bulk(setting), make_operator(kind, setting)
    displacement = random_fields(bulk, 1)[0]
    expected = internal_force(make_reference(setting), displacement)
    found = internal_force(operator, displacement)
    scale = np.abs(expected).max(initial=0)
    assert np.abs(found - expected).max(initial=0) <= 1e-12 * scale


@pytest.mark.parametrize("setting", STRAIGHT, ids=name)
def test_energy_of_a_linear_field_is_exact(setting: Setting) -> None:
    """With u = A x the energy of the form, with which all others agree, sums W(A) times the volume over materials.

    W is zero for the antisymmetric part of A, a rotation.
    """
    bulk, operator = make_bulk(setting), make_reference(setting)
    gradient = np.array([[0.3, -0.2, 0.1], [0.5, 0.4, -0.3], [0.2, -0.1, 0.6]])
    dim = bulk.space.mesh.geometry.dim
    gradient[dim:, :], gradient[:, dim:] = 0, 0
    if setting.plane == "axisymmetric":
        gradient[1, 0] = 0  # else the strain around the axis is not constant
    x = bulk.space.tabulate_dof_coordinates()
    field = nodal(bulk, x @ gradient.T)
    strain = 0.5 * (gradient + gradient.T)
    if setting.plane == "axisymmetric":
        strain[2, 2] = gradient[1, 1]
    expected = 0.0
    for index, material in enumerate(bulk.materials):
        if not isinstance(material, IsotropicElastic):
            seen = gradient[0, :dim] if setting.plane == "antiplane" else strain[:dim, :dim]
            if setting.plane == "axisymmetric":
                seen = strain
            in_ufl = fem.ufl.as_tensor(seen.tolist())
            density = material.energy_density(in_ufl, "solid" if len(seen) == 3 else setting.plane)((0.0,) * dim)
        elif setting.plane == "antiplane":
            density = 0.5 * material.shear_modulus * gradient[0] @ gradient[0]
        else:
            lame = material.lame_lambda(bulk.plane)
            density = 0.5 * lame * np.trace(strain) ** 2 + material.shear_modulus * np.sum(strain**2)
        expected += density * volume(bulk, index)
    comm = bulk.space.mesh.comm
    energy = comm.allreduce(-0.5 * field @ internal_force(operator, field))
    assert energy == pytest.approx(expected, rel=1e-12)


def volume(bulk: Bulk, index: int) -> float:
    mesh = bulk.space.mesh
    tags = fem.dolfinx.mesh.meshtags(
        mesh, mesh.topology.dim, np.arange(len(bulk.cell_material), dtype=np.int32), bulk.cell_material
    )
    dx = fem.ufl.Measure("dx", domain=mesh, subdomain_data=tags)
    one = fem.dolfinx.fem.Constant(mesh, 1.0)
    if bulk.plane == "axisymmetric":  # about y = 0
        one = 2 * np.pi * fem.ufl.SpatialCoordinate(mesh)[1]
    return mesh.comm.allreduce(fem.dolfinx.fem.assemble_scalar(fem.form(one * dx(index))))


# -- the fused step ------------------------------------------------------------------------------------------------

FUSED = [setting for setting in SETTINGS if setting.order <= 4]
fused = pytest.mark.parametrize("kind", [
    kind for kind in kinds("ruptfx.bodies.operators")
    if any(hasattr(each, "prepare_step") for each in vars(own_module("ruptfx.bodies.operators", kind)).values())
])  # fmt: skip


@fused
@pytest.mark.parametrize("scattered, decay, move", [(False, 1.0, 0.0), (True, 0.9, 0.0), (True, 1.0, 0.03)],
                         ids=["edge held", "any held, damped", "moved before"])  # fmt: skip
@pytest.mark.parametrize("setting", FUSED, ids=name)
def test_fused_step_is_the_plain_step(
    kind: str, setting: Setting, scattered: bool, decay: float, move: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Several blocks and tiles even on these meshes: nodes move on between blocks.
    monkeypatch.setattr("ruptfx.bodies.operators.matrix_free.BLOCK_NODES", 32)
    for constant, value in {"BLOCK_NODES_3D": 32, "TILE_NODES": 32, "MOST_LANES": 1}.items():
        monkeypatch.setattr(numbering, constant, value)
    make_operator(kind, setting)  # skips what the operator refuses
    bulk = make_bulk(setting)
    operator = operators.create(kind, bulk)
    assert isinstance(operator, FusedOperator)
    components, dt = bulk.space.dofmap.index_map_bs, 0.1
    displacement, velocity, draw = random_fields(bulk, 3)
    draw = draw.reshape(-1, components)[:, 0]
    inverse_mass = np.exp(draw)
    held = draw > 1 if scattered else bulk.space.tabulate_dof_coordinates()[:, 1] < 0.01
    operator.prepare_step(held, moves=move > 0)
    still = np.repeat(held | shared_nodes(bulk), components)
    moved = np.where(still, displacement, displacement + move * velocity)
    expected_force = internal_force(operator, moved)
    expected_velocity = np.where(
        still, velocity, decay * velocity + dt * np.repeat(inverse_mass, components) * expected_force
    )
    expected_displacement = np.where(still, moved, moved + dt * expected_velocity)
    expected_force[~still] = 0
    mean = 0.5 * (velocity + expected_velocity)
    expected_loss = np.sum(mean[~still] ** 2 / np.repeat(inverse_mass, components)[~still]) if decay < 1 else 0.0
    force = np.zeros_like(displacement)
    loss = operator.step(displacement, velocity, force, inverse_mass, dt, decay, move=move)
    assert loss == pytest.approx(expected_loss, rel=1e-13)
    for found, expected in (
        (force, expected_force), (velocity, expected_velocity), (displacement, expected_displacement),
    ):  # fmt: skip
        assert np.abs(found - expected).max(initial=0) <= 1e-14 * max(1, np.abs(expected).max(initial=0))


@pytest.mark.parametrize("elements", [(6, 5, 4), (12, 9, 1)], ids=["box", "one layer"])
def test_elements_follow_one_another_tile_by_tile(
    elements: tuple[int, int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numbering, "TILE_NODES", 200)
    meshes = fem.dolfinx.mesh
    corners = [[0.0, 0.0, 0.0], [0.1 * count for count in elements]]
    mesh = meshes.create_box(fem.MPI.COMM_WORLD, corners, list(elements), meshes.CellType.hexahedron)
    space = fem.lagrange(mesh, 2, 3)
    bulk = Bulk(space, "solid", [SOFT], np.zeros(len(space.dofmap.list), dtype=np.int32))
    operator = MatrixFree(bulk)
    owned = mesh.topology.index_map(3).size_local
    tile = numbering.tiles(space)
    order = operator.batches.ravel()
    assert sorted(np.unique(order)) == list(range(owned))
    if mesh.comm.size == 1:
        assert np.all(np.diff(tile[order]) >= 0)
        sizes = [len(np.unique(space.dofmap.list[:owned][tile == number])) for number in np.unique(tile)]
        assert len(sizes) > 4 and max(sizes) < 4 * 200
    expected = internal_force(UflForm(bulk), displacement := random_fields(bulk, 1)[0])
    found = internal_force(operator, displacement)
    assert np.abs(found - expected).max(initial=0) <= 1e-12 * np.abs(expected).max(initial=0)


@pytest.mark.parametrize("real", [np.float64, np.float32], ids=["double", "single"])
def test_nodes_that_a_block_completes_are_one_range(real: type, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numbering, "TILE_NODES", 500)
    monkeypatch.setattr(numbering, "BLOCK_NODES_3D", 128)
    meshes = fem.dolfinx.mesh
    mesh = meshes.create_box(fem.MPI.COMM_WORLD, [[0, 0, 0], [1, 1, 1]], [7, 6, 8], meshes.CellType.hexahedron)
    plain = fem.lagrange(mesh, 2, 3)
    space = numbering.in_sweep_order(plain)
    index_map, shared = space.dofmap.index_map, numbering.shared_nodes(space.dofmap.index_map)
    assert index_map.size_global == 15 * 13 * 17
    assert index_map.local_range == plain.dofmap.index_map.local_range
    operator = MatrixFree(Bulk(space, "solid", [SOFT], np.zeros(len(space.dofmap.list), np.int32), real=np.dtype(real)))
    size = numbering.batches_of_block(128, 27, operator.batches.shape[1]) * operator.batches.shape[1]
    assert size == 16
    groups = [group for group in numbering.sweep_order(space, shared) if len(group)]
    blocks = [group[at : at + size] for group in groups for at in range(0, len(group), size)]
    assert len(blocks) >= mesh.topology.index_map(3).size_local // 16
    done_in = np.full(len(shared), -1)
    for number, block in enumerate(blocks):
        done_in[space.dofmap.list[block].ravel()] = number
    done_in[shared] = -1
    assert np.all(np.diff(done_in[: index_map.size_local]) >= 0)
    # The nodes stay where they are: those of a cell, and those of other ranks.
    was, now = (each.tabulate_dof_coordinates() for each in (plain, space))
    np.testing.assert_array_equal(now[space.dofmap.list], was[plain.dofmap.list])
    owner = fem.dolfinx.fem.Function(space)
    owner.x.array[:] = now.ravel()
    owner.x.array[3 * index_map.size_local :] = np.nan
    owner.x.scatter_forward()
    np.testing.assert_allclose(owner.x.array, now.ravel(), rtol=0, atol=1e-15)


def shared_nodes(bulk: Bulk) -> np.ndarray:
    index_map = bulk.space.dofmap.index_map
    flag = fem.dolfinx.la.vector(index_map, 1)
    flag.array[:] = np.arange(len(flag.array)) >= index_map.size_local
    flag.scatter_reverse(fem.dolfinx.la.InsertMode.add)
    flag.scatter_forward()
    return flag.array > 0


@fused
def test_shared_forces_are_ready_before_the_interior(kind: str) -> None:
    """What travels while the interior is computed is complete after the step of the boundary, then untouched."""
    setting = SETTINGS[3]
    bulk, operator = make_bulk(setting), make_operator(kind, setting)
    displacement, velocity = random_fields(bulk, 2)
    shared = np.repeat(shared_nodes(bulk), 2)
    expected = internal_force(operator, displacement)[shared]
    operator.prepare_step(np.zeros(local_size(bulk) // 2, dtype=bool))
    force, inverse_mass = np.zeros_like(displacement), np.ones(local_size(bulk) // 2)
    operator.step(displacement, velocity, force, inverse_mass, 0.1, part="boundary")
    np.testing.assert_allclose(force[shared], expected, rtol=0, atol=1e-13 * np.abs(expected).max(initial=1))
    force[shared] = np.nan
    operator.step(displacement, velocity, force, inverse_mass, 0.1, part="interior")
    assert np.isnan(force[shared]).all() and np.isfinite(displacement).all()


@fused
def test_no_allocation_per_step(kind: str) -> None:
    bulk, operator = make_bulk(SETTINGS[4]), make_operator(kind, SETTINGS[4])
    displacement, velocity = random_fields(bulk, 2)
    force, inverse_mass = np.zeros_like(displacement), np.ones(len(displacement) // 2)
    operator.prepare_step(np.zeros(len(inverse_mass), dtype=bool))

    def steps() -> None:
        for _ in range(20):
            operator.step(displacement, velocity, force, inverse_mass, 1e-3)
            operator.add_internal_force(displacement, force)

    steps()
    tracemalloc.start()
    steps()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # Small Python objects of the call come and go, some 4 kB; one vector of this mesh takes more than 12 kB.
    assert displacement.nbytes > 12000 and peak < 6000


@fused
@pytest.mark.parametrize("real", [np.float64, np.float32], ids=["double", "single"])
def test_subnormal_numbers_count_as_zero_in_steps_only(kind: str, real: type) -> None:
    """Processors compute with them many times more slowly; ahead of waves all numbers are subnormal for a while."""
    bulk = replace(make_bulk(SETTINGS[3]), real=np.dtype(real))
    operator = operators.create(kind, bulk)
    nodes = local_size(bulk) // 2
    operator.prepare_step(np.zeros(nodes, dtype=bool))
    displacement, force = np.zeros(2 * nodes), np.zeros(2 * nodes, dtype=real)
    velocity = np.full(2 * nodes, np.finfo(real).tiny / 4, dtype=real)
    operator.step(displacement, velocity, force, np.ones(nodes, dtype=real), 0.1)
    own = ~np.repeat(shared_nodes(bulk), 2)
    assert not velocity[own].any() and not displacement[own].any()
    assert np.finfo(real).tiny * real(0.25) > 0  # arithmetic after the step is as before it


@fast
def test_not_a_number_stays_one(kind: str) -> None:
    bulk, operator = make_bulk(SETTINGS[3]), make_operator(kind, SETTINGS[3])
    displacement = random_fields(bulk, 1)[0]
    displacement[bulk.space.dofmap.list[0, 0] * 2] = np.nan
    assert np.isnan(internal_force(operator, displacement)).any()


def test_other_materials_are_refused_with_the_remedy() -> None:
    class Other(Material):
        pass

    bulk = make_bulk(SETTINGS[0])
    other = Bulk(bulk.space, bulk.plane, [Other(density=1.0)], bulk.cell_material)
    with pytest.raises(RuptfxError, match="operator = 'ufl_form'"):
        operators.create("matrix_free", other)
