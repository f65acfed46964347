"""Coarse and short versions of the demos, found by listing their folder."""

from __future__ import annotations

import copy
import tomllib
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import ruptfx
from ruptfx import RuptfxError
from ruptfx.case import Case, parse_case
from ruptfx.platform import fem
from ruptfx.run.model import Model

DEMOS = Path(ruptfx.__file__).parents[1] / "demos"
CELLS = 120  # at most, where the geometry allows it
STEPS = 40  # of explicit steps
FEW = 6  # of steps without inertia, whose solutions cost more
Table = dict[str, Any]


def names() -> list[str]:
    """Return the names of all demos that are one run with a mesh, and whose slip is not in a file of its own units.

    Bodies that repeat along strike have no motion of their own to compare; their steps have tests of their own.
    """
    tables = {path.stem: tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(DEMOS.glob("*.toml"))}
    return [
        name for name, table in tables.items()
        if "mesh" in table and "along_strike" not in table["mesh"]
        and not any("prescribed_slip" in fault for fault in table.get("faults", {}).values())
    ]  # fmt: skip


def _enlarged(node: Any, factor: float) -> Any:
    """Return the table with elements, viscous layers and numbers of layers for elements larger by a factor."""
    if isinstance(node, list):
        return [_enlarged(each, factor) for each in node]
    if not isinstance(node, dict):
        return node
    result = {key: _enlarged(value, factor) for key, value in node.items()}
    for key in ("element_size", "thickness"):
        if isinstance(result.get(key), float) and ("element_size" in result or "fraction" in result):
            result[key] *= factor
    if "layers" in result:
        result["layers"] = max(2, int(result["layers"] / factor))
    return result


@cache
def resolved(name: str) -> Table:
    """Return the table of a demo with all keys, on elements of low order and without figures."""
    path = DEMOS / f"{name}.toml"
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    table["order"] = min(table.get("order", 4), 2)
    table["output"] = {"figures": False, "plate_thickness": table.get("output", {}).get("plate_thickness")}
    table["output"] = {key: value for key, value in table["output"].items() if value is not None}
    return parse_case(table, path.parent).table()


@cache
def coarse(name: str) -> Table:
    """Return the resolved table of a demo on few elements and for few steps."""
    cases: list[Case] = []
    for power in range(14):
        trial = copy.deepcopy(resolved(name))
        for key in ("mesh", "damping"):
            trial[key] = _enlarged(trial.get(key, {}), 1.3**power)
        try:
            case = parse_case(trial)
            assert isinstance(case, Case)
            cells = len(case.mesh.build().cells)
        except RuptfxError:  # too coarse for its geometry
            break
        cases.append(case)
        if cells <= CELLS:
            break
    for case in reversed(cases):
        with suppress(RuptfxError):
            return _short(case, Model(case, fem.MPI.COMM_SELF))
    raise AssertionError(name)


def _short(case: Case, model: Model) -> Table:
    table = case.table()
    stepper = case.stepper
    step = case.stepper.bind(model).dt
    if "inertia" in stepper.offers and table["stepper"]["kind"] != "hybrid":
        duration = min(case.duration, STEPS * step)
    else:
        duration = min(case.duration, FEW * step)
    if "inertia" in stepper.offers and "time_step" in type(stepper).model_fields:
        table["stepper"]["time_step"] = step  # a rounded number, which would not scale
        # So is the step of which the viscosity of the layers is a fraction.
        for damping in [table["damping"], *(s.get("damping", {}) for s in table.get("stages", []))]:
            if "eta" not in damping.get("kelvin_voigt", {"eta": 0}):
                damping["kelvin_voigt"]["eta"] = damping["kelvin_voigt"].pop("fraction") * step
    part = duration / case.duration
    for stage in table.get("stages", []):
        stage["duration"] *= part
    for boundary in [*table.get("boundaries", []), *(b for s in table.get("stages", []) for b in s["boundaries"])]:
        if "ramp" in boundary:
            boundary["ramp"] = min(boundary["ramp"], 0.3 * duration)
    # The nodes of a surface are elsewhere.
    table["instruments"] = [
        each for each in table.get("instruments", []) if (each["kind"], case.plane) != ("fault_receiver", "solid")
    ]
    for instrument in table["instruments"]:
        instrument["interval"] = duration / 10
        if "spacing" in instrument:  # of a grid of receivers
            corners = np.subtract(instrument["opposite"], instrument["corner"])
            instrument["spacing"] = float(np.abs(corners).max()) / 4
    table["duration"] = sum(s["duration"] for s in table["stages"]) if table.get("stages") else duration
    table["output"] |= {"interface_interval": duration / 8, "bulk_interval": duration / 2}
    if not case.faults:
        table["output"].pop("rupture_threshold", None)
    table.pop("stop_when", None)
    for key in ("objective", "unknowns", "inference", "cameras"):
        table.pop(key, None)
    return table
