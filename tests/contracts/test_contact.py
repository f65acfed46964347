"""Every contact method of the folder, with every friction law: the C step is the reference step, patches stay still."""

from __future__ import annotations

import platform
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.interface_points import (
    POINTS,
    an_interface,
    at_point,
    compliances,
    crossed,
    jump_under,
    sizes,
    with_cohesion,
)
from helpers.messages import facts
from helpers.reference_step import advance_reference, advance_settled
from helpers.small_cases import COMPLIANT, HOMALITE, case, friction_laws, march, tilted

from ruptfx.app.check_law.examples import friction, table

pytest.importorskip("dolfinx")

from ruptfx.input.schema import alternatives, package_of
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fault_step import FaultStep, impedances
from ruptfx.interfaces.faults.interface import Interface
from ruptfx.interfaces.faults.points import Clock
from ruptfx.laws.contact import Point
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.coulomb import Coulomb
from ruptfx.platform.codegen import native
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

METHODS = {kind: cls for kind, cls in alternatives("ruptfx.laws.contact").items() if cls.explicit}
every_method = pytest.mark.parametrize("method", METHODS)
LAWS = friction_laws()
every_law = pytest.mark.parametrize("kind, wrapped", LAWS, ids=["-".join(filter(None, law)) for law in LAWS])


def contact(method: str, seed: int = 0) -> Any:
    cls = METHODS[method]
    return cls.model_validate(table(cls, seed))


def apart(face: Interface, jump: np.ndarray) -> np.ndarray:
    """A displacement with these jumps, shape (n, local)."""
    displacement = np.zeros((2 * POINTS, face.frame.shape[2]))
    displacement[face.plus] = np.einsum("ikc,ik->ic", face.frame, jump) / 2
    displacement[face.minus] = -displacement[face.plus]
    return displacement.ravel()


def a_fault(method: str, law: Any, components: int, random: np.random.Generator) -> Fault:
    face = an_interface(components, random)
    normal = np.where(random.random(POINTS) < 0.1, 0.0, random.uniform(1e5, 1e7, POINTS))
    shear = random.normal(size=(POINTS, face.tangents)) * 1e5
    along = np.eye(face.tangents)[np.zeros(POINTS, dtype=int)]
    return Fault("main", face, contact(method), law.at(face.position), normal, shear, along)


def steps_agree(
    fault: Fault, components: int, random: np.random.Generator, bond: dict[str, Any] | None = None
) -> tuple[float, float, float]:
    """Largest relative difference of C and reference over a few steps on random motion, the start among them; largest
    share of points that were open at once, and share of those that slid at some time. `bond` gets the last damage of
    cohesion, and what it took in shear."""
    dt, threshold = 1e-7, 1e-3
    inverse = np.repeat(random.uniform(1e4, 1e5, 2 * POINTS), components)
    driven = fault.interface.plus[random.random(POINTS) < 0.1]
    inverse.reshape(-1, components)[driven] = 0  # on one side; nodes held in some directions are in test_held_points.py
    clocks, law = [Clock.of_step(dt, number) for number in range(8)], fault.traced_law()
    compiled = [FaultStep(fault, inverse, clock, threshold) for clock in clocks]
    ours, theirs = fault.initial_state(), fault.initial_state()
    worst, opened, slid = 0.0, 0.0, np.zeros(POINTS, dtype=bool)
    # Jumps that change the tractions by some MPa, but slide by no more than the slip in which laws weaken: beyond that
    # a step may end in more than one way.
    size = np.minimum(4e6 * compliances(fault.contact, 1e6, dt), [np.inf, 3e-5])

    def compare(a: np.ndarray, b: np.ndarray, scale: float = 0.0) -> None:
        nonlocal worst
        np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
        scale = scale or np.nanmax(np.abs(b), initial=0.0)
        if scale > 0:
            worst = max(worst, float(np.nanmax(np.abs(a - b))) / scale)

    for step, clock in enumerate(clocks):
        displacement = apart(fault.interface, random.normal(size=(POINTS, components)) * sizes(fault.interface, size))
        velocity, force = random.normal(size=(2, len(inverse))) * [[2.0], [1e3]]
        mine, forces, untouched = velocity.copy(), force.copy(), velocity.copy()
        before = {name: values.copy() for name, values in theirs.items()}
        lost = compiled[step](ours, displacement, mine, forces, step * dt)
        expected = advance_reference(
            fault, law, theirs, displacement, velocity, force, inverse, clock, step * dt, threshold
        )
        compare(mine, velocity)
        compare(forces, force)
        theirs_shear, theirs_rate = fault.components(theirs, "shear_traction"), fault.components(theirs, "slip_rate")
        power = np.abs(theirs_shear * theirs_rate).sum(axis=1)
        typical = np.abs(theirs_shear).max() * np.abs(theirs_rate).max() * fault.interface.weight.sum() * dt
        compare(np.array([lost]), np.array([expected]), typical)
        if bond is not None:
            found = advance_settled(fault, law, before, displacement, untouched, inverse, clock, step * dt, threshold)
            torn = found.fractured * (clock.since if law.at_end else clock.kick)
            if law.at_end:
                torn = torn + fault.cohesive_losses(before, theirs, clock.since).tension
            torn = float((fault.interface.owned * fault.interface.weight) @ torn)
            whole = float(np.max(fault.cohesion.G_Ic)) * fault.interface.weight.sum()
            compare(np.array([compiled[step].fractured(ours, mine, None)]), np.array([torn]), typical + whole)
            bond |= {"last": theirs["damage"], "taken": bond.get("taken", 0.0) + torn}
        for name in theirs:
            compare(ours[name], theirs[name])
        opened = max(opened, float(np.mean(theirs["normal_stress"] == 0)))
        slid |= power > 0
    return worst, opened, float(slid.mean())


