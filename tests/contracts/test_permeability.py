"""Permeability that follows slip and the effective normal stress, and diffusion around an axis: closed forms."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers.messages import facts

pytest.importorskip("dolfinx")

from helpers.small_cases import case, slip_weakening
from helpers.strike_cases import faulted

from ruptfx import RuptfxError
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.interfaces.faults.fields import Heating
from ruptfx.platform import fem, parallel
from ruptfx.run.model import Model

pytestmark = [pytest.mark.fem, pytest.mark.mpi]

LAYER = {"kind": "diffusion", "permeability": 1e-13, "viscosity": 1e-3, "compressibility": 1e-8, "porosity": 0.1,
         "thickness": 1.0}  # fmt: skip
STORAGE, ALPHA = 1e-9, 0.1  # 1/Pa and, of the layer at the start, m2/s
PRESSED = {"faults.main.initial_stress": {"normal": 60e6, "shear": 1e6}, "faults.main.friction": {
    "kind": "coulomb", "mu_d": 0.6}}  # fmt: skip


def line(table: dict[str, Any], **changes: Any) -> Model:
    return Model(case({"order": 4, **PRESSED, "faults.main.pore_pressure": {**LAYER, **table}, **changes}))


def surface(table: dict[str, Any]) -> Model:
    mesh = {"kind": "extruded", "thickness": 8e-3, "layers": 2, "section": {
        "kind": "two_plates", "length": 12e-3, "height": 4e-3, "element_size": 2e-3}}  # fmt: skip
    return line(table, plane="solid", mesh=mesh, positions="x")


def section(table: dict[str, Any]) -> Model:
    return Model(faulted({
        "mesh.fault_depth": 8.0, "mesh.depth": 12.0, "mesh.element_size": 1.0,
        "mesh.along_strike": {"length": 15.0, "period": 20.0, "points": 80},
        "faults.main.pore_pressure": {**LAYER, **table},
    }), fem.MPI.COMM_SELF)  # fmt: skip


MODELS = {"line": line, "surface": surface, "section": section}


def places_of(model: Model) -> np.ndarray:
    """Positions along strike, on surfaces down dip, too, shape (n, axes)."""
    face = model.faults[0].interface
    return face.locations.reshape(len(face.plus), -1)


def extents(model: Model) -> list[tuple[float, float]]:
    """Smallest and largest position along every axis."""
    each = places_of(model).T
    return [(-parallel.largest(model.comm, float((-x).max(initial=-np.inf))),
             parallel.largest(model.comm, float(x.max(initial=-np.inf)))) for x in each]  # fmt: skip


def along_axes(model: Model) -> np.ndarray:
    """Positions from the first point over the size, shape (n, axes)."""
    lowest, highest = np.array(extents(model)).T
    return np.asarray((places_of(model) - lowest) / (highest - lowest))


def marched(model: Model, times: np.ndarray, slid: Any, start: np.ndarray) -> tuple[np.ndarray, float]:
    """Pressure after steps with a path of slip of the time, under a constant total stress, and the fluid at the end."""
    (made,) = model.faults[0].fields.contributions
    memory, none = made.memory(), np.zeros(len(start))
    memory["change"][:, 0] = start
    for begin, end in pairwise(times):
        made.plan(memory, begin, end - begin)
        before = memory["change"][:, 0].copy()
        after = made._step.end[model.faults[0].interface.number]
        path = (slid(end) - slid(begin)) + none
        made.advance(memory, begin, Heating(none, none, end - begin, slid=path, pressed=before - after))
    face, change = model.faults[0].interface, memory["change"][:, 0]
    return change, STORAGE * parallel.total(model.comm, float((face.owned * face.area) @ change))


@pytest.mark.parametrize("name", ["line", "surface"])
def test_a_permeability_that_follows_slip_with_second_order(name: str) -> None:
    """Uniform slip V t: the amplitude of cos(pi x / a) cos(pi z / b) decays with int k dt, and the mean is constant."""
    model = MODELS[name]({"slid_permeability": 1e-12, "slip_length": 1e-3})
    shape = np.prod(np.cos(np.pi * along_axes(model)), axis=1)
    face = model.faults[0].interface
    decay = sum((np.pi / np.ptp(each)) ** 2 for each in extents(model))
    end = 0.4 / (ALPHA * decay)

    def integral(time: float) -> float:
        """Of k / k_0 = 1 + 9 (1 - exp(-3 t / end)): slip of 3 mm in the time."""
        return 10 * time - 9 * end / 3 * (1 - np.exp(-3 * time / end))

    exact = float(np.exp(-ALPHA * decay * integral(end)))
    errors = []
    for steps in (40, 80):
        times = np.linspace(0.0, end, steps + 1)
        pressure, fluid = marched(model, times, lambda t: 3e-3 * t / end, 1e6 * (2 + shape))
        start = STORAGE * parallel.total(model.comm, float((face.owned * face.area) @ (1e6 * (2 + shape))))
        assert fluid == pytest.approx(start, rel=1e-12)
        wrong = float(np.abs(pressure / 1e6 - 2 - exact * shape).max(initial=0.0))
        errors.append(parallel.largest(model.comm, wrong) / exact)
    assert errors[1] < 1e-2 and np.log2(errors[0] / errors[1]) > 1.8


@pytest.mark.parametrize("name", MODELS)
def test_a_permeability_of_the_effective_stress_in_steady_flow(name: str) -> None:
    """k = k_0 exp(p / s): exp(p / s) is linear between two known pressures."""
    ends, scale = (-7.375, 7.375), 2e6
    first, last = ends if name == "section" else extents(MODELS[name]({}))[0]
    unit = (last - first) ** 2 / ALPHA
    history = {"kind": "sampled", "times": [0.0, 0.1 * unit, 100 * unit], "values": [0.0, 1.0, 1.0]}
    wells = [{"center": first, "pressure": 3e6, "history": history}, {"center": last, "pressure": 0.0}]
    model = MODELS[name]({"stress_scale": scale, "wells": wells})
    x = places_of(model)[:, 0]
    inside = (x >= first) & (x <= last)
    times = np.linspace(0.0, 4.0, 201) * unit
    pressure, _ = marched(model, times, lambda t: 0.0, 0 * x)
    exact = scale * np.log1p((np.exp(3e6 / scale) - 1) * (1 - (x - first) / (last - first)))
    assert np.abs(pressure - exact)[inside].max(initial=0.0) < 1e-3 * 3e6


def test_diffusion_around_an_axis_is_that_of_its_radius() -> None:
    """Along a cylinder as along a line: the amplitude of cos(pi x / a) decays with (pi / a)^2, whatever the radius."""
    model = Model(parse_case(slip_weakening({
        "plane": "axisymmetric", "order": 3, "mesh": {
            "kind": "fibre_in_matrix", "radius": 4e-3, "outer_radius": 8e-3, "length": 16e-3, "element_size": 2e-3},
        "faults.main.initial_stress.shear.center": 8e-3, "faults.main.pore_pressure": LAYER,
    })))  # fmt: skip
    shape, decay = np.cos(np.pi * along_axes(model)[:, 0]), ALPHA * (np.pi / np.ptp(extents(model)[0])) ** 2
    pressure, _ = marched(model, np.linspace(0.0, 1 / decay, 41), lambda t: 0.0, 1e6 * shape)
    np.testing.assert_allclose(pressure, 1e6 * np.exp(-1.0) * shape, atol=1e3)


@pytest.mark.parametrize("stepper", ["leapfrog", "quasi_dynamic"])
def test_the_permeability_follows_slip_and_stress_of_a_run_and_keeps_the_fluid(stepper: str) -> None:
    """ln k of the path of slip and of the change of the effective stress of a run, at every point."""
    rate = 1e-5 if stepper == "leapfrog" else 1e-7
    well = {"center": 6e-3, "rate": rate, "half_width": 2e-3}
    pushed = {"kind": "driven", "edge": "upper.left", "component": "x", "velocity": 1e-3}
    still = [{**pushed, "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]
    changes: dict[str, Any] = {
        "faults.main.initial_stress": {"normal": 6e6, "shear": 3.3e6}, "boundaries": [*still, pushed],
        "faults.main.contact": {"kind": "compliant", "C_n": 1e14, "C_s": 1e14},
        "faults.main.friction": {"kind": "rate_and_state_ageing", "a": 0.01, "b": 0.014, "D_c": 2e-7, "f_0": 0.6,
                                 "V_0": 1e-6},
        "stepper": {"kind": stepper}, "duration": 0.05 if stepper == "quasi_dynamic" else 1e-5, "order": 2,
    }  # fmt: skip
    if stepper == "leapfrog":
        changes |= {"faults.main.friction": {"kind": "coulomb", "mu_d": 0.4}}
    table = {"slid_permeability": 3e-12, "slip_length": 1e-8, "stress_scale": 1e5, "wells": [well]}
    model = line(table, **changes)
    motion, state = model.case.stepper.bind(model), model.initial_state()
    model = motion.model if stepper == "leapfrog" else model
    for _ in range(25):
        motion.step(state)
    fields, memory = state.faults["main"], state.fluids["main"]
    (made,), face = model.faults[0].fields.contributions, model.faults[0].interface
    slid, pressed = (memory[f"0.{name}"][:, 0] for name in ("slid", "pressed"))
    assert fields["slip"].max() > 1e-10 and fields["pore_pressure"].max() > 1.0
    np.testing.assert_allclose(slid, np.abs(fields["slip"]), rtol=1e-9)
    effective = fields["normal_stress"] - fields["pore_pressure"]
    np.testing.assert_allclose(pressed, effective - 6e6, rtol=1e-9, atol=1e-3)
    grown = np.log(1 + 29 * (1 - np.exp(-slid / 1e-8))) - pressed / 1e5
    np.testing.assert_allclose(made.permeability(slid, pressed), grown, rtol=1e-9, atol=1e-12)
    stored = STORAGE * parallel.total(model.comm, float((face.owned * face.area) @ memory["0.change"][:, 0]))
    assert stored == pytest.approx(rate * state.fault_time, rel=1e-12)


def test_explicit_steps_that_are_too_long_for_a_well_are_refused_with_a_step_that_works() -> None:
    """The error of a step is its difference from one of first order; with the printed step the run goes on."""
    well = {"center": 6e-3, "rate": 4e2}
    table = {"permeability": 1e-11, "wells": [well]}
    model = line(table, order=2, stepper={"kind": "leapfrog", "time_step": 1e-7})
    refused = r"1e-07 s .* (\S+) Pa at .* normal stress, (\S+) Pa, .* stepper.time_step = (\S+),"

    def march(case: Any) -> None:
        made = Model(case)
        motion, state = case.stepper.bind(made), made.initial_state()
        for _ in range(6):
            motion.step(state)

    with pytest.raises(RuptfxError, match=refused) as caught:
        march(model.case)
    error, most, shorter = map(float, re.search(refused, str(caught.value)).groups())
    assert error > most == pytest.approx(6e6) and shorter <= 5e-8
    march(model.case.changed("stepper.time_step", shorter))
    slower = {**table, "wells": [{**well, "rate": 1.0}]}
    march(line(slower, order=2, stepper={"kind": "leapfrog", "time_step": 1e-7}).case)


ONE_OF_TWO = {"slid_permeability": {"slid_permeability": 1e-12}, "slip_length": {"slip_length": 1e-3}}


@pytest.mark.parametrize("given", ONE_OF_TWO)
def test_one_key_of_two_is_refused_with_remedies_that_work(given: str) -> None:
    (other,) = ONE_OF_TWO.keys() - {given}
    with pytest.raises(CaseError, match=facts(rf"{given}: .* give {other}, too, or remove {given}")):
        line(ONE_OF_TWO[given])
    line(ONE_OF_TWO[given] | ONE_OF_TWO[other])
    line({})
    with pytest.raises(CaseError, match=facts(r"stress_scale = 0: .* greater than 0")):
        line({"stress_scale": 0.0})
