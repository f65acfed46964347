"""Specimens that are loaded slowly until they crack, in implicit steps and in those that change to explicit ones."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.crack_cases import HERE, joined_bar

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.interfaces.mechanisms.facets import IntrinsicFacets
from ruptfx.platform import parallel
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import ConvergenceError
from ruptfx.stepping.implicit.forces import Forces

pytestmark = pytest.mark.fem
WIDTH, HEIGHT, STRENGTH, MODULUS = 4e-3, 8e-3, 4e6, 50e9
SLOW, HYBRID = {"kind": "quasi_static"}, {"kind": "hybrid"}


class Pulled:
    """A run of the bar: time, force at its upper end and energies after every step."""

    def __init__(self, table: dict[str, Any]) -> None:
        case = parse_case(table, HERE)
        self.model = Model(case)
        self.motion, self.state = case.stepper.bind(self.model), self.model.initial_state()
        self._forces, self._top = Forces(self.model), np.isclose(self.model.coordinates[:, 1], HEIGHT)
        self.time, self.force, self.slow, self.open = [], [], [], []

    def to_end(self) -> Pulled:
        while self.state.time < self.model.case.duration * (1 - 1e-9):
            self.step()
        return self

    def step(self) -> None:
        self.motion.step(self.state)
        nodal = self._forces.internal(self.state).reshape(-1, 2)[: self.model.owned_nodes, 1]
        here = nodal[self._top[: self.model.owned_nodes]].sum()
        self.time.append(self.state.time)
        self.force.append(parallel.total(self.model.comm, here))
        self.slow.append(self.state.numbers.get("fast", 0.0) == 0)
        energies = self.motion.energies(self.state)
        lost = 2 * energies["boundary_work"] - sum(energies.values())
        self.open.append(abs(lost) / energies["boundary_work"])

    @property
    def energies(self) -> dict[str, float]:
        return self.motion.energies(self.state)


def test_a_tough_joint_opens_in_equilibrium() -> None:
    """The bar is stiffer than its softening joint: sigma = f_t (1 - w / w_c), w = u - sigma H / E, w_c = 2 G / f_t."""
    toughness = 20.0
    run = Pulled(joined_bar(SLOW, toughness, 12e-3)).to_end()
    moved = 1e-3 * (np.array(run.time) - 0.5e-4)  # after the ramp
    widest = 2 * toughness / STRENGTH
    softened = STRENGTH * (1 - moved / widest) / (1 - STRENGTH * HEIGHT / MODULUS / widest)
    exact = WIDTH * np.minimum(MODULUS / HEIGHT * moved, np.maximum(softened, 0.0))
    assert max(run.force) == pytest.approx(WIDTH * STRENGTH, rel=0.01)  # 0.2 % below it, between two steps
    driven = np.array(run.time) > 1e-4
    np.testing.assert_allclose(np.array(run.force)[driven], exact[driven], atol=0.006 * WIDTH * STRENGTH)
    assert run.energies["fracture"] == pytest.approx(toughness * WIDTH, rel=3e-3)
    assert max(run.open) < 1e-9


@pytest.mark.slow
def test_a_brittle_joint_fails_at_its_strength_and_sends_waves() -> None:
    """Softening is steeper than the bar: it is loaded without waves to strength times area, and fails dynamically."""
    toughness = 0.5
    run = Pulled(joined_bar(HYBRID, toughness, 0.705e-3)).to_end()
    first = run.slow.index(False)
    assert run.time[first] == pytest.approx(STRENGTH * HEIGHT / MODULUS / 1e-3 + 0.5e-4, rel=0.01)
    assert run.force[first - 1] == pytest.approx(WIDTH * STRENGTH, rel=0.01)
    energies = run.energies
    assert energies["fracture"] == pytest.approx(toughness * WIDTH, rel=5e-3)
    stored = 0.5 * STRENGTH**2 / MODULUS * HEIGHT * WIDTH
    assert run.energies["kinetic"] + energies["strain"] + energies["interface_elastic"] == pytest.approx(
        stored - toughness * WIDTH, rel=0.02
    )  # what the joint leaves of it are waves
    assert max(run.open) < 1e-9  # across the change, too
    assert energies["damping"] < 1e-4 * stored


def test_the_fastest_facet_yields_or_slides_under_pressure() -> None:
    """Ends open by 3 m/s and slide by 4 m/s: 5 m/s while they soften; failed, 4 m/s under pressure, else nothing."""
    model = Model(parse_case(joined_bar(SLOW, 20.0, 1e-4), HERE))
    (facets,) = (each for each in model.mechanisms if isinstance(each, IntrinsicFacets))
    state, cracks = model.initial_state(), model.cracks
    velocity = state.velocity.reshape(-1, 2)
    velocity[cracks.corners[0, 1]] = 3.0 * cracks.normal[0] + 4.0 * cracks.tangent[0]
    velocity[cracks.corners[0, 0]] = 0.0
    fields, found = state.cracks, {}
    state.time = 1e-5
    for damage, failed, traction in ((0.0, np.inf, -1.0), (0.5, np.inf, -1.0), (1.0, 1e-6, -1.0), (1.0, 1e-6, 1.0)):
        fields["damage"][0], fields["time_of_failure"][0], fields["normal_traction"][0] = damage, failed, traction
        found[damage, failed, traction] = facets.fastest(state)
    assert [*found.values()] == pytest.approx([0.0, 5.0, 4.0, 0.0])
    grown = fields["damage"] + np.linspace(0, 0.05, len(fields["damage"]))[:, None]
    reaction: Any = SimpleNamespace(fields={"damage": grown})
    assert facets.step_error(state, reaction) == pytest.approx(0.5)  # a tenth is allowed


@pytest.mark.slow
def test_equilibrium_alone_ends_where_the_brittle_joint_fails() -> None:
    run = Pulled(joined_bar(SLOW, 0.5, 1e-3))
    with pytest.raises(ConvergenceError, match="hybrid"):
        run.to_end()
    assert run.force[-1] == pytest.approx(WIDTH * STRENGTH, rel=0.01)
    assert run.energies["fracture"] < 0.05 * 0.5 * WIDTH


def test_implicit_steps_with_inertia_break_what_explicit_ones_do() -> None:
    """The joint of a bar torn apart at 3 m/s: both have the same waves and losses, up to errors of second order."""
    fast = {"boundaries": [
        {"kind": "driven", "edge": edge, "component": "y", "velocity": speed, "ramp": 2e-6}
        for edge, speed in (("upper.top", 1.5), ("lower.bottom", -1.5))
    ]}  # fmt: skip
    runs = [
        Pulled(joined_bar(stepper, 0.5, 6e-6, fast)).to_end()
        for stepper in ({"kind": "leapfrog", "safety": 0.3}, {"kind": "generalized_alpha", "courant": 0.3})
    ]
    explicit, implicit = runs
    assert explicit.energies["fracture"] == pytest.approx(0.5 * WIDTH, rel=5e-3)
    for name in ("fracture", "kinetic", "boundary_work"):
        assert implicit.energies[name] == pytest.approx(explicit.energies[name], rel=0.01), name
    assert max(implicit.open) < 1e-3
