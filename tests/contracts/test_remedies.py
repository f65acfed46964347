"""Remedies that messages print are tried by doing what they say: the case must then be accepted and make a step.

A row of the table is a refused case, a regular expression of the remedy in its message, and what the remedy asks for,
with the printed numbers as they are printed. Remedies of parts that do not work together are tried by `test_support`.
"""

from __future__ import annotations

import copy
import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import tomli_w
from helpers.crack_cases import HERE, RUBS, block
from helpers.sliding_cases import rough
from helpers.small_cases import COMPLIANT, HOMALITE, branched, plates, slip_weakening, strike_slip
from typer.testing import CliRunner, Result

from ruptfx import RuptfxError, Table, gradient, infer
from ruptfx.app.cli import app
from ruptfx.app.commands.infer import remedies_of
from ruptfx.case import Case, parse_case
from ruptfx.input.schema import set_key
from ruptfx.many_runs.study import read_study

pytest.importorskip("dolfinx")

from ruptfx.app.checks.preflight import preflight
from ruptfx.interfaces.mechanisms.checks.table import Row
from ruptfx.many_runs.adjoint.gradients import Objective
from ruptfx.run import stages
from ruptfx.run.cost import measured
from ruptfx.run.model import Model
from ruptfx.stepping.stopping import StopRules

pytestmark = pytest.mark.fem

VERDICTS = ["ok", "warning", "error"]
Changes = dict[str, Any]
"""Values by dotted key, list entries by number; None removes the key."""


class Remedy(NamedTuple):
    """A refused case and its remedies; each of `fixes` alone must make it acceptable."""

    table: Table
    says: str
    fixes: Callable[[re.Match[str]], list[Changes]]


def changed(table: Table, changes: Changes) -> Table:
    result = copy.deepcopy(table)
    for key, value in changes.items():
        if value is not None:
            set_key(result, key, value)
            continue
        *parents, last = key.split(".")
        node: Any = result
        for name in parents:
            node = node[int(name)] if isinstance(node, list) else node[name]
        del node[int(last) if isinstance(node, list) else last]
    return result


def step(table: Table) -> None:
    """Parse a case, make its model and instruments, and take one step; its objective, if there is one,
    is computed."""
    case = parse_case(table, HERE)
    if not isinstance(case, Case):
        return
    if case.objective:
        Objective(case, case.objective, record=False)
        return
    model = Model(case)
    motion = stages.bind(model)
    measured(model, motion.dt)
    StopRules(model, case.stop_when)
    motion.step(model.initial_state())


def flat(**changes: Any) -> Table:
    """Two plates of order 1; `__` in a key stands for a dot."""
    return plates({"order": 1, **{key.replace("__", "."): value for key, value in changes.items()}})


def solid(**changes: Any) -> Table:
    return strike_slip({key.replace("__", "."): value for key, value in changes.items()})


def number(found: re.Match[str], group: int = 1) -> float:
    return float(found[group])


RECEIVER = {"kind": "receiver", "name": "point", "interval": 1e-6, "point": [5.3e-3, 2.2e-3]}
FIXED = {"kind": "leapfrog", "time_step": 1.23456789e-7}
BODY = {"kind": "velocimeter", "name": "body", "interval": 1e-7, "point": [18e-3, 2e-3], "direction": [1.0, 0.0]}
TRACE = {"kind": "traces", "instrument": "body", "times": [1.1e-6, 2.2e-6], "data": {"velocity": [0.1, 0.1]},
         "units": {"velocity": "m/s"}, "sigma": 0.02}  # fmt: skip
SPECKLES = {"kind": "speckles", "name": "s", "frame_rate": 1e6, "exposure": 1e-7, "pixel": 1e-4}
ROW = {"kind": "resonators", "name": "row", "edge": "upper.top", "mass": 2.0, "frequency": 2e5}
FIXED_BASE = [{"kind": "driven", "edge": "lower.bottom", "component": axis, "velocity": 0.0} for axis in "xy"]

TIES = [{"kind": "periodic", "first": f"{body}.left", "second": f"{body}.right"} for body in ("lower", "upper")]

N = r"(-?[\d.]+(?:e[-+]?\d+)?)"

WATER = {"kind": "given", "pressure": 7.65432e6}
WELL = {"kind": "diffusion", "permeability": 1e-13, "viscosity": 1e-3, "compressibility": 1e-8, "porosity": 0.1,
        "thickness": 1.0, "wells": [{"center": 0.05, "rate": 1e-6}]}  # fmt: skip
PRESSURISED = {"kind": "thermal_pressurisation", "heat_capacity": 2.7e6, "thermal_diffusivity": 1e-6,
               "hydraulic_diffusivity": 1e-5, "pressure_per_temperature": 1e5, "width": 1e-3}  # fmt: skip

SATURATING = {"kind": "rate_and_state_saturating", "a": 0.01, "b": 0.0, "D_c": 1e-5, "f_0": 0.6, "V_0": 1e-6,
              "theta_c": 0.1}  # fmt: skip
ENDS = {"kind": "boxcar", "inside": 0.015, "outside": 0.0, "center": 16e-3, "half_width": 8e-3}

