"""Invariances of whole runs: every demo, coarse and short, changed in a way whose effect on all numbers is known.

A transformation returns another case, and what must become of the numbers of the run. The default selection has each
transformation on two demos at least and each demo under three; `-m slow` runs all pairs.
"""

from __future__ import annotations

import copy
import hashlib
import shutil
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.coarse_demos import coarse, names, resolved
from helpers.run_data import Data, Run, differences, read
from helpers.whole_runs import run_on, write
from typer.testing import CliRunner

from ruptfx.app.cli import app
from ruptfx.case import Case, parse_case
from ruptfx.input.profiles import OfKey, Profile
from ruptfx.input.quantities import _unit, factor
from ruptfx.input.schema import Part, Unit, has_mark, kinds, unit_of

pytest.importorskip("dolfinx")

from ruptfx.results.summary_fields import UNITS_OF_FRACTURE
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

Table = dict[str, Any]
Map = Callable[[Run], Run]
RANDOM = 20261128
FEWEST_OF_A_DEMO, FEWEST_DEMOS = 3, 2  # transformations of a demo, demos of a transformation in the default selection


def same(run: Run) -> Run:
    """Return the expected numbers of a change without effect."""
    return run


def run(table: Table, out: Path) -> None:
    """Run a case in one piece, on one rank."""
    case = parse_case(table)
    assert isinstance(case, Case)
    simulate(case, out, progress=False)


@dataclass(frozen=True)
class Changed:
    """A changed case, and what must become of the numbers of the run.

    Attributes
    ----------
    case : dict
    expected : callable
        From the run of the original case.
    tolerance : float
    observed : callable
        Applied to the run of the changed case first.
    ignored : tuple of str
        Ends of the names of numbers that the change concerns.
    run : callable
        Runs a case in a directory.
    """

    case: Table
    expected: Map = same
    tolerance: float = 1e-9
    observed: Map = same
    ignored: tuple[str, ...] = ()
    run: Callable[[Table, Path], None] = run


Transformation = Callable[[Table, np.random.Generator], Changed]
Needs = Callable[[Table], bool]
TRANSFORMATIONS: dict[str, tuple[Needs, Transformation]] = {}
"""By name: whether one applies to a resolved case, and the change itself, of the coarse case."""


def transformation(needs: Needs = lambda table: True) -> Callable[[Transformation], Transformation]:
    def add(function: Transformation) -> Transformation:
        TRANSFORMATIONS[function.__name__] = needs, function
        return function

    return add


# -- what transformations need -----------------------------------------------------------------------------------------


def loads(table: Table) -> list[Table]:
    """Return the boundaries of a case and of its stages."""
    return [*table.get("boundaries", []), *(b for stage in table.get("stages", []) for b in stage["boundaries"])]


def faults(table: Table) -> list[Table]:
    return list(table.get("faults", {}).values())


def has_profiles(node: Any) -> bool:
    """Return whether a table has a profile along an interface or in a body."""
    if isinstance(node, list):
        return any(has_profiles(each) for each in node)
    if not isinstance(node, dict):
        return False
    return node.get("kind") in PROFILES or any(has_profiles(each) for each in node.values())


PROFILES = {*kinds("ruptfx.input.profiles")} - {"linear", "exponential"}


def has_own_steps(table: Table) -> bool:
    """Steps are given; others are rounded to three digits."""
    return table["stepper"]["kind"] not in ("hybrid", "quasi_static")


def scales_with_keys(table: Table) -> bool:
    """The mesh is that of the keys; Gmsh makes another one of other lengths, and reads those of a file."""
    return table["mesh"]["kind"] not in ("gmsh_file", "specimen", "pieces")


def is_plain(table: Table) -> bool:
    """Interfaces have neither profiles nor nucleations nor finite sliding."""
    return not any(has_profiles(f) or f["nucleation"] or "sliding" in f for f in faults(table))


def can_move(table: Table) -> bool:
    """Directions and places of a plane case are mapped by `_moved`."""
    kinds = {"driven": {"kind", "edge", "component", "velocity", "ramp"}, "absorbing": None,
             "traction": {"kind", "edge", "traction", "ramp", "x_range", "y_range", "history"}}  # fmt: skip
    return (
        table["plane"] in ("strain", "stress") and is_plain(table) and not has_profiles(table["materials"])
        and not table.get("initial_stress") and not table.get("attachments")
        and table["mesh"]["kind"] in ("two_plates", "gmsh_file", "inclined_plates", "specimen", "pieces")
        and all(b["kind"] in kinds and not has_profiles(b) for b in loads(table))
    )  # fmt: skip


