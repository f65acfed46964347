"""Attachments against exact solutions: a bar with masses on springs, and the energy that tears an edge off."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.small_cases import HOMALITE, case, march
from scipy.optimize import brentq

pytest.importorskip("dolfinx")

from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem
HEIGHT, LENGTH = 8e-3, 12e-3  # m, of both plates together


def row(mass: float, frequency: float) -> dict[str, Any]:
    return {"kind": "resonators", "name": "row", "edge": "upper.top", "mass": mass, "frequency": frequency}


def shear_bar(attachments: list[dict[str, Any]], changes: dict[str, Any] | None = None) -> Any:
    """Two plates in antiplane that are glued rigidly: a bar along y for motion in z."""
    return case({"plane": "antiplane", "faults.main.contact": {"kind": "split_node"}, "attachments": attachments,
                 **(changes or {})})  # fmt: skip


@pytest.mark.parametrize("slowness", [0.02, 0.3])
def test_resonators_on_a_bar(slowness: float) -> None:
    """In the mode of lowest frequency, cos(w y / c) in the bar and k / (k - m w2) times its end in the masses,

        tan(w H / c) = -(m / (rho c)) w w_r^2 / (w_r^2 - w^2),   w > w_r:

    for w H / c -> 0 that of a two-mass chain, w^2 = w_r^2 (1 + m / (rho H)). After one period all is as it was, and
    after a quarter the displacement passes zero.
    """
    density = HOMALITE["density"]
    modulus = HOMALITE["young_modulus"] / 2 / (1 + HOMALITE["poisson_ratio"])
    c_s, mass = float(np.sqrt(modulus / density)), 0.7 * density * HEIGHT
    own = slowness * c_s / HEIGHT
    chain = own * np.sqrt(1 + mass / (density * HEIGHT))

    def missing(w: float) -> float:
        return (own**2 - w**2) * np.tan(w * HEIGHT / c_s) + mass / (density * c_s) * w * own**2

    w = brentq(missing, 1.0000001 * own, min(1.5 * chain, 0.499 * np.pi * c_s / HEIGHT))
    if slowness < 0.1:
        assert w == pytest.approx(chain, rel=1e-3)
    period = 2 * np.pi / w
    model = Model(shear_bar([row(mass, own / (2 * np.pi))]))
    motion, state = model.case.stepper.bind(model), model.initial_state()
    y = model.coordinates[:, 1] + HEIGHT / 2
    mode = np.cos(w * y / c_s)
    state.displacement[:] = mode
    state.attached["row"]["displacement"][:] = mode[model.attachments[0].at, None] / (1 - (w / own) ** 2)
    steps = int(np.ceil(1.05 * period / motion.dt))
    course, times = [], []
    for _ in range(steps):
        motion.step(state)
        course.append(float(mode @ (model.mass * state.displacement)) / float(mode @ (model.mass * mode)))
        times.append(state.time)
    np.testing.assert_allclose(course, np.cos(w * np.array(times)), atol=2e-4)
    away = state.displacement - mode * np.cos(w * state.time)
    assert np.abs(away).max() < 1e-3


def test_records_of_masses_have_their_times(tmp_path: Path) -> None:
    """With a record in every step their velocity is the central difference of their displacement, as in leapfrog."""
    push = {"kind": "driven", "edge": "lower.bottom", "component": "z", "velocity": 1.0, "ramp": 2e-6}
    given = shear_bar([row(2.0, 2e5)], {"boundaries": [push], "duration": 8e-6})
    step = given.stepper.bind(Model(given)).dt
    given = given.changed("output.interface_interval", step)
    with simulate(given, tmp_path / "run", progress=False) as record:
        found, step = record.attachments["row"], record.summary["time_step"]
        times = found.time.values
        np.testing.assert_array_equal(times, record.interfaces["main"].time.values)
        np.testing.assert_allclose(np.diff(times), step, rtol=1e-9)
        name = next(str(each) for each in found.data_vars if str(each).startswith("displacement"))
        moved, speed = found[name].values, found[name.replace("displacement", "velocity")].values
        central = (moved[2:] - moved[:-2]) / (2 * step)
        assert np.abs(speed).max() > 0.1
        np.testing.assert_allclose(speed[1:-1], central, rtol=0, atol=1e-9)


LAWS = [
    {"kind": "linear", "f_t": 2e5, "c": 3e5, "G_Ic": 0.06, "G_IIc": 0.2},
    {"kind": "exponential", "f_t": 2e5, "c": 3e5, "G_Ic": 0.06, "G_IIc": 0.2},
]


@pytest.mark.parametrize("law", LAWS, ids=[law["kind"] for law in LAWS])
@pytest.mark.parametrize("component, energy", [("y", "G_Ic"), ("x", "G_IIc")])
def test_tearing_off_takes_the_fracture_energy(law: dict[str, Any], component: str, energy: str) -> None:
    """Fracture takes G times the area, whatever the law and the springs; the torn ground stores nothing."""
    motion = [{"kind": "driven", "edge": f"{side}", "component": axis, "velocity": 0.4 * (axis == component),
               "ramp": 2e-6} for side in ("upper.top", "lower.bottom") for axis in "xy"]  # fmt: skip
    ground = {"kind": "foundation", "name": "ground", "edge": "lower.bottom", "normal": 3e12, "tangential": 2e12,
              "cohesion": law}  # fmt: skip
    _, stepped, state = march(case({
        "order": 2, "attachments": [ground], "boundaries": motion, "duration": 16e-6,
        "stepper": {"kind": "leapfrog", "time_step": 2e-8}, "faults.main.contact": {"kind": "split_node"},
    }))  # fmt: skip
    assert np.all(state.attached["ground"]["damage"] == 1)
    assert np.abs(state.attached["ground"]["traction"]).max() < 1.0
    found = stepped.energies(state)
    assert found["fracture"] == pytest.approx(law[energy] * LENGTH, rel=2e-4)  # of finite steps
    assert abs(found["impact_loss"]) < 1e-9 * found["fracture"]


def test_ground_stays_as_it_is_below_its_strength() -> None:
    """Pressed by p, springs of k give way by p / k, in equilibrium with the load; nothing fails."""
    ground = {"kind": "foundation", "name": "ground", "edge": "lower.bottom", "normal": 1e12, "tangential": 1e12,
              "cohesion": {"kind": "linear", "f_t": 1e3, "c": 1e9, "G_Ic": 0.06, "G_IIc": 1e6}}  # fmt: skip
    press = {"kind": "traction", "edge": "upper.top", "traction": [0.0, -1e5], "ramp": 20e-6}
    model, _, state = march(case({
        "order": 2, "attachments": [ground], "boundaries": [press], "duration": 150e-6, "damping": {"mass": 1e5},
        "faults.main.contact": {"kind": "split_node"}, "materials.default": {**HOMALITE, "poisson_ratio": 0.0},
    }))  # fmt: skip
    nodes = model.attachments[0].at
    np.testing.assert_allclose(state.displacement.reshape(-1, 2)[nodes, 1], -1e5 / 1e12, rtol=2e-2)
    assert not state.attached["ground"]["damage"].any() and state.energy["fracture"] == 0
