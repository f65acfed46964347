"""Contact methods for implicit steps with every friction law: exact tangents, the equilibrium they lead to, solvers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.interface_points import POINTS, an_interface, compliances, crossed, jump_under, sizes, with_cohesion
from helpers.messages import facts
from helpers.reference_step import respond_reference
from helpers.small_cases import HOMALITE, case, friction_laws, memory_friction, smooth_field

from ruptfx.app.check_law.examples import friction, table

pytest.importorskip("dolfinx")

from ruptfx.bodies.state import FaultState
from ruptfx.input.schema import CaseError, alternatives, package_of
from ruptfx.interfaces.faults import cohesive_interface
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.laws.contact._rigid import RigidContact
from ruptfx.platform import parallel
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.implicit.preconditioners import lu
from ruptfx.stepping.implicit.response import FaultResponse, Response

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

METHODS = {kind: cls for kind, cls in alternatives("ruptfx.laws.contact").items() if cls.implicit}
every_method = pytest.mark.parametrize("method", METHODS)
LAWS = friction_laws()
every_law = pytest.mark.parametrize("kind, wrapped", LAWS, ids=["-".join(filter(None, law)) for law in LAWS])
HELD = [
    {"kind": "driven", "edge": "lower.bottom", "component": component, "velocity": 0.0} for component in "xy"
] + [{"kind": "traction", "edge": "upper.top", "traction": [1e5, -2e6], "ramp": 1e-3}]  # fmt: skip


def contact(method: str) -> dict[str, Any]:
    return {"kind": method, **table(METHODS[method], 0)}


def a_moment(
    method: str, components: int, law: Any
) -> tuple[Fault, FaultState, np.ndarray, np.ndarray, dict[str, Any]]:
    """A fault whose points stick, slide and open, its state, a jump, the size of jumps, and what else is asked with."""
    random = np.random.default_rng(7)
    face = an_interface(components, random)
    normal = np.where(random.random(POINTS) < 0.1, 0.0, random.uniform(1e5, 1e7, POINTS))
    shear = random.normal(size=(POINTS, face.tangents)) * 1e5
    fault = Fault("main", face, METHODS[method].model_validate(table(METHODS[method], 0)), law.at(face.position),
                  normal, shear, np.eye(face.tangents)[np.zeros(POINTS, dtype=int)])  # fmt: skip
    state, dt = fault.initial_state(), 1e-6
    for name in (name for name in state if name.startswith("mean_slip_rate")):
        state[name][:] = random.normal(size=POINTS)  # some points slow down so much that the slip rate is bounded
    # Jumps that change the normal stress by some MPa, the shear traction by more, so that much slides.
    size = sizes(face, compliances(fault.contact, 1e6, dt) * [3e6, 15e6])
    given = {
        "dt": dt, "dt_before": 0.7e-6, "time": dt, "body_stiffness": np.full(POINTS, 1e11),
        "multiplier": (state["normal_stress"], fault.components(state, "shear_traction")),
    }  # fmt: skip
    return fault, state, random.normal(size=(POINTS, components)) * size, size, given


@every_method
@pytest.mark.parametrize("components", [1, 2, 3])
@every_law
def test_tangent_is_the_derivative(method: str, components: int, kind: str, wrapped: str | None) -> None:
    """Central differences of the traction; stuck, sliding and open points, the state advanced within."""
    fault, state, jump, size, given = a_moment(method, components, friction(kind, wrapped, profiles=True))

    def at(jump: np.ndarray) -> Response:
        return respond_reference(fault, state, jump, **given, threshold=1e-3)

    here, h = at(jump), 1e-6 * size
    for k in range(components):
        step = h * np.eye(components)[k]
        expected = (at(jump + step).traction - at(jump - step).traction) / (2 * h[k])
        error = np.abs(expected - here.tangent[:, :, k]).max(axis=1) / np.abs(here.tangent).max()
        # Truncation and round-off of the differences; a point may sit within h of a kink.
        assert np.sort(error)[-2] < 1e-6
    sliding = np.linalg.norm(fault.components(here.state, "slip_rate"), axis=1) > 0
    assert sliding.mean() > 0.05
    if components > 1:
        assert 0.01 < np.mean(here.state["normal_stress"] == 0) < 0.9


def response_agrees(method: str, components: int, law: Any) -> None:
    """Compiled and in arrays, with radiation, also from a guess that is far away: traction, tangent and all fields."""
    fault, state, jump, _, given = a_moment(method, components, law)
    radiation = np.linspace(0, 1e5, POINTS)
    respond = FaultResponse(fault, 1e-3, radiation)
    for guess in (None, {name: 10 * values for name, values in state.items()}):
        ours = respond(state, jump, **given, guess=guess)
        theirs = respond_reference(fault, state, jump, **given, threshold=1e-3, radiation=radiation, guess=guess)
        assert list(ours.state) == list(theirs.state)
        pairs = {"traction": (ours.traction, theirs.traction), "tangent": (ours.tangent, theirs.tangent)}
        pairs |= {name: (ours.state[name], theirs.state[name]) for name in theirs.state}
        for name, (mine, expected) in pairs.items():
            # When a rate is passed is a quotient of small differences.
            size = np.nanmax(np.abs(expected), initial=0.0) * (10 if name == "rupture_time" else 1)
            np.testing.assert_allclose(mine, expected, rtol=0, atol=1e-12 * size, err_msg=name)


@every_method
@every_law
def test_compiled_response_is_the_reference(method: str, kind: str, wrapped: str | None) -> None:
    response_agrees(method, 2, friction(kind, wrapped, profiles=True))


@every_method
@pytest.mark.parametrize("components", [1, 3])
@pytest.mark.parametrize("kind, wrapped", [("coulomb", None), ("prakash_clifton", "rate_and_state_power_law")])
def test_compiled_response_in_antiplane_and_3d(method: str, components: int, kind: str, wrapped: str | None) -> None:
    response_agrees(method, components, friction(kind, wrapped))


@pytest.mark.parametrize("method, kind, components", crossed(METHODS, [
    *((kind, 2) for kind in alternatives(package_of("cohesion"))), ("linear", 3), ("linear", 1),
]))  # fmt: skip
def test_response_with_cohesion(method: str, kind: str, components: int) -> None:
    """Compiled and in arrays, and the tangent against central differences: tearing, closing, sheared, failed points."""
    law = friction("linear_slip_weakening", None, profiles=True)
    fault, state, jump, size, given = a_moment(method, components, law)
    random = np.random.default_rng(3)
    fault = with_cohesion(fault, kind, compliances(fault.contact, 1e6, given["dt"]), random)
    state |= {name: np.zeros(POINTS) for name in cohesive_interface.STATE}
    respond = FaultResponse(fault, 1e-3)
    seen = []
    for _ in range(4):
        ours = respond(state, jump, **given)
        theirs = respond_reference(fault, state, jump, **given, threshold=1e-3)
        assert set(ours.state) == set(theirs.state)
        for name, expected in {"traction": theirs.traction, **theirs.state}.items():
            mine = ours.traction if name == "traction" else ours.state[name]
            scale = np.nanmax(np.abs(expected), initial=0.0) * (10 if name == "rupture_time" else 1)
            np.testing.assert_allclose(mine, expected, rtol=0, atol=2e-12 * scale, err_msg=name)
        h = 1e-6 * size
        for k in range(components):
            ahead = h * np.eye(components)[k]
            expected = np.subtract(*(respond(state, jump + d, **given).traction for d in (ahead, -ahead))) / (2 * h[k])
            error = np.abs(expected - ours.tangent[:, :, k]).max(axis=1) / np.abs(ours.tangent).max()
            assert np.sort(error)[-3] < 1e-6  # a point may sit within h of a kink
        damage = ours.state["damage"]
        seen.append((np.mean((damage > state["damage"]) & (damage < 1)), np.mean(damage >= 1)))
        state = ours.state
        jump = jump + 0.3 * random.normal(size=jump.shape) * size
    assert max(grows for grows, _ in seen) > 0.005 and seen[-1][1] > 0.02


def column_above_a_gap(method: str, gap: float, height: float) -> Model:
    """A column that its driven top pushes down at 3 mm/s, above a rigid base."""
    sides = [{"kind": "driven", "edge": f"upper.{side}", "component": "x", "velocity": 0.0} for side in
             ("left", "right")]  # fmt: skip
    return Model(case({
        "plane": "strain", "stepper": {"kind": "quasi_static"}, "faults.main.contact": contact(method),
        "faults.main.initial_stress.normal": 0.0,
        "faults.main.gap": gap, "boundaries": [
            *sides, {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": -3e-3},
        ],
        "mesh": {"kind": "block_on_rigid", "length": 1e-3, "height": height, "element_size": 1e-3},
    }))  # fmt: skip


@every_method
def test_a_gap_closes_before_it_carries(method: str) -> None:
    """A column 4 mm high, 10 um above its rigid base, pushed down by 15 um."""
    gap, height = 10e-6, 4e-3
    model = column_above_a_gap(method, gap, height)
    state = model.initial_state()
    np.testing.assert_array_equal(state.faults["main"]["opening"], gap)
    Equilibrium(model).solve(state, 5e-3).commit(state)
    # No lateral strain: p = M (d - gap - what the interface gives under p) / H, M = rho c_p^2.
    modulus = HOMALITE["density"] * model.wave_speeds().c_p ** 2
    pressure = state.faults["main"]["normal_stress"]
    given = -jump_under(model.faults[0].contact, 0.0, -pressure.mean(), 0.0)[0]
    # Multipliers are iterated until the sides overlap by little: 2e-5 of the pressure was found.
    np.testing.assert_allclose(pressure, modulus * (15e-6 - gap - given) / height, rtol=1e-4)


@every_method
def test_no_force_is_an_equilibrium(method: str) -> None:
    """Over an open gap the column follows its top as it is: no force that a residual could be compared with."""
    gap = 10e-6
    model = column_above_a_gap(method, gap, 4e-3)
    equilibrium, state = Equilibrium(model), model.initial_state()
    for moved in (3e-6, 6e-6, 9e-6):
        # The last begins where it ends.
        guess = state.displacement * (1.5 if moved == 9e-6 else 1.0)
        equilibrium.solve(state, 1e-3, guess=guess).commit(state)
        np.testing.assert_allclose(state.displacement.reshape(-1, 2)[:, 1], -moved, rtol=1e-12)
        np.testing.assert_allclose(state.faults["main"]["opening"], gap - moved, rtol=1e-9)
        assert np.all(state.faults["main"]["normal_stress"] == 0)


@pytest.mark.parametrize("condensed", [True, False])
def test_what_has_slid_far_still_balances(condensed: bool) -> None:
    """Tractions are stiffness times what is left of jump and slip: 1e17 Pa/m times the rounding of 0.1 m, 1e-17 m, on
    0.5 mm is 1e-3 N at a point, more than 1e-10 of the forces, some 1e4 N."""
    model = Model(case({
        "order": 2, "faults.main.contact": {"kind": "compliant", "C_n": 1e17, "C_s": 1e17}, "boundaries": HELD,
        "faults.main.friction": memory_friction("P1"), "faults.main.initial_stress": {"normal": 1e6, "shear": 2e4},
    }))  # fmt: skip
    equilibrium, state = Equilibrium(model, condensed=condensed), model.initial_state()
    slid = 0.1 + 1e-3 / 3
    upper = model.layout.body == model.bodies.names.index("upper")
    state.displacement.reshape(-1, 2)[upper, 0] = slid
    state.faults["main"]["slip"][:] = slid
    for _ in range(2):
        equilibrium.solve(state, 1e-4).commit(state)
    # The load has grown to 0.2 of 0.1 MPa, on average.
    face, traction = model.faults[0].interface, state.faults["main"]["shear_traction"]
    carried, area = parallel.total(model.comm, [(face.weight * face.owned) @ traction, face.weight @ face.owned])
    assert carried / area == pytest.approx(2e4 + 0.2e5, rel=1e-3)


@every_method
def test_equilibrium_balances_and_leaves_the_state_alone(method: str) -> None:
    """K u + J' W (T - T_0) = F at the end of a sliding step, Newton converges quadratically, nothing is committed."""
    pressed = case({
        "faults.main.contact": contact(method), "faults.main.friction": memory_friction("P1"), "boundaries": HELD,
        "faults.main.initial_stress": {"normal": 1e6, "shear": 2e4}, "stepper": {"kind": "quasi_static"},
    })  # fmt: skip
    model = Model(pressed)
    equilibrium, state = Equilibrium(model), model.initial_state()
    solution = equilibrium.solve(state, 1e-4)
    assert np.all(state.displacement == 0) and np.all(state.faults["main"]["slip"] == 0) and state.time == 0
    solution.commit(state)
    assert state.step == 1 and state.time == 1e-4 and state.faults["main"]["slip"].min(initial=1.0) > 0
    # The tractions of the state say the same as the solution.
    np.testing.assert_allclose(equilibrium.forces.internal(state), solution.internal, atol=1e-9 * solution.scale)
    free = ~model.loads.prescribed
    unbalanced = (solution.internal - equilibrium.forces.load(state.time))[free]
    assert np.abs(unbalanced).max() < 1e-9 * solution.scale
    # What is driven carries the load: sum of reactions = 0.1 of the final traction times the length, 12 mm.
    driven = ~free.reshape(-1, 2)[: model.owned_nodes, 0]
    reaction = parallel.total(model.comm, solution.internal.reshape(-1, 2)[: model.owned_nodes][driven].sum(axis=0))
    np.testing.assert_allclose(reaction, [-1e4 * 12e-3, 2e5 * 12e-3], rtol=1e-9)