@every_method
@every_law
def test_compiled_step_is_the_reference_step(method: str, kind: str, wrapped: str | None) -> None:
    random = np.random.default_rng(7)
    worst, opened, slid = steps_agree(a_fault(method, friction(kind, wrapped, profiles=True), 2, random), 2, random)
    # Both stop when the residual is below 1e-13 of the trial traction.
    assert worst < 1e-10
    assert 0.05 < opened < 0.95 and slid > 0.05


@every_method
@pytest.mark.parametrize("components", [1, 3])
@pytest.mark.parametrize("kind, wrapped", [("coulomb", None), ("prakash_clifton", "rate_and_state_power_law")])
def test_compiled_step_in_antiplane_and_3d(method: str, components: int, kind: str, wrapped: str | None) -> None:
    random = np.random.default_rng(3)
    worst, *_ = steps_agree(a_fault(method, friction(kind, wrapped), components, random), components, random)
    assert worst < 1e-10


@every_method
def test_compiled_step_with_a_gap(method: str) -> None:
    random = np.random.default_rng(11)
    fault = a_fault(method, friction("coulomb", None), 2, random)
    gap = random.uniform(0, 8e6, POINTS) * compliances(fault.contact, 1e6, 1e-7)[0]
    worst, opened, _ = steps_agree(replace(fault, gap=gap), 2, random)
    assert worst < 1e-10
    assert 0.05 < opened < 0.99


COHESION = alternatives(package_of("cohesion"))


@pytest.mark.parametrize("method, kind, components", crossed(METHODS, [
    *((kind, 2) for kind in COHESION), ("linear", 3),
]))  # fmt: skip
def test_compiled_step_with_cohesion(method: str, kind: str, components: int) -> None:
    """Some points crack from the start; motion tears, closes and shears the others until most have failed."""
    random = np.random.default_rng(13)
    fault = a_fault(method, friction("linear_slip_weakening", None, profiles=True), components, random)
    fault = with_cohesion(fault, kind, compliances(fault.contact, 1e6, 1e-7), random)
    worst, *_ = steps_agree(fault, components, random, damage := {})
    assert worst < 1e-10
    last = damage["last"]
    assert 0.02 < np.mean(last >= 1) < 0.95 and np.mean((last > 0) & (last < 1)) > 0.02
    assert damage["taken"] != 0


@every_method
def test_an_open_interface_at_rest_stays_so_in_3d(method: str) -> None:
    """No traction and no motion: slip has no direction."""
    fault, none = a_fault(method, Coulomb(mu_d=0.3), 3, np.random.default_rng(2)), np.zeros(6 * POINTS)
    fault = replace(fault, normal_stress_0=np.zeros(POINTS), shear_traction_0=np.zeros((POINTS, 2)),
                    gap=np.full(POINTS, 1e-3))  # fmt: skip
    state, velocity = fault.initial_state(), none.copy()
    FaultStep(fault, np.ones(6 * POINTS), Clock.of_step(1e-7), 1e-3)(state, none, velocity, none.copy(), 1e-7)
    assert np.all(velocity == 0)
    for name in ("mean_slip_rate", "slip_rate", "shear_traction"):
        assert np.all(fault.components(state, name) == 0)


