"""Every boundary of the folder, by its own example: written and read again, energies, ranks, steppers."""

from __future__ import annotations

import tomllib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, advance, case, march

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.bodies.boundaries import Action
from ruptfx.bodies.boundaries.gravity import Gravity
from ruptfx.bodies.boundaries.histories import Sampled, course
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.interfaces.mechanisms.faults import Faults
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
BOUNDARIES = alternatives("ruptfx.bodies.boundaries")
LEAPFROG = {"kind": "leapfrog"}
IMPLICIT = {"kind": "generalized_alpha", "scheme": "average_acceleration", "courant": 1.0}
SLOW = {"kind": "quasi_static", "first_step": 1e-6, "largest_step": 1e-6}
# Something moves whatever the boundary does, and comes to every edge.
PUSH = {"kind": "traction", "edge": "upper.right", "traction": [-1e6, 5e5], "ramp": 1e-6}
every_boundary = pytest.mark.parametrize("kind", BOUNDARIES)


def example(kind: str) -> dict[str, Any]:
    """What the boundary gives as an example."""
    return tomllib.loads(f"boundary = {BOUNDARIES[kind].example}")["boundary"]


def with_boundary(kind: str, changes: dict[str, Any] | None = None) -> Case:
    """Two glued plates with a load and the boundary."""
    return case({
        "order": 3, "duration": 6e-6, "boundaries": [PUSH, example(kind)], "faults.main.contact": COMPLIANT,
        **(changes or {}),
    })  # fmt: skip


def takes(stepper: str, kind: str) -> bool:
    """Return whether the steps can have the boundary: those that keep ties, and those with waves."""
    ties = with_boundary(kind).boundaries[-1].tied_edges is not None
    steps = alternatives("ruptfx.stepping.steppers")[stepper]
    return (not ties or "ties" in steps.offers) and (not BOUNDARIES[kind].waves or "inertia" in steps.offers)


def with_steps(*steppers: dict[str, Any]) -> Any:
    """Every boundary with all of the steppers that can have it."""
    pairs = [(kind, stepper) for kind in BOUNDARIES for stepper in steppers if takes(stepper["kind"], kind)]
    return pytest.mark.parametrize("kind, stepper", pairs, ids=[f"{kind}-{stepper['kind']}" for kind, stepper in pairs])


def by_number(model: Model, field: np.ndarray) -> np.ndarray:
    """A nodal field in an order that does not depend on the ranks, on every rank."""
    return parallel.share_rows(model.comm, model.layout.collect(field))


@every_boundary
def test_written_and_read_again(kind: str) -> None:
    given = with_boundary(kind)
    again = parse_case(tomllib.loads(given.to_toml()))
    assert example(kind)["kind"] == kind
    assert again == given and again.hash == given.hash


@every_boundary
def test_some_steps_take_it_and_the_others_refuse_it(kind: str) -> None:
    """Every boundary has a budget that is tested below; a stepper that cannot keep its ties says so by its key."""
    assert any(takes(stepper["kind"], kind) for stepper in (LEAPFROG, IMPLICIT))
    for stepper in (LEAPFROG, IMPLICIT, SLOW):
        if not takes(stepper["kind"], kind):
            with pytest.raises(CaseError, match=facts(rf"boundaries\.1.* stepper\.kind = '{stepper['kind']}'")):
                Model(with_boundary(kind, {"stepper": stepper}))


@with_steps(LEAPFROG, IMPLICIT)
def test_energy_budget_closes(kind: str, stepper: dict[str, Any]) -> None:
    """All that goes in is found again, in every microsecond."""
    busy = with_boundary(kind, {"stepper": stepper, "damping": {"mass": 1e4}})
    model = Model(busy)
    motion, state = busy.stepper.bind(model), model.initial_state()
    work = 0.0
    for _ in range(6):
        advance(motion, state, 1e-6)
        energy = motion.energies(state)
        work = max(work, abs(energy["boundary_work"]))
        lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
        assert abs(lost) < 1e-11 * work
    assert energy["kinetic"] > 1e-3 * work


@every_boundary
def test_the_same_on_any_ranks(kind: str) -> None:
    """What acts at every node, and the motion it leads to, are those of one rank."""
    found = []
    for comm in (COMM, fem.MPI.COMM_SELF):
        model = Model(with_boundary(kind, {"stepper": {"kind": "leapfrog", "time_step": 4e-8}}), comm)
        loads, field = model.loads, np.zeros(model.nodes * model.components)
        support = np.zeros_like(field)
        u = np.sin(900 * model.coordinates[:, :1] + 700 * model.coordinates[:, 1:] + [0.0, 1.0]).ravel()
        loads.add_support_force(u, support)
        loads.drive(field, 2e-6)
        acts = [loads.force(2e-6), loads.dashpot, loads.prescribed.astype(float), field, support]
        motion, state = model.case.stepper.bind(model), model.initial_state()
        advance(motion, state, 2e-6)
        found.append([by_number(model, values) for values in (*acts, state.displacement)])
    for here, alone in zip(*found, strict=True):
        np.testing.assert_allclose(here, alone, atol=1e-10 * np.abs(alone).max(initial=0.0))
    assert np.abs(found[0][-1]).max() > 0