def test_the_matrix_is_the_operator() -> None:
    """K u of the matrix that is factorised is that of the operator, to round-off."""
    model = Model(case())
    equilibrium, u = Equilibrium(model), smooth_field(model)
    product = equilibrium.tangent._stiffness.createVecLeft()
    vector = equilibrium.tangent._stiffness.createVecRight()
    vector.array[:] = u[: len(vector.array)]
    equilibrium.tangent._stiffness.mult(vector, product)
    expected = -model.internal_force(u)[: len(product.array)]
    assert np.abs(product.array - expected).max() < 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("options", [
    {}, {"ksp_type": "cg", "pc_type": "gamg", "ksp_rtol": 1e-9},
    {"ksp_type": "fgmres", "pc_type": "jacobi", "ksp_rtol": 1e-8},
])  # fmt: skip
def test_options_of_the_case_choose_the_solver(options: dict[str, Any]) -> None:
    model = Model(case({"order": 2, "boundaries": HELD}))
    equilibrium, reference = Equilibrium(model, options, condensed=False), Equilibrium(model)
    ours, theirs = (solver.solve(model.initial_state(), 1e-4).displacement for solver in (equilibrium, reference))
    np.testing.assert_allclose(ours, theirs, atol=1e-8 * np.abs(theirs).max())
    ksp = equilibrium._solver.snes.getKSP()
    assert ksp.getType() == options.get("ksp_type", "preonly")
    assert ksp.getPC().getType() == options.get("pc_type", "lu")


