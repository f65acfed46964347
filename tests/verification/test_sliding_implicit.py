"""Interfaces that slide in implicit steps: closed forms, laws of motion, geometry that converges, runs and restarts."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.sliding_cases import STIFF, rough
from helpers.small_cases import HOMALITE, merged, plates
from helpers.whole_runs import assert_goes_on_with_the_same_bits, run_of, run_on
from scipy.integrate import solve_ivp

pytest.importorskip("dolfinx")

from helpers.messages import facts

from benchmarks import westergaard
from ruptfx import RuptfxError
from ruptfx.bodies.state import State
from ruptfx.case import parse_case
from ruptfx.results.record import Record
from ruptfx.run import stages
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import ConvergenceError, condensed
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.steppers.quasi_static import EASY

pytestmark = pytest.mark.fem

CONTACTS: dict[str, dict[str, Any]] = {
    "augmented_lagrangian": {"kind": "augmented_lagrangian", "tolerance": 1e-12},
    "compliant": {"kind": "compliant", "C_n": 3e11, "C_s": 3e11},
}
RIGID = {"kind": "augmented_lagrangian"}
every_contact = pytest.mark.parametrize("contact", CONTACTS)


def held(edge: str, axes: str = "xy") -> list[dict[str, object]]:
    return [{"kind": "driven", "edge": edge, "component": axis, "velocity": 0.0} for axis in axes]


def started(table: dict[str, Any]) -> tuple[Model, Any, State]:
    given = parse_case(table)
    model = Model(given)  # type: ignore[arg-type]
    return model, given.stepper.bind(model), model.initial_state()  # type: ignore[union-attr]


# -- patch test, matching meshes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2, 4])
@every_contact
def test_uniform_stress_passes_between_different_meshes(contact: str, order: int) -> None:
    """16 on 11 elements: compression and shear on top of the initial stress, without strain along the interface.

    Where contact is compliant shear would move the ends of one side past those of the other.
    """
    E, nu, shear = HOMALITE["young_modulus"], HOMALITE["poisson_ratio"], 0.7e6 * (contact != "compliant")
    added = np.array([[-nu * 2e6, shear], [shear, -2e6]])  # plane stress
    boundaries: list[dict[str, object]] = held("lower.bottom")
    for edge, n in {"upper.top": (0, 1), "upper.left": (-1, 0), "lower.left": (-1, 0), "upper.right": (1, 0),
                    "lower.right": (1, 0)}.items():  # fmt: skip
        traction = (added @ np.array(n, float)).tolist()
        boundaries.append({"kind": "traction", "edge": edge, "traction": traction, "ramp": 1.0})
    body = {"length": 8e-3, "height": 2e-3}
    model, motion, state = started(merged(rough(), {
        "plane": "stress", "order": order, "boundaries": boundaries, "duration": 1.0,
        "materials": {"default": HOMALITE},
        "mesh": {"kind": "rough_plates", "curve_order": 1, "upper": {**body, "element_size": 0.5e-3},
                 "lower": {**body, "element_size": 8e-3 / 11}},
        "faults.main": {"sliding": {}, "contact": CONTACTS[contact], "friction": {"kind": "coulomb", "mu_d": 0.9},
                        "initial_stress": {"normal": 6e6}},
        "stepper": {"kind": "quasi_static", "first_step": 0.5, "largest_step": 0.5},
    }))  # fmt: skip
    for _ in range(2):
        motion.step(state)
    fault = state.faults["main"]
    np.testing.assert_allclose(fault["normal_stress"], 8e6, rtol=1e-9)
    np.testing.assert_allclose(fault["shear_traction"], shear, rtol=1e-8, atol=1e-3)
    top = np.isclose(model.coordinates[:, 1], model.coordinates[:, 1].max())
    moved = state.displacement.reshape(-1, 2)[top, 0]
    np.testing.assert_allclose(moved, 4e-3 * 2 * (1 + nu) / E * shear, rtol=1e-9, atol=1e-15)


@every_contact
def test_matching_nodes_give_what_pairs_give(contact: str) -> None:
    """As long as slip, here 0.1 nm, is next to nothing against the elements, 1 mm."""
    found = []
    for sliding in ({}, None):
        given = parse_case(plates({
            "order": 2, "faults.main.contact": CONTACTS[contact], "faults.main.sliding": sliding,
            "faults.main.friction": {"kind": "coulomb", "mu_d": 0.2},
            "faults.main.initial_stress": {"normal": 600.0, "shear": 100.0}, "stepper": {"kind": "quasi_static"},
            "boundaries": [*held("lower.bottom"),
                           {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1.2e-10}],
        }))  # fmt: skip
        model = Model(given)  # type: ignore[arg-type]
        equilibrium, state = Equilibrium(model), model.initial_state()
        for _ in range(5):
            equilibrium.solve(state, 0.2).commit(state)
        found.append(state)
    ours, pairs = found
    assert 0 < np.mean(pairs.faults["main"]["slip"] > 1e-3 * pairs.faults["main"]["slip"].max()) < 1
    np.testing.assert_allclose(ours.displacement, pairs.displacement, atol=1e-5 * np.abs(pairs.displacement).max())
    for name in ("slip", "normal_stress", "shear_traction", "friction_work"):
        values = pairs.faults["main"][name]
        np.testing.assert_allclose(ours.faults["main"][name], values, atol=1e-5 * np.abs(values).max())


# -- closed forms --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sides", ["opposed", "one"])
def test_westergaard_pressed_by_a_force(sides: str) -> None:
    """Opposed waves, or one of twice the amplitude on a flat body, touching in one point at first, with an upper body
    that only contact holds; in five steps."""
    given = westergaard.implicit(1.3, 0.2)
    if sides == "one":
        double = {"amplitude": -2 * westergaard.AMPLITUDE, "mean": 2 * westergaard.AMPLITUDE}
        wave = {"kind": "sinusoid", "wavelength": westergaard.WAVELENGTH, **double}
        given = given.changed("mesh.upper.profile", wave).changed("mesh.lower.profile", 0.0)
    model = Model(given)
    motion, state, shares = given.stepper.bind(model), model.initial_state(), []
    while state.time < 1 - 1e-9:
        motion.step(state)
        x, weight, pressure = westergaard.pressures(model, state)
        shares.append(1.3 * min(state.time, 1.0))
        wanted = westergaard.exact(x, shares[-1])
        assert weight @ np.abs(pressure - wanted) < 0.01 * weight @ wanted
        np.testing.assert_allclose(pressure.max(), wanted.max(), rtol=0.003)
        width = westergaard.WAVELENGTH / np.pi * np.arcsin(min(1.0, np.sqrt(shares[-1])))
        np.testing.assert_allclose(x[pressure > 0].max(), width, atol=np.diff(x).max())
    np.testing.assert_allclose(shares, [0.26, 0.52, 0.78, 1.04, 1.3])


def test_an_iteration_that_has_reached_rounding_has_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Below the tolerance no iteration counts as diverged, and the iterations that decide the next step stay few."""
    given = westergaard.implicit(1.3, 0.2)
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    balance, ends = condensed.Condensed.balance, []

    def observed(solver: condensed.Condensed, step: Any, *rest: Any, **options: Any) -> Any:
        found = balance(solver, step, *rest, **options)
        ends.append((found is not None, solver.history[-1] / rest[0].enough, solver.iterations / solver.outer))
        return found

    monkeypatch.setattr(condensed.Condensed, "balance", observed)
    motion.step(state)
    assert len(ends) > 2 and all(converged for converged, left, _ in ends if left <= 1)
    assert ends[-1][2] < 0.75 * EASY  # where steps begin to stop growing


