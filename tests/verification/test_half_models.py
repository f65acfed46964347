"""Mirror-symmetric halves against the whole, a rigid base, and the viscous layer."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.small_cases import COMPLIANT, HOMALITE, SPLIT, march, merged, plates, strike_slip

pytest.importorskip("dolfinx")

from ruptfx.bodies.state import State
from ruptfx.case import parse_case
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

WEAKENING = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 1e-6}
PATCH = {"kind": "boxcar", "inside": 4e6, "outside": 2.4e6, "center": 6e-3, "half_width": 1e-3}


def run(table: dict, duration: float = 5e-6) -> tuple[Model, State, float]:
    parsed = parse_case({**table, "duration": duration})
    model = Model(parsed)
    motion = parsed.stepper.bind(model)
    state = model.initial_state()
    for _ in range(round(duration / motion.dt)):
        motion.step(state)
    return model, state, motion.dt


def rupture(contact: dict, plane: str) -> dict:
    return plates({
        # The whole has modes of its own (opening), so that its largest stable step may be another.
        "stepper": {"kind": "leapfrog", "time_step": 8e-8},
        "plane": plane, "faults.main.contact": contact, "faults.main.friction": WEAKENING,
        "faults.main.initial_stress": {"normal": 6e6, "shear": PATCH},
        "boundaries": [{"kind": "absorbing", "edge": "upper.top"}, {"kind": "absorbing", "edge": "upper.left"}],
    })  # fmt: skip


def half(table: dict, symmetry: str) -> dict:
    return merged(table, {"mesh.kind": "half_plate", "mesh.symmetry": symmetry})


def with_lower_edges(table: dict) -> dict:
    images = {"upper.top": "lower.bottom", "upper.left": "lower.left"}
    return {**table, "boundaries": [
        *table["boundaries"], *({**edge, "edge": images[edge["edge"]]} for edge in table["boundaries"])
    ]}  # fmt: skip


@pytest.mark.parametrize("top", [0.0, 1e-3])
def test_half_of_a_box_with_a_fault_is_half_of_the_whole(top: float) -> None:
    """A vertical fault to the surface, and a buried one; beyond the rim, where the whole is welded, the plane rests."""
    changes = {"mesh.fault_top": top, "stepper.time_step": 6e-8, "faults.main.friction.D_c": 5e-7}
    table = strike_slip(changes)
    rest = [{"kind": "driven", "edge": "plus.plane", "component": each, "velocity": 0.0} for each in "xz"]
    edges = {
        body: [{"kind": "absorbing", "edge": f"{body}.{side}"} for side in ("left", "right", "bottom", "far")]
        for body in ("plus", "minus")
    }
    whole, there, _ = run({**table, "boundaries": edges["plus"] + edges["minus"]}, 4e-6)
    part, here, _ = run(merged({**table, "boundaries": edges["plus"] + rest}, {"mesh.half": True}), 4e-6)
    one, half = whole.faults[0].interface, part.faults[0].interface
    place = {tuple(np.round(point, 9)): number for number, point in enumerate(half.locations)}
    inside = np.array([place[tuple(np.round(point, 9))] for point in one.locations])
    np.testing.assert_allclose(half.area[inside], one.area, rtol=1e-12)
    assert there.faults["main"]["slip_1"].max() > 1e-6 and there.faults["main"]["slip_2"].max() > 1e-9
    for name, value in there.faults["main"].items():
        scale = 1e-11 * np.nanmax(np.abs(value), initial=0.0)
        np.testing.assert_allclose(here.faults["main"][name][inside], value, rtol=0, atol=scale, err_msg=name)
    assert len(half.plus) == len(one.plus)  # without the rim, which is welded
    for name, energy in whole.energies(there).items():
        np.testing.assert_allclose(part.energies(here)[name], energy, rtol=1e-10, atol=1e-20, err_msg=name)


@pytest.mark.parametrize("contact", [SPLIT, COMPLIANT], ids=lambda contact: contact["kind"])
@pytest.mark.parametrize("plane", ["stress", "antiplane"])
def test_antisymmetric_half_is_half_of_the_whole(contact: dict, plane: str) -> None:
    """Modes II and III: everything on the interface agrees to round-off, with half the nodes."""
    table = rupture(contact, plane)
    (whole, there, dt), (part, here, dt_half) = run(with_lower_edges(table)), run(half(table, "antisymmetric"))
    assert part.total_nodes == whole.total_nodes // 2 and dt == dt_half
    for name, value in there.faults["main"].items():
        np.testing.assert_allclose(here.faults["main"][name], value, rtol=0, atol=1e-11 * np.nanmax(np.abs(value)))
    assert np.abs(here.faults["main"]["slip"]).max() > 1e-6
    energy, same = part.energies(here), whole.energies(there)
    largest = max(map(abs, same.values()))
    assert all(abs(energy[name] - same[name]) < 1e-10 * largest for name in same)


@pytest.mark.parametrize("contact", [SPLIT, COMPLIANT], ids=lambda contact: contact["kind"])
def test_symmetric_half_opens_as_the_whole(contact: dict) -> None:
    """Tractions on both ends pull the plates apart: the gap is the same."""
    pull = [{"kind": "traction", "edge": "upper.top", "traction": [0.0, 9e6], "ramp": 1e-6}]
    push = [{"kind": "traction", "edge": "lower.bottom", "traction": [0.0, -9e6], "ramp": 1e-6}]
    table = plates({"faults.main.contact": contact})
    _, there, _ = run({**table, "boundaries": pull + push}, 8e-6)
    _, here, _ = run({**half(table, "symmetric"), "boundaries": pull}, 8e-6)
    opening = there.faults["main"]["opening"]
    assert opening.max() > 1e-6
    np.testing.assert_allclose(here.faults["main"]["opening"], opening, rtol=0, atol=1e-9 * opening.max())


def test_block_slides_on_a_rigid_base() -> None:
    """Plane S wave from the top of a block on a rigid frictional base: V = (2 tau_i + tau_0 - f sigma) / Z.

    The half space carries the incoming stress tau_i; stuck, a rigid base doubles it. Source: one-dimensional waves.
    """
    length, height = 4e-3, 20e-3
    c_s, density = 1255.0, HOMALITE["density"]
    modulus = density * c_s**2
    material = {**HOMALITE, "young_modulus": 2 * modulus * 1.35}
    z, tau_i, friction, sigma = density * c_s, 1e6, 0.2, 6e6
    table = plates({
        "plane": "antiplane", "materials.default": material,
        "mesh": {"kind": "block_on_rigid", "length": length, "height": height, "element_size": 1e-3},
        "faults.main.contact": SPLIT, "faults.main.friction": {"kind": "coulomb", "mu_d": friction},
        "boundaries": [{"kind": "driven", "edge": "upper.top", "component": "z", "velocity": tau_i / z}],
    })  # fmt: skip
    arrival, rates = height / c_s, []
    march(
        parse_case(table), 1.9 * arrival,
        lambda now: rates.append((now.time, now.faults["main"]["slip_rate"].copy())),
    )  # fmt: skip
    # On average over the ringing of single elements behind a sudden front.
    mean = np.mean([rate for time, rate in rates if time > 1.3 * arrival], axis=0)
    np.testing.assert_allclose(mean, (2 * tau_i - friction * sigma) / z, rtol=5e-3)


def test_viscous_layer_damps_noise_and_its_loss_is_accounted_for() -> None:
    bare = rupture(SPLIT, "stress")
    bare = merged(bare, {"stepper.time_step": None})
    viscous = merged(bare, {"damping": {"kelvin_voigt": {"fraction": 0.2}}})
    results = []
    for table in (bare, viscous, {**viscous, "operator": "ufl_form"}):
        model, state, dt = run(table)
        energy = model.energies(state)
        lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
        assert abs(lost) < 1e-10 * energy["frictional_dissipation"]
        results.append((model, state.faults["main"]["slip_rate"], energy, dt))
    # eta = 0.2 dt_c: the stable step is 0.2 (sqrt(1 + 25) - 1) = 0.8198 of the undamped one.
    assert results[1][3] / results[0][3] == pytest.approx(0.8198, abs=0.01)
    assert results[1][2]["damping"] > results[0][2]["damping"] > 0
    np.testing.assert_allclose(results[2][1], results[1][1], rtol=0, atol=1e-10 * np.abs(results[1][1]).max())