def test_multigrid_solves_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """What large systems get: CG while the tangent is symmetric, GMRES where friction follows pressure."""
    monkeypatch.setitem(lu.DIRECT, 2, 0)
    sliding = case({
        "order": 2, "faults.main.friction": {"kind": "coulomb", "mu_d": 0.1},
        "boundaries": [*HELD[:2], {**HELD[2], "traction": [3e6, -1e6]}, {**HELD[0], "edge": "upper.left"}],
        "faults.main.initial_stress": {"normal": 1e6, "shear": 9e4},
    })  # fmt: skip
    model = Model(sliding)
    equilibrium, state = Equilibrium(model), model.initial_state()
    types = []
    for dt in (1e-5, 9.9e-4):
        equilibrium.solve(state, dt).commit(state)
        types.append(equilibrium._solver.snes.getKSP().getType())
    assert parallel.total(model.comm, state.faults["main"]["slip"].sum()) > 0
    assert types == ["cg", "fgmres"]


def test_unknown_option_is_refused() -> None:
    model = Model(case({"order": 2, "boundaries": HELD}))
    equilibrium = Equilibrium(model, {"snes_rtoll": 1e-8})
    with pytest.raises(CaseError, match=facts(r"stepper\.petsc_options\.snes_rtoll = 1e-08: .* no such option")):
        equilibrium.solve(model.initial_state(), 1e-4)


