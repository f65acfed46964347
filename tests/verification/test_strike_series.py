"""Fourier series along strike: closed forms of a plane fault, sections without change along strike, the 3D mesh."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.compare import largest_difference
from helpers.messages import facts
from helpers.strike_cases import faulted
from pydantic import ValidationError

from ruptfx import RuptfxError
from ruptfx.app.checks.preflight import preflight
from ruptfx.app.commands import check
from ruptfx.app.commands._shared import screen
from ruptfx.bodies.boundaries.driven import Driven
from ruptfx.bodies.meshes.half_plate import HalfPlate
from ruptfx.bodies.meshes.two_plates import TwoPlates
from ruptfx.bodies.state import State
from ruptfx.case import Case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces import section
from ruptfx.interfaces.faults.fault import Fault
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.interfaces.section import Section
from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.laws.materials.orthotropic_elastic import OrthotropicElastic
from ruptfx.laws.materials.stiffness import linear_stiffness
from ruptfx.platform import fem, memory
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.recording.recorder import Recorder
from ruptfx.run.simulation import simulate
from ruptfx.stepping.implicit import ConvergenceError, series_bodies, stored, strike_series
from ruptfx.stepping.implicit.strike_series import StrikeSeries
from ruptfx.stepping.steppers.quasi_dynamic import QuasiDynamicMotion, SeriesMotion

pytestmark = pytest.mark.fem

G, NU = 30e9, 0.25
ROCK = {"default": IsotropicElastic(young_modulus=2 * G * (1 + NU), poisson_ratio=NU, density=2670.0)}


def half_space(size: float, order: int) -> Section:
    """One half of a whole space with a plane fault of length 1 along x, between planes of symmetry."""
    held = [Driven(edge=f"upper.{side}", component="x", velocity=0.0) for side in ("left", "right")]
    far = [Driven(edge="upper.top", component=axis, velocity=0.0) for axis in "xyz"]
    mesh = HalfPlate(length=1.0, height=6.0, element_size=size, growth=1.15)
    return Section(mesh, ROCK, order, [*held, *far])


def series(bodies: Section, folder: Path, points: int = 16, compliance: float = 1e-9 / G) -> StrikeSeries:
    nearly_rigid = np.full((len(bodies.faces["main"].plus), 3), compliance)
    return StrikeSeries(bodies, ["main"], nearly_rigid, 2 * np.pi, points, fem.MPI.COMM_WORLD, folder)


@pytest.mark.parametrize(("q", "k"), [(0, 2), (0, 5), (np.pi, 2), (np.pi, 5), (2 * np.pi, 1)])
def test_closed_form_of_a_plane_fault(q: float, k: int, tmp_path: Path) -> None:
    """Slip along strike cos(q x) sin(k z) and along the section sin(q x) cos(k z) in a whole space.

    G kappa / 2 (delta + (1 / (1 - nu) - 1) k k' / kappa^2) with the wavenumbers k along both directions.
    """
    K = series(half_space(1 / 4, 4), tmp_path)
    x, weight = K.section.faces["main"].points[:, 0], K.weight[::3]
    z, kappa = 2 * np.pi * np.arange(16)[:, None] / 16, np.hypot(q, k)
    strike, dip = np.cos(q * x) * np.sin(k * z), np.sin(q * x) * np.cos(k * z)
    none = np.zeros_like(strike)

    def part(values: np.ndarray, pattern: np.ndarray) -> float:
        return float(np.sum(weight * values * pattern) / np.sum(weight * pattern**2))

    by_strike = K.traction(np.stack([strike, none], axis=2))
    assert part(by_strike[..., 1], strike) == pytest.approx(0.5 * G * kappa * ((k / kappa) ** 2 / (1 - NU) +
                                                                            (q / kappa) ** 2), rel=2e-5)  # fmt: skip
    assert not K.has_opening and not by_strike[..., 0].any()
    if q:
        by_dip = K.traction(np.stack([none, dip], axis=2))
        assert part(by_dip[..., 2], dip) == pytest.approx(0.5 * G * kappa * ((q / kappa) ** 2 / (1 - NU) +
                                                                          (k / kappa) ** 2), rel=2e-5)  # fmt: skip
        mixed = 0.5 * G * q * k / kappa * (1 / (1 - NU) - 1)
        assert part(by_strike[..., 2], dip) == pytest.approx(mixed, rel=1e-4)
        assert part(by_dip[..., 1], strike) == pytest.approx(mixed, rel=1e-4)


def test_matrices_are_read_again_unless_damaged_or_of_other_bodies(tmp_path: Path) -> None:
    first = series(half_space(1 / 2, 2), tmp_path, 8)
    slip = np.random.default_rng(1).normal(size=(8, first.size, 2))
    assert first.stored == 0 and len(list(tmp_path.iterdir())) == 5
    again = series(half_space(1 / 2, 2), tmp_path, 8)
    assert again.stored == 5
    np.testing.assert_array_equal(again.traction(slip), first.traction(slip))
    damaged = sorted(tmp_path.iterdir())[0]
    damaged.write_bytes(damaged.read_bytes()[:-40] + bytes(40))
    mended = series(half_space(1 / 2, 2), tmp_path, 8)
    assert mended.stored == 4
    np.testing.assert_array_equal(mended.traction(slip), first.traction(slip))
    assert series(half_space(1 / 2, 2), tmp_path, 8, 2e-9 / G).stored == 0


def test_run_and_log_say_which_matrices_were_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """9 wavenumbers; the first run ends in the fifth, the second one goes on with it, the third computes none."""
    monkeypatch.setattr(stored, "cache_directory", lambda: tmp_path)
    compute, computed = StrikeSeries._computed, [0]

    def count(self: StrikeSeries, k: float) -> np.ndarray:
        computed[0] += 1
        if computed[0] == 5:
            raise RuptfxError("killed")
        return compute(self, k)

    monkeypatch.setattr(StrikeSeries, "_computed", count)
    case, alone = faulted({"duration": 10.0}), fem.MPI.COMM_SELF
    with pytest.raises(RuptfxError, match="killed"):
        simulate(case, tmp_path / "killed", comm=alone)
    for name, facts_of_run in (("second", ("4 read", "5 computed")), ("third", ("all 9 read", "none computed"))):
        capfd.readouterr()
        simulate(case, tmp_path / name, comm=alone)
        said = next(line for line in (tmp_path / name / "run.log").read_text().splitlines() if "wavenumbers" in line)
        assert all(fact in said for fact in (*facts_of_run, str(tmp_path / "stiffness")))
        assert said.split("INFO ")[1] in capfd.readouterr().err
    assert computed[0] == 10


def test_reciprocity_between_unlike_bodies(tmp_path: Path) -> None:
    """s' W K r = r' W K s for any slip, with opening stress of the sign that the stiffer side gives it."""
    soft = IsotropicElastic(young_modulus=30e9, poisson_ratio=0.3, density=2500.0)
    bodies = {"upper": ROCK["default"], "lower": soft}
    held = [Driven(edge=edge, component=axis, velocity=0.0) for edge in ("upper.top", "lower.bottom") for axis in "xyz"]
    plates = Section(TwoPlates(length=1.0, height=1.0, element_size=0.25), bodies, 2, held)
    K = series(plates, tmp_path, 9)
    one, other = np.random.default_rng(2).normal(size=(2, 9, K.size, 2))
    weight = K.weight[::3, None]
    products = [np.sum(weight * a * K.traction(b)[..., 1:]) for a, b in ((one, other), (other, one))]
    assert products[0] == pytest.approx(products[1], rel=1e-9)
    assert K.has_opening and np.sum(weight * one * K.traction(one)[..., 1:]) > 0


def test_as_the_true_mesh_in_three_dimensions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slip along strike sin(k z) on a plane between unlike plates, of the length of one wave, against an extruded mesh.

    Its ends along z are planes of antisymmetry in u_x, u_y and of symmetry in u_z, as those of the series.
    """
    monkeypatch.setattr(Section, "strain_measure", Section.measure)  # the quadrature of other meshes
    bodies = {
        "upper": {"kind": "isotropic_elastic", "young_modulus": 80e9, "poisson_ratio": 0.25, "density": 2700.0},
        "lower": {"kind": "isotropic_elastic", "young_modulus": 30e9, "poisson_ratio": 0.3, "density": 2500.0},
    }
    flat = {"kind": "two_plates", "length": 1.0, "height": 1.0, "element_size": 0.5}
    far = [{"kind": "driven", "edge": edge, "component": axis, "velocity": 0.0}
           for edge in ("upper.top", "lower.bottom") for axis in "xyz"]  # fmt: skip
    ends = [{"kind": "driven", "edge": f"{body}.{end}", "component": "z", "velocity": 0.0}
            for body in bodies for end in ("back", "front")]  # fmt: skip
    law = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 2e-3, "f_0": 0.6, "V_0": 1e-6}
    shared = {
        "plane": "solid", "order": 4, "duration": 1.0, "materials": bodies, "stepper": {"kind": "quasi_dynamic"},
        "faults": {"main": {"contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14}, "friction": law,
                            "initial_stress": {"normal": 6e6, "shear": 3.3e6}}},
    }  # fmt: skip
    extruded = {"kind": "extruded", "thickness": 0.5, "layers": 2, "section": flat}
    solid = Case.model_validate({**shared, "boundaries": [*far, *ends], "mesh": extruded})
    along = {"length": 1.0, "period": 1.0, "points": 8}
    repeats = Case.model_validate({**shared, "boundaries": far, "mesh": {**flat, "along_strike": along}})
    tractions = []
    for case in (solid, repeats):
        model = Model(case, fem.MPI.COMM_SELF)
        bodies_of = case.stepper.bind(model)._bodies
        points, frame = model.faults[0].interface.points, model.faults[0].interface.frame
        slip, taper = np.zeros((len(points), 3)), np.sin(np.pi * points[:, 0]) ** 2
        slip[:, 2] = taper * np.sin(2 * np.pi * points[:, 2])
        slip[:, 0] = 0.5 * taper * np.cos(2 * np.pi * points[:, 2])
        local = np.einsum("ikc,ic->ik", frame, slip)[:, 1:]
        traction = bodies_of.traction(np.zeros((len(points), 3)), local)
        globally = np.einsum("ikc,ik->ic", frame, traction)
        # Amplitudes of the wave at every x.
        x = np.unique(np.round(points[:, 0], 9))
        wave = np.column_stack([np.cos(2 * np.pi * points[:, 2])] * 2 + [np.sin(2 * np.pi * points[:, 2])])
        weight = model.faults[0].interface.weight[:, None]
        tractions.append(np.array([
            (weight * globally * wave)[at].sum(axis=0) / (weight * wave**2)[at].sum(axis=0)
            for at in (np.abs(points[:, 0] - each) < 1e-6 for each in x)
        ]))  # fmt: skip
    true, ours = tractions
    assert np.abs(ours).max(axis=0).min() > 1e9
    np.testing.assert_allclose(ours, true, atol=5e-4 * np.abs(true).max())


