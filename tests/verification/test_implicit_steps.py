"""Implicit steps against exact solutions and against explicit ones: order, stability, energy, shear impact."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, advance, case, impact, march

pytest.importorskip("dolfinx")

from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.case import parse_case
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.steppers.generalized_alpha import GeneralizedAlpha

pytestmark = pytest.mark.fem

RIGID = {"kind": "augmented_lagrangian"}
HELD = [{"kind": "driven", "edge": "lower.bottom", "component": component, "velocity": 0.0} for component in "xy"]


def implicit(scheme: str, **values: Any) -> dict[str, Any]:
    return {"kind": "generalized_alpha", "scheme": scheme, **values}


@pytest.mark.parametrize("scheme", ["average_acceleration", "hht", "generalized_alpha"])
def test_second_order_on_a_manufactured_motion(scheme: str) -> None:
    """u = U phi with the load that makes u(t) = sin^2(omega t) exact for one mode of the discrete bodies.

    The mode is that of the stuck, compliant plates held below, by inverse iteration with the matrix of the stepper;
    the load is M phi (u'' + omega_1^2 u) at both ends of a step. Error against the exact solution at equal time.
    """
    errors = []
    for steps in (20, 40, 80):
        duration = 1e-5
        bound = case({
            "order": 2, "duration": duration, "boundaries": HELD,
            "stepper": implicit(scheme, time_step=duration / steps),
        })  # fmt: skip
        model = Model(bound)
        motion, state = bound.stepper.bind(model), model.initial_state()
        mode, square = lowest_mode(motion)
        omega = 2 * np.pi / 1.3e-5
        size = 1e-9 / np.abs(mode).max()

        def load(time: float, mode: Any = mode, square: float = square, omega: float = omega, size: float = size,
                 model: Any = model) -> np.ndarray:  # fmt: skip
            # d2/dt2 sin^2 = 2 omega^2 cos(2 omega t)
            wanted = 2 * omega**2 * np.cos(2 * omega * time) + square * np.sin(omega * time) ** 2
            return size * wanted * model.mass * mode

        motion._equilibrium.forces.load = load
        advance(motion, state, duration)
        exact = size * np.sin(omega * duration) ** 2 * mode
        errors.append(np.linalg.norm(state.displacement - exact) / np.linalg.norm(size * mode))
    # Halving the step divides the error by four.
    assert all(3.6 < coarse / fine < 4.4 for coarse, fine in pairwise(errors)), errors
    assert errors[-1] < 0.02


@pytest.mark.parametrize("scheme, rho", [
    ("average_acceleration", 1.0), ("hht", 0.5), ("hht", 0.8), ("generalized_alpha", 0.0), ("generalized_alpha", 0.8),
])  # fmt: skip
def test_unresolved_motion_is_kept_to_the_spectral_radius(scheme: str, rho: float) -> None:
    """Eigenvalues of a step of u'' + omega^2 u = 0 with omega dt = 1e4, for u, dt u' and dt^2 u''."""
    alpha_m, alpha_f, gamma, beta = GeneralizedAlpha(scheme=scheme, spectral_radius=rho).weights()
    square = 1e8
    # (1 - alpha_m) a1 + alpha_m a0 + square ((1 - alpha_f) u1 + alpha_f u0) = 0 and Newmark's rules.
    new = np.array([[1, 0, -beta], [0, 1, -gamma], [square * (1 - alpha_f), 0, 1 - alpha_m]])
    old = np.array([[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [-square * alpha_f, 0, -alpha_m]])
    assert np.abs(np.linalg.eigvals(np.linalg.solve(new, old))).max() == pytest.approx(rho, abs=0.02)


def test_halved_steps_double_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """No step beyond 0.3 of the length is solved until the fourth; then every step is twice the one before, at most."""
    bound = case({"boundaries": HELD, "stepper": implicit("generalized_alpha", time_step=1e-6)})
    model = Model(bound)
    motion, state, made = bound.stepper.bind(model), model.initial_state(), list[float]()

    def advance_or_fail(state: Any, dt: float, carried: np.ndarray) -> None:
        if len(made) < 3 and dt > 0.3e-6:
            raise ConvergenceError("too long")
        made.append(dt)

    monkeypatch.setattr(motion, "_advance", advance_or_fail)
    for _ in range(6):
        motion.step(state)
    assert made == pytest.approx([0.25e-6, 0.25e-6, 0.25e-6, 0.5e-6, 1e-6, 1e-6])


def lowest_mode(motion: Any) -> tuple[np.ndarray, float]:
    """Lowest mode and its squared angular frequency, of the bodies and the stuck interface."""
    equilibrium, model = motion._equilibrium, motion.model
    free = model.free_inverse_mass() > 0
    state = model.initial_state()
    vector = np.where(free, 1.0, 0.0)
    square = 0.0
    for _ in range(60):
        # One linear solve: K u = M v, from rest, in an interface that stays stuck.
        scale = 1e-3 / np.abs(model.mass * vector).max()
        solved = equilibrium.solve(state, 1.0, added=scale * model.mass * vector).displacement / scale
        square = float(vector @ (model.mass * vector)) / float(vector @ (model.mass * solved))
        vector = solved / np.abs(solved).max()
    return vector, square


@pytest.mark.parametrize("scheme", ["average_acceleration", "generalized_alpha"])
def test_stable_at_fifty_times_the_explicit_step(scheme: str) -> None:
    """A wave packet in all modes: energy neither grows nor, with average acceleration, shrinks in 200 such steps."""
    thrown = case({"order": 3, "boundaries": HELD, "stepper": implicit(scheme, courant=50.0)})
    model = Model(thrown)
    motion, state = thrown.stepper.bind(model), model.initial_state()
    assert motion.dt > 45 * stable_time_step(model)
    # Small enough to keep the interface closed: stresses of rho c v = 0.3 MPa.
    random = np.random.default_rng(0).normal(size=len(model.mass))
    state.velocity[:] = np.where(model.free_inverse_mass() > 0, 0.1 * random, 0)
    energies = []
    for _ in range(200):
        motion.step(state)
        energy = motion.energies(state)
        energies.append(energy["kinetic"] + energy["strain"] + energy["interface_elastic"] - energy["boundary_work"])
    assert max(energies) <= energies[0] * (1 + 1e-9)
    if scheme == "average_acceleration":
        assert min(energies) > energies[0] * (1 - 1e-9)


def test_average_acceleration_conserves_energy() -> None:
    """Without friction and loads the energy changes by less than 1e-10 of itself in every step."""
    free = case({
        "order": 3, "boundaries": HELD, "stepper": implicit("average_acceleration", courant=3.0),
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.0},
    })  # fmt: skip
    model = Model(free)
    motion, state = free.stepper.bind(model), model.initial_state()
    x = model.coordinates
    state.velocity[:] = np.where(
        model.free_inverse_mass() > 0, 0.1 * np.sin(900 * np.repeat(x[:, 0], 2) + 400 * np.repeat(x[:, 1], 2)), 0
    )
    totals = []
    for _ in range(40):
        motion.step(state)
        energy = motion.energies(state)
        totals.append(energy["kinetic"] + energy["strain"] + energy["interface_elastic"] - energy["boundary_work"])
    assert np.abs(np.diff(totals)).max() < 1e-10 * totals[0]
    # It slid freely, and the energy was everywhere.
    assert np.abs(state.faults["main"]["slip"]).max() > 1e-7 and energy["strain"] > 0.1 * totals[0]