@every_method
def test_laws_are_vectorized(method: str) -> None:
    """No loop over points was left to one at a time: none calls exp or pow of numbers, but those of vectors."""
    gcc = "Free Software Foundation" in native._version(native.find_compiler())
    wide = platform.machine() == "x86_64" and "avx2" in native._processor()
    if not (wide and gcc and platform.libc_ver() >= ("glibc", "2.35")):
        pytest.skip("vectors of exp and pow come with GCC and glibc on x86-64 with AVX2")
    fault = a_fault(method, friction("rate_and_state_power_law", None, profiles=True), 2, np.random.default_rng(1))
    step = FaultStep(fault, np.ones(4 * POINTS), Clock.of_step(1e-7), 1e-3)
    called = set(Path(step._library._name).read_bytes().split(b"\0"))
    assert {b"exp", b"pow", b"expm1"}.isdisjoint(called)
    assert any(name.startswith(b"_ZGV") and name.endswith(b"_pow") for name in called)


@every_method
def test_failure_names_the_point(method: str) -> None:
    from ruptfx.interfaces.faults.projection import ProjectionError

    random = np.random.default_rng(1)
    fault = a_fault(method, Coulomb(mu_d=0.3), 2, random)
    displacement = np.zeros(4 * POINTS)
    displacement[2 * fault.interface.plus[13]] = np.nan
    velocity = displacement.copy()
    for step in (
        lambda: FaultStep(fault, np.ones(4 * POINTS), Clock.of_step(1e-7), 1e-3)(
            fault.initial_state(), displacement, velocity, np.zeros(4 * POINTS), 2e-6
        ),
        lambda: advance_reference(
            fault,
            fault.traced_law(),
            fault.initial_state(),
            displacement,
            velocity,
            np.zeros(4 * POINTS),
            np.ones(4 * POINTS),
            Clock.of_step(1e-7),
            2e-6,
            1e-3,
        ),
    ):
        with pytest.raises(
            ProjectionError, match=facts(r"coulomb: the trial traction is not a number.*point 13 .*'main'")
        ):
            step()


class Jumps(FrictionLaw):
    """A coefficient that jumps from 0.3 to 0.6 at 1 m/s: between the two no slip rate balances a traction."""

    formula = "mu"
    source = "none"

    def strength(self, slip_rate: Any, normal_stress: Any, state: Any) -> Any:
        return np.where(slip_rate > 1.0, 0.6, 0.3) * normal_stress

    def advance(self, state: Any, slip_rate: Any, normal_stress: Any, dt: Any) -> Any:
        return state

    def initial_state(self, normal_stress: Any, shear_stress: Any, slip_rate: Any) -> Any:
        return {}


def test_a_strength_that_jumps_over_the_traction_is_an_error() -> None:
    """By the compiled step and by arrays: the bracket closes at the jump, where the strength is not the traction."""
    from ruptfx.interfaces.faults.projection import ProjectionError

    # 1e6 Pa and a trial of 0.45e6 Pa; Z of some 1e3 Pa s/m takes next to nothing of it at 1 m/s.
    face = an_interface(2, np.random.default_rng(1))
    normal, shear, along = np.full(POINTS, 1e6), np.full((POINTS, 1), 0.45e6), np.ones((POINTS, 1))
    fault = Fault("main", face, contact("split_node"), Jumps(), normal, shear, along)
    dt, none = 1e-7, np.zeros(4 * POINTS)
    mobile = np.full(4 * POINTS, 1 / (1e3 * dt * face.weight.mean()))
    for step in (
        lambda: FaultStep(fault, mobile, Clock.of_step(dt, 2), 1e-3)(
            fault.initial_state(), none.copy(), none.copy(), none.copy(), 2e-6
        ),
        lambda: advance_reference(
            fault,
            fault.traced_law(),
            fault.initial_state(),
            none.copy(),
            none.copy(),
            none.copy(),
            mobile,
            Clock.of_step(dt, 2),
            2e-6,
            1e-3,
        ),
    ):
        with pytest.raises(ProjectionError, match=facts(r"jumps: no slip rate balances the trial traction.*point 0 ")):
            step()


