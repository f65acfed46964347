"""Quasi-dynamic steps of laws with strength at rest and with any state: exact sliders, implicit steps, restarts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.small_cases import HOMALITE, case, memory_friction, merged, plates

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.laws.friction import FrictionLaw
from ruptfx.laws.friction.prakash_clifton import PrakashClifton
from ruptfx.laws.friction.rate_and_state_power_law import RateAndStatePowerLaw
from ruptfx.laws.friction.time_weakening import TimeWeakening
from ruptfx.laws.friction.velocity_weakening_over_slip import VelocityWeakeningOverSlip
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.steppers._evolution import AnyState
from ruptfx.stepping.steppers.quasi_dynamic import QuasiDynamicMotion

pytestmark = pytest.mark.fem

SIDES = [{"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"} for body in ("upper", "lower")]
HELD = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
CLAMPED = [*HELD, *({**each, "edge": "upper.top"} for each in HELD)]
CONTACT = {"kind": "compliant", "C_n": 1e13, "C_s": 1e13}
MU = HOMALITE["young_modulus"] / (2 * (1 + HOMALITE["poisson_ratio"]))
ETA = 0.5 * np.sqrt(MU * HOMALITE["density"])
HEIGHT, PRESSURE = 4e-3, 6e6
STIFFNESS = 1 / (2 * HEIGHT / MU + 1 / CONTACT["C_s"])
WEAKENS = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 5e-6}


def slider(changes: dict[str, Any]) -> Any:
    """Two layers between plates at rest: all points slip alike, on a spring of the stiffness of both layers."""
    return case({
        "order": 1, "duration": 4e-5, "mesh.height": HEIGHT, "boundaries": [*SIDES, *CLAMPED],
        "faults.main.contact": CONTACT, "faults.main.initial_stress": {"normal": PRESSURE, "shear": 3.7e6},
        "stepper": {"kind": "quasi_dynamic", "tolerance": 1e-7, "largest_step": 1e-6}, **changes,
    })  # fmt: skip


def course(given: Any, time: float) -> tuple[np.ndarray, np.ndarray, Any, Any]:
    """Times and slips of the first point up to a time, the motion and the state."""
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    times, slips = [0.0], [0.0]
    while state.time < time * (1 - 1e-9):
        state.numbers["dt"] = min(state.numbers.get("dt", motion.dt), time - state.time)
        motion.step(state)
        fields = state.faults["main"]
        assert np.ptp(fields["slip"]) < 1e-9 * max(fields["slip"].max(), 1e-9)
        times.append(state.time)
        slips.append(float(fields["slip"][0]))
    return np.array(times), np.array(slips), motion, state


def test_a_slider_that_weakens_with_slip_against_the_exact_solution() -> None:
    """eta s' = tau_0 - K s - strength(s): exponential growth up to D_c, then decay to the equilibrium."""
    times, slips, motion, state = course(slider({"faults.main.friction": WEAKENS}), 3e-5)
    drop = (WEAKENS["mu_s"] - WEAKENS["mu_d"]) * PRESSURE / WEAKENS["D_c"]
    growth, excess = (drop - STIFFNESS) / ETA, 3.7e6 - WEAKENS["mu_s"] * PRESSURE
    weakened = np.log1p(WEAKENS["D_c"] * growth * ETA / excess) / growth
    end = (3.7e6 - WEAKENS["mu_d"] * PRESSURE) / STIFFNESS
    before = excess / (growth * ETA) * np.expm1(growth * np.minimum(times, weakened))
    after = end - (end - WEAKENS["D_c"]) * np.exp(-STIFFNESS / ETA * np.maximum(times - weakened, 0))
    assert weakened < 0.5 * times[-1] and slips[-1] > 0.9 * end
    np.testing.assert_allclose(slips, np.where(times < weakened, before, after), atol=1e-5 * end)
    energy = motion.energies(state)
    lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
    assert abs(lost) < 1e-9 * energy["frictional_dissipation"]


def test_coulomb_friction_sticks_and_slides_against_the_exact_solution() -> None:
    """Loaded at a speed v it sticks until tau = mu sigma, then V = v (1 - exp(-K t / eta)).

    With too much stress at the start and unloaded at v it slides at V = (V_0 + v) exp(-K t / eta) - v, and sticks from
    V = 0 on.
    """
    speed, end, relaxed = 0.05, 1.5e-5, ETA / STIFFNESS
    law = {"kind": "coulomb", "mu_d": 0.4}

    def pushed(velocity: float, shear: float) -> Any:
        top = [{**HELD[1], "edge": "upper.top"}, {**HELD[0], "edge": "upper.top", "velocity": velocity}]
        stress = {"normal": PRESSURE, "shear": shear}
        return slider({
            "faults.main.friction": law, "boundaries": [*SIDES, *HELD, *top], "faults.main.initial_stress": stress,
        })  # fmt: skip

    times, slips, _, _ = course(pushed(speed, 0.4 * PRESSURE - STIFFNESS * speed * end / 3), end)
    slid = np.maximum(times - end / 3, 0)
    exact = speed * (slid + relaxed * np.expm1(-slid / relaxed))
    np.testing.assert_allclose(slips, exact, atol=1e-4 * exact.max())
    assert exact.max() > 1e-7 and np.all(slips[times < 0.99 * end / 3] == 0)

    first = 0.1
    times, slips, _, state = course(pushed(-speed, 0.4 * PRESSURE + ETA * first), end)
    stops = relaxed * np.log1p(first / speed)
    slid = np.minimum(times, stops)
    exact = -(first + speed) * relaxed * np.expm1(-slid / relaxed) - speed * slid
    assert stops < 0.9 * end and state.faults["main"]["slip_rate"].max() == 0
    np.testing.assert_allclose(slips, exact, atol=1e-4 * exact.max())


