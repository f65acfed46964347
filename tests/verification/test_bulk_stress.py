"""Snapshots show the stress of the bodies: the tensor that was given, or the one that interface tractions stand for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import Given, case, tilted, two_boxes

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.bodies.operators.matrix_free import MatrixFree
from ruptfx.input.schema import CaseError
from ruptfx.readings.instruments.model_readings import ModelReadings
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.recording.bulk_fields import BulkFields
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem


def at_rest(changes: dict[str, Any], mesh: Any = None) -> tuple[dict[str, np.ndarray], BulkFields]:
    """All fields before anything happens, and what made them."""
    resting = case({"order": 2, **changes})
    model = Model(resting if mesh is None else resting.substituted({"mesh": mesh}))
    bulk = BulkFields(model)
    return bulk.gather(model.initial_state()), bulk


def check(fields: dict[str, np.ndarray], stress: list[float], fringe: float) -> None:
    if fields:  # on rank 0
        np.testing.assert_allclose(fields["stress"], np.tile(stress, (len(fields["stress"]), 1)), atol=1e-6, rtol=1e-9)
        np.testing.assert_allclose(fields["fringe"], fringe, rtol=1e-9)


def test_far_field_of_a_tilted_interface_is_the_tensor(tmp_path: Path) -> None:
    initial = {"tensor": [-5e6, -10e6, 0.0]}
    fields, bulk = at_rest({"mesh": tilted(tmp_path), "faults.main.initial_stress": initial})
    check(fields, [-5e6, -10e6, 0.0], 5e6)
    assert bulk.initial_stress.origin == "given"


def test_tractions_of_a_tilted_interface_and_nothing_along_it(tmp_path: Path) -> None:
    initial = {"normal": 6e6, "shear": 2e6}
    fields, bulk = at_rest({"mesh": tilted(tmp_path, angle=np.pi / 6), "faults.main.initial_stress": initial})
    # n = (-1/2, sqrt(3)/2), t = (sqrt(3)/2, 1/2): -6 n n' + 2 (n t' + t n') MPa with n n' = (1/4, 3/4, -sqrt(3)/4) and
    # n t' + t n' = (-sqrt(3)/2, sqrt(3)/2, 1/2); sigma_1 - sigma_2 = sqrt(6^2 + 4 2^2) in any frame.
    root = np.sqrt(3)
    check(fields, [1e6 * (-1.5 - root), 1e6 * (-4.5 + root), 1e6 * (1.5 * root + 1)], 1e6 * np.sqrt(52))
    assert bulk.initial_stress.origin.startswith("assumed") and "'main'" in bulk.initial_stress.origin


def test_antiplane_shear(tmp_path: Path) -> None:
    initial = {"normal": 6e6, "shear": 2e6}
    fields, _ = at_rest({"plane": "antiplane", "faults.main.initial_stress": initial})
    check(fields, [0.0, 2e6], 4e6)
    mesh = tilted(tmp_path, angle=np.pi / 6)
    fields, _ = at_rest({"plane": "antiplane", "mesh": mesh, "faults.main.initial_stress": initial})
    check(fields, [-1e6, np.sqrt(3) * 1e6], 4e6)


@pytest.mark.parametrize(
    ("initial", "stress", "fringe"),
    [
        ({"tensor": [-1e6, -2e6, -3e6, 4e6, 5e6, 6e6]}, [-1e6, -2e6, -3e6, 4e6, 5e6, 6e6], 1e6 * np.sqrt(65)),
        # n = +z, first tangent +x: zz and xz.
        ({"normal": 3e6, "shear": 2e6}, [0.0, 0.0, -3e6, 0.0, 0.0, 2e6], 0.0),
    ],
)
def test_three_dimensions(initial: dict[str, Any], stress: list[float], fringe: float) -> None:
    fields, _ = at_rest({"plane": "solid", "faults.main.initial_stress": initial}, two_boxes())
    check(fields, stress, fringe)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_strain_adds_to_the_initial_stress_with_its_sign(side: float) -> None:
    # u_x = gamma y, gamma = 1e-3: xy grows by G gamma, G = 5.3 / 2.7 GPa, with or against the initial 2 MPa.
    model = Model(case({"faults.main.initial_stress": {"normal": 6e6, "shear": side * 2e6}}))
    state, bulk = model.initial_state(), BulkFields(model)
    state.displacement.reshape(-1, 2)[:, 0] = 1e-3 * model.coordinates[:, 1]
    shear = side * 2e6 + 1e-3 * 5.3e9 / 2.7
    check(bulk.gather(state), [0.0, -6e6, shear], np.hypot(6e6, 2 * shear))


def test_interfaces_share_the_stress_of_the_bodies() -> None:
    fault = case().faults["main"].model_dump()
    with pytest.raises(CaseError, match=facts(r"faults\.b\.initial_stress\.tensor .* faults\.a has")):
        case({"faults": {
            "a": fault | {"initial_stress": {"tensor": [0.0, -6e6, 1e6]}},
            "b": fault | {"initial_stress": {"tensor": [0.0, -6e6, 2e6]}},
        }})  # fmt: skip


def test_the_file_says_what_is_assumed(tmp_path: Path) -> None:
    simulate(case({"order": 1, "duration": 1e-6}), tmp_path / "run")
    with Record(tmp_path / "run") as record:
        assert record.bulk.attrs["initial_stress"].startswith("assumed: the uniform stress that carries")
        assert record.bulk["stress"].attrs["long_name"] == "total stress, tension positive"


def test_uneven_pressure_is_that_of_the_interface_everywhere_across_it(tmp_path: Path) -> None:
    """Linear from 4 to 8 MPa along 12 mm, with 1 MPa of shear: in both bodies yy is minus the pressure at x."""
    taper = {"kind": "table", "positions": [0.0, 12e-3], "values": [4e6, 8e6]}
    resting = case({"order": 2, "faults.main.initial_stress": {"normal": taper, "shear": 1e6}})
    model = Model(resting)
    bulk = BulkFields(model)
    stress = bulk.gather(model.initial_state())["stress"]
    x = bulk.topology().points[:, 0]
    np.testing.assert_allclose(stress[:, 1], -(4e6 + 4e6 * x / 12e-3), rtol=1e-9)
    np.testing.assert_allclose(stress[:, [0, 2]], np.tile([0.0, 1e6], (len(stress), 1)), atol=1.0)
    assert "as it varies along it" in bulk.initial_stress.origin
    # A load cell on the top carries 6 MPa on 12 mm before anything moves, and 1 MPa of shear.
    found = ModelReadings(model, bulk.initial_stress.at).forces("upper.top", "edge")
    assert [offset for _, _, offset in found] == pytest.approx([12e3, -72e3], rel=1e-9)


UPPER = {
    "isotropic": {"kind": "isotropic_elastic", "young_modulus": 2e10, "poisson_ratio": 0.2, "density": 2000.0},
    "orthotropic": {"kind": "orthotropic_elastic", "E_1": 8e10, "E_2": 9e9, "nu_12": 0.25, "nu_23": 0.4, "G_12": 3.6e9,
                    "angle": 0.4, "density": 1500.0},
}  # fmt: skip


@pytest.mark.parametrize("upper, shear, plane", [
    pytest.param(upper, shear, plane, id=f"{name}-{shear}-{plane}",
                 marks=[pytest.mark.slow] * (name == "orthotropic" and plane == "solid"))
    for name, upper in UPPER.items() for shear in (0.0, 0.3) for plane in ("stress", "strain", "antiplane", "solid")
])  # fmt: skip
def test_stress_of_the_kernel_is_that_of_the_form(plane: str, shear: float, upper: dict[str, Any]) -> None:
    """On elements of unequal size, and of unequal materials: the same sums at the nodes."""
    table: dict[str, Any] = {
        "order": 3, "plane": plane, "mesh.growth": 1.2, "faults.main.initial_stress": {"normal": 6e6, "shear": 0.0},
        "operator": "matrix_free",
    }  # fmt: skip
    table["materials.upper"] = upper
    parsed = case(table)
    raw = two_boxes().build() if plane == "solid" else parsed.mesh.build()
    raw.points[:, 0] += shear * raw.points[:, 1]
    model = Model(parsed.substituted({"mesh": Given(raw)}))
    bulk = BulkFields(model)
    displacement = np.random.default_rng(3).standard_normal(model.nodes * model.components)
    fast, form = (np.zeros((model.nodes, {1: 2, 2: 3, 3: 6}[model.components])) for _ in range(2))
    assert isinstance(model.operator, MatrixFree) and model.operator.adds_stress
    model.operator.add_stress(displacement, fast)
    bulk.nodal._add_stress(displacement, form)
    np.testing.assert_allclose(fast, form, rtol=0, atol=1e-12 * np.abs(form).max())