NUMBERS: dict[str, Remedy] = {
    "no evolution effect": Remedy(
        slip_weakening({"faults.main.friction": SATURATING}), rf"friction\.b = 0.* give {N}.* (theta_initial)",
        lambda m: [{"faults.main.friction.b": number(m), f"faults.main.friction.{m[2]}": 10.0}]),
    "no evolution effect at the ends": Remedy(
        slip_weakening({"faults.main.friction": {**SATURATING, "b": ENDS}}),
        rf"friction\.b = 0 at position .* give {N}.* (theta_initial)",
        lambda m: [{"faults.main.friction.b": {**ENDS, "outside": number(m)}, f"faults.main.friction.{m[2]}": 10.0}]),
    "no age carries the initial stress": Remedy(
        slip_weakening({"faults.main.friction": {**SATURATING, "b": 1e-6}}),
        r"with theta = inf only.* (faults\.main\.friction\.theta_initial)", lambda m: [{m[1]: 10.0}]),
    "pore pressure that opens": Remedy(
        flat(faults__main__pore_pressure=WATER),
        rf"pore_pressure: {N} Pa at the start is not below the normal stress of {N} Pa",
        lambda m: [{"faults.main.pore_pressure.pressure": 0.99 * number(m, 2)},
                   {"faults.main.initial_stress.normal": 1.01 * number(m)}]),
    "well off the fault": Remedy(
        flat(faults__main__pore_pressure=WELL), rf"wells\.0\.center = {N} m: .* from {N} to {N} m",
        lambda m: [{"faults.main.pore_pressure.wells.0.center": number(m, 2)},
                   {"faults.main.pore_pressure.wells.0.center": number(m, 3)}]),
    "negative width": Remedy(
        flat(faults__main__pore_pressure={**PRESSURISED, "width": -1e-3}), r"width = -0\.001.* (0)",
        lambda m: [{"faults.main.pore_pressure.width": number(m)}]),
    "stable step": Remedy(
        flat(stepper={"kind": "leapfrog", "time_step": 1e-3}), rf"the limit is {N} s.* leave it out",
        lambda m: [{"stepper.time_step": number(m)}, {"stepper.time_step": None}]),
    "stage below a step": Remedy(
        flat(stepper=FIXED, duration=1e-6, stages=[{"duration": 3e-8}, {"duration": 9.7e-7}]),
        rf"a time step of {N} s;.* the time_step of .* to {N} s or less",
        lambda m: [{"stages.0.duration": number(m), "duration": 9.7e-7 + number(m)},
                   {"stepper.time_step": number(m, 2)}]),
    "sum of stages": Remedy(
        flat(duration=3e-6, stages=[{"duration": 1.23456789e-6}, {"duration": 1.00000001e-6}]),
        rf"the stages last {N} s together; give that", lambda m: [{"duration": number(m)}]),
    "too many records": Remedy(
        flat(duration=1.23456e-6, output__interface_interval=1e-15), rf"give at least {N} s",
        lambda m: [{"output.interface_interval": number(m)}]),
    "instrument below a step": Remedy(
        flat(stepper=FIXED, instruments=[{**RECEIVER, "interval": 1.1e-7}]), rf"below the time step of {N} s",
        lambda m: [{"instruments.0.interval": number(m)}, {"stepper.time_step": 1.1e-7}]),
    "point outside of the bodies": Remedy(
        flat(instruments=[{**RECEIVER, "point": [1.0, 1.0]}]), rf"x from {N} to {N}, y from {N} to {N} m",
        lambda m: [{"instruments.0.point": [number(m), number(m, 3)]},
                   {"instruments.0.point": [number(m, 2), number(m, 4)]}]),
    "surface of the rock": Remedy(
        flat(plane="strain", mesh__height=1.23456789e-3, initial_stress={"kind": "depth", "density": 2670.0,
             "gravity": 9.8, "surface": 1e-4}, faults__main__initial_stress=None),
        rf"make it {N}", lambda m: [{"initial_stress.surface": number(m)}]),
    "height of a rough fault": Remedy(
        solid(mesh__height={"kind": "sinusoid", "mean": 0.0, "amplitude": 1.2345678e-3, "wavelength": 7e-3}),
        rf"make distance at least {N},", lambda m: [{"mesh.distance": number(m)}]),
    "elements along a fault": Remedy(
        solid(mesh__fault_width=0.777777777e-3, faults__main__initial_stress__shear=2e6),
            rf"make element_size at most {N} m",
        lambda m: [{"mesh.element_size": number(m)}]),
    "elements along a branch": Remedy(
        branched({"mesh.branch_length": 1.23456789e-3, "stepper": {"kind": "leapfrog"}}),
            rf"make element_size at most {N} m",
        lambda m: [{"mesh.element_size": number(m)}]),
    "shortest wave of a surface": Remedy(
        solid(mesh__height={"kind": "self_affine_surface", "rms": 1e-5, "hurst": 0.8, "length": 0.03, "longest": 0.02,
                            "shortest": 1e-6, "seed": 3}),
        rf"make it at least {N}", lambda m: [{"mesh.height.shortest": number(m)}]),
    "length of a rough line": Remedy(
        flat(faults__main__gap={"kind": "sum", "terms": [1e-6, {
            "kind": "self_affine", "rms": 1e-9, "hurst": 0.8, "length": 1.0, "longest": 0.5, "shortest": 1e-9,
            "seed": 3}]}),
        rf"at most {N} times shortest = {N} m",
        lambda m: [{"faults.main.gap.terms.1.length": number(m) * number(m, 2), "faults.main.gap.terms.1.longest": 1e-6,
                    "faults.main.initial_stress.normal": 0.0}]),
    "quality of P waves": Remedy(
        flat(plane="strain", materials__default={**HOMALITE, "kind": "standard_linear_solids", "Q_p": 500.0,
            "Q_s": 33.3,
             "lowest_frequency": 1e4, "frequency_ratio": 30.0}),
        rf"use at most {N}", lambda m: [{"materials.default.Q_p": number(m)}]),
    "springs of a foundation": Remedy(
        flat(attachments=[{"kind": "foundation", "name": "base", "edge": "lower.bottom", "normal": 1e10,
                           "tangential": 1e13, "cohesion": {"kind": "linear", "f_t": 1.3e5, "c": 2e5, "G_Ic": 0.05,
                                                            "G_IIc": 0.1}}]),
        rf"give at least {N} Pa/m, or a larger fracture energy",
        lambda m: [{"attachments.0.normal": number(m)}, {"attachments.0.cohesion.G_Ic": 50.0}]),
    "beta of Newmark": Remedy(
        flat(stepper={"kind": "generalized_alpha", "scheme": "newmark", "gamma": 0.777777777, "beta": 0.1}),
        rf"gamma / 2 = {N} or more", lambda m: [{"stepper.beta": number(m)}]),
    "speed of P waves": Remedy(
        flat(plane="strain", materials__default={"kind": "isotropic_elastic", "density": 1246.0, "c_p": 1000.0,
                                                 "c_s": 1234.567}),
        rf"more than sqrt\(4/3\) c_s = {N}", lambda m: [{"materials.default.c_p": number(m)}]),
    "speed of P waves that vary": Remedy(
        flat(plane="strain", materials__default={
            "kind": "isotropic_elastic", "density": 1246.0, "c_s": 1234.567, "c_p": {
                "kind": "along_axis", "axis": "x", "profile": {"kind": "constant", "value": 1000.0}}}),
        rf"more than sqrt\(4/3\) c_s = {N} m/s", lambda m: [{"materials.default.c_p.profile.value": number(m)}]),
    "table too short": Remedy(
        slip_weakening({"order": 1, "mesh.length": 0.0333333333, "faults.main.initial_stress.shear": {
            "kind": "table", "positions": [1e-3, 2e-3], "values": [1e6, 1e6]}}),
        rf"points from {N} to {N} m; .* extend = true",
        lambda m: [{"faults.main.initial_stress.shear.positions": [number(m), number(m, 2)]},
                   {"faults.main.initial_stress.shear.extend": True}]),
    "table of a surface too small": Remedy(
        solid(mesh__fault_width=7.7777777e-3, faults__main__initial_stress__shear={
            "kind": "surface_table", "strike": [-9e-3, 9e-3], "dip": [0.0, 1e-3], "values": [[1e6, 1e6]] * 2}),
        rf"from 0 to 0.001 m, .* from {N} to {N} m; add",
        lambda m: [{"faults.main.initial_stress.shear.dip": [number(m), number(m, 2)]}]),
    "position of a receiver": Remedy(
        flat(mesh__length=0.0123456789, instruments=[{"kind": "fault_receiver", "name": "f", "interval": 1e-6,
                                                      "position": 1.0}]),
        rf"on the interface, {N} to {N} m",
        lambda m: [{"instruments.0.position": number(m)}, {"instruments.0.position": number(m, 2)}]),
    "point of a receiver": Remedy(
        solid(mesh__height={"kind": "sinusoid", "mean": 0.0, "amplitude": 1e-4, "wavelength": 7e-3},
              instruments=[{"kind": "fault_receiver", "name": "f", "interval": 1e-6, "point": [1e-3, 4e-3, -3e-3]}]),
        rf"nearest node, \({N}, {N}, {N}\) m",
        lambda m: [{"instruments.0.point": [number(m), number(m, 2), number(m, 3)]}]),
    "point of a nucleation": Remedy(
        slip_weakening({"order": 1, "faults.main.nucleation": [{
            "kind": "friction_drop", "mu_d": 0.1, "half_width": 3e-3, "center": {"x": 7.123456789e-3, "y": 3e-3}}]}),
        rf"its nearest point is \({N}, {N}\) m",
        lambda m: [{"faults.main.nucleation.0.center": {"x": number(m), "y": number(m, 2)}}]),
    "width of a sponge": Remedy(
        flat(mesh__length=0.0123456789, boundaries=[{"kind": "sponge", "edge": "upper.right", "width": 0.5}]),
        rf"has {N} m of its bodies", lambda m: [{"boundaries.0.width": number(m)}]),
    "exposure of a camera": Remedy(
        flat(cameras=[{"kind": "speckles", "name": "s", "frame_rate": 1.2345678e6, "exposure": 1e-3, "pixel": 1e-4}]),
        rf"longer than the {N} s", lambda m: [{"cameras.0.exposure": number(m)}]),
    "patch beside a surface": Remedy(
        solid(faults__main__initial_stress__shear={
            "kind": "rectangle", "inside": 3.7e6, "outside": 2.8e6, "strike": [0.1, 0.2], "dip": [0.1, 0.2]}),
        rf"strike from {N} to {N} m and dip from {N} to {N} m",
        lambda m: [{"faults.main.initial_stress.shear.strike": [number(m), number(m, 2)],
                    "faults.main.initial_stress.shear.dip": [number(m, 3), number(m, 4)]}]),
    "strip beside a surface": Remedy(
        solid(faults__main__nucleation=[{"kind": "friction_drop", "mu_d": 0.1, "half_width": 1e-4, "center": 0.1}]),
        rf"the points are from {N} to {N} m",
        lambda m: [{"faults.main.nucleation.0.center": number(m)}, {"faults.main.nucleation.0.center": number(m,
            2)}]),
    "tip beyond the interface": Remedy(
        flat(stop_when={"tip_beyond": 1.0}), rf"faults\.main from {N} to {N} m",
        lambda m: [{"stop_when.tip_beyond": 0.5 * (number(m) + number(m, 2))}]),
    "grid of receivers": Remedy(
        flat(instruments=[{"kind": "receiver_grid", "name": "g", "interval": 1e-6, "corner": [1e-3, 1e-3],
                           "opposite": [9e-3, 3e-3], "spacing": 1e-6}]),
        rf"at most {N}; make it larger", lambda m: [{"instruments.0.spacing": 1e-3}]),
    "yield": Remedy(
        flat(plane="strain", materials__default={
            **HOMALITE, "kind": "von_mises", "yield_stress": 1e6, "relaxation_time": 1e-6, "initial_stress": [-6e6,
                -2.3456789e6, 0.0, 0.0, 0.0,
                                                                                     0.0]}),
        rf"q = {N} Pa above {N} Pa", lambda m: [{"materials.default.yield_stress": 1.001 * number(m)}]),
    "data before the run": Remedy(
        slip_weakening({"order": 1, "instruments": [BODY], "objective": [
            {**TRACE, "times": [-1.1111111111e-7, 0.0, 2.2e-6], "data": {"velocity": [0.1] * 3}}]}),
        rf"with begin = {N}", lambda m: [{"objective.0.begin": number(m)}]),
    "data after the run": Remedy(
        slip_weakening({"order": 1, "instruments": [BODY], "duration": 1.1111111111111e-6, "objective": [
            {**TRACE, "times": [2e-7, 1.1111111111111e-6, 2.2e-6], "data": {"velocity": [0.1] * 3}}]}),
        rf"with end = {N}", lambda m: [{"objective.0.end": number(m)}, {"duration": 2.2e-6}]),
    "interval of a degree": Remedy(
        slip_weakening({"order": 1, "objective": [{
            "kind": "mode_degree", "mode": "crack", "threshold": 0.1, "loaded_end": 1e-3, "far_end": 11e-3,
            "spacing": 1e-3, "interval": 1.0, "steepness": 1.0}]}),
        rf"a quarter of duration = {N} s", lambda m: [{"objective.0.interval": number(m) / 4}]),
    "components of a tensor in 3D": Remedy(
        solid(faults__main__initial_stress={"tensor": [-6.123456789e6, -5e6, 2e6]}),
        rf"write \[{N}, {N}, ZZ, {N}, YZ, XZ\]",
        lambda m: [{"faults.main.initial_stress.tensor": [number(m), number(m, 2), -4e6, number(m, 3), 0.0, 0.0]}]),
    "components of a tensor in a plane": Remedy(
        flat(faults__main__initial_stress={"tensor": [-6.123456789e6, -5e6, 2e6, 1e6, 0.0, 0.0]}),
        rf"write \[{N}, {N}, {N}\]",
        lambda m: [{"faults.main.initial_stress.tensor": [number(m), number(m, 2), number(m, 3)]}]),
    "shear that the state cannot carry": Remedy(
        flat(faults__main__friction={"kind": "rate_and_state_ageing", "a": 0.001, "b": 0.0015, "D_c": 1e-5,
                                     "f_0": 0.6, "V_0": 1e-6}, faults__main__initial_stress={"normal": 6e6,
                                     "shear": 3e7}),
        rf"= {N} Pa / {N} Pa =",
        lambda m: [{"faults.main.initial_stress.shear": 0.55 * number(m, 2)},
                   {"faults.main.initial_stress.normal": number(m) / 0.55},
                   {"faults.main.friction.theta_initial": 1.0}]),
    "unit of another kind": Remedy(
        flat(duration="5 mm"), r"write for example '(.*?)'", lambda m: [{"duration": m[1]}]),
    "unit of another key": Remedy(
        slip_weakening({"order": 1, "instruments": [BODY], "objective": [{**TRACE, "data": {"velocity": [0.1, 0.1]}}],
                        "unknowns": [{"key": "faults.main.friction.D_c", "shape": "number", "bounds": ["1 Pa",
                        "9 Pa"]}]}),
        r"a value in (\w+) is wanted", lambda m: [{"objective": [], "instruments": [],
            "unknowns.0.bounds": [f"1e-6 {m[1]}", f"9e-6 {m[1]}"]}]),
}  # fmt: skip


