"""Periodic edges in implicit steps: tied nodes are one unknown of the equilibrium."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, HOMALITE, case, march, merged, plates

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model
from ruptfx.stepping.implicit.equilibrium import Equilibrium

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

COMM = fem.MPI.COMM_WORLD
SIDES = [{"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"} for body in ("upper", "lower")]
SHEAR_MODULUS = HOMALITE["young_modulus"] / (2 * (1 + HOMALITE["poisson_ratio"]))
SOFT = {**HOMALITE, "young_modulus": 2e9}
RIGID = {"kind": "augmented_lagrangian"}


def resting(component: str) -> dict[str, Any]:
    return {"kind": "driven", "edge": "lower.bottom", "component": component, "velocity": 0.0}


def driven(component: str, velocity: float) -> dict[str, Any]:
    return {"kind": "driven", "edge": "upper.top", "component": component, "velocity": velocity}


def sheared(changes: dict[str, Any]) -> dict[str, Any]:
    """Two layers between rigid plates, of which the upper one moves to the right."""
    return plates({
        "order": 2, "boundaries": [*SIDES, resting("x"), resting("y"), driven("x", 0.1), driven("y", 0.0)], **changes,
    })  # fmt: skip


@pytest.mark.parametrize("operator", ["assembled", "matrix_free"])
@pytest.mark.parametrize("condensed", [True, False], ids=["condensed", "whole"])
def test_a_sheared_layer_of_two_materials_against_the_exact_solution(operator: str, condensed: bool) -> None:
    """Shear stress U / (H/G+ + H/G- + 1/C_s): the displacement is linear in each layer and jumps by tau / C_s.

    Free edges instead leave 0.76 to 0.96 of the shear stress.
    """
    layers = parse_case(sheared({"operator": operator, "materials.upper": SOFT, "stepper": {"kind": "quasi_static"}}))
    model = Model(layers)
    equilibrium, state = Equilibrium(model, condensed=condensed), model.initial_state()
    equilibrium.solve(state, 1e-6).commit(state)
    moved, height, ratio = 0.1e-6, 4e-3, HOMALITE["young_modulus"] / SOFT["young_modulus"]
    tau = moved / ((1 + ratio) * height / SHEAR_MODULUS + 1 / COMPLIANT["C_s"])
    y, u = model.coordinates[:, 1], state.displacement.reshape(-1, 2)
    above = model.layout.body == model.bodies.names.index("upper")
    exact = np.where(above, moved - tau * ratio / SHEAR_MODULUS * (height - y), tau / SHEAR_MODULUS * (height + y))
    assert np.abs(u[:, 0] - exact).max() < 1e-10 * moved
    assert np.abs(u[:, 1]).max() < 1e-10 * moved
    np.testing.assert_allclose(state.faults["main"]["shear_traction"], tau, rtol=1e-10)


WEAKENS = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.4, "D_c": 5e-5}
AGES = {"kind": "rate_and_state_ageing", "a": 0.02, "b": 0.015, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-3,
        "theta_initial": 1e-3}  # fmt: skip


STEPPERS = [
    {"kind": "quasi_static"}, {"kind": "generalized_alpha", "time_step": 1e-6},
    {"kind": "hybrid", "fast_above": 0.05, "slow_below": 0.01, "calm_for": 2e-5,  # not from length and frequencies
     "slow": {"kind": "quasi_static", "smallest_step": 1e-8}, "fast": {"kind": "leapfrog", "time_step": 1e-7}},
]  # fmt: skip
PARTS = [*product([WEAKENS, AGES], [COMPLIANT, RIGID], STEPPERS), (AGES, COMPLIANT, {"kind": "quasi_dynamic"})]


# A law with a state takes longest where the contact is rigid.
@pytest.mark.parametrize("law, contact, stepper", [
    pytest.param(*part, marks=[pytest.mark.slow] * (part[:2] == (AGES, RIGID))) for part in PARTS
], ids=lambda part: part["kind"])  # fmt: skip
def test_a_layer_slips_as_a_column_of_one_element(
    law: dict[str, Any], contact: dict[str, Any], stepper: dict[str, Any]
) -> None:
    """Nothing depends on x: slip and traction of all points are those of a column one element wide."""
    slips, stresses = [], []
    for length in (12e-3, 2e-3):
        layer = parse_case(sheared({
            "mesh.length": length, "duration": 8e-5, "faults.main.friction": law, "faults.main.contact": contact,
            "faults.main.initial_stress": {"normal": 6e6, "shear": 3.55e6}, "stepper": stepper,
        }))  # fmt: skip
        model = Model(layer)
        motion, state = layer.stepper.bind(model), model.initial_state()
        slip, stress = [], []
        while state.time < layer.duration * (1 - 1e-9) and len(slip) < 400:
            motion.step(state)
            fields = state.faults["main"]
            slip.append(parallel.largest(COMM, fields["slip"].max(initial=-np.inf)))
            assert parallel.largest(COMM, np.abs(fields["slip"] - slip[-1]).max(initial=0.0)) < 1e-9 * 1e-6
            stress.append(parallel.largest(COMM, fields["shear_traction"].max(initial=-np.inf)))
        energy = motion.energies(state)
        left = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
        assert abs(left) < layer.stepper.closure * max(energy["boundary_work"], energy["frictional_dissipation"])
        slips.append(slip)
        stresses.append(stress)
    assert max(slips[0]) > 1e-6
    np.testing.assert_allclose(slips[0], slips[1], atol=1e-9 * max(slips[0]))
    np.testing.assert_allclose(stresses[0], stresses[1], rtol=1e-8)


def patch(center: float | None, changes: dict[str, Any]) -> dict[str, Any]:
    """More stress around a position than friction takes, or around the edge; it slips to a new equilibrium."""
    box = {"inside": 3.7e6, "outside": 2.8e6, "center": 8e-3, "half_width": 3e-3}
    if center is None:  # what is not within 5 mm of the middle is within 3 mm of the edge
        box = {"inside": 2.8e6, "outside": 3.7e6, "center": 8e-3, "half_width": 5e-3}
    return merged(plates({
        "order": 3, "mesh.length": 16e-3, "duration": 4e-6, "faults.main.contact": COMPLIANT,
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.5, "D_c": 5e-5},
        "faults.main.initial_stress": {"normal": 6e6, "shear": {"kind": "boxcar", **box}},
        "boundaries": [*SIDES, resting("x"), resting("y"), driven("x", 10.0), driven("y", 0.0)],
    }), changes)  # fmt: skip


@pytest.mark.parametrize("stepper", [
    {"kind": "quasi_static"}, {"kind": "generalized_alpha", "time_step": 2e-7, "scheme": "average_acceleration"},
    {"kind": "quasi_static", "petsc_options": {"snes_max_it": 30}},
], ids=["quasi_static", "generalized_alpha", "whole"])  # fmt: skip
def test_slip_does_not_know_where_the_edge_is(stepper: dict[str, Any]) -> None:
    """A patch in the middle and one across the edge slip alike, but for half a length; energy closes."""
    slips = []
    for center in (8e-3, None):
        model, motion, state = march(parse_case(patch(center, {"stepper": stepper})))
        face, fields = model.faults[0].interface, state.faults["main"]
        energy = motion.energies(state)
        given = energy["boundary_work"]
        size = max(abs(given), energy["frictional_dissipation"])
        assert abs(given - sum(value for name, value in energy.items() if name != "boundary_work")) < 1e-9 * size
        layout = model.layout
        u = state.displacement.reshape(model.nodes, -1)
        np.testing.assert_array_equal(u[layout.kept], u[layout.copies])
        rows = parallel.share_rows(COMM, np.column_stack([face.number, fields["slip"]])[face.owned])
        slips.append(rows[np.argsort(rows[:, 0]), 1])
    middle, edge = slips
    assert middle.max() > 1e-6 and middle.min() < 0.8 * middle.max()
    np.testing.assert_allclose(np.roll(edge, 12), middle, atol=1e-8 * middle.max())


def test_oblique_waves_against_the_exact_solution() -> None:
    """SH waves at +-45 degrees between free edges, in average acceleration: of second order."""
    speed, errors = np.sqrt(SHEAR_MODULUS / HOMALITE["density"]), []
    for steps in (40, 80):
        k = np.pi / 4e-3  # the plates are 4 mm high, 8 mm long
        omega = speed * np.sqrt(2) * k
        wave = case({
            "plane": "antiplane", "order": 5, "mesh.length": 8e-3, "boundaries": SIDES, "duration": 8e-6,
            "faults.main.contact": {"kind": "compliant", "C_n": 1e18, "C_s": 1e18},
            "stepper": {"kind": "generalized_alpha", "scheme": "average_acceleration", "time_step": 8e-6 / steps},
        })  # fmt: skip
        model = Model(wave)
        motion, state = wave.stepper.bind(model), model.initial_state()
        x, y = model.coordinates.T
        state.displacement[:] = 1e-6 * np.cos(k * y) * np.sin(k * x)
        state.velocity[:] = -1e-6 * omega * np.cos(k * y) * np.cos(k * x)
        for _ in range(steps):
            motion.step(state)
        exact = 1e-6 * np.cos(k * y) * np.sin(k * x - omega * state.time)
        errors.append(parallel.largest(COMM, np.abs(state.displacement - exact).max()))
    assert errors[1] < 2e-8 and 3.7 < errors[0] / errors[1] < 4.3


@pytest.mark.parametrize("stepper", [
    {"kind": "quasi_static"}, {"kind": "generalized_alpha", "time_step": 2e-7},
    {"kind": "quasi_static", "petsc_options": {"snes_max_it": 30}},
], ids=["quasi_static", "generalized_alpha", "whole"])  # fmt: skip
def test_the_same_on_any_number_of_ranks(stepper: dict[str, Any]) -> None:
    fields = []
    for comm in (COMM, fem.MPI.COMM_SELF):
        model = Model(parse_case(patch(None, {"stepper": stepper})), comm)
        motion, state = model.case.stepper.bind(model), model.initial_state()
        for _ in range(10):
            motion.step(state)
        fields.append(parallel.share_rows(model.comm, model.layout.collect(state.displacement)))
    np.testing.assert_allclose(fields[0], fields[1], atol=1e-9 * np.abs(fields[1]).max())