def test_options_that_end_without_a_test_do_not_hide_a_residual() -> None:
    """One linear step, `ksponly`, is no equilibrium where contact slides; where it sticks it is."""
    for shear, balanced in ((3e6, False), (1e4, True)):
        sliding = case({
            "order": 2, "faults.main.friction": {"kind": "coulomb", "mu_d": 0.1},
            "boundaries": [*HELD[:2], {**HELD[2], "traction": [shear, -1e6]}, {**HELD[0], "edge": "upper.left"}],
            "faults.main.initial_stress": {"normal": 1e6, "shear": 0.0},
        })  # fmt: skip
        model = Model(sliding)
        equilibrium, state = Equilibrium(model, {"snes_type": "ksponly"}), model.initial_state()
        if balanced:
            equilibrium.solve(state, 1e-3)
        else:
            with pytest.raises(ConvergenceError, match=facts(r"no equilibrium at time 0\.001 s")):
                equilibrium.solve(state, 1e-3)


def test_no_equilibrium_says_where_and_changes_nothing() -> None:
    """A plate that nothing holds, pulled off its base."""
    lost = case({
        "order": 2, "faults.main.friction": {"kind": "coulomb", "mu_d": 0.1}, "faults.main.initial_stress.normal": 1e6,
        "boundaries": [*HELD[:2], {**HELD[2], "traction": [0.0, 9e6]}],
    })  # fmt: skip
    model = Model(lost)
    equilibrium, state = Equilibrium(model), model.initial_state()
    with pytest.raises(
        ConvergenceError, match=facts(r"no equilibrium at time 0.0005 s, step of 0.0005 s: DIVERGED.*worst:")
    ):
        equilibrium.solve(state, 5e-4)
    assert np.all(state.displacement == 0) and state.time == 0 and np.all(state.faults["main"]["opening"] == 0)


RIGID = [kind for kind, cls in alternatives("ruptfx.laws.contact").items() if issubclass(cls, RigidContact)]


@pytest.mark.parametrize("stepper", ["leapfrog", "generalized_alpha", "quasi_static"])
def test_rigid_contact_is_the_same_by_whatever_name(stepper: str) -> None:
    """Each kind of steps takes the method that belongs to it: all fields are bitwise identical."""
    push = {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 2.0}
    fields = []
    for kind in RIGID:
        given = case({
            "order": 2, "duration": 4e-6, "stepper": {"kind": stepper}, "boundaries": [*HELD[:2], push],
            "faults.main.contact": {"kind": kind}, "faults.main.friction": {"kind": "coulomb", "mu_d": 0.3},
            "faults.main.initial_stress.shear": 1.79e6,
        })  # fmt: skip
        model = Model(given)
        motion, state = given.stepper.bind(model), model.initial_state()
        while state.time < given.duration:
            motion.step(state)
        assert np.abs(state.faults["main"]["slip"]).max() > 0
        fields.append({**state.faults["main"], "displacement": state.displacement})
    assert len(RIGID) > 1
    for other in fields[1:]:
        for name, values in fields[0].items():
            np.testing.assert_array_equal(other[name], values, err_msg=name)
