"""DESIGN.md and its pages are those of the package; files of demos/plugins do what they show, and fit their folders."""

from __future__ import annotations

import ast
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w
import typer
from helpers import package_tree, synthetic
from helpers.messages import facts
from helpers.small_cases import SPLIT, plates, slip_weakening, unstressed
from typer.testing import CliRunner

import ruptfx
from ruptfx import lumped
from ruptfx.app.bench import run_benchmark
from ruptfx.app.check_law import Report, check_law
from ruptfx.case import parse_case, read_case
from ruptfx.input.schema import CaseError, directory_of
from ruptfx.laws.materials import Plane
from ruptfx.results.record import Record

PACKAGE = Path(ruptfx.__file__).parent
ROOT = PACKAGE.parent
PAGE = (ROOT / "DESIGN.md").read_text(encoding="utf-8")
DEVELOPERS = ROOT / "docs" / "developers"
PLUGINS = ROOT / "demos" / "plugins"
EXAMPLES = {path.stem: path for path in sorted(PLUGINS.glob("*/*.py"))}
NO_FILES = ("monitors",)
"""Kinds that are lines of a list, not files of a folder."""
WEAKENING = {"kind": "hyperbolic_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": 5e-6}


def target(path: Path) -> Path:
    """Return the file of the repository that an example would be, in the folder of its kind."""
    kind = path.parent.name
    folder = Path("tests", kind) if kind == "benchmarks" else directory_of(kind).relative_to(ROOT)
    return folder / path.name


FILES = {name: target(path) for name, path in EXAMPLES.items() if path.parent.name not in NO_FILES}


def in_its_folder(name: str) -> bool:
    """Whether a developer has put the example into its folder."""
    path = ROOT / FILES[name]
    return path.is_file() and path.read_text(encoding="utf-8") == EXAMPLES[name].read_text(encoding="utf-8")


def plug_in(name: str) -> list[str]:
    """Return the example as a list of plug-ins, empty if its kind is known from its folder."""
    return [] if in_its_folder(name) else [str(EXAMPLES[name])]


def checked(name: str) -> Report:
    """Check the law of an example, by its kind if it is in its folder."""
    (file,) = plug_in(name) or [name]
    (report,) = check_law(file)
    return report


def in_a_case(name: str, table: dict[str, Any]) -> Any:
    """The case with the kind of an example."""
    return parse_case({**table, "plugins": [*plug_in(name), *table.get("plugins", [])]})


def executed(name: str) -> dict[str, Any]:
    """What the example defines."""
    return runpy.run_path(str(EXAMPLES[name]))


def run(case: Any, out: Path) -> Record:
    from ruptfx.run.simulation import simulate

    return simulate(case, out, progress=False)


# -- the page --------------------------------------------------------------------------------------------------------


def test_every_example_is_tried_here_and_stands_in_its_table() -> None:
    source = Path(__file__).read_text(encoding="utf-8")
    assert [name for name in EXAMPLES if f'"{name}"' not in source] == []
    page = (ROOT / "docs" / "developers" / "where_to_add.md").read_text(encoding="utf-8")
    rows = {row[1]: row[2] for row in re.finditer(r"^\| .*? \| `([\w/]+)/` \| .*?plugins/(\w+)/", page, re.MULTILINE)}
    assert {kind: folder.removesuffix("/") for folder, kind in rows.items()} == {
        path.parent.name: str(FILES[name].parent).removeprefix("ruptfx/")
        for name, path in EXAMPLES.items() if name in FILES
    }  # fmt: skip


def test_examples_import_from_the_door_only() -> None:
    for path in EXAMPLES.values():
        modules = {node.module for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)}
        assert {name for name in modules if str(name).startswith("ruptfx")} == {"ruptfx.plugin"}, path


def test_the_tree_is_that_of_the_package() -> None:
    """Rooms in the order of their imports, with the first line of every folder and file, and nothing else."""
    assert package_tree.in_page(PAGE) == package_tree.tree(), "renew it: python tests/helpers/package_tree.py"
    there = {path.name for path in PACKAGE.iterdir() if path.name not in ("__pycache__", "demos")}
    there -= {"__init__.py", "__main__.py", "py.typed"}
    assert there == {*package_tree.rooms(), "plugin.py", "plugin.pyi"}
    assert len(package_tree.rooms()) <= 14


