"""Faults beside facets that may break: slip of the fault, initial stress of facets, energy of cracks off the fault."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from crack_cases import BRITTLE, HERE, NEVER, RUBS, faulted
from small_cases import march

pytest.importorskip("dolfinx")

from messages import facts

from ruptfx.case import parse_case
from ruptfx.model import Model
from ruptfx.schema import CaseError

pytestmark = pytest.mark.fem


def run(changes: dict[str, Any]) -> tuple[Any, Any, dict[str, float], float]:
    """Model, state, energies, and the relative error of their balance."""
    model, motion, state = march(parse_case(faulted(changes), HERE))
    energy = motion.energies(state)
    work = energy.pop("boundary_work")
    return model, state, energy, (work - sum(energy.values())) / abs(work)


@pytest.mark.parametrize("contact", [{"kind": "split_node"}, {"kind": "compliant", "C_n": 2e14, "C_s": 1e14}])
def test_facets_that_never_break_change_no_slip(contact: dict[str, Any]) -> None:
    """Facets have the stiffness of the body with `compensate`; what is left is the error of the mesh.

    At equal vertices the slip is within 2 % of that of the continuous body (1.3 % found, and with springs four times as
    stiff the same), ruptures arrive within a twentieth of the duration. Without compensation the springs add a sixth of
    the compliance, and the slip is 8 % larger.
    """
    given = {"faults.main.contact": contact, "mesh.element_size": 0.5e-3}
    whole, reference, _, _ = run({**given, "fracture": None})
    slips, times = {}, {}
    for compensated in (True, False):
        model, state, energy, error = run({**given, "fracture.compensate": compensated})
        fields = state.faults["main"]
        assert abs(error) < 1e-12 and energy["fracture"] == 0
        # Two points at every vertex but the outermost ones, each a quarter of a facet away from it.
        position = model.faults[0].interface.position
        middle = 0.5 * (position[1:-1:2] + position[2:-1:2])
        np.testing.assert_allclose(middle, whole.faults[0].interface.position[1:-1])
        slips[compensated], times[compensated] = (
            0.5 * (fields[name].ravel()[1:-1:2] + fields[name].ravel()[2:-1:2]) for name in ("slip", "rupture_time")
        )
    slip, time = (reference.faults["main"][name].ravel()[1:-1] for name in ("slip", "rupture_time"))
    assert slip.max() > 3e-6
    assert np.linalg.norm(slips[True] - slip) < 0.02 * np.linalg.norm(slip)
    assert np.linalg.norm(slips[False] - slip) > 0.03 * np.linalg.norm(slip)
    assert np.abs(times[True] - time).max() < 0.05 * 4e-6


def test_a_rupture_breaks_facets_beside_the_fault() -> None:
    """What breaks is near the fault, takes energy, and slows the slip; the budget is closed."""
    whole = run({"mesh.element_size": 0.5e-3})
    model, state, energy, error = run({"mesh.element_size": 0.5e-3, "fracture.default.cohesion": BRITTLE})
    assert abs(error) < 1e-12
    cracks = model.cracks
    failed = (state.cracks["damage"] >= 1).all(axis=1)
    assert failed.sum() > 20
    broken = cracks.network.ends[cracks.order][failed].mean(axis=1)
    assert np.abs(broken[:, 1] - 10e-3).max() < 6e-3
    # Facets that have failed took G_Ic at least, in shear G_IIc, per length.
    length = 2 * cracks.half_length[failed].sum()
    assert energy["fracture"] > BRITTLE["G_Ic"] * length
    assert np.mean(state.faults["main"]["slip"]) < np.mean(whole[1].faults["main"]["slip"])


def test_facets_begin_with_the_stress_of_the_bodies() -> None:
    """Before anything moves they carry sigma n, and exert nothing; then springs carry the change."""
    stress = np.array([[-10e6, 5.5e6], [5.5e6, -10e6]])
    model = Model(parse_case(faulted(), HERE))
    cracks, state = model.cracks, model.initial_state()
    for moves in (False, True):
        if moves:
            state.displacement[:] = np.random.default_rng(0).normal(size=len(state.displacement)) * 1e-9
        state.force[:] = 0
        cracks(state, model.mass, 1e-8)
        rows = state.displacement.reshape(-1, 2)
        jump = rows[cracks.corners[:, 1]] - rows[cracks.corners[:, 0]]
        traction = (cracks.normal @ stress)[:, None] + cracks.stiffness[:, None, None] * jump
        np.testing.assert_allclose(cracks.tractions(state.cracks), traction, rtol=1e-12, atol=1e-5)
        force = np.zeros_like(state.force).reshape(-1, 2)
        change = (cracks.weight * cracks.stiffness)[:, None, None] * jump
        np.add.at(force, cracks.corners[:, 0], change)
        np.subtract.at(force, cracks.corners[:, 1], change)
        np.testing.assert_allclose(state.force, force.ravel(), rtol=1e-9, atol=1e-9 * np.abs(traction).max() * 1e-3)
        work = cracks.preload_work(state.displacement)
        stored = 0.5 * np.sum(change * jump)
        # sigma n [u] + k [u]^2 / 2 of all ends.
        assert cracks.stored(state.cracks, 0 * state.displacement) - work == pytest.approx(stored, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("changes, said", [
    ({"fracture.default.cohesion": {**BRITTLE, "c": 1e5}, "fracture.default.friction.mu_d": 0.2},
     "initial_stress.tensor: the facet at .* of shear, more than its strength"),
    ({"faults.main.initial_stress": {"normal": 5e6}}, "faults.main.initial_stress.normal: with .fracture. the facets"),
    ({"faults.main.sliding": {}}, "faults.main.sliding: with .fracture. interfaces join"),
    ({"fracture": {"kind": "extrinsic", "default": {"cohesion": NEVER, "friction": RUBS}}},
     "fracture.kind = 'extrinsic' .*use fracture.kind = 'intrinsic'"),
])  # fmt: skip
def test_what_facets_cannot_carry_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError, match=facts(said)):
        Model(parse_case(faulted(changes), HERE))
