"""Loading in stages: what goes on, what changes smoothly, what is refused."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.small_cases import SPLIT, advance, case, plates

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx import RuptfxError
from ruptfx.bodies.boundaries import PrescribedMotion
from ruptfx.case import parse_case
from ruptfx.run import stages
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate
from ruptfx.run.stages import Staged

pytestmark = pytest.mark.fem

COMMON = {
    "order": 2, "faults.main.contact": SPLIT, "faults.main.friction": {"kind": "coulomb", "mu_d": 0.3},
    "stepper": {"kind": "leapfrog", "time_step": 5e-8},
}  # fmt: skip


def loads(velocity: float, traction: float, ramp: float) -> list[dict[str, Any]]:
    return [
        {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": velocity, "ramp": ramp},
        {"kind": "traction", "edge": "upper.top", "traction": [0.0, traction], "ramp": ramp},
    ]


def test_stages_that_change_nothing() -> None:
    """Ramped loads of the first stage, held in the second: as without stages, from one step to the next."""
    alone = parse_case(plates({**COMMON, "duration": 8e-6, "boundaries": loads(4.0, -1e6, 2e-6)}))
    cut = parse_case(plates({**COMMON, "duration": 8e-6, "stages": [
        {"duration": 3e-6, "boundaries": loads(4.0, -1e6, 2e-6)},
        {"duration": 5e-6, "boundaries": loads(4.0, -1e6, 0.0)},
    ]}))  # fmt: skip
    found = []
    for given in (alone, cut):
        model = Model(given)
        motion = stages.bind(model)
        state = advance(motion, model.initial_state(), given.duration)
        energy = motion.energies(state)
        work = energy.pop("boundary_work")
        assert abs(work - sum(energy.values())) < 1e-10 * work
        found.append((state.velocity, state.faults["main"]["slip"]))
    assert found[0][1].max() > 1e-6
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12 * np.abs(one).max())


def test_from_the_old_amount_to_the_new_one() -> None:
    """Press in 1 us, hold 2 us, then drive in 4 us from rest to 2 m/s while the pressure falls to a quarter; then
    back, without pressure."""
    given = parse_case(plates({**COMMON, "duration": 12e-6, "stages": [
        {"duration": 3e-6, "boundaries": loads(0.0, -4e6, 1e-6)},
        {"duration": 5e-6, "boundaries": loads(2.0, -1e6, 4e-6)},
        {"duration": 4e-6, "boundaries": loads(-2.0, 0.0, 2e-6)},
    ]}))  # fmt: skip
    model = Model(given)
    staged = stages.bind(model)
    assert isinstance(staged, Staged) and np.allclose(staged.starts, [0, 3e-6, 8e-6])
    press, shear, back = (stage.loads for stage in staged._models)

    def pressure(load: Any, time: float) -> float:
        # The force on the top, 12 mm long [N/m], over its length.
        return load.force(time)[1::2].sum() / 12e-3

    times = np.array([0.5e-6, 1e-6, 3e-6])
    np.testing.assert_allclose([pressure(press, t) for t in times], [-2e6, -4e6, -4e6], rtol=1e-12)
    # A quarter, a half and all of the ramp of 4 us after 3 us.
    times = np.array([4e-6, 5e-6, 7e-6, 8e-6])
    np.testing.assert_allclose([pressure(shear, t) for t in times], [-3.25e6, -2.5e6, -1e6, -1e6], rtol=1e-12)
    motion = shear.motions[0]
    np.testing.assert_allclose([motion.velocity(t) for t in times], [0.5, 1.0, 2.0, 2.0], rtol=1e-12)
    # Back: 2 - 4 (t - 8 us) / 2 us; the traction vanishes with its last rest, that of the second stage.
    np.testing.assert_allclose([pressure(back, t) for t in (9e-6, 10e-6)], [-0.5e6, 0], rtol=1e-12, atol=1e-6)
    motion = back.motions[0]
    np.testing.assert_allclose([motion.velocity(t) for t in (8e-6, 9e-6, 10e-6)], [2, 0, -2], atol=1e-12)
    # Acceleration and displacement belong to the velocity.
    t, h = np.linspace(8.1e-6, 11.9e-6, 6), 1e-10  # none of them where the ramp ends
    slope = [(motion.displacement(x + h) - motion.displacement(x - h)) / (2 * h) for x in t]
    np.testing.assert_allclose(slope, [motion.velocity(x) for x in t], atol=1e-5)
    slope = [(motion.velocity(x + h) - motion.velocity(x - h)) / (2 * h) for x in t]
    np.testing.assert_allclose(slope, [motion.acceleration(x) for x in t], atol=1.0)


def test_displacement_of_a_motion_that_begins_with_the_old_speed() -> None:
    """2 m/s that vanish over a ramp of 2 us besides 3 m/s from its end on: 2 x 2 us / 2 + 3 x 2 us in 4 us."""
    still = PrescribedMotion(
        np.array([0]), lambda t: 3.0 * max(t - 2e-6, 0.0), lambda t: 3.0 * (t > 2e-6), lambda t: 0.0
    )
    later = stages._following(still, 1e-6, 2.0, 2e-6)
    way = [later.displacement(1e-6 + t) - later.displacement(1e-6) for t in (1e-6, 2e-6, 4e-6)]
    np.testing.assert_allclose(way, [1.5e-6, 2e-6, 8e-6], rtol=1e-12)


PUSH = {"kind": "traction", "edge": "upper.top", "traction": [1e6, 0.0]}


@pytest.mark.parametrize("lengths", [(4, 8, 2), (3, 5, 6), (3, 1, 6), (2.3, 4.9, 4), (2.5, 1, 2.1, 4), (2.6, 1.2, 4)],
                         ids=str)  # fmt: skip
@pytest.mark.parametrize("pushed", [0, 1])
def test_momentum_is_what_a_stage_pushed(lengths: tuple[float, ...], pushed: int) -> None:
    """Two free plates with 1 MPa on 12 mm in one of the stages: stress x length x duration, in any number of steps.

    Velocities are known up to half a step after the last traction, when nothing pushes any more.
    """
    dt = 5e-8
    steps = [{"duration": length * dt, "boundaries": [PUSH] if number == pushed else []}
             for number, length in enumerate(lengths)]  # fmt: skip
    given = parse_case(plates({
        **COMMON, "duration": sum(lengths) * dt, "stages": steps,
    }))  # fmt: skip
    model = Model(given)
    motion = stages.bind(model)
    state = advance(motion, model.initial_state(), given.duration)
    momentum = (model.mass * state.velocity)[::2].sum()
    assert momentum == pytest.approx(1e6 * 12e-3 * lengths[pushed] * dt, rel=1e-9)
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    assert abs(work - sum(energy.values())) < 1e-10 * work


@pytest.mark.parametrize("stepper", ["leapfrog", "hybrid"])
def test_a_stage_shorter_than_a_step_is_refused(stepper: str) -> None:
    """And runs when it is as the message says."""
    given = {**COMMON, "faults.main.contact": {"kind": "compliant", "C_n": 3e13, "C_s": 1e13}, "duration": 1.04e-6}
    fast = {"kind": "leapfrog", "time_step": 5e-8}
    for step, refused in ((5e-8, True), (4e-8, False)):
        fast["time_step"] = step
        case_ = parse_case(plates({
            **given, "stepper": fast if stepper == "leapfrog" else {"kind": "hybrid", "fast": dict(fast)},
            "stages": [{"duration": 1e-6}, {"duration": 4e-8, "boundaries": [PUSH]}],
        }))  # fmt: skip
        if not refused:
            stages.bind(Model(case_))
            continue
        with pytest.raises(RuptfxError, match=facts(r"stages\.1\.duration = 4e-08 s.* 5e-08 s.*to 4e-08 s or less")):
            stages.bind(Model(case_))


def test_a_profile_goes_on_from_the_old_one() -> None:
    """Pressed evenly at 1 m/s, then turned: over its ramp the edge goes from the even speed to the linear one."""
    line = {"kind": "table", "positions": [0.0, 12e-3], "values": [0.0, 2.0]}
    top = {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": -1.0}
    given = parse_case(plates({**COMMON, "duration": 6e-6, "stages": [
        {"duration": 2e-6, "boundaries": [top]},
        {"duration": 4e-6, "boundaries": [{**top, "velocity": -3.0, "profile": line, "ramp": 2e-6}]},
    ]}))  # fmt: skip
    model = Model(given)
    staged = stages.bind(model)
    assert isinstance(staged, Staged)
    (motion,) = staged._models[1].loads.motions
    x = model.coordinates[motion.dofs // 2, 0]
    for time, even, turned in ((2e-6, -1.0, 0.0), (3e-6, -0.5, -1.5), (4e-6, 0.0, -3.0)):
        np.testing.assert_allclose(motion.velocity(time), even + turned * x / 6e-3, atol=1e-12)


def test_goes_on_within_a_stage_with_the_same_bits(tmp_path: Path) -> None:
    given = case({**COMMON, "duration": 6e-6, "output.checkpoint_steps": 45, "stages": [
        {"duration": 2e-6, "boundaries": loads(0.0, -1e6, 1e-6), "damping": {"mass": 1e5}},
        {"duration": 4e-6, "boundaries": loads(4.0, -1e6, 1e-6), "damping": {"kelvin_voigt": {}}},
    ]})  # fmt: skip
    simulate(given, tmp_path / "whole", progress=False)
    shutil.copytree(tmp_path / "whole", tmp_path / "resumed")
    (tmp_path / "resumed" / "summary.json").unlink()
    simulate(given, tmp_path / "resumed", progress=False, resume=True)
    found = largest_difference(tmp_path / "whole", tmp_path / "resumed")
    # A resumed step looks for impacts where it need not: round-off of the energy.
    assert found.pop("energy.csv") < 1e-15 and max(found.values()) == 0


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"duration": 7e-6}, r"duration = 7e-06 s: the stages last 5e-06 s together; give that"),
        ({"stepper": {"kind": "quasi_dynamic"}},
         r"stepper.kind = 'quasi_dynamic': its steps take no stages; use .*'hybrid'"),
        ({"stages": [{"duration": 5e-6, "boundaries": [{"kind": "periodic", "first": "upper.left",
                                                        "second": "upper.right"}]}]},
         r"stages.0.boundaries: what ties edges"),
        ({"stages": [{"duration": 5e-6, "boundaries": [{"kind": "driven", "edge": "upper.left", "component": "z",
                                                        "velocity": 1.0}]}]},
         r"stages.0.boundaries.0.component = 'z'"),
        ({"stages": [{"duration": 5e-6, "boundaries": [{"kind": "absorbing", "edge": "upper.botom"}]}]},
         r"stages.0.boundaries.0.edge = 'upper.botom': no such edge"),
    ],
)  # fmt: skip
def test_stages_that_cannot_be(changes: dict[str, Any], message: str) -> None:
    table = {"duration": 5e-6, "stages": [{"duration": 5e-6}], **changes}
    with pytest.raises(RuptfxError, match=facts(message)):
        stages.bind(Model(parse_case(plates(table))))