def test_no_module_whose_name_begins_with_an_underscore_is_imported_from_another_room() -> None:
    imports = re.compile(r"^\s*(?:from|import) ruptfx\.(\w+)((?:\.\w+)*)(?: import (\w+))?", re.MULTILINE)
    crossing = [
        (str(path.relative_to(PACKAGE)), room, inner, name)
        for path in PACKAGE.rglob("*.py") if PACKAGE / "demos" not in path.parents
        for room, inner, name in imports.findall(path.read_text(encoding="utf-8"))
        if room != path.relative_to(PACKAGE).parts[0] and "._" in f"{inner}.{name}"
    ]  # fmt: skip
    assert crossing == []


@pytest.mark.parametrize("page", ["DESIGN.md", *(f"docs/developers/{path.name}" for path in DEVELOPERS.glob("*.md"))])
def test_files_and_folders_named_in_the_text_exist(page: str) -> None:
    named = re.findall(r"`((?:[a-z_]+/)+(?:[a-z_]+\.(?:py|c|toml))?)`", (ROOT / page).read_text(encoding="utf-8"))
    roots = PACKAGE, ROOT, ROOT / "demos"
    assert [path for path in named if not any((root / path).exists() for root in roots)] == []


def test_drawings_are_those_of_their_script_and_name_what_exists() -> None:
    """Every word after the file of a box is a name in it; every drawing is on the page of its name."""
    script = runpy.run_path(str(ROOT / "docs" / "make_drawings.py"))
    drawings = script["drawings"]()
    for name, rows in drawings.items():
        shown = script["svg"](rows, 10 if name == "where_to_add" else script["GAP"])
        assert (DEVELOPERS / f"{name}.svg").read_text(encoding="utf-8") == shown, "python docs/make_drawings.py"
        assert f"({name}.svg)" in (DEVELOPERS / f"{name}.md").read_text(encoding="utf-8")
        for box in (box for row in rows for box in row if box.fill in ("python", "c")):
            file, _, names = box.where.partition(": ")
            source = (PACKAGE / file).read_text(encoding="utf-8")
            assert [word for word in names.split(", ") if not re.search(rf"\b{word}\b", source)] == [], file
    assert {path.stem for path in DEVELOPERS.glob("*.md")} == {*drawings, "index"}


@pytest.mark.fem
def test_the_way_of_one_number_is_that_of_its_page(tmp_path: Path) -> None:
    """D_c = "12.5 um" is 1.25e-5 m in the law, a symbol of the formula, and one of the numbers that C reads."""
    pytest.importorskip("dolfinx")
    from ruptfx.interfaces.faults.point_code import PointCode
    from ruptfx.run.model import Model

    law = {"kind": "linear_slip_weakening", "mu_s": 0.6, "mu_d": 0.3, "D_c": "12.5 um"}
    (tmp_path / "case.toml").write_text(tomli_w.dumps(slip_weakening({"faults.main.friction": law})))
    case = read_case(tmp_path / "case.toml")
    (fault,) = Model(case).faults
    traced = fault.traced_law()
    (symbol,) = (name for name, value in traced.parameters.items() if value == 12.5e-6)
    code = PointCode(fault, traced, {"owned_area": fault.interface.weight})
    place = list(code.numbers).index(12.5e-6)
    assert symbol.endswith("D_c") and code._symbols()[symbol] == f"number[{place}]"
    seven = [row[0].where for row in runpy.run_path(str(ROOT / "docs" / "make_drawings.py"))["NUMBER"]][1:]
    assert len(seven) == 7 and seven[-1].startswith("interfaces/faults/points.c")


def examples_in_their_folders(root: Path) -> set[str]:
    """Write every example but the lines of lists to the folder of its kind, below a copy of the settings.

    Return their kinds.
    """
    for name, path in FILES.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        assert in_its_folder(name) or not (root / path).exists()
        shutil.copy(EXAMPLES[name], root / path)
    shutil.copy(ROOT / "pyproject.toml", root)
    return {path.stem for path in FILES.values()}