def test_implicit_and_explicit_steps_agree_on_the_shear_impact() -> None:
    """Slip rates at equal mesh: within 2 % of each other at the same step, of the limit of short steps as it shrinks.

    At a point the slip rate begins with a jump, so that distances to the limit are measured over all points and times.
    """
    changes = {"order": 2, "duration": 12e-6, "mesh.length": 24e-3, "mesh.height": 8e-3}
    stable = stable_time_step(Model(parse_case(impact(6e6, 2.0, changes=changes))))

    def slip_rates(stepper: dict[str, Any], factor: float) -> np.ndarray:
        rates = []
        steps = np.ceil(12e-6 / (factor * stable))
        loaded = impact(6e6, 2.0, changes={**changes, "stepper": {**stepper, "time_step": 12e-6 / steps}})
        march(
            parse_case(loaded), watch=lambda now: rates.append((now.fault_time, now.faults["main"]["slip_rate"].copy()))
        )
        times, values = np.array([time for time, _ in rates]), np.array([rate for _, rate in rates])
        wanted = np.linspace(4e-6, 11e-6, 60)
        return np.stack([np.interp(wanted, times, column) for column in values.T])

    def distance(ours: np.ndarray, theirs: np.ndarray) -> float:
        return float(np.linalg.norm(ours - theirs) / np.linalg.norm(theirs))

    limit, same = (slip_rates({"kind": "leapfrog"}, factor) for factor in (0.15, 0.3))
    assert limit.max() > 0.5
    ours = [slip_rates(implicit("average_acceleration"), factor) for factor in (1.2, 0.6, 0.3)]
    errors = [distance(rates, limit) for rates in ours]
    assert errors[0] > 1.5 * errors[1] > 2.25 * errors[2] and errors[2] < 0.02, errors
    assert np.abs(ours[2] - same).max() < 0.02 * same.max() and distance(ours[2], same) < 0.005


def test_sticking_is_exact() -> None:
    """Augmented Lagrangian: no jump along a stuck interface, none across a closed one, to 1e-8 of the traction."""
    pressed = case({
        "order": 2, "boundaries": [*HELD, {"kind": "traction", "edge": "upper.top", "traction": [1e6, -2e6]}],
        "faults.main.contact": RIGID, "stepper": implicit("generalized_alpha"), "duration": 1e-5,
    })  # fmt: skip
    model, _, state = march(pressed)
    fault = model.faults[0]
    jump = np.abs(fault.interface.jump(state.displacement)).max()
    # A traction of 6 MPa moves a node by 6 MPa over the diagonal of K / w, some 1e-6 m; penalty 100.
    compliant = march(case({**changes_of(pressed), "faults.main.contact": COMPLIANT}))[2]
    elastic = np.abs(model.faults[0].interface.jump(compliant.displacement)).max()
    assert jump < 1e-8 * elastic
    assert np.abs(state.faults["main"]["shear_traction"]).max() > 1e5


def changes_of(given: Any) -> dict[str, Any]:
    table = given.table()
    return {"order": 2, "boundaries": table["boundaries"], "stepper": table["stepper"], "duration": table["duration"]}
