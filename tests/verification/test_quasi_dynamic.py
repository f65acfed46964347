"""Quasi-dynamic Runge-Kutta steps: against implicit ones, their own energy budget, restarts, what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.small_cases import case

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.input.schema import CaseError
from ruptfx.platform import memory
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate
from ruptfx.stepping.implicit import ConvergenceError, condensed, loaded_bodies
from ruptfx.stepping.steppers.quasi_dynamic import QuasiDynamicMotion

pytestmark = pytest.mark.fem

STIFF = {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}
LAW = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 2e-7, "f_0": 0.6, "V_0": 1e-6}
HELD = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
EXPLICIT, IMPLICIT = {"kind": "quasi_dynamic"}, {
    "kind": "quasi_static", "radiation_damping": True, "slip_tolerance": 5e-11, "rate_tolerance": 2e-3,
    "strength_tolerance": 1e-5,
}  # fmt: skip


def plates(changes: dict[str, Any] | None = None) -> Any:
    """Unlike plates in plane stress, so that slip changes the normal stress; the upper one is pushed at its left."""
    soft = {"kind": "isotropic_elastic", "young_modulus": 2e9, "poisson_ratio": 0.3, "density": 1100.0}
    stiff = {"kind": "isotropic_elastic", "young_modulus": 4e9, "poisson_ratio": 0.35, "density": 1200.0}
    return case({
        "order": 2, "duration": 50.0, "mesh.length": 12e-3, "mesh.element_size": 2e-3,
        "materials": {"upper": soft, "lower": stiff},
        "faults.main.contact": STIFF, "faults.main.friction": LAW,
        "faults.main.initial_stress": {"normal": 6e6, "shear": 3.3e6},
        "boundaries": [*HELD, {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1e-6}],
        "stepper": EXPLICIT, **(changes or {}),
    })  # fmt: skip


def reach(given: Any, time: float) -> tuple[Any, Any, Any]:
    """Model, motion and state at a time, which the last step is cut to reach."""
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    while state.time < time * (1 - 1e-9):
        state.numbers["dt"] = min(state.numbers.get("dt", motion.dt), time - state.time)
        motion.step(state)
    return model, motion, state


def test_as_implicit_steps() -> None:
    """Slip that spreads from one end at changing normal stress: slip, slip rate, age, tractions, balance and energy."""
    model, motion, state = reach(plates(), 1.5)
    _, _, implicit = reach(plates({"stepper": IMPLICIT}), 1.5)
    ours, theirs = state.faults["main"], implicit.faults["main"]
    assert state.step < 0.25 * implicit.step
    assert np.ptp(ours["slip_rate"]) > 5e-7 and np.ptp(ours["normal_stress"]) > 3e5
    for name in ("slip", "slip_rate", "theta", "normal_stress", "shear_traction"):
        np.testing.assert_allclose(ours[name], theirs[name], atol=2e-3 * np.abs(theirs[name]).max(), err_msg=name)
    size = np.abs(state.displacement).max()
    np.testing.assert_allclose(state.displacement, implicit.displacement, atol=2e-3 * size)
    # The displacement goes with slip and tractions, and all forces but those of driven edges are balanced.
    jump = model.faults[0].interface.jump(state.displacement)[:, 1]
    stretch = (ours["shear_traction"] - model.faults[0].shear_traction_0[:, 0]) / STIFF["C_s"]
    np.testing.assert_allclose(jump, ours["slip"] + stretch, atol=1e-12 * size)
    forces = motion.equilibrium.forces.internal(state)
    free = ~model.loads.prescribed
    assert np.abs(forces[free]).max() < 1e-10 * np.abs(forces[~free]).max()
    energy = motion.energies(state)
    lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
    assert energy["frictional_dissipation"] > 0 and abs(lost) < 1e-9 * energy["boundary_work"]


def test_error_follows_the_tolerance() -> None:
    finest = reach(plates({"stepper": {**EXPLICIT, "tolerance": 1e-8}}), 1.5)[2].faults["main"]["slip"]
    errors = []
    for tolerance in (1e-3, 1e-5):
        slip = reach(plates({"stepper": {**EXPLICIT, "tolerance": tolerance}}), 1.5)[2].faults["main"]["slip"]
        errors.append(np.abs(slip - finest).max() / LAW["D_c"])
    assert errors[1] < 0.1 * errors[0] and errors[1] < 1e-4


def test_stopped_run_goes_on_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A first step below the largest one: steps grow during the whole run, so that a checkpoint has a step to restore.
    adaptive = {"kind": "quasi_dynamic", "first_step": 1e-3, "largest_step": 1.0}
    given = plates({"duration": 3.0, "output.checkpoint_steps": 4, "stepper": adaptive})
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


def test_a_step_begins_with_the_slopes_at_the_end_of_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six evaluations in place of seven, but for the first step; the numbers differ by rounding."""
    counts, evaluate = [0], QuasiDynamicMotion._slope

    def counted(*parts: Any) -> Any:
        counts[-1] += 1
        return evaluate(*parts)

    monkeypatch.setattr(QuasiDynamicMotion, "_slope", counted)
    ends = []
    for reuse in (True, False):
        model = Model(plates())
        motion, state = model.case.stepper.bind(model), model.initial_state()
        counts[:] = [0]
        for _ in range(5):
            motion.step(state)
            if not reuse:
                del state.numbers["rates_at"]
            counts.append(0)
        assert counts[0] % 7 == 0 and {count % (6 if reuse else 7) for count in counts[1:5]} == {0}
        assert sum(counts) > 25
        ends.append(state)
    for name in ("slip", "slip_rate", "theta", "shear_traction", "normal_stress"):
        ours, theirs = (each.faults["main"][name] for each in ends)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12 * np.abs(theirs).max())
    assert ends[0].time == pytest.approx(ends[1].time, rel=1e-9)


