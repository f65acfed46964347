"""A block that slides to rest on a rigid base: the law of friction alone says when and where it stops."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

pytest.importorskip("dolfinx")

from ruptfx.case import Case, parse_case
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

G, HEIGHT, DENSITY, START = 10.0, 5e-3, 1000.0, 0.2  # m/s2, m, kg/m3, m/s
WEAKENING = {"kind": "velocity_weakening", "mu_s": 0.6, "mu_d": 0.4, "V_w": np.sqrt(0.1 / 0.2)}  # omega = 0.1 m2/s2


def coefficient(law: dict, speed: float) -> float:
    if law["kind"] == "coulomb":
        return law["mu_d"]
    return law["mu_d"] + (law["mu_s"] - law["mu_d"]) * np.exp(-speed / law["V_w"])


@pytest.mark.parametrize(
    ("law", "time", "way"),
    [({"kind": "coulomb", "mu_d": 0.6}, 33.333e-3, 3.3333e-3), (WEAKENING, 34.852e-3, 3.5349e-3)],
    ids=lambda value: value["kind"] if isinstance(value, dict) else "",
)
def test_when_and_where_it_stops(law: dict, time: float, way: float) -> None:
    """dv/dt = -g mu(v): t = int dv / (g mu), x = int v dv / (g mu), from 0 to 0.2 m/s.

    Kelvin-Voigt damping, which does nothing to a rigid motion, quiets the waves of the sudden friction, which without
    it make points stick before the block has stopped; its stop is seen to one step, 1e-5 s.
    """
    assert quad(lambda v: 1 / (G * coefficient(law, v)), 0, START)[0] == pytest.approx(time, rel=2e-5)
    assert quad(lambda v: v / (G * coefficient(law, v)), 0, START)[0] == pytest.approx(way, rel=2e-5)
    case = parse_case({
        "plane": "strain", "order": 1, "duration": 0.04,
        "mesh": {"kind": "block_on_rigid", "length": 20e-3, "height": HEIGHT, "element_size": 5e-3},
        "materials": {"default": {
            "kind": "isotropic_elastic", "young_modulus": 1e8, "poisson_ratio": 0.0, "density": DENSITY,
        }},
        "faults": {"main": {
            "contact": {"kind": "split_node"}, "friction": law, "initial_stress": {"normal": DENSITY * G * HEIGHT},
        }},
        "damping": {"kelvin_voigt": {"fraction": 0.1}}, "output": {"figures": False},
    })  # fmt: skip
    assert isinstance(case, Case)
    model = Model(case)
    motion, state = case.stepper.bind(model), model.initial_state()
    mass = model.mass.reshape(-1, 2)[:, 0]
    state.velocity.reshape(-1, 2)[:, 0] = START

    def mean(field: np.ndarray) -> float:
        return float(mass @ field.reshape(-1, 2)[:, 0] / mass.sum())

    while mean(state.velocity) > 0 and state.time < 0.04:
        motion.step(state)
    assert state.time == pytest.approx(time, rel=1e-3)
    assert mean(state.displacement) == pytest.approx(way, rel=1e-3)
    assert np.all(state.faults["main"]["normal_stress"] > 0)
