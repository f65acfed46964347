"""Half models against the whole ones, in all that a run gives, and what has no half model."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from helpers.small_cases import SPLIT, merged, plates, strike_slip
from typer.testing import CliRunner

pytest.importorskip("dolfinx")

from helpers.messages import facts

from ruptfx.app.checks.preflight import preflight
from ruptfx.app.cli import app
from ruptfx.case import parse_case
from ruptfx.input.schema import CaseError
from ruptfx.results.record import Record
from ruptfx.run.model import Model
from ruptfx.run.simulation import simulate

pytestmark = pytest.mark.fem

OF_THE_MESH = {"case_hash", "nodes", "node_updates_per_second", "wall_time", "ranks", "title"}
COSTS = ("nodes", "memory", "files", "expected run time", "time of a step", "generalized Rayleigh speed",
         "minus", "lower")  # fmt: skip
GAUGE = {"kind": "strain_gauge", "name": "gauge", "angles": [0.0, 0.7], "length": 5e-4, "interval": 2e-7}
PATCH = {"kind": "boxcar", "inside": 3.7e6, "outside": 2.8e6, "center": 6e-3, "half_width": 2e-3}
DAMPED = {"damping": {"kelvin_voigt": {"fraction": 0.2}, "mass": 1e4}}
REST = [{"kind": "driven", "edge": "plus.plane", "component": each, "velocity": 0.0} for each in "xz"]


class Pair(NamedTuple):
    whole: dict[str, Any]
    half: dict[str, Any]


def boundaries(bodies: dict[str, tuple[str, ...]]) -> list[dict[str, Any]]:
    return [{"kind": "absorbing", "edge": f"{body}.{side}"} for body, sides in bodies.items() for side in sides]


def box() -> Pair:
    ends = ("left", "right", "bottom", "far")
    table = strike_slip({
        **DAMPED, "duration": 2e-6, "stepper": {"kind": "leapfrog", "time_step": 5e-8}, "mesh.fault_top": 1e-3,
        "faults.main.friction.D_c": 5e-7, "output": {"bulk_interval": 1e-6},
    })  # fmt: skip
    table["instruments"] = [
        {"kind": "receiver", "name": "off", "point": [1e-3, 1.3e-3, -1e-3], "interval": 2e-7},
        {"kind": "fault_receiver", "name": "on", "point": [1e-3, 0.0, -3e-3], "interval": 2e-7},
        {"kind": "load_cell", "name": "cell", "edge": "plus.far", "interval": 2e-7},
        {**GAUGE, "point": [-1e-3, 1e-3, -1e-3]},
        {"kind": "receiver_grid", "name": "grid", "corner": [-2e-3, 1e-3, 0.0], "opposite": [2e-3, 2e-3, 0.0],
         "spacing": 1e-3, "interval": 5e-7},
    ]  # fmt: skip
    half = merged(table, {"mesh.half": True, "boundaries": boundaries({"plus": ends}) + REST})
    return Pair({**table, "boundaries": boundaries({"plus": ends, "minus": ends})}, half)


def plate(symmetry: str) -> Pair:
    table = plates({
        **DAMPED, "duration": 4e-6, "order": 3, "stepper": {"kind": "leapfrog", "time_step": 5e-8},
        "faults.main.contact": SPLIT, "output": {"bulk_interval": 2e-6},
        "faults.main.friction": {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 1e-6},
    })  # fmt: skip
    ends = boundaries({"upper": ("left", "right")}), boundaries({"lower": ("left", "right")})
    if symmetry == "antisymmetric":
        table["faults"]["main"]["initial_stress"]["shear"] = PATCH
        push = ([0.5e6, 0.0], [-0.5e6, 0.0])
    else:
        push = ([0.0, 9e6], [0.0, -9e6])
    upper, lower = (
        [{"kind": "traction", "edge": edge, "traction": traction, "ramp": 1e-6}]
        for edge, traction in zip(("upper.top", "lower.bottom"), push, strict=True)
    )
    table["instruments"] = [
        {"kind": "receiver", "name": "off", "point": [5e-3, 1.3e-3], "interval": 2e-7},
        {"kind": "fault_receiver", "name": "on", "position": 5.3e-3, "interval": 2e-7},
        {"kind": "load_cell", "name": "cell", "edge": "upper.top", "interval": 2e-7},
        {**GAUGE, "point": [7e-3, 1e-3]},
    ]
    half = merged(table, {"mesh.kind": "half_plate", "mesh.symmetry": symmetry, "boundaries": ends[0] + upper})
    return Pair({**table, "boundaries": [*ends[0], *ends[1], *upper, *lower]}, half)


PAIRS = {"box": box, "antisymmetric": lambda: plate("antisymmetric"), "symmetric": lambda: plate("symmetric")}


@pytest.fixture(scope="module", params=[
    pytest.param(name, marks=() if name == "antisymmetric" else pytest.mark.slow) for name in PAIRS
])  # fmt: skip
def runs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Pair, Path]:
    pair, folder = PAIRS[request.param](), tmp_path_factory.mktemp(request.param)
    for name, table in pair._asdict().items():
        simulate(parse_case(table), folder / name, progress=False)
    return pair, folder


def same(one: Any, other: Any, slack: float = 1e-9, scale: float = 0.0) -> bool:
    """Return whether numbers agree, by the largest of an array or by a scale, or other values are equal."""
    one, other = np.asarray(one), np.asarray(other)
    if one.dtype.kind not in "fi" or other.dtype.kind not in "fi":
        return bool(np.array_equal(one, other))
    if one.shape != other.shape or not np.array_equal(np.isfinite(one), np.isfinite(other)):
        return False
    known = np.isfinite(one)
    return bool(np.all(np.abs(one - other)[known] <= slack * np.abs(one[known]).max(initial=max(scale, 1e-200))))


def test_summaries_agree(runs: tuple[Pair, Path]) -> None:
    whole, half = (Record(runs[1] / name).summary for name in Pair._fields)
    assert set(whole) == set(half)
    small = {"energy_closure": 1e-9}  # rounding, of the work
    small |= {"max_slip": 1e-15, "max_opening": 1e-15}
    others = {
        name: (whole[name], half[name]) for name in set(whole) - OF_THE_MESH
        if not same(whole[name], half[name]) and not max(abs(whole[name]), abs(half[name])) < small.get(name, 0.0)
    }  # fmt: skip
    assert not others


def test_records_and_instruments_agree(runs: tuple[Pair, Path]) -> None:
    whole, half = (Record(runs[1] / name) for name in Pair._fields)
    tables = {"interface": (whole.interface, half.interface), "energy": (whole.energy, half.energy)}
    tables |= {name: (whole.instruments[name], half.instruments[name]) for name in whole.instruments}
    size = np.abs(whole.energy["boundary_work"]).max().item()
    others = set()
    for table, (one, other) in tables.items():
        assert set(one) == set(other), table
        scale = {"m": 1e-6, "m/s": 1e-1, "Pa": 1e6}  # one component of a vector may be rounding
        for name in one:
            unit = str(one[name].attrs.get("units"))
            if one[name].dtype.kind == "f":
                largest = float(np.nanmax(np.abs(one[name].values), initial=0.0))
                scale[unit] = max(scale.get(unit, 0.0), largest)
        for name in one:
            if table == "energy" and name != "closure":  # some energies are rounding of the others
                assert np.abs(one[name] - other[name]).max() <= 1e-9 * size, name
            elif name != "closure" and not same(
                one[name].values, other[name].values, 1e-8, scale.get(str(one[name].attrs.get("units")), 0.0)
            ):
                others.add((table, name))
    assert not others
    assert set(whole.instruments) == set(half.instruments) != set()


def test_snapshots_agree_in_the_half(runs: tuple[Pair, Path]) -> None:
    """Nodes of the half; stresses at welded nodes of the plane are means over both sides in the whole only."""
    whole, half = (Record(runs[1] / name).bulk for name in Pair._fields)
    number = [str(name) for name in whole.attrs["bodies"]].index(str(np.atleast_1d(half.attrs["bodies"])[0]))
    own = np.unique(whole["cells"].values[whole["body_of_cell"].values == number])
    points = whole["points"].values[own]
    order = own[np.lexsort(np.round(points.T, 9))], np.lexsort(np.round(half["points"].values.T, 9))
    above = points[np.lexsort(np.round(points.T, 9))][:, 1] > 1e-9
    for name in ("velocity", "displacement", "stress"):
        one, other = whole[name].values[:, order[0]], half[name].values[:, order[1]]
        chosen = above if name == "stress" else np.full(len(above), True)
        assert same(one[:, chosen], other[:, chosen], 1e-8), name


def test_exports_and_figures_agree(runs: tuple[Pair, Path], tmp_path: Path) -> None:
    exported = {}
    for name in Pair._fields:
        arguments = ["export", runs[1] / name, "--format", "csv", "--out", tmp_path / name]
        done = CliRunner().invoke(app, list(map(str, arguments)))
        assert done.exit_code == 0, done.output
        exported[name] = {path.name: path for path in (tmp_path / name).glob("*.csv")}
    assert set(exported["whole"]) == set(exported["half"]) != set()
    for name, path in exported["whole"].items():
        one, other = (
            np.genfromtxt(each, delimiter=",", comments="#", skip_header=1) for each in (path, exported["half"][name])
        )
        assert same(one, other, 1e-6, 1e6 if "traction" in name else 0.0), name
    figures = [{path.name for path in Record(runs[1] / name).figures} for name in Pair._fields]
    if np.abs(Record(runs[1] / "half").interface["opening"].values).max() > 1e-9:  # slip of the whole is rounding
        figures[0] -= {"space_time.png", "slip_profiles.png"}
    assert figures[0] == figures[1] != set()


def test_checks_agree(runs: tuple[Pair, Path]) -> None:
    whole, half = (
        {row.quantity: row for row in preflight(parse_case(table)) if not row.quantity.startswith(COSTS)}
        for table in runs[0]
    )
    assert set(whole) == set(half)
    for name, row in whole.items():
        # The whole has modes with other symmetry, too.
        slack = 1e-3 if name == "stable time step" else 1e-9
        assert row.verdict == half[name].verdict and same(row.value, half[name].value, slack), name


@pytest.mark.parametrize("symmetry, changes, message", [
    ("antisymmetric", {"plane": "strain", "materials.default": {
        "kind": "von_mises", "young_modulus": 5e9, "poisson_ratio": 0.3, "density": 1200.0, "yield_stress": 5e7,
        "relaxation_time": 1e-8,
    }}, r"materials\.upper\.kind = 'von_mises'"),
    ("symmetric", {"materials.default": {
        "kind": "orthotropic_elastic", "density": 1500.0, "E_1": 1e11, "E_2": 1e10, "E_3": 1e10, "nu_12": 0.3,
        "nu_13": 0.3, "nu_23": 0.4, "G_12": 5e9, "G_13": 5e9, "G_23": 4e9, "angle": 20.0,
    }}, r"materials\.upper\.kind = 'orthotropic_elastic'"),
    ("antisymmetric", {"boundaries": [{"kind": "gravity", "acceleration": [1.0, -9.81]}]},
     r"boundaries\.0\.acceleration = .*-9\.81"),
    ("symmetric", {"boundaries": [{"kind": "gravity", "acceleration": [0.0, -9.81]}]},
     r"boundaries\.0\.acceleration = .*-9\.81"),
])  # fmt: skip
def test_what_has_no_mirror_image_is_refused(symmetry: str, changes: dict[str, Any], message: str) -> None:
    """The same is accepted in the whole, and gravity along the direction that both halves share in the half."""
    pair = plate(symmetry)
    with pytest.raises(CaseError, match=facts(message)):
        Model(parse_case(merged(pair.half, {"damping": None, **changes})))
    Model(parse_case(merged(pair.whole, {"damping": None, "boundaries": [], **changes})))
    across = [0.0, -9.81] if symmetry == "antisymmetric" else [-9.81, 0.0]
    Model(parse_case(merged(pair.half, {"boundaries": [{"kind": "gravity", "acceleration": across}]})))
