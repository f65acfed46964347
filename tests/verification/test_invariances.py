"""Invariances of whole runs: every demo, coarse and short, changed in a way whose effect on all numbers is known.

A transformation returns another case, and what must become of the numbers of the run. Some begin with a case made of
the demo, on which any direction can act. The default selection, a minute on a core, has each transformation and each
demo once; that of `-m slow` has transformations on two demos and demos under three; `-m pairs` runs all other pairs.
"""

from __future__ import annotations

import copy
import hashlib
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.coarse_demos import coarse, names, resolved
from helpers.moved_cases import ALONG, faults, loads, moved, on_mesh, ordered, placed
from helpers.moved_mesh import SECOND
from helpers.plain_cases import has_profiles, uniform
from helpers.run_data import Data, Run, differences, read
from helpers.scaled_cases import mapped, unit_factor
from helpers.whole_runs import run_on, write
from typer.testing import CliRunner

from ruptfx.app.cli import app
from ruptfx.case import Case, parse_case
from ruptfx.input.quantities import factor

pytest.importorskip("dolfinx")

from ruptfx.results.summary_fields import UNITS_OF_FRACTURE
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

Table = dict[str, Any]
Map = Callable[[Run], Run]
RANDOM = 20261128
FEWEST = {"default": (1, 1), "slow": (3, 2)}
"""Transformations of a demo, and demos of a transformation, in each selection."""

COSTLY = ("gmsh", "branch_3d", "strike_slip_3d", "composite_impact", "seismic_cycles", "fibre_pull_out")
"""Demos that the default selection has no more often than it has to."""

LONG = (("composite_impact", "extruded"), ("slip_sequence", "keys_in_another_order"), ("gmsh", "far_away"),
        ("stress_barrier", "on_two_ranks"), ("viscoelastic_impact", "exchanged_sides"))  # fmt: skip
"""Pairs of the default selection that need seconds: they are in the slow one."""


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
Base = Callable[[Table], Table]
TRANSFORMATIONS: dict[str, tuple[Needs, Transformation, Base]] = {}
"""By name: whether one applies to a resolved case, the change itself, and what becomes of the coarse case before it."""


def unchanged(table: Table) -> Table:
    return table


def transformation(
    needs: Needs = lambda table: True, base: Base = unchanged
) -> Callable[[Transformation], Transformation]:
    def add(function: Transformation) -> Transformation:
        TRANSFORMATIONS[function.__name__] = needs, function, base
        return function

    return add


# -- what transformations need -----------------------------------------------------------------------------------------


def has_own_steps(table: Table) -> bool:
    """Steps are given; others are rounded to three digits."""
    return table["stepper"]["kind"] not in ("hybrid", "quasi_static")


def watched(table: Table) -> float:
    """Tolerance of runs whose bodies are asked for more often: slow steps leave them out between, to rounding."""
    return 1e-6 if table["stepper"]["kind"] in ("hybrid", "quasi_static") else 0.0


def scales_with_keys(table: Table) -> bool:
    """The mesh is that of the keys; Gmsh makes another one of other lengths, and reads those of a file."""
    mesh = table["mesh"].get("section", table["mesh"])
    return mesh["kind"] not in ("gmsh_file", "specimen", "pieces", "branched_fault")


def is_plain(table: Table) -> bool:
    """Interfaces have neither profiles nor nucleations nor finite sliding."""
    return not any(has_profiles(f) or f["nucleation"] or "sliding" in f for f in faults(table))


def can_move(table: Table) -> bool:
    """Directions and places of a plane case are mapped by `moved`."""
    kinds = {"driven": {"kind", "edge", "component", "velocity", "ramp"}, "absorbing": None,
             "traction": {"kind", "edge", "traction", "ramp", "x_range", "y_range", "history"}}  # fmt: skip
    return (
        table["plane"] in ("strain", "stress") and is_plain(table) and not has_profiles(table["materials"])
        and not table.get("initial_stress") and not table.get("attachments")
        and table["mesh"]["kind"] in ("two_plates", "gmsh_file", "inclined_plates", "specimen", "pieces")
        and all(b["kind"] in kinds and not has_profiles(b) for b in loads(table))
    )  # fmt: skip


