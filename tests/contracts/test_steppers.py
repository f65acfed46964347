"""Every time stepper, found by name: what it owes to the time loop, and what it says of itself is true. Then leapfrog's
stable step."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, get_args
from unittest.mock import patch

import numpy as np
import pytest
from helpers.messages import facts
from helpers.small_cases import ANY_STEPPER, COMPLIANT, SPLIT, advance, case, march, memory_friction, required

pytest.importorskip("dolfinx")

from ruptfx import RuptfxError
from ruptfx.bodies import spectrum
from ruptfx.bodies.spectrum import highest_frequency, stable_time_step
from ruptfx.case.support import UnsupportedError
from ruptfx.input.fields import ENERGIES
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.run.model import Model
from ruptfx.stepping.steppers.leapfrog import LeapfrogMotion, what_limits

pytestmark = pytest.mark.fem

KINDS = alternatives("ruptfx.stepping.steppers")
# Those whose step can be given, with every scheme they have.
SCHEMES: list[dict[str, Any]] = [
    {"kind": kind, **({"scheme": scheme} if scheme else {})}
    for kind, cls in KINDS.items() if cls.second_order and "time_step" in cls.model_fields
    for scheme in get_args(getattr(cls.model_fields.get("scheme"), "annotation", None)) or ("",)
]  # fmt: skip
RIGID = {"kind": "augmented_lagrangian"}
METHODS = (COMPLIANT, SPLIT, RIGID)


def name_of(stepper: dict[str, Any]) -> str:
    return "-".join(value for value in stepper.values() if isinstance(value, str))


def with_contacts(schemes: list[dict[str, Any]]) -> list[Any]:
    """Every scheme with the contact methods its steps can use."""
    pairs = [(stepper, contact) for stepper in schemes for contact in METHODS]
    return [
        pytest.param(*pair, id=f"{name_of(pair[0])}-{pair[1]['kind']}") for pair in pairs if fits(*pair)
    ]  # fmt: skip


def fits(stepper: dict[str, Any], contact: dict[str, Any]) -> bool:
    """Whether it is the stepper's own method, which no other one replaces."""
    method = alternatives("ruptfx.laws.contact")[contact["kind"]]
    return all(getattr(method, way) for way in KINDS[stepper["kind"]].time_schemes)


# Implicit steps as short as explicit ones, so that the same happens.
CONSERVING: list[dict[str, Any]] = [
    {"kind": kind, **cls.conserving, **({"courant": 1.0} if "courant" in cls.model_fields else {})}
    for kind, cls in KINDS.items() if cls.conserving is not None
]  # fmt: skip
EVERYTHING = [
    {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0, "ramp": 4e-6},
    {"kind": "traction", "edge": "upper.top", "traction": [1e6, 2e6], "ramp": 3e-6},
    {"kind": "absorbing", "edge": "upper.right"},
    {"kind": "absorbing", "edge": "lower.bottom"},
]
HELD = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_stepper_owes(kind: str) -> None:
    """A step goes on in time, keeps the arrays of the state in their place, answers with all energies. It takes one
    contact method at least."""
    taken = 0
    for contact in METHODS:
        changes = {
            "order": 1, "boundaries": [*HELD, *EVERYTHING[: 3 if "inertia" in KINDS[kind].offers else 2]],
            "faults.main.contact": contact, "faults.main.friction": ANY_STEPPER,
            "stepper": {"kind": kind, **required(kind)},
        }  # fmt: skip
        try:
            pushed = case(changes)
        except UnsupportedError as refused:
            assert "faults.main.contact.kind" in str(refused)
            continue
        model = Model(pushed)
        motion, state = pushed.stepper.bind(model), model.initial_state()
        taken += 1
        arrays = [state.displacement, state.velocity, *state.faults["main"].values()]
        for number in (1, 2):
            before = state.time
            motion.step(state)
            assert state.step == number and before < state.time and motion.dt > 0
        now = [state.displacement, state.velocity, *state.faults["main"].values()]
        assert all(a is b for a, b in zip(now, arrays, strict=True)) and motion.collective in (True, False)
        energies = motion.energies(state)
        assert list(energies) == list(ENERGIES) and np.isfinite(list(energies.values())).all()
        for edge in model.loads.motions:
            assert state.displacement[edge.dofs] == pytest.approx(edge.displacement(state.time))
            between = 0.5 * (edge.velocity(before) + edge.velocity(state.time))  # a ramp: also the mean of a step
            assert any(state.velocity[edge.dofs] == pytest.approx(v) for v in (between, edge.velocity(state.time)))
        assert not state.force.any() and state.fault_time <= state.at_velocity()[0] <= state.time
    assert taken > 0


