"""Dilatancy after Segall and Rice (1995): a velocity step, diffusion along the interface, and growth of slip."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

pytest.importorskip("dolfinx")

from helpers.messages import facts
from helpers.small_cases import case

from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fields import Heating
from ruptfx.interfaces.pore_pressure.dilatancy import Dilatancy, Drained
from ruptfx.platform import fem
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem]

D_C, V_0, PER_AGE = 1e-3, 1e-3, 1e-4 / (1e-8 * 0.1)  # m, m/s, Pa: epsilon / (beta phi)
POROUS = {"compressibility": 1e-8, "porosity": 0.1}


def march(made: Any, ages: np.ndarray, times: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Pressure after steps, from ln theta at their ends, times a shape along the interface."""
    memory, rate = made.memory(), 0.0 * shape
    for begin, end, change in zip(times[:-1], times[1:], np.diff(ages), strict=True):
        made.plan(memory, begin, end - begin)
        made.advance(memory, begin, Heating(rate, rate, end - begin, change * shape, rate))
        rate = change * shape / (end - begin)
    none = Heating(rate, rate, 0.0)
    return np.asarray(made.values(memory, times[-1], none)["pore_pressure"])


def age(time: float | np.ndarray) -> Any:
    """ln (theta / theta before) after a step from V_0 to 10 V_0 of the ageing law."""
    return np.log(0.1 + 0.9 * np.exp(-10 * V_0 * np.asarray(time) / D_C))


def after(drainage: float | None, end: float, steps: int) -> float:
    """Pressure [Pa] after equal steps."""
    times = np.linspace(0.0, end, steps + 1)
    made = Drained(Dilatancy(coefficient=1e-4, drainage_time=drainage, **POROUS), 1)
    return float(march(made, age(times), times, np.ones(1))[0])


def test_undrained_pressure_after_a_velocity_step() -> None:
    """kappa ln(1 / 10) in the end, in any steps."""
    assert after(None, 2.0, 7) == pytest.approx(PER_AGE * np.log(0.1), rel=1e-7)


@pytest.mark.parametrize(("drainage", "bound", "order"), [(0.05, 3e-4, 2.0), (1e-4, 2e-3, 1.0)])
def test_drained_pressure_after_a_velocity_step(drainage: float, bound: float, order: float) -> None:
    """p = kappa int exp(-(t - s) / t_d) d(ln theta), with second order in steps shorter than t_d."""

    def rate(s: float) -> float:
        return float(-9 * np.exp(-10 * s) / (0.1 + 0.9 * np.exp(-10 * s)) * np.exp(-(0.1 - s) / drainage))

    exact = PER_AGE * sum(quad(rate, *ends, epsabs=1e-12)[0] for ends in ((0, 0.1 - 5e-4), (0.1 - 5e-4, 0.1)))
    errors = [abs(after(drainage, 0.1, steps) - exact) for steps in (200, 400)]
    assert errors[1] < bound * abs(exact) and np.log2(errors[0] / errors[1]) > order - 0.1


def test_what_opens_diffuses_along_the_interface_with_second_order() -> None:
    """A source kappa cos(pi x / L) d(ln theta)/dt: its amplitude decays at (pi / L)^2 k / (eta beta phi)."""
    table = {
        "kind": "diffusion",
        "permeability": 1e-13,
        "viscosity": 1e-3,
        "thickness": 1.0,
        "dilatancy": 1e-4,
        **POROUS,
    }
    law = {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 1e-6, "f_0": 0.6, "V_0": 1e-6}
    model = Model(case({"order": 4, "faults.main.pore_pressure": table, "faults.main.friction": law,
                        "faults.main.initial_stress": {"normal": 6e6, "shear": 3.3e6}}), fem.MPI.COMM_SELF)  # fmt: skip
    face, (made,) = model.faults[0].interface, model.faults[0].fields.contributions
    length = float(np.ptp(face.position))
    shape, decay = np.cos(np.pi * (face.position - face.position.min()) / length), (np.pi / length) ** 2 * 0.1
    end = 1 / decay

    def amplitude(steps: int) -> float:
        times = np.linspace(0.0, end, steps + 1)
        pressure = march(made, np.sin(2 * times / end), times, shape)
        assert np.abs(pressure - pressure[np.argmax(shape)] * shape).max() < 1e-5 * PER_AGE
        return float(pressure[np.argmax(shape)])

    exact = PER_AGE * quad(lambda s: 2 / end * np.cos(2 * s / end) * np.exp(-(end - s) * decay), 0, end)[0]
    errors = [abs(amplitude(steps) - exact) for steps in (20, 40)]
    assert errors[1] < 1e-3 * abs(exact) and np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.25)


SIGMA, A, B, F_0, CREEP = 50e6, 0.008, 0.012, 0.6, 1e-9
MODULUS, DENSITY = 30e9, 2700.0
KAPPA = 0.4 * (B - A) * SIGMA / F_0  # undrained, the critical stiffness is 0.6 of the drained one


