"""Materials with memory in implicit steps: paths of a block in closed form, Newton's iteration, explicit steps."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, HOMALITE, Given, plates, unstressed
from helpers.whole_runs import whole_and_resumed
from scipy.integrate import cumulative_simpson, trapezoid

pytest.importorskip("dolfinx")

from ruptfx.bodies.meshes import RawMesh
from ruptfx.case import Case, parse_case
from ruptfx.case.support import UnsupportedError
from ruptfx.platform import fem, parallel
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.recording.sampling import Samples
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.implicit.solution import Solution
from ruptfx.stepping.steppers.hybrid import HybridMotion

pytestmark = [pytest.mark.fem, pytest.mark.mpi]
COMM = fem.MPI.COMM_WORLD

SIDE = 2e-3
BULK, SHEAR = 5.3e9 / (3 * (1 - 0.7)), 5.3e9 / (2 * 1.35)
PRESSURE = 6e6
METAL = {**HOMALITE, "kind": "von_mises", "yield_stress": 2e7, "hardening": 8e8, "relaxation_time": 1e-15}
KINEMATIC = {**METAL, "hardening": 3e8, "kinematic_hardening": 5e8}
ROCK = {
    **HOMALITE, "kind": "drucker_prager", "cohesion": 1e6, "friction_angle": 0.5, "relaxation_time": 1e-15,
    "initial_stress": [-PRESSURE] * 3 + [0.0] * 3,
}  # fmt: skip
TIME = 1e-3  # s, scale of relaxation
FLUID = {**HOMALITE, "kind": "maxwell", "relaxation_time": TIME}
POLYMER = {**HOMALITE, "kind": "prony", "times": [TIME, 20 * TIME], "shear_moduli": [3e8, 5e8]}
SOLID = {**HOMALITE, "kind": "standard_linear_solids", "Q_p": 30.0, "Q_s": 20.0, "lowest_frequency": 1 / TIME,
         "frequency_ratio": 10.0}  # fmt: skip
FIXED = [{"kind": "driven", "edge": "rock.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
SIDES = [{"kind": "driven", "edge": f"rock.{side}", "component": "x", "velocity": 0.0} for side in ("left", "right")]
TIED = [{"kind": "periodic", "first": "rock.left", "second": "rock.right"}]


def block(cells: int) -> Given:
    """A square of square elements."""
    x, y = np.meshgrid(np.linspace(0, SIDE, cells + 1), np.linspace(0, SIDE, cells + 1))
    number = np.arange(x.size).reshape(x.shape)
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]]
    sides = {"bottom": number[0], "top": number[-1], "left": number[:, 0], "right": number[:, -1]}
    return Given(RawMesh(
        "quadrilateral", np.stack([x.ravel(), y.ravel()], axis=1), np.stack(corners, axis=-1).reshape(-1, 4),
        bodies=["rock"], cell_body=np.zeros(cells**2, int), interfaces={},
        edges={f"rock.{name}": np.stack([row[:-1], row[1:]], axis=1) for name, row in sides.items()},
    ))  # fmt: skip


def moved(component: str, times: np.ndarray, strain: np.ndarray) -> dict[str, Any]:
    """The top of the block follows a path of strain."""
    return {"kind": "moved", "edge": "rock.top", "component": component, "quantity": "displacement",
            "times": times.tolist(), "values": (SIDE * strain).tolist()}  # fmt: skip


def path(
    material: dict[str, Any], plane: str, boundaries: list[dict[str, Any]], times: np.ndarray, component: str
) -> tuple[np.ndarray, list[Solution], dict[str, float]]:
    """Return the mean traction on the top after every step [Pa], the solutions, and the energies at the end."""
    case = Case.model_validate({
        "plane": plane, "order": 2, "duration": float(times[-1]), "mesh": block(2), "boundaries": boundaries,
        "materials": {"default": material}, "output": {"figures": False}, "stepper": {"kind": "quasi_static"},
    })  # fmt: skip
    model = Model(case, COMM)
    motion, state = case.stepper.bind(model), model.initial_state()
    top = np.isclose(model.coordinates[: model.owned_nodes, 1], SIDE)
    tractions, solutions = [], []
    for dt in np.diff(times):
        solution = motion.equilibrium.solve(state, dt)
        solutions.append(solution)
        motion.take(state, solution)
        force = motion.equilibrium.forces.internal(state).reshape(model.nodes, -1)[: model.owned_nodes][top]
        column = 0 if plane == "antiplane" else "xy".index(component)
        tractions.append(parallel.total(COMM, float(force[:, column].sum())) / SIDE)
    return np.array(tractions), solutions, motion.energies(state)


def assert_closed(energies: dict[str, float]) -> None:
    work = energies["boundary_work"]
    assert abs(2 * work - sum(energies.values())) < 1e-10 * abs(work)


@pytest.mark.parametrize("material", [METAL, KINEMATIC])
def test_uniaxial_strain_of_a_metal(material: dict[str, Any]) -> None:
    """Uniaxial strain beyond yield: q = 2 G (e - 3/2 e_p) = Y + H e_p, and the axial stress is K e + 2 q / 3."""
    times, strain = np.linspace(0, 1, 21), -np.linspace(0, 0.03, 21)
    found, solutions, energies = path(material, "strain", [*FIXED[1:], *SIDES, moved("y", times, strain)], times, "y")
    e = np.abs(strain[1:])
    plastic = np.maximum((2 * SHEAR * e - 2e7) / (3 * SHEAR + 8e8), 0.0)
    assert plastic[0] == 0 < plastic[5]
    np.testing.assert_allclose(found, -(BULK * e + 2 / 3 * (2 * SHEAR * e - 3 * SHEAR * plastic)), rtol=1e-8)
    assert max(solution.iterations for solution in solutions) <= 4
    assert_closed(energies)
    # The mean stress of steps underestimates the work of the one that begins to yield.
    dissipated = (2e7 * plastic[-1] + 0.5 * material["hardening"] * plastic[-1] ** 2) * SIDE**2
    assert energies["material_dissipation"] == pytest.approx(dissipated, rel=0.02)


def test_uniaxial_strain_of_rock() -> None:
    """Uniaxial extension of rock under pressure: the axial stress beyond yield is K e + 2 / sqrt(3) Y(sigma_m)."""
    times, strain = np.linspace(0, 1, 21), np.linspace(0, 1.2e-3, 21)
    found, solutions, energies = path(ROCK, "strain", [*FIXED[1:], *SIDES, moved("y", times, strain)], times, "y")
    volume = BULK * strain[1:]
    limit = 1e6 * np.cos(0.5) - (volume - PRESSURE) * np.sin(0.5)
    beyond = 2 / np.sqrt(3) * SHEAR * strain[1:] > limit  # sqrt(J2) of the elastic stress
    assert 5 < beyond.sum() < 15
    elastic = (BULK + 4 / 3 * SHEAR) * strain[1:]
    np.testing.assert_allclose(found, np.where(beyond, volume + 2 / np.sqrt(3) * limit, elastic), rtol=1e-8)
    # Whether a point passes the corner of its law once more, which takes an iteration, depends on rounding.
    assert max(solution.iterations for solution in solutions) <= 6
    assert all(solution.residuals[-1] < 1e-5 * solution.residuals[-2] for solution in solutions)
    assert_closed(energies)


@pytest.mark.slow
def test_sheared_block_beyond_yield() -> None:
    """Uniform shear loaded, unloaded and loaded the other way: linear kinematic hardening in closed form."""
    amplitude = np.concatenate([np.linspace(0, 0.05, 11), np.linspace(0.05, -0.05, 21)[1:]])
    times = np.linspace(0, 1, len(amplitude))
    material = {**METAL, "hardening": 0.0, "kinematic_hardening": 8e8}
    top = {"kind": "driven", "edge": "rock.top", "component": "y", "velocity": 0.0}
    boundaries = [*FIXED, *TIED, top, moved("x", times, amplitude)]
    found, _, energies = path(material, "strain", boundaries, times, "x")
    expected, plastic = [], 0.0  # shear: tau = G (gamma - gamma_p), |tau - H / 3 gamma_p| <= Y / sqrt(3)
    for gamma in amplitude[1:]:
        over = SHEAR * (gamma - plastic) - 8e8 / 3 * plastic
        plastic += np.sign(over) * max(abs(over) - 2e7 / np.sqrt(3), 0.0) / (SHEAR + 8e8 / 3)
        expected.append(SHEAR * (gamma - plastic))
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * 2e7)
    assert_closed(energies)


def remaining(material: dict[str, Any], t: np.ndarray) -> np.ndarray:
    """Shear stress over the elastic one at a time after a sudden shear strain."""
    case = Case.model_validate(
        {"plane": "strain", "duration": 1.0, "mesh": block(1), "materials": {"default": material}}
    )
    given: Any = case.materials["default"]
    return 1 - sum(y * -np.expm1(-r * t) for y, r in zip(given.coefficients[1], given.rates, strict=True))


@pytest.mark.parametrize("material, plane", [
    pytest.param(material, plane, id=f"{material['kind']}-{plane}", marks=() if plane in quick else pytest.mark.slow)
    for material, quick in ((FLUID, ("strain", "stress")), (POLYMER, ("strain",)), (SOLID, ("stress",)))
    for plane in ("strain", "antiplane", "stress")
])  # fmt: skip
def test_relaxation_at_held_strain(material: dict[str, Any], plane: str) -> None:
    """Shear at once, then held: the traction relaxes as the relaxation function says, in steps of any length."""
    sudden, strain = 1e-9 * TIME, 1e-3
    times = np.concatenate([[0.0, sudden], TIME * np.array([0.01, 0.1, 0.11, 0.5, 2.0, 2.1])])
    axis = "z" if plane == "antiplane" else "x"
    boundaries = [moved(axis, times, np.where(times > 0, strain, 0.0)), *TIED]
    if plane == "antiplane":
        boundaries.append({"kind": "driven", "edge": "rock.bottom", "component": "z", "velocity": 0.0})
    else:
        boundaries += [*FIXED, {"kind": "driven", "edge": "rock.top", "component": "y", "velocity": 0.0}]
    found, solutions, energies = path(material, plane, boundaries, times, axis)
    np.testing.assert_allclose(found, SHEAR * strain * remaining(material, times[1:]), rtol=1e-8)
    assert max(solution.iterations for solution in solutions) <= 1, "linear materials need one iteration"
    assert_closed(energies)


# -- bodies with an interface ---------------------------------------------------------------------------------------

PUSH = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 0.05, "ramp": 1e-4}
HELD = [
    {"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"
]  # fmt: skip
YIELDING = {**ROCK, "relaxation_time": 1e-4}
STEPPERS: dict[str, dict[str, Any]] = {
    "quasi_static": {"kind": "quasi_static", "largest_step": 1e-4},
    "generalized_alpha": {"kind": "generalized_alpha", "scheme": "average_acceleration", "time_step": 4e-5},
    "hybrid": {"kind": "hybrid", "slow": {"kind": "quasi_static", "largest_step": 1e-4}},
}


fluid_and_slow_yielding = pytest.mark.parametrize("material", [
    pytest.param(YIELDING, marks=pytest.mark.slow, id="drucker_prager"), pytest.param(FLUID, id="maxwell"),
])  # fmt: skip
"""Both materials; steps of one that yields take seconds."""


def pushed(stepper: dict[str, Any], material: dict[str, Any] = YIELDING, **changes: Any) -> Case:
    """Plates whose upper left edge is pushed, so that stress is not uniform and a part of the plates yields."""
    return parse_case(plates({
        "plane": "strain", "order": 2, "duration": 2e-3, "boundaries": [PUSH, *HELD], "materials.default": material,
        "faults.main.contact": COMPLIANT, "stepper": stepper, **changes,
    }))  # fmt: skip


def steps(given: Case, comm: Any = COMM) -> tuple[Model, Any, Any]:
    model = Model(given, comm)
    motion, state = given.stepper.bind(model), model.initial_state()
    while state.time < given.duration * (1 - 1e-9):
        motion.step(state)
    return model, motion, state


def plastic_strain(model: Model, state: Any) -> float:
    """The largest plastic shear strain of all points."""
    largest = 0.0
    for name, sweep in model.memory.items():
        rows = sweep.rows(state.memory[name], np.arange(model.nodes))
        largest = max(largest, float(np.abs(rows[:, :, list(sweep.law.state).index("plastic_strain_xy")]).max()))
    return parallel.largest(model.comm, largest)


@pytest.mark.parametrize("stepper", [
    pytest.param(name, marks=[pytest.mark.slow] * (name == "quasi_static")) for name in STEPPERS
])  # fmt: skip
def test_budget_closes(stepper: str) -> None:
    model, motion, state = steps(pushed(STEPPERS[stepper]))
    values = motion.energies(state)
    assert abs(2 * values["boundary_work"] - sum(values.values())) < 1e-9 * values["boundary_work"]
    assert values["material_dissipation"] > 0.01 * values["boundary_work"]
    assert plastic_strain(model, state) > 1e-5


@pytest.mark.slow
def test_iteration_converges_quadratically() -> None:
    """While plates yield the residual of an iteration is below a multiple of the square of that before it."""
    model = Model(pushed(STEPPERS["quasi_static"], {**YIELDING, "relaxation_time": 1e-9}), COMM)
    equilibrium, state = Equilibrium(model), model.initial_state()
    numbers = []
    for number in range(12):
        solution = equilibrium.solve(state, 1e-4, guess=state.displacement)
        solution.commit(state)
        residuals = np.array(solution.residuals) / solution.scale
        numbers.append(solution.iterations)
        late = residuals[1:-1] < 1e-2  # near the solution, where the derivative is smooth
        if number > 4 and late.any():
            order = np.log(residuals[2:][late]) / np.log(residuals[1:-1][late])
            assert order.max() > 1.5, residuals
    assert plastic_strain(model, state) > 1e-4 and 3 <= max(numbers) <= 7


def test_elastic_steps_take_one_iteration() -> None:
    model = Model(pushed(STEPPERS["quasi_static"], {**YIELDING, "cohesion": 1e9}), COMM)
    equilibrium, state = Equilibrium(model), model.initial_state()
    for _ in range(3):
        solution = equilibrium.solve(state, 1e-4, guess=state.displacement)
        solution.commit(state)
        assert solution.iterations == 1


@pytest.mark.slow
@pytest.mark.parametrize("material", [YIELDING, FLUID], ids=lambda each: each["kind"])
def test_slow_loading_in_explicit_steps(material: dict[str, Any]) -> None:
    """The plates cross several hundred times during the loading: leapfrog follows the equilibrium."""
    damping = {"damping": {"mass": 2e4}}
    found = {}
    for name, stepper in {
        "leapfrog": {"kind": "leapfrog"}, "quasi_static": {"kind": "quasi_static", "largest_step": 1e-5},
        "generalized_alpha": {"kind": "generalized_alpha", "time_step": 5e-6},
    }.items():  # fmt: skip
        _, _, found[name] = steps(pushed(stepper, material, **({} if name == "quasi_static" else damping)))
    size = np.abs(found["leapfrog"].displacement).max()
    for name in ("quasi_static", "generalized_alpha"):
        apart = parallel.largest(COMM, float(np.abs(found[name].displacement - found["leapfrog"].displacement).max()))
        assert apart < 5e-3 * size, name


@fluid_and_slow_yielding
def test_implicit_waves_are_those_of_explicit_steps(material: dict[str, Any]) -> None:
    """A blow on the plates: average acceleration in small steps converges to leapfrog with the square of the step."""
    fast = {**material, "relaxation_time": 2e-6}
    blow = {**PUSH, "velocity": 10.0, "ramp": 2e-6}

    def displacement(stepper: dict[str, Any]) -> np.ndarray:
        _, _, state = steps(pushed(stepper, fast, duration=8e-6, boundaries=[blow, *HELD]))
        return np.asarray(state.displacement)

    exact = displacement({"kind": "leapfrog", "time_step": 1e-8})
    size = np.abs(exact).max()
    implicit = {"kind": "generalized_alpha", "scheme": "average_acceleration"}
    coarse, fine = (
        parallel.largest(COMM, float(np.abs(displacement({**implicit, "time_step": dt}) - exact).max()))
        for dt in (2e-7, 1e-7)
    )
    assert fine < 0.02 * size and coarse > 2.5 * fine


@pytest.mark.parametrize("stepper", STEPPERS)
def test_the_same_on_any_ranks(stepper: str) -> None:
    found = []
    for comm in (COMM, fem.MPI.COMM_SELF):
        model, motion, state = steps(pushed(STEPPERS[stepper], duration=1e-3), comm)
        groups = {
            name: values for each in model.mechanisms for group in each.saved(state).values()
            for name, values in group.items() if name.endswith("_xy")
        }  # fmt: skip
        energy = np.array([*motion.energies(state).values()])
        found.append([energy, *comm.bcast(groups, root=0).values()])
    assert len(found[0]) > 1
    for here, alone in zip(*found, strict=True):
        np.testing.assert_allclose(here, alone, rtol=1e-8, atol=1e-10 * np.abs(alone).max())


@pytest.mark.parametrize("stepper", [
    pytest.param(name, marks=[pytest.mark.slow] * (name == "generalized_alpha")) for name in STEPPERS
])  # fmt: skip
def test_resumed_bitwise(stepper: str, shared_tmp_path: Path) -> None:
    chosen = copy.deepcopy(STEPPERS[stepper])
    if COMM.size > 1:  # factorisations of several ranks at once differ by rounding from run to run
        chosen.get("slow", chosen)["petsc_options"] = {"pc_type": "redundant"}
    given = pushed(chosen, **{
        "output.checkpoint_steps": 7, "output.interface_interval": 4e-4, "output.bulk_interval": 1e-3,
        "output.bulk_fields": ["stress", "state"],
        "instruments": [{"kind": "load_cell", "name": "cell", "interval": 4e-4, "edge": "lower.bottom"}],
    })  # fmt: skip
    whole, cut = whole_and_resumed(given, shared_tmp_path / stepper)
    if COMM.rank == 0:
        with Record(whole) as one, Record(cut) as other:
            assert one.energy.identical(other.energy)
            assert one.interface.identical(other.interface)
            assert one.bulk.identical(other.bulk)
            assert one.instruments["cell"].identical(other.instruments["cell"])
            assert float(one.energy["material_dissipation"][-1]) > 0


def test_switch_to_waves_and_back() -> None:
    """A rupture between yielding plates: hybrid steps switch to waves and back, and the budget stays closed."""
    friction = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 2e-6}
    top = {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 0.02}
    given = pushed(
        {"kind": "hybrid", "calm_for": 2e-5, "slow_below": 1e-2, "fast_above": 0.05}, YIELDING, boundaries=[top, *HELD],
        duration=1e-2, damping={"mass": 3e5}, **{"faults.main.friction": friction},
    )  # fmt: skip
    model, kinds = Model(given, COMM), []
    motion, state = given.stepper.bind(model), model.initial_state()
    assert isinstance(motion, HybridMotion)
    while state.time < given.duration * (1 - 1e-9) and kinds.count(0.0) < 2:
        motion.step(state)
        if not kinds or kinds[-1] != state.numbers["fast"]:
            kinds.append(state.numbers["fast"])
    for _ in range(3):
        motion.step(state)
    assert kinds == [0.0, 1.0, 0.0]
    values = motion.energies(state)
    assert abs(2 * values["boundary_work"] - sum(values.values())) < 1e-6 * values["boundary_work"]
    assert values["material_dissipation"] > 0


def test_finite_sliding_is_refused() -> None:
    with pytest.raises(UnsupportedError, match=r"^materials\.default\.kind = 'drucker_prager': .*'leapfrog'"):
        pushed({"kind": "quasi_static"}, **{"faults.main.sliding": {}})


# -- instruments -----------------------------------------------------------------------------------------------------

TOP_CELL = {"kind": "load_cell", "name": "cell", "interval": 0.05, "edge": "rock.top"}
GAUGE = {"kind": "receiver", "name": "point", "interval": 0.05, "fields": ["stress"],
         "point": [0.3 * SIDE, 0.63 * SIDE]}  # fmt: skip


def measured(case: Case, comm: Any = COMM) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """Return times [s] and channels of the first instrument on all ranks, and the energies at the end."""
    model = Model(case, comm)
    motion, state = case.stepper.bind(model), model.initial_state()
    samples = Samples(model, motion.dt, unstressed)
    samples.observe(state)
    while state.fault_time < case.duration * (1 - 1e-9):
        motion.step(state)
        samples.observe(state)
    gathered = samples.gather()
    times, values = comm.bcast((gathered[0][1], np.array(gathered[0][2])) if gathered else None)
    return times, values, motion.energies(state)


@pytest.mark.parametrize("plane", ["strain", "antiplane", "stress"])
@pytest.mark.parametrize("material", [FLUID, POLYMER, SOLID], ids=lambda each: each["kind"])
def test_instruments_measure_relaxation(material: dict[str, Any], plane: str) -> None:
    """Shear at a constant rate: the stress at any point is G times the integral of the relaxation function, the force
    on the top is the side times that."""
    duration, rate = 2 * TIME, 1e-3 / TIME
    times = np.linspace(0.0, duration, 41)
    axis = "z" if plane == "antiplane" else "x"
    boundaries = [moved(axis, times, rate * times), *TIED]
    if plane == "antiplane":
        boundaries.append({"kind": "driven", "edge": "rock.bottom", "component": "z", "velocity": 0.0})
    else:
        boundaries += [*FIXED, {"kind": "driven", "edge": "rock.top", "component": "y", "velocity": 0.0}]
    step = duration / 40
    fine = np.linspace(0.0, duration, 4001)
    grown = cumulative_simpson(remaining(material, fine), x=fine, initial=0.0)
    for instrument, channel, size in ((TOP_CELL, 0, SIDE), (GAUGE, -1, 1.0)):  # xy, or yz, is the last stress
        given = Case.model_validate({
            "plane": plane, "order": 2, "duration": duration, "mesh": block(2), "boundaries": boundaries,
            "materials": {"default": material}, "output": {"figures": False},
            "stepper": {"kind": "quasi_static", "first_step": step, "largest_step": step},
            "instruments": [{**instrument, "interval": 2 * step}],
        })  # fmt: skip
        found, values, _ = measured(given)
        expected = size * SHEAR * rate * np.interp(found, fine, grown)
        assert len(found) == 21 and expected[-1] < 0.95 * size * SHEAR * rate * duration
        np.testing.assert_allclose(values[channel], expected, rtol=1e-7, atol=1e-9 * expected[-1])


@pytest.mark.parametrize("material", [METAL, KINEMATIC], ids=["isotropic", "kinematic"])
def test_instruments_measure_yield(material: dict[str, Any]) -> None:
    """Uniaxial strain, as in `test_uniaxial_strain_of_a_metal`; both ends carry the same force.

    Prescribed ends keep the width, so that the stress across is K e - q / 3.
    """
    times = np.linspace(0.0, 1.0, 21)
    for instrument, size in ((TOP_CELL, -SIDE), ({**TOP_CELL, "edge": "rock.bottom"}, SIDE), (GAUGE, -1.0)):
        given = Case.model_validate({
            "plane": "strain", "order": 2, "duration": 1.0, "mesh": block(2), "materials": {"default": material},
            "boundaries": [*FIXED[1:], *SIDES, moved("y", times, -0.03 * times)], "output": {"figures": False},
            "stepper": {"kind": "quasi_static", "first_step": 0.05, "largest_step": 0.05},
            "instruments": [instrument],
        })  # fmt: skip
        found, values, _ = measured(given)
        e = 0.03 * found
        plastic = np.maximum((2 * SHEAR * e - 2e7) / (3 * SHEAR + 8e8), 0.0)
        deviatoric = 2 * SHEAR * e - 3 * SHEAR * plastic
        expected = size * (BULK * e + 2 / 3 * deviatoric)
        np.testing.assert_allclose(values[1], expected, rtol=1e-7, atol=1e-9 * abs(expected[-1]))
        if instrument is GAUGE:
            np.testing.assert_allclose(values[0], -(BULK * e - deviatoric / 3), rtol=1e-7, atol=1e-9 * 2e7)


STEPS: dict[str, dict[str, Any]] = {
    "leapfrog": {"kind": "leapfrog", "time_step": 2e-8},
    "generalized_alpha": {"kind": "generalized_alpha", "scheme": "average_acceleration", "time_step": 1e-7},
}


def blown(material: dict[str, Any], stepper: str, cell: dict[str, Any], edge: str = "upper.left") -> Case:
    blow = {**PUSH, "edge": edge, "velocity": 10.0, "ramp": 2e-6}
    given = {**material, "relaxation_time": 2e-6}
    return pushed(STEPS[stepper], given, duration=8e-6, boundaries=[blow, *HELD], instruments=[cell])


@pytest.mark.parametrize("stepper", STEPS)
@fluid_and_slow_yielding
def test_a_free_edge_carries_nothing(material: dict[str, Any], stepper: str) -> None:
    """Waves pass the upper edge: elastic and inelastic forces and inertia of its nodes are in balance at every time."""
    step = STEPS[stepper]["time_step"]
    cell = {"kind": "load_cell", "name": "cell", "interval": step, "edge": "upper.top"}
    given = blown(material, stepper, cell)
    _, values, _ = measured(given)
    pressed = 8e6  # Pa, a fraction of the stress of the blow, rho c_p V = 32 MPa
    # Average accelerations are known half-way between the times of steps and are interpolated; leapfrog is exact.
    bound = 1e-9 if stepper == "leapfrog" else 0.02
    assert np.abs(values[1]).max() < bound * pressed * 12e-3


@pytest.mark.parametrize("material", [YIELDING, FLUID], ids=lambda each: each["kind"])
def test_force_times_velocity_is_the_work(material: dict[str, Any]) -> None:
    """Of a driven edge off the interface, by the trapezoidal rule at every step."""
    step = STEPS["leapfrog"]["time_step"]
    cell = {"kind": "load_cell", "name": "cell", "interval": step, "edge": "upper.top"}
    times, values, energies = measured(blown(material, "leapfrog", cell, "upper.top"))
    power = values[0] * 10.0 * np.minimum(times / 2e-6, 1.0)
    assert trapezoid(power, times) == pytest.approx(energies["boundary_work"], rel=0.01)
    assert energies["material_dissipation"] > 0.01 * energies["boundary_work"]


@fluid_and_slow_yielding
def test_receivers_measure_the_same_stress_in_implicit_steps(material: dict[str, Any]) -> None:
    """Both agree to 2 % of the amplitude; that of an elastic body under the same blow is more than 10 % off."""
    gauge = {**GAUGE, "interval": 2e-7, "point": [2.3e-3, 1.1e-3]}
    cases = [blown(material, stepper, gauge) for stepper in STEPS]
    cases.append(cases[0].changed("materials.default", HOMALITE))
    found = [measured(case)[1] for case in cases]
    count = min(values.shape[1] for values in found)
    explicit, implicit, elastic = (values[:, :count] for values in found)
    size = np.abs(explicit).max()
    assert np.abs(explicit - implicit).max() < 0.02 * size
    assert np.abs(explicit - elastic).max() > 0.1 * size


@pytest.mark.parametrize("instrument", [
    {"kind": "load_cell", "edge": "lower.bottom"}, {"kind": "receiver", "point": [2e-3, 2e-3], "fields": ["stress"]},
], ids=lambda each: each["kind"])  # fmt: skip
@pytest.mark.parametrize("stepper", [
    pytest.param(name, marks=() if name == "leapfrog" else pytest.mark.slow) for name in STEPS
])  # fmt: skip
def test_readings_are_the_same_on_any_ranks(stepper: str, instrument: dict[str, Any]) -> None:
    """The receiver is at a corner of four elements, which ranks may share."""
    given = blown(YIELDING, stepper, {**instrument, "name": "one", "interval": 4e-7, "bandwidth": 2e6})
    found = [measured(given, comm)[1] for comm in (COMM, fem.MPI.COMM_SELF)]
    assert np.abs(found[1]).max() > 1e3
    np.testing.assert_allclose(found[0], found[1], rtol=1e-8, atol=1e-9 * np.abs(found[1]).max())
