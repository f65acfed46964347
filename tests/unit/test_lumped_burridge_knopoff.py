"""Burridge-Knopoff chain: one block exactly and against an integrator, energy, and what the drive asks for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.lumped.burridge_knopoff import BurridgeKnopoff
from ruptfx.lumped.burridge_knopoff.chain import Chain, load, slip_event


def test_one_block_slips_as_an_oscillator() -> None:
    """Without weakening u'' = -u - (1 - sigma) from u = -1: it comes to rest 2 sigma further, after pi."""
    chain, u = Chain(0.0, 0.3, 0.0), np.array([-1.0])
    event = slip_event(chain, u, 1e-3)
    assert event.slip[0] == pytest.approx(0.6, rel=1e-3) and event.duration == pytest.approx(np.pi, rel=2e-3)
    assert event.dissipated == pytest.approx(0.7 * 0.6, rel=1e-3)


def test_period_of_one_block() -> None:
    """2 drop strength / (leaf_stiffness drive_speed) between events: 2 * 0.3 * 100 / (1e4 * 1e-6) = 6000 s."""
    model = BurridgeKnopoff(blocks=1, drop=0.3, weakening=0.0, events=3, discarded=1, step=1e-2)
    data = model.run()
    np.testing.assert_allclose(np.diff(data.time), 6000.0, rtol=1e-2)
    np.testing.assert_allclose(data.duration, np.pi * np.sqrt(1.0 / 1e4), rtol=1e-2)
    # A slip of 2 drop strength / stiffness = 6 mm takes (1 - drop) strength times the slip from the spring.
    np.testing.assert_allclose(data.slip[:, 0], 6e-3, rtol=1e-2)
    np.testing.assert_allclose(data.released, 70.0 * 6e-3, rtol=1e-2)


def test_weakening_against_an_integrator() -> None:
    chain = Chain(0.0, 0.05, 1.5)

    def motion(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -y[0] - 0.95 / (1 + 3.0 * y[1] / 0.95)]

    def rest(time: float, y: np.ndarray) -> float:
        return y[1] + (time < 0.1)

    rest.terminal, rest.direction = True, -1  # type: ignore[attr-defined]
    exact = solve_ivp(motion, (0, 20), [-1.0, 0.0], events=rest, rtol=1e-10, atol=1e-12)
    slips = [slip_event(chain, np.array([-1.0]), dt).slip[0] for dt in (4e-3, 2e-3)]
    errors = [abs(slip - (exact.y[0, -1] + 1)) for slip in slips]
    assert errors[1] < 2e-3 and errors[1] < 0.6 * errors[0]


def test_energy_is_accounted_for() -> None:
    data = BurridgeKnopoff(blocks=10, coupling_stiffness=4e4, events=300, discarded=100).run()
    assert int(data.blocks.min()) == 1 and int(data.blocks.max()) == 10
    assert float(data.energy_error) < 1e-9


def test_the_slip_in_events_of_all_blocks() -> None:
    data = BurridgeKnopoff(blocks=4, coupling_stiffness=4e4, events=100, discarded=20).run()
    slip = data["slip"].values
    whole = float(slip[(slip > 0).all(axis=1)].sum() / slip.sum())
    assert 0 < whole < 1 and float(data["slip_in_large"]) == pytest.approx(whole, rel=1e-12)


def test_blocks_follow_the_drive() -> None:
    """What the leaf springs lose in an event is the slip; between events they gain what the drive moves."""
    model = BurridgeKnopoff(blocks=20, events=30, discarded=0)
    data = model.run()
    fall = (data.force[:, 0] - data.force[:, 1]).values
    np.testing.assert_allclose(fall, model.leaf_stiffness * data.moment.values / 20, rtol=1e-9, atol=1e-12)
    rise = data.force[1:, 0].values - data.force[:-1, 1].values
    np.testing.assert_allclose(rise, model.leaf_stiffness * model.drive_speed * np.diff(data.time), atol=1e-9)


def test_no_block_is_left_above_its_strength_or_slips_back() -> None:
    chain, u = Chain(16.0, 0.01, 2.5), np.random.default_rng(3).uniform(-1e-2, 1e-2, 40)
    for _ in range(20):
        assert load(chain, u) >= 0
        event = slip_event(chain, u, 0.2 * chain.stable_step())
        assert chain.spring_force(u).max() <= 1 and event.slip.min() >= 0 and event.released > 0


def test_bad_values_name_the_key() -> None:
    with pytest.raises(CaseError, match=r"drop = 0\.0"):
        parse_case({"kind": "burridge_knopoff", "drop": 0.0})