# -- numbers of a case, with their units -------------------------------------------------------------------------------


def mapped(table: Table, change: Callable[[float, str, bool], object]) -> Table:
    """Return a case with `change(number, unit, text allowed)` in place of every number that has a unit."""
    case = parse_case(table)
    return _mapped(case, table, change, "1")


def _mapped(part: Part, table: Table, change: Callable[[float, str, bool], object], of_key: str) -> Table:
    result = dict(table)
    for name in type(part).model_fields:
        if name not in table:
            continue
        text = any(has_mark(type(part), name, mark) for mark in (Unit, OfKey))
        inner = isinstance(part, Profile) and name != "factor"  # of which the unit is that of the key
        unit = unit_of(type(part), name)
        if has_mark(type(part), name, OfKey) or (inner and isinstance(getattr(part, name), Profile)):
            unit = of_key
        result[name] = _value(getattr(part, name), table[name], change, unit, text)
    return result


def _value(value: Any, plain: Any, change: Callable[[float, str, bool], object], unit: str, text: bool) -> Any:
    if isinstance(value, Part):
        return _mapped(value, plain, change, unit)
    if isinstance(value, dict):
        return {key: _value(value[key], plain[key], change, unit, text) for key in plain}
    if isinstance(plain, list):
        return [_value(each, item, change, unit, text) for each, item in zip(value, plain, strict=True)]
    if isinstance(plain, float) or (isinstance(plain, int) and not isinstance(plain, bool) and unit != "1"):
        return change(float(plain), unit, text)
    return plain


def scaled(table: Table, **factors: float) -> Changed:
    """Return a case in which lengths, times and masses are larger by factors."""

    def by(unit: str) -> float:
        dimension = {} if unit == "degree" else _unit(unit)[1]
        return float(np.prod([factors.get(base, 1.0) ** power for base, power in dimension.items()]))

    def expected(run: Run) -> Run:
        return {
            name: Data(np.asarray(data.values, float) * by(data.unit), data.unit)
            if data.unit is not None and not isinstance(data.values, str | None | bool) else data
            for name, data in run.items()
        }  # fmt: skip

    result = mapped(table, lambda number, unit, _: number * by(unit))
    # Magnitudes are logarithms of energies in J.
    return Changed(result, expected, 1e-8, ignored=("magnitude", "aseismic_share", "b_value"))


TEXTS = {"m": "mm", "s": "ms", "kg/m3": "g/m3", "m/s": "mm/s", "1/s": "1/ms", "rad": "rad", "1": "%", "min": "min"}


@transformation()
def numbers_as_text_in_other_units(table: Table, rng: np.random.Generator) -> Changed:
    def text(number: float, unit: str, allowed: bool) -> object:
        if not allowed or unit == "degree":
            return number
        other = TEXTS.get(unit, f"k{unit}" if unit[0] in "PJNm" else unit)
        ratio = factor(other, unit)  # a power of ten
        return f"{Decimal(repr(number)) * ratio.denominator / ratio.numerator} {other}"

    return Changed(mapped(table, text), tolerance=0.0)


@transformation(scales_with_keys)
def longer(table: Table, rng: np.random.Generator) -> Changed:
    return scaled(table, m=rng.uniform(2, 5))


@transformation()
def slower(table: Table, rng: np.random.Generator) -> Changed:
    return scaled(table, s=rng.uniform(2, 5) if has_own_steps(table) else 100.0)


@transformation()
def heavier(table: Table, rng: np.random.Generator) -> Changed:
    return scaled(table, kg=rng.uniform(2, 5))


@transformation(lambda table: has_own_steps(table) and scales_with_keys(table))
def scaled_by_powers_of_two(table: Table, rng: np.random.Generator) -> Changed:
    return scaled(table, m=2.0**-3, s=2.0**5, kg=2.0**7)


# -- other ways to write a case ----------------------------------------------------------------------------------------


def _reversed_keys(node: Any) -> Any:
    if isinstance(node, dict):
        return {key: _reversed_keys(node[key]) for key in reversed(node)}
    return [_reversed_keys(each) for each in node] if isinstance(node, list) else node