def in_a_copy(root: Path, *folders: str) -> set[str]:
    """Write every example to its folder in a copy of some folders of the repository; return their kinds."""
    for name in folders:
        shutil.copytree(ROOT / name, root / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    return examples_in_their_folders(root)


def python_in(root: Path, *arguments: str, timeout: float) -> subprocess.CompletedProcess[str]:
    """Run Python in a copy of the repository, whose package it imports."""
    return subprocess.run([sys.executable, *arguments], cwd=root, capture_output=True, text=True, timeout=timeout,
                          env={**os.environ, "PYTHONPATH": str(root)})  # fmt: skip


def test_examples_pass_ruff_in_their_folders(tmp_path: Path) -> None:
    pytest.importorskip("ruff")
    examples_in_their_folders(tmp_path)
    assert len(list(tmp_path.rglob("*.py"))) == len(FILES)
    done = subprocess.run([sys.executable, "-m", "ruff", "check", "--no-cache", "."], cwd=tmp_path, capture_output=True,
                          text=True, timeout=60)  # fmt: skip
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_examples_pass_mypy_and_the_order_of_imports_in_their_folders(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    in_a_copy(tmp_path, "ruptfx", "tests/benchmarks", "demos")
    done = python_in(tmp_path, "-m", "mypy", timeout=1200)
    assert done.returncode == 0, done.stdout
    layers = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = python_in(tmp_path, "-c", layers, "--no-cache", timeout=300)
    assert done.returncode == 0, done.stdout


OF_EXAMPLES = """
import re

def pytest_collection_modifyitems(items):
    items[:] = [item for item in items if {kinds} & {{item.path.stem, *re.split(r"[][-]", item.name)}}]
"""
"""Plug-in of pytest that keeps the tests with a kind among their parameters, and those of a file for all kinds."""


def contracts_of_examples(root: Path, *files: str) -> None:
    """Run the contract tests of all examples in a copy of the repository."""
    kinds = in_a_copy(root, "ruptfx", "tests", "demos")
    (root / "of_examples.py").write_text(OF_EXAMPLES.format(kinds={*kinds, "test_support"}), encoding="utf-8")
    done = python_in(root, "-m", "pytest", "-p", "no:cacheprovider", "-p", "of_examples", *files, timeout=900)
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
@pytest.mark.fem
def test_examples_keep_the_contracts_in_their_folders(tmp_path: Path) -> None:
    """And every remedy of a refusal is accepted, and the table of support is true, with them among the kinds."""
    pytest.importorskip("dolfinx")
    contracts_of_examples(tmp_path, "tests/contracts", "--ignore=tests/contracts/test_every_key.py")


# -- examples --------------------------------------------------------------------------------------------------------


def test_friction_law_keeps_its_contract(tmp_path: Path) -> None:
    report = checked("hyperbolic_weakening")
    assert report.sound, report.rows


@pytest.mark.fem
def test_friction_law_in_a_run(tmp_path: Path) -> None:
    """The slip of the law is that of the fault, which ruptures."""
    pytest.importorskip("dolfinx")
    table = slip_weakening({"faults.main.friction": WEAKENING, "duration": 3e-6})
    with run(in_a_case("hyperbolic_weakening", table), tmp_path / "run") as record:
        slipped, slip = record.interface.slipped.values, record.interface.slip.values
        np.testing.assert_allclose(slipped, slip, rtol=1e-9, atol=1e-18)
        assert slip.max() > 0


def test_cohesive_law(tmp_path: Path) -> None:
    """It keeps its contract, and takes 1 / area times the strength and the opening at failure."""
    report = checked("trapezoidal")
    assert report.sound, report.rows
    law = executed("trapezoidal")["Trapezoidal"](f_t=2e6, c=2e6, G_Ic=13.0, G_IIc=13.0)
    assert law.opening_at_failure == pytest.approx(1e-5)
    opening = np.linspace(0, 1e-5, 10001)
    stress = 2e6 * law.remaining_fraction(law.damage(opening, 0 * opening))
    assert np.trapezoid(stress, opening) == pytest.approx(13.0, rel=1e-7)


@pytest.mark.fem
def test_fracture(tmp_path: Path) -> None:
    """Every facet has that stiffness, and a run keeps its energy."""
    pytest.importorskip("dolfinx")
    from helpers.crack_cases import case

    from ruptfx.run.model import Model

    table = case({"duration": 2e-6}).table()
    table["fracture"] = {"kind": "even_springs", "spring": 3e14, "default": table["fracture"]["default"]}
    broken = in_a_case("even_springs", table)
    assert Model(broken).cracks.stiffness == pytest.approx(3e14)
    with run(broken, tmp_path / "run") as record:
        assert float(np.abs(record.energy["closure"]).max()) < 1e-9


@pytest.mark.fem
def test_contact_method(tmp_path: Path) -> None:
    """With equal stiffnesses it is the compliant contact, the energies included."""
    pytest.importorskip("dolfinx")
    changes = {"duration": 3e-6, "output.interface_interval": 1e-6}
    ours = slip_weakening({**changes, "faults.main.contact": {"kind": "penalty", "stiff": 3e14}})
    theirs = slip_weakening({**changes, "faults.main.contact": {"kind": "compliant", "C_n": 3e14, "C_s": 3e14}})
    one = run(in_a_case("penalty", ours), tmp_path / "one")
    two = run(parse_case(theirs), tmp_path / "two")
    np.testing.assert_array_equal(one.interface.slip.values, two.interface.slip.values)
    np.testing.assert_array_equal(one.energy.to_array().values, two.energy.to_array().values)
    assert float(one.interface.slip.max()) > 0


@pytest.mark.fem
def test_nucleation(tmp_path: Path) -> None:
    """Half of the push after half of the rise."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    push = {"kind": "ramped_push", "extra": 2e6, "rise": 4e-6}
    model = Model(in_a_case("ramped_push", plates({"faults.main.nucleation": [push]})))
    assert model.faults[0].load(2e-6) == pytest.approx(1e6) and model.faults[0].load(9e-6) == pytest.approx(2e6)


@pytest.mark.fem
def test_slip_history(tmp_path: Path) -> None:
    """Half of the slip after half of the rise time, at twice the mean rate."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    slip = {"kind": "half_cosine", "slip": 3e-6, "rise_time": 4e-6}
    model = Model(in_a_case("half_cosine", plates({"faults.main.prescribed_slip": [slip]})))
    prescribed = model.faults[0].prescribed
    assert prescribed.slip(2e-6) == pytest.approx(1.5e-6) and prescribed.slip(9e-6) == pytest.approx(3e-6)
    assert prescribed.rate(2e-6) == pytest.approx(1.5) and prescribed.held.all()


@pytest.mark.fem
@pytest.mark.parametrize("plane", ["stress", "strain", "antiplane"])
def test_material(plane: Plane, tmp_path: Path) -> None:
    """Waves and forces are those of `isotropic_elastic` with E = G (3 lambda + 2 G) / (lambda + G) and
    nu = lambda / (2 (lambda + G)): lambda = G = 2 GPa is E = 5 GPa, nu = 1/4."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    given = {"kind": "lame_elastic", "first": 2e9, "second": 2e9, "density": 1200.0}
    same = {"kind": "isotropic_elastic", "young_modulus": 5e9, "poisson_ratio": 0.25, "density": 1200.0}
    changes = {"plane": plane, "mesh.element_size": 4e-3}
    ours = Model(in_a_case("lame_elastic", plates({**changes, "materials.default": given})))
    theirs = Model(parse_case(plates({**changes, "materials.default": same})))
    assert ours.wave_speeds() == pytest.approx(theirs.wave_speeds(), rel=1e-6)
    u = np.random.default_rng(0).normal(size=len(ours.mass))
    expected = theirs.internal_force(u)
    np.testing.assert_allclose(ours.internal_force(u), expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.fem
def test_mechanism(tmp_path: Path) -> None:
    """The mat moves as the boundary `spring` with the same stiffness does; it has a file and a column of its own."""
    pytest.importorskip("dolfinx")
    push = {"kind": "traction", "edge": "upper.top", "traction": [1e5, -1e6]}
    mat = {"kind": "mat", "name": "mat", "edge": "lower.bottom", "stiffness": 1e12}
    spring = {"kind": "spring", "edge": "lower.bottom", "normal": 1e12, "tangential": 1e12}
    fixed = {"duration": 6e-6, "stepper": {"kind": "leapfrog", "time_step": 2e-8}}
    ours = in_a_case("mat", plates({**fixed, "attachments": [mat], "boundaries": [push]}))
    theirs = parse_case(plates({**fixed, "boundaries": [push, spring]}))
    with run(ours, tmp_path / "ours") as one, run(theirs, tmp_path / "theirs") as two:
        mats, slip = one.energy["mat"].values, two.bulk["displacement"].values
        np.testing.assert_allclose(one.bulk["displacement"].values, slip, atol=1e-11 * np.abs(slip).max())
        np.testing.assert_allclose(
            one.energy["strain"].values + mats, two.energy["strain"].values, atol=1e-11 * mats.max()
        )
        assert mats.max() > 0 and np.abs(one.attachments["mat"]["force_y"].values).max() > 0
        assert float(np.abs(one.energy["closure"]).max()) < 1e-11


@pytest.mark.fem
def test_boundary(tmp_path: Path) -> None:
    """At a quarter of the period the whole amplitude pushes down on 12 mm."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    entry = {"kind": "oscillating_pressure", "edge": "upper.top", "amplitude": 1e6, "period": 4e-6}
    model = Model(in_a_case("oscillating_pressure", plates({"boundaries": [entry]})))
    (force,) = model.loads.forces
    nodal = np.zeros(2 * model.nodes)
    nodal[force.dofs] = force.values * force.factor(1e-6)
    assert nodal.reshape(-1, 2).sum(axis=0) == pytest.approx([0.0, -12e3], abs=1e-6)
    with pytest.raises(CaseError, match=facts(r"boundaries\.0: .*use traction")):
        in_a_case("oscillating_pressure", plates({"boundaries": [entry], "plane": "antiplane"}))


@pytest.mark.fem
def test_mesh_source(tmp_path: Path) -> None:
    """A quarter of the mass of the square at each of its corners, two of them on the interface."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    changes = {"mesh": {"kind": "one_element", "size": 2e-3}, "order": 1, "faults.main.contact": SPLIT}
    model = Model(in_a_case("one_element", plates(changes)))
    assert model.mass == pytest.approx(np.full(8, 1246.0 * 4e-6 / 4))
    (fault,) = model.faults
    assert fault.interface.position == pytest.approx([0.0, 2e-3]) and fault.interface.other_side == "rigid"


@pytest.mark.fem
def test_stepper(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    case = in_a_case("even_steps", plates({"stepper": {"kind": "even_steps", "number": 100}}))
    with run(case, tmp_path / "run") as record:
        assert record.summary["time_step"] == pytest.approx(5e-8)  # 5 us in 100 steps


@pytest.mark.fem
def test_operator(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from ruptfx.bodies.operators.ufl_form import UflForm
    from ruptfx.run.model import Model

    model = Model(in_a_case("counted", plates({"operator": "counted"})))
    operator: Any = model.operator
    u = np.random.default_rng(0).normal(size=len(model.mass))
    found, expected, calls = np.zeros_like(u), np.zeros_like(u), operator.calls
    operator.add_internal_force(u, found)
    UflForm(model.bulk).add_internal_force(u, expected)
    np.testing.assert_array_equal(found, expected)
    assert operator.calls == calls + 1 and np.abs(found).max() > 0


@pytest.mark.fem
def test_instrument(tmp_path: Path) -> None:
    """Bodies that turn by 3e-6 rad; the second look completes the samples at time zero."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model
    from ruptfx.run.recording.sampling import Samples

    entry = {"kind": "tiltmeter", "name": "tilt", "interval": 1e-6, "point": [5e-3, 1e-3]}
    model = Model(in_a_case("tiltmeter", plates({"instruments": [entry]})))
    samples, state = Samples(model, 1e-8, unstressed), model.initial_state()
    x, y = model.coordinates.T
    state.displacement[:] = 3e-6 * np.stack([-y, x], axis=1).ravel()
    samples.observe(state)
    state.time = 1e-7
    samples.observe(state)
    ((name, _, (values,)),) = samples.gather()
    assert name == "tilt" and values == pytest.approx(3e-6, rel=1e-9)


def test_term_of_an_objective(tmp_path: Path) -> None:
    """Its value is the mean slip; more shear stress everywhere, more slip."""
    pytest.importorskip("dolfinx")
    from ruptfx import gradient

    case = in_a_case("mean_slip", slip_weakening({"objective": [{"kind": "mean_slip"}]}))
    found = gradient(case, unknowns=["faults.main.initial_stress.shear"], progress=False)
    assert found["faults.main.initial_stress.shear"].attrs["units"] == "m/Pa"
    assert float(found["faults.main.initial_stress.shear"].sum()) > 0
    assert 0 < float(found["objective"]) < 1e-3


@pytest.mark.parametrize("names, fault, expected", [
    (["a"], None, "a"), (["a", "b"], "b", "b"), (["a", "b"], None, None), (["a"], "b", None),
])  # fmt: skip
def test_a_term_names_its_interface_where_there_are_several(names: list[str], fault: str | None, expected: str) -> None:
    term = {"kind": "mean_slip", **({"fault": fault} if fault else {})}
    case = in_a_case("mean_slip", slip_weakening({"objective": [term]}))
    bodies: Any = SimpleNamespace(model=SimpleNamespace(faults=[SimpleNamespace(name=name) for name in names]))
    if expected is None:
        with pytest.raises(ruptfx.RuptfxError, match=facts(rf"objective\.0\.fault = {fault}: .*{', '.join(names)}")):
            case.objective[0].requests(bodies, "objective.0")
    else:
        (request,) = case.objective[0].requests(bodies, "objective.0")
        assert (request.fault, request.field) == (expected, "slip")


def test_profile(tmp_path: Path) -> None:
    """A quarter of a wavelength from the origin it is at its crest."""
    sine = {"kind": "sine", "mean": 3.0, "amplitude": "2 Pa", "wavelength": "4 mm"}
    case = in_a_case("sine", plates({"faults.main.initial_stress.shear": sine}))
    stress = case.faults["main"].initial_stress.at(np.array([0.0, 1e-3, 3e-3]))
    assert stress.shear == pytest.approx([3.0, 5.0, 1.0])


MONITORED = """
import sys

sys.path.insert(0, "{}")
from sliding_time import sliding_time
from ruptfx.input import fields

fields.MONITORS += (sliding_time,)
from ruptfx import read_case, simulate

simulate(read_case(sys.argv[1]), sys.argv[2], progress=False)
"""


@pytest.mark.fem
def test_monitor_and_figure(tmp_path: Path) -> None:
    """Declared before all else is imported. Points that have not ruptured have not slid, others at most since then."""
    pytest.importorskip("dolfinx")
    table = slip_weakening({"duration": 3e-6})
    (tmp_path / "case.toml").write_text(tomli_w.dumps(table))
    script = MONITORED.format(EXAMPLES["sliding_time"].parent)
    done = subprocess.run(
        [sys.executable, "-c", script, "case.toml", "run"], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    with Record(tmp_path / "run") as record:
        sliding, since = record.interface.sliding_time, record.interface.rupture_time
        assert sliding.attrs["units"] == "s" and float(sliding.max()) > 1e-6
        assert (sliding.values[np.isnan(since.values)] == 0).all()
        step = record.summary["time_step"]
        assert (sliding + since).max() <= record.interface.time[-1] + step
        example = executed("opening")
        assert example["suits"](record)
        (line,) = example["opening"](record, units={"opening": "m"}).lines
        np.testing.assert_array_equal(line.get_ydata(), record.interface.opening.values.max(axis=0))


def test_movie(tmp_path: Path) -> None:
    """Its brightest picture is that of the largest displacement."""
    time, position = synthetic.times(3), synthetic.points(4)
    path = synthetic.write_run(tmp_path / "run", synthetic.crack(time, position), time, position, snapshots=3)
    with Record(path) as record:
        film, moved = executed("displacement")["displacement"](record), record.bulk["displacement"].values
        largest = np.linalg.norm(moved, axis=-1).max(axis=1)
        pictures = [np.nanmax(film.image(row)) for row in range(len(film.times))]
    assert len(pictures) == 3 and pictures == pytest.approx(list(largest), rel=0.1) and largest.max() > 0


def test_command(tmp_path: Path) -> None:
    (tmp_path / "data").write_bytes(bytes(2_000_000))
    app = typer.Typer()
    app.command()(executed("size")["size"])
    done = CliRunner().invoke(app, [str(tmp_path)])
    assert done.exit_code == 0 and done.output.split() == ["2", "MB"]


def test_benchmark(tmp_path: Path) -> None:
    shutil.copy(EXAMPLES["rayleigh_example"], tmp_path)  # the folder of the file has the name of a package
    assert run_benchmark("rayleigh_example", out=tmp_path / "numbers", folder=tmp_path)
    assert (tmp_path / "numbers" / "rayleigh_example.json").is_file()


def test_lumped_model(tmp_path: Path) -> None:
    """It comes to rest after v^2 / (2 mu g)."""
    table = {"plugins": plug_in("sliding_block"), "kind": "sliding_block", "speed": 2.0, "mu_d": 0.5}
    (tmp_path / "case.toml").write_text(tomli_w.dumps(table))
    found = lumped.simulate(read_case(tmp_path / "case.toml"), tmp_path / "run")
    assert float(found.slip[-1]) == pytest.approx(4.0 / 9.81)
    assert (tmp_path / "run" / "figures" / "slip.png").is_file()


@pytest.mark.fem
def test_mineral_map() -> None:
    """All cells of one height have one phase; layers of 2 mm in a specimen of 8 mm are four."""
    cls = executed("layered")["Layered"]
    phases = cls(thickness=2e-3, fractions={"a": 0.5, "b": 0.5}, seed=4)
    x, y = np.meshgrid(np.arange(5) * 1e-3, np.arange(8) * 1e-3)
    of_cells = phases.phase_of(np.column_stack([x.ravel(), y.ravel()]), 1e-3).reshape(8, 5)
    assert (of_cells == of_cells[:, :1]).all() and (of_cells[::2] == of_cells[1::2]).all()
    layers = {"kind": "layered", "thickness": 2e-3, "fractions": {"a": 0.5, "b": 0.5}, "seed": 4}
    shape = {"kind": "rectangle", "width": 4e-3, "height": 8e-3}
    case = in_a_case("layered", plates({"faults": {}}) | {
        "faults": {}, "mesh": {"kind": "specimen", "shape": shape, "element_size": 1e-3, "phases": layers},
    })  # fmt: skip
    mesh = case.mesh.build()
    height = mesh.points[mesh.cells].mean(axis=1)[:, 1]
    of_layer = {int(layer): set(mesh.cell_body[(height - height.min()) // 2e-3 == layer]) for layer in range(4)}
    assert all(len(bodies) == 1 for bodies in of_layer.values())


@pytest.mark.fem
def test_anisotropic_material() -> None:
    """Along x in plane strain rho c^2 is A for the fastest and L for the slowest wave; Love's constants by hand."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    rock = {"kind": "transversely_isotropic", "density": 2500.0, "A": 40e9, "C": 25e9, "F": 9e9, "L": 8e9, "N": 14e9}
    model = Model(in_a_case("transversely_isotropic", plates({"plane": "strain", "materials.default": rock})))
    speeds = model.wave_speeds()
    assert speeds.c_p == pytest.approx(4000.0) and speeds.c_s == pytest.approx((8e9 / 2500) ** 0.5)


@pytest.mark.fem
def test_fields_of_an_interface() -> None:
    """10 m of water are 98.1 kPa at y = 0; after half of its time a temperature is exp(-1/2) of that at the start."""
    pytest.importorskip("dolfinx")
    from ruptfx.interfaces.faults.fields import Heating
    from ruptfx.run.model import Model

    water = {"faults.main.pore_pressure": {"kind": "hydrostatic", "level": 10.0}}
    fields = Model(in_a_case("hydrostatic", plates(water))).faults[0].fields
    np.testing.assert_allclose(fields.initial()["pore_pressure"], 98.1e3)
    cools = {"faults.main.temperature": {"kind": "cooling", "start": 400.0, "time": 1e-3}}
    fields = Model(in_a_case("cooling", plates(cools))).faults[0].fields
    none = np.zeros(fields.points)
    later = fields.values(fields.memory(none), 3e-4, Heating(none, none, 2e-4))["temperature"]
    np.testing.assert_allclose(later, 400.0 * np.exp(-0.5))


@pytest.mark.fem
def test_hardening_springs() -> None:
    """12 mm of springs at 10 um: (1e12 Pa/m u + 1e20 Pa/m3 u^3) = 1e7 Pa + 1e5 Pa, against the motion."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    pads = {"kind": "hardening_springs", "name": "pads", "edge": "lower.bottom", "stiffness": 1e12, "hardening": 1e20}
    model = Model(in_a_case("hardening_springs", plates({"attachments": [pads]})))
    (mechanism,), state = model.attachments, model.initial_state()
    state.displacement[1::2] = 1e-5
    mechanism.add_external(state, None)
    assert state.force.reshape(-1, 2).sum(axis=0) == pytest.approx([0.0, -1.01e7 * 12e-3])


@pytest.mark.fem
@pytest.mark.parametrize("stepper", [
    {"kind": "leapfrog"}, {"kind": "generalized_alpha", "time_step": 1e-7},
])  # fmt: skip
@pytest.mark.parametrize("staged", [False, True])
def test_dashpots(stepper: dict[str, Any], staged: bool) -> None:
    """Across the plane with rho c_s they are the absorbing edge, in explicit and implicit steps and in stages."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model
    from ruptfx.run.stages import bind

    push = {"kind": "traction", "edge": "upper.top", "traction": [1e6], "ramp": 1e-6}
    edge = {"edge": "lower.bottom"}
    plain = plates({"plane": "antiplane", "stepper": stepper, "boundaries": [push]})
    speeds = Model(parse_case(plain)).wave_speeds()
    bed = {
        "kind": "dashpots",
        "name": "bed",
        "viscosity": speeds.c_s * plain["materials"]["default"]["density"],
        **edge,
    }
    results = []
    for change in ({"boundaries": [push, {"kind": "absorbing", **edge}]}, {"attachments": [bed]}):
        stages = {"stages": [{"duration": 6e-6}, {"duration": 6e-6, "damping": {"mass": 1e5}}]} if staged else {}
        case = in_a_case("dashpots", {**plain, **change, "duration": 12e-6, **stages})
        model = Model(case)
        motion, state = bind(model), model.initial_state()
        while state.time < case.duration:
            motion.step(state)
        results.append((state, motion.energies(state)))
    (edge_state, by_edge), (state, by_bed) = results
    assert by_bed["damping"] > 0.01 * by_bed["boundary_work"]
    for name, value in by_edge.items():
        assert by_bed[name] == pytest.approx(value, rel=1e-9, abs=1e-12 * by_edge["boundary_work"])
    np.testing.assert_allclose(state.velocity, edge_state.velocity, rtol=0, atol=1e-10 * np.abs(state.velocity).max())


@pytest.mark.fem
def test_forces_of_dashpots() -> None:
    """Bodies that move at 2 m/s in each direction: 3e6 Pa s/m resist over 12 mm by 72 kN/m, and take 288 kW/m."""
    pytest.importorskip("dolfinx")
    from ruptfx.run.model import Model

    bed = {"kind": "dashpots", "name": "bed", "edge": "lower.bottom", "viscosity": 3e6}
    moving = {"initial_velocity": {"lower": [2.0, 2.0], "upper": [2.0, 2.0]}, "boundaries": []}
    steps = {"stepper": {"kind": "leapfrog", "safety": 1e-4}}
    model = Model(in_a_case("dashpots", plates({"attachments": [bed], **moving, **steps})))
    motion, state = model.case.stepper.bind(model), model.initial_state()
    motion.step(state)
    assert state.attached["bed"]["force"].sum(axis=0) == pytest.approx([-72e3, -72e3], rel=1e-3)
    assert motion.energies(state)["damping"] == pytest.approx(288e3 * 0.5 * motion.dt, rel=1e-3)


@pytest.mark.fem
def test_stop_rule(tmp_path: Path) -> None:
    """It stops at the first record with the slip, 3 nm, which a run to the end passes."""
    pytest.importorskip("dolfinx")
    stop = {"stop_when": {"rules": [{"kind": "slip_beyond", "slip": 3e-9}]}, "output.interface_interval": 1e-7}
    with run(in_a_case("slip_beyond", slip_weakening({"duration": 3e-6, **stop})), tmp_path / "run") as record:
        largest = record.interface.slip.max("position").values
        assert record.summary["ended_by"] == "slip reached its limit"
        assert largest[-1] >= 3e-9 > largest[-2] and record.interface.time[-1] < 3e-6


def test_search_method(tmp_path: Path) -> None:
    """A study file names the plug-in and the kind; without the plug-in the kind is unknown."""
    from ruptfx.many_runs.study import search
    from ruptfx.many_runs.study.definition import read_study

    (tmp_path / "case.toml").write_text(tomli_w.dumps(plates()))
    text = f"""case = "case.toml"
plugins = {plug_in("shrinking_box")}
sampling = "search"
samples = 9
[[axes]]
key = "duration"
range = [1e-6, 3e-6]
[search]
method = {{ kind = "shrinking_box", shrink = 0.5 }}
[[search.goals]]
quantity = "max_slip"
at_least = 1.0
"""
    (tmp_path / "study.toml").write_text(text)
    study = read_study(tmp_path / "study.toml")
    assert study.search.method.kind() == "shrinking_box" and study.search.method.shrink == 0.5
    sets, _ = next(search._generations(study, study.search))
    assert sets[0] == pytest.approx([0.5]) and len(sets) == 8
    (tmp_path / "study.toml").write_text(text.replace('sampling = "search"', 'sampling = "cma_es"'))
    with pytest.raises(CaseError, match=facts(r"search\.method.*shrinking_box")):
        read_study(tmp_path / "study.toml")
