"""Local time steps: two columns of thin elements across a fault in substeps, against small steps of all elements."""

from __future__ import annotations

import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts
from helpers.small_cases import COMPLIANT, SPLIT, STRONG, Given, advance, case, march

pytest.importorskip("dolfinx")


from ruptfx import simulate
from ruptfx.bodies import spectrum
from ruptfx.bodies.meshes.two_plates import TwoPlates
from ruptfx.bodies.operators import FusedOperator
from ruptfx.case import Case
from ruptfx.case.support import UnsupportedError
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.interfaces.attachments import Attached
from ruptfx.platform import fem, parallel
from ruptfx.run import simulation
from ruptfx.run.model import Model
from ruptfx.stepping.steppers import _clusters
from ruptfx.stepping.steppers.leapfrog import LeapfrogMotion
from ruptfx.stepping.steppers.local_leapfrog import LocalMotion

pytestmark = pytest.mark.fem

ATTACHED = [
    {**tomllib.loads(f"example = {cls.example}")["example"], "edge": "lower.right"}
    for cls in alternatives("ruptfx.interfaces.attachments").values()
]

LOCAL = {"kind": "local_leapfrog", "substeps": 5}
EVERYTHING = [
    {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0, "ramp": 2e-6},
    {"kind": "traction", "edge": "upper.top", "traction": [1e6, 2e6], "ramp": 3e-6},
    {"kind": "absorbing", "edge": "upper.right"},
    {"kind": "sponge", "edge": "lower.bottom", "width": 3e-3},
]
# Slips from 9 to 15 mm at once, across the thin columns at 14 mm.
RUPTURE = {
    "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 4e-6},
    "faults.main.initial_stress.shear": {
        "kind": "boxcar", "inside": 3.8e6, "outside": 2.5e6, "center": 12e-3, "half_width": 3e-3,
    },
}  # fmt: skip


def thin(stepper: dict[str, Any], changes: dict[str, Any] | None = None, ratio: float = 12.0) -> Case:
    """Two plates of 22 x 18 elements of 1 mm, of which columns 14 and 15 are thinner by a ratio."""
    size, columns = 1e-3, 22
    raw = TwoPlates(length=columns * size, height=9e-3, element_size=size).build()
    widths = np.full(columns, size)
    widths[14:16] /= ratio
    raw.points[:, 0] = np.interp(
        raw.points[:, 0], np.linspace(0, columns * size, columns + 1), np.concatenate([[0.0], np.cumsum(widths)])
    )
    return case({"order": 3, "stepper": {**stepper}, **(changes or {})}).model_copy(update={"mesh": Given(raw)})


def small_steps(given: Case, local: Any) -> Case:
    """The case with leapfrog, in steps as long as the substeps of a motion."""
    equal = case({"stepper": {"kind": "leapfrog", "time_step": local.dt / local.clusters.substeps}}).stepper
    return given.model_copy(update={"stepper": equal})


@pytest.mark.parametrize("substeps", [3, 5, 7])
def test_a_free_body_vibrates_for_ever(substeps: int) -> None:
    """The scheme is symplectic and linear: u(n)' M v(n+1) - v(n)' M u(n+1), an energy times -2 dt, is constant.

    All frequencies are excited alike.
    """
    free = thin({**LOCAL, "substeps": substeps}, {"faults.main.friction": STRONG, "faults.main.contact": COMPLIANT})
    model = Model(free)
    motion, state = free.stepper.bind(model), model.initial_state()
    assert isinstance(motion, LocalMotion) and motion.clusters.substeps == substeps
    state.velocity[:] = np.random.default_rng(0).standard_normal(len(state.velocity)) * 1e-3
    state.numbers["lag"] = motion.dt / substeps
    modified, energy = [], []
    for _ in range(400):
        displacement, velocity = state.displacement.copy(), model.mass * state.velocity
        motion.step(state)
        modified.append(
            (velocity @ state.displacement - displacement @ (model.mass * state.velocity)) / (2 * motion.dt)
        )
        now = motion.energies(state)
        energy.append(now["kinetic"] + now["strain"] + now["interface_elastic"] - now["boundary_work"])
    assert np.ptp(modified) < 1e-10 * modified[0] and modified[0] > 0
    # The energy of records changes with the motion, without drift: as much in the first as in the last half.
    first, last = energy[:200], energy[200:]
    assert np.ptp(energy) < 5e-3 * energy[0]
    assert abs(np.mean(last) - np.mean(first)) < 1e-3 * energy[0]


