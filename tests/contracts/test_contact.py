"""Every contact method of the folder, with every friction law: the C step is the reference step, patches stay still."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from reference_step import advance_reference
from small_cases import COMPLIANT, HOMALITE, case, march, tilted

from ruptfx.check_law.examples import friction, friction_laws, table

pytest.importorskip("dolfinx")

from ruptfx.contact import Point
from ruptfx.fault import Fault
from ruptfx.fault_step import Clock, FaultStep, impedances
from ruptfx.friction.coulomb import Coulomb
from ruptfx.interface import Interface, Line
from ruptfx.model import Model
from ruptfx.schema import alternatives

pytestmark = pytest.mark.fem

METHODS = {kind: cls for kind, cls in alternatives("ruptfx.contact").items() if cls.explicit}
every_method = pytest.mark.parametrize("method", METHODS)
LAWS = friction_laws()
every_law = pytest.mark.parametrize("kind, held", LAWS, ids=["-".join(filter(None, law)) for law in LAWS])
POINTS = 101  # not a multiple of the points that the C code does at a time


def contact(method: str, seed: int = 0) -> Any:
    cls = METHODS[method]
    return cls.model_validate(table(cls, seed))


def an_interface(components: int, random: np.random.Generator) -> Interface:
    """Points with random frames and weights; no mesh."""
    local = components
    frame = np.linalg.qr(random.normal(size=(POINTS, components, components)))[0]
    nodes = random.permutation(2 * POINTS)
    return Interface(
        points=random.normal(size=(POINTS, max(2, components))),
        position=np.linspace(0, 1, POINTS), number=np.arange(POINTS),
        plus=nodes[:POINTS], minus=nodes[POINTS:], frame=frame.reshape(POINTS, local, components),
        weight=random.uniform(0.5e-4, 1e-4, POINTS), owned=random.random(POINTS) < 0.8, total=POINTS,
        line=Line("x", np.zeros(max(2, components)), 0.0, 1.0),
    )  # fmt: skip


def a_fault(method: str, law: Any, components: int, random: np.random.Generator) -> Fault:
    face = an_interface(components, random)
    normal = np.where(random.random(POINTS) < 0.1, 0.0, random.uniform(1e5, 1e7, POINTS))
    shear = random.normal(size=(POINTS, face.tangents)) * 1e5
    return Fault("main", face, contact(method), law.at(face.position), normal, shear)


def steps_agree(fault: Fault, components: int, random: np.random.Generator) -> tuple[float, float, float]:
    """Largest relative difference of C and reference over a few steps on random motion, the start among them; largest
    share of points that were open at once, and share of those that slid at some time."""
    dt, threshold = 1e-7, 1e-3
    inverse = np.repeat(random.uniform(1e4, 1e5, 2 * POINTS), components)
    driven = fault.interface.plus[random.random(POINTS) < 0.1] * components
    inverse[driven] = 0  # driven nodes, on one side and in one direction
    clocks, law = [Clock.of_step(dt, number) for number in range(8)], fault.traced_law()
    compiled = [FaultStep(fault, inverse, clock, threshold) for clock in clocks]
    ours, theirs = fault.initial_state(), fault.initial_state()
    worst, opened, slid = 0.0, 0.0, np.zeros(POINTS, dtype=bool)
    # Jumps that change the normal stress by a few MPa: C_n u, or Z u / dt with Z near 1e6 Pa s/m.
    size = 4e6 / (fault.contact.stiffness()[0] or 1e13)

    def compare(a: np.ndarray, b: np.ndarray, scale: float = 0.0) -> None:
        nonlocal worst
        np.testing.assert_array_equal(np.isnan(a), np.isnan(b))
        scale = scale or np.nanmax(np.abs(b), initial=0.0)
        if scale > 0:
            worst = max(worst, float(np.nanmax(np.abs(a - b))) / scale)

    for step, clock in enumerate(clocks):
        displacement = random.normal(size=len(inverse)) * size
        velocity, force = random.normal(size=(2, len(inverse))) * [[2.0], [1e3]]
        mine, forces = velocity.copy(), force.copy()
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
        for name in theirs:
            compare(ours[name], theirs[name])
        opened = max(opened, float(np.mean(theirs["normal_stress"] == 0)))
        slid |= power > 0
    return worst, opened, float(slid.mean())


@every_method
@every_law
def test_compiled_step_is_the_reference_step(method: str, kind: str, held: str | None) -> None:
    random = np.random.default_rng(7)
    worst, opened, slid = steps_agree(a_fault(method, friction(kind, held, profiles=True), 2, random), 2, random)
    # Both stop when the residual is below 1e-13 of the trial traction.
    assert worst < 1e-10
    assert 0.05 < opened < 0.95 and slid > 0.05


@every_method
@pytest.mark.parametrize("components", [1, 3])
@pytest.mark.parametrize("kind, held", [("coulomb", None), ("prakash_clifton", "rate_and_state_power_law")])
def test_compiled_step_in_antiplane_and_3d(method: str, components: int, kind: str, held: str | None) -> None:
    random = np.random.default_rng(3)
    worst, *_ = steps_agree(a_fault(method, friction(kind, held), components, random), components, random)
    assert worst < 1e-10


@every_method
def test_compiled_step_with_a_gap(method: str) -> None:
    random = np.random.default_rng(11)
    fault = a_fault(method, friction("coulomb", None), 2, random)
    size = 4e6 / (fault.contact.stiffness()[0] or 1e13)
    worst, opened, _ = steps_agree(replace(fault, gap=random.uniform(0, 2 * size, POINTS)), 2, random)
    assert worst < 1e-10
    assert 0.05 < opened < 0.99


@every_method
def test_failure_names_the_point(method: str) -> None:
    from ruptfx.projection import ProjectionError

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
            fault, fault.traced_law(), fault.initial_state(), displacement, velocity, np.zeros(4 * POINTS),
            np.ones(4 * POINTS), Clock.of_step(1e-7), 2e-6, 1e-3,
        ),
    ):
        with pytest.raises(ProjectionError, match=r"coulomb: the trial traction is not a number.*point 13 .*'main'"):
            step()


@every_method
def test_trial_is_what_stops_the_jump(method: str) -> None:
    """With the trial traction as force the bodies' jump ends where the method wants it."""
    random = np.random.default_rng(5)
    fault = a_fault(method, Coulomb(mu_d=0.3), 2, random)
    face, dt = fault.interface, 1e-7
    inverse = np.repeat(random.uniform(1e4, 1e5, 2 * POINTS), 2)
    z_n, z_s = impedances(face, inverse, dt)
    displacement, velocity = random.normal(size=(2, 4 * POINTS)) * [[1e-6], [1.0]]
    (opening, slip), (opening_rate, slip_rate) = face.split(face.jump(displacement)), face.split(face.jump(velocity))
    trial = fault.contact.trial(Point(
        fault.normal_stress_0, list(fault.shear_traction_0.T), opening, list(slip.T), opening_rate, list(slip_rate.T),
        list(0 * slip.T), dt, dt, z_n, list(z_s.T),
    ))  # fmt: skip
    pressed = fault.normal_stress_0 - trial.normal_stress
    dragged = trial.shear_traction[0] - fault.shear_traction_0[:, 0]
    change = np.stack([pressed, dragged], axis=1)
    face.add_force(velocity, dt * change, scale=inverse)
    normal, shear = face.split(face.jump(velocity))
    C_n, C_s = fault.contact.stiffness()
    if C_n == 0:
        # Rigid: no slip rate, and a gap that closes within the step.
        assert np.max(np.abs(shear)) < 1e-12
        assert np.max(np.abs(opening + dt * normal)) < 1e-18
    else:
        # Springs: trial = initial stress and C times the jump.
        np.testing.assert_allclose(change[:, 0], C_n * opening, rtol=1e-9, atol=1e-3)
        np.testing.assert_allclose(change[:, 1], C_s * slip[:, 0], rtol=1e-9, atol=1e-3)
        np.testing.assert_allclose(trial.impedance[0], dt * C_s)
        np.testing.assert_allclose(trial.normal_compliance, 1 / C_n)


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
@pytest.mark.parametrize("angle", [0.0, 0.6, 2.5])
@pytest.mark.parametrize("order", [2, 4])
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
    # The interface opens by T_n / C_n and shears by T_t / C_s (rigid: not at all); the plus body moves.
    C_n, C_s = model.faults[0].contact.stiffness()
    if C_n:
        upper = np.unique(model.space.dofmap.list[model.bodies.cell_body == model.bodies.names.index("upper")])
        fields[upper] += (n @ added @ n) / C_n * n + (t @ added @ n) / C_s * t
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