def bump(changes: dict[str, Any]) -> dict[str, Any]:
    """A cylinder of 10 mm on a plane, 4 elements on 3 in a half-width of 0.1 mm; both bodies are held by far edges."""
    radius, half_width = 10e-3, 0.1e-3
    height = 8 * half_width
    plate = {"length": 2 * height, "height": height, "growth": 1.35}
    return merged({
        "plane": "strain", "order": 4, "duration": 1.0,
        "mesh": {
            "kind": "rough_plates", "curve_order": 2,
            "upper": {**plate, "element_size": half_width / 4,
                      "profile": {"kind": "parabola", "radius": radius, "center": height}},
            "lower": {**plate, "element_size": half_width / 3},
        },
        "materials": {"default": STIFF},
        "faults": {"main": {
            "sliding": {}, "contact": RIGID, "friction": {"kind": "coulomb", "mu_d": 0.0},
            "initial_stress": {"normal": 0.0},
        }},
        "boundaries": [
            *held("lower.bottom"), *held("upper.top", "x"),
            {"kind": "driven", "edge": "upper.top", "component": "y",
             "velocity": -0.25 * half_width**2 / radius * (np.log(8 * height / half_width) + 1)},
        ],
    }, changes)  # fmt: skip


@pytest.mark.slow
def test_hertz_between_different_meshes() -> None:
    """Pressed in five steps: within 2 % of the closed form for its force (Johnson 1985, section 4.2)."""
    model, motion, state = started(bump({"stepper": {"kind": "quasi_static", "largest_step": 0.2, "first_step": 0.2}}))
    while state.time < 1 - 1e-9:
        motion.step(state)
    face, pressure, radius = model.faults[0].interface, state.faults["main"]["normal_stress"], 10e-3
    force = face.weight @ pressure
    stiffness = STIFF["young_modulus"] / (2 * (1 - STIFF["poisson_ratio"] ** 2))
    a = np.sqrt(4 * force * radius / (np.pi * stiffness))
    exact = 2 * force / (np.pi * a) * np.sqrt(np.maximum(1 - ((face.position - 0.8e-3) / a) ** 2, 0))
    assert 0.08e-3 < a < 0.12e-3
    assert np.sqrt(face.weight @ (pressure - exact) ** 2 / (face.weight @ exact**2)) < 0.02
    np.testing.assert_allclose(pressure.max(), exact.max(), rtol=0.01)
    # Without shear at either end nothing is left over: forces are in balance, work is strain energy.
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    assert abs(work - sum(energy.values())) < 1e-10 * work
    assert abs(energy["damping"]) < 1e-6 * work and abs(energy["impact_loss"]) < 0.05 * work


