"""Pore pressure and temperature across an interface against closed forms and a column of finite differences.

A point slides at a prescribed rate with the strength f (sigma - p), through the two parts of a step that all steppers
use: `FaultFields.plan` and `complete`.
"""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import erfc, erfcx

from ruptfx.interfaces.faults.across import Across
from ruptfx.interfaces.faults.fields import Contribution, FaultFields, Heating
from ruptfx.interfaces.pore_pressure.thermal_pressurisation import PressurisedLayer, ThermalPressurisation
from ruptfx.interfaces.temperature.conduction import Conduction, HeatedLayer

F, SIGMA, CAPACITY, LAMBDA = 0.6, 100e6, 2.7e6, 0.3e6


def layer(width: float, heat: float, water: float, duration: float) -> PressurisedLayer:
    table = ThermalPressurisation(
        heat_capacity=CAPACITY, thermal_diffusivity=heat, hydraulic_diffusivity=water,
        pressure_per_temperature=LAMBDA, width=width,
    )  # fmt: skip
    return PressurisedLayer(table, duration, 1)


def slide(contribution: Contribution, times: np.ndarray, speed: Any) -> dict[str, np.ndarray]:
    """Return the fields and the heat at some times [s] of a point that slides at `speed(time)` [m/s]."""
    fields = FaultFields([contribution], 1)
    face = SimpleNamespace(points=np.zeros((1, 2)))
    fault = SimpleNamespace(name="main", components=lambda state, name: state[name][:, None], interface=face)
    start = np.array([F * SIGMA])
    state = {"slip": np.zeros(1), "slip_rate": np.array([speed(0.0)]), "shear_traction": start,
             "normal_stress": np.array([SIGMA]), "frictional_heat": np.zeros(1)}  # fmt: skip
    state |= {name: values.copy() for name, values in fields.initial().items()}
    state |= {f"{name}_rate": np.zeros(1) for name in fields.initial()}
    run = SimpleNamespace(fluids={"main": fields.memory(start * speed(0.0))}, faults={"main": state}, fault_time=0.0)
    history = [{name: values[0] for name, values in state.items()}]
    for begin, end in pairwise(times):
        dt = end - begin
        fields.plan(fault, run, dt)  # type: ignore[arg-type]
        old = {name: values.copy() for name, values in state.items()}
        for name in fields.initial():
            state[name] += dt * state[f"{name}_rate"]
        state["slip"] += 0.5 * dt * (speed(begin) + speed(end))
        state["slip_rate"][:] = speed(end)
        state["shear_traction"][:] = F * (SIGMA - state.get("pore_pressure", np.zeros(1)))
        run.fault_time = end
        fields.complete(fault, run, old, state, dt, end)  # type: ignore[arg-type]
        history.append({name: values[0] for name, values in state.items()})
    return {name: np.array([each[name] for each in history]) for name in state}


@pytest.mark.parametrize("alpha", [1e-6, 1e-2])
def test_a_plane_under_a_constant_heat_flow_warms_with_the_root_of_time(alpha: float) -> None:
    times = np.concatenate([[0.0], np.geomspace(1e-5, 1.0, 200)])
    table = Conduction(heat_capacity=CAPACITY, thermal_diffusivity=alpha)
    rise = slide(HeatedLayer(table, 1.0, 1), times, lambda time: 1.0)["temperature"]
    expected = F * SIGMA / CAPACITY * np.sqrt(times / (np.pi * alpha))
    assert rise[1:] == pytest.approx(expected[1:], rel=1e-4)


def test_a_layer_without_diffusion_weakens_exponentially_with_slip() -> None:
    """Adiabatic and undrained (Lachenbruch 1980): the density of a Gaussian at its middle is that of a layer of h."""
    width = 10e-3
    h = np.sqrt(2 * np.pi) * width
    run = slide(layer(width, 1e-14, 3e-14, 1.0), np.linspace(0, 1.0, 1001), lambda time: 1.0)
    expected = F * SIGMA * np.exp(-F * LAMBDA * run["slip"] / (CAPACITY * h))
    assert expected[-1] < 0.1 * expected[0]
    assert run["shear_traction"] == pytest.approx(expected, rel=1e-3)


