"""Implicit steps solved on the interfaces alone are those of the whole system, to 1e-9 of every field."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, case, memory_friction

pytest.importorskip("dolfinx")

from ruptfx.laws.materials.isotropic_elastic import IsotropicElastic
from ruptfx.platform import parallel
from ruptfx.run.model import Model
from ruptfx.stepping.implicit import compliance, condensed
from ruptfx.stepping.implicit.equilibrium import Equilibrium
from ruptfx.stepping.implicit.solution import Rates

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

RIGID = {"kind": "augmented_lagrangian"}
HELD = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
PULLED = [
    {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1.0},
    {"kind": "driven", "edge": "upper.right", "component": "y", "velocity": 0.5},  # lifted off there, pressed elsewhere
    {"kind": "traction", "edge": "upper.top", "traction": [1e5, -1e6], "ramp": 1e-5},
    {"kind": "absorbing", "edge": "lower.right"},
    {"kind": "spring", "edge": "upper.top", "normal": 1e9, "tangential": 1e9},
]  # fmt: skip


def pulled(contact: dict[str, Any], changes: dict[str, Any] | None = None) -> Model:
    """Two plates that slide, open and stick in different places."""
    return Model(case({
        "order": 2, "faults.main.contact": contact, "faults.main.friction": memory_friction("P1"),
        "faults.main.initial_stress": {"normal": 1e6, "shear": 2e4}, "boundaries": [*HELD, *PULLED],
        "damping": {"mass": 1e4, "kelvin_voigt": {"fraction": 0.3}}, "stepper": {"kind": "generalized_alpha"},
        **(changes or {}),
    }))  # fmt: skip


def march(model: Model, dts: list[float], inertia: bool, condense: bool) -> tuple[Any, Equilibrium]:
    """Steps of the average acceleration, or of no inertia."""
    equilibrium, state = Equilibrium(model, condensed=condense), model.initial_state()
    for dt in dts:
        predictor = state.displacement + dt * state.velocity
        rates = Rates(4 / dt**2, 2 / dt, predictor, -state.velocity) if inertia else None
        solution = equilibrium.solve(state, dt, rates)
        state.velocity[:] = (solution.displacement - state.displacement) / dt
        solution.commit(state)
    return state, equilibrium


def differences(ours: Any, theirs: Any, comm: Any) -> dict[str, float]:
    """Of displacement and every field, over its largest value on all ranks."""
    pairs = {"displacement": (ours.displacement, theirs.displacement)}
    pairs |= {name: (ours.faults["main"][name], theirs.faults["main"][name]) for name in ours.faults["main"]}
    found = {}
    for name, (a, b) in pairs.items():
        known = np.isfinite(b)
        np.testing.assert_array_equal(np.isfinite(a), known)
        largest = parallel.largest(comm, np.abs(b[known]).max(initial=0.0))
        found[name] = parallel.largest(comm, np.abs(a - b)[known].max(initial=0.0)) / (largest or 1.0)
    return found


@pytest.mark.parametrize("inertia", [False, True], ids=["quasi_static", "dynamic"])
@pytest.mark.parametrize("contact", [COMPLIANT, RIGID], ids=lambda contact: contact["kind"])
def test_same_answers_as_the_whole_system(contact: dict[str, Any], inertia: bool) -> None:
    """Stuck, sliding and open points, bodies that nothing but the interface holds down."""
    model = pulled(contact)
    dts = [1e-5, 1e-5, 5e-6, 1e-5]
    ours, used = march(model, dts, inertia, True)
    theirs, reference = march(model, dts, inertia, False)
    assert isinstance(used._solver, condensed.Condensed)
    assert not isinstance(reference._solver, condensed.Condensed)
    fields = ours.faults["main"]
    shares = [np.sum(model.faults[0].interface.owned * flag) for flag in (
        fields["normal_stress"] == 0, (fields["normal_stress"] > 0) & (fields["slip"] > 1e-9))]  # fmt: skip
    is_open, slides = parallel.total(model.comm, shares)
    assert is_open > 1 and slides > 1
    found = differences(ours, theirs, model.comm)
    assert max(found.values()) < 1e-9, found


def test_same_steps_as_the_whole_system() -> None:
    """Steps that adapt are of the same length, and the energies the same, through the onset of sliding."""
    sliding = case({
        "order": 2, "duration": 1e-4, "boundaries": [*HELD, PULLED[0]], "faults.main.friction": memory_friction("P1"),
        "stepper": {"kind": "quasi_static", "slip_tolerance": 1e-6},
    })  # fmt: skip
    model = Model(sliding)
    found = []
    for condense in (True, False):
        motion, state = sliding.stepper.bind(model), model.initial_state()
        motion.equilibrium = Equilibrium(model, condensed=condense)
        times = []
        for _ in range(12):
            motion.step(state)
            times.append(state.time)
        found.append((times, motion.energies(state)))
    (times, energies), (others, their_energies) = found
    assert times == others and parallel.largest(model.comm, state.faults["main"]["slip"].max(initial=0.0)) > 1e-7
    work = their_energies["boundary_work"]
    assert energies == pytest.approx(their_energies, rel=1e-9, abs=1e-9 * abs(work))


def test_bodies_that_go_on_as_before_take_one_back_substitution(monkeypatch: pytest.MonkeyPatch) -> None:
    """Edges that move on in steps of one length, nothing else that depends on time: only the interface is out of
    balance where the motion of the step before goes on."""
    moved = [*HELD, {"kind": "driven", "edge": "upper.top", "component": "x", "velocity": 1.0},
             {"kind": "driven", "edge": "upper.top", "component": "y", "velocity": -0.1}]  # fmt: skip
    model, solved = pulled(COMPLIANT, {"boundaries": moved, "damping": {}}), []
    solve = compliance.Factors.solve
    monkeypatch.setattr(compliance.Factors, "solve", lambda self, force: solved.append(1) or solve(self, force))
    equilibrium, state, taken = Equilibrium(model), model.initial_state(), []
    for dt in (1e-5, 1e-5, 1e-5, 5e-6, 5e-6):
        solved.clear()
        solution = equilibrium.solve(state, dt, guess=state.displacement + dt * state.velocity)
        state.velocity[:] = (solution.displacement - state.displacement) / dt
        solution.commit(state)
        taken.append(len(solved))
    assert parallel.largest(model.comm, state.faults["main"]["slip"].max(initial=0.0)) > 1e-9
    assert taken == [2, 1, 1, 1, 1]
    ours, theirs = Equilibrium(model), Equilibrium(model, condensed=False)
    guess = state.displacement + dt * state.velocity
    found, expected = (solver.solve(state, dt, guess=guess).displacement for solver in (ours, theirs))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_a_step_size_costs_one_factorisation_and_the_last_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    build = condensed.Compliance

    def counted(*given: Any) -> Any:
        made.append(given[3])
        return build(*given)

    monkeypatch.setattr(condensed, "Compliance", counted)
    dts = [1e-5, 5e-6, 1e-5, 2.5e-6, 1.25e-6, 5e-6, 6e-7, 1e-5]
    march(pulled(COMPLIANT), dts, True, True)
    # The fifth size drives out the one not used for the longest time, which is the first: it is made again.
    assert [round(2 / factors[1] / 1e-7, 3) for factors in made] == [100, 50, 25, 12.5, 6, 100]
    made.clear()
    march(pulled(COMPLIANT), dts, False, True)
    assert made == [(0.0, 0.0)]  # without inertia it does not depend on the size


def test_points_that_do_not_feel_each_other_share_a_right_hand_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short step on a long interface: fewer right-hand sides, the same matrix."""
    model = pulled(COMPLIANT, {"mesh.length": 48e-3, "order": 1, "damping": {}})
    dt = 3e-7
    sizes, matrices = [], []
    apart = compliance.apart
    for least in (lambda distance, least: apart(distance, least), lambda distance, _: apart(distance, np.inf)):
        monkeypatch.setattr(compliance, "apart", lambda *given, least=least: sizes.append(groups := least(*given))
                            or groups)  # fmt: skip
        _, equilibrium = march(model, [dt], True, True)
        (kept,) = equilibrium._solver._kept.values()
        matrices.append(kept.blocks)
    assert len(sizes[0]) < 0.7 * len(sizes[1])
    np.testing.assert_allclose(matrices[0], matrices[1], atol=1e-9 * np.abs(matrices[1]).max())


