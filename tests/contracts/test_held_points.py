"""Points whose mass couples normal and tangential motion: the conditions of contact after a step, by definition."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.interface_points import POINTS, an_interface

from ruptfx.app.check_law.examples import friction

pytest.importorskip("dolfinx")

from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.faults.fault_step import FaultStep
from ruptfx.interfaces.faults.held_points import coupled_points, mobility_blocks
from ruptfx.interfaces.faults.points import Clock
from ruptfx.laws.contact.split_node import SplitNode
from ruptfx.laws.friction.coulomb import Coulomb

pytestmark = pytest.mark.fem

JUMPING = [("cohesion", "coulomb"), ("memory_constant_time", "coulomb")]
"""Laws whose strength is lost at once on opening. With two tangents tractions turn abruptly where sliding stops."""
LAWS = [("coulomb", None), ("linear_slip_weakening", None), ("rate_and_state_ageing", None), *JUMPING]
DT = 1e-7


def masses(kind: str, components: int, random: np.random.Generator) -> np.ndarray:
    """Inverse masses [1/kg], shape (2 POINTS, components)."""
    inverse = np.repeat(random.uniform(3e4, 1e5, 2 * POINTS)[:, None], components, axis=1)
    if kind == "one side held":
        inverse[random.random(2 * POINTS) < 0.3, 0] = 0.0
    elif kind == "dashpots":
        inverse *= random.uniform(0.3, 1.0, inverse.shape)
    return inverse


def a_fault(law: object, components: int, random: np.random.Generator) -> Fault:
    face = an_interface(components, random)
    normal = np.where(random.random(POINTS) < 0.1, 0.0, random.uniform(1e5, 1e7, POINTS))
    shear = random.normal(size=(POINTS, face.tangents)) * 1e5
    along = np.eye(face.tangents)[np.zeros(POINTS, dtype=int)]
    return Fault("main", face, SplitNode(), law, normal, shear, along)


@pytest.mark.parametrize("components", [2, 3])
@pytest.mark.parametrize("kind", ["one side held", "dashpots"])
@pytest.mark.parametrize("law", LAWS, ids=["-".join(filter(None, law)) for law in LAWS])
def test_contact_conditions_hold_after_every_step(law: tuple[str, str | None], kind: str, components: int) -> None:
    """Closed points stay closed, open ones do not overlap, and the slip rate of the law is the jump of the velocities.

    Velocities are of the order of 1 m/s, tractions of 10 MPa.
    """
    random = np.random.default_rng(5)
    fault = a_fault(friction(*law), components, random)
    face, inverse = fault.interface, masses(kind, components, random)
    assert len(coupled_points(face, inverse.ravel())) > POINTS / 3
    steps = [FaultStep(fault, inverse.ravel(), Clock.of_step(DT, number), 1e-3) for number in range(4)]
    state, velocity, slid, opened = fault.initial_state(), np.zeros(inverse.size), 0.0, 0.0
    for number, step in enumerate(steps):
        # Gaps that a step may close. A point held on both sides cannot open along the normal alone.
        both = (inverse[face.plus] + inverse[face.minus] == 0).any(axis=1)
        jump = np.abs(random.normal(size=(POINTS, components))) * 2e-8 * ~both[:, None]
        displacement, force = np.zeros((2 * POINTS, components)), np.zeros(inverse.size)
        displacement[face.plus] = np.einsum("ikc,ik->ic", face.frame, jump * (random.random(POINTS) < 0.3)[:, None])
        displacement, velocity = displacement.ravel(), velocity + 0.5**number * random.normal(size=inverse.size)
        velocity[inverse.ravel() == 0] = 0.0
        before = velocity.copy()
        step(state, displacement, velocity, force, number * DT)
        opening, _ = face.split(face.rate(displacement))
        rate, slip_rate = face.split(face.rate(velocity))
        gap, sigma = opening + DT * rate, state["normal_stress"]
        wrong = np.abs(fault.components(state, "mean_slip_rate") - slip_rate).max(axis=1) * (sigma > 0) > 1e-9
        wrong |= (gap < -1e-16) | (np.abs(gap) * (sigma > 0) > 1e-16)
        assert np.mean(wrong) <= (0.03 if components == 3 or law in JUMPING else 0.0)
        assert sigma.min() >= 0
        assert not fault.components(state, "shear_traction")[sigma == 0].any()
        # The force on the nodes changes their velocity by its own inverse mass, along every axis.
        np.testing.assert_allclose(velocity - before, step.clock.kick * inverse.ravel() * force, atol=1e-12)
        slid = max(slid, np.mean((sigma > 0) & (np.abs(slip_rate).max(axis=1) > 1e-6)))
        opened = max(opened, np.mean(sigma == 0))
    assert slid > 0.05 and opened > 0.05


@pytest.mark.parametrize("components", [2, 3])
@pytest.mark.parametrize("kind", ["one side held", "dashpots"])
def test_coulomb_friction_at_coupled_points(kind: str, components: int) -> None:
    """|T| = mu sigma along the slip rate where points slide, less where they stick: the first step, from rest."""
    random = np.random.default_rng(6)
    mu = 0.3
    fault = a_fault(Coulomb(mu_d=mu), components, random)
    face, inverse = fault.interface, masses(kind, components, random)
    velocity = np.where(inverse.ravel() > 0, random.normal(size=inverse.size), 0.0)
    state, none = fault.initial_state(), np.zeros(inverse.size)
    FaultStep(fault, inverse.ravel(), Clock.of_step(DT, 2), 1e-3)(state, none, velocity, none.copy(), 0.0)
    _, slip_rate = face.split(face.rate(velocity))
    traction, sigma = fault.components(state, "shear_traction"), state["normal_stress"]
    size, speed = np.linalg.norm(traction, axis=1), np.linalg.norm(slip_rate, axis=1)
    slides, sticks = (sigma > 0) & (speed > 1e-9), (sigma > 0) & (speed <= 1e-9)
    assert slides.sum() > 10 and sticks.sum() > 5
    np.testing.assert_allclose(size[slides], mu * sigma[slides], rtol=1e-10)
    np.testing.assert_allclose(
        traction[slides], (mu * sigma / np.maximum(speed, 1e-300))[slides, None] * slip_rate[slides], atol=1e-4 * 1e3
    )
    assert np.all(size[sticks] <= mu * sigma[sticks] * (1 + 1e-12))


def test_points_of_nodes_with_equal_masses_are_not_coupled() -> None:
    random = np.random.default_rng(1)
    face = an_interface(3, random)
    inverse = np.repeat(random.uniform(1e4, 1e5, 2 * POINTS)[:, None], 3, axis=1)
    assert len(coupled_points(face, inverse.ravel())) == 0
    inverse[face.plus[4], 1] = 0.0
    assert coupled_points(face, inverse.ravel()).tolist() == [4]
    # 1/m of the free side, and of both but along y: R diag R' by hand, for one entry.
    plus, minus, rows = inverse[face.plus[4]], inverse[face.minus[4]], face.rows[4]
    expected = sum(rows[0, c] * rows[2, c] * (plus[c] + minus[c]) for c in range(3))
    assert mobility_blocks(face, inverse.ravel())[4, 0, 2] == pytest.approx(expected, rel=1e-12)