def test_slip_on_a_plane_weakens_as_in_rice_2006_over_five_decades() -> None:
    heat, water, speed = 1e-6, 4e-6, 1.0
    length = 4 / F**2 * (CAPACITY / LAMBDA) ** 2 * (np.sqrt(heat) + np.sqrt(water)) ** 2 / speed
    times = np.concatenate([[0.0], length * np.geomspace(1e-5, 10.0, 3000) / speed])
    run = slide(layer(0.0, heat, water, times[-1]), times, lambda time: speed)
    ratio = run["slip"] / length
    expected = F * SIGMA * erfcx(np.sqrt(ratio))  # exp(s) erfc(sqrt(s))
    assert expected[1] == pytest.approx(F * SIGMA * np.exp(1e-5) * erfc(np.sqrt(1e-5)))
    seen = ratio >= 1e-4
    assert np.ptp(np.log10(ratio[seen])) == pytest.approx(5, abs=0.01)
    assert run["shear_traction"][seen] == pytest.approx(expected[seen], rel=1e-3)


def test_steps_are_of_second_order_and_all_heat_is_the_work_of_friction() -> None:
    def speed(time: float) -> float:
        return float(np.sin(np.pi * time) ** 2)

    runs = [slide(layer(5e-3, 1e-6, 1e-4, 1.0), np.linspace(0, 1.0, n + 1), speed) for n in (320, 640, 1280, 2560)]
    ends = [run["pore_pressure"][-1] for run in runs]
    changes = np.diff(ends)
    assert changes[0] / changes[1] > 3.7 and changes[1] / changes[2] > 3.8
    run = runs[0]
    work = 0.5 * (run["shear_traction"][1:] + run["shear_traction"][:-1]) * np.diff(run["slip"])
    assert run["frictional_heat"][-1] == pytest.approx(work.sum(), rel=1e-12)


def test_a_layer_agrees_with_a_column_of_finite_differences() -> None:
    width, heat, water, n, dt = 2e-3, 1e-6, 5e-6, 400, 1e-3
    y = np.linspace(0, 20e-3, n + 1)
    spacing = y[1]
    source = np.exp(-0.5 * (y / width) ** 2) / (width * np.sqrt(2 * np.pi)) / CAPACITY
    operator = (np.diag(np.full(n + 1, -2.0)) + np.diag(np.ones(n), 1) + np.diag(np.ones(n), -1)) / spacing**2
    operator[0, 1] *= 2
    operator[-1] = 0
    one = np.eye(n + 1)
    steps = [(np.linalg.inv(one - 0.5 * dt * a * operator), one + 0.5 * dt * a * operator) for a in (heat, water)]
    temperature, pressure, power = np.zeros(n + 1), np.zeros(n + 1), 1e6
    contribution, memory = layer(width, heat, water, 1.0), layer(width, heat, water, 1.0).memory()
    for _ in range(1000):
        warmer = steps[0][0] @ (steps[0][1] @ temperature + dt * power * source)
        pressure = steps[1][0] @ (steps[1][1] @ pressure + LAMBDA * (warmer - temperature))
        temperature = warmer
        heating = Heating(np.array([power]), np.array([power * dt]), dt)
        values = contribution.values(memory, 0.0, heating)
        contribution.advance(memory, 0.0, heating)
    assert values["temperature"][0] == pytest.approx(temperature[0], rel=1e-3)
    assert values["pore_pressure"][0] == pytest.approx(pressure[0], rel=1e-3)


def test_equal_diffusivities_are_the_limit_of_different_ones() -> None:
    heating = Heating(np.array([1e6]), np.array([1e6]), 1.0)
    pressures = [
        layer(1e-3, 1e-6, water, 1.0).values(layer(1e-3, 1e-6, water, 1.0).memory(), 0.0, heating)["pore_pressure"][0]
        for water in (1e-6, 1.01e-6, 0.99e-6)
    ]
    assert pressures[0] == pytest.approx(0.5 * (pressures[1] + pressures[2]), rel=1e-4)


def test_a_step_in_parts_is_the_step_as_a_whole() -> None:
    across = Across(np.array([1e-6]), 0.0, 10.0)
    whole, halves, one = np.zeros((1, across.count)), np.zeros((1, across.count)), np.ones(1)
    across.advance(whole, 2e-3, 3 * one, 2000 * one)  # power 500 to 2500 W/m2
    for heat in (1.0, 2.0):
        across.advance(halves, 1e-3, heat * one, 1000 * one)
    assert halves == pytest.approx(whole, rel=1e-9)