@pytest.mark.parametrize("method", alternatives("ruptfx.laws.contact"))
def test_trial_is_relieved_as_it_says(method: str) -> None:
    """Opening by `normal_compliance` relieves a unit of normal stress, sliding at V for the step Z V of shear traction:
    as slip of the interface, or of the velocity that the bodies would have."""
    random, cls = np.random.default_rng(5), alternatives("ruptfx.laws.contact")[method]
    contact = cls.model_validate(table(cls, 0))
    for _ in range(10):
        point = at_point(random)
        before = contact.trial(point)
        relieved, V = 1e2, 1e2 / before.impedance[0]  # 100 Pa, by which springs that stiffen do not change
        opened = replace(point, opening_jump=point.opening_jump + relieved * before.normal_compliance)
        slid = replace(point, slip=[point.slip[0] + V * point.since], slip_velocity=[point.slip_velocity[0] - V])
        size = abs(before.normal_stress) + 1e6 * abs(point.opening_velocity) + abs(before.shear_traction[0])
        found = before.normal_stress - contact.trial(opened).normal_stress
        np.testing.assert_allclose(found, relieved, rtol=1e-3, atol=1e-14 * size)
        found = before.shear_traction[0] - contact.trial(slid).shear_traction[0]
        np.testing.assert_allclose(found, 1e2, rtol=1e-3, atol=1e-14 * size)


@every_method
def test_trial_stops_the_jump_or_follows_it(method: str) -> None:
    """Without stiffness in a direction, the trial traction as force ends its jump; with it, the trial is that of a
    spring no stiffer than it says, which holds the energy it says."""
    random = np.random.default_rng(5)
    fault = a_fault(method, Coulomb(mu_d=0.3), 2, random)
    face, dt = fault.interface, 1e-7
    inverse = np.repeat(random.uniform(1e4, 1e5, 2 * POINTS), 2)
    z_n, z_s = impedances(face, inverse, dt)
    displacement, velocity = random.normal(size=(2, 4 * POINTS)) * [[1e-6], [1.0]]
    (opening, slip), (opening_rate, slip_rate) = face.split(face.jump(displacement)), face.split(face.jump(velocity))
    point = Point(
        fault.normal_stress_0, list(fault.shear_traction_0.T), opening, list(slip.T), opening_rate, list(slip_rate.T),
        list(0 * slip.T), dt, dt, z_n, list(z_s.T),
    )  # fmt: skip
    trial = fault.contact.trial(point)
    pressed = fault.normal_stress_0 - trial.normal_stress
    dragged = trial.shear_traction[0] - fault.shear_traction_0[:, 0]
    face.add_force(velocity, dt * np.stack([pressed, dragged], axis=1), scale=inverse)
    normal, shear = face.split(face.jump(velocity))
    C_n, C_s = fault.contact.stiffness()
    if C_n == 0:
        assert np.max(np.abs(opening + dt * normal)) < 1e-18  # a gap that closes within the step
    if C_s == 0:
        assert np.max(np.abs(shear)) < 1e-12
    moved = [1e-10, 1e-10]  # m
    wider = replace(point, opening_jump=opening + moved[0], slip_jump=[slip[:, 0] + moved[1]])
    further = fault.contact.trial(wider)
    ends = [(np.asarray(t.normal_stress), np.asarray(t.shear_traction[0])) for t in (trial, further)]
    stored = [fault.contact.stored(n, [s], 0 * n, [0 * s]) for n, s in ends]
    work = np.zeros(POINTS)
    if C_n:
        stiffness = (ends[0][0] - ends[1][0]) / moved[0]
        assert stiffness.min() > 0 and stiffness.max() < C_n * (1 + 1e-5)
        work -= 0.5 * (ends[0][0] + ends[1][0]) * moved[0]
    if C_s:
        stiffness = (ends[1][1] - ends[0][1]) / moved[1]
        assert stiffness.min() > 0 and stiffness.max() < C_s * (1 + 1e-5)
        work += 0.5 * (ends[0][1] + ends[1][1]) * moved[1]
    most = 1e-10 * np.abs(stored[0]).max(initial=1e-300)
    np.testing.assert_allclose(stored[1] - stored[0], work, rtol=1e-4, atol=most)