WORDS: dict[str, Remedy] = {
    "damping twice": Remedy(
        flat(damping__kelvin_voigt={"fraction": 0.2, "eta": 1e-8}), "remove one of them",
        lambda m: [{"damping.kelvin_voigt.eta": None}, {"damping.kelvin_voigt.fraction": None}]),
    "bodies and thickness": Remedy(
        flat(damping__kelvin_voigt={"eta": 1e-8, "bodies": ["upper"], "thickness": 3e-3}), "give one of them",
        lambda m: [{"damping.kelvin_voigt.bodies": None}, {"damping.kelvin_voigt.thickness": None}]),
    "component of another plane": Remedy(
        flat(boundaries=[{"kind": "driven", "edge": "upper.top", "component": "z", "velocity": 1.0}]),
        r"moves in (\w+) only", lambda m: [{"boundaries.0.component": axis} for axis in m[1]]),
    "width and stiffness": Remedy(
        flat(boundaries=[{"kind": "body_spring", "stiffness": 4e15, "width": 0.1}]), "give one of them",
        lambda m: [{"boundaries.0.width": None}]),
    "width in plane stress": Remedy(
        flat(boundaries=[{"kind": "body_spring", "width": 0.1}]), "use stiffness",
        lambda m: [{"boundaries.0": {"kind": "body_spring", "stiffness": 4e15}}]),
    "P wave in antiplane": Remedy(
        flat(plane="antiplane", boundaries=[{
            "kind": "incident_wave", "edge": "lower.bottom", "wave": "P", "direction": [0.0, 1.0], "velocity": 1.0,
            "history": {"kind": "ricker", "frequency": 3e5, "delay": 4e-6}}]),
        r"S waves only; use '(\w+)'", lambda m: [{"boundaries.0.wave": m[1]}]),
    "polarisation in a plane": Remedy(
        flat(boundaries=[{
            "kind": "incident_wave", "edge": "lower.bottom", "wave": "S", "direction": [0.0, 1.0], "velocity": 1.0,
            "polarisation": [1.0, 0.0, 0.0], "history": {"kind": "ricker", "frequency": 3e5, "delay": 4e-6}}]),
        "remove it", lambda m: [{"boundaries.0.polarisation": None}]),
    "range without a side": Remedy(
        flat(boundaries=[{"kind": "traction", "edge": "upper.top", "traction": [0.0, -1e6], "x_range": [1e-4,
            2e-4]}]),
        "make it longer", lambda m: [{"boundaries.0.x_range": [0.0, 4e-3]}]),
    "normal spring in antiplane": Remedy(
        flat(plane="antiplane", boundaries=[{"kind": "spring", "edge": "lower.bottom", "normal": 1e12}]),
        "use (tangential)", lambda m: [{"boundaries.0": {"kind": "spring", "edge": "lower.bottom", m[1]: 1e12}}]),
    "tensor beside the stress of the bodies": Remedy(
        flat(plane="strain", initial_stress={"kind": "uniform", "tensor": [-5e6, -6e6, 1e6]},
             faults__main__initial_stress={"tensor": [-5e6, -6e6, 1e6]}), "remove one of them",
        lambda m: [{"initial_stress": None}, {"faults.main.initial_stress": None}]),
    "no stress of an interface": Remedy(
        flat(plane="strain", faults__main__initial_stress=None), "give normal .* or tensor, or",
        lambda m: [{"faults.main.initial_stress": {"normal": 6e6}},
                   {"faults.main.initial_stress": {"tensor": [-5e6, -6e6, 1e6]}},
                   {"initial_stress": {"kind": "uniform", "tensor": [-5e6, -6e6, 1e6]}}]),
    "stress of the bodies in antiplane": Remedy(
        flat(plane="antiplane", initial_stress={"kind": "uniform", "tensor": [-5e6, -6e6, 1e6]},
             faults__main__initial_stress=None), "give normal and shear",
        lambda m: [{"initial_stress": None, "faults.main.initial_stress": {"normal": 6e6, "shear": 1e6}}]),
    "normal and tensor": Remedy(
        flat(faults__main__initial_stress={"normal": 6e6, "tensor": [-5e6, -6e6, 1e6]}), "give either",
        lambda m: [{"faults.main.initial_stress.tensor": None}, {"faults.main.initial_stress.normal": None}]),
    "shear without normal": Remedy(
        flat(faults__main__initial_stress={"shear": 1e6}), "give it, too",
        lambda m: [{"faults.main.initial_stress.normal": 6e6}]),
    "rake in a plane": Remedy(
        flat(faults__main__initial_stress={"normal": 6e6, "shear": 1e6, "rake": 30.0}), "leave it out",
        lambda m: [{"faults.main.initial_stress.rake": None}]),
    "rotations beside an interface": Remedy(
        flat(large_rotations=True), "leave one of them out", lambda m: [{"large_rotations": None}]),
    "collisions of what does not break": Remedy(
        block({"collisions": {"kind": "potential"}}), "add (.*)",
        lambda m: [{"large_rotations": True}]),
    "order of bodies that break": Remedy(
        block({"order": 2}), r"set order = (\d)", lambda m: [{"order": int(m[1])}]),
    "fracture out of a plane": Remedy(
        block({"plane": "antiplane", "boundaries": []}), r"use plane = '(\w+)' or '(\w+)'",
        lambda m: [{"plane": m[1]}, {"plane": m[2]}]),
    "materials that vary in bodies that break": Remedy(
        block({"materials.default.density": {"kind": "along_axis", "axis": "x", "profile": {
            "kind": "table", "positions": [-1.0, 1.0], "values": [2600.0, 2700.0]}}}),
        "give a number", lambda m: [{"materials.default.density": 2600.0}]),
    "attachments in implicit steps of sliding": Remedy(
        rough({"stepper": {"kind": "quasi_static"}, "attachments": [
            {"kind": "foundation", "name": "base", "edge": "lower.left", "normal": 2e13, "tangential": 1e13,
             "cohesion": {"kind": "linear", "f_t": 1e5, "c": 2e5, "G_Ic": 0.05, "G_IIc": 0.1}}]}),
        r"remove (attachments\.0)", lambda m: [{m[1]: None}]),
    "two instruments of one name": Remedy(
        flat(instruments=[dict(RECEIVER), dict(RECEIVER)]), "give each one of its own",
        lambda m: [{"instruments.1.name": "other"}]),
    "two cameras of one name": Remedy(
        flat(cameras=[dict(SPECKLES), dict(SPECKLES)]),
        "give each one of its own", lambda m: [{"cameras.1.name": "other"}]),
    "two attachments of one name": Remedy(
        flat(attachments=[dict(ROW), dict(ROW)]),
        "give each one of its own", lambda m: [{"attachments.1.name": "other"}]),
    "velocity with three components": Remedy(
        flat(initial_velocity={"upper": [1.0, 0.0, 0.0]}), r"moves in (\w), (\w); give (\d) components",
        lambda m: [{"initial_velocity.upper": [1.0] * int(m[3])}]),
    "velocity in steps from rest": Remedy(
        flat(initial_velocity={"upper": [1.0, 0.0]}, stepper={"kind": "generalized_alpha"}),
        r"use '(\w+)', or leave it out",
        lambda m: [{"stepper.kind": m[1]}, {"initial_velocity": None}]),
    "profile along an interface in a body": Remedy(
        flat(materials__default__density={"kind": "table", "positions": [-1.0, 1.0], "values": [1246.0, 1246.0]}),
        r"kind = '(\w+)', axis = '(\w)', profile",
        lambda m: [{"materials.default.density": {"kind": m[1], "axis": m[2], "profile": {
            "kind": "table", "positions": [-1.0, 1.0], "values": [1246.0, 1246.0]}}}]),
    "weights that are zero": Remedy(
        flat(faults__main__friction__mu_d={"kind": "random_classes", "values": [1e6, 2e6], "weights": [0.0, 0.0],
                                           "cell": 1e-3, "seed": 3}),
        "give at least one that is positive", lambda m: [{"faults.main.friction.mu_d.weights": [0.0, 1.0]}]),
    "constants twice": Remedy(
        flat(materials__default={**HOMALITE, "c_p": 2100.0, "c_s": 1200.0}),
        r"give either (\w+) and (\w+) or (\w+) and (\w+)",
        lambda m: [{f"materials.default.{m[1]}": None, f"materials.default.{m[2]}": None},
                   {f"materials.default.{m[3]}": None, f"materials.default.{m[4]}": None}]),
    "operator of rotating bodies": Remedy(
        block({"large_rotations": True, "operator": "assembled"}),
        r"operator = '(\w+)',? or '(\w+)'", lambda m: [{"operator": m[1]}, {"operator": m[2]}]),
    "option of PETSc": Remedy(
        flat(stepper={"kind": "generalized_alpha", "petsc_options": {"snes_no_such_thing": 3}}),
            "correct or remove it",
        lambda m: [{"stepper.petsc_options": {}}]),
    "options of steps at interfaces": Remedy(
        rough({"stepper": {"kind": "quasi_static", "petsc_options": {"snes_rtol": 1e-9}}}), "remove them",
        lambda m: [{"stepper.petsc_options": {}}]),
    "separate meshes without sliding": Remedy(
        rough({"faults.main.sliding": None}), r"add the table \[(\S+)\]", lambda m: [{m[1]: {}}]),
    "forces without sliding": Remedy(
        flat(output__forces_interval=1e-6), r"add the table \[faults\.NAME\.sliding\], or remove this key",
        lambda m: [{"output.forces_interval": None}, {"faults.main.sliding": {}, "boundaries": FIXED_BASE}]),
    "springs that soften a body": Remedy(
        block({"fracture.stiffness_ratio": 3.0}), r"increase it, or set (fracture\.compensate) = false",
        lambda m: [{"fracture.stiffness_ratio": 100.0}, {m[1]: False}]),
    "speckles in antiplane": Remedy(
        flat(plane="antiplane", cameras=[SPECKLES]), "remove it", lambda m: [{"cameras.0": None}]),
    "body of a point that is not given": Remedy(
        flat(instruments=[{**BODY, "interval": 1e-6, "point": [5e-3, 5e-4], "relative_body": "lower"}]),
            "is of the point (relative_to)",
        lambda m: [{f"instruments.0.{m[1]}": [5e-3, -5e-4]}]),
    "gauge in antiplane": Remedy(
        flat(plane="antiplane", instruments=[{"kind": "strain_gauge", "name": "g", "interval": 1e-6, "point": [5e-3,
            2e-3],
                                              "length": 1e-3, "angles": [0.0]}]),
        "use a (receiver)", lambda m: [{"instruments.0": {**RECEIVER, "kind": m[1]}}]),
    "place of a point on two bodies": Remedy(
        flat(instruments=[{**RECEIVER, "point": [6e-3, 0.0]}]), r"'(\w+)' and '(\w+)' meet there; say in which",
        lambda m: [{"instruments.0.body": m[1]}, {"instruments.0.body": m[2]}]),
    "edge that is not there": Remedy(
        flat(boundaries=[{"kind": "absorbing", "edge": "upper.topp"}]), r"did you mean '(.*?)'",
        lambda m: [{"boundaries.0.edge": m[1]}]),
    "key that is not there": Remedy(
        flat(faults__main__frictoin=RUBS), r"did you mean '(\w+)'",
        lambda m: [{"faults.main.frictoin": None, f"faults.main.{m[1]}": RUBS}]),
    "kind that is not there": Remedy(
        flat(faults__main__friction__kind="colomb"), r"did you mean '(\w+)'",
        lambda m: [{"faults.main.friction.kind": m[1]}]),
    "material that is not there": Remedy(
        flat(materials={"upper": HOMALITE}), r"add \[(\S+)\] or \[(\S+)\]",
        lambda m: [{m[1]: HOMALITE}, {m[2]: HOMALITE}]),
    "interface that is not there": Remedy(
        flat(faults={"mian": {"contact": COMPLIANT, "friction": RUBS, "initial_stress": {"normal": 6e6}}}),
        r"it has: (\w+)", lambda m: [{"faults": {m[1]: {"contact": COMPLIANT, "friction": RUBS,
                                                        "initial_stress": {"normal": 6e6}}}}]),
    "plane of a solid": Remedy(
        solid(plane="strain", faults__main__initial_stress__shear=1e6), r"use plane = '(\w+)' with three",
        lambda m: [{"plane": m[1]}]),
    "two boundaries of one edge": Remedy(
        flat(boundaries=[{"kind": "driven", "edge": "upper.top", "component": "x", "velocity": v} for v in (1.0,
            2.0)]),
        "remove one of them, or give each its x_range",
        lambda m: [{"boundaries.1": None}, {"boundaries.0": None},
                   {"boundaries.0.x_range": [0.0, 6e-3], "boundaries.1.x_range": [6e-3, 12e-3]}]),
    "load without effect": Remedy(
        flat(boundaries=[*FIXED_BASE, {"kind": "traction", "edge": "lower.bottom", "traction": [1e6, 0.0]}]),
        "leave that component out, or remove this entry or what drives",
        lambda m: [{"boundaries.2": None}, {"boundaries.0": None}]),
    "half of a dipping fault": Remedy(
        solid(mesh__half=True, mesh__dip=60.0), "leave out half, or make dip (90)",
        lambda m: [{"mesh.half": False}, {"mesh.dip": float(m[1])}]),
    "half of a rough fault": Remedy(
        solid(mesh__half=True, mesh__height={"kind": "sinusoid", "mean": 0.0, "amplitude": 1e-5, "wavelength": 7e-3}),
        "leave out half, or height", lambda m: [{"mesh.half": False}, {"mesh.height": 0.0}]),
    "moduli for other times": Remedy(
        flat(plane="strain", materials__default={**HOMALITE, "kind": "prony", "times": [1e-6, 1e-5],
                                                 "shear_moduli": [1e8], "bulk_moduli": [1e8, 1e8]}),
        "give one for each time", lambda m: [{"materials.default.shear_moduli": [1e8, 1e8]}]),
    "moduli above that of sudden loading": Remedy(
        flat(plane="strain", materials__default={**HOMALITE, "kind": "prony", "times": [1e-6], "shear_moduli": [1e12],
                                                 "bulk_moduli": [1e8]}),
        r"exceeds the shear modulus (\S+) Pa",
        lambda m: [{"materials.default.shear_moduli": [0.999 * number(m)]}]),
    "gamma of another scheme": Remedy(
        flat(stepper={"kind": "generalized_alpha", "scheme": "hht", "gamma": 0.6}), "remove them",
        lambda m: [{"stepper.gamma": None}]),
    "stepper with friction": Remedy(
        flat(stepper={"kind": "petsc_ts", "scheme": "basicsymplectic"}, damping={"mass": 1e3}),
            r"use '(\w+)' or '(\w+)'",
        lambda m: [{"stepper.scheme": m[1]}, {"stepper.scheme": m[2]}]),
    "well of two quantities": Remedy(
        flat(faults__main__pore_pressure={**WELL, "wells": [{"center": 0.0, "rate": 1e-6, "pressure": 1e5}]}),
        "rate, pressure: give one of them",
        lambda m: [{f"faults.main.pore_pressure.wells.0.{name}": None} for name in ("rate", "pressure")]),
    "dilatancy of a law without an age": Remedy(
        flat(faults__main__pore_pressure={
            "kind": "dilatancy", "coefficient": 1e-4, "compressibility": 1e-8, "porosity": 0.1}),
        r"use kind = '(\w+)'",
        lambda m: [{"faults.main.friction": {
            "kind": m[1], "a": 0.01, "b": 0.014, "D_c": 1e-5, "f_0": 0.6, "V_0": 1e-6}},
            {"faults.main.pore_pressure": None}]),
    "missing heat capacity": Remedy(
        flat(faults__main__pore_pressure={k: v for k, v in PRESSURISED.items() if k != "heat_capacity"}),
        r"pore_pressure.*heat_capacity",
        lambda m: [{"faults.main.pore_pressure.heat_capacity": 2.7e6}]),
    "file and history": Remedy(
        flat(faults__main__pore_pressure={"kind": "given", "file": "p.csv", "history": {
            "kind": "sampled", "times": [0.0, 1.0], "values": [0.0, 1.0]}}),
        r"remove it, or give (pressure) instead of file",
        lambda m: [{"faults.main.pore_pressure.file": None, f"faults.main.pore_pressure.{m[1]}": 1e5}]),
    "ties in one stage": Remedy(
        flat(boundaries=TIES, stages=[{"duration": 5e-6, "boundaries": []}]), "give the same in",
        lambda m: [{"stages.0.boundaries": TIES}]),
    "ties of one body beside an interface": Remedy(
        flat(boundaries=TIES[:1]), r"add kind = '(\w+)' in .* or remove (\S+)",
        lambda m: [{"boundaries": [*TIES[:1], {**TIES[1], "kind": m[1]}]}, {m[2]: None}]),
}  # fmt: skip