# -- motion --------------------------------------------------------------------------------------------------------


def flat(changes: dict[str, Any]) -> dict[str, Any]:
    """A flat block of 0.6 on 0.3 mm on a long flat base, 8 on 9 elements per millimetre, of two materials."""
    block = {"length": 0.6e-3, "height": 0.3e-3, "element_size": 0.1e-3}
    return merged(rough(), {
        "mesh": {"kind": "rough_plates", "curve_order": 1, "upper": block,
                 "lower": {"left": -0.5e-3, "length": 2e-3, "height": 0.3e-3, "element_size": 0.117e-3}},
        "faults.main.contact": RIGID, "boundaries": held("lower.bottom"), **changes,
    })  # fmt: skip


SLOPE, G = 0.3, 3e7


def pull(model: Model, state: State, number: int = 0) -> np.ndarray:
    """Force of the upper body on the lower one [N/m]."""
    face, fault = model.faults[number].interface, state.faults[model.faults[number].name]
    local = np.column_stack([-fault["normal_stress"], fault["shear_traction"]])
    return np.asarray(np.einsum("i,ik,ikc->c", face.weight, local, face.frame))


def heavy(mu: float, stepper: dict[str, Any], ramp: float) -> dict[str, Any]:
    """Gravity that pulls as on a slope down to +x."""
    pull = [G * np.sin(SLOPE), -G * np.cos(SLOPE)]
    return flat({
        "boundaries": [*held("lower.bottom"), {"kind": "gravity", "acceleration": pull, "ramp": ramp}],
        "faults.main.friction": {"kind": "coulomb", "mu_d": mu}, "stepper": stepper,
    })  # fmt: skip


def test_a_block_rests_on_a_slope() -> None:
    """Friction holds its weight, and nothing moves on when the load is there."""
    model, motion, state = started(heavy(0.6, {"kind": "quasi_static", "largest_step": 0.25, "first_step": 0.25}, 1.0))
    while state.time < 1 - 1e-9:
        motion.step(state)
    fault, upper = state.faults["main"], model.layout.body == model.bodies.names.index("upper")
    weight = G * model.mass.reshape(-1, 2)[upper, 0].sum()
    np.testing.assert_allclose(pull(model, state), weight * np.array([np.sin(SLOPE), -np.cos(SLOPE)]), rtol=1e-8)
    assert not np.any(fault["slip"])
    rested = state.displacement.copy()
    motion.step(state)
    assert np.abs(state.displacement - rested).max() < 1e-6 * np.abs(rested).max()


def test_nothing_holds_a_block_on_a_steep_slope() -> None:
    _, motion, state = started(heavy(0.1, {"kind": "quasi_static", "largest_step": 0.25, "first_step": 0.25}, 1.0))
    with pytest.raises(ConvergenceError, match=facts(r"no equilibrium at time .* the step was halved 12 times")):
        while state.time < 1:
            motion.step(state)


