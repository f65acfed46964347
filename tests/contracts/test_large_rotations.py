"""Bodies that turn by any angle: every operator that can agrees with the form; rotations cost no energy."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.crack_cases import NEVER, WEAK, case
from helpers.small_cases import plates

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.bodies import operators
from ruptfx.bodies.operators import Bulk, EnergyOperator, Operator
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError, kinds
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.platform import fem
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

MATERIALS = [
    IsotropicElastic(density=1.0, young_modulus=2.0, poisson_ratio=0.3),
    IsotropicElastic(density=1.0, young_modulus=5.0, poisson_ratio=0.2),
]


@cache
def bulk(cell: str = "triangle") -> Bulk:
    meshes = fem.dolfinx.mesh
    mesh = meshes.create_rectangle(fem.MPI.COMM_WORLD, [[0, 0], [1, 0.75]], [5, 4], getattr(meshes.CellType, cell))
    x = mesh.geometry.x
    x[:, 0] += 0.05 * np.sin(5 * x[:, 1])
    middle = x[fem.geometry_dofmap(mesh)].mean(axis=1)
    material = (np.sin(40 * middle.sum(axis=1)) > 0).astype(np.int32)
    return Bulk(fem.lagrange(mesh, 1, 2), "strain", MATERIALS, material, large_rotations=True)


@cache
def operator(kind: str, cell: str = "triangle") -> Any:
    try:
        return operators.create(kind, bulk(cell))
    except RuptfxError as refusal:
        assert re.search(r"large.rotations", str(refusal)) and "operator = " in str(refusal)
        pytest.skip("refuses large rotations")


def force(operator: Any, displacement: np.ndarray) -> np.ndarray:
    found = np.zeros_like(displacement)
    operator.add_internal_force(displacement, found)
    return found


def turned(given: Bulk, angle: float, strain: float) -> np.ndarray:
    """Displacement of a rotation after a random motion of that size."""
    x = given.space.tabulate_dof_coordinates()[:, :2]
    moved = x + strain * np.sin(7 * x[:, ::-1] + 3 * x)
    c, s = np.cos(angle), np.sin(angle)
    return np.ascontiguousarray(moved @ np.array([[c, s], [-s, c]]) - x).ravel()


every = pytest.mark.parametrize("kind", kinds("ruptfx.bodies.operators"))
ANGLES = [0.0, 0.4, -1.5, 1.6, 3.0, -3.1]


@every
@pytest.mark.parametrize("angle", ANGLES)
def test_force_and_energy_are_those_of_the_form(kind: str, angle: float) -> None:
    given, reference = operator(kind), operator("ufl_form")
    displacement = turned(bulk(), angle, 0.02)
    expected = force(reference, displacement)
    assert np.abs(force(given, displacement) - expected).max(initial=0) <= 2e-12 * np.abs(expected).max(initial=0)
    assert isinstance(given, EnergyOperator)
    assert given.energy(displacement) == pytest.approx(reference.energy(displacement), rel=1e-12)


def test_energy_is_that_of_the_singular_values() -> None:
    """W = lambda/2 (s_1 + s_2 - 2)^2 + G ((s_1 - 1)^2 + (s_2 - 1)^2), with the stretches s of F = 1 + grad u."""
    given = bulk()
    gradient = np.array([[-1.6, -0.9], [0.7, -1.5]])
    x = given.space.tabulate_dof_coordinates()[:, :2]
    found = operator("ufl_form").energy(np.ascontiguousarray(x @ gradient.T).ravel())
    stretch = np.linalg.svd(np.eye(2) + gradient)[1] - 1
    assert np.linalg.det(np.eye(2) + gradient) > 0
    expected = 0.0
    for index, material in enumerate(MATERIALS):
        first, shear = material.lame("strain")
        one = fem.dolfinx.fem.Constant(given.space.mesh, 1.0)
        area = fem.dolfinx.fem.assemble_scalar(fem.form(one * operators.ufl_form.measure(given)(index)))
        expected += area * (0.5 * first * stretch.sum() ** 2 + shear * np.sum(stretch**2))
    assert found == pytest.approx(expected, rel=1e-12)


@every
@pytest.mark.parametrize("angle", ANGLES)
def test_a_rotation_gives_no_force(kind: str, angle: float) -> None:
    given = operator(kind)
    scale = np.abs(force(given, turned(bulk(), 0.0, 0.02))).max(initial=0)
    assert np.abs(force(given, turned(bulk(), angle, 0.0))).max(initial=0) <= 1e-12 * scale
    assert given.energy(turned(bulk(), angle, 0.0)) <= 1e-24


@every
def test_force_is_the_derivative_of_the_energy(kind: str) -> None:
    given, displacement = operator(kind), turned(bulk(), 2.0, 0.02)
    way = np.random.default_rng(fem.MPI.COMM_WORLD.rank).normal(size=len(displacement))
    rise = [given.energy(displacement + step * way) for step in (2e-4, 1e-4, -1e-4, -2e-4)]
    slope = (8 * (rise[1] - rise[2]) - (rise[0] - rise[3])) / 12e-4
    assert slope == pytest.approx(-force(given, displacement) @ way, rel=1e-8)


@every
def test_small_motion_obeys_hooke(kind: str) -> None:
    """The difference falls with the square of the motion."""
    given, linear = operator(kind), operators.create(kind, replace(bulk(), large_rotations=False))
    for size in (1e-3, 1e-6):
        displacement = turned(bulk(), size, size)
        expected = force(linear, displacement)
        away = np.abs(force(given, displacement) - expected).max(initial=0)
        assert away <= 30 * size * np.abs(expected).max(initial=0)


def viscous(operator: Any, displacement: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    found = np.zeros_like(displacement)
    operator.add_viscous_force(displacement, velocity, found)
    return found


@pytest.mark.parametrize("angle", ANGLES)
def test_viscous_force_is_that_of_the_form_and_turns_with_the_bodies(angle: float) -> None:
    """R f(u, v) at the motion turned by R, whatever the spin; its power takes energy; K v where nothing has moved."""
    given, reference = operator("matrix_free"), operator("ufl_form")
    x, c, s = bulk().space.tabulate_dof_coordinates()[:, :2], np.cos(angle), np.sin(angle)
    R, spin = np.array([[c, -s], [s, c]]), np.array([[0.0, -3.0], [3.0, 0.0]])
    displacement, still = turned(bulk(), angle, 0.02), turned(bulk(), 0.0, 0.02)
    velocity = np.sin(5 * x + 2 * x[:, ::-1])
    flying = velocity @ R.T + (x + displacement.reshape(-1, 2)) @ spin.T + [7.0, -4.0]
    found = viscous(given, displacement, flying.ravel())
    expected = viscous(reference, still, velocity.ravel()).reshape(-1, 2) @ R.T
    scale = np.abs(expected).max(initial=0)
    assert np.abs(found - expected.ravel()).max(initial=0) <= 2e-12 * scale
    assert np.abs(found - viscous(reference, displacement, flying.ravel())).max(initial=0) <= 2e-12 * scale
    power = fem.MPI.COMM_WORLD.allreduce(float(found @ flying.ravel()))
    assert power < -1.0
    linear = operators.create("ufl_form", replace(bulk(), large_rotations=False))
    at_rest = viscous(given, 0 * displacement, velocity.ravel())
    assert np.abs(at_rest - force(linear, velocity.ravel())).max(initial=0) <= 2e-12 * scale


def test_an_operator_without_energy_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """For small rotations the force is enough."""

    class Force(Operator):
        def __init__(self, bulk: Bulk) -> None:
            pass

    monkeypatch.setattr("ruptfx.bodies.operators.ufl_form.UflForm", Force)
    with pytest.raises(CaseError, match=facts("operator = 'ufl_form': .*large_rotations needs; use 'matrix_free'")):
        operators.create("ufl_form", bulk())
    operators.create("ufl_form", replace(bulk(), large_rotations=False))


def test_quadrilaterals_take_the_form() -> None:
    with pytest.raises(RuptfxError, match=facts(r"matrix_free .*quadrilateral.*ufl_form")):
        operators.create("matrix_free", bulk("quadrilateral"))
    assert force(operator("ufl_form", "quadrilateral"), turned(bulk("quadrilateral"), 2.0, 0.0)).max() < 1e-12


# -- facets that may break -------------------------------------------------------------------------------------------


class Pieces:
    """A block whose cells have moved apart at random and broken, then turned by an angle as a whole."""

    def __init__(self, angle: float) -> None:
        self.model = Model(case({"large_rotations": True, "fracture.default.cohesion": WEAK, "boundaries": []}))
        self.state, self.cracks = self.model.initial_state(), self.model.cracks
        x, c, s = self.model.coordinates[:, :2], np.cos(angle), np.sin(angle)
        self.turn = np.array([[c, -s], [s, c]])
        assert self.cracks is not None
        size = WEAK["G_Ic"] / WEAK["f_t"]
        # The same for a corner on any rank, and by the same steps at any angle.
        apart = size * np.sin(1e6 * x @ [[1.0, 3.0], [2.0, -1.0]] + self._of_cells() @ [[7.0, 5.0]])
        for part in (0.3, -0.2, 1.0):
            self.state.displacement[:] = ((x + part * apart) @ self.turn.T - x).ravel()
            self.state.force[:] = 0
            self.cracks(self.state, self.model.mass, 1e-6)
        self.x = x + self.state.displacement.reshape(-1, 2)

    def _of_cells(self) -> np.ndarray:
        number = np.asarray(self.model.mesh.topology.original_cell_index)
        cells = self.model.space.dofmap.list
        of_node = np.zeros((self.model.nodes, 1))
        of_node[cells] = number[: len(cells), None, None]
        return of_node

    @property
    def force(self) -> np.ndarray:
        return self.state.force.reshape(-1, 2)


def test_facets_turn_with_their_cells() -> None:
    """Tractions and states are those of the block that was not turned, forces are turned, their moment is nothing."""
    still, turned = Pieces(0.0), Pieces(2.2)
    assert (still.state.cracks["damage"] > 0).sum() > 20 and (still.state.cracks["damage"] >= 1).any()
    for name, values in still.state.cracks.items():
        scale = np.abs(values[np.isfinite(values)]).max(initial=0)
        np.testing.assert_allclose(turned.state.cracks[name], values, rtol=1e-6, atol=1e-7 * scale, err_msg=name)
    scale = np.abs(still.force).max(initial=0)
    np.testing.assert_allclose(turned.force, still.force @ turned.turn.T, atol=1e-7 * scale)
    comm = still.model.comm
    for each in (still, turned):
        total = comm.allreduce(each.force.sum(axis=0))
        moment = comm.allreduce(np.sum(each.x[:, 0] * each.force[:, 1] - each.x[:, 1] * each.force[:, 0]))
        assert np.abs(total).max() <= 1e-12 * scale and abs(moment) <= 1e-12 * scale * 0.01 * each.model.nodes


@pytest.mark.parametrize("angle", [0.0, 2.2])
def test_forces_of_facets_are_those_of_arrays(angle: float) -> None:
    """And what tractions do over a small motion is what these forces do."""
    pieces = Pieces(angle)
    again, cracks, state = np.zeros_like(pieces.state.force), pieces.cracks, pieces.state
    cracks.add_force(state.cracks, again, state.displacement)
    scale = np.abs(again).max(initial=0)
    np.testing.assert_allclose(state.force, again, atol=1e-12 * scale)
    way = 1e-9 * np.sin(1e7 * pieces.x).ravel()
    work, none = (cracks.stored(state.cracks, part * way, state.displacement) for part in (1, 0))
    found = pieces.model.comm.allreduce(np.array([work - none, -again @ way]))
    assert found[0] == pytest.approx(found[1], rel=1e-9)


def damped_bar(spin: float) -> tuple[float, float, float]:
    """Return the parts of the longitudinal vibration of a spinning bar that damping takes by two times, and the angle.

    The energy budget closes.
    """
    model = Model(parse_case({
        "plane": "strain", "order": 1, "duration": 2e-5, "large_rotations": True,
        "mesh": {"kind": "pieces", "element_size": 1e-3, "bodies": {
            "bar": {"kind": "rectangle", "center": [0.0, 0.0], "width": 8e-3, "height": 1e-3},
        }},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 50e9, "poisson_ratio": 0.25,
                                  "density": 2600.0}},
        "fracture": {"kind": "intrinsic", "default": {"cohesion": NEVER, "friction": {"kind": "coulomb", "mu_d": 0.3}}},
        "collisions": {"kind": "potential"}, "damping": {"kelvin_voigt": {"eta": 4e-8}},
    }))  # fmt: skip
    motion, state, x = model.case.stepper.bind(model), model.initial_state(), model.coordinates[:, :2]
    wave = 20.0 * np.sin(np.pi * x[:, 0] / 8e-3)
    state.velocity[:] = (spin * np.stack([-x[:, 1], x[:, 0]], axis=1) + np.stack([wave, 0 * wave], axis=1)).ravel()
    state.energy["boundary_work"] = 0.5 * model.layout.owned_dot(state.velocity, model.mass * state.velocity)
    vibration = 0.5 * float(model.mass.reshape(-1, 2)[: model.owned_nodes, 0] @ wave[: model.owned_nodes] ** 2)
    lost = []
    for until in (1e-5, 2e-5):
        while state.time < until:
            motion.step(state)
        lost.append(state.energy["damping"])
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    total = model.comm.allreduce(np.array([work - sum(energy.values()), work, vibration, *lost]))
    assert abs(total[0]) <= 1e-12 * total[1]
    return total[3] / total[2], total[4] / total[2], spin * state.time


@pytest.mark.slow
def test_viscosity_damps_a_spinning_bar_as_one_at_rest() -> None:
    """But for the stretch of the spin, (spin / frequency)^2 = 3e-4, over the strain of the vibration, 5e-3."""
    still, spinning = damped_bar(0.0), damped_bar(3e4)
    assert spinning[2] == pytest.approx(0.6, rel=1e-2) and 0.5 < still[0] < still[1] < 0.9
    assert spinning[:2] == pytest.approx(still[:2], rel=0.02)


def test_flying_bodies_begin_with_their_energy() -> None:
    given = case({"boundaries": [], "mesh.divide": 5e-3, "initial_velocity": {"upper": [3.0, -4.0]},
                  "fracture.default.cohesion": NEVER, "duration": 1e-6, "large_rotations": True})  # fmt: skip
    model = Model(given)
    state = model.initial_state()
    energy = model.energies(state)
    assert energy["kinetic"] == pytest.approx(0.5 * 2600 * 8e-3 * 5e-3 * 25, rel=1e-12)
    assert energy["boundary_work"] == energy["kinetic"]
    with pytest.raises(CaseError, match=facts(r"initial_velocity\.uper: no such body")):
        Model(case({"mesh.divide": 5e-3, "boundaries": [], "initial_velocity": {"uper": [3.0, -4.0]}})).initial_state()


@pytest.mark.parametrize("breaks", [False, True])
def test_what_finite_steps_take_closes_the_budget(breaks: bool) -> None:
    """It falls with the square of the step while nothing breaks, watched or not, with a driven edge as well."""
    taken = []
    for safety in (0.8, 0.4):
        model = Model(case({
            "large_rotations": True, "duration": 4e-6, "stepper": {"kind": "leapfrog", "safety": safety},
            "initial_velocity": {} if breaks else {"rock": [0.0, 40.0]}, "damping": {"mass": 1e4},
            "fracture.default.cohesion": WEAK if breaks else NEVER,
            "boundaries": [
                {"kind": "driven", "edge": "rock.top", "component": "x", "velocity": 60.0, "ramp": 2e-6},
                {"kind": "driven", "edge": "rock.bottom", "component": "y", "velocity": 0.0},
            ],
        }))  # fmt: skip
        motion, state, largest = model.case.stepper.bind(model), model.initial_state(), 0.0
        while state.time < model.case.duration:
            state.wants_energies = state.step % 2 == 0
            motion.step(state)
            energy = motion.energies(state)
            work = energy.pop("boundary_work")
            assert abs(work - sum(energy.values())) <= 1e-12 * max(work, 1e-3)
            largest = max(largest, abs(energy["rotation_error"]))
        failed = model.comm.allreduce(int(np.isfinite(state.cracks["time_of_failure"]).sum()))
        assert bool(failed) == breaks
        taken.append(largest / work)
    assert 0 < taken[0] < 1e-3 and (breaks or taken[1] == pytest.approx(0.25 * taken[0], rel=0.1))


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"plane": "antiplane", "boundaries": []}, "large_rotations, plane = 'antiplane'"),
        ({"stepper": {"kind": "generalized_alpha", "time_step": 1e-8}}, "large_rotations: stepper.kind"),
    ],
)
def test_what_cannot_turn_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        case({"large_rotations": True, **changes})
    with pytest.raises(CaseError, match=facts(r"large_rotations: faults\.main keeps the direction")):
        parse_case(plates({"large_rotations": True}))
    with pytest.raises(
        CaseError, match=facts(r"initial_velocity.upper: .*'quasi_static' begin at rest; use 'leapfrog'")
    ):
        parse_case(plates({"initial_velocity": {"upper": [1.0, 0.0]}, "stepper": {"kind": "quasi_static"}}))
    with pytest.raises(CaseError, match=facts(r"initial_velocity.upper = .*moves in x, y; give 2 components")):
        parse_case(plates({"initial_velocity": {"upper": [1.0]}}))