def refused(table: Table, says: str) -> re.Match[str]:
    with pytest.raises(RuptfxError) as caught:
        step(table)
    found = re.search(says, str(caught.value), re.DOTALL)
    assert found is not None, str(caught.value)
    return found


@pytest.mark.parametrize("name", NUMBERS)
def test_printed_numbers_are_accepted(name: str) -> None:
    table, says, fixes = NUMBERS[name]
    for changes in fixes(refused(table, says)):
        if name == "shortest wave of a surface":
            parse_case(changed(table, changes))  # where it is refused; a million waves take half a minute
        else:
            step(changed(table, changes))


@pytest.mark.parametrize("name", WORDS)
def test_remedies_are_accepted(name: str) -> None:
    table, says, fixes = WORDS[name]
    for changes in fixes(refused(table, says)):
        step(changed(table, changes))


CHECKS: dict[str, tuple[Table, str, str, Callable[[re.Match[str]], list[Changes]]]] = {
    "grid noise": (
        slip_weakening({"order": 1}), "faults.main: damping", r"(\S+) = \{ (\w+) = ([\d.]+) \} takes",
        lambda m: [{m[1]: {m[2]: number(m, 3)}}]),
    "records of a front": (
        slip_weakening({"faults.main.friction.D_c": 1e-6, "output.interface_interval": 5e-6}),
        "faults.main: interval of records",
        rf"in {N} s: .* reduce (\S+)$", lambda m: [{m[2]: number(m)}]),
    "a lost exponent": (
        flat(materials__default__young_modulus=5.3), "upper: young_modulus", r"less than 1000, .* exponent lost",
        lambda m: [{"materials.default.young_modulus": 5.3e9}]),
    "facets too long": (
        block({"fracture.default.cohesion.G_Ic": 1e-3, "fracture.default.cohesion.G_IIc": 1e-3}),
        "fracture rock-rock: process zone I", r"larger (\w+); .*: (\S+) = true",
        lambda m: [{f"fracture.default.cohesion.{m[1]}": 1e3}, {m[2]: True}]),
    "an edge that reflects": (
        flat(duration=4e-5), "upper.top: echo", "make the body larger, or the edge (absorbing)",
        lambda m: [{"mesh.height": 1.0}, {"boundaries": [{"kind": m[1], "edge": "upper.top"}]}]),
    "a step that jumps over the law": (
        slip_weakening({"order": 1, "faults.main.friction.D_c": 1e-9}), "faults.main: shortest time",
        r"reduce (\S+) or (\S+)$", lambda m: [{m[2]: 1e-12, "duration": 1e-11}]),
    "softening beyond the springs": (
        slip_weakening({"order": 1, "faults.main.contact": COMPLIANT}), "faults.main: softening / stiffness",
        "take a stiffer contact, (split_node), or a longer slip weakening",
        lambda m: [{"faults.main.contact": {"kind": m[1]}}, {"faults.main.contact.C_s": 1e13},
                   {"faults.main.friction.D_c": 5e-5}]),
    "a filter that passes more": (
        flat(instruments=[{**RECEIVER, "bandwidth": 1e7}]), "instruments.point: highest frequency",
        r"reduce the (interval)",
        lambda m: [{f"instruments.0.{m[1]}": 2e-8, "stepper": {"kind": "leapfrog", "time_step": 1e-8}}]),
}  # fmt: skip