def test_energy_and_restart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work of driven edges = energy of bodies + friction + radiation; a stopped run goes on bitwise."""
    case = faulted({"output": {"figures": False, "interface_growth": 1.5, "checkpoint_steps": 20}, "duration": 300.0})
    simulate(case, tmp_path / "whole", progress=False).close()
    with Record(tmp_path / "whole") as record:
        energy = {name: np.asarray(record.energy[name]) for name in ("closure", "frictional_dissipation", "strain")}
        worst = np.abs(energy["closure"]).max()
        assert worst < 1e-9 and energy["frictional_dissipation"][-1] > 0 and np.abs(energy["strain"][-1]) > 0
    step = QuasiDynamicMotion.step

    def stops(motion: QuasiDynamicMotion, state: State) -> None:
        if state.step == 50:
            raise ConvergenceError("stopped by the test")
        step(motion, state)

    monkeypatch.setattr(QuasiDynamicMotion, "step", stops)
    with pytest.raises(ConvergenceError):
        simulate(case, tmp_path / "stopped", progress=False)
    monkeypatch.setattr(QuasiDynamicMotion, "step", step)
    simulate(case, tmp_path / "stopped", progress=False, resume=True).close()
    assert max(largest_difference(tmp_path / "whole", tmp_path / "stopped").values()) == 0


@pytest.mark.parametrize(("now", "then", "due"), [
    (1e-9, 0.0, True), (2.9e-9, 1e-9, False), (3.1e-9, 1e-9, True), (1e-9, 2.9e-9, False), (1e-9, 3.1e-9, True),
    (0.0, 0.0, False),
])  # fmt: skip
def test_record_where_the_largest_slip_rate_has_changed_by_the_factor(now: float, then: float, due: bool) -> None:
    output = SimpleNamespace(interface_growth=3.0)
    recorder: Any = SimpleNamespace(
        model=SimpleNamespace(case=SimpleNamespace(output=output)), _fastest=now, _fastest_recorded=then
    )
    assert Recorder._has_grown(recorder) == due
    output.interface_growth = None
    assert not Recorder._has_grown(recorder)


def test_fault_that_creeps_as_a_whole_is_the_antiplane_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction that is uniform along strike: slip of the section in antiplane shear at the same time."""
    monkeypatch.setattr(Section, "strain_measure", Section.measure)  # the quadrature of other meshes
    ends = {}
    for name in ("surface", "line"):
        changes: dict[str, object] = {"faults.main.friction.a": 0.02, "duration": 40.0,
                                      "mesh.along_strike": {"length": 8.0, "period": 8.0, "points": 4}}  # fmt: skip
        case = faulted(changes)
        if name == "line":
            table = case.model_dump(exclude_none=True)
            table |= {"plane": "antiplane", "output": {"figures": False}, "boundaries": [
                each for each in table["boundaries"] if each["component"] == "z"]}  # fmt: skip
            del table["mesh"]["along_strike"]
            case = Case.model_validate(table)
        model = Model(case, fem.MPI.COMM_SELF)
        motion, state = case.stepper.bind(model), model.initial_state()
        while state.time < 40 * (1 - 1e-9):
            state.numbers["dt"] = min(state.numbers.get("dt", motion.dt), 40 - state.time)
            motion.step(state)
        fields, face = state.faults["main"], model.faults[0].interface
        depth = face.points[:, 0]
        slip = fields["slip_1" if name == "surface" else "slip"]
        ends[name] = [slip[np.abs(depth - x) < 1e-9] for x in np.unique(np.round(depth, 9))]
    for surface, line in zip(ends["surface"], ends["line"], strict=True):
        assert len(surface) == 4 and np.ptp(surface) < 1e-12
        assert surface[0] == pytest.approx(line[0], rel=1e-6)
    assert ends["line"][0][0] < 0.6 * ends["line"][-1][0]