def test_a_block_slides_down_a_slope() -> None:
    """With a = g (sin - mu cos), over three elements in 60 steps of 0.2 us, 16 times the explicit one."""
    step = {"kind": "generalized_alpha", "time_step": 0.2e-6}
    model, motion, state = started(heavy(0.1, step, 2e-6))
    upper = model.layout.body == model.bodies.names.index("upper")
    mass = model.mass.reshape(-1, 2)[:, 0] * upper

    def mean(field: np.ndarray) -> float:
        return float(mass @ field.reshape(-1, 2)[:, 0] / mass.sum())

    while state.time < 4e-6:
        motion.step(state)
    before, began = mean(state.velocity), state.time
    while state.time < 12e-6:
        motion.step(state)
    gained = (mean(state.velocity) - before) / (state.time - began)
    np.testing.assert_allclose(gained, G * (np.sin(SLOPE) - 0.1 * np.cos(SLOPE)), rtol=5e-3)
    assert mean(state.displacement) > 0.3e-3
    np.testing.assert_allclose(state.faults["main"]["slip"].mean(), mean(state.displacement), rtol=1e-2)


def spring_slider(stiffness: float, law: dict[str, float], pressure: float, speed: float, age: float) -> list[float]:
    """When a massless slider that is pulled from rest, tau = k (V t - s), slides 3, 10, 30 and 100 times as fast as it
    is pulled [s]."""
    a, b, D_c, f_0, V_0 = (law[name] for name in ("a", "b", "D_c", "f_0", "V_0"))

    def log_rate(time: Any, slip: Any, log_age: Any) -> Any:
        carried = stiffness * (speed * time - slip) / pressure
        return np.log(V_0) + (carried - f_0 - b * (np.log(V_0 / D_c) + log_age)) / a

    def slopes(time: float, y: np.ndarray) -> list[float]:
        rate = np.exp(log_rate(time, *y))
        return [rate, np.exp(-y[1]) - rate / D_c]

    events = []
    for times in (3, 10, 30, 100):
        events.append(lambda time, y, times=times: log_rate(time, *y) - np.log(times * speed))
    events[-1].terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(
        slopes, (0, 100.0), [0.0, np.log(age)], "LSODA", events=events, rtol=1e-9, atol=1e-14, max_step=0.05
    )
    return [float(when[0]) for when in found.t_events]


DIETERICH = {"a": 0.01, "b": 0.015, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-4}


def dragged(
    contact: dict[str, Any], law: dict[str, float], pressure: float, speed: float, press: float, age: float,
    stiffness: float,
) -> tuple[Model, Any, State]:  # fmt: skip
    """A stiff block pressed on a base, which then moves away under it, held by springs."""
    load = {"kind": "traction", "edge": "upper.top", "traction": [0.0, -pressure]}
    base = {"kind": "driven", "edge": "lower.bottom", "component": "x", "velocity": 0.0}
    fixed = [*held("lower.bottom", "y"),
             {"kind": "spring", "edge": "upper.top", "normal": 0.0, "tangential": stiffness}]  # fmt: skip
    given = parse_case(flat({
        "order": 1, "duration": press + 9.0, "mesh.upper.height": 0.05e-3,  # low, so that it does not tilt
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 5e9, "poisson_ratio": 0.0,
                                  "density": 1246.0}},
        "faults.main.contact": contact,
        "faults.main.friction": {"kind": "rate_and_state_ageing", **law, "theta_initial": age},
        "faults.main.initial_stress": {"normal": 0.0}, "boundaries": [],
        "stages": [{"duration": press, "boundaries": [*fixed, base, {**load, "ramp": 0.5}]},
                   {"duration": 9.0, "boundaries": [*fixed, {**base, "velocity": -speed}, load]}],
        "stepper": {"kind": "quasi_static", "slip_tolerance": 5e-9, "rate_tolerance": 5e-3},
    }))  # fmt: skip
    model = Model(given)  # type: ignore[arg-type]
    return model, stages.bind(model), model.initial_state()


STIFF_SPRINGS = {"kind": "compliant", "C_n": 1e13, "C_s": 1e13}


