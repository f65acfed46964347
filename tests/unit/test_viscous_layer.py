"""Kelvin-Voigt damping of some elements in the sweep of the bulk kernel, and by an operator of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, plates

pytest.importorskip("dolfinx")

from ruptfx import RuptfxError
from ruptfx.bodies.operators import matrix_free
from ruptfx.bodies.operators.matrix_free import MatrixFree
from ruptfx.bodies.spectrum import stable_time_step
from ruptfx.case import Case, parse_case
from ruptfx.interfaces.mechanisms.viscosity import KelvinVoigt, ViscousLayer
from ruptfx.platform import fem
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

PUSH = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 20.0, "ramp": 1e-6}
VARYING = {**HOMALITE, "young_modulus": {
    "kind": "random", "mean": 4e9, "standard_deviation": 5e8, "correlation_length": 1e-3, "seed": 4,
}}  # fmt: skip
FIBRES = {
    "kind": "orthotropic_elastic", "density": 1600.0, "E_1": 80e9, "E_2": 9e9, "E_3": 9e9, "nu_12": 0.25,
    "nu_13": 0.25, "nu_23": 0.4, "G_12": 4e9, "G_13": 4e9, "G_23": 3e9, "angle": 0.4,
}  # fmt: skip


def stepped(
    case: Case, comm: Any = fem.MPI.COMM_WORLD
) -> tuple[dict[str, float], np.ndarray, MatrixFree | None, list[Any]]:
    """Return energies and displacement after 60 steps, the operator and the mechanisms."""
    model = Model(case, comm)
    motion, state = case.stepper.bind(model), model.initial_state()
    for _ in range(60):
        state.wants_energies = True
        motion.step(state)
    operator = model.operator if isinstance(model.operator, MatrixFree) else None
    energies = motion.energies(state)
    return energies, state.displacement, operator, motion.mechanisms


@pytest.mark.parametrize("changes", [
    {}, {"damping.kelvin_voigt": {"bodies": ["lower"], "fraction": 0.3}}, {"materials.default": VARYING},
    {"materials.lower": FIBRES}, {"damping.mass": 1e4}, {"plane": "antiplane"}, {"order": 5},
])  # fmt: skip
def test_in_the_sweep_and_apart_are_equal(monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any]) -> None:
    """Blocks are so small that damped nodes move on before most elements are computed."""
    monkeypatch.setattr(matrix_free, "BLOCK_NODES", 64)
    found = []
    for operator in ("matrix_free", "ufl_form"):
        push = PUSH if changes.get("plane") != "antiplane" else {**PUSH, "component": "z"}
        energies, displacement, kernel, mechanisms = stepped(parse_case(plates({
            "plane": "strain", "boundaries": [push], "operator": operator, "mesh.element_size": 5e-4,
            "damping.kelvin_voigt": {"fraction": 0.3}, **changes,
        })))  # fmt: skip
        damping = [type(each) for each in mechanisms if isinstance(each, KelvinVoigt | ViscousLayer)]
        assert damping == [ViscousLayer if kernel else KelvinVoigt]
        if kernel:
            assert kernel._blocks > 8
            assert energies["damping"] > 0
        found.append([np.array([*energies.values()]), displacement])
    for fused, apart in zip(*found, strict=True):
        np.testing.assert_allclose(fused, apart, rtol=1e-9, atol=1e-11 * np.abs(apart).max())


@pytest.mark.parametrize("stepper", [{}, {"safety": 1.0}, {"time_step": 2e-8}])
def test_the_damping_of_newmark_steps_is_that_of_their_time_step(stepper: dict[str, Any]) -> None:
    """With gamma = 0.6 the viscosity is a tenth of the step; the largest step is sqrt(1 / 1.2) of the usual one."""
    table = plates({"plane": "strain", "boundaries": [PUSH], "mesh.element_size": 5e-4})
    usual = Model(parse_case(table), fem.MPI.COMM_WORLD)
    table["damping"] = {"kelvin_voigt": {"beta_2": 0.6}}
    table["stepper"] = {"kind": "leapfrog", **stepper}
    case = parse_case(table)
    model = Model(case, fem.MPI.COMM_WORLD)
    dt = case.stepper.bind(model).dt
    assert model.viscosity is not None and model.viscosity.nodes.all()
    assert model.viscosity.eta == pytest.approx(0.1 * dt, rel=5e-3)  # the step is rounded down to three digits
    if stepper == {"safety": 1.0}:
        assert stable_time_step(model) == pytest.approx(stable_time_step(usual) / np.sqrt(1.2), rel=1e-9)


@pytest.mark.parametrize("gamma", [0.55, 0.8])
def test_a_standing_wave_is_that_of_explicit_newmark_steps(gamma: float) -> None:
    """A lumped bar of linear elements has the mode cos(k x) with the frequency 2 c/h sin(k h/2)."""
    h, dt, length = 2e-3, 2e-7, 12e-3
    case = parse_case(plates({
        "order": 1, "materials.default.poisson_ratio": 0.0, "damping.kelvin_voigt.beta_2": gamma,
        "stepper": {"kind": "leapfrog", "time_step": dt},
    }))  # fmt: skip
    model = Model(case, fem.MPI.COMM_WORLD)
    motion, state = case.stepper.bind(model), model.initial_state()
    k = 3 * np.pi / length
    x = model.coordinates[:, 0]
    u = state.displacement.reshape(-1, 2)
    u[:, 0] = 1e-6 * np.cos(k * x)
    amplitudes = [1e-6]
    for _ in range(60):
        motion.step(state)
        u = state.displacement.reshape(-1, 2)
        amplitude = u[:, 0] @ np.cos(k * x) / (np.cos(k * x) ** 2).sum()
        np.testing.assert_allclose(u, np.outer(amplitude * np.cos(k * x), [1, 0]), atol=1e-15)
        amplitudes.append(float(amplitude))
    squared = HOMALITE["young_modulus"] / HOMALITE["density"] * (2 / h * np.sin(k * h / 2)) ** 2
    position, acceleration = amplitudes[0], -squared * amplitudes[0]
    velocity = (amplitudes[1] - position) / dt - dt / 2 * acceleration
    for expected in amplitudes[1:]:
        position += dt * velocity + dt**2 / 2 * acceleration
        before, acceleration = acceleration, -squared * position
        velocity += dt * ((1 - gamma) * before + gamma * acceleration)
        assert position == pytest.approx(expected, rel=0, abs=1e-15)
    # The product of both roots of the recurrence: the square of the amplitude is multiplied by it in a step.
    q = np.array(amplitudes)
    area = q[1:-1] ** 2 - q[:-2] * q[2:]
    np.testing.assert_allclose(area[1:] / area[:-1], 1 - (gamma - 0.5) * squared * dt**2, rtol=1e-6)


def test_the_damping_of_newmark_steps_is_given_alone() -> None:
    with pytest.raises(RuptfxError, match=r"beta_2 = 0\.6\b"):
        parse_case(plates({"damping.kelvin_voigt": {"beta_2": 0.6, "eta": 1e-8, "bodies": ["lower"]}}))


def test_steps_for_inserted_sweeps_need_their_force() -> None:
    """Their nodes would not move on."""
    *_, kernel, _ = stepped(parse_case(plates({"boundaries": [PUSH], "damping.kelvin_voigt": {"fraction": 0.3}})))
    assert kernel is not None
    vectors = [np.zeros(kernel._nodes * 2) for _ in range(3)]
    with pytest.raises(AssertionError, match="inserted sweeps"):
        kernel.step(*vectors, np.ones(kernel._nodes), 1e-9)