# Strengthens with the slip rate, so that equilibrium is stable; slides at 1e-6 m/s under 0.6 times the normal stress.
STABLE = {**ANY_STEPPER, "a": 0.02, "b": 0.005, "theta_initial": 10.0}


@pytest.mark.parametrize("kind", KINDS)
def test_the_energy_budget_is_as_open_as_a_stepper_says(kind: str) -> None:
    """Driven, loaded and sliding, with dampers where there is inertia: what is missing is below `closure` in all steps,
    and who leaves more open than solvers do says why. The energy of springs is counted from that under the initial
    stress, whose rounding exceeds 1e-9 of the work of a first step of 5 ns."""
    stepper = KINDS[kind]
    assert stepper.closure <= 1e-9 or stepper.why_open
    worst: dict[str, float] = {}
    for contact in METHODS:
        boundaries = [EVERYTHING[0], {**EVERYTHING[1], "traction": [1e6, -2e6]}]
        boundaries += EVERYTHING[2 : 2 + ("inertia" in stepper.offers)]
        try:
            busy = case({
                "order": 2, "plane": "strain", "boundaries": [*boundaries, *HELD],
                "damping": {"mass": 1e4} if "inertia" in stepper.offers else {},
                "faults.main.contact": contact, "faults.main.friction": STABLE,
                "faults.main.initial_stress": {"normal": 2e6, "shear": 1.2e6},
                "stepper": {"kind": kind, **required(kind)},
            })  # fmt: skip
        except UnsupportedError:  # as `test_what_a_stepper_owes` has it
            continue
        model = Model(busy)
        motion, state = busy.stepper.bind(model), model.initial_state()
        fault = model.faults[0]
        normal, shear = fault.normal_stress_0, fault.shear_traction_0[:, 0]
        held = fault.interface.weight @ fault.contact.stored(normal, [shear], 0 * normal, [0 * shear])
        missing, work = 0.0, 0.0
        while state.time < 10e-6:
            motion.step(state)
            energy = motion.energies(state)
            work = max(work, abs(energy["boundary_work"]))
            lost = 2 * energy["boundary_work"] - sum(energy.values())
            missing = max(missing, (abs(lost) - np.finfo(float).eps * held) / work)
        worst[contact["kind"]] = missing
        assert energy["frictional_dissipation"] > 1e-7 * work and energy["strain"] > 0.01 * work
    assert worst and max(worst.values()) <= stepper.closure, worst


@pytest.mark.parametrize("stepper, contact", [
    pytest.param(*each.values, id=each.id, marks=[pytest.mark.slow] * (each.values[1] is RIGID))
    for each in with_contacts(SCHEMES)
])  # fmt: skip
def test_second_order_in_time(stepper: dict[str, Any], contact: dict[str, Any]) -> None:
    """Stuck interface, driven, loaded, absorbing and damped; the solution of the ODE is smooth for t > 0."""
    duration = 2e-6
    finals = []
    for steps in (60, 120, 240) if "explicit" in KINDS[stepper["kind"]].time_schemes else (30, 60, 120):
        smooth = case({
            "order": 2, "duration": duration, "boundaries": EVERYTHING, "damping": {"mass": 2e5},
            "faults.main.contact": contact, "stepper": {**stepper, "time_step": duration / steps},
        })  # fmt: skip
        _, motion, state = march(smooth)
        assert state.step == steps and motion.dt == duration / steps
        finals.append(state.displacement.copy())
    coarse, fine = (np.linalg.norm(a - b) for a, b in pairwise(finals))
    # |u_h - u_(h/2)| / |u_(h/2) - u_(h/4)| = 2^2 for a second-order scheme.
    assert 3.5 < coarse / fine < 4.5
    assert fine > 1e-9 * np.linalg.norm(finals[-1])