@pytest.mark.parametrize(("changes", "words"), [
    ({"mesh.along_strike": {"length": 9.0, "period": 8.0, "points": 16}}, "period = 8.*length = 9"),
    ({"stepper": {"kind": "leapfrog"}, "output.interface_steps": None}, "along_strike.*leapfrog.*quasi_dynamic"),
    ({"plane": "strain"}, "along_strike.*plane = 'strain'.*'solid'"),
    ({"output.bulk_interval": 1.0}, "bulk_interval = 1 s"),
])  # fmt: skip
def test_refusals(changes: dict[str, object], words: str) -> None:
    with pytest.raises((CaseError, ValidationError), match=f"(?s){words}"):
        faulted(changes)


@pytest.mark.parametrize("axis", [0, 2])
def test_contact_varies_down_dip_only(axis: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A compliance that is 1e-13 m/Pa times one plus a tenth of the depth (x), or of the position along strike (z)."""
    case = faulted()
    model = Model(case, fem.MPI.COMM_SELF)

    def compliance(fault: Fault) -> np.ndarray:
        return 1e-13 * np.outer(1 + 0.1 * fault.interface.points[:, axis], [1.0, 1.0, 2.0])

    monkeypatch.setattr(series_bodies, "compliance", compliance)
    if axis == 2:
        with pytest.raises(CaseError, match=facts("faults.contact: .* C_n and C_s")):
            case.stepper.bind(model)
    else:
        motion = case.stepper.bind(model)
        assert isinstance(motion, SeriesMotion)
        contact = motion._bodies._contact  # the surface first, 4 m down dip last
        expected = 1e-13 * np.outer([1.0, 1.2, 1.4], [1.0, 1.0, 2.0])
        np.testing.assert_allclose(contact[[0, 4, -1]], expected, rtol=1e-9)


def test_refuses_matrices_beyond_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """9 wavenumbers and 9 points of 3 by 2 components are 35 kB."""
    monkeypatch.setattr(memory, "available", lambda: 3e4)
    case = faulted()
    with pytest.raises(RuptfxError, match=facts(r"points = 16.*3\.5e-05 GB.*3e-05 GB")):
        case.stepper.bind(Model(case, fem.MPI.COMM_SELF))


def test_check_says_memory_and_time_before_a_matrix_is_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    """16 points along strike, 9 down dip: 288 components; 27 solutions of 9 wavenumbers; 9 x 54 x 9 doubles."""

    def compute(*_: object) -> None:
        raise RuptfxError("computed")

    monkeypatch.setattr(strike_series.StrikeSeries, "_matrix", compute)
    rows = []
    with pytest.raises(RuptfxError, match="computed"):
        for row in preflight(faulted()):
            assert row.early
            rows.append(row)
    values = {row.quantity.removeprefix("mesh.along_strike: "): row.value for row in rows}
    unknowns = 3 * 17 * 9  # of 8 x 4 elements of order 2, or more than there are: elements grow
    seconds = values.pop("time of the matrices")
    assert isinstance(seconds, float) and 0 < seconds < 9 * unknowns * (4e-6 + 27 * 1.5e-7)
    assert values == {
        "components of slip": 2 * 16 * 9, "memory of the matrices": 9 * 6 * 9**2 * 8, "solutions of a wavenumber": 27,
    }  # fmt: skip


def test_long_computations_are_said_before_they_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(screen, "print", said.append)
    first, last = Row("matrices", 3.5e6, "B", "at most", early=True), Row("time", 42.0, "s", "of one core", early=True)
    rows = check._collected(iter([first, last, Row("other", 1.0)]))
    assert next(rows) is first and next(rows) is last and not said
    assert next(rows).quantity == "other"  # as soon as the computation is asked for
    assert said == ["matrices: 3.5e+06 B (at most)", "time: 42 s (of one core)"]
    list(check._collected([Row("time", 3.0, "s", early=True)]))
    assert len(said) == 2


def test_check_says_wavenumbers_and_memory() -> None:
    rows = {row.quantity: row for row in preflight(faulted())}
    assert rows["mesh.along_strike: wavenumbers"].value == 9
    assert rows["mesh.along_strike: matrices"].value == 9 * 4 * 9**2 * 8
    near = rows["mesh.along_strike: gap between images"]
    assert near.value == 3.0 and near.verdict == "warning"  # 4 m down dip


@pytest.mark.slow
def test_refuses_a_material_whose_strains_along_z_and_across_it_are_coupled(monkeypatch: pytest.MonkeyPatch) -> None:
    """An orthotropic one has the axis z; the same with a stiffness between yy and yz has not."""
    wood = OrthotropicElastic(E_1=12e9, E_2=1e9, nu_12=0.3, nu_23=0.3, G_12=0.8e9, density=600.0, angle=0.5)
    held = [Driven(edge="upper.top", component=axis, velocity=0.0) for axis in "xyz"]
    mesh = HalfPlate(length=1.0, height=1.0, element_size=0.5)
    Section(mesh, {"default": wood}, 1, held)
    stiffness = linear_stiffness(wood, "solid").copy()
    stiffness[1, 1, 1, 2] = stiffness[1, 2, 1, 1] = 0.1 * stiffness.max()
    monkeypatch.setattr(section, "linear_stiffness", lambda *_: stiffness)
    with pytest.raises(CaseError, match=facts(r"materials\.upper.*0\.1 of the largest")):
        Section(mesh, {"default": wood}, 1, held)


def test_refuses_a_mesh_that_is_no_section() -> None:
    case = faulted()
    along = {"along_strike": {"length": 5.0, "period": 8.0, "points": 16}}
    with pytest.raises(RuptfxError, match=r"along_strike.*'extruded'.*strike_slip_section"):
        section_of = {"kind": "two_plates", "length": 4.0, "height": 2.0, "element_size": 1.0}
        mesh = {"kind": "extruded", "thickness": 1.0, "section": section_of, **along}
        Model(Case.model_validate({**case.model_dump(exclude_none=True), "mesh": mesh}), fem.MPI.COMM_SELF)


def test_refuses_pressed_edges() -> None:
    pressed = {"kind": "traction", "edge": "upper.right", "traction": [-1e6, 0.0, 0.0]}
    pushed = faulted({"boundaries": [*faulted().model_dump(exclude_none=True)["boundaries"], pressed]})
    with pytest.raises(CaseError, match=facts(r"boundaries\.5\.kind = 'traction'.*initial_stress")):
        Model(pushed, fem.MPI.COMM_SELF)