@pytest.mark.parametrize("kind", [kind for kind in BOUNDARIES if takes(IMPLICIT["kind"], kind)])
def test_explicit_and_implicit_steps_agree(kind: str) -> None:
    """Both are of second order: a quarter of the difference with half the step."""
    away = []
    for steps in (80, 160):
        ends = []
        for stepper in (LEAPFROG, IMPLICIT):
            smooth = with_boundary(kind, {
                "order": 2, "duration": 4e-6, "damping": {"mass": 2e5},
                "stepper": {**stepper, "time_step": 4e-6 / steps},
            })  # fmt: skip
            model, _, state = march(smooth)
            ends.append(state.displacement)
        both = [np.sqrt(parallel.total(COMM, model.layout.owned_dot(u, u))) for u in (ends[1], ends[1] - ends[0])]
        away.append(both[1] / both[0])
    assert away[0] < 0.01 and away[1] < 0.35 * away[0]


@pytest.mark.parametrize("kind", [kind for kind in BOUNDARIES if takes(SLOW["kind"], kind)])
def test_quasi_static_steps_take_it(kind: str) -> None:
    """A step without inertia ends in equilibrium, with its energies, whatever the boundary is."""
    # Both of two tied nodes are driven, or none.
    edges = ["lower.left"] + ["upper.left"] * (with_boundary(kind).boundaries[-1].tied_edges is not None)
    held = [{"kind": "driven", "edge": edge, "component": name, "velocity": 0.0}
            for edge in edges for name in ("x", "y")]  # fmt: skip
    slow = with_boundary(kind, {
        "order": 2, "boundaries": [example(kind), *held, {**PUSH, "ramp": 4e-6}], "duration": 4e-6,
        "stepper": SLOW,
    })  # fmt: skip
    model = Model(slow)
    motion, state = slow.stepper.bind(model), model.initial_state()
    for _ in range(4):
        motion.step(state)
        energy = motion.energies(state)
        lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
        assert abs(lost) < 1e-9 * abs(energy["boundary_work"])
    assert energy["strain"] > 0


@every_boundary
def test_the_chosen_step_is_stable(kind: str) -> None:
    """Random motion does not grow with what the boundary adds to the frequencies."""
    noisy = with_boundary(kind, {"boundaries": [example(kind)]})
    model = Model(noisy)
    motion, state = noisy.stepper.bind(model), model.initial_state()
    state.displacement[:] = 1e-16 * np.sin(1e6 * np.arange(len(state.displacement)))
    quiet = float(parallel.largest(COMM, np.abs(model.loads.force(1e-6)).max(initial=0.0)))
    moves = parallel.anywhere(COMM, bool(model.loads.motions)) or quiet > 0
    advance(motion, state, 100 * motion.dt)
    assert np.all(np.isfinite(state.velocity))
    if not moves:
        assert np.abs(state.displacement).max() < 1e-14


def test_a_ramp_and_a_history_are_multiplied() -> None:
    """A quarter of a ramp of 4 s times 2, the value of the history after 1 s."""
    history = Sampled(kind="sampled", times=[0.0, 4.0], values=[0.0, 8.0])
    assert course(1.0, 4.0, history) == pytest.approx(0.25 * 2.0)
    assert course(1.0, 4.0, None) == pytest.approx(0.25)
    assert course(1.0, 0.0, history) == pytest.approx(2.0)


def test_forces_grow_during_their_ramp() -> None:
    """A quarter of the weight after a quarter of the ramp, all of it from the end on."""
    weight = Gravity(acceleration=[0.0, -9.81], ramp=4e-6)
    whole = SimpleNamespace(mirror_planes=(), one_sided={})
    model: Any = SimpleNamespace(model=SimpleNamespace(mass=np.array([2.0, 2.0, 3.0, 3.0]), components=2, bodies=whole))
    force = weight.act(model, "boundaries.0").force
    assert force is not None
    assert [force.factor(time) for time in (0.0, 1e-6, 4e-6, 9e-6)] == pytest.approx([0.0, 0.25, 1.0, 1.0])


def test_neither_boundaries_nor_steps_of_faults_keep_vectors_over_all_nodes() -> None:
    edges = [f"{body}.{side}" for body in ("upper", "lower") for side in ("left", "right")]
    ends = [{"kind": "absorbing", "edge": edge} for edge in edges]
    given = case({"order": 2, "boundaries": ends})
    model = Model(given, fem.MPI.COMM_SELF)
    # The sum of all dashpots is kept, once; four boundaries would keep four vectors.
    assert model.loads.loading == [0, 1, 2, 3]
    assert model.loads.dashpot.any()
    assert [action for _, actions in model.loads._acts for action in actions] == 4 * [Action()]
    (faults,) = (each for each in given.stepper.bind(model).mechanisms if isinstance(each, Faults))
    sizes = {name: value.size for steps in faults.steps for step in steps for name, value in vars(step).items()
             if isinstance(value, np.ndarray)}  # fmt: skip
    assert sizes
    assert max(sizes.values()) < model.nodes, sizes