@pytest.mark.parametrize("stepper, contact", with_contacts(CONSERVING))
@pytest.mark.parametrize("plane, pull, tolerance", [
    ("stress", -2e6, 1e-11), ("strain", -2e6, 1e-11),
    # A spring that lets go, or nodes that meet, between two steps: the discrete budget is no longer exact.
    ("stress", 2e6, 1e-4), ("strain", 2e6, 1e-4),
])  # fmt: skip
def test_energy_budget_closes(
    stepper: dict[str, Any], contact: dict[str, Any], plane: str, pull: float, tolerance: float
) -> None:
    """Sliding, opening, driven, loaded, absorbing, damped: all that is put in is found again."""
    boundaries = [EVERYTHING[0], {**EVERYTHING[1], "traction": [1e6, pull]}, *EVERYTHING[2:]]
    busy = case({
        "order": 2 if contact is RIGID else 4, "plane": plane, "duration": 10e-6, "boundaries": boundaries,
        "damping": {"mass": 1e4},
        "faults.main.contact": contact, "faults.main.friction": memory_friction("P1"),
        "faults.main.initial_stress": {"normal": 0.5e6 if pull > 0 else 2e6, "shear": 5e3}, "stepper": stepper,
    })  # fmt: skip
    opening, worst, work = [], 0.0, 0.0
    model = Model(busy)
    motion, state = busy.stepper.bind(model), model.initial_state()
    for _ in range(10):
        advance(motion, state, 1e-6, lambda now: opening.append(now.faults["main"]["opening"].max()))
        energy = motion.energies(state)
        work = max(work, abs(energy["boundary_work"]))
        lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
        worst = max(worst, abs(lost) / work)
    # Multipliers are the tractions to 1e-8 of the largest.
    assert worst < max(tolerance, 1e-10 if contact is RIGID else 0)
    # It was busy: slid, damped, opened if pulled.
    assert energy["frictional_dissipation"] > 5e-5 * work and energy["damping"] > 1e-3 * work
    assert (max(opening) > 1e-8) == (pull > 0)


@pytest.mark.parametrize("stepper", CONSERVING, ids=name_of)
def test_antiplane_energy_and_split(stepper: dict[str, Any]) -> None:
    rigid = SPLIT if fits(stepper, SPLIT) else RIGID
    sliding = case({
        "order": 4 if rigid is SPLIT else 2, "plane": "antiplane",
        "duration": 6e-6, "faults.main.contact": rigid, "stepper": stepper,
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 1e-6},
        "faults.main.initial_stress.shear": {
            "kind": "boxcar", "inside": 3.7e6, "outside": 3e6, "center": 6e-3, "half_width": 2e-3
        },
    })  # fmt: skip
    _, motion, state = march(sliding)
    energy = motion.energies(state)
    lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
    assert state.faults["main"]["slip"].min() > 0
    assert abs(lost) < (1e-11 if rigid is SPLIT else 1e-10) * energy["boundary_work"]