# -- numbers of a case, with their units -------------------------------------------------------------------------------


def scaled(table: Table, **factors: float) -> Changed:
    """Return a case in which lengths, times and masses are larger by factors."""

    def expected(run: Run) -> Run:
        return {
            name: Data(np.asarray(data.values, float) * unit_factor(data.unit, factors), data.unit)
            if data.unit is not None and not isinstance(data.values, str | None | bool) else data
            for name, data in run.items()
        }  # fmt: skip

    result = mapped(table, lambda number, unit, _: number * unit_factor(unit, factors))
    # Magnitudes are logarithms of energies in J; a text has speeds in m/s.
    return Changed(result, expected, 1e-8, ignored=("magnitude", "aseismic_share", "b_value", "not_resolved"))


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
    """Return a table with its keys reversed, but for the bodies of a mesh, in whose order they are in files."""
    if isinstance(node, dict):
        return {key: node[key] if key == "bodies" else _reversed_keys(node[key]) for key in reversed(node)}
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
    return Changed({**table, "operator": "ufl_form"}, tolerance=1e-8)  # degrees of modes have roots of differences


# -- additions without effect ------------------------------------------------------------------------------------------


UNITS_OF_SPECIMEN = ("first_peak_strain", *(name for name in UNITS_OF_FRACTURE if name != "failed_length"))


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
    of_edge = [f"{edges[0]}.{quantity}_{axis}" for quantity in ("displacement", "force") for axis in "xyz"]
    # An edge of a specimen that was none of its ends before has the stress of the summary.
    return Changed(result, tolerance=1e-12, ignored=(*of_edge, *UNITS_OF_SPECIMEN))