@every_method
def test_initial_stress_below_strength_moves_nothing(method: str) -> None:
    quiet = case({
        "faults.main.contact": contact(method).model_dump(), "faults.main.friction": {"kind": "coulomb", "mu_d": 0.5},
        "faults.main.initial_stress.shear": 2.9e6, "duration": 2e-6,
    })  # fmt: skip
    _, _, state = march(quiet)
    assert np.all(state.velocity == 0)
    assert np.all(state.faults["main"]["shear_traction"] == 2.9e6)


@every_method
@pytest.mark.parametrize("angle, order", [(0.6, 2), (2.5, 4), *(
    pytest.param(*pair, marks=pytest.mark.slow) for pair in ((0.0, 2), (0.0, 4), (0.6, 4), (2.5, 2))
)])  # fmt: skip
def test_uniform_stress_stays_uniform(method: str, angle: float, order: int, tmp_path: Any) -> None:
    """Patch test: a uniform stress on top of the initial one is in equilibrium, on skewed elements and any slope."""
    added = np.array([[0.4e6, 0.7e6], [0.7e6, -2e6]])  # tension positive
    n, t = np.array([-np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    unturned = {"upper.top": (2.0, 10.0), "lower.bottom": (-2.0, -10.0), "upper.left": (-1.0, 0.0),
                "lower.left": (-1.0, 0.0), "upper.right": (1.0, 0.0), "lower.right": (1.0, 0.0)}  # fmt: skip
    turn = np.array([t, n]).T
    boundaries = []
    for edge, outward in unturned.items():
        outward = turn @ (np.array(outward) / np.linalg.norm(outward))
        boundaries.append({"kind": "traction", "edge": edge, "traction": (added @ outward).tolist()})
    loaded = case({
        "order": order, "mesh": tilted(tmp_path, angle), "boundaries": boundaries, "duration": 3e-6,
        "faults.main.contact": contact(method).model_dump(), "faults.main.friction": {"kind": "coulomb", "mu_d": 0.9},
    })  # fmt: skip
    model = Model(loaded)
    motion, state = loaded.stepper.bind(model), model.initial_state()
    # Hooke's law in plane stress: strain = ((1 + nu) stress - nu trace 1) / E.
    E, nu = HOMALITE["young_modulus"], HOMALITE["poisson_ratio"]
    strain = ((1 + nu) * added - nu * np.trace(added) * np.eye(2)) / E
    fields = state.displacement.reshape(-1, 2)
    fields[:] = model.coordinates @ strain
    # The interface opens and shears until it carries that (rigid: not at all); the plus body moves.
    upper = np.unique(model.space.dofmap.list[model.bodies.cell_body == model.bodies.names.index("upper")])
    opened, sheared = jump_under(model.faults[0].contact, 6e6, n @ added @ n, t @ added @ n)
    fields[upper] += opened * n + sheared * t
    for _ in range(20):
        motion.step(state)
    # Speeds against those of a wave of 2 MPa: sigma / (rho c) = 0.8 m/s.
    assert np.max(np.abs(state.velocity)) < 1e-10
    fault = state.faults["main"]
    np.testing.assert_allclose(fault["normal_stress"], 6e6 - n @ added @ n, rtol=1e-9)
    np.testing.assert_allclose(fault["shear_traction"], t @ added @ n, rtol=1e-7)


def test_stiff_compliant_contact_is_split_node_contact() -> None:
    """The difference falls as 1 / C: the jump of an elastic interface is traction / C."""
    common = {
        "order": 2, "duration": 4e-6, "mesh.element_size": 1e-3,
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.1},
        "boundaries": [{"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 5.0, "ramp": 2e-6}],
        "stepper": {"kind": "leapfrog", "time_step": 1e-8},
    }  # fmt: skip
    rigid = march(case({**common, "faults.main.contact": {"kind": "split_node"}}))[2].faults["main"]["slip"]
    stiff = []
    for factor in (1, 4, 16):
        method = {"kind": "compliant", "C_n": factor * COMPLIANT["C_n"] * 3, "C_s": factor * COMPLIANT["C_s"] * 3}
        slip = march(case({**common, "faults.main.contact": method}))[2].faults["main"]["slip"]
        stiff.append(np.max(np.abs(slip - rigid)) / rigid.max())
    assert rigid.max() > 1e-6
    assert stiff[1] < 0.35 * stiff[0] and stiff[2] < 0.35 * stiff[1]
    assert stiff[2] < 0.02
