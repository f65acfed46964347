"""Laws whose strength drives slip are refused: before the run, and where it shows only in a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from helpers.small_cases import COMPLIANT, SPLIT, march, plates

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.app.checks.preflight import preflight
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.projection import ProjectionError
from ruptfx.run.model import Model

pytestmark = pytest.mark.fem

LAW = """
import numpy as np
from ruptfx.laws.friction import FrictionLaw
from ruptfx.input.units import VaryingCoefficient

class Own(FrictionLaw):
    "A law."
    formula = "strength = f(V, sigma, slipped)"
    source = "a test"
    state_fields = {{"slipped": "m"}}
    mu_d: VaryingCoefficient

    def initial_state(self, normal_stress, shear_stress, slip_rate):
        return {{"slipped": np.zeros_like(normal_stress)}}

    def strength(self, slip_rate, normal_stress, state):
        slipped = state["slipped"]
        return {formula}

    def advance(self, state, slip_rate, normal_stress, dt):
        return {{"slipped": state["slipped"] + slip_rate * dt}}
"""


def with_law(folder: Path, formula: str, changes: dict[str, Any] | None = None) -> Any:
    (folder / "own.py").write_text(LAW.format(formula=formula))
    friction = {"plugins": ["own.py"], "faults.main.friction": {"kind": "own", "mu_d": 0.4}}
    return parse_case(plates({**friction, **(changes or {})}), folder)


@pytest.mark.parametrize(
    "formula, found",
    [
        ("-normal_stress", r"-6e\+06 Pa after 0 s at a slip rate of 0 m/s"),
        ("normal_stress * (self.mu_d - 0.1 * slip_rate)", r"-3\.6e\+06 Pa after 0 s at a slip rate of 10 m/s"),
        # Slip over 1 cm: 0.1 after 1 s at 1 mm/s, 100 after 1 s at 1 m/s: 6 MPa (0.4 - 100).
        ("normal_stress * (self.mu_d - slipped / 1e-2)", r"-5\.976e\+08 Pa after 1 s at a slip rate of 1 m/s"),
        ("normal_stress * self.mu_d * np.sqrt(0.5 - slip_rate)", r"nan Pa after 0 s at a slip rate of 1 m/s"),
    ],
)
def test_refused_before_the_first_step(tmp_path: Path, formula: str, found: str) -> None:
    case = with_law(tmp_path, formula)
    for refused in (lambda: Model(case), lambda: list(preflight(case))):
        with pytest.raises(CaseError, match=facts(rf"faults\.main\.friction: own has a strength of ({found})")):
            refused()


@pytest.mark.parametrize("formula", ["normal_stress * self.mu_d", "0 * normal_stress"])
def test_no_strength_is_not_refused(tmp_path: Path, formula: str) -> None:
    Model(with_law(tmp_path, formula))


@pytest.mark.parametrize("contact", [COMPLIANT, SPLIT], ids=["compliant", "split_node"])
@pytest.mark.parametrize(
    "formula",
    [
        "normal_stress * (1 - normal_stress / 7e6)",  # also at rest
        "normal_stress * np.where(slip_rate > 1e-9, 1 - normal_stress / 7e6, 0.1)",
    ],
    ids=["at rest", "at a slip rate"],
)
def test_a_run_ends_where_the_strength_becomes_negative(tmp_path: Path, formula: str, contact: dict[str, Any]) -> None:
    """6 MPa plus rho c_p v = 1246 x 2202 x 1 = 2.7 MPa of a pressing edge pass 7 MPa on the way.

    Slip begins beyond 6.3 MPa, where the second law is no stronger in motion than at rest.
    """
    press = [
        {"kind": "driven", "edge": edge, "component": component, "velocity": sign * speed, "ramp": 1e-6}
        for edge, sign in (("upper.top", 1), ("lower.bottom", -1)) for component, speed in (("x", 1.0), ("y", -1.0))
    ]  # fmt: skip
    changes = {"boundaries": press, "faults.main.contact": contact, "faults.main.initial_stress.shear": 0.5e6}
    case = with_law(tmp_path, formula, changes)
    told = r"own: its strength is negative \(-[\de.+]+ Pa\).*interface point \d+ .*time"
    with pytest.raises(ProjectionError, match=facts(told)):
        march(case)


CARRIED = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.012, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-6}


@pytest.mark.parametrize("shear, b, theta", [(30e6, 0.012, r"8\.56e\+197"), (5e6, 1e-6, "inf")])
def test_a_state_that_overflows_is_refused_with_stresses_and_remedies(shear: float, b: float, theta: str) -> None:
    """theta = D_c / V_0 exp((a ln(2 sinh(tau / (a sigma)) V_0 / V) - f_0) / b), with a ratio of 6 and V = 1 nm/s:
    exponent (6 + 0.01 ln 1000 - 0.6) / 0.012 = 455.756, theta = 8.56e197 s."""

    def model(changes: dict[str, Any]) -> Model:
        key = "faults.main"
        return Model(parse_case(plates({
            f"{key}.contact": SPLIT, f"{key}.friction": {**CARRIED, "b": b},
            f"{key}.initial_stress": {"normal": 5e6, "shear": shear}, **changes,
        })))  # fmt: skip

    ratio = rf"{shear:g} Pa / 5e\+06 Pa = {shear / 5e6:g} at position 0 m".replace("e+0", r"e\+0")
    with pytest.raises(CaseError, match=rf"initial_stress: shear / normal = {ratio} .*theta = {theta}"):
        model({})
    # The remedies of the message, one by one.
    for changes in (
        {"faults.main.initial_stress.shear": 1e5}, {"faults.main.initial_stress.normal": 1e9},
        {"faults.main.friction.theta_initial": 1.0},
    ):  # fmt: skip
        if b > 1e-3 or "friction" in next(iter(changes)):
            assert model(changes).faults[0].name == "main"