@pytest.mark.parametrize("contact", [STIFF_SPRINGS, RIGID])
def test_slip_nucleates_as_in_the_spring_slider(contact: dict[str, Any]) -> None:
    """Held by springs of half the critical stiffness it is dragged along, and slips as the massless slider runs away.
    Bodies are 0.15 % as compliant as the springs."""
    pressure, speed, press, age, law = 5e6, 1e-4, 1.0, 0.1, DIETERICH
    stiffness = 0.5 * (law["b"] - law["a"]) * pressure / law["D_c"]
    model, motion, state = dragged(contact, law, pressure, speed, press, age, stiffness)
    times, rates = [0.0], [1e-300]
    area, fault = model.faults[0].interface.weight, state.faults["main"]
    while rates[-1] < 100 * speed and state.step < 400:
        motion.step(state)
        times.append(state.time - press)
        rates.append(max(float(area @ fault["slip_rate"] / area.sum()), 1e-300))
    growing = slice(int(np.argmax(np.array(rates) > speed)), None)
    found = np.interp(np.log([3 * speed, 10 * speed, 30 * speed, 100 * speed]), np.log(rates[growing]), times[growing])
    expected = np.array(spring_slider(stiffness, law, pressure, speed, age + press))
    np.testing.assert_allclose(found, expected, rtol=3e-3)
    # Its last decades take a thousandth of the time.
    np.testing.assert_allclose(found[-1] - found[:-1], expected[-1] - expected[:-1], rtol=0.1)


@pytest.mark.parametrize("contact", [STIFF_SPRINGS, RIGID])
def test_pressed_at_slip_rates_next_to_nothing(contact: dict[str, Any]) -> None:
    """Where the direct effect is small, a = 0.001, rates are exp(-600) of the others: it rests, and bears the load."""
    model, motion, state = dragged(contact, {**DIETERICH, "a": 0.001}, 5e6, 1e-4, 1.0, 0.1, 1e9)
    for _ in range(30):
        motion.step(state)
    fault = state.faults["main"]
    assert np.abs(fault["slip_rate"]).max() < 1e-100
    force = model.faults[0].interface.weight @ fault["normal_stress"] / model.faults[0].interface.weight.sum()
    np.testing.assert_allclose(force, 5e6 * min(1.0, state.time / 0.5), rtol=1e-4)  # it tilts


@every_contact
def test_average_acceleration_closes_the_budget(contact: str) -> None:
    """Rough bodies that are pressed, slide, part and meet again: friction, impacts, new pairings."""
    springs = {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}
    _, motion, state = started(rough({
        "duration": 6e-6, "faults.main.contact": RIGID if contact == "augmented_lagrangian" else springs,
        "stepper": {"kind": "generalized_alpha", "scheme": "average_acceleration", "time_step": 1e-7},
    }))  # fmt: skip
    closed = []
    while state.time < 6e-6:
        motion.step(state)
        closed.append(state.faults["main"]["normal_stress"] > 0)
    assert any(np.any(before & ~after) for before, after in pairwise(closed))
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    assert energy["frictional_dissipation"] > 0.02 * work
    np.testing.assert_allclose(sum(energy.values()), work, rtol=1e-8)
    assert abs(energy["impact_loss"]) < 0.5 * energy["frictional_dissipation"]


AGEING = {"kind": "rate_and_state_ageing", "a": 0.02, "b": 0.01, "D_c": 5e-6, "f_0": 0.3, "V_0": 1e-4}
# With a shorter memory the trailing point opens while friction still remembers its pressure: there is no equilibrium
# next to the last one, whichever way the state is advanced (docs/explanation/implicit_steps.md).
MEMORY = {"kind": "prakash_clifton", "L_p": 4e-6, "law": {"kind": "coulomb", "mu_d": 0.3}}