@transformation(lambda table: bool(faults(table)) and not any({"sliding", "cohesion"} & {*f} for f in faults(table)))
def a_nucleation_of_nothing(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    for fault in faults(result):
        fault["nucleation"].append({"kind": "overstress", "extra": 0.0})

    def nonzero(run: Run) -> Run:
        return {name: each for name, each in run.items() if "added_shear" not in name or np.any(each.values)}

    return Changed(result, nonzero, observed=nonzero, tolerance=1e-12)


@transformation(lambda table: table["stepper"]["kind"] == "leapfrog" and not table.get("stages")
                and not any("sliding" in fault for fault in faults(table)))  # fmt: skip
def damping_of_nothing(table: Table, rng: np.random.Generator) -> Changed:
    """Rates and viscosities that change no digit of a velocity in the whole run."""
    result = copy.deepcopy(table)
    result["damping"]["mass"] = result["damping"].get("mass", 0.0) + 1e-18 / table["duration"]
    if "kelvin_voigt" not in result["damping"] and faults(table) and not table.get("fracture"):
        result["damping"]["kelvin_voigt"] = {"eta": 1e-18 * table["stepper"]["time_step"]}
    return Changed(result, tolerance=1e-9)


@transformation(lambda table: not table.get("stages"))
def springs_of_nothing(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    result.setdefault("boundaries", []).append({"kind": "body_spring", "stiffness": 1e-12})
    return Changed(result, tolerance=1e-8)


@transformation(lambda table: not table.get("fracture") and table["plane"] != "axisymmetric")
def more_instruments(table: Table, rng: np.random.Generator) -> Changed:
    result, edges = copy.deepcopy(table), sorted(parse_case(table).mesh.build().edges)
    result.setdefault("instruments", []).append(
        {"kind": "load_cell", "name": "added", "edge": edges[0], "interval": table["duration"] / 7}
    )
    kept = lambda run: {k: v for k, v in run.items() if ":added/" not in k}  # noqa: E731
    return Changed(result, tolerance=watched(table), observed=kept)


@transformation()
def more_checkpoints(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    result["output"] |= {"checkpoint_steps": 3}
    return Changed(result, tolerance=watched(table))


# -- a run in parts ----------------------------------------------------------------------------------------------------


@transformation()
def stopped_and_resumed(table: Table, rng: np.random.Generator) -> Changed:
    """A run that is stopped after some steps goes on from its checkpoint."""
    result = copy.deepcopy(table)
    result["output"] |= {"checkpoint_steps": int(rng.integers(2, 5))}
    return Changed(result, tolerance=watched(table), run=_in_two)


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


def placement(table: Table, turn: np.ndarray, offset: np.ndarray, tolerance: float = 1e-8, **keys: Any) -> Changed:
    """Return a case on a mapped mesh."""
    still = np.zeros(len(turn))
    return Changed(moved(table, turn, offset, **keys), lambda run: placed(run, turn, still), tolerance,
                   lambda run: placed(run, np.eye(len(turn)), -offset))  # fmt: skip


def _placement(
    matrix: list[list[float]], needs: Needs = can_move, base: Base = unchanged, **keys: Any
) -> tuple[Needs, Transformation, Base]:
    turn = np.array(matrix)
    return needs, lambda table, rng: placement(table, turn, np.zeros(len(turn)), **keys), base


ONE = [[1.0, 0.0], [0.0, 1.0]]
TRANSFORMATIONS |= {
    "renumbered": _placement(ONE, seed=5),
    "exchanged_sides": _placement(ONE, exchanged=True),
    "half_a_turn": _placement([[-1.0, 0.0], [0.0, -1.0]]),
    "a_quarter_turn": _placement([[0.0, -1.0], [1.0, 0.0]]),
    "mirrored": _placement([[-1.0, 0.0], [0.0, 1.0]]),
    "upside_down": _placement([[1.0, 0.0], [0.0, -1.0]]),
}


def can_turn(table: Table, dimensions: int) -> bool:
    """Interfaces of its plain case slip by a force in the bodies, and its mesh can be mapped."""
    return (
        table["stepper"]["kind"] == "leapfrog" and bool(faults(table)) and not table.get("fracture")
        and not any({"sliding", "cohesion"} & {*fault} for fault in faults(table))
        and not has_profiles(table["materials"])
        and table["plane"] in {2: ("strain", "stress"), 3: ("solid",)}[dimensions]
        and table["mesh"]["kind"] not in ("half_plate", "block_on_rigid") and not table["mesh"].get("half")
        and (dimensions == 2 or table["materials"].get("default", {}).get("kind") == "isotropic_elastic")
    )  # fmt: skip


def _about(axis: int, angle: float) -> np.ndarray:
    """Return the matrix of a rotation about an axis in three dimensions."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.eye(3)
    turn[np.ix_(*2 * [[(axis + 1) % 3, (axis + 2) % 3]])] = [[c, -s], [s, c]]
    return turn


for number, axis in enumerate("xyz"):
    quarter = np.round(_about(number, np.pi / 2)).tolist()
    TRANSFORMATIONS[f"a_quarter_turn_about_{axis}"] = _placement(quarter, lambda table: can_turn(table, 3), uniform)
    TRANSFORMATIONS[f"mirrored_along_{axis}"] = _placement(
        np.diag(1 - 2 * np.eye(3)[number]).tolist(), lambda table: can_turn(table, 3), uniform
    )


@transformation(lambda table: can_turn(table, 2), uniform)
def turned_by_any_angle(table: Table, rng: np.random.Generator) -> Changed:
    c, s = np.cos(angle := rng.uniform(0, 2 * np.pi)), np.sin(angle)
    return placement(table, np.array([[c, -s], [s, c]]), np.zeros(2))


@transformation(lambda table: can_turn(table, 3), uniform)
def turned_about_any_axis(table: Table, rng: np.random.Generator) -> Changed:
    turn = np.linalg.multi_dot([_about(axis, rng.uniform(0, 2 * np.pi)) for axis in range(3)])
    return placement(table, turn, np.zeros(3))


@transformation(can_move)
def far_away(table: Table, rng: np.random.Generator) -> Changed:
    """Translated by ten thousand times the size of the bodies, as coordinates of maps are."""
    offset = np.ptp(parse_case(table).mesh.build().points, axis=0).max() * np.array([1e4, -7e3])
    # Coordinates keep 12 digits of the size of the bodies.
    return placement(table, np.eye(2), offset, 1e-6)


KILOMETRE = 1e3


@transformation(lambda table: can_turn(table, 2) or can_turn(table, 3), uniform)
def in_coordinates_of_a_map(table: Table, rng: np.random.Generator) -> Changed:
    """Eastings and northings of a zone of UTM, for bodies of a kilometre and more; others are as far by their size."""
    points = parse_case(table).mesh.build().points
    offset = np.array([5e5, 4e6, 0.0])[: points.shape[1]] * min(1.0, float(np.ptp(points, axis=0).max()) / KILOMETRE)
    return placement(table, np.eye(points.shape[1]), offset, 1e-6)


# -- bodies, interfaces and loads in parts -----------------------------------------------------------------------------


def can_divide(table: Table) -> bool:
    """The mesh may be divided; names of bodies and interfaces are nowhere but in materials and laws."""
    return (
        table["plane"] in ("strain", "stress") and not table.get("fracture") and not table.get("attachments")
        and table["mesh"]["kind"] in ("two_plates", "gmsh_file", "inclined_plates", "branched_fault")
        and not any("sliding" in fault for fault in faults(table)) and not table.get("initial_velocity")
        and not table["damping"].get("kelvin_voigt", {}).get("bodies")
    )  # fmt: skip


@transformation(can_divide)
def bodies_in_two(table: Table, rng: np.random.Generator) -> Changed:
    """Two welded bodies of one material are one."""
    result = on_mesh(table, np.eye(2), np.zeros(2), two_bodies=True)
    result["materials"] |= {f"{name}{SECOND}": each for name, each in table["materials"].items() if name != "default"}
    if "positions" in table:
        result["positions"] = table["positions"]

    def of_places(run: Run) -> Run:
        return ordered({name: data for name, data in run.items()
                        if name != "bulk.h5:body" and not name.startswith("instruments")})  # fmt: skip

    return Changed(result, of_places, 1e-8, of_places)


@transformation(lambda table: can_divide(table) and is_plain(table) and len(faults(table)) == 1)
def interfaces_in_two(table: Table, rng: np.random.Generator) -> Changed:
    """Two adjoining interfaces with the same laws are one."""
    result = on_mesh(table, np.eye(2), np.zeros(2), two_interfaces=True)
    (name,) = result["faults"]
    result["faults"][name + SECOND] = copy.deepcopy(result["faults"][name])

    def joined(run: Run) -> Run:
        """Return the numbers of interfaces as those of one, without scalars that are of one of them."""
        kept = {key: data for key, data in run.items() if not key.startswith(("interface", "summary", "instruments"))}
        fields = {key.partition(":")[2] for key in run if key.startswith("interface")}
        for field in fields:
            parts = [run[key] for key in sorted(run) if key.startswith("interface") and key.endswith(f":{field}")]
            whole = parts[0].values if field == "time" else np.concatenate([each.values for each in parts], axis=-1)
            kept[f"interface.h5:{field}"] = Data(whole, parts[0].unit)
        return ordered(kept)

    return Changed(result, joined, 1e-8, joined)


def _halved(node: Any, keys: tuple[str, ...]) -> Any:
    """Return a table with half of the numbers under some keys, and of the profiles there."""
    if isinstance(node, dict):
        inner = ("inside", "outside", "value", "terms", "values")
        return {key: _halved(each, (key, *inner)) if key in keys else each for key, each in node.items()}
    if isinstance(node, list):
        return [_halved(each, keys) for each in node]
    return 0.5 * node if isinstance(node, float) else node


@transformation(
    lambda table: (
        any(b["kind"] in ("traction", "point_force") for b in table.get("boundaries", []))
        or any(each["kind"] == "overstress" for fault in faults(table) for each in fault["nucleation"])
    )
)
def loads_in_halves(table: Table, rng: np.random.Generator) -> Changed:
    result = copy.deepcopy(table)
    boundaries = result.get("boundaries", [])
    places = [(boundaries, "traction", "traction"), (boundaries, "point_force", "force")]
    places += [(fault["nucleation"], "overstress", "extra") for fault in faults(result)]
    for entries, kind, key in places:
        for each in [each for each in entries if each["kind"] == kind]:
            half = _halved(each, (key,))
            entries.remove(each)
            entries += [half, copy.deepcopy(half)]
    # A rupture makes the rounding of the slow steps before it larger.
    return Changed(result, tolerance=max(Changed.tolerance, watched(table)))


# -- another dimension, another half -----------------------------------------------------------------------------------


@transformation(
    lambda table: (
        table["plane"] == "strain"
        and is_plain(table)
        and bool(faults(table))
        and not table.get("stages")
        and table["mesh"]["kind"] in ("two_plates", "half_plate", "branched_fault")
        and all(b["kind"] in ("driven", "absorbing") for b in loads(table))
    )
)
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


@transformation(
    lambda table: (
        table["mesh"]["kind"] == "half_plate"
        and table["mesh"]["symmetry"] == "antisymmetric"
        and all(b["kind"] == "absorbing" for b in loads(table))
        and {*table["materials"]} == {"default"}
        and "thickness" not in table["damping"].get("kelvin_voigt", {})
    )
)
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


@transformation(
    lambda table: (
        table["plane"] == "antiplane"
        and not any(b.get("velocity") for b in loads(table))
        and all(isinstance(f["initial_stress"].get("shear"), float) for f in faults(table))
    )
)
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


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Base], Run]:
    """The run of a coarse demo, or of a case made of it, made once."""

    @cache
    def original(name: str, base: Base) -> Run:
        out, table = tmp_path_factory.mktemp(name) / "run", base(copy.deepcopy(coarse(name)))
        run(table, out)
        return read(out, table["plane"])

    return original


def _rank(pair: tuple[str, str]) -> str:
    """Return a key that puts pairs into an arbitrary order that stays."""
    return hashlib.sha256(" ".join(pair).encode()).hexdigest()


def _selection(pairs: list[tuple[str, str]], of_a_demo: int, demos: int) -> set[tuple[str, str]]:
    """Return pairs in which every transformation and every demo is as often as it has to be."""
    chosen = set[tuple[str, str]]()
    for index, least in ((1, demos), (0, of_a_demo)):
        for each in dict.fromkeys(pair[index] for pair in pairs):
            own = sorted((pair for pair in pairs if pair[index] == each), key=_rank)
            own.sort(key=lambda pair: pair[0] in COSTLY)
            missing = max(least - len(chosen.intersection(own)), 0)
            chosen |= {*[pair for pair in own if pair not in chosen][:missing]}
    return chosen


def _pairs() -> list[Any]:
    """Return all pairs of a demo and a transformation that applies to it, with the mark of their selection."""
    pairs = [(demo, name) for demo in names() for name, (needs, *_) in TRANSFORMATIONS.items() if needs(resolved(demo))]
    default, slow = (_selection(pairs, *fewest) for fewest in FEWEST.values())
    result = []
    for pair in pairs:
        selected = pair in default and pair not in LONG
        marks = [] if selected else [pytest.mark.slow if pair in {*slow, *LONG} else pytest.mark.pairs]
        result.append(pytest.param(*pair, marks=marks, id="-".join(pair)))
    return result


@pytest.mark.parametrize("demo, name", _pairs())
def test_invariance(demo: str, name: str, original: Callable[[str, Base], Run], tmp_path: Path) -> None:
    rng = np.random.default_rng([RANDOM, int(_rank((demo, name))[:8], 16)])
    _, change, base = TRANSFORMATIONS[name]
    changed = change(base(copy.deepcopy(coarse(demo))), rng)
    changed.run(changed.case, tmp_path / "run")
    actual = changed.observed(read(tmp_path / "run", changed.case["plane"]))
    expected = changed.expected(original(demo, base))
    # Without inertia bodies rest between two equal loads; that is rounding.
    rest = ("bulk.h5:velocity",) if changed.case["stepper"]["kind"] == "quasi_static" else ()
    ignored = (*changed.ignored, *rest)
    lines = list(differences(expected, actual, changed.tolerance, lambda each: each.endswith(ignored)))
    assert not lines, "\n".join(lines)
