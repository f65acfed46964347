"""Cohesion and nucleation between solids that slide: separation against the law, energies, restart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.sliding_cases import solids
from helpers.small_cases import advance, march
from helpers.whole_runs import assert_goes_on_with_the_same_bits, run_of

pytest.importorskip("dolfinx")

from ruptfx.bodies.state import State
from ruptfx.case import parse_case
from ruptfx.results.record import Record
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

EXACT = {"kind": "forward_lagrange", "tolerance": 1e-13, "sweeps": 300}
COMPLIANT = {"kind": "compliant", "C_n": 3e12, "C_s": 1e12}
WEAK = {"kind": "linear", "f_t": 2e6, "c": 4e6, "G_Ic": 3.0, "G_IIc": 12.0}


def driven(velocity: tuple[float, float, float]) -> list[dict[str, Any]]:
    """The lower body held, the top of the upper one driven."""
    edges = [("lower.bottom", axis, 0.0) for axis in "xyz"]
    edges += [("upper.top", axis, value) for axis, value in zip("xyz", velocity, strict=True)]
    return [{"kind": "driven", "edge": edge, "component": c, "velocity": v, "ramp": 0.5e-6} for edge, c, v in edges]


@pytest.mark.parametrize("contact", [EXACT, COMPLIANT], ids=["forward_lagrange", "compliant"])
@pytest.mark.parametrize(
    "velocity", [(0.0, 0.0, 8.0), (8.0, 6.0, 0.0), (6.0, 4.0, 8.0)], ids=["open", "shear", "mixed"]
)
def test_cohesion_between_solids(velocity: tuple[float, float, float], contact: dict[str, Any]) -> None:
    """Traction stays within the law and reaches it, failed points have dissipated G, and energies close."""
    case = parse_case(solids({
        "boundaries": driven(velocity), "duration": 3e-6, "faults.main.contact": contact,
        "faults.main.cohesion": WEAK, "faults.main.friction.mu_d": 0.0, "faults.main.sliding.update_slip": 0.02,
    }))  # fmt: skip
    ratio: list[np.ndarray] = []

    def watch(state: State) -> None:
        fields = state.faults["main"]
        shear = np.hypot(fields["shear_traction_1"], fields["shear_traction_2"])
        for traction, strength in ((-fields["normal_stress"], WEAK["f_t"]), (shear, WEAK["c"])):
            remaining = strength * (1 - fields["damage"])
            assert np.all(traction <= remaining + 1e-9 * strength)
            softens = (fields["damage"] > 0.05) & (fields["damage"] < 0.95)
            ratio.append(traction[softens] / remaining[softens])

    model, motion, state = march(case, watch=watch)
    energies = motion.energies(state)
    work = energies.pop("boundary_work")
    assert abs(work - sum(energies.values())) < 1e-10 * abs(work)
    face, fields = model.faults[0].interface, state.faults["main"]
    assert fields["damage"].min() == 1.0 and (face.geometry.revision > 2) == (velocity[0] > 0)
    np.testing.assert_allclose(np.concatenate(ratio).max(), 1.0, atol=1e-9)
    spent = energies["fracture"] / face.weight.sum()
    energy = {0: WEAK["G_Ic"], 10: WEAK["G_IIc"]}.get(10 * (velocity[0] > 0) + velocity[2])
    if energy is None:  # opening and slip, each of which alone would need its energy
        assert WEAK["G_Ic"] < spent < WEAK["G_IIc"]
    else:
        np.testing.assert_allclose(spent, energy, rtol=0.04)  # a step opens 5 % of the jump at failure


def test_cohesion_without_friction_dissipates_nothing_else() -> None:
    """Springs that no update stretches: all dissipated energy is that of the fracture."""
    case = parse_case(solids({
        "boundaries": driven((8.0, 6.0, 0.0)), "duration": 2e-6, "order": 1, "faults.main.contact": COMPLIANT,
        "faults.main.cohesion": WEAK, "faults.main.friction.mu_d": 0.0, "faults.main.sliding.update_slip": 1e3,
    }))  # fmt: skip
    _, motion, state = march(case)
    energies = motion.energies(state)
    assert state.faults["main"]["damage"].max() == 1.0 and energies["fracture"] > 1e-6
    assert abs(energies["frictional_dissipation"]) < 1e-12 * energies["fracture"]


@pytest.mark.parametrize("rake", [0.0, 40.0])
def test_overstress_drives_along_the_rake(rake: float) -> None:
    """Free bodies: the momentum of the upper one is that of the driving traction less friction, to 1e-9 of it."""
    shear, extra, normal = 1.2e6, 1e6, 5e6
    case = parse_case(solids({
        "boundaries": [], "duration": 0.4e-6, "faults.main.contact": EXACT,
        "faults.main.initial_stress": {"normal": normal, "shear": shear, "rake": rake},
        "faults.main.nucleation": {"kind": "overstress", "extra": extra},
    }))  # fmt: skip
    friction: list[np.ndarray] = []  # of all points, at every step [N]

    def watch(state: State) -> None:
        fields = state.faults["main"]
        friction.append(np.stack([fields[f"shear_traction_{k}"] for k in (1, 2)]) @ model.faults[0].interface.weight)

    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    advance(motion, state, case.duration, watch)
    face = model.faults[0].interface
    upper = model.layout.body == model.bodies.names.index("upper")
    momentum = (model.mass * state.velocity).reshape(-1, 3)[upper].sum(axis=0)
    way = np.array([np.cos(np.deg2rad(rake)), np.sin(np.deg2rad(rake))])
    kick = motion.dt * np.array([0.5, *np.ones(len(friction) - 1)])
    force = (shear + extra) * face.weight.sum() * way - np.array(friction)
    np.testing.assert_allclose(
        momentum[:2], face.frame[0, 1:, :2].T @ (kick @ force), atol=1e-9 * np.abs(momentum).max()
    )
    # Normal forces hardly change before waves of the rims arrive everywhere.
    exact = (shear + extra - 0.3 * normal) * face.weight.sum() * kick.sum()
    np.testing.assert_allclose(momentum[:2], exact * way, atol=0.01 * exact)
    energies = motion.energies(state)
    assert abs(energies.pop("boundary_work") - sum(energies.values())) < 1e-10 * energies["frictional_dissipation"]


CHANGES = {
    "boundaries": driven((20.0, 10.0, -1.0)), "duration": 1.2e-6, "output.checkpoint_steps": 9,
    "output.interface_interval": 0.2e-6, "faults.main.sliding.update_slip": 0.01,
    "faults.main.cohesion": {**WEAK, "G_Ic": 15.0, "G_IIc": 60.0},
    "faults.main.nucleation": [
        {"kind": "overstress", "extra": 1e5},
        {"kind": "friction_drop", "center": {"x": 0.7e-3, "y": 0.5e-3, "z": 0.0}, "half_width": 0.3e-3, "time": 0.4e-6},
    ],
}  # fmt: skip

case_file, alone = run_of(solids(CHANGES))


def test_cohesion_and_nucleation_go_on_with_the_same_bits(case_file: Path, alone: Path) -> None:
    with Record(alone) as record:
        damage, slip = (record.interface[name].values[-1] for name in ("damage", "slip_1"))
    assert damage.min() > 0.5 and damage.max() < 1.0 and slip.max() > 1e-6
    assert_goes_on_with_the_same_bits(case_file, alone, checkpoints=2)