@pytest.mark.parametrize(
    "friction, coefficient, left",
    [({"kind": "coulomb", "mu_d": 0.3}, 0.3, 1e-9), (AGEING, 0.3 + 0.01 * np.log(2), 2e-3), (MEMORY, 0.3, 1e-3)],
    ids=["coulomb", "rate_and_state", "prakash_clifton"],
)
def test_flat_blocks_slide_with_the_force_of_friction(
    friction: dict[str, Any], coefficient: float, left: float
) -> None:
    """Pressed, then sheared at 0.2 mm/s over one element of the base: T/N is the coefficient, that of steady sliding
    where it has a state."""
    model, motion, state = started(flat({
        "faults.main.friction": friction,
        "boundaries": [
            *held("lower.bottom"), {"kind": "traction", "edge": "upper.top", "traction": [0.0, -5e6], "ramp": 1.0},
            {"kind": "moved", "edge": "upper.top", "component": "x", "quantity": "velocity", "times": [1.0, 1.2],
             "values": [0.0, 2e-4]},
        ],
        "stepper": {"kind": "quasi_static", "largest_step": 0.1},
    }))  # fmt: skip
    face, fault, ratios = model.faults[0].interface, state.faults["main"], []
    while state.time < 1.8:
        motion.step(state)
        if fault["slip"].min() > 5e-5:
            ratios.append(face.weight @ fault["shear_traction"] / (face.weight @ fault["normal_stress"]))
    assert len(ratios) > 4 and fault["slip"].max() > 0.117e-3
    np.testing.assert_allclose(ratios, coefficient, rtol=left)
    np.testing.assert_allclose(pull(model, state)[1], -5e6 * 0.6e-3, rtol=1e-8)


@every_contact
def test_a_force_closes_a_gap(contact: str) -> None:
    """3 um between bodies of which nothing holds the upper one from falling or tilting; then it lies on its crests."""
    springs = {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}
    given = parse_case(rough({
        "mesh.closest": 3e-6, "faults.main.contact": RIGID if contact == "augmented_lagrangian" else springs,
        "boundaries": [*held("lower.bottom"), *held("upper.top", "x"),
                       {"kind": "traction", "edge": "upper.top", "traction": [0.0, -5e6], "ramp": 1.0}],
        "stepper": {"kind": "quasi_static"},
    }))  # fmt: skip
    model = Model(given)  # type: ignore[arg-type]
    equilibrium, state = Equilibrium(model), model.initial_state()
    assert model.faults[0].interface.jump(state.displacement)[:, 0].min() > 2.9e-6
    equilibrium.solve(state, 0.01).commit(state)
    np.testing.assert_allclose(pull(model, state)[1], -0.01 * 5e6 * 1.2e-3, rtol=1e-7)
    crests = model.faults[0].interface.points[state.faults["main"]["normal_stress"] > 0, 0] / 0.6e-3
    assert len(crests) > 1 and np.abs(crests - np.round(crests)).max() < 0.1


@pytest.mark.slow
def test_slow_and_fast() -> None:
    """Pressed and sheared in equilibrium, a rupture in explicit steps when that ends, then slow sliding again."""
    model, motion, state = started(rough({
        "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}, "damping": {"mass": 5e5},
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.5, "mu_d": 0.1, "D_c": 1e-6},
        "duration": 2.0, "boundaries": [
            *held("lower.bottom"), {"kind": "traction", "edge": "upper.top", "traction": [0.0, -5e6], "ramp": 1.0},
            {"kind": "moved", "edge": "upper.top", "component": "x", "quantity": "velocity", "times": [1.0, 1.2],
             "values": [0.0, 1e-5]},
        ],
        "stepper": {"kind": "hybrid", "slow": {"kind": "quasi_static", "largest_step": 0.1, "first_step": 0.02},
                    "calm_for": 1e-6},
    }))  # fmt: skip
    modes, ratios = [0.0], []
    while state.time < 1.7:
        motion.step(state)
        if state.numbers["fast"] != modes[-1]:
            modes.append(state.numbers["fast"])
        force = pull(model, state)
        ratios.append(-force[0] / force[1])
    assert modes[:3] == [0.0, 1.0, 0.0] and modes[-1] == 0.0
    # Flanks of the asperities add to the friction, or take off it.
    assert max(ratios) > 0.35 and abs(ratios[-1] - 0.1) < 0.03
    fault = state.faults["main"]
    closed = fault["normal_stress"] > 0
    np.testing.assert_allclose(fault["shear_traction"][closed], 0.1 * fault["normal_stress"][closed], rtol=1e-6)
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    np.testing.assert_allclose(sum(energy.values()), work, rtol=2e-3)  # springs that find others in explicit steps


