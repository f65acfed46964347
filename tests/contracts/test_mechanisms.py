"""Mechanisms: each is found by its file, says which nodes it acts on, and the stepper knows none by name."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest
from helpers.crack_cases import block
from helpers.crack_cases import case as broken
from helpers.small_cases import case, march

import ruptfx.stepping.steppers.leapfrog as leapfrog
from ruptfx.app.checks import preflight
from ruptfx.bodies import spectrum
from ruptfx.case import parse_case
from ruptfx.interfaces.mechanisms import ImplicitForce, Mechanism, kinds, mechanisms_of, responding
from ruptfx.run import cost
from ruptfx.run.model import Model
from ruptfx.run.recording import checkpoint, recorder
from ruptfx.run.recording import mechanisms as records
from ruptfx.stepping.steppers.leapfrog import LeapfrogMotion

pytestmark = pytest.mark.fem
kinds_before = records.kinds()
MASS, STIFFNESS = 0.01, 5e7  # kg/m, N/m2: soft enough for the stable step of the bodies


class PointMass(Mechanism):
    """A mass on a spring at one node, that starts at rest: an oscillator that the body drives."""

    order = 55

    def __init__(self, model: Model) -> None:
        super().__init__(model)
        self.node = int(np.argmax(model.coordinates.sum(axis=1)))
        self.place, self.speed = np.zeros(2), np.zeros(2)

    def nodes(self) -> Any:
        found = super().nodes()
        found[self.node] = True
        return found

    def add_external(self, state: Any, kick: Any) -> None:
        pull = STIFFNESS * (self.place - state.displacement.reshape(-1, 2)[self.node])
        state.force.reshape(-1, 2)[self.node] += pull
        self.speed -= kick.clock.kick * pull / MASS
        self.place += kick.clock.dt * self.speed


def test_one_class_per_name_in_calling_order() -> None:
    found = kinds()
    assert [each.order for each in found] == sorted(each.order for each in found)
    assert len({each.__name__ for each in found}) == len(found) >= 10
    assert all(each.__doc__ and each.__module__.startswith("ruptfx.interfaces.mechanisms.") for each in found)


def test_forces_of_implicit_steps_are_a_contract_of_their_own() -> None:
    """Only mechanisms of that contract have its methods; springs of facets are one, a point mass and loads are not."""
    methods = {name for name in vars(ImplicitForce) if not name.startswith("_")}
    assert methods == {"coupled", "respond", "force_of", "advance", "step_error", "fastest"}
    assert {each.__name__ for each in kinds() if issubclass(each, ImplicitForce)} == {"IntrinsicFacets", "Memory"}
    assert not [each.__name__ for each in kinds() if methods & set(dir(each)) and not issubclass(each, ImplicitForce)]
    model = Model(broken({}))
    model.mechanisms.append(PointMass(model))
    assert [type(each).__name__ for each in responding(model.mechanisms)] == ["IntrinsicFacets"]


def test_the_stepper_names_none() -> None:
    source = Path(leapfrog.__file__).read_text(encoding="utf-8").partition("class LeapfrogMotion")[2]
    names = {"faults", "sliding", "cracks", "facets", "collisions", "rotations", "viscosity", "ties", "loads"}
    assert not words_of(source) & names
    assert "isinstance(model.operator" in source and source.count("isinstance") == 1


@pytest.mark.parametrize("module", [recorder, cost, checkpoint], ids=lambda module: module.__name__)
def test_records_costs_and_checkpoints_name_none(module: ModuleType) -> None:
    source = Path(module.__file__ or "").read_text(encoding="utf-8")
    names = {"sliding", "slides", "crack", "cracks", "facets", "collisions", "rotations", "ties", "fracture"}
    assert not words_of(source) & (names | {"attachments", "edge_sums", "interface_file"})


def words_of(source: str) -> set[str]:
    return {word.lower() for word in re.findall(r"[A-Za-z_]+", source)}


def test_every_file_of_a_mechanism_is_found_and_named_once() -> None:
    found = records.kinds()
    assert len(found) >= 5 and all(issubclass(each.of, Mechanism) for each in found)
    for model in (Model(broken({})), Model(case({}))):
        parts = records.records_of(model)
        names = [name for each in parts for name in each.names()]
        assert names and len(set(names)) == len(names)
        assert {type(each) for each in parts} == {
            kind for kind in found if any(isinstance(each, kind.of) for each in model.mechanisms)
        }  # fmt: skip


class Counted(records.Records):
    """Counts the records of a point mass."""

    of = PointMass
    made: ClassVar[list[float]] = []

    def names(self) -> list[str]:
        return ["counted.txt"]

    def open(self, opening: records.Opening) -> None:
        (opening.out / "counted.txt").touch()

    def read(self, state: Any) -> tuple[float, float]:
        return state.fault_time, state.step * self.model.total_nodes

    def append(self, time: float, data: float) -> None:
        self.made.append(time * data)

    def reopen(self) -> list[Path]:
        return []

    def close(self) -> None:
        pass

    def numbers(self, records: int, snapshots: int) -> float:
        return 1e6 * records


def test_a_new_mechanism_is_recorded_and_costed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recorder writes what a mechanism of another file declares; the estimate of the disk counts it."""
    given = case({"duration": 1e-6, "output.interface_interval": 2e-7, "output.figures": False})

    def cost_of(model: Model) -> cost.Cost:
        return cost.rehearse(model, given.stepper.bind(model), 50, 0.0, 0.0)

    model = Model(given)
    plain = cost_of(model)
    monkeypatch.setattr(records, "kinds", lambda: (*kinds_before, Counted))
    model.mechanisms = [*mechanisms_of(model), PointMass(model)]
    with_mass = cost_of(model)
    rows, _ = cost.counts(given, 50)
    assert with_mass.disk - plain.disk == pytest.approx(8e6 * rows, rel=1e-6)
    assert len(Counted.made) >= 2 and Counted.made[-1] > Counted.made[0] == 0


