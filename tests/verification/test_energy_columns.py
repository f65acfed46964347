"""Every column of energy.csv against a number of its own, by hand: a column that is what others leave, or that shares
with another, closes the budget whatever it is.

The first are antiplane columns of two equal plates, which are as one-dimensional as a rod: their sides are free.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.sliding_cases import rough
from helpers.small_cases import COMPLIANT, HOMALITE, SPLIT, case

pytest.importorskip("dolfinx")

from benchmarks.collisions import Flight, pair
from ruptfx.case import parse_case
from ruptfx.input.fields import ENERGIES
from ruptfx.interfaces.mechanisms.rotations import LargeRotations
from ruptfx.interfaces.sliding.follower import Follower
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

LENGTH, HEIGHT = 12e-3, 4e-3  # of a plate
RHO = HOMALITE["density"]
G = HOMALITE["young_modulus"] / 2 / (1 + HOMALITE["poisson_ratio"])
C = np.sqrt(G / RHO)
RIGID = {"kind": "augmented_lagrangian"}
BOTTOM = {"kind": "driven", "edge": "lower.bottom", "component": "z", "velocity": 0.0}


def column(changes: dict[str, Any]) -> tuple[Any, Any]:
    """Motion and initial state of two plates under 6 MPa of pressure."""
    given = case({"plane": "antiplane", "order": 2, "faults.main.initial_stress.normal": 6e6, **changes})
    model = Model(given)
    return given.stepper.bind(model), model.initial_state()


def run(motion: Any, state: Any, until: float) -> dict[str, float]:
    """Go on to the first step whose energies are at a time [s] or later; the energies and their time."""
    while state.at_velocity()[0] < until * (1 - 1e-9):
        motion.step(state)
    return motion.energies(state) | {"time": state.at_velocity()[0]}


def expect(found: dict[str, float], expected: dict[str, float], tolerance: float) -> None:
    """All columns: those that are not named are zero; relative to the largest one."""
    assert set(expected) <= set(ENERGIES)
    whole = [expected.get(name, 0.0) for name in ENERGIES]
    scale = max(map(abs, whole))
    np.testing.assert_allclose([found[name] for name in ENERGIES], whole, rtol=0, atol=tolerance * scale)


@pytest.mark.parametrize("radiates", [False, True])
@pytest.mark.parametrize("contact", [{**COMPLIANT, "C_s": 1e12}, RIGID], ids=lambda contact: contact["kind"])
def test_equilibrium(contact: dict[str, Any], radiates: bool) -> None:
    """The top is driven at 2 m/s. From 1 MPa on the shear stress rises at k 2 m/s, where 1 / k = 2 H / G + 1 / C_s,
    until friction holds no more: 0.4 times 6 MPa, and Z / 2 times the slip rate of 2 m/s if waves radiate.

    Energies are those beyond the initial stress tau_0, which works on slip and on the stretch of the springs.
    """
    speed, tau_0, strength, duration = 2.0, 1e6, 2.4e6, 80e-6
    radiated = 0.5 * RHO * C * speed if radiates else 0.0
    motion, state = column({
        "duration": duration, "faults.main.contact": contact, "faults.main.initial_stress.shear": tau_0,
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.4},
        "boundaries": [BOTTOM, {**BOTTOM, "edge": "upper.top", "velocity": speed}],
        "stepper": {"kind": "quasi_static", "first_step": 1e-7, "largest_step": 4e-7, "slip_tolerance": 1.0,
                    "radiation_damping": radiates},
    })  # fmt: skip
    # Slides after 4 us; with waves the slip rate comes near 2 m/s with exp(-t / 4 us).
    early, late = run(motion, state, 70e-6), run(motion, state, duration)
    assert np.ptp(state.faults["main"]["slip"]) < 1e-9 * state.faults["main"]["slip"].max()
    # Between two times of steady sliding nothing but the work of the top and of the initial stress, what friction and
    # what waves take: per area (tau - tau_0) and tau_0, strength, and Z / 2 V, each times the way V t.
    way = LENGTH * speed * (late["time"] - early["time"])
    change = {name: late[name] - early[name] for name in ENERGIES}
    whole = strength + radiated
    expect(change, {"boundary_work": whole * way, "frictional_dissipation": strength * way, "damping": radiated * way},
           1e-4 if radiates else 1e-9)  # fmt: skip
    # Stress and with it what bodies and springs hold: (tau - tau_0)^2 / 2 G and (tau^2 - tau_0^2) / 2 C_s.
    stiffness = contact.get("C_s", np.inf)
    assert late["strain"] == pytest.approx(LENGTH * (whole - tau_0) ** 2 / G * HEIGHT, rel=1e-4)
    held = LENGTH * 0.5 * (whole**2 - tau_0**2) / stiffness
    assert late["interface_elastic"] == pytest.approx(held, rel=1e-4, abs=1e-9 * late["strain"])
    # The upper plate moves with the top, the lower one rests.
    assert late["kinetic"] == pytest.approx(0.5 * RHO * LENGTH * HEIGHT * speed**2, rel=1e-4)


LEAPFROG = {"kind": "leapfrog"}
AVERAGE = {"kind": "generalized_alpha", "scheme": "average_acceleration", "courant": 1.0}
# With what is left of the ringing behind the front, relative to the work.
SCHEMES = [
    (LEAPFROG, SPLIT, 1e-3), (LEAPFROG, COMPLIANT, 1e-3), (AVERAGE, COMPLIANT, 1e-3), (AVERAGE, RIGID, 1e-3),
    ({"kind": "petsc_ts", "courant": 1.0}, COMPLIANT, 6e-3),
]  # fmt: skip


names = [f"{stepper['kind']}-{contact['kind']}" for stepper, contact, _ in SCHEMES]


@pytest.mark.parametrize("stepper, contact, tolerance", SCHEMES, ids=names)
def test_waves_of_a_sudden_stress_drop(stepper: dict[str, Any], contact: dict[str, Any], tolerance: float) -> None:
    """From 3 MPa to a friction of 2.4 MPa: V = 2 (tau_0 - tau_d) / Z, half of it in either plate, which the wave has
    filled when it leaves by the absorbing edges: those take Z (V / 2)^2 each, friction tau_d V, and tau_0 V comes in.

    Per volume both kinetic and strain energy are rho (V / 2)^2 / 2.
    """
    tau_0, tau_d = 3e6, 2.4e6
    rate = 2 * (tau_0 - tau_d) / (RHO * C)
    motion, state = column({
        "duration": 40e-6, "faults.main.contact": contact, "faults.main.initial_stress.shear": tau_0,
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.4}, "stepper": stepper,
        "boundaries": [{"kind": "absorbing", "edge": edge} for edge in ("upper.top", "lower.bottom")],
    })  # fmt: skip
    early, late = run(motion, state, 20e-6), run(motion, state, 40e-6)  # 4 mm take 3.2 us
    way = LENGTH * rate * (late["time"] - early["time"])
    change = {name: late[name] - early[name] for name in ENERGIES}
    radiated = 0.5 * RHO * C * rate
    expect(change, {"boundary_work": tau_0 * way, "frictional_dissipation": tau_d * way, "damping": radiated * way},
           tolerance)  # fmt: skip
    assert tau_0 == pytest.approx(tau_d + radiated)
    for name in ("kinetic", "strain"):
        assert late[name] == pytest.approx(RHO * (rate / 2) ** 2 / 2 * 2 * HEIGHT * LENGTH, rel=0.05)


@pytest.mark.parametrize("damping, stepper", [
    pytest.param(damping, stepper, id=f"{name}-{stepper['kind']}", marks=[pytest.mark.slow] * (stepper is slow))
    for stepper in (LEAPFROG, AVERAGE) for name, damping, slow in (
        ("mass", {"mass": 4e4}, None), ("thickness", {"kelvin_voigt": {"eta": 1e-7, "thickness": 1.0}}, AVERAGE),
        ("bodies", {"kelvin_voigt": {"eta": 1e-7, "bodies": ["upper", "lower"]}}, None),
    )
])  # fmt: skip
def test_damping_of_a_mode(stepper: dict[str, Any], damping: dict[str, Any]) -> None:
    """Glued plates with free ends: u = A cos(pi y / 2 H), omega = pi c / 2 H. Mass damping a makes it decay with
    exp(-a t / 2), viscosity eta with exp(-eta omega^2 t / 2), its energy twice as fast; all of that is `damping`."""
    omega, amplitude = np.pi * C / (2 * HEIGHT), 1e-6
    decay = damping["mass"] if "mass" in damping else damping["kelvin_voigt"]["eta"] * omega**2
    glued = {"kind": "compliant", "C_n": 1e14, "C_s": 1e14} if stepper is AVERAGE else SPLIT
    motion, state = column({
        "order": 3, "duration": 30e-6, "faults.main.contact": glued, "damping": damping,
        "stepper": {**stepper, "courant": 1.0} if stepper is AVERAGE else {**stepper, "safety": 0.3},
    })  # fmt: skip
    model = motion.model
    # The mode is odd about the interface: cos(pi (y + H) / 2 H) over both plates.
    state.displacement[:] = -amplitude * np.sin(0.5 * np.pi * model.coordinates[:, 1] / HEIGHT)
    # Strain energy G (A pi / 2 H)^2 / 2 times the volume times the mean of a squared cosine.
    begun = 0.25 * G * (amplitude * np.pi / (2 * HEIGHT)) ** 2 * 2 * HEIGHT * LENGTH
    # After whole half periods what the phase changes is gone: a t is half the time of the true oscillation.
    found = run(motion, state, 6 * np.pi / omega)
    left = begun * np.exp(-decay * found["time"])
    assert found["damping"] == pytest.approx(begun - left, rel=5e-3)
    assert found["kinetic"] + found["strain"] + found["interface_elastic"] == pytest.approx(left, rel=5e-3)
    assert left < 0.7 * begun


def test_plastic_impact() -> None:
    """A block comes down on a rigid base at 3 m/s: its lowest nodes stop at once, and lose rho L (h / 2) v^2 / 2 where
    elements of order 1 are h high; what is above them loses nothing, and turns back after they have stopped."""
    speed, size = 3.0, 1e-3
    mesh = {"kind": "block_on_rigid", "length": LENGTH, "height": HEIGHT, "element_size": size}
    given = case({"order": 1, "mesh": mesh, "faults.main.contact": SPLIT, "faults.main.initial_stress.normal": 0.0})
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    state.velocity[1::2] = -speed
    for _ in range(5):
        motion.step(state)
        found = motion.energies(state)
        assert found["impact_loss"] == pytest.approx(0.5 * RHO * LENGTH * 0.5 * size * speed**2, rel=1e-12)
    assert state.faults["main"]["opening"].max() == 0 and state.faults["main"]["normal_stress"].min() > 0
    assert found["frictional_dissipation"] == found["damping"] == found["boundary_work"] == 0
    whole = 0.5 * RHO * LENGTH * HEIGHT * speed**2
    assert found["kinetic"] + found["strain"] + found["impact_loss"] == pytest.approx(whole, rel=1e-12)


def test_springs_that_close_and_open_within_steps() -> None:
    """A block comes down on springs, 0.13 um below, and jumps off again: `impact_loss` of the step of a transition is
    the mean traction times the way of the open contact in it, of either sign."""
    speed, gap = 3.0, 0.13e-6
    mesh = {"kind": "block_on_rigid", "length": LENGTH, "height": HEIGHT, "element_size": 1e-3}
    springs = {"kind": "compliant", "C_n": 1e13, "C_s": 1e13}
    given = case({"order": 1, "mesh": mesh, "faults.main.contact": springs, "faults.main.initial_stress.normal": 0.0,
                  "faults.main.gap": gap})  # fmt: skip
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    state.velocity[1::2] = -speed
    whole, fields, losses, by_hand = 0.5 * RHO * LENGTH * HEIGHT * speed**2, state.faults["main"], [], []
    area = model.faults[0].interface.weight
    while state.time < 8e-6:
        old = fields["normal_stress"].copy(), fields["opening"].copy()
        before = state.energy["impact_loss"]
        motion.step(state)
        losses.append(state.energy["impact_loss"] - before)
        by_hand.append(area @ (0.5 * (old[0] + fields["normal_stress"]) * (old[1] - fields["opening"])))
        found = motion.energies(state)
        kept = sum(found[name] for name in ("kinetic", "strain", "interface_elastic", "frictional_dissipation"))
        assert kept + found["impact_loss"] == pytest.approx(whole, rel=1e-12)
    np.testing.assert_allclose(losses, by_hand, rtol=0, atol=1e-15 * whole)
    assert fields["opening"].min() > gap and max(losses) > 1e-6 * whole and min(losses) < -1e-6 * whole


def test_what_collisions_lose_is_the_error_of_the_step() -> None:
    """`collision_loss` is what is left of the work of contact when its energy and friction are taken off. With steps a
    third of the stable ones little is: a hundredth of a wrong energy or friction would be more than all of it."""
    bodies = {
        name: {"kind": "rectangle", "center": [x, 0.0], "width": 2e-3, "height": 2e-3}
        for name, x in (("left", 0.0), ("right", 2.0005e-3))
    }
    flight = Flight(pair(bodies, 0.5, 2e-6, {
        "initial_velocity": {"left": [5.0, 0.0], "right": [-5.0, 3.0]},
        "stepper": {"kind": "leapfrog", "time_step": 2e-9},
    }))  # fmt: skip
    rows = []
    while flight.state.time < 2e-6:
        flight.motion.step(flight.state)
        rows.append(flight.motion.energies(flight.state))
    held, loss = (np.abs([row[name] for row in rows]) for name in ("collisions", "collision_loss"))
    assert held[-1] == 0 and held.max() > 0.1 * rows[-1]["boundary_work"]  # they have met, and are apart again
    assert loss.max() < 5e-4 * held.max()
    assert loss[-1] < 5e-3 * rows[-1]["frictional_dissipation"]


def test_turning_of_a_stretched_and_turned_block() -> None:
    """A step from rest to F = R U, stretched by e along x in the frame of the bodies and turned by an angle a.

    The energy of volume V goes from 0 to W = (lambda + 2 G) e^2 V / 2, and the force of the bodies from 0 to that of
    the stress P = R diag(lambda + 2 G, lambda) e. The mean of both does the work -V P : (R U - 1) / 2 =
    -V e ((lambda + 2 G) (1 + e - cos a) + lambda (1 - cos a)) / 2. That and W differ by V e (lambda + G) (1 - cos a).
    """
    e, angle, dt, length, height = 1e-3, 0.3, 1e-7, 4e-3, 2e-3
    plate = {"kind": "rectangle", "center": [0.0, 0.0], "width": length, "height": height}
    given = case({
        "plane": "strain", "order": 1, "large_rotations": True, "faults": {}, "boundaries": [],
        "mesh": {"kind": "pieces", "element_size": 1e-3, "bodies": {"plate": plate}},
    })  # fmt: skip
    model = Model(given)
    state, rotations = model.initial_state(), LargeRotations(model)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = (model.coordinates @ (turn @ np.diag([1 + e, 1.0]) - np.eye(2)).T).ravel()
    kick: Any = SimpleNamespace(clock=SimpleNamespace(since=dt))
    for displacement, velocity in ((0 * moved, 0 * moved), (moved, moved / dt)):
        state.displacement[:], state.velocity[:] = displacement, velocity
        state.force[:] = 0.0
        model.internal_force(state.displacement, out=state.force)
        rotations.add_internal(state, kick)
    state.velocity[:] = 0.0
    E, nu = HOMALITE["young_modulus"], HOMALITE["poisson_ratio"]
    lame = E * nu / ((1 + nu) * (1 - 2 * nu))
    volume = length * height
    found = model.energies(state)
    assert found["strain"] == pytest.approx(0.5 * (lame + 2 * G) * e**2 * volume, rel=1e-9)
    assert found["rotation_error"] == pytest.approx(volume * e * (lame + G) * (1 - np.cos(angle)), rel=1e-9)


def test_facing_of_a_flat_surface_that_slides_past_a_kink() -> None:
    """Nodes of both surfaces are a distance d apart, above each other; the lower surface falls from its node 3 on.

    The upper one comes down by 0.3 d and slides by d, so that its point i faces node i + 1 in place of node i. Springs
    store w (sigma^2 / C_n + tau^2 / C_s) / 2, with sigma = C_n times the overlap along the normal of the opposite
    surface. What they are stretched along the tangent, beyond the slip, does not change. The tangent at a point is the
    mean of the unit tangents opposite to its two facets.
    """
    d, fall, C_n, C_s = 1e-4, 0.1, 3e13, 1e13
    ends = [-2 * d, 3 * d, 8 * d]
    low = {"kind": "table", "positions": ends, "values": [0.0, 0.0, -5 * d * fall]}
    body = {"length": 4 * d, "height": 2 * d, "element_size": d, "left": 0.0, "profile": 0.0}
    given = parse_case(rough({
        "order": 1, "mesh.curve_order": 1, "mesh.upper": body,
        "mesh.lower": {**body, "length": 10 * d, "left": -2 * d, "profile": low},
        "faults.main.contact": {"kind": "compliant", "C_n": C_n, "C_s": C_s},
    }))  # fmt: skip
    model = Model(given)
    state, fault = model.initial_state(), model.faults[0]
    motion = np.array([d, -0.3 * d])
    state.displacement.reshape(-1, 2)[model.coordinates[:, 1] > -1e-3 * d] = motion
    state.displacement.reshape(-1, 2)[fault.interface.nodes[5:]] = 0.0  # of the lower surface

    heights = np.array([0.0, 0.0, 0.0, 0.0, -fall * d, -2 * fall * d])  # of nodes 0 to 5 of the lower surface
    facets = np.array([[1.0, 0.0]] * 3 + [[1.0, -fall]] * 2) / np.array([1.0] * 3 + [np.hypot(1.0, fall)] * 2)[:, None]
    weight = d * np.array([0.5, 1.0, 1.0, 1.0, 0.5])

    def springs(first: int) -> tuple[np.ndarray, np.ndarray]:
        """Overlap along the normals and motion along the tangents if point 0 faces node `first`."""
        seen = facets[first : first + 4]
        tangent = np.vstack([seen[:1], 0.5 * (seen[1:] + seen[:-1]), seen[-1:]])
        tangent /= np.hypot(*tangent.T)[:, None]
        apart = motion + np.column_stack([-first * d * np.ones(5), -heights[first : first + 5]])
        return tangent[:, 1] * apart[:, 0] - tangent[:, 0] * apart[:, 1], tangent @ motion

    stretch = 1e-6
    (overlap, along), (later, _) = springs(0), springs(1)
    assert overlap.min() > 0 and later.min() > 0
    fields = state.faults["main"]
    order = np.argsort(fault.interface.points[:, 0])
    fields["normal_stress"][order], fields["shear_traction"][:] = C_n * overlap, C_s * stretch
    fields["slip"][order] = along - stretch
    Follower(fault)(state)
    np.testing.assert_allclose(fields["normal_stress"][order], C_n * later, rtol=1e-9)
    np.testing.assert_allclose(fields["shear_traction"], C_s * stretch, rtol=1e-9)
    before, after = weight @ (0.5 * C_n * overlap**2), weight @ (0.5 * C_n * later**2)
    assert abs(before - after) > 0.05 * before
    assert state.energy["pairing_update_loss"] == pytest.approx(before - after, rel=1e-9)


def test_new_partners_of_points_that_cohesion_still_pulls() -> None:
    """Flat bodies apart by 3 um, half damaged at 5 um: the tension 1 MPa w / 5 um stretches springs and opens w."""
    d, C_n, gap = 1e-4, 3e13, 3e-6
    body = {"length": 4 * d, "height": 2 * d, "element_size": d, "left": 0.0, "profile": 0.0}
    model = Model(parse_case(rough({
        "order": 1, "mesh.curve_order": 1, "mesh.upper": body,
        "mesh.lower": {**body, "length": 10 * d, "left": -2 * d},
        "faults.main.contact": {"kind": "compliant", "C_n": C_n, "C_s": 1e13},
        "faults.main.cohesion": {"kind": "linear", "f_t": 2e6, "c": 4e6, "G_Ic": 10.0, "G_IIc": 40.0},
    })))  # fmt: skip
    state, fault = model.initial_state(), model.faults[0]
    state.displacement.reshape(-1, 2)[fault.interface.plus] = d, gap
    fields = state.faults["main"]
    fields["damage"][:], fields["largest_opening"][:], fields["slip"][:] = 0.5, 5e-6, d
    Follower(fault)(state)
    opening = gap / (1 + 1e6 / 5e-6 / C_n)
    np.testing.assert_allclose(fields["opening"], opening, rtol=1e-9)
    np.testing.assert_allclose(fields["normal_stress"], -1e6 * opening / 5e-6, rtol=1e-9)


def test_mass_damping_takes_the_first_half_step_once() -> None:
    """Two plates that fly as one body lose kinetic energy to `damping` alone, from the first half step on."""
    model = Model(case({
        "order": 2, "faults.main.contact": SPLIT, "damping.mass": 1e5,
        "initial_velocity": {"upper": [1.0, 0.0], "lower": [1.0, 0.0]},
    }))  # fmt: skip
    motion, state = model.case.stepper.bind(model), model.initial_state()
    begun = 0.5 * RHO * 2 * LENGTH * HEIGHT
    energies = run(motion, state, 20 * motion.dt)
    lost = begun * -np.expm1(-2 * 1e5 * energies["time"])
    assert energies["damping"] == pytest.approx(lost, rel=1e-2) and lost > 0.1 * begun
    damping = energies["damping"]
    expect(energies, {"boundary_work": begun, "kinetic": begun - damping, "damping": damping}, 1e-9)


def test_materials_dissipate_what_they_do_at_small_steps() -> None:
    """`material_dissipation` at one time between two records is of second order in the step.

    Half a step of force times velocity would be 1.5 % of it, and the budget closes with it, since `strain` takes it.
    """
    solid = {**HOMALITE, "kind": "standard_linear_solids", "Q_p": 25.0, "Q_s": 15.0, "lowest_frequency": 5e4,
             "frequency_ratio": 10.0}  # fmt: skip
    push = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 20.0, "ramp": 8e-6}
    losses = []
    for number in (80, 160):
        given = case({
            "order": 2, "plane": "strain", "materials.default": solid, "duration": 9e-6, "boundaries": [push],
            "stepper": {"kind": "leapfrog", "time_step": 8e-6 / number},
        })  # fmt: skip
        model = Model(given)
        motion, state = given.stepper.bind(model), model.initial_state()
        records = []
        while state.fault_time < 8e-6:
            state.wants_energies = True
            motion.step(state)
            records.append((state.fault_time, motion.energies(state)["material_dissipation"]))
        losses.append(np.interp(8e-6, *zip(*records[-2:], strict=True)))
    assert losses[0] == pytest.approx(losses[1], rel=2e-3)
