"""Attachments in implicit steps against exact solutions: plates on a ground that holds or fails, and resonators."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, case
from scipy.optimize import brentq

pytest.importorskip("dolfinx")

from ruptfx.interfaces.mechanisms import StepEnd
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem
HEIGHT, LENGTH, MODULUS = 8e-3, 12e-3, HOMALITE["young_modulus"]
BAR = {**HOMALITE, "poisson_ratio": 0.0}
NORMAL, TANGENTIAL = 2e12, 1e12  # Pa/m
STRONG = {"kind": "linear", "f_t": 1e9, "c": 1e9, "G_Ic": 1e9, "G_IIc": 1e9}
SLOW = {"quasi_static": {"kind": "quasi_static"}, "hybrid": {"kind": "hybrid"}}


def on_ground(cohesion: dict[str, Any], boundaries: list[dict[str, Any]], changes: dict[str, Any]) -> Any:
    """Two plates on a ground, glued to each other; a bar along y, as they have no lateral contraction."""
    ground = {"kind": "foundation", "name": "ground", "edge": "lower.bottom", "normal": NORMAL,
              "tangential": TANGENTIAL, "cohesion": cohesion}  # fmt: skip
    return case({"order": 2, "attachments": [ground], "boundaries": boundaries, "materials.default": BAR,
                 "faults.main.contact": {"kind": "compliant", "C_n": 1e15, "C_s": 1e15}, **changes})  # fmt: skip


def mean_at(model: Any, state: Any, y: float, component: int) -> float:
    rows = state.displacement.reshape(-1, 2)[np.isclose(model.coordinates[:, 1], y, atol=1e-9)]
    assert len(rows) > 5 and np.ptp(rows[:, component]) < 1e-6 * np.abs(rows).max()
    return float(rows[:, component].mean())


@pytest.mark.parametrize("kind", SLOW)
def test_a_plate_pressed_on_the_ground(kind: str) -> None:
    """Springs of k give way by p / k, and the plates by p (H / E + 1 / C_n) more; both exact in finite elements."""
    press = {"kind": "traction", "edge": "upper.top", "traction": [0.0, -1e6], "ramp": 1e-3}
    model, motion, state = march_to(on_ground(STRONG, [press], {"stepper": SLOW[kind], "duration": 2e-3}))
    assert state.time >= 1e-3
    assert mean_at(model, state, -4e-3, 1) == pytest.approx(-1e6 / NORMAL, rel=1e-8)
    whole = -1e6 * (1 / NORMAL + 1e-15 + HEIGHT / MODULUS)
    assert mean_at(model, state, 4e-3, 1) == pytest.approx(whole, rel=1e-8)
    energy = motion.energies(state)
    lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
    assert abs(lost) < 1e-9 * energy["boundary_work"]
    stored = 0.5 * (1e12 / NORMAL + (7e6**2 - 6e6**2) / 1e15) * LENGTH  # the interface has 6 MPa at the start
    assert energy["interface_elastic"] == pytest.approx(stored, rel=1e-7)


def march_to(given: Any) -> tuple[Any, Any, Any]:
    """Step to the end of the case with steps of variable length."""
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    while state.time < given.duration * (1 - 1e-9):
        motion.step(state)
    return model, motion, state


def test_a_plate_torn_off_slowly() -> None:
    """The top moves by D: T = f_t (1 - w / delta), D = C T + w, with the compliance C of ground, interface and bar."""
    law = {"kind": "linear", "f_t": 2e5, "c": 4e5, "G_Ic": 2.0, "G_IIc": 8.0}
    delta, compliance = 2 * law["G_Ic"] / law["f_t"], 1 / NORMAL + 1e-15 + HEIGHT / MODULUS
    way = 0.6 * delta
    pull = {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": way / 1e-2, "ramp": 1e-4}
    given = on_ground(law, [pull], {"stepper": {"kind": "quasi_static"}, "duration": 1e-2})
    model, motion, state = march_to(given)
    moved = mean_at(model, state, 4e-3, 1)
    opening = (moved - compliance * law["f_t"]) / (1 - compliance * law["f_t"] / delta)
    expected = law["f_t"] * (1 - opening / delta)
    ground = state.attached["ground"]
    assert 0.4 * delta < opening < 0.7 * delta
    np.testing.assert_allclose(ground["largest_opening"], opening, rtol=1e-8)
    np.testing.assert_allclose(-ground["traction"][:, 1], expected, rtol=1e-8)
    energy = motion.energies(state)
    # Of a triangle the part up to the opening, less what is still stored along the secant.
    dissipated = 0.5 * law["f_t"] * opening * LENGTH
    assert energy["fracture"] == pytest.approx(dissipated, rel=1e-3)
    lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
    assert abs(lost) < 1e-6 * energy["boundary_work"]


def test_the_stiffness_of_a_ground_that_fails() -> None:
    """Opened and sheared at once beyond the strength: the stiffness is the derivative of the force."""
    law = {"kind": "linear", "f_t": 2e5, "c": 4e5, "G_Ic": 2.0, "G_IIc": 8.0}
    pulls = [{"kind": "driven", "edge": "upper.top", "component": axis, "velocity": 1e-3, "ramp": 1e-4}
             for axis in "xy"]  # fmt: skip
    model = Model(on_ground(law, pulls, {"stepper": {"kind": "quasi_static"}, "duration": 1e-2}))
    (ground,) = model.attachments
    state = model.initial_state()
    u = np.zeros_like(state.displacement)
    u.reshape(-1, 2)[:, 0] = 3e-6 + 1e-4 * model.coordinates[:, 0]
    u.reshape(-1, 2)[:, 1] = 4e-6 - 2e-4 * model.coordinates[:, 0]
    here = ground.respond(state, StepEnd(u, 1.0))
    damage = here.fields["damage"]
    assert (damage > 0.01).all() and (damage < 1).all()
    random = np.random.default_rng(1).normal(size=(len(ground.at), 2))
    for length in (1e-9, 1e-10):
        there = u.copy()
        there.reshape(-1, 2)[ground.at] += length * random
        changed = here.force - ground.respond(state, StepEnd(there, 1.0)).force
        predicted = length * np.einsum("nij,nj->ni", here.stiffness, random)
        assert np.abs(changed - predicted).max() < 10 * length / 1e-6 * np.abs(predicted).max()


def test_a_damaged_node_that_closes_within_a_step_loses_the_area_between_its_secants() -> None:
    """From the opening a on the secant s to a closed b on the full stiffness k: (k - s) a b / 2 is lost per area."""
    law = {"kind": "linear", "f_t": 2e5, "c": 4e5, "G_Ic": 2.0, "G_IIc": 8.0}
    model = Model(on_ground(law, [], {"stepper": {"kind": "quasi_static"}, "duration": 1e-2}))
    (ground,) = model.attachments
    state = model.initial_state()

    def move(y: float) -> dict[str, float]:
        u, before = np.zeros_like(state.displacement), dict(state.energy)
        u[1::2] = y
        end = StepEnd(u, 1.0)
        ground.advance(state, end, ground.respond(state, end))
        state.displacement[:] = u
        return {name: state.energy[name] - before[name] for name in ("fracture", "impact_loss")}

    opening, closing = 5e-6, 2e-6
    move(0.5 * opening)
    first = move(opening)
    assert first["fracture"] > 0 and first["impact_loss"] == 0
    secant = -state.attached["ground"]["traction"][0, 1] / opening
    assert 0 < secant < 0.9 * NORMAL
    second = move(-closing)
    assert second["fracture"] == 0
    assert second["impact_loss"] == pytest.approx(0.5 * (NORMAL - secant) * opening * closing * LENGTH, rel=1e-9)


def frequency(course: list[float], times: list[float]) -> float:
    """Return the angular frequency from two passages through zero, interpolated between steps."""
    values, at = np.array(course), np.array(times)
    before = np.flatnonzero(values[:-1] * values[1:] < 0)
    passages = at[before] + (at[before + 1] - at[before]) * values[before] / (values[before] - values[before + 1])
    assert len(passages) == 2
    return float(np.pi / (passages[1] - passages[0]))


@pytest.mark.parametrize("steps", [
    {"kind": "generalized_alpha", "scheme": "average_acceleration"}, {"kind": "petsc_ts"},
])  # fmt: skip
def test_a_plate_that_vibrates_on_the_ground(steps: dict[str, Any]) -> None:
    """The lowest mode along y, cos(w (H / 2 - y) / c), has tan(w H / c) = k c / (E w) and keeps its energy."""
    stiffness, speed = 1e11, float(np.sqrt(MODULUS / HOMALITE["density"]))
    w = brentq(lambda w: MODULUS * w / speed * np.tan(w * HEIGHT / speed) - stiffness, 1.0, 1.5 * speed / HEIGHT)
    period = 2 * np.pi / w
    steps = {**steps, "time_step": period / 200}
    given = on_ground(STRONG, [], {"stepper": steps, "duration": period})
    given = given.model_copy(update={"attachments": [given.attachments[0].model_copy(update={"normal": stiffness})]})
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    mode = np.zeros((model.nodes, 2))
    mode[:, 1] = np.cos(w * (HEIGHT / 2 - model.coordinates[:, 1]) / speed)
    mode = mode.ravel()
    state.velocity[:] = 1e-3 * mode
    start = model.energies(state)["kinetic"]
    course, times = [], []
    for _ in range(220):
        motion.step(state)
        course.append(float(mode @ (model.mass * state.displacement)))
        times.append(state.time)
    assert frequency(course, times) == pytest.approx(w, rel=1e-3)
    energy = motion.energies(state)
    assert np.abs(state.attached["ground"]["traction"][:, 1]).max() > 0 and not state.attached["ground"]["damage"].any()
    assert energy["kinetic"] + energy["strain"] + energy["interface_elastic"] == pytest.approx(
        start + energy["boundary_work"], rel=1e-7
    )  # fmt: skip


@pytest.mark.parametrize("scheme", ["generalized_alpha", "average_acceleration"])
def test_resonators_on_a_bar(scheme: str) -> None:
    """The lowest mode of a bar with masses, tan(w H / c) = -(m / (rho c)) w w_r^2 / (w_r^2 - w^2), has its frequency.

    It is that of `test_torn_and_shaken_edges`, from two passages through zero; average acceleration keeps the energy.
    """
    density = HOMALITE["density"]
    shear = HOMALITE["young_modulus"] / 2 / (1 + HOMALITE["poisson_ratio"])
    c_s, mass = float(np.sqrt(shear / density)), 0.7 * density * HEIGHT
    own = 0.3 * c_s / HEIGHT

    def missing(w: float) -> float:
        return (own**2 - w**2) * np.tan(w * HEIGHT / c_s) + mass / (density * c_s) * w * own**2

    w = brentq(missing, 1.0000001 * own, min(1.5 * own * np.sqrt(1.7), 0.499 * np.pi * c_s / HEIGHT))
    period = 2 * np.pi / w
    row = {"kind": "resonators", "name": "row", "edge": "upper.top", "mass": mass, "frequency": own / (2 * np.pi)}
    model = Model(case({
        "plane": "antiplane", "attachments": [row], "duration": period,
        "faults.main.contact": {"kind": "compliant", "C_n": 1e16, "C_s": 1e16},
        "stepper": {"kind": "generalized_alpha", "scheme": scheme, "time_step": period / 200},
    }))  # fmt: skip
    motion, state = model.case.stepper.bind(model), model.initial_state()
    mode = np.cos(w * (model.coordinates[:, 1] + HEIGHT / 2) / c_s)
    state.displacement[:] = 1e-9 * mode
    masses = state.attached["row"]
    masses["displacement"][:] = state.displacement[model.attachments[0].at, None] / (1 - (w / own) ** 2)
    masses["acceleration"][:] = -(w**2) * masses["displacement"]
    start = model.energies(state)
    course, times = [], []
    for _ in range(220):
        motion.step(state)
        course.append(float(mode @ (model.mass * state.displacement)) / float(mode @ (model.mass * mode)))
        times.append(state.time)
    assert frequency(course, times) == pytest.approx(w, rel=1e-3)
    energy = motion.energies(state)
    assert energy["resonators"] > 0.05 * (start["strain"] + start["resonators"])
    if scheme == "average_acceleration":
        total, first = (sum(e[name] for name in ("kinetic", "strain", "interface_elastic", "resonators"))
                        for e in (energy, start))  # fmt: skip
        assert total == pytest.approx(first, rel=1e-7)