# A block of 1 on 0.2 mm on a base of 2 mm, whose nodes do not match, under a cap whose nodes do.
CAPPED = """
Point(1) = {0, -0.4e-3, 0}; Point(2) = {2e-3, -0.4e-3, 0}; Point(3) = {2e-3, 0, 0}; Point(4) = {0, 0, 0};
Point(5) = {0.5e-3, 0, 0}; Point(6) = {1.5e-3, 0, 0}; Point(7) = {1.5e-3, 0.2e-3, 0}; Point(8) = {0.5e-3, 0.2e-3, 0};
Point(9) = {1.5e-3, 0.4e-3, 0}; Point(10) = {0.5e-3, 0.4e-3, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Line(5) = {5, 6}; Line(6) = {6, 7};
Line(7) = {7, 8}; Line(8) = {8, 5}; Line(9) = {7, 9}; Line(10) = {9, 10}; Line(11) = {10, 8};
Curve Loop(1) = {1, 2, 3, 4}; Curve Loop(2) = {5, 6, 7, 8}; Curve Loop(3) = {-7, 9, 10, 11};
Plane Surface(1) = {1}; Plane Surface(2) = {2}; Plane Surface(3) = {3};
Transfinite Curve{1, 3} = 13; Transfinite Curve{5, 7, 10} = 8; Transfinite Curve{2, 4, 6, 8, 9, 11} = 3;
Transfinite Surface{1, 2, 3}; Recombine Surface{1, 2, 3};
Physical Surface("base") = {1}; Physical Surface("block") = {2}; Physical Surface("cap") = {3};
Physical Curve("main") = {3, 5}; Physical Curve("joint") = {7};
Physical Curve("base.bottom") = {1}; Physical Curve("cap.top") = {10};
"""


def test_beside_an_interface_of_pairs(tmp_path: Path) -> None:
    """A block slides under a cap that sticks to it: the forces go through both, less the stress that was there."""
    pytest.importorskip("gmsh")
    path = tmp_path / "capped.geo"
    path.write_text(CAPPED)
    main, joint = (
        {"contact": RIGID, "friction": {"kind": "coulomb", "mu_d": mu}, "initial_stress": {"normal": stress}}
        for mu, stress in ((0.3, 0.0), (0.6, 1e6))
    )
    model, motion, state = started({
        "plane": "strain", "order": 2, "duration": 2.0, "materials": {"default": STIFF},
        "mesh": {"kind": "gmsh_file", "file": str(path), "interfaces": {
            "main": {"plus": "block", "minus": "base", "matching": False}, "joint": {"plus": "cap", "minus": "block"},
        }},
        "faults": {"main": {**main, "sliding": {}}, "joint": joint},
        "stepper": {"kind": "quasi_static", "largest_step": 0.1, "first_step": 0.1, "slip_tolerance": 1e-5},
        "boundaries": [
            *held("base.bottom"), {"kind": "traction", "edge": "cap.top", "traction": [0.0, -5e6], "ramp": 1.0},
            {"kind": "moved", "edge": "cap.top", "component": "x", "quantity": "velocity", "times": [1.0, 1.2],
             "values": [0.0, 2e-4]},
        ],
    })  # fmt: skip
    while state.time < 1.8:
        motion.step(state)
    slides, sticks = pull(model, state), pull(model, state, 1)
    np.testing.assert_allclose(slides, [0.3 * 5e3, -5e3], rtol=1e-3)  # it has tilted a little
    np.testing.assert_allclose(sticks, slides - [0.0, 1e6 * 1e-3], rtol=1e-6)
    assert state.faults["main"]["slip"].min() > 0.13e-3 and not np.any(state.faults["joint"]["slip"])
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    np.testing.assert_allclose(sum(energy.values()), work, rtol=1e-9)


def test_facing_converges() -> None:
    """What is found again changes less each time, by twenty and more, also in steps of a third of a node's distance."""
    found: list[list[float]] = []
    _, motion, state = started(rubbed())
    solve = motion.equilibrium.solve

    def noted(*given: Any, **more: Any) -> Any:
        solution = solve(*given, **more)
        found.append(solution.pairing_changes)
        return solution

    motion.equilibrium.solve = noted
    while state.time < 1:
        motion.step(state)
    assert max(map(len, found)) > 2 and min(map(len, found)) <= 2
    assert all(changes[-1] <= 1e-4 for changes in found)
    falls = [before / after for changes in found for before, after in pairwise(changes)]
    assert np.median(falls) > 20 and min(falls) > 1


# -- runs ----------------------------------------------------------------------------------------------------------