@pytest.mark.parametrize("name", CHECKS)
def test_what_check_proposes_removes_its_warning(name: str) -> None:
    """A remark, an error that the case declares as meant, or a warning: it is gone or weaker with the remedy."""
    table, quantity, says, fixes = CHECKS[name]

    def row(given: Table) -> Row | None:
        case = parse_case(given, HERE)
        assert isinstance(case, Case)
        return next((row for row in preflight(case) if row.quantity == quantity), None)

    first = row(table)
    assert first is not None
    found = re.search(says, first.note)
    assert found is not None, first.note
    for changes in fixes(found):
        again = row(changed(table, changes))
        assert again is None or VERDICTS.index(again.verdict) < VERDICTS.index(first.verdict), again


@pytest.mark.parametrize("method, reason, ways", [
    ("l_bfgs", "iterations are used up", ["raise inference.iterations", "start", "inference.method = 'cma_es'"]),
    ("gauss_newton", "converged", ["start", "inference.method = 'cma_es'"]),
    ("cma_es", "iterations are used up", ["raise inference.iterations", "start"]),
])  # fmt: skip
def test_a_search_does_not_propose_its_own_method(method: str, reason: str, ways: list[str]) -> None:
    texts = remedies_of(method, reason).split(", or ")
    assert len(texts) == len(ways) and all(way in text for way, text in zip(ways, texts, strict=True))


# -- lumped models, studies and commands --------------------------------------------------------------------------