def test_impulses_beside_small_elements_are_unstable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without layers of larger elements around the small ones the motion of the same body grows without bound."""
    monkeypatch.setattr(_clusters, "LAYERS", 0)
    free = thin({**LOCAL, "substeps": 7}, {"faults.main.friction": STRONG, "faults.main.contact": COMPLIANT})
    model = Model(free)
    motion, state = free.stepper.bind(model), model.initial_state()
    state.velocity[:] = np.random.default_rng(0).standard_normal(len(state.velocity)) * 1e-3
    state.numbers["lag"] = motion.dt / 7
    advance(motion, state, 400 * motion.dt)
    assert not np.abs(state.velocity).max() < 1e3


@pytest.mark.parametrize("contact", [SPLIT, COMPLIANT], ids=["split", "compliant"])
@pytest.mark.parametrize("changes", [
    {}, {"damping": {"kelvin_voigt": {"fraction": 0.2}}}, {"precision": "single"},
    {"attachments": ATTACHED},
], ids=["plain", "viscous layer", "single", "attachments"])  # fmt: skip
def test_slip_is_that_of_small_steps(contact: dict[str, Any], changes: dict[str, Any]) -> None:
    """A rupture that crosses both clusters, driven, loaded, absorbed; the budget closes as the stepper says."""
    busy = thin(LOCAL, {**RUPTURE, **changes, "faults.main.contact": contact, "boundaries": EVERYTHING})
    model = Model(busy)
    motion, state = busy.stepper.bind(model), model.initial_state()
    assert isinstance(motion, LocalMotion) and 0.05 < motion.clusters.share < 0.2
    advance(motion, state, 8e-6)
    _, equal, alone = march(small_steps(busy, motion), state.time)
    assert isinstance(equal, LeapfrogMotion) and alone.time == pytest.approx(state.time, rel=1e-12)
    here, there = state.faults["main"], alone.faults["main"]
    beyond = model.faults[0].interface.points[:, 0] > 14.2e-3
    assert there["slip"][beyond].max() > 0.05 * there["slip"].max()
    for name in ("slip", "normal_stress"):
        np.testing.assert_allclose(here[name], there[name], atol=1e-3 * np.abs(there[name]).max())
    # Of the whole bodies, in which larger elements take longer steps.
    for ours, its, bound in ((state.displacement, alone.displacement, 1e-3), (state.velocity, alone.velocity, 0.02)):
        assert np.linalg.norm(ours - its) < bound * np.linalg.norm(its)
    energy = motion.energies(state)
    lost = 2 * energy["boundary_work"] - sum(energy.values())
    assert abs(lost) < busy.stepper.closure * energy["boundary_work"]
    assert energy["frictional_dissipation"] > 1e-3 * energy["boundary_work"] < 1e3 * energy["damping"]


PARTS: dict[str, dict[str, Any]] = {
    # Thin columns end at both tied edges; the others are tied far from them.
    "tied ends of the columns": {"boundaries": [
        {"kind": "periodic", "first": "lower.bottom", "second": "upper.top"}, EVERYTHING[2],
    ]},
    "tied sides": {"boundaries": [
        *({"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"} for body in ("upper", "lower")),
        EVERYTHING[1], EVERYTHING[3],
    ]},
    "prescribed slip": {"boundaries": EVERYTHING, "faults.main.prescribed_slip": [{
        "kind": "gaussian", "slip": 1e-5, "width": 1e-6,
        "where": {"kind": "boxcar", "inside": 1.0, "outside": 0.0, "center": 14e-3, "half_width": 2e-3},
    }]},
    "thermal pressurisation": {"boundaries": EVERYTHING, "faults.main.pore_pressure": [{
        "kind": "thermal_pressurisation", "hydraulic_diffusivity": 4e-6, "pressure_per_temperature": 1e6,
        "heat_capacity": 2.7e6, "thermal_diffusivity": 1e-6, "width": 5e-6,
    }]},
    "a well": {"boundaries": EVERYTHING, "faults.main.pore_pressure": [{
        "kind": "diffusion", "permeability": 1e-10, "viscosity": 1e-3, "compressibility": 1e-8, "porosity": 0.1,
        "thickness": 1.0, "wells": [{"center": 14e-3, "rate": 1.0}],
    }]},
}  # fmt: skip
"""Parts of a case that act in every substep."""


@pytest.mark.parametrize("part, contact", [
    ("tied ends of the columns", SPLIT), ("tied sides", COMPLIANT), ("prescribed slip", SPLIT),
    ("prescribed slip", COMPLIANT), ("thermal pressurisation", SPLIT), ("a well", COMPLIANT),
], ids=lambda value: value if isinstance(value, str) else value["kind"])  # fmt: skip
def test_parts_of_a_case_act_in_substeps(part: str, contact: dict[str, Any]) -> None:
    """Slip, traction and pressure are those of small steps, and the part acts where elements are small."""
    busy = thin(LOCAL, {**RUPTURE, "faults.main.contact": contact, **PARTS[part]})
    model, motion, state = march(busy, 5e-6)
    assert isinstance(motion, LocalMotion) and motion.clusters.substeps == 5 and motion.clusters.share < 0.2
    _, equal, alone = march(small_steps(busy, motion), state.time)
    assert isinstance(equal, LeapfrogMotion) and alone.time == pytest.approx(state.time, rel=1e-12)
    here, there = state.faults["main"], alone.faults["main"]
    for name in {"slip", "normal_stress", "pore_pressure", "temperature"} & {*here}:
        np.testing.assert_allclose(here[name], there[name], atol=1e-3 * np.abs(there[name]).max(), err_msg=name)
    among = np.abs(model.faults[0].interface.points[:, 0] - 14e-3) < 1e-3
    assert here["slip"][among].max() > 0.05 * here["slip"].max()
    if "pore_pressure" in here:
        assert np.abs(here["pore_pressure"][among]).max() > 1e-3 * 6e6
    if part.startswith("tied"):
        first, second = (state.velocity.reshape(model.nodes, -1)[at] for at in (model.layout.kept, model.layout.copies))
        assert np.array_equal(first, second) and np.abs(first).max() > 1e-2
    assert np.linalg.norm(state.displacement - alone.displacement) < 1e-3 * np.linalg.norm(alone.displacement)
    energy = motion.energies(state)
    lost = 2 * energy["boundary_work"] - sum(energy.values())
    assert abs(lost) < busy.stepper.closure * max(abs(each) for each in energy.values())


@pytest.mark.parametrize("contact", [SPLIT, COMPLIANT], ids=["split", "compliant"])
def test_second_order(contact: dict[str, Any]) -> None:
    """A stuck fault; halves of the step make a quarter of the difference."""
    finals = []
    for steps in (40, 80, 160):
        smooth = thin(
            {**LOCAL, "time_step": 1.6e-6 / steps}, {"faults.main.contact": contact, "boundaries": EVERYTHING}
        )
        _, motion, state = march(smooth, 1.6e-6)
        assert state.step == steps and isinstance(motion, LocalMotion)
        finals.append(state.displacement.copy())
    coarse, fine = (np.linalg.norm(a - b) for a, b in pairwise(finals))
    assert 3.5 < coarse / fine < 4.5


@pytest.mark.mpi
@pytest.mark.parametrize("operator", ["matrix_free", "ufl_form"])
def test_the_same_on_any_ranks(operator: str) -> None:
    busy = thin(LOCAL, {**RUPTURE, "boundaries": EVERYTHING, "faults.main.contact": SPLIT, "operator": operator})
    found = []
    for comm in (fem.MPI.COMM_WORLD, fem.MPI.COMM_SELF):
        model, motion, state = march(busy, 2e-6, comm=comm)
        face, values = model.faults[0].interface, state.faults["main"]["slip"]
        rows = parallel.share_rows(comm, np.column_stack([face.number, values])[face.owned])
        found.append((rows[np.argsort(rows[:, 0])], np.array([*motion.energies(state).values()])))
    for here, alone in zip(*found, strict=True):
        np.testing.assert_allclose(here, alone, rtol=1e-9, atol=1e-11 * np.abs(alone).max())
    assert found[0][0][:, 1].max() > 1e-7


@pytest.mark.parametrize("operator", ["matrix_free", "ufl_form"])
def test_a_rank_may_have_no_element_of_a_cluster(operator: str) -> None:
    model = Model(case({"order": 2, "operator": operator}))
    idle = _clusters.part_of(model, np.zeros(len(model.bulk.cell_material), dtype=bool))
    assert isinstance(idle, FusedOperator) == isinstance(model.operator, FusedOperator)
    force = np.zeros(len(model.mass))
    idle.add_internal_force(np.ones(len(model.mass)), force)
    assert not force.any()
    if isinstance(idle, FusedOperator):
        idle.prepare_step(np.zeros(model.nodes, dtype=bool))
        velocity, displacement = np.ones(len(force)), np.zeros(len(force))
        assert idle.step(displacement, velocity, force, np.ones(model.nodes), 1.0, part="boundary") == 0
        assert not displacement.any()


def test_a_stopped_run_goes_on_bitwise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = thin(LOCAL, {**RUPTURE, "faults.main.contact": COMPLIANT, "duration": 3e-6})
    with simulate(given, tmp_path / "run", progress=False) as alone:
        slip, steps = alone.interface.slip.values, alone.summary["steps"]
    calls = iter(range(1000))
    with monkeypatch.context() as patch:
        patch.setattr(simulation.Signals, "anywhere", lambda self, comm: "SIGTERM" if next(calls) == 30 else "")
        with pytest.raises(simulation.Interrupted, match=facts("step 31")):
            simulate(given, tmp_path / "stopped", progress=False)
    assert steps > 60
    with simulate(given, tmp_path / "stopped", progress=False, resume=True) as resumed:
        np.testing.assert_array_equal(resumed.interface.slip.values, slip)
    assert slip.max() > 1e-7


def test_equal_elements_take_equal_steps() -> None:
    """Without small elements, or in one substep, it is the leapfrog."""
    uniform = case({**RUPTURE, "stepper": {"kind": "local_leapfrog"}})
    _, motion, state = march(uniform)
    _, _, alone = march(uniform.model_copy(update={"stepper": case().stepper}))
    assert isinstance(motion, LeapfrogMotion)
    np.testing.assert_array_equal(state.displacement, alone.displacement)
    one = thin({**LOCAL, "substeps": 1})
    assert isinstance(one.stepper.bind(Model(one)), LeapfrogMotion)


def test_substeps_are_chosen() -> None:
    """Thinner by 12: sqrt(1 + 144) / sqrt(2) = 8.5 times the highest frequency. Eleven substeps are refused."""
    motion = thin({"kind": "local_leapfrog"}).stepper.bind(Model(thin({"kind": "local_leapfrog"})))
    assert isinstance(motion, LocalMotion) and motion.clusters.substeps in (5, 7)
    assert motion.clusters.work < 0.7 and motion.clusters.share == pytest.approx(2 / 22)
    many = thin({**LOCAL, "substeps": 11})
    with pytest.raises(CaseError, match=facts("stepper.substeps = 11: no elements are large enough; leave it out")):
        many.stepper.bind(Model(many))


@pytest.mark.parametrize("changes, message", [
    ({"damping": {"mass": 1e4}}, "damping.mass = 10000: equal steps only; remove it, or use stepper.kind = 'leapfrog'"),
    ({"damping": {"kelvin_voigt": {"beta_2": 0.6}}, "operator": "ufl_form"},
     "damping.kelvin_voigt: operator = 'ufl_form' damps in equal steps only; use operator = 'matrix_free', remove the "
     "damping, or use stepper.kind = 'leapfrog'"),
    ({"stepper.time_step": 1e-6}, "stepper.substeps = 5: no elements are large enough for steps of 1e-06 s"),
])  # fmt: skip
def test_refusals(changes: dict[str, Any], message: str) -> None:
    wrong = thin(LOCAL, changes)
    with pytest.raises(CaseError, match=facts(message)):
        wrong.stepper.bind(Model(wrong))


def test_an_attachment_in_equal_steps_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Attached, "local_steps", False)
    wrong = thin(LOCAL, {"attachments": ATTACHED[:1]})
    with pytest.raises(CaseError, match=facts("attachments: name = 'base' acts in equal steps only; remove it")):
        wrong.stepper.bind(Model(wrong))


def test_clusters_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lanczos runs for all elements and for the larger ones, however often small ones are looked for."""
    applied: list[int] = []
    lanczos = spectrum._lanczos

    def counted(model: Any, springs: Any) -> float:
        applied.append(len(springs))
        return lanczos(model, springs)

    monkeypatch.setattr(spectrum, "_lanczos", counted)
    given = thin(LOCAL, {**RUPTURE, "duration": 1e-7})
    model = Model(given)
    given.stepper.bind(model)
    assert len(applied) == 2


def test_what_the_case_refuses() -> None:
    with pytest.raises(CaseError, match=facts("substeps = 4: must be odd; use 5")):
        thin({**LOCAL, "substeps": 4})
    with pytest.raises(UnsupportedError, match=facts("stepper.kind = 'local_leapfrog': stages")):
        case({"stepper": LOCAL, "stages": [{"duration": 5e-6}]})