def strip(relative: float, pressure: Any) -> tuple[dict[str, Any], float]:
    """A uniform antiplane fault whose stiffness [Pa/m] is a multiple of (b - a) sigma / D_c; it creeps."""
    stiffness = relative * (B - A) * SIGMA / D_C
    height = MODULUS / (2 * stiffness)
    return {
        "plane": "antiplane", "order": 1, "duration": 4 * D_C / CREEP, "output": {"figures": False},
        "mesh": {"kind": "half_plate", "length": height, "height": height, "element_size": height},
        "materials": {"default": {"kind": "isotropic_elastic", "young_modulus": 2.5 * MODULUS, "poisson_ratio": 0.25,
                                  "density": DENSITY}},
        "boundaries": [{"kind": "driven", "edge": "upper.top", "component": "z", "velocity": CREEP / 2}],
        "faults": {"main": {
            "contact": {"kind": "compliant", "C_n": 1e16, "C_s": 1e16},
            "initial_stress": {"normal": SIGMA, "shear": (F_0 + 1e-5) * SIGMA},
            "friction": {"kind": "rate_and_state_ageing", "a": A, "b": B, "D_c": D_C, "f_0": F_0, "V_0": CREEP,
                         "V_initial": CREEP},
            "pore_pressure": pressure,
        }},
        "stepper": {"kind": "quasi_dynamic", "tolerance": 1e-7},
    }, stiffness  # fmt: skip


def linear(stiffness: float, drainage: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrix of small changes of (tau, psi = ln theta, p), and v = ln V of them as a row.

    tau = sigma (a v + b psi) - f p,   tau' = -k V_0 v,   psi' = -(V_0 / D_c) (psi + v),   p' = -p / t_d + kappa psi'
    """
    slip = np.array([1.0, -B * SIGMA, F_0]) / (A * SIGMA)
    ageing = -CREEP / D_C * (np.array([0.0, 1.0, 0.0]) + slip)
    drained = np.array([0.0, 0.0, -1.0 / drainage])
    return np.array([-stiffness * CREEP * slip, ageing, drained + KAPPA * ageing]), slip


@pytest.mark.parametrize(("relative", "drainage", "grows"), [
    (0.7, None, False), (0.5, None, True), (0.7, 1e-3, True), (1.1, 1e-3, False), (0.7, 0.3, True),
])  # fmt: skip
def test_slip_grows_below_the_critical_stiffness(relative: float, drainage: float | None, grows: bool) -> None:
    """Drained (b - a) sigma / D_c, undrained ((b - a) sigma - f kappa) / D_c; drainage times are over D_c / V_0."""
    seconds = None if drainage is None else drainage * D_C / CREEP
    fluid = {"kind": "dilatancy", "coefficient": KAPPA * 1e-9, "drainage_time": seconds, **POROUS}
    table, stiffness = strip(relative, {key: value for key, value in fluid.items() if value is not None})
    given = parse_case(table)
    model = Model(given, fem.MPI.COMM_SELF)
    motion, state = given.stepper.bind(model), model.initial_state()
    rows = []
    while state.time < given.duration:
        motion.step(state)
        rows.append((state.time, np.log(state.faults["main"]["slip_rate"][0] / CREEP)))
    times, rates = np.array(rows).T
    matrix, slip = linear(stiffness, 1e30 if seconds is None else seconds)
    begun = 1e-5 * SIGMA * np.array([1.0, 1 / (B * SIGMA), 0.0])
    expected = np.array([slip @ expm(matrix * time) @ begun for time in times])
    np.testing.assert_allclose(rates, expected, atol=0.02 * np.abs(expected).max())
    assert np.ptp(state.faults["main"]["slip_rate"]) < 1e-6 * CREEP
    assert (np.linalg.eigvals(matrix).real.max() > 1e-9 * CREEP / D_C) == grows


@pytest.mark.parametrize(("relative", "drainage"), [(0.6, 1e12), (1.0, 1e-12)])
def test_the_critical_stiffness_of_both_limits(relative: float, drainage: float) -> None:
    for factor, grows in ((0.999, True), (1.001, False)):
        matrix, _ = linear(factor * relative * (B - A) * SIGMA / D_C, drainage * D_C / CREEP)
        assert (np.linalg.eigvals(matrix).real.max() > 1e-9 * CREEP / D_C) == grows


LAYER = {"permeability": 1e-13, "viscosity": 1e-3, "thickness": 1.0, "dilatancy": KAPPA * 1e-9}


@pytest.mark.parametrize("fluid", [
    {"kind": "dilatancy", "coefficient": KAPPA * 1e-9}, {"kind": "diffusion", **LAYER},
])  # fmt: skip
def test_without_drainage_the_pressure_is_that_of_the_state(fluid: dict[str, Any]) -> None:
    """p = kappa ln(theta / theta at the start), in a uniform fault without flow through its rim."""
    given = parse_case(strip(0.7, {**fluid, **POROUS})[0])
    model = Model(given, fem.MPI.COMM_SELF)
    motion, state = given.stepper.bind(model), model.initial_state()
    fields = state.faults["main"]
    begun = fields["theta"].copy()
    while state.time < 0.1 * given.duration:
        motion.step(state)
    aged = np.log(fields["theta"] / begun)
    assert np.abs(aged).min() > 1e-6
    np.testing.assert_allclose(fields["pore_pressure"], KAPPA * aged, rtol=1e-6)


@pytest.mark.parametrize("table", [
    {"kind": "dilatancy", "coefficient": 1e-4, **POROUS},
    {"kind": "diffusion", "permeability": 1e-13, "viscosity": 1e-3, "thickness": 1.0, "dilatancy": 1e-4, **POROUS},
])  # fmt: skip
def test_a_law_without_an_age_has_no_dilatancy(table: dict[str, Any]) -> None:
    with pytest.raises(CaseError, match=facts(r"faults\.main\.pore_pressure\.0: .* theta .*remove")):
        Model(case({"faults.main.friction": {"kind": "coulomb", "mu_d": 0.4}, "faults.main.pore_pressure": table}))