def test_short_steps_ask_a_strip_along_the_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is out of balance far away moves no interface in a step: one back substitution of the whole, and the same
    answers as of the whole system."""
    changes = {"mesh.length": 48e-3, "mesh.height": 24e-3, "order": 1, "damping": {}}
    dts = [2e-7, 2e-7, 1e-7]
    theirs, _ = march(pulled(COMPLIANT, changes), dts, True, False)
    solved: list[int] = []
    solve = compliance.Factors.solve
    monkeypatch.setattr(compliance.Factors, "solve", lambda self, force: solved.append(1) or solve(self, force))
    model = pulled(COMPLIANT, changes)
    ours, equilibrium = march(model, dts, True, True)
    assert all(kept._factors._strip for kept in equilibrium._solver._kept.values()) and len(solved) == len(dts)
    found = differences(ours, theirs, model.comm)
    assert max(found.values()) < 1e-9, found
    _, equilibrium = march(model, dts[:1], False, True)
    assert not next(iter(equilibrium._solver._kept.values()))._factors._strip


def test_large_interfaces_take_iterations(monkeypatch: pytest.MonkeyPatch) -> None:
    """The linear systems by GMRES, point by point and with the factors of an iteration before: as if factorised."""
    factorised, _ = march(pulled(COMPLIANT), [1e-5] * 3, False, True)
    for small, most in ((0, 30), (0, 1)):
        monkeypatch.setattr(condensed, "SMALL", small)
        monkeypatch.setattr(condensed, "MAX_KRYLOV", most)
        model = pulled(COMPLIANT)
        found = differences(march(model, [1e-5] * 3, False, True)[0], factorised, model.comm)
        assert max(found.values()) < 1e-9, found


class Hardening(IsotropicElastic):
    """Stiffer where it is strained."""

    factor: ClassVar[float] = 1e4

    def energy_density(self, strain: Any, plane: Any) -> Any:
        linear = super().energy_density(strain, plane)
        return linear + self.factor * linear**2 / self.young_modulus


def test_what_is_not_condensed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bodies that are not linear, interfaces with too many points, options of the case."""
    model = pulled(COMPLIANT)
    assert condensed.fits(model)
    assert not isinstance(Equilibrium(model, {"snes_max_it": 20})._solver, condensed.Condensed)
    monkeypatch.setattr(condensed, "MAX_UNKNOWNS", 10)
    assert not condensed.fits(model)
    monkeypatch.undo()
    model.bulk.materials[0] = Hardening.model_validate(
        {"young_modulus": 5.3e9, "poisson_ratio": 0.35, "density": 1246.0}
    )
    assert not condensed.fits(model)
