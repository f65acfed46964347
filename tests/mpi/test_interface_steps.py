"""Quasi-static steps that leave the bodies for later are those of the whole system, to 1e-9, whenever one looks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.compare import largest_difference
from helpers.small_cases import COMPLIANT, case, memory_friction

pytest.importorskip("dolfinx")

from ruptfx.case import Case
from ruptfx.platform import parallel
from ruptfx.platform.fem import MPI
from ruptfx.run import simulation
from ruptfx.run.model import Model
from ruptfx.run.recording.checkpoint import Checkpoint
from ruptfx.run.simulation import Interrupted, simulate
from ruptfx.stepping.implicit import interface_steps
from ruptfx.stepping.implicit.compliance import Factors
from ruptfx.stepping.implicit.equilibrium import Equilibrium

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

RIGID = {"kind": "augmented_lagrangian"}
LOADS = [
    *[{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"],
    {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1.0, "ramp": 3e-5},
    {"kind": "driven", "edge": "upper.right", "component": "y", "velocity": 0.5},  # lifted off there, pressed elsewhere
    {"kind": "traction", "edge": "upper.top", "traction": [1e5, -1e6], "ramp": 5e-5},
    {"kind": "spring", "edge": "upper.top", "normal": 1e9, "tangential": 1e9},
]


SLOW = {
    "order": 2, "duration": 1e-3, "boundaries": LOADS, "faults.main.friction": memory_friction("P1"),
    "faults.main.initial_stress": {"normal": 1e6, "shear": 2e4},
    "stepper": {"kind": "quasi_static", "first_step": 1e-5, "largest_step": 1e-5, "slip_tolerance": 1e-4,
                "radiation_damping": True},
}  # fmt: skip


def pulled(changes: dict[str, Any] | None = None) -> Case:
    """Two plates that slide, open and stick in different places."""
    return case(SLOW | (changes or {}))


def march(given: Case, looks: list[int], defer: bool = True) -> list[dict[str, Any]]:
    """What is seen after some of the steps, on this rank."""
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    state.lazy_bodies = defer
    if not defer:
        motion.equilibrium = Equilibrium(model, radiation=motion.radiation, condensed=False)
    seen = []
    for step in range(1, looks[-1] + 1):
        motion.step(state)
        assert (interface_steps.Carried.of(state) is not None) is defer
        if step in looks:
            assert state.deferred is (defer and step > 1)
            energies = motion.energies(state)
            nodal = {"displacement": state.displacement.copy(), "velocity": state.velocity.copy()}
            seen.append({"time": state.time, "energies": energies, "fields": nodal | {
                name: values.copy() for name, values in state.faults["main"].items()}})  # fmt: skip
    fields, owned = state.faults["main"], model.faults[0].interface.owned
    of = (fields["normal_stress"] == 0, (fields["normal_stress"] > 0) & (np.abs(fields["slip"]) > 1e-8))
    assert parallel.total(model.comm, [np.sum(owned * each) for each in of]).min() > 1  # some are open, some slide
    return seen


@pytest.mark.parametrize("contact", [COMPLIANT, RIGID], ids=lambda contact: contact["kind"])
def test_what_is_seen_is_what_the_whole_system_does(contact: dict[str, Any]) -> None:
    step = {COMPLIANT["kind"]: 1e-5, RIGID["kind"]: 6e-6}[contact["kind"]]
    given = pulled({"faults.main.contact": contact, "stepper.first_step": step, "stepper.largest_step": step})
    looks = [1, 2, 4, 7, 8]
    for ours, theirs in zip(march(given, looks), march(given, looks, defer=False), strict=True):
        assert ours["time"] == theirs["time"]
        for name, expected in theirs["fields"].items():
            known = np.isfinite(expected)
            size = parallel.largest(MPI.COMM_WORLD, np.abs(expected[known]).max(initial=0.0)) or 1.0
            np.testing.assert_allclose(ours["fields"][name], expected, rtol=0, atol=1e-9 * size, err_msg=name)
        largest = max(map(abs, theirs["energies"].values()))
        assert ours["energies"] == pytest.approx(theirs["energies"], rel=1e-9, abs=1e-9 * largest)


def test_looking_changes_nothing_but_rounding() -> None:
    """Not to the bit: sums of BLAS depend on where in memory numbers lie; a run and its repetition differ as much."""
    given = pulled({"faults.main.contact": COMPLIANT})
    often, once = march(given, list(range(1, 13))), march(given, [12])
    largest = max(map(abs, once[-1]["energies"].values()))
    assert often[-1]["energies"] == pytest.approx(once[-1]["energies"], rel=1e-12, abs=1e-12 * largest)
    for name, values in once[-1]["fields"].items():
        size = parallel.largest(MPI.COMM_WORLD, np.abs(values[np.isfinite(values)]).max(initial=0.0)) or 1.0
        np.testing.assert_allclose(often[-1]["fields"][name], values, rtol=0, atol=1e-12 * size, err_msg=name)


def test_energies_stay_when_another_stepper_takes_over() -> None:
    """What is left out of them step by step is there for who goes on."""
    given = pulled({"faults.main.contact": COMPLIANT})
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    state.lazy_bodies = True
    for _ in range(5):
        motion.step(state)
    before = motion.energies(state)
    assert before["strain"] > 0.01 * before["boundary_work"] > 0
    motion.leave(state)
    assert not (interface_steps.Carried.of(state) or state.fields or state.points)
    assert model.energies(state) == pytest.approx(before, rel=1e-12, abs=1e-12 * before["boundary_work"])


def test_run_that_was_stopped_goes_on_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between two records, where nobody had looked yet, and with an instrument in the bodies that looks each time."""
    receiver = {"kind": "receiver", "name": "point", "interval": 1e-5, "point": [5.3e-3, 2.2e-3]}
    for name, instruments in (("without", []), ("with", [receiver])):
        given = pulled({
            "faults.main.contact": COMPLIANT, "duration": 1.4e-4, "instruments": instruments,
            "output.interface_interval": 5e-5, "output.bulk_interval": 7e-5,
        })  # fmt: skip
        simulate(given, tmp_path / name, MPI.COMM_SELF, progress=False)
        steps = iter(range(1, 100))
        with monkeypatch.context() as patch:
            patch.setattr(simulation.Signals, "anywhere", lambda *_, s=steps: "a test" if next(s) == 7 else "")
            with pytest.raises(Interrupted):
                simulate(given, tmp_path / f"{name}_stopped", MPI.COMM_SELF, progress=False)
        left = Checkpoint.latest(MPI.COMM_SELF, tmp_path / f"{name}_stopped", given)
        assert left is not None and left.manifest["step"] == 7 and len(left.manifest["points"]["main"]) == 8
        simulate(given, tmp_path / f"{name}_stopped", MPI.COMM_SELF, progress=False, resume=True)
        assert max(largest_difference(tmp_path / name, tmp_path / f"{name}_stopped").values()) == 0
    # Looks in between leave what is recorded as it is.
    (tmp_path / "with" / "instruments.h5").unlink()
    assert max(largest_difference(tmp_path / "with", tmp_path / "without").values()) == 0