@transformation()
def keys_in_another_order(table: Table, rng: np.random.Generator) -> Changed:
    return Changed(_reversed_keys(table), tolerance=1e-10)


@transformation(lambda table: any(len(table.get(key, [])) > 1 for key in ("boundaries", "instruments")))
def entries_in_another_order(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    for each in [result.get(key, []) for key in ("boundaries", "instruments", "attachments")]:
        each.reverse()
    for fault in faults(result):
        fault["nucleation"].reverse()
    return Changed(result, tolerance=1e-10)


@transformation()
def written_and_read(table: Table, rng: np.random.Generator) -> Changed:
    text = parse_case(table).to_toml()
    return Changed(tomllib.loads(text), tolerance=0.0)


@transformation(lambda table: "default" in table["materials"])
def materials_by_the_name_of_the_body(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    default = result["materials"].pop("default")
    bodies = parse_case(table).mesh.build().bodies
    result["materials"] = {body: result["materials"].get(body, default) for body in bodies}
    return Changed(result, tolerance=0.0)


@transformation(lambda table: bool(faults(table)))
def uniform_profiles_for_numbers(table: Table, rng: np.random.Generator) -> Changed:
    """Friction and initial stress by a table of equal values."""
    result, case = copy.deepcopy(table), parse_case(table)
    for name, fault in case.faults.items():
        for key in ("friction", "initial_stress"):
            part, node = getattr(fault, key), result["faults"][name].get(key, {})
            for each in list(node):
                if isinstance(node[each], float) and "Varying" in str(type(part).__annotations__.get(each, "")):
                    value = node[each]
                    node[each] = {"kind": "table", "positions": [-1e9, 1e9], "values": [value, value]}
    return Changed(result)


def _isotropic(material: Table) -> bool:
    constants = [material.get(key) for key in ("young_modulus", "poisson_ratio", "density")]
    return material["kind"] == "isotropic_elastic" and all(isinstance(each, float) for each in constants)


@transformation(lambda table: any(map(_isotropic, table["materials"].values())))
def speeds_for_moduli(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    for material in filter(_isotropic, result["materials"].values()):
        E, nu, rho = material.pop("young_modulus"), material.pop("poisson_ratio"), material["density"]
        material["c_p"] = float(np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu) * rho)))
        material["c_s"] = float(np.sqrt(E / (2 * (1 + nu) * rho)))
    return Changed(result, tolerance=1e-8)


@transformation(lambda table: not table.get("fracture") and table["plane"] != "axisymmetric"
                and any(map(_isotropic, table["materials"].values())))  # fmt: skip