AGEING = {"a": 0.01, "b": 0.015, "D_c": 1e-5, "f_0": 0.6, "V_0": 1e-6}
LUMPED: dict[str, Remedy] = {
    "too few periods": Remedy(
        {"kind": "maxwell_slip", "mu_s": 0.6, "mu_d": 0.4321, "periods": 1.0}, rf"must be at least {N},",
        lambda m: [{"periods": number(m)}]),
    "exponents twice": Remedy(
        {"kind": "maxwell_slip", "alphas": [0.5, 0.5]}, rf"give {N} once", lambda m: [{"alphas": [number(m)]}]),
    "a push too high": Remedy(
        {"kind": "spring_block", "loading_height": 1.0, "length": 0.137777}, rf"keep it below {N} m",
        lambda m: [{"loading_height": number(m)}]),
    "samples below a step": Remedy(
        {"kind": "spring_block", "mass": 11.23456, "sample_interval": 1e-9}, rf"largest stable step, {N} s",
        lambda m: [{"sample_interval": number(m)}]),
    "profile of a single block": Remedy(
        {"kind": "spring_slider", "friction": {"kind": "rate_and_state_ageing", "a": {"kind": "constant",
            "value": 0.01},
                                               "b": 0.015, "D_c": 1e-5, "f_0": 0.6, "V_0": 1e-6}},
        "give numbers, no profile", lambda m: [{"friction.a": 0.01}]),
    "another law of a slider": Remedy(
        {"kind": "spring_slider", "friction": {"kind": "coulomb", "mu_d": 0.6}}, r"use (\w+), _(\w+), _(\w+) or _(\w+)",
        lambda m: [{"friction": {"kind": m[1], **AGEING}}, {"friction": {"kind": f"rate_and_state_{m[2]}", **AGEING}},
                   {"friction": {"kind": f"rate_and_state_{m[3]}", **AGEING, "theta_c": 1.0}},
                   {"friction": {"kind": f"rate_and_state_{m[4]}", **AGEING, "T_0": 293.0,
                                 "temperature_initial": 310.0}}]),
}  # fmt: skip


@pytest.mark.parametrize("name", LUMPED)
def test_remedies_of_lumped_models_are_accepted(name: str) -> None:
    table, says, fixes = LUMPED[name]
    for changes in fixes(refused(table, says)):
        step(changed(table, changes))


AXES = [{"key": "faults.main.friction.mu_d", "values": [0.3, 0.6]}]
RANGE = {"key": "faults.main.friction.mu_d", "range": [0.3333333333, 0.6666666666]}
SEARCH: Table = {"sampling": "cma_es", "samples": 9, "axes": [RANGE], "search": {"goals": [
    {"quantity": "max_slip", "at_least": 1e-6}]}}  # fmt: skip

STUDIES: dict[str, Remedy] = {
    "values and range": Remedy(
        {"axes": [{**AXES[0], "range": [0.3, 0.6], "points": 3}]}, "give either values or range",
        lambda m: [{"axes.0.values": None}, {"axes.0.range": None, "axes.0.points": None}]),
    "a value twice": Remedy(
        {"axes": [{**AXES[0], "values": [0.3, 0.6, 0.3]}]}, "is there twice; remove one",
        lambda m: [{"axes.0.values": [0.3, 0.6]}]),
    "a range without points": Remedy(
        {"axes": [dict(RANGE)]}, "give their number", lambda m: [{"axes.0.points": 3}]),
    "labels of fewer values": Remedy(
        {"axes": [{**AXES[0], "labels": ["a"]}]}, "give one for each value", lambda m: [{"axes.0.labels": ["a",
            "b"]}]),
    "a search without goals": Remedy(
        {"axes": [dict(RANGE)], "sampling": "cma_es", "samples": 9}, "give both or none",
        lambda m: [{"search": SEARCH["search"]}, {"sampling": "grid", "samples": None, "axes.0.points": 3}]),
    "a start outside of the range": Remedy(
        {**SEARCH, "search": {**SEARCH["search"], "start": {"mu_d": 9.0}}}, rf"its range, {N} to {N}; give",
        lambda m: [{"search.start.mu_d": number(m)}, {"search.start.mu_d": number(m, 2)}]),
    "a quantity that is not there": Remedy(
        {"axes": AXES, "quantities": ["max_slop"]}, r"did you mean '(\w+)'", lambda m: [{"quantities": [m[1]]}]),
    "a key twice": Remedy(
        {"axes": [dict(AXES[0]), {**AXES[0], "name": "other"}]}, "remove one of them, or make one axis of both",
        lambda m: [{"axes.1": None}]),
    "a key of an axis in the settings": Remedy(
        {"axes": AXES, "set": {"faults.main.friction.mu_d": 0.5}}, "remove it from set", lambda m: [{"set": {}}]),
    "two axes of one name": Remedy(
        {"axes": [{**AXES[0], "name": "a"}, {"key": "duration", "values": [1e-6, 2e-6], "name": "a"}]},
        "give them different names", lambda m: [{"axes.1.name": "b"}]),
    "a goal with a bound and a target": Remedy(
        {**SEARCH, "search": {"goals": [{"quantity": "max_slip", "at_least": 1e-6, "target": 1e-6}]}},
        "give one of target, at_least and at_most",
        lambda m: [{"search.goals.0": {"quantity": "max_slip", "at_least": 1e-6}}]),
    "a unit of another kind": Remedy(
        {**SEARCH, "search": {"goals": [{"quantity": "max_slip", "at_least": "1 Pa"}]}}, r"write for example '(.*?)'",
        lambda m: [{"search.goals.0.at_least": m[1]}]),
}  # fmt: skip


@pytest.mark.parametrize("name", STUDIES)
def test_remedies_of_studies_are_accepted(name: str, tmp_path: Path) -> None:
    table, says, fixes = STUDIES[name]
    (tmp_path / "case.toml").write_text(tomli_w.dumps(flat()))

    def read(study: Table) -> None:
        (tmp_path / "study.toml").write_text(tomli_w.dumps({"case": "case.toml", **study}))
        read_study(tmp_path / "study.toml").points()

    with pytest.raises(RuptfxError) as caught:
        read(table)
    found = re.search(says, str(caught.value), re.DOTALL)
    assert found is not None, str(caught.value)
    for changes in fixes(found):
        read(changed(table, changes))


class Session:
    """A folder with a short run, in which commands are tried one after the other."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(folder)
        self.folder = folder
        short = flat(duration=2e-6, output__checkpoint_steps=1, instruments=[{**RECEIVER, "interval": 1e-6}])
        Path("case.toml").write_text(tomli_w.dumps(short))
        Path("study.toml").write_text(tomli_w.dumps({"case": "case.toml", "axes": [{**AXES[0], "values": [0.6]}]}))

    def __call__(self, text: str) -> Result:
        return CliRunner(env={"COLUMNS": "1000"}).invoke(app, shlex.split(text))

    def refused(self, text: str, says: str) -> re.Match[str]:
        done = self(text)
        found = re.search(says, done.output, re.DOTALL)
        assert done.exit_code == 1 and found is not None, done.output
        return found

    def works(self, text: str) -> None:
        done = self(text.removeprefix("ruptfx ").strip())
        assert done.exit_code == 0, f"{text}: {done.output}"


POLARISCOPE = '{ kind = "polariscope", name = "film", frame_rate = 2e6, exposure = 5e-7, pixel = 5e-4 }'
COMMANDS: dict[str, tuple[list[str], str, str, Callable[[re.Match[str]], list[str]]]] = {
    "a study is no case": ([], "run study.toml", r"run it with: (ruptfx study \S+)", lambda m: [f"{m[1]} --quiet"]),
    "a case is no study": ([], "study case.toml", r"run it with: (ruptfx run \S+)",
                           lambda m: [f"{m[1]} --quiet --out elsewhere"]),
    "a run that exists": (["run case.toml --out r --quiet"], "run case.toml --out r --quiet --set duration=1e-6",
                          r"(--overwrite).*another directory, or remove it",
                          lambda m: [f"run case.toml --out r --quiet --set duration=1e-6 {m[1]}",
                                     "run case.toml --out r2 --quiet --set duration=1e-6"]),
    "a run directory is no case": (["run case.toml --out r --quiet"], "run r",
                                   r"its case is (\S+), and 'ruptfx (\w+)'",
                                   lambda m: [f"check {m[1]}", f"{m[2]} r --quiet"]),
    "a key without a value": ([], "check case.toml --set duration", r"for example (\S+=\S+)",
                              lambda m: [f"check case.toml --set {m[1]}"]),
    "a longer run that is shorter": (["run case.toml --out r --quiet"], "resume r --duration 1e-6 --quiet",
                                     rf"has {N} s already; give a longer one, or resume without it",
                                     lambda m: [f"resume r --quiet --duration {1.5 * float(m[1])!r}",
                                                "resume r --quiet"]),
    "a figure without data": (["run case.toml --out r --quiet"], "plot r --figure cracks", r"it has (\w+)",
                              lambda m: [f"plot r --figure {m[1]}"]),
    "no camera": (["run case.toml --out r --quiet --set output.bulk_interval=5e-7"], "film r",
                  r"such as --camera '(\{.*?\})'",
                  lambda m: [f"film r --camera '{m[1]}'"]),
    "no thickness of the plates": (
        ["run case.toml --out r --quiet --set output.bulk_interval=5e-7"],
        f"film r --camera '{POLARISCOPE}'", r"run it with (--set \S+'.*?'),",
        lambda m: [f"run case.toml --out r --quiet --set output.bulk_interval=5e-7 --overwrite {m[1]}"]),
    "no fringe constant": (
        ["run case.toml --out r --quiet --set output.bulk_interval=5e-7 --set output.plate_thickness=9e-3"],
        f"film r --camera '{POLARISCOPE}'", r"run the case with (--set \S+'.*?'),",
        lambda m: ["run case.toml --out r2 --quiet --set output.bulk_interval=5e-7 "
                   f"--set output.plate_thickness=9e-3 {m[1]}", f"film r2 --camera '{POLARISCOPE}'"]),
    "a format of pictures": (["run case.toml --out r --quiet"], "mesh case.toml --out m.toml", r"known: \.(\w+)",
                             lambda m: [f"mesh case.toml --out m.{m[1]}"]),
    "instruments of a comparison": (["run case.toml --out r --quiet"], "compare r data.csv --most-shift 0",
                                    r"such as '(.*?)'", lambda m: [f"compare r data.csv --most-shift '{m[1]}'"]),
    "times of a clock": (["run case.toml --out r --quiet"], "compare r late.csv", r"--time-shift '(.*?)'",
                         lambda m: [f"compare r late.csv --time-shift '{m[1]}'"]),
    "a study of another case": (["study study.toml --out s --quiet"],
    "study study.toml --out s --quiet --set duration=1e-6",
                                r"another --out, or replace it with (--overwrite)",
                                lambda m: [f"study study.toml --out s --quiet --set duration=1e-6 {m[1]}"]),
    "a directory that exists": ([], "demos taken", r"(ruptfx demos) DIRECTORY", lambda m: [f"{m[1]} other"]),
}  # fmt: skip


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * name.startswith("a study")) for name in COMMANDS
])  # fmt: skip
def test_remedies_of_commands_work(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before, command, says, remedies = COMMANDS[name]
    session = Session(tmp_path, monkeypatch)
    Path("taken").mkdir()
    Path("taken", "thesis.tex").write_text("")
    for file, start in (("data.csv", 0.0), ("late.csv", 1234.5)):
        rows = "\n".join(f"{start + 2e-7 * n!r},{n % 3}" for n in range(11))
        Path(file).write_text(f"time (s),velocity_x (m/s)\n{rows}\n")
    for first in before:
        session.works(first)
    for remedy in remedies(session.refused(command, says)):
        session.works(remedy)


PLATES = (Path(__file__).parents[1] / "data" / "two_bodies.geo").read_text()
SIDES = {"main": {"plus": "upper", "minus": "lower"}}
CAP = (
    PLATES.replace('"main") = {3}', '"main") = {3, 6}').replace('Physical Curve("upper.top") = {6};', "")
    + """