def test_refuses_contact_that_is_rigid_or_opens() -> None:
    """Rigid contact, and a fault that opens: it says so, and the state is as before."""
    with pytest.raises(CaseError, match=facts(r"faults\.main\.contact.kind = '.*: .*stiffness")):
        plates({"faults.main.contact": {"kind": "augmented_lagrangian"}})
    up = {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": 1.0}  # slower takes as many more steps
    pulled = plates({"boundaries": [*HELD, up]})
    with pytest.raises(ConvergenceError, match=facts(r"faults\.main opens at time .*quasi_static")):
        reach(pulled, 1e-4)


def test_a_gap_is_for_quasi_static_steps() -> None:
    """The refusal names them, and they run: open over a third of the interface, at rest and without traction there."""
    closed = {"kind": "boxcar", "inside": 0.0, "center": 6e-3, "half_width": 2e-3, "outside": 6e6}
    opened = {"faults.main.initial_stress": {"normal": closed}, "faults.main.gap": {
        **closed, "inside": 1e-7, "outside": 0.0}}  # fmt: skip
    with pytest.raises(CaseError, match=facts(r"faults\.main\.gap.*quasi_static")):
        plates(opened)
    _, _, state = reach(plates({**opened, "stepper": {"kind": "quasi_static"}}), 1e-3)
    fields = state.faults["main"]
    inside = fields["opening"] > 0
    assert 0 < inside.sum() < len(inside)
    assert np.abs(fields["opening"][inside] - 1e-7).max() < 1e-8
    assert not fields["shear_traction"][inside].any() and not fields["normal_stress"][inside].any()


def by_hand(fields: Any) -> np.ndarray:
    """Strength of the ageing law [Pa], shape (n,)."""
    # a sigma asinh(V / (2 V_0) exp(psi / a)), psi = f_0 + b ln(V_0 theta / D_c)
    psi = LAW["f_0"] + LAW["b"] * np.log(LAW["V_0"] * fields["theta"] / LAW["D_c"])
    return np.asarray(
        LAW["a"] * fields["normal_stress"] * np.arcsinh(fields["slip_rate"] / (2 * LAW["V_0"]) * np.exp(psi / LAW["a"]))
    )


# 1 / eta = 1 / sqrt(mu rho) of one side + that of the other, mu = E / (2 (1 + nu)), of the bodies of `plates`.
ETA = 1 / sum(np.sqrt(2 * (1 + nu) / (E * rho)) for E, nu, rho in ((2e9, 0.3, 1100.0), (4e9, 0.35, 1200.0)))


@pytest.mark.parametrize(
    ("law", "shear"),
    [
        ({"V_initial": 0.9e-3}, 3.6e6),
        ({"V_initial": 2e-3}, 3.6e6),
        ({"V_initial": 0.1}, 3.6e6),
        ({"theta_initial": 1e-3}, 4.2e6),
    ],
)
def test_fast_slip_balances_and_radiates(law: dict[str, float], shear: float) -> None:
    """An event that is fast from the start: |tau| = strength + eta V at every point, and the energy of eta V."""
    given = plates({
        "faults.main.friction": {**LAW, **law}, "faults.main.initial_stress": {"normal": 6e6, "shear": shear},
        "duration": 1e-3, "boundaries": HELD,
    })  # fmt: skip
    model = Model(given)
    motion, state, face = given.stepper.bind(model), model.initial_state(), model.faults[0].interface
    radiated = 0.0
    for _ in range(40):
        before = {name: state.faults["main"][name].copy() for name in ("slip", "slip_rate")}
        motion.step(state)
        now = state.faults["main"]
        np.testing.assert_allclose((now["shear_traction"] - by_hand(now)) / now["slip_rate"], ETA, rtol=1e-9)
        mean = 0.5 * (before["slip_rate"] + now["slip_rate"])
        radiated += float(np.sum(face.weight * ETA * mean * (now["slip"] - before["slip"])))
    assert now["slip_rate"].min() > 0.1
    energy = motion.energies(state)
    # Equilibrium counts the kinetic energy of the bodies as damped, too.
    assert energy["damping"] + energy["kinetic"] == pytest.approx(radiated, rel=1e-9)


def test_a_point_without_balance_is_an_error() -> None:
    """The state is as before, and the error names the point and the time."""
    given = plates()
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    motion.step(state)
    time, fields = state.time, state.faults["main"]
    fields["theta"][3] = np.nan
    slip = fields["slip"].copy()
    number, (x, y) = model.faults[0].interface.number[3], model.faults[0].interface.points[3]
    place = rf"point {number} of fault 'main' at \({x:.6g}, {y:.6g}\) m, time {time:.9g} s"
    with pytest.raises(ConvergenceError, match=facts(place)):
        motion.step(state)
    assert state.time == time and np.array_equal(fields["slip"], slip)


def test_a_linear_solve_that_is_wrong_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """As factors of a stiffness that cannot be factorised would be: displacements too small by a thousandth."""
    given = plates()
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    motion.step(state)
    solve = motion._bodies.solve
    monkeypatch.setattr(motion._bodies, "solve", lambda force: 0.999 * solve(force))
    with pytest.raises(ConvergenceError, match=facts(r"\d\S* N .* \d\S* N .*time \d\S* s")):
        motion.step(state)


def test_memory_bounds_the_number_of_components(monkeypatch: pytest.MonkeyPatch) -> None:
    """More components than are condensed give the same slip; six matrices of 26 x 26 take 32 kB."""
    _, _, usual = reach(plates(), 0.5)
    monkeypatch.setattr(condensed, "MAX_UNKNOWNS", 10)
    model, _, state = reach(plates(), 0.5)
    ours, theirs = (each.faults["main"]["slip"] for each in (state, usual))
    assert theirs.max() > 0 and condensed.count_jumps(model) == 26
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * theirs.max())
    assert loaded_bodies.matrix_bytes(model) == 6 * 8 * 26**2 == 32448
    monkeypatch.setattr(memory, "available", lambda: 32000.0)
    sizes = r"stepper.kind = 'quasi_dynamic': .* 26 .* 3.24e-05 GB, .* 3.2e-05 GB"
    with pytest.raises(RuptfxError, match=facts(sizes)):
        plates().stepper.bind(Model(plates()))
