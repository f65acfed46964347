"""Single precision: how far results are from those in double precision, and on what they must not depend."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from helpers.crack_cases import faulted
from helpers.messages import facts
from helpers.small_cases import HOMALITE, branched, impact, march, merged, plates, strike_slip
from helpers.whole_runs import run_on, whole_and_resumed, write

from benchmarks.precision import energy_drift, impact_errors, slow_errors
from ruptfx.app.check_law.examples import table
from ruptfx.bodies import operators
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import CaseError, alternatives
from ruptfx.platform import fem
from ruptfx.platform.codegen.native import SINGLE, address
from ruptfx.results.record import Record
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem]
ROUNDING = float(np.finfo(np.float32).eps)  # 1.2e-7
LAYERED = {"default": {**HOMALITE, "young_modulus": {"kind": "along_axis", "axis": "y", "profile": {
    "kind": "table", "positions": [-9e-3, 9e-3], "values": [4e9, 6e9],
}}}}  # fmt: skip
PUSHED: dict[str, Any] = {"duration": 3e-6, "boundaries": [
    {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 2.0},
    {"kind": "absorbing", "edge": "upper.right"},
]}  # fmt: skip
MEMORY = {"default": {
    **HOMALITE, "kind": "standard_linear_solids", "Q_p": 25.0, "Q_s": 15.0, "lowest_frequency": 5e4,
    "frequency_ratio": 10.0,
}}  # fmt: skip
ORTHOTROPIC = {"default": table(alternatives("ruptfx.laws.materials")["orthotropic_elastic"])}
ORTHOTROPIC["default"]["kind"] = "orthotropic_elastic"
CASES: dict[str, dict[str, Any]] = {
    "quadrilaterals": plates(PUSHED),
    "order 1": plates({**PUSHED, "order": 1}),
    "order 7": plates({**PUSHED, "order": 7, "duration": 1e-6}),
    "mass damping": plates({**PUSHED, "damping": {"mass": 1e5}}),
    "layer": plates({**PUSHED, "damping": {"kelvin_voigt": {"fraction": 0.1}}}),
    "triangles": faulted({"fracture": None}),
    "layer of triangles": faulted({"fracture": None, "damping": {"kelvin_voigt": {"fraction": 0.1}}}),
    "oblique": branched({"duration": 3e-6}),
    "antiplane": plates({
        **PUSHED, "plane": "antiplane", "boundaries": [{**PUSHED["boundaries"][0], "component": "z"}],
    }),
    "axisymmetric": plates({
        **PUSHED, "plane": "axisymmetric", "boundaries": None, "initial_velocity": {"matrix": [1.0, 0.0]},
        "mesh": {"kind": "fibre_in_matrix", "radius": 4e-3, "outer_radius": 8e-3, "length": 4e-3, "element_size": 2e-3},
    }),
    "orthotropic": plates({**PUSHED, "materials": ORTHOTROPIC, "boundaries": PUSHED["boundaries"][:1]}),
    "varying": plates({**PUSHED, "materials": LAYERED}),
    "memory": plates({**PUSHED, "materials": MEMORY}),
    "solid": strike_slip(),
}  # fmt: skip
LONG = ("order 7", "varying", "axisymmetric", "antiplane")
"""Cases that take seconds."""


def case_of(tables: dict[str, Any], changes: dict[str, Any] | None = None) -> Case:
    """The case of a table with other values of dotted keys."""
    case = parse_case(merged(tables, changes or {}))
    assert isinstance(case, Case)
    return case


def both(tables: dict[str, Any]) -> tuple[Any, Any]:
    """States after the same steps in both precisions, with the energies of the last step."""
    result = []
    step: dict[str, float] = {}
    for name in ("double", "single"):
        model, motion, state = march(case_of(tables, {"precision": name, **step}))
        state.wants_energies, step = True, {"stepper.time_step": motion.dt}
        motion.step(state)
        assert state.velocity.dtype == model.real and state.displacement.dtype == np.float64
        result.append((state, motion.energies(state)))
    return result[0], result[1]


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in CASES])
def test_steps_are_those_in_double_precision(name: str) -> None:
    (double, expected), (single, energies) = both(CASES[name])
    for field in ("displacement", "velocity"):
        values, found = getattr(double, field), getattr(single, field)
        error = np.abs(found - values).max() / np.abs(values).max()
        assert 0 < error < 1e-5, field
    for key, value in expected.items():
        assert energies[key] == pytest.approx(value, abs=1e-5 * max(map(abs, expected.values()))), key
    lost = energies["boundary_work"] - sum(value for key, value in energies.items() if key != "boundary_work")
    if name != "memory":  # closes as in double precision
        assert abs(lost) < 1e-5 * max(map(abs, energies.values()))


@pytest.mark.parametrize("name", ["quadrilaterals", "order 1", "triangles", "solid"])
def test_a_long_way_costs_no_digits_of_the_stress(name: str) -> None:
    """Of displacements of 1 m with strains of 1e-6 floats alone would keep no digit."""
    model = Model(case_of(CASES[name]), fem.MPI.COMM_SELF)
    single = operators.create("matrix_free", replace(model.bulk, real=SINGLE))
    c, size = model.components, np.ptp(model.coordinates, axis=0).max()
    strained = 1e-6 * size * np.sin(3 / size * model.coordinates).ravel()
    forces = []
    for operator, away in ((model.operator, 0.0), (single, 1.0)):
        force = np.zeros(len(strained))
        operator.add_internal_force(strained + away, force)
        forces.append(force.reshape(-1, c))
    # The sum of both keeps 2e-16 of 1 m.
    assert np.abs(forces[1] - forces[0]).max() < (20 * ROUNDING + 1e-15 / (1e-6 * size / 40)) * np.abs(forces[0]).max()


def test_a_rupture_keeps_slip_arrivals_and_energy() -> None:
    slip, steps, closure = impact_errors(4e-3)
    assert 0 < slip < 1e-5
    assert 0 < steps < 0.01
    assert closure < 1e-6


def test_a_standing_wave_keeps_its_energy() -> None:
    assert energy_drift(10_000) < 2e-6


def test_steps_below_the_rounding_of_the_way_add_up() -> None:
    """A step adds 1e-10 of the way; floats would not move."""
    way, speed = slow_errors(1000)
    assert way < 1e-6 and speed < 1e-6


def test_a_resumed_run_is_bitwise_identical(tmp_path: Path) -> None:
    case = case_of(impact(6e6, 2.0), {"precision": "single", "output.checkpoint_steps": 40})
    paths = whole_and_resumed(case, tmp_path)
    whole, resumed = (Record(path).interface for path in paths)
    for name in ("slip", "slip_rate", "shear_traction", "normal_stress"):
        np.testing.assert_array_equal(whole[name].values, resumed[name].values)


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.skipif(fem.MPI.COMM_WORLD.size > 1, reason="starts MPI jobs itself")
def test_two_ranks_agree_to_rounding(tmp_path: Path) -> None:
    case = write(tmp_path, merged(impact(6e6, 2.0), {"precision": "single"}))
    one, two = (Record(run_on(ranks, case, tmp_path / str(ranks))).interface for ranks in (1, 2))
    assert np.abs(one.slip.values).max() > 1e-6
    for name in ("slip", "slip_rate"):
        assert np.abs(two[name].values - one[name].values).max() < 1e-4 * np.abs(one[name].values).max(), name


def test_other_operators_refuse_it() -> None:
    case = case_of(plates({"precision": "single", "operator": "ufl_form"}))
    with pytest.raises(CaseError, match=facts("precision = 'single': operator = 'ufl_form' computes; 'matrix_free'")):
        Model(case)


def test_c_functions_get_the_type_that_they_read() -> None:
    assert address(np.zeros(2, np.float32), SINGLE).value
    with pytest.raises(TypeError, match="float32"):
        address(np.zeros(2, np.float32))