@pytest.mark.parametrize("module", [preflight, checkpoint, spectrum])
def test_what_asks_all_mechanisms_names_none(module: Any) -> None:
    """Rows of `check`, checkpoints and the stable step come from loops over mechanisms."""
    source = Path(module.__file__).read_text(encoding="utf-8")
    code = re.sub(r"#.*", "", re.sub(r'""".*?"""', "", source, flags=re.DOTALL))
    words = {word.lower() for word in re.findall(r"[A-Za-z]+", code)}
    assert "mechanisms" in words
    assert not words & {"cracks", "collisions", "sliding", "slides", "resonators", "foundation", "rigid", "facets"}


@pytest.mark.parametrize("made", [case, broken])
def test_present_ones_are_those_of_the_case(made: Any) -> None:
    names = {type(each).__name__ for each in mechanisms_of(Model(made()))}
    assert names == ({"Loads", "Faults"} if made is case else {"Loads", "IntrinsicFacets"})


def test_extrinsic_facets_advance_all_nodes() -> None:
    model = Model(parse_case(block({"fracture.kind": "extrinsic"}), Path(__file__).parent.parent))
    (facets,) = (each for each in mechanisms_of(model) if type(each).__name__ == "ExtrinsicFacets")
    assert facets.nodes().all()


def test_a_new_mechanism_takes_part_in_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Impulse of the mass: the body loses the momentum that the mass gains, to rounding."""
    given = case({"boundaries": [{"kind": "traction", "edge": "upper.top", "traction": [1e6, 0.0]}]})
    _, plain, alone = march(given)
    monkeypatch.setattr(leapfrog, "mechanisms_of", lambda model: [*mechanisms_of(model), PointMass(model)])
    model, motion, state = march(given)
    assert isinstance(motion, LeapfrogMotion)
    (mass,) = (each for each in motion.mechanisms if isinstance(each, PointMass))
    mass_of = model.mass[::2]
    momentum, without = (float(mass_of @ each.velocity[::2]) for each in (state, alone))
    assert plain.dt == motion.dt and MASS * abs(mass.speed[0]) > 1e-3 * abs(without)
    assert momentum + MASS * mass.speed[0] == pytest.approx(without, rel=1e-12)


def test_nothing_asks_whether_a_method_was_overridden() -> None:
    """Classes declare what they offer (`Alternative.offers`), and mechanisms the contracts that they keep."""
    question = re.compile(r"(type\(\w+\)|\bcls)\.\w+ is (not )?[A-Z]\w*\.\w+|getattr\(\w+, \w+\) is (not )?getattr")
    package = Path(leapfrog.__file__).parents[2]
    asked = [path.name for path in package.rglob("*.py") if question.search(path.read_text(encoding="utf-8"))]
    assert asked == []


def test_few_classes_have_more_than_20_methods() -> None:
    """There were 16; this list may only become shorter."""
    package = Path(leapfrog.__file__).parents[2]
    large = {
        node.name for path in package.rglob("*.py") for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and sum(isinstance(each, ast.FunctionDef) for each in node.body) > 20
    }  # fmt: skip
    assert large <= {"Files", "Recorder", "RigidCracks", "Inversion"}