def rubbed(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """Two rough bodies pressed by 5 MPa within 0.2 s, held for as long, and then sheared by 0.2 mm/s."""
    return rough({
        "faults.main.contact": RIGID, "duration": 1.0, "stepper": {"kind": "quasi_static", "largest_step": 0.1},
        "boundaries": [
            *held("lower.bottom"), {"kind": "traction", "edge": "upper.top", "traction": [0.0, -5e6], "ramp": 0.2},
            {"kind": "moved", "edge": "upper.top", "component": "x", "quantity": "velocity", "times": [0.4, 0.5],
             "values": [0.0, 2e-4]},
        ],
    } | (changes or {}))  # fmt: skip


case_file, alone = run_of(rubbed({
    "output.checkpoint_steps": 4, "output.interface_interval": 0.1, "output.rupture_threshold": 1e-6,
}))  # fmt: skip


def test_pressed_held_sheared(alone: Path) -> None:
    """The normal force is that on the edge, forces rest while all is held, then all that is closed slides."""
    with Record(alone) as record:
        table = record.forces
        slip = record.interface.slip.values
    normal, shear = table.normal_force.values / 1.2e-3, table.shear_force.values / 1.2e-3
    pressed, still = table.time > 0.19, (table.time > 0.19) & (table.time < 0.41)
    np.testing.assert_allclose(normal[pressed], 5e6, rtol=2e-4)
    assert still.sum() == 3 and np.ptp(shear[still]) < 1e-5 * 5e6  # what points face is found to 1e-4
    assert table.sticking.values[still].min() > 0 and table.sliding.values[-1] > 0.05
    assert table.sticking.values[-1] == 0
    # Flanks of the asperities carry some of the shear.
    assert 0.2 < shear[-1] / normal[-1] < 0.4
    np.testing.assert_allclose(slip[-1].max(), 2e-4 * (table.time.values[-1] - 0.45), rtol=0.05)


def test_one_asperity_down_and_up() -> None:
    """Over a whole wave the ratio of the forces is that of friction on average, in between less or more the slope."""
    given = rubbed({"duration": 4.0, "stepper.largest_step": 0.05})
    model, motion, state = started(given)
    way, ratios = [], []
    while state.time < 4.0:
        motion.step(state)
        force = pull(model, state)
        way.append(2e-4 * (state.time - 0.45))
        ratios.append(-force[0] / force[1])
    ratios, way = np.array(ratios), np.array(way)
    one = np.linspace(0.1e-3, 0.7e-3, 601)
    np.testing.assert_allclose(np.interp(one, way, ratios).mean(), 0.3, rtol=0.02)
    slope, mu = 0.105, 0.3
    least, most = (mu - slope) / (1 + mu * slope), (mu + slope) / (1 - mu * slope)
    slides = ratios[way > 0.05e-3]
    assert least - 0.01 < slides.min() < least + 0.05 and most - 0.05 < slides.max() < most + 0.01
    energy = motion.energies(state)
    assert abs(energy["impact_loss"]) < 0.01 * energy["frictional_dissipation"]


@pytest.mark.slow
def test_same_on_two_ranks(case_file: Path, alone: Path) -> None:
    out = run_on(2, case_file, case_file.parent / "on_2", limit=240)
    assert max(largest_difference(alone, out).values()) < 1e-9


def test_goes_on_with_the_same_bits(case_file: Path, alone: Path) -> None:
    """While it slides."""
    assert_goes_on_with_the_same_bits(case_file, alone, checkpoints=2)


# -- what is refused -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "replaced, options, message",
    [
        ({}, {"petsc_options": {"ksp_type": "gmres"}},
         r"stepper.petsc_options: faults.main slides, and steps are then solved at the interfaces, not by PETSc"),
        ({"is_linear": lambda bulk: False}, {},
         r"faults.main.sliding: implicit steps need .* one of 'isotropic_elastic' has another; use 'isotropic"),
        ({"MAX_UNKNOWNS": 100}, {},
         r"faults.main.sliding: the surfaces have \d+ degrees of freedom, implicit steps take 100 .*; use larger elem"),
    ],
)  # fmt: skip
def test_cases_that_cannot_slide_in_implicit_steps(
    replaced: dict[str, object], options: dict[str, Any], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in replaced.items():
        monkeypatch.setattr(condensed, name, value)
    with pytest.raises(RuptfxError, match=facts(message)):
        started(rough({"faults.main.contact": RIGID, "stepper": {"kind": "quasi_static", **options}}))
