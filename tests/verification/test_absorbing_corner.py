"""A rupture leaves through an absorbing edge that the interface crosses: no noise, and what dashpots cannot do."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.small_cases import SPLIT, merged, plates

pytest.importorskip("dolfinx")

from ruptfx.case import parse_case
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

WEAKENING = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.2, "D_c": 1e-6}


def run(left: float, length: float, duration: float) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, float]]:
    """Rupture from x = 0; x of the interface, its fields and the energies at the end."""
    edges = ("left", "right", "top")
    table = merged(plates(), {
        "positions": "x", "mesh": {
            "kind": "half_plate", "length": length, "height": 8e-3, "element_size": 1e-3, "left": left,
        },
        "faults.main.contact": SPLIT, "faults.main.friction": WEAKENING,
        "faults.main.initial_stress": {"normal": 6e6, "shear": 2.4e6},
        "faults.main.nucleation": {
            "kind": "overstress",
            "extra": {"kind": "boxcar", "inside": 1.8e6, "outside": 0.0, "center": 0.0, "half_width": 1e-3},
        },
        "damping": {"kelvin_voigt": {"fraction": 0.1}}, "stepper": {"kind": "leapfrog", "time_step": 2.5e-8},
        "boundaries": [{"kind": "absorbing", "edge": f"upper.{edge}"} for edge in edges],
    })  # fmt: skip
    model = Model(parse_case(table))
    motion = model.case.stepper.bind(model)
    state = model.initial_state()
    for _ in range(round(duration / motion.dt)):
        motion.step(state)
    energy = model.energies(state)
    return model.faults[0].interface.position, state.faults["main"], energy


def test_rupture_leaves_through_the_edge() -> None:
    # The front reaches 8 mm after some 8 us (c_R = 1156 m/s), then its waves have 8 us to come back.
    x, short, energy = run(-8e-3, 16e-3, 16e-6)
    far, long, _ = run(-16e-3, 32e-3, 16e-6)
    assert np.isfinite(short["rupture_time"]).all()
    # Up to one element from the edge the front does not know of it.
    inside = np.abs(x) <= 7e-3
    for name in ("rupture_time", "peak_slip_rate"):
        expected = np.interp(x[inside], far, long[name])
        np.testing.assert_allclose(short[name][inside], expected, rtol=0.01, atol=1e-7)
    # Dashpots carry waves, not the static stress of the crack beyond the edge: behind the front slip is too large, by
    # a quarter after a second crossing time, but smooth and without a second rupture.
    expected = np.interp(x[inside], far, long["slip"])
    assert np.all(short["slip"][inside] < 1.3 * expected) and np.all(short["slip"][inside] > 0.99 * expected)
    rate = short["slip_rate"][inside]
    assert np.all(rate > 0) and rate.max() < 1.6 * long["slip_rate"][np.abs(far) <= 7e-3].max()
    lost = energy["boundary_work"] - sum(value for name, value in energy.items() if name != "boundary_work")
    assert abs(lost) < 1e-10 * energy["frictional_dissipation"]


@pytest.mark.parametrize("kind", ["absorbing", "sponge"])
def test_budget_closes_where_an_oblique_interface_crosses_the_edge(kind: str) -> None:
    """Both components have the same dashpot at the crossing: slip causes no normal velocity there."""
    wide = {"width": 2e-3} if kind == "sponge" else {}
    sides = [f"{body}.{side}" for body in ("upper", "lower") for side in ("left", "right")]
    model = Model(parse_case(merged(plates(), {
        "plane": "strain",
        "mesh": {"kind": "inclined_plates", "side": 12e-3, "inclination": 0.5, "element_size": 1e-3},
        "faults.main.contact": SPLIT, "faults.main.friction": WEAKENING,
        "faults.main.initial_stress": {"normal": 6e6, "shear": 2.4e6},
        "faults.main.nucleation": {
            "kind": "overstress",
            "extra": {"kind": "boxcar", "inside": 1.8e6, "outside": 0.0, "center": 6e-3, "half_width": 1e-3},
        },
        "boundaries": [{"kind": kind, "edge": edge, **wide} for edge in sides],
    })))  # fmt: skip
    motion, state = model.case.stepper.bind(model), model.initial_state()
    while state.time < 12e-6:
        motion.step(state)
    assert np.isfinite(state.faults["main"]["rupture_time"]).all()
    energy = model.energies(state)
    work = energy.pop("boundary_work")
    assert energy["damping"] > 0.01 * work
    assert abs(sum(energy.values()) - work) < 1e-12 * work
    ends = model.faults[0].interface.nodes
    dashpot = model.loads.dashpot.reshape(-1, 2)
    np.testing.assert_array_equal(dashpot[ends, 0], dashpot[ends, 1])
    assert np.any(dashpot[:, 0] != dashpot[:, 1])