def orthotropic_with_equal_constants(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    for material in filter(_isotropic, result["materials"].values()):
        E, nu = material.pop("young_modulus"), material.pop("poisson_ratio")
        material |= {"kind": "orthotropic_elastic", "E_1": E, "E_2": E, "nu_12": nu, "nu_23": nu,
                     "G_12": E / (2 * (1 + nu))}  # fmt: skip
    return Changed(result, tolerance=1e-8)


@transformation(lambda table: table["plane"] == "stress" and all(map(_isotropic, table["materials"].values())))
def strain_for_stress(table: Table, rng: np.random.Generator) -> Changed:
    """Plane stress is plane strain with E (1 + 2 nu) / (1 + nu)^2 and nu / (1 + nu)."""
    result = copy.deepcopy(table)
    result["plane"] = "strain"
    for material in result["materials"].values():
        E, nu = material["young_modulus"], material["poisson_ratio"]
        material |= {"young_modulus": E * (1 + 2 * nu) / (1 + nu) ** 2, "poisson_ratio": nu / (1 + nu)}
        material.pop("fringe_constant", None)
    result["output"].pop("plate_thickness", None)
    return Changed(result, tolerance=1e-8)


@transformation(lambda table: not table.get("fracture") and not table.get("large_rotations"))
def another_operator(table: Table, rng: np.random.Generator) -> Changed:
    return Changed({**table, "operator": "ufl_form"})


# -- additions without effect ------------------------------------------------------------------------------------------


def _free_edges(table: Table) -> list[str]:
    loaded = {each.get("edge") for each in loads(table)}
    return [name for name in parse_case(table).mesh.build().edges if name not in loaded]


@transformation(lambda table: not table.get("stages"))
def a_load_of_nothing(table: Table, rng: np.random.Generator) -> Changed:
    result, edges = copy.deepcopy(table), _free_edges(table)
    if not edges:
        return Changed(result)
    size = {"antiplane": 1, "solid": 3}.get(table["plane"], 2)
    result.setdefault("boundaries", []).append({"kind": "traction", "edge": edges[0], "traction": [0.0] * size})
    return Changed(result, tolerance=1e-12, ignored=tuple(f"{edges[0]}.{c}_{x}" for c in ("displacement", "force")
                                                          for x in "xyz"))  # fmt: skip


@transformation(lambda table: bool(faults(table)) and not any({"sliding", "cohesion"} & {*f} for f in faults(table)))
def a_nucleation_of_nothing(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    for fault in faults(result):
        fault["nucleation"].append({"kind": "overstress", "extra": 0.0})
    return Changed(result, tolerance=1e-12)


@transformation(lambda table: not table.get("fracture") and table["plane"] != "axisymmetric")
def more_instruments(table: Table, rng: np.random.Generator) -> Changed:
    result, edges = copy.deepcopy(table), sorted(parse_case(table).mesh.build().edges)
    result.setdefault("instruments", []).append(
        {"kind": "load_cell", "name": "added", "edge": edges[0], "interval": table["duration"] / 7}
    )
    return Changed(result, tolerance=0.0, observed=lambda run: {k: v for k, v in run.items() if ":added/" not in k})


@transformation()
def more_checkpoints(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    result["output"] |= {"checkpoint_steps": 3}
    return Changed(result, tolerance=0.0)


# -- a run in parts ----------------------------------------------------------------------------------------------------


@transformation()
def stopped_and_resumed(table: Table, rng: np.random.Generator) -> Changed:
    """A run that is stopped after some steps goes on from its checkpoint."""
    result = copy.deepcopy(table)
    result["output"] |= {"checkpoint_steps": int(rng.integers(2, 5))}
    return Changed(result, tolerance=0.0, run=_in_two)


def _in_two(table: Table, out: Path) -> None:
    run(table, out)
    (out / "summary.json").unlink()
    shutil.rmtree(out / "checkpoints" / "final", ignore_errors=True)
    simulate(parse_case(table), out, progress=False, resume=True)


@transformation(lambda table: table["stepper"]["kind"] == "leapfrog" and not table.get("stages")
                and not any("history" in each for each in loads(table)))  # fmt: skip
def extended(table: Table, rng: np.random.Generator) -> Changed:
    """A shorter run goes on until the end of the longer one; steps that follow their error end with the run."""
    short = table["duration"] * rng.uniform(0.3, 0.7)

    def extend(table: Table, out: Path) -> None:
        run({**table, "duration": short}, out)
        result = CliRunner().invoke(app, ["resume", str(out), "--duration", f"{table['duration']!r} s", "--quiet"])
        assert result.exit_code == 0, result.output

    return Changed(table, tolerance=0.0, run=extend)


# Not of sliding contact: its many steps take minutes where ranks that wait busily share cores; tests/mpi has it.
@transformation(lambda table: not any("sliding" in fault for fault in table["faults"].values()))
def on_two_ranks(table: Table, rng: np.random.Generator) -> Changed:
    def whole(run: Run) -> Run:
        """Snapshots have a file for each rank, in an order of its own; tests/mpi compares them."""
        return {name: data for name, data in run.items() if not name.startswith("bulk")}

    return Changed(table, whole, 1e-8, whole, run=lambda table, out: _on_ranks(2, table, out))


def _on_ranks(ranks: int, table: Table, out: Path) -> None:
    run_on(ranks, write(out.parent, table), out)


@transformation(lambda table: table["stepper"]["kind"] == "leapfrog" and is_plain(table)
                and bool(table.get("boundaries"))
                and not any("history" in b or b["kind"] == "moved" for b in loads(table)))  # fmt: skip
def a_stage_in_two(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    boundaries, first = result.pop("boundaries"), 0.5 * result["duration"]
    result["stages"] = [
        {"duration": each, "boundaries": boundaries} for each in (first, result["duration"] - first)
    ]  # fmt: skip
    return Changed(result, tolerance=1e-9, ignored=("rupture_time",))


# -- the same bodies elsewhere -----------------------------------------------------------------------------------------

PLUGIN = str(Path(__file__).parents[1] / "helpers" / "moved_mesh.py")
ALONG = ("slip", "slip_rate", "shear_traction", "displacement_jump", "cohesive_slip")
"""Numbers along the tangent of an interface, which a reflection turns round."""


def _moved(table: Table, matrix: np.ndarray, offset: np.ndarray, **keys: Any) -> Table:
    """Return a case on the mapped mesh."""
    result = copy.deepcopy(table)
    for boundary in loads(result):
        if boundary["kind"] == "driven":
            old = "xy".index(boundary["component"])
            new = int(np.argmax(np.abs(matrix[:, old])))
            boundary |= {"component": "xy"[new], "velocity": boundary["velocity"] * float(matrix[new, old])}
        if boundary["kind"] == "traction":
            boundary["traction"] = (matrix @ boundary["traction"]).tolist()
        ranges = {"x_range": boundary.pop("x_range", None), "y_range": boundary.pop("y_range", None)}
        for old, limits in enumerate(ranges.values()):
            if limits is not None:
                new = int(np.argmax(np.abs(matrix[:, old])))
                boundary["xy"[new] + "_range"] = sorted(float(matrix[new, old] * v + offset[new]) for v in limits)
    for material in result["materials"].values():
        if material["kind"] == "orthotropic_elastic":  # directions of fibres
            turn = float(np.arctan2(matrix[1, 0], matrix[0, 0]))
            material["angle"] = material.get("angle", 0.0) * float(np.linalg.det(matrix)) + turn
    for body, velocity in result.get("initial_velocity", {}).items():
        result["initial_velocity"][body] = (matrix @ velocity).tolist()
    result.pop("positions", None)
    result["instruments"] = []
    result["plugins"] = [PLUGIN]
    result["mesh"] = {"kind": "moved_mesh", "source": table["mesh"], "matrix": matrix.tolist(),
                      "offset": offset.tolist(), **keys}  # fmt: skip
    return result


def _placed(run: Run, matrix: np.ndarray, offset: np.ndarray) -> Run:
    """Return the numbers of a run as they are after a motion, in an order that does not depend on the numbering."""
    result = {name: data for name, data in run.items() if not name.startswith("instruments")}

    def put(name: str, values: np.ndarray) -> None:
        result[name] = Data(values, result[name].unit)

    for name in list(result):
        base = name.removesuffix("x")
        if name.endswith(("_x", ":x")) and base + "y" in result:
            pair = np.stack([result[base + "x"].values, result[base + "y"].values], axis=-1) @ matrix.T
            is_place = name.endswith((":x", ":deformed_x", ":paired_x"))
            pair = pair + offset if is_place else pair
            put(base + "x", pair[..., 0])
            put(base + "y", pair[..., 1])
    for name in ("bulk.h5:displacement", "bulk.h5:velocity", "bulk.h5:points", "cracks.h5:points", "cracks.h5:normal"):
        if name in result:
            put(name, result[name].values[..., :2] @ matrix.T + offset * name.endswith("points"))
    if "bulk.h5:stress" in result:
        xx, yy, xy = np.moveaxis(result["bulk.h5:stress"].values, -1, 0)
        turned = matrix @ np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2) @ matrix.T
        put("bulk.h5:stress", np.stack([turned[..., 0, 0], turned[..., 1, 1], turned[..., 0, 1]], -1))
    if np.linalg.det(matrix) < 0:
        for name in result:
            if name.startswith("interface") and name.partition(":")[2] in ALONG:
                put(name, -result[name].values)
    return _ordered(result)


def _ordered(run: Run) -> Run:
    """Return the numbers of points by the place of the points; what only numbers them is left out."""
    result = dict(run)
    for file in {name.partition(":")[0] for name in run}:
        if file.startswith("interface"):
            places = np.stack([run[f"{file}:{axis}"].values for axis in "xy"], axis=1)
        elif file == "bulk.h5":
            places = np.column_stack([run["bulk.h5:points"].values, run["bulk.h5:body"].values])
        else:
            continue
        grid = np.round(places / (1e-6 * np.ptp(places[:, :2], axis=0).max()))
        if len(np.unique(grid, axis=0)) < len(grid):  # cells have nodes of their own
            result = {name: data for name, data in result.items() if not name.startswith("bulk.h5")}
            continue
        order = np.lexsort(grid.T[::-1])
        for name, data in run.items():
            shape = np.shape(data.values)
            if name.startswith(f"{file}:") and len(places) in shape:
                result[name] = Data(np.take(data.values, order, axis=shape.index(len(places))), data.unit)
    numbers = ("bulk.h5:cells", "bulk.h5:body_of_cell", "interface.h5:position", "interface.h5:paired_position")
    specimen = [f"summary.json:{name}" for name in UNITS_OF_FRACTURE if name != "failed_length"]
    left_out = {*numbers, *specimen, "summary.json:first_peak_strain"}  # of the mesh kind `specimen` only
    left_out |= {name for name in result if name.startswith(("cracks.h5", "events.h5"))}
    return {name: data for name, data in result.items() if name not in left_out}


def _placement(matrix: list[list[float]], **keys: Any) -> tuple[Needs, Transformation]:
    turn, still = np.array(matrix), np.zeros(2)

    def change(table: Table, rng: np.random.Generator) -> Changed:
        case = _moved(table, turn, still, **keys)
        return Changed(case, lambda run: _placed(run, turn, still), 1e-8, lambda run: _placed(run, np.eye(2), still))

    return can_move, change


ONE = [[1.0, 0.0], [0.0, 1.0]]
TRANSFORMATIONS |= {
    "renumbered": _placement(ONE, seed=5),
    "exchanged_sides": _placement(ONE, exchanged=True),
    "half_a_turn": _placement([[-1.0, 0.0], [0.0, -1.0]]),
    "a_quarter_turn": _placement([[0.0, -1.0], [1.0, 0.0]]),
    "mirrored": _placement([[-1.0, 0.0], [0.0, 1.0]]),
    "upside_down": _placement([[1.0, 0.0], [0.0, -1.0]]),
}


@transformation(can_move)
def far_away(table: Table, rng: np.random.Generator) -> Changed:
    """Translated by ten thousand times the size of the bodies, as coordinates of maps are."""
    offset = np.ptp(parse_case(table).mesh.build().points, axis=0).max() * np.array([1e4, -7e3])
    still = np.zeros(2)
    # Coordinates keep 12 digits of the size of the bodies.
    return Changed(_moved(table, np.eye(2), offset), lambda run: _placed(run, np.eye(2), still), 1e-6,
                   lambda run: _placed(run, np.eye(2), -offset))  # fmt: skip


# -- another dimension, another half -----------------------------------------------------------------------------------


@transformation(lambda table: table["plane"] == "strain" and is_plain(table) and bool(faults(table))
                and not table.get("stages")
                and table["mesh"]["kind"] in ("two_plates", "half_plate", "branched_fault")
                and all(b["kind"] in ("driven", "absorbing") for b in loads(table)))
def extruded(table: Table, rng: np.random.Generator) -> Changed:
    """Plane strain is a solid whose faces do not move along z."""
    result = copy.deepcopy(table)
    mesh = parse_case(table).mesh.build()
    result |= {"plane": "solid", "instruments": []}
    result["mesh"] = {"kind": "extruded", "section": table["mesh"], "thickness": 1.0, "layers": 1}
    result["output"].pop("plate_thickness", None)
    for material in result["materials"].values():
        material.pop("fringe_constant", None)
    result["boundaries"] += [
        {"kind": "driven", "edge": f"{body}.{face}", "component": "z", "velocity": 0.0}
        for body in mesh.bodies for face in ("front", "back")
    ]  # fmt: skip
    names = ("slip", "slip_rate", "shear_traction", "displacement_jump")

    def section(run: Run) -> Run:
        """Return energies, and the interface at z = 0 with the names of the plane."""
        here = run.get("interface.h5:z")
        kept = {name: Data(data.values, "J") for name, data in run.items() if name.startswith("energy.csv")}
        for name in (*names, "normal_stress", "opening", "x", "time"):
            full = f"interface.h5:{name}{'_1' if here is not None and name in names else ''}"
            values = run[full].values
            if here is not None and name != "time":
                values = values[..., np.abs(here.values) < 1e-9]
            kept[f"interface.h5:{name}"] = Data(values, run[full].unit)
        order = np.argsort(kept["interface.h5:x"].values)
        return {
            name: Data(data.values[..., order], data.unit) if name.startswith("interface") and not name.endswith("time")
            else data for name, data in kept.items()
        }  # fmt: skip

    return Changed(result, section, 1e-7, section)


@transformation(lambda table: table["mesh"]["kind"] == "half_plate" and table["mesh"]["symmetry"] == "antisymmetric"
                and all(b["kind"] == "absorbing" for b in loads(table)) and {*table["materials"]} == {"default"}
                and "thickness" not in table["damping"].get("kelvin_voigt", {}))
def a_whole_for_a_half(table: Table, rng: np.random.Generator) -> Changed:
    """Two plates that shear each other move antisymmetrically: half of the motion of the whole is not meshed."""
    result = copy.deepcopy(table)
    del result["mesh"]["symmetry"]
    result["mesh"]["kind"] = "two_plates"
    result["boundaries"] += [
        {**each, "edge": each["edge"].replace("upper", "lower").replace("top", "bottom")}
        for each in result["boundaries"]
    ]  # fmt: skip
    return Changed(result, lambda run: {k: v for k, v in run.items() if k.startswith("interface")}, 1e-8,
                   lambda run: {k: v for k, v in run.items() if k.startswith("interface")})  # fmt: skip


@transformation(lambda table: table["plane"] == "antiplane" and not any(b.get("velocity") for b in loads(table))
                and all(isinstance(f["initial_stress"].get("shear"), float) for f in faults(table)))
def the_other_sense(table: Table, rng: np.random.Generator) -> Changed:
    """Antiplane motion with the opposite sign."""
    result = copy.deepcopy(table)
    for fault in faults(result):
        fault["initial_stress"]["shear"] *= -1
        for each in fault["nucleation"]:
            extra = each.get("extra")
            for node, keys in ((each, ["extra"]), (extra if isinstance(extra, dict) else {}, ["inside", "outside"])):
                node.update({key: -node[key] for key in keys if isinstance(node.get(key), float)})
    signed = ("velocity", "displacement", "stress", *ALONG)

    def turned(run: Run) -> Run:
        return {
            name: Data(-data.values, data.unit) if name.partition(":")[2].split("/")[-1].removesuffix("_z") in signed
            else data for name, data in run.items()
        }  # fmt: skip

    return Changed(result, turned, 1e-12)


# -- the runs ----------------------------------------------------------------------------------------------------------


OPEN: dict[tuple[str, str], str] = {}
"""Pairs that are known to differ, and why."""


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Run]:
    """The run of a coarse demo, made once."""

    @cache
    def original(name: str) -> Run:
        out = tmp_path_factory.mktemp(name) / "run"
        run(coarse(name), out)
        return read(out, coarse(name)["plane"])

    return original


def _rank(pair: tuple[str, str]) -> str:
    """Return a key that puts pairs into an arbitrary order that stays."""
    return hashlib.sha256(" ".join(pair).encode()).hexdigest()


def _pairs() -> Iterator[Any]:
    """Yield all pairs of a demo and a transformation that applies to it, those outside of the selection as slow."""
    pairs = [(demo, name) for demo in names() for name, (needs, _) in TRANSFORMATIONS.items() if needs(resolved(demo))]
    chosen = set[tuple[str, str]]()
    for index, least in enumerate((FEWEST_OF_A_DEMO, FEWEST_DEMOS)):
        for each in dict.fromkeys(pair[index] for pair in pairs):
            chosen |= {*sorted((pair for pair in pairs if pair[index] == each), key=_rank)[:least]}
    for pair in pairs:
        marks = [] if pair in chosen else [pytest.mark.slow]
        if pair in OPEN:
            marks.append(pytest.mark.xfail(reason=OPEN[pair], strict=True))
        yield pytest.param(*pair, marks=marks, id="-".join(pair))


@pytest.mark.parametrize("demo, name", _pairs())
def test_invariance(demo: str, name: str, original: Callable[[str], Run], tmp_path: Path) -> None:
    rng = np.random.default_rng([RANDOM, int(_rank((demo, name))[:8], 16)])
    changed = TRANSFORMATIONS[name][1](copy.deepcopy(coarse(demo)), rng)
    changed.run(changed.case, tmp_path / "run")
    actual = changed.observed(read(tmp_path / "run", changed.case["plane"]))
    expected = changed.expected(original(demo))
    lines = list(differences(expected, actual, changed.tolerance, lambda each: each.endswith(changed.ignored)))
    assert not lines, "\n".join(lines)