def test_rounding_leaves_the_equilibrium_to_the_whole_system(monkeypatch: pytest.MonkeyPatch) -> None:
    """A root whose rounding is too large is no failure: neither a solution nor an error."""
    given = pulled({"faults.main.contact": COMPLIANT})
    motion, state = given.stepper.bind(model := Model(given)), model.initial_state()
    state.lazy_bodies = True
    for _ in range(3):
        motion.step(state)
    steps, carried, calls = motion.equilibrium.interface_steps, interface_steps.Carried.of(state), []
    sizes = steps.sizes

    def rough(step: Any, jump: np.ndarray) -> tuple[float, float]:
        calls.append(step)
        forces, rounding = sizes(step, jump)
        return forces, rounding * (1e30 if len(calls) == 2 else 1.0)  # of the root

    assert steps.solve(state, carried, 1e-5) is not None
    monkeypatch.setattr(steps, "sizes", rough)
    assert steps.solve(state, carried, 1e-5) is None and len(calls) == 2


def test_bodies_are_left_alone_between_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not a back substitution, not a force of the bodies in steps that nobody looks at."""
    given = pulled({"faults.main.contact": COMPLIANT})
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    state.lazy_bodies = True
    for _ in range(3):  # answers to edges and loads are made when they are first needed
        motion.step(state)

    def forbidden(*_: Any) -> Any:
        raise AssertionError("the bodies were asked")

    with monkeypatch.context() as patch:
        for owner, name in ((Factors, "solve"), (Factors, "solve_each"), (Model, "internal_force")):
            patch.setattr(owner, name, forbidden)
        for _ in range(4):
            motion.step(state)
        with pytest.raises(AssertionError):
            motion.advance_bodies(state)


def test_what_is_not_deferred_or_no_more(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """Edges whose shape of motion is an array; steps that find no jumps; bodies out of balance when they are seen."""
    profile = {**LOADS[2], "profile": {"kind": "table", "positions": [0.0, 4e-3], "values": [1.0, 0.5]}}
    assert Equilibrium(Model(pulled({"boundaries": [*LOADS[:2], profile]}))).interface_steps is None
    assert Equilibrium(Model(pulled()), {"snes_max_it": 20}).interface_steps is None
    given = pulled({"faults.main.contact": COMPLIANT})
    model = Model(given)
    motion, state = given.stepper.bind(model), model.initial_state()
    state.lazy_bodies = True
    for _ in range(3):
        motion.step(state)
    since = state.numbers["deferred_since"]
    state.lazy_bodies = False
    motion.step(state)
    assert interface_steps.Carried.of(state) is None
    state.lazy_bodies = True
    motion.step(state)
    assert state.numbers["deferred_since"] == state.time > since  # solved as a whole, and a new base
    with monkeypatch.context() as patch:
        patch.setattr(interface_steps.InterfaceSteps, "solve", lambda *_: None)
        motion.step(state)
    assert state.numbers["deferred_since"] == state.time  # the same
    motion.step(state)
    (compliance,) = motion.equilibrium._solver._kept.values()
    compliance.blocks *= 1.001
    motion.step(state)
    energies = motion.energies(state)
    assert "out of balance" in caplog.text and interface_steps.Carried.of(state) is None
    compliance.blocks /= 1.001
    motion.step(state)
    assert interface_steps.Carried.of(state) is not None
    assert motion.energies(state)["boundary_work"] > energies["boundary_work"]
