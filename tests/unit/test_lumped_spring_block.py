"""Spring-block chain: statics, momentum, single contacts, events, errors."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.messages import facts

from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.lumped.spring_block import SpringBlock
from ruptfx.lumped.spring_block.chain import Chain, Contacts, History, Integrator
from ruptfx.lumped.spring_block.events import Breaks, Event, catalogue, chaining, slow_fronts


def small(**changes: object) -> Chain:
    values = {
        "mass": 0.1,
        "damping": 0.0,
        "spring": 1e6,
        "drive_stiffness": 1e5,
        "drive_speed": 0.0,
        "contacts": np.full(4, 3),
        "contact_stiffness": 1e4,
        "contact_strength": 1.0,
        "scatter": 0.0,
        "delay": 1e-3,
    }
    return Chain(**{**values, **changes})  # type: ignore[arg-type]


def test_energy_of_an_undamped_chain_is_kept() -> None:
    chain = small()
    integrator = Integrator(chain, 0.1 * chain.stable_step(), seed=0)
    integrator.x[:] = integrator.x_old[:] = 1e-6 * np.array([1.0, -2.0, 0.5, 3.0])
    stiffness = chain.stiffness_matrix() + np.diag(np.full(4, 3e4))

    def energy() -> float:
        # Central differences keep v(t - dt/2)^2 m/2 + x(t) K x(t - dt) / 2 exactly.
        velocity = (integrator.x - integrator.x_old) / integrator.dt
        return 0.5 * chain.mass * velocity @ velocity + 0.5 * integrator.x @ stiffness @ integrator.x_old

    before = energy()
    integrator.advance(5000, History())
    assert energy() == pytest.approx(before, rel=1e-10)


def test_a_contact_breaks_at_its_threshold_and_returns_unstretched() -> None:
    # One contact per block, far stiffer than the springs: block 0 is pushed slowly until its contact breaks at 1 N.
    chain = small(contacts=np.ones(4, int), drive_speed=1e-3, damping=2e4, spring=1e2)
    integrator, history = Integrator(chain, 0.3 * chain.stable_step(), seed=0), History()
    while not history.break_time:
        integrator.advance(1, history)
    # The contact carries 1 N, the neighbour at most spring x_0 = 1e2 * 1e-4 N, and damping m eta v = 0.1 2e4 1e-3 N.
    assert history.break_block == [0] and history.break_count == [1]
    # It is seen to have broken at the end of the step in which it does.
    assert 1.0 / 1e4 < integrator.x[0] < 1.0 / 1e4 + 1e-3 * integrator.dt
    assert history.first_force == pytest.approx(1.0 + 1e-2 + 2.0, rel=0.1)
    contacts = integrator.contacts
    assert contacts.stiffness[0, 0] == 0
    steps = int(np.ceil(chain.delay / integrator.dt)) + 1
    integrator.advance(steps, history)
    assert contacts.stiffness[0, 0] > 0
    # It returned within the last steps, where the block then was.
    assert contacts.origin[0, 0] == pytest.approx(integrator.x[0], abs=3 * integrator.dt * 1e-1)


def test_matrix_and_source_follow_the_contacts() -> None:
    chain = small(scatter=0.2, drive_speed=5e-3, damping=1e3)
    integrator = Integrator(chain, 0.3 * chain.stable_step(), seed=4)
    integrator.advance(40_000, History())
    contacts = integrator.contacts
    diagonal = chain.stiffness_matrix() + np.diag(contacts.stiffness.sum(axis=1))
    half = chain.damping * integrator.dt / 2
    expected = 2 / (1 + half) * np.eye(4) - integrator.scale * diagonal
    assert integrator.matrix == pytest.approx(expected, rel=1e-9, abs=1e-9)
    pulled = integrator.scale * (contacts.stiffness * contacts.origin).sum(axis=1)
    assert integrator.source[1:] == pytest.approx(pulled[1:], rel=1e-6, abs=1e-15)


def test_thresholds_and_stiffnesses_are_coupled() -> None:
    contacts = Contacts(small(scatter=0.05, contacts=np.full(200, 100)), np.random.default_rng(0))
    # k = <k> sqrt(f / <f>), and the sample mean of 20 000 draws is within 4 standard errors.
    assert contacts.stiffness == pytest.approx(1e4 * np.sqrt(contacts.strength))
    assert contacts.strength.mean() == pytest.approx(1, abs=4 * 0.05 / np.sqrt(20_000))
    assert contacts.strength.std() == pytest.approx(0.05, rel=0.03)


def test_ageing_raises_thresholds_with_the_logarithm_of_time() -> None:
    contacts = Contacts(small(ageing=0.1, ageing_time=2.0), np.random.default_rng(0))
    young, old = (contacts.reach(0, t)[0] for t in (0.0, 2.0 * (np.e - 1)))
    assert old / young == pytest.approx(1.1)  # 1 + 0.1 ln(e)


def test_loading_height_moves_contacts_forward_and_keeps_their_number() -> None:
    # Tilt 6 (F/F_N) h / L = 6 * 0.5 * 0.01 / 0.14 = 0.2143 at either end.
    number = SpringBlock(loading_height=0.01, contacts=1000).chain().contacts
    assert (number[0], number[-1]) == (786, 1214)
    assert number.sum() == pytest.approx(70_000, rel=1e-3)


def test_events_of_a_made_up_run() -> None:
    # Blocks 0..3 break one after the other within 3 ms, and again after 0.5 s only block 0.
    breaks = Breaks(
        np.array([0.1, 0.101, 0.102, 0.103, 0.6]), np.array([0, 1, 2, 3, 0]), np.full(5, 10), 0.005, np.full(4, 10)
    )
    time = np.linspace(0, 1, 1001)
    force = np.where(time < 0.1, 1000 * time, 50.0)
    first, second = catalogue(breaks, time, force, large_drop=40.0)
    assert (first.blocks, first.reach, first.large, first.detachments) == (4, 4, True, 4)
    assert first.drop == pytest.approx(first.force - 50)
    assert (second.blocks, second.large) == (1, False)
    assert breaks.detached(0, np.array([0.099, 0.1, 0.1049, 0.1051])).tolist() == [0, 1, 1, 0]


def test_a_block_detaches_once_when_half_of_its_contacts_have_broken() -> None:
    """Five of ten contacts break, and the others after 1 ms; all are attached again when five break after 0.1 s."""
    breaks = Breaks(np.array([0.1, 0.101, 0.2]), np.zeros(3, int), np.array([5, 5, 5]), 0.005, np.array([10]))
    times, blocks = breaks.detachments()
    assert times.tolist() == [0.1, 0.2] and blocks.tolist() == [0, 0]


def test_the_precursor_figure_says_how_many_points_and_their_correlation() -> None:
    data = SpringBlock(blocks=20, contacts=20, interface_ratio=50, large_events=1, duration=0.5).run()
    assert not data.event_large.any()
    count = data.sizes["event"]
    correlation = np.corrcoef(data.event_force.values, data.event_reach.values)[0, 1]
    assert count > int(data.precursors) and float(data.length_correlation) == pytest.approx(correlation)
    (ax,) = SpringBlock.figures(data)["precursor_length"].axes
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert f"least squares through 0 (n = {count}, r = {correlation:.2f})" in labels
    assert len(labels) == 2  # no large event that was not
    assert len(ax.collections[0].get_offsets()) == count


def test_slow_fronts_are_blocks_that_move_alone() -> None:
    # 10 ms from block to block is more than the delay of 5 ms and less than 20 of them: a front of 100 blocks/s.
    alone = Breaks(0.01 * np.arange(1, 7), np.arange(6), np.full(6, 10), 0.005, np.full(8, 10))
    (front,) = slow_fronts(alone, np.inf)
    assert (front.first_block, front.last_block) == (0, 5)
    assert front.speed == pytest.approx(100)
    together = Breaks(0.001 * np.arange(1, 7), np.arange(6), np.full(6, 10), 0.005, np.full(8, 10))
    assert slow_fronts(together, np.inf) == []


def test_fronts_that_start_at_several_places_are_chained() -> None:
    # Two fronts of 1000 blocks/s start together at blocks 0 and 10: together they cover 20 blocks in 9 ms.
    times = 1e-3 * np.concatenate([np.arange(10), np.arange(10)])
    event = Event(0, 0.009, 0, 0, 0, 20, 20, 20, False, np.arange(20), times)
    assert chaining(event) == pytest.approx(20 / 9e-3 / 1000, rel=0.2)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"contatcs": 3}, "did you mean 'contacts'"),
        ({"loading_height": 0.1}, "lift off"),
        ({"sample_interval": 1e-9}, r"sample_interval = 1e-09 s: must be at least the largest stable step, .* s"),
        ({"scatter": -0.1}, "scatter"),
    ],
)
def test_bad_cases_name_the_key(change: dict[str, object], message: str) -> None:
    with pytest.raises(CaseError, match=facts(message)):
        parse_case({"kind": "spring_block", **change})


@pytest.mark.parametrize("apart, events", [(1.5, 1), (2.5, 2)])
def test_detachments_within_two_delays_are_one_event(apart: float, events: int) -> None:
    time, force = np.linspace(0.0, 20.0, 201), np.ones(201)
    breaks = Breaks(np.array([5.0, 5.0 + apart]), np.array([0, 1]), np.array([2, 2]), 1.0, np.array([2, 2]))
    assert len(catalogue(breaks, time, force, 0.5)) == events


@pytest.mark.slow
def test_damping_over_the_frequency_of_the_contacts_decides_the_speed_of_fronts() -> None:
    """The printed 3.45e4 1/s over sqrt(K_s N / M) = 9745 1/s is 3.54, above critical; fronts are slower than 0.1 there.

    A hundredth of the damping at the same frequency gives more than half of the wave speed, as the page says.
    """
    model = SpringBlock(contacts=30, large_events=1, duration=3.0)
    frequency = np.sqrt(model.stiffness * model.blocks / model.mass)
    assert model.damping / frequency == pytest.approx(3.5404, rel=1e-4)
    slow, fast = (model.model_copy(update={"damping": 3.45e4 / factor}).run() for factor in (1, 100))
    assert float(slow.front_speed) < 0.1 and float(fast.front_speed) > 0.5