@pytest.mark.parametrize(
    "C_n, limit",
    [(300e9, "set by the elements"), (3e16, r"set by the contact stiffness of faults.main \(.* s without it\)")],
)
def test_unstable_step_is_refused(C_n: float, limit: str) -> None:
    contact = {"kind": "compliant", "C_n": C_n, "C_s": 100e9}
    stiff = case({"faults.main.contact": contact, "stepper": {"kind": "leapfrog", "time_step": 1e-6}})
    message = rf"stepper\.time_step = 1e-06 s: unstable, the limit is .* s, {limit}; reduce it"
    with pytest.raises(CaseError, match=facts(message)):
        stiff.stepper.bind(Model(stiff))


@pytest.mark.parametrize("damping", [{}, {"kelvin_voigt": {"fraction": 0.5}}], ids=["undamped", "kelvin_voigt"])
@pytest.mark.parametrize("mesh", ["two_plates", "half_plate"])
def test_what_limits_is_measured(mesh: str, damping: dict[str, Any]) -> None:
    """A stiffness that shortens the step by a third sets it, whatever is damped and however much of it is meshed."""
    found = {}
    for C in (300e9, 30e12):
        contact = {"kind": "compliant", "C_n": C, "C_s": C}
        model = Model(case({"mesh.kind": mesh, "faults.main.contact": contact, "damping": damping}))
        stable = stable_time_step(model)
        found[C] = stable, what_limits(model, stable)
    assert found[30e12][0] < 0.69 * found[300e9][0]
    assert found[300e9][1] == "set by the elements"
    assert found[30e12][1].startswith("set by the contact stiffness of faults.main")


def test_damping_and_step_ask_for_the_highest_frequency_once() -> None:
    damped = case({"damping": {"kelvin_voigt": {"fraction": 0.5}}, "faults.main.contact": COMPLIANT})
    with patch.object(spectrum, "_lanczos", wraps=spectrum._lanczos) as searched:
        model = Model(damped)
        with_contact = stable_time_step(model)
        assert searched.call_count == 1
        assert stable_time_step(model, []) > with_contact and searched.call_count == 2  # of the bodies alone


def test_a_highest_frequency_that_does_not_converge_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten iterations are one estimate, with nothing to compare it with; it was taken as the highest frequency."""
    monkeypatch.setattr(spectrum, "MOST_ITERATIONS", 10)
    with pytest.raises(RuptfxError, match=facts("not found in 10 iterations")):
        highest_frequency(Model(case({"faults.main.contact": COMPLIANT})))


@pytest.mark.parametrize("C_n", [300e9, 1e14])
def test_the_limit_is_the_limit(C_n: float) -> None:
    """Energy stays bounded just below 2 / omega_max and explodes just above."""
    moved = case({"order": 3, "faults.main.contact": {"kind": "compliant", "C_n": C_n, "C_s": 100e9}})
    model = Model(moved)
    stable = 2 / highest_frequency(model)
    random = np.random.default_rng(0)
    growth = []
    for factor in (0.985, 1.015):
        motion, state = LeapfrogMotion(model, factor * stable), model.initial_state()
        # Small enough to keep the interface closed: C_n u << 6 MPa.
        state.displacement[:] = 1e-16 * random.normal(size=len(state.displacement))
        advance(motion, state, 25 * motion.dt)
        before = np.linalg.norm(state.velocity)
        advance(motion, state, 25 * motion.dt)
        growth.append(np.linalg.norm(state.velocity) / before)
    # Per step above the limit: exp(2 acosh(1.015)), that is e^8.7 = 5800 in 25 steps, before the interface opens.
    assert growth[0] < 3 and growth[1] > 1000


def test_chosen_step_does_not_depend_on_the_last_digits() -> None:
    plain = case()
    dt = plain.stepper.bind(Model(plain)).dt
    assert float(f"{dt:.2e}") == pytest.approx(dt, rel=1e-12)


def test_safety_scales_the_step() -> None:
    dts = [(c := case({"stepper": {"kind": "leapfrog", "safety": s}})).stepper.bind(Model(c)).dt for s in (0.9, 0.45)]
    assert dts[0] / dts[1] == pytest.approx(2, rel=0.02)