LAWS: dict[str, dict[str, Any]] = {
    "slip weakening": {**WEAKENS, "mu_d": 0.5, "D_c": 2e-5},
    "two states": memory_friction("P1"),
    "weakens with the slip rate": {"kind": "velocity_weakening_over_slip", "mu_s": 0.6, "mu_d": 0.5, "V_w": 0.5,
                                   "L": 1e-5},
}  # fmt: skip


@pytest.mark.parametrize("name", LAWS)
def test_as_implicit_steps(name: str) -> None:
    """A patch that is stressed beyond its strength: slip, slip rate, tractions and states are those of BDF2 steps."""
    table = plates({
        "order": 2, "duration": 1e-5, "faults.main.contact": CONTACT, "faults.main.friction": LAWS[name],
        "boundaries": CLAMPED, "faults.main.initial_stress": {"normal": 6e6, "shear": {
            "kind": "gaussian", "background": 2e6, "amplitude": 2e6, "center": 6e-3, "width": 2e-3}},
    })  # fmt: skip
    found = []
    for stepper in (
        {"kind": "quasi_dynamic", "tolerance": 1e-5},
        {"kind": "quasi_static", "radiation_damping": True, "slip_tolerance": 1e-10, "rate_tolerance": 2e-3,
         "strength_tolerance": 1e-5, "largest_step": 2e-8},
    ):  # fmt: skip
        given = parse_case(merged(table, {"stepper": stepper}))
        model = Model(given)
        motion, state = given.stepper.bind(model), model.initial_state()
        while state.time < 6e-6 * (1 - 1e-9):
            state.numbers["dt"] = min(state.numbers.get("dt", motion.dt), 6e-6 - state.time)
            motion.step(state)
        found.append(state.faults["main"])
    ours, theirs = found
    assert ours["slip"].max() > 1e-7 and ours["slip"].min() < 0.9 * ours["slip"].max()
    law = model.faults[0].friction
    for field in ("slip", "slip_rate", "normal_stress", "shear_traction", *law.all_state_fields()):
        np.testing.assert_allclose(ours[field], theirs[field], atol=3e-3 * np.abs(theirs[field]).max(), err_msg=field)


@pytest.mark.parametrize("law", [
    RateAndStatePowerLaw(mu_s=0.6, mu_d=0.4, V_0=100.0, V_1=29.0, p=1.2, m=5.0, L_0=1e-5, theta_0_initial=1e-4),
    VelocityWeakeningOverSlip(mu_s=0.6, mu_d=0.3, V_w=0.5, L=1e-5, V_star=0.1),
    PrakashClifton(L_p=1e-5, V_star=0.1, theta_p_ratio=0.5, law=TimeWeakening(mu_s=0.6, mu_d=0.3, arrival=1.0)),
], ids=lambda law: law.kind())  # fmt: skip
def test_rates_of_states_are_those_of_advance(law: FrictionLaw) -> None:
    pressure, speed = np.array([5e6, 6e6]), np.array([0.0, 0.7])
    state = law.initial_state(np.array([6e6, 6e6]), np.array([3e6, 3e6]), speed)
    evolution = AnyState(law, np.ones(2))
    h = 1e-9
    later, earlier = (law.advance(state, speed, pressure, sign * h) for sign in (1, -1))
    rates = evolution.rates(state, speed, pressure)
    variables = evolution.variables(state)
    wrong = 1e-3 * variables
    mu = [law.strength(speed, pressure, evolution.state(each)) / pressure for each in (variables, variables + wrong)]
    errors = evolution.errors(variables, wrong, speed, pressure)
    np.testing.assert_allclose(errors[:, 0], np.abs(mu[1] - mu[0]), rtol=1e-6)
    for k, name in enumerate(law.all_state_fields()):
        expected = (later[name] - earlier[name]) / (2 * h)
        np.testing.assert_allclose(rates[:, k], expected, rtol=1e-5, atol=1e-6 * np.abs(state[name]).max() / 1e-6)


def test_stopped_run_goes_on_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = slider({"faults.main.friction": memory_friction("P1"), "duration": 2e-6, "output.checkpoint_steps": 4,
                    "stepper": {"kind": "quasi_dynamic", "first_step": 1e-9, "largest_step": 1e-7}})  # fmt: skip
    simulate(given, tmp_path / "whole", progress=False)
    step = QuasiDynamicMotion.step

    def stops(motion: Any, state: Any) -> None:
        if state.step == 10:
            raise ConvergenceError("stopped by the test")
        step(motion, state)

    monkeypatch.setattr(QuasiDynamicMotion, "step", stops)
    with pytest.raises(ConvergenceError):
        simulate(given, tmp_path / "stopped", progress=False)
    monkeypatch.setattr(QuasiDynamicMotion, "step", step)
    simulate(given, tmp_path / "stopped", progress=False, resume=True).close()
    assert max(largest_difference(tmp_path / "whole", tmp_path / "stopped").values()) == 0
