"""Every attachment of the folder, by its own example: read again, energies, records, ranks, resume, refusals."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, advance, case, march, plates
from helpers.whole_runs import whole_and_resumed

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.units import check_units

from ruptfx.bodies.spectrum import highest_frequency, springs_of
from ruptfx.bodies.state import State
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, alternatives, unit_of
from ruptfx.interfaces.attachments.foundation import Ground
from ruptfx.interfaces.mechanisms import Mechanism
from ruptfx.interfaces.mechanisms.checks.table import Plan
from ruptfx.platform import fem, parallel
from ruptfx.results.record import Record
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
ATTACHMENTS = alternatives("ruptfx.interfaces.attachments")
PRESENT = ("foundation", "resonators")
"""Kinds whose units the table has."""
# Motion that comes to every edge, of both components.
PUSH = {"kind": "traction", "edge": "upper.right", "traction": [-1e6, 5e5], "ramp": 1e-6}
every_attachment = pytest.mark.parametrize("kind", ATTACHMENTS)


def example(kind: str) -> dict[str, Any]:
    """What the attachment gives as an example."""
    return tomllib.loads(f"attachment = {ATTACHMENTS[kind].example}")["attachment"]


def table(kind: str, changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """Two glued plates with a load and the attachment."""
    return plates({
        "order": 3, "duration": 6e-6, "boundaries": [PUSH], "attachments": [example(kind)],
        "faults.main.contact": COMPLIANT, **(changes or {}),
    })  # fmt: skip


def attached(kind: str, changes: dict[str, Any] | None = None) -> Case:
    return parse_case(table(kind, changes))


@every_attachment
def test_written_and_read_again(kind: str) -> None:
    given = attached(kind)
    again = parse_case(tomllib.loads(given.to_toml()))
    assert example(kind)["kind"] == kind and again == given and again.hash == given.hash


@every_attachment
def test_fields_and_energies_are_declared(kind: str) -> None:
    """Fields of the state are those declared, and a column of its own has a role and a meaning."""
    model = Model(attached(kind))
    (mechanism,) = model.attachments
    assert isinstance(mechanism, Mechanism) and mechanism in model.mechanisms
    state = model.initial_state()
    assert list(state.attached) == [mechanism.name]
    assert list(mechanism.of(state)) == [field.name for field in mechanism.fields]
    for field in mechanism.fields:
        assert field.unit and field.long_name
        assert np.all(mechanism.of(state)[field.name] == field.start)
    for energy in mechanism.energies:
        assert energy.meaning and energy.role in ("stored", "dissipated")
        assert energy.name in model.energies(state)


def budget(given: Case) -> tuple[dict[str, float], float]:
    """Energies at the end of a case, and the largest difference between them and the work of the boundaries."""
    model = Model(given)
    motion, state, lost = given.stepper.bind(model), model.initial_state(), [0.0]

    def watch(state: State) -> None:
        energy = motion.energies(state)
        lost.append(energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work"))

    advance(motion, state, given.duration, watch)
    return motion.energies(state), float(np.abs(lost).max())


@every_attachment
@pytest.mark.parametrize("changes", [{}, {"plane": "antiplane", "boundaries": [{**PUSH, "traction": [1e6]}]}])
def test_energy_budget_closes(kind: str, changes: dict[str, Any]) -> None:
    """All that goes in is found again, and the attachment has its part of it.

    A budget that is declared open closes with the square of the step.
    """
    cls = ATTACHMENTS[kind]
    assert cls.closure <= 1e-12 or cls.why_open
    (ours, lost), (without, lost_without) = (budget(attached(kind, {**changes, "attachments": given}))
                                             for given in ([example(kind)], []))  # fmt: skip
    assert lost < cls.closure * ours["kinetic"] and lost_without < 1e-12 * without["kinetic"]
    if cls.closure > 1e-12:
        stepper = attached(kind, changes).stepper
        halves = {**changes, "stepper": {"kind": "leapfrog", "safety": 0.5 * stepper.safety}}
        assert budget(attached(kind, halves))[1] < 0.5 * lost
    assert any(abs(value - without.get(name, 0.0)) > 1e-3 * without["kinetic"] for name, value in ours.items())


def agree_on_ranks(given: Case, march: Callable[[Any, Any], object], rtol: float) -> None:
    """Compare times, energies and records of a march on all ranks with those of each rank alone."""
    found = []
    for comm in (COMM, fem.MPI.COMM_SELF):
        model = Model(given, comm)
        motion, state = given.stepper.bind(model), model.initial_state()
        march(motion, state)
        (mechanism,) = model.attachments
        rows = comm.bcast(dict(mechanism.record(state)), root=0)
        energies = np.array([*motion.energies(state).values()])
        found.append([motion.dt, state.time, energies, *rows.values()])
    for here, alone in zip(*found, strict=True):
        np.testing.assert_allclose(here, alone, rtol=rtol, atol=0.01 * rtol * np.abs(alone).max(initial=0.0))


@every_attachment
def test_the_same_on_any_ranks(kind: str) -> None:
    agree_on_ranks(attached(kind), lambda motion, state: advance(motion, state, 6e-6), 1e-9)


@every_attachment
def test_some_ranks_have_no_node_of_a_short_edge(kind: str) -> None:
    given = attached(kind, {"attachments": [{**example(kind), "edge": "upper.left"}]})
    nodes = COMM.allgather(len(Model(given, COMM).attachments[0].at))
    assert sum(nodes) and (COMM.size == 1 or 0 in nodes)
    agree_on_ranks(given, lambda motion, state: advance(motion, state, 1e-6), 1e-9)


def test_nodes_of_the_ground_fail_each_by_itself() -> None:
    """Damage, pulled off and sheared, does not depend on the nodes beside; without shear it is that of a linear law."""
    given, random = example("foundation"), np.random.default_rng(0)
    (ground,) = Model(attached("foundation")).attachments
    assert isinstance(ground, Ground)
    law, nodes = given["cohesion"], np.arange(len(ground.at))[:, None]
    fields = {field.name: np.zeros((len(nodes), 2) if field.vector else len(nodes)) for field in ground.fields}
    slope = law["f_t"] ** 2 / (2 * law["G_Ic"])  # strength that is lost per opening
    for shear in (0.0, *np.full(20, 1.0)):
        away, along = random.uniform(0.0, 1.5, (2, len(nodes))) * law["f_t"] / slope
        moved = np.column_stack([shear * along, away])  # the ground is below
        found = ground._answer(fields, moved)[0]["damage"]
        if not shear:
            opening = (given["normal"] * away - law["f_t"]) / (given["normal"] - slope)
            np.testing.assert_allclose(found, np.clip(opening * slope / law["f_t"], 0, 1), atol=1e-12)
        for node in nodes[:, 0]:
            alone = ground._answer(fields, np.where(nodes == node, moved, 0.0))[0]["damage"]
            assert alone[node] == found[node]


def test_a_step_may_damage_the_ground_by_a_tenth() -> None:
    """Half of the largest error for a node whose damage grows by 0.05, whatever it was."""
    model = Model(attached("foundation"))
    (ground,), state = model.attachments, model.initial_state()
    assert isinstance(ground, Ground)
    damage = ground.of(state)["damage"]
    damage[:] = 0.3
    after = damage + 0.02
    after[:1] += 0.03
    reaction: Any = SimpleNamespace(fields={"damage": after})
    assert ground.step_error(state, reaction) == pytest.approx(0.5 if len(damage) else 0.0)


@every_attachment
def test_the_stable_step_respects_it(kind: str) -> None:
    """Springs a thousand times stiffer than the example do not blow up at the step that is chosen for them."""
    given, cls = example(kind), ATTACHMENTS[kind]
    units = {name: unit_of(cls, name) for name in given if name in cls.model_fields}
    stiff = {name: 1e3 * given[name] for name, unit in units.items() if unit in ("Pa/m", "kg/m2")}
    stiff |= {name: 2e7 for name, unit in units.items() if unit == "1/s"}
    if not stiff:
        pytest.skip("has neither stiffness nor frequency")
    model, motion, state = march(attached(kind, {"attachments": [{**given, **stiff}], "duration": 3e-6}))
    assert highest_frequency(model) > 1.2 * highest_frequency(model, [])
    assert len(springs_of(model)) > 1
    energy = motion.energies(state)
    assert 0 < energy["kinetic"] < 1.0 and np.isfinite(state.displacement).all()


@every_attachment
def test_recorded_and_resumed_bitwise(kind: str, shared_tmp_path: Path) -> None:
    """A run that goes on from a checkpoint ends as one that was never stopped, in every number of its files."""
    plain = attached(kind)
    steps = int(0.55 * plain.duration / plain.stepper.bind(Model(plain)).dt)
    given = attached(kind, {"output.checkpoint_steps": steps, "output.interface_interval": 2e-7})
    whole, cut = whole_and_resumed(given, shared_tmp_path / kind, "attachments.h5")
    recorded = [name for field in Model(given).attachments[0].recorded_fields() for name in field.names(2)]
    if COMM.rank == 0:
        with Record(whole) as one, Record(cut) as other:
            ours, theirs = (record.attachments[example(kind)["name"]] for record in (one, other))
            assert ours.sizes["time"] > 20 and ours.identical(theirs)
            assert sorted(recorded) == sorted(str(name) for name in ours.data_vars if "time" in ours[name].dims)
            assert any(np.abs(ours[name].values).max() > 0 for name in recorded)
            assert one.energy.identical(other.energy)
            assert float(np.abs(one.energy["closure"]).max()) < 10 * ATTACHMENTS[kind].closure
        own = () if kind in PRESENT else tuple(recorded)  # a new kind may call other quantities so
    assert check_units(whole, but=own) > len(recorded) - len(own)


@every_attachment
def test_check_has_its_rows(kind: str) -> None:
    model = Model(attached(kind))
    plan = Plan(1e-8, 600, 2e-8, [(6e-6, model.loads)])
    rows = [row for each in model.attachments for row in each.check(plan)]
    assert rows and all(example(kind)["name"] in row.quantity for row in rows)


STEPPERS = {
    "generalized_alpha": {"kind": "generalized_alpha", "scheme": "average_acceleration", "time_step": 1e-7},
    "quasi_static": {"kind": "quasi_static"},
    "hybrid": {"kind": "hybrid", "fast_above": 5e-3, "slow_below": 4e-3, "calm_for": 1e-6},
}
SLOW_PUSH = {**PUSH, "traction": [-8e4, 4e4], "ramp": 5e-6}  # up to 0.11 MPa the ground fails stably
IN_STEPS = [
    (kind, stepper) for kind, cls in ATTACHMENTS.items() for stepper in STEPPERS
    if cls.implicit and (stepper != "quasi_static" or not cls.inertia)
]  # fmt: skip
every_implicit = pytest.mark.parametrize("kind, stepper", IN_STEPS)


def implicit(kind: str, stepper: str, changes: dict[str, Any] | None = None) -> Case:
    slips = {"damping": {"mass": 2e6}, "faults.main.friction": SLIPPERY, "duration": 12e-6}
    more = slips if stepper == "hybrid" else {"duration": 8e-6}
    return attached(kind, {"order": 2, "stepper": STEPPERS[stepper], **more,
                           "boundaries": [SLOW_PUSH, SUPPORT], **(changes or {})})  # fmt: skip


SLIPPERY = {"kind": "coulomb", "mu_d": 0.004}
SUPPORT = {"kind": "spring", "edge": "lower.left", "normal": 1e13, "tangential": 1e13}


@every_implicit
def test_energy_budget_closes_in_implicit_steps(kind: str, stepper: str) -> None:
    given = implicit(kind, stepper)
    model, modes = Model(given), [0.0]
    motion, state = given.stepper.bind(model), model.initial_state()
    while state.time < given.duration:
        motion.step(state)
        modes.append(state.numbers.get("fast", 0.0))
        energy = motion.energies(state)
        lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
        assert abs(lost) < 2e-9 * max(map(abs, energy.values()))
    if stepper == "hybrid":  # there and back
        assert {-1.0, 1.0} <= set(np.diff(modes))
    (mechanism,) = model.attachments
    found = [np.abs(values).max() for values in mechanism.of(state).values()]
    assert max(found) > 0 and np.isfinite(found).all()


@every_implicit
def test_the_same_on_any_ranks_in_implicit_steps(kind: str, stepper: str) -> None:
    agree_on_ranks(implicit(kind, stepper), lambda motion, state: [motion.step(state) for _ in range(12)], 1e-7)


@pytest.mark.parametrize("kind, stepper", [
    pytest.param(*each, marks=[pytest.mark.slow] * (each == ("foundation", "hybrid"))) for each in IN_STEPS
])  # fmt: skip
def test_resumed_bitwise_in_implicit_steps(kind: str, stepper: str, shared_tmp_path: Path) -> None:
    plain = implicit(kind, stepper)
    model = Model(plain)
    motion, state = plain.stepper.bind(model), model.initial_state()
    while state.time < 0.6 * plain.duration:
        motion.step(state)
    given = implicit(kind, stepper, {"output.checkpoint_steps": state.step, "output.interface_interval": 2e-7})
    whole, cut = whole_and_resumed(given, shared_tmp_path / f"{kind}_{stepper}", "attachments.h5")
    if COMM.rank == 0:
        with Record(whole) as one, Record(cut) as other:
            ours, theirs = (record.attachments[example(kind)["name"]] for record in (one, other))
            if COMM.size == 1:
                assert ours.identical(theirs) and one.energy.identical(other.energy)
            for name in ours.data_vars:  # on several ranks the factorisation of a matrix rounds differently every time
                here, there = ours[name].values, theirs[name].values
                np.testing.assert_allclose(here, there, rtol=1e-7, atol=1e-9 * np.abs(here).max())  # of solvers


@every_attachment
def test_steps_without_mechanisms_refuse_it(kind: str) -> None:
    with pytest.raises(CaseError, match=facts(r"attachments\.0\.kind = .*'spring'.*use stepper\.kind = .*'leapfrog'")):
        attached(kind, {"stepper": {"kind": "quasi_dynamic"}})


def test_a_ground_that_does_not_fail_is_the_boundary_that_quasi_dynamic_steps_take() -> None:
    """The remedy of their refusal: equal slip in quasi-static equilibrium, to the tolerance of its solver."""
    ground = {**example("foundation"), "cohesion": {"kind": "linear", "f_t": 1e9, "c": 1e9, "G_Ic": 1e6, "G_IIc": 1e6}}
    spring = {"kind": "spring", **{name: ground[name] for name in ("edge", "normal", "tangential")}}
    slow = {
        "order": 2, "duration": 1.0, "stepper": {"kind": "quasi_static"}, "damping": None,
        "faults.main.friction": {"kind": "coulomb", "mu_d": 0.6},
    }  # fmt: skip
    drive = {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 1e-4}
    slips = []
    for found in ({"boundaries": [drive], "attachments": [ground]}, {"boundaries": [drive, spring], "attachments": []}):
        given = attached("foundation", {**slow, **found})
        model = Model(given)
        motion, state = given.stepper.bind(model), model.initial_state()
        while state.time < given.duration:
            motion.step(state)
        slips.append(state.faults["main"]["slip"])
    assert slips[0].max() > 1e-6
    np.testing.assert_allclose(slips[0], slips[1], rtol=0, atol=1e-8 * slips[1].max())
    attached("foundation", {
        **slow, "stepper": {"kind": "quasi_dynamic"}, "boundaries": [drive, spring], "attachments": [],
    })  # fmt: skip


def test_resonators_need_inertia() -> None:
    with pytest.raises(CaseError, match=facts(r"attachments\.0\.kind = 'resonators'.*no effect without inertia")):
        attached("resonators", {"stepper": {"kind": "quasi_static"}})


def test_sliding_contact_in_implicit_steps_refuses_attachments() -> None:
    changes = {"stepper": {"kind": "quasi_static"}, "faults.main.sliding": {}}
    with pytest.raises(CaseError, match=r"attachments\.0.*sliding"):
        attached("foundation", changes)


def test_each_has_its_own_name() -> None:
    with pytest.raises(CaseError, match=facts(r"attachments\.1\.name = 'row': another attachment has that name")):
        case({"attachments": [{**example("resonators")}, {**example("resonators")}]})


def test_an_edge_that_is_not_there_is_named() -> None:
    with pytest.raises(Exception, match=r"attachments\.0\.edge = 'upper\.tip'"):
        Model(case({"attachments": [{**example("resonators"), "edge": "upper.tip"}]}))


def test_areas_and_normals_of_an_edge() -> None:
    model = Model(case())
    edge = case({"attachments": [example("resonators")]}).attachments[0].nodes_on(model, "attachments.0")
    owned = edge.nodes < model.owned_nodes
    assert parallel.total(COMM, edge.area[owned].sum()) == pytest.approx(12e-3, rel=1e-12)
    np.testing.assert_allclose(edge.normal, np.tile([0.0, 1.0], (len(edge.nodes), 1)), atol=1e-12)
