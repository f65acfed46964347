"""Mechanisms: each is found by its file, says which nodes it acts on, and the stepper knows none by name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crack_cases import block
from crack_cases import case as broken
from small_cases import case, march

import ruptfx.steppers.leapfrog as leapfrog
from ruptfx import preflight, spectrum
from ruptfx.case import parse_case
from ruptfx.mechanisms import Mechanism, kinds, mechanisms_of
from ruptfx.model import Model
from ruptfx.recording import checkpoint
from ruptfx.steppers.leapfrog import LeapfrogMotion

pytestmark = pytest.mark.fem
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
    assert all(each.__doc__ and each.__module__.startswith("ruptfx.mechanisms.") for each in found)


def test_the_stepper_names_none() -> None:
    source = Path(leapfrog.__file__).read_text(encoding="utf-8").partition("class LeapfrogMotion")[2]
    words = {word.lower() for word in re.findall(r"[A-Za-z]+", source)}
    names = {"faults", "sliding", "cracks", "facets", "collisions", "rotations", "viscosity", "ties", "loads"}
    assert not words & names
    assert "isinstance(model.operator" in source and source.count("isinstance") == 1


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
    model = Model(parse_case(block({"fracture.kind": "on_strength"}), Path(__file__).parent.parent))
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