Point(7) = {40e-3, 20e-3, 0, h}; Point(8) = {0, 20e-3, 0, h}; Line(8) = {5, 7}; Line(9) = {7, 8}; Line(10) = {8, 6};
Curve Loop(3) = {-6, 8, 9, 10}; Plane Surface(3) = {3}; Physical Surface("cap") = {3};
"""
)
APART = PLATES
for old, new in (
    ("Point(5) =", "Point(7) = {40e-3, 0, 0, h / 3}; Point(8) = {0, 0, 0, h / 3}; Point(5) ="),
    ("Line(5) = {3, 5}", "Line(5) = {7, 5}"), ("Line(7) = {6, 4};", "Line(7) = {6, 8}; Line(8) = {8, 7};"),
    ("{-3, 5, 6, 7}", "{8, 5, 6, 7}"), ('"main") = {3}', '"main") = {3, 8}'),
):  # fmt: skip
    APART = APART.replace(old, new)
BLOCKS = """SetFactory("OpenCASCADE");
Box(1) = {-5e-3, -5e-3, -10e-3, 40e-3, 30e-3, 10e-3}; Box(2) = {0, 0, 0, 20e-3, 20e-3, 10e-3};
Transfinite Curve{:} = 3; Transfinite Surface{:}; Transfinite Volume{:}; //
Physical Volume("lower") = {1}; Physical Volume("upper") = {2}; Physical Surface("main") = {6, 11};
"""
ROCK = 'Physical Surface("rock") = {1, 2};'
IN_ROCK = PLATES.replace('Physical Surface("lower") = {1}; Physical Surface("upper") = {2};', ROCK)
IN_ROCK = re.sub(r'"(upper|lower)\.', '"rock.', IN_ROCK)


def names_of(found: re.Match[str]) -> Changes:
    return {"mesh.names": tomllib.loads(found[1])["names"]}


class Meshed(NamedTuple):
    """A script and changes of its case that are refused; each of `fixes`, replacements and changes, is accepted."""

    script: str
    changes: Changes
    says: str
    fixes: Callable[[re.Match[str]], list[tuple[dict[str, str], Changes]]]


SLIDES = {"mesh.interfaces.main.matching": False, "faults.main.sliding": {}}
MESHES: dict[str, Meshed] = {
    "another name in the file": Meshed(
        PLATES.replace('"main"', '"main fault"'), {}, r"as (names = \{.*\})$", lambda m: [({}, names_of(m))]),
    "an interface with a blank": Meshed(
        PLATES.replace('"main"', '"main fault"'), {"mesh.interfaces": {"main fault": SIDES["main"]}},
        r"call it (\w+) here and in \[faults\], and add (names = \{.*\}) to",
        lambda m: [({}, {"mesh.interfaces": {m[1]: SIDES["main"]}, "mesh.names": tomllib.loads(m[2])["names"],
                         "faults": {m[1]: flat()["faults"]["main"]}})]),
    "a name that is written wrong": Meshed(
        PLATES, {"mesh.names": {"upper": "uper"}}, r"did you mean '(\w+)'",
        lambda m: [({}, {"mesh.names.upper": m[1]})]),
    "no interface in the file": Meshed(
        PLATES.replace('Physical Curve("main") = {3};', "//"), {}, "correct the case",
        lambda m: [({"//\n": 'Physical Curve("main") = {3};\n'}, {})]),
    "cells in two groups": Meshed(
        f"{PLATES}\n{ROCK}", {"mesh.interfaces": {}, "faults": None}, "list in .mesh. the bodies that count",
        lambda m: [({}, {"mesh.names": {"lower": "lower", "upper": "upper"}}), ({}, {"mesh.names": {"all": "rock"}})]),
    "an interface inside a body": Meshed(
        IN_ROCK, {"mesh.interfaces.main": {"plus": "rock", "minus": "rock"}}, r"as normal = \[(.*?), (.*?)\]",
        lambda m: [({}, {"mesh.interfaces.main.normal": [float(m[1]), float(m[2])]})]),
    "a normal along the interface": Meshed(
        IN_ROCK, {"mesh.interfaces.main": {"plus": "rock", "minus": "rock", "normal": [1.0, 0.0]}},
        rf"has the normal \({N}, {N}\)",
        lambda m: [({}, {"mesh.interfaces.main.normal": [number(m), number(m, 2)]})]),
    "elements of third order": Meshed(
        f"{PLATES}\nMesh.ElementOrder = 3; Recombine Surface{{1, 2}};", {},
        r"\((Mesh\.ElementOrder = 1)\), or with all nodes of those \((Mesh\.SecondOrderIncomplete = 0)\)",
        lambda m: [({"Mesh.ElementOrder = 3": way}, {}) for way in (m[1], f"Mesh.ElementOrder = 2; {m[2]}")]),
    "two kinds of cells": Meshed(
        f"{PLATES}\nRecombine Surface{{1}};", {}, "mesh it with one",
        lambda m: [({"Recombine Surface{1}": "Recombine Surface{1, 2}"}, {}), ({"Recombine Surface{1};": ""}, {})]),
    "facets beside a third body": Meshed(
        CAP, {}, "list these bodies, too, or leave the facets out", lambda m: [({"{3, 6}": "{3}"}, {})]),
    "sides of other nodes": Meshed(
        APART, {"faults.main.contact": COMPLIANT}, r"matching = false here, and the table \[faults\.(\w+)\.sliding\]",
        lambda m: [({"h / 3": "h"}, {}), ({}, SLIDES)]),
    "tetrahedra that slide": Meshed(
        BLOCKS, {"plane": "solid", "boundaries": [], **SLIDES},
        r"of tetrahedron elements.*transfinite volumes with '(Recombine)'\), or remove (this table)",
        lambda m: [({"; //": f"; {m[1]} Surface{{:}};"}, {})]),
    "a script that does more": Meshed(
        f'{PLATES}\nSystemCall "true";', {}, r"add (trust) = true to \[mesh\]", lambda m: [({}, {"mesh.trust": True})]),
}  # fmt: skip


@pytest.mark.parametrize("name", MESHES)
def test_remedies_of_mesh_files_are_accepted(name: str, tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    script, changes, says, fixes = MESHES[name]
    file = tmp_path / "mesh.geo"
    table = flat(mesh={"kind": "gmsh_file", "file": str(file), "interfaces": SIDES})
    file.write_text(script + "\n")
    found = refused(changed(table, changes), says)
    for replacements, more in fixes(found):
        text = script
        for old, new in replacements.items():
            assert old in text
            text = text.replace(old, new)
        file.write_text(text + "\n")
        step(changed(changed(table, changes), more))


MU, SHEAR = "faults.main.friction.mu_d", "faults.main.initial_stress.shear"


def observed(unknowns: list[Table], **keys: Any) -> Table:
    """A rupture with two data and unknowns, 32 mm long."""
    return slip_weakening(
        {
            "order": 1,
            "duration": 3e-6,
            "instruments": [BODY],
            "objective": [TRACE],
            "unknowns": unknowns,
            **{key.replace("__", "."): value for key, value in keys.items()},
        }
    )


GRADIENTS: dict[str, Remedy] = {
    "knots beyond the interface": Remedy(
        observed([{"key": SHEAR, "shape": "knots", "knots": [1.0, 2.0]}], mesh__length=0.0333333333),
        rf"from {N} m to {N} m; place knots there", lambda m: [{"unknowns.0.knots": [number(m), number(m, 2)]}]),
    "a knot on which nothing depends": Remedy(
        observed([{"key": SHEAR, "shape": "knots", "knots": [0.0, 0.02, 0.9, 1.0]}]), rf"at {N} m; remove it",
        lambda m: [{"unknowns.0.knots": [each for each in (0.0, 0.02, 0.9, 1.0) if each != number(m)]}]),
    "knots of a constant": Remedy(
        observed([{"key": "materials.default.density", "shape": "knots", "knots": [0.0, 0.02]}]),
        "use shape = '(number)'", lambda m: [{"unknowns.0.shape": m[1], "unknowns.0.knots": None}]),
    "knots without positions": Remedy(
        observed([{"key": SHEAR, "shape": "knots"}]), "give both or none",
        lambda m: [{"unknowns.0.shape": "number"}, {"unknowns.0.knots": [0.0, 0.02]}]),
    "knots on a surface": Remedy(
        solid(order=1, duration=1e-6, objective=[{"kind": "final_slip", "target": 1e-6, "sigma": 1e-6}],
              unknowns=[{"key": SHEAR, "shape": "knots", "knots": [0.0, 1e-3]}]),
        "use '(number)'", lambda m: [{"unknowns.0.shape": m[1], "unknowns.0.knots": None}]),
    "a key that is written wrong": Remedy(
        observed([{"key": MU[:-1]}]), "did you mean '(.*?)'", lambda m: [{"unknowns.0.key": m[1]}]),
    "a key twice": Remedy(observed([{"key": MU}] * 2), "remove one of them", lambda m: [{"unknowns.1": None}]),
    "a parameter of all terms, and of one": Remedy(
        observed([{"key": "objective.*.gain"}, {"key": "objective.0.gain"}]), "remove one of them",
        lambda m: [{"unknowns.1": None}, {"unknowns.0": None}]),
}  # fmt: skip


@pytest.mark.parametrize("name", GRADIENTS)
def test_remedies_of_gradients_are_accepted(name: str) -> None:
    def differentiate(table: Table) -> None:
        gradient(parse_case(table), progress=False)

    table, says, fixes = GRADIENTS[name]
    with pytest.raises(RuptfxError) as caught:
        differentiate(table)
    found = re.search(says, str(caught.value), re.DOTALL)
    assert found is not None, str(caught.value)
    for changes in fixes(found):
        differentiate(changed(table, changes))


NUMBER = {"key": MU, "shape": "number", "bounds": [0.2, 0.5]}
SHIFT = {"key": "objective.0.time_shift", "shape": "number"}
EARLY = {**TRACE, "times": [-1.1e-6, 1.3333333e-6, 2.2e-6, 5e-6], "data": {"velocity": [0.1] * 4}}
INFERENCES: dict[str, Remedy] = {
    "data outside of the run": Remedy(
        observed([NUMBER], objective=[EARLY]),
        rf"begin = {N} and make the run longer or leave the late ones out with end = {N}",
        lambda m: [{"objective.0.begin": number(m), "objective.0.end": number(m, 2)},
                   {"objective.0.begin": number(m), "duration": 5.1e-6}]),
    "bounds beside the case": Remedy(
        observed([{**NUMBER, "bounds": [0.3, 0.5]}], faults__main__friction__mu_d=0.2345678),
        rf"the value of the case, {N}, .*widen them, or change the case",
        lambda m: [{"unknowns.0.bounds": [0.9 * number(m), 0.5]}, {MU: 0.4}]),
    "bounds that the key refuses": Remedy(
        observed([{**NUMBER, "bounds": [-0.1, 0.5]}]), "give bounds that the key accepts",
        lambda m: [{"unknowns.0.bounds": [0.0, 0.5]}]),
    "a time shift without bounds": Remedy(
        observed([dict(SHIFT)]), "bounds: .* needs some", lambda m: [{"unknowns.0.bounds": [-1e-7, 1e-7]}]),
    "a time shift as a field": Remedy(
        observed([{**SHIFT, "shape": "field", "bounds": [-1e-7, 1e-7]}]), "use shape = '(number)'",
        lambda m: [{"unknowns.0.shape": m[1]}]),
    "bounds beyond the data": Remedy(
        observed([{**SHIFT, "bounds": [-1.5e-6, 1e-7]}]), rf"begin = {N}, or narrow the bounds of the shift",
        lambda m: [{"objective.0.begin": number(m)}, {"unknowns.0.bounds": [-1e-6, 1e-7]}]),
    "the logarithm of zero": Remedy(
        observed([{"key": "objective.0.offset", "shape": "number", "scale": "log", "bounds": [0.1, 1.0]}]),
        "use '(linear)'", lambda m: [{"unknowns.0.scale": m[1], "unknowns.0.bounds": [-1.0, 1.0]}]),
    "a constant of bodies": Remedy(
        observed([NUMBER, {"key": "materials.default.density", "shape": "number"}]), "remove it",
        lambda m: [{"unknowns.1": None}]),
    "no unknowns": Remedy(observed([]), r"add entries \[\[unknowns\]\]", lambda m: [{"unknowns": [NUMBER]}]),
    "no sum of squares": Remedy(
        observed([NUMBER], inference__method="gauss_newton", objective=[{
            "kind": "mode_degree", "mode": "crack", "threshold": 1e-3, "loaded_end": 13e-3, "far_end": 30e-3,
            "spacing": 1e-3, "interval": 1e-7}]),
        r"use method = '(\w+)'", lambda m: [{"inference.method": m[1]}]),
    "too few walkers": Remedy(
        observed([NUMBER, {"key": SHEAR, "shape": "number", "bounds": [-1e9, 1e9]}, {
            "key": "objective.0.gain", "shape": "number", "bounds": [0.5, 2.0]}],
            inference={"method": "ensemble", "population": 4}),
        r"needs at least (\d+) walkers", lambda m: [{"inference.population": int(m[1])}]),
    "walkers without bounds": Remedy(
        observed([{"key": MU, "shape": "number"}], inference={"method": "ensemble"}), "give one of them",
        lambda m: [{"unknowns.0.bounds": [0.2, 0.5]}, {"unknowns.0.sigma": 0.02}]),
    "a field without a prior": Remedy(
        observed([{"key": SHEAR}]), "give both, or shape = '(number)'",
        lambda m: [{"unknowns.0.sigma": 1e5, "unknowns.0.correlation_length": 5e-3}, {"unknowns.0.shape": m[1]}]),
}  # fmt: skip


@pytest.mark.parametrize("name", INFERENCES)
def test_remedies_of_inferences_are_accepted(name: str, tmp_path: Path) -> None:
    """An iteration of the search is made, and files are written."""

    def search(table: Table, folder: str) -> None:
        table = changed(table, {"inference.iterations": 1})
        infer(parse_case(table), tmp_path / folder, progress=False)
        assert (tmp_path / folder / "best.toml").is_file()

    table, says, fixes = INFERENCES[name]
    if table.get("inference", {}).get("method") == "ensemble":
        pytest.importorskip("emcee")
    with pytest.raises(RuptfxError) as caught:
        search(table, "refused")
    found = re.search(says, str(caught.value), re.DOTALL)
    assert found is not None, str(caught.value)
    for index, changes in enumerate(fixes(found)):
        search(changed(table, changes), str(index))
